"""Trapezoidal velocity profiles of one joint: commands to motion (5.2 to 5.9), motion to commands, states.

A drive takes commands (target angle, speed, acceleration) and moves by itself: it changes its speed with
constant acceleration to a peak, cruises, and brakes with the same acceleration to rest at the target. The
next command is given when this braking would begin (t''), so only the last command brakes. n commands hence
give 2 n + 1 phases of constant acceleration, with an acceleration phase for each command

    accelerate 1, cruise 1, accelerate 2, cruise 2, ..., accelerate n, cruise n, brake

with the speeds 0, w_1, w_1, w_2, w_2, ..., w_n, w_n, 0 at their boundaries. Phases may be empty (length 0; no
cruise is the triangle of (5.3)). They stay in the arrays: phase 2 k - 2 always is the acceleration phase of
command k.

Symbols: phi angle, w speed, a acceleration (> 0), d_k duration of acceleration phase k, c_k cruise duration,
d_{n+1} brake duration; t'_k end of acceleration, t''_k end of cruise. Angles in rad, times in s, start of the
motion at t = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, number_from, positive_number
from ocptip.basics.frozen import read_only, settle
from ocptip.trajectories.pieces import Pieces, Side

_IDLE = 1.0  # speed (rad/s) and acceleration (rad/s^2) of a command that moves nothing; any value would do


@dataclass(frozen=True)
class RampCommand:
    """One command to a joint's drive.

    Attributes:
        phi_e: target angle, rad.
        speed: speed v > 0 to cruise at, rad/s; without effect if the target is too near to reach it.
        acceleration: a > 0 of speeding up and of braking, rad/s^2.
    """

    phi_e: float
    speed: float
    acceleration: float

    def __post_init__(self) -> None:
        """Raise InputError if phi_e is not finite, or speed or acceleration is not > 0."""
        settle(
            self,
            phi_e=number_from("phi_e", self.phi_e),
            speed=positive_number("speed", self.speed),
            acceleration=positive_number("acceleration", self.acceleration),
        )


class ServoRamp(NamedTuple):
    """The drive's motion until it would brake: to the speed `peak` (rad/s, signed), cruise; times in s."""

    peak: float
    ramp: float
    cruise: float


def servo_ramp(phi_a: float, w_a: float, phi_e: float, speed: float, acceleration: float) -> ServoRamp:
    """Return the drive's answer to a command given in the state (phi_a, w_a), (5.2) to (5.8).

    With D+ and D- the distances covered by reaching +v or -v and braking at once (5.5): at least D+ to go:
    cruise at +v; at most D-: cruise at -v; between: no cruise, a peak below v (5.8). If braking at once leads
    exactly to the target, and v is not below the speed, the peak is 0: the joint comes to rest at t' = t''.

    Args:
        phi_a: angle when the command is given, rad.
        w_a: speed when the command is given, rad/s.
        phi_e: target angle, rad.
        speed: v > 0, rad/s.
        acceleration: a > 0, rad/s^2.
    """
    way, v, a = phi_e - phi_a, speed, acceleration
    way_plus = 0.5 * (w_a + v) * abs(v - w_a) / a + 0.5 * (v * v) / a
    way_minus = 0.5 * (w_a - v) * abs(v + w_a) / a - 0.5 * (v * v) / a
    if way >= way_plus:
        peak, cruise = v, (way - way_plus) / v
    elif way <= way_minus:
        peak, cruise = -v, (way_minus - way) / v
    else:
        u = _sign(0.5 * w_a * abs(w_a) / a - way)
        peak, cruise = -u * sqrt(max(0.5 * (w_a * w_a) - u * a * way, 0.0)) + 0.0, 0.0  # no -0.0
    return ServoRamp(peak, abs(peak - w_a) / a, cruise)


def _sign(value: float) -> float:
    return float((value > 0) - (value < 0))


@dataclass(frozen=True, eq=False)
class JointRamps:
    """The motion of one joint under successive commands: 2 n + 1 phases of constant acceleration.

    Made by :meth:`from_commands`. The joint rests before t = 0 and after the end.

    Attributes:
        commands: the n commands.
        times: boundaries of the phases, (2 n + 2,), s, from 0, not decreasing.
        angles: angle at the boundaries, (2 n + 2,), rad; the last is the last command's phi_e, exactly.
        speeds: speed at the boundaries, (2 n + 2,), rad/s.
        accelerations: acceleration within the phases, (2 n + 1,), rad/s^2; 0 in a phase of length 0.
    """

    commands: tuple[RampCommand, ...]
    times: np.ndarray
    angles: np.ndarray
    speeds: np.ndarray
    accelerations: np.ndarray

    @classmethod
    def from_commands(cls, phi_start: float, commands: Sequence[RampCommand]) -> JointRamps:
        """Return the motion from rest at phi_start (rad); command k + 1 is given at t'' of command k (5.4).

        Raises:
            InputError: phi_start is not finite, or there is no command.
        """
        phi = phi_start = number_from("phi_start", phi_start)
        commands = tuple(commands)
        if not commands:
            raise InputError("commands: at least one profile command is needed, got none")
        times, angles, speeds, accelerations = [0.0], [phi], [0.0], []
        for command in commands:
            w = speeds[-1]
            peak, ramp, cruise = servo_ramp(phi, w, command.phi_e, command.speed, command.acceleration)
            # Backwards from the target, so that the joint ends there exactly.
            phi = command.phi_e - 0.5 * peak * abs(peak) / command.acceleration
            times += [times[-1] + ramp, times[-1] + ramp + cruise]
            angles += [phi - peak * cruise, phi]
            speeds += [peak, peak]
            accelerations += [_sign(peak - w) * command.acceleration, 0.0]
        last, peak = commands[-1], speeds[-1]
        times.append(times[-1] + abs(peak) / last.acceleration)
        angles.append(last.phi_e)
        speeds.append(0.0)
        accelerations.append(-_sign(peak) * last.acceleration + 0.0)
        arrays = [np.array(values) for values in (times, angles, speeds, accelerations)]
        return cls(commands, *map(read_only, arrays))

    @property
    def phi_start(self) -> float:
        """Angle before the motion, rad."""
        return float(self.angles[0])

    @property
    def phi_end(self) -> float:
        """Angle after the motion, rad."""
        return float(self.angles[-1])

    @property
    def end(self) -> float:
        """When the joint has come to rest, s."""
        return float(self.times[-1])

    @property
    def durations(self) -> np.ndarray:
        """Durations of the phases, (2 n + 1,), s."""
        return np.diff(self.times)

    @property
    def peaks(self) -> np.ndarray:
        """Speed w_k at the end of each command's acceleration phase and during its cruise, (n,), rad/s."""
        return self.speeds[1:-1:2]

    @property
    def ramps(self) -> np.ndarray:
        """Acceleration durations d_1 .. d_n and the duration d_{n+1} of braking, (n + 1,), s."""
        return self.durations[::2]

    @property
    def cruises(self) -> np.ndarray:
        """Cruise durations c_k, (n,), s."""
        return self.durations[1::2]

    @property
    def ramp_ends(self) -> np.ndarray:
        """t' of each command, (n,), s."""
        return self.times[1:-1:2]

    @property
    def brake_starts(self) -> np.ndarray:
        """t'' of each command, (n,), s: the next one is given, or the joint brakes."""
        return self.times[2:-1:2]

    @cached_property
    def crossings(self) -> np.ndarray:
        """When the speed changes sign within each command's acceleration phase, (n,), s, NaN where it does
        not (5.28).
        """
        before, after = self.speeds[:-2:2], self.peaks
        crossing = self.times[:-2:2] + np.abs(before) / self._command_accelerations
        return np.where(before * after < 0, crossing, np.nan)

    @property
    def margins(self) -> np.ndarray:
        """How far each target is from where braking at once would lead, (n,), rad.

        Where it is 0 for a moving joint, before the last command, the motion jumps: with a little less way to
        go the joint stops and turns back, and t'' comes later by |w_a| / a at most.
        """
        w_a = self.speeds[:-2:2]
        way = np.array([command.phi_e for command in self.commands]) - self.angles[:-2:2]
        return np.abs(way - 0.5 * w_a * np.abs(w_a) / self._command_accelerations)

    @cached_property
    def pieces(self) -> Pieces:
        """The phases that last, as polynomials of time (5.9), of this one joint."""
        lasting = np.diff(self.times) > 0
        ends = np.append(lasting, True)
        rows = self.angles[:-1], self.speeds[:-1], self.accelerations
        derivatives = np.stack(rows)[:, lasting, None]
        return Pieces(self.times[ends], derivatives, self.angles[-1:])

    def states(self, times: ArrayLike, *, side: Side = "right") -> tuple[np.ndarray, ...]:
        """Return angle (rad), speed (rad/s) and acceleration (rad/s^2) at times (any shape, s), (5.9).

        Args:
            times: when; before 0 and after the end the joint rests.
            side: "right": at a boundary of phases the acceleration after it, "left": the one before it.

        Raises:
            InputError: a time is not finite, or side is another word.
        """
        return tuple(values[..., 0] for values in self.pieces.at(times, side=side))

    @cached_property
    def _command_accelerations(self) -> np.ndarray:
        return np.array([command.acceleration for command in self.commands])


def phase_violations(
    peaks: ArrayLike,
    ramps: ArrayLike,
    cruises: ArrayLike,
    *,
    resolution: float = 1e-9,
    tolerance: float = 1e-7,
) -> list[str]:
    """Return why no commands produce these phases, one sentence per reason; empty if there are some.

    Commands exist if and only if, for k = 1 .. n with w_0 = 0,

    1. d_k >= 0 and c_k >= 0;
    2. w_k differs from w_{k-1} exactly if d_k > 0 (a_k is finite and > 0);
    3. d_{n+1} = |w_n| d_n / |w_n - w_{n-1}|: the drive brakes with a_n (free if d_n = 0, w_n = w_{n-1} != 0);
    4. w_k is not 0, except that a command may move nothing (w_{k-1} = d_k = c_k = 0), and that the last one
       may only brake (c_n = d_{n+1} = 0);
    5. for 1 < k < n the target keeps a margin from where braking at once would lead
       (:attr:`JointRamps.margins`): |w_k| c_k if the joint slows down or keeps its speed without turning,
       |w_k| c_k + (w_k^2 - w_{k-1}^2) / a_k if it speeds up, |w_k| c_k + w_k^2 / a_k if it turns. Only
       slowing down without cruise has none.

    Turning needs no condition of its own: with speed |w_k| and a_k = |w_k - w_{k-1}| / d_k the way to the
    target is D+ + w_k c_k or D- + w_k c_k of (5.5) for w_k > 0 or < 0, whatever w_{k-1}.

    Args:
        peaks: w_1 .. w_n, signed, (n,), rad/s.
        ramps: d_1 .. d_n and the brake duration d_{n+1}, (n + 1,), s.
        cruises: c_1 .. c_n, (n,), s.
        resolution: minimum margin of condition 5, rad: how finely targets are stored or sent.
        tolerance: how much durations (s) may break conditions 1 and 3, and speeds (rad/s) condition 2.

    Raises:
        InputError: shapes do not fit, or numbers are not finite.
    """
    w, d, c = _phase_arrays(peaks, ramps, cruises)
    n, results = len(w), []
    for name, values in (("ramp", d), ("cruise", c)):
        negative = ((k, x) for k, x in enumerate(values, 1) if x < -tolerance)
        results += [f"{name} {k}: lasts {x:.6g} s, must be >= 0" for k, x in negative]
    if results:
        return results
    w, d, c = _snapped(w, d, c, tolerance)
    for k, (w_a, w_k, d_k, c_k) in enumerate(zip([0.0, *w[:-1]], w, d, c, strict=False), 1):
        where = f"command {k} (from {w_a:.6g} to {w_k:.6g} rad/s in {d_k:.6g} s, then {c_k:.6g} s of cruise)"
        if w_k == 0 and w_a == 0 and d_k == 0 and c_k == 0:
            continue
        if w_k == 0 and not (k == n and c_k == 0 and w_a != 0):
            results.append(f"{where}: no command makes a joint rest between its ends; keep |w_{k}| > 0")
        elif d_k == 0 and w_k != w_a:
            results.append(f"{where}: a step of the speed; the change must last")
        elif d_k > 0 and w_k == w_a:
            results.append(f"{where}: a duration that changes no speed; count it as cruise")
        elif 1 < k < n and (margin := _margin(w_a, w_k, d_k, c_k)) <= resolution:
            results.append(
                f"{where}: the target is {margin:.3g} rad from where braking at once leads, must be more "
                f"than {resolution:.3g}; slowing down needs some cruise, or leave out the command"
            )
    w_a, brake = (w[-2] if n > 1 else 0.0), d[-1]
    if d[-2] > 0 and w[-1] != w_a:
        wanted = abs(w[-1]) * d[-2] / abs(w[-1] - w_a)
        if abs(brake - wanted) > tolerance:
            results.append(f"braking: lasts {brake:.6g} s, must last {wanted:.6g} s at the last acceleration")
    elif (w[-1] == 0) != (brake == 0):
        results.append(f"braking: lasts {brake:.6g} s, but the speed before it is {w[-1]:.6g} rad/s")
    return results


def phases_to_commands(
    phi_start: float,
    peaks: ArrayLike,
    ramps: ArrayLike,
    cruises: ArrayLike,
    *,
    phi_goal: float | None = None,
    resolution: float = 1e-9,
    tolerance: float = 1e-7,
) -> tuple[RampCommand, ...]:
    """Return the commands that make a joint run through these phases: the inverse of the servo law.

    Command k has speed |w_k| (in a triangle, where more would change nothing: the peak), acceleration a_k =
    |w_k - w_{k-1}| / d_k, and as target the angle where braking from w_k with a_k would end if begun at the
    end of cruise k. Where a_k is free (no acceleration phase: w_k = w_{k-1}) it is the one of the command
    before, for the last command |w_n| / d_{n+1}. A small a_k puts the target far ahead: keep phi_e in the
    limits.

    Args:
        phi_start: angle before the motion, rad.
        peaks, ramps, cruises, resolution, tolerance: see :func:`phase_violations`.
        phi_goal: if given, the last target is set to it, rad; must be within 1e-6 rad of the computed one.

    Raises:
        InputError: no commands do this (all reasons are listed), or phi_goal is not where the phases lead.
    """
    phi = number_from("phi_start", phi_start)
    if violations := phase_violations(peaks, ramps, cruises, resolution=resolution, tolerance=tolerance):
        raise InputError("phases: no profile commands produce them: " + "; ".join(violations))
    w, d, c = _snapped(*_phase_arrays(peaks, ramps, cruises), tolerance)
    commands: list[RampCommand] = []
    w_a = 0.0
    for k, (w_k, d_k, c_k) in enumerate(zip(w, d, c, strict=False)):
        speed = abs(w_k) or abs(w_a) or _IDLE
        if d_k > 0:
            acceleration = abs(w_k - w_a) / d_k
        elif w_k == 0:
            acceleration = _IDLE
        else:
            acceleration = abs(w_k) / d[-1] if k == len(w) - 1 else commands[-1].acceleration
        phi += 0.5 * (w_a + w_k) * d_k + w_k * c_k
        commands.append(RampCommand(phi + 0.5 * w_k * abs(w_k) / acceleration, speed, acceleration))
        w_a = w_k
    if phi_goal is not None:
        last = commands[-1]
        if not abs(last.phi_e - number_from("phi_goal", phi_goal)) <= 1e-6:
            raise InputError(f"phi_goal: the phases lead to {last.phi_e!r} rad, not to {phi_goal!r}")
        commands[-1] = RampCommand(phi_goal, last.speed, last.acceleration)
    return tuple(commands)


def without_idle_ramps(
    peaks: np.ndarray, ramps: np.ndarray, cruises: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """These phases, see :func:`phase_violations`, where each without a change of speed joins the cruise
    before it.
    """
    ramps, cruises = ramps.copy(), cruises.copy()
    for k in range(1, len(peaks)):
        if peaks[k] == peaks[k - 1]:
            cruises[k - 1] += ramps[k]
            ramps[k] = 0.0
    return peaks, ramps, cruises


def _phase_arrays(
    peaks: ArrayLike, ramps: ArrayLike, cruises: ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    w = finite_array("peaks", peaks, (None,))
    if not len(w):
        raise InputError("peaks: at least one command is needed, got none")
    return w, finite_array("ramps", ramps, (len(w) + 1,)), finite_array("cruises", cruises, (len(w),))


def _snapped(
    w: np.ndarray, d: np.ndarray, c: np.ndarray, tolerance: float
) -> tuple[list[float], list[float], list[float]]:
    """Durations just below 0 as 0; no acceleration phase where its length and its change of speed are nearly
    0.
    """
    speeds = [0.0, *w.tolist()]
    ramps, cruises = np.maximum(d, 0.0).tolist(), np.maximum(c, 0.0).tolist()
    for k in range(len(w)):
        if ramps[k] <= tolerance and abs(speeds[k + 1] - speeds[k]) <= tolerance:
            speeds[k + 1], ramps[k] = speeds[k], 0.0
    return speeds[1:], ramps, cruises


def _margin(w_a: float, w_k: float, d_k: float, c_k: float) -> float:
    """Distance between the target of a command and where braking at once would lead, rad."""
    way = abs(w_k) * c_k
    if d_k == 0:
        return way
    acceleration = abs(w_k - w_a) / d_k
    if w_a * w_k <= 0:
        return way + w_k**2 / acceleration
    return way + max(w_k**2 - w_a**2, 0.0) / acceleration
