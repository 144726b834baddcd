"""The table `[robot]` of a task file, a parallel robot on its support; format: docs/motion-planner.md."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ocptip.basics import schema
from ocptip.basics.schema import Keys
from ocptip.basics.toml import Table
from ocptip.contact.support import Support
from ocptip.task_files.arm import MOUNT
from ocptip.task_files.motors import dc_motors
from ocptip.task_files.payload import load_table, read_payload, read_process, read_sensor

if TYPE_CHECKING:
    from ocptip.standing.platform import StandingParallelRobot


def _limit(meaning: str, unit: str = "m, rad", bound: str = "", otherwise: str = "") -> schema.Key:
    return schema.per_joint(meaning, unit, bound=bound, otherwise=otherwise)


_LIMITS = Keys(
    "limits of a parallel robot",
    "Limits of the coordinates of the platform and of the motors.",
    {
        "lower": _limit("Lower limit of the coordinates."),
        "upper": _limit("Upper limit of the coordinates."),
        "speed": _limit("Speed limit of the coordinates.", "m/s, rad/s", "> 0"),
        "acceleration": _limit("Acceleration limit of the coordinates.", "m/s^2, rad/s^2", "> 0"),
        "motor_force": _limit("Limit of the forces or torques of the motors.", "N, N m", "> 0"),
        "motor_speed": _limit("Speed limit of the motors.", "m/s, rad/s", "> 0", "none"),
        "singularity": schema.number(
            "Minimum distance from singular poses, 0 to 1.", otherwise="the usual one"
        ),
    },
)
PLATFORM_ROBOT = Keys(
    "robot",
    "A parallel robot, instead of an arm.",
    {
        "parallel": schema.text("A ready-made robot such as `Delta`, or a robot file, relative to this one."),
        **MOUNT,
        "limits": schema.table(_LIMITS),
    },
)


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
    from ocptip.parallel.description.ready_made import READY_MADE  # these load for 0.1 s
    from ocptip.parallel.robot import ParallelRobot
    from ocptip.standing.platform import PlatformLimits, StandingParallelRobot
    from ocptip.task_files.parallel import read_parallel_robot

    table = data.table("robot")
    name, payload = table["parallel"], read_payload(load_table(data, segment))
    mount = {"position": table["mount_position"], "rotation": table.rotation("mount_", np.eye(3))}
    process = read_process(data, segment)
    if process is not None and process.turns_with_tool:
        raise data.error('of a parallel robot has axes = "base" or "world"', "process.axes")
    load = None if process is None else process.seen_from(mount["rotation"].T).wrench
    table.close(early=True)
    with table.at("parallel"):
        made = READY_MADE[name]() if name in READY_MADE else read_parallel_robot(table.named_file("parallel"))
        robot = ParallelRobot(made.with_payload(payload))
    sensor, motors = read_sensor(data, mount["position"]), data.table("motors")
    _ = motors["kind"]  # complains where it is missing
    drives, given = dc_motors(motors, robot.m), table.table("limits")
    bounds = {key: given.get(key, size=robot.m) for key in _LIMITS.keys if key != "singularity"}
    bounds["motor_speed"] = given.get("motor_speed", np.inf, size=robot.m)
    limits = given.make(PlatformLimits, **bounds, **given.given("singularity"))
    with table.at(), given.at(None):
        return StandingParallelRobot(
            robot, support, drives, limits, **mount, load=load, reference_moment=moment, sensor=sensor
        )
