"""S-curves of one joint: velocity ramps whose accelerations take a time to rise and fall (are trapezoids).

The angle is the mean of the ramp motion's over the last `rise_time` tau seconds, and so are speed and
acceleration. Where the ramps' acceleration jumps at t, that of the S-curve changes linearly until t + tau:
all phases are cubics, every event is two. Targets stay, speeds and accelerations stay within those of the
ramps, the jerk within the greatest change of the acceleration over tau, at most 2 a / tau; the motion takes
tau longer. This is what drives make of ramps with a moving average of their set points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import positive_number
from ocptip.trajectories.ramps import JointRamps, RampCommand, checked_times

ENDS = 1e-6
"""s: nearer to start and end of a joint's motion its speed does not change sign but for rounding."""


@dataclass(frozen=True, eq=False)
class JointSCurve:
    """The motion of one joint: its ramps with accelerations that take `rise_time` to change.

    The joint rests before t = 0 and after the end. B breaks: each boundary of phases of the ramps, twice.

    Attributes:
        ramps: the velocity ramps.
        rise_time: tau > 0, s.
    """

    ramps: JointRamps
    rise_time: float

    def __post_init__(self) -> None:
        """Raise InputError if the rise time is not > 0."""
        positive_number("rise_time", self.rise_time)

    @property
    def commands(self) -> tuple[RampCommand, ...]:
        """The commands."""
        return self.ramps.commands

    @property
    def phi_start(self) -> float:
        """Angle before the motion, rad."""
        return self.ramps.phi_start

    @property
    def phi_end(self) -> float:
        """Angle after the motion, rad."""
        return self.ramps.phi_end

    @property
    def end(self) -> float:
        """When the joint has come to rest, s; 0 if it does not move."""
        return float(self.times[-1])

    @cached_property
    def times(self) -> np.ndarray:
        """The breaks, (B,), s, from 0, increasing; a joint that does not move has but the break 0."""
        edges = self.ramps.times
        if self.ramps.end == 0:
            return edges[:1]
        return np.unique(np.concatenate([edges, edges + self.rise_time]))

    @cached_property
    def crossings(self) -> np.ndarray:
        """When the speed changes sign, (K,), s, increasing; with a rest between, when that begins."""
        _, _, v, a, j = self._pieces
        lengths = np.append(np.diff(self.times), 0.0)
        found = []
        for t, length, *piece in zip(self.times, lengths, v[1:], a[1:], j[1:], strict=True):
            roots = _roots(*piece)
            found += [t + r for r in roots if 0 <= r <= length and ENDS < t + r < self.end - ENDS]
        candidates = np.unique([*self.times, *found])
        signs = np.sign(self.states(0.5 * (candidates[1:] + candidates[:-1]))[1])
        moving = np.flatnonzero(signs)
        turned = signs[moving[1:]] != signs[moving[:-1]]
        return candidates[1 + moving[:-1][turned]]

    @cached_property
    def angle_range(self) -> tuple[float, float]:
        """Least and greatest angle of the motion, rad, exact: overshoot at reversals included."""
        angles = self.states(np.concatenate([self.times, self.crossings]))[0]
        return float(angles.min()), float(angles.max())

    @cached_property
    def speed_peak(self) -> float:
        """Greatest |speed|, rad/s, exact."""
        _, _, _, a, j = self._pieces
        turns = np.divide(-a, j, out=np.zeros_like(a), where=j != 0)[1:-1]
        turns = self.times[:-1] + np.clip(turns, 0, np.diff(self.times))
        return float(np.max(np.abs(self.states(np.concatenate([self.times, turns]))[1])))

    @property
    def acceleration_peak(self) -> float:
        """Greatest |acceleration|, rad/s^2, exact: at a break."""
        return float(np.max(np.abs(self.states(self.times)[2])))

    def states(
        self, times: ArrayLike, *, side: Literal["left", "right"] = "right"
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return angle (rad), speed (rad/s) and acceleration (rad/s^2) at times (any shape, s).

        Args:
            times: when; before 0 and after the end the joint rests.
            side: of no effect: accelerations do not jump.

        Raises:
            InputError: a time is not finite, or side is another word than left and right.
        """
        t = checked_times(times, side)
        piece = np.searchsorted(self.times, t, side=side)  # 0: rest before, 1 .. B - 1: moving, B: rest
        phi, w, a, j = (values[piece] for values in self._pieces[1:])
        s = t - self._pieces[0][piece]
        return phi + s * (w + s * (a / 2 + s * j / 6)), w + s * (a + s * j / 2), a + s * j

    @cached_property
    def _pieces(self) -> tuple[np.ndarray, ...]:
        """Start times, angles, speeds, accelerations, jerks: rest, pieces, rest; (B + 1,) each."""
        t, tau, ramps = self.times, self.rise_time, self.ramps
        now, before = ramps.states(t), ramps.states(t - tau)
        phi = (_integral(ramps, t) - _integral(ramps, t - tau)) / tau
        w, a = (now[0] - before[0]) / tau, (now[1] - before[1]) / tau
        middles = 0.5 * (t[1:] + t[:-1])
        jerks = (ramps.states(middles)[2] - ramps.states(middles - tau)[2]) / tau
        phi[0], phi[-1] = self.phi_start, self.phi_end
        w[[0, -1]] = a[[0, -1]] = 0.0
        first = (values[:1] for values in (t, phi, w, a))
        padded = [np.concatenate([f, v]) for f, v in zip(first, (t, phi, w, a), strict=True)]
        return *padded, np.concatenate([[0.0], jerks, [0.0]])


def _integral(ramps: JointRamps, times: np.ndarray) -> np.ndarray:
    """Of the angle from t = 0 to each time, rad s; the joint rests before and after."""
    lengths, angles, speeds = ramps.durations, ramps.angles[:-1], ramps.speeds[:-1]
    pieces = lengths * (angles + lengths * (speeds / 2 + lengths * ramps.accelerations / 6))
    at_edges = np.concatenate([[0.0], np.cumsum(pieces)])
    piece = np.clip(np.searchsorted(ramps.times, times, side="right") - 1, 0, len(lengths) - 1)
    t = np.clip(times, 0, ramps.end) - ramps.times[piece]
    inside = angles[piece] + t * (speeds[piece] / 2 + t * ramps.accelerations[piece] / 6)
    rest = np.minimum(times, 0) * ramps.phi_start + np.maximum(times - ramps.end, 0) * ramps.phi_end
    return at_edges[piece] + t * inside + rest


def _roots(v: float, a: float, j: float) -> list[float]:
    """Real zeros of v + a t + j t^2 / 2, s."""
    if j == 0:
        return [-v / a] if a != 0 else []
    under = a * a - 2 * j * v
    if under < 0:
        return []
    q = -(a + np.copysign(np.sqrt(under), a))
    return [q / j, *([2 * v / q] if q != 0 else [])]
