"""Where a task comes from: its file, and the files that it names, so that a plan's folder can hold them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any

from ocptip.basics.toml import toml_text
from ocptip.motion.objective import Objective
from ocptip.motion.stops.rules import kinds_of
from ocptip.robots.kinematics import TCP
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism

TASK = "task/task.toml"
"""The task file within a plan's folder; beside it what it names."""

_RATES = (("cancel_deceleration_deg_s2", "rad", 180 / math.pi), ("cancel_deceleration_m_s2", "m", 1.0))
"""Keys of decelerations, units of the joints, and factors from SI."""


@dataclass(frozen=True, eq=False)
class TaskSource:
    """The content of a task file, as it was when the task was read.

    Attributes:
        data: the file's content; files are named as in `files`.
        robot: the one that it describes: a task with another one has no source.
        files: what it names, URDF, meshes and others: content by name, relative to the task file, with "/".
    """

    data: Mapping[str, Any]
    robot: StandingMechanism
    files: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def places(self) -> list[str]:
        """Names of `files` within a plan's folder."""
        return [self.place(name) for name in self.files]

    @staticmethod
    def place(name: str) -> str:
        """The name of one file within a plan's folder."""
        return (PurePosixPath(TASK).parent / name).as_posix()

    def text(
        self,
        name: str,
        limits: Limits,
        objective: Objective,
        rise_times: tuple[float, ...] | None = None,
    ) -> str:
        """A task file with this name, these limits, objective and rise times, which replace those of the
        file.
        """
        data: dict[str, Any] = {} if "case" in self.data else {"name": name}
        data |= {key: dict(v) if isinstance(v, Mapping) else v for key, v in self.data.items()}
        asked = data.setdefault("limits", {})
        asked.update(limits.in_files)
        for key in ("rise_time", "jerk"):
            asked.pop(key, None)
        if "case" not in self.data:
            asked["angle_margin_deg"] = math.degrees(limits.angle_margin)
        if limits.jerk:
            asked["jerk"] = list(limits.jerk)
        if rise_times is not None:
            asked["rise_time"] = list(rise_times) or 0.0
        data["tolerance"] = tolerance_table(limits, self.robot)
        if limits.stoppable:
            data["stops"] = {**data.get("stops", {}), **stop_keys(limits, self.robot)}
        motion = data.setdefault("motion", {})
        for key in ("duration", "max_duration", "objective", "price_per_second"):
            motion.pop(key, None)
        if math.isfinite(limits.max_duration):
            exact = limits.min_duration == limits.max_duration
            motion["duration" if exact else "max_duration"] = limits.max_duration
        motion["objective"] = objective.name
        if objective.name == "both":
            motion["price_per_second"] = objective.time_weight
        return toml_text(data)


def speed_table(speeds: Mapping[str, float]) -> dict[str, Any]:
    """Keys of `[limits]` for speeds of points, m/s, by their names, see `Robot`."""
    points = {name: speed for name, speed in speeds.items() if name != TCP}
    tcp = {"tcp_speed": speeds[TCP]} if TCP in speeds else {}
    return {**tcp, **({"point_speed": points} if points else {})}


def tolerance_table(limits: Limits, robot: StandingMechanism) -> dict[str, Any]:
    """The table `[tolerance]`; that of a parallel robot holds the damping with which acceleration steps
    count.
    """
    if robot.arm is None and limits.damping < 1:
        return {"damping": limits.damping}
    return limits.tolerance.to_table() or {"preset": "none"}


def source_of(task: Any) -> TaskSource | None:
    """Where a task was read from; None if it was made in Python, or has another robot by now."""
    source = task.source
    return source if source is not None and source.robot is task.robot else None


def stop_keys(limits: Limits, robot: StandingMechanism) -> dict[str, Any]:
    """Keys of `[stops]` with which the task asks for them."""
    path, brakes, cancel = limits.stops, limits.brakes, limits.cancel
    given = {"path": path, "brakes": brakes, "cancel": cancel}
    asked: dict[str, Any] = {
        "safe": kinds_of(name for name, asked_for in given.items() if asked_for is not None)
    }
    if brakes is not None:
        asked |= {"GN": brakes.GN, "GT": brakes.GT}
        asked |= {"brake_torque_min_Nm": list(brakes.least), "brake_torque_max_Nm": list(brakes.greatest)}
        asked |= {"brake_delay": list(brakes.delay)}
    if cancel is not None:
        asked |= {"GN": cancel.GN, "GT": cancel.GT, "cancel_share": 1.0}
        if cancel.together:
            asked["cancel_stopj"] = cancel.decelerations[0]
        for key, unit, scale in () if cancel.together else _RATES:
            pairs = zip(robot.units, cancel.decelerations, strict=True)
            if asked_for := [scale * rate for of, rate in pairs if of == unit]:
                asked[key] = asked_for
        asked |= {"cancel_reaction": cancel.reaction, "cancel_longest": cancel.longest}
    if path is not None:
        asked |= {"GN": path.GN, "GT": path.GT, "time": path.time}
    return asked
