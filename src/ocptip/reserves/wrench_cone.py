"""Half spaces of wrenches that contacts with friction can hold, from the inside.

Every friction cone is replaced by a pyramid inscribed in it, of `sides` sides: no tangential force beyond
cos(pi / sides) of the limit is lost. What the contacts can balance is then the cone spanned by the pyramids'
edges, whose facets are those of the convex hull of a cross-section (Caron, Pham and Nakamura: the contact
wrench cone).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import scipy  # subpackages load on first use

from ocptip.contact.support import Support
from ocptip.numerics.jit.compiled import compiled

SIDES = 16
TOLERANCE = 1 - np.cos(np.pi / SIDES)
"""Share of the friction that is lost at most: 1.9 %."""

_SOFT = 1e-3  # softness of the maximum, of its unit
_FAR = 40.0  # times the softness below the maximum: rows so far below it add less than rounding does
_SLANTED = 1e-3  # least cosine of a pyramid's edge against the mean normal
_ROUNDING = 1e-9
_DIGITS = 12  # of edges, in units of a force


def wrench_half_spaces(support: Support, friction: np.ndarray) -> np.ndarray | None:
    """Rows a (m, 6): wrenches w on the base with a . w <= 0 are held; None where the cone has no such facets.

    Lengths of rows are such that a . w is a force for moments counted in units of the support's length.

    Args:
        support: spatial, with ordinary contacts.
        friction: (n,), coefficients of the contacts.
    """
    angles = 2 * np.pi * (np.arange(SIDES) + 0.5) / SIDES
    circle = np.stack([np.ones(SIDES), np.cos(angles), np.sin(angles)])
    scaling = np.r_[np.ones(3), np.full(3, 1 / support.length)]
    matrix = (scaling[:, None] * support.wrench_matrix).reshape(6, len(friction), 3)
    units = np.column_stack([np.ones_like(friction), friction, friction])
    edges = np.einsum("wnc,nc,cs->nsw", matrix, units, circle).reshape(-1, 6)
    normal = np.append(support.frames[:, :, 0].sum(axis=0), np.zeros(3))
    key = np.round(np.vstack([edges, normal]), _DIGITS) + 0.0
    rows = _facets(_Cone(key.tobytes(), edges, normal))
    return None if rows is None else -rows * scaling


@dataclass(frozen=True)
class _Cone:
    """Edges (k, 6) of a cone with their mean direction; the key says which cones differ by rounding only."""

    key: bytes
    edges: np.ndarray = field(compare=False)
    normal: np.ndarray = field(compare=False)


@lru_cache(maxsize=64)
def _facets(cone: _Cone) -> np.ndarray | None:
    """Rows (m, 6) of unit length, positive inside a cone; objects of one shape and friction share them.

    The edges are not rounded: many facets have more than the minimum number of edges, and stay whole so.
    """
    edges, normal = cone.edges, cone.normal
    heights = edges @ normal
    if np.min(heights) <= _SLANTED * np.linalg.norm(normal):
        return None
    basis = np.linalg.svd(normal[None])[2][1:]
    try:
        hull = scipy.spatial.ConvexHull((edges / heights[:, None]) @ basis.T)
    except scipy.spatial.QhullError:  # contacts on a line, or without friction
        return None
    rows = hull.equations[:, :-1] @ basis + hull.equations[:, -1:] * normal
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    rows = np.unique(np.round(rows / _ROUNDING) * _ROUNDING, axis=0)
    return rows[np.max(edges @ rows.T, axis=0) <= 10 * _ROUNDING * np.max(np.abs(edges))]


class ConeMap:
    """How near a wrench is to the facets of a cone of such half spaces, as a smooth function for programs.

    The value is about 0 for no force across and 1 on the cone: 1 + M / unit, with M the smooth maximum
    T log(sum exp(a . w / T)) of all a . w, which is never below their maximum.

    Args:
        half_spaces: rows a (m, 6).
        unit: N.
    """

    def __init__(self, half_spaces: np.ndarray, unit: float) -> None:
        self._rows, self._unit, self._softness = np.ascontiguousarray(half_spaces), unit, _SOFT * unit

    def __call__(self, wrenches: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values (N,), slopes (N, 6) and second derivatives (N, 6, 6) at wrenches (N, 6)."""
        above = wrenches @ self._rows.T / self._softness
        greatest, slopes, bends = _soft_maximum(above, self._rows)
        values = 1 + self._softness * greatest / self._unit
        return values, slopes / self._unit, bends / (self._softness * self._unit)


@compiled
def _soft_maximum(above, rows):
    """log(sum exp(above)) (N,) of numbers (N, m), and its first two derivatives where rows (m, 6) are theirs.

    Cones of objects have more than 1000 rows, of which few are near the maximum: only these are added.
    """
    count, m = above.shape
    values, slopes, bends = np.empty(count), np.zeros((count, 6)), np.zeros((count, 6, 6))
    for i in range(count):
        top = above[i, 0]
        for k in range(1, m):
            top = max(top, above[i, k])
        total = 0.0
        for k in range(m):
            if above[i, k] > top - _FAR:
                share = np.exp(above[i, k] - top)
                total += share
                for a in range(6):
                    slopes[i, a] += share * rows[k, a]
                    for b in range(6):
                        bends[i, a, b] += share * rows[k, a] * rows[k, b]
        values[i] = top + np.log(total)
        for a in range(6):
            slopes[i, a] /= total
        for a in range(6):
            for b in range(6):
                bends[i, a, b] = bends[i, a, b] / total - slopes[i, a] * slopes[i, b]
    return values, slopes, bends
