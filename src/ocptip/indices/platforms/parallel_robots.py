"""Indices of any parallel robot in a pose: distances from singular poses, and how its motors act together."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError
from ocptip.indices.entry import IndexEntry
from ocptip.indices.meanings import PARALLEL, PLATFORM
from ocptip.indices.platforms.controllability import control_number
from ocptip.indices.platforms.from_parallel import planar_pose_of_robot, platform_of_robot
from ocptip.indices.platforms.rate import rate_platform
from ocptip.parallel.analysis.workspace import motor_volume
from ocptip.parallel.robot import ParallelRobot


def parallel_indices(robot: ParallelRobot, z: ArrayLike) -> dict[str, float]:
    """Values of the indices `PARALLEL` in a pose (m,), m and rad; and of CTN for planar RPR robots.

    Raises:
        InputError: the pose is out of reach, or wrong shapes.
    """
    z = robot.kinematics.coordinates("z", z)
    q = robot.ik(z).q
    found = robot.singularity(z, q)
    regular = found.platform if math.isfinite(found.platform) else 0.0
    values = {
        "dexterity": abs(motor_volume(robot, z, q)),
        "platform": regular,
        "legs": float(found.legs.min()),
    }
    with suppress(InputError):  # not planar, or other legs
        values["ctn"] = control_number(planar_pose_of_robot(robot.description, z)).value
    return values


def rate_parallel(robot: ParallelRobot, z: ArrayLike) -> tuple[list[IndexEntry], tuple[str, ...]]:
    """All indices of a pose (m,), those of Stewart-Gough platforms included where it is one.

    Returns:
        Entries, and what is singular, see `Singularity.kinds`.
    """
    z = robot.kinematics.coordinates("z", z)
    kinds = robot.singularity(z).mechanical
    status = "singular pose" if kinds else "ok"
    entries = [
        {**PARALLEL, **PLATFORM}[name].entry(name, value if np.isfinite(value) else 0.0, status)
        for name, value in parallel_indices(robot, z).items()
    ]
    try:
        platform = platform_of_robot(robot.description).platform
    except InputError:
        return entries, kinds
    return [*entries, *rate_platform(platform, *robot.kinematics.pose(z))], kinds
