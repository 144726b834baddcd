"""The table `[robot]` of a task file, a parallel robot on its support; format: docs/motion-planner.md."""

from __future__ import annotations

from typing import Any

import numpy as np

from ocptip.basics.toml import Table
from ocptip.contact.support import Support
from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.robot import ParallelRobot
from ocptip.standing.platform import PlatformLimits, StandingParallelRobot
from ocptip.task_files.motors import dc_motors
from ocptip.task_files.parallel import read_parallel_robot
from ocptip.task_files.payload import load_table, read_payload, read_process
from ocptip.task_files.sensor import read_sensor


def read_platform_robot(
    data: Table, support: Support, moment: float | None, segment: Table | None = None
) -> StandingParallelRobot:
    """The robot of a file on its support.

    Args:
        data: the file.
        support: of its scene.
        moment: reference moment, N m, or None.
        segment: of a cycle.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    for key in ("arm", "obstacle"):
        if key in data:
            raise data.error("not together with [robot]; the box of its coordinates keeps it off others", key)
    table = data.table("robot")
    name, payload = table.text("parallel"), read_payload(load_table(data, segment))
    mount = {"position": table.vector("mount_position", 3), "rotation": table.rotation("mount_", np.eye(3))}
    process = read_process(data, segment)
    if process is not None and process.turns_with_tool:
        raise data.error('of a parallel robot has axes = "base" or "world"', "process.axes")
    load = None if process is None else process.seen_from(mount["rotation"].T).wrench
    table.close("limits")
    with table.at("parallel"):
        robot = ParallelRobot(_description(table, name).with_payload(payload))
    sensor, motors = read_sensor(data, mount["position"]), data.table("motors")
    motors.choice("kind", ("dc",))
    parts = robot, support, dc_motors(motors, robot.m), _limits(table.table("limits"), robot.m)
    with table.at(), table.table("limits").at(None):
        return StandingParallelRobot(*parts, **mount, load=load, reference_moment=moment, sensor=sensor)


def _description(table: Table, name: str) -> RobotDescription:
    return READY_MADE[name]() if name in READY_MADE else read_parallel_robot(table.path_of("parallel"))


def _limits(table: Table, m: int) -> PlatformLimits:
    limits: dict[str, Any] = {key: table.per_joint(key, m) for key in ("lower", "upper")}
    for key in ("speed", "acceleration", "motor_force"):
        limits[key] = table.per_joint(key, m, bound="> 0")
    limits["motor_speed"] = table.per_joint("motor_speed", m, np.inf, bound="> 0")
    return table.make(PlatformLimits, **limits, **table.numbers("singularity"))
