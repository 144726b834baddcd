"""Estimates of GN and GT for many wrenches at once, without the contact solver.

Lower bounds of friction utilisation GT. Let the base slide with a velocity v and turn with a rate w about the
common normal of its contacts. Then friction takes at most the power sum mu_i N_i |v + w x p_i|, for all
normal forces N_i that hold the base up. So the power of the wrench over the largest of these sums is no more
than GT, and its largest value over all (v, w) is GT (duality: what cones with a share of their friction can
hold is convex). The sum is linear in the normal forces, so it is largest where three contacts carry all.

Fast estimates of GN and GT of feet on uneven ground, for many places at once: the search ranks thousands of
places with different contacts; the contact solver and the cone programs would take minutes. They check what
the search returns.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support

_PARALLEL = 1e-9
_MOST = 8  # contacts: of more only v along the force is looked at, with all weight on the roughest contact
_DIRECTIONS, _ROUNDS = 4, 5  # of half a turn each; how often the best is looked for around it
_LEAST = 1e-3  # of what friction could take at most, else rounding decides


class LeastSlip:
    """Lower bounds of GT of ordinary contacts with the same normal; zero for others.

    Args:
        support: the contacts, with centre of mass.
    """

    def __init__(self, support: Support) -> None:
        contacts, frames = support.contacts, support.frames
        self.known = all(isinstance(c, UnilateralContact) for c in contacts) and bool(
            np.ptp(frames[:, :, 0], axis=0).max() <= _PARALLEL
        )
        if not self.known:
            return
        self.axes = frames[0].T  # rows: normal, tangents
        self.friction = np.array([float(c.friction) for c in contacts])  # pyright: ignore
        self.height, *places = (
            self.axes @ (np.array([c.position for c in contacts]) - support.center_of_mass).T
        )
        self.places = np.array(places)  # (2, n)
        self.radius = max(float(np.sqrt(np.mean(self.places**2) * 2)), np.finfo(float).tiny)
        self.held = np.vstack([np.ones(len(contacts)), self.places[1], -self.places[0]])
        flat = np.ptp(self.height) <= _PARALLEL * support.length and len(contacts) <= _MOST
        triples = combinations(range(len(contacts)), 3) if flat else ()
        size = abs(np.linalg.det(self.held @ self.held.T)) ** 0.5
        self.triples = [t for t in map(list, triples) if abs(np.linalg.det(self.held[:, t])) > 1e-9 * size]

    def __call__(self, wrenches: np.ndarray) -> np.ndarray:
        """(N,) under wrenches (N, 6), N and N m, on the base about its centre of mass."""
        if not self.known:
            return np.zeros(len(wrenches))
        forces, moments = wrenches[:, :3] @ self.axes.T, wrenches[:, 3:] @ self.axes.T
        pressed, pull = np.maximum(-forces[:, 0], 0.0), -forces[:, 1:]
        size = np.linalg.norm(pull, axis=1)
        along = size / np.maximum(self.friction.max() * pressed, np.finfo(float).tiny)
        least = np.where(pressed > 0, along, 0.0)
        normals = self._normals(pressed, moments, pull)
        some = np.flatnonzero(np.any([np.isfinite(n[:, 0]) for n in normals], axis=0)) if normals else []
        if len(some):
            result = self._sliding(pull[some], -moments[some, 0], pressed[some], [n[some] for n in normals])
            least[some] = np.maximum(least[some], result)
        return least

    def _normals(self, pressed: np.ndarray, moments: np.ndarray, pull: np.ndarray) -> list[np.ndarray]:
        """Per triple its normal forces (N, 3) that hold the base, N; -inf where they would have to pull."""
        if not self.triples:
            return []
        height = float(np.mean(self.height))
        right = np.column_stack(
            [pressed, -moments[:, 1] + height * pull[:, 1], -moments[:, 2] - height * pull[:, 0]]
        )
        normals = [right @ np.linalg.inv(self.held[:, t]).T for t in self.triples]
        return [np.where(np.all(n >= -1e-9 * pressed[:, None], axis=1)[:, None], n, -np.inf) for n in normals]

    def _sliding(
        self, pull: np.ndarray, turn: np.ndarray, pressed: np.ndarray, normals: list[np.ndarray]
    ) -> np.ndarray:
        """Largest power over that of friction, of directions of sliding and rates of turning."""
        presses = [np.isfinite(n[:, 0]) for n in normals]
        normals = [np.where(press[:, None], n, 0.0) for press, n in zip(presses, normals, strict=True)]
        heading = np.arctan2(pull[:, 1], pull[:, 0])
        best, velocities = np.zeros(len(pull)), np.zeros((2, len(pull)))

        def evaluate(angles: np.ndarray) -> None:
            ahead, turned = heading + angles[0], angles[1]
            v, w = np.array([np.cos(ahead), np.sin(ahead)]) * np.cos(turned), np.sin(turned) / self.radius
            x, y = self.places[:, :, None]
            speeds = self.friction[:, None] * np.hypot(v[0] - w * y, v[1] + w * x)
            pairs = zip(presses, normals, self.triples, strict=True)
            taken = [np.where(allowed, np.sum(n.T * speeds[t], axis=0), -np.inf) for allowed, n, t in pairs]
            most = np.max(taken, axis=0)
            power = np.sum(pull.T * v, axis=0) + turn * w
            share = power / np.maximum(most, _LEAST * pressed * speeds.max(axis=0))
            better = share > best
            best[better], velocities[:, better] = share[better], angles[:, better]

        turns = np.linspace(-np.pi / 2, np.pi / 2, _DIRECTIONS, endpoint=False)
        for a in turns:
            for b in turns:
                evaluate(np.tile([[a], [b]], len(pull)))
        step = turns[1] - turns[0]
        for _ in range(_ROUNDS):
            step /= 2
            middle = velocities.copy()
            for side in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                evaluate(middle + step * np.array(side)[:, None])
        return best


NOT_HELD = 10.0
"""Value of GT where no forces hold the base."""

ROUNDS = 6
_PRESSING = 1e-2  # cost of normal forces relative to tangential ones
_TINY = 1e-12


def edge_moments(
    wrenches: np.ndarray, contacts: np.ndarray, pairs: np.ndarray, center_of_mass: np.ndarray
) -> np.ndarray:
    """Moments (N, M, axes), N m, that press the base down about lines through two contacts each.

    The addable moments (`reserves.tip_moments`) of axes that tip before friction ends.

    Args:
        wrenches: (N, M, 6), N and N m, on the base about its centre of mass.
        contacts: (N, n, 3), m.
        pairs: (axes, 2) numbers of the contacts on each axis.
        center_of_mass: (3,), m.
    """
    first, second = contacts[:, pairs[:, 0]], contacts[:, pairs[:, 1]]
    axes = second - first
    axes = axes / np.linalg.norm(axes, axis=2, keepdims=True)
    twists = np.concatenate([np.cross(axes, center_of_mass - first), axes], axis=2)
    return -np.einsum("nmw,naw->nma", wrenches, twists)


def friction_shares(
    wrenches: np.ndarray, contacts: np.ndarray, frames: np.ndarray, support: Support, rounds: int = ROUNDS
) -> np.ndarray:
    """Upper bounds (N, M) of GT; `NOT_HELD` where no pressing contact forces hold the base.

    Least squares of tangential forces over friction limits, weighted again in every round by how much each
    contact uses (Lawson's method for the minimax).

    Args:
        wrenches: (N, M, 6), N and N m, on the base about its centre of mass.
        contacts, frames: (N, n, 3), m, and (N, n, 3, 3) in base axes.
        support: with centre of mass and ordinary contacts, of which the friction counts.
        rounds: how often forces are weighted again.
    """
    N, M = wrenches.shape[:2]
    n, friction = contacts.shape[1], np.array([c.friction for c in support.contacts])  # pyright: ignore
    arms = contacts - support.center_of_mass
    moments = np.cross(arms[:, :, None], frames.transpose(0, 1, 3, 2)).transpose(0, 1, 3, 2)
    blocks = np.concatenate([frames, moments / support.length], axis=2)  # (N, n, 6, 3)
    G = blocks.transpose(0, 2, 1, 3).reshape(N, 1, 6, 3 * n)
    w = wrenches * np.r_[1, 1, 1, np.full(3, 1 / support.length)]
    size = np.maximum(np.linalg.norm(w[:, :, :3], axis=2) / n, _TINY)
    normal, weights = np.repeat(size[:, :, None], n, axis=2), np.full((N, M, n), 1 / n)
    best = np.full((N, M), NOT_HELD)
    rough = np.maximum(friction, _TINY)
    for _ in range(rounds):
        friction_limits = rough * np.maximum(normal, 1e-2 * size[:, :, None])
        cheap = np.empty((N, M, n, 3))  # inverse costs
        cheap[:, :, :, 0] = (size**2)[:, :, None] / _PRESSING
        cheap[:, :, :, 1:] = np.where(friction > 0, friction_limits**2 / np.maximum(weights, 1e-6), 0.0)[
            ..., None
        ]
        scaled = G * cheap.reshape(N, M, 1, 3 * n)
        matrix = scaled @ G.transpose(0, 1, 3, 2)
        matrix = matrix + 1e-12 * np.trace(matrix, axis1=2, axis2=3)[:, :, None, None] * np.eye(6)
        forces = -(scaled.transpose(0, 1, 3, 2) @ np.linalg.solve(matrix, w[..., None]))[..., 0]
        forces = forces.reshape(N, M, n, 3)
        normal, along = forces[..., 0], np.linalg.norm(forces[..., 1:], axis=3)
        used = along / np.maximum(rough * normal, _TINY * size[:, :, None])
        used = np.where((along > 0) | (normal < 0), used, 0.0)
        largest = np.max(used, axis=2)
        holds = np.all(normal >= 0, axis=2)
        best = np.where(holds, np.minimum(best, largest), best)
        weights = weights * np.clip(used, 1e-3, NOT_HELD)
        weights = weights / np.sum(weights, axis=2, keepdims=True)
    return best
