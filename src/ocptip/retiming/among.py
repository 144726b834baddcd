"""Plans a motion among obstacles: a path that is clear, timed so that all limits hold."""

from __future__ import annotations

import math
import time
from dataclasses import replace

from ocptip.basics.errors import InputError, PlanningError
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.path_search import search_path
from ocptip.motion.task import MotionTask
from ocptip.retiming.retime import retime

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
    try:
        timed = retime(task.robot, fit.path, task.limits, task.objective, nodes=NODES)
    except InputError as error:
        raise PlanningError(f"the path among the obstacles: {error}") from error
    if not timed.verified:
        raise PlanningError(f"the motion along the path breaks limits: {'; '.join(timed.check.violations)}")
    chosen = replace(task, start=fit.path.start, goal=fit.path.goal, choices=())
    return MotionPlan(
        task=chosen,
        motion=timed.motion,
        check=timed.check,
        starts=(),
        best=0,
        seed=seed,
        seconds=time.perf_counter() - began,
        interrupted=False,
        options={"method": "path", "path": {"made_of": fit.how, "searched_s": searched}},
    )
