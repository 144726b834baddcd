"""The optimal-control problem of ramp motions as a nonlinear program with exact derivatives.

Least electric energy over the variables of `profiles`, subject to

- the structure: every joint arrives, brakes with the deceleration of its last ramp, keeps its acceleration
  limit, ends no later than t_E; in an ordered program also the order of all events and the signs of speeds;
- rows at nodes: moments about the tipping axes (GN), slip reserve (GT), torques, clearances, angles, and the
  mechanism's further limits.

Most node rows are far from their limits; only those that are near take part (`RowSet`), the others are looked
at after each solve.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import casadi as cs
import numpy as np

from ocptip.basics.errors import SolverError
from ocptip.contact.solver import solve_many
from ocptip.motion.planner.node_physics import NodeJacobian, NodePhysics
from ocptip.motion.planner.profiles import Layout, Nodes, NodeStates
from ocptip.numerics.batch import BatchFunction
from ocptip.numerics.point import PointFunction
from ocptip.reserves.tipping import TipMap
from ocptip.standing.limits import MotionLimits

NEGLIGIBLE = 1e-9  # a node whose multipliers are all below this is left out of the Hessian
ENERGY_UNIT = 100.0  # J; the objective is energy / ENERGY_UNIT
INSIDE = 1e-4  # further limits are kept with this distance, in their units: rounding cannot break them


@dataclass(eq=False)
class RowSet:
    """Which node rows take part in a program.

    Attributes:
        tip: (N, axes) moments about tipping axes.
        slip: (N,) slip reserve.
        torque: (N, n).
        gap: (N, m) signed distances.
        angle: (N, n).
        further: (N, k), see `FurtherLimits`.
    """

    tip: np.ndarray
    slip: np.ndarray
    torque: np.ndarray
    gap: np.ndarray
    angle: np.ndarray
    further: np.ndarray

    FAMILIES = ("tip", "slip", "torque", "gap", "angle", "further")

    def __sub__(self, other: RowSet) -> int:
        """How many rows are in this set and not in the other."""
        return sum(int(np.sum(getattr(self, name) & ~getattr(other, name))) for name in self.FAMILIES)


@dataclass(frozen=True, eq=False)
class Structure:
    """Rows that depend on x only: equalities, limits of ramps, order of events.

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
        return tuple(self._first(x))

    def hessian(self, x: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """Hessian (nx, nx) of multipliers . rows."""
        return self._second(x, multipliers)[0]

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


@dataclass(eq=False)
class Evaluation:
    """First-order data of a program at one x."""

    x: np.ndarray
    states: NodeStates
    physics: NodeJacobian
    chained: np.ndarray
    durations: np.ndarray
    structure: tuple[np.ndarray, np.ndarray]
    tip: tuple[np.ndarray, np.ndarray]
    slip: tuple[np.ndarray, np.ndarray]
    gaps: tuple[np.ndarray, np.ndarray] = field(default=None)


class MotionProgram:
    """The nonlinear program over given nodes.

    Args:
        physics: of the robot.
        limits: to keep at the nodes (already tightened by the caller if need be).
        layout: of the variables.
        nodes: where energy and rows are evaluated.
        weights: (N, nx): the quadrature weights, s, are weights @ x; zero for nodes of rows only.
        directions: (N, n) directions of motion for the power.
        structure: rows in x.
        rows: node rows that take part.
    """

    def __init__(
        self,
        physics: NodePhysics,
        limits: MotionLimits,
        layout: Layout,
        nodes: Nodes,
        weights: np.ndarray,
        directions: np.ndarray,
        structure: Structure,
        rows: RowSet | None = None,
    ) -> None:
        self.physics, self.limits, self.layout = physics, limits, layout
        self.robot = physics.robot
        self.nodes, self.weights, self.directions, self.structure = nodes, weights, directions, structure
        self.tip_map = TipMap(self.robot.tip_over)
        moment = self.robot.tip_over.reference_moment
        self._least_moment = None if moment is None else moment * (1 / limits.GN - 1)
        self._further = self.robot.further_limits
        self._gap_functions: tuple | None = None
        self._last: Evaluation | None = None
        self._rows_taking_part = rows if rows is not None else self.no_rows()
        self.anchor: np.ndarray | None = None
        self.pull = 0.0

    @property
    def rows(self) -> RowSet:
        """Node rows that take part."""
        return self._rows_taking_part

    @rows.setter
    def rows(self, rows: RowSet) -> None:
        self._rows_taking_part, self._last = rows, None

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.weights)

    def no_rows(self) -> RowSet:
        """A row set without rows."""
        N, n, m = self.n_nodes, self.robot.n, len(self.robot.collision.labels)
        shapes = (N, self.tip_map.count), (N,), (N, n), (N, m), (N, n), (N, self._further.count)
        return RowSet(*(np.zeros(shape, dtype=bool) for shape in shapes))

    def near_rows(self, x: np.ndarray, share: float) -> RowSet:
        """Rows whose use of their limit at x is at least `share` (1: at the limit)."""
        limits, robot = self.limits, self.robot
        s = self.nodes.states(x).values
        n = robot.n
        y = self.physics.values(s, self.directions)
        rows = self.no_rows()
        torque, wrench = y[:, 1 : 1 + n], y[:, 1 + n : 7 + n]
        if self.tip_map.count:
            rows.tip = self.tip_map(wrench)[0] * share <= self._least_moment
        usage = self._slip(wrench, derivatives=False)[0]
        rows.slip = ~(usage < share * limits.GT)
        rows.torque = np.abs(torque) >= share * limits.torque_ratio * robot.limits.torque
        if rows.gap.size:
            rows.gap = robot.collision.gaps(s[:, :n]) <= limits.clearance + 0.01 * (1 - share)
        room = 0.2 * (1 - share)
        low, high = robot.limits.angle_min, robot.limits.angle_max
        rows.angle = (s[:, :n] <= low + room) | (s[:, :n] >= high - room)
        still = np.ones(n, dtype=bool)
        still[list(self.layout.joints)] = False
        rows.angle[:, still] = False  # passive joints stay between start and goal
        rows.further = self._further.excess(y[:, 7 + n :]) >= share - 1
        return rows

    def use(self, x: np.ndarray) -> np.ndarray:
        """Worst use of any limit at each node (N,): 1 at the limit, more beyond; rows need not take part."""
        limits, robot = self.limits, self.robot
        s = self.nodes.states(x).values
        n, arm = robot.n, robot.limits
        y = self.physics.values(s, self.directions)
        torque, wrench = y[:, 1 : 1 + n], y[:, 1 + n : 7 + n]
        columns = [np.max(np.abs(torque) / arm.torque, axis=1) / limits.torque_ratio]
        columns.append(self._slip(wrench, derivatives=False)[0] / limits.GT)
        if self.tip_map.count:
            short = self._least_moment - np.min(self.tip_map(wrench)[0], axis=1)
            columns.append(1 + short / self._moment_unit)
        if robot.collision.labels:
            columns.append(1 + 10 * (limits.clearance - np.min(robot.collision.gaps(s[:, :n]), axis=1)))
        joints = list(self.layout.joints)
        q = s[:, joints]
        columns.append(1 + np.max(np.maximum(arm.angle_min[joints] - q, q - arm.angle_max[joints]), axis=1))
        if self._further.count:
            columns.append(1 + np.max(self._further.excess(y[:, 7 + n :]), axis=1))
        return np.max(columns, axis=0)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of all rows, in the order of `values`."""
        limits, rows = self.limits, self.rows
        arm = self.robot.limits
        tip, slip = np.count_nonzero(rows.tip), np.count_nonzero(rows.slip)
        torque, gap = np.count_nonzero(rows.torque), np.count_nonzero(rows.gap)
        at = np.nonzero(rows.angle)[1]
        lower = [
            np.full(tip, (self._least_moment or 0.0) / self._moment_unit),
            np.full(slip, -np.inf),
            -np.full(torque, limits.torque_ratio),
        ]
        upper = [np.full(tip, np.inf), np.full(slip, limits.GT), np.full(torque, limits.torque_ratio)]
        lower += [np.full(gap, limits.clearance * 10), arm.angle_min[at]]
        upper += [np.full(gap, np.inf), arm.angle_max[at]]
        further, at = self._further, np.nonzero(rows.further)[1]
        lower.append(further.lower[at] / further.units[at] + INSIDE)
        upper.append(further.upper[at] / further.units[at] - INSIDE)
        return (
            np.concatenate([self.structure.lower, *lower]),
            np.concatenate([self.structure.upper, *upper]),
        )

    def carried(self, multipliers: np.ndarray, rows: RowSet) -> np.ndarray:
        """Multipliers of a program with other rows at the first of these nodes, for this program's rows."""
        count = len(self.structure.lower)
        result = [multipliers[:count]]
        at = count
        for name in RowSet.FAMILIES:
            old, new = getattr(rows, name), getattr(self.rows, name)
            full, size = np.zeros(new.shape), np.count_nonzero(old)
            full[: len(old)][old] = multipliers[at : at + size]
            result.append(full[new])
            at += size
        return np.concatenate(result)

    def energy(self, x: np.ndarray) -> float:
        """Electric energy by the nodes' quadrature, J."""
        s = self.nodes.states(x).values
        return float((self.weights @ x) @ self.physics.values(s, self.directions)[:, 0])

    def values(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Objective and rows."""
        at = self._evaluate(x)
        return self._objective(at), self._rows(at)

    def _objective(self, at: Evaluation) -> float:
        value = float(at.durations @ at.physics.y[:, 0]) / ENERGY_UNIT
        if self.pull:
            value += 0.5 * self.pull * float(np.sum((at.x - self.anchor) ** 2))
        return value

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """Gradient of the objective (nx,)."""
        at = self._evaluate(x)
        power = at.physics.y[:, 0]
        gradient = (power @ self.weights + at.durations @ at.chained[:, 0]) / ENERGY_UNIT
        return gradient + self.pull * (x - self.anchor) if self.pull else gradient

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Jacobian of the rows (rows, nx)."""
        at, rows = self._evaluate(x), self.rows
        n = self.robot.n
        structure = at.structure[1]
        wrench = at.chained[:, 1 + n : 7 + n]
        i, k = np.nonzero(rows.tip)
        parts = [structure]
        parts.append(np.einsum("rw,rwx->rx", at.tip[1][i, k], wrench[i]) / self._moment_unit)
        i = np.flatnonzero(rows.slip)
        parts.append(np.einsum("rw,rwx->rx", at.slip[1], wrench[i]))
        i, k = np.nonzero(rows.torque)
        parts.append(at.chained[i, 1 + k] / self.robot.limits.torque[k, None])
        parts.append(self._gap_slopes(at))
        i, k = np.nonzero(rows.angle)
        parts.append(at.states.jacobian[i, k])
        i, k = np.nonzero(rows.further)
        parts.append(at.chained[i, 7 + n + k] / self._further.units[k, None])
        return np.concatenate(parts)

    def hessian(self, x: np.ndarray, sigma: float, multipliers: np.ndarray) -> np.ndarray:
        """Hessian of sigma * objective + multipliers . rows; the curvature of GT itself is left out."""
        at, rows = self._evaluate(x), self.rows
        n, N = self.robot.n, self.n_nodes
        sigma = sigma / ENERGY_UNIT
        count = len(self.structure.lower)
        sizes = [np.count_nonzero(getattr(rows, name)) for name in RowSet.FAMILIES]
        on_g, on_tip, on_slip, on_torque, on_gap, on_angle, on_further = np.split(
            multipliers, np.cumsum([count, *sizes[:-1]])
        )
        on_y = np.zeros((N, 7 + n + self._further.count))
        on_y[:, 0] = sigma * at.durations
        i, k = np.nonzero(rows.tip)
        np.add.at(on_y[:, 1 + n : 7 + n], i, on_tip[:, None] * at.tip[1][i, k] / self._moment_unit)
        i = np.flatnonzero(rows.slip)
        on_y[i, 1 + n : 7 + n] += on_slip[:, None] * at.slip[1]
        i, k = np.nonzero(rows.torque)
        on_y[i, 1 + k] += on_torque / self.robot.limits.torque[k]
        i, k = np.nonzero(rows.further)
        on_y[i, 7 + n + k] += on_further / self._further.units[k]
        H = np.zeros((N, 3 * n, 3 * n))
        weighty = np.flatnonzero(np.max(np.abs(on_y), axis=1) > NEGLIGIBLE)
        H[weighty] = self.physics.hessian(at.physics.at(weighty), on_y[weighty])
        on_s = np.einsum("ik,iks->is", on_y, at.physics.slope)
        if rows.gap.any():
            self._add_gap_hessian(H, on_s, at, on_gap)
        i, k = np.nonzero(rows.angle)
        np.add.at(on_s, (i, k), on_angle)
        S = at.states.jacobian
        nx = self.layout.size
        result = S.reshape(-1, nx).T @ np.matmul(H, S).reshape(-1, nx)
        self.nodes.second(result, x, at.states, on_s)
        mixed = sigma * self.weights.T @ at.chained[:, 0]
        result += mixed + mixed.T
        result += self.structure.hessian(x, on_g)
        result[np.diag_indices_from(result)] += sigma * ENERGY_UNIT * self.pull
        return result

    @property
    def _moment_unit(self) -> float:
        return 2 * (self.robot.tip_over.reference_moment or 1.0)

    def _evaluate(self, x: np.ndarray) -> Evaluation:
        if self._last is not None and np.array_equal(self._last.x, x):
            return self._last
        n = self.robot.n
        states = self.nodes.states(x)
        physics = self.physics.jacobian(states.values, self.directions)
        if not np.isfinite(physics.y).all():
            raise SolverError("motion program: dynamics are not finite")
        chained = np.matmul(physics.slope, states.jacobian)
        wrench = physics.y[:, 1 + n : 7 + n]
        at = Evaluation(
            x.copy(),
            states,
            physics,
            chained,
            self.weights @ x,
            self.structure.rows(x),
            self.tip_map(wrench),
            self._slip(wrench[self.rows.slip]),
        )
        if self.rows.gap.any():
            at.gaps = self._gaps(at)
        self._last = at
        return at

    def _rows(self, at: Evaluation) -> np.ndarray:
        rows, n = self.rows, self.robot.n
        i, k = np.nonzero(rows.torque)
        torque = at.physics.y[i, 1 + k] / self.robot.limits.torque[k]
        further = at.physics.y[:, 7 + n :] / self._further.units
        return np.concatenate(
            [
                at.structure[0],
                at.tip[0][rows.tip] / self._moment_unit,
                at.slip[0],
                torque,
                np.empty(0) if at.gaps is None else at.gaps[0],
                at.states.values[:, :n][rows.angle],
                further[rows.further],
            ]
        )

    def _slip(self, wrenches: np.ndarray, derivatives: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """GT (N,) and its derivative (N, 6) where asked for; a large number where not solved."""
        if not len(wrenches):
            return np.empty(0), np.empty((0, 6))
        reserve = self.robot.slip.evaluate(solve_many(self.robot.support, wrenches), derivatives)
        GT = np.where(np.isfinite(reserve.GT), reserve.GT, 10.0)
        gradient = np.nan_to_num(reserve.gradient) if derivatives else np.empty((0, 6))
        return GT, gradient

    # --- clearances: only pairs that take part have a CasADi function -------------------------------------

    def _gap_pairs(self) -> tuple:
        pairs = np.flatnonzero(self.rows.gap.any(axis=0))
        if self._gap_functions is None or not np.array_equal(self._gap_functions[0], pairs):
            n = self.robot.n
            q, lam = cs.SX.sym("q", n), cs.SX.sym("lam", len(pairs))
            gaps = self.robot.collision.function(q)[pairs.tolist()] * 10
            hessian, _ = cs.hessian(cs.dot(lam, gaps), q)
            first = BatchFunction(cs.Function("gap", [q], [gaps, cs.jacobian(gaps, q)]))
            second = BatchFunction(cs.Function("gap_hessian", [q, lam], [hessian]))
            self._gap_functions = pairs, first, second
        return self._gap_functions

    def _gaps(self, at: Evaluation) -> tuple[np.ndarray, np.ndarray]:
        """Gaps (10 m) of all rows and their derivatives with respect to q, (rows,) and (rows, n)."""
        pairs, first, _ = self._gap_pairs()
        n = self.robot.n
        gaps, slopes = first(at.states.values[:, :n])
        slopes = slopes.reshape(len(gaps), len(pairs), n)
        mask = self.rows.gap[:, pairs]
        return gaps.reshape(len(slopes), -1)[mask], slopes[mask]

    def _gap_slopes(self, at: Evaluation) -> np.ndarray:
        i = np.nonzero(self.rows.gap)[0]
        if not len(i):
            return np.empty((0, self.layout.size))
        return np.einsum("rq,rqx->rx", at.gaps[1], at.states.jacobian[i, : self.robot.n])

    def _add_gap_hessian(self, H: np.ndarray, on_s: np.ndarray, at: Evaluation, on_gap: np.ndarray) -> None:
        pairs, _, second = self._gap_pairs()
        n = self.robot.n
        lam = np.zeros((self.n_nodes, len(pairs)))
        lam[self.rows.gap[:, pairs]] = on_gap
        H[:, :n, :n] += second(at.states.values[:, :n], lam)[0].reshape(-1, n, n)
        i = np.nonzero(self.rows.gap)[0]
        np.add.at(on_s[:, :n], i, on_gap[:, None] * at.gaps[1])
