"""Trajectories, however they are made, against piecewise polynomials of SciPy and differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PPoly

import ocptip
from ocptip.basics.errors import InputError
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory

RAMPS = Trajectory.from_profiles(
    [0.2, -0.4, 0.3],
    [
        [RampCommand(1.1, 0.8, 2.0), RampCommand(-0.3, 1.2, 3.0)],
        [RampCommand(0.5, 0.9, 1.7)],
        [RampCommand(0.3, 1.0, 1.0)],  # does not move
    ],
)
CURVES = RAMPS.with_rise_times((0.05, 0.1, 0.02))


def _on_a_path(cubic: bool) -> Trajectory:
    rng, ends = np.random.default_rng(2), np.linspace(0, 1, 4)
    path = JointPath(ends, CubicSpline(ends, rng.normal(size=(4, 3))).c)
    s = np.linspace(0, 1, 13)
    even = Trajectory.from_path(path, s, rng.uniform(0.5, 2, len(s)) * s * (1 - s))
    assert even.timing is not None
    return Trajectory.from_path(path, s, even.timing.x, 1.01 * even.timing.node_times) if cubic else even


WAYS = {
    "profiles": RAMPS,
    "S-curves": CURVES,
    "cubic points": controller_points(RAMPS, "cubic", step=0.1),
    "quintic points": controller_points(CURVES, "quintic", step=0.1),
    "straight lines": controller_points(RAMPS, "linear", step=0.05),
    "samples": Trajectory.from_points(np.linspace(0, 1, 12), RAMPS(np.linspace(0, RAMPS.end, 12))),
    "timed path": _on_a_path(False),
    "timed path, cubic in time": _on_a_path(True),
    "segments": Trajectory.from_segments([RAMPS, CURVES.time_scaled(1.5)], [0.3, 0.2]),
}


@pytest.fixture(params=WAYS.values(), ids=WAYS.keys())
def motion(request) -> Trajectory:
    return request.param


def _by_scipy(motion: Trajectory, joint: int) -> PPoly:
    """One joint, from 0 to the end of its pieces."""
    return PPoly(motion.coefficients[joint][::-1], motion.breaks[joint])


def test_it_is_called_for_positions_and_derivatives_of_any_order(motion):
    times = np.linspace(1e-4, motion.end - 1e-4, 301)
    for joint, breaks in enumerate(motion.breaks):
        moving = times[times < breaks[-1]]
        for order in range(6) if len(moving) else ():
            own = motion(moving, order)[:, joint]
            expected = _by_scipy(motion, joint)(moving, nu=order)
            np.testing.assert_allclose(own, expected, rtol=1e-9, atol=1e-9 * (1 + np.abs(expected).max()))
    for order, values in enumerate(motion.states(times)):
        np.testing.assert_array_equal(motion(times, order), values)
    assert motion(0.5 * motion.end).shape == (motion.n,)
    assert motion(times.reshape(7, 43), 1).shape == (7, 43, motion.n)


def test_it_rests_before_and_after(motion):
    outside = np.array([-1.0, motion.end + 1e-9, motion.end + 1.0])
    np.testing.assert_array_equal(motion(outside), [motion.start, motion.goal, motion.goal])
    for order in (1, 2, 3, 9):
        assert not motion(outside, order).any()


def test_extreme_values_are_those_of_scipys_roots(motion):
    for joint, breaks in enumerate(motion.breaks):
        if len(breaks) < 2:
            assert motion.angle_ranges[joint].tolist() == [motion.start[joint]] * 2
            continue
        peaks = []
        for order in range(4):
            curve = _by_scipy(motion, joint).derivative(order)
            turns = curve.derivative().roots(discontinuity=False, extrapolate=False)
            ends = [np.polyval(curve.c[:, k], breaks[k + 1] - breaks[k]) for k in range(len(breaks) - 1)]
            peaks.append(np.concatenate([curve.c[-1], ends, curve(turns[np.isfinite(turns)])]))
        low, high = motion.angle_ranges[joint]
        np.testing.assert_allclose([low, high], [peaks[0].min(), peaks[0].max()], atol=1e-12)
        found = motion.speed_peaks[joint], motion.acceleration_peaks[joint], motion.jerk_peaks[joint]
        np.testing.assert_allclose(found, [np.abs(values).max() for values in peaks[1:]], rtol=1e-9)


def test_events_are_within_it_and_part_what_is_smooth(motion):
    events = motion.event_times
    assert events[0] == 0
    assert np.all(np.diff(events) > 0)
    speeds = np.sign(motion(np.linspace(*motion.intervals.T, 21)[1:-1], 1))
    assert not np.any((speeds.max(axis=0) > 0) & (speeds.min(axis=0) < 0))  # none changes sign inside


def test_all_of_it_is_slowed_down(motion):
    times = np.linspace(0, motion.end, 50)
    slower = motion.time_scaled(2.0)
    assert slower.end == pytest.approx(2 * motion.end)
    np.testing.assert_allclose(slower(2 * times), motion(times), atol=1e-9)
    np.testing.assert_allclose(slower.speed_peaks, motion.speed_peaks / 2, rtol=1e-9, atol=1e-12)


def test_it_says_what_it_is():
    assert ocptip.Trajectory is Trajectory
    assert repr(RAMPS).startswith("<Trajectory of profiles: 3 joints, ")
    assert repr(WAYS["segments"]).startswith("<Trajectory of 2 segments: 3 joints, ")
    assert repr(WAYS["timed path"]).startswith("<Trajectory of timing: 3 joints, ")


def test_segments_are_motions_with_pauses_between_them():
    whole = WAYS["segments"]
    assert len(whole.segments) == 2
    assert RAMPS.segments == (RAMPS,)
    assert (RAMPS.begins.tolist(), RAMPS.pauses) == ([0.0], (0.0,))
    assert whole.begins.tolist() == [0.0, RAMPS.end + 0.3]
    times = np.linspace(0, RAMPS.end, 40)
    np.testing.assert_allclose(whole(times), RAMPS(times), atol=1e-12)
    later = np.linspace(0, whole.segments[1].end, 40)
    np.testing.assert_allclose(whole(whole.begins[1] + later, 1), whole.segments[1](later, 1), atol=1e-9)
    assert not whole(RAMPS.end + np.array([0.01, 0.29]), 1).any()


def test_bad_calls_name_what_is_wrong():
    with pytest.raises(InputError, match="order: "):
        RAMPS(0.5, -1)
    with pytest.raises(InputError, match="times: contains NaN"):
        RAMPS([np.nan])
    with pytest.raises(InputError, match="rise_time: only velocity profiles have one"):
        WAYS["samples"].with_rise_times(0.1)
    with pytest.raises(InputError, match="only profiles and timed paths have parameters"):
        WAYS["samples"].to_dict()
    with pytest.raises(InputError, match="trajectory: expected profiles"):
        _ = Trajectory().end
