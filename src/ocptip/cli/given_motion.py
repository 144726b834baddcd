"""Motions and tasks as the options of `check`, `certify` and `retime` name them."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError
from ocptip.basics.read import only_inside, require_readable
from ocptip.cli.options import given_columns, rate_of
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.output import PLAN, TRAJECTORY
from ocptip.motion.task import MotionTask
from ocptip.published.cases import case_names
from ocptip.published.tasks import experiment_task
from ocptip.standing.tolerance import NONE, Tolerance
from ocptip.task_files.cycle import read_task
from ocptip.task_files.plan_folder import is_plan_folder, planned_rate, read_plan_folder
from ocptip.trajectories.read import load_motion, motion_origin
from ocptip.trajectories.trajectory import Trajectory


def task_of(options: Namespace, otherwise: Tolerance = NONE) -> tuple[MotionTask | CycleTask, Path]:
    """The task and the motion's file.

    The task that is named, or that of the plan's folder, or the case that the file names, with its base.
    Where a task file has no tolerance, and for cases, it is `otherwise`.
    """
    path = Path(options.motion)
    if path.is_dir():
        with only_inside(path):
            require_readable(path / PLAN)
    folder, path = (path, path / PLAN) if path.is_dir() else (path.parent, path)
    if options.task is not None:
        if options.base is not None:
            raise InputError("--base: only for --case; a task file has its own base")
        return read_task(options.task, otherwise), path
    asked = options.case is not None or options.base is not None
    if not asked and (folder == Path(options.motion) or is_plan_folder(folder)):
        return read_plan_folder(folder).task, path
    origin = motion_origin(path)
    named = origin.get("case")
    if options.case is None and named is None:
        raise InputError(
            f"{options.motion}: names no case; say which robot by --case A..H or --task TASK.toml"
        )
    if options.case is None and named not in case_names():
        raise InputError(
            f"{options.motion}: is for {named!r}, which is no printed case ({', '.join(case_names())}); "
            "say which robot by --task TASK.toml or --case A..H"
        )
    case = options.case or named
    base = origin.get("base") if case == named else None
    task = experiment_task(case, options.base or base or "effective")
    return replace(task, limits=replace(task.limits, tolerance=otherwise)), path


def motion_of(path: Path, task: MotionTask, options: Namespace) -> Trajectory:
    """The motion; ramp commands with the rise time as typed, else their own, else that of the task."""
    motion = load_motion(path, task.robot.names, task.robot.units, **read_options(path, task, options))
    if motion.profiles is None:
        if options.rise_time is not None:
            own = "samples, which say themselves how they move" if motion.points else "a timing of its own"
            raise InputError(f"--rise-time: {options.motion} has {own}")
        return motion
    own = motion.rise_times if options.rise_time is None else ()
    return motion.with_rise_times(own or task.rise_times or ())


def read_options(path: Path, task: MotionTask | CycleTask, options: Namespace) -> dict[str, Any]:
    """What the readers of motions get to know beside the robot.

    The trajectory in the folder of a plan is for the controller that the plan names.
    """
    rate = rate_of(options)
    if rate is None and path.name == TRAJECTORY and is_plan_folder(path.parent):
        rate = planned_rate(path.parent)
    return {"unit": options.unit, "start": task.start, "rate": rate, "columns": given_columns(options)}
