"""Signed distances of pairs of convex solids on moving bodies, with derivatives.

coal finds the nearest points and the direction n between them; a pair that is certainly farther apart than
anybody asks for is answered with a lower bound.

The derivatives are those of min |b - a| over the features (point, edge, face) on which the nearest points
slide: the slope is n . (b - a)' of the points as if fixed to their bodies (envelope theorem), the curvature
is exact as long as the features stay the same; it is that of the solids' cores where these are thickened.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import casadi as cs
import numpy as np

from ocptip.numerics.batch import BatchFunction
from ocptip.robots.collision.bounds import DistanceBounds
from ocptip.robots.collision.gaps import Contact
from ocptip.robots.collision.shapes import Shape
from ocptip.robots.pinocchio import load_coal

RESTING = -1
"""The body that does not move."""

_NEAREST = 2e-3  # m: of nearer (or overlapping) features the curvature is that at this distance
_AT_ONCE = 32  # states: what is computed of so many fits into a cache


class Distances:
    """Distances of pairs of solids on K bodies.

    Args:
        frames: CasADi function of y (ny,): for each moving body its axes, row by row, and its origin, m; one
            column (12 K,).
        solids: body (0 to K - 1, or `RESTING`) and shape.
        pairs: of numbers of solids on different bodies.
    """

    def __init__(
        self,
        frames: cs.Function,
        solids: Sequence[tuple[int, Shape]],
        pairs: Sequence[tuple[int, int]],
    ) -> None:
        y, weights = cs.SX.sym("y", frames.numel_in(0)), cs.SX.sym("weights", frames.numel_out(0))
        values = frames(y)
        self._frames = BatchFunction(frames)
        self._moving = frames.numel_out(0) // 12  # reshape cannot infer it where there are no states
        self._slopes = BatchFunction(cs.Function("slopes", [y], [cs.jacobian(values, y)]))
        bend = cs.hessian(cs.dot(weights, values), y)[0]
        self._bend = BatchFunction(cs.Function("bend", [y, weights], [bend]))
        self._shapes = [shape for _, shape in solids]
        self._bodies = np.array([body for body, _ in solids], dtype=int)
        self._solids = [shape.solid() for shape in self._shapes]
        self._turns = np.array([shape.rotation for shape in self._shapes]).reshape(-1, 3, 3)
        self._shifts = np.array([shape.position for shape in self._shapes]).reshape(-1, 3)
        self._bounds = DistanceBounds(self._shapes, self._bodies)
        self._of(pairs)
        self._coal = load_coal()
        self._own = [self._coal.Transform3s(shape.rotation, shape.position) for shape in self._shapes]
        self._request, self._quick = self._coal.DistanceRequest(), self._coal.DistanceRequest()
        self._request.enable_signed_distance = True
        self._quick.enable_signed_distance = False  # the other takes long where solids overlap

    def _of(self, pairs: Sequence[tuple[int, int]]) -> None:
        self.pairs = tuple(pairs)
        self._both = np.array(self.pairs, dtype=int).reshape(-1, 2)
        self._bounds = self._bounds.of(self._both)

    def of(self, pairs: Sequence[tuple[int, int]]) -> Distances:
        """Distances of other pairs of the same solids."""
        other = copy(self)
        other._of(pairs)
        return other

    def gaps(self, y: np.ndarray, below: float | np.ndarray = np.inf) -> np.ndarray:
        """Signed distances (N, m), m, at y (N, ny).

        Those above `below` (m; one for all, or (m,)) may be lower bounds above it.
        """
        return self.smallest(y, np.arange(len(self.pairs)), below)

    def smallest(self, y: np.ndarray, groups: np.ndarray, below: float | np.ndarray = np.inf) -> np.ndarray:
        """Smallest signed distances (N, g), m, of groups of pairs, at y (N, ny).

        Args:
            y: states.
            groups: (m,) numbers 0 to g - 1, the group of each pair.
            below: m, one for all or (m,) by pair; above it, the answer may be a lower bound that also is.
        """
        order = np.argsort(groups, kind="stable")
        group = groups[order]
        begins = np.flatnonzero(np.diff(group, prepend=-1))
        values = np.empty((len(y), len(begins)))
        for begin in range(0, len(y), _AT_ONCE):
            axes, origins = self._poses(y[begin : begin + _AT_ONCE])
            gaps = self._bounds(axes, origins, below)[:, order]
            near = gaps < np.broadcast_to(below, len(order))[order]
            first = gaps == np.minimum.reduceat(gaps, begins, axis=1)[:, group]
            most = np.inf
            for rows in (near & first, near & ~first):  # then what may be nearer still
                i, k = np.nonzero(rows & (gaps < most))
                gaps[i, k] = self._nearest(axes, origins, i, order[k], points=False).distances
                most = np.minimum.reduceat(np.where(first, gaps, np.inf), begins, axis=1)[:, group]
            values[begin : begin + _AT_ONCE] = np.minimum.reduceat(gaps, begins, axis=1)
        return values

    def proved(self, y: np.ndarray, least: float, needed: np.ndarray) -> np.ndarray | None:
        """See `Collisions.proved`; the first distance below `least` ends it, of the nearest pairs first."""
        axes, origins = self._poses(y)
        bounds = self._bounds(axes, origins, needed)
        states, pairs = np.nonzero(bounds < needed)
        order = np.argsort(bounds[states, pairs], kind="stable")
        kept, result, poses = np.ones(len(y), dtype=bool), self._coal.DistanceResult(), dict[Any, Any]()
        for state, pair in zip(states[order].tolist(), pairs[order].tolist(), strict=True):
            a, b = self.pairs[pair]
            for solid in (a, b):
                if (state, solid) not in poses:
                    position = state, self._bodies[solid]
                    poses[state, solid] = (
                        self._coal.Transform3s(axes[position], origins[position]) * self._own[solid]
                    )
            result.clear()
            gap = self._coal.distance(
                self._solids[a], poses[state, a], self._solids[b], poses[state, b], self._quick, result
            )
            if gap < least or gap <= 0:  # of overlapping solids coal does not say how much they overlap
                return None
            if gap < needed[pair]:
                kept[state] = False
        return kept

    def least(self, y: np.ndarray) -> Contact:
        """The nearest pair at each of N states (as many rows, in their order)."""
        parts = [self._least(y[begin : begin + _AT_ONCE]) for begin in range(0, len(y), _AT_ONCE)]
        results = [replace(part, states=part.states + k * _AT_ONCE) for k, part in enumerate(parts)]
        return _joined(*results) if results else self._least(y)

    def _least(self, y: np.ndarray) -> Contact:
        axes, origins = self._poses(y)
        bounds = self._bounds(axes, origins)
        states = np.arange(len(y))
        best = self._nearest(axes, origins, states, np.argmin(bounds, axis=1))
        values = bounds.copy()
        values[states, best.pairs] = np.inf
        i, k = np.nonzero(values < best.distances[:, None])
        others = self._nearest(axes, origins, i, k)
        every = _joined(best, others)
        order = np.lexsort((every.pairs, every.distances, every.states))
        first = order[np.searchsorted(every.states[order], states)]
        return _chosen(every, first)

    def at(self, y: np.ndarray, states: np.ndarray, pairs: np.ndarray) -> tuple[Contact, np.ndarray]:
        """Nearest points in rows (states[r], pairs[r]), and slopes (r, ny) of their distances over y."""
        used, owner = np.unique(states, return_inverse=True)
        axes, origins = self._poses(y[used])
        contact = self._nearest(axes, origins, owner, pairs)
        apart = self._moved(y[used], axes, origins, contact)[0]
        return replace(contact, states=states), np.einsum("ra,rax->rx", contact.normals, apart)

    def curvature(self, y: np.ndarray, contact: Contact, on: np.ndarray) -> np.ndarray:
        """(N, ny, ny): second derivatives of on . distances ((r,)) by state."""
        every = np.zeros((len(y), y.shape[1], y.shape[1]))
        used, states = np.unique(contact.states, return_inverse=True)
        y, contact = y[used], replace(contact, states=states)
        axes, origins = self._poses(y)
        apart, directions, slide, turned = self._moved(y, axes, origins, contact, features=True)
        weights = np.zeros((len(y), self._frames.function.numel_out(0)))
        for side, sign in ((0, -1.0), (1, 1.0)):
            bodies = self._bodies[self._both[contact.pairs, side]]
            moving = np.flatnonzero(bodies != RESTING)
            ends = contact.normals[moving, :, None] * directions[moving, side, None, :]
            entries = np.concatenate([ends.reshape(-1, 9), contact.normals[moving]], axis=1)
            columns = 12 * bodies[moving, None] + np.arange(12)
            scaled = sign * on[moving, None] * entries
            np.add.at(weights, (contact.states[moving, None], columns), scaled)
        result = self._bend(y, weights)[0].reshape(len(y), y.shape[1], y.shape[1])
        gap = np.maximum(contact.distances + slide.depth, _NEAREST)[:, None, None]
        n = contact.normals
        across = np.eye(3) - n[:, :, None] * n[:, None, :]
        free = across @ slide.along  # (r, 3, 4)
        mixed = turned + np.einsum("rax,ras->rxs", apart, free) / gap
        inner = np.einsum("ras,rat->rst", free, free) / gap
        inner += 1e-6 * np.eye(4) / gap
        rows = np.einsum("rax,rab,rby->rxy", apart, across, apart) / gap
        rows -= np.einsum("rxs,rst,ryt->rxy", mixed, np.linalg.inv(inner), mixed)
        np.add.at(result, contact.states, on[:, None, None] * rows)
        every[used] = result
        return every

    # --- parts ---------------------------------------------------------------------------------------------

    def _poses(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Axes (N, K + 1, 3, 3) and origins (N, K + 1, 3) of the bodies; the last one rests."""
        values = self._frames(y)[0].reshape(len(y), self._moving, 12)
        axes, origins = np.empty((len(y), self._moving + 1, 3, 3)), np.zeros((len(y), self._moving + 1, 3))
        axes[:, :-1], axes[:, -1] = values[..., :9].reshape(len(y), self._moving, 3, 3), np.eye(3)
        origins[:, :-1] = values[..., 9:]
        return axes, origins

    def _nearest(
        self,
        axes: np.ndarray,
        origins: np.ndarray,
        states: np.ndarray,
        pairs: np.ndarray,
        points: bool = True,
    ) -> Contact:
        """Nearest points of some pairs at some states; if not asked for, normals and points are empty."""
        rows, distance = len(states), self._coal.distance
        result = self._coal.DistanceResult()  # of its own: threads may share this object
        distances, values = np.empty(rows), np.empty((rows, 3, 3)) if points else None
        solids = self._both[pairs]
        number = len(self._shapes)
        wanted, which = np.unique(states[:, None] * number + solids, return_inverse=True)
        state, solid = np.divmod(wanted, number)
        turn, origin = axes[state, self._bodies[solid]], origins[state, self._bodies[solid]]
        turns = turn @ self._turns[solid]
        shifts = origin + np.einsum("pab,pb->pa", turn, self._shifts[solid])
        poses = [self._coal.Transform3s(*pose) for pose in zip(turns, shifts, strict=True)]
        both = which.reshape(-1, 2).tolist()
        for r, ((a, b), (p, q)) in enumerate(zip(solids.tolist(), both, strict=True)):
            result.clear()
            distances[r] = distance(
                self._solids[a], poses[p], self._solids[b], poses[q], self._request, result
            )
            if values is not None:
                values[r] = result.normal, result.getNearestPoint1(), result.getNearestPoint2()
        if values is None:
            return Contact(states, pairs, distances)
        return Contact(states, pairs, distances, values[:, 0], values[:, 1:])

    def _moved(
        self,
        y: np.ndarray,
        axes: np.ndarray,
        origins: np.ndarray,
        contact: Contact,
        features: bool = False,
    ) -> tuple:
        """How b - a moves with y, (r, 3, ny), points of the cores taken as fixed to their bodies.

        With features also: these points (r, 2, 3) in their bodies' axes; the features they may slide on; and
        how those turn towards n, (r, ny, 4).
        """
        slopes = self._slopes(y)[0].reshape(len(y), self._moving, 12, y.shape[1])
        rows = len(contact.states)
        apart, directions = np.zeros((rows, 3, y.shape[1])), np.empty((rows, 2, 3))
        along, turned = np.zeros((rows, 3, 4)), np.zeros((rows, y.shape[1], 4))
        depth = np.zeros(rows)
        for side, sign in ((0, -1.0), (1, 1.0)):
            solids = self._both[contact.pairs, side]
            bodies = self._bodies[solids]
            turn = axes[contact.states, bodies]
            points = contact.points[:, side].copy()
            local = np.zeros((rows, 3, 2))
            if features:
                outward = -sign * np.einsum("rab,ra->rb", turn, contact.normals)
                for solid in np.unique(solids):
                    shape, of_it = self._shapes[solid], solids == solid
                    local[of_it] = shape.rotation @ shape.touched(outward[of_it] @ shape.rotation)
                down = np.array([self._shapes[solid].thickness for solid in solids])
                points += sign * down[:, None] * contact.normals
                depth += down
            directions[:, side] = np.einsum("rab,ra->rb", turn, points - origins[contact.states, bodies])
            moving = np.flatnonzero(bodies != RESTING)
            of_body = slopes[contact.states[moving], bodies[moving]]
            of_axes = of_body[:, :9].reshape(len(moving), 3, 3, of_body.shape[-1])
            moved = np.einsum("rabx,rb->rax", of_axes, directions[moving, side]) + of_body[:, 9:]
            apart[moving] += sign * moved
            if features:
                along[:, :, 2 * side : 2 * side + 2] = sign * turn @ local
                towards = np.einsum("rabx,rbs,ra->rxs", of_axes, local[moving], contact.normals[moving])
                turned[moving, :, 2 * side : 2 * side + 2] = sign * towards
        return apart, directions, _Slide(along, depth), turned


@dataclass(frozen=True, eq=False)
class _Slide:
    """Features of both solids: directions (r, 3, 4), and how deep (r,), m, both lie below the surfaces."""

    along: np.ndarray
    depth: np.ndarray


def _joined(*parts: Contact) -> Contact:
    fields = ("states", "pairs", "distances", "normals", "points")
    return Contact(*(np.concatenate([getattr(part, f) for part in parts]) for f in fields))


def _chosen(contact: Contact, rows: np.ndarray) -> Contact:
    fields = ("states", "pairs", "distances", "normals", "points")
    return Contact(*(getattr(contact, f)[rows] for f in fields))
