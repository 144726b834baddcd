"""What a start does with motions that are all but verified."""

import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import SolverError
from ocptip.motion.check import check_motion
from ocptip.motion.planner.attempt import Attempt, Clock
from ocptip.motion.planner.event_order import order_of
from ocptip.motion.planner.exact import MET, Refiner
from ocptip.motion.planner.one_start import SLOWED, Search
from ocptip.motion.planner.random_start import random_change, random_start
from ocptip.published.tasks import experiment_task
from ocptip.standing.tolerance import WORKSHOP
from tests.motion.planner.test_program import geared_task
from tests.quick import some


@pytest.fixture(scope="module")
def task():
    return experiment_task("A", "effective")


@cache
def formulation_of(task):
    return Search(task).formulation


def at_share(task, share):
    """The printed motion at this share of the speeds and accelerations that are allowed."""
    worst = check_motion(task.robot, task.reference, task.limits).worst
    ratio = max(worst["speed_ratio"].value, np.sqrt(worst["acceleration_ratio"].value))
    return task.reference.time_scaled(ratio / share)


@pytest.mark.parametrize(("share", "helped"), [(1 + 5e-5, True), (SLOWED + 1e-3, False)])
def test_what_exceeds_accelerations_by_rounding_is_slowed_down(task, share, helped):
    motion = at_share(task, share)
    assert not check_motion(task.robot, motion, task.limits).verified
    refiner = SimpleNamespace(motion=lambda exact: motion)
    found, checked = Search(task)._motion_and_check(refiner, None, Clock())
    assert checked.verified == helped
    assert found.end == pytest.approx(motion.end * (share if helped else 1.0), rel=1e-6)


@pytest.mark.parametrize(("factor", "helped"), some(1, [(0.99, True), (1.01, False), (None, False)]))
def test_a_hop_never_makes_it_worse(task, monkeypatch, factor, helped):
    """Where what it leads to is faster, slower or fails."""
    slow = at_share(task, 0.9)
    checked = check_motion(task.robot, slow, task.limits)
    assert checked.verified
    clock = Clock()
    clock.iterations = 100
    before = Attempt(clock.result(5, "verified", checked), slow, checked)
    search = Search(task)

    def refined(x, clock, most):
        clock.iterations += 7
        if factor is None:
            raise SolverError("no")
        motion = slow.time_scaled(factor)
        return (motion, check_motion(task.robot, motion, task.limits)), x, ""

    monkeypatch.setattr(search, "_fine", lambda x, clock: (x, 0.0))
    monkeypatch.setattr(search, "_refined", refined)
    monkeypatch.setattr(search, "_coarse", lambda x, limits, clock: (x, 0.0))
    after = search.hopped(before, (1, 2))
    assert after.motion.end == pytest.approx(slow.end * (factor if helped else 1.0))
    assert (after.result.number, after.result.verified, after.result.iterations) == (
        5,
        True,
        7,
    )  # what came before is not counted twice
    assert (before.result.iterations, clock.iterations) == (100, 100)  # the result so far is as it was
    assert after.result.energy == after.check.energy <= checked.energy


def test_a_motion_that_keeps_no_limits_is_told_in_words(task, monkeypatch):
    search = Search(task)
    refiner = Refiner(search.formulation, search.inner)
    order, x = order_of(search.formulation, search.formulation.variables(task.reference))
    exact = refiner.solve_order(order, x, start_mu=1e-3)
    broken = replace(exact.solution, x=x, violation=0.18, status="Restoration_Failed")
    monkeypatch.setattr(search, "_ordered", lambda *_: replace(exact, solution=broken))
    found, _, why = search._exact(refiner, x, Clock(), np.inf)
    assert found is None
    assert re.fullmatch(
        r"no motion: limits stay broken, most of all [a-z -]+ by 0\.18 in its units "
        r"\(the restoration reached no point where all of them are kept; Ipopt: Restoration_Failed\)",
        why,
    )


@given(seed=st.integers(0, 2**32))
def test_random_changes_keep_the_duration_and_are_no_two_alike(task, seed):
    formulation, rng = formulation_of(task), np.random.default_rng(seed)
    layout, x = formulation.layout, formulation.variables(task.reference)
    kept = x.copy()
    changed = random_change(layout, x, rng)
    assert np.array_equal(x, kept)
    assert changed[layout.end] == x[layout.end]
    for j in range(len(layout.joints)):
        d, c = changed[layout.d(j)], changed[layout.c(j)]
        assert d.min() > 0
        assert c.min() >= 0
        assert d.sum() + c.sum() <= x[layout.end] * (1 + 1e-12)
    assert not np.array_equal(changed, x)
    assert not np.array_equal(changed, random_change(layout, x, rng))


def test_slower_variables_are_the_same_path_in_more_time(task):
    formulation, rng = Search(task).formulation, np.random.default_rng(3)
    motion = random_start(task.robot, task.start, task.goal, task.optimised, task.commands, task.limits, rng)
    slower = formulation.motion(formulation.slowed(formulation.variables(motion), 1.6))
    times, optimised = np.linspace(0, motion.end, 20), list(task.optimised)
    expected, found = motion.states(times)[0], slower.states(1.6 * times)[0]
    np.testing.assert_allclose(found[:, optimised], expected[:, optimised], atol=1e-9)
    assert slower.end == pytest.approx(1.6 * motion.end)


@pytest.mark.slow
def test_where_little_is_left_within_a_tolerance_a_slower_motion_is_begun_with():
    """E on its effective base keeps 0.54 of 2.22 N m at rest; no order of the smooth programs holds."""
    task = experiment_task("E", "effective")
    attempt = Search(replace(task, limits=replace(task.limits, tolerance=WORKSHOP))).run(1, 0)
    assert attempt.result.verified
    assert 350 < attempt.result.energy < 450


@pytest.mark.slow
def test_switching_times_that_nearly_meet_are_one():
    """The interior-point method leaves up to 43 us between four pairs of them: no pieces of microseconds."""
    attempt = Search(geared_task()).run(0, 1)
    assert attempt.result.status == "verified"
    assert np.min(np.diff(attempt.motion.event_times)) > MET
