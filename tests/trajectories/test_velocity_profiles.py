"""Passive joints, and the motion of all joints: states, events, quadrature, reading and writing."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.trajectories.ramps import JointRamps, RampCommand
from ocptip.trajectories.trajectory import Trajectory
from ocptip.trajectories.velocity_profiles import VelocityProfiles, earliest_end, passive_command
from tests.trajectories.strategies import angles, commands, numbers

V, A = np.array([2.0, 2.0, 2.0]), np.array([8.0, 8.0, 8.0])


def command(phi_e: float = 1.0, speed: float = 1.0, acceleration: float = 2.0) -> RampCommand:
    """Some command."""
    return RampCommand(phi_e, speed, acceleration)


@given(angles(), angles(), numbers(0.1, 4.0), numbers(0.1, 12.0), st.one_of(st.just(1.0), numbers(1.0, 5.0)))
def test_passive_joint_ends_on_time_within_its_limits(phi_start, phi_goal, v, a, later):
    """From the earliest possible end on, any end is met exactly, at the speed limit if it can be reached."""
    way = abs(phi_goal - phi_start)
    assume(way > 1e-6)
    earliest = float(earliest_end(way, v, a))
    end = earliest * later
    motion = JointRamps.from_commands(phi_start, [passive_command(phi_start, phi_goal, end, v, a)])
    assert motion.end == pytest.approx(end, rel=1e-9)
    assert motion.phi_end == phi_goal
    assert np.abs(motion.speeds).max() <= v
    assert np.abs(motion.accelerations).max() <= a
    if way > 0.5 * v * end * (1 + 1e-9):
        assert np.abs(motion.peaks[0]) == v  # (5.16)
        assert motion.ramp_ends[0] == pytest.approx(end - way / v, rel=1e-6, abs=1e-9)
    elif way < 0.5 * v * end * (1 - 1e-9):
        assert motion.ramp_ends[0] == motion.brake_starts[0] == pytest.approx(end / 2)  # (5.17)
    with pytest.raises(InputError, match="end: must be >="):
        passive_command(phi_start, phi_goal, earliest * 0.999, v, a)


def test_earliest_end_is_vectorised():
    """(5.14), (5.13): trapezoid and triangle."""
    assert earliest_end([4.0, -0.5, 0.0], 2.0, 8.0) == pytest.approx([2.25, 0.5, 0.0])


def test_passive_joints_end_with_the_last_optimised_one():
    """(5.15), the usual case."""
    motion = Trajectory.ending_together([0, 0, 0], [1, 0.5, -2], [[command()], None, None], V, A)
    assert [joint.end for joint in motion.joints] == pytest.approx([1.5, 1.5, 1.5])
    assert motion.goal.tolist() == [1, 0.5, -2]
    assert len(motion.joints[2].commands) == 1


def test_slow_passive_joint_decides_the_end():
    """(5.15): it goes at its limits, the others wait for it."""
    motion = Trajectory.ending_together([0, 0, 0], [1, 4, -2], [[command()], None, None], V, A)
    assert [joint.end for joint in motion.joints] == pytest.approx([1.5, 2.25, 2.25])
    assert motion.joints[1].accelerations[0] == pytest.approx(8.0)
    assert motion.end == pytest.approx(2.25)


def test_passive_joint_without_way_rests():
    """No motion, no events of its own."""
    motion = Trajectory.ending_together([0, 0.2], [1, 0.2], [[command()], None], V[:2], A[:2])
    assert motion.joints[1].end == 0
    assert motion.event_times == pytest.approx([0, 0.5, 1.0, 1.5])


def test_states_of_all_joints():
    """Columns are joints; at one time a vector."""
    motion = Trajectory.from_profiles([0.0, 0.5], [[command()], [command(2.0), command(-1.0)]])
    times = np.linspace(-0.1, motion.end + 0.1, 40)
    for side in ("left", "right"):
        states = motion.states(times, side=side)
        for values, *of_joints in zip(
            states, *(j.states(times, side=side) for j in motion.joints), strict=True
        ):
            assert values.shape == (40, 2)
            assert values.tolist() == np.column_stack(of_joints).tolist()
    assert motion.states(0.3)[0].shape == (2,)
    assert motion.angle_ranges.tolist() == [joint.pieces.angle_ranges[0].tolist() for joint in motion.joints]


@given(st.lists(st.tuples(angles(), commands), min_size=1, max_size=3))
def test_events_split_the_motion(joints):
    """Sorted, over 0.1 us apart, from 0 to the end; within an interval no acceleration or sign changes."""
    motion = Trajectory.from_profiles([start for start, _ in joints], [given for _, given in joints])
    events = motion.event_times
    assert events[0] == 0
    assert events[-1] == (motion.end if motion.end > 1e-7 else 0)
    assert np.all(np.diff(events) > 1e-7)
    all_times = np.concatenate([motion.crossings, *(joint.times for joint in motion.joints)])
    assert np.abs(all_times[:, None] - events).min(axis=1).max() < 2e-9 * len(all_times)
    if len(events) < 2:
        return
    left, right = motion.intervals.T
    parts = left[:, None] + (right - left)[:, None] * np.array([0.01, 0.3, 0.99])
    assume((right - left).min() > 1e-6)
    _, speeds, accelerations = motion.states(parts)
    assert np.all(accelerations == accelerations[:, :1])
    assert np.all(np.sign(np.round(speeds, 12)) == np.sign(np.round(speeds[:, 1:2], 12)))


@given(st.lists(st.tuples(angles(), commands), min_size=1, max_size=3))
def test_quadrature_is_exact_for_the_motion(joints):
    """Integral of speed is the way, of squared speed (degree 2 in every interval) the sum of (5.9)."""
    motion = Trajectory.from_profiles([start for start, _ in joints], [given for _, given in joints])
    nodes, weights = motion.quadrature()
    assert len(nodes) == len(weights) == 4 * len(motion.intervals)
    assert np.all(np.diff(nodes) > 0)
    assert not np.intersect1d(nodes, motion.event_times).size
    assert weights.sum() == pytest.approx(motion.end, abs=1e-12)
    speeds = motion.states(nodes)[1]
    assert weights @ speeds == pytest.approx(motion.goal - motion.start, abs=1e-6)
    for j, joint in enumerate(motion.joints):
        before, after = joint.speeds[:-1], joint.speeds[1:]
        squares = np.sum(joint.durations * (before**2 + before * after + after**2) / 3)
        assert weights @ speeds[:, j] ** 2 == pytest.approx(squares, abs=1e-6)


def test_events_nearer_than_a_nanosecond_are_one():
    """No interval of rounding's length."""
    motion = Trajectory.from_profiles([0.0, 0.0], [[command()], [command(1.0 + 1e-13)]])
    assert len(motion.event_times) == 4


def test_resting_arm():
    """Nothing moves: no interval, no node."""
    motion = Trajectory.from_profiles([0.5], [[command(0.5)]])
    assert motion.end == 0
    assert motion.event_times.tolist() == [0]
    assert motion.quadrature()[0].shape == (0,)


def test_time_scaled_motion_has_the_same_path():
    """Speeds scale with 1 / factor, accelerations with its square."""
    motion = Trajectory.from_profiles([0.0], [[command(2.0), command(-1.0, 2.0, 3.0)]])
    fast = motion.time_scaled(0.95)
    assert fast.end == pytest.approx(0.95 * motion.end)
    times = np.linspace(0, motion.end, 50)
    assert fast.states(0.95 * times)[0] == pytest.approx(motion.states(times)[0])


@given(st.lists(st.tuples(angles(), commands), min_size=1, max_size=3))
def test_dictionary_round_trip(joints):
    """Through JSON; degrees outside, radians inside; other keys do no harm."""
    motion = Trajectory.from_profiles([start for start, _ in joints], [given for _, given in joints])
    written = json.loads(json.dumps({**motion.to_dict(), "energy_J": 3.0}))
    assert written["commands"][0][0]["speed"] == pytest.approx(np.rad2deg(joints[0][1][0].speed))
    read = Trajectory.from_dict(written)
    assert read.start == pytest.approx(motion.start)
    for one, two in zip(read.joints, motion.joints, strict=True):
        for a, b in zip(one.commands, two.commands, strict=True):
            assert [a.phi_e, a.speed, a.acceleration] == pytest.approx([b.phi_e, b.speed, b.acceleration])


GOOD = {"phi_e": 10, "speed": 20, "acceleration": 30}


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ([], "motion: expected a table"),
        ({"start": [0]}, "commands is missing"),
        ({"start": [0], "commands": "x"}, "commands: expected one list"),
        ({"start": [0], "commands": [GOOD]}, "commands: expected one list"),
        ({"start": [0, 1], "commands": [[GOOD]]}, "start: expected shape 1"),
        ({"start": [np.nan], "commands": [[GOOD]]}, "start: contains NaN"),
        ({"start": [0, 0], "commands": [[GOOD], []]}, "joint 2: commands: at least one"),
        (
            {"start": [0, 0], "commands": [[GOOD], [GOOD, {**GOOD, "speed": -5}]]},
            "joint 2, command 2: speed.*-5",
        ),
        ({"start": [0], "commands": [[{**GOOD, "acceleration": None}]]}, "joint 1, command 1: acceleration"),
        ({"start": [0], "commands": [[{**GOOD, "phi_e": np.nan}]]}, "joint 1, command 1: phi_e.*nan"),
        (
            {"start": [0], "commands": [[{"phi_e": 1, "speed": 1}]]},
            "joint 1, command 1: expected exactly the keys",
        ),
        ({"start": [0], "commands": [[{**GOOD, "jerk": 1}]]}, "joint 1, command 1: .*jerk"),
    ],
)
def test_bad_dictionaries_are_refused(data, said):
    """The message names joint and command, counted from 1."""
    with pytest.raises(InputError, match=said):
        Trajectory.from_dict(data)


def test_bad_calls_are_refused():
    """Each with its name."""
    with pytest.raises(InputError, match="joints: at least one"):
        VelocityProfiles(())
    with pytest.raises(InputError, match="joint 1: commands"):
        Trajectory.ending_together([0], [1], [[]], [1], [1])
    with pytest.raises(InputError, match=r"speed_limits of joint 2: .*-1"):
        Trajectory.ending_together([0, 0], [1, 1], [[command()], None], [0, -1], [0, 1])
    with pytest.raises(InputError, match="goal: expected shape 1"):
        Trajectory.ending_together([0], [1, 2], [None], [1], [1])
    motion = Trajectory.from_profiles([0.0], [[command()]])
    for order in (0, 2.5, True):
        with pytest.raises(InputError, match="order"):
            motion.quadrature(order)
    with pytest.raises(InputError, match="factor"):
        motion.time_scaled(0)


@pytest.mark.parametrize("cruise", [0.0, 5e-9, 1e-3])
def test_phases_that_only_rounding_makes_are_no_intervals(cruise):
    motion = Trajectory.from_profiles([0.0], [[RampCommand(1.0 + cruise, 1.0, 1.0)]])
    expected = [0, 1, 1 + cruise, 2 + cruise] if cruise > 1e-6 else [0, 1, 2]
    np.testing.assert_allclose(motion.event_times, expected, atol=1e-8)
