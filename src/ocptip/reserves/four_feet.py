"""Four ordinary contacts on one plane: how equally compliant ones share a load, and the minimum friction
used.

The normal forces of four contacts can shift along one direction: N = N0 + s d, all >= 0, is a segment. For
given normal forces the minimum usage of the friction t(s) is a problem in three dimensions (`planar`). 1 / t
is concave in s: it is the smallest, over planar motions u, of the friction's power sum mu_i N_i |J_i u|
divided by the power h . u of the load. The slope of the friction's power at the best motion says on which
side the optimum lies: at an end of the segment, or between, where the slope vanishes (Illinois method). The
value is certain where it meets the lower bound that its motion gives: the load's power over the larger one of
the friction's powers at both ends. That replaces a cone program per state by a few planar problems.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ocptip.contact.support import Support
from ocptip.numerics.jit.compiled import compiled
from ocptip.reserves.equal_compliance import equal_normal_map
from ocptip.reserves.force_sets import ForceSets
from ocptip.reserves.planar import solve_planar
from ocptip.reserves.tipping import TipOver

_LEAST_FRICTION = 1e-2  # smaller coefficients make tangential forces too small beside normal ones
_INSIDE = 1e-8  # of the segment: a contact without load has no limit to compare its force with
_LEAST_FORCE = 1e-6  # of the sum: normal forces of equally compliant feet that count as pressed
_SURE = 1e-7  # between the bounds of the usage, as for the cone program
_STEPS = 60


@dataclass(frozen=True, eq=False)
class SharedLoads:
    """The sharing of loads by four feet; NaN where it is not certain, or a foot lifts.

    Attributes:
        usage: (N,) the minimum share of the friction with which contacts hold the base.
        normal_forces: (N, 4) N, of equally compliant feet.
        friction_used: (N, 4) shares of the friction with these.
    """

    usage: np.ndarray
    normal_forces: np.ndarray
    friction_used: np.ndarray


class FourFeet:
    """Four ordinary contacts with friction on one plane.

    Args:
        support: the base on them; see :func:`four_feet`.
    """

    def __init__(self, support: Support) -> None:
        scaling = np.repeat([1.0, 1.0 / support.length], 3)
        matrix = (scaling[:, None] * support.wrench_matrix).reshape(6, 4, 3)
        forces = -np.linalg.pinv(support.wrench_matrix).reshape(4, 3, 6)
        self._J = np.linalg.svd(matrix[:, :, 1:].reshape(6, 8))[2][:3].T.reshape(4, 2, 3).copy()
        self._loads = np.einsum("ikr,ikw->rw", self._J, forces[:, 1:])
        self._normals = forces[:, 0].copy()
        self._shift = np.linalg.svd(matrix[:, :, 0])[2][-1].copy()
        self._friction = ForceSets(support).friction
        equal = equal_normal_map(support)
        assert equal is not None  # such contacts can share loads in several ways
        self._equal = np.ascontiguousarray(equal)

    def share(self, wrenches: np.ndarray) -> SharedLoads:
        """Shared loads under wrenches (N, 6) on the base, N and N m."""
        count = len(wrenches)
        shared_loads = SharedLoads(*(np.full((count, *shape), np.nan) for shape in ((), (4,), (4,))))
        given = np.ascontiguousarray(wrenches), self._loads, self._normals, self._shift, self._friction
        _share_all(
            *given,
            self._J,
            self._equal,
            shared_loads.usage,
            shared_loads.normal_forces,
            shared_loads.friction_used,
        )
        return shared_loads


@lru_cache(maxsize=8)
def four_feet(support: Support) -> FourFeet | None:
    """The four feet of a support; None if it stands on something else, or on feet with declared springs."""
    if support.dimension != 3 or support.n_contacts != 4 or support.elastic:
        return None
    sets = ForceSets(support)
    if not sets.ordinary or np.min(sets.friction) < _LEAST_FRICTION or equal_normal_map(support) is None:
        return None
    return FourFeet(support) if TipOver(support, 1.0).on_polygon else None


@compiled
def _share_all(wrenches, maps, normals, shift, friction, J, equal, usage, forces, used):
    """Puts usages (N,), normal forces and shares (N, 4) of wrenches (N, 6)."""
    h, limit = np.empty((1, 3)), np.empty((1, 4))
    held, pulls, bases = np.zeros((1, 4, 2)), np.zeros((1, 4, 2)), J.reshape(1, 4, 2, 3)
    start, one, other = np.empty(4), np.empty(4), np.empty(4)
    for k in range(len(wrenches)):
        for r in range(3):
            h[0, r] = 0.0
            for c in range(6):
                h[0, r] += maps[r, c] * wrenches[k, c]
        low, high, total, least = -np.inf, np.inf, 0.0, np.inf
        for i in range(4):
            start[i] = 0.0
            forces[k, i] = 0.0
            for c in range(6):
                start[i] += normals[i, c] * wrenches[k, c]
                forces[k, i] += equal[i, c] * wrenches[k, c]
            total += abs(forces[k, i])
            least = min(least, forces[k, i])
            if shift[i] > 0:
                low = max(low, -start[i] / shift[i])
            elif shift[i] < 0:
                high = min(high, -start[i] / shift[i])
        if not (least > _LEAST_FORCE * total and high > low):
            for i in range(4):
                forces[k, i] = np.nan
            continue
        for i in range(4):
            one[i], other[i] = start[i] + low * shift[i], start[i] + high * shift[i]
            limit[0, i] = friction[i] * forces[k, i]
        upper, lower = _planar(h, limit, bases, held, pulls, friction, forces[k], forces[k], J)
        if not upper - lower <= _SURE * max(1.0, upper):
            for i in range(4):
                forces[k, i] = np.nan
            continue
        for i in range(4):
            used[k, i] = np.sqrt(held[0, i, 0] ** 2 + held[0, i, 1] ** 2) / limit[0, i]
        usage[k] = _least(h, low, high, start, shift, friction, one, other, J, bases, limit, held, pulls)


@compiled
def _least(h, low, high, start, shift, friction, one, other, J, bases, limit, held, pulls):
    """The minimum usage over the segment of normal forces; NaN where it is not certain."""
    # The ends of the segment unload a contact, whose limit would be 0: the search stays a little inside.
    inside = _INSIDE * (high - low)
    left, right, value = low + inside, high - inside, low + inside
    slope_left, slope_right, side = 0.0, 0.0, 0
    for step in range(_STEPS):
        for i in range(4):
            limit[0, i] = friction[i] * (start[i] + value * shift[i])
        upper, lower = _planar(h, limit, bases, held, pulls, friction, one, other, J)
        if upper - lower <= _SURE * max(1.0, upper):
            return upper
        slope = 0.0  # of the friction's power
        for i in range(4):
            slope += friction[i] * shift[i] * np.sqrt(pulls[0, i, 0] ** 2 + pulls[0, i, 1] ** 2)
        if step == 0:
            if slope <= 0:
                break
            slope_left, value = slope, right
            continue
        if step == 1:
            if slope >= 0:
                break
            slope_right = slope
        # Illinois method: halving the slope of an end that stays twice keeps the steps from creeping to one
        # side.
        elif slope > 0:
            left, slope_left = value, slope
            if side == 1:
                slope_right *= 0.5
            side = 1
        else:
            right, slope_right = value, slope
            if side == -1:
                slope_left *= 0.5
            side = -1
        value = (left * slope_right - right * slope_left) / (slope_right - slope_left)
    return np.nan


@compiled
def _planar(h, limit, bases, held, pulls, friction, one, other, J):
    """The minimum usage with these limits, and the bound of its motion for two sets of normal forces."""
    for i in range(4):
        held[0, i, 0] = held[0, i, 1] = pulls[0, i, 0] = pulls[0, i, 1] = 0.0
    solve_planar(h, limit, bases, held, pulls)
    upper, power, first, second = 0.0, 0.0, 0.0, 0.0
    for i in range(4):
        x, y = held[0, i, 0], held[0, i, 1]
        upper = max(upper, np.sqrt(x * x + y * y) / limit[0, i])
        x, y = pulls[0, i, 0], pulls[0, i, 1]
        speed = np.sqrt(x * x + y * y)
        first += friction[i] * one[i] * speed
        second += friction[i] * other[i] * speed
        for r in range(3):
            power += h[0, r] * (J[i, 0, r] * x + J[i, 1, r] * y)
    # The friction's power is linear in the normal forces, so over the segment its maximum is at an end: with
    # it the bound holds for every sharing.
    most = max(first, second)
    return upper, power / most if most > 0 else 0.0
