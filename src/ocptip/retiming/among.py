"""Plans a motion along a path, timed so that all limits hold: among obstacles, or the straight line; and the
slow motion that is left where searches give none.
"""

from __future__ import annotations

import math
import time
from bisect import bisect_left
from dataclasses import replace
from functools import cache
from typing import cast

import numpy as np

from ocptip.basics.errors import InputError, PlanningError
from ocptip.basics.interrupts import TimeIsUpError
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.paths.search import MOST_STATES, search_path
from ocptip.motion.paths.smoothing import smoothed_path
from ocptip.motion.planner.random_start import SLOWER, pace_that_stands
from ocptip.motion.task import MotionTask
from ocptip.motion.violations import broken_words
from ocptip.retiming.retime import retime
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.trajectories.path_fit import FittedPath, rounded_lines
from ocptip.trajectories.trajectory import Trajectory

NODES = 60
"""Intervals between nodes of the timing: 0.3 % of the duration, for a third of the time."""

SLOW = "slow"
"""Option of a plan that is a slow motion of all joints in step, because a search gave none."""

LEAST_GAIN = 0.01
"""Share of the cost that a timed line saves at least to replace velocity profiles, which drives run."""


def plan_along_path(
    task: MotionTask, *, seed: int = 0, deadline: float = math.inf, states: int = MOST_STATES
) -> MotionPlan:
    """The motion along a path from a start to a goal of a task, as cheap or fast as its limits allow.

    Args:
        task: of which any pair of start and goal postures may be taken.
        seed: of the random search.
        deadline: of `time.perf_counter`, s, after which the search for a path ends.
        states: number of tested states after which it ends.

    Raises:
        InputError: OMPL is not installed.
        PlanningError: there is no path, or no timing keeps all limits.
    """
    began = time.perf_counter()
    fit = search_path(task, seed=seed, deadline=deadline, most=states)
    searched = time.perf_counter() - began
    plan = _timed(task, fit, seed)
    options = {"method": "path", "path": {"made_of": fit.how, "searched_s": searched}}
    return replace(plan, seconds=time.perf_counter() - began, options=options)


def no_worse_than_line(plan: MotionPlan) -> MotionPlan:
    """The plan, or the motion along the straight line of the joints between its ends if that costs less.

    A timing has no profiles of single joints, so that it may be better on the same path: it keeps a tray as
    level as the line does, and is as fast as what stands on it allows.
    """
    began, task = time.perf_counter(), cast(MotionTask, plan.task)
    ends = np.array([plan.motion.start, plan.motion.goal])
    if np.array_equal(*ends):
        return plan
    try:
        line = _timed(task, rounded_lines(ends, ()), plan.seed)
    except PlanningError:
        return plan
    cost, plan_cost = (task.objective.cost(one.energy, one.duration) for one in (line, plan))
    seconds = plan.seconds + time.perf_counter() - began
    if cost > (1 - LEAST_GAIN) * plan_cost:
        return replace(plan, seconds=seconds)
    path = {"made_of": "the straight line of the joints", "searched_s": plan.seconds}
    return replace(line, seconds=seconds, options={**plan.options, "method": "path", "path": path})


def slow_plan(task: MotionTask, *, seed: int = 0) -> MotionPlan:
    """The synchronised default motion, as slow as its limits ask for.

    All joints take one trapezoidal profile each, and end together. No search is needed, so that this is a
    plan where a search gives none, or has no time. An interrupt ends the choice among speeds that keep them.

    Raises:
        PlanningError: no speed keeps all limits; names those that the slowest motion breaks.
    """
    began = time.perf_counter()
    robot, rise = task.robot, np.array(task.rise_times or 0.0)
    fastest = Trajectory.ending_together(
        task.start, task.goal, [None] * robot.n, robot.limits.speed, robot.limits.acceleration
    )
    stands = pace_that_stands(robot, fastest, limits_of(robot, task.limits, task.optimised), SLOWER)

    @cache
    def tried(pace: float) -> tuple[Trajectory, MotionCheck]:
        motion = fastest.time_scaled(pace)
        motion = motion.with_rise_times(rise) if np.any(rise) else motion
        return motion, check_motion(robot, motion, task.limits)

    paces = [pace for pace in SLOWER if pace >= (stands or SLOWER[-1])]
    interrupted = False
    if not tried(paces[0])[1].verified:
        motion, checked = tried(paces[-1])
        if not checked.verified:
            broken = "; ".join(broken_words(robot, checked.violations))
            slowly = f"even slowly, joints in step from start to goal in {motion.end:.3g} s"
            raise PlanningError(f"{slowly}: {broken}")
        slower = len(paces) - 1  # a slower motion keeps what a faster one does, nearly
        try:
            paces = paces[bisect_left(paces, True, 1, slower, key=lambda pace: tried(pace)[1].verified) :]
        except KeyboardInterrupt as stop:  # the slowest one is verified
            paces, interrupted = paces[slower:], not isinstance(stop, TimeIsUpError)
    motion, checked = tried(paces[0])
    options = {"starts": 0, SLOW: True}
    how = {"starts": (), "best": 0, "seed": seed, "interrupted": interrupted, "options": options}
    return MotionPlan(task, motion, checked, seconds=time.perf_counter() - began, **how)


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
        raise PlanningError(f"the path: {error}") from error
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
