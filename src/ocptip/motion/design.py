"""How narrow the feet and how light the base may be under a motion: its limits of tip-over and slip."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ocptip.contact.support import Support
from ocptip.motion.cycles.task import Task
from ocptip.reserves.slip import known
from ocptip.reserves.tipping import TipMap
from ocptip.standing.arm import Robot
from ocptip.standing.instants import Instants
from ocptip.standing.limits import Limits
from ocptip.standing.within.design import Design, smallest_design
from ocptip.standing.within.in_motion import worst_slip_of, worst_tip_of
from ocptip.standing.within.late_joints import DelayedStates, jump_states, on_time
from ocptip.standing.within.worst_case import WorstCase, worst_case_of
from ocptip.trajectories.trajectory import Trajectory

SPACING = 0.01  # s: between instants, at most

Part = tuple[Robot, Trajectory, Limits]
"""A motion of a robot, and its limits."""


def motion_design(task: Task, motion: Trajectory) -> Design:
    """The smallest base on which a motion keeps its limits of tip-over and slip, nominal and worst case.

    Instants are sampled. Stops, compliant feet and elastic joints are not included.

    Args:
        task: robot and limits.
        motion: of as many segments.

    Raises:
        InputError: the robot is no arm.
    """
    parts: list[Part] = []
    for segment, segment_motion in zip(task.segments, motion.segments, strict=True):
        robot = Robot.of(segment.task.robot, "design: only for arms; this robot is a parallel one")
        parts.append((robot, segment_motion, segment.task.limits))

    def on(support: Support) -> _OnBase:
        return _OnBase(
            [(robot.varied(support=support), motion_part, limits) for robot, motion_part, limits in parts]
        )

    return smallest_design(parts[0][0].support, on)


class _OnBase:
    """Motions on one base; uses of their limits, 1 at the limit.

    Args:
        parts: of a motion, or of the segments of a cycle.
    """

    def __init__(self, parts: Iterable[Part]) -> None:
        self._parts = list(parts)

    def tip(self) -> tuple[float, None]:
        """The largest use of a limit of the tip-over index."""
        return max(self._tip(*part) for part in self._parts), None

    def slip(self) -> tuple[float, None]:
        """The largest use of a limit of the friction utilisation."""
        return max(self._slip(*part) for part in self._parts), None

    @staticmethod
    def _tip(robot: Robot, motion: Trajectory, limits: Limits) -> float:
        moments, tip_over = TipMap(robot.tip_over), robot.tip_over
        if not moments.count:
            return np.inf if tip_over.free_rotation else 0.0
        least = np.min(moments(_loads(robot, motion))[0])
        use = float(tip_over.ratio(least)) / limits.GN
        if limits.tolerance.given and use < 1:
            worst = worst_tip_of(*_worst_states(robot, motion, limits))
            use = max(use, worst.most / limits.GN_worst_case)
        return use

    @staticmethod
    def _slip(robot: Robot, motion: Trajectory, limits: Limits) -> float:
        use = float(np.max(known(robot.slip.greatest(_loads(robot, motion))))) / limits.GT
        if limits.tolerance.given and use < 1:
            worst = worst_slip_of(*_worst_states(robot, motion, limits))
            use = max(use, worst.value / limits.GT_worst_case if worst else 0.0)
        return use


def _loads(robot: Robot, motion: Trajectory) -> np.ndarray:
    """Wrenches (N, 6) on the base at sampled instants."""
    times = motion.both_sides(SPACING)
    return Instants.of_states(robot.during(motion), *motion.states(times), times).wrenches


def _worst_states(robot: Robot, motion: Trajectory, limits: Limits) -> tuple[WorstCase, DelayedStates]:
    """The worst case, and the states that count in it: delayed, and at acceleration steps."""
    cases, acting = worst_case_of(robot, limits.tolerance), robot.during(motion)
    delayed = on_time(motion, limits.tolerance, motion.both_sides(SPACING), acting)
    return cases, delayed.joined(jump_states(motion, limits.tolerance, cases, acting))
