"""Tangential redistribution: min over z of max_i |q_i + Q_i z| / l_i, in batches.

The forces of every z hold the equilibrium exactly (z runs over the tangential forces that cancel each other),
so that the usage of any z is an upper bound of the optimum, and any multipliers v with Q'v = 0 give the lower
bound sum v_i . q_i / sum |v_i| l_i. The gap between the two proves a result, whichever status the solver
returned. Source: thesis M, (4.12). A second-order cone program of Clarabel, polished by Newton steps on the
optimality conditions, because derivatives need the multipliers to more digits than an interior-point method
gives.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import clarabel
import numpy as np

from ocptip.numerics.cone_program import USABLE, columns_of, no_columns, quiet_settings
from ocptip.reserves.optimality import ForceRange, forces_of, lengths, refined
from ocptip.reserves.planar import planar_forces

GAP_TOLERANCE = 1e-7
"""Largest gap between the two bounds of the usage, relative to max(1, usage), of a solved state."""

ZERO_USAGE = 1e-10
"""Usages below this are zero; the usage has a kink there, its derivative is then given as zero."""

_BALANCE = 1e-9  # largest error of the forces' balance, relative to the largest force
_TOLERANCES = (1e-9, 1e-12)
_GOOD_STATUS = (*USABLE, "InsufficientProgress")


class ConeBatch:
    """A Clarabel program: min x_0 with b - A x in a product of cones; set up once, re-solved by updates.

    Args:
        structure: (rows, columns) True where A may be non-zero.
        cones: Clarabel cones in the order of the rows.
        tolerance: gap and feasibility tolerance.
        equilibrate: scale rows and columns first (slower, needed where limits differ by magnitudes).
    """

    def __init__(self, structure: np.ndarray, cones: list, tolerance: float, equilibrate: bool) -> None:
        settings = quiet_settings(tolerance)
        settings.presolve_enable = False  # the structure must survive for the updates
        settings.equilibrate_enable = equilibrate
        rows, columns = structure.shape
        self._entries = np.nonzero(structure.T)[::-1]
        cost = np.zeros(columns)
        cost[0] = 1.0
        self._solver = clarabel.DefaultSolver(
            no_columns(columns),
            cost,
            columns_of(structure.astype(float)),
            np.zeros(rows),
            cones,
            settings,
        )

    def solve(self, A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Solve for A (N, rows, columns), b (N, rows): x (N, columns), multipliers (N, rows), status (N,).

        x and the multipliers are NaN where the solver gave no usable point.
        """
        count, rows, columns = A.shape
        x, multipliers = np.full((count, columns), np.nan), np.full((count, rows), np.nan)
        status = np.empty(count, dtype=object)
        # Updates of the numbers alone keep the symbolic factorisation, which costs more than a solve of this
        # size.
        data = A[:, self._entries[0], self._entries[1]]
        for s in range(count):
            self._solver.update(A=data[s], b=b[s])
            solution = self._solver.solve()
            status[s] = str(solution.status)
            if status[s] in _GOOD_STATUS:
                x[s], multipliers[s] = solution.x, solution.z
        return x, multipliers, status


@dataclass
class Minimax:
    """Best known points of N minimax problems, with the two bounds.

    Attributes:
        usage: (N,) largest usage of the forces, the upper bound.
        forces: (N, n, k) tangential forces q + Q z, N.
        pull: (N, n, k) multipliers v_i, Q'v = 0 and sum |v_i| l_i = 1. At the optimum
            d usage = sum v_i . d q_i - usage sum |v_i| d l_i.
        gap: (N,) upper minus lower bound.
        status: (N,) solver status.
    """

    usage: np.ndarray
    forces: np.ndarray
    pull: np.ndarray
    gap: np.ndarray
    status: np.ndarray

    @property
    def solved(self) -> np.ndarray:
        """(N,) True where the gap is closed."""
        return self.gap <= GAP_TOLERANCE * np.maximum(1.0, self.usage)

    def take_better(self, where: np.ndarray, other: Minimax) -> None:
        """Replace the states `where` by `other` where its gap is smaller."""
        better = other.gap < self.gap[where]
        for item in fields(self):
            getattr(self, item.name)[where[better]] = getattr(other, item.name)[better]


def minimise_usage(q: np.ndarray, Q: np.ndarray, limits: np.ndarray, J: np.ndarray | None = None) -> Minimax:
    """Smallest largest usage of N problems of the same size.

    Contacts in one plane are solved by duality in three dimensions (`planar`); what is left, or not proved,
    by a cone program.

    Args:
        q: (N, n, k) tangential forces at z = 0, N.
        Q: (N, n, k, nz) linearly independent tangential forces per unit of z.
        limits: (N, n) limits l_i > 0, N.
        J: (N, n, 2, 3) orthonormal complement of Q where it has three columns, else None.
    """
    if J is None:
        return _minimise_general(q, Q, limits)
    best = _minimise_planar(q, J, limits)
    todo = np.flatnonzero(~best.solved)
    if len(todo):
        general = _minimise_general(q[todo], Q[todo], limits[todo])
        for item in fields(best):
            getattr(best, item.name)[todo] = getattr(general, item.name)
    return best


def _minimise_planar(q: np.ndarray, J: np.ndarray, limits: np.ndarray) -> Minimax:
    forces, pull = planar_forces(q, J, limits)
    usage = np.max(lengths(forces) / limits, axis=1)
    total = np.sum(lengths(pull) * limits, axis=1)
    with np.errstate(invalid="ignore"):
        pull = pull / np.where(total > 0, total, 1.0)[:, None, None]
        gap = np.maximum(usage - np.einsum("sik,sik->s", pull, q), 0.0)
        error = np.max(np.abs(np.einsum("sikr,sik->sr", J, forces - q)), axis=1)
        good = np.isfinite(gap) & (error <= _BALANCE * np.max(np.abs(q), axis=(1, 2), initial=0.0))
    pull[usage <= ZERO_USAGE] = 0.0
    # Where the balance fails q itself is the best known point; its infinite gap sends it to the cone program.
    forces = np.where(good[:, None, None], forces, q)
    usage = np.max(lengths(forces) / limits, axis=1)
    status = np.full(len(q), "direct", dtype=object)
    return Minimax(usage, forces, pull, np.where(good, gap, np.inf), status)


def _minimise_general(q: np.ndarray, Q: np.ndarray, limits: np.ndarray) -> Minimax:
    """By Clarabel.

    The problem is solved for u_i = (q_i + Q_i z) / l_i in an orthonormal basis P of the redistributions.
    Units are those of the least-squares solution, whose usage is at most sqrt(n) times the optimum.
    """
    count, n, k = q.shape
    nz = Q.shape[3]
    u = q / limits[:, :, None]
    P = np.linalg.qr((Q / limits[:, :, None, None]).reshape(count, n * k, nz))[0].reshape(Q.shape)
    for _ in range(2):  # the second time removes the rounding errors of the first
        u = u - forces_of(P, _against(P, u))
    # Units of the least-squares usage make the optimum a number near 1 in all states, as tolerances assume.
    level = np.max(lengths(u), axis=1)
    level = np.where(level > ZERO_USAGE, level, 1.0)
    u = u / level[:, None, None]
    best = _least_squares(u, P)
    # The looser tolerance and Newton steps prove nearly all states; the tighter one is slower and is for the
    # rest.
    for tolerance in _TOLERANCES:
        todo = np.flatnonzero(~best.solved)
        if len(todo) == 0:
            break
        y, pull, status = _cone_program(u[todo], P[todo], tolerance)
        best.status[todo] = status
        best.take_better(todo, _with_bounds(u[todo], P[todo], y, pull, status))
        best.take_better(todo, _with_bounds(u[todo], P[todo], *_polished(u[todo], P[todo], y, pull), status))
    return Minimax(
        usage=best.usage * level,
        forces=best.forces * level[:, None, None] * limits[:, :, None],
        pull=best.pull / limits[:, :, None],
        gap=best.gap * level,
        status=best.status,
    )


def _against(Q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Q'v: (N, nz) from Q (N, n, k, nz) and v (N, n, k)."""
    return np.einsum("sikz,sik->sz", Q, v)


def _least_squares(u: np.ndarray, P: np.ndarray) -> Minimax:
    """y = 0: the optimum where nothing can be redistributed or no tangential force is needed."""
    usages = lengths(u)
    worst, rows = np.argmax(usages, axis=1), np.arange(len(u))
    usage = usages[rows, worst]
    needed = usage > ZERO_USAGE
    pull = np.zeros_like(u)
    worst_rows = rows[needed], worst[needed]
    pull[worst_rows] = u[worst_rows] / usage[needed, None]
    known = ~needed if P.shape[3] else np.ones(len(u), dtype=bool)
    status = np.where(known, "direct", "not attempted").astype(object)
    return Minimax(usage, u.copy(), pull, np.where(known, 0.0, np.inf), status)


def _cone_program(
    u: np.ndarray, P: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Minimise t with (t, u_i + P_i y) in the second-order cone: y, multipliers of u, status."""
    count, n, k = u.shape
    nz = P.shape[3]
    structure = np.zeros((n, k + 1, nz + 1), dtype=bool)
    structure[:, 0, 0] = structure[:, 1:, 1:] = True
    A, b = np.zeros((count, *structure.shape)), np.zeros((count, n, k + 1))
    A[:, :, 0, 0] = -1.0
    A[:, :, 1:, 1:] = -P
    b[:, :, 1:] = u
    rows = n * (k + 1)
    cones = [clarabel.SecondOrderConeT(k + 1)] * n
    batch = ConeBatch(structure.reshape(rows, -1), cones, tolerance, equilibrate=False)
    x, multipliers, status = batch.solve(A.reshape(count, rows, -1), b.reshape(count, rows))
    return x[:, 1:], -multipliers.reshape(count, n, k + 1)[:, :, 1:], status


def _with_bounds(
    u: np.ndarray, P: np.ndarray, y: np.ndarray, pull: np.ndarray, status: np.ndarray
) -> Minimax:
    """Evaluate both bounds after making the multipliers feasible: P'v = 0, sum |v_i| = 1."""
    # Projected and scaled multipliers are feasible exactly, so that their lower bound is valid.
    pull = pull - forces_of(P, _against(P, pull))
    total = np.sum(lengths(pull), axis=1)
    pull = pull / np.where(total > 0, total, np.nan)[:, None, None]
    forces = u + forces_of(P, y)
    usage = np.max(lengths(forces), axis=1)
    gap = usage - np.einsum("sik,sik->s", pull, u)
    return Minimax(usage, forces, pull, np.where(np.isfinite(gap), np.maximum(gap, 0.0), np.inf), status)


def _polished(u: np.ndarray, P: np.ndarray, y: np.ndarray, pull: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Newton steps on the optimality conditions: y, multipliers. No normal force is free here."""
    none = np.zeros(u.shape[:2])
    fixed = ForceRange(none, np.zeros((*none.shape, P.shape[3])), none + 1.0, none, none, none)
    total = np.sum(lengths(pull), axis=1)
    with np.errstate(invalid="ignore"):
        pull = pull / np.where(total > 0, total, np.nan)[:, None, None]
    usage = np.max(lengths(u + forces_of(P, y)), axis=1)
    point = refined(u, P, fixed, y, usage, pull, none)
    return point.z, point.pull
