"""A path of joints: which postures follow each other, not when.

Polynomials in s, from s = 0 at the start to s = 1 at the goal. Positions are continuous everywhere. Where the
direction turns at once there is a corner, at which a motion has to stop; elsewhere the first derivative is
continuous, and the second one may have steps at breakpoints only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.frozen import settle

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

GAP = 1e-9  # rad or m: jumps of positions at breakpoints that are rounding
CORNER = 1e-6
"""A step of the first derivative by more than this share of itself is a corner."""

BEND = 1e-6
"""A step of the second derivative by more than this share of its maximum is a step of the curvature."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """A path of n joints in K polynomial pieces.

    Attributes:
        breakpoints: (K + 1,), increasing from 0 to 1: ends of the pieces, where the second derivative may
            have a step.
        coefficients: (D + 1, K, n), rad or m, of the powers D, ..., 0 of s - breakpoints[k] in piece k.
    """

    breakpoints: np.ndarray
    coefficients: np.ndarray

    def __post_init__(self) -> None:
        """Raise InputError if shapes do not fit, positions have a gap, or a piece stands still."""
        ends = finite_array("breakpoints", self.breakpoints, (None,))
        if len(ends) < 2 or ends[0] != 0 or ends[-1] != 1 or np.any(np.diff(ends) <= 0):
            raise InputError("breakpoints: expected at least two, increasing from 0 to 1")
        given = finite_array("coefficients", self.coefficients, (None, len(ends) - 1, None))
        if len(given) < 2 or not given.shape[2]:
            raise InputError(f"coefficients: expected (D + 1, K, n), D and n >= 1, got {given.shape}")
        settle(self, breakpoints=ends, coefficients=given)
        gaps = np.max(np.abs(self._at_ends(0)[1][:-1] - self._at_ends(0)[0][1:]), axis=1, initial=0.0)
        if np.any(gaps > GAP * (1 + np.abs(given).max())):
            k = int(np.argmax(gaps))
            raise InputError(f"path: has a gap of {gaps[k]:.3g} at s = {ends[k + 1]:.6g}")
        still = np.flatnonzero(~np.any(given[:-1], axis=(0, 2)))
        if still.size:
            k = int(still[0])
            raise InputError(f"path: does not move between s = {ends[k]:.6g} and {ends[k + 1]:.6g}")

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.coefficients.shape[2]

    @property
    def start(self) -> np.ndarray:
        """Positions at s = 0, (n,), rad or m."""
        return self.coefficients[-1, 0]

    @property
    def goal(self) -> np.ndarray:
        """Positions at s = 1, (n,), rad or m."""
        return self._at_ends(0)[1][-1]

    def at(
        self, s: ArrayLike, *, side: Literal["left", "right"] = "right"
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return positions q (rad or m), dq/ds and d2q/ds2 at N places: three arrays (N, n).

        Args:
            s: (N,), in [0, 1]; a single one gives (n,).
            side: "right": at a breakpoint the derivatives after it; "left": those before it.

        Raises:
            InputError: a place is not in [0, 1].
        """
        places = np.asarray(s, dtype=float)
        if not np.all((places >= 0) & (places <= 1)):
            raise InputError("s: must be in [0, 1]")
        piece = np.clip(np.searchsorted(self.breakpoints, places, side=side) - 1, 0, self.pieces - 1)
        beyond = (places - self.breakpoints[piece])[..., None]
        own = self.coefficients[:, piece]
        return derivatives(own, beyond, 0), derivatives(own, beyond, 1), derivatives(own, beyond, 2)

    @property
    def pieces(self) -> int:
        """Number of pieces K."""
        return len(self.breakpoints) - 1

    @cached_property
    def corners(self) -> np.ndarray:
        """Breakpoints, counted from 0, at which the direction turns at once; a motion has to stop there."""
        begins, ends = self._at_ends(1)
        size = np.maximum(np.linalg.norm(begins[1:], axis=1), np.linalg.norm(ends[:-1], axis=1))
        return 1 + np.flatnonzero(np.linalg.norm(begins[1:] - ends[:-1], axis=1) > CORNER * size)

    @cached_property
    def bends(self) -> np.ndarray:
        """Breakpoints, counted from 0, at which the curvature has a step and a motion need not stop.

        No motion that passes them keeps a jerk limit.
        """
        begins, ends = self._at_ends(2)
        steps = np.max(np.abs(begins[1:] - ends[:-1]), axis=1, initial=0.0)
        size = np.max(np.abs([begins, ends]))
        return np.setdiff1d(1 + np.flatnonzero(steps > BEND * size), self.corners)

    @cached_property
    def curve(self) -> PPoly:
        """The path as SciPy has it."""
        from scipy.interpolate import PPoly  # loads for 0.1 s, and most plans have no path

        return PPoly(self.coefficients, self.breakpoints)

    @cached_property
    def ranges(self) -> np.ndarray:
        """Minimum and maximum position of each joint, exact, (n, 2), rad or m."""
        found = []
        for joint, turns in enumerate(self.curve.derivative().roots(discontinuity=False, extrapolate=False)):
            places = np.concatenate([self.breakpoints, np.clip(turns[np.isfinite(turns)], 0, 1)])
            values = self.at(places)[0][:, joint]
            found.append((values.min(), values.max()))
        return np.array(found)

    def _at_ends(self, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of that order at begin and end of every piece, (K, n) each."""
        widths = np.diff(self.breakpoints)[:, None]
        begins, ends = (derivatives(self.coefficients, at, order) for at in (0 * widths, widths))
        return begins, ends


def derivatives(coefficients: np.ndarray, places: np.ndarray, order: int) -> np.ndarray:
    """Derivatives (N, n) of N polynomials (D + 1, N, n) at N places (N, 1), one for each."""
    for _ in range(order):
        powers = np.arange(len(coefficients) - 1, 0, -1).reshape(-1, *[1] * (coefficients.ndim - 1))
        coefficients = coefficients[:-1] * powers
    result = np.zeros(coefficients.shape[1:])
    for row in coefficients:
        result = row + places * result
    return result
