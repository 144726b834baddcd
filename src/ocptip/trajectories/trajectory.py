"""The motion of all joints of a robot over time: a piecewise polynomial that knows its switching times."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import whole_number
from ocptip.numerics.quadrature import gauss_legendre
from ocptip.trajectories.pieces import Pieces, Side

MERGE = 1e-7  # switching times nearer to each other than this are one, s: rounding of commands moves them
INSIDE = 1.5 * MERGE
"""Distance from switching times at which their two sides are evaluated, s."""


class Trajectory:
    """A motion of n joints, from rest at t = 0 to rest. Angles in rad (sliding joints: m), times in s.

    Attributes:
        peak_rounding: share of the limits by which rounding may lift speeds and accelerations.
        assumed: what the reader of a file had to assume, in words.
    """

    peak_rounding = 0.0
    assumed: tuple[str, ...] = ()

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """The polynomials, in the order of the joints; joints with the same ends of pieces are together."""
        raise NotImplementedError

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
        return float(max(part.breaks[-1] for part in self.pieces))

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
        robot that does not move has the single one at 0.
        """
        switching = np.unique(np.concatenate([part.switching_times for part in self.pieces]))
        return merged(switching, self.crossings, self.end)

    @property
    def intervals(self) -> np.ndarray:
        """Intervals between events, (S - 1, 2), s: within each, torque and power are smooth."""
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
        """Start, end, both sides of all events, instants between them at most `spacing` apart, (N,), s."""
        pieces = [self.event_times[[0, -1]]]
        for left, right in self.intervals:
            count = max(4, int(np.ceil((right - left) / spacing)) + 1)
            pieces.append(np.linspace(left + INSIDE, right - INSIDE, count))
        return np.unique(np.concatenate(pieces))

    def __repr__(self) -> str:
        """What a person wants to know first."""
        way = np.max(np.abs(self.goal - self.start))
        return (
            f"<Trajectory of {self.n} joints, {self.end:.6g} s, up to {way:.4g} rad from start to goal, "
            f"{len(self.event_times)} events>"
        )


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
