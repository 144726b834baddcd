"""A plan: of a motion, or of a cycle, which has one for each segment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

from ocptip.motion.check import MotionCheck
from ocptip.motion.cycles.check import CycleCheck, cycle_check
from ocptip.motion.cycles.task import CycleTask, Task
from ocptip.motion.planner.attempt import StartResult
from ocptip.motion.planner.jobs import LOST
from ocptip.trajectories.trajectory import Trajectory

TIME_IS_UP = "time_is_up"
"""Option of a plan whose search a time limit ended; its text says what is missing, empty: nothing."""


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """A planned motion, or cycle.

    Attributes:
        task: what was asked for; of a motion with the start and goal that were chosen.
        motion: the exact motion, by velocity profiles; of a cycle the motions of the planned segments and the
            rests between.
        check: of all limits, on the dense grid, with a certificate if it is proved and no interrupt came; of
            a cycle the worst of all segments, and the energy and duration of all with the rests.
        starts: what became of each start that finished, by number; of a cycle those of all segments.
        best: number of the start the motion comes from; of a cycle 0.
        seed: of the starts.
        seconds: wall time of the planning.
        interrupted: some starts had not finished.
        options: what else was asked for; `choices`: how many postures there were, and were planned.
        segments: plans of the segments of a cycle; of the first ones only if the planning was interrupted.
        slower: factor of all times, which is in the motion, that made its proof complete.
    """

    task: Task
    motion: Trajectory
    check: MotionCheck
    starts: tuple[StartResult, ...]
    best: int
    seed: int
    seconds: float
    interrupted: bool
    options: dict[str, Any]
    segments: tuple[MotionPlan, ...] = ()
    slower: float = 1.0

    @classmethod
    def of_cycle(
        cls,
        task: CycleTask,
        segments: Sequence[MotionPlan],
        *,
        seed: int = 0,
        seconds: float,
        interrupted: bool = False,
        options: dict[str, Any],
    ) -> MotionPlan:
        """The plan of a cycle from those of its segments."""
        rests = tuple(segment.rest for segment in task.segments[: len(segments)])
        motion = Trajectory.from_segments([one.motion for one in segments], rests)
        check = _checked(task, motion, segments).whole
        starts = tuple(start for one in segments for start in one.starts)
        return cls(
            task, motion, check, starts, 0, seed, seconds, interrupted, options, segments=tuple(segments)
        )

    @property
    def parts(self) -> tuple[MotionPlan, ...]:
        """The plans of the segments; a motion is its only segment."""
        return self.segments or (self,)

    def with_parts(self, parts: Sequence[MotionPlan]) -> MotionPlan:
        """This plan with other plans of its segments."""
        if not self.segments:
            return parts[0]
        how = {"seed": self.seed, "options": self.options, "interrupted": self.interrupted}
        return MotionPlan.of_cycle(cast(CycleTask, self.task), parts, **how, seconds=self.seconds)

    @property
    def stopped(self) -> bool:
        """The user's interrupt ended the search, not a time limit."""
        return self.interrupted and not any(TIME_IS_UP in one.options for one in (self, *self.parts))

    @property
    def complete(self) -> bool:
        """All segments are planned."""
        return len(self.parts) == len(self.task.segments)

    @property
    def finished(self) -> Task:
        """The task of the segments that have a plan."""
        return _finished(self.task, len(self.parts))

    @property
    def checked(self) -> CycleCheck:
        """The check by segments."""
        return _checked(self.task, self.motion, self.parts)

    @property
    def energy(self) -> float:
        """Electric energy, that of the rests of a cycle included, J."""
        return self.check.energy

    @property
    def duration(self) -> float:
        """With all rests, s."""
        return self.check.duration

    @property
    def lost(self) -> tuple[StartResult, ...]:
        """Starts without a result, because they killed their workers."""
        return tuple(start for start in self.starts if start.status.startswith(LOST))

    @property
    def verified(self) -> bool:
        """All segments are planned, and every limit holds on the dense grid."""
        return self.complete and self.check.verified


def _finished(task: Task, count: int) -> Task:
    """The task up to that number of segments."""
    return (
        task if count == len(task.segments) else replace(task, segments=task.segments[:count], closed=False)
    )


def _checked(task: Task, motion: Trajectory, parts: Sequence[MotionPlan]) -> CycleCheck:
    return cycle_check(_finished(task, len(parts)), motion, [part.check for part in parts])
