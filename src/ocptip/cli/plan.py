"""`ocptip plan`: plans the motion of least energy, says what it found, writes files and figures."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, TextIO

from ocptip.basics.errors import InputError, PlanningError, positive_number
from ocptip.basics.outputs import remove_figures
from ocptip.certificate.checks import certified
from ocptip.cli.command import Answer, Report
from ocptip.cli.cycles import RISE_TIME, cycle_with_options, plan_it
from ocptip.cli.layout import (
    check_rows,
    masses,
    rise_rows,
    sensitivities_to_dict,
    summary,
    under,
    use_of_reserves,
)
from ocptip.cli.many import Asked, answer_many, cluster, digest_of
from ocptip.cli.options import output_directory, require_least, step_of, with_limits
from ocptip.cli.stops import (
    price_line,
    price_of_stops,
    sensitivities_of,
    stop_table,
    stops_of,
    with_safe_stops,
)
from ocptip.cli.terminal import Progress, say_if_compiling
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.execution import Execution, execute
from ocptip.motion.largest_tolerance import largest_tolerance, too_much_at_rest
from ocptip.motion.objective import ENERGY, Objective, objective_of
from ocptip.motion.output import plan_to_dict, sample_motion, write_plan
from ocptip.motion.plan import MotionPlan, ToleranceError, plan_motion
from ocptip.motion.planner.attempt import LEFT_OUT
from ocptip.motion.stops import Stops
from ocptip.motion.task import MotionTask
from ocptip.motion.tolerated import Tolerated, tolerances
from ocptip.numerics.fork_server import interrupts_afterwards, ready
from ocptip.pictures.frame import Drawing
from ocptip.pictures.plan import begin_plan
from ocptip.published.cases import case_names
from ocptip.published.tasks import experiment_task
from ocptip.standing.elastic.drives import with_rise
from ocptip.standing.mechanism import MotionSamples
from ocptip.standing.sensitivity import Sensitivity
from ocptip.standing.tolerance import WORKSHOP
from ocptip.task_files.cycle import read_task
from ocptip.trajectories.trajectory import Trajectory


def run(options: Namespace) -> Report:
    """Plan; where there is no plan, the report says why."""
    require_least(options, starts=1, seed=0, jobs=1)
    for factor in options.time_scale:
        positive_number("--time-scale", factor)
    step_of(options)
    if len(options.task) > 1:
        return answer_many(options, _asked, planned)
    one = _asked(Namespace(**{**vars(options), "task": options.task[0]}))
    say_if_compiling()
    with cluster(options) as executor:
        return planned(one, options, executor)


def _asked(options: Namespace) -> Asked:
    """A task, with what the options change."""
    task, base = _task(options)
    digest = digest_of(task.source, options)
    if isinstance(task, CycleTask):
        task = cycle_with_options(task, options)
    else:
        task = _with_objective(_with_rise_time(task, options), options)
        task = with_safe_stops(task, options.stop_safe)
    return Asked(task, task.name, output_directory(options, task.name, task.source), digest, base)


def planned(one: Asked, options: Namespace, executor: Executor | None) -> Report:
    """Plan one task; where there is no plan, the report says why."""
    if isinstance(one.task, CycleTask):
        return plan_it(one, options, executor)
    task = one.task
    how = {"starts": options.starts, "seed": options.seed, "jobs": options.jobs, "executor": executor}
    how["prove"] = certified
    try:
        with progress_bar(sys.stderr, task.objective) as progress:
            looked = _Looked()
            slowly = task.limits.tolerance.given and options.controller == "ramps"  # proved
            aside = {"meanwhile": looked} if slowly else {}
            plan = plan_motion(task, **how, progress=progress, **aside)
            without = _without_stops(task, how) if task.limits.stoppable else None
    except PlanningError as error:
        without = _without_stops(task, how) if task.limits.stoppable else None
        return _no_plan(task, error, options, executor, without)
    except InputError:
        error = too_much_at_rest(task) if options.largest_tolerance else None
        if error is None:
            raise
        return _no_plan(task, error, options, executor)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("before there was a verified plan") from None
    report = _report(plan, one, options, looked)
    report.price = price_of_stops(plan, without)
    return report


class _Looked:
    """What drives make of a motion, and what it tolerates: known before its proof if that changes nothing."""

    def __init__(self) -> None:
        self._motion: Trajectory | None = None

    def __call__(self, task: MotionTask, motion: Trajectory, check: MotionCheck) -> None:
        """Look at it."""
        with interrupts_afterwards():
            self._execution = Execution.of_drives(task.robot, motion, task.limits, check)
            self._tolerated, self._motion = tolerances(task.robot, motion), motion

    def at(self, plan: MotionPlan, check: MotionCheck) -> tuple[Execution, tuple[Tolerated, ...]]:
        """Of a plan."""
        if self._motion is None or self._motion.to_dict() != plan.motion.to_dict():
            self(plan.task, plan.motion, check)
        return replace(self._execution, check=check), self._tolerated


def _report(plan: MotionPlan, one: Asked, options: Namespace, looked: _Looked) -> PlanReport:
    """What is run, proved and looked at from all sides, while other processes draw its figures."""
    robot, limits = plan.task.robot, plan.task.limits
    run = plan if options.controller == "ramps" else _by_points(plan, options)
    check = certified(robot, run.motion, run.check, limits)
    check = replace(check, drives=with_rise(robot, run.motion))
    samples = sample_motion(robot, run.motion)
    drawing = None
    if ready() and not options.no_figures:
        drawing = begin_plan(_seen(plan, run.motion, check), samples)
    with drawing or nullcontext():
        scaled = [(f, check_motion(robot, plan.motion.time_scaled(f), limits)) for f in options.time_scale]
        if isinstance(run, Execution):
            execution, deviations = replace(run, check=check), tolerances(robot, run.motion)
        else:
            execution, deviations = looked.at(plan, check)
        stops = stops_of(plan.task, run.motion, check)
        extra = {"base": one.base} if one.base else {}
        extra |= {"tolerated": [d.to_dict() for d in deviations], "digest": one.digest}
        written = one.directory, not options.no_figures, options.effort
        report = PlanReport(plan, execution, scaled, extra, *written, tolerated=deviations, stops=stops)
        report.samples, report.drawing = samples, drawing
        if options.sensitivities:
            report.sensitivities = sensitivities_of(plan.task, run.motion)
    return report


def _no_plan(
    task: MotionTask,
    error: PlanningError,
    options: Namespace,
    executor: Executor | None,
    without: MotionPlan | None = None,
) -> Answer:
    """Why, how much of the tolerance a motion can have if asked for, what is wrong `without` stops."""
    data = {"case": task.name, "verified": False, "status": f"{error}", **task.robot.masses_to_dict()}
    lines = [("masses", masses(task.robot))]
    if (tolerance := task.limits.tolerance.of(task.robot.payload)).given:
        lines.insert(0, ("within", f"{tolerance}; --tolerance none plans as described"))
    if without is not None:
        broken = check_motion(task.robot, without.motion, task.limits).violations
        plain = f"the plan without stops, {without.energy:.1f} J in {without.duration:.3f} s"
        lines.insert(0, ("stops", f"{plain}: {'; '.join(broken)}"))
        data["without_stops"] = {"energy_J": without.energy, "duration_s": without.duration}
        data["without_stops"]["violations"] = list(broken)
    if isinstance(error, ToleranceError) and options.largest_tolerance:
        how = {"seed": options.seed, "jobs": options.jobs, "executor": executor}
        with progress_bar(sys.stderr, task.objective) as progress:
            found = largest_tolerance(task, error, **how, progress=progress)
        lines.insert(0, ("largest", f"{found}"))
        data["largest_tolerance"] = found.to_dict()
    return Answer(False, summary(f"{task.name}: NO VERIFIED PLAN. {error}", lines, []), data)


def _without_stops(task: MotionTask, how: dict[str, Any]) -> MotionPlan | None:
    """The plan that need not be stopped, of as many starts; None if none is found."""
    try:
        return plan_motion(replace(task, limits=task.limits.without_stops), **how)
    except PlanningError:
        return None


def progress_bar(stream: TextIO, objective: Objective = ENERGY) -> Progress:
    """Bar that shows the least cost so far."""
    best = f"best {{:.{3 if objective.unit == 's' else 1}f}} {objective.unit}"
    return Progress(stream, "building the optimisation problem ...", "no verified plan yet", best, "steps")


def _with_objective(task: MotionTask, options: Namespace) -> MotionTask:
    """The task with objective and duration as typed."""
    name, price = options.objective, options.price_per_second
    if name is not None or price is not None:
        task = replace(task, objective=objective_of(name, price))
    exact, most = options.duration, options.max_duration
    if exact is not None and most is not None:
        raise InputError("--duration: give either --duration or --max-duration")
    for option, least, seconds in (("--duration", exact, exact), ("--max-duration", 0.0, most)):
        if seconds is not None:
            positive_number(option, seconds)
            limits = replace(task.limits, min_duration=least, max_duration=seconds)
            task = replace(task, limits=limits)
    return task


def _with_rise_time(task: MotionTask, options: Namespace) -> MotionTask:
    """The task as S-curves if a controller needs them."""
    if options.controller != "quintic" or all(task.rise_times or [0.0]):
        return task
    if options.rise_time is not None:
        raise InputError(f"--rise-time: must be > 0 for --controller quintic, got {options.rise_time:g}")
    return replace(task, rise_times=RISE_TIME)


def _task(options: Namespace) -> tuple[MotionTask | CycleTask, str | None]:
    """The task, and the base data if it is a case."""
    if options.task in case_names():
        base = options.base or "effective"
        task = experiment_task(options.task, base)
        task = replace(task, limits=replace(task.limits, tolerance=WORKSHOP))
        return with_limits(task, options), base
    if Path(options.task).suffix.lower() != ".toml":
        raise InputError(f"{options.task}: neither a case (A to H) nor a task file (.toml)")
    if options.base is not None:
        raise InputError(f"--base: belongs to the cases A to H, got {options.task}")
    task = read_task(options.task, WORKSHOP)
    return task if isinstance(task, CycleTask) else with_limits(task, options), None


@dataclass
class PlanReport(Report):
    """A plan.

    Attributes:
        plan: the plan.
        execution: what runs it.
        time_scale: factors with the checks of the plan run that much slower.
        extra: further entries of plan.json.
        directory: where files go.
        figures: whether figures are among them.
        effort: whether trajectory.json has torques.
        tolerated: deviations that lose no contact; empty if not computed.
        stops: of a plan that keeps its reserves in stops; None: not asked for.
        sensitivities: what changes would do; empty if not asked for.
        price: what it costs that it may be stopped; empty if it need not.
        samples: of the motion that is run; computed if None.
        drawing: its figures, if they are being drawn already.
    """

    early = True
    command: ClassVar[str] = "plan"
    plan: MotionPlan
    execution: Execution
    time_scale: list[tuple[float, MotionCheck]] = field(default_factory=list)
    extra: dict[str, Any] = field(default_factory=dict)
    directory: Path = Path()
    figures: bool = True
    effort: bool = False
    tolerated: tuple[Tolerated, ...] = ()
    stops: Stops | None = None
    sensitivities: tuple[Sensitivity, ...] = ()
    price: dict[str, Any] = field(default_factory=dict)
    samples: MotionSamples | None = None
    drawing: Drawing | None = None

    @property
    def check(self) -> MotionCheck:
        """Of what is written."""
        return self.execution.check

    @property
    def good(self) -> bool:
        """True if what is written is verified, stops included where they are asked for."""
        return self.execution.verified and (self.stops is None or self.stops.verified)

    def entries(self) -> dict[str, Any]:
        """What plan.json holds beside the plan: `extra`, and what else was asked for."""
        rows = [{"factor": f, **p.to_dict()} for f, p in self.time_scale]
        more = {"time_scale": rows} if rows else {}
        if self.stops:
            more["stops"] = self.stops.to_dict() | ({"price": self.price} if self.price else {})
        more |= sensitivities_to_dict(self.sensitivities)
        return {**self.extra, "warnings": self.warnings, **more}

    def to_dict(self) -> dict[str, Any]:
        """The content of plan.json and the list `written`."""
        return {**plan_to_dict(self.plan, self.execution), **self.entries(), "written": self.written}

    def write(self) -> Iterator[Path]:
        """Write plan.json, tables and figures."""
        motion = self.execution.motion
        samples = self.samples or sample_motion(self.plan.task.robot, motion)
        how = {"samples": samples, "extra": self.entries(), "effort": self.effort}
        yield from write_plan(self.directory, self.plan, execution=self.execution, **how)
        remove_figures(self.directory, self.command)
        if self.figures:
            drawing = self.drawing or begin_plan(_seen(self.plan, motion, self.check), samples)
            yield from drawing.save(self.directory)
            if self.stops:
                from ocptip.pictures.stops import draw_stops

                yield from draw_stops(self.directory, self.stops)

    def to_text(self) -> str:
        """The summary in one line, then starts, time scales and files. ASCII only, but for names."""
        lines = self.found()
        if self.execution.controller != "ramps":
            lines.append(("controller", self._controller(self.execution)))
        if self.execution.trajectory_text:
            lines.append(("points", self.execution.trajectory_text))
        more = {"sensitivities": self.sensitivities, "stops": {"": self.stops} if self.stops else {}}
        lines += check_rows(self.check, self.tolerated, **more)
        if self.stops:
            lines += under("stopped", [*price_line(self.price), *stop_table(self.stops)])
        lines += [(f"time x {factor:g}", _scale_text(checked)) for factor, checked in self.time_scale]
        lines.append(("masses", masses(self.plan.task.robot)))
        lines += under("assumed", self.plan.task.robot.notes)
        return summary(self.headline(), lines, self.written)

    def found(self) -> list[tuple[str, str]]:
        """How the motion was found."""
        lines = [("starts", self._starts())]
        lines += [("", f"start {one.number} {one.status}") for one in self.plan.lost]
        if self.plan.motion.profiles is not None:
            lines += rise_rows(self.plan.motion, self.plan.check)
        if "choices" in self.plan.options:
            pairs = self.plan.options["choices"]
            lines.append(
                ("postures", f"{pairs['planned']} of {pairs['pairs']} pairs of start and goal planned")
            )
        if self.plan.interrupted:
            lines.append(("interrupted", "this is the best of the starts that had finished"))
        return lines

    def headline(self) -> str:
        """Status, energy, duration, use of the reserves, ratio to the reference."""
        plan, checked = self.plan, self.check
        verdict = checked.headline if self.good else "NOT VERIFIED"
        parts = [
            f"{plan.task.name}: {verdict}. {checked.energy:.1f} J in {checked.duration:.3f} s",
            use_of_reserves(checked),
        ]
        if plan.task.reference is not None:
            energy = plan.task.robot.energy(plan.task.reference)
            parts.append(f"{checked.energy / energy:.3f} of the reference's {energy:.1f} J")
        said = (*checked.violations, *(self.stops.violations if self.stops else ()))
        broken = f" Broken: {'; '.join(said)}." if said else ""
        return ", ".join(parts) + "." + broken

    def _controller(self, execution: Execution) -> str:
        step = 1000 * execution.step
        how = {
            "linear": f"straight lines between points every {step:g} ms",
            "cubic": "cubics between points",
            "quintic": "quintics between points",
        }[execution.controller]
        slower = f", slowed down by {100 * (execution.slower - 1):.2f} %" if execution.slower > 1 else ""
        return f"{execution.controller}: {how}{slower}; all numbers are of that motion"

    def _starts(self) -> str:
        starts = self.plan.starts
        verified = sum(start.verified for start in starts)
        iterations = sum(start.iterations for start in starts)
        out = sum(start.status == LEFT_OUT for start in starts)
        left = f" ({out} that promised less left out)" if out else ""
        hops = sum(start.hops for start in starts)
        changed = f", the best {hops} times changed at random" if hops else ""
        return (
            f"{verified} of {len(starts) - out} verified{left}{changed}, {iterations} iterations, "
            f"{self.plan.seconds:.1f} s, seed {self.plan.seed}"
        )


def _by_points(plan: MotionPlan, options: Namespace) -> Execution:
    own = plan.task.robot, plan.motion, plan.task.limits
    return execute(*own, options.controller, step=step_of(options))


def _seen(plan: MotionPlan, motion: Trajectory, check: MotionCheck) -> Any:
    """The plan as its figures show it: with the motion that is run."""
    return SimpleNamespace(**vars(plan) | {"motion": motion, "check": check})


def _scale_text(checked: MotionCheck) -> str:
    if checked.verified:
        values = ", ".join(f"{name} {checked.worst[name].value:.3f}" for name in ("GN", "GT"))
        return f"stands, all limits kept: {values}, {checked.energy:.1f} J in {checked.duration:.3f} s"
    verdict = "stands, but breaks limits" if checked.stands else "LOSES A CONTACT"
    return f"{verdict}: {'; '.join(checked.violations)}"
