"""A mesh as a few convex solids that together contain it: cut by planes where that saves volume.

What of the body lies on one side of a plane is bounded by what of the surface lies there and by the section,
whose edge is on the surface: so the convex hull of the cut surface contains it.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

MOST = 4
"""Parts of a mesh."""

WORTHWHILE = 0.93
"""Volume of the parts, relative to the whole, up to which a cut is made."""

_LEVELS = (0.15, 0.3, 0.5, 0.7, 0.85)

_DIRECTIONS = np.random.default_rng(0).normal(size=(150, 3))


def convex_parts(points: np.ndarray, triangles: np.ndarray) -> list[np.ndarray]:
    """Points (k, 3), m, whose convex hulls together contain a mesh.

    Args:
        points: (N, 3), m.
        triangles: (T, 3), numbers of points.
    """
    edges = np.unique(np.sort(np.vstack([triangles[:, [i, i - 1]] for i in range(3)]), axis=1), axis=0)
    whole = _hull_volume(points)
    if not whole > 0 or _volume(points, triangles) > WORTHWHILE * whole:
        return [points]
    parts = [(points, edges, whole, _best_cut(points, edges))]
    while len(parts) < MOST:
        k = max(range(len(parts)), key=lambda i: parts[i][2] - parts[i][3][0])
        _, _, before, (after, axis, level) = parts[k]
        if after > WORTHWHILE * before:
            break
        own, links, *_ = parts.pop(k)
        for side in (-1.0, 1.0):
            piece = _side(own, links, axis, level, side)
            parts.append((*piece, _hull_volume(piece[0]), _best_cut(*piece)))
    return [part[0] for part in parts]


def _best_cut(points: np.ndarray, edges: np.ndarray) -> tuple[float, int, float]:
    """Volume of both hulls after the best cut, its axis and level, m."""
    best = (np.inf, 0, 0.0)
    low, high = points.min(axis=0), points.max(axis=0)
    for axis in range(3):
        for share in _LEVELS:
            level = float(low[axis] + share * (high[axis] - low[axis]))
            over = points[:, axis] - level
            section = _section(points, edges, over)[0]
            sides = [_hull_volume(np.vstack([points[s * over >= 0], section])) for s in (-1.0, 1.0)]
            best = min(best, (sum(sides), axis, level))
    return best


def _side(
    points: np.ndarray, edges: np.ndarray, axis: int, level: float, side: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points and edges of the surface where side * (p[axis] - level) >= 0; edges of the section are new."""
    over = side * (points[:, axis] - level)
    cut, across = _section(points, edges, over)
    inside = (over[edges] >= 0).all(axis=1)
    kept = np.where(over[edges[across, 0]] > 0, edges[across, 0], edges[across, 1])
    shortened = np.column_stack([kept, len(points) + np.arange(len(cut))])
    used, numbers = np.unique(np.vstack([edges[inside], shortened]), return_inverse=True)
    return np.vstack([points, cut])[used], numbers.reshape(-1, 2)


def _section(points: np.ndarray, edges: np.ndarray, over: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (k, 3) in which edges cross the plane at height 0 of heights over (N,), and these edges."""
    first, second = over[edges].T
    across = np.flatnonzero(first * second < 0)
    share = (first[across] / (first[across] - second[across]))[:, None]
    return points[edges[across, 0]] * (1 - share) + points[edges[across, 1]] * share, across


def _volume(points: np.ndarray, triangles: np.ndarray) -> float:
    """Of the body that the triangles bound, m^3."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return abs(float(np.sum(a * np.cross(b, c)))) / 6


def _hull_volume(points: np.ndarray) -> float:
    if len(points) > len(_DIRECTIONS):  # nearly the volume, of fine meshes much sooner
        points = points[np.unique(np.argmax(points @ _DIRECTIONS.T, axis=0))]
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0
