"""Checks of motions and cycles with their certificates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from ocptip.basics.text import silent
from ocptip.certificate.find import certify
from ocptip.motion.check import MotionCheck
from ocptip.motion.cycles.check import CycleCheck, cycle_check
from ocptip.motion.cycles.task import Task
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.trajectory import Trajectory


def certified(
    robot: StandingMechanism,
    motion: Trajectory,
    checked: MotionCheck,
    limits: Limits | None = None,
    say: Callable[[str], None] = silent,
) -> MotionCheck:
    """The check with a certificate, if the motion keeps its limits: a proof for all instants.

    One that it has stays.

    Args:
        robot, motion, limits: as checked.
        checked: result of `check_motion`.
        say: called with what is proved, and how much of it.
    """
    if not checked.kept_while_moving or checked.certificate is not None:
        return checked
    return replace(checked, certificate=certify(robot, motion, limits or Limits(), checked.worst, say))


def certified_cycle(
    task: Task,
    motion: Trajectory,
    checked: CycleCheck,
    *,
    cancels: bool = False,
    say: Callable[[str], None] = silent,
) -> CycleCheck:
    """The check with certificates of all segments, if their motions keep their limits.

    Each holds for its segment and the rests before and after it with what that segment holds, which are
    those at the seams.

    Args:
        task, motion: as checked.
        checked: result of `check_cycle`.
        cancels: prove also that arms can be cancelled, by the rules of the tasks.
        say: called with what is proved, and how much of it.
    """
    if not checked.whole.kept_while_moving:
        return checked
    tasks = [segment.task for segment in task.segments]
    limits = [
        segment_task.stops.safe(segment_task.limits, segment_task.robot, "cancel")
        if cancels and segment_task.limits.cancel is None and segment_task.robot.arm
        else segment_task.limits
        for segment_task in tasks
    ]
    rows = zip(tasks, zip(motion.segments, checked.segments, limits, strict=True), strict=True)
    return cycle_check(task, motion, [certified(segment_task.robot, *row, say) for segment_task, row in rows])
