"""Velocity ramps of one joint: the servo law, physics of the motion, states, excursion, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from ocptip.basics.errors import InputError
from ocptip.trajectories.ramps import JointRamps, RampCommand, servo_ramp
from tests.quick import examples
from tests.trajectories.strategies import angles, commands


def test_trapezoid_from_rest():
    """(5.2): t' = v/a, t'' = |way|/v, t_e = t'' + v/a."""
    motion = JointRamps.from_commands(1.0, [RampCommand(-5.0, 2.0, 4.0)])
    assert motion.times == pytest.approx([0, 0.5, 3.0, 3.5])
    assert motion.angles == pytest.approx([1.0, 0.5, -4.5, -5.0])
    assert motion.speeds.tolist() == [0, -2, -2, 0]
    assert motion.accelerations.tolist() == [-4, 0, 4]


@pytest.mark.parametrize("speed", [2.0, 3.0, 100.0])
def test_triangle_from_rest(speed):
    """(5.3): peak sqrt(a |way|); the commanded speed does not matter."""
    motion = JointRamps.from_commands(0.0, [RampCommand(1.0, speed, 4.0)])
    assert motion.times == pytest.approx([0, 0.5, 0.5, 1.0])
    assert motion.peaks == pytest.approx([2.0])


@pytest.mark.parametrize(
    ("w_a", "way", "peak", "ramp", "cruise"),
    [
        (1.0, 10.0, 2.0, 1.0, (10 - 3.5) / 2),  # on in the same direction
        (-1.0, 10.0, 2.0, 3.0, (10 - 3.5) / 2),  # turns first
        (3.0, 10.0, 2.0, 1.0, (10 - 4.5) / 2),  # faster than v: slows down
        (-3.0, 10.0, 2.0, 5.0, (10 + 0.5) / 2),  # faster than v the wrong way
        (1.0, 0.0, -np.sqrt(0.5), 1 + np.sqrt(0.5), 0.0),  # overshoots, comes back
        (3.0, 4.0, -np.sqrt(0.5), 3 + np.sqrt(0.5), 0.0),  # cannot stop in time: back in a triangle
        (3.0, -9.0, -2.0, 5.0, (9 + 2.5 - 2) / 2),  # behind: at -v
        (1.0, 2.0, np.sqrt(2.5), np.sqrt(2.5) - 1, 0.0),  # between D- and D+
        (1.0, 0.5, 0.0, 1.0, 0.0),  # braking at once leads there
        (0.0, 0.0, 0.0, 0.0, 0.0),  # nothing to do
    ],
)
def test_servo_law_from_the_moving_state(w_a, way, peak, ramp, cruise):
    """(5.5) to (5.8) by hand, v = 2, a = 1; and their mirror images."""
    for sign in (1, -1):
        found = servo_ramp(0.7, sign * w_a, 0.7 + sign * way, 2.0, 1.0)
        assert found.peak == pytest.approx(sign * peak, abs=1e-7)
        assert found.ramp == pytest.approx(ramp, abs=1e-7)
        assert found.cruise == pytest.approx(cruise, abs=1e-7)


@given(angles(), commands)
def test_motion_obeys_physics(phi_start, given_commands):
    """Continuous angle and speed, speed bounds, exact end, ordered events, angle = integral of speed."""
    motion = JointRamps.from_commands(phi_start, given_commands)
    assert np.all(motion.durations >= 0)
    assert motion.phi_start == phi_start
    assert motion.phi_end == given_commands[-1].phi_e
    assert motion.states(motion.end)[0] == given_commands[-1].phi_e
    d, w, a = motion.durations, motion.speeds, motion.accelerations
    assert w[0] == w[-1] == 0
    assert w[:-1] + a * d == pytest.approx(w[1:], abs=1e-9)
    assert np.diff(motion.angles) == pytest.approx(0.5 * (w[:-1] + w[1:]) * d, abs=1e-9)
    for k, command in enumerate(given_commands):
        assert abs(motion.peaks[k]) <= max(command.speed, abs(w[2 * k])) * (1 + 1e-12)
    assert np.all(motion.ramp_ends <= motion.brake_starts)
    inside = np.linspace(0, motion.end, 200)
    angle, speed, _ = motion.states(inside)
    simpson = (inside[1:] - inside[:-1]) / 6
    middle = motion.states(0.5 * (inside[1:] + inside[:-1]))[1]
    travelled = np.sum(simpson * (speed[:-1] + 4 * middle + speed[1:]))
    assert travelled == pytest.approx(motion.phi_end - phi_start, abs=np.diff(inside).max() ** 2 * 12 * 10)
    low, high = motion.pieces.angle_ranges[0]
    assert low - 1e-12 <= angle.min()
    assert angle.max() <= high + 1e-12


@examples(25)
@given(angles(), commands)
def test_agrees_with_a_simulated_drive(phi_start, given_commands):
    """A drive simulated step by step, without any formula of (5.2) to (5.8), moves the same way.

    It slews its speed, by at most a dt in a step, towards the highest speed from which it still can stop.
    """
    motion = JointRamps.from_commands(phi_start, given_commands)
    dt = 5e-4
    steps = int(motion.end / dt) + 2
    phi, w, simulated = phi_start, 0.0, np.empty(steps)
    switch = [0.0, *motion.brake_starts[:-1], np.inf]
    now = 0
    for i in range(steps):
        simulated[i] = phi
        while i * dt >= switch[now + 1]:
            now += 1
        v, a, left = (
            given_commands[now].speed,
            given_commands[now].acceleration,
            given_commands[now].phi_e - phi,
        )
        wanted = np.copysign(min(v, (2 * a * abs(left)) ** 0.5), left)
        w += min(max(wanted - w, -a * dt), a * dt)
        phi += w * dt
    error = np.abs(simulated - motion.states(np.arange(steps) * dt)[0]).max()
    assert error < 20 * dt * len(given_commands)


@given(angles(), commands)
def test_crossings_are_sign_changes(phi_start, given_commands):
    """At a crossing the speed is 0 and the acceleration is not (5.27); one for every change of sign."""
    motion = JointRamps.from_commands(phi_start, given_commands)
    found = motion.crossings[np.isfinite(motion.crossings)]
    if len(found):
        speed = motion.states(found)[1]
        assert speed == pytest.approx(0, abs=1e-9)
        turned = np.isfinite(motion.crossings) & (np.abs(motion.peaks) > 1e-6)
        assert np.all(motion.accelerations[:-1:2][turned] != 0)
    assert len(found) == np.sum(motion.peaks[:-1] * motion.peaks[1:] < 0)


def test_overshoot_at_a_reversal_is_in_the_range():
    """(5.35): turned back at speed w with a, the joint still goes w^2 / (2 a)."""
    motion = JointRamps.from_commands(0.0, [RampCommand(1.0, 1.0, 10.0), RampCommand(-1.0, 1.0, 0.5)])
    turned_at = motion.angles[2]
    assert motion.pieces.angle_ranges[0] == pytest.approx((-1.0, turned_at + 1.0))
    assert motion.pieces.angle_ranges[0, 1] > motion.angles.max() + 0.5


def test_states_at_boundaries_and_outside():
    """The acceleration's side is selectable; phases of length 0 never show; outside the joint rests (5.9)."""
    motion = JointRamps.from_commands(0.0, [RampCommand(1.0, 5.0, 4.0)])  # a triangle, t' = t'' = 0.5
    right = motion.states([-1.0, 0.0, 0.5, 1.0, 9.0])
    left = motion.states([-1.0, 0.0, 0.5, 1.0, 9.0], side="left")
    assert right[2].tolist() == [0, 4, -4, 0, 0]
    assert left[2].tolist() == [0, 0, 4, -4, 0]
    assert right[0] == pytest.approx([0, 0, 0.5, 1, 1])
    assert left[0] == pytest.approx(right[0])
    assert right[1] == pytest.approx([0, 0, 2, 0, 0])
    assert motion.states(np.zeros((2, 3)))[0].shape == (2, 3)


def test_zero_length_motion():
    """A command to where the joint is takes no time."""
    motion = JointRamps.from_commands(0.3, [RampCommand(0.3, 1.0, 1.0)])
    assert motion.end == 0
    assert motion.states([0.0, 1.0])[0].tolist() == [0.3, 0.3]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("speed", 0.0),
        ("speed", -1.0),
        ("speed", np.nan),
        ("acceleration", 0),
        ("acceleration", np.inf),
        ("phi_e", "x"),
    ],
)
def test_bad_commands_are_refused(field, value):
    """The message names the field and shows the value."""
    with pytest.raises(InputError, match=f"{field}: .*{value}"):
        RampCommand(**{"phi_e": 1.0, "speed": 1.0, "acceleration": 1.0, field: value})


def test_bad_calls_are_refused():
    """No commands, no number, no such side."""
    with pytest.raises(InputError, match="at least one"):
        JointRamps.from_commands(0.0, [])
    with pytest.raises(InputError, match="phi_start"):
        JointRamps.from_commands(np.nan, [RampCommand(1.0, 1.0, 1.0)])
    motion = JointRamps.from_commands(0.0, [RampCommand(1.0, 1.0, 1.0)])
    with pytest.raises(InputError, match="NaN"):
        motion.states([0.0, np.nan])
    with pytest.raises(InputError, match="side"):
        motion.states(0.0, side="both")
    with pytest.raises(ValueError, match="read-only"):
        motion.times[0] = 1.0
