"""`ocptip plan`: plans the motion of least energy, says what it found, writes files and figures."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from ocptip.cli.command import (
    MOVES,
    STANDS,
    Progress,
    _print,
    _refuse,
    output_directory,
    require_least,
    say_if_compiling,
    summary,
)

if TYPE_CHECKING:
    from ocptip.motion.check import MotionCheck
    from ocptip.motion.plan import MotionPlan
    from ocptip.motion.task import MotionTask

BASES = ("printed", "effective")
_LIMIT_OPTIONS = {"gn": "GN", "gt": "GT", "torque_ratio": "torque_ratio", "clearance": "clearance"}


def add_parser(commands: Any) -> None:
    """Add `plan` to the commands of the parser. Loads no numerics."""
    plan = commands.add_parser(
        "plan",
        help="the arm motion of least energy that loses no contact",
        description="Plans the ramp motion of least electric energy that keeps all contacts, and checks it.",
        epilog="exit code: 0 a verified plan, 1 none was found, 2 bad input",
    )
    plan.add_argument("task", metavar="A..H|TASK.toml", help="a published case, or a task file (see README)")
    plan.add_argument(
        "--base", choices=BASES, help="base data of the cases (default: effective, there contacts bind)"
    )
    plan.add_argument("--starts", metavar="N", type=int, default=8, help="random starts (default: 8)")
    plan.add_argument("--seed", metavar="N", type=int, default=0, help="of the starts (default: 0)")
    plan.add_argument("--jobs", metavar="N", type=int, help="processes (default: one per core)")
    plan.add_argument("--gn", metavar="X", type=float, help="largest tip-over value GN (default: 0.9)")
    plan.add_argument("--gt", metavar="X", type=float, help="largest slip value GT (default: 0.9)")
    plan.add_argument(
        "--torque-ratio", metavar="X", type=float, help="largest torque / limit of any joint (default: 1)"
    )
    plan.add_argument("--clearance", metavar="M", type=float, help="least distance to obstacles (default: 0)")
    plan.add_argument(
        "--time-scale",
        metavar="F",
        type=float,
        nargs="+",
        default=[],
        help="check the plan with all times multiplied by F, too (0.95: faster)",
    )
    plan.add_argument("--out", metavar="DIR", help="where files go (default: ocptip-plan-<name>)")
    plan.add_argument("--no-figures", action="store_true", help="write no figures")
    plan.add_argument("--json", action="store_true", help="print JSON instead of the summary")
    plan.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Plan, write and print; returns the exit code."""
    from ocptip.basics.errors import InputError, OcptipError, PlanningError

    report = None
    try:
        _check_numbers(options)
        task = _task(options)
        directory = output_directory(options, "plan", task.name)
        try:
            plan = _planned(options, task)
        except PlanningError as error:
            return _without_plan(options, task, str(error))
        report = PlanReport(plan, time_scale=[_scaled(plan, factor) for factor in options.time_scale])
        if base := _base(options):
            report.extra["base"] = base
        failure = _written(report, directory, figures=not options.no_figures)
    except InputError as error:
        return _refuse(f"{error}")
    except OcptipError as error:
        return _refuse(f"computation failed: {error}")
    except KeyboardInterrupt:
        _refuse("interrupted" + ("" if report else " before there was a verified plan"))
        return MOVES
    _print(report.to_json() if options.json else report.to_text())
    if failure is not None:
        return _refuse(f"{failure.filename or directory}: {failure.strerror or failure}")
    return STANDS if plan.verified else MOVES


@dataclass
class PlanReport:
    """What `ocptip plan` says.

    Attributes:
        plan: the plan.
        time_scale: factors with the checks of the plan run that much slower.
        extra: further entries of plan.json.
        written: files.
    """

    plan: MotionPlan
    time_scale: list[tuple[float, MotionCheck]] = field(default_factory=list)
    extra: dict[str, Any] = field(default_factory=dict)
    written: list[Path] = field(default_factory=list)

    def entries(self) -> dict[str, Any]:
        """What plan.json holds beside the plan: `extra`, and `time_scale` if it was asked for."""
        if not self.time_scale:
            return self.extra
        rows = [{"factor": f, **p.to_dict()} for f, p in self.time_scale]
        return {**self.extra, "time_scale": rows}

    def to_json(self) -> str:
        """The content of plan.json and the list `written`, as JSON text."""
        from ocptip.basics.write import plain
        from ocptip.motion.output import plan_to_dict

        data = {**plan_to_dict(self.plan), **self.entries(), "written": self.written}
        return json.dumps(plain(data), indent=2, allow_nan=False)

    def to_text(self) -> str:
        """The summary in one line, then starts, time scales and files. ASCII only, but for names."""
        lines = [("starts", self._starts())]
        if self.plan.interrupted:
            lines.append(("interrupted", "this is the best of the starts that had finished"))
        lines += [(f"time x {factor:g}", _scale_text(checked)) for factor, checked in self.time_scale]
        return summary(self.headline(), lines, self.written)

    def headline(self) -> str:
        """Status, energy, duration, worst reserve, ratio to the reference."""
        plan, checked = self.plan, self.plan.check
        name = max(("GN", "GT"), key=lambda n: checked.worst[n].value / checked.worst[n].limit)
        worst = checked.worst[name]
        parts = [
            f"{plan.task.name}: {'VERIFIED' if plan.verified else 'NOT VERIFIED'}. "
            f"{checked.energy:.1f} J in {checked.duration:.3f} s",
            f"worst reserve {name} {worst.value:.3f} (limit {worst.limit:g}) at {worst.time:.3f} s",
        ]
        if plan.task.reference is not None:
            energy = plan.task.robot.energy(plan.task.reference)
            parts.append(f"{checked.energy / energy:.3f} of the reference's {energy:.1f} J")
        broken = "" if plan.verified else f" Broken: {'; '.join(checked.violations)}."
        return ", ".join(parts) + "." + broken

    def _starts(self) -> str:
        starts = self.plan.starts
        verified = sum(start.verified for start in starts)
        iterations = sum(start.iterations for start in starts)
        return (
            f"{verified} of {len(starts)} verified, {iterations} iterations, "
            f"{self.plan.seconds:.1f} s, seed {self.plan.seed}"
        )


def progress_bar(stream: TextIO) -> Progress:
    """Bar that shows the least energy so far."""

    def best(energy: float | None) -> str:
        return "no verified plan yet" if energy is None else f"best {energy:.1f} J"

    return Progress(stream, "building the optimisation problem ...", best)


def _planned(options: argparse.Namespace, task: MotionTask) -> MotionPlan:
    from ocptip.motion.plan import plan_motion

    say_if_compiling()
    with progress_bar(sys.stderr) as progress:
        return plan_motion(
            task, starts=options.starts, seed=options.seed, jobs=options.jobs, progress=progress
        )


def _check_numbers(options: argparse.Namespace) -> None:
    """Refuse options that cannot be, by the names they have on the command line."""
    from ocptip.basics.errors import positive_number, share_of_one

    require_least(options, starts=1, seed=0, jobs=1)
    for name in _LIMIT_OPTIONS:
        if (value := getattr(options, name)) is not None:
            option = f"--{name.replace('_', '-')}"
            if name in ("gn", "gt"):
                share_of_one(option, value)
            else:
                positive_number(option, value, zero_allowed=name == "clearance")
    for factor in options.time_scale:
        positive_number("--time-scale", factor)


def _task(options: argparse.Namespace) -> MotionTask:
    from dataclasses import replace

    from ocptip.basics.errors import InputError
    from ocptip.published.tasks import experiment_task
    from ocptip.standing.limits import MotionLimits
    from ocptip.task_files.motion import load_task

    values = {limit: getattr(options, name) for name, limit in _LIMIT_OPTIONS.items()}
    limits = {name: value for name, value in values.items() if value is not None}
    if base := _base(options):
        return experiment_task(options.task, base, MotionLimits(**limits))
    if Path(options.task).suffix.lower() != ".toml":
        raise InputError(f"{options.task}: neither a case (A to H) nor a task file (.toml)")
    if options.base is not None:
        raise InputError(f"--base: belongs to the cases A to H, got {options.task}")
    task = load_task(options.task)
    return replace(task, limits=replace(task.limits, **limits)) if limits else task


def _base(options: argparse.Namespace) -> str | None:
    """Base data of a case; None for a task file."""
    from ocptip.published.cases import motion_cases

    return (options.base or "effective") if options.task in motion_cases() else None


def _written(report: PlanReport, directory: Path, *, figures: bool) -> OSError | None:
    """Write files and figures; an error is returned, not raised, so that the result is still printed."""
    from ocptip.motion.output import sample_motion, write_plan

    plan = report.plan
    samples = sample_motion(plan.task.robot, plan.motion)
    try:
        report.written += write_plan(directory, plan, samples=samples, extra=report.entries())
        if figures:
            from ocptip.pictures.plan import draw_plan

            report.written += draw_plan(directory, plan, samples)
    except OSError as error:
        return error
    return None


def _without_plan(options: argparse.Namespace, task: MotionTask, reason: str) -> int:
    if options.json:
        _print(json.dumps({"case": task.name, "verified": False, "status": reason}, indent=2))
    else:
        _print(f"{task.name}: NO VERIFIED PLAN. {reason}")
    return MOVES


def _scaled(plan: MotionPlan, factor: float) -> tuple[float, MotionCheck]:
    from ocptip.motion.check import check_motion

    return factor, check_motion(plan.task.robot, plan.motion.time_scaled(factor), plan.task.limits)


def _scale_text(checked: MotionCheck) -> str:
    if checked.verified:
        values = ", ".join(f"{name} {checked.worst[name].value:.3f}" for name in ("GN", "GT"))
        return f"stands, all limits kept: {values}, {checked.energy:.1f} J in {checked.duration:.3f} s"
    verdict = "stands, but breaks limits" if checked.stands else "LOSES A CONTACT"
    return f"{verdict}: {'; '.join(checked.violations)}"
