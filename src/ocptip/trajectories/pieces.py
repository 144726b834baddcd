"""Piecewise polynomials of time: the one form in which every trajectory is evaluated.

Each piece is given by its derivatives at its begin (position, speed, acceleration, jerk ...), which are its
Taylor coefficients: of order k divided by k! they are the coefficients of the powers of the time that has
passed since then. They are exact where a profile or an interpolation defines them. All other values follow
from them: states, extreme values, instants at which speeds change sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError

Side = Literal["left", "right"]

MERGE = 1e-7  # switching times nearer to each other than this are one, s: rounding of commands moves them
ENDS = 1e-6
"""s: nearer to start and end of a motion speeds do not change sign but for rounding."""
STANDSTILL = 1e-9  # rad/s or m/s: a joint that never gets faster rests, signs of its speed are rounding
_CONTINUOUS = 1e-12  # of the largest value: smaller steps between two pieces are rounding
_NEGLIGIBLE = 1e-14  # of the largest coefficient: smaller ones of the highest powers are rounding
_REAL = 1e-7  # imaginary parts of zeros, of the length of a piece, that are rounding of double zeros


@dataclass(frozen=True, eq=False)
class Pieces:
    """K polynomials of time, one after the other, of m joints whose pieces have the same ends.

    The joints rest before the first and after the last piece. A joint that never moves may have no piece.

    Attributes:
        breaks: (K + 1,), s, increasing.
        derivatives: (D + 1, K, m), of the orders 0 ... D at the begins of the pieces, rad or m and s.
        goal: (m,), rad or m, positions after the last piece.
        switching: (K + 1,), the breaks that are switching times of the motion; None: all.
    """

    breaks: np.ndarray
    derivatives: np.ndarray
    goal: np.ndarray
    switching: np.ndarray | None = None

    @property
    def start(self) -> np.ndarray:
        """Positions before the first piece, (m,), rad or m."""
        return self.derivatives[0, 0] if len(self.breaks) > 1 else self.goal

    @property
    def switching_times(self) -> np.ndarray:
        """Breaks at which the motion may change at once, s."""
        return self.breaks if self.switching is None else self.breaks[self.switching]

    @property
    def coefficients(self) -> np.ndarray:
        """(D + 1, K, m), of the powers 0 ... D of the time since the begin of each piece."""
        orders = [factorial(k) for k in range(len(self.derivatives))]
        return self.derivatives / np.array(orders, dtype=float)[:, None, None]

    def joint(self, number: int) -> Pieces:
        """Those of a single joint, counted from 0."""
        return replace(self, derivatives=self.derivatives[:, :, [number]], goal=self.goal[[number]])

    def steps(self, order: int) -> np.ndarray:
        """Maximum step of each joint's derivative of this order at breaks, both ends included, (m,)."""
        sides = (self.at(self.breaks, range(order, order + 1), side)[0] for side in ("left", "right"))
        return np.max(np.abs(np.subtract(*sides)), axis=0)

    def step_rates(self, order: int) -> np.ndarray:
        """Maximum step of each joint's derivative per mean length of the pieces beside it, (m,)."""
        left, right = (self.at(self.breaks, range(order, order + 1), side)[0] for side in ("left", "right"))
        lengths = np.diff(self.breaks)
        beside = 0.5 * (np.append(lengths[:1], lengths) + np.append(lengths, lengths[-1:]))
        return np.max(np.abs(right - left) / beside[:, None], axis=0, initial=0.0)

    def at(self, times: ArrayLike, orders: range = range(3), side: Side = "right") -> tuple[np.ndarray, ...]:
        """Derivatives of these orders at times, each (..., m).

        Args:
            times: any shape, s.
            orders: 0 is the position.
            side: at a break that of the piece after it ("right") or before it ("left").

        Raises:
            InputError: a time is not finite, or side is another word.
        """
        t = checked_times(times, side)
        piece = np.searchsorted(self.breaks, t, side=side)  # 0: rest before, K + 1: rest after
        begins, rows = self._padded
        elapsed, chosen = (t - begins[piece])[..., None], rows[orders.start :, piece]
        return tuple(taylor(chosen[order - orders.start :], elapsed) for order in orders)

    @cached_property
    def angle_ranges(self) -> np.ndarray:
        """Minimum and maximum position of each joint, overshoot included, (m, 2), rad or m."""
        return np.array([(values.min(), values.max()) for values in self._extreme_values(0)])

    def peaks(self, order: int) -> np.ndarray:
        """Maximum absolute value of each joint's derivative of this order, (m,)."""
        return np.array([np.max(np.abs(values)) for values in self._extreme_values(order)])

    @cached_property
    def crossings(self) -> np.ndarray:
        """When any joint's speed changes sign, sorted, s; with a rest between, when that begins."""
        count, piece, joint, elapsed = len(self.breaks) - 1, *self._zeros(1)
        if not count:
            return np.empty(0)
        times = self.breaks[piece] + elapsed
        inside = (times > self.breaks[0] + ENDS) & (times < self.breaks[-1] - ENDS)
        results = [np.empty(0)]
        for j in np.flatnonzero(self.peaks(1) > STANDSTILL):
            candidates = np.unique(np.concatenate([self.breaks, times[inside & (joint == j)]]))
            middles = 0.5 * (candidates[1:] + candidates[:-1])
            owner = np.searchsorted(self.breaks, middles, side="right") - 1
            speeds = taylor(self.derivatives[1:, owner, j], middles - self.breaks[owner])
            signs = np.sign(speeds)
            moving = np.flatnonzero(signs)
            turned = signs[moving[1:]] != signs[moving[:-1]]
            results.append(candidates[1 + moving[:-1][turned]])
        return np.sort(np.concatenate(results))

    @cached_property
    def _padded(self) -> tuple[np.ndarray, np.ndarray]:
        """Begins (K + 2,) and derivatives (D + 1, K + 2, m) with rest before and after the pieces."""
        rest = np.zeros((2, len(self.derivatives), 1, len(self.goal)))
        rest[0, 0, 0], rest[1, 0, 0] = self.start, self.goal
        rows = np.concatenate([rest[0], self.derivatives, rest[1]], axis=1)
        return np.concatenate([self.breaks[:1], self.breaks]), rows

    def _extreme_values(self, order: int) -> list[np.ndarray]:
        """Per joint the values of a derivative among which its minimum and its maximum are."""
        rest = np.zeros((1, len(self.goal))) if order else self.goal[None]
        if order >= len(self.derivatives):
            return list(rest.T)
        begins = np.concatenate([self.derivatives[order], rest])
        ends = taylor(self.derivatives[order:], np.diff(self.breaks)[:, None])
        size = np.max(np.abs(begins), axis=0, initial=0.0)
        steps = np.abs(ends - begins[1:]) > _CONTINUOUS * size  # else the end is the next begin
        piece, joint, elapsed = self._zeros(order + 1)
        inner = taylor(self.derivatives[order:, piece, joint], elapsed)
        return [
            np.concatenate([begins[:, j], ends[steps[:, j], j], inner[joint == j]])
            for j in range(len(self.goal))
        ]

    def _zeros(self, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Inside pieces, where a derivative vanishes: piece, joint, time since the begin of the piece, s."""
        rows = self.derivatives[order:]
        if len(rows) < 2 or not rows.shape[1]:
            nothing = np.empty(0, dtype=int)
            return nothing, nothing, np.empty(0)
        count = rows.shape[2]
        length = np.repeat(np.diff(self.breaks), count)
        flat = rows.reshape(len(rows), -1)
        number, elapsed = _low_zeros(flat) if len(flat) <= 3 else _high_zeros(flat, length)
        kept = (elapsed >= 0) & (elapsed <= length[number])
        number, elapsed = number[kept], elapsed[kept]
        return number // count, number % count, elapsed


def following(parts: Sequence[Pieces], begins: Sequence[float]) -> Pieces:
    """Pieces of the same joints one after the other, with rest between them.

    Args:
        parts: each with its time from 0.
        begins: s, of each.
    """
    orders = max(len(part.derivatives) for part in parts)
    breaks, rows = [np.array([begins[0]])], []
    for part, begin, until in zip(parts, begins, [*begins[1:], -np.inf], strict=True):
        missing = np.zeros((orders - len(part.derivatives), *part.derivatives.shape[1:]))
        rows.append(np.concatenate([part.derivatives, missing]))
        breaks.append(begin + part.breaks[1:])
        if until > begin + part.breaks[-1]:
            rest = np.zeros((orders, 1, len(part.goal)))
            rest[0, 0] = part.goal
            rows.append(rest)
            breaks.append(np.array([until]))
    return Pieces(np.concatenate(breaks), np.concatenate(rows, axis=1), parts[-1].goal)


def taylor(rows: np.ndarray, elapsed: np.ndarray) -> np.ndarray:
    """Value some time after the begin of pieces, from their derivatives (D + 1, ...) there."""
    if not len(rows):
        return np.zeros(rows.shape[1:])
    value = rows[-1]
    for k in range(len(rows) - 2, -1, -1):
        value = rows[k] + elapsed * value / (k + 1)
    return value


def checked_times(times: ArrayLike, side: str) -> np.ndarray:
    """Return times (any shape, s) as floats.

    Raises:
        InputError: a time is not finite, or side is neither "left" nor "right".
    """
    t = np.asarray(times, dtype=float)
    if not np.all(np.isfinite(t)):
        raise InputError("times: contains NaN or infinity")
    if side not in ("left", "right"):
        raise InputError(f'side: must be "left" or "right", got {side!r}')
    return t


def _low_zeros(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Zeros of v + a t + j t^2 / 2, rows (2 or 3, N): whose they are, and t; those that are not real are NaN.

    The form of the solution loses no digits where one zero is much nearer than the other.
    """
    v, a, j = rows if len(rows) == 3 else (*rows, np.zeros_like(rows[0]))
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -(a + np.copysign(np.sqrt(a * a - 2 * j * v), a))
        zeros = np.concatenate([q / j, 2 * v / q])
    number = np.tile(np.arange(rows.shape[1]), 2)
    finite = np.isfinite(zeros)
    return number[finite], zeros[finite]


def _high_zeros(rows: np.ndarray, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Zeros of polynomials of higher degree, rows (D + 1, N): eigenvalues of companion matrices."""
    powers = np.arange(len(rows))
    orders = np.array([factorial(k) for k in powers], dtype=float)
    c = rows / orders[:, None] * length ** powers[:, None]  # of the share of a piece: sizes that compare
    large = np.abs(c) > _NEGLIGIBLE * np.max(np.abs(c), axis=0)
    degree = np.where(large.any(axis=0), len(rows) - 1 - np.argmax(large[::-1], axis=0), 0)
    numbers, shares = [], []
    for d in np.unique(degree[degree > 0]):
        indices = np.flatnonzero(degree == d)
        companion = np.zeros((len(indices), d, d))
        companion[:, np.arange(1, d), np.arange(d - 1)] = 1.0
        companion[:, :, -1] = -(c[:d, indices] / c[d, indices]).T
        values = np.linalg.eigvals(companion)
        real = np.abs(values.imag) <= _REAL
        numbers.append(np.repeat(indices, np.sum(real, axis=1)))
        shares.append(np.clip(values.real[real], -1.0, 2.0))
    if not numbers:
        return np.empty(0, dtype=int), np.empty(0)
    number, share = np.concatenate(numbers), np.concatenate(shares)
    return number, share * length[number]
