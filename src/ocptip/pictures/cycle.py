"""Figures of a cycle: those of a plan, over all segments, with their boundaries and what is held."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ocptip.motion.check import MotionCheck
from ocptip.motion.cycles.check import CycleCheck
from ocptip.motion.cycles.task import Task
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.trajectory import Trajectory


@dataclass(frozen=True)
class _Task:
    """The attributes of a task that figures read."""

    name: str
    robot: StandingMechanism
    limits: Limits
    reference: None = None


@dataclass(frozen=True, eq=False)
class _Plan:
    """The attributes of a plan that figures read.

    Attributes:
        task, motion, check: of the whole.
        segments: begin and end of each motion, s, and what to call it.
        segment_limits: of each.
    """

    task: Any
    motion: Trajectory
    check: MotionCheck
    segments: tuple[tuple[float, float, str], ...] = ()
    segment_limits: tuple[Limits, ...] = ()


def seen_plan(task: Task, motion: Trajectory, check: CycleCheck) -> Any:
    """The plan that figures draw: of a motion, of a cycle, or of its first segments."""
    if not task.is_cycle:
        return _Plan(task, motion.segments[0], check.whole)
    rows = []
    for segment, own, begin in zip(task.segments, motion.segments, motion.begins, strict=False):
        payload = segment.task.robot.payload
        name = f"{segment.name}, {payload.mass:.4g} kg" if payload else segment.name
        rows.append((float(begin), float(begin) + own.end, name))
    seen = _Task(task.name, task.robot, task.limits)
    limits = tuple(segment.task.limits for segment in task.segments[: len(rows)])
    return _Plan(seen, motion, check.whole, tuple(rows), limits)
