"""Points for controllers: the motion they make of them, against interpolation by other code."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly, CubicHermiteSpline

from ocptip.basics.errors import InputError
from ocptip.trajectories.controllers import CONTROLLERS, NEAREST, controller_points
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import some

RAMP = Trajectory.from_profiles(
    [0.2, -0.4],
    [[RampCommand(1.1, 0.8, 2.0), RampCommand(-0.3, 1.2, 3.0)], [RampCommand(0.5, 0.9, 1.7)]],
)


def fit(motion, controller, rise=0.02):
    """The motion with rise times where a controller needs them."""
    return motion.with_rise_times(rise) if controller == "quintic" else motion


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("step", [0.004, 0.05])
def test_points_are_what_messages_hold(controller, step):
    run = controller_points(fit(RAMP, controller), controller, step=step)
    assert np.all(np.diff(run.points.times) >= NEAREST - 2e-9)
    np.testing.assert_allclose(run.points.times, np.round(run.points.times, 9), atol=1e-15)
    np.testing.assert_allclose([run.start, run.goal], [RAMP.start, RAMP.goal], atol=1e-14)
    assert (run.points.speeds is None) == (controller == "linear")
    assert (run.points.accelerations is None) == (controller != "quintic")
    for values in (run.points.speeds, run.points.accelerations):
        if values is not None:
            np.testing.assert_array_equal(values[[0, -1]], 0.0)


def test_cubics_are_the_ramps_exactly():
    run = controller_points(RAMP, "cubic")
    times = np.linspace(0, RAMP.end, 1777)
    for ours, theirs in zip(run.states(times)[:2], RAMP.states(times)[:2], strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-8)
    theirs = CubicHermiteSpline(run.points.times, run.points.angles, run.points.speeds)(times)
    np.testing.assert_allclose(run.states(times)[0], theirs, atol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("rise", some(1, [0.005, 0.02, 0.3]))
def test_quintics_are_the_mean_of_the_ramps(rise):
    run = controller_points(RAMP.with_rise_times(rise), "quintic")
    assert run.end == pytest.approx(RAMP.end + rise, abs=1e-8)
    times = np.linspace(-0.1, run.end + 0.1, 331)
    back = np.linspace(0, rise, 4001)
    weights = np.full(len(back), 1 / (len(back) - 1))
    weights[[0, -1]] /= 2  # trapezoidal rule
    theirs = (v.reshape(len(times), len(back), 2) for v in RAMP.states((times[:, None] - back).ravel())[:2])
    for own, other in zip(run.states(times)[:2], theirs, strict=True):
        np.testing.assert_allclose(own, np.einsum("b,tbj->tj", weights, other), atol=1e-6)
    values = [
        [q, v, a]
        for q, v, a in zip(run.points.angles, run.points.speeds, run.points.accelerations, strict=True)
    ]
    inside = times[(times > 0) & (times < run.end)]
    curve = BPoly.from_derivatives(run.points.times, np.array(values))
    np.testing.assert_allclose(run.states(inside)[0], curve(inside), atol=1e-12)
    np.testing.assert_allclose(run.states(inside)[2], curve.derivative(2)(inside), atol=1e-6)
    assert np.all(run.speed_peaks <= RAMP.speed_peaks + 1e-7)
    assert np.all(run.acceleration_peaks <= RAMP.acceleration_peaks * (1 + 1e-4))
    _, _, left = run.states(run.points.times, side="left")
    np.testing.assert_allclose(left, run.states(run.points.times)[2], atol=1e-6)  # no jumps


def test_quintics_through_ramps_as_they_are_overshoot():
    """Why accelerations are not simply written beside cubic run."""
    run = controller_points(RAMP, "cubic", step=0.01)
    accelerations = RAMP.states(run.points.times)[2]
    naive = Trajectory.from_points(run.points.times, run.points.angles, run.points.speeds, accelerations)
    assert np.max(naive.acceleration_peaks / RAMP.acceleration_peaks) > 1.2


@pytest.mark.parametrize("step", [0.002, 0.01, 0.04])
def test_straight_lines_with_corners_spread_over_a_period(step):
    run = controller_points(RAMP, "linear", step=step)
    assert run.end == pytest.approx(run.points.times[-1] + step)
    times = np.linspace(0, run.end, 1234)
    moved = np.clip(times[:, None] - step * np.linspace(0, 1, 2001), 0, run.points.times[-1])
    for joint in range(2):
        lines = np.interp(moved, run.points.times, run.points.angles[:, joint]).mean(axis=1)
        np.testing.assert_allclose(run.states(times)[0][:, joint], lines, atol=2e-3 * step)
    _, speeds, accelerations = run.states(times)
    assert np.all(run.speed_peaks <= RAMP.speed_peaks + 1e-12)
    assert np.all(run.acceleration_peaks <= RAMP.acceleration_peaks + 1e-9)
    assert np.all(np.abs(speeds).max(axis=0) <= run.speed_peaks + 1e-12)
    assert np.all(np.abs(accelerations).max(axis=0) <= run.acceleration_peaks + 1e-9)


@given(
    st.lists(st.tuples(st.floats(-2, 2), st.floats(0.2, 2), st.floats(0.5, 6)), min_size=1, max_size=3),
    st.sampled_from(CONTROLLERS),
    st.floats(0.003, 0.1),
)
def test_any_ramps_stay_within_their_limits(commands, controller, rise):
    motion = Trajectory.from_profiles([0.1], [[RampCommand(*c) for c in commands]])
    if motion.end < 0.01:
        return
    run = controller_points(fit(motion, controller, rise), controller, step=0.01)
    low, high = motion.angle_ranges[0]
    assert low - 1e-6 <= run.angle_ranges[0, 0] <= run.angle_ranges[0, 1] <= high + 1e-6
    assert run.speed_peaks[0] <= motion.speed_peaks[0] * (1 + 1e-4) + 1e-4
    assert run.goal[0] == pytest.approx(motion.goal[0], abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"controller": "septic"}, "controller: expected linear, cubic, quintic, got 'septic'"),
        ({"controller": "quintic"}, "rise_time: must be > 0 for quintic"),
        ({"controller": "linear", "step": float("nan")}, "step: must be finite"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(InputError, match=message):
        controller_points(RAMP, **arguments)


def test_a_motion_that_rests_is_too_short():
    rest = Trajectory.from_profiles([0.3], [[RampCommand(0.3, 1.0, 1.0)]])
    with pytest.raises(InputError, match="too short for a controller's points"):
        controller_points(rest, "cubic")
