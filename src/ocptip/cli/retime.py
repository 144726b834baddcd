"""`ocptip retime`: times a given path anew, says what it found, writes files and figures."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ocptip.basics.errors import InputError, naming, positive_number
from ocptip.basics.text import quantity
from ocptip.certificate.checks import certified
from ocptip.cli.command import Report
from ocptip.cli.cycles import CycleReport
from ocptip.cli.given_motion import task_of
from ocptip.cli.layout import use_of_reserves
from ocptip.cli.options import given_columns, given_limits, output_directory, rate_of, step_of
from ocptip.cli.plan import PlanReport
from ocptip.cli.terminal import Progress, say_if_compiling
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.cycles.check import cycle_check
from ocptip.motion.cycles.output import run_motion
from ocptip.motion.cycles.plan import CyclePlan, sequence_of
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.cycles.tolerated import cycle_tolerances
from ocptip.motion.execution import Execution, execute
from ocptip.motion.objective import TIME, Objective, objective_of
from ocptip.motion.plan import MotionPlan
from ocptip.motion.task import MotionTask
from ocptip.motion.tolerated import tolerances
from ocptip.retiming.retime import Retimed, retime
from ocptip.standing.arm import Robot
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import WORKSHOP
from ocptip.task_files.path import load_path, refuse_early
from ocptip.trajectories.path_fit import FittedPath
from ocptip.trajectories.tool_path import ToolPath, tool_distance
from ocptip.trajectories.trajectory import Trajectory

_WORDS = {"time": "fastest", "energy": "cheapest", "both": "least cost"}


def run(options: Namespace) -> Report:
    """Time the path; one that cannot be timed is bad input, and it is said where and why."""
    step_of(options)
    if options.controller == "quintic" and options.jerk is None:
        raise InputError("--controller: quintics need --jerk, without which accelerations jump")
    refuse_early(options.motion)  # the task may have to be compiled first
    task, path = task_of(options, WORKSHOP)
    how = {"tolerance": options.path_tolerance, "unit": options.unit, "rate": rate_of(options)}
    given = load_path(path, task, columns=given_columns(options), **how)
    directory = output_directory(options, task.name, task.source)
    say_if_compiling()
    motions: Sequence[Trajectory | None] = given.motions or [None] * len(given.paths)
    tasks = [task] if isinstance(task, MotionTask) else [segment.task for segment in task.segments]
    names = [""] if isinstance(task, MotionTask) else [f" (segment {s.name})" for s in task.segments]
    timings = []
    for own, fit, motion, name in zip(tasks, given.paths, motions, names, strict=True):
        shown = Progress(sys.stderr, "reading the path ...")
        with naming(Path(options.motion).name + name), shown as progress:
            timings.append(Timing.of(_asked(own, fit, motion, options), fit, options, progress))
    written = directory, not options.no_figures, options.effort
    if isinstance(task, CycleTask):
        return _cycle(task, timings, *written)
    (timing,) = timings
    deviations = tolerances(task.robot, timing.execution.motion)
    base = {"base": options.base or "effective"} if timing.task.source is None else {}
    extra = {**base, "tolerated": [one.to_dict() for one in deviations], "retimed": timing.to_dict()}
    report = RetimeReport(timing.plan, timing.execution, [], extra, *written, tolerated=deviations)
    report.timing = timing
    return report


def _asked(task: MotionTask, fit: FittedPath, motion: Trajectory | None, options: Namespace) -> MotionTask:
    """The task along the path, with limits, objective and duration as typed; else the fastest timing."""
    limits: dict[str, Any] = given_limits(options)
    if options.max_duration is not None:
        limits |= {
            "min_duration": 0.0,
            "max_duration": positive_number("--max-duration", options.max_duration),
        }
    name, price = options.objective, options.price_per_second
    return replace(
        task,
        start=fit.path.start,
        goal=fit.path.goal,
        targets=(None, None),
        choices=(),
        reference=motion,
        limits=replace(task.limits, **limits),
        objective=TIME if name is None and price is None else objective_of(name, price),
    )


def _jerk(robot: StandingMechanism, options: Namespace) -> np.ndarray | None:
    """(n,) rad/s^3, m/s^3 as typed; None without."""
    if options.jerk is None:
        return None
    return positive_number("--jerk", options.jerk) * np.where(
        np.array(robot.units) == "rad", np.pi / 180, 1.0
    )


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
    def of(cls, task: MotionTask, fit: FittedPath, options: Namespace, progress: Progress) -> Timing:
        """Time a path."""
        robot, limits = task.robot, task.limits
        progress.stage("timing the path ...")
        timed = retime(robot, fit.path, limits, task.objective, jerk=_jerk(robot, options))
        progress.stage("checking the timing ...")
        execution = execute(robot, timed.motion, limits, options.controller, step=step_of(options))
        progress.stage("proving the timing ...")
        proved = certified(robot, execution.motion, execution.check, limits)
        before = None if task.reference is None else check_motion(robot, task.reference, limits)
        return cls(task, fit, timed, replace(execution, check=proved), before)

    @property
    def plan(self) -> MotionPlan:
        """The timing in the shape of a plan, for what writes and draws these."""
        return MotionPlan(
            self.task, self.timed.motion, self.timed.check, (), 0, 0, self.timed.seconds, False, {}
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; distances of the path in degrees and mm."""
        robot, scales = self.task.robot, np.where(np.array(self.task.robot.units) == "rad", 180 / np.pi, 1e3)
        return {
            **self.timed.to_dict(),
            "path_made_of": self.fit.how,
            "path_distance": (scales * self.fit.distance).tolist(),
            "tool_distance_mm": [1e3 * v for v in self._tool][:1],
            "corners": len(self.fit.path.corners),
            "as_given": None if self.before is None else self.before.to_dict(),
            "robot": robot.kind,
        }

    @property
    def _tool(self) -> np.ndarray:
        """Largest distance of the gripper, m; empty for mechanisms without one."""
        if isinstance(self.fit, ToolPath):
            return self.fit.tool[:1]
        robot = self.task.robot
        return np.array([tool_distance(robot.arm, self.fit)] if isinstance(robot, Robot) else [])

    def rows(self) -> list[tuple[str, str]]:
        """The path, what it was, and what decides its timing."""
        found = [("path", self._path()), ("timing", self._timing())]
        if self.before is not None:
            verdict = f"; {'; '.join(self.before.violations)}" if self.before.violations else ""
            found.append(("as given", f"{self.before.duration:.3f} s, {self.before.headline}{verdict}"))
        if self.task.reference is not None:
            found += [("assumed", text) for text in self.task.reference.assumed]
        if self.timed.later:
            found.append(("only checked", f"{', '.join(self.timed.later)}: the timing does not know them"))
        return found

    def _path(self) -> str:
        units = np.array(self.task.robot.units)
        off = [
            f"{scale * own.max():.2g} {unit}"
            for own, scale, unit in (
                (self.fit.distance[units == "rad"], 180 / np.pi, "deg"),
                (self.fit.distance[units == "m"], 1e3, "mm"),
                (self._tool, 1e3, "mm of the gripper"),
            )
            if own.size
        ]
        corners = len(self.fit.path.corners)
        stops = f"; stops at {corners} corner{'s' * (corners > 1)}" if corners else ""
        return f"{self.fit.how}, at most {', '.join(off)} off{stops}"

    def _timing(self) -> str:
        timed = self.timed
        if timed.cheapest is not None:
            own = timed.cheapest
            unit = self.task.objective.unit
            seconds = f"{timed.seconds:.2f} s to solve and check"
            if self.task.objective.name == "time":
                words = f"at least {own.lower_bound:.4g} s on these nodes"
                return f"{words}, {timed.fastest:.4g} s if no joint were late; {seconds}"
            words = f"cost {own.cost:.4g} {unit}, at least {own.lower_bound:.4g} {unit} on these nodes"
            return f"{words}; the fastest takes {timed.fastest:.3f} s; {seconds}"
        counts = {name: timed.active.count(name) for name in dict.fromkeys(timed.active) if name}
        shares = sorted(counts.items(), key=lambda item: -item[1])
        text = ", ".join(f"{name} ({100 * n / len(timed.active):.0f} %)" for name, n in shares)
        return f"decided by {text} of {len(timed.active)} intervals; {timed.seconds:.2f} s to solve and check"


@dataclass
class RetimeReport(PlanReport):
    """A path with its timing.

    Attributes:
        timing: with the evidence.
    """

    command: ClassVar[str] = "retime"
    timing: Timing | None = None

    def found(self) -> list[tuple[str, str]]:
        """The path, what it was, and what decides its timing."""
        assert self.timing is not None
        return self.timing.rows()

    def headline(self) -> str:
        """Status, duration, energy, use of the reserves."""
        assert self.timing is not None
        return _headline(self.plan.task.name, self.check, self.plan.task.objective, self.timing.before)

    def write(self) -> Iterator[Path]:
        """Write what a plan has, and the phase plane."""
        yield from super().write()
        if self.figures and self.timing:
            from ocptip.pictures.phase_plane import draw_phase_plane

            yield from draw_phase_plane(self.directory, self.plan, self.timing.timed)


def _headline(name: str, checked: MotionCheck, objective: Objective, before: MotionCheck | None) -> str:
    given = f" instead of {before.duration:.3f} s as given" if before else ""
    broken = "" if checked.verified else f" Broken: {'; '.join(checked.violations)}."
    return (
        f"{name}: {checked.headline}. The {_WORDS[objective.name]} timing takes {checked.duration:.3f} s"
        f"{given}, {quantity(checked.energy, 'J')}, {use_of_reserves(checked)}.{broken}"
    )


def _cycle(
    task: CycleTask, timings: Sequence[Timing], directory: Path, figures: bool, effort: bool
) -> Report:
    """The same for the segments of a cycle, between standstills."""
    segments = [
        replace(segment, task=own.task, goals=own.task.goal[None], target=None)
        for segment, own in zip(task.segments, timings, strict=True)
    ]
    task = replace(task, segments=tuple(segments), starts=timings[0].task.start[None])
    parts, executions = tuple(own.plan for own in timings), [own.execution for own in timings]
    exact = cycle_check(task, sequence_of(task, parts), [part.check for part in parts])
    seconds = sum(part.seconds for part in parts)
    plan = CyclePlan(task, parts, exact, 0, seconds, False, {"retimed": [own.to_dict() for own in timings]})
    motion = run_motion(plan, executions)
    checked = cycle_check(task, motion, [execution.check for execution in executions])
    report = RetimedCycleReport(
        plan, executions, motion, checked, [], cycle_tolerances(task, motion), directory, figures, effort
    )
    report.timings = timings
    return report


@dataclass
class RetimedCycleReport(CycleReport):
    """Paths of a cycle with their timings.

    Attributes:
        timings: of the segments.
    """

    command: ClassVar[str] = "retime"
    timings: Sequence[Timing] = ()

    def found(self) -> list[tuple[str, str]]:
        """The path of each segment, and what decides its timing."""
        names = [segment.name for segment in self.plan.task.segments]
        pairs = zip(names, self.timings, strict=True)
        return [(title, f"{text} (segment {name})") for name, own in pairs for title, text in own.rows()]

    def write(self) -> Iterator[Path]:
        """Write what a cycle has, and the phase plane of each segment."""
        names = [f"phase_plane-{k}" for k in range(1, len(self.timings) + 1)]
        yield from super().write()
        if self.figures:
            from ocptip.pictures.phase_plane import draw_phase_plane

            for name, own in zip(names, self.timings, strict=True):
                yield from draw_phase_plane(self.directory, own.plan, own.timed, name)
