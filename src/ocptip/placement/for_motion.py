"""Placement for a motion: good placements at rest, ranked by the energy of the motions planned on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, OcptipError, PlanningError, whole_number
from ocptip.certificate.checks import certified
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.plan import plan_motion
from ocptip.motion.task import FIRST_SEVEN, MotionTask
from ocptip.numerics.threads import one_thread
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.place import place
from ocptip.placement.problem import PlacementProblem
from ocptip.placement.result import FEASIBLE, Placement, PlacementResult, evaluate_placement
from ocptip.placement.search.starts import solutions
from ocptip.robots.inverse.joint_angles import nearest_copies
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits


@dataclass(frozen=True, eq=False)
class MotionPlacement:
    """One placement with the motions planned from each gripper task to the next.

    Attributes:
        placement: with the joint angles at which the motions start and end.
        plans: one per leg; None without a verified motion.
        refusals: one sentence per leg, empty where there is a plan.
    """

    placement: Placement
    plans: tuple[MotionPlan | None, ...]
    refusals: tuple[str, ...]

    @property
    def verified(self) -> bool:
        """All legs have a verified plan."""
        return all(plan is not None and plan.verified for plan in self.plans)

    @property
    def energy(self) -> float:
        """Electric energy of all legs, J; infinite if one has no plan."""
        return float(sum(np.inf if plan is None else plan.energy for plan in self.plans))

    @property
    def duration(self) -> float:
        """Duration of all legs, s; infinite if one has no plan."""
        return float(sum(np.inf if plan is None else plan.duration for plan in self.plans))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "placement": self.placement.to_dict(),
            "verified": self.verified,
            "energy_J": self.energy if np.isfinite(self.energy) else None,
            "duration_s": self.duration if np.isfinite(self.duration) else None,
            "legs": [None if plan is None else plan.check.to_dict() for plan in self.plans],
            "refusals": list(self.refusals),
        }


@dataclass(frozen=True, eq=False)
class MotionPlacementResult:
    """Placements ranked by the energy of their motions.

    Attributes:
        ranked: the minimum energy first; those without plan last.
        static: result of the placement at rest.
    """

    ranked: tuple[MotionPlacement, ...]
    static: PlacementResult

    @property
    def best(self) -> MotionPlacement:
        """The placement with the minimum planned energy."""
        return self.ranked[0]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {"ranked": [m.to_dict() for m in self.ranked], "seconds_static": self.static.seconds}


@one_thread
def place_for_motion(
    problem: PlacementProblem,
    *,
    candidates: int = 3,
    starts: int = 2,
    seed: int = 0,
    jobs: int | None = 1,
    optimised: tuple[int, ...] = FIRST_SEVEN,
    commands: int = 3,
    placement_starts: int = 5,
) -> MotionPlacementResult:
    """Find the placement from which the arm moves from gripper task to gripper task with minimum energy.

    The best distinct placements at rest (all tasks, all constraints) are candidates. On each the IK solutions
    of the tasks are chosen so that the joint paths, in seconds at full speed, are shortest, and every leg is
    planned by `ocptip.motion.plan.plan_motion`, unloaded, within the same limits.

    Args:
        problem: with two tasks or more, in the order in which they are visited.
        candidates: number of placements to plan on.
        starts: of the motion planner, per leg.
        seed: of placements and plans.
        jobs: processes of the motion planner.
        optimised, commands: see `MotionTask`.
        placement_starts: of `place`.

    Raises:
        InputError: fewer than two tasks, or a tolerance of the base.
        NoPlacementError: no placement serves all tasks at rest.
        PlanningError: no candidate has a verified motion; the message names the limit that fails on each.
    """
    require_way(problem)
    numbers = {"candidates": candidates, "starts": starts, "jobs": 1 if jobs is None else jobs}
    for name, value in (numbers | {"placement_starts": placement_starts}).items():
        whole_number(name, value, 1)
    static = place(problem, starts=max(placement_starts, candidates), seed=seed, keep=candidates)
    evaluator, found = Evaluator(problem), []
    for placement in static.placements:
        aligned = shortest_way(evaluator, placement, seed)
        robot = placed_robot(aligned)
        plans, refusals = [], []
        for start, goal, name in _legs(aligned):
            task = MotionTask(name, robot, start, goal, motion_limits(problem), tuple(optimised), commands)
            try:
                plans.append(plan_motion(task, starts=starts, seed=seed, jobs=jobs, prove=certified))
                refusals.append("")
            except OcptipError as error:
                plans.append(None)
                refusals.append(str(error))
        found.append(MotionPlacement(aligned, tuple(plans), tuple(refusals)))
    ranked = tuple(sorted(found, key=lambda m: m.energy))
    if not ranked[0].verified:
        reasons = "; ".join(dict.fromkeys(r for m in ranked for r in m.refusals if r))
        raise PlanningError(f"no verified motion on any of {len(ranked)} placements: {reasons}")
    return MotionPlacementResult(ranked, static)


def placed_robot(placement: Placement) -> Robot:
    """The robot at its place: gravity and obstacles of the world in base axes.

    Its tip-over index keeps the reference moment of the problem's robot.
    """
    return robot_at(placement.problem, placement.patch, placement.parameters)


def robot_at(problem: PlacementProblem, patch: int, parameters: np.ndarray) -> Robot:
    """The robot placed by parameters (k,) of a patch."""
    robot, (origins, bases) = problem.robot, problem.base_pose(patch, parameters[None])
    origin, base = origins[0], bases[0]
    footing = problem.stands[patch].footing(parameters)
    around = [obstacle.placed(base.T, -base.T @ origin) for obstacle in problem.obstacles]
    return robot.varied(
        support=robot.support.varied(footing.support.contacts, gravity=base.T @ problem.gravity),
        obstacles=[*robot.obstacles, *around],
        reference_moment=robot.tip_over.reference_moment,
        redistribution=robot.slip.redistribution,
    )


def shortest_way(evaluator: Evaluator, placement: Placement, seed: int = 0) -> Placement:
    """This placement with the IK solutions between which joint motion is minimal, checked again.

    Only solutions that keep all constraints of their task count; where a task has none besides the given one,
    that one stays.
    """
    limits = evaluator.arm.limits
    rng = np.random.default_rng(seed)
    weights = 1 / np.where(np.isfinite(limits.speed), limits.speed, 1.0)
    layers = []
    for t, own in enumerate(placement.angles):
        q = solutions(evaluator, t, placement.patch, placement.parameters[None], rng)[0]
        q = np.vstack([own, q[np.isfinite(q).all(axis=1)]])
        parameters = np.tile(placement.parameters, (len(q), 1))
        kept = evaluator.task(t, placement.patch, parameters, q).margin() >= -FEASIBLE
        kept[0] = True
        layers.append(q[kept])
    cost, path = np.zeros(len(layers[0])), [[q] for q in layers[0]]
    for q in layers[1:]:
        options = []
        for goal in q:
            near = [_near(evaluator.arm, goal, way[-1]) for way in path]
            costs = [c + np.abs(g - way[-1]) @ weights for c, way, g in zip(cost, path, near, strict=True)]
            best = int(np.argmin(costs))
            options.append((costs[best], [*path[best], near[best]]))
        cost, path = np.array([c for c, _ in options]), [way for _, way in options]
    angles = np.array(path[int(np.argmin(cost))])
    return evaluate_placement(evaluator, placement.patch, placement.parameters, angles, placement.start)


def _near(arm: ArmModel, goal: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The copy of an angle, whole turns away, that is nearest to the start within its limits."""
    turned = nearest_copies(arm, goal, start)
    return np.where((turned >= arm.limits.angle_min) & (turned <= arm.limits.angle_max), turned, goal)


def _legs(placement: Placement) -> list[tuple[np.ndarray, np.ndarray, str]]:
    names, angles = [task.name for task in placement.problem.tasks], placement.angles
    return [(angles[t], angles[t + 1], f"{names[t]} to {names[t + 1]}") for t in range(len(names) - 1)]


def require_way(problem: PlacementProblem) -> None:
    """Raise InputError for a problem with one task, or with a tolerance of its base."""
    if len(problem.tasks) < 2:
        raise InputError("tasks: a motion needs two gripper tasks or more, got one")
    if problem.tolerance.given:
        raise InputError("tolerance: motions are planned for the nominal base; leave the tolerance out")


def motion_limits(problem: PlacementProblem) -> Limits:
    """The limits of motions between the tasks of a problem."""
    limits = problem.limits
    return Limits(
        GN=limits.GN or 1.0,
        GT=limits.GT or 1.0,
        torque_ratio=limits.torque_ratio,
        clearance=limits.clearance,
    )
