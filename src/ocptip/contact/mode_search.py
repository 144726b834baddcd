"""Exact search over all mode combinations of a support (branch-and-bound on convex programs).

A node allows every contact a list of its modes. Its relaxation drops the rule that only one mode's variables
may be positive: all variables of the allowed modes may be. An infeasible relaxation discards all mode
combinations of the node at once. So an exhausted search is a proof, up to the tolerance of the programs.
Pivoting can only report that it ended without a solution.

Two questions are asked:

* Is there any solution of the contact laws? (`find_solution`, linear programs)
* Is there a solution that moves? (`find_motion`) All contact models dissipate: contact forces do no positive
  work on the contact accelerations, hence qdd' M qdd <= h' qdd in every solution. So a solution moves
  exactly if h' qdd > 0, which is the linear objective, and the ball bounds it (one second-order cone).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import clarabel
import numpy as np
import scipy  # subpackages load on first use

from ocptip.contact.bindings import laws
from ocptip.contact.support import ContactSystem
from ocptip.numerics.cone_program import INFEASIBLE, USABLE, ConeColumns, quiet_settings, solve_cones

MOTION_TOLERANCE = 3e-9
"""Share of the free base's power that counts as motion: roughly, accelerations above 5e-5 of the free one."""

EXHAUSTED, FOUND, LIMIT = "exhausted", "found", "node limit"

_LP_TOLERANCE = 1e-10
_LP_ITERATIONS = 5000  # of a program; without a limit HiGHS may cycle on columns of very different size
_RESIDUAL = 1e-9
_POSITIVE = 1e-9
_INFEASIBLE = 1e-7
_PRICE = 1e-3
_REST = 1e-8  # accelerations, relative to the largest right-hand side, that cannot be told from rest
_RANK_TOLERANCE = 1e-9
_STICK, _SLIDE, _LIFT = 0, 1, 2


@dataclass(frozen=True)
class SearchResult:
    """Outcome of a search.

    Attributes:
        status: `"found"`, `"exhausted"` (proof that there is none) or `"node limit"` (undecided).
        subsets: (n,) the subset of each contact, if there is a solution.
        basic: (m,) values in canonical order, N, if there is a solution.
        residual: of the equations, relative to the largest right-hand side, if there is a solution.
        nodes: number of convex programs solved.
    """

    status: str
    subsets: np.ndarray | None
    basic: np.ndarray | None
    residual: float
    nodes: int


def find_solution(system: ContactSystem, wrench: np.ndarray, max_nodes: int = 20000) -> SearchResult:
    """Search for any solution of the contact laws under a wrench (6,)."""
    return _SolutionSearch(system, wrench).run(max_nodes)


def find_motion(system: ContactSystem, wrench: np.ndarray, max_nodes: int = 20000) -> SearchResult:
    """Search for a solution of the contact laws in which the base moves under a wrench (6,)."""
    return _MotionSearch(system, wrench).run(max_nodes)


class _SolutionSearch:
    """Depth-first search for any solution; one boolean mask over its modes per contact is a node."""

    def __init__(self, system: ContactSystem, wrench: np.ndarray) -> None:
        self.system = system
        rhs = system.rhs_matrix @ wrench + system.plain_rhs_offset
        self.scale = float(np.max(np.abs(rhs))) or 1.0
        self.rhs = rhs / self.scale
        self.modes = [_ModeList(contact) for contact in system.support.contacts]

    def run(self, max_nodes: int) -> SearchResult:
        # Depth first: the stack stays as short as the number of splits, and a solution is met early.
        stack = [[np.ones(len(modes.subsets), dtype=bool) for modes in self.modes]]
        nodes = 0
        undecided = False
        while stack:
            if nodes >= max_nodes:
                return SearchResult(LIMIT, None, None, np.inf, nodes)
            allowed = stack.pop()
            nodes += 1
            x = self._relaxation(allowed)
            if x is None:
                continue
            k = self._worst_contact(allowed, x)
            # All contacts fit a single mode: this is a candidate, which only counts on the original data.
            if k is None:
                result = self._verified(allowed, x)
                if result is not None:
                    return SearchResult(FOUND, *result, nodes)
                open_contacts = [j for j, mask in enumerate(allowed) if mask.sum() > 1]
                if not open_contacts:
                    undecided |= not self._excluded(allowed)
                    continue
                k = open_contacts[0]
            for part in self.modes[k].split(allowed[k]):
                child = list(allowed)
                child[k] = part
                stack.append(child)
        return SearchResult(LIMIT if undecided else EXHAUSTED, None, None, np.inf, nodes)

    def _columns(self, allowed: list[np.ndarray]) -> np.ndarray:
        """Columns of all variables of the allowed modes."""
        return np.concatenate(
            [
                first + np.flatnonzero(modes.member[mask].any(axis=0))
                for first, modes, mask in zip(self.system.first_column, self.modes, allowed, strict=True)
            ]
        )

    def _relaxation(self, allowed: list[np.ndarray]) -> np.ndarray | None:
        """A point of the node's relaxation; None if nothing in the node can be a solution.

        The equations are given slack, whose sum is minimised: this program always has a solution, so that
        a node is discarded because of a residual that was computed, never because of a status.
        """
        columns = self._columns(allowed)
        rows = len(self.rhs)
        equations = np.hstack([self.system.plain_matrix[:, columns], np.eye(rows), -np.eye(rows)])
        x = np.zeros(self.system.plain_matrix.shape[1])
        # first with a small price on x, whose sparse answers fit single modes soonest; then without
        for price in (_PRICE, 0.0):
            cost = np.concatenate([np.full(len(columns), price), np.ones(2 * rows)])
            result = linear_program(cost, equations, self.rhs)
            if result is not None and np.sum(result.x[len(columns) :]) <= _INFEASIBLE:
                x[columns] = result.x[: len(columns)]
                return x
            if result is not None and price == 0.0:
                return None
        # if no method decides, the node stays alive with x = 0 and is split further
        return x

    def _worst_contact(self, allowed: list[np.ndarray], x: np.ndarray) -> int | None:
        """The contact that breaks its laws most, of those whose positive variables fit no single mode."""
        support, system = self.system.support, self.system
        d = support.dimension
        force = (system.force_matrix @ x * self.scale + system.force_offset).reshape(-1, 1, d)
        acceleration = (system.acceleration_matrix @ x).reshape(-1, 1, d) * self.scale / support.mass
        worst, where = -1.0, None
        for k, (modes, mask) in enumerate(zip(self.modes, allowed, strict=True)):
            if len(modes.fitting(mask, self._positive(k, x))) == 0:
                violation = laws.law_violation(
                    support.contacts[k], force[k], acceleration[k], self.scale, support.mass
                )[0]
                if violation > worst:
                    worst, where = violation, k
        return where

    def _positive(self, k: int, x: np.ndarray) -> np.ndarray:
        first = self.system.first_column[k]
        return x[first : first + self.modes[k].member.shape[1]] > _POSITIVE

    def _verified(self, allowed, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float] | None:
        """Subsets, basic values and residual of a candidate, recomputed on the original data."""
        subsets = []
        for k, (modes, mask) in enumerate(zip(self.modes, allowed, strict=True)):
            fits = modes.fitting(mask, self._positive(k, x))
            if len(fits) == 0:
                return None
            subsets.append(modes.subsets[fits[0]])
        columns = self.system.active_columns(np.array([subsets]))[0]
        matrix = self.system.plain_matrix[:, columns]
        basic = x[columns]
        # The program is exact to its tolerances only. Least squares on the active columns removes that error;
        # the second round removes what the cut at 0 adds.
        for _ in range(2):
            corrected = basic + np.linalg.lstsq(matrix, self.rhs - matrix @ basic, rcond=1e-12)[0]
            basic = np.maximum(corrected, 0.0)
        residual = float(np.max(np.abs(matrix @ basic - self.rhs)))
        if residual > _RESIDUAL or not self._answers(columns, basic):
            return None
        return np.array(subsets), basic * self.scale, residual

    def _answers(self, columns: np.ndarray, basic: np.ndarray) -> bool:
        """True if a verified solution is one that was asked for."""
        return True

    def _excluded(self, allowed: list[np.ndarray]) -> bool:
        """True if it is certain that a single combination of modes, whose relaxation is feasible, is none."""
        return False


class _MotionSearch(_SolutionSearch):
    """Search for a solution in which the base moves.

    `y` is the base's acceleration in units in which y'y = qdd' M qdd, and `load` the free one, so that
    h' qdd = load'y and all solutions lie in the ball |y - load/2| <= |load|/2.
    """

    def __init__(self, system: ContactSystem, wrench: np.ndarray) -> None:
        super().__init__(system, wrench)
        support = system.support
        # With M = L L' the substitution y = L' qdd turns the ellipsoid qdd' M qdd <= h' qdd into a ball.
        root = np.linalg.cholesky(support.inverse_mass * support.mass)
        self.load = root.T @ wrench / self.scale
        self.size = float(np.linalg.norm(self.load))
        self.least = max(MOTION_TOLERANCE * self.size**2, _REST**2)
        W = root.T @ support.wrench_matrix
        self.Y = W @ system.force_matrix
        self.y0 = self.load + W @ system.force_offset / self.scale
        self.power = self.load @ self.Y / (self.size or 1.0)

    def run(self, max_nodes: int) -> SearchResult:
        if self.size <= _REST:
            return SearchResult(EXHAUSTED, None, None, 0.0, 0)
        return super().run(max_nodes)

    def _relaxation(self, allowed: list[np.ndarray]) -> np.ndarray | None:
        columns = self._columns(allowed)
        count, rows = len(columns), len(self.rhs)
        b = np.concatenate([self.rhs, np.zeros(count), [self.size / 2], self.y0 - self.load / 2])
        cones = [
            clarabel.ZeroConeT(rows),
            clarabel.NonnegativeConeT(count),
            clarabel.SecondOrderConeT(1 + len(self.load)),
        ]
        program = self._program(columns, rows)
        solution = solve_cones(-self.power[columns], program, b, cones, quiet_settings(1e-10))
        status = str(solution.status)
        # Only a proof of infeasibility, or a maximum power of rest, discards a node. Without a verdict of the
        # solver the node is split further, from x = 0.
        if status in INFEASIBLE:
            return None
        x = np.zeros(self.system.plain_matrix.shape[1])
        if status in USABLE:
            x[columns] = np.maximum(solution.x, 0.0)
            if self.load @ (self.Y @ x + self.y0) <= self.least:
                return None
        return x

    def _program(self, columns: np.ndarray, rows: int) -> Any:
        """Equations, x >= 0, and the ball: per column the dense equations, -1 on the diagonal, and -Y."""
        count, size = len(columns), len(self.load)
        data = np.empty((count, rows + 1 + size))
        data[:, :rows] = self.system.plain_matrix[:, columns].T
        data[:, rows] = -1.0
        data[:, rows + 1 :] = -self.Y[:, columns].T
        index = np.empty(data.shape, dtype=np.int64)
        index[:, :rows] = np.arange(rows)
        index[:, rows] = rows + np.arange(count)
        index[:, rows + 1 :] = rows + count + 1 + np.arange(size)
        starts = data.shape[1] * np.arange(count + 1)
        keep = data.ravel() != 0.0  # explicit zeros would cost time in every factorisation
        starts = np.concatenate([[0], np.cumsum(keep)])[starts]
        shape = (rows + count + 1 + size, count)
        return ConeColumns(data.ravel()[keep], index.ravel()[keep], starts, shape)

    def _positive(self, k: int, x: np.ndarray) -> np.ndarray:
        first = self.system.first_column[k]
        return x[first : first + self.modes[k].member.shape[1]] > 1e-7

    def _excluded(self, allowed: list[np.ndarray]) -> bool:
        columns = self._columns(allowed)
        matrix = self.system.plain_matrix[:, columns]
        power = self.power[columns]
        # With independent columns the combination has one candidate, which is computed. Otherwise a linear
        # program maximises the power over all its solutions.
        if np.linalg.matrix_rank(matrix, tol=_RANK_TOLERANCE) == len(columns):
            basic, *_ = np.linalg.lstsq(matrix, self.rhs, rcond=None)
            return bool(np.min(basic) < -_RESIDUAL) or not self._answers(columns, basic)
        result = linear_program(-power, matrix, self.rhs)
        if result is None:
            return False
        return result.status == 2 or (result.status == 0 and not self._answers(columns, result.x))

    def _answers(self, columns: np.ndarray, basic: np.ndarray) -> bool:
        return bool(self.load @ (self.Y[:, columns] @ basic + self.y0) > self.least)


def linear_program(cost: np.ndarray, equations: np.ndarray, rhs: np.ndarray):
    """Minimise cost'x over x >= 0 with HiGHS: the result (status 0 or 2), or None if no method decides."""
    options = {
        "primal_feasibility_tolerance": _LP_TOLERANCE,
        "dual_feasibility_tolerance": _LP_TOLERANCE,
        "maxiter": _LP_ITERATIONS,
    }
    # HiGHS sometimes ends without a verdict by one method; simplex and interior point fail on different
    # problems.
    for method in ("highs", "highs-ds", "highs-ipm"):
        result = scipy.optimize.linprog(cost, A_eq=equations, b_eq=rhs, method=method, options=options)
        if result.status in (0, 2):
            return result
    return None


class _ModeList:
    """The usable modes of one contact and how to split a selection of them."""

    def __init__(self, contact) -> None:
        automaton = contact.automaton
        self.subsets = np.flatnonzero(~automaton.redundant)
        active = automaton.subsets[self.subsets]
        self.member = np.zeros((len(active), len(contact.columns.names)), dtype=bool)
        np.put_along_axis(self.member, active, True, axis=1)
        acceleration = contact.columns.acceleration[:, active]  # (d, modes, places)
        moving = np.any(acceleration != 0, axis=(0, 2))
        lifting = np.any(acceleration[0] != 0, axis=1)
        self.family = np.where(lifting, _LIFT, np.where(moving, _SLIDE, _STICK))
        # The sum of the tangential columns points into the middle of the sector of directions in which the
        # mode slides.
        sum_t = acceleration[1:].sum(axis=2)
        self.angle = (
            np.arctan2(sum_t[-1], sum_t[0]) if len(sum_t) == 2 else np.where(sum_t[0] < 0, np.pi, 0.0)
        )

    def fitting(self, mask: np.ndarray, positive: np.ndarray) -> np.ndarray:
        """Modes of the selection that contain all positive variables."""
        return np.flatnonzero(mask & self.member[:, positive].all(axis=1))

    def split(self, mask: np.ndarray) -> list[np.ndarray]:
        """Two smaller selections: by what the contact does, then by direction, then by element."""
        families = np.unique(self.family[mask])
        if len(families) > 1:
            chosen = mask & (self.family == families[-1])
        elif families[0] != _STICK and len(self._angles(mask)) > 1:
            angles = self._angles(mask)
            # The circle is opened at its largest gap, so that both halves are connected arcs: forces of an
            # arc span a small convex set, which keeps the relaxation tight.
            gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
            start = angles[(np.argmax(gaps) + 1) % len(angles)]
            turned = np.mod(np.round(self.angle, 9) - start + 1e-6, 2 * np.pi)
            values = np.unique(np.round(turned[mask], 6))
            chosen = mask & (turned < values[len(values) // 2] - 1e-6)
        else:
            # The element that divides the modes most evenly gives the shallowest tree.
            counts = self.member[mask].sum(axis=0)
            j = int(np.argmax(np.minimum(counts, mask.sum() - counts)))
            chosen = mask & self.member[:, j]
        return [chosen, mask & ~chosen]

    def _angles(self, mask: np.ndarray) -> np.ndarray:
        return np.unique(np.round(self.angle[mask], 9))
