"""A base on wheels with hinges in MuJoCo, with its arm locked, and when it tips."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from ocptip.robots.kinematics import link_frames
from ocptip.standing.arm import Robot

STEP, SETTLE, RADIUS, ROUGH = 1e-3, 0.3, 0.08, 2.0
GAIN = 0.25  # N m s/rad per kg, of the wheels' controllers
WINDOW, SHARES = 0.1, (0.3, 0.05)  # s, and shares of the force between which its course is straight
WHEEL, SPINS = 0.01, 1e-3  # kg, kg m^2: the mass of the base has that of its wheels in it


def _vector(values: ArrayLike) -> str:
    return " ".join(f"{x:.12g}" for x in np.ravel(values))


def _inertial(mass: float, place: np.ndarray, tensor: np.ndarray) -> str:
    xx, xy, xz, _, yy, yz, _, _, zz = np.ravel(tensor)
    full = _vector([xx, yy, zz, xy, xz, yz])
    return f'<inertial mass="{mass:.12g}" pos="{_vector(place)}" fullinertia="{full}"/>'


def driven(robot: Robot) -> np.ndarray:
    """(c,) whether a contact is a wheel with a hinge; one without friction is a caster."""
    return np.array([getattr(contact, "friction", 0.0) > 0 for contact in robot.support.contacts])


def on_wheels(robot: Robot, q: np.ndarray, axes: np.ndarray) -> mujoco.MjModel:
    """The model of a robot in posture q (n,) on wheels with hinges along axes, (c, 3), and on casters."""
    support, arm = robot.support, robot.arm
    frames, bodies, wheels, motors = link_frames(arm, q), "", "", ""
    for k in range(arm.links):
        turn = frames.rotations[k]
        place = frames.origins[k] + turn @ arm.centres[k]
        bodies += f"<body>{_inertial(arm.masses[k], place, turn @ arm.inertias[k] @ turn.T)}</body>"
    own = _inertial(WHEEL, np.zeros(3), SPINS * np.eye(3))
    rows = zip(support.contacts, axes, driven(robot), strict=True)
    for k, (contact, axis, hinged) in enumerate(rows):
        centre = _vector(np.add(contact.position, [0, 0, RADIUS]))
        joint = f'<joint name="w{k}" axis="{_vector(axis)}"/>' if hinged else ""
        grip = f'friction="{ROUGH} 0 0" condim="3"' if hinged else 'friction="0 0 0" condim="1"'
        # Twin wheels would touch each other: they only have contact with the ground.
        geom = f'<geom type="sphere" size="{RADIUS}" {grip} solref="0.004 1" priority="1" conaffinity="0"/>'
        wheels += f'<body pos="{centre}">{joint}{own}{geom}</body>'
        # Stiff enough for the mass that wheels follow their speeds, but stiffer ones chatter.
        motors += f'<velocity joint="w{k}" kv="{GAIN * robot.mass:.6g}"/>' if hinged else ""
    option = f'timestep="{STEP}" integrator="implicitfast" cone="elliptic" impratio="10"'
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco><option gravity="{_vector(support.gravity)}" {option}/>
      <worldbody><geom type="plane" size="0 0 1" contype="0"/>
        <body name="base"><freejoint/>{_inertial(support.mass, support.center_of_mass, support.inertia)}
          {bodies}{wheels}</body></worldbody>
      <actuator>{motors}</actuator></mujoco>""")


def tips_at(
    model: mujoco.MjModel,
    wheel_speeds: Callable[[float], np.ndarray],
    initial: tuple[float, float],
    seconds: float,
    axis: np.ndarray,
) -> float:
    """The time, s, at which nothing presses any more on the wheels beside a tipping axis.

    Wheels that grip chatter, the more the less they carry. So their force is the mean over `WINDOW`, and its
    zero is that of the straight line through its course between two shares of the force at the beginning.

    Args:
        model: see `on_wheels`.
        wheel_speeds: function of time, rad/s of each wheel with a hinge; before it the base settles.
        initial: m/s and rad/s, forward and about z.
        seconds: after which this ends; the result is infinite if the force is still large then.
        axis: contacts on the axis, from 1.
    """
    data, force = mujoco.MjData(model), np.zeros(6)
    times = STEP * np.arange(int((SETTLE + seconds) / STEP)) - SETTLE
    beside = np.zeros(len(times))
    data.qvel[[0, 5]], data.qvel[6:] = initial, wheel_speeds(0.0)
    for k, time in enumerate(times):
        data.ctrl[:] = wheel_speeds(max(0.0, time))
        mujoco.mj_step(model, data)
        for i in range(data.ncon):
            if max(data.contact[i].geom1, data.contact[i].geom2) not in axis:  # the ground is geometry 0
                mujoco.mj_contactForce(model, data, i, force)
                beside[k] += force[0]
    width = int(WINDOW / STEP)
    mean = np.convolve(beside, np.full(width, 1 / width), "valid")
    centres = times[: len(mean)] + 0.5 * WINDOW
    mean, centres = mean[centres > 0], centres[centres > 0]
    first, last = (int(np.argmax(mean < share * mean[0])) for share in SHARES)
    if not 0 < first < last:
        return np.inf
    slope, offset = np.polyfit(centres[first:last], mean[first:last], 1)
    return float(-offset / slope)
