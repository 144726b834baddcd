"""Platforms of `ocptip.parallel` descriptions: 6UPS hexapods and planar RPR robots.

A leg counts if its line is known from its two ends: joints that turn about one fixed point, then the driven
prismatic joint through that point, then the coupling point.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, finite_array
from ocptip.indices.platforms.planar import PlanarPlatformPose
from ocptip.indices.platforms.platform import PlatformFile, StewartPlatform
from ocptip.parallel.description.entries import value_of
from ocptip.parallel.description.robot_description import PRISMATIC, Leg, RobotDescription

_SPATIAL, _PLANAR = (True,) * 6, (True, True, False, False, False, True)


def platform_of_robot(robot: RobotDescription) -> PlatformFile:
    """Anchors and home pose of a 6UPS (or nUPS) robot.

    Raises:
        InputError: the robot is none: other degrees of freedom, legs or motors.
    """
    base, moving = _anchors(robot, _SPATIAL, "UPS", 3)
    home = robot.home
    rotation = Rotation.from_euler(robot.platform.convention.upper(), home[3:]).as_matrix()
    return PlatformFile(StewartPlatform(base, moving, robot.name), home[:3].copy(), rotation, None)


def planar_pose_of_robot(robot: RobotDescription, coordinates: object = None) -> PlanarPlatformPose:
    """A planar RPR robot in a pose.

    Args:
        robot: planar, in the xy-plane.
        coordinates: (3,) x, y in m and angle in rad; default: the home pose.

    Raises:
        InputError: the robot is none: other degrees of freedom, legs or motors.
    """
    base, moving = _anchors(robot, _PLANAR, "RPR", 2)
    x, y, angle = robot.home if coordinates is None else finite_array("coordinates", coordinates, (3,))
    c, s = np.cos(angle), np.sin(angle)
    turned = moving[:, :2] @ np.array([[c, s], [-s, c]])
    return PlanarPlatformPose(base[:, :2], turned + np.array([x, y]))


def _anchors(
    robot: RobotDescription, mask: tuple[bool, ...], kind: str, n: int
) -> tuple[np.ndarray, np.ndarray]:
    if not isinstance(robot, RobotDescription):
        raise InputError(f"robot: expected a RobotDescription, got {type(robot).__name__}")
    if robot.platform.mask != mask:
        free = ", ".join(robot.platform.coordinates)
        raise InputError(f"robot {robot.name}: not of kind {kind}: its platform moves in {free}")
    for number, leg in enumerate(robot.legs, start=1):
        if not _straight(leg, n):
            raise InputError(
                f"robot {robot.name}: leg {number} is not of kind {kind} (joints about one point, then a "
                "prismatic joint through it)"
            )
    if sorted(robot.actuated) != [(leg, n - 1) for leg in range(len(robot.legs))]:
        raise InputError(f"robot {robot.name}: needs one motor in the prismatic joint of every leg")
    return np.array([leg.origin for leg in robot.legs]), np.array([leg.coupling_point for leg in robot.legs])


def _straight(leg: Leg, n: int) -> bool:
    """True if joint n is prismatic, the ones before turn, and all their axes meet in the leg's origin."""
    prismatic = [row.sigma == PRISMATIC for row in leg.rows[:n]]
    offsets = [value_of(v) for row in leg.rows[:n] for v in (row.b, row.d)]
    offsets += [value_of(row.r) for row in leg.rows[: n - 1]]
    last = leg.rows[n] if n < len(leg.rows) else None
    end = [] if last is None else [value_of(last.b), value_of(last.d), value_of(last.r)]
    return leg.n == n and prismatic == [False] * (n - 1) + [True] and not any(offsets) and not any(end)
