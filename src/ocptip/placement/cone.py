"""Directions whose convex hull contains a spherical cap, so that what holds for them holds inside it."""

from __future__ import annotations

from functools import cache

import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.frozen import read_only
from ocptip.numerics.bisection import border

LARGEST_EXCESS = 0.02
"""How much longer than 1 the points of an enclosure of default size are at most."""

FEWEST = 4
_MOST = 4.0  # excess length of the coarsest enclosure
_CLOSE = 1e-2  # relative, of the excess
_ROUNDING = 1e-12
_RIMS = np.linspace(0.6, 1.5, 10)  # points on the rim, relative to even spacing
_SHARES = (0.0, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)  # of the half angle over which the inner points are spread
_COUNTS = tuple(int(n) for n in np.unique(np.round(1.15 ** np.arange(10, 50))))


@cache
def enclosure(count: int, half_angle: float) -> np.ndarray:
    """Points (count, 3) about z whose convex hull contains all unit vectors within an angle of it.

    A ring in the plane of the rim and points spread inside, all of one length just large enough; the best of
    a few ways to share the points among the two.

    Args:
        count: at least `FEWEST`.
        half_angle: rad, above 0 and at most pi.
    """
    usual = np.sin(half_angle) * np.sqrt(2 * np.pi * count / (1 - np.cos(half_angle)))
    rims = {int(np.clip(round(usual * f), 3, count - 1)) for f in _RIMS}
    inner = [(rim, share) for rim in sorted(rims) for share in _SHARES]
    best, excess = np.empty((0, 3)), _MOST
    for rim, share in [*inner, (0, 1.0)]:
        inside = _spread(count - rim, share * half_angle)
        excess, best = _enclosing(rim, inside, half_angle, excess, best)
    return read_only(best)


@cache
def enough(half_angle: float) -> int:
    """A number of points of which none is more than `LARGEST_EXCESS` too long; the smallest of a list."""
    return next(n for n in _COUNTS if np.linalg.norm(enclosure(n, half_angle)[0]) <= 1 + LARGEST_EXCESS)


def _spread(count: int, half_angle: float) -> np.ndarray:
    """Fibonacci points on a cap (count, 3); one: its middle."""
    k = np.arange(count)
    z = 1 - (1 - np.cos(half_angle)) * (k + 0.5) / count if count > 1 else np.ones(1)
    turn, across = np.pi * (3 - np.sqrt(5)) * k, np.sqrt(np.maximum(1 - z**2, 0))
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])


def _enclosing(
    rim: int, inside: np.ndarray, half_angle: float, most: float, otherwise: np.ndarray
) -> tuple[float, np.ndarray]:
    """Minimum excess length below `most` with which the points enclose the cap, and the points."""
    height, turn = np.cos(half_angle), 2 * np.pi * np.arange(rim) / max(rim, 1)

    def points(excess: float) -> np.ndarray:
        across = np.sqrt((1 + excess) ** 2 - height**2)
        ring = np.column_stack([across * np.cos(turn), across * np.sin(turn), np.full(rim, height)])
        return np.concatenate([ring, (1 + excess) * inside])

    if not _encloses(points(most), half_angle):
        return most, otherwise

    def enclosed(excess: float) -> bool:
        return _encloses(points(excess), half_angle)

    length, _ = border(enclosed, most, 0.0, lambda low, high: high - low <= _CLOSE * high)
    return length, points(length)


def _encloses(points: np.ndarray, half_angle: float) -> bool:
    """Whether the convex hull of points contains the cap: no plane of the hull cuts it."""
    centre = np.array([0.0, 0.0, np.cos(half_angle)])
    unit = np.array([1.0, 1.0, half_angle / (1 - centre[2])])  # a flat cap made as high as wide, for Qhull
    try:
        planes = scipy.spatial.ConvexHull((points - centre) * unit).equations
    except scipy.spatial.QhullError:
        return False
    normals, offsets = planes[:, :3] * unit, -planes[:, 3]
    sizes = np.linalg.norm(normals, axis=1)
    off_axis = np.arccos(np.clip(normals[:, 2] / sizes, -1, 1))
    reach = np.cos(np.maximum(off_axis - half_angle, 0.0)) - normals @ centre / sizes
    return bool(np.all(offsets / sizes >= reach - _ROUNDING * (1 - centre[2])))
