"""`ocptip.plan`: the motion of minimum cost that keeps all limits, with all that is known about it."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np

from ocptip.api.inputs.motion_requirements import motion_outcomes
from ocptip.api.inputs.requirements import Outcome
from ocptip.api.methods import (
    ALONG_PATH,
    Ask,
    Method,
    Runner,
    better_smoothed,
    executed,
    of_segments,
    prepared,
    searched,
)
from ocptip.api.tasks import TaskLike, load_task
from ocptip.basics.errors import InputError, PlanningError, positive_number
from ocptip.basics.outputs import remove_figures
from ocptip.basics.write import plain
from ocptip.certificate.checks import certified
from ocptip.motion.check import check_motion
from ocptip.motion.cycles.check import CycleCheck, check_cycle, cycle_check, with_rises
from ocptip.motion.cycles.task import Task, refuse_driving, refuse_objects
from ocptip.motion.files.execution import Execution
from ocptip.motion.files.plan_files import (
    planned_to_dict,
    run_by,
    samples_joined,
    save_bag,
    task_samples,
    write_plan,
)
from ocptip.motion.largest_tolerance import LargestTolerance, largest_tolerance, too_much_at_rest
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.multi_start import ToleranceError
from ocptip.motion.plan import plan_motion
from ocptip.motion.planner.random_start import SLOWER
from ocptip.motion.stops.cancels import SafeDecelerations
from ocptip.motion.stops.check import (
    Stops,
    cancels_by_segment,
    cancels_to_dict,
    stops_by_segment,
    stops_to_dict,
)
from ocptip.motion.summary import STOPS, CheckedMotion, brief
from ocptip.motion.task import MotionTask
from ocptip.motion.tolerated import robustness
from ocptip.motion.violations import sentence, stated
from ocptip.numerics.time_limit import TimeBudget
from ocptip.pictures.plan import draw_plan
from ocptip.pictures.plan_curves import seen_plan
from ocptip.pictures.stops import draw_stops
from ocptip.retiming import among
from ocptip.standing.at_rest.sensitivity import Reserves, Sensitivity, motion_sensitivities
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.within.in_motion import worst_contacts
from ocptip.standing.within.worst_case import WorstCase
from ocptip.trajectories.trajectory import Trajectory

SPACING = 0.01
"""s, between the instants of sensitivities."""

Progress = Callable[[int, int, float | None], None]


@dataclass(frozen=True, eq=False, repr=False)
class Plan(CheckedMotion):
    """A planned motion, or cycle, as it is run, and all that is known about it.

    Attributes:
        planned: result of the search: commands, starts, seed. Of a cycle `parts` has one per segment.
        executions: what runs the motion of each segment; a motion has one segment.
        time_scale: factors with the checks of the plan run that much slower.
        price: what stops cost, plain data; empty: they cost nothing, or were not asked for.
        cancels: safe decelerations of a cancelled controller, by the name of the segment; empty: `stops` has
            them, or the robot is no arm.
    """

    command: ClassVar[str] = "plan"
    planned: MotionPlan
    executions: tuple[Execution, ...]
    time_scale: tuple[tuple[float, CycleCheck], ...] = ()
    price: Mapping[str, Any] = field(default_factory=dict)
    cancels: Mapping[str, SafeDecelerations] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        planned: MotionPlan,
        *,
        controller: Runner = "ramps",
        rate: float | None = None,
        rise_time: float | None = None,
        time_scale: Sequence[float] = (),
        sensitivities: bool = False,
        stage: Callable[[str], None] | None = None,
        budget: TimeBudget | None = None,
        smooth: bool = False,
    ) -> Plan:
        """Run, prove and check what was planned; arguments are those of :func:`plan`.

        Args:
            smooth: smooth the path of a plan along one, and take the better of both motions.
        """
        task, say, budget = planned.finished, stage or silent, budget or TimeBudget(None)
        say("proving what is run ...")
        run = partial(executed, controller=controller, rate=rate, rise_time=rise_time, budget=budget)
        executions = run(planned)
        if smooth:
            say("smoothing the path ...")
            planned, executions = better_smoothed(planned, executions, run, budget)
        motion = run_by(planned, executions)
        checked = with_rises(task, motion, cycle_check(task, motion, [run.check for run in executions]))
        pairs = zip(executions, checked.segments, strict=True)
        say("checking stops and cancels ...")
        stops, cancels = dict[str, Stops](), dict[str, SafeDecelerations]()
        if any(segment.task.limits.stoppable for segment in task.segments):
            stops = budget.within(partial(stops_by_segment, task, motion, checked), stops, STOPS)
        say("finding which deviations lose no contact ...")
        robust = budget.within(partial(robustness, task, motion), (), "robustness")
        scaled = budget.within(
            lambda: tuple((f, check_cycle(task, planned.motion.time_scaled(f))) for f in time_scale),
            (),
            "time scales" * bool(time_scale),
        )
        if STOPS not in budget.left_out and not any(own.decelerations for own in stops.values()):
            compute = partial(cancels_by_segment, task, motion)
            cancels = budget.within(compute, cancels, "safe decelerations of cancels")
        changes: tuple[Sensitivity, ...] = ()
        if sensitivities:
            compute = partial(sensitivities_of, task.segments[0].task, motion.segments[0])
            changes = budget.within(compute, changes, "sensitivities")
        return cls(
            planned,
            tuple(replace(run, check=own) for run, own in pairs),
            scaled,
            cancels=cancels,
            task=planned.task,
            checked=checked,
            robustness=robust,
            stops=stops,
            sensitivities=changes,
            left_out=tuple(budget.left_out),
        )

    @property
    def motion(self) -> Trajectory:
        """The executed motion; of a cycle the motions of the segments and the rests between them."""
        return run_by(self.planned, self.executions)

    @property
    def verified(self) -> bool:
        """Everything is planned, and what is run keeps all limits, stops included where asked for."""
        run = all(one.verified for one in self.executions)
        return self.planned.complete and run and super().verified

    def require(self, text: str) -> tuple[Outcome, ...]:
        """Return which requirements the plan meets; see `ocptip.api.check.Check.require`."""
        return motion_outcomes(self, text)

    def save_bag(self, path: str | os.PathLike[str]) -> None:
        """Write the executed motion and its margins over time as a bag, see `motion.files.plan_files`."""
        save_bag(self.task, self.motion, path)

    def __repr__(self) -> str:
        """Verdict, duration and energy, margins, robustness."""
        return brief(self.task.name, self)

    def to_dict(self) -> dict[str, Any]:
        """The content of plan.json, plain data for strict JSON."""
        return {**planned_to_dict(self.planned, self.executions, self.checked), **plain(self._entries())}

    def _entries(self) -> dict[str, Any]:
        """The entries of plan.json beside the plan."""
        source = self.task.source
        base = source.data.get("base") if source and "case" in source.data else None
        rows = [{"factor": f, **checked.to_dict()} for f, checked in self.time_scale]
        changes = [one.to_dict() for one in self.sensitivities]
        stops = stops_to_dict(self.task, self.stops)
        if self.price and self.task.is_cycle:
            stops["price_of_stops"] = self.price
        elif self.price:
            stops["stops"]["price"] = self.price
        return {
            **({"base": base} if base else {}),
            "margins": [one.to_dict() for one in self.margins],
            "tolerated": [one.to_dict() for one in self.robustness],
            **({"time_scale": rows} if rows else {}),
            **stops,
            **cancels_to_dict(self.task, self.cancels),
            **({"sensitivities": changes} if changes else {}),
            **({"left_out": list(self.left_out)} if self.left_out else {}),
        }

    def save(
        self, folder: str | os.PathLike[str], *, figures: bool = True, effort: bool = False
    ) -> list[Path]:
        """Write plan.json, motion.csv, trajectory.json, certificates, the task, and figures into a folder.

        Args:
            folder: made if it does not exist; the one above it must. Files of an earlier plan are replaced.
            figures: also draw them.
            effort: write joint torques into trajectory.json.

        Returns:
            The paths.

        Raises:
            InputError: the folder holds files that ocptip did not write and would replace.
            OSError: a file cannot be written; names it.
        """
        return list(self.write(folder, figures=figures, effort=effort))

    def write(
        self,
        folder: str | os.PathLike[str],
        *,
        figures: bool = True,
        effort: bool = False,
        extra: Mapping[str, Any] | None = None,
    ) -> Iterator[Path]:
        """Write the files and yield each path when its file is complete; `extra` replaces entries of
        plan.json.
        """
        folder, motion = Path(folder), run_by(self.planned, self.executions)
        samples = task_samples(self.task, motion)
        entries = {**self._entries(), **(extra or {})}
        how = {"executions": self.executions, "samples": samples, "effort": effort, "extra": entries}
        yield from write_plan(folder, self.planned, **how)
        remove_figures(folder, self.command)
        if not figures:
            return
        yield from draw_plan(folder, seen_plan(self.task, motion, self.checked), samples_joined(samples))
        for stops in () if self.task.is_cycle else self.stops.values():
            yield from draw_stops(folder, stops)


class NoPlanError(PlanningError):
    """The search ended without a verified motion; the message says how near it came.

    Attributes:
        task: that was planned.
        without_stops: the plan of the same task that need not be stopped; None: none, or not asked for.
        broken: the limits which that one breaks in stops.
        largest: the largest uncertainty with which there is a motion; None: not asked for.
        cancels: which decelerations are safe in a slow motion, and what helps; empty: not asked for.
    """

    largest: LargestTolerance | None = None
    broken: tuple[Worst, ...] = ()
    cancels: str = ""

    def __init__(self, message: str, task: Task, without_stops: MotionPlan | None = None) -> None:
        super().__init__(message)
        self.task, self.without_stops = task, without_stops
        if without_stops is not None:
            self.broken = check_motion(task.robot, without_stops.motion, task.limits).violations

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        data = {"case": self.task.name, "verified": False, "status": f"{self}"}
        data |= self.task.robot.masses_to_dict()
        if (plan := self.without_stops) is not None:
            costs = {"energy_J": plan.energy, "duration_s": plan.duration}
            data["without_stops"] = {**costs, "violations": stated(self.broken)}
        if self.cancels:
            data["cancels"] = self.cancels
        if self.largest is not None:
            data["largest_tolerance"] = self.largest.to_dict()
        return data


def plan(
    task: TaskLike,
    *,
    starts: int = 8,
    seed: int = 0,
    jobs: int | None = 1,
    executor: Executor | None = None,
    controller: Runner = "ramps",
    rate: float | None = None,
    rise_time: float | None = None,
    time_scale: Sequence[float] = (),
    stops: Ask | None = None,
    sensitivities: bool = False,
    largest_uncertainty: bool = False,
    method: Method | None = None,
    seconds: float | None = None,
    progress: Progress | None = None,
    stage: Callable[[str], None] | None = None,
) -> Plan:
    """Plan the motion, or the cycle, of minimum cost that keeps all limits; check and prove what is run.

    The result depends on the task, `starts` and `seed` only, not on where the starts run.

    Example::

        plan = ocptip.plan("A", starts=4)
        plan.save("plan-A")

    Args:
        task: from :func:`ocptip.load_task`, or what that takes.
        starts: number of random starts, of a cycle per segment.
        seed: of the random starts.
        jobs: number of processes; None: one per core, then a script needs `if __name__ == "__main__":`.
        executor: runs the starts instead: any executor of `concurrent.futures`.
        controller: what runs the motion: `"ramps"`, "linear", "cubic" or "quintic". The verdict is about
            that.
        rate: points per second for the controller; default 100, for "linear" 500.
        rise_time: s, within which accelerations rise; default: that of the task, else the planner chooses.
        time_scale: factors; the check is repeated with all times multiplied by each.
        stops: plan so that limits also hold in stops along the path, by brakes, both, by a cancelled
            controller, or all; "given": both where brake torques are given.
        sensitivities: say what changes of masses and contacts would do.
        largest_uncertainty: where there is no plan, search the largest uncertainty that has one.
        method: "direct" searches velocity profiles from start to goal, "path" times a path among obstacles
            (needs OMPL), "smooth" also smooths it and takes the better motion; None: what suits the task,
            and with `seconds` paths are smoothed.
        seconds: of wall time for search and checks. The search takes most of it; the best verified motion
            until then is the plan. Checks and proofs that are not complete at the end are left out, see
            `left_out`.
        progress: called as progress(done, steps, minimum cost of a verified plan so far or None).
        stage: called with what is done after the search.

    Raises:
        InputError: the task cannot be planned (with all reasons), or an argument cannot be used.
        NoPlanError: no start gave a verified plan.
    """
    single = {"rate": rate, "seconds": seconds}
    given = {name: [value] for name, value in single.items() if value is not None}
    for name, numbers in {"time_scale": time_scale, **given}.items():
        for number in numbers:
            positive_number(name, number)
    task = prepared(load_task(task), controller, rise_time, stops)
    refuse_objects(task, *["sensitivities"] * sensitivities)
    refuse_driving(task, *["sensitivities"] * sensitivities)
    if task.is_cycle and sensitivities:
        raise InputError("sensitivities: not for cycles")
    if (alone := base_alone(task)) and stage:
        stage(f"{alone}: perhaps there is no plan ...")
    how = {"starts": starts, "seed": seed, "jobs": jobs, "executor": executor}
    budget, search = (TimeBudget(limit) for limit in _limits(seconds))
    if controller == "quintic":
        if method in ALONG_PATH:
            raise InputError(
                "method: motions along a path have acceleration steps, which quintics cannot run"
            )
        method = "direct"
    try:
        direct = partial(plan_motion, task, progress=progress, prove=certified, stage=stage, **how)
        if task.is_cycle:
            direct = partial(direct, segment=of_segments(method, seed, stage or silent))
        planned = _searched(task, method, budget, search, direct, seed, stage or silent)
    except PlanningError as error:
        other = None if task.is_cycle else _without_stops(task, how, budget)
        refusal = NoPlanError("; ".join(filter(None, (f"{error}", alone))), task, other)
        if not task.is_cycle and task.segments[0].task.limits.cancel is not None:
            (stage or silent)("finding which cancels a slow motion allows ...")
            refusal.cancels = budget.within(partial(_cancels, task), "")
        if isinstance(error, ToleranceError) and largest_uncertainty:
            largest = partial(_largest, cast(MotionTask, task), error, how, stage)
            refusal.largest = budget.within(largest, None)
        raise refusal from error
    except InputError:
        asked = largest_uncertainty and not task.is_cycle
        error = too_much_at_rest(cast(MotionTask, task)) if asked else None
        if error is None:
            raise
        refusal = NoPlanError(f"{error}", task)
        refusal.largest = _largest(cast(MotionTask, task), error, how, stage)
        raise refusal from error
    except KeyboardInterrupt:
        what = "a segment had" if task.is_cycle else "there was"
        raise KeyboardInterrupt(f"before {what} a verified plan") from None
    along_path = planned.options.get("method") == "path"
    known = {"controller": controller, "rate": rate, "rise_time": rise_time, "time_scale": time_scale}
    smooth = along_path and (method == "smooth" or (method is None and budget.given))
    how_run = {"sensitivities": sensitivities, "stage": stage, "budget": budget, "smooth": smooth}
    found = Plan.of(planned, **known, **how_run)
    if along_path or not any(one.task.limits.stoppable for one in task.segments):
        return found
    if stage:
        stage("planning without stops, to compare the cost ...")
    price = price_of_stops(planned, _without_stops(task, how, budget))
    return replace(found, price=price, left_out=tuple(budget.left_out))


def _limits(seconds: float | None) -> tuple[float | None, float | None]:
    """Time limits, s, of the search with the checks, and of the search; files are written after both."""
    if seconds is None:
        return None, None
    return seconds - min(5.0, 0.05 * seconds), max(0.7 * seconds, seconds - 120.0)


def base_alone(task: Task) -> str:
    """The limits that a base breaks while the arm rests at its start, and at its goal.

    Empty where one of both keeps them, or the base rests.
    """
    own, end, found = task.segments[0].task, task.robot.acts.end, []
    limits = replace(own.limits, min_duration=0.0, max_duration=math.inf)
    for name, q in (("start", own.start), ("goal", own.goal)) if end else ():
        held = Trajectory.from_points(np.array([0.0, end]), np.tile(q, (2, 1)))
        if not (broken := check_motion(own.robot, held, limits).violations):
            return ""
        found.append(f"{name}: {sentence(broken[0])}")
    alone = "the base alone, its arm at rest, breaks limits: at the "
    return alone + "; at the ".join(found) if found else ""


def silent(text: str) -> None:
    """Show nothing, where nobody wants to know what is done next."""


def _searched(
    task: Task,
    method: Method | None,
    budget: TimeBudget,
    search: TimeBudget,
    direct: Callable[[], MotionPlan],
    seed: int,
    say: Callable[[str], None],
) -> MotionPlan:
    """The plan of a search; where that has none in its time, or for cancels or objects, a slow motion."""
    try:
        return searched(task, method, search, direct, seed, say)
    except PlanningError as error:
        hard = (
            budget.given or task.segments[0].task.limits.cancel is not None or len(task.robot.interfaces) > 1
        )
        if method is not None or task.is_cycle or not hard or isinstance(error, ToleranceError):
            raise
        say(f"{error}")
        say("checking a slow motion of all joints in step ...")
        slow = budget.within(partial(among.slow_plan, cast(MotionTask, task), seed=seed), None, "slow motion")
        if slow is None:
            why = "could not be checked in the time" if budget.left_out else "breaks limits"
            raise PlanningError(f"{error}; a slow motion of all joints in step {why}") from error
        return slow


def _without_stops(task: Task, how: Mapping[str, Any], budget: TimeBudget) -> MotionPlan | None:
    """The plan that need not be stopped, of as many starts; None: not asked for, no time, or none."""
    if not any(segment.task.limits.stoppable for segment in task.segments):
        return None
    try:
        plain_task = task.each(lambda own: replace(own, limits=own.limits.without_stops))
        return budget.within(partial(plan_motion, plain_task, **how), None, "cost of stops")
    except PlanningError:
        return None


def _cancels(task: Task) -> str:
    """Which decelerations are safe in the slowest synchronised default motion, and what helps."""
    own, slowest = task.segments[0].task, SLOWER[-1]
    rates = own.robot.limits.speed / slowest, own.robot.limits.acceleration / slowest**2
    motion = Trajectory.ending_together(own.start, own.goal, [None] * own.robot.n, *rates)
    found = cancels_by_segment(task, motion).get("")
    if found is None:
        return ""
    text = f"even slowly, joints in step from start to goal in {motion.end:.3g} s: {found.text}"
    if found.minimum is not None:
        return f"{text}. Plan with --deceleration in that range"
    if len(own.robot.interfaces) > 1:
        text += (
            ". Joints that stop one by one tilt what objects stand on: plan with --stop-safe path, and let "
        )
        return f"{text}the controller stop along the path"
    return text


def price_of_stops(plan: MotionPlan, without: MotionPlan | None) -> dict[str, Any]:
    """Additional cost of a plan that may be stopped; without: the plan that need not, None: there is none."""
    if without is None:
        return {}
    objective = plan.task.segments[0].task.objective
    costs = {"energy_J": without.energy, "duration_s": without.duration}
    pairs = {
        "energy_more": (plan.energy, without.energy),
        "duration_more": (plan.duration, without.duration),
        "cost_more": tuple(objective.cost(one.energy, one.duration) for one in (plan, without)),
    }
    more = {name: round(own / other - 1, 6) + 0.0 for name, (own, other) in pairs.items()}
    return {"without_stops": costs, "objective": objective.name, **more}


def _largest(
    task: MotionTask, error: ToleranceError, how: Mapping[str, Any], stage: Callable[[str], None] | None
) -> LargestTolerance:
    others = {name: value for name, value in how.items() if name != "starts"}
    return largest_tolerance(task, error, **others, stage=stage)


def sensitivities_of(task: MotionTask, motion: Trajectory) -> tuple[Sensitivity, ...]:
    """The effects of changes on the margins of a motion; within an uncertainty in its worst case."""
    times, tolerance = motion.both_sides(SPACING), task.limits.tolerance.of(task.robot.payload)

    def worst(robot: StandingMechanism, speed: float) -> Reserves:
        counts = tolerance.heavier(robot.support.mass - task.robot.support.mass)
        faster = motion.time_scaled(1 / speed)
        found = worst_contacts(WorstCase(robot, counts), faster, times / speed)
        tip, slip, force = found["tip"], found["slip"], found["alike"] or found["foot_force"]
        least, reference = force.value if force else np.nan, robot.tip_over.reference_moment
        return Reserves.of(tip.value if tip else 0.0, slip.value, least, reference, slip.factor)

    return motion_sensitivities(task.robot, *motion.states(times), worst if tolerance.given else None)
