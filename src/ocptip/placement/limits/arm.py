"""Limits of the arm: gripper pose, joint angles, torques, collisions, distance from singular poses."""

from __future__ import annotations

from typing import Any

import casadi as cs
import numpy as np

from ocptip.indices.arms.symbolic import index_function
from ocptip.indices.arms.values import index_values
from ocptip.indices.metric import OperationEllipsoid
from ocptip.numerics.batch import BatchFunction
from ocptip.numerics.vectors import perpendicular
from ocptip.placement.limits.base import WorldSolids, needs_solids
from ocptip.placement.limits.forces import Twice
from ocptip.placement.limits.layout import Hessian, Point, Variables
from ocptip.placement.limits.limit import (
    ANGLE_UNIT,
    LENGTH_UNIT,
    LOG_UNIT,
    CaseRows,
    ConstraintRows,
    PlacementLimit,
    RowLabel,
    Symbols,
    TaskEvaluation,
)
from ocptip.placement.problem import GripperTask, PlacementLimits, PlacementProblem
from ocptip.robots.geometry import CollisionModel, Floor, Obstacle, sphere_centres
from ocptip.robots.kinematics import gripper_batch, gripper_kinematics, gripper_pose
from ocptip.robots.model import ArmModel

MEASURES = ("condition", "singular_ratio")
_STEP = 1e-5  # rad; second derivatives are central differences of exact gradients
_SMALLEST = 1e-12
_POWER = 16  # of the smooth forms of PI_OE and CDN_OE: at most 6 and 11 % below the index


def measures(model: ArmModel, q: np.ndarray, length: float = 1.0) -> np.ndarray:
    """Condition number |J| |J^-1| and ratio of extreme singular values, (N, 2), at q (N, n), rad."""
    jacobian = gripper_batch(model)(q)[2].copy()
    jacobian[:, :3] /= length
    s = np.maximum(np.linalg.svd(jacobian, compute_uv=False), _SMALLEST)
    condition = np.sqrt(np.sum(s**2, axis=1) * np.sum(1 / s**2, axis=1))
    return np.column_stack([condition, s[:, 0] / s[:, -1]])


def limited(limits: PlacementLimits) -> dict[str, float]:
    """Limited measures with the upper bounds of what `LogMeasures` evaluates."""
    bounds = {name: np.log(most) for name in MEASURES if (most := getattr(limits, name)) is not None}
    if limits.index is not None and limits.index_min is not None:
        bounds[limits.index] = -np.log(limits.index_min)
    return bounds


def index_of(model: ArmModel, q: np.ndarray, limits: PlacementLimits) -> np.ndarray:
    """The limited performance index (N,) at q (N, n), rad."""
    assert limits.index is not None  # it is limited
    ellipsoid = OperationEllipsoid.sphere(limits.tool_radius)
    return index_values(model, q, ellipsoid=ellipsoid, names=[limits.index])[limits.index]


class LogMeasures:
    """Logarithms of the limited measures with two derivatives, for the nonlinear program.

    Upper bounds are wanted: of an index it is the negative logarithm of its amount.

    Args:
        model: the arm.
        limits: with at least one of the measures limited.
    """

    def __init__(self, model: ArmModel, limits: PlacementLimits) -> None:
        self.bounds, self.n = limited(limits), model.n
        q = cs.SX.sym("q", model.n)
        jacobian = gripper_kinematics(model)(q)[2]
        scaled = cs.vertcat(jacobian[:3, :] / limits.jacobian_length, jacobian[3:, :])
        flat = cs.vec(scaled)
        self._function = BatchFunction(cs.Function("J", [q], [flat, cs.jacobian(flat, q)]))
        if limits.index is not None:
            options = {}
            if limits.index in ("pi_oe", "inv_cdn_oe"):
                options = {"ellipsoid": OperationEllipsoid.sphere(limits.tool_radius), "p": _POWER}
            value = index_function(model, limits.index, **options)(q)
            amount = -0.5 * cs.log(value**2 + _SMALLEST**2)
            self._index = BatchFunction(cs.Function("index", [q], [amount, cs.jacobian(amount, q)]))

    def gradient(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (N, m) and gradients (N, m, n) at q (N, n)."""
        flat, slope = self._function(q)
        u, s, vt = np.linalg.svd(flat.reshape(len(q), self.n, 6).transpose(0, 2, 1), full_matrices=False)
        s = np.maximum(s, _SMALLEST)
        # d sigma_i = u_i' dJ v_i
        on_entries = (vt[:, :, :, None] * u.transpose(0, 2, 1)[:, :, None]).reshape(*s.shape, -1)
        slopes = on_entries @ slope
        values, gradients = [], []
        for name in self.bounds:
            if name == "condition":
                a, b = np.sum(s**2, axis=1), np.sum(s**-2, axis=1)
                values.append(0.5 * np.log(a * b))
                on = s / a[:, None] - s**-3 / b[:, None]
                gradients.append((on[:, None] @ slopes)[:, 0])
            elif name == "singular_ratio":
                values.append(np.log(s[:, 0] / s[:, -1]))
                gradients.append(slopes[:, 0] / s[:, :1] - slopes[:, -1] / s[:, -1:])
            else:
                value, slope_of_index = self._index(q)
                values.append(value[:, 0])
                gradients.append(slope_of_index[:, 0])
        return np.stack(values, axis=1), np.stack(gradients, axis=1)

    def hessian(self, q: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """Second derivatives (N, n, n) of multipliers (N, m) . values at q (N, n)."""
        steps = _STEP * np.concatenate([np.eye(self.n), -np.eye(self.n)])
        slopes = self.gradient((q[:, None] + steps).reshape(-1, self.n))[1]
        slopes = multipliers[:, None, None] @ slopes.reshape(len(q), 2 * self.n, -1, self.n)
        forward, backward = slopes[:, : self.n, 0], slopes[:, self.n :, 0]
        result = (forward - backward) / (2 * _STEP)
        return (result + result.transpose(0, 2, 1)) / 2


POSE_TOLERANCE = 1e-6
"""Largest error of the gripper's position (m) and orientation (rad)."""

_SMALLEST_INDEX = 1e-12
_INDEX_UNITS = {"dm_2": "rad", "manipulability": "m^3"}
_PROBES = 8
_CONSTANT = 1e-9
_HALF_TURN = 1e-7  # keeps the rows of orientations finite at 180 degrees


class Reach(PlacementLimit):
    """The gripper is at its pose."""

    kind = "reach"
    has_margin = False

    def margins(self, evaluation: TaskEvaluation) -> list[ConstraintRows]:
        wanted, base = self.problem.tasks[evaluation.task], evaluation.base
        position, turned = gripper_pose(self.problem.robot.arm, evaluation.q)
        missed = np.linalg.norm(
            evaluation.origin + (base @ position[:, :, None])[:, :, 0] - wanted.position, axis=1
        )
        world = base @ turned
        if wanted.orientation == "full":
            difference = wanted.rotation.T @ world
            sine = np.linalg.norm(difference - difference.transpose(0, 2, 1), axis=(1, 2)) / np.sqrt(8)
            cosine = (np.trace(difference, axis1=1, axis2=2) - 1) / 2
        else:
            axis, goal = world @ wanted.tool_axis, wanted.rotation @ wanted.tool_axis
            sine, cosine = np.linalg.norm(np.cross(axis, goal), axis=1), axis @ goal
        turn = np.arctan2(sine, cosine) if wanted.orientation != "free" else np.zeros(len(evaluation.q))
        labels, scale = ["gripper position", "gripper orientation"], np.array([LENGTH_UNIT, ANGLE_UNIT])
        values = np.column_stack([missed, turn])
        return [self.row(labels, values, POSE_TOLERANCE, True, ("m", "rad"), scale)]

    def functions(self, symbols: Symbols) -> list[Twice]:
        """Per task rows that vanish where the gripper has its pose."""
        tip, turned, _ = gripper_kinematics(self.problem.robot.arm)(symbols.q)
        world, axes = symbols.world(tip), symbols.base @ turned
        return [self._function(symbols, task, world, axes) for task in self.problem.tasks]

    def blocks(self, layout: Variables, functions: list[Twice]) -> list[CaseRows]:
        return [CaseRows(t, layout.y[t], f.labels, 0.0, 0.0, function=f) for t, f in enumerate(functions)]

    def _function(self, symbols: Symbols, task: GripperTask, world: cs.SX, axes: cs.SX) -> Twice:
        rows = [(world - cs.SX(task.position)) / LENGTH_UNIT]
        if task.orientation == "full":
            error = cs.SX(task.rotation.T) @ axes
            sines = cs.vertcat(
                error[2, 1] - error[1, 2], error[0, 2] - error[2, 0], error[1, 0] - error[0, 1]
            )
            rows.append(_turned(sines / 2, (cs.trace(error) - 1) / 2))
        elif task.orientation == "axis":
            goal = task.rotation @ task.tool_axis
            x = perpendicular(goal)
            across = np.array([x, np.cross(goal, x)])
            axis = axes @ cs.SX(task.tool_axis)
            rows.append(_turned(cs.SX(across) @ axis, cs.SX(goal).T @ axis))
        values = cs.vertcat(*rows)
        kept, missed = _changeable(symbols, values)
        prefix = f"{task.name}: " if len(self.problem.tasks) > 1 else ""
        words = ["position"] * min(3, len(kept)) + ["orientation"] * max(len(kept) - 3, 0)
        labels = [RowLabel(self.kind, f"{prefix}gripper {word}") for word in words]
        return Twice.of(symbols.y, [], values[kept], labels, missed, symbols.local)


class JointAngles(PlacementLimit):
    """Joint angles within the arm's limits, which are bounds of the program's variables."""

    kind = "joint angle"
    together = True
    counted_once = True

    def margins(self, evaluation: TaskEvaluation) -> list[ConstraintRows]:
        problem, rows = self.problem, []
        arm, names = problem.robot.arm, [task.name for task in problem.tasks]
        units, of = np.array(arm.units), f" ({names[evaluation.task]})" if len(names) > 1 else ""
        ends = arm.angle_range(problem.limits.angle_margin)
        for limit, upper, word in zip(ends, (False, True), ("lower", "upper"), strict=True):
            indices = np.flatnonzero(np.isfinite(limit))
            margin = " with its margin" if problem.limits.angle_margin else ""
            labels = [f"{word} limit of {arm.joint_names[j]}{margin}{of}" for j in indices]
            rows.append(
                self.row(
                    labels, evaluation.q[:, indices], limit[indices], upper, tuple(units[indices]), ANGLE_UNIT
                )
            )
        return rows


class Torque(PlacementLimit):
    """Amounts of the joint torques (4.33)."""

    kind = "torque"
    counted_once = True
    on_loads = True

    def __init__(self, problem: PlacementProblem) -> None:
        super().__init__(problem)
        self.joints = problem.limited_joints
        self.most = problem.most_torque[self.joints]

    def margins(self, evaluation: TaskEvaluation) -> list[ConstraintRows]:
        kept, joints = evaluation.constrained, self.joints
        names = self.problem.robot.names
        labels = [f"{names[j]} ({evaluation.cases[c].name})" for c in kept for j in joints]
        values = np.abs(evaluation.torques[:, kept][:, :, joints]).reshape(
            len(evaluation.q), len(kept) * len(joints)
        )
        limits = np.tile(self.most, len(kept))
        units = self.problem.robot.motor_units
        return [self.row(labels, values, limits, True, tuple(units[j] for _ in kept for j in joints), limits)]

    def blocks(self, layout: Variables, functions: list[Twice]) -> list[CaseRows]:
        result = []
        for i, case in enumerate(layout.cases):
            wide = 1.0 if case.constrained else np.inf
            names = self.problem.robot.names
            labels = [RowLabel(self.kind, f"{names[j]} ({case.name})") for j in self.joints]
            result.append(CaseRows(i, layout.y[case.task], labels, -wide, wide))
        return result

    def values(self, point: Point, block: CaseRows) -> np.ndarray:
        return point.loads[block.of][self.joints] / self.most

    def jacobian(self, point: Point, block: CaseRows) -> np.ndarray:
        return point.slopes[block.of][self.joints] / self.most[:, None]

    def add_hessian(
        self, sums: Hessian, point: Point, blocks: list[CaseRows], multipliers: np.ndarray
    ) -> None:
        for block in blocks:
            sums.on_loads[block.of][self.joints] += multipliers[block.rows] / self.most


class Clearance(PlacementLimit):
    """The arm against itself and against obstacles, of the base and of the world; solids of the base."""

    kind = "clearance"
    many = True
    together = True
    counted_once = True

    def __init__(self, problem: PlacementProblem) -> None:
        super().__init__(problem)
        self.arm = problem.robot.arm
        self._collision, self._least = problem.robot.collision, problem.limits.clearance
        self._against, self._solids = [], WorldSolids(problem) if needs_solids(problem) else None
        if self._solids:
            return
        if self.arm.sphere_sets and problem.obstacles:
            self._spheres = BatchFunction(sphere_centres(self.arm))
            self._against = [(obstacle, *self._checked(obstacle)) for obstacle in problem.obstacles]

    def _checked(self, obstacle: Obstacle) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Numbers and radii of the arm's spheres that are checked against an obstacle, names of the gaps."""
        names = self.arm.floor_sets if isinstance(obstacle, Floor) else self.arm.obstacle_sets
        index, radii, labels, offset = [], [], [], 0
        for spheres in self.arm.sphere_sets:
            for k, radius in enumerate(spheres.radii):
                if spheres.name in names:
                    index.append(offset)
                    radii.append(radius)
                    labels.append(f"{spheres.name}[{k + 1}] and {obstacle.name}")
                offset += 1
        return np.array(index, dtype=int), np.array(radii), labels

    def margins(self, evaluation: TaskEvaluation) -> list[ConstraintRows]:
        rows = []

        def add(labels: list[str], gaps: np.ndarray, least: np.ndarray | float = self._least) -> None:
            rows.append(self.row(labels, gaps, least, False, "m", LENGTH_UNIT))

        if self._solids:
            add(*self._solids.gaps(evaluation))
            return rows
        if self._collision.labels:
            add(
                [f"{x.first} and {x.second}" for x in self._collision.labels],
                self._collision.gaps(evaluation.q),
            )
        if self._against:
            world = evaluation.world(self._spheres(evaluation.q)[0].transpose(0, 2, 1))
            for obstacle, index, radii, labels in self._against:
                add(labels, obstacle.gaps(world[:, index], radii))
        return rows

    def functions(self, symbols: Symbols) -> list[Any]:
        """One of all gaps, for all tasks."""
        if self._solids:
            return self._solids.functions(symbols, self.kind)
        gaps, names = [], [f"{x.first} and {x.second}" for x in self._collision.labels]
        if names:
            assert isinstance(self._collision, CollisionModel)  # all else is a matter of `WorldSolids`
            gaps.append(self._collision.function(symbols.q))
        if self._against:
            centres = sphere_centres(self.arm)(symbols.q)
            for obstacle, index, radii, labels in self._against:
                gaps += [
                    obstacle.gap(symbols.world(centres[:, int(i)]), radius)
                    for i, radius in zip(index, radii, strict=True)
                ]
                names += labels
        if not gaps:
            return []
        labels = [RowLabel(self.kind, name) for name in names]
        return [
            Twice.of(
                symbols.y, [], (cs.vertcat(*gaps) - self._least) / LENGTH_UNIT, labels, local=symbols.local
            )
        ]

    def blocks(self, layout: Variables, functions: list[Twice]) -> list[CaseRows]:
        result = []
        for gaps in functions:
            for t, near in enumerate(layout.near):
                labels = [gaps.labels[g] for g in np.flatnonzero(near)]
                result.append(CaseRows(t, layout.y[t], labels, 0.0, np.inf, function=gaps, chosen=near))
        return [block for block in result if block.labels]


class Manipulability(PlacementLimit):
    """Distance from singular poses: condition number, ratio of singular values, a performance index."""

    kind = "manipulability"

    def __init__(self, problem: PlacementProblem) -> None:
        super().__init__(problem)
        limits = problem.limits
        self._logs = LogMeasures(problem.robot.arm, limits) if limited(limits) else None

    def margins(self, evaluation: TaskEvaluation) -> list[ConstraintRows]:
        arm, limits, rows = self.problem.robot.arm, self.problem.limits, []

        def add(name: str, values: np.ndarray, bound: float, sign: float) -> None:
            margins = sign * (np.log(values) - np.log(bound)) / LOG_UNIT
            unit = _INDEX_UNITS.get(name, "")
            label = (name.replace("_", " "),)
            rows.append(ConstraintRows(self.kind, label, values, np.array([bound]), sign < 0, unit, margins))

        for k, name in enumerate(MEASURES):
            if (most := getattr(limits, name)) is not None:
                add(name, measures(arm, evaluation.q, limits.jacobian_length)[:, [k]], most, -1.0)
        if limits.index is not None and limits.index_min is not None:
            values = np.maximum(index_of(arm, evaluation.q, limits), _SMALLEST_INDEX)[:, None]
            add(limits.index, values, limits.index_min, 1.0)
        return rows

    def blocks(self, layout: Variables, functions: list[Twice]) -> list[CaseRows]:
        if self._logs is None:
            return []
        labels = [RowLabel(self.kind, name.replace("_", " ")) for name in self._logs.bounds]
        upper = np.array(list(self._logs.bounds.values())) / LOG_UNIT
        return [CaseRows(t, q, labels, -np.inf, upper) for t, q in enumerate(layout.q)]

    def values(self, point: Point, block: CaseRows) -> np.ndarray:
        return self._at(point)[0][block.of] / LOG_UNIT

    def jacobian(self, point: Point, block: CaseRows) -> np.ndarray:
        return self._at(point)[1][block.of] / LOG_UNIT

    def _at(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """Values (tasks, m) and gradients (tasks, m, n)."""
        logs = self._logs
        assert logs is not None  # else there are no rows
        return point.once(self, lambda: logs.gradient(point.x[np.array(point.layout.q)]))

    def add_hessian(
        self, sums: Hessian, point: Point, blocks: list[CaseRows], multipliers: np.ndarray
    ) -> None:
        if not blocks or self._logs is None:
            return
        on = np.array([multipliers[block.rows] for block in blocks]) / LOG_UNIT
        bends = self._logs.hessian(point.x[np.array([block.columns for block in blocks])], on)
        for block, bend in zip(blocks, bends, strict=True):
            sums.add(block.columns, bend)


def _turned(sines: cs.SX, cosine: cs.SX) -> cs.SX:
    """Rows that grow with an angle up to 180 degrees, where its sine vanishes: 2 tan(angle / 2)."""
    return 2 * sines / (1 + cosine + _HALF_TURN) / ANGLE_UNIT


def _changeable(symbols: Symbols, values: cs.SX) -> tuple[list[int], float]:
    """Rows that some variable changes (in a planar robot not all), and how far the others are from 0."""
    inputs = [symbols.y, *symbols.local.symbols]
    function = cs.Function("probe", inputs, [values, cs.jacobian(values, symbols.y)])
    rng = np.random.default_rng(0)
    slope, worst = np.zeros(values.numel()), np.zeros(values.numel())
    for _ in range(_PROBES):
        value, jacobian = function(*(rng.normal(size=symbol.shape) for symbol in inputs))
        slope = np.maximum(slope, np.abs(np.array(jacobian)).max(axis=1))
        worst = np.maximum(worst, np.abs(np.array(value)).ravel())
    kept = np.flatnonzero(slope > _CONSTANT)
    return kept.tolist(), float(np.max(np.delete(worst, kept), initial=0.0))
