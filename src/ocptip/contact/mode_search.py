"""Exact search over all mode combinations of a support (branch and bound on linear programs).

A node allows every contact a list of its modes. Its relaxation drops the rule that only one mode's
variables may be positive: all variables of the allowed modes may be. An infeasible relaxation discards
all mode combinations of the node at once, so an exhausted search is a proof (up to the tolerance of the
linear programs), where pivoting can only say that it found nothing.

Two questions are asked:

* Is there any solution of the contact laws? (`find_solution`)
* Is there a solution that moves? (`find_motion`) All bindings dissipate: contact forces do no positive
  work on the contact accelerations, hence qdd' M qdd <= h' qdd in every solution. So a solution moves
  exactly if h' qdd > 0, which is the linear objective, and the ball bounds it (as tangent planes).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from ocptip.contact.support import ContactSystem

EXHAUSTED, FOUND, LIMIT = "exhausted", "found", "node limit"

_LP_TOLERANCE = 1e-10
_POSITIVE = 1e-9
_MOTION_TOLERANCE = 1e-7
_MAX_CUTS = 12


@dataclass(frozen=True)
class SearchResult:
    """Outcome of a search.

    Attributes:
        status: "found", "exhausted" (proof that there is none) or "node limit" (undecided).
        subsets: (n,) the subset of each contact, if found.
        basic: (m,) values in canonical order, N, if found.
        residual: of the equations, relative to the largest right-hand side, if found.
        nodes: number of linear programs solved.
    """

    status: str
    subsets: np.ndarray | None
    basic: np.ndarray | None
    residual: float
    nodes: int


def find_solution(system: ContactSystem, wrench: np.ndarray, max_nodes: int = 20000) -> SearchResult:
    """Search for any solution of the contact laws under a wrench (6,)."""
    return _Search(system, wrench, motion=False).run(max_nodes)


def find_motion(system: ContactSystem, wrench: np.ndarray, max_nodes: int = 20000) -> SearchResult:
    """Search for a solution of the contact laws in which the base moves under a wrench (6,)."""
    return _Search(system, wrench, motion=True).run(max_nodes)


class _Search:
    def __init__(self, system: ContactSystem, wrench: np.ndarray, *, motion: bool) -> None:
        self.system, self.motion = system, motion
        rhs = system.rhs_matrix @ wrench + system.plain_rhs_offset
        self.scale = float(np.max(np.abs(rhs))) or 1.0
        self.rhs = rhs / self.scale
        self.modes = []  # per contact: (subset numbers, membership matrix over the contact's pool)
        for contact in system.support.contacts:
            automaton = contact.automaton
            usable = np.flatnonzero(~automaton.redundant)
            member = np.zeros((len(usable), len(contact.columns.names)), dtype=bool)
            np.put_along_axis(member, automaton.subsets[usable], True, axis=1)
            self.modes.append((usable, member))
        if motion:
            self._prepare_motion(wrench)

    def _prepare_motion(self, wrench: np.ndarray) -> None:
        """Base motion in metric units y with y'y = qdd' M qdd, as a linear map of x: y = Y x + y0."""
        support, system = self.system.support, self.system
        d = support.dimension
        root = np.linalg.cholesky(support.inverse_mass * support.mass)  # M^-1 = root root' / mass
        self.load = root.T @ wrench / self.scale  # h' qdd = load' y, in units of scale^2 / mass
        W = root.T @ support.wrench_matrix
        self.Y = W @ system.force_matrix
        self.y0 = self.load + W @ system.force_offset / self.scale
        # contact rows of the system speak of the same motion; keep both, the program is then tighter
        self.cuts: list[tuple[np.ndarray, float]] = []
        self.least = _MOTION_TOLERANCE * max(float(self.load @ self.load), 1e-300)
        self.d = d

    def run(self, max_nodes: int) -> SearchResult:
        """Depth-first search."""
        if self.motion and not np.any(self.load):
            return SearchResult(EXHAUSTED, None, None, 0.0, 0)
        stack = [[np.ones(len(usable), dtype=bool) for usable, _ in self.modes]]
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
            branch = self._branch(allowed, x)
            if branch is None:
                found = self._verified(allowed, x)
                if found is not None:
                    return SearchResult(FOUND, *found, nodes)
                branch = self._split_any(allowed)
                if branch is None:
                    undecided = True
                    continue
            stack += branch
        return SearchResult(LIMIT if undecided else EXHAUSTED, None, None, np.inf, nodes)

    def _relaxation(self, allowed: list[np.ndarray]) -> np.ndarray | None:
        """Solve the node's linear program; None if nothing in the node can be a solution."""
        columns = np.concatenate(
            [
                first + np.flatnonzero(member[mask].any(axis=0))
                for first, (_, member), mask in zip(
                    self.system.first_column, self.modes, allowed, strict=True
                )
            ]
        )
        equations = self.system.plain_matrix[:, columns]
        x = np.zeros(self.system.plain_matrix.shape[1])
        if not self.motion:
            values = _linear_program(np.ones(len(columns)), equations, self.rhs)
            if values is None:
                return None
            x[columns] = values
            return x
        power = self.load @ self.Y[:, columns]
        constant = float(self.load @ self.y0)
        for _ in range(_MAX_CUTS):
            # y'y <= load'y: tangent planes 2 c'y - c'c <= load'y
            rows = [(2.0 * c - self.load) @ self.Y[:, columns] for c in self._centres()]
            limits = [c @ c - (2.0 * c - self.load) @ self.y0 for c in self._centres()]
            values = _linear_program(-power, equations, self.rhs, np.array(rows), np.array(limits))
            if values is None or power @ values + constant <= self.least:
                return None
            x[columns] = values
            y = self.Y @ x + self.y0
            if y @ y <= self.load @ y * (1.0 + 1e-6) + 1e-12:
                break
            self.cuts.append(y)
        return x

    def _centres(self) -> list[np.ndarray]:
        size = float(np.linalg.norm(self.load))
        axes = [s * size * e for e in np.eye(len(self.load)) for s in (0.5, -0.5)]
        return [np.zeros_like(self.load), self.load, *axes, *self.cuts[-40:]]

    def _branch(self, allowed: list[np.ndarray], x: np.ndarray) -> list[list[np.ndarray]] | None:
        """Split the contact whose positive variables fit no single mode; None if all fit."""
        best = None
        for k, ((_, member), mask) in enumerate(zip(self.modes, allowed, strict=True)):
            first = self.system.first_column[k]
            positive = np.flatnonzero(x[first : first + member.shape[1]] > _POSITIVE)
            if member[mask][:, positive].all(axis=1).any():
                continue
            counts = member[mask][:, positive].sum(axis=0)
            balance = np.minimum(counts, mask.sum() - counts)
            j = int(np.argmax(balance))
            if balance[j] > 0 and (best is None or balance[j] > best[0]):
                best = (balance[j], k, positive[j])
        return None if best is None else self._split(allowed, best[1], best[2])

    def _split_any(self, allowed: list[np.ndarray]) -> list[list[np.ndarray]] | None:
        """Split some contact that still has a choice."""
        for k, ((_, member), mask) in enumerate(zip(self.modes, allowed, strict=True)):
            counts = member[mask].sum(axis=0)
            balance = np.minimum(counts, mask.sum() - counts)
            j = int(np.argmax(balance))
            if balance[j] > 0:
                return self._split(allowed, k, j)
        return None

    def _split(self, allowed: list[np.ndarray], k: int, j: int) -> list[list[np.ndarray]]:
        having = self.modes[k][1][:, j]
        without, within = list(allowed), list(allowed)
        without[k] = allowed[k] & ~having
        within[k] = allowed[k] & having
        return [without, within]

    def _verified(self, allowed, x: np.ndarray):
        """Subsets, basic values and residual of a candidate, recomputed on the original data."""
        subsets, columns = [], []
        for k, ((usable, member), mask) in enumerate(zip(self.modes, allowed, strict=True)):
            first = self.system.first_column[k]
            positive = x[first : first + member.shape[1]] > _POSITIVE
            fits = np.flatnonzero(mask & member[:, positive].all(axis=1))
            if len(fits) == 0:
                return None
            subsets.append(usable[fits[0]])
            automaton = self.system.support.contacts[k].automaton
            columns.append(first + automaton.subsets[usable[fits[0]]])
        columns = np.concatenate(columns)
        matrix = self.system.plain_matrix[:, columns]
        basic = x[columns]
        correction = np.linalg.lstsq(matrix, self.rhs - matrix @ basic, rcond=1e-12)[0]
        if np.min(basic + correction) >= -_LP_TOLERANCE:
            basic = basic + correction
        basic = np.maximum(basic, 0.0)
        residual = float(np.max(np.abs(matrix @ basic - self.rhs)))
        if residual > 10 * _LP_TOLERANCE:
            return None
        if self.motion:
            y = self.Y[:, columns] @ basic + self.y0
            if self.load @ y <= self.least:
                return None
        return np.array(subsets), basic * self.scale, residual


def _linear_program(cost, equations, rhs, rows=None, limits=None) -> np.ndarray | None:
    """Minimise cost'x, x >= 0, with HiGHS; None if infeasible."""
    options = {
        "primal_feasibility_tolerance": _LP_TOLERANCE,
        "dual_feasibility_tolerance": _LP_TOLERANCE,
    }
    for method in ("highs", "highs-ds", "highs-ipm"):
        result = linprog(
            cost, A_ub=rows, b_ub=limits, A_eq=equations, b_eq=rhs, method=method, options=options
        )
        if result.status == 0:
            return result.x
        if result.status == 2:
            return None
    # undecided by three methods: keep the node alive with an empty point so that it is split further
    return np.zeros(len(cost))
