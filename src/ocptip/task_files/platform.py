"""The tables `[robot]` and `[motors]` of a task file: a parallel robot on its support; see `task_file`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError, positive_number
from ocptip.basics.toml import (
    number_at,
    per_joint_at,
    refuse_unknown,
    required,
    rpy_at,
    subtable,
    text_at,
    vector_at,
    with_place,
)
from ocptip.contact.support import Support
from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.description.robot_description import BodyInertia, RobotDescription
from ocptip.parallel.robot import ParallelRobot
from ocptip.standing.platform import PlatformLimits, StandingParallelRobot
from ocptip.task_files.motors import MOTOR_KEYS, dc_motors
from ocptip.task_files.parallel import read_parallel_robot

_ROBOT_KEYS = ("parallel", "payload", "mount_position", "mount_rpy_deg", "limits")
_PLATFORM_LIMITS = ("lower", "upper", "speed", "acceleration", "motor_force", "motor_speed", "singularity")


def parallel_robot(
    data: dict[str, Any], support: Support, moment: float | None, folder: Path
) -> StandingParallelRobot:
    """The robot of the file `data` on its support.

    Args:
        data: the file's tables.
        support: of its scene.
        moment: reference moment, N m, or None.
        folder: of the file.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    if "arm" in data or "obstacle" in data:
        which = "arm" if "arm" in data else "obstacle"
        raise InputError(
            f"{which}: not together with [robot]; the box of its coordinates keeps it off others"
        )
    table = subtable(data, "robot")
    refuse_unknown(table, _ROBOT_KEYS, "robot.")
    robot = with_place("robot.parallel", ParallelRobot, _description(table, folder))
    motors = subtable(data, "motors")
    if motors.get("kind") != "dc":
        raise InputError(
            f"motors.kind: a parallel robot needs 'dc' with motor data, got {motors.get('kind')!r}"
        )
    refuse_unknown(motors, MOTOR_KEYS["dc"], "motors.", also=("kind",))
    return with_place(
        "robot",
        StandingParallelRobot,
        robot,
        support,
        dc_motors(motors, robot.m),
        _platform_limits(table, robot.m),
        position=vector_at("robot.mount_position", required(table, "mount_position", "robot"), 3),
        rotation=rpy_at("robot.mount_rpy_deg", table.get("mount_rpy_deg", [0, 0, 0])),
        reference_moment=moment,
    )


def _description(table: dict[str, Any], folder: Path) -> RobotDescription:
    name = text_at("robot.parallel", required(table, "parallel", "robot"))
    if name in READY_MADE:
        description = READY_MADE[name]()
    else:
        description = with_place("robot.parallel", read_parallel_robot, folder / name)
    payload = positive_number(
        "robot.payload", number_at("robot.payload", table.get("payload", 0.0)), zero_allowed=True
    )
    if payload:
        body = description.platform.inertia
        loaded = BodyInertia(body.mass + payload, body.first_moment, body.inertia)
        description = replace(description, platform=replace(description.platform, inertia=loaded))
    return description


def _platform_limits(table: dict[str, Any], m: int) -> PlatformLimits:
    values = subtable(table, "limits", prefix="robot.")
    refuse_unknown(values, _PLATFORM_LIMITS, "robot.limits.")
    for key in _PLATFORM_LIMITS[:5]:
        required(values, key, "robot.limits")
    limits = {}
    for key, value in values.items():
        where = f"robot.limits.{key}"
        signed = key in ("lower", "upper")
        limits[key] = (
            number_at(where, value) if key == "singularity" else per_joint_at(where, value, m, signed=signed)
        )
    return PlatformLimits(**limits)
