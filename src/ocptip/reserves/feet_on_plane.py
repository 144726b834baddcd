"""Ordinary contacts on one plane: how equally compliant ones share a load, and the minimum friction used.

Normal forces of more than three contacts can shift: they are any mean of vertices, in each of which three
contacts carry the load. For given normal forces the minimum usage t of the friction is a problem in three
dimensions (`planar`). 1 / t is concave in the normal forces: it is the smallest, over planar motions u, of
the friction's power sum mu_i N_i |J_i u| divided by the power h . u of the load. At an optimum a mean of at
most three vertices suffices, as u has two degrees of freedom. It is searched for in triangles of vertices;
the slope of the friction's power at the best motion says which way to go. A value is certain where it meets
the lower bound of its motion: the load's power over the largest of the friction's powers at all vertices.
That replaces a cone program per state by some planar problems.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from ocptip.contact.support import Support
from ocptip.numerics.jit.compiled import compiled
from ocptip.reserves.equal_compliance import equal_normal_map
from ocptip.reserves.force_sets import ForceSets
from ocptip.reserves.planar import solve_planar
from ocptip.reserves.tipping import TipOver

_MOST = 8  # contacts: of more there are too many vertices
_LEAST_FRICTION = 1e-2  # smaller coefficients make tangential forces too small beside normal ones
_INSIDE = 1e-9  # share of equal normal forces in a vertex: a contact without load has no limit
_LEAST_FORCE = 1e-6  # of the sum: normal forces of equally compliant feet that count as pressed
_SURE, _CLOSE = 1e-7, 1e-9  # between the bounds of the usage: of what counts; where the search ends
_RANK_TOLERANCE = 1e-6
_ROUNDING = 1e-12
_STEPS, _TRIANGLES = 60, 12


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
    """Three to eight ordinary contacts on one plane, two of them or more with friction.

    Args:
        support: the base on them; see :func:`feet_on_plane`.

    Attributes:
        unique: normal forces follow from the load.
    """

    def __init__(self, support: Support) -> None:
        friction, n = ForceSets(support).friction, support.n_contacts
        self._order = np.argsort(friction == 0, kind="stable")  # those with friction first
        rough = self._order[: np.count_nonzero(friction)]
        scaling = np.repeat([1.0, 1.0 / support.length], 3)
        matrix = (scaling[:, None] * support.wrench_matrix).reshape(6, n, 3)[:, self._order]
        forces = -np.linalg.pinv(matrix.reshape(6, 3 * n)).reshape(n, 3, 6) * scaling
        sliding = matrix[:, : len(rough), 1:].reshape(6, -1)
        self._friction = friction[rough]
        self._J = np.linalg.svd(sliding)[2][:3].T.reshape(-1, 2, 3).copy()
        pressing = matrix[:, :, 0]
        # Tangential forces balance apart from normal ones; of both the shortest ones give the load.
        held = np.linalg.pinv(sliding) @ matrix[:, :, 1:].reshape(6, -1) @ forces[:, 1:].reshape(-1, 6)
        self._loads = np.einsum("ikr,ikw->rw", self._J, held.reshape(-1, 2, 6))
        vertices = []
        for three in map(list, combinations(range(n), 3)):
            inverse = np.linalg.pinv(pressing[:, three], rcond=_RANK_TOLERANCE)
            if np.linalg.matrix_rank(pressing[:, three], _RANK_TOLERANCE) == 3:
                vertices.append(np.zeros((n, 6)))
                vertices[-1][three] = inverse @ pressing @ forces[:, 0]
        self._vertices = np.array(vertices)
        equal = equal_normal_map(support)
        self.unique = equal is None
        self._equal = np.ascontiguousarray(forces[:, 0] if equal is None else equal[self._order])

    def share(self, wrenches: np.ndarray) -> SharedLoads:
        """Shared loads under wrenches (N, 6) on the base, N and N m."""
        count, n = len(wrenches), len(self._order)
        usage, forces, used = np.full(count, np.nan), np.empty((count, n)), np.zeros((count, n))
        _share_all(
            *(np.ascontiguousarray(wrenches), self._loads, self._vertices, self._friction, self._J),
            *(self._equal, usage, forces, used),
        )
        back = np.argsort(self._order)
        return SharedLoads(usage, forces[:, back], used[:, back])


@lru_cache(maxsize=8)
def feet_on_plane(support: Support) -> FeetOnPlane | None:
    """The feet of a support; None if it stands on something else, or on feet with declared springs."""
    if support.dimension != 3 or not 3 <= support.n_contacts <= _MOST or support.elastic:
        return None
    sets = ForceSets(support)
    if not sets.ordinary or not TipOver(support, 1.0).on_polygon:
        return None
    if np.any((sets.friction > 0) & (sets.friction < _LEAST_FRICTION)) or np.sum(sets.friction > 0) < 2:
        return None
    return FeetOnPlane(support)


@compiled
def _share_all(wrenches, maps, corners, friction, J, equal, usage, forces, used):
    """Puts usages (N,), normal forces and shares (N, n) of wrenches (N, 6)."""
    n, m = len(equal), len(friction)
    h, limit, speeds = np.empty((1, 3)), np.empty((1, m)), np.empty(m)
    held, pulls, bases = np.zeros((1, m, 2)), np.zeros((1, m, 2)), J.reshape(1, m, 2, 3)
    vertices, normals, spare = np.empty((len(corners), n)), np.empty(n), np.empty((2, n))
    for k in range(len(wrenches)):
        for r in range(3):
            h[0, r] = 0.0
            for c in range(6):
                h[0, r] += maps[r, c] * wrenches[k, c]
        total, least = 0.0, np.inf
        for i in range(n):
            forces[k, i] = 0.0
            for c in range(6):
                forces[k, i] += equal[i, c] * wrenches[k, c]
            total += abs(forces[k, i])
            least = min(least, forces[k, i])
        count = 0
        if least > _LEAST_FORCE * total:
            count = _feasible(wrenches[k], corners, forces[k], total, vertices)
            upper, power = _planar(h, forces[k], friction, bases, limit, held, pulls, speeds)
            if not upper - power <= _SURE * max(1.0, upper):
                count = 0
        if count == 0:
            for i in range(n):
                forces[k, i] = used[k, i] = np.nan
            continue
        for i in range(m):
            used[k, i] = np.sqrt(held[0, i, 0] ** 2 + held[0, i, 1] ** 2) / limit[0, i]
        usage[k] = _least(
            h, vertices, count, forces[k], normals, spare, friction, bases, limit, held, pulls, speeds
        )


@compiled
def _feasible(wrench, corners, forces, total, vertices):
    """Puts the vertices without negative forces, a little inside; their number."""
    count = 0
    for v in range(len(corners)):
        good = True
        for i in range(len(forces)):
            force = 0.0
            for c in range(6):
                force += corners[v, i, c] * wrench[c]
            good = good and force >= -_ROUNDING * total
            vertices[count, i] = (1 - _INSIDE) * max(force, 0.0) + _INSIDE * forces[i]
        if good:
            count += 1
        if count == len(vertices):
            break
    return count


@compiled
def _least(h, vertices, count, equal, normals, spare, friction, bases, limit, held, pulls, speeds):
    """The minimum usage over means of vertices; NaN where it is not certain. Speeds are of equal forces."""
    first = second = third = _strongest(vertices, count, friction, speeds)
    usage, bound = np.inf, 0.0
    for _ in range(_TRIANGLES):
        upper, power, s, t = _in_triangle(
            h, vertices[first], vertices[second], vertices[third],
            normals, spare, friction, bases, limit, held, pulls, speeds,
        )  # fmt: skip
        best = _strongest(vertices, count, friction, speeds)
        # vertices are a little inside: what is beyond them counts in the bound
        beyond = _INSIDE * _friction(equal, friction, speeds)
        most = (_friction(vertices[best], friction, speeds) - beyond) / (1 - _INSIDE)
        usage, bound = min(usage, upper), max(bound, power / max(most, 1e-300))
        if usage - bound <= _CLOSE * max(1.0, usage):
            break
        weights = (1 - s) * (1 - t), (1 - s) * t, s
        if weights[2] <= weights[0] and weights[2] <= weights[1]:
            third = best
        elif weights[1] <= weights[0]:
            second = best
        else:
            first = best
    return usage if usage - bound <= _SURE * max(1.0, usage) else np.nan


@compiled
def _in_triangle(h, a, b, c, normals, spare, friction, bases, limit, held, pulls, speeds):
    """Usage and power at the best mean (1 - s) ((1 - t) a + t b) + s c of normal forces, and s and t."""
    upper, power, s, t, search = np.inf, 0.0, 0.0, 0.0, np.zeros(5)
    for step in range(_STEPS):
        for i in range(len(a)):
            spare[0, i], spare[1, i] = a[i] + s * (c[i] - a[i]), b[i] + s * (c[i] - b[i])
        upper, power, t = _on_segment(
            h, spare[0], spare[1], normals, friction, bases, limit, held, pulls, speeds
        )
        one, two, three = (
            _friction(a, friction, speeds),
            _friction(b, friction, speeds),
            _friction(c, friction, speeds),
        )
        certain = upper - power / max(one, two, three, 1e-300) <= _CLOSE * max(1.0, upper)
        following = _next(search, step, s, three - (1 - t) * one - t * two)
        if certain or following < 0:
            break
        s = following
    return upper, power, s, t


@compiled
def _on_segment(h, a, b, normals, friction, bases, limit, held, pulls, speeds):
    """Usage and power at the best mean (1 - t) a + t b of normal forces, and t."""
    upper, power, t, search = np.inf, 0.0, 0.0, np.zeros(5)
    for step in range(_STEPS):
        for i in range(len(a)):
            normals[i] = a[i] + t * (b[i] - a[i])
        upper, power = _planar(h, normals, friction, bases, limit, held, pulls, speeds)
        one, two = _friction(a, friction, speeds), _friction(b, friction, speeds)
        certain = upper - power / max(one, two, 1e-300) <= 0.5 * _CLOSE * max(1.0, upper)
        following = _next(search, step, t, two - one)
        if certain or following < 0:
            break
        t = following
    return upper, power, t


@compiled
def _next(search, step, place, slope):
    """Where to look next, from 0 to 1, for a slope that vanishes; negative: a maximum is at `place`.

    `search` has both ends, their slopes and the side that moved last.
    """
    if step == 0:
        search[1], search[2] = 1.0, slope
        return 1.0 if slope > 0 else -1.0
    if step == 1:
        search[3] = slope
        if slope >= 0:
            return -1.0
    # Illinois method: halving the slope of an end that stays twice keeps the steps from creeping to one side.
    elif slope > 0:
        search[0], search[2] = place, slope
        if search[4] == 1.0:
            search[3] *= 0.5
        search[4] = 1.0
    else:
        search[1], search[3] = place, slope
        if search[4] == -1.0:
            search[2] *= 0.5
        search[4] = -1.0
    return (search[0] * search[3] - search[1] * search[2]) / (search[3] - search[2])


@compiled
def _planar(h, normals, friction, bases, limit, held, pulls, speeds):
    """The minimum usage with these normal forces, the load's power and the speeds in the motion that proves
    it; the friction's power is 1.
    """
    m = len(friction)
    for i in range(m):
        limit[0, i] = friction[i] * normals[i]
        held[0, i, 0] = held[0, i, 1] = pulls[0, i, 0] = pulls[0, i, 1] = 0.0
    solve_planar(h, limit, bases, held, pulls)
    upper, power = 0.0, 0.0
    for i in range(m):
        x, y = held[0, i, 0], held[0, i, 1]
        upper = max(upper, np.sqrt(x * x + y * y) / limit[0, i])
        x, y = pulls[0, i, 0], pulls[0, i, 1]
        speeds[i] = np.sqrt(x * x + y * y)
        for r in range(3):
            power += h[0, r] * (bases[0, i, 0, r] * x + bases[0, i, 1, r] * y)
    return upper, power


@compiled
def _friction(normals, friction, speeds):
    """Power of the friction with these normal forces."""
    power = 0.0
    for i in range(len(friction)):
        power += friction[i] * normals[i] * speeds[i]
    return power


@compiled
def _strongest(vertices, count, friction, speeds):
    """The vertex with the largest power of the friction."""
    best, most = 0, -1.0
    for v in range(count):
        power = _friction(vertices[v], friction, speeds)
        if power > most:
            best, most = v, power
    return best
