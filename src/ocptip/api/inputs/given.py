"""Given motions, in the folder of a plan, in other files or as objects, and their tasks."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from ocptip.api.inputs.postures import resting_posture
from ocptip.api.tasks import Base, TaskLike, load_task
from ocptip.basics.errors import InputError, positive_number
from ocptip.basics.read import only_inside, require_readable
from ocptip.motion.cycles.task import Task
from ocptip.motion.files.output import PLAN, TRAJECTORY
from ocptip.motion.files.source import TaskSource, source_of
from ocptip.motion.task import MotionTask
from ocptip.published.cases import case_names
from ocptip.published.tasks import experiment_task
from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import DEFAULT
from ocptip.task_files.cycle import read_task
from ocptip.task_files.plan_folder import is_plan_folder, planned_rate, read_plan_folder
from ocptip.trajectories.bags import is_bag
from ocptip.trajectories.drive_profile import DriveProfile, load_drive_profile
from ocptip.trajectories.read import load_motion, motion_origin
from ocptip.trajectories.trajectory import Trajectory

_DRIVE = "drive.csv"  # of a profile that is no part of the task
NO_MOTION = (
    "is a task or a path, no motion; 'ocptip stand {0} --posture start' checks a task at rest, "
    "'ocptip retime {0}' times a path"
)

ProfileLike = DriveProfile | str | os.PathLike[str]
"""How a base drives: what `load_drive_profile` gives or takes."""

MotionLike = Trajectory | str | os.PathLike[str]
"""A motion, that of a cycle, the path of a file that holds one, or the folder of a plan."""


def task_of_motion(
    motion: str | os.PathLike[str], task: TaskLike | None, base: Base | None
) -> tuple[Task, Path]:
    """The task and the motion's file.

    The task that is named, or that of the plan's folder, or the case that the file names, with its base.
    Cases, and task files that state no uncertainty, have the default one.

    Args:
        motion: the file, or the folder of a plan.
        task: a task, a case or a task file; None: that of the motion.
        base: of a case.
    """
    path = Path(motion)
    if path.is_dir() and not is_bag(path):
        with only_inside(path):
            require_readable(path / PLAN)
        folder, path = path, path / PLAN
    else:
        folder = path.parent
    case = task if isinstance(task, str) and not Path(task).suffix else None
    if task is not None and case is None:
        if base is not None:
            raise InputError("base: only for --case; a task file already names its base")
        return read_task(task, DEFAULT) if isinstance(task, str | os.PathLike) else task, path
    asked = case is not None or base is not None
    if not asked and (folder == Path(motion) or is_plan_folder(folder)):
        return read_plan_folder(folder).task, path
    origin = motion_origin(path) if _is_file(motion) else {}  # the name of a posture has none
    named = origin.get("case")
    if case is None and named is None:
        raise InputError(f"{motion}: names no case; say which robot by --case A..H or --task TASK.toml")
    if case is None and named not in case_names():
        raise InputError(
            f"{motion}: is for {named!r}, which is no printed case ({', '.join(case_names())}); "
            "say which robot by --task TASK.toml or --case A..H"
        )
    case = f"{case or named}"
    motion_task = experiment_task(
        case, base or (origin.get("base") if case == named else None) or "effective"
    )
    return replace(motion_task, limits=replace(motion_task.limits, tolerance=DEFAULT)), path


def _is_file(motion: object) -> bool:
    """Whether a file is meant, which need not exist."""
    return isinstance(motion, os.PathLike) or (
        isinstance(motion, str) and (bool(Path(motion).suffix) or Path(motion).exists())
    )


def driving(task: Task, profile: ProfileLike | None) -> Task:
    """The task of an arm on a base that drives so; None: as it is."""
    if profile is None:
        return task
    profile = profile if isinstance(profile, DriveProfile) else load_drive_profile(profile)
    if task.is_cycle:
        text = "not for motions of cycles, whose segments would each begin with it; of a posture: ocptip "
        raise InputError(f"drive_profile: {text}check NAME --task TASK.toml, NAME being that of a segment")
    return task.each(partial(driven, profile=profile))


def driven(task: MotionTask, profile: DriveProfile) -> MotionTask:
    """The task with this profile, which its source holds as a file."""
    robot = Robot.of(task.robot, "drive_profile: only for arms, this robot is a parallel one").driving(
        profile
    )
    source = source_of(task)
    if source is not None and "case" not in source.data:
        motion = {**source.data["motion"], "drive_profile": _DRIVE}
        files = {**source.files, _DRIVE: profile.to_csv().encode()}
        source = TaskSource({**source.data, "motion": motion}, robot, files)
    return replace(task, robot=robot, source=source)


def given_motion(
    motion: MotionLike | ArrayLike,
    task: TaskLike | None,
    *,
    base: Base | None = None,
    drive_profile: ProfileLike | None = None,
    rise_time: float | None = None,
    unit: str | None = None,
    rate: float | None = None,
    columns: Mapping[str, str | int] | None = None,
    topic: str | None = None,
) -> tuple[str, Task, Trajectory]:
    """Name of what is given, the task, and the motion; see :func:`ocptip.check`.

    Profile commands have the given rise time, else that of the file, else that of the task. The trajectory in
    the folder of a plan is for the controller that the plan names.
    """
    if drive_profile is not None and not isinstance(drive_profile, DriveProfile):
        drive_profile = load_drive_profile(drive_profile)
    if not isinstance(motion, Trajectory) and task is not None and not _is_file(motion):
        driven = load_task(task, base=base)
        if driven.is_cycle and drive_profile is not None:  # a posture is held in one of its segments
            name = resting_posture(driven, cast("ArrayLike | str", motion)).name
            parts = {segment.name: segment.task for segment in driven.segments}
            motion = "goal" if name in parts else motion
            driven = replace(parts.get(name, driven.segments[0].task), name=f"{driven.name} {name}")
        driven = driving(driven, drive_profile)
        if driven.robot.acts.end:  # its arm holds a posture as long as its base drives
            posture = resting_posture(driven, cast("ArrayLike | str", motion))
            times = np.array([0.0, driven.robot.acts.end])
            return posture.name, driven, Trajectory.from_points(times, np.tile(posture.q, (2, 1)))
    if drive_profile is not None:
        how = {"rise_time": rise_time, "unit": unit, "rate": rate, "columns": columns, "topic": topic}
        name, task, trajectory = given_motion(motion, task, base=base, **how)
        return name, driving(task, drive_profile), trajectory
    if not isinstance(motion, str | os.PathLike | Trajectory):
        raise InputError("motion: a posture is held only where the base drives; give a drive profile")
    if not isinstance(motion, str | os.PathLike):
        if task is None:
            raise InputError("task: missing; a motion that is no file does not say which robot it is of")
        return "motion", load_task(task, base=base), motion
    if Path(motion).suffix == ".toml":
        raise InputError(NO_MOTION.format(motion), "", str(motion))
    task, path = task_of_motion(motion, task, base)
    if rate is None and path.name == TRAJECTORY and is_plan_folder(path.parent):
        rate = planned_rate(path.parent)
    elif rate is not None:
        rate = positive_number("rate", rate)
    how = {"unit": unit, "start": task.start, "rate": rate, "columns": columns, "topic": topic}
    name, robot = Path(motion).name, task.robot
    if task.is_cycle:
        if rise_time:
            raise InputError("rise_time: not for cycles")
        return name, task, load_motion(path, robot.names, robot.units, several=True, **how)
    trajectory = load_motion(path, robot.names, robot.units, **how)
    if trajectory.profiles is not None:
        rise_times = trajectory.rise_times or cast(MotionTask, task).rise_times or ()
        return name, task, trajectory.with_rise_times(rise_times if rise_time is None else rise_time)
    if rise_time is not None:
        defined = "samples, which already define its timing" if trajectory.points else "already a timing"
        raise InputError(f"rise_time: {motion} has {defined}")
    return name, task, trajectory
