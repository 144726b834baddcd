"""Motions at the worst of a tolerance: no sample is worse, and the named worst is attained."""

import dataclasses

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.motion.check import check_motion
from ocptip.motion.within_tolerance import jump_states, tolerable, worst_within
from ocptip.published.tasks import experiment_task
from ocptip.reserves.tipping import TipMap
from ocptip.standing.limits import MotionLimits
from ocptip.standing.tolerance import SITE, WORKSHOP, Tolerance
from ocptip.standing.worst_case import worst_case_of
from ocptip.task_files.motion import load_task
from ocptip.trajectories.arm_motion import ArmMotion
from studies.tolerance.samples import sampled_wrenches
from tests.places import EXAMPLES


@pytest.fixture(scope="module")
def task():
    return experiment_task("B", "effective")


def slow(task, factor):
    limits = task.robot.limits
    rates = limits.speed / factor, limits.acceleration / factor**2
    return ArmMotion.with_passive(task.start, task.goal, [None] * task.robot.n, *rates)


@pytest.mark.parametrize("factor", [1.6, 3.0])
def test_no_sample_is_worse_than_the_worst_case(task, factor):
    robot, motion = task.robot, slow(task, factor)
    checked = check_motion(robot, motion, dataclasses.replace(task.limits, tolerance=WORKSHOP))
    within, cases = checked.within, worst_case_of(robot, WORKSHOP)
    wrenches = sampled_wrenches(robot, motion, WORKSHOP, np.random.default_rng(0), 4000)
    states = cases.robot.contact_states(wrenches)
    moments = wrenches @ cases.robot.tip_over.affine_moments[0].T
    least = float(cases.tip_ratio(moments.min()))
    assert least <= within.tip.bound + 1e-3  # of delays inside the window, up to their second order
    assert within.tip.value <= within.tip.bound
    assert within.tip.bound - within.tip.value < 0.01 * within.tip.value
    assert least > checked.worst["GN"].value  # samples find something
    if within.tip.bound < 1:
        GT = cases.robot.slip.evaluate(states, derivatives=False).GT
        assert GT.max() <= within.slip.value + 1e-3
        assert states.persistent.all()


def test_how_much_of_a_tolerance_a_motion_can_have(task):
    motion, tolerance = slow(task, 2.0), Tolerance(tilt=np.radians(3.0), friction=0.2, damping=0.05)
    limits = dataclasses.replace(task.limits, tolerance=tolerance)
    share, why = tolerable(task.robot, motion, limits)
    assert 0.1 < share < 0.9
    assert why.startswith("of floor tilt 3 deg alone it can have floor tilt ")
    times = np.linspace(0, motion.end, 300)
    for factor, kept in ((share - 0.03, True), (share + 0.05, False)):
        found = worst_within(task.robot, motion, tolerance.scaled(factor), times).measured(limits)
        assert all(worst.excess <= 0 for worst in found) == kept


def test_verified_only_if_the_worst_case_is(task):
    motion = slow(task, 3.0)
    loose = dataclasses.replace(task.limits, tolerance=Tolerance(tilt=np.radians(0.5)))
    assert check_motion(task.robot, motion, task.limits).verified
    assert check_motion(task.robot, motion, loose).verified
    strict = dataclasses.replace(task.limits, tolerance=SITE)
    checked = check_motion(task.robot, motion, strict)
    assert not checked.verified
    assert any(text.startswith("GN_worst_case is ") for text in checked.violations)
    assert "tilt 1.5 deg towards" in checked.within.tip.how
    assert checked.to_dict()["within_tolerance"]["tolerance"]["push"] == 20
    assert "contact" in checked.within.tip.left


def test_jumps_overshoot_together_if_nothing_is_late(task):
    motion = slow(task, 2.0)
    found = jump_states(motion, Tolerance(damping=0.05))
    assert len(found.times) == len(motion.event_times)
    start = found.s[np.argmin(found.times), 12:]
    acceleration = motion.states(np.array([1e-4]))[2][0]
    assert np.allclose(start, (1 + np.exp(-np.pi * 0.05 / np.sqrt(1 - 0.05**2))) * acceleration)
    assert jump_states(motion, Tolerance(tilt=0.01)).s.shape == (0, 18)


def test_late_joints_are_combined_in_all_ways(task):
    motion = slow(task, 2.0)
    found = jump_states(motion, Tolerance(delay=0.01))
    first = found.s[found.times == 0.0, 12:]
    moving = np.flatnonzero(motion.states(np.array([1e-4]))[2][0])
    assert len(first) == 2 ** len(moving)
    assert len(np.unique(first, axis=0)) == len(first)
    assert "late" in found.words[0]


def test_late_s_curves_are_no_worse_than_the_states_that_are_looked_at(task):
    """Random delays of all joints at random instants: moments about the tipping axes, which are affine."""
    delay, robot = 0.015, task.robot
    motion = slow(task, 1.3).with_rise_times(0.04)
    found = jump_states(motion, Tolerance(delay=delay))
    assert any("late" in words for words in found.words)
    rng = np.random.default_rng(4)
    times = rng.uniform(0, motion.end + delay, 4000)
    late = np.where(
        rng.random((4000, 6)) < 0.5, rng.choice([0.0, delay], (4000, 6)), rng.uniform(0, delay, (4000, 6))
    )
    states = [np.empty((4000, 6)) for _ in range(3)]
    for j in range(6):
        for state, own in zip(states, motion.states(times - late[:, j]), strict=True):
            state[:, j] = own[:, j]

    def moments(q, qd, qdd):
        return TipMap(robot.tip_over)(robot.loads(q, qd, qdd)[1])[0]

    looked, on_time = moments(*np.hsplit(found.s, 3)), moments(*motion.states(times))
    least = np.minimum(looked.min(axis=0), on_time.min(axis=0))
    reference = robot.tip_over.reference_moment
    # angles and speeds of late joints are looked at elsewhere
    assert np.all(moments(*states).min(axis=0) > least - 0.01 * reference)
    then = moments(*motion.states(found.times))
    assert np.all((then - looked).max(axis=0) > 0.1 * reference)


def test_parallel_robots_are_refused():
    task = load_task(EXAMPLES / "tasks" / "delta_cart.toml")
    with pytest.raises(InputError, match="tolerance: looked at for arms only"):
        worst_case_of(task.robot, WORKSHOP)


def test_limits_say_what_is_asked_of_the_worst_case():
    limits = MotionLimits(tolerance=WORKSHOP)
    assert limits.to_dict()["GN_worst_case"] == 0.999
    assert limits.to_dict()["tolerance"]["speed"] == 0.03
    assert "tolerance" not in MotionLimits().to_dict()
