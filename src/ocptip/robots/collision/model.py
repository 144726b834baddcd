"""Distances of an arm's solids from each other, from the base and from obstacles: which pairs and names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations, product

import casadi as cs
import numpy as np

from ocptip.robots.collision.distances import RESTING, Distances
from ocptip.robots.collision.gaps import (
    NEVER,
    POSTURES,
    TOUCHING,
    Collisions,
    Contact,
    GapLabel,
    random_postures,
)
from ocptip.robots.collision.shapes import ArmGeometry, Ball, BodyShape, Shape
from ocptip.robots.geometry import Floor, Obstacle
from ocptip.robots.kinematics import chain
from ocptip.robots.model import ArmModel, joint_states

_BY_HAND = "excluded"
_NEIGHBOURS = "neighbours"


class ShapeCollisions(Collisions):
    """All signed distances of an arm of convex solids.

    Pairs are: links that are no neighbours; what the arm carries and all links but the last; shapes of the
    base and all links but the first; obstacles and all links. Of these pairs those are left out that are
    excluded, and those of arm and base that touch in each of `POSTURES` random postures.

    Args:
        arm: with geometry; its spheres, if it has only those, are solids, too.
        obstacles: in base axes.
        base: shapes of the base (body 0, base axes).

    Attributes:
        distances: of the pairs, over q (n,), rad.
        solids: name, body and shape; first those of the arm, then those of the base, then obstacles.
        of_arm, of_base: how many.
        pairs: of numbers of solids.
    """

    def __init__(
        self, arm: ArmModel, obstacles: Sequence[Obstacle] = (), base: Sequence[BodyShape] = ()
    ) -> None:
        super().__init__(arm.n)
        geometry = arm.geometry or geometry_of_spheres(arm)
        self.arm, self.source = arm, geometry.source
        own, fixed = solids_of(arm, geometry), [(s.name, RESTING, s.shape) for s in base]
        around = [(o.name, RESTING, o.shape) for o in obstacles]
        self.solids = [*own, *fixed, *around]
        self.of_arm, self.of_base = len(own), len(fixed)
        bodies = [s.body for s in geometry.shapes]
        self.apart: dict[frozenset[str], str] = {}
        mounted = [self._links(bodies, 2), range(len(own), len(own) + len(fixed))]
        inner = [*self._self_pairs(geometry), *product(*mounted)]
        self.distances = Distances(
            link_frames_function(arm), [(body, shape) for _, body, shape in self.solids], inner
        )
        inner = self._parting(inner)
        floors = [isinstance(o, Floor) for o in obstacles]
        outer = [
            (s, len(own) + len(fixed) + k)
            for k, is_floor in enumerate(floors)
            for s in self._links(bodies, 1)
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

    def _parting(self, pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """The pairs but for those that never part."""
        touching = np.arange(len(pairs))
        for q in (random_postures(self.arm, 10), random_postures(self.arm, POSTURES)):
            found = self.distances.of([pairs[k] for k in touching]).gaps(q, TOUCHING)
            touching = touching[(found < TOUCHING).all(axis=0)]
        kept = [pair for k, pair in enumerate(pairs) if k not in touching]
        names = {frozenset(self.solids[s][0] for s in pair) for pair in kept}
        for k in touching:
            pair = frozenset(self.solids[s][0] for s in pairs[k])
            self.apart[pair] = f"some of their solids {NEVER}" if pair in names else NEVER
        return kept

    def gaps(self, q: np.ndarray, below: float = np.inf) -> np.ndarray:
        states, single = joint_states("q", q, self.n)
        result = self.distances.gaps(states, below)
        return result[0] if single else result

    def nearest(self, q: np.ndarray) -> Contact:
        return self.distances.least(np.atleast_2d(q))

    def slopes(self, q: np.ndarray, states: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        contact, slopes = self.distances.at(q, states, pairs)
        self._last = q.copy(), contact
        return contact.distances, slopes

    def curvature(self, q: np.ndarray, states: np.ndarray, pairs: np.ndarray, on: np.ndarray) -> np.ndarray:
        last = self._last
        known = last is not None and _same(last, q, states, pairs)
        contact = last[1] if known else self.distances.at(q, states, pairs)[0]
        return self.distances.curvature(q, contact, on)


def _same(last: tuple[np.ndarray, Contact], q: np.ndarray, states: np.ndarray, pairs: np.ndarray) -> bool:
    """Whether nearest points are those of these rows."""
    found = last[0], last[1].states, last[1].pairs
    return all(np.array_equal(a, b) for a, b in zip(found, (q, states, pairs), strict=True))


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
