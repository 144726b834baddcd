"""A mesh as a few convex solids that together contain its surface: cut by planes where that saves volume.

What of the body lies on one side of a plane is bounded by what of the surface lies there and by the section,
whose edge is on the surface: so the convex hull of the cut surface contains it. Where three planes meet in
a body, a piece may lack its innermost corner. Nothing gets there but through the surface, which is covered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import scipy

from ocptip.robots.collision.distances import Distances
from ocptip.robots.collision.gaps import POSTURES, random_postures
from ocptip.robots.collision.model import always_touching, link_frames_function, solids_of
from ocptip.robots.collision.shapes import ArmGeometry, MeshFile
from ocptip.robots.kinematics import link_frames
from ocptip.robots.model import ArmModel
from ocptip.robots.pinocchio import load_coal

MOST = 8
"""Parts of a mesh."""

WORTHWHILE = 0.93
"""Volume of the parts, relative to the whole, up to which a cut is made."""

LARGE = 2e-4
"""m^3: a cut that saves at least this volume is also made: little of a torso, but enough for an elbow."""

LITTLE = 1e-2
"""Share of the volume: cuts that save less are no better than one through the middle."""

NEIGHBOURS = 200
"""Neighbours of a corner, at most: coal counts them in a byte, and a fine cone has more at its apex."""

_ROUNDED = 1e-3
_LEVELS = (0.15, 0.35, 0.65, 0.85)
_DIRECTIONS = np.random.default_rng(0).normal(size=(100, 3))


def convex_parts(points: np.ndarray, triangles: np.ndarray, most: int | None = None) -> list[np.ndarray]:
    """Points (k, 3), m, whose convex hulls together contain a mesh; see :func:`cut_surfaces`."""
    return [corners_of(part) for part in cut_surfaces(points, triangles, most)]


def corners_of(surface: np.ndarray) -> np.ndarray:
    """Points (k, 3), m, whose hull coal takes and contains triangles (T, 3, 3)."""
    return with_few_neighbours(np.unique(surface.reshape(-1, 3), axis=0))


def cut_surfaces(points: np.ndarray, triangles: np.ndarray, most: int | None = None) -> list[np.ndarray]:
    """A mesh in parts, triangles (T, 3, 3), m, each, which together are its surface.

    Args:
        points: (N, 3), m.
        triangles: (T, 3), numbers of points.
        most: number of parts of a mesh that is not convex. Default: `MOST`, where cuts save much.
    """
    surface = points[triangles]
    whole, volume = _hull_volume(surface), _volume(surface)
    # More than the hull has a mesh of parts that overlap: its volume tells nothing then.
    full = volume <= (1 + _ROUNDED) * whole and (
        not _is_worthwhile(whole, volume) if most is None else volume >= (1 - LITTLE) * whole
    )
    if full or not whole > 0:
        return [surface]
    parts = [(surface, whole, _best_cut(surface))]
    while len(parts) < (most or MOST):
        if most is None:
            k = max(range(len(parts)), key=lambda i: parts[i][1] - parts[i][2][0])
        else:
            k = max(range(len(parts)), key=lambda i: parts[i][1])
        piece_here, before, (after, axis, level) = parts[k]
        if most is None and not _is_worthwhile(before, after):
            break
        if most is not None and after > (1 - LITTLE) * before:
            # No single cut helps: a groove opens only after one through it, and a shell gets thin pieces.
            low, high = piece_here.min(axis=(0, 1)), piece_here.max(axis=(0, 1))
            axis = int(np.argmax(high - low))
            level = float(0.5 * (low[axis] + high[axis]))
        pieces = [side_of(piece_here, axis, level, side) for side in (-1.0, 1.0)]
        if min(map(len, pieces)) == 0:
            break
        parts[k : k + 1] = [(piece, _hull_volume(piece), _best_cut(piece)) for piece in pieces]
    return [part[0] for part in parts]


def with_few_neighbours(points: np.ndarray) -> np.ndarray:
    """Points whose hull contains that of the points given, and no corner of which has more than `NEIGHBOURS`.

    Where a corner has more, `NEIGHBOURS` corners far from each other are kept, and moved away from their
    middle until their hull contains all.
    """
    try:
        hull = scipy.spatial.ConvexHull(points)
    except (scipy.spatial.QhullError, ValueError):
        return points  # flat: `Hull` makes it a solid
    edges = np.unique(np.sort(hull.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    if np.bincount(edges.ravel()).max() <= NEIGHBOURS:
        return points
    corners = points[hull.vertices]
    chosen, far = [int(np.argmax(corners[:, 2]))], np.full(len(corners), np.inf)
    while len(chosen) < NEIGHBOURS:
        far = np.minimum(far, np.linalg.norm(corners - corners[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(far)))
    kept = corners[chosen]
    planes, middle = scipy.spatial.ConvexHull(kept).equations, kept.mean(axis=0)
    outside = (planes[:, :3] @ corners.T + planes[:, 3:]).max(axis=1)
    inside = -(planes[:, :3] @ middle + planes[:, 3])
    return middle + (1 + max(0.0, float(np.max(outside / inside)))) * (kept - middle)


def _is_worthwhile(before: float, after: float) -> bool:
    """Whether solids of some volume, m^3, are to be replaced by others."""
    return after <= WORTHWHILE * before or before - after >= LARGE


def _best_cut(surface: np.ndarray) -> tuple[float, int, float]:
    """Volume of both hulls after the best cut, its axis and level, m."""
    best = (np.inf, 0, 0.0)
    corners = np.unique(surface.reshape(-1, 3), axis=0)  # each once: a sixth
    low, high = corners.min(axis=0), corners.max(axis=0)
    for axis in range(3):
        least, most = surface[:, :, axis].min(axis=1), surface[:, :, axis].max(axis=1)
        for share in _LEVELS:
            level = float(low[axis] + share * (high[axis] - low[axis]))
            across = surface[(least < level) & (most > level)]
            volumes = []
            for side in (-1.0, 1.0):
                whole = corners[side * (corners[:, axis] - level) >= 0]
                pieces = side_of(across, axis, level, side).reshape(-1, 3)
                volumes.append(_hull_volume(np.concatenate([whole, pieces])))
            if min(volumes) > 0:
                best = min(best, (sum(volumes), axis, level))
    return best


def side_of(surface: np.ndarray, axis: int, level: float, side: float) -> np.ndarray:
    """Triangles (T, 3, 3) where side * (p[axis] - level) >= 0; those across the plane are cut."""
    over = side * (surface[:, :, axis] - level)
    inside = over >= 0
    count = inside.sum(axis=1)
    result = [surface[count == 3]]
    for inner in (1, 2):  # corners inside; the corner that is alone comes first
        which = np.flatnonzero(count == inner)
        alone = np.argmax(inside[which] == (inner == 1), axis=1)
        order = (alone[:, None] + np.arange(3)) % 3
        corners = np.take_along_axis(surface[which], order[:, :, None], axis=1)
        heights = np.take_along_axis(over[which], order, axis=1)
        share = (heights[:, :1] / (heights[:, :1] - heights[:, 1:]))[:, :, None]
        cuts = corners[:, :1] + share * (corners[:, 1:] - corners[:, :1])
        if inner == 1:
            result.append(np.concatenate([corners[:, :1], cuts], axis=1))
        else:
            result.append(np.stack([cuts[:, 0], corners[:, 1], corners[:, 2]], axis=1))
            result.append(np.stack([cuts[:, 0], corners[:, 2], cuts[:, 1]], axis=1))
    return np.concatenate(result)


def _volume(surface: np.ndarray) -> float:
    """Volume of the body that triangles (T, 3, 3) bound, m^3."""
    a, b, c = surface.transpose(1, 0, 2)
    return abs(float(np.sum(a * np.cross(b, c)))) / 6


def _hull_volume(surface: np.ndarray) -> float:
    points = surface.reshape(-1, 3)
    if len(points) > len(_DIRECTIONS):  # nearly the volume, of fine meshes much sooner
        points = points[np.unique(np.argmax(_DIRECTIONS @ points.T, axis=1))]
    try:
        return float(scipy.spatial.ConvexHull(points).volume)
    except (scipy.spatial.QhullError, ValueError):
        return 0.0


@dataclass(frozen=True, eq=False)
class Raw:
    """A geometry as its file has it.

    Attributes:
        name: of the link.
        body: see `BodyShape`.
        geometry: of coal, a mesh's triangles for example.
        rotation, position: (3, 3) and (3,), m: its pose in the link's frame; of body 0 in the mount frame.
        mesh: its file; None: no mesh.
    """

    name: str
    body: int
    geometry: Any
    rotation: np.ndarray
    position: np.ndarray
    mesh: MeshFile | None = None


def touches_on_meshes(arm: ArmModel, geometry: ArmGeometry, raw: Sequence[Raw]) -> dict[frozenset[str], int]:
    """In how many of `POSTURES` random postures links touch on their meshes.

    Of those links, neither neighbours nor excluded, some of whose convex solids touch in all of them.
    """
    shapes = geometry.shapes
    pairs = [
        (a, b)
        for b in range(len(shapes))
        for a in range(b)
        if abs(shapes[a].body - shapes[b].body) > 1
        and frozenset((shapes[a].name, shapes[b].name)) not in geometry.apart
    ]
    solids = [(body, shape) for _, body, shape in solids_of(arm, geometry)]
    distances = Distances(link_frames_function(arm), solids, pairs)
    outcome = {frozenset(shapes[s].name for s in pairs[k]) for k in always_touching(arm, distances)}
    if not outcome:
        return {}
    coal, frames = load_coal(), link_frames(arm, random_postures(arm, POSTURES))
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.enable_contact = True  # without it coal 3.0.3 misses some overlaps of cylinders

    def pose(item: Raw, state: int) -> Any:
        turn, origin = arm.mount_rotation, arm.mount_position
        if item.body:
            turn, origin = frames.rotations[state, item.body - 1], frames.origins[state, item.body - 1]
        return coal.Transform3s(turn @ item.rotation, origin + turn @ item.position)

    def touch(first: Raw, second: Raw, state: int) -> bool:
        result.clear()
        poses = pose(first, state), pose(second, state)
        return coal.collide(first.geometry, poses[0], second.geometry, poses[1], request, result) > 0

    counts = {}
    for names in sorted(outcome, key=sorted):
        items = [[item for item in raw if item.name == name] for name in sorted(names)]
        hits = (any(touch(a, b, state) for a, b in product(*items)) for state in range(POSTURES))
        counts[names] = sum(hits)
    return counts
