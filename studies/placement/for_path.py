"""Placement for a path: where the base should stand so that a path through gripper tasks is timed best.

    python -m studies.placement.for_path

prints how long the sweep of the examples takes where the cart stands, and at the best place of the search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from ocptip.basics.errors import InputError, OcptipError, PlanningError, positive_number, whole_number
from ocptip.motion.objective import TIME, Objective
from ocptip.motion.violations import sentence
from ocptip.numerics.threads import one_thread
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.for_cycle import sampled_places
from ocptip.placement.place import place
from ocptip.placement.problem import GripperTask, PlacementLimits, PlacementProblem
from ocptip.placement.result import FEASIBLE, Placement, evaluate_placement
from ocptip.placement.search.refine import followed
from ocptip.placement.search.starts import exact_scores, solutions
from ocptip.placement.terrain import plane
from ocptip.retiming.retime import Retimed, least_cost, retime
from ocptip.robots.inverse.joint_angles import nearest_copies
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.task_files.motion import load_task
from ocptip.task_files.path import load_path
from ocptip.trajectories.path_fit import FittedPath, blended_lines, spline_through
from ocptip.trajectories.tool_path import tool_lines
from studies.common import EXAMPLES

Between = Literal["spline", "lines", "tool lines"]
_NODES = 40  # of timings that are compared while looking around: 0.5 % of the duration
_ROUNDS, _DRAWS = 16, 8
_RADIUS, _SHRINK = 0.1, 0.6  # of the parameters' scales: standard deviation of the first round; then
_SAME_POSTURE = 1e-3  # rad or m


@dataclass(frozen=True, eq=False)
class PathPlacement:
    """One place, and the path from there with its timing.

    Attributes:
        placement: with the postures through which the path goes.
        path: the path; None where there is none.
        timed: its timing; None where it has none.
        refusal: why; else empty.
    """

    placement: Placement
    path: FittedPath | None
    timed: Retimed | None
    refusal: str = ""

    @property
    def verified(self) -> bool:
        """The placement keeps its limits at rest, and the timing keeps those of the motion."""
        return self.timed is not None and self.timed.verified and self.placement.feasible

    @property
    def cost(self) -> float:
        """In the unit of the objective; infinite where no timing is verified."""
        if self.timed is None or not self.verified:
            return np.inf
        return self.timed.objective.cost(self.timed.check.energy, self.timed.motion.end)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "placement": self.placement.to_dict(),
            "verified": self.verified,
            "cost": self.cost if self.verified else None,
            "timing": None if self.timed is None else self.timed.to_dict(),
            "path_made_of": None if self.path is None else self.path.how,
            "refusal": self.refusal,
        }


@one_thread
def place_for_path(
    problem: PlacementProblem,
    objective: Objective = TIME,
    *,
    between: Between = "spline",
    path_tolerance: float = 0.0,
    known: Sequence[Placement] = (),
    candidates: int = 3,
    seed: int = 0,
    placement_starts: int = 5,
) -> tuple[PathPlacement, ...]:
    """Find the place of minimum cost of the path through the gripper tasks: time, energy, or both.

    Known places, the best distinct ones at rest, and sampled ones are candidates. Around each a random search
    on coarse grids selects places whose best timing costs less and that keep all limits at rest. The results
    are timed on the usual grid by `ocptip.retiming.retime.retime`, unloaded, within the same limits, and
    checked; that of the candidate counts where it is better.

    Args:
        problem: with two tasks or more, in the order in which they are visited.
        objective: `TIME`, `ENERGY` or `priced`.
        between: "spline" of the joints, "lines" of the joints, or "tool lines", straight ones of the gripper.
        path_tolerance: rad (sliding joints, tool lines: m), by which corners of lines are rounded; 0: the arm
            stops there.
        known: places to begin with, such as where the base stands now; no result is worse.
        candidates: number of places to begin with besides these.
        seed: of the placement and the search.
        placement_starts: of `place`.

    Returns:
        The minimum cost first; those without verified timing last.

    Raises:
        InputError: fewer than two tasks, bad numbers, or a tolerance of the base.
        NoPlacementError: no placement serves all tasks at rest.
        PlanningError: the path has no verified timing at any place; the message says why.
    """
    require_way(problem)
    if between not in get_args(Between):
        raise InputError(f"between: expected one of {', '.join(get_args(Between))}, got {between!r}")
    positive_number("path_tolerance", path_tolerance, zero_allowed=True)
    for name, value in {"candidates": candidates, "placement_starts": placement_starts}.items():
        whole_number(name, value, 1)
    paths = _Paths(problem, objective, between, path_tolerance)
    static = place(problem, starts=placement_starts, seed=seed, keep=candidates)
    places = list(static.places[:candidates])
    places += sampled_places(problem, static, candidates - len(places), seed)
    places = [shortest_way(paths.evaluator, placement, seed) for placement in places]
    found = [paths.best_around(placement, np.random.default_rng(seed)) for placement in (*known, *places)]
    ranked = tuple(sorted(found, key=lambda one: one.cost))
    if not ranked[0].verified:
        reasons = "; ".join(dict.fromkeys(one.refusal for one in ranked))
        raise PlanningError(f"no verified timing at any of {len(ranked)} places: {reasons}")
    return ranked


class _Paths:
    """Paths through the tasks of a problem, and their timings, place by place."""

    def __init__(
        self, problem: PlacementProblem, objective: Objective, between: Between, tolerance: float
    ) -> None:
        self.evaluator, self._problem, self._objective = Evaluator(problem), problem, objective
        self._between, self._tolerance = between, tolerance
        self._limits: Limits = motion_limits(problem)

    def best_around(self, placement: Placement, rng: np.random.Generator) -> PathPlacement:
        """The best place of a random search around a place, or that place itself where it is better."""
        first = self._timed(placement)
        parameters, q = self._around(placement, rng)
        if np.array_equal(parameters, placement.parameters):
            return first
        found = self._timed(
            evaluate_placement(self.evaluator, placement.patch, parameters, q, placement.start)
        )
        return min(first, found, key=lambda one: one.cost)

    def _around(self, placement: Placement, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (k,) and postures (tasks, n)."""
        patch, terrain = placement.patch, self._problem.terrain[placement.patch]
        p, q = placement.parameters, placement.angles
        best, radius = self._cost(patch, p, q), _RADIUS
        for _ in range(_ROUNDS):
            steps = radius * self._problem.scales(patch) * rng.normal(size=(_DRAWS, len(p)))
            drawn = terrain.wrapped(np.clip(p + steps, terrain.lower, terrain.upper))
            postures, kept = followed(self.evaluator, patch, drawn, np.repeat(q[None], _DRAWS, axis=0))
            at = np.flatnonzero(kept)
            if len(at):
                margins = exact_scores(self.evaluator, patch, drawn[at], postures[at], fast=True)[1]
                at = at[margins >= -FEASIBLE]
            costs = [self._cost(patch, drawn[k], postures[k]) for k in at]
            if costs and min(costs) < best:
                best, k = min(costs), at[int(np.argmin(costs))]
                p, q = drawn[k], postures[k]
            else:
                radius *= _SHRINK
        return p, q

    def _cost(self, patch: int, parameters: np.ndarray, postures: np.ndarray) -> float:
        """On a coarse grid; infinite where there is no path, or no timing."""
        try:
            path = self._path(patch, parameters, postures).path
            return least_cost(
                robot_at(self._problem, patch, parameters), path, self._limits, self._objective, _NODES
            )
        except OcptipError:
            return np.inf

    def _timed(self, placement: Placement) -> PathPlacement:
        path = None
        try:
            path = self._path(placement.patch, placement.parameters, placement.angles)
            robot = robot_at(self._problem, placement.patch, placement.parameters)
            timed = retime(robot, path.path, self._limits, self._objective)
        except OcptipError as error:
            return PathPlacement(placement, path, None, str(error))
        broken = [*map(str, placement.violations), *map(sentence, timed.check.violations)]
        return PathPlacement(placement, path, timed, "; ".join(broken))

    def _path(self, patch: int, parameters: np.ndarray, postures: np.ndarray) -> FittedPath:
        if self._between == "spline":
            return spline_through(postures)
        if self._between == "lines":
            return blended_lines(postures, self._tolerance)
        origin, base = self._problem.base_pose(patch, parameters[None])
        poses = [_target(task, origin[0], base[0]) for task in self._problem.tasks]
        found = tool_lines(self.evaluator.arm, poses, postures[:1], self._tolerance)
        if np.abs(found.path.goal - postures[-1]).max() > _SAME_POSTURE and poses[0].conditions == 6:
            raise PlanningError("the lines end in another posture than the one that was checked")
        return found


def _target(task: GripperTask, origin: np.ndarray, base: np.ndarray) -> PoseTarget:
    """The task's pose in base axes."""
    position, rotation = base.T @ (task.position - origin), base.T @ task.rotation
    return PoseTarget(position, rotation, orientation=task.orientation, tool_axis=task.tool_axis)


def robot_at(problem: PlacementProblem, patch: int, parameters: np.ndarray) -> Robot:
    """The robot placed by parameters (k,) of a patch: gravity and obstacles of the world in base axes.

    Its tip-over index keeps the reference moment of the problem's robot.
    """
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


def sweep() -> tuple[PlacementProblem, Placement]:
    """The sweep of the examples as gripper tasks, and the place where its cart stands."""
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    robot = task.robot
    assert isinstance(robot, Robot)
    postures = load_path(EXAMPLES / "paths" / "ur5_sweep.toml", task).paths[0].samples
    tasks = [GripperTask(*gripper_pose(robot.arm, q), name=f"point {k}") for k, q in enumerate(postures, 1)]
    problem = PlacementProblem(robot, tasks, plane(), limits=PlacementLimits(GN=0.9, GT=0.9, clearance=0.01))
    return problem, evaluate_placement(Evaluator(problem), 0, np.zeros(3), postures)


def main() -> None:
    """Print both durations."""
    problem, here = sweep()
    given = retime(
        robot_at(problem, here.patch, here.parameters),
        spline_through(here.angles).path,
        motion_limits(problem),
    )
    best = place_for_path(problem, known=[here])[0]
    print(f"where it stands: {given.motion.end:.3f} s; best place: {best.cost:.3f} s")


if __name__ == "__main__":
    main()
