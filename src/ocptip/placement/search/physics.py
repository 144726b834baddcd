"""Everything smooth in the nonlinear program on one patch of terrain, as functions with two derivatives.

Variables of one task are y = (p, q): the patch's parameters and the joint angles of that task.

It also chooses which gaps, load cases and pieces of force sets take part in a program around a point.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as cs
import numpy as np

from ocptip.placement.evaluate import Evaluator
from ocptip.placement.limits.arm import Clearance, Reach
from ocptip.placement.limits.contact import wrench_of_forces
from ocptip.placement.limits.forces import ContactForces, Local, Piece, Twice
from ocptip.placement.limits.layout import corner_maps
from ocptip.placement.limits.limit import Symbols
from ocptip.placement.power import HoldingPower
from ocptip.placement.problem import TaskLoad
from ocptip.robots.dynamics import inverse_dynamics
from ocptip.standing.footing import Footing


def unique_normal_forces(footing: Footing) -> bool:
    """Three contacts on one plane: redistribution in full is then the same as of tangential forces."""
    return footing.support.n_contacts == 3 and footing.tip_over.affine_moments is not None


class PatchPhysics:
    """Functions of a problem on one patch.

    Args:
        evaluator: of the problem.
        patch: number of the patch.

    Attributes:
        stand: how the base stands on it.
        loads: (y, force, moment in world axes) -> torques (n,), the wrench (6,) on the base, gravity (3,).
        functions: per limit its rows that are smooth functions of y, see `Limit.functions`.
        pose: those that vanish where the gripper has its pose, per task, in units of 0.1 m and 0.2 rad.
        gaps: signed distances of the arm minus the clearance, in 0.1 m; None without any.
        forces: contact forces as variables, where all may be redistributed; else None.
        power: torques -> power, gradient, second derivatives; None for a torque cost.
    """

    def __init__(self, evaluator: Evaluator, patch: int) -> None:
        self.evaluator, self.problem, self.patch = evaluator, evaluator.problem, patch
        problem, robot, footing = self.problem, self.problem.robot, self.problem.footing
        self.terrain, self.stand = problem.terrain[patch], problem.stands[patch]
        self.k, self.n = self.terrain.size, robot.arm.n
        y = cs.SX.sym("y", self.k + self.n)
        p, q = y[: self.k], y[self.k :]
        local = Local(self.stand.given, lambda place: self.stand.local(place[: self.k]))
        moving, about = self.stand.conforms, footing.support.center_of_mass
        symbols = Symbols(y, p, q, self.terrain, *self.stand.expressions(p), about, moving, local)
        self.loads = self._loads(symbols)
        self.functions = {limit: limit.functions(symbols) for limit in evaluator.limits}
        self.pose = self.functions[evaluator.limit(Reach)]
        self.gaps = next(iter(self.functions[evaluator.limit(Clearance)]), None)
        self.forces = None
        if moving or footing.slip.redistribution == "full" or unique_normal_forces(footing):
            unit = robot.mass * max(float(np.linalg.norm(problem.gravity)), 1e-3)
            self.forces = ContactForces(footing.support, unit, wrench_of_forces(symbols) if moving else None)
        self.power = problem.energy.derivatives(self.n) if isinstance(problem.energy, HoldingPower) else None

    @property
    def dropped(self) -> list[float]:
        """Per task, how far (in units of `pose`) rows miss that no variable can change; they are left out."""
        return [pose.dropped for pose in self.pose]

    def _loads(self, symbols: Symbols) -> Twice:
        support = self.problem.robot.support
        force, moment, still = cs.SX.sym("f", 3), cs.SX.sym("m", 3), cs.SX.zeros(self.n)
        gravity = symbols.base.T @ cs.SX(self.problem.gravity)
        torque, wrench = inverse_dynamics(self.problem.robot.arm)(
            symbols.q,
            still,
            still,
            gravity,
            symbols.base.T @ force,
            symbols.base.T @ moment,
            support.center_of_mass,
        )
        weight = cs.vertcat(support.mass * gravity, cs.SX.zeros(3))
        counts = corner_maps(self.problem).shape[2] > 6
        values = cs.vertcat(torque, wrench + weight, gravity if counts else cs.SX(0, 1))
        return Twice.of(symbols.y, [force, moment], values, local=symbols.local)


_NEAR_WORST = 0.95  # share of the worst corner's usage
_CORNERS = 2  # of a load case that are taken for near the worst, at most


def near_gaps(physics: PatchPhysics, p: np.ndarray, q: np.ndarray, distance: float) -> list[np.ndarray]:
    """Per task, which gaps are within `distance` (in 0.1 m) of their limit at p (k,) and q (tasks, n)."""
    if physics.gaps is None:
        return [np.zeros(0, dtype=bool) for _ in q]
    return [physics.gaps.values(np.concatenate([p, angles])) < distance for angles in q]


def held_cases(physics: PatchPhysics, p: np.ndarray, q: np.ndarray, share: float) -> list[int]:
    """Contact cases whose friction utilisation counts, or uses `share` of its limit or more at p (k,), q
    (tasks, n).

    Of a load case that counts those at the corners of the tolerance that are about as bad as the worst.
    """
    problem = physics.problem
    limit, counts = problem.limits.GT or 1.0, problem.weights.GT > 0
    return [
        j
        for j, case, usage, near_worst in _usages(physics, p, q)
        if (near_worst and counts and case.counts) or not usage < share * limit
    ]


def worst_cases(physics: PatchPhysics, p: np.ndarray, q: np.ndarray) -> list[int]:
    """Numbers of the contact cases that are nearly the worst of their constrained load case."""
    return [j for j, _, _, near_worst in _usages(physics, p, q) if near_worst]


def _usages(
    physics: PatchPhysics, p: np.ndarray, q: np.ndarray
) -> Iterator[tuple[int, TaskLoad, float, bool]]:
    """Number, load case, friction utilisation of every constrained contact case, and whether it is near the
    worst.
    """
    problem, stand = physics.problem, physics.stand
    constrained = [i for i, case in enumerate(problem.cases) if case.constrained]
    wrenches_held = wrenches(physics, p, q).reshape(len(problem.cases), -1, 6)[constrained]
    usage = physics.evaluator.fast_usage(stand, stand.at(p), wrenches_held.reshape(1, -1, 6)).reshape(
        wrenches_held.shape[:2]
    )
    for i, usage_of_case in zip(constrained, usage, strict=True):
        near = ~(usage_of_case < _NEAR_WORST * np.max(usage_of_case)) & (
            np.argsort(np.argsort(-usage_of_case, kind="stable")) < _CORNERS
        )
        for c, value in enumerate(usage_of_case):
            yield len(usage_of_case) * i + c, problem.cases[i], float(value), bool(near[c])


def pieces(physics: PatchPhysics, p: np.ndarray, q: np.ndarray, held: list[int]) -> list[Piece] | None:
    """Pieces of the force sets in which the contact solver's forces lie, per held case."""
    if physics.forces is None or not held:
        return None if physics.forces is None else []
    return physics.forces.start(wrenches(physics, p, q)[held], physics.stand.footing(p))[1]


def wrenches(physics: PatchPhysics, p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """(contact cases, 6) wrenches on the base, N and N m."""
    points = [(np.concatenate([p, q[case.task]]), case) for case in physics.problem.cases]
    loads = np.array([physics.loads.values(y, c.force, c.moment)[physics.n :] for y, c in points])
    return np.einsum("kwg,ig->ikw", corner_maps(physics.problem), loads).reshape(-1, 6)
