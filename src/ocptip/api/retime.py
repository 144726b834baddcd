"""`ocptip.retime`: the fastest or cheapest timing of a given path that keeps all limits."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, Literal, cast

import numpy as np

from ocptip.api.inputs.given import MotionLike, ProfileLike, driven, driving, task_of_motion
from ocptip.api.methods import proved_runs
from ocptip.api.plan import base_alone
from ocptip.api.results.plan import Plan
from ocptip.api.tasks import Base, TaskLike, load_task
from ocptip.basics.errors import InputError, naming, positive_number
from ocptip.basics.text import silent
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.cycles.check import cycle_check
from ocptip.motion.cycles.task import CycleTask, refuse_driving, refuse_objects
from ocptip.motion.files.execution import Execution, execute, slowed_as_needed
from ocptip.motion.files.plan_files import run_by
from ocptip.motion.files.source import source_of
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.objective import TIME, objective_of
from ocptip.motion.stops.check import cancels_by_segment
from ocptip.motion.task import MotionTask
from ocptip.motion.tolerated import robustness
from ocptip.numerics.time_limit import TimeBudget
from ocptip.pictures.phase_plane import draw_phase_plane
from ocptip.retiming.retime import Retimed
from ocptip.retiming.retime import retime as time_path
from ocptip.retiming.whole_body import BaseLimits, Run
from ocptip.robots.kinematics import gripper_pose
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.task_files.path import load_path, path_along, refuse_early
from ocptip.trajectories.controllers import Controller
from ocptip.trajectories.drive_profile import POSE
from ocptip.trajectories.path_fit import FittedPath
from ocptip.trajectories.tool_path import ToolPath, tool_distance
from ocptip.trajectories.trajectory import Trajectory

SLOWEST = 4.0
"""Maximum factor of all times by which a timing is slowed down where the check asks for it."""


@dataclass(frozen=True)
class Timing:
    """A path, its timing, and what a controller makes of it.

    Attributes:
        task: robot, limits and objective.
        fit: the path.
        timed: its timing.
        execution: the points of a controller, and their check.
        before: check of the motion that the path was taken from; None: there was none.
    """

    task: MotionTask
    fit: FittedPath
    timed: Retimed
    execution: Execution
    before: MotionCheck | None

    @classmethod
    def of(
        cls,
        task: MotionTask,
        fit: FittedPath,
        jerk: float | None,
        controller: Controller,
        rate: float | None,
        stage: Callable[[str], None],
        base: BaseLimits | None,
        budget: TimeBudget,
    ) -> Timing:
        """Time a path; arguments are those of :func:`retime`, `budget` is for the proof."""
        robot, limits = task.robot, task.limits
        stage("timing the path ...")
        most = None if jerk is None else jerk * np.where(np.array(robot.units) == "rad", np.pi / 180, 1.0)
        limited = np.isfinite(robot.limits.jerk).any() and most is None and not limits.jerk
        breaks_jerk = limited and fit.path.bends.size > 0
        if breaks_jerk:
            robot = Robot.of(robot)
            robot = robot.varied(arm=robot.arm.with_limits(jerk=np.full(robot.n, np.inf)))
        timed = time_path(robot, fit.path, limits, task.objective, jerk=most, base=base, slowest=SLOWEST)
        stage("checking the timing ...")
        step = None if rate is None else 1 / rate
        if base is None:
            execution = execute(robot, timed.motion, limits, controller, step=step)
            if breaks_jerk:
                task = _with_bends_noted(task, fit)
                robot = task.robot
                timed = replace(timed, check=check_motion(robot, timed.motion, limits))
                execution = replace(execution, check=check_motion(robot, execution.motion, limits))
        else:
            timed, execution = _whole_body(timed, limits, controller, step)
            profile = timed.robot.drive_profile
            assert profile is not None  # its base drives
            task = driven(task, profile)
            fit, robot = fit.some(slice(len(POSE), None)), task.robot
        before = None if task.reference is None else check_motion(robot, task.reference, limits)
        timing = cls(task, fit, timed, execution, before)
        stage("proving the timing ...")
        (execution,) = proved_runs(timing.plan, [execution], budget)
        return replace(timing, execution=execution)

    @property
    def plan(self) -> MotionPlan:
        """The timing in the shape of a plan, for what writes and draws these."""
        return MotionPlan(
            self.task, self.timed.motion, self.timed.check, (), 0, 0, self.timed.seconds, False, {}
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; distances of the path in degrees and mm."""
        robot, scales = self.task.robot, np.where(np.array(self.task.robot.units) == "rad", 180 / np.pi, 1e3)
        lines = {}
        if self.fit.keeps_to_lines:
            joints, tool = self.beside_lines
            lines = {
                "beside_lines": (scales * joints).tolist(),
                "tool_beside_lines_mm": (1e3 * tool).tolist(),
            }
        return {
            **self.timed.to_dict(),
            "path_made_of": self.fit.how,
            "path_distance": (scales * self.fit.distance).tolist(),
            "tool_distance_mm": [1e3 * v for v in self.tool_distance][:1],
            **lines,
            "corners": len(self.fit.path.corners),
            "as_given": None if self.before is None else self.before.to_dict(),
            "robot": robot.kind,
        }

    @cached_property
    def beside_lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Largest distance of a spline from the lines between its points: joints, (n,), and the gripper."""
        if (arm := self.task.robot.arm) is None:
            return self.fit.beside_lines()[0], np.zeros(0)
        joints, tool = self.fit.beside_lines(lambda q: gripper_pose(arm, q)[0])
        return joints, np.array([tool])

    @property
    def tool_distance(self) -> np.ndarray:
        """Largest distance of the gripper, m; empty for mechanisms without one."""
        if isinstance(self.fit, ToolPath):
            return self.fit.tool[:1]
        arm = self.task.robot.arm
        return np.array([] if arm is None else [tool_distance(arm, self.fit)])


def _whole_body(
    timed: Retimed, limits: Limits, controller: Controller, step: float | None
) -> tuple[Retimed, Execution]:
    """The timing and its execution by a controller, slower with the base where that is needed."""

    def tried(factor: float) -> Execution:
        run = Run(timed.robot, timed.motion, True).slowed(factor)
        executed = execute(run.robot, run.motion, limits, controller, step=step, slowest=1.0)
        return replace(executed, slower=factor)

    execution = slowed_as_needed(tried) or tried(1.0)
    run = Run(timed.robot, timed.motion, True).slowed(execution.slower)
    check = timed.check if execution.slower == 1 else check_motion(run.robot, run.motion, limits)
    slower = timed.slower * execution.slower
    return replace(timed, robot=run.robot, motion=run.motion, check=check, slower=slower), execution


def _with_bends_noted(task: MotionTask, fit: FittedPath) -> MotionTask:
    """The task, whose robot has a note that no timing of the path keeps its jerk limits."""
    robot = Robot.of(task.robot)
    joints = ", ".join(robot.names[j] for j in np.flatnonzero(np.isfinite(robot.limits.jerk)))
    place = fit.path.breakpoints[fit.path.bends[0]]
    note = (
        f"no timing of the path keeps the jerk limits of joints {joints}: its curvature has a step at "
        f"s = {place:.4f}; waypoints without times are joined smoothly"
    )
    source, robot = source_of(task), robot.varied(arm=robot.arm.with_notes(note))
    return replace(task, robot=robot, source=source and replace(source, robot=robot))


@dataclass(frozen=True, eq=False, repr=False)
class RetimedPlan(Plan):
    """A path, or those of a cycle, with the timing.

    Attributes:
        timings: of the segments, with the evidence; a motion has one segment.
    """

    command: ClassVar[str] = "retime"
    timings: tuple[Timing, ...] = ()

    def _entries(self) -> dict[str, Any]:
        entries = {name: value for name, value in super()._entries().items() if name != "base"}
        return entries if self.task.is_cycle else {**entries, "retimed": self.timings[0].to_dict()}

    def write(self, folder: str | os.PathLike[str], *, figures: bool = True, **how: Any) -> Iterator[Path]:
        """The files of a plan, and the phase plane of each segment."""
        yield from super().write(folder, figures=figures, **how)
        for number, timing in enumerate(self.timings if figures else (), 1):
            name = f"phase_plane-{number}" if self.task.is_cycle else "phase_plane"
            yield from draw_phase_plane(folder, timing.plan, timing.timed, name)


def retime(
    task: TaskLike | None,
    path: MotionLike,
    *,
    base: Base | None = None,
    drive_profile: ProfileLike | None = None,
    base_limits: BaseLimits | str | None = None,
    objective: Literal["time", "energy", "both"] | None = None,
    price_per_second: float | None = None,
    max_duration: float | None = None,
    jerk: float | None = None,
    path_tolerance: float | None = None,
    controller: Controller = "cubic",
    rate: float | None = None,
    seconds: float | None = None,
    unit: str | None = None,
    columns: Mapping[str, str | int] | None = None,
    topic: str | None = None,
    stage: Callable[[str], None] | None = None,
) -> RetimedPlan:
    """Time a path so that all limits hold, as fast or as cheaply as possible; check and prove the result.

    Example::

        plan = ocptip.retime("task.toml", "path.toml")

    Args:
        task: robot and limits; what :func:`ocptip.load_task` takes. None: what the path's file names.
        path: a file of waypoints (TOML), or a motion or its file, whose times are not kept.
        base: of a case, if it is not that of the file.
        drive_profile: how the base drives meanwhile, instead of as in the task, see :func:`ocptip.check`.
        base_limits: of a base that drives on the path, such as "1 m/s, 1 m/s^2, 60 deg/s, 300 N"; the path
            then also has x, y and yaw of the base, and both are timed together.
        objective, price_per_second: what is minimised; default "time".
        max_duration: s, at most.
        jerk: deg/s^3 (sliding joints: m/s^3), at most; None: acceleration steps are allowed.
        path_tolerance: degrees (sliding joints, tool lines: mm), by which the path may be off what is given.
        controller: what runs it; "quintic" needs `jerk`.
        rate: points per second for the controller.
        seconds: of wall time, after which the proof, robustness and cancels are left out; a user's interrupt
            also ends them. The timing and its check are always complete.
        unit, columns, topic: of a CSV file or a bag, see `ocptip.trajectories.read.load_motion`.
        stage: called with what is done next.

    Raises:
        InputError: the path cannot be read or timed; says where and why.
    """
    if controller == "quintic" and jerk is None:
        raise InputError("controller: quintics need --jerk; without it accelerations have steps")
    for name, value in (
        ("rate", rate),
        ("jerk", jerk),
        ("max_duration", max_duration),
        ("seconds", seconds),
    ):
        if value is not None:
            positive_number(name, value)
    limits_of_base = BaseLimits.of(base_limits) if isinstance(base_limits, str) else base_limits
    if isinstance(path, Trajectory):
        if task is None:
            raise InputError("task: missing; a motion that is no file does not say which robot it is of")
        task, name = load_task(task, base=base), "motion"
        given = path_along(path, task, path_tolerance, jerk is not None)
    else:
        refuse_early(path)  # the task may have to be compiled first
        task, file = task_of_motion(path, task, base)
        reading = {"columns": columns, "unit": unit, "rate": rate, "topic": topic}
        reading |= {"with_base": limits_of_base is not None, "smooth": jerk is not None}
        name, given = file.name, load_path(file, task, tolerance=path_tolerance, **reading)
    task = driving(task, drive_profile)
    if limits_of_base and task.is_cycle:
        raise InputError("base_limits: not for cycles")
    if given.paths[0].path.joints > task.robot.n and not limits_of_base:
        raise InputError(f"{name}: is a path of base and arm; give limits of the base (base_limits)")
    refuse_objects(task)
    refuse_driving(task)
    motions: Sequence[Trajectory | None] = given.motions or [None] * len(given.paths)
    goal = (
        TIME if objective is None and price_per_second is None else objective_of(objective, price_per_second)
    )
    most: dict[str, float] = {}
    if max_duration is not None:
        most = {"min_duration": 0.0, "max_duration": max_duration}
    timings, budget = [], TimeBudget(seconds)
    how = jerk, controller, rate, stage or silent, limits_of_base, budget
    for segment, fit, motion in zip(task.segments, given.paths, motions, strict=True):
        columns_of_arm = slice(-segment.task.robot.n, None)
        ends = {"start": fit.path.start[columns_of_arm], "goal": fit.path.goal[columns_of_arm]}
        ends |= {"targets": (None, None), "choices": (), "reference": None if limits_of_base else motion}
        limits = replace(segment.task.limits, **most)
        asked = replace(segment.task, **ends, limits=limits, objective=goal)
        where = f"{name} (segment {segment.name})" if task.is_cycle else name
        with naming(where), _naming_base(asked):
            timings.append(Timing.of(asked, fit, *how))
    planned = _cycle(cast(CycleTask, task), timings) if task.is_cycle else timings[0].plan
    executions = tuple(timing.execution for timing in timings)
    motion = run_by(planned, executions)
    checked = cycle_check(planned.task, motion, [run.check for run in executions])
    return RetimedPlan(
        planned,
        executions,
        timings=tuple(timings),
        task=planned.task,
        checked=checked,
        robustness=budget.within(partial(robustness, planned.task, motion), (), "robustness"),
        cancels=budget.within(
            partial(cancels_by_segment, planned.task, motion), {}, "safe decelerations of cancels"
        ),
        left_out=tuple(budget.left_out),
    )


@contextmanager
def _naming_base(task: MotionTask) -> Iterator[None]:
    """Refusals also say what the base alone breaks while it drives."""
    try:
        yield
    except InputError as error:
        if not (alone := base_alone(task)):
            raise
        raise InputError(f"{error.text}; {alone}", error.path, error.file) from None


def _cycle(task: CycleTask, timings: Sequence[Timing]) -> MotionPlan:
    """The timings of the segments of a cycle, between standstills."""
    segments = [
        replace(segment, task=timing.task, goals=timing.task.goal[None], target=None)
        for segment, timing in zip(task.segments, timings, strict=True)
    ]
    task = replace(task, segments=tuple(segments), starts=timings[0].task.start[None])
    options = {"retimed": [timing.to_dict() for timing in timings]}
    seconds = sum(timing.timed.seconds for timing in timings)
    return MotionPlan.of_cycle(task, [timing.plan for timing in timings], seconds=seconds, options=options)
