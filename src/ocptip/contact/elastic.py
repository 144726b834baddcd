"""Compliant contacts: how contacts with springs share the load on a base that rests on them.

The base moves by a small twist xi; a foot that presses is a spring D along the contact's axes, one that the
motion lifts carries nothing. With W the wrench per contact force, foot motions are W' xi, and K xi = w with K
= sum of W_k D_k W_k' over the feet that press: forces -D W' xi are linear in the wrench w while the same feet
press. On one plane the normal forces are the unique minimiser of the elastic energy (sum of f^2 / 2 k, f >=
0, in balance). That is a strictly convex program, whatever the tangential springs.

Clamps are feet that let go elsewhere: below minus their preload if one jaw yields, never if none does. Their
jaws are rigid, what they hold is the spring. One that lets go exerts its preload.

Friction cones are no part of this: friction utilisation checks them, with these normal forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # subpackages load on first use

from ocptip.contact.bindings.binding import Spring
from ocptip.numerics.vectors import distinct_rows

_ROUNDS = 30
_KEPT = 1e3  # times rounding, by which a lifted foot may be pressed in and a pressed one pull
_SINGULAR = 1e-11
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Shared:
    """Loads shared by springs, for N wrenches.

    Attributes:
        forces: (N, n, d) on the base in contact axes, N; 0 of feet that are lifted.
        pressing: (N, n) True for feet that press.
        maps: (N, n, d, w) derivative of the forces with respect to the wrench while the same feet press.
        deflections: (N, n, d), m, contact axes: by how much the feet are moved; negative along the normal:
            pressed in.
        found: (N,) False where no set of pressing feet carries the load; entries of these loads are NaN.
    """

    forces: np.ndarray
    pressing: np.ndarray
    maps: np.ndarray
    deflections: np.ndarray
    balanced: np.ndarray


class ElasticFeet:
    """The contacts of a support as springs.

    Args:
        wrench_matrix: W (w, n d), wrench about the centre of mass per contact force in contact axes.
        springs: of the n contacts.
        length: of the support, m.

    Attributes:
        springs: as given.
        stiffness: (n, d), N/m, contact axes.
        lowest: (n,), N, normal forces below which contacts let go.
    """

    def __init__(self, wrench_matrix: np.ndarray, springs: Sequence[Spring], length: float) -> None:
        self.springs = tuple(springs)
        self.stiffness = np.array([spring.stiffness for spring in springs])
        self.lowest = np.array([spring.lowest for spring in springs])
        n, d = self.stiffness.shape
        self._unit = np.ones(len(wrench_matrix))
        self._unit[d:] = length
        self.W = wrench_matrix.reshape(len(wrench_matrix), n, d)
        self._maps: dict[bytes, np.ndarray] = {}

    def matrix(self, pressing: np.ndarray | None = None, factors: np.ndarray | None = None) -> np.ndarray:
        """K (w, w): wrench per small twist about the centre of mass, N/m, N, N m.

        Args:
            pressing: (n,) feet that press; default all.
            factors: (n,) of the feet's stiffness, such as damping over stiffness; default 1.
        """
        D = self.stiffness * (1.0 if factors is None else factors[:, None])
        if pressing is not None:
            D = D * pressing[:, None]
        return np.einsum("vkc,kc,wkc->vw", self.W, D, self.W)

    def twist_map(self, pressing: np.ndarray) -> np.ndarray:
        """(w, w): twist of the base per wrench while these feet (n,) press; of minimum norm if some twist is
        free.
        """
        key = np.packbits(pressing).tobytes()
        if key not in self._maps:
            K = self.matrix(pressing) / np.outer(self._unit, self._unit)
            # The pseudo-inverse also serves sets of feet that leave a twist free, which the iteration may
            # visit.
            inverse = np.linalg.pinv(K, rcond=_SINGULAR, hermitian=True)
            self._maps[key] = inverse / np.outer(self._unit, self._unit)
        return self._maps[key]

    @property
    def holds(self) -> bool:
        """Whether the springs resist every motion of the base; castors alone do not."""
        K = self.matrix() / np.outer(self._unit, self._unit)
        return bool(np.linalg.matrix_rank(K, tol=1e-9 * np.trace(K), hermitian=True) == len(K))

    @property
    def normal_map(self) -> np.ndarray:
        """(n, w): normal forces, N, per wrench while all feet press."""
        down = np.einsum("vk,vw->kw", self.W[:, :, 0], self.twist_map(np.ones(len(self.springs), dtype=bool)))
        return -self.stiffness[:, :1] * down

    def share(self, wrenches: np.ndarray) -> Shared:
        """Forces under wrenches (N, w), N and N m, that the base rests under.

        Newton's method on the set of pressing feet. Where it cycles, or ends with too few feet, the set of
        minimum energy is taken, as if all feet had one normal.
        """
        N, n = len(wrenches), len(self.stiffness)
        # The energy is piecewise quadratic in the twist; on each set of pressing feet a Newton step is exact.
        pressing, todo = np.ones((N, n), dtype=bool), np.arange(N)
        scale = np.max(np.abs(self.lowest), initial=0.0, where=np.isfinite(self.lowest))
        tolerance = _ROUNDING * np.max(np.abs(wrenches) / self._unit, axis=1, initial=scale)
        for _ in range(_ROUNDS):
            moved, _ = self._moved(wrenches[todo], pressing[todo])
            press = self._presses(moved, pressing[todo], tolerance[todo])
            changed = np.any(press != pressing[todo], axis=1)
            pressing[todo[changed]] = press[changed]
            todo = todo[changed]
            if not len(todo):
                break
        shared = self._shared(wrenches, pressing, tolerance)
        if shared.balanced.all():
            return shared
        for i in np.flatnonzero(~shared.balanced):
            pressing[i] = self._least(wrenches[i])
        return self._shared(wrenches, pressing, tolerance)

    def _shared(self, wrenches: np.ndarray, pressing: np.ndarray, tolerance: np.ndarray) -> Shared:
        """Forces while these feet (N, n) press, if they do so in balance and the others do not."""
        deflections, maps = self._moved(wrenches, pressing)
        maps = -self.stiffness[:, :, None] * maps * pressing[:, :, None, None]
        forces = -self.stiffness * deflections * pressing[:, :, None]
        forces[:, :, 0] = np.where(pressing, forces[:, :, 0], self.lowest)
        spare = -self.stiffness[:, 0] * deflections[:, :, 0] - self.lowest
        down = spare * np.where(pressing, 1.0, -1.0)
        result = self._balances(forces, wrenches) & np.all(down >= -_KEPT * tolerance[:, None], axis=1)
        for array in (forces, maps, deflections):
            array[~result] = np.nan
        return Shared(forces, pressing, maps, deflections, result)

    def _moved(self, wrenches: np.ndarray, pressing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Motions of the feet (N, n, d), m, and their derivatives (N, n, d, w)."""
        patterns, which = distinct_rows(pressing)
        maps = np.array([np.einsum("vkc,vw->kcw", self.W, self.twist_map(p)) for p in patterns])
        maps = maps[which] if len(patterns) else np.empty((0, *self.W.shape[1:], len(self.W)))
        loads = wrenches + np.where(pressing, 0.0, self.lowest) @ self.W[:, :, 0].T
        return np.einsum("skcw,sw->skc", maps, loads), maps

    def _presses(self, moved: np.ndarray, pressing: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
        """(N, n): feet pressed into the ground; those that neither press nor lift stay what they are."""
        down = -self.stiffness[:, 0] * moved[:, :, 0] - self.lowest
        return np.where(np.abs(down) <= tolerance[:, None], pressing, down > 0)

    def _least(self, wrench: np.ndarray) -> np.ndarray:
        """(n,) feet that press if tangential springs are ignored, by minimum-distance programming (LDP).

        Normal forces are f + M s with gaps s, f if all feet press; s are the multipliers of
        f + M s >= lowest. Lawson, Hanson, Solving Least Squares Problems (1974), chapter 23.
        """
        may_lift, every = np.isfinite(self.lowest), np.ones(len(self.lowest), dtype=bool)
        if not may_lift.any():
            return every
        k, normals = self.stiffness[may_lift, 0], self.W[:, may_lift, 0]
        M = np.diag(k) - k[:, None] * (normals.T @ self.twist_map(every) @ normals) * k
        size, axes = np.linalg.eigh(M)
        f = (self.normal_map @ wrench - self.lowest)[may_lift]
        # M is positive semidefinite: small negative eigenvalues are rounding, and small ones belong to free
        # twists.
        root = axes * np.sqrt(np.maximum(size, 0.0) * (size > _SINGULAR * size[-1]))
        scale = np.max(np.abs(f), initial=np.sqrt(np.finfo(float).tiny))
        gaps, _ = scipy.optimize.nnls(
            np.vstack([root.T / np.sqrt(k.max()), -f / scale]), np.append(np.zeros(len(k)), 1.0)
        )
        every[may_lift] = gaps == 0
        return every

    def _balances(self, forces: np.ndarray, wrenches: np.ndarray) -> np.ndarray:
        """(N,) whether the forces hold the wrenches."""
        rest = (np.einsum("wkc,skc->sw", self.W, forces) + wrenches) / self._unit
        scale = np.max(np.abs(wrenches) / self._unit, axis=1, initial=0.0)
        return np.max(np.abs(rest), axis=1, initial=0.0) <= 1e-6 * scale
