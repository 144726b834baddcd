"""What a cycle tolerates: of each deviation that of the segment that tolerates least."""

from __future__ import annotations

from dataclasses import replace

from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.tolerated import Tolerated, tolerances
from ocptip.trajectories.trajectory import Trajectory


def cycle_tolerances(task: CycleTask, motion: Trajectory) -> tuple[Tolerated, ...]:
    """The least of every quantity, times from the begin of the cycle; empty for parallel robots."""
    least: dict[str, Tolerated] = {}
    for segment, own, begin in zip(task.segments, motion.segments, motion.begins, strict=False):
        for found in tolerances(segment.task.robot, own):
            placed = replace(found, time=float(begin) + found.time)
            if not found.at_most:
                placed = replace(placed, how=f"segment {segment.name}: {found.how}")
            before = least.get(found.quantity)
            if before is None or _worse(placed, before):
                least[found.quantity] = placed
    return tuple(least.values())


def _worse(one: Tolerated, other: Tolerated) -> bool:
    """Of the same quantity; a factor of friction is worse if it is larger."""
    if one.quantity == "friction":
        return one.value > other.value
    return (one.value, one.at_most) < (other.value, other.at_most)
