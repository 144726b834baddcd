"""Fits to samples: what limits say of time-optimal motions of toppra, of noise, of ramps, of coarse files."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.trajectories.fit import fitted, noise_of
from ocptip.trajectories.points import FINEST, PEAK_TOLERANCE
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.sequence import standstills
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import examples, some

SPEED, ACCELERATION = np.array([1.5, 1.5, 2.0]), np.array([4.0, 4.0, 6.0])


def toppra_path(share, seed):
    """Function of the fastest motion along a spline with this share of the limits, and its duration."""
    toppra = pytest.importorskip("toppra")
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    rng = np.random.default_rng(seed)
    path = toppra.SplineInterpolator(np.linspace(0, 1, 4), rng.normal(size=(4, 3)).cumsum(axis=0) * 0.6)
    limits = [
        constraint.JointVelocityConstraint(share * SPEED),
        constraint.JointAccelerationConstraint(share * ACCELERATION),
    ]
    grid = np.linspace(0, 1, 201)
    trajectory = algorithm.TOPPRA(limits, path, gridpoints=grid, parametrizer="ParametrizeConstAccel")
    found = trajectory.compute_trajectory(0, 0)
    return found, found.duration


def sampled_at(function, duration, rate, digits):
    """Times and rounded positions."""
    times = np.append(np.arange(0, duration - 0.2 / rate, 1 / rate), duration)
    return np.round(times, 9), np.round(function(times), digits), np.full(3, 0.5 * 10.0**-digits)


@pytest.mark.parametrize(
    ("rate", "digits", "seed"), some(1, [(100, 4, 0), (100, 6, 1), (250, 5, 0), (1000, 4, 1)])
)
def test_a_motion_within_its_limits_is_and_one_beyond_is_not(rate, digits, seed):
    for share in (0.95, 1.03):
        times, positions, rounding = sampled_at(*toppra_path(share, seed), rate, digits)
        motion = fitted(times, positions, rounding=rounding)
        peak = np.max(motion.acceleration_peaks / ACCELERATION)
        assert peak == pytest.approx(share, abs=0.012)
        assert np.max(motion.speed_peaks / SPEED) < share + 0.01
        assert (max(peak, np.max(motion.speed_peaks / SPEED)) > 1 + PEAK_TOLERANCE) == (share > 1)
        assert np.all(motion.fit.distance <= 1.01 * motion.fit.tolerance)
        assert motion.end == pytest.approx(times[-1])
        assert not motion.fit.noisy.any()


@pytest.mark.slow
@pytest.mark.parametrize("seed", some(2, range(4)))
@pytest.mark.parametrize("rate", [100, 250, 1000])
@pytest.mark.parametrize("digits", [4, 5, 6, 12])
def test_the_same_at_all_rates(rate, digits, seed):
    test_a_motion_within_its_limits_is_and_one_beyond_is_not(rate, digits, seed)


RAMP = Trajectory.from_profiles(
    [0.0, 0.5], [[RampCommand(0.6, 0.8, 3.0)], [RampCommand(-0.2, 1.0, 4.0), RampCommand(0.3, 0.5, 2.0)]]
)


@pytest.mark.slow
def test_of_ramps_the_accelerations_are_found():
    times = np.append(np.arange(0, RAMP.end, 0.005), RAMP.end)
    motion = fitted(times, RAMP.states(times)[0])
    fine = np.linspace(0, RAMP.end, 999)
    places, speeds, accelerations = motion.states(fine)
    exact = RAMP.states(fine)
    np.testing.assert_allclose(places, exact[0], atol=2e-5)
    np.testing.assert_allclose(speeds, exact[1], atol=5e-3)
    np.testing.assert_allclose(motion.acceleration_peaks, RAMP.acceleration_peaks, rtol=5e-3)
    assert np.mean(np.abs(accelerations - exact[2]) < 0.02) > 0.97
    assert np.all(motion.states([0.0, motion.end])[1] == 0)
    slow = motion.time_scaled(2.0)
    assert slow.peak_rounding == PEAK_TOLERANCE
    np.testing.assert_allclose(slow.acceleration_peaks, motion.acceleration_peaks / 4)


@pytest.mark.parametrize("sigma", [1e-5, 1e-3])
def test_noise_is_estimated_and_said_and_does_not_become_acceleration(sigma):
    times = np.append(np.arange(0, RAMP.end, 0.004), RAMP.end)
    noise = sigma * np.random.default_rng(5).normal(size=(len(times), 2))
    samples = RAMP.states(times)[0] + noise
    np.testing.assert_allclose(noise_of(times, samples), sigma, rtol=0.3)
    motion = fitted(times, samples, rounding=np.full(2, 5e-7))
    assert motion.fit.noisy.all()
    assert np.all((motion.fit.distance > 2 * sigma) & (motion.fit.distance < 5.5 * sigma))
    assert np.all(motion.acceleration_peaks < RAMP.acceleration_peaks * 1.05 + 8 * sigma / 0.01)
    assert motion.fit.to_dict()["noisy"].all()


def test_curvature_of_coarse_samples_is_no_noise():
    times = np.linspace(0, 2, 41)
    smooth = (0.5 - 0.5 * np.cos(np.pi * times / 2))[:, None]
    assert noise_of(times, smooth)[0] == 0
    motion = fitted(times, smooth)
    assert motion.fit.tolerance[0] == FINEST
    assert motion.acceleration_peaks[0] == pytest.approx(np.pi**2 / 8, rel=0.05)


@pytest.mark.slow
def test_speeds_of_the_file_are_compared():
    times = np.append(np.arange(0, RAMP.end, 0.01), RAMP.end)
    states = RAMP.states(times)
    near = fitted(times, states[0], speeds=states[1])
    assert np.max(near.fit.speed_distance) < 0.02
    far = fitted(times, states[0], speeds=0.5 * states[1])
    assert np.max(far.fit.speed_distance) == pytest.approx(0.5, abs=0.02)


@examples(15, derandomize=True)
@given(st.lists(st.floats(-1, 1), min_size=2, max_size=6), st.integers(0, 99))
def test_few_samples_at_any_times_are_passed(values, seed):
    times = np.cumsum(np.random.default_rng(seed).uniform(0.05, 0.4, len(values)))
    motion = fitted(times, np.array(values)[:, None])
    assert motion.fit.distance[0] <= 1.5 * FINEST
    assert np.all(motion.states([0, motion.end])[1] == 0)


def test_a_recording_that_rests_has_no_events():
    """201 equal samples had 3,401."""
    times = np.linspace(0, 2, 201)
    motion = fitted(times, np.full((201, 6), 0.3))
    np.testing.assert_array_equal(motion.event_times, times[[0, -1]])


@pytest.mark.parametrize("rate", [125, 500])
def test_noisy_samples_have_at_most_a_piece_each_and_few_events(rate):
    """An event was each of 3 to 14 pieces per sample; now those at which accelerations jump."""
    rng, times = np.random.default_rng(0), np.arange(0, 4 + 1e-9, 1 / rate)
    smooth = 0.5 * np.sin(np.pi * times / 4)[:, None] ** 2 * [1.0, -0.7]
    motion = fitted(times, smooth + 2e-5 * rng.normal(size=smooth.shape), rounding=np.full(2, 5e-7))
    assert motion.fit.noisy.all()
    assert len(motion.points.times) <= len(times) + 1
    assert np.all(motion.fit.distance <= 1.01 * motion.fit.tolerance)
    assert len(motion.event_times) <= 0.6 * len(times)
    before, after = (motion.states(motion.points.times, side=side)[2] for side in ("left", "right"))
    no_event = ~np.isin(motion.points.times, motion.event_times)
    largest = np.abs(after - before)[no_event].max(axis=0)
    assert np.all(largest <= PEAK_TOLERANCE * motion.acceleration_peaks)


def test_samples_that_long_pieces_cannot_pass_are_passed_by_shorter_ones():
    """Coarse rounding asks for long pieces, an oscillation of 100 Hz for short ones."""
    times = np.arange(0, 0.2 + 1e-9, 1e-3)
    positions = 5e-3 * np.sin(2 * np.pi * 100 * times) * np.sin(np.pi * times / 0.2) ** 2
    motion = fitted(times, positions[:, None], rounding=np.full(1, 1e-3))
    assert motion.fit.distance[0] <= 1.05e-3


def test_joints_that_rest_stay_where_they_are():
    times = np.linspace(0, 1, 30)
    positions = np.stack([0.5 - 0.5 * np.cos(np.pi * times), np.full(30, 0.3)], axis=1)
    motion = fitted(times, positions)
    assert np.all(motion.states(np.linspace(0, 1, 77))[0][:, 1] == 0.3)
    assert motion.acceleration_peaks[1] == 0


@pytest.mark.parametrize(("sigma", "digits"), some(1, [(3e-4, 6), (0.0, 5)]))
def test_a_rest_on_the_way_is_a_rest_and_the_motions_beside_it_are_as_calm(sigma, digits):
    rng, pause = np.random.default_rng(2), 0.4
    times = np.arange(0, 2 * RAMP.end + pause + 0.005, 0.01)
    there = RAMP.states(np.clip(times, 0, RAMP.end))[0]
    back = RAMP.states(np.clip(2 * RAMP.end + pause - times, 0, RAMP.end))[0]
    positions = np.where((times < RAMP.end + 0.5 * pause)[:, None], there, back)
    noisy = np.round(positions + sigma * rng.normal(size=positions.shape), digits)
    motion = fitted(times, noisy, rounding=np.full(2, 0.5 * 10.0**-digits))
    first, _ = standstills(motion.points)[0]
    middle = motion.states(np.linspace(RAMP.end + 0.1, RAMP.end + pause - 0.1, 9))
    np.testing.assert_allclose(middle[0], np.tile(there[-1], (9, 1)), atol=4 * sigma + 2e-5)
    np.testing.assert_allclose(middle[1], 0.0, atol=1e-4)
    assert RAMP.end - 0.02 <= motion.points.times[first] <= RAMP.end + 0.25 * pause + 0.05
    assert np.all(motion.fit.distance <= 1.05 * motion.fit.tolerance)
    assert np.all(motion.acceleration_peaks <= (1.05 if sigma else 1.01) * RAMP.acceleration_peaks)
    assert motion.end == pytest.approx(times[-1])
