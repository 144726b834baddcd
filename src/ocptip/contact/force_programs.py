"""Cone programs over the contact forces of a base: by how much they stay inside their limits, and how far a
load may grow.

Forces K of all contacts, in contact axes, and one more variable: a margin common to all limits, or the share
of a change of the load.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import clarabel
import numpy as np

from ocptip.basics.errors import InputError, SolverError
from ocptip.contact.bindings import laws
from ocptip.contact.bindings.binding import Binding, ForcePiece
from ocptip.contact.support import Support
from ocptip.numerics.cone_program import INFEASIBLE, USABLE, columns_of, quiet_settings, solve_cones

_TOLERANCES = (1e-10, 1e-8, 1e-6)
_BALANCE = 1e-8
_REACHED = 1e-9  # relative: singular values, and parts of a wrench that no contact force has


@dataclass(frozen=True, eq=False)
class _ForceRows:
    """Rows `limits - matrix @ (forces, margin)` in cones, after those of the balance."""

    matrix: np.ndarray
    limits: np.ndarray
    cones: list[Any]


def _force_rows(
    contacts: tuple[Binding, ...], pieces: tuple[ForcePiece, ...], unit: float, cone: bool, inside: float
) -> _ForceRows:
    """Forces stay inside the pieces, by `inside` times the last variable, which is at most 1."""
    d, n = contacts[0].dimension, len(contacts)
    size = d * n + 1
    rows, rhs = [], []

    def row(**entries: float) -> np.ndarray:
        line = np.zeros(size)
        for key, value in entries.items():
            line[-1 if key == "s" else int(key[1:])] = value
        return line

    rows.append(row(s=1.0))  # bounded, or a support without load would have no largest margin
    rhs.append(1.0)
    second_order = []
    carried = laws.carries(contacts)
    for k, (contact, piece) in enumerate(zip(contacts, pieces, strict=True)):
        normal = f"k{d * k}"
        # only ends of the whole force set are limits; at the others the next piece goes on
        low, high = laws.normal_range(contact)
        if np.isfinite(piece.normal_min):
            rows.append(row(**{normal: -1.0, "s": inside * (piece.normal_min == low)}))
            rhs.append(-piece.normal_min / unit)
        if np.isfinite(piece.normal_max):
            rows.append(row(**{normal: 1.0, "s": inside * (piece.normal_max == high)}))
            rhs.append(piece.normal_max / unit)
        if not carried[k, -1]:
            continue
        if 0 < piece.along < np.inf:
            for sign in (1.0, -1.0):
                rows.append(row(**{f"k{d * k + 1}": sign, "s": inside}))
                rhs.append(piece.along / unit)
        if cone:
            block = np.zeros((d, size))
            block[0, d * k], block[0, -1] = -piece.slope, inside
            block[1:, d * k + 1 : d * k + d] = -np.eye(d - 1)
            second_order.append((block, np.concatenate([[piece.radius / unit], np.zeros(d - 1)])))
        else:
            for face in laws.polygon(contact)[0]:
                line = row(**{normal: -piece.slope, "s": inside})
                line[d * k + 1 : d * k + d] = face
                rows.append(line)
                rhs.append(piece.radius / unit)
    blocks, limits = [np.array(rows)], [np.array(rhs)]
    cones: list[Any] = [clarabel.NonnegativeConeT(len(rows))]
    for block, limit in second_order:
        blocks.append(block)
        limits.append(limit)
        cones.append(clarabel.SecondOrderConeT(d))
    idle = np.eye(size)[:-1][~carried.ravel()]
    if len(idle):  # forces that no contact has
        blocks.append(idle)
        limits.append(np.zeros(len(idle)))
        cones.append(clarabel.ZeroConeT(len(idle)))
    return _ForceRows(np.vstack(blocks), np.concatenate(limits), cones)


def largest_margin(
    contacts: tuple[Binding, ...],
    pieces: tuple[ForcePiece, ...],
    matrix: np.ndarray,
    target: np.ndarray,
    unit: float,
    cone: bool,
) -> tuple[float, np.ndarray | None, np.ndarray]:
    """Largest margin s (in units) over forces with matrix K = target inside the pieces, and the dual.

    Args:
        contacts: of one support.
        pieces: a convex piece of the force set of each.
        matrix, target: of the balance, in units of `unit`.
        unit: N.
        cone: Coulomb's true cones; False: the friction pyramids.

    Raises:
        SolverError: the program ended without a verdict.
    """
    d, n = contacts[0].dimension, len(contacts)
    rows = _force_rows(contacts, pieces, unit, cone, 1.0)
    carried = laws.carries(contacts).ravel()
    balance = np.hstack([matrix, np.zeros((len(matrix), 1))])
    cost = np.append(np.zeros(d * n), -1.0)
    program = (
        cost,
        columns_of(np.vstack([balance, rows.matrix])),
        np.concatenate([target, rows.limits]),
        [clarabel.ZeroConeT(len(matrix)), *rows.cones],
    )
    ended = ""
    inverse = np.linalg.pinv(matrix)
    for tolerance in _TOLERANCES:
        solution = solve_cones(*program, quiet_settings(tolerance))
        status = str(solution.status)
        dual = np.asarray(solution.z)[: len(matrix)]
        if status in (*USABLE, "InsufficientProgress"):
            x = np.asarray(solution.x)
            forces = np.where(carried, x[:-1], 0.0)
            forces = forces - inverse @ (matrix @ forces - target)  # large ones balance only relatively
            allowed = _BALANCE * max(1.0, 1e-5 * np.max(np.abs(forces)))
            if np.max(np.abs(matrix @ forces - target), initial=0.0) < allowed:
                return float(x[-1]), forces.reshape(n, d) * unit, dual
        if status in INFEASIBLE:
            return -np.inf, None, dual
        ended = f"{status} (primal residual {solution.r_prim:.1e}, dual residual {solution.r_dual:.1e})"
    raise SolverError(f"equilibrium: no verdict from the convex program (Clarabel: {ended})")


class LoadRays:
    """How far the load on a support may go from one wrench towards another, on Coulomb's true cones.

    Args:
        support: spatial; the force set of every contact is convex.
        normal_map: (n, 6) normal forces, N, per wrench, where springs determine them; default: they are free.

    Raises:
        InputError: it is not.
    """

    def __init__(self, support: Support, normal_map: np.ndarray | None = None) -> None:
        pieces = [contact.force_pieces() for contact in support.contacts]
        if any(len(piece) > 1 for piece in pieces):
            k = next(k for k, piece in enumerate(pieces) if len(piece) > 1)
            raise InputError(f"contacts[{k}]: a {support.contacts[k].kind} has no convex set of forces")
        self._scaling = np.r_[np.ones(3), np.full(3, 1.0 / support.length)]
        self._unit = max(float(np.linalg.norm(support.weight)), 1.0)
        self._rows = _force_rows(support.contacts, tuple(piece[0] for piece in pieces), self._unit, True, 0.0)
        carrying = self._scaling[:, None] * support.wrench_matrix * laws.carries(support.contacts).ravel()
        u, s, _ = np.linalg.svd(carrying)
        self._reached = u[:, : len(s)][:, s > _REACHED * s[0]]
        self._balance, self._of_load = self._reached.T @ carrying, self._reached.T
        if normal_map is not None:
            normals = np.eye(carrying.shape[1])[::3]
            rows = np.vstack(
                [np.hstack([carrying, np.eye(6)]), np.hstack([normals, -normal_map / self._scaling])]
            )
            _, s, axes = np.linalg.svd(rows, full_matrices=False)  # some rows follow from others
            rows = axes[s > _REACHED * s[0]]
            self._balance, self._of_load = rows[:, :-6], rows[:, -6:]

    def farthest(self, start: np.ndarray, end: np.ndarray) -> tuple[float, np.ndarray]:
        """Largest share t <= 1 with start + t (end - start) held, and the normal (6,) of the limit there.

        The normal points out of the set of wrenches that are held. Where the line does not meet the set, t is
        -inf.

        Raises:
            SolverError: the program ended without a verdict.
        """
        return self.with_forces(start, end)[:2]

    def with_forces(self, start: np.ndarray, end: np.ndarray) -> tuple[float, np.ndarray, np.ndarray | None]:
        """As `farthest`, and contact forces (n, d), N, that hold the wrench there; None where none do."""
        first, change = (
            self._scaling * contact_forces / self._unit for contact_forces in (start, end - start)
        )
        across = self._reached @ (self._reached.T @ change) - change
        if np.linalg.norm(across) > _REACHED * max(np.linalg.norm(change), _REACHED):
            return 0.0, -across * self._scaling, None
        balance = np.hstack([self._balance, (self._of_load @ change)[:, None]])
        cost = np.append(np.zeros(self._balance.shape[1]), -1.0)
        matrix = columns_of(np.vstack([balance, self._rows.matrix]))
        limits = np.concatenate([-self._of_load @ first, self._rows.limits])
        ended, cones = "", [clarabel.ZeroConeT(len(balance)), *self._rows.cones]
        for tolerance in _TOLERANCES:
            solution = solve_cones(cost, matrix, limits, cones, quiet_settings(tolerance))
            status = str(solution.status)
            normal = self._scaling * (np.asarray(solution.z)[: len(balance)] @ self._of_load)
            if status in USABLE:
                size = np.linalg.norm(normal)
                forces = self._unit * np.asarray(solution.x)[:-1].reshape(-1, 3)
                return float(solution.x[-1]), normal / size if size else normal, forces
            if status in INFEASIBLE:
                return -np.inf, normal, None
            ended = status
        raise SolverError(f"largest load: no answer from the convex program (Clarabel: {ended})")
