"""The floor that a base stands on, as far as its contacts tell where it is."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ocptip.contact.support import Support
from ocptip.robots.geometry import FLOOR, Floor

_STEEPEST = 0.5
"""Cosine between a contact's normal and the vertical up to which the contact stands on the floor."""

_ALIKE = 1e-5
"""Planes whose normals differ by less are parallel: 0.01 mm per metre."""

_IN_PLANE = 1e-6
"""Distance of contacts from their common plane, relative to their spread, that counts as rounding."""


def floors_under(support: Support) -> tuple[Floor, ...]:
    """Half spaces that what moves must stay out of, in base axes; none where no contact bears from below.

    What the ground is like between and beyond the contacts is not known. Free is what lies above the tangent
    plane of every contact that stands on the floor and, where at least three lie in one plane, above that
    plane. On a flat floor these are one plane; of steps the highest one remains.
    """
    up = -support.gravity / max(float(np.linalg.norm(support.gravity)), 1e-300)
    normals = support.frames[:, :, 0]
    below = normals @ up >= _STEEPEST if np.any(support.gravity) else np.ones(len(normals), dtype=bool)
    places = np.array([contact.position for contact in support.contacts])
    standing = [
        (k + 1, tuple(places[k].tolist()), tuple(normals[k].tolist())) for k in np.flatnonzero(below).tolist()
    ]
    return _floors(tuple(standing))


@lru_cache(maxsize=64)
def _floors(standing: tuple[tuple[int, tuple[float, ...], tuple[float, ...]], ...]) -> tuple[Floor, ...]:
    """Floors under contacts, each of these given by number, position and normal.

    The cache gives the same objects again, by which collisions are kept.
    """
    floors: list[tuple[np.ndarray, float, str]] = []
    points = np.array([place for _, place, _ in standing]).reshape(-1, 3)
    common = _common_plane(points, np.array([normal for *_, normal in standing]).reshape(-1, 3))
    planes = [(np.array(n), float(np.dot(n, p)), f"{FLOOR} at contact {k}") for k, p, n in standing]
    if common is not None:
        planes.insert(0, (common, float(np.max(points @ common)), FLOOR))
    for normal, level, name in planes:
        same = [k for k, other in enumerate(floors) if np.linalg.norm(other[0] - normal) < _ALIKE]
        if not same:
            floors.append((normal, level, name))
        elif level > floors[same[0]][1]:  # the highest of parallel planes hides the others
            floors[same[0]] = normal, level, name
    if len(floors) == 1:
        floors = [(*floors[0][:2], FLOOR)]
    return tuple(Floor(-normal, -level, name) for normal, level, name in floors)


def _common_plane(points: np.ndarray, normals: np.ndarray) -> np.ndarray | None:
    """Upward normal of the plane through all points (k, 3); None where they are in none, or in one line."""
    if len(points) < 3:
        return None
    away = points - points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(away)
    if sizes[1] <= _IN_PLANE * sizes[0] or sizes[2] > _IN_PLANE * sizes[0]:
        return None
    normal = axes[2] * np.copysign(1.0, np.sum(normals @ axes[2]))
    alike = np.linalg.norm(normals - normal, axis=1) < _ALIKE
    return normals[alike][0] if alike.any() else normal
