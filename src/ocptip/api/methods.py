"""How a motion is searched, directly or along a path among obstacles; and what runs it then."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from typing import Any, Literal, cast

import numpy as np

from ocptip.basics.errors import InputError, InputWarning, PlanningError, SolverError
from ocptip.basics.interrupts import TimeIsUpError
from ocptip.basics.text import quantity
from ocptip.certificate.checks import certified
from ocptip.motion.choices import NEARLY, line_overlap
from ocptip.motion.cycles.task import Task
from ocptip.motion.files.execution import Execution, execute, slower_to_prove
from ocptip.motion.motion_plan import TIME_IS_UP, MotionPlan
from ocptip.motion.multi_start import ToleranceError
from ocptip.motion.plan import SegmentSearch
from ocptip.motion.stops.rules import Kinds
from ocptip.motion.task import MotionTask
from ocptip.numerics.time_limit import TimeBudget, interrupted_after
from ocptip.retiming import among
from ocptip.trajectories.controllers import Controller
from ocptip.trajectories.velocity_profiles import checked_rise_times

Method = Literal["direct", "path", "smooth"]

ALONG_PATH: tuple[Method, ...] = ("path", "smooth")
"""Methods that time a path among obstacles; the second one smooths it then."""

_FIRST = 0.6  # of the time, for a method after which another one follows

FEW_STATES = 40_000
"""Tested states of the search for a path of a segment that a cycle may do without, at most."""

Runner = Controller | Literal["ramps"]
"""The executor of a motion: a controller that interpolates between points, or `"ramps"`: drives that are
commanded with trapezoidal velocity profiles.
"""

Ask = Kinds | Literal["given"]
"""Stops of these kinds, or of those that the task gives brake torques for."""

RISE_TIME = 0.02
"""s, for controllers that need one and where none is asked for."""
FOR_PROOFS = 0.8
"""Share of the time left that proofs may take; robustness and figures follow."""
SLOWER_ALONG_PATH = 1.004
"""Factor of the times of a timed path that is tried first; cubics between points then keep the limits."""


def searched(
    task: Task,
    method: Method | None,
    whole: TimeBudget,
    budget: TimeBudget,
    direct: Callable[..., MotionPlan],
    seed: int,
    say: Callable[[str], None],
) -> MotionPlan:
    """The plan of the first method that gives a verified motion; with objects, or safe when cancelled, at
    least as good as the timed straight line. Where no method has one, see `_or_slow`.

    Args:
        task: of a motion or a cycle.
        method: the only one that is tried; None: those that suit the task, see `methods_for`.
        whole: time of the search with the checks after it.
        budget: time of the search.
        direct: the direct search, called with the cost `known` of a motion that is verified already.
        seed: of the search for a path.
        say: called with what is done next, and why a method before gave nothing.

    Raises:
        InputError: the task cannot be planned, or not by this method.
        PlanningError: no method gave a verified motion.
    """
    if task.is_cycle and method == "smooth":
        raise InputError("method: smooth is for single motions, not for cycles")
    if method in ALONG_PATH and not task.robot.collision.labels:
        raise InputError(f"method: {method} needs collision geometry; there is none")
    methods = methods_for(task, budget.given) if method is None else (method,)
    if task.is_cycle:  # its segments share the time
        return direct()

    def search(known: float = math.inf) -> MotionPlan:
        return _searched(task, method, methods, budget, partial(direct, known=known), seed, say)

    return search() if method else _or_slow(cast(MotionTask, task), search, whole, seed, say)


def _searched(
    task: Task,
    method: Method | None,
    methods: tuple[Method, ...],
    budget: TimeBudget,
    direct: Callable[..., MotionPlan],
    seed: int,
    say: Callable[[str], None],
) -> MotionPlan:
    """See `searched`, of a motion."""
    try:
        motion_plan = _first_of(methods, task, budget, direct, seed, say)
        if method is not None:
            return motion_plan
        carries = bool(task.robot.carried)
        cancelled = task.segments[0].task.limits.cancel is not None and not motion_plan.motion.rise_times
        if not carries and not cancelled:  # timings know no other stops
            return motion_plan
        why = ", which keeps objects as level as start and goal" if carries else ", to compare"
        say(f"timing the straight line{why} ...")
        try:
            with interrupted_after(budget.left):
                return among.no_worse_than_line(motion_plan)
        except KeyboardInterrupt:
            say("interrupted; the plan without the line is kept")
            return motion_plan
    except ToleranceError:
        raise
    except PlanningError as error:
        more = " (without --method, the direct method is tried as well)" if method == "path" else ""
        if budget.given and not budget.left and set(methods) != {"direct"}:  # which says so itself
            more += "; more --seconds may help"
            if method is None and "path" in methods:
                more += ", or --method path, which gets all of the time"
        raise PlanningError(f"{error}{more}") from error


def of_segments(method: Method | None, seed: int, say: Callable[[str], None]) -> SegmentSearch:
    """The search of a segment of a cycle, for `plan_motion`; arguments are those of `searched`.

    Without a method a path is searched where the direct search fails, for motions along paths cost more, and
    where the straight line overlaps far. There it comes first, and alone and not for long as long as the
    cycle may do without this segment.
    """

    def search(
        task: MotionTask, direct: Callable[..., MotionPlan], budget: TimeBudget, needed: bool
    ) -> MotionPlan:
        first: Method = method or "direct"
        methods: tuple[Method, ...] = (first,)
        if method is None and task.robot.collision.labels and find_spec("ompl") is not None:
            methods = methods_for(task, budget.given)
            if "path" not in methods:
                methods = ("direct", "path")
        if not needed and methods[0] == "path" and line_overlap(task)[0] > NEARLY:
            methods = ("path",)
        states = among.MOST_STATES if needed else FEW_STATES

        def begin(known: float = math.inf) -> MotionPlan:
            return _first_of(methods, task, budget, partial(direct, known=known), seed, say, states)

        return begin() if method else _or_slow(task, begin, budget, seed, say)

    return search


def _or_slow(
    task: MotionTask,
    search: Callable[[float], MotionPlan],
    budget: TimeBudget,
    seed: int,
    say: Callable[[str], None],
) -> MotionPlan:
    """The plan of a search; where that has none in its time, or for cancels or objects, a slow motion.

    A slow motion that was checked before the search is also the plan where an interrupt ends the search
    before it has one, and where it costs less.

    For cancels, and with a time limit for objects, the slow motion is checked before the search, which may be
    long. Where even that one is not safe when cancelled, a search without a time limit does not begin: a stop
    decelerates as hard from a slow motion as from a fast one.
    """
    cancelled, carries, slow = task.limits.cancel is not None, bool(task.robot.carried), None

    def slow_motion(share: float) -> MotionPlan | None:
        say("checking a slow motion of all joints in step ...")
        with suppress(TimeIsUpError), interrupted_after(share * budget.left):
            return among.slow_plan(task, seed=seed)
        return None

    if cancelled or (carries and budget.given):
        try:
            slow = slow_motion(0.7)  # any plan is better than none
        except PlanningError as error:
            if cancelled and not budget.given:
                more = "with --method direct other motions are searched, which may take long"
                raise PlanningError(f"{error}; {more}") from None
    known = math.inf if slow is None else task.objective.cost(slow.energy, slow.duration)
    out_of_time = {TIME_IS_UP: ""} if budget.given else {}
    try:
        if slow is not None and slow.interrupted:
            return slow
        plan = search(known)
        if slow is None or task.objective.cost(plan.energy, plan.duration) <= known:
            return plan
        out_of_time = {name: text for name, text in plan.options.items() if name == TIME_IS_UP}
        return replace(slow, interrupted=plan.interrupted, options={**slow.options, **out_of_time})
    except KeyboardInterrupt:
        if slow is None:
            raise
        return replace(slow, interrupted=True)
    except PlanningError as error:
        if slow is None and (carries or budget.given) and not isinstance(error, ToleranceError):
            say(f"{error}")
            try:
                slow = slow_motion(1.0)
            except PlanningError as of_slow:
                raise PlanningError(f"{error}; {of_slow}") from None
            if slow is None:
                more = "a slow motion of all joints in step could not be checked either: give more time"
                raise PlanningError(f"{error}; {more}") from None
        if slow is None:
            raise
        if slow.interrupted:  # by hand
            return slow
        return replace(slow, interrupted=budget.given, options={**slow.options, **out_of_time})


def _first_of(
    methods: tuple[Method, ...],
    task: Task,
    budget: TimeBudget,
    direct: Callable[..., MotionPlan],
    seed: int,
    say: Callable[[str], None],
    states: int = among.MOST_STATES,
) -> MotionPlan:
    failed: list[str] = []
    for name in methods:
        share = 1.0 if name == methods[-1] else _FIRST  # of the time left
        if failed:
            say(failed[-1])
        if name in ALONG_PATH:
            say("searching and timing a path ...")
        seconds = share * budget.left
        try:
            end = time.perf_counter() + seconds
            with interrupted_after(seconds):
                if name == "direct":
                    return direct()
                how = {"seed": seed, "deadline": end, "states": states}
                return among.plan_along_path(cast(MotionTask, task), **how)
        except TimeIsUpError as stop:
            if not budget.given:  # it was the time of a search around this one
                raise
            ended = f"{name} method: no verified motion in the given time, {seconds:.3g} s"
            failed.append(f"{ended}; {stop}".removesuffix("; "))
        except ToleranceError:
            raise
        except PlanningError as error:
            failed.append(f"{name} method: {error}" if failed else f"{error}")
        except SolverError as error:
            failed.append(f"{name} method: no verified motion, a solver failed: {error}")
    raise PlanningError("; ".join(failed))


def methods_for(task: Task, limited: bool = False) -> tuple[Method, ...]:
    """The methods that suit a task, the more promising one first; both where the time is limited.

    Among obstacles the direct search succeeds only near the straight line, and may take long to fail: where
    much overlaps on that line, or the time is limited, a path comes first. A warning says where a path is
    needed and OMPL is missing.
    """
    if task.is_cycle or not task.robot.collision.labels:
        return ("direct",)
    overlap, between = line_overlap(cast(MotionTask, task))
    if overlap <= 0 and not limited:
        return ("direct",)
    if find_spec("ompl") is not None:
        floors = {name for name, *_ in task.robot.collision.floors}
        obstacles = any(solid.name not in floors for solid in task.robot.obstacles)
        hard = overlap > 0 or obstacles if limited else overlap > NEARLY
        return ("path", "direct") if hard else ("direct", "path")
    if overlap <= 0:
        return ("direct",)
    text = (
        f"on the straight line from start to goal, {between} overlap by {quantity(1e3 * overlap, 'mm', 3)}; "
    )
    text += "a path around needs OMPL (pip install 'ocptip[paths]')"
    warnings.warn(InputWarning(f"{task.name}: {text}"), stacklevel=3)
    return ("direct",)


def prepared(task: Task, controller: Runner, rise_time: float | None, stops: Ask | None) -> Task:
    """The task whose plans suit the controller, and keep their limits in the stops asked for."""
    if stops:
        kinds = None if stops == "given" else stops
        task = task.each(
            lambda segment: replace(segment, limits=segment.stops.safe(segment.limits, segment.robot, kinds))
        )
    for segment in task.segments:
        if segment.task.limits.cancel is not None and segment.task.limits.cancel.together:
            raise InputError("stop_safe: stopj is checked, not planned for; give a deceleration per joint")
    if task.is_cycle:
        if rise_time is not None and controller != "quintic":
            raise InputError("rise_time: cycles have trapezoidal profiles; only for --controller quintic")
        return task
    if rise_time is not None:
        task = replace(task, rise_times=checked_rise_times(rise_time, task.robot.n))
    rises = cast(MotionTask, task).rise_times or (0.0,)
    limited = np.isfinite(cast(MotionTask, task).limits.jerks(task.robot.limits)) & (np.array(rises) == 0)
    if rise_time is not None and limited.any():
        names = ", ".join(task.robot.names[j] for j in np.flatnonzero(limited))
        raise InputError(f"rise_time: 0 exceeds any jerk limit, and joints {names} have one; leave it out")
    if controller == "quintic" and not all(cast(Sequence[float], rises)):
        if rise_time is not None:
            raise InputError(f"rise_time: must be > 0 for --controller quintic, got {rise_time:g}")
        task = replace(task, rise_times=RISE_TIME)
    return task


def executed(
    planned: MotionPlan,
    *,
    controller: Runner,
    rate: float | None,
    rise_time: float | None,
    budget: TimeBudget,
    begin: Callable[..., Callable[[], Any]] = partial,
) -> list[Execution]:
    """What runs each segment, without a proof; see `proved_runs`. `begin` is as of `calls_begun`."""
    step, executions = None if rate is None else 1 / rate, list[Execution]()
    for part in planned.parts:
        robot, motion, limits = part.task.robot, part.motion, part.task.limits
        if planned.task.is_cycle and controller == "quintic":  # segments are planned as ramps
            least = rise_time or RISE_TIME  # jerk limits may ask for more
            motion = motion.with_rise_times(np.maximum(motion.rise_times or 0.0, least))
        along_path = motion.timing is not None  # no drive runs that as it is
        if controller == "ramps" and not along_path:
            run = Execution.of_drives(robot, motion, limits, part.check, budget, begin)
        else:
            runner = cast(Controller, "cubic" if controller == "ramps" else controller)
            first = SLOWER_ALONG_PATH if along_path else 1.0
            run = execute(robot, motion, limits, runner, step=step, first=first)
        executions.append(run)
    return executions


def proved_runs(planned: MotionPlan, executions: list[Execution], budget: TimeBudget) -> list[Execution]:
    """What runs each segment, with its proof if there is time for it; segments share the time.

    Timings of paths are slower where that makes their proof complete. A proof that ran out of time is not
    begun again.
    """
    proved = list[Execution]()
    for part, run in zip(planned.parts, executions, strict=True):
        if run.check.proof_out_of_time:
            proved.append(run)
            continue
        prove = partial(certified, part.task.robot, run.motion, run.check, part.task.limits)
        without = replace(run.check, proof_out_of_time=run.check.certificate is None)
        share = FOR_PROOFS / (len(executions) - len(proved))
        run = replace(run, check=budget.within(prove, without, share=share))
        if part.motion.timing is not None:
            how = part.task.robot, part.motion, part.task.limits, run, certified
            run = budget.within(partial(slower_to_prove, *how), run, share=share)
        proved.append(run)
    return proved


def better_smoothed(
    planned: MotionPlan,
    executions: list[Execution],
    run: Callable[[MotionPlan], list[Execution]],
    budget: TimeBudget,
) -> tuple[MotionPlan, list[Execution]]:
    """The better of a plan along a path, with its execution, and of that along the smoothed path.

    One that is proved is not replaced by one that is not. Without time the plan stays as it is.
    """

    def smoother() -> tuple[MotionPlan, list[Execution]] | None:
        plan = among.smoothed_plan(planned)
        return None if plan is None else (plan, run(plan))

    objective, before = planned.task.segments[0].task.objective, executions[0].check
    result = budget.within(smoother, None)
    path = {**planned.options["path"], "smoothed": False}
    if result is not None:
        after = result[1][0].check
        costs = [objective.cost(one.energy, one.duration) for one in (before, after)]
        path["smoothed_costs_more"] = costs[1] / costs[0] - 1
        if after.verified and after.certified >= before.certified and costs[1] < costs[0]:
            planned, executions, path["smoothed"] = *result, True
    return replace(planned, options={**planned.options, "path": path}), executions
