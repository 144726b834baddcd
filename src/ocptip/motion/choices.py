"""Which postures: a gripper pose leaves several, and the cheapest motion need not have the shortest path.

Every pair of start and goal postures is ranked by the cost of the synchronised default motion between them:
one trapezoidal velocity profile per joint, all ending together, slowed down until the base stands. That
orders pairs as the planned motions do, nearly; the most promising ones are planned. Of pairs next to each
other in a continuum of postures one stands for all: the planner moves along it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ocptip.motion.planner.free_ends import FOUND_MARGIN
from ocptip.motion.planner.one_start import free_ends
from ocptip.motion.planner.random_start import SLOWER, pace_that_stands
from ocptip.motion.task import MotionTask, end_refusals, refusals
from ocptip.robots.inverse.joint_angles import within_limits
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.refusals import posture_refusals
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limits import Limits
from ocptip.trajectories.trajectory import Trajectory

COMPARED = 24  # pairs, those with the shortest ways
APART = 0.5  # rad (sliding joints: m): least difference of two pairs in a continuum
PLANNED, WORSE = 4, 1.25  # at most so many, whose plainest motions cost at most so much more than the best
NEARLY = 0.02
"""m: overlap on the straight line in joint space up to which motions near that line may be clear."""

_STATES = 60  # of the straight line
PROMISING = 1.03  # after one start each, the others go to pairs that cost at most so much more than the best


def likely_choices(task: MotionTask) -> list[MotionTask]:
    """The task with its most promising pairs of postures, best first; just the task if it has no choice."""
    if not task.choices:
        return [task]
    limits = task.robot.limits
    speed = np.where(np.isfinite(limits.speed), limits.speed, 1.0)
    pairs = sorted(task.choices, key=lambda pair: float(np.sum(np.abs(pair[1] - pair[0]) / speed)))
    tasks: list[MotionTask] = []
    apart, rests = APART if free_ends(task) else 0.0, dict[tuple[int, bytes], bool]()

    def stays(share: int, q: np.ndarray) -> bool:
        key = share, q.tobytes()  # many pairs have the same ends
        if key not in rests:
            rests[key] = not end_refusals(task, share, q)
        return rests[key]

    for start, goal in pairs:
        one = replace(task, start=start, goal=goal, choices=())
        if any(_difference(one, other) < apart for other in tasks) or refusals(one, at_rest=False):
            continue
        if stays(0, start) and stays(1, goal):
            tasks.append(one)
        if len(tasks) == COMPARED:
            break
    ranked = sorted(((plainest_cost(one), k) for k, one in enumerate(tasks)))
    least = ranked[0][0] if ranked else np.inf
    if not np.isfinite(least):
        return tasks[:PLANNED] or [task]
    return [tasks[k] for cost, k in ranked[:PLANNED] if cost <= WORSE * least]


def _difference(one: MotionTask, other: MotionTask) -> float:
    """Largest difference of any angle at start or goal."""
    return float(np.max(np.abs([one.start - other.start, one.goal - other.goal])))


def plainest_cost(task: MotionTask) -> float:
    """Cost of the synchronised default motion from start to goal at the cheapest speed; infinite if it never
    stands.
    """
    robot, limits, best = task.robot, task.robot.limits, np.inf
    kept = limits_of(robot, task.limits, task.optimised)
    for factor in SLOWER:
        rates = limits.speed / factor, limits.acceleration / factor**2
        motion = Trajectory.ending_together(task.start, task.goal, [None] * robot.n, *rates)
        if pace_that_stands(robot, motion, kept) is None:
            continue
        cost = task.objective.cost(robot.energy(motion), motion.end)
        if cost >= best:
            break
        best = cost
    return float(best)


def line_overlap(task: MotionTask) -> tuple[float, str]:
    """Largest overlap, m, on the straight line in joint space from a start to a goal, and of what, an
    obstacle or the robot itself; of several lines that of the smallest one.
    """
    shares, collision = np.linspace(0, 1, _STATES)[:, None], task.robot.collision
    results = []
    for start, goal in task.choices or [(task.start, task.goal)]:
        gaps = np.min(collision.gaps(start + shares * (goal - start), 0.0), axis=0)
        nearest = int(np.argmin(gaps))
        results.append((max(-float(gaps[nearest]), 0.0), str(collision.labels[nearest])))
    return min(results)


def first_round(tasks: list[MotionTask], numbers: range) -> list[tuple[MotionTask, int]]:
    """Tasks, best first, with the numbers of their first starts: one of each task, or all of a single task.

    Numbers that begin above 0 follow starts that have run before; they are for a single task only.
    """
    if numbers.start or len(tasks) == 1:
        return [(tasks[0], k) for k in numbers]
    return [*zip(tasks, numbers, strict=False)]


def second_round(
    tasks: list[MotionTask], numbers: range, costs: dict[int, float]
) -> list[tuple[MotionTask, int]]:
    """The starts that the first round leaves, for the tasks whose first start promises about the minimum
    cost.

    Args:
        tasks, numbers: see `first_round`.
        costs: of the motions of the first round, by number of the start.
    """
    first = len(first_round(tasks, numbers))
    order = sorted(numbers[:first], key=lambda k: (costs.get(k, np.inf), k))
    least = costs.get(order[0], np.inf)
    good = [k for k in order if costs.get(k, np.inf) <= PROMISING * least]
    return [(tasks[good[k % len(good)]], k) for k in numbers[first:]]


def postures_of(arm: ArmModel, target: PoseTarget, limits: Limits) -> np.ndarray:
    """Postures (k, n), rad (sliding joints: m), of a gripper pose; far from angle limits, if some are.

    Raises:
        InputError: out of reach.
    """
    result = target.postures(arm)
    low, high = arm.angle_range(max(limits.angle_margin, FOUND_MARGIN))
    far = (result >= low) & (result <= high)
    return result[far.all(axis=1)] if far.all(axis=1).any() else result


def posture_pairs(
    robot: Robot, limits: Limits, starts: np.ndarray, goals: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pairs of start and goal, (n,), rad each, by the rule of docs/how-to/gripper-poses.md, ties by order.

    All that stand at rest within all limits; if none does, the one with the fewest reasons against it.

    Args:
        robot: on its support.
        limits: of the task.
        starts, goals: (k, n) each, rad (sliding joints: m).
    """
    arm = robot.arm.limits
    reasons = [[0], [0]]
    if len(starts) > 1 or len(goals) > 1:
        ends = (robot.resting(0), starts), (robot.resting(1), goals)
        reasons = [[len(posture_refusals(segment_task, limits, q)) for q in qs] for segment_task, qs in ends]
    weights = 1 / np.where(np.isfinite(arm.speed), arm.speed, 1.0)
    ranked = []
    for s, start in enumerate(starts):
        for g, goal in enumerate(goals):
            # Branches of a pose, unlike the angles of a posture, may be taken whole turns away.
            near = within_limits(robot.arm, goal, start) if len(goals) > 1 else goal
            way = float(np.abs(near - start) @ weights)
            ranked.append((reasons[0][s] + reasons[1][g], way, len(ranked), start, near))
    ranked.sort(key=lambda entry: entry[:3])
    return [entry[3:] for entry in ranked if entry[0] == 0] or [ranked[0][3:]]
