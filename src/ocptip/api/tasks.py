"""`ocptip.load_task`: the task of a published case or of a file, with what is to be different in it."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from ocptip.basics.errors import InputError, positive_number
from ocptip.motion.cycles.task import Task
from ocptip.motion.files.source import source_of
from ocptip.motion.objective import objective_of
from ocptip.motion.task import MotionTask
from ocptip.published.cases import case_names
from ocptip.published.tasks import experiment_task
from ocptip.robots.kinematics import TCP
from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import DEFAULT, Uncertainty
from ocptip.task_files.cycle import read_task
from ocptip.task_files.plan_folder import is_plan_folder
from ocptip.task_files.tables.tolerance import load_tolerance

Base = Literal["printed", "effective"]
"""Data of the base of a case."""
TaskLike = Task | str | os.PathLike[str]
"""A task, the name of a case, or the path of a task file."""


def load_task(
    source: TaskLike,
    *,
    base: Base | None = None,
    uncertainty: Uncertainty | str | None = None,
    objective: Literal["energy", "time", "both"] | None = None,
    price_per_second: float | None = None,
    duration: float | None = None,
    max_duration: float | None = None,
    tcp_speed: float | None = None,
    **limits: float | None,
) -> Task:
    """Return the task of a case or of a file, a motion or a cycle.

    Example::

        task = ocptip.load_task("A", uncertainty="none", objective="time", GN=0.8)

    Args:
        source: "A" to "H", the path of a task file (docs/motion-planner.md), or a task, which is changed.
        base: of a case; default "effective".
        uncertainty: the worst case that limits hold in; a preset ("workshop", "none"), a TOML file with a
            table `[tolerance]`, or the object. Default: that of the file, else "workshop".
        objective, price_per_second: what is minimised; "both" is energy plus the cost of time, J/s.
        duration, max_duration: s, of a motion; the segments of a cycle have theirs in the file.
        tcp_speed: maximum speed of the TCP of an arm, m/s.
        limits: GN, GT, torque_ratio, clearance (m), foot_lift (m): instead of those of the file; of a cycle
            they are those of all segments.

    Raises:
        InputError: there is no such case or file, or a value cannot be used; names file, key and value.
    """
    task = _read(source, base)
    if duration is not None or max_duration is not None:
        limits |= _durations(task, duration, max_duration)
    given: dict[str, Any] = {name: value for name, value in limits.items() if value is not None}
    if uncertainty is not None:
        given["tolerance"] = load_tolerance(uncertainty)
    changes: dict[str, Any] = {}
    if objective is not None or price_per_second is not None:
        changes["objective"] = objective_of(objective, price_per_second)

    def changed(motion_task: MotionTask) -> MotionTask:
        if tcp_speed is not None:
            motion_task = _with_tcp_speed(motion_task, tcp_speed)
        return replace(motion_task, limits=replace(motion_task.limits, **given), **changes)

    return task.each(changed) if given or changes or tcp_speed is not None else task


def _with_tcp_speed(task: MotionTask, speed: float) -> MotionTask:
    """The task of an arm with this speed limit of its TCP, m/s, and so its file."""
    positive_number("tcp_speed", speed)
    robot = Robot.of(task.robot, "tcp_speed: is for arms")
    robot = robot.varied(speed_limits={**robot.speed_limits, TCP: speed})
    if (source := source_of(task)) is not None:
        limits = {**source.data.get("limits", {}), "tcp_speed": speed}
        source = replace(source, robot=robot, data={**source.data, "limits": limits})
    return replace(task, robot=robot, source=source)


def _read(source: TaskLike, base: Base | None) -> Task:
    if not isinstance(source, str | os.PathLike):
        if base is not None:
            raise InputError("base: belongs to the cases A to H, got a task")
        return source
    if source in case_names():
        task = experiment_task(str(source), base or "effective")
        return replace(task, limits=replace(task.limits, tolerance=DEFAULT))
    if is_plan_folder(source):
        raise InputError(
            f"is the folder of a plan; 'ocptip check {source}' checks its motion", "", str(source)
        )
    if Path(source).suffix.lower() != ".toml":
        raise InputError(f"{source}: neither a case (A to H) nor a task file (.toml)")
    if base is not None:
        raise InputError(f"base: belongs to the cases A to H, got {source}")
    return read_task(source, DEFAULT)


def _durations(task: Task, exact: float | None, most: float | None) -> dict[str, float]:
    """Limits of the duration of a motion, s."""
    if task.is_cycle:
        name = "duration" if exact is not None else "max_duration"
        raise InputError(f"{name}: of a cycle belongs to its [[segment]]s, as a key of this name")
    if exact is not None and most is not None:
        raise InputError("duration: give either duration or max_duration")
    if exact is not None:
        seconds = positive_number("duration", exact)
        return {"min_duration": seconds, "max_duration": seconds}
    return {"min_duration": 0.0, "max_duration": positive_number("max_duration", most)}
