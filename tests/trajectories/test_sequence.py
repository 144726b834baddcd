"""Motions one after the other: joined into one trajectory, parted again where it stands still."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, seed
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.trajectories.controllers import CONTROLLERS, controller_points
from ocptip.trajectories.points import Points, stamped
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.sequence import joined, parted, standstills
from ocptip.trajectories.trajectory import Trajectory
from tests.quick import examples


def ramps(start, goal, speed=1.0):
    commands = [[RampCommand(q, speed * (1 + k), 3.0 + k)] for k, q in enumerate(goal)]
    return Trajectory.from_profiles(start, commands)


STOPS = [[0.0, 0.3], [1.0, -0.4], [0.2, 0.5], [0.0, 0.3]]
MOTIONS = [ramps(a, b) for a, b in pairwise(STOPS)]


@seed(3)
@examples(12)
@given(st.sampled_from(CONTROLLERS), st.lists(st.sampled_from([0.0, 0.013, 0.5]), min_size=3, max_size=3))
def test_parted_again_the_motions_are_those_that_were_joined(controller, pauses):
    rise = 0.02 if controller == "quintic" else 0.0
    runs = [controller_points(motion.with_rise_times(rise), controller, step=0.01) for motion in MOTIONS]
    whole = joined([run.points for run in runs], pauses)
    found = parted(Trajectory(points=whole), standstills(whole))
    expected = Trajectory.from_segments(runs, pauses)
    assert len(found.segments) == 3
    np.testing.assert_allclose(found.begins, expected.begins, atol=4e-9)
    np.testing.assert_allclose(found.pauses, pauses, atol=4e-9)
    assert found.end == pytest.approx(expected.end, abs=1e-8)
    for own, other in zip(found.segments, runs, strict=True):
        times = np.linspace(0, other.end, 50)
        for a, b in zip(own.states(times)[:2], other.states(times)[:2], strict=True):
            np.testing.assert_allclose(a, b, atol=1e-7)  # times are whole nanoseconds


def test_the_whole_trajectory_is_the_motions_in_turn():
    sequence = Trajectory.from_segments(tuple(MOTIONS), (0.2, 0.0, 0.1))
    points = [controller_points(motion, "cubic").points for motion in MOTIONS]
    whole = Trajectory(points=joined(points, sequence.pauses))
    for begin, motion, pause in zip(sequence.begins, MOTIONS, sequence.pauses, strict=True):
        inside = np.linspace(0.01, motion.end - 0.01, 20)
        for run in (whole, sequence):
            np.testing.assert_allclose(run(begin + inside), motion(inside), atol=1e-7)
            np.testing.assert_allclose(run(begin + inside, 1), motion(inside, 1), atol=1e-6)
        rest = begin + motion.end + np.linspace(1e-6, 0.99 * pause, 4) if pause else []
        for run in (whole, sequence):
            for value in run.states(np.array(rest))[1:]:
                assert not np.any(value)
    assert whole.end == pytest.approx(sequence.end, abs=1e-8)
    np.testing.assert_allclose(sequence.time_scaled(2.0).begins, 2 * sequence.begins)
    np.testing.assert_allclose(sequence.jumps, 0, atol=1e-12)
    assert sequence.event_times[-1] == pytest.approx(sequence.begins[-1] + MOTIONS[-1].end)


def test_one_joint_that_rests_is_no_standstill():
    times = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    angles = np.array([[0.0, 0.0], [0.2, 0.1], [0.4, 0.1], [0.4, 0.3], [0.4, 0.4]])
    speeds = np.array([[0.0, 0.0], [0.4, 0.0], [0.0, 0.2], [0.0, 0.3], [0.0, 0.0]])
    assert standstills(Points(times, angles, speeds)) == []
    speeds[2] = 0.0
    assert standstills(Points(times, angles, speeds)) == [(2, 2)]


def test_rest_before_the_motion_belongs_to_it():
    times = np.array([0.0, 0.5, 1.0, 1.5])
    motion = Trajectory.from_points(times, np.array([[0.0], [0.0], [1.0], [1.0]]), np.zeros((4, 1)))
    assert standstills(motion.points) == [(2, 3)]
    found = parted(motion, standstills(motion.points))
    assert (len(found.segments), found.pauses, found.segments[0].end) == (1, (0.5,), 1.0)


@pytest.mark.parametrize(
    ("motions", "pauses", "message"),
    [
        ((), (), "motions: at least one is needed"),
        (MOTIONS, (0.0,), "pauses: expected 3, got 1"),
        (MOTIONS[:1], (-1.0,), r"pauses\[1\]: must be >= 0"),
        ((MOTIONS[0], ramps([0.0], [1.0])), (0.0, 0.0), r"motions\[2\]: has 1 joints, the first one has 2"),
    ],
)
def test_what_is_no_sequence(motions, pauses, message):
    with pytest.raises(InputError, match=message):
        Trajectory.from_segments(tuple(motions), pauses)


def test_parts_of_a_trajectory_are_those_joined_to_the_last_bit():
    rng = np.random.default_rng(4)
    motions = []
    for _ in range(4):
        times = stamped(np.concatenate([[0.0], np.cumsum(rng.choice([2e-6, 1e-3, 0.01, 0.7], 30))]))
        speeds = rng.normal(size=(31, 2))
        speeds[[0, -1]] = 0.0
        angles = rng.normal(size=(31, 2))
        if motions:
            angles[0] = motions[-1].angles[-1]
        motions.append(Points(times, angles, speeds))
    whole = joined(motions, (0.0, 0.3, 1 / 3, 0.0))
    again = parted(Trajectory(points=whole), standstills(whole))
    for one, other in zip(motions, (own.points for own in again.segments), strict=True):
        assert np.array_equal(one.times, other.times)
        assert np.array_equal(one.angles, other.angles)
