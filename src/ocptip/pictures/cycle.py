"""Figures of a cycle: those of a plan, over all segments, with their boundaries and what is held."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.motion.check import MotionCheck
from ocptip.motion.cycles.check import CycleCheck
from ocptip.motion.cycles.output import samples_joined
from ocptip.motion.cycles.task import CycleTask
from ocptip.pictures.plan import draw_plan
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import MotionSamples, StandingMechanism
from ocptip.trajectories.trajectory import Trajectory


@dataclass(frozen=True)
class _Task:
    """What figures ask of a task."""

    name: str
    robot: StandingMechanism
    limits: MotionLimits
    reference: None = None


@dataclass(frozen=True, eq=False)
class _Plan:
    """What figures ask of a plan.

    Attributes:
        task, motion, check: of the whole.
        segments: begin and end of each motion, s, and what to call it.
        segment_limits: of each.
    """

    task: _Task
    motion: Trajectory
    check: MotionCheck
    segments: tuple[tuple[float, float, str], ...]
    segment_limits: tuple[MotionLimits, ...]


def draw_cycle(
    directory: str | os.PathLike[str],
    task: CycleTask,
    motion: Trajectory,
    check: CycleCheck,
    samples: Sequence[MotionSamples],
) -> list[Path]:
    """Draw all figures of a cycle into a directory as PNG, as `draw_plan` does.

    Args:
        directory: made if it does not exist; the one above it must.
        task: what was asked for.
        motion: of its segments, or of the first of them.
        check: of that.
        samples: of `cycle_samples`.

    Raises:
        OSError: a file or the directory cannot be written; names it.
    """
    return draw_plan(directory, seen_plan(task, motion, check), samples_joined(samples))


def seen_plan(task: CycleTask, motion: Trajectory, check: CycleCheck) -> Any:
    """A cycle, or its first segments, as figures of plans see it."""
    rows = []
    for segment, own, begin in zip(task.segments, motion.segments, motion.begins, strict=False):
        payload = segment.task.robot.payload
        name = f"{segment.name}, {payload.mass:.4g} kg" if payload else segment.name
        rows.append((float(begin), float(begin) + own.end, name))
    seen = _Task(task.name, task.robot, task.limits)
    limits = tuple(segment.task.limits for segment in task.segments[: len(rows)])
    return _Plan(seen, motion, check.whole, tuple(rows), limits)
