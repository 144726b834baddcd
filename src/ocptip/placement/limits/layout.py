"""Where the variables of the nonlinear program are, and what limits need to know at one point.

Variables x = (p, q of each task, s): the patch's parameters, joint angles, variables of the objective, and
contact forces. The criteria that are a maximum or a sum of amounts enter the objective through variables s: a
moment that all tipping moments exceed, a bound of all friction utilisations, of the force space's use, of
torque amounts.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.placement.limits.forces import ContactForces, Piece, Twice
from ocptip.placement.power import TorqueCost
from ocptip.placement.problem import CRITERIA, PlacementProblem
from ocptip.placement.stand import Stand
from ocptip.standing.footing import Footing


def corner_maps(problem: PlacementProblem) -> np.ndarray:
    """(K, 6, 9): wrenches at the corners of the tolerance per wrench of the nominal base and gravity.

    (1, 6, 6) where there is only the nominal base, so that gravity does not count.
    """
    maps = np.array([np.hstack([np.eye(6), corner.per_gravity]) for corner in problem.corners])
    return maps if np.any(maps[:, :, 6:]) else maps[:, :, :6]


class Variables:
    """Places of the variables, and which rows take part.

    Args:
        problem: the problem.
        stand: how the base stands on the patch.
        near: per task (m,) which gaps take part.
        held: numbers of the contact cases whose slip takes part.
        weighted: the criteria count; False: the objective is zero.
        least: bound of the moment that all tipping moments exceed; None where nothing tips.
        forces: contact forces as variables, or None.
        pieces: of the force sets to which they keep, per held case; None without forces.

    Contact cases are load cases at corners of the problem's tolerance: number K i + c is load case i at
    corner c of K.

    Attributes:
        k, n: numbers of parameters and of joints.
        cases: load cases.
        corners: (K, 6, 9): wrench on the base at each corner per wrench on the nominal base (6) and gravity
            (3) in base axes.
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
        stand: Stand,
        near: list[np.ndarray],
        held: list[int],
        weighted: bool,
        least: float | None,
        forces: ContactForces | None,
        pieces: list[Piece] | None,
    ) -> None:
        self.problem, self.near, self.held, self.forces, self.pieces = problem, near, held, forces, pieces
        self.stand, terrain = stand, stand.patch
        self.corners = corner_maps(problem)
        self.k, self.n, self.cases = terrain.size, problem.robot.arm.n, problem.cases
        self.counting = [i for i, case in enumerate(self.cases) if case.counts]
        self.weights = problem.weights.array() / [problem.references[c] for c in CRITERIA] * weighted
        self.size, self.x_bounds = 0, (np.empty(0), np.empty(0))
        self.p = self._add(terrain.lower, terrain.upper)
        angles = problem.robot.arm.angle_range(problem.limits.angle_margin)
        self.q = [self._add(*angles) for _ in problem.tasks]
        self.y = [np.r_[self.p, q] for q in self.q]
        loaded = any(self.cases[i].load >= 0 for i in self.counting) and len(problem.limited_joints) > 0
        self.slack: dict[str, int] = {}
        for name, wanted, low, high in (
            ("moment", self.weights[0] > 0 and least is not None, least or 0.0, np.inf),
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

    def _add(self, lower: ArrayLike, upper: ArrayLike) -> np.ndarray:
        """Places of further variables with these bounds."""
        self.x_bounds = np.append(self.x_bounds[0], lower), np.append(self.x_bounds[1], upper)
        first, self.size = self.size, len(self.x_bounds[0])
        return np.arange(first, self.size)

    def slack_of(self, name: str, i: int) -> int | None:
        """The objective's variable that bounds rows of a load case; None where a limit does."""
        return self.slack.get(name) if self.cases[i].counts else None

    def contact_case(self, j: int) -> tuple[int, np.ndarray]:
        """Number of the load case of a contact case, and its corner (6, 9)."""
        return j // len(self.corners), self.corners[j % len(self.corners)]

    def contact_cases(self, cases: list[int]) -> list[int]:
        """Numbers of all contact cases of some load cases."""
        count = len(self.corners)
        return [count * i + c for i in cases for c in range(count)]

    def unloaded(self, i: int) -> int:
        """Number of the load case without process load of the same task."""
        return next(c for c, case in enumerate(self.cases) if case.task == self.cases[i].task)


class Point:
    """One x, and what was computed there.

    Attributes:
        layout: of the variables.
        x: (nx,).
        loads: per load case (n + 9,): joint torques, N m, the wrench on the nominal base, N and N m, and
            gravity in base axes, m/s^2.
        slopes: per load case (n + 9, k + n): their derivatives with respect to y of its task.
    """

    def __init__(self, layout: Variables, loads: Twice, x: np.ndarray) -> None:
        self.layout, self.x = layout, x.copy()
        results = [loads.jacobian(x[layout.y[c.task]], c.force, c.moment) for c in layout.cases]
        self.loads, self.slopes = zip(*results, strict=True)
        self._known: dict[Hashable, Any] = {}

    @cached_property
    def wrenches(self) -> np.ndarray:
        """(contact cases, 6), N and N m."""
        loads = np.array([load[self.layout.n :] for load in self.loads])
        return np.einsum("kwg,ig->ikw", self.layout.corners, loads).reshape(-1, 6)

    def wrench_slope(self, j: int) -> np.ndarray:
        """(6, k + n): derivative of the wrench of a contact case with respect to y of its task."""
        i, corner = self.layout.contact_case(j)
        return corner @ self.slopes[i][self.layout.n :]

    @cached_property
    def footing(self) -> Footing:
        """The base on its contacts."""
        return self.layout.stand.footing(self.x[self.layout.p])

    def once(self, key: Hashable, evaluate: Callable[[], Any]) -> Any:
        """The value of `evaluate`, which is called once per key."""
        if key not in self._known:
            self._known[key] = evaluate()
        return self._known[key]


class Hessian:
    """Second derivatives of objective and rows, as they are added up.

    Attributes:
        matrix: (nx, nx).
        on_loads: (cases, n + 9): first derivatives by the loads of each case; the curvature of the loads
            follows.
        of_loads: (cases, n + 9, n + 9): second derivatives by the loads.
    """

    def __init__(self, layout: Variables) -> None:
        self.layout, self.matrix = layout, np.zeros((layout.size, layout.size))
        cases, loads = len(layout.cases), layout.n + layout.corners.shape[2]
        self.on_loads, self.of_loads = np.zeros((cases, loads)), np.zeros((cases, loads, loads))

    def add_on_wrench(self, j: int, slope: np.ndarray, bend: np.ndarray | None = None) -> None:
        """Add derivatives (6,) and (6, 6) by the wrench of a contact case."""
        i, corner = self.layout.contact_case(j)
        self.on_loads[i][self.layout.n :] += slope @ corner
        if bend is not None:
            self.of_loads[i][self.layout.n :, self.layout.n :] += corner.T @ bend @ corner

    def add(self, columns: np.ndarray, part: np.ndarray) -> None:
        """Add second derivatives by some variables."""
        self.matrix[np.ix_(columns, columns)] += part

    def add_mixed(self, column: int, columns: np.ndarray, part: np.ndarray) -> None:
        """Add second derivatives by one variable and by others."""
        self.matrix[column, columns] += part
        self.matrix[columns, column] += part
