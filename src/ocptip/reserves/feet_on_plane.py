"""Ordinary contacts on one plane: how equally compliant ones share a load, and the minimum friction used.

For given normal forces the minimum use of the friction is a problem in three dimensions (`planar`). Where
normal forces can shift, the minimum over all of them follows by `coplanar`, which begins there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ocptip.contact.bindings.laws import carries
from ocptip.contact.support import Support
from ocptip.numerics.jit.compiled import compiled
from ocptip.reserves.coplanar import grow
from ocptip.reserves.equal_compliance import equal_normal_map
from ocptip.reserves.force_sets import ForceSets, FreeForces
from ocptip.reserves.minimax import GAP_TOLERANCE, ZERO_USAGE
from ocptip.reserves.planar import solve_planar
from ocptip.reserves.tipping import TipOver

_LEAST_FORCE = 1e-6  # of the sum: normal forces of equally compliant feet that count as pressed
_SURE = 1e-9  # relative: between the bounds of the usage


@dataclass(frozen=True, eq=False)
class SharedLoads:
    """The sharing of loads by n feet; NaN where it is not certain, or a foot lifts.

    Attributes:
        usage: (N,) the minimum share of the friction with which contacts hold the base.
        normal_forces: (N, n) N, of equally compliant feet.
        friction_used: (N, n) shares of the friction with these; 0 without friction.
    """

    usage: np.ndarray
    normal_forces: np.ndarray
    friction_used: np.ndarray


class FeetOnPlane:
    """Three ordinary contacts or more on one plane, two of them or more with friction.

    Args:
        support: the base on them; see :func:`feet_on_plane`.
        sets: their force sets.
        J, balances: complements of the free tangential forces, and of all, see `FreeForces.basis`.

    Attributes:
        unique: normal forces follow from the load.
    """

    def __init__(self, support: Support, sets: ForceSets, J: np.ndarray, balances: np.ndarray) -> None:
        carrying = support.wrench_matrix * carries(support.contacts).ravel()
        forces = -np.linalg.pinv(carrying).reshape(-1, 3, 6)  # one way to hold each wrench
        self._rough = ~sets.frictionless
        self._friction = np.where(self._rough, sets.friction, 1.0)
        self._J = np.ascontiguousarray(J)
        self._load = np.einsum("ikr,ikw->rw", J, forces[self._rough, 1:])
        self._cones = balances[None].copy()
        self._cones[0, :, 0] /= self._friction[:, None]
        self._fixed = np.einsum("ir,iw->rw", balances[:, 0], forces[:, 0])
        self._growing = np.einsum("ikr,ikw->rw", balances[:, 1:], forces[:, 1:])
        equal = equal_normal_map(support)
        self.unique = equal is None
        self._equal = np.ascontiguousarray(forces[:, 0] if equal is None else equal)

    def share(self, wrenches: np.ndarray) -> SharedLoads:
        """Shared loads under wrenches (N, 6) on the base, N and N m."""
        count, n = len(wrenches), len(self._equal)
        usage, forces, used = np.full(count, np.nan), np.empty((count, n)), np.zeros((count, n))
        _share_all(
            *(np.ascontiguousarray(wrenches), self._equal, self._load, self._friction, self._J, self._rough),
            *(self._cones, self._fixed, self._growing, self.unique, usage, forces, used),
        )
        return SharedLoads(usage, forces, used)


@lru_cache(maxsize=8)
def feet_on_plane(support: Support) -> FeetOnPlane | None:
    """The feet of a support; None if it stands on something else, or on feet with declared springs."""
    if support.dimension != 3 or support.elastic or not TipOver(support, 1.0).on_polygon:
        return None
    sets, every = ForceSets(support), np.ones(support.n_contacts, dtype=bool)
    free = FreeForces(support, sets)
    (_, _, J), (_, _, balances) = free.basis(every, False), free.basis(every, True)
    # The grip is 1 unless friction makes tangential forces too small beside normal ones.
    if J is None or balances is None or np.any(sets.grip < 1):
        return None
    return FeetOnPlane(support, sets, J, balances)


@compiled
def _share_all(wrenches, equal, load, friction, J, rough, cones, fixed, growing, unique, usage, forces, used):
    """Puts usages (N,), normal forces and shares (N, n) of wrenches (N, 6)."""
    n, m, r = len(equal), len(J), cones.shape[3]
    h, limit, held, pulls = np.empty((1, 3)), np.empty((1, m)), np.empty((1, m, 2)), np.empty((1, m, 2))
    bases, start, kept, grows = J.reshape(1, m, 2, 3), np.empty((1, n)), np.empty((1, r)), np.empty((1, r))
    s, x, y = np.empty(1), np.empty((1, n, 3)), np.empty((1, r))
    for k in range(len(wrenches)):
        total, least = 0.0, np.inf
        for i in range(n):
            force = _product(equal[i], wrenches[k])
            forces[k, i] = force
            total += abs(force)
            least = min(least, force)
        most, power, sure = 0.0, 0.0, least > _LEAST_FORCE * total
        if sure:
            place = 0
            for i in range(n):
                start[0, i] = friction[i] * forces[k, i] / total
                if rough[i]:
                    limit[0, place] = start[0, i]
                    held[0, place, 0] = held[0, place, 1] = pulls[0, place, 0] = pulls[0, place, 1] = 0.0
                    place += 1
            for c in range(3):
                h[0, c] = _product(load[c], wrenches[k]) / total
            solve_planar(h, limit, bases, held, pulls)
            place = 0
            for i in range(n):
                if rough[i]:
                    a, b, p, q = held[0, place, 0], held[0, place, 1], pulls[0, place, 0], pulls[0, place, 1]
                    used[k, i] = np.sqrt(a * a + b * b) / limit[0, place]
                    most = max(most, used[k, i])
                    # of the load, where the power of the friction is 1
                    for c in range(3):
                        power += h[0, c] * (J[place, 0, c] * p + J[place, 1, c] * q)
                    place += 1
            sure = most - power <= GAP_TOLERANCE * max(1.0, most)
        if not sure:
            for i in range(n):
                forces[k, i] = used[k, i] = np.nan
            continue
        usage[k] = most
        if unique or most <= ZERO_USAGE:
            continue
        for c in range(r):
            kept[0, c] = _product(fixed[c], wrenches[k]) / total
            grows[0, c] = _product(growing[c], wrenches[k]) / (total * most)
        s[0] = np.nan
        grow(cones, kept, grows, start, s, x, y)  # from the limits of equally compliant feet
        bound = 0.0
        for c in range(r):
            bound += kept[0, c] * y[0, c]
        usage[k] = most / s[0] if abs(bound - s[0]) <= _SURE * s[0] else np.nan


@compiled
def _product(row, wrench):
    value = 0.0
    for c in range(6):
        value += row[c] * wrench[c]
    return value
