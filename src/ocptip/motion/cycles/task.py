"""A cycle: segments from rest to rest, each with what the robot holds then."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ocptip.basics.errors import InputError, finite_array, positive_number
from ocptip.motion.objective import Objective
from ocptip.motion.source import TaskSource
from ocptip.motion.task import MotionTask, refusals
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism

SAME = 1e-6
"""rad or m: a segment that starts farther from the end of the one before does not continue it."""


@dataclass(frozen=True, eq=False)
class Segment:
    """One motion of a cycle.

    Attributes:
        name: for messages.
        task: robot with what it holds, limits, objective; its goal is the first of `goals`.
        goals: postures of which the segment may end in any, (k, n), rad (sliding joints: m).
        dwell: s, standstill at the goal, with what this segment holds.
    """

    name: str
    task: MotionTask
    goals: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    dwell: float = 0.0

    def __post_init__(self) -> None:
        n = self.task.robot.n
        goals = finite_array("goals", self.goals if len(self.goals) else self.task.goal[None], (None, n))
        goals.flags.writeable = False
        object.__setattr__(self, "goals", goals)
        object.__setattr__(self, "dwell", positive_number("dwell", self.dwell, zero_allowed=True))

    def between(self, start: np.ndarray, goal: np.ndarray) -> MotionTask:
        """The task from one posture to another, (n,) each."""
        return replace(self.task, start=start, goal=goal, choices=())

    def standby(self, q: np.ndarray) -> float:
        """Electric power at rest in posture q, (n,), W."""
        robot, still = self.task.robot, np.zeros((1, self.task.robot.n))
        torques, _ = robot.loads(q[None], still, still)
        return float(np.sum(robot.motors.power(torques, robot.motor_speeds(q[None], still))))


@dataclass(frozen=True, eq=False)
class CycleTask:
    """Segments to be planned one after the other, each starting where the one before ends.

    Attributes:
        name: for messages and titles.
        segments: at least one, all with the same joints on the same support.
        starts: postures of which the first segment may start in any, (k, n), rad (sliding joints: m).
        closed: the last segment ends where the first one has started.
        source: the file that it was read from.
    """

    name: str
    segments: tuple[Segment, ...]
    starts: np.ndarray
    closed: bool = False
    source: TaskSource | None = None

    def __post_init__(self) -> None:
        """Raise InputError if there is no segment, or joints differ."""
        object.__setattr__(self, "segments", tuple(self.segments))
        if not self.segments:
            raise InputError("segments: at least one is needed, got none")
        first = self.robot
        for number, segment in enumerate(self.segments, 1):
            own = segment.task.robot
            if own.names != first.names or own.units != first.units:
                raise InputError(
                    f"segments[{number}]: moves {', '.join(own.names)}, the first {', '.join(first.names)}"
                )
        starts = finite_array("starts", self.starts, (None, first.n))
        starts.flags.writeable = False
        object.__setattr__(self, "starts", starts)

    @property
    def robot(self) -> StandingMechanism:
        """That of the first segment."""
        return self.segments[0].task.robot

    @property
    def limits(self) -> MotionLimits:
        """Those of the first segment."""
        return self.segments[0].task.limits

    @property
    def objective(self) -> Objective:
        """That of the first segment."""
        return self.segments[0].task.objective

    def titles(self) -> list[str]:
        """Of the segments, for messages: "segment 2 (carry)"."""
        return [f"segment {k} ({segment.name})" for k, segment in enumerate(self.segments, 1)]

    def with_limits(self, limits: dict[str, float]) -> CycleTask:
        """The same with some limits replaced in all segments."""
        if not limits:
            return self
        changed = [
            replace(s, task=replace(s.task, limits=replace(s.task.limits, **limits))) for s in self.segments
        ]
        return replace(self, segments=tuple(changed))

    def with_objective(self, objective: Objective) -> CycleTask:
        """The same with one objective for all segments."""
        changed = [replace(s, task=replace(s.task, objective=objective)) for s in self.segments]
        return replace(self, segments=tuple(changed))


def require_way_plannable(task: CycleTask, way: list[np.ndarray]) -> None:
    """Raise InputError with all reasons against the segments between these postures, m + 1 of (n,)."""
    found = []
    for title, segment, start, goal in zip(task.titles(), task.segments, way[:-1], way[1:], strict=True):
        found += [f"{title}: {reason}" for reason in refusals(segment.between(start, goal))]
    if found:
        raise InputError(f"{task.name}: cannot be planned: {'; '.join(found)}")
