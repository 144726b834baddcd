"""The table `[stops]`; format: docs/stops.md."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, cast, get_args

from ocptip.basics import schema
from ocptip.basics.schema import Keys
from ocptip.basics.toml import Table
from ocptip.motion.stop_rules import Kinds, StopRules
from ocptip.motion.task import MotionTask

_KIND = schema.choice("Stops.", get_args(Kinds))
_TORQUE = "torque of each brake; sliding joints: N."
STOPS = Keys(
    "stops",
    "How the robot is stopped.",
    {
        "safe": schema.anything(
            "Stops that plans and checks keep; true: along the path, with torques also by brakes.",
            "`path`, `brakes`, `both`, or true",
            {"enum": [True, False, *get_args(Kinds)]},
            default=False,
        ),
        "GN": schema.number("Largest tip-over index during stops.", otherwise="of [limits]"),
        "GT": schema.number("Largest slip index during stops.", otherwise="of [limits]"),
        "time": schema.number(
            "Shortest time of a stop along the path.", "s", otherwise="what the drives can"
        ),
        "brake_torque_min_Nm": schema.per_joint(
            f"Minimum {_TORQUE}", "N m", bound="> 0", otherwise="no brakes"
        ),
        "brake_torque_max_Nm": schema.per_joint(
            f"Maximum {_TORQUE}", "N m", bound="> 0", otherwise="no brakes"
        ),
        "brake_delay": schema.vector("Minimum and maximum delay of the brakes.", "s", 2, default=[0, 0]),
    },
)


def _safe(table: Table) -> Kinds | Literal[""] | None:
    """Stops that plans have to keep: of which kinds, "" where that is left open; None: of none."""
    value = table.value("safe", False)
    if isinstance(value, bool):
        return "" if value else None
    with table.at("safe"):
        return cast(Kinds, _KIND.convert(value, None))


def with_stops(data: Table, task: MotionTask) -> MotionTask:
    """The task with the file's rules of stops; where they say `safe`, stops along the path are its limits.

    Raises:
        InputError: a value is unknown or cannot be used; names its place.
    """
    if "stops" not in data:
        return task
    table = data.table("stops")
    n = task.robot.n
    ends = [table.get(f"brake_torque_{end}_Nm", size=n) for end in ("min", "max")]
    delay = tuple(table["brake_delay"].tolist())
    rules = table.given("GN", "GT", "time")
    safe = _safe(table)
    table.close()
    names = {"brake_min": "brake_torque_min_Nm", "brake_max": "brake_torque_max_Nm", "delay": "brake_delay"}
    with table.at(**names):
        found = StopRules(**rules, brake_min=ends[0], brake_max=ends[1], delay=delay)
        if any(end is not None for end in ends):
            found.brakes(task.robot)
        limits = found.safe(task.limits, task.robot, safe or None) if safe is not None else task.limits
    return replace(task, stops=found, limits=limits)
