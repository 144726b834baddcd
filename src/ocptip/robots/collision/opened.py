"""Meshes cut where their convex solids collide and the meshes do not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from ocptip.robots.collision.distances import RESTING
from ocptip.robots.collision.gaps import GapLabel
from ocptip.robots.collision.model import ShapeCollisions
from ocptip.robots.collision.parts import corners_of, cut_surfaces, side_of
from ocptip.robots.collision.shapes import ArmGeometry, BodyShape, Hull, MeshFile, Shape
from ocptip.robots.kinematics import LinkFrames, link_frames
from ocptip.robots.pinocchio import load_coal
from ocptip.robots.urdf.parser import load_mesh

CUTS = 40
"""Maximum number of cuts of the meshes of a pair of links, for a posture."""

_GAIN = 1e-6  # m by which a cut has to part two solids


@dataclass(frozen=True, eq=False)
class _Piece:
    """A solid on a body (0: the mount, `RESTING`: base axes), and what of a mesh it encloses, link axes."""

    body: int
    shape: Shape
    surface: np.ndarray | None = None

    @cached_property
    def solid(self) -> Any:
        return self.shape.solid()

    def cut(self, axis: int, level: float) -> list[_Piece]:
        """Both sides of a plane; none where all is on one side."""
        assert self.surface is not None
        sides = [side_of(self.surface, axis, level, sign) for sign in (-1.0, 1.0)]
        if min(map(len, sides)) == 0:
            return []
        return [_Piece(self.body, Hull(corners_of(s)), s) for s in sides]


def opened(collision: ShapeCollisions, postures: Iterable[np.ndarray], least: float) -> ArmGeometry | None:
    """The arm's geometry with more solids for meshes: where two meshes keep the distance `least`, their
    solids do so as well.

    Each cut goes through one of the nearest points of two solids, and of all such cuts the one is made that
    parts them most.

    Args:
        collision: of the arm.
        postures: (n,) each, rad.
        least: m.

    Returns:
        None where cuts do not help, or are not needed.
    """
    arm, pieces = collision.arm, dict[str, list[_Piece]]()
    for q in postures:
        frames = link_frames(arm, q[None])
        for label in collision.hidden(q, least):
            if not _open(collision, frames, label, least, pieces):
                return None
    if not pieces or arm.geometry is None:
        return None
    kept = [s for s in arm.geometry.shapes if s.name not in pieces or not isinstance(s.shape, Hull)]
    finer = [
        BodyShape(name, p.body, p.shape)
        for name, piece in pieces.items()
        for p in piece
        if p.surface is not None
    ]
    links, carried = ([s for s in kept if s.carried == held] for held in (False, True))
    return replace(arm.geometry, shapes=(*links, *finer, *carried))


def _open(
    collision: ShapeCollisions,
    frames: LinkFrames,
    label: GapLabel,
    least: float,
    pieces: dict[str, list[_Piece]],
) -> bool:
    """Cut the meshes of two names until their solids are so far apart, m; whether they are."""
    both = [pieces.get(name) or list(_pieces(collision, name)) for name in (label.first, label.second)]
    poses: dict[int, tuple[np.ndarray, np.ndarray]] = {
        p.body: _pose(collision, frames, p.body) for which in both for p in which
    }
    gaps = {(one, other): _nearest(one, other, poses) for one, other in product(*both)}
    for _ in range(CUTS):
        pair = min(gaps, key=lambda which: gaps[which][0])
        gap, points = gaps[pair]
        if gap >= least:
            pieces.update(
                (name, which) for name, which in zip((label.first, label.second), both, strict=True)
                if any(p.surface is not None for p in which)
            )  # fmt: skip
            return True
        best, chosen = gap + _GAIN, None
        for side, piece in enumerate(pair):
            turn, origin = poses[piece.body]
            for point, axis in product(points, range(3)) if piece.surface is not None else ():
                halves = piece.cut(axis, float((turn.T @ (point - origin))[axis]))
                apart = [_nearest(*_ordered(half, pair[1 - side], side), poses)[0] for half in halves]
                if halves and min(apart) > best:
                    best, chosen = min(apart), (side, halves)
        if chosen is None:
            return False
        side, halves = chosen
        both[side] = [p for p in both[side] if p is not pair[side]] + halves
        gaps = {which: result for which, result in gaps.items() if which[side] is not pair[side]}
        for half, other in product(halves, both[1 - side]):
            which = _ordered(half, other, side)
            gaps[which] = _nearest(*which, poses)
    return False


def _ordered(one: _Piece, other: _Piece, side: int) -> tuple[_Piece, _Piece]:
    return (other, one) if side else (one, other)


def _nearest(
    first: _Piece, second: _Piece, poses: dict[int, tuple[np.ndarray, np.ndarray]]
) -> tuple[float, np.ndarray]:
    """Signed distance, m, and nearest points (2, 3), m, base axes."""
    coal = load_coal()
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    placed = [p.shape.placed(*poses[p.body]) for p in (first, second)]
    transforms = [coal.Transform3s(p.rotation, p.position) for p in placed]
    gap = coal.distance(first.solid, transforms[0], second.solid, transforms[1], request, result)
    return float(gap), np.array([result.getNearestPoint1(), result.getNearestPoint2()])


def _pose(collision: ShapeCollisions, frames: LinkFrames, body: int) -> tuple[np.ndarray, np.ndarray]:
    if body == RESTING:
        return np.eye(3), np.zeros(3)
    if body == 0:
        return collision.arm.mount_rotation, collision.arm.mount_position
    return frames.rotations[0, body - 1], frames.origins[0, body - 1]


def _pieces(collision: ShapeCollisions, name: str) -> Iterator[_Piece]:
    """Solids of a name, those of meshes with what they enclose."""
    geometry = collision.arm.geometry
    meshes = [] if geometry is None else [mesh for mesh in geometry.meshes if mesh.name == name]
    for mesh in meshes:
        for surface in cut_surfaces(*_triangles(mesh)):
            points = surface @ mesh.rotation.T + mesh.position
            yield _Piece(mesh.body, Hull(corners_of(points)), points)
    for other, body, shape in collision.solids:
        if other == name and not (meshes and isinstance(shape, Hull)):
            yield _Piece(RESTING if body == RESTING else body + 1, shape)


def _triangles(mesh: MeshFile) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3), m, of a mesh's file, and numbers (T, 3) of those of its triangles."""
    model = load_mesh(mesh.file, mesh.scale)
    triangles = [model.tri_indices(i) for i in range(model.num_tris)]
    return np.array(model.vertices()), np.array([[t[k] for k in range(3)] for t in triangles], dtype=int)
