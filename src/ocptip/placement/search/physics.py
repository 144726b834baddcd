"""Everything smooth in the nonlinear program on one patch of terrain, as functions with two derivatives.

Variables of one task are y = (p, q): the patch's parameters and the joint angles of that task.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.numerics.point import PointFunction
from ocptip.placement.evaluate import ANGLE_UNIT, LENGTH_UNIT, Evaluator
from ocptip.placement.manipulability import LogMeasures, limited
from ocptip.placement.power import HoldingPower
from ocptip.placement.problem import GripperTask
from ocptip.placement.search.forces import ContactForces
from ocptip.robots.dynamics import inverse_dynamics
from ocptip.robots.geometry import Floor, sphere_centres
from ocptip.robots.kinematics import gripper_kinematics
from ocptip.standing.arm import StandingRobot

_PROBES = 8
_CONSTANT = 1e-9


@dataclass(frozen=True, eq=False)
class Twice:
    """A vector function with two derivatives.

    Attributes:
        first: y and further arguments -> values (m,), Jacobian (m, ny).
        second: the same and multipliers (m,) -> Hessian (ny, ny) of their product with the values.
        size: m.
    """

    first: PointFunction
    second: PointFunction
    size: int

    @classmethod
    def of(cls, y: cs.SX, arguments: list[cs.SX], values: cs.SX) -> Twice:
        """From expressions."""
        lam = cs.SX.sym("lam", values.numel())
        hessian, _ = cs.hessian(cs.dot(lam, values), y)
        return cls(
            PointFunction(cs.Function("first", [y, *arguments], [values, cs.vec(cs.jacobian(values, y))])),
            PointFunction(cs.Function("second", [y, *arguments, lam], [hessian])),
            values.numel(),
        )

    def jacobian(self, *arguments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (m,) and Jacobian (m, ny)."""
        values, slope = self.first(*arguments)
        return values, slope.reshape(-1, len(values)).T

    def hessian(self, *arguments: np.ndarray) -> np.ndarray:
        """(ny, ny)."""
        result = self.second(*arguments)[0]
        return result.reshape(len(arguments[0]), -1)


def unique_normal_forces(robot: StandingRobot) -> bool:
    """Three contacts on one plane: redistribution in full is then the same as of tangential forces."""
    return robot.support.n_contacts == 3 and robot.tip_over.affine_moments is not None


class PatchPhysics:
    """Functions of a problem on one patch.

    Args:
        evaluator: of the problem.
        patch: number of the patch.

    Attributes:
        loads: (y, force, moment in world axes) -> torques (n,) and the wrench (6,) on the base.
        pose: per task, y -> rows that vanish where the gripper has its pose, in units of 0.1 m and 0.2 rad.
        dropped: per task, how far (in these units) rows miss that no variable can change; they are left out.
        gaps: y -> signed distances of the arm minus the clearance, in 0.1 m; None without any.
        gap_labels: their names.
        ground: p -> rows >= 0 that concern the base alone, in 0.1 m, or None.
        ground_labels: their kinds and names.
        manipulability: logarithms of the limited measures over log 2, or None.
        forces: contact forces as variables, where all may be redistributed; else None.
        power: torques -> power, gradient, second derivatives; None for a torque cost.
    """

    def __init__(self, evaluator: Evaluator, patch: int) -> None:
        self.evaluator, self.problem, self.patch = evaluator, evaluator.problem, patch
        problem = self.problem
        self.terrain = problem.terrain[patch]
        self.k, self.n = self.terrain.size, problem.robot.arm.n
        arm = problem.robot.arm
        y = cs.SX.sym("y", self.k + self.n)
        p, q = y[: self.k], y[self.k :]
        ground, turn = self.terrain.function(p)
        position, rotation = problem.ground_frame
        base = turn @ cs.SX(rotation.T)
        origin = ground - base @ cs.SX(position)
        self.loads = self._loads(y, q, base)
        tip, turned, _ = gripper_kinematics(arm)(q)
        world, axes = origin + base @ tip, base @ turned
        made = [self._pose(y, task, world, axes) for task in problem.tasks]
        self.pose, self.dropped = [m[0] for m in made], [m[1] for m in made]
        self.gaps, self.gap_labels = self._gaps(y, q, origin, base)
        self.ground, self.ground_labels = self._ground(p, origin, base)
        limits = problem.limits
        self.manipulability = LogMeasures(arm, limits) if limited(limits) else None
        robot = problem.robot
        self.forces = None
        if robot.slip.redistribution == "full" or unique_normal_forces(robot):
            unit = robot.mass * max(float(np.linalg.norm(problem.gravity)), 1e-3)
            self.forces = ContactForces(robot.support, robot.slip, unit)
        self.power = None
        if isinstance(problem.energy, HoldingPower):
            self.power = problem.energy.derivatives(arm.n)

    def _loads(self, y: cs.SX, q: cs.SX, base: cs.SX) -> Twice:
        problem, support = self.problem, self.problem.robot.support
        force, moment, still = cs.SX.sym("f", 3), cs.SX.sym("m", 3), cs.SX.zeros(self.n)
        gravity = base.T @ cs.SX(problem.gravity)
        torque, wrench = inverse_dynamics(problem.robot.arm)(
            q, still, still, gravity, base.T @ force, base.T @ moment, support.center_of_mass
        )
        weight = cs.vertcat(support.mass * gravity, cs.SX.zeros(3))
        return Twice.of(y, [force, moment], cs.vertcat(torque, wrench + weight))

    def _pose(self, y: cs.SX, task: GripperTask, world: cs.SX, axes: cs.SX) -> tuple[Twice, float]:
        rows = [(world - cs.SX(task.position)) / LENGTH_UNIT]
        if task.orientation == "full":
            error = cs.SX(task.rotation.T) @ axes
            rows.append(
                cs.vertcat(error[2, 1] - error[1, 2], error[0, 2] - error[2, 0], error[1, 0] - error[0, 1])
                / (2 * ANGLE_UNIT)
            )
        elif task.orientation == "axis":
            goal = task.rotation @ task.tool_axis
            x = np.cross(goal, np.eye(3)[np.argmin(np.abs(goal))])
            x /= np.linalg.norm(x)
            across = np.array([x, np.cross(goal, x)])
            rows.append(cs.SX(across) @ axes @ cs.SX(task.tool_axis) / ANGLE_UNIT)
        values = cs.vertcat(*rows)
        kept, missed = self._changeable(y, values)
        return Twice.of(y, [], values[kept]), missed

    def _changeable(self, y: cs.SX, values: cs.SX) -> tuple[list[int], float]:
        """Rows that some variable changes (in a planar robot not all), and how far the others are from 0."""
        function = cs.Function("probe", [y], [values, cs.jacobian(values, y)])
        rng = np.random.default_rng(0)
        slope, worst = np.zeros(values.numel()), np.zeros(values.numel())
        for _ in range(_PROBES):
            value, jacobian = function(rng.normal(size=y.numel()))
            slope = np.maximum(slope, np.abs(np.array(jacobian)).max(axis=1))
            worst = np.maximum(worst, np.abs(np.array(value)).ravel())
        kept = np.flatnonzero(slope > _CONSTANT)
        return kept.tolist(), float(np.max(np.delete(worst, kept), initial=0.0))

    def _gaps(self, y: cs.SX, q: cs.SX, origin: cs.SX, base: cs.SX) -> tuple[Twice | None, tuple[str, ...]]:
        problem, arm = self.problem, self.problem.robot.arm
        collision, least = problem.robot.collision, problem.limits.clearance
        gaps, labels = [], [str(label) for label in collision.labels]
        if labels:
            gaps.append(collision.function(q))
        if arm.sphere_sets and problem.obstacles:
            centres = sphere_centres(arm)(q)
            for obstacle, (index, radii, names) in zip(
                problem.obstacles, self.evaluator._checked, strict=True
            ):
                for i, radius, name in zip(index, radii, names, strict=True):
                    gaps.append(obstacle.gap(origin + base @ centres[:, int(i)], radius))
                    labels.append(f"{name} and {obstacle.name}")
        if not gaps:
            return None, ()
        return Twice.of(y, [], (cs.vertcat(*gaps) - least) / LENGTH_UNIT), tuple(labels)

    def _ground(
        self, p: cs.SX, origin: cs.SX, base: cs.SX
    ) -> tuple[Twice | None, tuple[tuple[str, str], ...]]:
        problem, terrain = self.problem, self.terrain
        rows, labels = [], []
        if terrain.contact_area is not None:
            for k, contact in enumerate(problem.robot.support.contacts):
                at = origin + base @ cs.SX(contact.position)
                for axis, name in enumerate("xy"):
                    for side, sign in ((0, 1.0), (1, -1.0)):
                        if np.isfinite(limit := terrain.contact_area[side, axis]):
                            rows.append(sign * (at[axis] - limit))
                            labels.append(("contact area", f"contact {k + 1}: {name}"))
        for k, sphere in enumerate(problem.base_spheres):
            at = origin + base @ cs.SX(sphere[:3])
            for obstacle in (*problem.obstacles, *problem.keep_out):
                if not isinstance(obstacle, Floor):
                    rows.append(obstacle.gap(at, sphere[3]) - problem.limits.base_clearance)
                    labels.append(("base clearance", f"base[{k + 1}] and {obstacle.name}"))
        if terrain.constraints is not None:
            values = terrain.constraints(p)
            rows += [values[i] for i in range(values.numel())]
            labels += [("terrain", name) for name in terrain.constraint_names]
        if not rows:
            return None, ()
        return Twice.of(p, [], cs.vertcat(*rows) / LENGTH_UNIT), tuple(labels)
