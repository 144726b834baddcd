"""A limit of the jerk: the closed form of a straight line, differences of accelerations, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.motion.objective import ENERGY, TIME
from ocptip.retiming.retime import retime
from ocptip.standing.limits import Limits
from ocptip.trajectories.path import JointPath
from tests.quick import some
from tests.retiming.paths import delta, random_path, tripod

FREE = Limits(GN=0.999, GT=0.999, torque_ratio=100.0)


@pytest.mark.slow
def test_a_straight_line_is_an_s_curve():
    """Where speed, acceleration and jerk are all reached it takes D/V + V/A + A/J."""
    task = tripod()
    way, limits = task.goal - task.start, task.robot.limits
    path = JointPath([0.0, 1.0], np.stack([way, task.start])[:, None])
    V, A = np.min(limits.speed / np.abs(way)), np.min(limits.acceleration / np.abs(way))
    J = 4 * A**2 / V
    found = retime(task.robot, path, FREE, jerk=J * np.abs(way).max(), nodes=100)
    assert found.verified
    least = 1 / V + V / A + A / J
    assert 1 / V > V / A + A / J  # all are reached
    assert found.motion.end == pytest.approx(least, rel=5e-3)
    assert found.motion.end >= least * (1 - 1e-4)


@pytest.mark.parametrize(("objective", "nodes"), some(1, [(TIME, 60), (ENERGY, 30)]))
def test_jerks_are_within_the_limit_and_nothing_is_faster(objective, nodes):
    task, limits = tripod(), Limits()
    path, jerk = random_path(task, 3, 0.1), 5 * task.robot.limits.acceleration
    first = retime(task.robot, path, limits, objective, nodes=nodes)
    found = retime(task.robot, path, limits, objective, nodes=nodes, jerk=jerk)
    motion = found.motion
    assert found.verified, found.check.violations
    assert np.all(motion.timing.x <= first.motion.timing.x * (1 + 1e-6))
    assert first.motion.end < motion.end < 1.5 * first.motion.end
    assert found.slower < 1.05
    times, h = np.linspace(1e-5, motion.end - 1e-5, 20_001), 1e-6
    change = (motion.states(times + h)[2] - motion.states(times - h)[2]) / (2 * h)
    share = np.max(np.abs(change / jerk))
    assert 0.95 < share < 1.01  # a jump at a node, however small, is a peak of differences
    assert np.max(np.abs(motion.states([0.0, motion.end - 1e-9])[2])) < 1e-4
    assert np.max(motion.acceleration_steps) < 1e-5 * np.max(motion.acceleration_peaks)
    assert not first.jerk_ratio


@pytest.mark.slow
def test_four_feet_and_another_robot():
    task = delta()
    found = retime(task.robot, random_path(task, 0, 0.1), task.limits, nodes=60, jerk=1000.0)
    assert found.verified, found.check.violations
    assert found.jerk_ratio == pytest.approx(1.0, abs=0.02)
    assert found.motion.end > found.fastest


def test_limits_of_jerk_count_without_being_asked_for():
    task, limits = tripod(), Limits()
    path, jerk = random_path(task, 3, 0.1), tuple(5 * task.robot.limits.acceleration)
    asked = retime(task.robot, path, limits, nodes=30, jerk=jerk)
    for jerks in (jerk, tuple(2 * np.array(jerk))):
        found = retime(
            task.robot, path, replace(limits, jerk=jerks), nodes=30, jerk=jerk if jerks != jerk else None
        )
        assert found.motion.end == pytest.approx(asked.motion.end, rel=1e-6)
        assert found.check.worst["jerk_ratio"].value <= 1
    assert "jerk_ratio" not in asked.check.worst


def test_refusals():
    task = tripod()
    path = random_path(task, 0)
    for jerk, words in ((-1.0, "jerk: must be > 0"), ([1.0, 2.0], "jerk: expected 1 or 6 numbers, got 2")):
        with pytest.raises(InputError, match=words):
            retime(task.robot, path, jerk=jerk)
    way = 0.2 * (task.goal - task.start)
    bent = np.array([[0 * way, way], [way, way], [task.start, task.start + 0.5 * way]])
    with pytest.raises(
        InputError, match=r"jerk: the path's curvature has a step at s = 0\.5000 of 1\.0000.*--path-tolerance"
    ):
        retime(task.robot, JointPath([0.0, 0.5, 1.0], bent), FREE, jerk=100.0, nodes=20)
