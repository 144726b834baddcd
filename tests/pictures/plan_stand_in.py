"""A plan without planning: the printed motion of a case, for tests of what is done with plans."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from ocptip.motion.check import check_motion
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.planner.attempt import StartResult
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits


@cache
def _checked(name, base, factor, limits):
    task = experiment_task(name, base, limits)
    motion = task.reference.time_scaled(factor)
    return task, motion, check_motion(task.robot, motion, limits)


@cache
def stand_in_plan(name="C", base="effective", *, factor=1.0, limits=None, reference=True, interrupted=False):
    """A `MotionPlan`; the motion is the printed one with all times multiplied by factor."""
    limits = limits or Limits()
    printed, motion, checked = _checked(name, base, factor, limits)
    task = printed if reference else replace(printed, reference=None)
    return plan_of(task, motion, checked, interrupted=interrupted)


def plan_of(task, motion, checked=None, *, interrupted=False):
    """A `MotionPlan` with this motion."""
    checked = checked or check_motion(task.robot, motion, task.limits)
    nan = float("nan")
    starts = (
        StartResult(
            number=1,
            status="verified",
            energy=checked.energy,
            verified=True,
            iterations=31,
            seconds=1.2,
            cpu_seconds=1.1,
            solves=2,
            stages={},
            hops=2,
        ),
        StartResult(
            number=2,
            status="infeasible",
            energy=nan,
            verified=False,
            iterations=12,
            seconds=0.7,
            cpu_seconds=0.6,
            solves=1,
            stages={},
            hops=0,
        ),
    )
    return MotionPlan(
        task=task,
        motion=motion,
        check=checked,
        starts=starts,
        best=0,
        seed=3,
        seconds=2.5,
        interrupted=interrupted,
        options={"starts": 2, "limits": task.limits},
    )
