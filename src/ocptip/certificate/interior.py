"""Contact forces well inside their sets: what is interpolated between them stays inside."""

from __future__ import annotations

from typing import Any

import clarabel
import numpy as np

from ocptip.contact.support import Support
from ocptip.numerics.cone_program import quiet_settings, solve_cones
from ocptip.reserves.force_sets import ForceSets

_SHARES = np.array([0.0, 1e-4, 1e-3, 0.01, 0.03, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0])
_LEAST = 0.3  # of the mean normal force: what every contact is to carry if it can
_ROUNDS = 40
_NEXT_TO_NOTHING = 1e-6  # of the largest force
_SMALL = 1e-5  # of the largest force: what is nearer to an end of its set is looked for by a cone program
_REGULAR = 1e-14
_TANGENTIAL = np.array([False, True, True])


class Interior:
    """Moves forces that hold a wrench with minimum friction away from the ends of their sets.

    Args:
        support: the base on its contacts.
    """

    def __init__(self, support: Support) -> None:
        self._sets = ForceSets(support)
        self._matrix = support.wrench_matrix
        self._scaling = np.array([1.0] * 3 + [1 / support.length] * 3)

    def between(self, forces: np.ndarray, wrenches: np.ndarray, share: float | np.ndarray) -> np.ndarray:
        """Forces (N, n, 3) that hold the same wrenches (N, 6), far inside a share, or shares (N,), of their
        sets."""
        other, share = self._spread(forces, wrenches), np.broadcast_to(share, len(forces))[:, None]
        best, chosen = np.full(len(forces), -np.inf), forces
        for part in _SHARES:
            mixed = (1 - part) * forces + part * other
            margin = self._margin(mixed, share)
            better = margin > best + 1e-12
            chosen = np.where(better[:, None, None], mixed, chosen)
            best = np.where(better, margin, best)
        size = np.max(np.abs(forces), axis=(1, 2))
        for row in np.flatnonzero(best < _SMALL * size):
            result = self._deepest(chosen[row], wrenches[row], float(share[row, 0]))
            if result is not None and self._margin(result[None], share[row : row + 1])[0] > best[row]:
                chosen[row] = result
        return chosen

    def _deepest(self, forces: np.ndarray, wrench: np.ndarray, share: float) -> np.ndarray | None:
        """Forces (n, 3) that hold a wrench (6,) as far inside their sets as possible; None: not solved.

        Normal forces keep a distance t from their ends, tangential ones the friction of t newtons less.
        """
        normal, count = forces[None, :, 0], len(forces)
        limits = self._sets.limits(normal, np.max(np.abs(forces), axis=(0, 1), keepdims=True)[:, 0] + 1e-300)
        low, high, radius, slope = (
            getattr(limits, key)[0] for key in ("normal_min", "normal_max", "radius", "slope")
        )
        unit = np.max(np.abs(forces)) + 1e-300  # N
        rubs, last = ~self._sets.frictionless, np.eye(3 * count + 1)[-1]
        rows = [np.hstack([self._scaling[:, None] * self._matrix, np.zeros((6, 1))])]
        numbers = [-self._scaling * wrench / unit]
        rows.append(np.eye(3 * count + 1)[:-1].reshape(count, 3, -1)[~rubs][:, 1:].reshape(-1, 3 * count + 1))
        numbers.append(np.zeros(len(rows[1])))
        cones: list[Any] = [clarabel.ZeroConeT(6 + len(rows[1]))]
        normals = np.eye(3 * count + 1)[: 3 * count : 3]
        for end, sign in ((low, -1.0), (high, 1.0)):
            known = np.isfinite(end)
            rows.append(sign * normals[known] + last)
            numbers.append(sign * end[known] / unit)
        rows.append(last[None])  # of contacts without ends
        numbers.append(np.ones(1))
        cones.append(clarabel.NonnegativeConeT(sum(map(len, numbers[2:]))))
        for k in np.flatnonzero(rubs):
            tangential = -np.eye(3 * count + 1)[3 * k + 1 : 3 * k + 3]
            rows.append(
                np.vstack([-share * slope[k] * normals[k] + share * max(slope[k], 0.1) * last, tangential])
            )
            numbers.append(np.array([share * radius[k] / unit, 0.0, 0.0]))
            cones.append(clarabel.SecondOrderConeT(3))
        result = solve_cones(-last, np.vstack(rows), np.concatenate(numbers), cones, quiet_settings(1e-10))
        solved = result.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
        return unit * np.array(result.x[:-1]).reshape(count, 3) if solved else None

    def without(self, forces: np.ndarray, wrenches: np.ndarray) -> np.ndarray:
        """Forces without those of contacts that carry next to nothing; the others hold the wrench."""
        size = np.max(np.abs(forces), axis=(1, 2), keepdims=True)
        loaded = np.max(np.abs(forces), axis=2, keepdims=True) > _NEXT_TO_NOTHING * size
        kept = np.where(loaded, forces, 0.0)
        return self._balanced(kept, wrenches, np.broadcast_to(loaded, forces.shape).astype(float))

    def _margin(self, forces: np.ndarray, share: np.ndarray) -> np.ndarray:
        normal, size = forces[:, :, 0], np.max(np.abs(forces), axis=(1, 2)) + 1e-300
        limits = self._sets.limits(normal, size)
        ends = np.minimum(normal - limits.normal_min, limits.normal_max - normal)
        friction = share * (limits.radius + limits.slope * normal) - np.linalg.norm(forces[:, :, 1:], axis=2)
        return np.min(np.minimum(ends, np.where(self._sets.frictionless, np.inf, friction)), axis=1)

    def _spread(self, forces: np.ndarray, wrenches: np.ndarray) -> np.ndarray:
        """Normal forces that all press, tangential ones in proportion to them."""
        total = np.maximum(np.sum(np.maximum(forces[:, :, 0], 0.0), axis=1, keepdims=True), 1e-9)
        least = _LEAST * total / forces.shape[1]
        values = forces.copy()
        for _ in range(_ROUNDS):
            values[:, :, 0] = np.maximum(values[:, :, 0], least)
            weight = np.concatenate(
                [np.ones_like(values[:, :, :1]), np.repeat(values[:, :, :1] / total[:, None], 2, 2)], 2
            )
            weight = np.maximum(weight, 1e-6)
            values = self._balanced(values, wrenches, weight)
        return values

    def _balanced(self, forces: np.ndarray, wrenches: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Forces nearest by weight that hold the wrenches."""
        G = (self._scaling[:, None] * self._matrix).reshape(6, -1, 3)
        weight = weight * np.where(self._sets.frictionless[:, None] & _TANGENTIAL, 0.0, 1.0)
        rest = np.einsum("wkc,Nkc->Nw", G, forces) + wrenches * self._scaling
        A = np.einsum("wkc,Nkc,vkc->Nwv", G, weight, G)
        A = A + _REGULAR * np.trace(A, axis1=1, axis2=2)[:, None, None] * np.eye(6)
        return forces - weight * np.einsum("wkc,Nw->Nkc", G, np.linalg.solve(A, rest[..., None])[..., 0])
