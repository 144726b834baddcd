"""The optimal-control problem of velocity profiles as a nonlinear program with exact derivatives.

Minimum cost (energy, time or both) over the variables of `profiles`, subject to

- the structure: every joint arrives, brakes with the deceleration of its last phase, keeps its acceleration
  limit, ends no later than t_E; in an ordered program also the order of all switching times and the signs of
  speeds;
- rows at nodes: those of the limits (`standing.limit_kinds.limit`).

Most node rows are far from their limits; only those that are near take part (`RowSet`), the others are
checked after each solve.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ocptip.basics.errors import SolverError
from ocptip.motion.objective import Objective
from ocptip.motion.planner.node_physics import NodeJacobian, NodePhysics
from ocptip.motion.planner.profiles import Layout, Nodes, NodeStates
from ocptip.numerics.batch import PointFunction
from ocptip.numerics.ipopt import Solution, solve
from ocptip.standing.instants import Instants, NodeColumns
from ocptip.standing.limit_kinds.limit import Limit
from ocptip.standing.limit_kinds.rows import NodeRows, RowNodes

POWER = NodeColumns.power


@dataclass(frozen=True, eq=False)
class RowSet:
    """Which node rows take part in a program.

    Attributes:
        masks: by name of the limit, (N, width of the limit).
    """

    masks: dict[str, np.ndarray]

    def __getitem__(self, name: str) -> np.ndarray:
        """Rows of the limit of that name."""
        return self.masks[name]

    def __sub__(self, other: RowSet) -> int:
        """How many rows are in this set and not in the other."""
        return sum(int(np.sum(mask & ~other[name])) for name, mask in self.masks.items())

    def including(self, other: RowSet) -> RowSet:
        """Rows that are in this set or, at the first of these nodes, in the other."""
        masks = {name: mask.copy() for name, mask in self.masks.items()}
        for name, mask in masks.items():
            mask[: len(other[name])] |= other[name]
        return RowSet(masks)

    @property
    def at_nodes(self) -> np.ndarray:
        """(N,) True where a row of the node takes part."""
        return np.any(np.hstack(list(self.masks.values())), axis=1)


@dataclass(frozen=True, eq=False)
class Structure:
    """Rows that depend on x only: equalities, limits of velocity profiles, order of switching times.

    Attributes:
        function: CasADi function x -> g.
        lower, upper: bounds of g.
        x_lower, x_upper: bounds of x.
    """

    function: cs.Function
    lower: np.ndarray
    upper: np.ndarray
    x_lower: np.ndarray
    x_upper: np.ndarray

    def rows(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (rows,) and Jacobian (rows, nx)."""
        values, jacobian = self._first(x)
        return values, jacobian

    def hessian(self, x: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """Hessian (nx, nx) of multipliers . rows."""
        return self._second(x, multipliers)[0]

    @cached_property
    def pattern(self) -> np.ndarray:
        """(rows, nx) True where the Jacobian may differ from zero."""
        filled = np.zeros((len(self.lower), len(self.x_lower)), dtype=bool)
        filled[self.function.jac_sparsity(0, 0).get_triplet()] = True
        return filled

    @cached_property
    def _first(self) -> PointFunction:
        x = cs.SX.sym("x", len(self.x_lower))
        g = self.function(x)
        return PointFunction(cs.Function("structure", [x], [g, cs.jacobian(g, x)]))

    @cached_property
    def _second(self) -> PointFunction:
        x, lam = cs.SX.sym("x", len(self.x_lower)), cs.SX.sym("lam", len(self.lower))
        hessian, _ = cs.hessian(cs.dot(lam, self.function(x)), x)
        return PointFunction(cs.Function("structure_hessian", [x, lam], [hessian]))


@dataclass(frozen=True)
class Pull:
    """The term 0.5 weight |x - anchor|^2 of the objective: regular where phases of the motion do nothing.

    Attributes:
        anchor: (nx,).
        weight: in units of the objective.
    """

    anchor: np.ndarray
    weight: float


class ProgramNodes(RowNodes):
    """The nodes of a program at one x, as rows of limits are made of them.

    Args:
        states, physics: of the nodes.
        columns: of the quantities.
    """

    def __init__(self, states: NodeStates, physics: NodeJacobian, columns: NodeColumns) -> None:
        super().__init__(columns, np.ascontiguousarray(states.values.T), physics.y)
        self.states, self.physics = states, physics

    def by_states(self, nodes: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        return self.states.over_all(nodes, slopes)

    def by_quantities(self, nodes: np.ndarray, first: int | np.ndarray, slopes: np.ndarray) -> np.ndarray:
        return self.states.over_all(nodes, self.physics.over_states(nodes, first, slopes))

    @cached_property
    def of_power(self) -> np.ndarray:
        """Slopes (nx, N) of the nodes' power."""
        return self.states.over_all_everywhere(self.physics.power)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """First-order data of a program at one x.

    Attributes:
        x: (nx,), its bytes: they are compared at every call.
        nodes: states and physics.
        durations: (N,), s, quadrature weights.
        of_structure: Jacobian of the structure.
        rows: of the limits that have some.
        values: objective and rows.
    """

    x: bytes
    nodes: ProgramNodes
    durations: np.ndarray
    of_structure: np.ndarray
    rows: list[NodeRows]
    values: tuple[float, np.ndarray]


class MotionProgram:
    """The nonlinear program over given nodes. It does not change; :meth:`with_rows` gives another one.

    Args:
        physics: of the robot.
        limits: to keep at the nodes (already tightened by the caller if need be).
        layout: of the variables.
        nodes: where energy and rows are evaluated.
        weights: (N, nx): the quadrature weights, s, are weights @ x; zero for nodes of rows only.
        directions: (N, n) directions of motion for the power.
        structure: rows in x.
        objective: what is minimised.
        rows: node rows that take part; default none.
        pull: a term of the objective; default none.
    """

    def __init__(
        self,
        physics: NodePhysics,
        limits: tuple[Limit, ...],
        layout: Layout,
        nodes: Nodes,
        weights: np.ndarray,
        directions: np.ndarray,
        structure: Structure,
        objective: Objective,
        rows: RowSet | None = None,
        pull: Pull | None = None,
    ) -> None:
        self.physics, self.limits, self.layout = physics, limits, layout
        self.nodes, self.weights, self.structure = nodes, weights, structure
        self._directions = np.ascontiguousarray(directions.T)  # nodes side by side, as all that physics takes
        self.objective = objective
        self.rows, self.pull = rows if rows is not None else self.no_rows(), pull
        self._used = [limit for limit in limits if self.rows[limit.name].any()]
        self._last: Evaluation | None = None
        self._sloped: tuple[Evaluation, np.ndarray] | None = None
        self._latest: tuple[np.ndarray, Instants] | None = None
        self._parts: dict[bytes, Instants] = {}  # of the latest

    def with_rows(
        self, rows: RowSet, pull: Pull | None = None, near: np.ndarray | None = None
    ) -> MotionProgram:
        """This program with other node rows, as they are `near` these variables, and with this pull."""
        limits = self.limits
        if near is not None:
            limits = tuple(limit.chosen(self._instants(near)) for limit in limits)
        parts = self.physics, limits, self.layout, self.nodes, self.weights, self._directions.T
        return MotionProgram(*parts, self.structure, self.objective, rows, pull)

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.weights)

    def no_rows(self) -> RowSet:
        """A row set without rows."""
        shapes = {limit.name: (self.n_nodes, limit.width) for limit in self.limits}
        return RowSet({name: np.zeros(shape, dtype=bool) for name, shape in shapes.items()})

    def near_rows(self, x: np.ndarray, share: float, nodes: slice = slice(None)) -> RowSet:
        """Rows of some nodes whose use of their limit at x is at least `share` (1: at the limit)."""
        return RowSet(
            dict(self._of_limits(x, nodes, lambda limit, instants: limit.near(instants, share), False))
        )

    def use(self, x: np.ndarray, nodes: slice = slice(None)) -> np.ndarray:
        """Worst use of any limit at some nodes: 1 at the limit, more beyond; rows need not take part."""
        uses = self._of_limits(x, nodes, lambda limit, instants: limit.use(instants), -np.inf)
        return np.max([values for _, values in uses], axis=0)

    def _of_limits(
        self,
        x: np.ndarray,
        nodes: slice,
        evaluate: Callable[[Limit, Instants], np.ndarray],
        elsewhere: float | bool,
    ) -> Iterator[tuple[str, np.ndarray]]:
        """Names of limits, and their values at those of the nodes that each is about; others `elsewhere`.

        There may be tens of thousands of nodes with deviating joints, which most limits are not about.
        """
        numbers = np.arange(self.n_nodes)[nodes]
        for limit in self.limits:
            about = np.isin(self.nodes.kinds[nodes], limit.node_kinds)
            values = evaluate(limit, self.instants(x, numbers[about]))
            every = np.full((len(about), *values.shape[1:]), elsewhere, dtype=values.dtype)
            every[about] = values
            yield limit.name, every

    def most_broken(self, x: np.ndarray) -> str:
        """The limit whose row is farthest from its bounds at x, in words."""
        (lower, upper), values = self.bounds(), self.values(x)[1]
        names = ["timing"] * len(self.structure.lower)
        for limit in self._used:
            names += [limit.name.replace("_", " ")] * int(np.count_nonzero(self.rows[limit.name]))
        return names[int(np.argmax(np.maximum(lower - values, values - upper)))] if names else "range"

    def instants(self, x: np.ndarray, nodes: np.ndarray) -> Instants:
        """Some of the nodes as limits evaluate them; the same again share what was computed of them."""
        every = self._instants(x)
        if len(nodes) == self.n_nodes:
            return every
        key = nodes.tobytes()
        if key not in self._parts:
            self._parts[key] = every.some(nodes)
        return self._parts[key]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of all rows, in the order of `values`."""
        lower, upper = [self.structure.lower], [self.structure.upper]
        for limit in self._used:
            places = np.nonzero(self.rows[limit.name])[1]
            for bounds, ends in zip((lower, upper), limit.bounds(), strict=True):
                bounds.append(ends[places])
        return np.concatenate(lower), np.concatenate(upper)

    def carried(self, multipliers: np.ndarray, rows: RowSet) -> np.ndarray:
        """Multipliers of a program with other rows at the first of these nodes, for this program's rows."""
        index = len(self.structure.lower)
        result = [multipliers[:index]]
        for name, new in self.rows.masks.items():
            old = rows[name]
            full, size = np.zeros(new.shape), np.count_nonzero(old)
            full[: len(old)][old] = multipliers[index : index + size]
            result.append(full[new])
            index += size
        return np.concatenate(result)

    def solve(self, x: np.ndarray, **options: Any) -> Solution:
        """Solve from x; options of `numerics.ipopt.solve`."""
        structure, bounds, nx = self.structure, self.bounds(), self.layout.size
        at_nodes = np.ones((len(bounds[0]) - len(structure.lower), nx), dtype=bool)
        pattern = np.vstack([structure.pattern, at_nodes]), np.ones((nx, nx), dtype=bool)
        return solve(self, x, (structure.x_lower, structure.x_upper), bounds, pattern=pattern, **options)

    def energy(self, x: np.ndarray) -> float:
        """Electric energy by the nodes' quadrature, J."""
        y = self.physics.values(self.nodes.values(x), self._directions)
        return float((self.weights @ x) @ y[:, POWER])

    def values(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Objective and rows."""
        return self._evaluate(x).values

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """Gradient of the objective (nx,)."""
        evaluation = self._evaluate(x)
        if self._sloped is None or self._sloped[0] is not evaluation:  # Ipopt asks twice
            self._sloped = evaluation, self._gradient(evaluation, x)
        return self._sloped[1]

    def _gradient(self, evaluation: Evaluation, x: np.ndarray) -> np.ndarray:
        gradient = (
            evaluation.nodes.y[:, POWER] @ self.weights + evaluation.nodes.of_power @ evaluation.durations
        )
        gradient = self.objective.energy_weight * gradient / self.objective.size
        gradient[self.layout.end] += self.objective.time_weight / self.objective.size
        return gradient + self.pull.weight * (x - self.pull.anchor) if self.pull else gradient

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Jacobian of the rows (rows, nx)."""
        evaluation = self._evaluate(x)
        parts = [limit.jacobian(rows) for limit, rows in zip(self._used, evaluation.rows, strict=True)]
        return np.concatenate([evaluation.of_structure, *parts])

    def hessian(self, x: np.ndarray, sigma: float, multipliers: np.ndarray) -> np.ndarray:
        """Hessian of sigma * objective + multipliers . rows."""
        evaluation = self._evaluate(x)
        nodes, of_energy = evaluation.nodes, sigma * self.objective.energy_weight / self.objective.size
        first, parts = len(self.structure.lower), list[tuple[Limit, NodeRows, np.ndarray]]()
        on_g = multipliers[:first]
        for limit, rows in zip(self._used, evaluation.rows, strict=True):
            last = first + len(rows.values)
            parts.append((limit, rows, multipliers[first:last]))
            first = last
        on_y = np.zeros(nodes.y.shape)
        on_y[:, POWER] = of_energy * evaluation.durations
        for limit, rows, on in parts:
            limit.add_to_quantities(rows, on, on_y)
        H = self.physics.hessian(nodes.physics, on_y)
        for limit, rows, on in parts:
            limit.add_hessian(rows, on, H, H.slopes.T)
        result = self.structure.hessian(x, on_g)
        mixed = of_energy * nodes.of_power @ self.weights
        nodes.states.add_hessian(result, x, H.upper, H.slopes, mixed)
        if self.pull:
            np.einsum("xx->x", result)[:] += sigma * self.pull.weight
        return result

    def _instants(self, x: np.ndarray) -> Instants:
        """The nodes as limits evaluate them."""
        if self._latest is None or not np.array_equal(self._latest[0], x):
            s, columns = self.nodes.values(x), self.physics.columns
            y = self.physics.values(s, self._directions)
            parts = y[:, columns.torque], y[:, columns.wrench], y[:, columns.further]
            n = self.physics.n
            q, qd, qdd, process = np.split(np.ascontiguousarray(s.T), [n, 2 * n, 3 * n], axis=1)
            self._parts.clear()
            before = self.nodes.before(x)
            self._latest = x.copy(), Instants(self.physics.robot, q, *parts, qd, qdd, process, before=before)
        return self._latest[1]

    def _evaluate(self, x: np.ndarray) -> Evaluation:
        key = x.tobytes()
        if self._last is not None and self._last.x == key:
            return self._last
        states = self.nodes.states(x)
        physics = self.physics.jacobian(states.values, self._directions)
        if not np.isfinite(physics.y).all():
            raise SolverError("motion program: dynamics are not finite")
        nodes = ProgramNodes(states, physics, self.physics.columns)
        rows = [limit.rows(nodes, self.rows[limit.name]) for limit in self._used]
        durations, (values, of_structure), of = self.weights @ x, self.structure.rows(x), self.objective
        cost = of.cost(float(durations @ nodes.y[:, POWER]), x[self.layout.end]) / of.size
        if self.pull:
            away = x - self.pull.anchor
            cost += 0.5 * self.pull.weight * float(away @ away)
        values = cost, np.concatenate([values, *(row.values for row in rows)])
        self._last = Evaluation(key, nodes, durations, of_structure, rows, values)
        return self._last
