"""A cycle: segments from rest to rest, each with what the robot holds then."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.frozen import settle
from ocptip.motion.files.source import TaskSource
from ocptip.motion.objective import Objective
from ocptip.motion.task import MotionTask, Segment, refusals
from ocptip.numerics.vectors import wrapped
from ocptip.robots.inverse.pose_target import AXES, PoseTarget
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism

SAME = 1e-6
"""rad or m: a segment that starts farther from the end of the one before does not continue it."""


@dataclass(frozen=True, eq=False)
class CycleTask:
    """Segments to be planned one after the other, each starting where the one before ends.

    Attributes:
        name: for messages and titles.
        segments: at least one, all with the same joints on the same support.
        starts: postures of which the first segment may start in any, (k, n), rad (sliding joints: m).
        closed: the last segment ends where the first one has started.
        source: the file that it was read from.
        target: the gripper pose that the starts are postures of; None where the angles are given.
    """

    is_cycle: ClassVar[bool] = True
    name: str
    segments: tuple[Segment, ...]
    starts: np.ndarray
    closed: bool = False
    source: TaskSource | None = None
    target: PoseTarget | None = None

    def __post_init__(self) -> None:
        """Raise InputError if there is no segment, or joints differ."""
        settle(self, segments=tuple(self.segments))
        if not self.segments:
            raise InputError("segments: at least one is needed, got none")
        first = self.robot
        for number, segment in enumerate(self.segments, 1):
            robot = segment.task.robot
            if robot.names != first.names or robot.units != first.units:
                raise InputError(
                    f"segments[{number}]: moves {', '.join(robot.names)}, the first {', '.join(first.names)}"
                )
        settle(self, starts=finite_array("starts", self.starts, (None, first.n)))

    @property
    def robot(self) -> StandingMechanism:
        """That of the first segment."""
        return self.segments[0].task.robot

    @property
    def start(self) -> np.ndarray:
        """The first of the postures in which the cycle may start, (n,), rad or m."""
        return self.starts[0]

    @property
    def limits(self) -> Limits:
        """Those of the first segment."""
        return self.segments[0].task.limits

    @property
    def objective(self) -> Objective:
        """That of the first segment."""
        return self.segments[0].task.objective

    @property
    def ends(self) -> list[tuple[str, np.ndarray, PoseTarget | None]]:
        """Start and goals of the segments: names, postures (k, n) of which each may be any, their poses."""
        goals = [(f"goal of segment {s.name}", s.goals, s.target) for s in self.segments]
        return [("start", self.starts, self.target), *goals]

    def pose_miss(self, end: int, q: np.ndarray) -> float:
        """By how much posture q misses the gripper pose of an end, m and rad; infinite if it has none."""
        _, _, target = self.ends[end]
        if target is None or (arm := self.robot.arm) is None:
            return np.inf
        return float(target.residuals(arm, q[None])[0])

    def offset(self, end: int, q: np.ndarray, near: float) -> np.ndarray:
        """(n,) How far posture q is off the nearest one of an end, rad, m; zero if it is in its pose.

        Args:
            end: number in `ends`.
            q: (n,), rad (sliding joints: m).
            near: m and rad, by which a pose may be missed.
        """
        _, postures, target = self.ends[end]
        arm = self.robot.arm
        if target is not None and arm is not None and target.reached(arm, q[None], near)[0]:
            return np.zeros(self.robot.n)
        off = q - postures
        if len(postures) > 1:
            off = np.where(np.array(self.robot.units) == "rad", wrapped(off), off)
        off = np.abs(off)
        return off[np.argmin(off.max(axis=1))]

    def titles(self) -> list[str]:
        """Titles of the segments, for messages: "segment 2 (carry)"."""
        return [f"segment {k} ({segment.name})" for k, segment in enumerate(self.segments, 1)]

    def each(self, change: Callable[[MotionTask], MotionTask]) -> CycleTask:
        """This cycle with the task of every segment changed by `change`."""
        changed = (replace(segment, task=change(segment.task)) for segment in self.segments)
        return replace(self, segments=tuple(changed))


Task = MotionTask | CycleTask
"""The task that is planned and checked; a motion has one segment."""


def refuse_objects(task: Task, *whats: str) -> None:
    """Raise InputError if a robot of the task carries objects: for `whats`, and for cycles."""
    for what in (*whats, *["a cycle"] * task.is_cycle):
        for segment in task.segments:
            segment.task.robot.require_no_objects(what)


def refuse_driving(task: Task, *whats: str) -> None:
    """Raise InputError if the base drives, for what does not take that: `whats`, and stops as limits."""
    stopped = any(segment.task.limits.stoppable for segment in task.segments)
    for what in (*whats, *["stops"] * stopped) if task.robot.acts.end else ():
        raise InputError(f"{what}: not for a base that drives; leave this out, or the drive profile")


def freed_offset(target: PoseTarget | None, robot: StandingMechanism, q: np.ndarray) -> dict[str, float]:
    """Where in its ranges a pose is in posture q, (n,): m, by the axes along which it is free."""
    if target is None or robot.arm is None:
        return {}
    offset = target.offsets(robot.arm, q[None])[0]
    return {
        axis: float(shift) for axis, shift, free in zip(AXES, offset, target.free, strict=True) if free.any()
    }


def require_way_plannable(task: CycleTask, way: list[np.ndarray]) -> None:
    """Raise InputError with all reasons against the segments between these postures, m + 1 of (n,)."""
    results = []
    for title, segment, start, goal in zip(task.titles(), task.segments, way[:-1], way[1:], strict=True):
        results += [f"{title}: {reason}" for reason in refusals(segment.between(start, goal))]
    if results:
        raise InputError(f"{task.name}: cannot be planned: {'; '.join(results)}")
