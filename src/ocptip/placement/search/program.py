"""The placement as a nonlinear program with exact derivatives (4.38, 4.39).

Rows are those of the limits (`ocptip.placement.limits`); each block knows its place and the variables that it
depends on. Tip-over moments and friction utilisation come from the contact solver with its exact derivatives;
where all contact forces may be redistributed, they are variables themselves.

Where no placement keeps all limits, an `ElasticProgram` relaxes them. Each kind of constraint of each load
case has one violation e >= 0 in units of 0.1 m, 0.2 rad or its limit. Their sum is small where few
constraints are broken, so that its minimum names those that fail: all others hold there.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ocptip.numerics.batch import BatchFunction
from ocptip.placement.limits.arm import JointAngles, Reach
from ocptip.placement.limits.forces import Piece
from ocptip.placement.limits.layout import Hessian, Point, Variables
from ocptip.placement.limits.limit import ANGLE_UNIT, CaseRows
from ocptip.placement.search.physics import PatchPhysics


class PlacementObjective:
    """Weighted sum of the normalised criteria.

    Args:
        layout: of the variables.
        power: of torques (1, n): power, its gradient and the diagonal of its Hessian; None for a torque cost.
    """

    def __init__(self, layout: Variables, power: BatchFunction | None) -> None:
        self._layout, self._function, self._weights = layout, power, layout.weights
        self._share = layout.weights[3] / len(layout.counting)
        self._powered = layout.counting if self._share > 0 and power is not None else []
        self._linear = [
            (layout.slack[name], weight)
            for name, weight in zip(("slip", "force"), layout.weights[1:3], strict=True)
            if name in layout.slack
        ]
        self._amounts = np.concatenate([np.empty(0, dtype=int), *layout.amounts.values()])
        if layout.amounts:
            cost = self._share * layout.problem.energy.cost[layout.costly]
            self._cost = np.tile(cost, len(layout.amounts))

    def _power(self, point: Point) -> dict[int, list[np.ndarray]]:
        """Per counting case power, its gradient (n,) and the diagonal of its Hessian (n,) by the torques."""
        power, n = self._function, self._layout.n
        assert power is not None  # else no case is powered
        return point.once(
            self, lambda: {i: [part[0] for part in power(point.loads[i][None, :n])] for i in self._powered}
        )

    def value(self, point: Point) -> float:
        """At a point."""
        value, x = 0.0, point.x
        if (s := self._layout.slack.get("moment")) is not None:
            value += self._weights[0] / (1 + 2 * x[s])  # GN of a moment in units of 2 M0
        for column, weight in self._linear:
            value += weight * x[column]
        if len(self._amounts):
            value += float(self._cost @ x[self._amounts])
        for i in self._powered:
            value += self._share * float(self._power(point)[i][0][0])
        return value

    def gradient(self, point: Point) -> np.ndarray:
        """(nx,)."""
        layout, gradient = self._layout, np.zeros(self._layout.size)
        if (s := self._layout.slack.get("moment")) is not None:
            gradient[s] = -2 * self._weights[0] / (1 + 2 * point.x[s]) ** 2
        for column, weight in self._linear:
            gradient[column] = weight
        if len(self._amounts):
            gradient[self._amounts] = self._cost
        for i in self._powered:
            slope = self._power(point)[i][1] @ point.slopes[i][: layout.n]
            gradient[layout.y[layout.cases[i].task]] += self._share * slope
        return gradient

    def add_hessian(self, sums: Hessian, point: Point, sigma: float) -> None:
        """Add sigma times its second derivatives."""
        if (s := self._layout.slack.get("moment")) is not None:
            sums.matrix[s, s] += sigma * 8 * self._weights[0] / (1 + 2 * point.x[s]) ** 3
        joints, share = np.arange(self._layout.n), sigma * self._weights[3] / len(self._layout.counting)
        for i in self._powered:
            _, slope, bend = self._power(point)[i]
            sums.on_loads[i][joints] += share * slope
            sums.of_loads[i][joints, joints] += share * bend


class PlacementProgram(Variables):
    """Values and derivatives for `ocptip.numerics.ipopt.solve`.

    Args:
        physics: of the patch.
        near: per task (m,) which gaps take part.
        held: numbers of the contact cases whose slip takes part: the counting ones if GT has a weight, and
            those that may come to their limit.
        pieces: per held case the pieces of the force sets, where forces are variables.
        criteria: False: only the constraints, with objective zero.

    Attributes:
        limits: with the blocks of their rows.
        labels, bounds: of all rows.
    """

    def __init__(
        self,
        physics: PatchPhysics,
        near: list[np.ndarray],
        held: list[int],
        pieces: list[Piece] | None = None,
        criteria: bool = True,
    ) -> None:
        tip = physics.evaluator.tip_over
        least = tip.quantity.least_moment / tip.quantity.unit if tip.moments.count else None
        problem, stand, forces = physics.problem, physics.stand, physics.forces
        super().__init__(problem, stand, near, held, criteria, least, forces, pieces)
        self.physics, self.objective = physics, PlacementObjective(self, physics.power)
        self.limits = [(limit, limit.blocks(self, function)) for limit, function in physics.functions.items()]
        blocks, count = [block for _, function in self.limits for block in function], 0
        for block in blocks:
            block.rows = slice(count, count + len(block.labels))
            count = block.rows.stop
        self.labels = tuple(label for block in blocks for label in block.labels)
        self.bounds = _stacked(blocks, "lower"), _stacked(blocks, "upper")
        self._last: Point | None = None

    def start(self, p: np.ndarray, q: np.ndarray) -> np.ndarray:
        """x for parameters (k,) and joint angles (tasks, n), with the values s just as large as needed."""
        x = np.zeros(self.size)
        x[: self.k] = p
        x[self.k : self.k + q.size] = q.ravel()
        point = Point(self, self.physics.loads, x)
        for limit, _ in self.limits:
            limit.start(point, x)
        return np.clip(x, *self.x_bounds)

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (k,) and joint angles (tasks, n) of x."""
        return x[self.p], x[np.array(self.q)]

    def _at(self, x: np.ndarray) -> Point:
        if self._last is None or not np.array_equal(self._last.x, x):
            self._last = Point(self, self.physics.loads, x)
        return self._last

    def values(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Objective and rows."""
        point = self._at(x)
        rows = point.once(self, lambda: self._rows(point))
        return self.objective.value(point), rows

    def _rows(self, point: Point) -> np.ndarray:
        return np.concatenate(
            [limit.values(point, block) for limit, blocks in self.limits for block in blocks]
        )

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """Gradient of the objective, (nx,)."""
        return self.objective.gradient(self._at(x))

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Jacobian of the rows, (rows, nx)."""
        point, result = self._at(x), np.zeros((len(self.labels), self.size))
        for limit, blocks in self.limits:
            for block in blocks:
                result[block.rows, block.columns] = limit.jacobian(point, block)
        return result

    @cached_property
    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the Jacobian (rows, nx) and the Hessian (nx, nx) may differ from zero."""
        slopes, bends = np.zeros((len(self.labels), self.size), dtype=bool), np.eye(self.size, dtype=bool)
        for block in (block for _, blocks in self.limits for block in blocks):
            slopes[block.rows, block.columns] = True
            bends[np.ix_(block.columns, block.columns)] = True
        for y in self.y:
            bends[np.ix_(y, y)] = True
        return slopes, bends

    def hessian(self, x: np.ndarray, sigma: float, multipliers: np.ndarray) -> np.ndarray:
        """Hessian of sigma * objective + multipliers . rows, (nx, nx)."""
        point, sums = self._at(x), Hessian(self)
        loaded = 1 + max((k for k, (limit, _) in enumerate(self.limits) if limit.on_loads), default=-1)
        for limit, blocks in self.limits[:loaded]:
            limit.add_hessian(sums, point, blocks, multipliers)
        self.objective.add_hessian(sums, point, sigma)
        for i, case in enumerate(self.cases):
            y, slope = self.y[case.task], point.slopes[i]
            inner = self.physics.loads.hessian(x[y], case.force, case.moment, sums.on_loads[i])
            sums.add(y, inner + slope.T @ sums.of_loads[i] @ slope)
        for limit, blocks in self.limits[loaded:]:
            limit.add_hessian(sums, point, blocks, multipliers)
        return sums.matrix


def _stacked(blocks: list[CaseRows], bound: str) -> np.ndarray:
    """A bound of all rows."""
    return np.concatenate([np.broadcast_to(getattr(b, bound), len(b.labels)) for b in blocks])


class ElasticProgram:
    """A program of constraints alone, with violations as further variables.

    Where the gripper pose cannot be reached, joint limits are rows that can also be relaxed; the bounds of
    the terrain stay.

    Args:
        program: made with `criteria=False`.
        reachable: the gripper pose and the joint limits are kept.
    """

    def __init__(self, program: PlacementProgram, reachable: bool = False) -> None:
        self.program = program
        lower, upper = program.bounds
        names = [
            (label.kind, "" if limit.together else label.name)
            for limit, blocks in program.limits
            for block in blocks
            for label in block.labels
        ]
        low, high = (bound.copy() for bound in program.x_bounds)
        self._joints = np.concatenate(program.q)
        angle_low, angle_high = low[self._joints], high[self._joints]
        low[self._joints] = np.where(np.isfinite(angle_low), angle_low - np.pi, -np.inf)
        high[self._joints] = np.where(np.isfinite(angle_high), angle_high + np.pi, np.inf)
        names += [(JointAngles.kind, "")] * len(self._joints)
        self.groups = list(dict.fromkeys(names))
        which = np.array([self.groups.index(name) for name in names])
        lower = np.concatenate([lower, angle_low / ANGLE_UNIT])
        upper = np.concatenate([upper, angle_high / ANGLE_UNIT])
        self._below, self._above = np.flatnonzero(np.isfinite(lower)), np.flatnonzero(np.isfinite(upper))
        nx, count = program.size, len(self.groups)
        self._extra = np.zeros((len(self._below) + len(self._above), count))
        if reachable:
            firm = np.isin([kind for kind, _ in self.groups], (Reach.kind, JointAngles.kind))
        else:
            firm = np.zeros(count, dtype=bool)
        self._extra[np.arange(len(self._below)), which[self._below]] = 1.0
        self._extra[len(self._below) + np.arange(len(self._above)), which[self._above]] = -1.0
        self.bounds = (
            np.concatenate([lower[self._below], np.full(len(self._above), -np.inf)]),
            np.concatenate([np.full(len(self._below), np.inf), upper[self._above]]),
        )
        self.x_bounds = np.r_[low, np.zeros(count)], np.r_[high, np.where(firm, 0.0, np.inf)]
        self._limits, self._which, self.size = (lower, upper), which, nx + count

    def start(self, x: np.ndarray) -> np.ndarray:
        """x with violations just as large as needed."""
        rows = self._stacked(self.program.values(x)[1], x)
        short = np.maximum(np.maximum(self._limits[0] - rows, rows - self._limits[1]), 0)
        violations = np.zeros(len(self.groups))
        np.maximum.at(violations, self._which, short)
        return np.concatenate([x, violations])

    def _stacked(self, rows: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.concatenate([rows, x[self._joints] / ANGLE_UNIT])

    def values(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Sum of violations, and all rows."""
        inner, violations = x[: self.program.size], x[self.program.size :]
        rows = self._stacked(self.program.values(inner)[1], inner)
        both = np.concatenate([rows[self._below], rows[self._above]])
        return float(np.sum(violations)), both + self._extra @ violations

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """(nx,)."""
        return np.r_[np.zeros(self.program.size), np.ones(len(self.groups))]

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """(rows, nx)."""
        slope = self.program.jacobian(x[: self.program.size])
        angles = np.zeros((len(self._joints), self.program.size))
        angles[np.arange(len(self._joints)), self._joints] = 1 / ANGLE_UNIT
        slope = np.concatenate([slope, angles])
        both = np.concatenate([slope[self._below], slope[self._above]])
        return np.hstack([both, self._extra])

    @cached_property
    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the Jacobian (rows, nx) and the Hessian (nx, nx) may differ from zero."""
        inner, bends = self.program.pattern
        angles = np.zeros((len(self._joints), self.program.size), dtype=bool)
        angles[np.arange(len(self._joints)), self._joints] = True
        slopes = np.concatenate([inner, angles])
        both = np.concatenate([slopes[self._below], slopes[self._above]])
        result = np.zeros((self.size, self.size), dtype=bool)
        result[: len(bends), : len(bends)] = bends
        return np.hstack([both, self._extra != 0]), result

    def hessian(self, x: np.ndarray, sigma: float, multipliers: np.ndarray) -> np.ndarray:
        """(nx, nx)."""
        sums = np.zeros(len(self._which))
        sums[self._below] += multipliers[: len(self._below)]
        sums[self._above] += multipliers[len(self._below) :]
        size = self.program.size
        result = np.zeros((self.size, self.size))
        count = len(sums) - len(self._joints)
        result[:size, :size] = self.program.hessian(x[:size], 0.0, sums[:count])
        return result
