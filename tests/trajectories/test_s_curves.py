"""S-curves: the mean of the ramps over the rise time, against convolution, integration and other code."""

import json

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.motion.check import check_motion
from ocptip.published.tasks import experiment_task
from ocptip.standing.limit_kinds.jumps import Jumps
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.pieces import MERGE
from ocptip.trajectories.ramps import JointRamps, RampCommand
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.trajectory import Trajectory
from ocptip.trajectories.velocity_profiles import VelocityProfiles
from tests.quick import examples
from tests.trajectories.strategies import angles, commands, numbers

rises = numbers(1e-3, 0.8)


def curve(phi, ramps, rise):
    made = JointRamps.from_commands(phi, ramps)
    assume(made.end > 0.01)
    return Trajectory(profiles=VelocityProfiles((made,), (rise,)))


@examples(60)
@given(phi=angles(), ramps=commands, rise=rises, seed=st.integers(0, 10**6))
def test_states_are_means_of_the_ramps_over_the_rise_time(phi, ramps, rise, seed):
    """Gauss-Legendre between the ramps' own boundaries integrates their piecewise polynomials exactly."""
    made = curve(phi, ramps, rise)
    times = np.random.default_rng(seed).uniform(-0.2, made.end + 0.2, 25)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    found = np.hstack(made.states(times))
    for t, state in zip(times, found, strict=True):
        edges = made.joints[0].times
        cuts = np.unique([t - rise, t, *edges[(edges > t - rise) & (edges < t)]])
        half = 0.5 * np.diff(cuts)[:, None]
        at = 0.5 * (cuts[1:] + cuts[:-1])[:, None] + half * nodes
        means = [np.sum(half * weights * part) / rise for part in made.joints[0].states(at)]
        np.testing.assert_allclose(state, means, rtol=1e-9, atol=1e-9 + 1e-11 / rise)


@examples(60)
@given(phi=angles(), ramps=commands, rise=rises)
def test_pieces_join_and_rest_at_both_ends(phi, ramps, rise):
    made = curve(phi, ramps, rise)
    for t in made.breaks[0]:
        before, after = made.states(t - 1e-12), made.states(t + 1e-12)
        np.testing.assert_allclose(before, after, atol=1e-7 * max(1.0, 1e-3 / rise))
    assert made.end == made.joints[0].end + rise
    assert [v.item() for v in made.states(made.end + 1.0)] == [ramps[-1].phi_e, 0.0, 0.0]
    assert [v.item() for v in made.states(-1.0)] == [phi, 0.0, 0.0]
    assert np.all(np.diff(made.breaks[0]) > 0)


@examples(60)
@given(phi=angles(), ramps=commands, rise=rises)
@example(
    phi=6e-6,  # back, then rest in the midst of the motion, then forth
    ramps=[RampCommand(0.0, 1.0, 1.0), RampCommand(5e-6, 1.0, 3.0), RampCommand(6e-6, 1.0, 1.0)],
    rise=0.5,
)
def test_extremes_are_exact_and_within_those_of_the_ramps(phi, ramps, rise):
    made = curve(phi, ramps, rise)
    q, v, a = made.states(np.linspace(0, made.end, 4001))
    low, high = made.angle_ranges[0]
    h = made.end / 4000
    (speed,), (acceleration,) = made.speed_peaks, made.acceleration_peaks
    ramps = made.with_rise_times(0.0)
    for exact, sampled, slack in (
        (high, q.max(), speed * h),
        (-low, -q.min(), speed * h),
        (speed, np.abs(v).max(), acceleration * h),
        (acceleration, np.abs(a).max(), 2 * ramps.acceleration_peaks[0] / rise * h),
    ):
        assert sampled - 1e-9 <= exact <= sampled + slack + 1e-9
    own = ramps.angle_ranges[0]
    assert own[0] - 1e-9 <= low <= high <= own[1] + 1e-9
    assert speed <= ramps.speed_peaks[0] * (1 + 1e-9)
    assert acceleration <= ramps.acceleration_peaks[0] * (1 + 1e-9) + 1e-12 / rise


@examples(100)
@given(phi=angles(), ramps=commands, rise=rises)
def test_crossings_are_where_the_speed_changes_its_sign(phi, ramps, rise):
    made = curve(phi, ramps, rise)
    times = np.linspace(2e-6, made.end - 2e-6, 3001)
    speeds = made(times, 1)[:, 0]
    certain = np.abs(speeds) > 1e-9
    signs, kept = np.sign(speeds[certain]), times[certain]
    near = np.diff(kept) < 2 * (times[1] - times[0])  # not with a rest in between
    changes = np.flatnonzero((signs[1:] != signs[:-1]) & near)
    for k in changes:
        assert np.sum((made.crossings > kept[k]) & (made.crossings < kept[k + 1])) % 2 == 1
    np.testing.assert_allclose(made.states(made.crossings)[1], 0, atol=1e-9)


def test_a_reversal_crosses_half_a_rise_time_later():
    ramps = Trajectory.from_profiles([0.0], [[RampCommand(1.0, 0.8, 2.0), RampCommand(-0.5, 1.0, 2.0)]])
    assert len(ramps.crossings) == 1
    np.testing.assert_allclose(ramps.with_rise_times(0.05).crossings, ramps.crossings + 0.025, atol=1e-12)


MOTION = Trajectory.from_profiles(
    [0.2, -0.4, 0.3],
    [
        [RampCommand(1.1, 0.8, 2.0), RampCommand(-0.3, 1.2, 3.0)],
        [RampCommand(0.5, 0.9, 1.7)],
        [RampCommand(0.3, 1.0, 1.0)],
    ],
)


@pytest.mark.parametrize("rise", [0.03, (0.05, 0.0, 0.02), (0.05, 0.1, 0.2)])
def test_whole_motions(rise):
    motion = MOTION.with_rise_times(rise)
    each = np.broadcast_to(rise, 3)
    times = np.linspace(-0.1, motion.end + 0.1, 200)
    states = motion.states(times)
    for j, (own, ramps) in enumerate(zip(each, MOTION.joints, strict=True)):
        alone = Trajectory(profiles=VelocityProfiles((ramps,), own)).states(times)
        for part, value in zip(states, alone, strict=True):
            np.testing.assert_array_equal(part[:, j], value[:, 0])
    ends = [ramps.end + own for ramps, own in zip(MOTION.joints[:2], each[:2], strict=True)]
    assert motion.end == max(ends)  # the third does not move
    edges = np.concatenate([MOTION.joints[0].times + each[0], MOTION.joints[1].times + each[1]])
    assert np.max(np.min(np.abs(motion.event_times - edges[:, None]), axis=1)) <= MERGE
    assert len(Jumps.of(motion)) == (len(MOTION.joints[1].times) if 0.0 in each else 0)
    np.testing.assert_array_equal(motion.goal, MOTION.goal)


def test_none_gives_the_ramps_themselves():
    for none in (0, 0.0, (), (0.0, 0.0, 0.0), np.zeros(3)):
        motion = MOTION.with_rise_times(none)
        assert motion.rise_times == ()
        assert all(own is joint.pieces for own, joint in zip(motion.pieces, motion.joints, strict=True))
        assert motion.to_dict() == MOTION.to_dict()
        assert "rise_time_s" not in motion.to_dict()


def test_time_scaling_keeps_the_path_and_slowing_the_rise_times():
    motion = MOTION.with_rise_times(0.05)
    times = np.linspace(0, motion.end, 77)
    np.testing.assert_allclose(
        motion.time_scaled(1.3).states(1.3 * times)[0], motion.states(times)[0], atol=1e-12
    )
    slower = motion.slowed(1.3)
    assert slower.rise_times == motion.rise_times
    assert slower.end == pytest.approx(1.3 * MOTION.end + 0.05)


@pytest.mark.parametrize("rise", [0.03, (0.05, 0.0, 0.02)])
def test_files_hold_rise_times(tmp_path, rise):
    motion = MOTION.with_rise_times(rise)
    path = tmp_path / "motion.json"
    path.write_text(json.dumps(motion.to_dict()))
    again = load_motion(path)
    assert again.rise_times == motion.rise_times
    assert motion.to_dict()["rise_time_s"] == (rise if isinstance(rise, float) else list(rise))


@pytest.mark.parametrize(
    ("rise", "message"),
    [
        (-0.1, "rise_time: must be >= 0"),
        (1e-6, "rise_time: must be 0 or at least 0.0001 s"),
        ((0.1, 0.1), "rise_time: expected one, or one for each of 3 joints, got 2"),
        ("soon", "rise_time: expected a number"),
        (float("nan"), "rise_time: must be finite"),
    ],
)
def test_bad_rise_times_are_named(rise, message):
    with pytest.raises(InputError, match=message):
        MOTION.with_rise_times(rise)
    with pytest.raises(InputError, match=message.replace("rise_time", "rise_time_s")):
        Trajectory.from_dict({**MOTION.to_dict(), "rise_time_s": rise})


def test_the_check_integrates_and_samples_the_curve_itself():
    """Commands with a rise time and the points that a controller gets of it: one motion, one verdict."""
    task = experiment_task("C")
    motion = task.reference.with_rise_times(0.03)
    checked = check_motion(task.robot, motion, task.limits)
    points = check_motion(task.robot, controller_points(motion, "quintic"), task.limits)
    assert checked.energy == pytest.approx(points.energy, rel=1e-6)
    for name in ("GN", "GT", "torque_ratio", "speed_ratio", "acceleration_ratio", "angle_margin_deg"):
        assert checked.worst[name].value == pytest.approx(points.worst[name].value, rel=1e-4)
    times = np.linspace(0, motion.end, 40001)
    power = task.robot.samples(motion, times).powers.sum(axis=1)
    assert checked.energy == pytest.approx(np.trapezoid(power, times), rel=1e-4)
