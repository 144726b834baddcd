"""What `ocptip plan` and `ocptip check` say of cycles: several motions in one task."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ocptip.basics.errors import InputError, PlanningError
from ocptip.basics.outputs import remove_figures
from ocptip.basics.text import quantity, ratio
from ocptip.basics.write import plain
from ocptip.certificate.checks import certified
from ocptip.cli.command import Answer, Report
from ocptip.cli.layout import check_rows, gear_rows, summary, table, under, use_of_reserves
from ocptip.cli.many import Asked
from ocptip.cli.options import given_limits, step_of
from ocptip.cli.stops import (
    price_line,
    price_of_stops,
    stop_table,
    stops_of_cycle,
    stops_to_dict,
    with_safe_stops,
)
from ocptip.cli.terminal import Progress
from ocptip.motion.cycles.check import CycleCheck, check_cycle, cycle_check, parts_of
from ocptip.motion.cycles.output import cycle_samples, cycle_to_dict, drives_of, run_motion, write_cycle
from ocptip.motion.cycles.plan import CyclePlan, plan_cycle
from ocptip.motion.cycles.task import CycleTask, freed_offset
from ocptip.motion.cycles.tolerated import cycle_tolerances
from ocptip.motion.execution import Execution, execute
from ocptip.motion.objective import objective_of
from ocptip.motion.stops import Stops
from ocptip.motion.tolerated import Tolerated
from ocptip.robots.inverse.pose_target import AXES
from ocptip.trajectories.trajectory import Trajectory

RISE_TIME = 0.02
"""s, for controllers that need one and where none is asked for."""
_NOT_OF_CYCLES = ("duration", "max_duration")
_COLUMNS = ("GN", "GT", "torque_ratio", "clearance_m")
_HEADS = {"GN": "GN", "GT": "GT", "torque_ratio": "torque", "clearance_m": "clearance"}


def cycle_with_options(task: CycleTask, options: Namespace) -> CycleTask:
    """The task with limits and objective as typed."""
    for name in _NOT_OF_CYCLES:
        if getattr(options, name) is not None:
            option = f"--{name.replace('_', '-')}"
            raise InputError(f"{option}: of a cycle belongs to its [[segment]]s, as a key of this name")
    require_plain(options, "sensitivities")
    if options.rise_time is not None and options.controller != "quintic":
        raise InputError(
            "--rise-time: segments of cycles are planned as ramps; only for --controller quintic"
        )
    task = task.with_limits(given_limits(options)).each(lambda own: with_safe_stops(own, options.stop_safe))
    if options.objective is not None or options.price_per_second is not None:
        return task.with_objective(objective_of(options.objective, options.price_per_second))
    return task


def plan_it(one: Asked, options: Namespace, executor: Executor | None) -> Report:
    """Plan a cycle; where there is no plan, the report says why."""
    task: CycleTask = one.task
    how = {"starts": options.starts, "seed": options.seed, "jobs": options.jobs, "executor": executor}
    how["prove"] = certified
    best = f"best of this segment {{:.{3 if task.objective.unit == 's' else 1}f}} {task.objective.unit}"
    try:
        with Progress(sys.stderr, "comparing postures ...", "no verified plan yet", best) as progress:
            plan = plan_cycle(task, **how, progress=progress)
            without = _without_stops(task, how)
    except PlanningError as error:
        data = {"case": task.name, "verified": False, "status": f"{error}", **task.robot.masses_to_dict()}
        within = task.limits.tolerance
        why = under("within", [f"{within}; --tolerance none plans as described"] if within.given else [])
        return Answer(False, summary(f"{task.name}: NO VERIFIED PLAN. {error}", why, []), data)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("before a segment had a verified plan") from None
    report = report_of(plan, one, options)
    report.price = price_of_stops(plan, without)
    return report


def _without_stops(task: CycleTask, how: dict[str, Any]) -> CyclePlan | None:
    """The cycle that need not be stopped, of as many starts; None if that was not asked, or none is found."""
    if not any(segment.task.limits.stoppable for segment in task.segments):
        return None
    try:
        return plan_cycle(task.each(lambda own: replace(own, limits=own.limits.without_stops)), **how)
    except PlanningError:
        return None


def report_of(plan: CyclePlan, one: Asked, options: Namespace) -> CycleReport:
    """What is to be said of a planned cycle."""
    pairs = zip(plan.parts, _executions(plan, options), strict=True)
    executions = [
        replace(own, check=certified(part.task.robot, own.motion, own.check, part.task.limits))
        for part, own in pairs
    ]
    motion = run_motion(plan, executions)
    checked = cycle_check(plan.finished, motion, [execution.check for execution in executions])
    scaled = [(f, check_cycle(plan.finished, plan.motion.time_scaled(f))) for f in options.time_scale]
    deviations = cycle_tolerances(plan.finished, motion)
    written = one.directory, not options.no_figures, options.effort, one.digest
    stops = stops_of_cycle(plan.finished, motion, checked, None)
    return CycleReport(plan, executions, motion, checked, scaled, deviations, *written, stops=stops)


def require_plain(options: Namespace, *names: str) -> None:
    """Refuse options that are for single motions only."""
    for name in names:
        if getattr(options, name):
            raise InputError(f"--{name.replace('_', '-')}: not for cycles")


def _executions(plan: CyclePlan, options: Namespace) -> list[Execution]:
    """What runs each segment."""
    if options.controller == "ramps":
        return drives_of(plan)
    rise = (options.rise_time or RISE_TIME) if options.controller == "quintic" else 0.0
    return [
        execute(
            part.task.robot,
            part.motion.with_rise_times(rise),  # planned as ramps, slowed down if need be
            part.task.limits,
            options.controller,
            step=step_of(options),
        )
        for part in plan.parts
    ]


@dataclass
class CycleReport(Report):
    """A planned cycle.

    Attributes:
        plan: the plan.
        executions: what runs each segment.
        motion: that is run.
        check: of that.
        time_scale: factors with the checks of the plan run that much slower.
        tolerated: deviations that lose no contact.
        directory: where files go.
        figures: whether figures are among them.
        effort: whether trajectory.json has torques.
        digest: of all that the plan depends on.
        stops: of segments that keep their reserves in stops, by name; empty: not asked for.
        price: what stops cost, plain data.
    """

    early = True
    command: ClassVar[str] = "plan"
    plan: CyclePlan
    executions: list[Execution]
    motion: Trajectory
    check: CycleCheck
    time_scale: list[tuple[float, CycleCheck]] = field(default_factory=list)
    tolerated: tuple[Tolerated, ...] = ()
    directory: Path = Path()
    figures: bool = True
    effort: bool = False
    digest: str = ""
    stops: dict[str, Stops] = field(default_factory=dict)
    price: dict[str, Any] = field(default_factory=dict)

    @property
    def good(self) -> bool:
        """True if all segments are planned and what is written is verified, stops included if asked for."""
        found = [*self.executions, *self.stops.values()]
        return self.plan.complete and self.check.whole.verified and all(one.verified for one in found)

    def entries(self) -> dict[str, Any]:
        """What plan.json holds beside the plan."""
        rows = [{"factor": f, **checked.to_dict()} for f, checked in self.time_scale]
        return {
            **({"time_scale": rows} if rows else {}),
            **stops_to_dict(self.stops),
            **({"price_of_stops": self.price} if self.price else {}),
            "tolerated": [one.to_dict() for one in self.tolerated],
            "digest": self.digest,
            "warnings": self.warnings,
        }

    def to_dict(self) -> dict[str, Any]:
        """The content of plan.json and the list `written`."""
        data = cycle_to_dict(self.plan, self.executions, self.check)
        return {**data, **plain(self.entries()), "written": self.written}

    def write(self) -> Iterator[Path]:
        """Write plan.json, tables and figures."""
        samples = cycle_samples(self.plan.task, self.motion)
        how = {"samples": samples, "extra": self.entries(), "effort": self.effort}
        yield from write_cycle(self.directory, self.plan, executions=self.executions, **how)
        remove_figures(self.directory, self.command)
        if self.figures:
            from ocptip.pictures.cycle import draw_cycle

            yield from draw_cycle(self.directory, self.plan.task, self.motion, self.check, samples)

    def to_text(self) -> str:
        """The summary in one line, a table of the segments, then what else is known."""
        whole, plan = self.check.whole, self.plan
        lines = self.found()
        if self.executions[0].controller != "ramps":
            lines.append(("controller", self._controller()))
        pairs = zip(plan.task.segments, self.executions, strict=False)
        texts = [f"{e.trajectory_text} (segment {s.name})" for s, e in pairs if e.trajectory_text]
        lines += under("points", texts)
        if plan.interrupted:
            lines.append(("interrupted", self._interrupted()))
        lines += [*check_rows(whole, self.tolerated, stops=self.stops), *gear_rows(self.check)]
        tables = [["", f"segment {name}", *stop_table(own)] for name, own in self.stops.items()]
        lines += under("stopped", [*price_line(self.price), *(line for own in tables for line in own)])
        lines += [(f"time x {f:g}", scaled_text(checked)) for f, checked in self.time_scale]
        lines += under("assumed", plan.task.robot.notes)
        head = "\n".join([self.headline(), "", *segment_table(plan.task, self.check), ""])
        return summary(head, lines, self.written)

    def found(self) -> list[tuple[str, str]]:
        """How the motions were found."""
        lines = [("starts", self._starts())]
        lines += [("", f"start {one.number} {one.status}") for part in self.plan.parts for one in part.lost]
        if "choices" in self.plan.options:
            chosen = self.plan.options["choices"]
            counts = ", ".join(map(str, chosen["postures"]))
            lines.append(
                ("postures", f"{counts} that stand at start and goals; {chosen['ways']} ways planned")
            )
        return lines + under("freed", list(freed_texts(self.plan)))

    def headline(self) -> str:
        """Status, energy, duration, use of the reserves."""
        whole = self.check.whole
        verdict = whole.headline
        if not self.plan.complete:
            parts = f"{len(self.plan.parts)} of {len(self.plan.task.segments)} segments"
            verdict = f"INCOMPLETE ({parts}){whole.scope}"
        broken = "" if whole.verified else f" Broken: {'; '.join(whole.violations)}."
        return (
            f"{self.plan.task.name}: {verdict}. {whole.energy:.1f} J in {whole.duration:.3f} s, "
            f"{use_of_reserves(whole)}.{broken}"
        )

    def _starts(self) -> str:
        found = [start for part in self.plan.parts for start in part.starts]
        verified, iterations = sum(s.verified for s in found), sum(s.iterations for s in found)
        return (
            f"{verified} of {len(found)} verified, {iterations} iterations, {self.plan.seconds:.1f} s, "
            f"seed {self.plan.seed}"
        )

    def _interrupted(self) -> str:
        if self.plan.complete:
            return "this is the best of the starts that had finished"
        left = ", ".join(s.name for s in self.plan.task.segments[len(self.plan.parts) :])
        return f"without a plan: {left}; no trajectory.json"

    def _controller(self) -> str:
        slower = max(execution.slower for execution in self.executions)
        how = f", ramps slowed down by up to {100 * (slower - 1):.2f} %" if slower > 1 else ""
        return f"{self.executions[0].controller}{how}; all numbers are of that motion"


def freed_texts(plan: CyclePlan) -> Iterator[str]:
    """Where poses that are free within a range are."""
    if not plan.parts:
        return
    motions = [part.motion for part in plan.parts]
    postures = [motions[0].start, *(own.goal for own in motions)]
    for (name, _, target), q in zip(plan.task.ends, postures, strict=False):
        for axis, own in freed_offset(target, plan.task.robot, q).items():
            assert target is not None
            low, high = 1e3 * target.free[AXES.index(axis)]
            yield f"{axis} {1e3 * own:+.4g} mm ({low:g} to {high:g}), {name}"


def segment_table(task: CycleTask, check: CycleCheck) -> list[str]:
    """Lines of `segment_rows`."""
    return table(segment_rows(task, check), left=(0, 1))


def segment_rows(task: CycleTask, check: CycleCheck) -> list[list[str]]:
    """Titles, a row per segment (what it holds, energy, duration, rest, worst values), and one of all."""
    rows = [["segment", "holds", "energy", "time", "rest", *_HEADS.values(), ""]]
    for k, (name, own) in enumerate(zip(check.names, check.segments, strict=True)):
        payload = task.segments[k].task.robot.payload
        pause, energy = check.pauses[k], check.rest_energies[k]
        rest = f"{quantity(pause, 's')}, {quantity(energy, 'J')}" if pause else "-"
        rows.append(
            [
                f"{k + 1} {name}",
                quantity(payload.mass, "kg") if payload else "nothing",
                quantity(own.energy, "J"),
                f"{own.duration:.3f} s",
                rest,
                *_values(own),
                "" if own.verified else "BROKEN",
            ]
        )
    whole = check.whole
    rest = f"{quantity(sum(check.pauses), 's')}, {quantity(sum(check.rest_energies), 'J')}"
    total = [quantity(whole.energy, "J"), f"{whole.duration:.3f} s", rest if any(check.pauses) else "-"]
    rows.append(["in all", "", *total, *_values(whole), "" if whole.verified else "BROKEN"])
    return rows


def _values(check: Any) -> list[str]:
    values = [check.worst[name].value if name in check.worst else np.nan for name in _COLUMNS]
    return [*map(ratio, values[:-1]), quantity(1e3 * values[-1], "mm")]


def scaled_text(checked: CycleCheck) -> str:
    """What becomes of a cycle that is run faster or slower."""
    whole = checked.whole
    if whole.verified:
        return f"stands, all limits kept: {whole.energy:.1f} J in {whole.duration:.3f} s"
    verdict = "stands, but breaks limits" if whole.stands else "LOSES A CONTACT"
    return f"{verdict}: {'; '.join(whole.violations)}"


def segments_of(task: CycleTask, motion: Trajectory) -> Trajectory:
    """The segments of what a file holds.

    Raises:
        InputError: it is not clear where they begin, or there are more or fewer than in the task.
    """
    if motion.points is not None:
        motion = parts_of(task, motion)
    elif not motion.parts:
        motion = Trajectory.from_segments((motion,), (0.0,))
    if len(motion.segments) != len(task.segments):
        raise InputError(f"has {len(motion.segments)} segments, {task.name} has {len(task.segments)}")
    return motion
