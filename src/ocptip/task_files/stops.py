"""The table `[stops]`; format: docs/stops.md."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, cast, get_args

import numpy as np

from ocptip.basics.toml import Table
from ocptip.motion.stop_rules import Kinds, StopRules
from ocptip.motion.task import MotionTask


def _safe(table: Table) -> Kinds | Literal[""] | None:
    """Stops that plans have to keep: of which kinds, "" where that is left open; None: of none."""
    if "safe" not in table or isinstance(table.value("safe"), bool):
        return "" if table.flag("safe", False) else None
    return cast(Kinds, table.choice("safe", get_args(Kinds)))


def with_stops(data: Table, task: MotionTask) -> MotionTask:
    """The task with the file's rules of stops; where they say `safe`, stops along the path are its limits.

    Raises:
        InputError: a value is unknown or cannot be used; names its place.
    """
    if "stops" not in data:
        return task
    table = data.table("stops")
    n = task.robot.n
    ends = [table.per_joint(f"brake_torque_{end}_Nm", n, None, bound="> 0") for end in ("min", "max")]
    delay = tuple(table.vector("brake_delay", 2, np.zeros(2)).tolist())
    rules = table.numbers("GN", "GT", "time")
    safe = _safe(table)
    table.close()
    names = {"brake_min": "brake_torque_min_Nm", "brake_max": "brake_torque_max_Nm", "delay": "brake_delay"}
    with table.at(**names):
        found = StopRules(**rules, brake_min=ends[0], brake_max=ends[1], delay=delay)
        if any(end is not None for end in ends):
            found.brakes(task.robot)
        limits = found.safe(task.limits, task.robot, safe or None) if safe is not None else task.limits
    return replace(task, stops=found, limits=limits)
