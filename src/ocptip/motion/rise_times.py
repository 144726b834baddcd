"""Which rise times: where acceleration steps count with their overshoot, S-curves cost less than trapezoidal
profiles.

After an acceleration step the base has to carry up to twice the load of the step; with an S-curve only the
effect of delayed joints, which falls with the rise time. So plans within such an uncertainty are S-curves if
no rise time is given. Their rise time is about SHORTEST over the share of the margin that the uncertainty
leaves at rest. Then the best motion is solved again with twice and half of it, while that costs less. It is
also solved with trapezoidal profiles where its path promises nearly the same cost.
"""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from ocptip.motion.task import MotionTask, refusals
from ocptip.standing.arm import Robot
from ocptip.standing.limit_kinds.worst_case import left_at_rest

SHORTEST = 0.05
"""Minimum rise time that is chosen, s: about a period of elastic parts; shorter ones let them ring as steps
do.
"""
LONGEST = 0.4  # s


def with_rise_time(task: MotionTask) -> MotionTask:
    """The task with the rise time that is tried first; as it is where one is given, or none pays."""
    if task.rise_times is not None or not _pays(task):
        return task
    left = left_at_rest(task.robot, task.limits.tolerance, np.array([task.start, task.goal]))
    doublings = np.round(np.log2(1 / np.clip(left, SHORTEST / LONGEST, 1.0)))
    return _possible(task, SHORTEST * 2**doublings) or task


def families(tasks: list[MotionTask]) -> list[list[MotionTask]]:
    """Tasks with the rise times that are tried first; and, where these lead nowhere, as they are."""
    risen = [with_rise_time(task) for task in tasks]
    return [tasks] if risen == tasks else [risen, tasks]


def others(chosen: MotionTask) -> list[MotionTask]:
    """The task with the rise times next to the present one: twice, half, and none."""
    rise = max(cast(tuple[float, ...], chosen.rise_times or (0.0,)))
    found = [other for other in (2 * rise, 0.5 * rise) if SHORTEST <= other <= LONGEST]
    tasks = [_possible(chosen, other) for other in (*found, 0.0)] if rise else []
    return [one for one in tasks if one is not None]


def _pays(task: MotionTask) -> bool:
    limits = task.limits
    return bool(limits.tolerance.overshoot) and isinstance(task.robot, Robot) and not limits.stoppable


def _possible(task: MotionTask, rise: float) -> MotionTask | None:
    risen = replace(task, rise_times=float(rise))
    return None if refusals(risen, at_rest=False) else risen
