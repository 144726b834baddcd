"""Full redistribution: the smallest usage t over all contact forces that hold the equilibrium.

With four or more contacts the normal forces of a contact state are one choice of many. Then the limits
depend on the unknowns too,

    min over z of max_i |q_i + Q_i z| / limit_i(p_i + P_i z),    limit_i(K_n) = radius_i + slope_i K_n,

which is quasi-convex: for given t, F(t) = min_z max_i (|q_i + Q_i z| - t limit_i) / d_i is a second-order
cone program, and t is optimal where F(t) = 0. The iteration t <- usage at the minimiser (generalised
fractional programming: Dinkelbach; Crouzeix, Ferland and Schaible, J. Optim. Theory Appl. 47, 1985) falls
monotonically and superlinearly near the optimum. Far from it, where limits differ by magnitudes, it is slow;
so every other program tries half of what is left above the largest t known to be too small.

Where all contacts lie in one plane, normal and tangential forces balance apart. Then one cone program does,
see `coplanar`.

Contacts without friction have no tangential force and no limit. Their cones would pin F(t) to zero for every
t, so they have none: only the ends of their normal forces count.

Many states are solved from few: Newton steps from the optimum of the nearest one of a fourth of them mostly
lead to a proven optimum, without a program.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import clarabel
import numpy as np

from ocptip.numerics.vectors import distinct_rows
from ocptip.reserves.coplanar import largest_growth
from ocptip.reserves.minimax import ZERO_USAGE, ConeBatch
from ocptip.reserves.optimality import ForceRange, forces_of, lengths, refined

NEGLIGIBLE_LIMIT = 1e-7
"""Limits below this, relative to the largest one, do not enter the usage: such contacts are unloaded."""

_TOLERANCE = 1e-10
_SMALLEST_DIVISOR = 1e-3
_DECREASE = 1e-9
_NEAR = 1e-3
_MAX_ITERATIONS = 40
_LEVEL = 1e-6  # slopes of limits that count as none
_ENDS = 1e-9  # of a normal force beyond its range, of the largest force
_CLOSED = 1e-10  # gap between the bounds of a usage, relative to it or 1
_FEW, _ONE_OF = 8, 4  # states that are solved one by one; of more, one of so many at first
_CHUNK = 500


@dataclass
class FractionalOptimum:
    """Optima of N states.

    Attributes:
        usage: (N,) smallest largest usage.
        z: (N, nz) where it is reached.
        pull: (N, n, k) derivative of the usage with respect to the tangential forces q.
        normal_pull: (N, n) derivative with respect to the normal forces p.
        gap: (N,) estimated distance from the optimum, inf where the cone program failed.
        status: (N,) last solver status.
        iterations: (N,) cone programs solved.
    """

    usage: np.ndarray
    z: np.ndarray
    pull: np.ndarray
    normal_pull: np.ndarray
    gap: np.ndarray
    status: np.ndarray
    iterations: np.ndarray

    def put(self, rows: np.ndarray, other: FractionalOptimum) -> None:
        """The optima of the states `rows`."""
        for item in fields(self):
            getattr(self, item.name)[rows] = getattr(other, item.name)


def largest_usage(tangential: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """(N,) largest |tangential| / limit of the contacts with a limit worth mentioning."""
    counts = limits > NEGLIGIBLE_LIMIT * np.max(limits, axis=1, keepdims=True)
    return np.max(np.where(counts, lengths(tangential) / np.where(counts, limits, 1.0), 0.0), axis=1)


def minimise_fraction(
    q: np.ndarray,
    Q: np.ndarray,
    forces: ForceRange,
    balances: np.ndarray | None = None,
    exact: bool = True,
) -> FractionalOptimum:
    """Smallest largest usage of N states of the same size, starting from z = 0, which must be feasible.

    All forces in units of the largest force of their state.

    Args:
        q: (N, n, k) tangential forces at z = 0.
        Q: (N, n, k, nz) tangential forces per unit of z, orthonormal together with `forces.per_z`.
        forces: normal forces and limits.
        balances: (N, n, k + 1, r), orthonormal complement of `forces.per_z` and Q, where normal and
            tangential forces balance apart; None otherwise.
        exact: whether derivatives are wanted.
    """
    if balances is not None:
        best = _start(q, forces, Q.shape[3])
        left = np.flatnonzero(~_by_growth(best, q, Q, forces, balances, exact))
        if len(left):
            best.put(left, minimise_fraction(q[left], Q[left], forces.take(left)))
        return best
    count = len(q)
    # States are grouped by their frictionless contacts, since one cone program serves only equal structures.
    patterns, which = distinct_rows(forces.rough)
    if len(patterns) > 1:
        best = _start(q, forces, Q.shape[3])
        for p in range(len(patterns)):
            rows = np.flatnonzero(which == p)
            best.put(rows, minimise_fraction(q[rows], Q[rows], forces.take(rows)))
        return best
    if count <= _FEW:
        return _one_by_one(q, Q, forces)
    # Neighbours along a motion have nearly the same optimum: a fourth of the states is solved, the others
    # start there.
    some = np.arange(0, count, _ONE_OF)
    others = np.setdiff1d(np.arange(count), some)
    best = _start(q, forces, Q.shape[3])
    best.put(some, minimise_fraction(q[some], Q[some], forces.take(some)))
    left = others[~_from_nearest(best, some, others, q, Q, forces)]
    if len(left):
        best.put(left, _one_by_one(q[left], Q[left], forces.take(left)))
    return best


def _from_nearest(
    best: FractionalOptimum,
    known: np.ndarray,
    others: np.ndarray,
    q: np.ndarray,
    Q: np.ndarray,
    forces: ForceRange,
) -> np.ndarray:
    """Refine states `others` from the optima of the nearest `known` ones; True where that is proven."""
    basis = np.concatenate([forces.per_z[:, :, None], Q], axis=2).reshape(len(q), -1, Q.shape[3])
    held = np.concatenate([forces.normal[:, :, None], q], axis=2).reshape(len(q), -1)
    free = np.einsum("sfz,sf->sz", basis, held)
    # Differences of z depend on the basis point of a state; forces of minimum norm compare states
    # independently of it.
    load = held - np.einsum("sfz,sz->sf", basis, free)  # of all forces the shortest, linear in the wrench
    sizes = np.sum(load[known] ** 2, axis=1)
    near = [
        np.argmin(sizes - 2 * load[part] @ load[known].T, axis=1)
        for part in np.array_split(others, 1 + len(others) // _CHUNK)
    ]
    from_state = known[np.concatenate(near)]
    z = best.z[from_state] + free[from_state] - free[others]
    start = z, best.usage[from_state], best.pull[from_state], best.normal_pull[from_state]
    proven = _polish(best, others, q[others], Q[others], forces.take(others), *start)
    best.status[others[proven]] = "refined"
    return proven


def _start(q: np.ndarray, forces: ForceRange, nz: int) -> FractionalOptimum:
    """The states as they are given, z = 0."""
    count, n, _ = q.shape
    z = np.zeros((count, nz))
    return FractionalOptimum(
        usage=largest_usage(q, forces.limits(z)),
        z=z,
        pull=np.zeros_like(q),
        normal_pull=np.zeros((count, n)),
        gap=np.full(count, np.inf),
        status=np.full(count, "not attempted", dtype=object),
        iterations=np.zeros(count, dtype=int),
    )


def _one_by_one(q: np.ndarray, Q: np.ndarray, forces: ForceRange) -> FractionalOptimum:
    """By cone programs, as `minimise_fraction`; the same contacts have friction in all states."""
    count, k = len(q), q.shape[2]
    best = _start(q, forces, Q.shape[3])
    if not (count and forces.rough[0].any()):
        best.gap[:], best.status[:] = 0.0, "no friction"
        return best
    batch = _batch(forces.rough[0], k, Q.shape[3])
    known_too_small = np.zeros(count)
    todo = np.arange(count)
    for iteration in range(_MAX_ITERATIONS):
        if len(todo) == 0:
            break
        force_range, t = forces.take(todo), best.usage[todo].copy()
        # Every second program bisects, which helps where the iteration of Dinkelbach is slow (limits of very
        # different size).
        halves = (iteration % 2 == 1) & (known_too_small[todo] < (1.0 - _NEAR) * t)
        t[halves] = (t[halves] + known_too_small[todo[halves]]) / 2
        x, multipliers, best.status[todo] = batch.solve(
            *_program(q[todo], Q[todo], force_range, t, best.z[todo])
        )
        best.iterations[todo] += 1
        usable = np.isfinite(x).all(axis=1)
        too_small = usable & halves & (x[:, 0] > 0)
        known_too_small[todo[too_small]] = t[too_small]
        usable &= ~too_small
        rows, force_range = todo[usable], force_range.take(usable)
        before = best.usage[rows]
        _improve(best, rows, q[rows], Q[rows], force_range, x[usable], multipliers[usable], t[usable])
        decrease = (before - best.usage[rows]) / np.maximum(before, _SMALLEST_DIVISOR)
        # A failed program ends the iteration, a failed trial of the bisection only that trial.
        finished = ~usable & ~halves
        finished[usable] = (decrease <= _DECREASE) & ~halves[usable]
        near = (decrease < _NEAR) & ~halves[usable]
        for points in (best.z[rows], x[usable, 1:]):  # the program's point where the best one is another
            if not np.any(near):
                break
            row = rows[near]
            start = points[near], best.usage[row], best.pull[row], best.normal_pull[row]
            proven = _polish(best, row, q[row], Q[row], force_range.take(near), *start)
            finished[np.flatnonzero(usable)[near]] |= proven
            near[np.flatnonzero(near)[proven]] = False
        todo = todo[~finished]
    known = np.isfinite(best.gap)
    best.gap[known] = np.minimum(best.gap, best.usage)[known]  # no usage is below zero
    return best


def _by_growth(
    best: FractionalOptimum,
    q: np.ndarray,
    Q: np.ndarray,
    forces: ForceRange,
    balances: np.ndarray,
    exact: bool,
) -> np.ndarray:
    """Improve states whose normal and tangential forces balance apart; (N,) True where that is proven."""
    proven = np.zeros(len(q), dtype=bool)
    steep = np.all(~forces.rough | (np.abs(forces.slope) > _LEVEL), axis=1)
    rows = np.flatnonzero((best.usage > ZERO_USAGE) & steep & forces.rough.any(axis=1))
    if not len(rows):
        return proven
    q, Q, forces, A, usage = q[rows], Q[rows], forces.take(rows), balances[rows], best.usage[rows]
    # Limits, or without friction the distance from the lower end, are what the cones begin with.
    slope = np.where(forces.rough, forces.slope, 1.0)
    radius = np.where(forces.rough, forces.radius, -forces.lower)
    fixed = np.einsum("snr,sn->sr", A[:, :, 0], forces.normal + radius / slope)
    growing = np.einsum("snkr,snk->sr", A[:, :, 1:], q / usage[:, None, None])
    n, k, r = A.shape[1:]
    # A lower end above the apex of its cone is a cone of its own: the force's distance from it.
    apart = forces.lower + radius / slope
    ends = np.flatnonzero(np.any(np.abs(apart) > _ENDS, axis=0))
    cones = np.zeros((len(A), n + len(ends), 3, r + len(ends)))
    cones[:, :n, 0, :r], cones[:, :n, 1:k, :r] = A[:, :, 0] / slope[:, :, None], A[:, :, 1:]
    new = np.arange(len(ends))
    cones[:, ends, 0, r + new], cones[:, n + new, 0, r + new] = 1 / slope[:, ends], -1.0
    fixed, growing = np.hstack([fixed, apart[:, ends]]), np.hstack([growing, 0 * apart[:, ends]])
    s, x, y = largest_growth(cones, fixed, growing)
    t, least, y = usage / s, usage / np.einsum("sr,sr->s", fixed, y), y[:, :r]
    normal, tangential = (x[:, :n, 0] - radius) / slope, x[:, :n, 1:k] * t[:, None, None]
    z = np.einsum("snz,sn->sz", forces.per_z, normal - forces.normal)
    z += np.einsum("snkz,snk->sz", Q, tangential - q)
    pull = -np.einsum("snkr,sr->snk", A, y / s[:, None])
    pull[:, :, 0] *= t[:, None]
    # What forces at z are beyond their limits, and the usage that this is worth: 0 but for rounding.
    beyond = np.maximum(lengths(q + forces_of(Q, z)) - t[:, None] * forces.limits(z), 0.0)
    gap = np.abs(t - least) + np.sum(lengths(pull[:, :, 1:]) * beyond, axis=1)
    inside = np.all(normal <= forces.upper + _ENDS, axis=1)  # the cones do not know these ends
    good = inside & (gap <= _CLOSED * np.maximum(1.0, t))
    place = rows[good]
    best.usage[place], best.z[place], best.gap[place] = t[good], z[good], gap[good]
    best.pull[place], best.normal_pull[place] = pull[good, :, 1:], pull[good, :, 0]
    best.status[place], proven[place] = "Solved", True
    # The error of the multipliers is about the root of the gap; Newton steps make it that of rounding.
    todo = np.flatnonzero(np.isfinite(s) & (exact | ~good))
    if len(todo):
        start = z[todo], t[todo], pull[todo, :, 1:], pull[todo, :, 0]
        proven[rows[todo]] |= _polish(best, rows[todo], q[todo], Q[todo], forces.take(todo), *start)
        best.status[rows[todo]] = "Solved"
    return proven


def _batch(rough: np.ndarray, k: int, nz: int) -> ConeBatch:
    """Cones of the contacts with friction, ends of all."""
    n, m = len(rough), int(np.count_nonzero(rough))
    cones = np.ones((m, k + 1, nz + 1), dtype=bool)
    ends = np.ones((2 * n, nz + 1), dtype=bool)
    ends[:, 0] = False
    return ConeBatch(
        np.vstack([cones.reshape(m * (k + 1), nz + 1), ends]),
        [clarabel.SecondOrderConeT(k + 1)] * m + [clarabel.NonnegativeConeT(2 * n)],
        _TOLERANCE,
        equilibrate=True,
    )


def _program(
    q: np.ndarray, Q: np.ndarray, forces: ForceRange, t: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A and b of the cone program F(t), divisors from the limits at z. Rows: cones, lower, upper ends."""
    count, n, k = q.shape
    columns = Q.shape[3] + 1
    limits = forces.limits(z)
    A, b = np.zeros((count, n, k + 1, columns)), np.zeros((count, n, k + 1))
    # Divisors are the limits at the current point (Crouzeix); the floor keeps rows of unloaded contacts
    # finite.
    A[:, :, 0, 0] = -np.maximum(limits, _SMALLEST_DIVISOR * np.max(limits, axis=1, keepdims=True))
    A[:, :, 0, 1:] = -(t[:, None] * forces.slope)[:, :, None] * forces.per_z
    A[:, :, 1:, 1:] = -Q
    b[:, :, 0] = t[:, None] * (forces.radius + forces.slope * forces.normal)
    b[:, :, 1:] = q
    ends = np.zeros((count, 2 * n, columns))
    ends[:, :n, 1:], ends[:, n:, 1:] = -forces.per_z, forces.per_z
    to_ends = np.maximum(np.hstack([forces.normal - forces.lower, forces.upper - forces.normal]), 0.0)
    to_ends[np.all(ends == 0, axis=2)] = 1.0  # a fixed normal force stays where it is, at an end or not
    rough = forces.rough[0]
    rows = np.count_nonzero(rough) * (k + 1)
    A = np.concatenate([A[:, rough].reshape(count, rows, columns), ends], axis=1)
    return A, np.hstack([b[:, rough].reshape(count, rows), to_ends])


def _improve(
    best: FractionalOptimum,
    rows: np.ndarray,
    q: np.ndarray,
    Q: np.ndarray,
    forces: ForceRange,
    x: np.ndarray,
    multipliers: np.ndarray,
    t: np.ndarray,
) -> None:
    """Keep lower usages, and the derivatives of t from the multipliers of F(t): dt = dF / sum w_i limit_i."""
    count, n, k = q.shape
    excess, z = x[:, 0], x[:, 1:]
    limits = forces.limits(z)
    cones = np.zeros((count, n, k + 1))
    rough = np.flatnonzero(forces.rough[0]) if count else []
    cones[:, rough] = multipliers[:, : -2 * n].reshape(count, len(rough), k + 1)
    lower, upper = multipliers[:, -2 * n : -n], multipliers[:, -n:]
    weight = cones[:, :, 0]
    total = np.maximum(np.sum(weight * limits, axis=1, keepdims=True), np.finfo(float).tiny)
    best.pull[rows] = -cones[:, :, 1:] / total[:, :, None]
    best.normal_pull[rows] = (upper - lower - t[:, None] * weight * forces.slope) / total
    best.gap[rows] = np.abs(excess) / total[:, 0]
    reached = largest_usage(q + forces_of(Q, z), limits)
    falls = reached < best.usage[rows]
    best.usage[rows[falls]], best.z[rows[falls]] = reached[falls], z[falls]


def _polish(
    best: FractionalOptimum,
    where: np.ndarray,
    q: np.ndarray,
    Q: np.ndarray,
    forces: ForceRange,
    *start: np.ndarray,
) -> np.ndarray:
    """Refine the states `where` by Newton steps, see `refined`; True where a proven optimum replaced them."""
    point = refined(q, Q, forces, *start)
    good = point.proven & (point.t <= best.usage[where] * (1.0 + _DECREASE))
    rows = where[good]
    best.usage[rows], best.z[rows], best.gap[rows] = (
        np.minimum(point.t, best.usage[where])[good],
        point.z[good],
        point.residual[good],
    )
    best.pull[rows], best.normal_pull[rows] = point.pull[good], point.normal_pull[good]
    return good
