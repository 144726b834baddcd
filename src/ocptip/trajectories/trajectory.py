"""The motion of all joints of a robot over time: a piecewise polynomial that knows its switching times.

There is one class of trajectories, and several ways to make one: velocity profiles, points of a controller or
samples, a path with its timing, several trajectories one after the other. The data of each form, such as the
commands of profiles, is an attribute of the trajectory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, positive_number, whole_number
from ocptip.numerics.quadrature import gauss_legendre
from ocptip.trajectories.path import JointPath, PathTiming
from ocptip.trajectories.pieces import MERGE, Pieces, Side, following
from ocptip.trajectories.points import PEAK_TOLERANCE, Fit, Points
from ocptip.trajectories.ramps import JointRamps, RampCommand
from ocptip.trajectories.velocity_profiles import VelocityProfiles

INSIDE = 1.5 * MERGE
"""Distance from switching times at which their two sides are evaluated, s."""
_ROUNDED_TIMES = 1e-5  # share of peaks: times of points in whole ns, events within 0.1 us taken as one
_ROUNDED_STEPS = 1e-4  # share of the largest acceleration: smaller steps are rounding, or a solver's
_ROUNDED_JERKS = 1e-3  # share of the largest jerk between points whose times are in whole ns


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """A motion of n joints, from rest at t = 0 to rest. Angles in rad (sliding joints: m), times in s.

    Exactly one of profiles, points, timing and parts says what it is.

    Example::

        from ocptip import Trajectory
        from ocptip.trajectories.ramps import RampCommand

        motion = Trajectory.from_profiles([0.0], [[RampCommand(phi_e=1.0, speed=1.0, acceleration=2.0)]])
        print(motion, motion(0.5 * motion.end), motion([0.1, 0.2], order=1), motion.event_times)

    Attributes:
        profiles: commands to the drives, of which it is the trapezoidal velocity profiles or S-curves.
        points: points or samples between which it is interpolated.
        timing: its path, and when it is where on it.
        parts: several trajectories one after the other, each with its time from 0.
        pauses: s, standstill after each of `parts`; empty without these.
        fit: how it was fitted to samples, if it was.
        assumed: what the reader of a file had to assume, in words.
    """

    profiles: VelocityProfiles | None = None
    points: Points | None = None
    timing: PathTiming | None = None
    parts: tuple[Trajectory, ...] = ()
    pauses: tuple[float, ...] = (0.0,)
    fit: Fit | None = None
    assumed: tuple[str, ...] = ()

    @classmethod
    def from_profiles(
        cls, start: ArrayLike, commands: Sequence[Sequence[RampCommand]], rise_times: ArrayLike = ()
    ) -> Trajectory:
        """Return the trajectory of velocity profiles, see :meth:`VelocityProfiles.from_commands`."""
        return cls(profiles=VelocityProfiles.from_commands(start, commands, rise_times))

    @classmethod
    def ending_together(
        cls,
        start: ArrayLike,
        goal: ArrayLike,
        commands: Sequence[Sequence[RampCommand] | None],
        speed_limits: ArrayLike,
        acceleration_limits: ArrayLike,
    ) -> Trajectory:
        """Return profiles of which joints without commands end with the others.

        See :meth:`VelocityProfiles.ending_together`.
        """
        args = start, goal, commands, speed_limits, acceleration_limits
        return cls(profiles=VelocityProfiles.ending_together(*args))

    @classmethod
    def from_points(
        cls,
        times: np.ndarray,
        angles: np.ndarray,
        speeds: np.ndarray | None = None,
        accelerations: np.ndarray | None = None,
        period: float | None = None,
        before: np.ndarray | None = None,
        assumed: tuple[str, ...] = (),
    ) -> Trajectory:
        """Return the trajectory through points, see :class:`Points` for the curve between them."""
        return cls(points=Points(times, angles, speeds, accelerations, period, before), assumed=assumed)

    @classmethod
    def from_path(
        cls, path: JointPath, s: np.ndarray, x: np.ndarray, times: np.ndarray | None = None
    ) -> Trajectory:
        """Return the trajectory along a path, see :class:`PathTiming`."""
        return cls(timing=PathTiming(path, s, x, times))

    @classmethod
    def from_segments(cls, motions: Sequence[Trajectory], pauses: Sequence[float]) -> Trajectory:
        """Return trajectories of the same joints one after the other, each begins where the last one ended.

        Args:
            motions: in their order.
            pauses: s, standstill after each.

        Raises:
            InputError: there is no motion, or numbers of joints or pauses do not fit.
        """
        motions, pauses = tuple(motions), tuple(map(float, pauses))
        if not motions:
            raise InputError("motions: at least one is needed, got none")
        if len(pauses) != len(motions):
            raise InputError(f"pauses: expected {len(motions)}, got {len(pauses)}")
        for number, (motion, pause) in enumerate(zip(motions, pauses, strict=True), 1):
            positive_number(f"pauses[{number}]", pause, zero_allowed=True)
            if motion.n != motions[0].n:
                raise InputError(
                    f"motions[{number}]: has {motion.n} joints, the first one has {motions[0].n}"
                )
        assumed = tuple(dict.fromkeys(text for motion in motions for text in motion.assumed))
        return cls(parts=motions, pauses=pauses, assumed=assumed)

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """The polynomials, in the order of the joints; joints with the same ends of pieces are together."""
        if not self.parts:
            return self._source.pieces
        of_parts = [
            [part.joint(k) for part in motion.pieces for k in range(len(part.goal))] for motion in self.parts
        ]
        return tuple(following(parts, self.begins.tolist()) for parts in zip(*of_parts, strict=True))

    @property
    def n(self) -> int:
        """Number of joints."""
        return sum(len(part.goal) for part in self.pieces)

    @property
    def start(self) -> np.ndarray:
        """Angles before the motion, (n,), rad."""
        return np.concatenate([part.start for part in self.pieces])

    @property
    def goal(self) -> np.ndarray:
        """Angles after the motion, (n,), rad."""
        return np.concatenate([part.goal for part in self.pieces])

    @property
    def end(self) -> float:
        """When the last joint has come to rest, s."""
        if self.parts:
            return float(self.begins[-1]) + self.parts[-1].end + self.pauses[-1]
        return float(max(part.breaks[-1] for part in self.pieces))

    @property
    def segments(self) -> tuple[Trajectory, ...]:
        """The trajectories one after the other of which it consists; itself if it is a single one."""
        return self.parts or (self,)

    @cached_property
    def begins(self) -> np.ndarray:
        """When each segment begins, (m,), s."""
        lengths = [motion.end + pause for motion, pause in zip(self.parts, self.pauses, strict=False)]
        return np.concatenate([[0.0], np.cumsum(lengths)[:-1]])

    @property
    def jumps(self) -> np.ndarray:
        """How far each segment but the first starts from the end of the one before, (m - 1,), rad or m."""
        ends = zip(self.segments[:-1], self.segments[1:], strict=True)
        return np.array([np.max(np.abs(after.start - before.goal)) for before, after in ends])

    @property
    def joints(self) -> tuple[JointRamps, ...]:
        """Each joint's velocity profile; empty if it is not made of profiles."""
        return self.profiles.joints if self.profiles else ()

    @property
    def rise_times(self) -> tuple[float, ...]:
        """(n,), s, of accelerations of profiles; empty: these step, or it is not made of profiles."""
        return self.profiles.rise_times if self.profiles else ()

    @property
    def peak_rounding(self) -> float:
        """Share of the limits by which rounding may lift speeds and accelerations."""
        if self.fit is not None:
            return PEAK_TOLERANCE
        return _ROUNDED_TIMES if self.points is not None else 0.0

    @property
    def angle_ranges(self) -> np.ndarray:
        """Minimum and maximum angle of each joint during the motion, overshoot included, (n, 2), rad."""
        return np.concatenate([part.angle_ranges for part in self.pieces])

    @cached_property
    def speed_peaks(self) -> np.ndarray:
        """Maximum |speed| of each joint, (n,), rad/s."""
        return np.concatenate([part.peaks(1) for part in self.pieces])

    @cached_property
    def acceleration_peaks(self) -> np.ndarray:
        """Maximum |acceleration| of each joint, (n,), rad/s^2."""
        return np.concatenate([part.peaks(2) for part in self.pieces])

    @cached_property
    def jerk_peaks(self) -> np.ndarray:
        """Maximum |jerk| of each joint inside its pieces, (n,), rad/s^3."""
        return np.concatenate([part.peaks(3) for part in self.pieces])

    @property
    def jerk_source(self) -> str:
        """How `largest_jerks` are known where they are not exact, in words; empty: they are."""
        if self.parts:
            return next((part.jerk_source for part in self.parts if part.jerk_source), "")
        if self.fit is not None:
            return "at least, by differences of samples"
        estimated = self.points is not None and self.points.accelerations is None and self._steps.any()
        return "estimated by acceleration steps between points" if estimated else ""

    @cached_property
    def largest_jerks(self) -> np.ndarray:
        """Maximum |jerk| of each joint, (n,), rad/s^3; infinite where its acceleration steps.

        Points without accelerations are joined by curves whose accelerations step at the points. There a step
        counts as a change over half of both neighbouring intervals. Of a fit it is the minimum that any
        motion has whose positions are within the tolerance at the samples.
        """
        if self.parts:
            return np.max([part.largest_jerks for part in self.parts], axis=0)
        if self.fit is not None:
            return self.fit.jerk
        spread = np.where(self._steps, np.inf, 0.0)
        if self.jerk_source:
            rates = np.concatenate([part.step_rates(2) for part in self.pieces])
            spread = np.where(self._steps, rates, 0.0)
        return np.maximum(self.jerk_peaks, spread)

    @property
    def jerk_rounding(self) -> float:
        """Share of the limits by which rounding may lift `largest_jerks`."""
        return _ROUNDED_JERKS if self.points is not None else 0.0

    @cached_property
    def _steps(self) -> np.ndarray:
        """(n,) True for joints whose acceleration steps by more than rounding."""
        return self.acceleration_steps > _ROUNDED_STEPS * self.acceleration_peaks

    @property
    def acceleration_steps(self) -> np.ndarray:
        """Maximum step of each joint's acceleration, start and end included, (n,), rad/s^2."""
        return np.concatenate([part.steps(2) for part in self.pieces])

    @property
    def breaks(self) -> tuple[np.ndarray, ...]:
        """Per joint the ends of its pieces, (K + 1,), s."""
        return tuple(part.breaks for part in self.pieces for _ in part.goal)

    @property
    def coefficients(self) -> tuple[np.ndarray, ...]:
        """Per joint (D + 1, K), of the powers 0 ... D of the time since the begin of each of its pieces."""
        return tuple(column for part in self.pieces for column in np.moveaxis(part.coefficients, 2, 0))

    def __call__(self, times: ArrayLike, order: int = 0, *, side: Side = "right") -> np.ndarray:
        """Return the angles at N times (s), or their derivative of an order, (N, n); one time gives (n,).

        Args:
            times: when; before 0 and after the end all joints rest.
            order: 0: angles, rad; 1: speeds, rad/s; 2: accelerations, rad/s^2; 3: jerks ...
            side: at a switching time the value after it ("right") or before it ("left").

        Raises:
            InputError: a time is not finite, order is no whole number >= 0, or side is another word.
        """
        order = whole_number("order", order, 0)
        parts = [part.at(times, range(order, order + 1), side)[0] for part in self.pieces]
        return np.concatenate(parts, axis=-1)

    def states(self, times: ArrayLike, *, side: Side = "right") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return angles (rad), speeds (rad/s), accelerations (rad/s^2) at N times (s): three arrays (N, n).

        A single time gives (n,).

        Args:
            times: when; before 0 and after the end all joints rest.
            side: at a switching time the value after it ("right") or before it ("left").

        Raises:
            InputError: a time is not finite, or side is another word.
        """
        parts = zip(*(part.at(times, side=side) for part in self.pieces), strict=True)
        angles, speeds, accelerations = (np.concatenate(values, axis=-1) for values in parts)
        return angles, speeds, accelerations

    @cached_property
    def crossings(self) -> np.ndarray:
        """When any joint's speed changes sign, sorted, (K,), s (5.27)."""
        return np.sort(np.concatenate([part.crossings for part in self.pieces]))

    @cached_property
    def event_times(self) -> np.ndarray:
        """Switching times of all joints and all sign changes of their speeds, sorted, (S,), s (5.24), (5.26).

        From 0 to the end. Of those within 0.1 us of each other one stays, so that no interval is shorter. A
        robot that does not move has the single one at 0. Each segment has such times.
        """
        if self.parts:
            pairs = zip(self.begins, self.parts, strict=True)
            return np.unique(np.concatenate([begin + motion.event_times for begin, motion in pairs]))
        switching = np.unique(np.concatenate([part.switching_times for part in self.pieces]))
        return merged(switching, self.crossings, self.end)

    @property
    def intervals(self) -> np.ndarray:
        """Intervals between switching times, (S - 1, 2), s: within each, torque and power are smooth."""
        return np.column_stack([self.event_times[:-1], self.event_times[1:]])

    def quadrature(self, order: int = 4) -> tuple[np.ndarray, np.ndarray]:
        """Return Gauss-Legendre nodes (s) inside all intervals and their weights (s), (5.25); both (N,).

        `weights @ f(nodes)` is the integral over the motion, exact for polynomials up to degree
        2 order - 1 in each interval. N = (S - 1) order, sorted by time.

        Raises:
            InputError: order is not a whole number >= 1.
        """
        return gauss_legendre(self.intervals, order)

    def both_sides(self, spacing: float) -> np.ndarray:
        """Start, end, both sides of all switching times, instants between them at most `spacing` apart, (N,),
        s.
        """
        pieces = [self.event_times[[0, -1]]]
        for left, right in self.intervals:
            count = max(4, int(np.ceil((right - left) / spacing)) + 1)
            pieces.append(np.linspace(left + INSIDE, right - INSIDE, count))
        return np.unique(np.concatenate(pieces))

    def with_rise_times(self, rise_times: ArrayLike) -> Trajectory:
        """Return the same profiles with accelerations that rise within this time, s: one for all, or (n,).

        0 for trapezoidal velocity profiles.

        Raises:
            InputError: it is not made of profiles, or a rise time is below 0, or their number is wrong.
        """
        if self.profiles is None:
            raise InputError("rise_time: only velocity profiles have one, the motion is none")
        return replace(self, profiles=self.profiles.with_rise_times(rise_times))

    def time_scaled(self, factor: float) -> Trajectory:
        """Return the same path with all times, pauses too, multiplied by `factor` > 0 (below 1: faster)."""
        factor = positive_number("factor", factor)
        if self.parts:
            scaled = [motion.time_scaled(factor) for motion in self.parts]
            return Trajectory.from_segments(scaled, [factor * pause for pause in self.pauses])
        names = ("profiles", "points", "timing", "fit")
        made = {name: part.time_scaled(factor) for name in names if (part := getattr(self, name)) is not None}
        return replace(self, **made)

    def slowed(self, factor: float) -> Trajectory:
        """Return the motion that takes `factor` > 0 times as long; profiles keep their rise times."""
        if self.profiles is None:
            return self.time_scaled(factor)
        return replace(self, profiles=self.profiles.slowed(factor))

    def to_dict(self, units: Sequence[str] = ()) -> dict[str, Any]:
        """Return the parameters of profiles or of a timed path as data for plan.json, lossless.

        Args:
            units: of the joints, "rad" or "m"; where one is "m", values of that joint are in metres, and
                `units`, "deg" or "m" per joint, is added. Others: degrees.

        Raises:
            InputError: it is made of neither.
        """
        profiles = self.profiles or self.timing
        if profiles is None:
            raise InputError("motion: only profiles and timed paths have parameters that can be written")
        return profiles.to_dict(units)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Trajectory:
        """Return the motion written by :meth:`to_dict`; keys that it does not write are ignored.

        Raises:
            InputError: a key is missing or unknown, or a value cannot be used; names joint and command.
        """
        if isinstance(data, Mapping) and "path" in data:
            return cls(timing=PathTiming.from_dict(data))
        return cls(profiles=VelocityProfiles.from_dict(data))

    def __repr__(self) -> str:
        """The representation, number of joints, duration and segments."""
        names = ("profiles", "points", "timing", "parts")
        made = next((name for name in names if getattr(self, name)), "nothing")
        of = f"{len(self.parts)} segments" if self.parts else made
        way = np.max(np.abs(self.goal - self.start))
        return (
            f"<Trajectory of {of}: {self.n} joints, {self.end:.6g} s, up to {way:.4g} rad between its ends>"
        )

    @property
    def _source(self) -> VelocityProfiles | Points | PathTiming:
        """The data of a single motion."""
        made = self.profiles or self.points or self.timing
        if made is None:
            raise InputError("trajectory: expected profiles, points, a timing or parts, got none")
        return made


def merged(switching: np.ndarray, crossings: np.ndarray, end: float) -> np.ndarray:
    """Switching times (sorted) and sign changes from 0 to the end, no two within `MERGE`, sorted, s.

    Of switching times the first stays; a sign change next to a switching time is left out.
    """
    after = np.clip(np.searchsorted(switching, crossings), 1, len(switching) - 1)
    near = np.abs(switching[[after - 1, after]] - crossings).min(axis=0) if len(crossings) else crossings
    kept = [0.0]
    for t in np.unique(np.concatenate([switching, crossings[near > MERGE]])):
        if t - kept[-1] > MERGE and end - t > MERGE:
            kept.append(float(t))
    return np.array([*kept, end] if end > MERGE else kept)
