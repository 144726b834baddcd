"""`ocptip plan`: plans the motion of minimum energy, reports it, writes files and figures."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from concurrent.futures import Executor

from ocptip.api.plan import NoPlanError
from ocptip.api.plan import plan as plan_task
from ocptip.api.tasks import load_task
from ocptip.basics.errors import InputError, naming, positive_number
from ocptip.cli.command import Answer, Report
from ocptip.cli.layout import masses, summary
from ocptip.cli.many import Asked, answer_many, cluster, digest_of
from ocptip.cli.options import (
    gate_of,
    given_limits,
    naming_options,
    output_directory,
    read_gate,
    require_least,
    taken,
    typed,
    with_cancel,
)
from ocptip.cli.plan.plan_report import PlanReport
from ocptip.cli.terminal import Progress
from ocptip.motion.cycles.task import Task
from ocptip.motion.violations import sentence
from ocptip.trajectories.bags import require_new


def run(options: Namespace) -> Report:
    """Plan; where there is no plan, the report says why."""
    require_least(options, starts=1, seed=0, jobs=1)
    for factor in options.time_scale:
        positive_number("--time-scale", factor)
    for name in typed(options, "seconds", "rate"):
        positive_number(f"--{name}", getattr(options, name))
    read_gate(options)
    if options.bag:
        with naming("--bag"):
            require_new(options.bag)
    if len(options.task) > 1:
        for name in typed(options, "require", "junit", "bag"):
            raise InputError(f"--{name}: is for one task, got {len(options.task)}")
        return answer_many(options, _asked, planned)
    began = time.monotonic()
    one = _asked(Namespace(**{**vars(options), "task": options.task[0]}))
    if options.seconds:  # reading the robot is part of them
        options.seconds = max(options.seconds - (time.monotonic() - began), 0.5 * options.seconds)
    with cluster(options) as executor:
        return planned(one, options, executor)


def _asked(options: Namespace) -> Asked:
    """A task, with what the options change."""
    with naming_options(*typed(options, "base", "duration", "max_duration")):
        changes = taken(options, "base objective price_per_second duration max_duration")
        task = with_cancel(load_task(options.task, **changes, **given_limits(options)), options)
    directory = output_directory(options, task.name, task.source)
    return Asked(task, task.name, directory, digest_of(task.source, options))


def planned(one: Asked, options: Namespace, executor: Executor | None) -> Report:
    """Plan one task; where there is no plan, the report says why."""
    try:
        with (
            naming_options("rise_time", "sensitivities", "drive_profile"),
            progress_bar(one.task) as progress,
        ):
            same = "drive_profile starts seed jobs controller rate rise_time time_scale sensitivities method "
            same += "seconds"
            plan = plan_task(
                one.task,
                **taken(options, same),
                stops=options.stop_safe,
                largest_uncertainty=options.largest_tolerance,
                executor=executor,
                figures=not options.no_figures,
                progress=progress,
                stage=progress.stage,
            )
    except NoPlanError as error:
        return _no_plan(one.task, error)
    gate = gate_of(options, plan)
    if options.bag:
        plan.save_bag(options.bag)
    how = not options.no_figures, options.effort, one.digest, options.bag
    return PlanReport(plan, one.directory, *how, **gate)


def _no_plan(task: Task, error: NoPlanError) -> Answer:
    """Why, how much of the tolerance a motion can have if asked for, what is wrong without stops."""
    tolerance, lines = task.limits.tolerance, []
    if error.largest is not None:
        lines.append(("largest", f"{error.largest}"))
    if (plan := error.without_stops) is not None:
        plain = f"the plan without stops, {plan.energy:.1f} J in {plan.duration:.3f} s"
        lines.append(("stops", f"{plain}: {'; '.join(map(sentence, error.broken))}"))
    if not task.is_cycle:
        tolerance = tolerance.of(task.robot.payload)
    if error.cancels:
        lines.append(("cancels", error.cancels))
    if tolerance.given:
        lines.append(("within", f"{tolerance}; --tolerance none plans for the nominal model"))
    if not task.is_cycle:
        lines.append(("masses", masses(task.robot)))
    return Answer(summary(f"{task.name}: NO VERIFIED PLAN. {error}", lines, []), error.to_dict(), yes=False)


def progress_bar(task: Task) -> Progress:
    """Bar that shows the minimum cost so far."""
    unit = task.objective.unit
    best = f"best{' of this segment' * task.is_cycle} {{:.{3 if unit == 's' else 1}f}} {unit}"
    first = "comparing postures ..." if task.is_cycle else "checking the task, building the program ..."
    what = "starts" if task.is_cycle else "search steps"
    return Progress(sys.stderr, first, "no verified plan yet", best, what)
