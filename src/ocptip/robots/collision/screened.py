"""Distances for searches, which ask for many single states: cheap lower bounds before coal is called.

The bound of a pair is that of the capsules about both solids; of a box at rest, such as a board of a
shelf, it is that of the capsule from the planes of the faces, which is much closer. All bounds are
one CasADi function together with the frames of the links. Only pairs that these do not clear go to coal, the
nearest first, and the first collision ends it.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs
import numpy as np

from ocptip.numerics.batch import BatchFunction
from ocptip.robots.collision.distances import RESTING
from ocptip.robots.collision.shapes import Box, HalfSpace, Shape, enclosing_capsule
from ocptip.robots.pinocchio import load_coal

_TINY = 1e-12


class ScreenedDistances:
    """Distances of pairs of solids on K bodies, as `Distances` has them.

    Args:
        frames: CasADi function of y (ny,), see `Distances`.
        solids: body (0 to K - 1, or `RESTING`) and shape.
        pairs: of numbers of solids on different bodies.
    """

    def __init__(
        self,
        frames: cs.Function,
        solids: Sequence[tuple[int, Shape]],
        pairs: Sequence[tuple[int, int]],
    ) -> None:
        y = cs.SX.sym("y", frames.numel_in(0))
        values = frames(y)
        capsules = [_Enclosing(body, shape, values) for body, shape in solids]
        planes = [_planes(shape) if body == RESTING else None for body, shape in solids]
        bounds = [_bound(capsules, planes, *pair) for pair in pairs]
        self._screen = BatchFunction(cs.Function("screen", [y], [values, cs.vertcat(*bounds)]))
        self._pairs = np.array(pairs, dtype=int).reshape(-1, 2)
        self._bodies = [body for body, _ in solids]
        self._moving = frames.numel_out(0) // 12
        coal = load_coal()
        self._solids = [shape.solid() for _, shape in solids]
        self._own = [coal.Transform3s(shape.rotation, shape.position) for _, shape in solids]
        self._coal, self._request = coal, coal.DistanceRequest()
        self._request.enable_signed_distance = False  # takes long where solids overlap

    def proved(self, y: np.ndarray, least: float, needed: np.ndarray) -> np.ndarray | None:
        """See `Collisions.proved`."""
        values, bounds = self._screen(y)
        bounds = bounds.reshape(len(y), -1)
        states, pairs = np.nonzero(bounds < needed)
        order = np.argsort(bounds[states, pairs], kind="stable")
        kept, result, poses = np.ones(len(y), dtype=bool), self._coal.DistanceResult(), {}
        for state, pair in zip(states[order].tolist(), pairs[order].tolist(), strict=True):
            a, b = self._pairs[pair].tolist()
            for solid in (a, b):
                if (state, solid) not in poses:
                    poses[state, solid] = self._pose(values[state], solid)
            result.clear()
            gap = self._coal.distance(
                self._solids[a], poses[state, a], self._solids[b], poses[state, b], self._request, result
            )
            if gap < least or gap <= 0:  # of overlapping solids coal does not say how much they overlap
                return None
            if gap < needed[pair]:
                kept[state] = False
        return kept

    def _pose(self, values: np.ndarray, solid: int) -> object:
        body = self._bodies[solid]
        if body == RESTING:
            return self._own[solid]
        own = values[12 * body : 12 * body + 12]
        return self._coal.Transform3s(own[:9].reshape(3, 3), own[9:]) * self._own[solid]


class _Enclosing:
    """The capsule about a solid, base axes: ends, SX (3,) each, and radius, m; a half space has none."""

    def __init__(self, body: int, shape: Shape, values: cs.SX) -> None:
        self.ends: list[cs.SX] = []
        self.radius = 0.0
        if isinstance(shape, HalfSpace):
            return
        ends, self.radius = enclosing_capsule(shape)
        if body == RESTING:
            self.ends = [cs.SX(end) for end in ends]
            return
        own = values[12 * body : 12 * body + 12]
        turn = cs.reshape(own[:9], 3, 3).T
        self.ends = [own[9:] + turn @ cs.SX(end) for end in ends]


def _planes(shape: Shape) -> np.ndarray | None:
    """Outward normals and levels (f, 4) of a half space or a box: inside is n . p + level <= 0; else None."""
    if isinstance(shape, HalfSpace):
        normal = shape.rotation @ shape.normal
        return np.array([[*-normal, shape.distance + normal @ shape.position]])
    if not isinstance(shape, Box):
        return None
    normals = np.vstack([shape.rotation.T, -shape.rotation.T])
    return np.column_stack([normals, -normals @ shape.position - 0.5 * np.tile(shape.size, 2)])


def _bound(
    capsules: Sequence[_Enclosing], planes: Sequence[np.ndarray | None], first: int, second: int
) -> cs.SX:
    for flat, other in ((first, second), (second, first)):
        own = planes[flat]
        if own is not None and capsules[other].ends:
            heights = [cs.SX(own[:, :3]) @ end + cs.SX(own[:, 3]) for end in capsules[other].ends]
            return cs.mmax(cs.fmin(*heights)) - capsules[other].radius - 1e-8
    one, two = capsules[first], capsules[second]
    return _between(*one.ends, *two.ends) - one.radius - two.radius


def _between(start: cs.SX, end: cs.SX, other: cs.SX, far: cs.SX) -> cs.SX:
    """Distance of two line segments, m, as `distances.between_lines`."""
    along, across, between = end - start, far - other, start - other
    a, b, e = cs.dot(along, along), cs.dot(along, across), cs.dot(across, across)
    c, f = cs.dot(along, between), cs.dot(across, between)
    a, e = cs.fmax(a, _TINY), cs.fmax(e, _TINY)

    def clip(x: cs.SX) -> cs.SX:
        return cs.fmin(cs.fmax(x, 0), 1)

    s = clip((b * f - c * e) / cs.fmax(a * e - b * b, _TINY * a * e))
    t = clip((b * s + f) / e)
    s = clip((b * t - c) / a)
    apart = between + s * along - t * across
    return cs.sqrt(cs.dot(apart, apart))
