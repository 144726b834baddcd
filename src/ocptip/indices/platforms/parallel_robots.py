"""Indices of any parallel robot in a pose: distances from singular poses, and how its motors act together."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, finite_array
from ocptip.indices.meanings import PARALLEL, PLATFORM, IndexEntry
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import control_number
from ocptip.indices.platforms.platform import PlanarPlatformPose, StewartPlatform
from ocptip.indices.platforms.reviewed import PlacedPlatform, rate_platform
from ocptip.parallel.analysis.workspace import motor_volume
from ocptip.parallel.description.platform import value_of
from ocptip.parallel.description.robot_description import PRISMATIC, RobotDescription, SerialLeg
from ocptip.parallel.robot import ParallelRobot

_SPATIAL, _PLANAR = (True,) * 6, (True, True, False, False, False, True)


def platform_of_robot(robot: RobotDescription) -> PlacedPlatform:
    """Anchors and home pose of a 6UPS (or nUPS) robot.

    Raises:
        InputError: the robot is none: other degrees of freedom, legs or motors.
    """
    base, moving = _anchors(robot, _SPATIAL, "UPS", 3)
    home = robot.home
    rotation = Rotation.from_euler(robot.platform.convention.upper(), home[3:]).as_matrix()
    return PlacedPlatform(StewartPlatform(base, moving, robot.name), home[:3].copy(), rotation, None)


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


def _straight(leg: SerialLeg, n: int) -> bool:
    """True if joint n is prismatic, the ones before turn, and all their axes meet in the leg's origin."""
    prismatic = [row.sigma == PRISMATIC for row in leg.rows[:n]]
    offsets = [value_of(v) for row in leg.rows[:n] for v in (row.b, row.d)]
    offsets += [value_of(row.r) for row in leg.rows[: n - 1]]
    last = leg.rows[n] if n < len(leg.rows) else None
    end = [] if last is None else [value_of(last.b), value_of(last.d), value_of(last.r)]
    return leg.n == n and prismatic == [False] * (n - 1) + [True] and not any(offsets) and not any(end)


class ParallelIndices:
    """The indices of a parallel robot in its poses.

    Args:
        robot: any.
        ellipsoid: operation ellipsoid in the platform frame, for 1/CDN_OE and 1/CDN_CL of hexapods.

    Attributes:
        names: of its indices: those of `PARALLEL`; for planar RPR robots and hexapods CTN; for hexapods also
            the others of `PLATFORM`.
        usual: the ones to evaluate along a motion or over a workspace.
    """

    def __init__(self, robot: ParallelRobot, ellipsoid: OperationEllipsoid | None = None) -> None:
        self.robot, self.ellipsoid = robot, ellipsoid
        self.platform, planar = None, False
        with suppress(InputError):  # no hexapod
            self.platform = platform_of_robot(robot.description).platform
        with suppress(InputError):  # not planar, or other legs
            planar = planar_pose_of_robot(robot.description) is not None
        tool = () if ellipsoid else ("inv_cdn_oe", "inv_cdn_cl")
        names = (
            [name for name in PLATFORM if name not in tool] if self.platform else ["ctn"] if planar else []
        )
        self.names = (*PARALLEL, *names)
        self.usual = (*PARALLEL, *names[: 2 if ellipsoid else 1])

    def values(self, z: ArrayLike, names: Iterable[str]) -> dict[str, float]:
        """Indices by name in a pose (m,), m and rad; 0 where it is singular.

        Raises:
            InputError: the pose is out of reach, or wrong shapes.
        """
        z, wanted = self.robot.kinematics.coordinates("z", z), list(names)
        table = {}
        if any(name in PARALLEL for name in wanted):
            table |= self._of_motors(z)
        known_names = [name for name in wanted if name not in PARALLEL]
        if known_names and self.platform:
            table |= self.rated(z).values(known_names)
        elif known_names:
            table["ctn"] = control_number(planar_pose_of_robot(self.robot.description, z)).value
        return {name: table[name] for name in wanted}

    def rated(self, z: np.ndarray) -> PlacedPlatform:
        """A hexapod as platform in a pose."""
        assert self.platform is not None
        return PlacedPlatform(self.platform, *self.robot.kinematics.pose(z), self.ellipsoid)

    def _of_motors(self, z: np.ndarray) -> dict[str, float]:
        q = self.robot.ik(z).q
        singularity = self.robot.singularity(z, q)
        volume = abs(motor_volume(self.robot, z, q))
        return {
            "dexterity": volume if math.isfinite(volume) else 0.0,
            "platform": singularity.platform if math.isfinite(singularity.platform) else 0.0,
            "conditioning": singularity.conditioning,
            "legs": float(singularity.legs.min()),
        }


def rate_parallel(robot: ParallelRobot, z: ArrayLike) -> tuple[list[IndexEntry], tuple[str, ...]]:
    """All indices of a pose (m,), those of Stewart-Gough platforms included where it is one.

    Returns:
        Entries, and what is singular, see `Singularity.kinds`.
    """
    z = robot.kinematics.coordinates("z", z)
    indices, kinds = ParallelIndices(robot), robot.singularity(z).mechanical
    status = "singular pose" if kinds else "ok"
    names = [name for name in indices.names if name in PARALLEL or not indices.platform]
    entries = [
        {**PARALLEL, **PLATFORM}[name].entry(name, value, status)
        for name, value in indices.values(z, names).items()
    ]
    if indices.platform:
        entries += rate_platform(indices.platform, *robot.kinematics.pose(z))
    return entries, kinds
