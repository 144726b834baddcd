"""Plans a motion among obstacles: a path that is clear, timed so that all limits hold."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import cast

from ocptip.basics.errors import InputError, PlanningError
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.path_search import search_path
from ocptip.motion.path_smoothing import smoothed_path
from ocptip.motion.task import MotionTask
from ocptip.motion.violations import broken_words
from ocptip.retiming.retime import retime
from ocptip.trajectories.path_fit import FittedPath

NODES = 60
"""Intervals between nodes of the timing: 0.3 % of the duration, for a third of the time."""


def plan_along_path(task: MotionTask, *, seed: int = 0, deadline: float = math.inf) -> MotionPlan:
    """The motion along a path from a start to a goal of a task, as cheap or fast as its limits allow.

    Args:
        task: of which any pair of start and goal postures may be taken.
        seed: of the random search.
        deadline: of `time.perf_counter`, s, after which the search for a path ends.

    Raises:
        InputError: OMPL is not installed.
        PlanningError: there is no path, or no timing keeps all limits.
    """
    began = time.perf_counter()
    fit = search_path(task, seed=seed, deadline=deadline)
    searched = time.perf_counter() - began
    plan = _timed(task, fit, seed)
    options = {"method": "path", "path": {"made_of": fit.how, "searched_s": searched}}
    return replace(plan, seconds=time.perf_counter() - began, options=options)


def smoothed_plan(plan: MotionPlan, *, deadline: float = math.inf) -> MotionPlan | None:
    """The motion along a shorter and smoother path than that of a plan; None: there is none with all limits.

    Args:
        plan: of `plan_along_path`.
        deadline: of `time.perf_counter`, s, after which the path is smoothed no further.
    """
    began, task = time.perf_counter(), cast(MotionTask, plan.task)
    assert plan.motion.timing is not None  # it is along a path
    fit = smoothed_path(task, plan.motion.timing.path, deadline=deadline)
    if fit is None:
        return None
    try:
        smoother = _timed(task, fit, plan.seed)
    except PlanningError:
        return None
    return replace(smoother, seconds=plan.seconds + time.perf_counter() - began, options=plan.options)


def _timed(task: MotionTask, fit: FittedPath, seed: int) -> MotionPlan:
    """The plan along a path.

    Raises:
        PlanningError: no timing keeps all limits.
    """
    try:
        timed = retime(task.robot, fit.path, task.limits, task.objective, nodes=NODES)
    except InputError as error:
        raise PlanningError(f"the path among the obstacles: {error}") from error
    if not timed.verified:
        broken = "; ".join(broken_words(task.robot, timed.check.violations))
        raise PlanningError(f"the motion along the path breaks limits: {broken}")
    chosen = replace(task, start=fit.path.start, goal=fit.path.goal, choices=())
    return MotionPlan(
        task=chosen,
        motion=timed.motion,
        check=timed.check,
        starts=(),
        best=0,
        seed=seed,
        seconds=timed.seconds,
        interrupted=False,
        options={},
    )
