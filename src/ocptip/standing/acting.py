"""What acts on a robot beside the motion of its joints: a process, and a base that drives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.kinematics import chain, gripper_batch
from ocptip.robots.model import ArmModel
from ocptip.robots.process import PATH, TIME, ProcessWrench
from ocptip.trajectories.drive_profile import DriveProfile
from ocptip.trajectories.path import JointPath, PathTiming
from ocptip.trajectories.pieces import MERGE
from ocptip.trajectories.trajectory import Trajectory

BASE = 9  # columns of the motion of a base, see `BaseMotion.rows`
_STEP = 0.005  # s: between the instants that measure the path of the TCP during a motion
_STEPS = 2000  # intervals that measure the path of the TCP along a path of joints


@dataclass(frozen=True, eq=False)
class Acting:
    """What acts at instants: columns of numbers, those of the process first.

    Attributes:
        process: one that varies; None: there is none, or a constant one, which is part of the arm.
        drive_profile: None: the base rests.
    """

    process: ProcessWrench | None = None
    drive_profile: DriveProfile | None = None

    @property
    def size(self) -> int:
        """Number of columns: 6 of a process that varies, 9 of a base that drives."""
        return 6 * (self.process is not None) + BASE * (self.drive_profile is not None)

    @property
    def knots(self) -> np.ndarray:
        """(K,) s, at which something that varies over time has a corner or a step."""
        process = self.process if self.process is not None and self.process.over == TIME else None
        parts = [np.asarray(process.knots)] if process else []
        return np.unique(np.concatenate([*parts, self.drive_profile.knots if self.drive_profile else []]))

    @property
    def end(self) -> float:
        """When a base has driven its profile, s; 0 for one that rests."""
        return self.drive_profile.end if self.drive_profile else 0.0

    def at(self, times: np.ndarray) -> np.ndarray:
        """(N, size) at instants (N,), s.

        Raises:
            InputError: the process varies over something else than time.
        """
        if self.process is not None and self.process.over != TIME:
            raise InputError(f"process: varies over {self.process.over}, which the time alone does not tell")
        parts = [*self.process.at(times)] if self.process else []
        parts += [self.drive_profile.rows(times)] if self.drive_profile else []
        return np.hstack([np.empty((len(times), 0)), *parts])

    def split(self, columns: np.ndarray | None) -> tuple[np.ndarray | None, BaseMotion | None]:
        """The process (N, 6), and the motion of the base, of columns (N, size); None: there is none."""
        if columns is None or not columns.shape[1]:
            return None, None
        base = columns[:, -BASE:] if self.drive_profile else None
        motion = None if base is None else BaseMotion(base[:, :3], base[:, 3:6], base[:, 6:])
        return (columns[:, :6] if self.process else None), motion

    def expressions(self, columns: cs.SX | None) -> tuple[cs.SX | None, list[cs.SX]]:
        """The same of one column (size,): the process, (6,), and the three parts of the base's motion."""
        if columns is None:
            return None, []
        base = cs.vertsplit(columns[-BASE:], 3) if self.drive_profile else []
        return (columns[:6] if self.process else None), base

    def on_gripper(
        self, arm: ArmModel, q: np.ndarray, process: np.ndarray | None
    ) -> tuple[ArmModel, dict[str, np.ndarray]]:
        """The arm without a process that varies, and force and moment (N, 3), base axes, of its columns."""
        if process is None or self.process is None:
            return arm, {}
        arm, load = arm.without_process, {"force": process[:, :3], "moment": process[:, 3:]}
        if self.process.turns_with_tool:
            turn = gripper_batch(arm)(q)[1]
            load = {name: np.einsum("kij,kj->ki", turn, rows) for name, rows in load.items()}
        return arm, load

    def on_gripper_expressions(
        self, arm: ArmModel, q: cs.SX, process: cs.SX | None
    ) -> tuple[ArmModel, tuple[cs.SX, cs.SX]]:
        """The same of one column (6,); without it two columns of zeros."""
        if process is None or self.process is None:
            return arm, (cs.SX.zeros(3), cs.SX.zeros(3))
        arm = arm.without_process
        turn = chain(arm, q)[0][-1] if self.process.turns_with_tool else cs.SX.eye(3)
        return arm, (turn @ process[:3], turn @ process[3:])

    def during(self, motion: Trajectory, tool: Callable[[np.ndarray], np.ndarray]) -> Acting:
        """The same over the time of a motion.

        The TCP goes straight over 5 ms where the process varies over its path; `tool` gives its positions.
        """
        process = self.process
        if process is None or process.over == TIME:
            return self
        times, values = np.array([0.0, motion.end]), np.array([0.0, 1.0])
        if process.over == PATH:
            times = np.linspace(0.0, motion.end, 1 + max(1, int(np.ceil(motion.end / _STEP))))
            values = _covered(tool(motion.states(times)[0]))
        return replace(self, process=process.over_time(times, values))

    def along(
        self,
        path: JointPath,
        tool: Callable[[np.ndarray], np.ndarray],
        timing: PathTiming | None = None,
    ) -> Acting:
        """The same with a process over places s on a path of the joints, or with a timing over its time.

        Raises:
            InputError: the process varies over time, which a path has not yet.
        """
        process = self.process
        if process is None:
            return self
        if process.over != PATH:
            raise InputError(
                f"process: varies over {process.over}, which a path does not know before it is timed; "
                "give it over path_m"
            )
        first, last = path.breakpoints[[0, -1]]
        places = np.union1d(np.linspace(first, last, _STEPS + 1), path.breakpoints)
        times = places if timing is None else timing.passes(places)[0]
        return replace(self, process=process.over_time(times, _covered(tool(path.at(places)[0]))))

    def pieces(self, motion: Trajectory) -> np.ndarray:
        """Intervals (S, 2), s, between switching times of the motion and `knots`."""
        knots = self.knots
        if not len(knots) or not len(motion.intervals):
            return motion.intervals
        inside = [knots[(knots > a + MERGE) & (knots < b - MERGE)] for a, b in motion.intervals]
        ends = [np.array([a, *end, b]) for (a, b), end in zip(motion.intervals, inside, strict=True)]
        return np.concatenate([np.column_stack([end[:-1], end[1:]]) for end in ends])

    def at_pace(self, factor: float) -> Acting:
        """The same with all times multiplied by a factor > 0."""
        return Acting(
            self.process and self.process.at_pace(factor),
            self.drive_profile and self.drive_profile.at_pace(factor),
        )


def _covered(points: np.ndarray) -> np.ndarray:
    """(N,), m: distance covered on straight lines between points (N, 3)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
