"""`ocptip.plan`: the motion of minimum cost that keeps all limits, with all that is known about it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np

from ocptip.api.inputs.given import ProfileLike, driving
from ocptip.api.methods import (
    ALONG_PATH,
    Ask,
    Method,
    Runner,
    of_segments,
    prepared,
    searched,
)
from ocptip.api.results.plan import Plan
from ocptip.api.tasks import TaskLike, load_task
from ocptip.basics.errors import InputError, PlanningError, positive_number
from ocptip.basics.text import silent
from ocptip.motion.check import check_motion
from ocptip.motion.cycles.task import Task, refuse_driving, refuse_objects
from ocptip.motion.largest_tolerance import LargestTolerance, largest_tolerance, too_much_at_rest
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.multi_start import ToleranceError
from ocptip.motion.plan import FIRST, plan_motion
from ocptip.motion.planner.random_start import SLOWER
from ocptip.motion.stops.cancels import SafeDecelerations, in_all
from ocptip.motion.stops.check import (
    cancels_by_segment,
)
from ocptip.motion.task import MotionTask
from ocptip.motion.violations import sentence, stated
from ocptip.numerics.time_limit import TimeBudget
from ocptip.numerics.workers import processes
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.trajectories.trajectory import Trajectory

Progress = Callable[[int, int, float | None], None]


COST_OF_STOPS = "cost of stops"
"""Name of the comparison with a plan that need not be stopped, where it is left out."""


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
    drive_profile: ProfileLike | None = None,
    starts: int | None = None,
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
    figures: bool = False,
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
        drive_profile: how the base drives meanwhile, instead of as in the task, see :func:`ocptip.check`.
        starts: number of random starts; default 8, of a cycle 2 per segment: there later ones gain little.
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
        figures: also draw the figures of `save`, while other processes check and prove.
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
    task = prepared(driving(load_task(task), drive_profile), controller, rise_time, stops)
    starts = (FIRST if task.is_cycle else 8) if starts is None else starts
    refuse_objects(task, *["sensitivities"] * sensitivities)
    refuse_driving(task, *["sensitivities"] * sensitivities)
    if task.is_cycle and sensitivities:
        raise InputError("sensitivities: not for cycles")
    if (alone := base_alone(task)) and stage:
        stage(f"{alone}: perhaps there is no plan ...")
    budget, search = (TimeBudget(limit) for limit in _limits(seconds, task))
    if controller == "quintic":
        if method in ALONG_PATH:
            raise InputError(
                "method: motions along a path have acceleration steps, which quintics cannot run"
            )
        method = "direct"
    with processes(executor, 1 if budget.given else jobs, max(starts, 2)) as pool:
        how = {"starts": starts, "seed": seed, "jobs": jobs, "executor": pool}
        try:
            direct = partial(plan_motion, task, progress=progress, **how)
            if task.is_cycle:
                direct = partial(direct, segment=of_segments(method, seed, stage or silent), budget=search)
            planned = searched(task, method, budget, search, direct, seed, stage or silent)
        except PlanningError as error:
            other = None if task.is_cycle else _without_stops(task, how, budget)
            refusal = NoPlanError("; ".join(filter(None, (f"{error}", alone))), task, other)
            if any(segment.task.limits.cancel is not None for segment in task.segments):
                (stage or silent)("finding which cancels a slow motion allows ...")
                refusal.cancels = _cancels(task, budget)
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
        if planned.interrupted and pool is not executor:
            pool = None  # its processes may be busy with what the interrupt left
        known |= {"jobs": jobs, "executor": pool, "figures": figures, "stage": stage}
        known["sensitivities"] = sensitivities
        result = Plan.of(planned, **known, budget=budget, smooth=smooth)
        if along_path or not any(one.task.limits.stoppable for one in task.segments):
            return result
        if planned.stopped:
            return replace(result, left_out=(*result.left_out, COST_OF_STOPS))
        if stage:
            stage("planning without stops, to compare the cost ...")
        price = price_of_stops(planned, _without_stops(task, how, budget))
        return replace(result, price=price, left_out=tuple(budget.left_out))


def _limits(seconds: float | None, task: Task) -> tuple[float | None, float | None]:
    """Time limits, s, of the search with the checks, and of the search; files are written after both.

    Checks and proofs of stops take longer.
    """
    if seconds is None:
        return None, None
    stoppable = any(segment.task.limits.stoppable for segment in task.segments)
    share, most = (0.5, 240.0) if stoppable else (0.7, 120.0)
    return seconds - min(5.0, 0.05 * seconds), max(share * seconds, seconds - most)


def base_alone(task: Task) -> str:
    """The limits that a base breaks while the arm rests at its start, and at its goal.

    Empty where one of both keeps them, or the base rests.
    """
    segment_task, end, results = task.segments[0].task, task.robot.acts.end, []
    limits = replace(segment_task.limits, min_duration=0.0, max_duration=math.inf)
    for name, q in (("start", segment_task.start), ("goal", segment_task.goal)) if end else ():
        held = Trajectory.from_points(np.array([0.0, end]), np.tile(q, (2, 1)))
        if not (broken := check_motion(segment_task.robot, held, limits).violations):
            return ""
        results.append(f"{name}: {sentence(broken[0])}")
    alone = "the base alone, its arm at rest, breaks limits: at the "
    return alone + "; at the ".join(results) if results else ""


def _without_stops(task: Task, how: Mapping[str, Any], budget: TimeBudget) -> MotionPlan | None:
    """The plan that need not be stopped, of as many starts; None: not asked for, no time, or none."""
    if not any(segment.task.limits.stoppable for segment in task.segments):
        return None
    try:
        plain_task = task.each(lambda one_task: replace(one_task, limits=one_task.limits.without_stops))
        return budget.within(partial(plan_motion, plain_task, **how), None, COST_OF_STOPS)
    except PlanningError:
        return None


def _cancels(task: Task, budget: TimeBudget) -> str:
    """Which decelerations are safe in the slowest synchronised default motion of every segment."""
    safe, texts = list[SafeDecelerations](), list[str]()
    for k, segment in enumerate(task.segments):
        compute = partial(_cancels_slowly, segment.task)
        result = budget.within(compute, None, share=1 / (len(task.segments) - k))
        if result is None:
            texts.append(f"{segment.name}: not checked, the time was up" if task.is_cycle else "")
            continue
        safe.append(result[0])
        slowly = f"{segment.name}, even slowly, in {result[2]:.3g} s: {result[0].verdict}"
        texts.append(slowly if task.is_cycle else result[1])
    if task.is_cycle:
        texts += [in_all(safe)] if len(safe) == len(texts) else []
        texts += ["else plan with --stop-safe path, and let the controller stop along the path"]
    return "; ".join(filter(None, texts))


def _cancels_slowly(motion_task: MotionTask) -> tuple[SafeDecelerations, str, float] | None:
    """Which decelerations are safe in the slowest synchronised default motion, what helps, its duration."""
    slowest = SLOWER[-1]
    rates = motion_task.robot.limits.speed / slowest, motion_task.robot.limits.acceleration / slowest**2
    motion = Trajectory.ending_together(
        motion_task.start, motion_task.goal, [None] * motion_task.robot.n, *rates
    )
    result = cancels_by_segment(motion_task, motion).get("")
    if result is None:
        return None
    text = f"even slowly, joints in step from start to goal in {motion.end:.3g} s: {result.text}"
    if result.minimum is not None:
        return result, f"{text}. Plan with --deceleration in that range", motion.end
    if motion_task.robot.carried:
        text += (
            ". Joints that stop one by one tilt what objects stand on: plan with --stop-safe path, and let "
        )
        text += "the controller stop along the path"
    return result, text, motion.end


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
    more = {name: round(with_stops / other - 1, 6) + 0.0 for name, (with_stops, other) in pairs.items()}
    return {"without_stops": costs, "objective": objective.name, **more}


def _largest(
    task: MotionTask, error: ToleranceError, how: Mapping[str, Any], stage: Callable[[str], None] | None
) -> LargestTolerance:
    others = {name: value for name, value in how.items() if name != "starts"}
    return largest_tolerance(task, error, **others, stage=stage)
