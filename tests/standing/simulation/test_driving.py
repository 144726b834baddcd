"""Bases that drive on wheels with hinges in MuJoCo: wheels lift where the drive envelope says so."""

import mujoco
import numpy as np
import pytest

from ocptip.robots.kinematics import link_frames
from ocptip.standing.drive_envelope import Manoeuvres, largest_manoeuvres
from ocptip.task_files.motion import load_task
from tests.places import EXAMPLES

STEP, SETTLE, RADIUS, ROUGH = 1e-3, 0.3, 0.08, 2.0
LIFTED = 0.15  # s: a wheel that lifts for longer does not chatter
WHEEL, SPINS = 0.01, 1e-3  # kg, kg m^2: the mass of the base has that of its wheels in it


def vector(values):
    return " ".join(f"{x:.12g}" for x in np.ravel(values))


def inertial(mass, place, tensor):
    xx, xy, xz, _, yy, yz, _, _, zz = np.ravel(tensor)
    full = vector([xx, yy, zz, xy, xz, yz])
    return f'<inertial mass="{mass:.12g}" pos="{vector(place)}" fullinertia="{full}"/>'


def on_wheels(robot, q, axes):
    """The model of a robot whose arm is locked, on wheels with hinges along axes, (n, 3)."""
    support, arm = robot.support, robot.arm
    frames, bodies, wheels, motors = link_frames(arm, q), "", "", ""
    for k in range(arm.links):
        turn = frames.rotations[k]
        place = frames.origins[k] + turn @ arm.centres[k]
        bodies += f"<body>{inertial(arm.masses[k], place, turn @ arm.inertias[k] @ turn.T)}</body>"
    own = inertial(WHEEL, np.zeros(3), SPINS * np.eye(3))
    for k, (contact, axis) in enumerate(zip(support.contacts, axes, strict=True)):
        centre = vector(np.add(contact.position, [0, 0, RADIUS]))
        joint = f'<joint name="w{k}" axis="{vector(axis)}"/>'
        grip = f'friction="{ROUGH} 0 0" condim="3" solref="0.004 1" priority="1"'
        wheels += f'<body pos="{centre}">{joint}{own}<geom type="sphere" size="{RADIUS}" {grip}/></body>'
        motors += f'<velocity joint="w{k}" kv="5"/>'
    option = f'timestep="{STEP}" integrator="implicitfast" cone="elliptic" impratio="10"'
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco><option gravity="{vector(support.gravity)}" {option}/>
      <worldbody><geom type="plane" size="0 0 1"/>
        <body name="base"><freejoint/>{inertial(support.mass, support.center_of_mass, support.inertia)}
          {bodies}{wheels}</body></worldbody>
      <actuator>{motors}</actuator></mujoco>""")


def tips_at(model, wheel_speeds, initial, seconds):
    """The time, s, at which more than two wheels touch the ground for the last time.

    One wheel of four may lift before, as rigid wheels share the load unevenly; wheels that grip chatter.

    Args:
        model: see `on_wheels`.
        wheel_speeds: function of time, rad/s of each wheel; before it the base settles.
        initial: m/s and rad/s, forward and about z.
        seconds: after which this ends.
    """
    data, force, last = mujoco.MjData(model), np.zeros(6), np.inf
    data.qvel[[0, 5]], data.qvel[6:] = initial, wheel_speeds(0.0)
    for k in range(int((SETTLE + seconds) / STEP)):
        time = k * STEP - SETTLE
        data.ctrl[:] = wheel_speeds(max(0.0, time))
        mujoco.mj_step(model, data)
        if time - last > LIFTED:
            return last
        if k % 5 == 0:
            pressed = 0
            for i in range(data.ncon):
                mujoco.mj_contactForce(model, data, i, force)
                pressed += force[0] > 1e-3
            last = time if pressed > 2 or time < 0 else last
    return np.inf


@pytest.fixture(scope="module")
def task():
    return load_task(EXAMPLES / "tasks" / "ur5_cart.toml")


@pytest.mark.parametrize(("slope", "posture"), [(0.0, "start"), (0.08, "start"), (-0.05, "goal")])
def test_wheels_lift_at_the_braking_of_the_envelope(task, slope, posture):
    robot, q = task.robot, getattr(task, posture)
    gravity = 9.81 * np.array([np.sin(slope), 0, -np.cos(slope)])
    brake = Manoeuvres.accelerations(np.array([[-1.0, 0, 0]]), gravity)
    predicted = largest_manoeuvres(robot, q, brake).tip[0]
    tilted = robot.varied(support=robot.support.varied(gravity=gravity), reference_moment=1.0)
    model = on_wheels(tilted, q, np.tile([0, 1, 0], (4, 1)))
    rate, initial = 1.0, 9.0  # the deceleration grows by `rate` per second

    def wheel_speeds(t):
        return np.full(4, (initial - rate * t**2 / 2) / RADIUS)

    time = tips_at(model, wheel_speeds, (initial, 0.0), 1.5 * predicted / rate)
    assert rate * time == pytest.approx(predicted, rel=0.02)


def test_wheels_lift_at_the_speed_of_the_envelope_in_a_curve(task):
    """All wheels are steered to the same centre, on the right; the speed grows slowly."""
    robot, radius, begin, rate = task.robot, 3.0, 1.5, 0.25
    steady, linear, square = np.zeros((3, 1, 9))
    steady[0, [0, 8]] = rate, -rate / radius
    square[0, 1], linear[0, 5] = -1 / radius, -1 / radius
    curve = Manoeuvres(steady, linear, square, robot.support.gravity[None])
    predicted = largest_manoeuvres(robot, task.start, curve).tip[0]
    spokes = np.array([np.add(contact.position, [0, radius, 0]) for contact in robot.support.contacts])
    away = np.linalg.norm(spokes, axis=1)
    model = on_wheels(robot, task.start, spokes / away[:, None])

    def wheel_speeds(t):
        return (begin + rate * t) * away / radius / RADIUS

    time = tips_at(model, wheel_speeds, (begin, -begin / radius), 1.5 * (predicted - begin) / rate)
    assert begin + rate * time == pytest.approx(predicted, rel=0.02)
