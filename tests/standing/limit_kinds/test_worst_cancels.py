"""Cancels within an uncertainty as limits of programs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ocptip.motion.check import check_motion
from ocptip.motion.plan import plan_motion
from ocptip.standing.instants import Instants, NodeColumns
from ocptip.standing.limit_kinds.rows import NodeSlopes
from ocptip.standing.limit_kinds.worst_cancels import WorstCancelLimit
from ocptip.standing.stops.by_cancel import Cancel
from ocptip.standing.tolerance import WORKSHOP
from ocptip.standing.within.cancelled import worst_of_cancels
from ocptip.standing.within.worst_case import worst_case_of
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES


@pytest.fixture(scope="module")
def task():
    return load_task(EXAMPLES / "tasks" / "ur5_cart.toml")


def limits_of_cancels(task, share: float):
    cancel = Cancel(tuple(share * task.robot.limits.acceleration))
    asked = replace(task.limits, cancel=cancel, tolerance=WORKSHOP)
    return cancel, WorstCancelLimit.of(task.robot, asked, tuple(range(6)))


def rows_of(limit, s: np.ndarray):
    slopes = np.tile(np.eye(s.shape[1]), (len(s), 1, 1))
    none = np.empty((len(s), 0)), np.empty((len(s), 0, s.shape[1]))
    mask = np.ones((len(s), limit.width), dtype=bool)
    return limit.rows(NodeSlopes(NodeColumns(6, 0), s, slopes, *none), mask)


@pytest.mark.slow
def test_rows_have_exact_derivatives_where_their_states_are_chosen(task):
    rng, step = np.random.default_rng(0), 1e-5
    states = 0.3 * rng.normal(size=(3, 3, 6))
    at, s = Instants.of_states(task.robot, *states), np.hstack(states)
    for limit in limits_of_cancels(task, 0.3)[1]:
        limit = limit.chosen(at)
        found = rows_of(limit, s)
        on = rng.normal(size=len(found.values))
        bends = limit.curvature(found, on)[1]
        for k in range(s.shape[1]):
            d = step * np.eye(s.shape[1])[k]
            ahead, back = rows_of(limit, s + d), rows_of(limit, s - d)
            scale = np.abs(found.slopes).max()
            numeric = (ahead.values - back.values) / (2 * step)
            np.testing.assert_allclose(numeric, found.slopes[:, k], atol=2e-5 * scale)
            if limit.quantity.symbol == "GN":  # the curvature of GT over the wrench is left out
                bent = on[:, None] * (ahead.slopes - back.slopes) / (2 * step)
                np.testing.assert_allclose(bent, bends[:, k], atol=1e-4 * np.abs(bends).max())


def test_rows_are_as_bad_as_the_check(task):
    """Also just after a step of the motion, where they know its accelerations before."""
    speed, acceleration, way = (
        task.robot.limits.speed,
        task.robot.limits.acceleration,
        [1, 0.8, -1, 0.5, 1, 1],
    )
    ramps = [RampCommand(*own) for own in zip(way, 0.4 * speed, 0.3 * acceleration, strict=True)]
    motion = Trajectory.from_profiles([0.0, -1.2, 1.2, 0.0, 0.0, 0.0], [[ramp] for ramp in ramps])
    times = motion.both_sides(0.1)
    cancel, limits = limits_of_cancels(task, 0.1)
    cases = worst_case_of(task.robot, WORKSHOP)
    tip, slip = worst_of_cancels(cases, motion, cancel, times)
    at, milder = (Instants.of_states(task.robot, *motion.states(times)) for _ in range(2))
    at.before = motion.states(times - WORKSHOP.late)[2]
    found, less = (cases.tip_ratio(np.min(limits[0]._worst(own.s, own.before)[0])) for own in (at, milder))
    assert 0.98 * tip.value < found <= 1.02 * tip.value
    assert less < 0.95 * found
    assert 0.9 * slip.value < float(np.max(limits[1].use(at))) < 1
    assert float(np.max(limits[0].use(at))) < 1


@pytest.mark.slow
def test_a_plan_keeps_contacts_in_cancels_where_one_without_these_limits_loses_them(task):
    asked, values = replace(task.limits, cancel=limits_of_cancels(task, 0.2)[0], tolerance=WORKSHOP), []
    for limits in (asked, asked.without_stops):
        motion = plan_motion(replace(task, limits=limits), starts=1, jobs=1).motion
        values.append(check_motion(task.robot, motion, asked).worst["GN_cancel_worst_case"].value)
    assert values[0] <= asked.GN_worst_case < 1.1 < values[1]
