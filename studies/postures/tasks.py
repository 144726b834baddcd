"""Tasks from gripper pose to gripper pose: three six-axis arms on bases that tip, two of seven axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.motion.choices import plainest_cost, posture_pairs, postures_of
from ocptip.motion.task import MotionTask, refusals
from ocptip.published.cases import motion_case
from ocptip.published.tasks import experiment_robot
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.kinematics import gripper_pose
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.refusals import posture_refusals
from ocptip.standing.limits import Limits
from ocptip.task_files.motion import load_task
from studies.common import EXAMPLES

SIX = ("UR5", "FP1W2F", "FSFS")
PLANNED = (0, 1, 2)
MOST_PAIRS = 16
HOPELESS = 1.8
TRIES = 400
NEAR, FAR = 0.5, 2.5  # rad: largest difference of the drawn postures, joint 1 to 3, at least and at most


@cache
def robot_of(name: str) -> tuple[Robot, Limits]:
    """A robot, and the limits of its tasks."""
    if name == "UR5":
        task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
        assert isinstance(task.robot, Robot)
        return task.robot, task.limits
    return experiment_robot(motion_case({"FP1W2F": "A", "FSFS": "C"}[name]), "effective"), Limits()


def branch_task(number: int, seed: int = 0) -> MotionTask:
    """A six-axis task; number 0, 1, ... of a seed. Of every third the start is a pose, too."""
    rng, name = np.random.default_rng([seed, number]), SIX[number % len(SIX)]
    robot, limits = robot_of(name)
    for _ in range(TRIES):
        start, goal = (standing_posture(robot, limits, rng) for _ in range(2))
        if not NEAR <= np.max(np.abs(goal - start)[:3]) <= FAR:
            continue
        poses = (number % 9) // 3 == 2
        task = pose_task(f"{name} {number}", robot, limits, start if not poses else None, start, goal)
        if 3 <= len(task.choices) <= MOST_PAIRS:
            return replace(task, optimised=PLANNED)
    raise InputError(f"task {number}: none found in {TRIES} draws")


def standing_posture(robot: Robot, limits: Limits, rng: np.random.Generator) -> np.ndarray:
    """A random posture (n,), rad, that keeps all limits at rest."""
    own = robot.limits
    low, high = np.maximum(own.angle_min, -np.pi), np.minimum(own.angle_max, np.pi)
    while True:
        q = rng.uniform(low, high)
        if not posture_refusals(robot, limits, q):
            return q


def pose_task(
    name: str,
    robot: Robot,
    limits: Limits,
    given: np.ndarray | None,
    start: np.ndarray,
    goal: np.ndarray,
) -> MotionTask:
    """From a given posture (None: from the pose of `start`) to the pose of `goal`."""
    targets = [PoseTarget(*gripper_pose(robot.arm, q)) for q in (start, goal)]
    starts = postures_of(robot.arm, targets[0], limits) if given is None else given[None]
    pairs = posture_pairs(robot, limits, starts, postures_of(robot.arm, targets[1], limits))
    wanted = (targets[0] if given is None else None), targets[1]
    return MotionTask(name, robot, *pairs[0], limits, choices=tuple(pairs), targets=wanted)


def hopeless(pairs: Sequence[MotionTask], factor: float = HOPELESS) -> set[int]:
    """Which pairs' plainest motions cost so much that no plan between these postures will be the cheapest.

    Planned motions need down to 0.65 of their plainest ones; so do those of the cheapest pair, roughly.
    """
    costs = [plainest_cost(pair) for pair in pairs]
    return {k for k, cost in enumerate(costs) if cost > factor * min(costs)}


def plannable_pairs(task: MotionTask) -> list[MotionTask]:
    """One task per pair of postures that can be planned, in the task's order."""
    each = [replace(task, start=start, goal=goal, choices=()) for start, goal in task.choices]
    return [one for one in each if not refusals(one)]
