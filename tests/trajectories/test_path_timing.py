"""A path with its timing: states against differences, peaks against dense samples, time in closed form."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from ocptip.basics.errors import InputError
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import examples


def spline_path(seed: int, joints: int = 3, pieces: int = 4) -> JointPath:
    ends = np.linspace(0, 1, pieces + 1)
    return JointPath(ends, CubicSpline(ends, np.random.default_rng(seed).normal(size=(pieces + 1, joints))).c)


def timed(seed: int) -> Trajectory:
    rng, path = np.random.default_rng(seed), spline_path(seed)
    s = np.unique(np.concatenate([path.breakpoints, np.linspace(0, 1, 21)]))
    return Trajectory.from_path(path, s, rng.uniform(0.5, 2, len(s)) * s * (1 - s))


@examples(10, derandomize=True)
@given(st.integers(0, 1000))
def test_states_and_peaks(seed):
    motion = timed(seed)
    assert np.array_equal(motion.states([-1.0])[0][0], motion.start)
    ends = motion.states(np.array([-1.0, motion.end + 1]))
    assert not ends[1].any()
    assert not ends[2].any()
    assert np.allclose(ends[0][1], motion.goal)
    times = np.concatenate([np.linspace(a + 1e-6, b - 1e-6, 41) for a, b in motion.intervals])
    _, qd, qdd = motion.states(times)
    h = 1e-6
    after, before = motion.states(times + h), motion.states(times - h)
    assert np.allclose((after[0] - before[0]) / (2 * h), qd, atol=1e-6 * (1 + motion.speed_peaks.max()))
    inner = np.abs(times[:, None] - motion.event_times).min(axis=1) > 1.5e-6
    change = (after[1] - before[1]) / (2 * h)
    assert np.allclose(change[inner], qdd[inner], atol=1e-4 * (1 + motion.acceleration_peaks.max()))
    for found, peaks in ((qd, motion.speed_peaks), (qdd, motion.acceleration_peaks)):
        largest = np.abs(found).max(axis=0)
        assert np.all(largest <= peaks * (1 + 1e-9))
        assert np.all(largest >= 0.97 * peaks)


@examples(5, derandomize=True)
@given(st.integers(0, 1000))
def test_given_times_make_cubics(seed):
    """Accelerations and jerks against differences; peaks against dense samples."""
    even = timed(seed)
    rng = np.random.default_rng(seed)
    own = even.timing
    steps = np.diff(own.node_times) * rng.uniform(0.95, 1.05, len(own.s) - 1)
    motion = Trajectory.from_path(own.path, own.s, own.x, np.append(0.0, np.cumsum(steps)))
    assert motion.end == pytest.approx(steps.sum())
    times = np.concatenate([np.linspace(a, b, 43)[1:-1] for a, b in motion.intervals])
    h = 1e-6
    states = motion.states(times)
    after, before = motion.states(times + h), motion.states(times - h)
    for k, peaks in ((1, motion.speed_peaks), (2, motion.acceleration_peaks), (3, motion.jerk_peaks)):
        rate = (after[k - 1] - before[k - 1]) / (2 * h)
        if k < 3:
            assert np.allclose(rate, states[k], atol=1e-5 * peaks.max())
        largest = np.abs(rate).max(axis=0)
        assert np.all(largest <= peaks * (1 + 1e-4))
        assert np.all(largest >= 0.9 * peaks)  # samples keep away from nodes
    again = Trajectory.from_dict(motion.to_dict())
    assert np.array_equal(again.states(times)[2], states[2])
    slower = motion.time_scaled(2.0)
    assert np.allclose(slower.jerk_peaks, motion.jerk_peaks / 8)


@pytest.mark.parametrize("cubic", [False, True])
def test_polynomials_of_time_are_exact_up_to_rounding(cubic):
    """Of rational numbers: the path's polynomial of s at the law's s of time."""
    motion = timed(3)
    if cubic:
        own = motion.timing
        motion = Trajectory.from_path(own.path, own.s, own.x, 1.02 * own.node_times)
    timing, path = motion.timing, motion.timing.path
    for k in range(0, len(timing.s) - 1, 3):
        for share in (Fraction(1, 7), Fraction(5, 6)):
            t = share * Fraction(timing.node_times[k + 1] - timing.node_times[k])
            law = (timing.s[k], np.sqrt(timing.x[k]), 0.5 * timing.u[k], timing.third[k] / 6)
            s = sum(Fraction(c) * t**power for power, c in enumerate(law))
            piece = int(np.searchsorted(path.breakpoints, float(s))) - 1
            way = s - Fraction(path.breakpoints[piece])
            for j in range(motion.n):
                exact = sum(Fraction(c) * way**i for i, c in enumerate(path.coefficients[::-1, piece, j]))
                found = sum(Fraction(c) * t**i for i, c in enumerate(motion.coefficients[j][:, k]))
                assert abs(exact - found) <= 1e-14 * (1 + abs(exact))


def test_times_that_do_not_fit():
    path = JointPath([0.0, 1.0], [[[1.0]], [[0.0]]])
    with pytest.raises(InputError, match="times: between nodes it goes backwards"):
        Trajectory.from_path(path, [0.0, 0.5, 1.0], [0.0, 4.0, 0.0], [0.0, 2.0, 4.0])
    with pytest.raises(InputError, match="times: expected increasing ones from 0"):
        Trajectory.from_path(path, [0.0, 0.5, 1.0], [0.0, 4.0, 0.0], [0.0, 2.0, 1.0])


def test_sides_of_nodes_and_scaling():
    motion = timed(1)
    node = motion.timing.node_times[5:6]
    left, right = (motion.states(node, side=side)[2] for side in ("left", "right"))
    assert np.max(np.abs(left - right)) > 1e-3
    slower = motion.time_scaled(2.0)
    assert slower.end == pytest.approx(2 * motion.end)
    assert np.allclose(slower.acceleration_peaks, motion.acceleration_peaks / 4)
    path = JointPath([0.0, 1.0], [[[1.0]], [[0.0]]])
    even = Trajectory.from_path(path, [0.0, 0.5, 1.0], [0.0, 4.0, 0.0])
    assert even.end == pytest.approx(1.0)  # speed rises to 2 in half of the time
    assert even.acceleration_peaks == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("s", "x", "words"),
    [
        ([0.0, 1.0], [1.0, 1.0], "breakpoint 0.25 is no node"),
        ([0.0, 0.25, 0.5, 0.75, 1.0], [0.0, 0.0, 1.0, 1.0, 0.0], "never goes on"),
        ([0.0, 0.25, 0.5, 0.75, 1.0], [0.0, -1.0, 1.0, 1.0, 0.0], "must be >= 0"),
        ([0.0, 0.25, 0.5, 0.75], [0.0, 1.0, 1.0, 1.0], "increasing from 0 to 1"),
    ],
)
def test_refusals(s, x, words):
    with pytest.raises(InputError, match=words):
        Trajectory.from_path(spline_path(0), s, x)
