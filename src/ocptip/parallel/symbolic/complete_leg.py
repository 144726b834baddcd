"""One complete leg in symbols: joint rates from the twist of its end, and back the wrench of its efforts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as cs
import numpy as np
import scipy.linalg

from ocptip.basics.errors import InputError
from ocptip.parallel.kinematics.leg_solver import LegSolver
from ocptip.parallel.symbolic.leg_dynamics import (
    ChainState,
    LegModel,
    chain_drift,
    chain_motion,
    leg_efforts,
    point_columns,
)
from ocptip.parallel.symbolic.spatial_sx import BlockSystem, Vector, dot, minus, unit, zero

_HEAVY = 1e-12
Wrench = tuple[Vector, Vector]
Scalars = list[cs.SX]


@dataclass
class CompleteLeg:
    """One leg: its model and its equations, in the axes of one of its link frames.

    Attributes:
        model: all joints.
        arm: of its end on the platform, world axes.
        frame: link frame of the equations.
        rows, others: components of the end's twist that give the joint rates, and the other ones.
        columns: joints that are solved for; of the others at most one is idle.
        redundant: joints that are coordinates, whose rates are given.
        jacobian: 6 rows of entries, one per joint.
        system: its rows and columns.
        idle, momentum: (n,) motion of all joints with the end at rest, and what rates are multiplied with to
            get their part along it: their momentum, or themselves for a leg without inertia there.
        free: the leg with the robot's inertia in numbers and without friction, None if there is no inertia
            along the idle motion. (Motor forces remain linear in the inertia that `model` has.)
        held: wrenches at the end, world axes, that do no work along the joints, one per other row.
        motion: of all bodies, once moved.
    """

    model: LegModel
    arm: Vector
    frame: int
    rows: tuple[int, ...]
    others: tuple[int, ...]
    columns: tuple[int, ...]
    jacobian: list[Scalars]
    system: BlockSystem
    free: LegModel | None
    redundant: tuple[int, ...] = ()
    idle: Scalars = field(default_factory=list)
    momentum: Scalars = field(default_factory=list)
    held: list[Wrench] = field(default_factory=list)
    motion: ChainState = field(init=False)

    def __post_init__(self) -> None:
        for other in self.others:
            balance = self.system.solve_transposed([self.jacobian[other][c] for c in self.columns])
            values: Scalars = [cs.SX(0.0)] * 6
            for row, value in zip((*self.rows, other), (*balance, cs.SX(-1.0)), strict=True):
                values[row] = -value
            self.held.append(self._to_world(values))
        spare = [j for j in range(self.model.size) if j not in (*self.columns, *self.redundant)]
        if spare:
            self.idle = self._spread(self.system.solve([-self.jacobian[row][spare[0]] for row in self.rows]))
            self.idle[spare[0]] = cs.SX(1.0)
            still = [cs.SX(0.0)] * self.model.size
            weights = _free_efforts(self.free, still, self.idle) if self.free else self.idle
            whole = dot(weights, self.idle)
            self.momentum = [weight / whole for weight in weights]

    def followed(self, linear: Vector, angular: Vector, given: Scalars) -> Scalars:
        """Joint rates for a velocity of the end, world axes, without a part along the idle motion.

        Those of redundant joints are given.
        """
        rates = self.particular(linear, angular, given)
        return self._without(rates, dot(self.momentum, rates)) if self.idle else rates

    def nearest(self, linear: Vector, angular: Vector, given: Scalars) -> Scalars:
        """The smallest joint rates for a velocity of the end, those of redundant joints given."""
        rates = self.particular(linear, angular, given)
        return self._without(rates, dot(self.idle, rates) / dot(self.idle, self.idle)) if self.idle else rates

    def particular(self, linear: Vector, angular: Vector, given: Scalars) -> Scalars:
        """Joint rates for a velocity of the end, idle joint at rest, those of redundant joints given."""
        to_frame = self.model.rotation(self.frame, 0)
        moving = [*to_frame(linear), *to_frame(angular)]
        for joint, rate in zip(self.redundant, given, strict=True):
            moving = [term - row[joint] * rate for term, row in zip(moving, self.jacobian, strict=True)]
        rates = self._spread(self.system.solve([moving[row] for row in self.rows]))
        for joint, rate in zip(self.redundant, given, strict=True):
            rates[joint] = rate
        return rates

    def accelerated(self, rates: Scalars, linear: Vector, angular: Vector, given: Scalars) -> Scalars:
        """Joint accelerations for an acceleration of the end, world axes, at given rates."""
        drift, turning = self.drift(rates)
        result = self.particular(minus(linear, drift), minus(angular, turning), given)
        if not self.idle:
            return result
        if self.free is None:
            return self._without(result, dot(self.momentum, result))
        still = [cs.SX(0.0)] * self.model.size
        whole = dot(_free_efforts(self.free, still, self.idle), self.idle)
        return self._without(result, dot(_free_efforts(self.free, rates, result), self.idle) / whole)

    def drift(self, rates: Scalars) -> tuple[Vector, Vector]:
        """Acceleration of the end without joint accelerations, linear and angular, world axes."""
        to_world = self.model.rotation(0, self.frame)
        linear, angular = chain_drift(self.model, rates, self.frame)
        return to_world(linear), to_world(angular)

    def wrench(self, efforts: Sequence[cs.SX]) -> tuple[Vector, Vector, Scalars]:
        """Force and moment at the leg's end, world axes, that joint efforts balance; and what is left of the
        efforts of redundant joints."""
        if self.idle:
            share = dot(self.idle, efforts)
            efforts = [effort - weight * share for effort, weight in zip(efforts, self.momentum, strict=True)]
        values: Scalars = [cs.SX(0.0)] * 6
        balance = self.system.solve_transposed([efforts[c] for c in self.columns])
        for row, value in zip(self.rows, balance, strict=True):
            values[row] = value
        left = [
            efforts[joint] - dot([self.jacobian[row][joint] for row in self.rows], balance)
            for joint in self.redundant
        ]
        return *self._to_world(values), left

    def _to_world(self, values: Scalars) -> Wrench:
        to_world = self.model.rotation(0, self.frame)
        return to_world(values[:3]), to_world(values[3:])

    def _spread(self, solved: Sequence[cs.SX]) -> Scalars:
        rates: Scalars = [cs.SX(0.0)] * self.model.size
        for column, value in zip(self.columns, solved, strict=True):
            rates[column] = value
        return rates

    def _without(self, rates: Scalars, share: cs.SX) -> Scalars:
        return [rate - share * along for rate, along in zip(rates, self.idle, strict=True)]


def _free_efforts(model: LegModel, rates: Scalars, accelerations: Scalars) -> Scalars:
    """Efforts without gravity."""
    return leg_efforts(model, chain_motion(model, rates, accelerations, zero()))


def chosen_equations(
    leg: LegSolver, model: LegModel, joints: np.ndarray, redundant: tuple[int, ...]
) -> tuple[int, tuple[int, ...], tuple[int, ...], list[Scalars]]:
    """Frame, rows and columns of a leg's equations, and all entries: independent, in the smallest blocks,
    then sparsest."""
    rank, others = leg.n - leg.idle - len(redundant), [k for k in range(leg.n) if k not in redundant]
    pivots = np.asarray(scipy.linalg.qr(leg.jacobian(joints)[0][:, others], pivoting=True)[-1])
    columns = tuple(sorted(others[k] for k in pivots[:rank]))
    best: tuple[tuple[int, int], int, tuple[int, ...], list[Scalars]] | None = None
    for frame in range(1, model.size + 1):
        by_joint = [
            [*linear, *(model.rotation(frame, j)(unit(2)) if model.revolute[j - 1] else zero())]
            for j, linear in enumerate(point_columns(model, frame), start=1)
        ]
        entries = [list(row) for row in zip(*by_joint, strict=True)]
        whole = cs.vertcat(*(cs.horzcat(*row) for row in entries))
        numbers = np.array(cs.Function("J", [cs.vertcat(*model.q)], [whole])(joints))[:, columns]
        pivots = np.asarray(scipy.linalg.qr(numbers.T, pivoting=True)[-1])
        rows = tuple(sorted(int(k) for k in pivots[:rank]))
        try:
            system = BlockSystem([[entries[row][c] for c in columns] for row in rows])
        except InputError:
            continue
        filled = sum(not entry.is_zero() for row in system.matrix for entry in row)
        cost = (sum(len(block) ** 3 for block, _ in system.blocks), filled)
        if best is None or cost < best[0]:
            best = cost, frame, rows, entries
    if best is None:
        raise InputError(f"leg {leg.number + 1}: no choice of its equations determines all its joints")
    return best[1], best[2], columns, best[3]


def idle_inertia(leg: LegSolver, joints: np.ndarray) -> bool:
    """True if a leg has inertia along its idle motion."""
    if not leg.idle:
        return False
    motions = leg.idle_motions(joints)
    M = leg.dynamics(joints, np.zeros(leg.n), np.zeros(3))[0]
    return float((motions.T @ M @ motions)[0, 0]) > _HEAVY * max(float(np.trace(M)), 1e-300)
