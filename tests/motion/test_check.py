"""The check of a finished motion finds what happens between coarse samples."""

from dataclasses import replace

import numpy as np
import pytest

import ocptip.motion.check as check_module
import ocptip.reserves.slip as slip_module
from ocptip.basics.errors import InputError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.check import check_motion
from ocptip.motion.violations import sentence
from ocptip.published.cases import motion_case
from ocptip.published.tasks import PRINTED_LIMITS, experiment_robot, experiment_task
from ocptip.standing.at_rest.refusals import posture_refusals
from ocptip.standing.limits import Limits
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import some


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
        check_motion(robot, motion, step=1e-9)
    slow = RampCommand(motion.goal[0], 1.0, 1e-12)
    commands = [(slow,), *(joint.commands for joint in motion.joints[1:])]
    with pytest.raises(InputError, match="an acceleration that is far too small"):
        check_motion(robot, Trajectory.from_profiles(motion.start, commands))


def test_printed_motions_are_verified_with_the_printed_base():
    for name in "ABCDEFGH":
        checked = check_motion(*reference(name, "printed"), PRINTED_LIMITS)
        assert checked.verified, (name, checked.violations)
        assert checked.violations == ()


@pytest.mark.parametrize(
    ("name", "base"), some(1, [("B", "effective"), ("G", "effective"), ("A", "printed")])
)
def test_worst_values_are_those_of_a_very_dense_grid(name, base):
    robot, motion = reference(name, base)
    checked = check_motion(robot, motion)
    inner = np.concatenate([np.linspace(a, b, 402)[1:-1] for a, b in motion.intervals])
    dense = robot.samples(motion, inner)
    for key, values in (
        ("GN", dense.tip.GN),
        ("GT", dense.slip.GT),
        ("torque_ratio", np.max(np.abs(dense.torques) / robot.arm.limits.torque, axis=1)),
        ("clearance_m", -dense.clearances),
    ):
        worst = -checked.worst[key].value if key == "clearance_m" else checked.worst[key].value
        assert worst >= np.max(values) - 1e-9, key
        assert worst <= np.max(values) + 0.02 * abs(worst) + 1e-3, key


def test_violations_name_quantity_time_and_limit():
    robot, motion = reference("B", "effective")
    checked = check_motion(robot, motion)
    assert not checked.verified
    assert len(checked.violations) == 1
    text = sentence(checked.violations[0])
    assert text.startswith("GN is 0.99")
    assert "must be <= 0.9" in text
    assert checked.stands
    assert check_motion(robot, motion, Limits(GN=0.999)).verified


def test_a_motion_that_tips_is_refused():
    robot, motion = reference("B", "effective")
    checked = check_motion(robot, motion.time_scaled(0.5))
    assert not checked.verified
    assert checked.worst["GN"].value > 1
    assert any("slips or lifts" in v.detail for v in checked.violations)
    assert not checked.stands


def test_a_robot_on_springs_stands_whatever_its_feet_carry():
    robot, motion = reference("A", "printed")
    own = robot.support
    contacts = [replace(contact, stiffness=1e6) for contact in own.contacts]
    support = Support(contacts, mass=own.mass, center_of_mass=own.center_of_mass, gravity=own.gravity)
    checked = check_motion(robot.varied(support=support), motion.time_scaled(3.0))
    assert checked.worst["foot_force_N"].value > 1  # N: no index that ends at 1
    assert checked.verified
    assert checked.stands


@pytest.mark.parametrize("flaw", ["unsolved", "moving"])
def test_without_verified_contact_states_nothing_stands(monkeypatch, flaw):
    robot, motion = reference("A", "printed")
    evaluate = check_module.evaluate_limits

    def flawed(*arguments):
        found = evaluate(*arguments)
        return replace(found, **({"unsolved": [0.5]} if flaw == "unsolved" else {"lost": ("base",)}))

    monkeypatch.setattr(check_module, "evaluate_limits", flawed)
    checked = check_motion(robot, motion)
    assert max(checked.worst[name].value for name in ("GN", "GT")) < 0.9
    assert not checked.verified
    assert not checked.stands
    assert checked.to_dict()["stands"] is False


def test_an_upper_bound_of_the_slip_optimum_keeps_a_limit_and_is_named_where_it_does_not(monkeypatch):
    robot, motion = reference("A", "printed")
    GT = check_motion(robot, motion).worst["GT"].value
    monkeypatch.setattr(slip_module, "GAP_TOLERANCE", -1.0)  # no optimum is certified
    assert check_motion(robot, motion, Limits(GT=1.01 * GT)).verified
    checked = check_motion(robot, motion, Limits(GT=0.99 * GT))
    assert not checked.verified
    assert not any("no verified contact state" in violation.detail for violation in checked.violations)
    assert any("the slip optimum is not proved at" in violation.detail for violation in checked.violations)
    start, slope = motion.start, robot.support.varied(gravity=[0.3, 0.0, -9.81])
    robot = robot.varied(support=slope)
    assert posture_refusals(robot, Limits(GT=0.9), start) == []
    [refusal] = posture_refusals(robot, Limits(GT=1e-9), start)
    assert refusal.startswith("at rest the friction used is at most")


def test_a_motion_that_slides_is_told_the_friction_that_it_needs():
    robot, motion = reference("A", "printed")
    needed = check_motion(robot, motion).worst["GT"].value
    smooth = [
        replace(contact, friction=0.5 * needed * contact.friction) for contact in robot.support.contacts
    ]
    checked = check_motion(robot.varied(support=robot.support.varied(smooth)), motion)
    worst = checked.worst["GT"]
    assert worst.value > 1
    factor = checked.contacts.friction.value
    assert 1 < factor <= 2 * (1 + 1e-3)  # of the instant at which it slides fastest
    assert worst.detail.startswith(f"friction used {100 * factor:.0f} %: ")
    assert worst.detail.endswith("N of tangential force are missing")
    assert worst in checked.violations


def test_weak_instants_are_counted_on_the_first_grid_whatever_is_refined(monkeypatch):
    robot, motion = reference("A", "printed")
    corners = [(x, y, 0.0) for x in (-0.25, 0.25) for y in (-0.2, 0.2)]
    feet = [UnilateralContact(position=at, friction=0.08, facets=12) for at in corners]
    robot, motion = robot.varied(support=robot.support.varied(feet)), motion.time_scaled(0.9)
    refined = check_motion(robot, motion, step=0.02)
    monkeypatch.setattr("ocptip.motion.check._ROUNDS", 1)
    coarse = check_motion(robot, motion, step=0.02)
    assert refined.samples > coarse.samples
    assert refined.contacts.weak == coarse.contacts.weak > 0
    assert refined.contacts.first_weak == coarse.contacts.first_weak


def test_joint_limits_are_checked_exactly():
    robot, motion = reference("A", "printed")
    fast = check_motion(robot, motion.time_scaled(0.9))
    assert fast.worst["speed_ratio"].value == pytest.approx(
        check_motion(robot, motion).worst["speed_ratio"].value / 0.9
    )
    assert any(v.name == "speed_ratio" for v in fast.violations)
    start = motion.start
    far = [[RampCommand(phi, 0.5, 1.0)] for phi in start]
    far[1] = [RampCommand(3.0, 0.5, 1.0)]
    beyond = check_motion(robot, Trajectory.from_profiles(start, far))
    assert any(v.name == "angle_margin_deg" and "joint 2" in v.detail for v in beyond.violations)


def test_an_arm_that_does_not_move_is_checked_too():
    robot, motion = reference("A", "printed")
    still = Trajectory.from_profiles(motion.start, [[RampCommand(phi, 1.0, 1.0)] for phi in motion.start])
    checked = check_motion(robot, still)
    assert checked.verified
    assert checked.energy == 0
    assert checked.duration == 0


def test_results_are_plain_data():
    data = check_motion(*reference("C", "printed")).to_dict()
    assert set(data["worst"]) >= {"GN", "GT", "torque_ratio", "clearance_m"}
    assert data["verified"] is True
    assert data["worst"]["torque_ratio"]["detail"].startswith("joint ")


@pytest.mark.parametrize(
    "bad", [{"GN": 0.0}, {"GN": 1.2}, {"GT": 5.0}, {"GT": float("nan")}, {"clearance": -1.0}]
)
def test_bad_limits_are_named(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        Limits(**bad)


def test_parts_that_fit_into_memory_give_the_same(monkeypatch):
    task = experiment_task("B", "effective")
    whole, counts = check_motion(task.robot, task.reference, task.limits), []
    monkeypatch.setattr("ocptip.motion.sampled_limits._PART", 50)
    parts = check_motion(
        task.robot, task.reference, task.limits, progress=lambda done, total, _: counts.append((done, total))
    )
    assert parts.samples == whole.samples
    for name in ("force", "moment", "edge", "friction"):
        one, other = getattr(parts.contacts, name), getattr(whole.contacts, name)
        assert one.value == pytest.approx(other.value, rel=1e-8), name
    for name, worst in whole.worst.items():
        assert parts.worst[name].value == pytest.approx(worst.value, rel=1e-9), name
        assert parts.worst[name].time == pytest.approx(worst.time, nan_ok=True, abs=1e-6), name
    assert counts[0][0] == 0
    assert counts[-1][1] == whole.samples
