"""What acts on a robot beside the motion of its joints: a process, and a base that drives."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.process import TIME, ProcessWrench
from ocptip.trajectories.drive_profile import DriveProfile

BASE = 9  # columns of the motion of a base, see `BaseMotion.rows`


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

    def at_pace(self, factor: float) -> Acting:
        """The same with all times multiplied by a factor > 0."""
        return Acting(
            self.process and self.process.at_pace(factor),
            self.drive_profile and self.drive_profile.at_pace(factor),
        )
