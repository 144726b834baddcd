"""Cancels as limits of programs: wrenches of the states of stops, and their derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ocptip.motion.check import check_motion
from ocptip.motion.plan import plan_motion
from ocptip.published.tasks import experiment_task
from ocptip.standing.instants import Instants, NodeColumns
from ocptip.standing.limit_kinds.kinds import CancelAngleLimit, CancelDurationLimit
from ocptip.standing.limit_kinds.rows import NodeSlopes
from ocptip.standing.limits import Limits
from ocptip.standing.stops.by_cancel import Cancel, cancel_slopes, stop_states
from ocptip.task_files.motion import load_task
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.motion.test_task import TWO_JOINTS, URDF


@pytest.fixture(scope="module")
def robot():
    return experiment_task("A", "effective").robot


def test_slopes_and_curvature_against_differences(robot):
    rng, n, step = np.random.default_rng(0), robot.n, 1e-5
    q, qd = rng.normal(size=(2, 4, n))
    qd[0, 1] = 0.0
    rates = tuple(rng.uniform(2, 6, n))
    at = stop_states(q, qd, np.array(rates))
    rows = np.flatnonzero(rng.random(len(at.owner)) < 0.2)
    chosen = np.sign(qd)[at.owner[rows]], at.moves[rows].astype(float), at.weights[rows]
    s = np.hstack([q, qd, 0 * q])[at.owner[rows]]
    slopes, weights = cancel_slopes(robot, rates), rng.normal(size=(len(rows), 6))
    expected = robot.loads(at.q[rows], at.qd[rows], at.qdd[rows])[1]
    np.testing.assert_allclose(slopes.wrenches(s, *chosen), expected, atol=1e-9)
    gradient, bends = (f(s, *chosen, weights) for f in (slopes.gradient, slopes.hessian))
    assert not gradient[:, 2 * n :].any()
    for j in range(2 * n):
        d = step * np.eye(3 * n)[j]
        ahead, back = (np.sum(weights * slopes.wrenches(s + own, *chosen), axis=1) for own in (d, -d))
        numeric = (ahead - back) / (2 * step)
        np.testing.assert_allclose(gradient[:, j], numeric, atol=3e-5 * np.abs(gradient).max())
        numeric = (slopes.gradient(s + d, *chosen, weights) - slopes.gradient(s - d, *chosen, weights)) / (
            2 * step
        )
        np.testing.assert_allclose(bends[:, j], numeric, atol=1e-4 * np.abs(bends).max())


def test_angles_of_rest_are_those_of_whole_stops_with_exact_derivatives(robot):
    rng, n = np.random.default_rng(1), robot.n
    rates = rng.uniform(2, 6, n)
    limit = CancelAngleLimit(robot, Limits(cancel=Cancel(tuple(rates))), (0, 1))
    states = rng.normal(size=(3, 4, n))
    at = stop_states(*states[:2], rates)
    ends = at.q[-4:]  # the last state of each stop is at rest
    np.testing.assert_allclose(limit._rests(*states[:2]), ends, atol=1e-12)
    low, high = robot.limits.angle_min, robot.limits.angle_max
    use = limit.use(Instants.of_states(robot, *states))
    np.testing.assert_allclose(use, 1 + np.max(np.maximum(low - ends, ends - high), axis=1), atol=1e-12)
    mask = np.ones((4, n), dtype=bool)

    def rows(s):
        size = s.shape[1]
        slopes = np.tile(np.eye(size), (len(s), 1, 1))
        none = np.empty((len(s), 0)), np.empty((len(s), 0, size))
        return limit.rows(NodeSlopes(NodeColumns(n, 0), s, slopes, *none), mask)

    s, step = np.hstack(states), 1e-5
    found, on = rows(s), rng.normal(size=4 * n)
    np.testing.assert_allclose(found.values, ends.ravel(), atol=1e-12)
    _, bends = limit.curvature(found, on)
    for k in range(s.shape[1]):
        d = step * np.eye(s.shape[1])[k]
        ahead, back = rows(s + d), rows(s - d)
        np.testing.assert_allclose((ahead.values - back.values) / (2 * step), found.slopes[:, k], atol=1e-8)
        bent = on[:, None] * (ahead.slopes - back.slopes) / (2 * step)
        np.testing.assert_allclose(bent, bends[:, k], atol=1e-6)


def test_a_motion_at_full_speed_beside_a_limit_is_not_cancelled_within_it(robot):
    """By hand: 1 rad/s at 2 rad/s^2 needs 0.25 rad, and the goal is 0.1 rad before the limit."""
    start, way = np.zeros(robot.n), np.eye(robot.n)[0]
    motion = Trajectory.from_profiles(start, [[RampCommand(x, 1.0, 8.0)] for x in way])
    arm = robot.arm.with_limits(angle_max=np.where(way > 0, 1.1, robot.limits.angle_max))
    beside = robot.varied(arm=arm)
    limits = Limits(cancel=Cancel((2.0,) * robot.n, GN=1.0, GT=1.0))
    checked = check_motion(beside, motion, limits)
    worst = checked.worst["angle_margin_deg_cancel"]
    assert checked.worst["angle_margin_deg"].excess <= 0
    # It reaches 1 rad/s until 1/16 rad before the goal.
    assert worst.value == pytest.approx(np.degrees(0.1 + 1 / 16 - 0.25), abs=0.1)
    assert worst.broken


def test_a_fast_joint_needs_long_to_stop(robot):
    """By hand: 1 rad/s at 2 rad/s^2 needs 0.5 s, after 0.1 s until the controller reacts."""
    way = np.eye(robot.n)[0]
    motion = Trajectory.from_profiles(np.zeros(robot.n), [[RampCommand(x, 1.0, 8.0)] for x in way])
    cancel = Cancel((2.0,) * robot.n, reaction=0.1, longest=0.55, GN=1.0, GT=1.0)
    limits = Limits(cancel=cancel)
    worst = check_motion(robot, motion, limits).worst["duration_s_cancel"]
    assert worst.value == pytest.approx(0.6)
    assert worst.detail == robot.joint_label(0)
    assert worst.broken
    [limit] = CancelDurationLimit.of(robot, limits, tuple(range(robot.n)))
    speeds = np.random.default_rng(2).normal(size=(4, robot.n))
    states = np.zeros_like(speeds), speeds, np.zeros_like(speeds)
    at, most = Instants.of_states(robot, *states), 2.0 * 0.45
    np.testing.assert_allclose(limit.use(at), np.max(np.abs(speeds), axis=1) / most)
    np.testing.assert_array_equal(limit.near(at, 0.7), np.abs(speeds) >= 0.7 * most)
    size = 3 * robot.n
    none = np.empty((4, 0)), np.empty((4, 0, size))
    nodes = NodeSlopes(NodeColumns(robot.n, 0), at.s, np.tile(np.eye(size), (4, 1, 1)), *none)
    rows = limit.rows(nodes, np.ones_like(speeds, dtype=bool))
    np.testing.assert_allclose(rows.values, speeds.ravel() / most)
    np.testing.assert_allclose(np.sum(rows.slopes * at.s[rows.nodes], axis=1), rows.values)


@pytest.mark.slow
def test_a_plan_is_slow_enough_to_stop_in_time(tmp_path):
    (tmp_path / "two.urdf").write_text(TWO_JOINTS)
    (tmp_path / "task.toml").write_text(URDF)
    task = load_task(tmp_path / "task.toml")
    cancel, lasts = Cancel(tuple(0.3 * task.robot.limits.acceleration)), {}
    for longest in (2.0, 0.6):
        limits = replace(task.limits, cancel=replace(cancel, longest=longest))
        checked = plan_motion(replace(task, limits=limits), starts=1, jobs=1).check
        assert checked.verified
        lasts[longest] = checked.worst["duration_s_cancel"].value
    assert lasts[0.6] <= 0.6 < lasts[2.0]


@pytest.mark.slow
def test_a_plan_brakes_early_enough_beside_a_limit(tmp_path):
    """The goal is 0.05 rad before the upper limit of a joint; free cancels go beyond it."""
    (tmp_path / "two.urdf").write_text(
        TWO_JOINTS.replace('lower="-2" upper="2"', 'lower="-2" upper="1.1"', 1)
    )
    (tmp_path / "task.toml").write_text(URDF)
    task = load_task(tmp_path / "task.toml")
    cancel = Cancel(tuple(0.3 * task.robot.limits.acceleration), GN=0.9, GT=0.9)
    beyond = {}
    for name, own in (("free", None), ("kept", cancel)):
        planned = plan_motion(replace(task, limits=replace(task.limits, cancel=own)), starts=1, jobs=1)
        checked = check_motion(task.robot, planned.motion, replace(task.limits, cancel=cancel))
        beyond[name] = checked.worst["angle_margin_deg_cancel"].excess
    assert beyond["free"] > 0.5
    assert beyond["kept"] <= 0
