"""The check of a finished motion finds what happens between coarse samples."""

from dataclasses import replace

import numpy as np
import pytest

import ocptip.motion.check as proof_module
from ocptip.basics.errors import InputError
from ocptip.motion.check import prove
from ocptip.published.cases import motion_case
from ocptip.published.tasks import experiment_robot
from ocptip.standing.limits import MotionLimits
from ocptip.trajectories.arm_motion import ArmMotion
from ocptip.trajectories.ramps import RampCommand


def reference(name, base):
    case = motion_case(name)
    robot = experiment_robot(case, base)
    limits = robot.arm.limits
    return robot, case.reference_motion(limits.speed, limits.acceleration)


def test_a_grid_of_too_many_instants_is_refused():
    robot, motion = reference("A", "printed")
    with pytest.raises(
        InputError, match=r"^step: the motion lasts .* s, which would be .* instants at steps"
    ):
        prove(robot, motion, step=1e-9)
    slow = RampCommand(motion.goal[0], 1.0, 1e-12)
    commands = [(slow,), *(joint.commands for joint in motion.joints[1:])]
    with pytest.raises(InputError, match="an acceleration that is far too small"):
        prove(robot, ArmMotion.from_commands(motion.start, commands))


def test_printed_motions_are_verified_with_the_printed_base():
    for name in "ABCDEFGH":
        proof = prove(*reference(name, "printed"))
        assert proof.verified, (name, proof.violations)
        assert proof.violations == ()


@pytest.mark.parametrize(("name", "base"), [("B", "effective"), ("G", "effective"), ("A", "printed")])
def test_worst_values_are_those_of_a_very_dense_grid(name, base):
    robot, motion = reference(name, base)
    proof = prove(robot, motion)
    inner = np.concatenate([np.linspace(a, b, 402)[1:-1] for a, b in motion.intervals])
    dense = robot.samples(motion, inner)
    for key, values in (
        ("GN", dense.tip.GN),
        ("GT", dense.slip.GT),
        ("torque_ratio", np.max(np.abs(dense.torques) / robot.arm.limits.torque, axis=1)),
        ("clearance_m", -dense.clearances),
    ):
        worst = -proof.worst[key].value if key == "clearance_m" else proof.worst[key].value
        assert worst >= np.max(values) - 1e-9, key
        assert worst <= np.max(values) + 0.02 * abs(worst) + 1e-3, key


def test_violations_name_quantity_time_and_limit():
    robot, motion = reference("B", "effective")
    proof = prove(robot, motion)
    assert not proof.verified
    assert len(proof.violations) == 1
    assert proof.violations[0].startswith("GN is 0.99")
    assert "must be <= 0.9" in proof.violations[0]
    assert proof.stands
    assert prove(robot, motion, MotionLimits(GN=0.999)).verified


def test_a_motion_that_tips_is_refused():
    robot, motion = reference("B", "effective")
    proof = prove(robot, motion.time_scaled(0.5))
    assert not proof.verified
    assert proof.worst["GN"].value > 1
    assert any("slips or lifts" in v for v in proof.violations)
    assert not proof.stands


@pytest.mark.parametrize("flaw", ["unsolved", "moving"])
def test_without_verified_contact_states_nothing_stands(monkeypatch, flaw):
    robot, motion = reference("A", "printed")
    evaluate = proof_module._evaluate

    def flawed(*arguments):
        found = evaluate(*arguments)
        return replace(found, **({"unsolved": [0.5]} if flaw == "unsolved" else {"standing": False}))

    monkeypatch.setattr(proof_module, "_evaluate", flawed)
    proof = prove(robot, motion)
    assert max(proof.worst[name].value for name in ("GN", "GT")) < 0.9
    assert not proof.verified
    assert not proof.stands
    assert proof.to_dict()["stands"] is False


def test_joint_limits_are_checked_exactly():
    robot, motion = reference("A", "printed")
    fast = prove(robot, motion.time_scaled(0.9))
    assert fast.worst["speed_ratio"].value == pytest.approx(
        prove(robot, motion).worst["speed_ratio"].value / 0.9
    )
    assert any(v.startswith("speed_ratio") for v in fast.violations)
    start = motion.start
    far = [[RampCommand(phi, 0.5, 1.0)] for phi in start]
    far[1] = [RampCommand(3.0, 0.5, 1.0)]
    beyond = prove(robot, ArmMotion.from_commands(start, far))
    assert any(v.startswith("angle_margin_deg") and "joint 2" in v for v in beyond.violations)


def test_an_arm_that_does_not_move_is_checked_too():
    robot, motion = reference("A", "printed")
    still = ArmMotion.from_commands(motion.start, [[RampCommand(phi, 1.0, 1.0)] for phi in motion.start])
    proof = prove(robot, still)
    assert proof.verified
    assert proof.energy == 0
    assert proof.duration == 0


def test_results_are_plain_data():
    data = prove(*reference("C", "printed")).to_dict()
    assert set(data["worst"]) >= {"GN", "GT", "torque_ratio", "clearance_m"}
    assert data["verified"] is True
    assert data["worst"]["torque_ratio"]["detail"].startswith("joint ")


@pytest.mark.parametrize(
    "bad", [{"GN": 0.0}, {"GN": 1.2}, {"GT": 5.0}, {"GT": float("nan")}, {"clearance": -1.0}]
)
def test_bad_limits_are_named(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        MotionLimits(**bad)
