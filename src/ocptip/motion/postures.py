"""Postures that start and goal may have: those of gripper poses, and the pairs of them that stand."""

from __future__ import annotations

import numpy as np

from ocptip.motion.planner.free_ends import FOUND_MARGIN
from ocptip.robots.inverse.joint_angles import within_limits
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.standing.rest import posture_refusals


def postures_of(arm: ArmModel, target: PoseTarget, limits: Limits) -> np.ndarray:
    """Postures (k, n), rad (sliding joints: m), of a gripper pose; far from angle limits, if some are.

    Raises:
        InputError: out of reach.
    """
    found = target.postures(arm)
    margin = np.where(arm.prismatic, 0.0, max(limits.angle_margin, FOUND_MARGIN))
    far = (found >= arm.limits.angle_min + margin) & (found <= arm.limits.angle_max - margin)
    return found[far.all(axis=1)] if far.all(axis=1).any() else found


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
        reasons = [[len(posture_refusals(own, limits, q)) for q in qs] for own, qs in ends]
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
