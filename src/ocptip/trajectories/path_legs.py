"""Smooth pieces of paths by their length: of lines and blends, of trapezoidal velocity profiles exactly,
fitted to samples.

Fitted is the quintic spline with as few knots as a tolerance allows: samples are not differentiated, so
second derivatives of the piece are those of a curve, not of rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial
from typing import TYPE_CHECKING

import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError
from ocptip.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

LEAST = 1e-9  # rad or m: points that are nearer to each other are the same
_DEGREE = 5
_MET = 1e-5  # s: events of ramps that are nearer to each other are one
_AT_REST = 1e-5  # s: events nearer to begin or end are there; a joint goes less than 1e-9 rad in between
_TURNS = 1e-5  # of the greatest speed: where all joints are slower, the way turns back
_SAME = 1e-7  # of the length: samples that are nearer to each other are one
_FEWEST = 12  # twice as many samples as a piece has at least
_NEARLY = 0.3  # of the tolerance: pieces that are farther off are divided, if any is too far off
_FIRST = 4  # pieces to begin with
_SMALL = 0.05  # of the greatest acceleration: that of a joint counts as at least so much


@dataclass(frozen=True, eq=False)
class Leg:
    """A smooth piece of a path by its length.

    Attributes:
        curve: of the length, (n,).
        lengths: (M,): where the samples are.
        samples: (M, n).
        numbers: (M,): which of the samples that were given these are.
    """

    curve: PPoly
    lengths: np.ndarray
    samples: np.ndarray
    numbers: np.ndarray

    @classmethod
    def of_rows(
        cls,
        rows: list[np.ndarray],
        knots: list[float],
        lengths: np.ndarray,
        points: np.ndarray,
        section: slice,
    ) -> Leg:
        """Leg of polynomials between knots."""
        kept = np.append(np.diff(knots) > LEAST * knots[-1], True)  # blends may leave no line between them
        curve = scipy.interpolate.PPoly(np.stack(rows, axis=1)[:, kept[:-1]], np.array(knots)[kept])
        return cls(curve, lengths[section], points[section], np.arange(len(points))[section])

    @classmethod
    def of_ramps(cls, motion: Trajectory, begin: float, end: float) -> Leg | None:
        """The exact path of trapezoidal velocity profiles by their time; None for S-curves, and where they
        turn back.

        Between its first two switching times, and its last two, it is a straight line: there the parameter is
        half the square of the time from rest.
        """
        if any(motion.rise_times):
            return None
        inner = motion.event_times
        inner = inner[(inner > begin + _AT_REST) & (inner < end - _AT_REST)]
        if not len(inner):
            return None
        times = np.concatenate([[begin], inner[np.append(True, np.diff(inner) > _MET)], [end]])
        q, v, _ = motion.states(times)
        if np.any(np.max(np.abs(v[1:-1]), axis=1) < _TURNS * np.max(np.abs(v))):
            return None
        v[0], v[-1], widths = v[1], v[-2], np.diff(times)
        widths[[0, -1]] /= 2
        w, first, last = widths[:, None], v[:-1], v[1:]
        pace = np.diff(q, axis=0) / w
        rows = [(first + last - 2 * pace) / w**2, (3 * pace - 2 * first - last) / w, first, q[:-1]]
        knots = np.append(0.0, np.cumsum(widths))
        return cls(scipy.interpolate.PPoly(np.stack(rows), knots), knots, q, np.arange(len(q)))

    @classmethod
    def fitted(
        cls, samples: np.ndarray, tolerance: np.ndarray, breaks: Sequence[int] | np.ndarray = ()
    ) -> Leg:
        """The spline with few knots that passes samples within a tolerance, exactly at both ends.

        Args:
            samples: (M, n), close to each other.
            tolerance: (n,).
            breaks: numbers of samples at which the curvature may have a step.

        Raises:
            InputError: the samples have corners that no smooth curve passes within the tolerance.
        """
        lengths = polygon_lengths(samples)
        kept = np.append(np.diff(lengths) > _SAME * lengths[-1], True)
        kept[0], kept[-2] = (
            True,
            len(samples) == 2 or (kept[-2] and lengths[-1] - lengths[-2] > _SAME * lengths[-1]),
        )
        length, values = lengths[kept], samples[kept]
        places = np.clip(np.searchsorted(np.flatnonzero(kept), breaks), 0, len(length) - 1)
        jumps = length[_apart(places.tolist(), len(length))]
        knots = _supported(length, np.union1d(np.linspace(0, length[-1], _FIRST + 1)[1:-1], jumps), jumps)
        while True:
            curve = _least_squares(length, values, knots, jumps)
            off = np.max(np.abs(curve(length) - values) / tolerance, axis=1)
            if off.max() <= 1:
                return cls(curve, length, values, np.flatnonzero(kept))
            owner = np.searchsorted(knots, length, side="right")
            bad = np.unique(owner[off > _NEARLY])  # neighbours pull at each other
            middles = [float(np.median(length[owner == k])) for k in bad]
            more = _supported(length, np.union1d(knots, middles), jumps)
            if len(more) <= len(knots):
                break
            knots = more
        share = length[int(np.argmax(off))] / length[-1]
        miss = np.max(np.abs(curve(length) - values))
        raise InputError(
            f"path: no smooth curve keeps within {tolerance.min():.2g} (rad or m) of it: at "
            f"{100 * share:.0f} % of its length it is {miss:.2g} off; is there a corner? Say by how much the "
            "path may be off (--path-tolerance)"
        )

    def slower(self, times: np.ndarray, speeds: np.ndarray, accelerations: np.ndarray) -> float:
        """Minimum share of the time by which it is slower than a motion, within the same accelerations.

        At the speed of the motion they are q' u + q'' (ds/dt)^2 with the nearest ds/dt and u. Where they are
        f > 1 times the maximum of the motion, the path has to be passed sqrt(f) times slower.

        Args:
            times: (M,), s, of all samples that were given; so are the others.
            speeds: (M, n), rad/s or m/s.
            accelerations: (M, n), rad/s^2 or m/s^2.
        """
        most = np.max(np.abs(accelerations), axis=0)
        most = np.maximum(most, max(_SMALL * most.max(), 1e-300))
        t, v, a = (part[self.numbers] for part in (times, speeds, accelerations))
        way, bend = self.curve(self.lengths, nu=1), self.curve(self.lengths, nu=2)
        square = np.sum(way**2, axis=1)
        across = bend * (np.sum(way * v, axis=1) / square)[:, None] ** 2
        slowed = way * (np.sum(way * (a - across), axis=1) / square)[:, None] + across
        factors = np.sqrt(np.max(np.abs(slowed) / most, axis=1))
        return float(np.trapezoid(np.maximum(factors, 1.0) - 1.0, t) / (t[-1] - t[0]))


def _apart(places: Sequence[int], count: int) -> list[int]:
    """Those of sorted numbers of samples that have enough others between them and before both ends."""
    kept = [0]
    for place in places:
        if place - kept[-1] >= 2 * _FEWEST and count - place > 2 * _FEWEST:
            kept.append(place)
    return kept[1:]


def _supported(places: np.ndarray, knots: np.ndarray, jumps: np.ndarray) -> np.ndarray:
    """Knots (k,) with enough samples between them; those at curvature steps stay."""
    kept: list[float] = []
    fixed = np.concatenate([[0.0], jumps, places[-1:]])
    for knot in knots:
        last = kept[-1] if kept else 0.0
        after = fixed[np.searchsorted(fixed, knot, side="right")]
        inside = min(
            np.count_nonzero((places > low) & (places <= high)) for low, high in ((last, knot), (knot, after))
        )
        if inside >= _FEWEST // 2 or knot in jumps:
            kept.append(float(knot))
    return np.array(kept)


def _least_squares(places: np.ndarray, values: np.ndarray, knots: np.ndarray, jumps: np.ndarray) -> PPoly:
    """The quintic spline nearest to values (M, n), exact at both ends; at curvature steps its slope is
    continuous.
    """
    inner = np.sort(np.concatenate([knots, np.repeat(jumps, _DEGREE - 2)]))
    edge = np.full(_DEGREE + 1, places[-1])
    t = np.concatenate([np.zeros(_DEGREE + 1), inner, edge])
    design = scipy.interpolate.BSpline.design_matrix(places, t, _DEGREE).tocsr()
    count = len(t) - _DEGREE - 1
    weights = np.gradient(places)
    coefficients = np.zeros((count, values.shape[1]))
    coefficients[0], coefficients[-1] = values[0], values[-1]
    left = values - design @ coefficients
    free = design[:, 1:-1]
    normal = (free.T @ free.multiply(weights[:, None])).toarray()
    bands = np.zeros((_DEGREE + 1, count - 2))
    for k in range(_DEGREE + 1):
        bands[_DEGREE - k, k:] = np.diagonal(normal, k)
    coefficients[1:-1] = scipy.linalg.solveh_banded(bands, free.T @ (weights[:, None] * left))
    spline, ends = scipy.interpolate.BSpline(t, coefficients, _DEGREE), np.unique(t)
    rows = [spline(ends[:-1], nu=k) / factorial(k) for k in range(_DEGREE, -1, -1)]
    return scipy.interpolate.PPoly(np.stack(rows), ends)


def polygon_lengths(points: np.ndarray) -> np.ndarray:
    """Length of the polygon up to each point, (N,)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
