"""Which rise times the planner chooses within a tolerance that counts jumps, and when none."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from ocptip.motion.check import check_motion
from ocptip.motion.multi_start import LONGEST, SHORTEST, MultiStart, others, with_rise_time
from ocptip.motion.plan import plan_motion
from ocptip.published.tasks import experiment_task
from ocptip.standing.stops.along_path import PathStops
from ocptip.standing.tolerance import WORKSHOP, Uncertainty
from tests.quick import some


def within(name, tolerance=WORKSHOP, **changes):
    task = experiment_task(name)
    return replace(task, limits=replace(task.limits, tolerance=tolerance), **changes)


@pytest.mark.parametrize(("name", "rise"), some(1, [("B", 0.1), ("A", 0.05), ("E", 0.2)]))
def test_the_less_a_tolerance_leaves_at_rest_the_longer_is_the_rise(name, rise):
    assert with_rise_time(within(name)).rise_times == (rise,) * 6


@pytest.mark.parametrize(
    "task",
    [
        experiment_task("A"),
        within("A", Uncertainty(tilt=0.01, delay=0.01)),
        within("A", rise_times=0.0),
        within("A", rise_times=0.03),
    ],
    ids=["as described", "jumps do not overshoot", "ramps", "given"],
)
def test_what_needs_no_choice_stays(task):
    assert with_rise_time(task) is task


def test_motions_that_may_be_stopped_are_ramps():
    task = within("A")
    task = replace(task, limits=replace(task.limits, stops=PathStops()))
    assert with_rise_time(task) is task


def test_a_motion_that_must_not_last_longer_stays_ramps():
    task = within("D")
    assert with_rise_time(replace(task, limits=replace(task.limits, max_duration=2.13))).rise_times is None
    assert with_rise_time(replace(task, limits=replace(task.limits, max_duration=2.5))).rise_times


@pytest.mark.parametrize(
    ("rise", "expected"),
    [(0.1, [0.2, 0.05, 0]), (SHORTEST, [0.1, 0]), (LONGEST, [0.2, 0]), (0.0, [])],
)
def test_rise_times_next_to_one(rise, expected):
    found = [max(task.rise_times, default=0) for task in others(within("B", rise_times=rise))]
    assert found == pytest.approx(expected)


def test_changes_of_rise_times_are_steps_of_the_search():
    """Two that come to nothing: the bar goes on from the last start, and ends with the last change."""
    task = within("B", rise_times=LONGEST)
    told = list[tuple[int, int]]()
    search = MultiStart(replace(task, rise_times=None), range(1), 0, lambda *step: told.append(step[:2]))
    motion = SimpleNamespace(rise_times=task.rise_times)
    attempt = SimpleNamespace(motion=motion, cost=lambda objective: 1.0, after=lambda *tried: attempt)
    nothing = SimpleNamespace(begin=lambda *job: SimpleNamespace(result=lambda: None))
    search._change_rise_time(nothing, SimpleNamespace(task=task, attempt=attempt))
    assert told == [(0, 2), (0, 4), (1, 4), (2, 4)]


@pytest.mark.slow
def test_s_curves_cost_less_than_ramps_where_jumps_count():
    own, ramps = (plan_motion(within("A", **how), starts=1, jobs=1) for how in ({}, {"rise_times": 0}))
    assert not ramps.motion.rise_times
    assert own.motion.rise_times == own.task.rise_times
    assert min(own.motion.rise_times) >= SHORTEST
    assert own.energy < ramps.energy
    assert check_motion(own.task.robot, own.motion, own.task.limits, step=0.003).verified


@pytest.mark.slow
def test_ramps_win_where_jumps_cost_nothing():
    """A heavy cart: S-curves begin, the best motion is cheaper as ramps."""
    from studies.tolerance.run import on_cart

    task = on_cart("D")
    task = replace(task, limits=replace(task.limits, tolerance=WORKSHOP))
    assert with_rise_time(task).rise_times
    plan = plan_motion(task, starts=3, jobs=1)
    assert plan.task.rise_times == () == plan.motion.rise_times
    assert plan.energy < 1.01 * plan_motion(on_cart("D"), starts=3, jobs=1).energy
