"""Cycles from TOML files: several motions, `[[segment]]`, in one file. Format: docs/how-to/cycles.md."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ocptip.basics import schema
from ocptip.basics.errors import InputError, doubt
from ocptip.basics.read import read_text
from ocptip.basics.schema import Key, Keys
from ocptip.basics.toml import MARK, Table
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.task import MotionTask, Segment
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.standing.limits import LIMIT_KEYS, Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.task_files.doubts import doubt_masses, doubt_units, require_kind
from ocptip.task_files.motion import (
    AIM,
    COURSE,
    DURATION,
    JERK,
    STOPS,
    TASK,
    coordinates,
    jerk_limited,
    load_task,
    motion_keys,
    ramp_task,
    with_stops,
)
from ocptip.task_files.source import task_source
from ocptip.task_files.tables.joints import LOCKED, LOCKED_KEYS, end_keys, read_end
from ocptip.task_files.tables.payload import OF_SEGMENT
from ocptip.task_files.task_scene import COMMON_LIMITS, TaskScene, limit_numbers, task_keys

_SHARED = (*COURSE, *AIM)  # of [motion], unless a segment has its own
_GOALS = ("goal_deg", "goal_m", "goal_pose")
_BACK = "start"
_LOADS = ("payload", "process")

_GOAL = schema.vector(
    "`start`: the cycle is closed; parallel robots: coordinates, m and rad.",
    otherwise="the other keys of the goal",
)

_STATE = schema.text(
    "`start`: the cycle is closed; or a state of the SRDF.", otherwise="the other keys of the goal"
)

_SEGMENT_LIMITS = Keys("limits of a segment", "Limits of a segment.", LIMIT_KEYS)


def _segment_keys(name: str, goal: Mapping[str, Key]) -> Keys:
    return Keys(
        name,
        "A motion of a cycle.",
        {
            "name": schema.text("Title.", otherwise="its number"),
            "goal": replace(
                _GOAL, words="`start`, or list of numbers", schema={"anyOf": [{"const": _BACK}, _GOAL.schema]}
            ),
            **goal,
            **OF_SEGMENT,
            "dwell": schema.number("Standstill at the goal.", "s", bound=">= 0", default=0.0),
            "limits": schema.table(_SEGMENT_LIMITS, default=None),
            **COURSE,
            **AIM,
            **DURATION,
        },
        at_most_one=[tuple(DURATION)],
    )


_OF_ROBOTS = {
    "arm": {
        "motion": schema.table(motion_keys("start of an arm", end_keys("start", "start"), cycle=True)),
        "segment": schema.tables(
            _segment_keys("segment", {**end_keys("goal", "goal"), "goal": _STATE, **LOCKED_KEYS}),
            required=True,
        ),
    },
    "robot": {
        "motion": schema.table(motion_keys("start of a platform", coordinates("start"), cycle=True)),
        "segment": schema.tables(_segment_keys("segment of a platform", {}), required=True),
    },
}


def cycle_keys(name: str, meaning: str, common: Mapping[str, Key], *robots: str) -> Keys:
    """Keys of a file with [[segment]]: the same as `task_keys`, for these kinds of robots."""
    return task_keys(name, meaning, common, {robot: _OF_ROBOTS[robot] for robot in robots})


CYCLE = cycle_keys(
    "cycle",
    "Several motions of a robot on its base: `ocptip plan`.",
    {
        "limits": schema.table(
            Keys("limits of a cycle", "Limits of all segments.", {**COMMON_LIMITS, **JERK}), default=None
        ),
        "stops": schema.table(STOPS, default=None),
    },
    "arm",
    "robot",
)

Ends = Callable[[StandingMechanism, Table, str, Limits], tuple[np.ndarray, PoseTarget | None]]
"""Reads a start or a goal, as `read_end` does."""


def read_task(path: str | os.PathLike[str], otherwise: Uncertainty = NONE) -> MotionTask | CycleTask:
    """Read a task file: one motion, or a cycle where it has `[[segment]]`.

    Args:
        path: of the file.
        otherwise: the tolerance of an arm if the file has none.

    Raises:
        InputError: see `ocptip.task_files.motion.load_task`.
    """
    path = Path(path)
    try:
        return (load_cycle if "segment" in Table.read(path, TASK) else load_task)(path, otherwise)
    except InputError as error:
        if "missing" not in error.text or f"\n{MARK}" not in read_text(path):
            raise
        text = f"{error.text}; lines that begin with {MARK} are not read until the mark is taken away"
        raise InputError(text, error.path, error.file) from None


def load_cycle(path: str | os.PathLike[str], otherwise: Uncertainty = NONE) -> CycleTask:
    """Read a task file with `[[segment]]`.

    Args:
        path: of the file.
        otherwise: the tolerance of an arm if the file has none.

    Raises:
        InputError: the file cannot be read or describes no cycle; one line that names file and key.

    Warns: InputWarning: suspicious values.
    """
    path = Path(path)
    with Table.read(path, CYCLE) as data:
        require_kind(data, "plan")
        doubt_units(data)
        data.close(early=True)
        task = read_cycle(data, path.stem, otherwise=otherwise).each(
            lambda one_task: with_stops(data, one_task)
        )
        task = replace(task, source=task_source(data, task.robot))
        for segment in task.segments:
            doubt_masses(data, segment.task.robot)
        for message in _doubts(task):
            doubt(f"{data.file}: {message}")
        return task


class _SegmentTable(Table):
    """A segment's table, with those keys of `[motion]` that all segments share."""

    def __init__(self, table: Table, motion: Table) -> None:
        table.close(early=True)
        given = table.content
        self._motion = motion
        self._shared = {key: motion.value(key) for key in _SHARED if key in motion and key not in given}
        if "objective" in given or "price_per_second" in given:
            self._shared = {k: v for k, v in self._shared.items() if k in ("optimised", "commands")}
        super().__init__({**self._shared, **given}, table.file, table._keys, table.path, table._folder)
        self._uses = table._uses

    def place(self, key: str) -> str:
        """Path of a key within the file."""
        return self._motion.place(key) if key in self._shared else super().place(key)


def read_cycle(data: Table, default: str, ends: Ends = read_end, otherwise: Uncertainty = NONE) -> CycleTask:
    """The cycle of a file, without its source.

    Args:
        data: the file.
        default: name.
        ends: what reads starts and goals.
        otherwise: the tolerance of an arm if the file has none.
    """
    scene, name, motion = TaskScene(data, otherwise), data.get("name", default), data.table("motion")
    for key in ("goal", *_GOALS, *DURATION):
        if key in motion:
            raise motion.error("of a cycle belongs to its [[segment]]s", key)
    tables = [_SegmentTable(segment, motion) for segment in data.tables("segment")]
    robots: dict[str, StandingMechanism] = {}
    held: list[str] = []
    for table in tables:
        held.append(repr([table.content.get(key) for key in (*_LOADS, *LOCKED)]))
        if held[-1] not in robots:
            robots[held[-1]] = scene.robot(table)
    for key in _LOADS:
        _require_use(data, tables, key)
    limits = jerk_limited(data.table("limits"), scene.limits, robots[held[0]].n)
    starts, pose = ends(robots[held[0]], motion, "start", limits)
    motion.close(early=True)
    segments: list[Segment] = []
    for number, (table, segment) in enumerate(zip(tables, held, strict=True), 1):
        before = segments[-1].goals[0] if segments else starts[0]
        last = number == len(tables)
        segments.append(_segment(table, number, robots[segment], limits, before, (starts, pose), last, ends))
    closed = tables[-1].value("goal") == _BACK
    return CycleTask(name, tuple(segments), starts, closed, target=pose)


def _segment(
    table: Table,
    number: int,
    robot: StandingMechanism,
    limits: Limits,
    before: np.ndarray,
    start: tuple[np.ndarray, PoseTarget | None],
    last: bool,
    ends: Ends,
) -> Segment:
    """One segment; `before` is a posture that it may start in, `start` what the first one may."""
    name, dwell = table.get("name", f"{number}"), table["dwell"]
    limits_table = table.table("limits")
    numbers = limit_numbers(limits_table)
    limits_table.close()
    with limits_table.at():
        limits = replace(limits, **numbers)
    if table.value("goal") == _BACK:
        goals, pose = start
        if not last:
            raise table.error(f"the last segment may have {_BACK!r}, got {_BACK!r}", "goal")
        for key in (key for key in _GOALS if key in table):
            raise table.error(f"not together with goal = {_BACK!r}", key)
    else:
        goals, pose = ends(robot, table, "goal", limits)
    task = ramp_task(name, robot, before, goals[0], limits, table)
    return Segment(name, task, goals, dwell, pose)


def _require_use(data: Table, tables: list[_SegmentTable], key: str) -> None:
    """Refuse loads that no segment has."""
    values, used = data.value(key, {}), [table.value(key) for table in tables]
    named = isinstance(values, dict) and values and all(isinstance(value, dict) for value in values.values())
    for name in values if named and list(values) != ["shape"] else ():
        if name not in used:
            raise data.error("no segment carries it", f"{key}.{name}")


def _doubts(task: CycleTask) -> Iterator[str]:
    """Suspicious values of segments."""
    for number, (one, other) in enumerate(zip(task.segments[:-1], task.segments[1:], strict=True), 1):
        if one.task.robot is not other.task.robot and one.dwell == 0:
            yield f"segment[{number}]: the load of the gripper changes after it, in no time; give a dwell"
    for number, segment in enumerate(task.segments, 1):
        apart = len(segment.goals) > 1 or np.abs(segment.task.start - segment.task.goal).max() > 1e-9
        if not apart and not (number == len(task.segments) and task.closed and len(task.starts) > 1):
            yield f"segment[{number}]: starts where it ends, there is nothing to plan"
