"""Payload and base from a sensor and from loads of feet; the regressors against the library's recursion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from ocptip.basics.errors import InputError
from ocptip.contact.support import Support
from ocptip.measured.bodies import identify_bodies, tables
from ocptip.measured.parameters import (
    body_of,
    link_parameters,
    moved_parameters,
    on_sensor,
    parameters_of,
    regressors,
)
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import Recording, Signal
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.payload import Payload
from ocptip.robots.process import AXES, ProcessWrench
from ocptip.standing.arm import Robot
from ocptip.standing.sensor import WrenchSensor
from ocptip.task_files.tables.arm import arm_of_file
from tests.measured.machines import changed, predictor, recorded, values_of
from tests.places import ROOT
from tests.quick import THOROUGH, some

HELD = Payload(2.0, [0.02, -0.01, 0.05], [0.01, 0.012, 0.008])


def test_regressors_are_newton_and_euler():
    robot = predictor().robot
    rng = np.random.default_rng(1)
    states = [rng.normal(size=(6, robot.n)) for _ in range(3)]
    torques, wrenches = regressors(robot.arm, robot.support.gravity, *states)
    expected = robot.loads(*states)
    parameters = link_parameters(robot.arm)
    np.testing.assert_allclose(torques @ parameters, expected[0], atol=1e-11)
    sensor = WrenchSensor([0.1, 0.2, -0.3], rotation=np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]))
    seen = on_sensor(sensor, wrenches[:, :, 10:]) @ parameters
    np.testing.assert_allclose(seen, sensor.reads(robot.support, expected[1]), atol=1e-11)


def test_the_ur5_with_its_sliding_or_turning_joints_and_gravity_on_a_slope():
    arm = arm_of_file(ROOT / "src/ocptip/examples/tasks/ur5_cart.toml")
    sliding = replace(arm, prismatic=np.arange(arm.n) == 2)
    gravity = np.array([1.0, -2.0, -9.5])
    rng = np.random.default_rng(2)
    states = [rng.normal(size=(4, arm.n)) for _ in range(3)]
    for own in (arm, sliding):
        torques, wrenches = regressors(own, gravity, *states)
        expected = evaluate_dynamics(own, *states, gravity=gravity)
        parameters = link_parameters(own)
        rotors = own.armature * states[2]
        np.testing.assert_allclose(torques @ parameters + rotors, expected.torque, atol=1e-10)
        np.testing.assert_allclose(wrenches[:, :, 10:] @ parameters, expected.wrench, atol=1e-10)


def test_parameters_of_bodies_go_both_ways():
    body = (2.0, np.array([0.1, -0.2, 0.3]), np.diag([0.2, 0.3, 0.4]) + 0.01)
    mass, centre, inertia = body_of(parameters_of(body))
    assert mass == 2.0
    np.testing.assert_allclose(centre, body[1])
    np.testing.assert_allclose(inertia, body[2], atol=1e-15)
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    moved = body_of(moved_parameters(turn, np.array([1.0, 2, 3])) @ parameters_of(body))
    np.testing.assert_allclose(moved[1], [1.0, 2, 3] + turn @ body[1])
    np.testing.assert_allclose(moved[2], turn @ body[2] @ turn.T, atol=1e-13)


def test_a_payload_is_found_within_a_percent_and_its_intervals_hold():
    robot = predictor().robot
    robot = robot.varied(arm=robot.arm.with_payload(HELD))
    inside = []
    for seed in range(8 if THOROUGH else 2):
        found = identify_bodies(recorded(seed, robot=robot), predictor(), bandwidth=np.inf)
        body = found.bodies[0]
        away = np.append(body.mass - HELD.mass, body.center - HELD.center_of_mass)
        assert abs(away[0]) < 0.01 * HELD.mass
        inside.append(np.abs(away) < body.quantile * body.errors)
    assert np.mean(inside) > 0.85
    assert body.errors[0] < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(("cutoff", "causal"), some(1, [(8.0, True), (3.0, True), (5.0, False)]))
def test_a_payload_is_identified_from_a_filtered_sensor(cutoff, causal):
    """SciPy's filter over the noisy sensor; taken for a plain signal, the answer is a negative mass."""
    robot = predictor().robot
    recording = recorded(0, robot=robot.varied(arm=robot.arm.with_payload(HELD)))
    sections = signal.butter(2, cutoff, fs=1 / recording.period, output="sos")
    for name in ("fx", "fy", "fz", "mx", "my", "mz"):
        own = values_of(recording, name)
        for _ in range(1 if causal else 2):
            own = signal.sosfilt(sections, own, zi=signal.sosfilt_zi(sections) * own[0])[0]
            own = own if causal else own[::-1]
        recording = changed(recording, name, own)
    found = identify_bodies(recording, predictor())
    told, body = found.estimate.low_passes["sensor"], found.bodies[0]
    assert (told.order, told.causal) == (2, causal)
    assert told.cutoff == pytest.approx(cutoff, rel=0.01)
    assert body.mass == pytest.approx(HELD.mass, rel=1e-3)
    np.testing.assert_allclose(body.center, HELD.center_of_mass, atol=1e-3)
    with pytest.raises(InputError, match="nothing is seen of it"):
        identify_bodies(recording, predictor(), bandwidth=np.inf)


@pytest.mark.slow
@pytest.mark.parametrize("axes", some(1, AXES))
def test_what_a_process_does_to_the_gripper_is_no_payload(axes):
    robot = predictor().robot
    process = ProcessWrench([1.0, -2.0, -10.0], [0.2, 0.5, 0.1], axes)
    described = robot.varied(arm=robot.arm.with_process(process))
    real = robot.varied(arm=described.arm.with_payload(HELD))
    nominal = Predictor(described, predictor().motion)
    body = identify_bodies(recorded(0, robot=real), nominal).bodies[0]
    assert body.mass == pytest.approx(HELD.mass, rel=0.01)
    np.testing.assert_allclose(body.center, HELD.center_of_mass, atol=2e-3)


@pytest.mark.slow
def test_a_tared_sensor_tells_a_payload_from_the_motion_alone():
    robot = predictor().robot
    robot = robot.varied(arm=robot.arm.with_payload(HELD))
    recording = recorded(3, robot=robot)
    for name in ("fx", "fz", "my"):
        recording = changed(recording, name, values_of(recording, name) + 7.0)
    body = identify_bodies(recording, predictor(), tared=True).bodies[0]
    assert body.mass == pytest.approx(HELD.mass, abs=4 * body.errors[0])
    assert body.errors[0] < 0.05
    with pytest.raises(InputError, match="tared"):
        identify_bodies(recording, predictor(), ("base",), tared=True)


def on_feet(robot: Robot, seed: int, noise: float = 0.2) -> Recording:
    """Normal forces of three feet by the balance of forces and moments, from the wrench on the base."""
    recording = recorded(seed)
    times = recording.times - 0.1234567
    wrenches = robot.loads(*predictor().states(times, np.zeros(robot.n)))[1]
    support = robot.support
    places = np.array([c.position for c in support.contacts]) - support.center_of_mass
    heights = places[:, 2]
    across = np.stack([np.ones(3), places[:, 1], -places[:, 0]])
    # friction acts at the feet's height: its moment about the centre of mass is known by its force
    tangential = np.cross([0.0, 0.0, heights[0]], -wrenches[:, :3] * [1, 1, 0])
    right = np.stack([-wrenches[:, 2], *(-wrenches[:, 3:5] - tangential[:, :2]).T])
    forces = np.linalg.solve(across, right)
    rng = np.random.default_rng(seed)
    feet = [
        Signal(f"normal{k}", "feet", k - 1, f + noise * rng.normal(size=len(f)))
        for k, f in enumerate(forces, 1)
    ]
    return replace(recording, signals=(*(s for s in recording.signals if s.kind == "angles"), *feet))


def test_loads_of_feet_are_those_of_the_contacts():
    robot = predictor().robot
    recording = on_feet(robot, 0, noise=0.0)
    samples = robot.samples(predictor().motion, np.array([0.5]))
    seen = [np.interp(0.6234567, recording.times, s.values) for s in recording.of("feet")]
    np.testing.assert_allclose(seen, samples.states.contact_forces[0, :, 0], atol=0.3)


def test_base_and_payload_are_found_from_the_feet():
    nominal = predictor()
    support = nominal.robot.support
    real = Support(
        support.contacts, mass=1.08 * support.mass,
        center_of_mass=np.add(support.center_of_mass, [0.01, -0.02, 0.0]), inertia=support.inertia,
        gravity=support.gravity,
    )  # fmt: skip
    robot = nominal.robot.varied(support=real, arm=nominal.robot.arm.with_payload(HELD))
    found = identify_bodies(on_feet(robot, 5), nominal, ("payload", "base"))
    payload, base = found.bodies
    assert base.mass == pytest.approx(real.mass, rel=0.01)
    assert payload.mass == pytest.approx(HELD.mass, abs=4 * payload.errors[0])
    for body, true in ((payload, HELD.center_of_mass), (base, real.center_of_mass)):
        for k in np.flatnonzero(body.seen[1:]):
            assert body.center[k] == pytest.approx(true[k], abs=4 * body.errors[1 + k])
    assert base.seen.tolist() == [True, True, True, False]  # no slope: its height is not told
    assert base.center[2] == support.center_of_mass[2]
    table = tables(found, 3.0)["tolerance"]
    assert table["base_mass"][0] < real.mass < table["base_mass"][1]
    assert table["center_of_mass"][2] == 0.0


@pytest.mark.slow
def test_what_rests_on_a_sensor_is_found():
    robot = predictor().robot
    plate = WrenchSensor([0.0, 0.0, -0.1], mass=5.0, center_of_mass=[0.0, 0.0, -0.05])
    nominal = Predictor(robot.varied(sensor=plate), predictor().motion)
    real = replace(plate, mass=5.5, center_of_mass=[0.01, 0.0, -0.05])
    own = Predictor(robot.varied(sensor=real), predictor().motion)
    recording = recorded(0)
    state = own.state(recording.times - 0.1234567, np.zeros(6), np.zeros(25))
    rng = np.random.default_rng(0)
    for one in recording.of("sensor"):
        values = own.signal("sensor", one.index, state) + 0.1 * rng.normal(size=len(one.values))
        recording = changed(recording, one.name, values)
    base = identify_bodies(recording, nominal, ("base",)).bodies[0]
    assert base.mass == pytest.approx(5.5, abs=0.01)
    np.testing.assert_allclose(base.center[:2], [0.01, 0.0], atol=1e-3)


def test_what_cannot_be_told_is_refused():
    recording = recorded(0)
    with pytest.raises(InputError, match=r"does not rest on the sensor \(\[sensor\] mass = 0\)"):
        identify_bodies(recording, predictor(), ("base",))
    with pytest.raises(InputError, match="expected payload or base"):
        identify_bodies(recording, predictor(), ("arm",))
    angles = replace(recording, signals=tuple(recording.of("angles")))
    with pytest.raises(InputError, match="neither a force-torque sensor"):
        identify_bodies(angles, predictor())
    feet = on_feet(predictor().robot, 0)
    two = replace(feet, signals=feet.signals[:-1])
    with pytest.raises(InputError, match="normal forces of 2 contacts, there are 3"):
        identify_bodies(two, predictor())
