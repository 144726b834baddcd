"""Where the variables of the nonlinear program are, and what limits need to know at one point.

Variables x = (p, q of each task, s): the patch's parameters, joint angles, variables of the objective, and
contact forces. The criteria that are a maximum or a sum of amounts enter the objective through variables s:
a moment that all tipping moments exceed, a bound of all slip reserves, of the force space's use, of torque
amounts.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ocptip.placement.limits.forces import ContactForces, Piece
from ocptip.placement.limits.twice import Twice
from ocptip.placement.power import TorqueCost
from ocptip.placement.problem import CRITERIA, PlacementProblem
from ocptip.placement.terrain import Patch


class Layout:
    """Places of the variables, and which rows take part.

    Args:
        problem: the problem.
        terrain: the patch.
        near: per task (m,) which gaps take part.
        held: numbers of the load cases whose slip takes part.
        weighted: the criteria count; False: the objective is zero.
        least: bound of the moment that all tipping moments exceed; None where nothing tips.
        forces: contact forces as variables, or None.
        pieces: of the force sets to which they keep, per held case; None without forces.

    Attributes:
        k, n: numbers of parameters and of joints.
        cases: load cases.
        counting: numbers of those that count in the criteria.
        weights: (4,) of the criteria, divided by their references.
        p, q, y: places of the parameters (k,), of the joint angles (n,) per task, and of both per task.
        slack: those of the objective's variables "moment", "slip" and "force", as far as they are needed.
        costly: numbers of the joints whose torque amounts cost something.
        amounts: per counting load case the places of their amounts; empty for an electric power.
        grip: the first place of contact forces.
        held_forces: places of the contact forces (3 contacts,) per held case; empty where they are none.
        size: number of variables.
        x_bounds: their bounds.
    """

    def __init__(
        self,
        problem: PlacementProblem,
        terrain: Patch,
        near: list[np.ndarray],
        held: list[int],
        weighted: bool,
        least: float | None,
        forces: ContactForces | None,
        pieces: list[Piece] | None,
    ) -> None:
        self.problem, self.near, self.held, self.forces, self.pieces = problem, near, held, forces, pieces
        self.k, self.n, self.cases = terrain.size, problem.robot.arm.n, problem.cases
        self.counting = [i for i, case in enumerate(self.cases) if case.counts]
        self.weights = problem.weights.array() / [problem.references[c] for c in CRITERIA] * weighted
        self.size, self.x_bounds = 0, (np.empty(0), np.empty(0))
        angles = problem.robot.arm.limits
        self.p = self._add(terrain.lower, terrain.upper)
        self.q = [self._add(angles.angle_min, angles.angle_max) for _ in problem.tasks]
        self.y = [np.r_[self.p, q] for q in self.q]
        loaded = any(self.cases[i].load >= 0 for i in self.counting) and len(problem.limited_joints) > 0
        self.slack: dict[str, int] = {}
        for name, wanted, low, high in (
            ("moment", self.weights[0] > 0 and least is not None, least, np.inf),
            ("slip", self.weights[1] > 0, 0.0, problem.limits.GT or 1.0),
            ("force", self.weights[2] > 0 and loaded, 0.0, np.inf),
        ):
            if wanted:
                self.slack[name] = int(self._add([low], [high])[0])
        self.costly, self.amounts = np.empty(0, dtype=int), {}
        if self.weights[3] > 0 and isinstance(problem.energy, TorqueCost):
            self.costly = problem.energy.joints
            zero = np.zeros(len(self.costly))
            self.amounts = {i: self._add(zero, zero + np.inf) for i in self.counting}
        self.grip = self.size
        self.held_forces = [self._add(*piece.bounds()) for piece in pieces or ()]

    def _add(self, lower: Sequence[float], upper: Sequence[float]) -> np.ndarray:
        """Places of further variables with these bounds."""
        self.x_bounds = np.append(self.x_bounds[0], lower), np.append(self.x_bounds[1], upper)
        first, self.size = self.size, len(self.x_bounds[0])
        return np.arange(first, self.size)

    def slack_of(self, name: str, i: int) -> int | None:
        """The objective's variable that bounds rows of a load case; None where a limit does."""
        return self.slack.get(name) if self.cases[i].counts else None

    def unloaded(self, i: int) -> int:
        """Number of the load case without process load of the same task."""
        return next(c for c, case in enumerate(self.cases) if case.task == self.cases[i].task)


class Point:
    """One x, and what was computed there.

    Attributes:
        layout: of the variables.
        x: (nx,).
        loads: per load case (n + 6,): joint torques, N m, and the wrench on the base, N and N m.
        slopes: per load case (n + 6, k + n): their derivatives with respect to y of its task.
    """

    def __init__(self, layout: Layout, loads: Twice, x: np.ndarray) -> None:
        self.layout, self.x = layout, x.copy()
        found = [loads.jacobian(x[layout.y[c.task]], c.force, c.moment) for c in layout.cases]
        self.loads, self.slopes = zip(*found, strict=True)
        self._known: dict[Hashable, Any] = {}

    @cached_property
    def wrenches(self) -> np.ndarray:
        """(cases, 6), N and N m."""
        return np.array([load[self.layout.n :] for load in self.loads])

    def once(self, key: Hashable, evaluate: Callable[[], Any]) -> Any:
        """What `evaluate` returns, called for a key once."""
        if key not in self._known:
            self._known[key] = evaluate()
        return self._known[key]


class Curvature:
    """Second derivatives of objective and rows, as they are added up.

    Attributes:
        matrix: (nx, nx).
        on_loads: (cases, n + 6): first derivatives by the loads of each case; their own curvature follows.
        of_loads: (cases, n + 6, n + 6): second derivatives by the loads.
    """

    def __init__(self, size: int, cases: int, loads: int) -> None:
        self.matrix = np.zeros((size, size))
        self.on_loads, self.of_loads = np.zeros((cases, loads)), np.zeros((cases, loads, loads))

    def add(self, columns: np.ndarray, part: np.ndarray) -> None:
        """Add second derivatives by some variables."""
        self.matrix[np.ix_(columns, columns)] += part

    def add_mixed(self, column: int, columns: np.ndarray, part: np.ndarray) -> None:
        """Add second derivatives by one variable and by others."""
        self.matrix[column, columns] += part
        self.matrix[columns, column] += part
