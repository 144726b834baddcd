"""The list of all limits: a new kind is one class, and one line here.

Two kinds are here: rows that tie variables of the objective to loads, use of the force space and amounts of
torques.
"""

from __future__ import annotations

import numpy as np

from ocptip.placement.limits.arm import Clearance, JointAngles, Manipulability, Reach, Torque
from ocptip.placement.limits.base import (
    BaseClearance,
    ContactArea,
    OnGround,
    ParameterBounds,
    Strokes,
    TerrainLimit,
)
from ocptip.placement.limits.contact import (
    HeldForces,
    Persistence,
    SlipIndexLimit,
    SlipLimit,
    TipOverIndexLimit,
    TipOverLimit,
)
from ocptip.placement.limits.forces import Twice
from ocptip.placement.limits.layout import Hessian, Point, Variables
from ocptip.placement.limits.limit import CaseRows, PlacementLimit, RowLabel
from ocptip.placement.problem import PlacementProblem

_SIGNS = (1.0, -1.0)


class ForceSpace(PlacementLimit):
    """No joint uses more of its torque margin in a load's direction than the bound of all (4.19)."""

    kind = "force space"
    on_loads = True

    def __init__(self, problem: PlacementProblem) -> None:
        super().__init__(problem)
        self.joints = problem.limited_joints
        self.most = problem.most_torque[self.joints]

    def blocks(self, layout: Variables, functions: list[Twice]) -> list[CaseRows]:
        slack = layout.slack.get("force")
        if slack is None:
            return []
        result = []
        for i in layout.counting:
            case = layout.cases[i]
            if case.load >= 0:
                labels = [RowLabel(self.kind, case.name)] * (2 * len(self.joints))
                result.append(CaseRows(i, layout.y[case.task], labels, -np.inf, 0.0, slack))
        return result

    def start(self, point: Point, x: np.ndarray) -> None:
        if (slack := point.layout.slack.get("force")) is None:
            return
        shares = []
        for i in point.layout.counting:
            if point.layout.cases[i].load >= 0:
                torques, change = self._torques(point, i)
                most = np.where(change > 0, self.most - torques, self.most + torques)
                shares.append(np.max(np.abs(change) / np.maximum(most, 1e-6 * self.most)))
        x[slack] = max(shares)

    def values(self, point: Point, block: CaseRows) -> np.ndarray:
        torques, change = self._torques(point, block.of)
        t = point.x[block.slack]
        return np.concatenate(
            [sign * change / self.most - t * (1 - sign * torques / self.most) for sign in _SIGNS]
        )

    def jacobian(self, point: Point, block: CaseRows) -> np.ndarray:
        torques, t = self._torques(point, block.of)[0], point.x[block.slack]
        own_slope = point.slopes[point.layout.unloaded(block.of)][self.joints] / self.most[:, None]
        change_slope = point.slopes[block.of][self.joints] / self.most[:, None] - own_slope
        parts = []
        for sign in _SIGNS:
            slack = 1 - sign * torques / self.most
            parts.append(np.column_stack([sign * change_slope + t * sign * own_slope, -slack]))
        return np.concatenate(parts)

    def add_hessian(
        self, sums: Hessian, point: Point, blocks: list[CaseRows], multipliers: np.ndarray
    ) -> None:
        for block in blocks:
            assert block.slack is not None  # it is that of the force space
            unloaded, t = point.layout.unloaded(block.of), point.x[block.slack]
            for sign, on in zip(_SIGNS, multipliers[block.rows].reshape(2, -1), strict=True):
                on = sign * on / self.most
                sums.on_loads[block.of][self.joints] += on
                sums.on_loads[unloaded][self.joints] += (t - 1) * on
                sums.add_mixed(block.slack, block.columns[:-1], on @ point.slopes[unloaded][self.joints])

    def _torques(self, point: Point, i: int) -> tuple[np.ndarray, np.ndarray]:
        """Unloaded torques of the limited joints, and their change by the load, N m."""
        load = point.loads[point.layout.unloaded(i)][self.joints]
        return load, point.loads[i][self.joints] - load


class TorqueAmounts(PlacementLimit):
    """Variables of the objective that are at least the amounts of torques which cost something."""

    kind = "torque cost"
    on_loads = True

    def blocks(self, layout: Variables, functions: list[Twice]) -> list[CaseRows]:
        result, joints = [], layout.costly
        for i, amounts in layout.amounts.items():
            case = layout.cases[i]
            labels = [RowLabel(self.kind, case.name)] * (2 * len(joints))
            result.append(CaseRows(i, np.r_[layout.y[case.task], amounts], labels, 0.0, np.inf))
        return result

    def start(self, point: Point, x: np.ndarray) -> None:
        objective = point.layout
        for i, amounts in objective.amounts.items():
            x[amounts] = np.abs(point.loads[i][objective.costly])

    def values(self, point: Point, block: CaseRows) -> np.ndarray:
        joints = point.layout.costly
        amounts, torques = point.x[block.columns[-len(joints) :]], point.loads[block.of][joints]
        return np.concatenate([amounts - sign * torques for sign in _SIGNS])

    def jacobian(self, point: Point, block: CaseRows) -> np.ndarray:
        joints = point.layout.costly
        slope, unit = point.slopes[block.of][joints], np.eye(len(joints))
        return np.concatenate([np.hstack([-sign * slope, unit]) for sign in _SIGNS])

    def add_hessian(
        self, sums: Hessian, point: Point, blocks: list[CaseRows], multipliers: np.ndarray
    ) -> None:
        for block in blocks:
            for sign, on in zip(_SIGNS, multipliers[block.rows].reshape(2, -1), strict=True):
                sums.on_loads[block.of][point.layout.costly] -= sign * on


TASK_LIMITS: tuple[type[PlacementLimit], ...] = (
    Reach,
    JointAngles,
    TipOverLimit,
    SlipLimit,
    HeldForces,
    Torque,
    ForceSpace,
    TorqueAmounts,
    TipOverIndexLimit,
    SlipIndexLimit,
    Persistence,
    Clearance,
    Manipulability,
)
"""Kinds of limits of a task, in the order of the program's rows."""

BASE_LIMITS = (ParameterBounds, ContactArea, OnGround, Strokes, BaseClearance, TerrainLimit)
"""Kinds of limits of the base alone."""

KINDS: dict[str, type[PlacementLimit]] = {limit.kind: limit for limit in (*TASK_LIMITS, *BASE_LIMITS)}
"""All limits by their names in results."""
