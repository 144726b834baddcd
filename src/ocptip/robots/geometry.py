"""Obstacles; collision spheres of an arm against floor, walls, pillars and each other (4.29 to 4.32).

A signed distance is the free gap in metres, negative in collision. Thesis M demands the negated value <= 0.
Solids other than spheres are the matter of `robots.collision`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations, count, product
from typing import NamedTuple, Self

import casadi as cs
import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError, finite_array, number_from, positive_number
from ocptip.basics.frozen import settle
from ocptip.numerics.batch import BatchFunction
from ocptip.robots.collision.bounds import DistanceBounds, steepest_slopes
from ocptip.robots.collision.gaps import (
    NEVER,
    POSTURES,
    TOUCHING,
    Collisions,
    Contact,
    GapLabel,
    random_postures,
)
from ocptip.robots.collision.shapes import Ball, BodyShape, Capsule, HalfSpace, Shape
from ocptip.robots.collision.spheres import NOTHING, SphereGaps
from ocptip.robots.kinematics import chain
from ocptip.robots.model import ArmModel, SphereSet, joint_states

FLOOR = "floor"
"""Name of a floor, also in pairs that are left out."""

_ENDLESS = 40.0  # m
_TANGENTS = 300
_MOST_SPHERES = 1000  # on one link


@dataclass(frozen=True, eq=False)
class Wall:
    """A plane; free are the points with normal . p <= distance (4.30).

    Attributes:
        normal: (3,), unit vector into the wall, base axes.
        distance: m, from the base origin along the normal.
        name: for messages.
    """

    normal: np.ndarray
    distance: float
    name: str = "wall"

    def __post_init__(self) -> None:
        normal = finite_array(f"{self.name}: normal", self.normal, (3,))
        if abs(np.linalg.norm(normal) - 1) > 1e-9:
            raise InputError(f"{self.name}: normal must have length 1, got {normal.tolist()}")
        settle(self, normal=normal)
        number_from(f"{self.name}: distance", self.distance)

    def gap(self, centre: cs.SX, radius: float) -> cs.SX:
        """Signed distance of a sphere, m; centre (3,), m, base frame."""
        return self.distance - cs.dot(cs.DM(self.normal), centre) - radius

    def gaps(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """`gap` (..., k) of many spheres: centres (..., k, 3) and radii (k,), m."""
        return self.distance - centres @ self.normal - radii

    @property
    def shape(self) -> Shape:
        """The solid."""
        return HalfSpace(self.normal, self.distance)

    def placed(self, rotation: np.ndarray, position: np.ndarray) -> Self:
        """The same in other axes, in which the present ones sit at this pose ((3, 3); (3,), m)."""
        normal = rotation @ self.normal
        return replace(self, normal=normal, distance=float(self.distance + normal @ position))


@dataclass(frozen=True, eq=False)
class Floor(Wall):
    """A wall that only the sets `ArmModel.floor_sets` are checked against; see :func:`floor`."""

    name: str = FLOOR


def floors_among(obstacles: Sequence[Obstacle]) -> tuple[tuple[str, np.ndarray, float], ...]:
    """Name, upward normal (3,) and level, m, of the floors among obstacles; see `Collisions.floors`."""
    return tuple((o.name, -o.normal + 0.0, -o.distance + 0.0) for o in obstacles if isinstance(o, Floor))


def floor(height: float) -> Floor:
    """A horizontal floor: free are the points above z = `height` (m, base frame)."""
    return Floor(np.array([0.0, 0.0, -1.0]), -number_from("floor height", height))


@dataclass(frozen=True, eq=False)
class Pillar:
    """An endless cylinder (4.31), vertical by default; free are the points outside.

    Attributes:
        point: (3,), m, base frame: any point on its axis.
        radius: m.
        axis: (3,), unit vector, base axes.
        name: for messages.
    """

    point: np.ndarray
    radius: float
    axis: np.ndarray = (0.0, 0.0, 1.0)  # pyright: ignore[reportAssignmentType] # settled as an array
    name: str = "pillar"

    def __post_init__(self) -> None:
        for key in ("point", "axis"):
            settle(self, **{key: finite_array(f"{self.name}: {key}", getattr(self, key), (3,))})
        if abs(np.linalg.norm(self.axis) - 1) > 1e-9:
            raise InputError(f"{self.name}: axis must have length 1, got {self.axis.tolist()}")
        positive_number(f"{self.name}: radius", self.radius)

    def gap(self, centre: cs.SX, radius: float) -> cs.SX:
        """Signed distance of a sphere, m; centre (3,), m, base frame."""
        across = np.eye(3) - np.outer(self.axis, self.axis)
        return _length(cs.DM(across) @ (centre - cs.DM(self.point))) - self.radius - radius

    def gaps(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """`gap` (..., k) of many spheres: centres (..., k, 3) and radii (k,), m."""
        arms = centres - self.point
        across = arms - (arms @ self.axis)[..., None] * self.axis
        return np.linalg.norm(across, axis=-1) - self.radius - radii

    @property
    def shape(self) -> Shape:
        """The solid, `_ENDLESS` long."""
        x = np.cross(self.axis, np.eye(3)[np.argmin(np.abs(self.axis))])
        x = x / np.linalg.norm(x)
        axes = np.column_stack([x, np.cross(self.axis, x), self.axis])
        return Capsule(self.radius, _ENDLESS, rotation=axes, position=self.point)

    def placed(self, rotation: np.ndarray, position: np.ndarray) -> Self:
        """The same in other axes, in which the present ones sit at this pose ((3, 3); (3,), m)."""
        return replace(self, point=position + rotation @ self.point, axis=rotation @ self.axis)


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex solid, such as a box or the hull of a mesh.

    Attributes:
        shape: base axes, or the world's.
        name: for messages.
    """

    shape: Shape
    name: str = "obstacle"

    def gap(self, centre: cs.SX, radius: float) -> cs.SX:
        """Signed distance of a sphere from the solid's faces, m; at most the true one, of balls exact."""
        if self._is_ball:
            return _length(centre - cs.DM(self.shape.position)) - self.shape.thickness - radius
        normals, levels = self._faces
        return cs.mmax(cs.DM(normals) @ centre + cs.DM(levels)) - radius

    def gaps(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """`gap` (..., k) of many spheres: centres (..., k, 3) and radii (k,), m."""
        if self._is_ball:
            return np.linalg.norm(centres - self.shape.position, axis=-1) - self.shape.thickness - radii
        normals, levels = self._faces
        return np.max(centres @ normals.T + levels, axis=-1) - radii

    def placed(self, rotation: np.ndarray, position: np.ndarray) -> Self:
        """The same in other axes, in which the present ones sit at this pose ((3, 3); (3,), m)."""
        return replace(self, shape=self.shape.placed(rotation, position))

    @property
    def _is_ball(self) -> bool:
        return type(self.shape) is Ball  # a capsule is a longer one

    @cached_property
    def _faces(self) -> tuple[np.ndarray, np.ndarray]:
        """Outward normals (f, 3) and levels (f,), m: of the solid are the points with n . p + level <= 0."""
        corners = self.shape.outline()
        if not self.shape.thickness:
            equations = scipy.spatial.ConvexHull(corners).equations
            return equations[:, :3], equations[:, 3]
        normals = np.random.default_rng(0).normal(size=(_TANGENTS, 3))  # of planes about a round one
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals, -np.max(normals @ corners.T, axis=1) - self.shape.thickness


Obstacle = Wall | Pillar | Solid


def in_closed_form(obstacle: Obstacle | BodyShape) -> bool:
    """Whether the distance of a sphere from it is a formula: of walls, pillars and balls."""
    return isinstance(obstacle, Wall | Pillar) or type(obstacle.shape) is Ball


class CollisionModel(Collisions):
    """All signed distances of an arm of spheres among floor, walls, pillars, balls; also as CasADi function.

    Args:
        model: the arm with its sphere sets and pairs.
        obstacles: floor (checked against `model.floor_sets`), walls, pillars, balls (`model.obstacle_sets`).
        base: balls of the base (body 0, base axes), checked against all links but the first, but for pairs
            that touch in each of `POSTURES` random postures.

    Attributes:
        function: CasADi function, in: q (n,), rad; out: `gaps` (m,), m.
    """

    source = "spheres"

    def __init__(
        self, model: ArmModel, obstacles: Sequence[Obstacle] = (), base: Sequence[BodyShape] = ()
    ) -> None:
        super().__init__(model.n)
        q = cs.SX.sym("q", model.n)
        spheres = _spheres(model, q)
        rows: list[_Row] = []
        for number, obstacle in enumerate(obstacles):
            if not isinstance(obstacle, Obstacle) or not in_closed_form(obstacle):
                raise InputError(f"obstacles: expected Wall, floor(...), Pillar or a ball, got {obstacle!r}")
            for name in model.floor_sets if isinstance(obstacle, Floor) else model.obstacle_sets:
                for ball in spheres[name]:
                    gap = obstacle.gap(ball.centre, ball.radius)
                    rows.append((GapLabel(ball.name, obstacle.name), (ball.number, NOTHING, number), gap))
        for first, second in model.collision_pairs:
            pairs = list(product(spheres[first], spheres[second]))
            for (a, b), gap in zip(pairs, _between(pairs), strict=True):
                rows.append((GapLabel(a.name, b.name), (a.number, b.number, NOTHING), gap))
        self.apart = {
            frozenset((a.name, b.name)): "neighbours" if abs(a.link - b.link) <= 1 else "excluded"
            for a, b in combinations(model.sphere_sets, 2)
            if not {(a.name, b.name), (b.name, a.name)} & set(model.collision_pairs)
        }
        self.model, self.floors = model, floors_among(obstacles)
        resting = [Solid(ball.shape) for ball in base]
        rows += self._parting(q, self._from_base(spheres, base, len(obstacles)))
        self.labels = tuple(label for label, _, _ in rows)
        self.function = cs.Function("gaps", [q], [cs.vertcat(*(gap for *_, gap in rows))], ["q"], ["gaps"])
        self._batch = BatchFunction(self.function) if rows else None
        self._pairs, self._around = [pair for _, pair, _ in rows], (*obstacles, *resting)

    def _from_base(
        self, spheres: Mapping[str, list[_Sphere]], base: Sequence[BodyShape], first: int
    ) -> list[_Row]:
        """Spheres of all links but the first, and balls of the base, numbered from `first`."""
        return [
            (
                GapLabel(sphere.name, ball.name),
                (sphere.number, NOTHING, number),
                Solid(ball.shape).gap(sphere.centre, sphere.radius),
            )
            for number, ball in enumerate(base, first)
            for some in self.model.sphere_sets
            if some.link >= 2
            for sphere in spheres[some.name]
        ]

    def _parting(self, q: cs.SX, rows: list[_Row]) -> list[_Row]:
        """Those that do not touch in every posture; the others are noted."""
        if not rows:
            return rows
        gaps = BatchFunction(cs.Function("base", [q], [cs.vertcat(*(gap for *_, gap in rows))]))
        values = gaps(random_postures(self.model, POSTURES))[0].reshape(POSTURES, -1)
        always = np.max(values, axis=0) < TOUCHING
        names = [frozenset((label.first.split("[")[0], label.second)) for label, _, _ in rows]
        kept = [row for row, never in zip(rows, always, strict=True) if not never]
        left = {pair for pair, never in zip(names, always, strict=True) if not never}
        for pair in (pair for pair, never in zip(names, always, strict=True) if never):
            self.apart[pair] = f"some of their solids {NEVER}" if pair in left else NEVER
        return kept

    @cached_property
    def steepest(self) -> np.ndarray:
        sets, pairs = self.model.sphere_sets, np.array(self._pairs, dtype=int).reshape(-1, 3)[:, :2]
        bodies = np.repeat(
            [sphere_set.link - 1 for sphere_set in sets], [len(sphere_set.radii) for sphere_set in sets]
        )
        centres = np.concatenate([sphere_set.centres for sphere_set in sets])
        radii = np.concatenate([sphere_set.radii for sphere_set in sets])
        reach = [np.linalg.norm(sphere_set, axis=1) + radii for sphere_set in (centres[:, :2], centres)]
        resting = len(radii)  # stands for every obstacle
        pairs = np.where(pairs == NOTHING, resting, pairs)
        extents = (
            np.append(sphere_set, extra)
            for sphere_set, extra in zip((bodies, *reach), (-1, 0.0, 0.0), strict=True)
        )
        return steepest_slopes(self.model, pairs, *extents)

    @cached_property
    def _bounds(self) -> DistanceBounds:
        """The distances themselves, but for rounding."""
        mount = self.model.mount_rotation, self.model.mount_position
        links, solids = list[int](), list[Shape]()
        for spheres in self.model.sphere_sets:
            balls = [Ball(float(r), position=c) for c, r in zip(spheres.centres, spheres.radii, strict=True)]
            solids += balls if spheres.link else [ball.placed(*mount) for ball in balls]
            links += [spheres.link - 1] * len(balls)
        solids += [obstacle.shape for obstacle in self._around]
        pairs = [(a, len(links) + around if b == NOTHING else b) for a, b, around in self._pairs]
        bodies = np.array([*links, *[-1] * len(self._around)])
        return DistanceBounds(solids, bodies).of(np.array(pairs).reshape(-1, 2))

    def on_line(self, begin: np.ndarray, end: np.ndarray, clearance: float) -> tuple[bool, int]:
        return self._bounds.on_line(self.model, self.steepest, begin, end, clearance)

    def gaps(self, q: np.ndarray, below: float | np.ndarray = np.inf) -> np.ndarray:
        states, single = joint_states("q", q, self.model.n)
        result = self._batch(states)[0] if self._batch else np.empty((len(states), 0))
        return result[0] if single else result

    def slopes(
        self, q: np.ndarray, states: np.ndarray, pairs: np.ndarray, *, once: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        if once:
            return self._each(q, states, pairs)
        chosen, place = np.unique(pairs, return_inverse=True)
        gaps, slopes = _gap_functions(self, tuple(chosen.tolist()))[0](q)
        gaps = gaps.reshape(len(q), len(chosen))
        return gaps[states, place], slopes.reshape(*gaps.shape, self.n)[states, place]

    @cached_property
    def _each(self) -> SphereGaps:
        point = cs.SX.sym("point", 3)
        return SphereGaps(
            self.model, [obstacle.gap(point, 0.0) for obstacle in self._around], point, self._pairs
        )

    def curvature(self, q: np.ndarray, states: np.ndarray, pairs: np.ndarray, on: np.ndarray) -> np.ndarray:
        chosen, place = np.unique(pairs, return_inverse=True)
        weights = np.zeros((len(q), len(chosen)))
        weights[states, place] = on
        return _gap_functions(self, tuple(chosen.tolist()))[1](q, weights)[0].reshape(-1, self.n, self.n)

    def nearest(self, q: np.ndarray) -> Contact:
        gaps = self.gaps(q)
        states, pairs = np.arange(len(q)), np.argmin(gaps, axis=1)
        return Contact(states, pairs, gaps[states, pairs])


@lru_cache(maxsize=8)
def _gap_functions(collision: CollisionModel, pairs: tuple[int, ...]) -> tuple[BatchFunction, BatchFunction]:
    """Functions of some distances: values with slopes, and the weighted sum's second derivative."""
    q, weights = cs.SX.sym("q", collision.n), cs.SX.sym("weights", len(pairs))
    gaps = collision.function(q)[list(pairs)]
    hessian, _ = cs.hessian(cs.dot(weights, gaps), q)
    first = BatchFunction(cs.Function("gap", [q], [gaps, cs.jacobian(gaps, q)]))
    return first, BatchFunction(cs.Function("gap_hessian", [q, weights], [hessian]))


def spheres_along_links(
    model: ArmModel, radius: float, *, links: Sequence[int] | None = None
) -> tuple[SphereSet, ...]:
    """Sphere sets that cover the straight lines Q_i to Q_{i+1} (last: to G) as tubes, for arms without data.

    Args:
        radius: m, of every sphere; neighbours are at most one radius apart, so the tube covered is 0.86 radii
            thick.
        links: 1..L; all with a length above zero by default.

    Raises:
        InputError: no such link, a radius that is not positive, or so small that a link has more than 1,000.
    """
    positive_number("radius", radius)
    chosen = range(1, model.links + 1) if links is None else links
    sets = []
    for link in chosen:
        if not 1 <= link <= model.links:
            raise InputError(f"links: must be 1..{model.links}, got {link}")
        offset = model.offsets[link - 1]
        length = np.linalg.norm(offset)
        if length == 0 and links is None:
            continue
        if length > _MOST_SPHERES * radius:
            text = f"more than {_MOST_SPHERES} spheres on link {link}, {length:.4g} m long"
            raise InputError(text, "radius")
        steps = np.linspace(0, 1, int(np.ceil(length / radius)) + 1)
        sets.append(SphereSet(f"link {link}", link, steps[:, None] * offset, np.full(len(steps), radius)))
    return tuple(sets)


def never_part(model: ArmModel) -> list[tuple[str, str]]:
    """Pairs of sphere sets that are checked, but touch in each of many random postures."""
    collision = CollisionModel(model)
    gaps = collision.gaps(random_postures(model, POSTURES))
    touching: dict[tuple[str, str], np.ndarray] = {}
    names = [(x.first.split("[")[0], x.second.split("[")[0]) for x in collision.labels]
    for pair, gap in zip(names, gaps.T, strict=True):
        touching[pair] = touching.get(pair, False) | (gap < TOUCHING)
    return [pair for pair, touches in touching.items() if touches.all()]


def sphere_centres(model: ArmModel) -> cs.Function:
    """CasADi function of all sets' sphere centres in order (4.29): q (n,), rad, to (3, k), m, base frame."""
    q = cs.SX.sym("q", model.n)
    columns = [sphere.centre for spheres in _spheres(model, q).values() for sphere in spheres]
    return cs.Function("sphere_centres", [q], [cs.horzcat(*columns)], ["q"], ["centres"])


class _Sphere(NamedTuple):
    """A sphere with its name and its number among all of an arm."""

    name: str
    number: int
    centre: cs.SX
    radius: float


_TINY = 1e-30
"""m^2: keeps the derivative finite where two centres coincide; it changes lengths by less than 1e-15 m."""
_Row = tuple[GapLabel, tuple[int, int, int], cs.SX]
"""What a distance is between, in words and as for `SphereGaps`, and the distance."""


def _spheres(model: ArmModel, q: cs.SX) -> dict[str, list[_Sphere]]:
    rotations, origins = chain(model, q)
    frames = [
        (cs.SX(model.mount_rotation), cs.SX(model.mount_position)),
        *zip(rotations, origins, strict=True),
    ]
    number, result = count(), {}
    for sphere_set in model.sphere_sets:
        rotation, origin = frames[sphere_set.link]
        result[sphere_set.name] = [
            _Sphere(f"{sphere_set.name}[{k}]", next(number), origin + rotation @ cs.SX(centre), radius)
            for k, (centre, radius) in enumerate(zip(sphere_set.centres, sphere_set.radii, strict=True), 1)
        ]
    return result


def _between(pairs: Sequence[tuple[_Sphere, _Sphere]]) -> list[cs.SX]:
    """Distances of the surfaces of pairs of spheres, m (4.32), by a few operations on matrices."""
    firsts, seconds = (cs.horzcat(*(sphere.centre for sphere in side)) for side in zip(*pairs, strict=True))
    between = firsts - seconds
    lengths = cs.sqrt(cs.sum1(between * between) + _TINY)
    return cs.horzsplit(
        lengths - cs.DM([[a.radius for a, _ in pairs]]) - cs.DM([[b.radius for _, b in pairs]])
    )


def _length(vector: cs.SX) -> cs.SX:
    return cs.sqrt(cs.sumsqr(vector) + _TINY)
