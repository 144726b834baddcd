"""Payloads against bodies that Pinocchio welds to the tool, and against boxes cut into small pieces."""

import dataclasses
import itertools

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError
from ocptip.indices import rate_arm
from ocptip.numerics.inertia import parallel_axis
from ocptip.published.arms import arm_by_name
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.kinematics import link_frames
from ocptip.robots.payload import Payload
from ocptip.robots.urdf.arm import arm_from_pinocchio, arm_from_urdf
from ocptip.task_files.motion import load_task
from tests.places import EXAMPLES, UR5
from tests.robots.pinocchio_twin import dynamics, twin
from tests.robots.sample_arms import random_arm

PART = Payload(10.0, [0.03, -0.05, 0.12], [0.04, 0.002, -0.001, 0.05, 0.003, 0.03])
HELD = [Payload(0.4), Payload(7.0, [0.1, 0.2, -0.3]), PART, Payload.box(3.0, [0.1, 0.2, 0.4], [0, 0, 0.2])]


def welded(model, payload):
    """The bare arm in Pinocchio with the payload welded to its tool."""
    robot = twin(model)
    tool = pin.SE3(model.tool_rotation.copy(), model.offsets[-1].copy())
    body = pin.Inertia(payload.mass, payload.center_of_mass.copy(), payload.inertia.copy())
    robot.appendBodyToJoint(model.n, body, tool)
    return robot


def relative(value, expected) -> float:
    return float(np.abs(value - expected).max() / np.abs(expected).max())


@pytest.mark.parametrize("payload", HELD)
@pytest.mark.parametrize(
    "arm", [random_arm(1, 4), random_arm(2, 7), arm_by_name("FP1W2F")], ids=lambda arm: arm.name
)
def test_torques_base_wrench_and_energy_are_those_of_a_welded_body(arm, payload):
    loaded, robot = arm.with_payload(payload), welded(arm, payload)
    rng = np.random.default_rng(3)
    for q, qd, qdd in rng.uniform(-3, 3, (20, 3, arm.n)):
        force, moment, about = rng.uniform(-20, 20, (3, 3))
        ours = evaluate_dynamics(loaded, q, qd, qdd, force=force, moment=moment, about=about)
        torque, wrench = dynamics(robot, q, qd, qdd, [0, 0, -9.81], force, moment, about)
        assert relative(ours.torque, torque) < 1e-12
        assert relative(ours.wrench, wrench) < 1e-12


@pytest.mark.parametrize("payload", HELD)
def test_energy_is_that_of_a_welded_body(payload):
    """Along a motion the work of the torques is the change of kinetic and potential energy."""
    arm = arm_by_name("FP1W2F")
    loaded, robot = arm.with_payload(payload), welded(arm, payload)
    rng, data = np.random.default_rng(4), robot.createData()
    h = 1e-5
    for q, qd, qdd in rng.uniform(-2, 2, (5, 3, arm.n)):
        power = qd @ evaluate_dynamics(loaded, q, qd, qdd).torque
        ends = [
            pin.computeKineticEnergy(robot, data, q + t * qd + 0.5 * t**2 * qdd, qd + t * qdd)
            + pin.computePotentialEnergy(robot, data, q + t * qd + 0.5 * t**2 * qdd)
            for t in (-h, h)
        ]
        assert power == pytest.approx((ends[1] - ends[0]) / (2 * h), rel=1e-6, abs=1e-5)


def test_a_payload_is_replaced_and_taken_away_to_the_last_bit():
    arm = random_arm(5, 6)
    moved = arm.with_payload(PART).mounted([1, 2, 3]).with_limits(speed=np.full(6, 2.0))
    assert moved.payload is PART
    assert moved.masses.sum() == pytest.approx(arm.masses.sum() + 10)
    other = moved.with_payload(HELD[0]).with_payload(PART)
    free = other.with_payload(None)
    assert free.payload is None
    assert free.bare_link is None
    for name in ("masses", "centres", "inertias"):
        np.testing.assert_array_equal(getattr(other, name), getattr(moved, name))
        np.testing.assert_array_equal(getattr(free, name), getattr(arm, name))
    np.testing.assert_array_equal(free.mount_position, moved.mount_position)


def test_a_urdf_with_the_part_welded_in_is_the_same_arm():
    whole = pin.buildModelFromUrdf(str(UR5))
    frame = whole.frames[whole.getFrameId("tool0")]
    body = pin.Inertia(PART.mass, PART.center_of_mass.copy(), PART.inertia.copy())
    whole.appendBodyToJoint(frame.parentJoint, body, frame.placement)
    names = {"base_link": "base_link", "tool_frame": "tool0"}
    expected = arm_from_pinocchio(whole, **names)
    loaded = arm_from_urdf(UR5, **names).with_payload(PART)
    for name in ("masses", "centres", "inertias"):
        np.testing.assert_allclose(getattr(loaded, name), getattr(expected, name), rtol=0, atol=1e-12)


def test_the_cart_of_the_example_tips_under_the_mass_found_by_hand():
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    robot, states = task.robot, (task.start[None], np.zeros((1, 6)), np.zeros((1, 6)))
    loaded = robot.varied(arm=robot.arm.with_payload(Payload(10.0)))
    assert loaded.masses == pytest.approx({"base": 35.0, "arm": robot.mass - 35.0, "payload": 10.0})
    assert loaded.mass == pytest.approx(robot.mass + 10)
    weight = loaded.loads(*states)[1] - robot.loads(*states)[1]
    np.testing.assert_allclose(weight[0, :3], [0, 0, -98.1], atol=1e-9)
    # the part hangs at the TCP of the start pose, (0.3, 0.5, 0.9) in base axes
    lever = np.array([0.30, 0.50, 0.90]) - robot.support.center_of_mass
    np.testing.assert_allclose(weight[0, 3:], np.cross(lever, [0, 0, -98.1]), atol=1e-6)
    # about the left wheels at y = 0.2 base and arm balance this mass at y = 0.5
    frames = link_frames(robot.arm, task.start)
    y = frames.origins[:-1, 1] + np.einsum("kj,kj->k", frames.rotations[:-1, 1], robot.arm.centres)
    heaviest = (35.0 * 0.2 + robot.arm.masses @ (0.2 - y)) / 0.3
    for factor, stands in ((0.99, True), (1.01, False)):
        held = robot.varied(arm=robot.arm.with_payload(Payload(factor * heaviest)))
        assert held.contact_states(held.loads(*states)[1]).persistent[0] == stands
    assert robot.masses_to_dict()["payload"] is None
    assert loaded.masses_to_dict()["payload"] == {"mass": 10.0, "center_of_mass": [0.0, 0.0, 0.0]}


def test_indices_that_weigh_masses_see_the_payload():
    arm, q = arm_by_name("FP1W2F"), [0, 0.7, -1.05, 0.2, 0.9, 0.3]
    free, loaded = rate_arm(arm, q), rate_arm(arm.with_payload(PART), q)
    assert loaded["dm_2"].value == free["dm_2"].value
    assert loaded["dm_2_weighted"].value > 1.1 * free["dm_2_weighted"].value


def test_a_box_is_the_sum_of_its_pieces():
    size, cuts = np.array([0.1, 0.2, 0.4]), 24
    steps = (np.arange(cuts) + 0.5) / cuts - 0.5
    pieces = np.array(list(itertools.product(steps, repeat=3))) * size
    expected = sum(parallel_axis(3.0 / len(pieces), p) for p in pieces)
    np.testing.assert_allclose(Payload.box(3.0, size).inertia, expected, rtol=3e-3, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Payload(0.0), "mass: must be > 0"),
        (lambda: Payload(np.nan), "mass: must be finite"),
        (lambda: Payload(1e13), "mass: magnitudes above"),
        (lambda: Payload(1.0, [0, 0]), "center_of_mass: expected shape 3"),
        (lambda: Payload(1.0, [0, 0, np.inf]), "center_of_mass: contains NaN or infinity"),
        (lambda: Payload(1.0, inertia=[1, 1]), "inertia: expected shape 3 x 3"),
        (lambda: Payload(1.0, inertia=[1, 1, -1]), "inertia: must be positive definite"),
        (lambda: Payload(1.0, inertia=[1, 1, 0]), "inertia: must be positive definite"),
        (lambda: Payload(1.0, inertia=[1, 1, 2.1]), "inertia: no body has these principal values"),
        (lambda: Payload(1.0, inertia=[[1, 1, 0], [0, 1, 0], [0, 0, 1]]), "inertia: must be symmetric"),
        (lambda: Payload.box(1.0, [1, 1]), "box: expected shape 3"),
        (lambda: Payload.box(1.0, [1, 1, 0]), "box: dimensions must be > 0"),
        (lambda: Payload.box(-1.0, [1, 1, 1]), "mass: must be > 0"),
    ],
)
def test_what_cannot_be_is_refused(make, message):
    with pytest.raises(InputError, match=f"^{message}"):
        make()


def test_a_payload_says_what_it_is():
    assert str(Payload(1.0, [0, 0.1, 0])) == "point mass at (0, 0.1, 0) m"
    assert str(HELD[3]) == "centre at (0, 0, 0.2) m, principal moments 0.0125, 0.0425, 0.05 kg m^2"
    data = PART.to_dict()
    assert Payload(**data).to_dict() == data
    with pytest.raises(dataclasses.FrozenInstanceError):
        PART.mass = 3.0
    with pytest.raises(ValueError, match="read-only"):
        PART.inertia[0, 0] = 1.0
