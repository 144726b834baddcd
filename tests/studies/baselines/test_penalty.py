"""The motion problem for search methods: parameters, cost and limits against the robot's own evaluation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from ocptip.basics.errors import InputError
from ocptip.motion.check import check_motion
from ocptip.motion.planner.random_start import random_start
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from studies.baselines.penalty import MotionPenalty, _piecewise_maxima, _spline_maxima
from tests.quick import some

INSIDE = 1.5e-7


@pytest.fixture(scope="module")
def task():
    """Case B: small triangle."""
    return experiment_task("B", "effective")


@pytest.fixture(scope="module")
def penalty(task):
    return MotionPenalty(task, between="sides")


@pytest.fixture(scope="module")
def random_points(penalty):
    """Parameters near the first start, feasible ones and others."""
    rng = np.random.default_rng(3)
    start = penalty.random_start(0, 0)
    return [np.clip(start + rng.normal(0, 0.05, penalty.size), 0, 1) for _ in range(6)]


def test_parameters_are_commands_in_units_of_their_bounds(task, penalty):
    limits = task.robot.arm.limits
    assert penalty.size == 24
    fastest = penalty.motion(np.ones(24))
    for joint in task.optimised:
        commands = fastest.joints[joint].commands
        assert [c.speed for c in commands] == pytest.approx([limits.speed[joint]] * 3)
        assert [c.acceleration for c in commands] == pytest.approx([limits.acceleration[joint]] * 3)
        ends = task.start[joint], task.goal[joint]
        assert commands[0].phi_e == pytest.approx(min(limits.angle_max[joint], max(ends) + 1.2))
        assert commands[2].phi_e == task.goal[joint]
    p = np.linspace(0.1, 0.9, 24)
    np.testing.assert_allclose(penalty.parameters(penalty.motion(p)), p, atol=1e-12)


def test_random_starts_are_those_of_the_planner(task, penalty):
    rng = np.random.default_rng([5, 2])
    motion = random_start(task.robot, task.start, task.goal, task.optimised, task.commands, task.limits, rng)
    again = penalty.motion(penalty.random_start(2, 5))
    assert again.end == pytest.approx(motion.end, rel=1e-9)
    times = np.linspace(0, motion.end, 50)
    for ours, theirs in zip(again.states(times), motion.states(times), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-8)


def test_motion_is_that_of_the_passive_rule(task, penalty, random_points):
    limits = task.robot.arm.limits
    for p in random_points:
        motion = penalty.motion(p)
        commands = [*(joint.commands for joint in motion.joints[:3]), None, None, None]
        same = Trajectory.ending_together(task.start, task.goal, commands, limits.speed, limits.acceleration)
        assert same.end == motion.end
        np.testing.assert_array_equal(same.event_times, motion.event_times)


def test_energy_and_limits_at_nodes_and_sides_are_the_robots(task, penalty, random_points):
    robot, count = task.robot, len(task.robot.collision.labels)
    for p in random_points:
        value, motion = penalty.evaluate(p), penalty.motion(p)
        assert value.energy == pytest.approx(robot.energy(motion), rel=1e-12)
        left, right = motion.intervals.T
        times = np.concatenate([motion.quadrature(4)[0], left + INSIDE, right - INSIDE])
        samples = robot.samples(motion, times)
        expected = [np.max(samples.tip.GN) - 0.9, np.max(samples.slip.GT) - 0.9]
        np.testing.assert_allclose(value.limits[:2], expected, rtol=1e-6, atol=1e-7)
        gaps = robot.collision.gaps(samples.angles)
        np.testing.assert_allclose(value.limits[2 : 2 + count], -gaps.min(axis=0), atol=1e-12)
        torques = np.concatenate([samples.torques.max(axis=0), -samples.torques.min(axis=0)])
        np.testing.assert_allclose(
            value.limits[2 + count : 14 + count], torques - np.tile(robot.arm.limits.torque, 2), atol=1e-9
        )
        assert value.cost == pytest.approx(value.energy + penalty.weight * np.maximum(value.limits, 0).sum())
        assert value.feasible == (value.cost == value.energy)


def test_limits_of_the_task_count(task, random_points):
    tight = replace(task, limits=Limits(GN=0.95, GT=0.8, torque_ratio=0.5, clearance=0.01))
    normal, tighter = (MotionPenalty(t, between="sides").evaluate(random_points[0]) for t in (task, tight))
    count = len(task.robot.collision.labels)
    torque = 0.5 * np.tile(task.robot.arm.limits.torque, 2)
    change = np.concatenate([[-0.05, 0.1], np.full(count, 0.01), torque, np.zeros(6)])
    np.testing.assert_allclose(tighter.limits - normal.limits, change, atol=1e-12)


@pytest.mark.parametrize("between", ["spline", "sides"])
@pytest.mark.parametrize("name", some(1, ["A", "F", "H"]))
def test_verified_references_are_feasible_and_others_are_not(name, between):
    task = experiment_task(name, "printed")
    penalty = MotionPenalty(task, between=between)
    assert check_motion(task.robot, task.reference, task.limits).verified
    value = penalty.of_motion(task.reference)
    # the spline overshoots at jumps, so that it may see what is not there; nothing comes near here
    assert value.feasible
    assert value.energy == pytest.approx(task.robot.energy(task.reference))
    assert not penalty.of_motion(task.reference.time_scaled(0.3)).feasible


def test_spline_sees_maxima_between_nodes(task, random_points):
    spline, sides = (MotionPenalty(task, between=between) for between in ("spline", "sides"))
    for p in random_points:
        motion = spline.motion(p)
        nodes = motion.quadrature(4)[0]
        GN = task.robot.samples(motion, nodes).tip.GN
        dense = CubicSpline(nodes, GN)(np.linspace(0, motion.end, 20_001))
        seen = spline.evaluate(p).limits[0] + 0.9
        assert seen >= np.max(dense) - 1e-9
        assert seen == pytest.approx(np.max(dense), abs=1e-3 * np.ptp(GN) + 1e-6)
        assert sides.evaluate(p).energy == spline.evaluate(p).energy


def test_reversal_beyond_an_angle_limit_counts(task, penalty):
    joint = task.optimised[0]
    top = task.robot.arm.limits.angle_max[joint]
    commands = [list(j.commands) for j in task.reference.joints]
    commands[joint][0] = RampCommand(top - 0.01, 2.0, 2.0)
    commands[joint][1] = RampCommand(task.goal[joint], 1.0, 1.5)  # brakes later than command 1 would have
    value = penalty.of_motion(Trajectory.from_profiles(task.start, commands))
    motion = Trajectory.from_profiles(task.start, commands)
    excess = motion.angle_ranges[joint, 1] - top
    assert excess > 0.05
    assert value.limits[-6] == pytest.approx(excess)


def test_spline_maxima_against_a_dense_grid():
    rng = np.random.default_rng(0)
    times = np.sort(rng.uniform(0.1, 0.9, 30))
    columns = rng.normal(size=(30, 5))
    columns[:, 4] -= 100.0  # far from any limit: left as it is
    dense = CubicSpline(times, columns)(np.linspace(0, 1, 200_001))
    found = _spline_maxima(times, columns, 1.0, near=-10.0)
    np.testing.assert_allclose(found[:4], dense.max(axis=0)[:4], rtol=1e-5)
    assert found[4] == columns[:, 4].max()


def test_piecewise_maxima_against_dense_polynomials():
    rng = np.random.default_rng(1)
    x = np.polynomial.legendre.leggauss(4)[0]
    grid = np.linspace(-1, 1, 20_001)
    for coefficients in (rng.normal(size=(4, 6)), np.diag([0, 0, 1, 0])[:, :3], np.diag([0, 1.0, 0, 0])):
        values, dense = (np.polynomial.polynomial.polyval(at, coefficients).T for at in (x, grid))
        high, low = _piecewise_maxima(values)
        np.testing.assert_allclose(high, dense.max(axis=0), atol=1e-6)
        np.testing.assert_allclose(low, dense.min(axis=0), atol=1e-6)


def test_refusals(task, penalty):
    with pytest.raises(InputError, match="between: expected one of"):
        MotionPenalty(task, between="nodes")
    with pytest.raises(InputError, match="weight: must be > 0"):
        MotionPenalty(task, weight=0.0)
    with pytest.raises(InputError, match="p: expected shape 24"):
        penalty(np.zeros(23))
    one = Trajectory.from_profiles(task.start, [[RampCommand(angle, 1.0, 1.0)] for angle in task.goal])
    with pytest.raises(InputError, match="joint 1 has 1 commands, must be 3"):
        penalty.parameters(one)
    with pytest.raises(InputError, match="cannot be planned"):
        MotionPenalty(replace(task, limits=Limits(GN=0.01)))
