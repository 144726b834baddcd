"""The consecutive motions of a plan, each with the robot as it is during that motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ocptip.standing.arm import Robot
from ocptip.trajectories.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Part:
    """A motion from rest to rest.

    Attributes:
        robot: with what it holds.
        motion: of it.
        name: of the segment of a cycle; of a single motion empty.
        begin: s, when it begins.
        rest: s, standstill after it, with what it holds.
    """

    robot: Robot
    motion: Trajectory
    name: str = ""
    begin: float = 0.0
    rest: float = 0.0

    @property
    def end(self) -> float:
        """When the standstill after it ends, s."""
        return self.begin + self.motion.end + self.rest

    def time_scaled(self, factor: float) -> Part:
        """The same path, and process, with all times multiplied by `factor` > 0."""
        if factor == 1:
            return self
        robot = self.robot.during(self.motion).at_pace(factor)
        motion = self.motion.time_scaled(factor)
        return replace(self, robot=robot, motion=motion, begin=factor * self.begin, rest=factor * self.rest)


def owners(parts: Sequence[Part], times: np.ndarray) -> Iterator[tuple[int, Part, np.ndarray]]:
    """Which of these times belong to which part.

    Args:
        parts: in their order.
        times: (T,), s, from the begin of the first; before and after all parts those of the nearest.

    Yields:
        Number of the part, the part, and numbers (k,) of its times. An end is of the part that ends.
    """
    owner = np.searchsorted([part.end for part in parts[:-1]], times)
    for number, part in enumerate(parts):
        yield number, part, np.flatnonzero(owner == number)
