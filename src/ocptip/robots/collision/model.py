"""Distances of an arm's solids from each other, from the base and from obstacles: which pairs and names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from itertools import combinations, product
from typing import Any

import casadi as cs
import numpy as np

from ocptip.robots.collision.bounds import steepest_slopes
from ocptip.robots.collision.distances import RESTING, Distances
from ocptip.robots.collision.gaps import (
    MEETING,
    NEVER,
    POSTURES,
    TOUCHING,
    UNSEEN,
    Collisions,
    Contact,
    GapLabel,
    random_postures,
)
from ocptip.robots.collision.shapes import (
    ArmGeometry,
    Ball,
    BodyShape,
    Hull,
    MeshFile,
    Shape,
)
from ocptip.robots.geometry import FLOOR, CollisionModel, Floor, Obstacle, floors_among, in_closed_form
from ocptip.robots.kinematics import chain, link_frames
from ocptip.robots.model import ArmModel, joint_states
from ocptip.robots.pinocchio import load_coal
from ocptip.robots.urdf.parser import load_mesh

_BY_HAND = "excluded"
_PARALLEL = 1e-6
_NEIGHBOURS = "neighbours"
_TELESCOPE = "telescope: all joints between them slide along one line"
_MEETING = 1e-4  # m: axes that pass each other nearer than this meet


class ShapeCollisions(Collisions):
    """All signed distances of an arm of convex solids.

    Pairs are: links that are no neighbours; what the arm carries and all links but the last; shapes of the
    base and all links but the first; obstacles and all links. Of these pairs those are left out that are
    excluded, and of arm and base those that touch in each of `POSTURES` random postures, and tubes of a
    telescope, which touch in some: links between which all joints slide along one line.

    Args:
        arm: with geometry; its spheres, if it has only those, count as solids.
        obstacles: in base axes.
        base: shapes of the base (body 0, base axes).

    Attributes:
        distances: of the pairs, over q (n,), rad.
        solids: name, body and shape; first those of the arm, then those of the base, then obstacles.
        of_arm, of_base: how many.
        of_links: how many of the arm's, which come first, it does not carry.
        pairs: of numbers of solids.
    """

    def __init__(
        self, arm: ArmModel, obstacles: Sequence[Obstacle] = (), base: Sequence[BodyShape] = ()
    ) -> None:
        super().__init__(arm.n)
        geometry = arm.geometry or geometry_of_spheres(arm)
        self.arm, self.source, self.floors = arm, geometry.source, floors_among(obstacles)
        solids, fixed = solids_of(arm, geometry), [(s.name, RESTING, s.shape) for s in base]
        around = [(o.name, RESTING, o.shape) for o in obstacles]
        self.solids = [*solids, *fixed, *around]
        self.of_arm, self.of_base = len(solids), len(fixed)
        self.of_links = sum(not shape.carried for shape in geometry.shapes)
        self.links = frozenset(name for name, *_ in solids[: self.of_links]) if arm.geometry else frozenset()
        held = arm.payload is not None and arm.payload.mass > 0
        self.payload_unseen = held and arm.geometry is not None and self.of_links == self.of_arm
        bodies = [s.body for s in geometry.shapes]
        self.apart = {}
        mounted = [self._links(bodies, 2), range(len(solids), len(solids) + len(fixed))]
        inner = [*self._self_pairs(geometry), *product(*mounted)]
        self.distances = Distances(
            link_frames_function(arm), [(body, shape) for _, body, shape in self.solids], inner
        )
        inner = self._parting(inner, geometry.on_meshes)
        floors = [isinstance(o, Floor) for o in obstacles]
        kept_off = {name for pair in geometry.apart if FLOOR in pair for name in pair}
        self.apart |= {pair: why for pair, why in geometry.apart.items() if FLOOR in pair and any(floors)}
        outer = [
            (s, len(solids) + len(fixed) + k)
            for k, is_floor in enumerate(floors)
            for s in self._links(bodies, 1)
            if not (is_floor and self.solids[s][0] in kept_off)
            if arm.geometry or self.solids[s][0] in (arm.floor_sets if is_floor else arm.obstacle_sets)
        ]
        self.pairs = [*inner, *outer]
        self.distances = self.distances.of(self.pairs)
        self._last: tuple[np.ndarray, Contact] | None = None
        self.labels = tuple(GapLabel(self.solids[a][0], self.solids[b][0]) for a, b in self.pairs)

    @staticmethod
    def _links(bodies: Sequence[int], first: int) -> list[int]:
        return [s for s, body in enumerate(bodies) if body >= first]

    def _self_pairs(self, geometry: ArmGeometry) -> Iterable[tuple[int, int]]:
        for a, b in combinations(range(len(geometry.shapes)), 2):
            first, second = geometry.shapes[a], geometry.shapes[b]
            if first.body == second.body:
                continue
            names, near = frozenset((first.name, second.name)), abs(first.body - second.body) == 1
            if near and first.carried == second.carried:
                self.apart[names] = _NEIGHBOURS
            elif names in geometry.apart:
                self.apart[names] = geometry.apart[names]
            else:
                yield a, b

    def _parting(
        self, pairs: list[tuple[int, int]], on_meshes: Mapping[frozenset[str], int]
    ) -> list[tuple[int, int]]:
        """The pairs but for those that never part, tubes of a telescope, and neighbours over two joints."""
        pairs = self._without(pairs, self._in_line, 0, _TELESCOPE)
        touching = set(always_touching(self.arm, self.distances.of(pairs)).tolist())
        kept = [pair for k, pair in enumerate(pairs) if k not in touching]
        names = {self._names(pair) for pair in kept}
        for pair in {self._names(pairs[k]): None for k in sorted(touching)}:
            count, some = on_meshes.get(pair, POSTURES), "some of their solids " if pair in names else ""
            if count == POSTURES:
                self.apart[pair] = f"{some}{NEVER}"
            elif count == 0:
                self.apart[pair] = f"{some}{NEVER} as convex solids, their meshes never touch"
            else:
                self.apart[pair] = f"{UNSEEN} (touching in {count} of {POSTURES} postures)"
        return self._without(kept, self._axes_meet, POSTURES // 2, MEETING)

    def _names(self, pair: tuple[int, int]) -> frozenset[str]:
        return frozenset(self.solids[s][0] for s in pair)

    def _without(
        self,
        pairs: list[tuple[int, int]],
        related: Callable[[int, int], bool],
        postures: int,
        reason: str,
    ) -> list[tuple[int, int]]:
        """The pairs but for those of links that are related and touch in more postures than that."""
        related_pairs = [k for k, pair in enumerate(pairs) if max(pair) < self.of_links and related(*pair)]
        if not related_pairs:
            return pairs
        result = self.distances.of([pairs[k] for k in related_pairs]).gaps(
            random_postures(self.arm, POSTURES), TOUCHING
        )
        touches: dict[frozenset[str], np.ndarray] = {}
        for k, touch in zip(related_pairs, (result < TOUCHING).T, strict=True):
            names = self._names(pairs[k])
            touches[names] = touches.get(names, np.zeros(len(touch), dtype=bool)) | touch
        counts = {names: int(touch.sum()) for names, touch in touches.items() if touch.sum() > postures}
        for names, count in counts.items():
            self.apart[names] = f"{reason} (touching in {count} of {POSTURES} postures)"
        return [
            pair for k, pair in enumerate(pairs) if k not in related_pairs or self._names(pair) not in counts
        ]

    def _in_line(self, first: int, second: int) -> bool:
        """Whether all joints between two solids, at least two, slide along parallel axes."""
        low, high = sorted((self.solids[first][1], self.solids[second][1]))
        joints, turn, axes = range(low + 1, high + 1), np.eye(3), []
        if len(joints) < 2 or low == high or not self.arm.slides[list(joints)].all():
            return False
        for joint in joints:
            turn = turn @ self.arm.rotations[joint]
            axes.append(turn[:, 2])
        return all(abs(axis @ axes[0]) > 1 - _PARALLEL for axis in axes)

    def _axes_meet(self, first: int, second: int) -> bool:
        """Whether just two turning joints, whose axes meet, are between two solids, as in shoulders."""
        low, high = sorted((self.solids[first][1], self.solids[second][1]))
        if high - low != 2 or self.arm.slides[low + 1 : high + 1].any():
            return False
        axis, across = self.arm.rotations[high][:, 2], np.array([0.0, 0.0, 1.0])
        normal = np.cross(across, axis)
        size = np.linalg.norm(normal)
        return bool(size > _PARALLEL and abs(normal @ self.arm.offsets[high - 1]) < _MEETING * size)

    @cached_property
    def steepest(self) -> np.ndarray:
        pairs, (bodies, across, about) = np.array(self.pairs, dtype=int).reshape(-1, 2), self._extents()
        return steepest_slopes(self.arm, pairs, bodies, across, about)

    def _extents(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bodies of the solids, and how far these reach from z and from the origin, m; 0 of those at rest."""
        bodies, reach = np.array([body for _, body, _ in self.solids]), np.zeros((2, len(self.solids)))
        for k, (_, body, shape) in enumerate(self.solids):
            if body != RESTING:
                corners = shape.outline()
                reach[:, k] = [np.linalg.norm(size, axis=1).max() for size in (corners[:, :2], corners)]
                reach[:, k] += shape.thickness
        return bodies, reach[0], reach[1]

    def gaps(self, q: np.ndarray, below: float | np.ndarray = np.inf) -> np.ndarray:
        states, single = joint_states("q", q, self.n)
        result = self.distances.gaps(states, below)
        return result[0] if single else result

    def proved(self, q: np.ndarray, least: float, needed: np.ndarray) -> np.ndarray | None:
        return self.distances.proved(q, least, needed)

    def nearest(self, q: np.ndarray) -> Contact:
        return self.distances.least(np.atleast_2d(q))

    def on_meshes(self, q: np.ndarray, label: GapLabel) -> float | None:
        geometry = self.arm.geometry
        meshes = () if geometry is None else geometry.meshes
        if not {label.first, label.second} & {mesh.name for mesh in meshes}:
            return None
        coal, frames = load_coal(), link_frames(self.arm, q[None])
        request, result = coal.DistanceRequest(), coal.DistanceResult()

        def placed(item: MeshFile | Shape, turn: np.ndarray, origin: np.ndarray) -> Any:
            return coal.Transform3s(turn @ item.rotation, origin + turn @ item.position)

        def of(name: str) -> Iterator[tuple[Any, Any]]:
            named = [mesh for mesh in meshes if mesh.name == name]
            for mesh in named:
                result = load_mesh(mesh.file, mesh.scale)
                frame = (
                    (frames.rotations[0, mesh.body - 1], frames.origins[0, mesh.body - 1])
                    if mesh.body
                    else (self.arm.mount_rotation, self.arm.mount_position)
                )
                yield result, placed(mesh, *frame)
            for other, body, shape in self.solids:
                if other == name and not (named and isinstance(shape, Hull)):
                    still = np.eye(3), np.zeros(3)
                    frame = still if body == RESTING else (frames.rotations[0, body], frames.origins[0, body])
                    yield shape.solid(), placed(shape, *frame)

        pairs = product(list(of(label.first)), list(of(label.second)))
        return min(coal.distance(a, x, b, y, request, result.clear() or result) for (a, x), (b, y) in pairs)

    def slopes(
        self, q: np.ndarray, states: np.ndarray, pairs: np.ndarray, *, once: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        contact, slopes = self.distances.at(q, states, pairs)
        self._last = q.copy(), contact
        return contact.distances, slopes

    def curvature(self, q: np.ndarray, states: np.ndarray, pairs: np.ndarray, on: np.ndarray) -> np.ndarray:
        last = self._last
        known = last if last is not None and _same(last, q, states, pairs) else None
        contact = known[1] if known else self.distances.at(q, states, pairs)[0]
        return self.distances.curvature(q, contact, on)


def always_touching(arm: ArmModel, distances: Distances) -> np.ndarray:
    """Numbers of the pairs that touch in each of `POSTURES` random postures."""
    touching = np.arange(len(distances.pairs))
    for q in (random_postures(arm, 10), random_postures(arm, POSTURES)):
        result = distances.of([distances.pairs[k] for k in touching]).gaps(q, TOUCHING)
        touching = touching[(result < TOUCHING).all(axis=0)]
    return touching


def _same(last: tuple[np.ndarray, Contact], q: np.ndarray, states: np.ndarray, pairs: np.ndarray) -> bool:
    """Whether nearest points are those of these rows."""
    result = last[0], last[1].states, last[1].pairs
    return all(np.array_equal(a, b) for a, b in zip(result, (q, states, pairs), strict=True))


def solids_of(arm: ArmModel, geometry: ArmGeometry) -> list[tuple[str, int, Shape]]:
    """Name, moving body (link 1 is number 0) and shape of an arm's solids; what rests is in base axes."""
    mount = arm.mount_rotation, arm.mount_position
    return [
        (s.name, s.body - 1 if s.body else RESTING, s.shape if s.body else s.shape.placed(*mount))
        for s in geometry.shapes
    ]


def geometry_of_spheres(arm: ArmModel) -> ArmGeometry:
    """The spheres of an arm as solids."""
    shapes = [
        BodyShape(spheres.name, spheres.link, Ball(float(radius), position=centre))
        for spheres in arm.sphere_sets
        for centre, radius in zip(spheres.centres, spheres.radii, strict=True)
    ]
    checked = {frozenset(pair) for pair in arm.collision_pairs}
    names = [frozenset((a.name, b.name)) for a, b in combinations(arm.sphere_sets, 2)]
    apart = {pair: _BY_HAND for pair in names if pair not in checked}
    return ArmGeometry(tuple(shapes), apart, "spheres")


def link_frames_function(arm: ArmModel) -> cs.Function:
    """CasADi function of q (n,), rad: axes row by row and origin, m, of links 1..L in base axes, (12 L,)."""
    q = cs.SX.sym("q", arm.n)
    rotations, origins = chain(arm, q)
    frames = [cs.vertcat(cs.vec(rotations[i].T), origins[i]) for i in range(arm.links)]
    return cs.Function("frames", [q], [cs.vertcat(*frames)])


@lru_cache(maxsize=8)
def collisions_of(
    arm: ArmModel, obstacles: tuple[Obstacle, ...], shapes: tuple[BodyShape, ...]
) -> Collisions:
    """Collisions in closed form of spheres among floor, walls, pillars and balls; all else by solids."""
    if arm.geometry is None and not arm.sphere_sets:
        return CollisionModel(arm)
    if arm.geometry is None and all(map(in_closed_form, (*obstacles, *shapes))):
        return CollisionModel(arm, obstacles, shapes)
    return ShapeCollisions(arm, obstacles, shapes)
