"""Paths of base and arm together: x, y and yaw of the base, m and rad, come before the joints.

In base axes the acceleration of such a base is affine in u = d2s/dt2 and x = (ds/dt)^2, and its angular
velocity grows with that of the joints, with ds/dt. So torques and wrenches stay affine, see `rows`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.standing.arm import Robot
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.drive_profile import POSE, DriveProfile
from ocptip.trajectories.path import PathTiming
from ocptip.trajectories.trajectory import Trajectory

_COUNT = len(POSE)
_STILL = DriveProfile.of_velocities(np.array([0.0, 1.0]), np.zeros((2, 3)))
_LIMIT = re.compile(r"\s*(?P<number>[0-9.eE+-]+)\s*(?P<unit>\S+)\s*")
_UNITS = {
    "m/s": ("speed", 1.0),
    "rad/s": ("turning", 1.0),
    "deg/s": ("turning", np.pi / 180),
    "m/s^2": ("acceleration", 1.0),
    "rad/s^2": ("turning_acceleration", 1.0),
    "deg/s^2": ("turning_acceleration", np.pi / 180),
    "N": ("force", 1.0),
}


@dataclass(frozen=True)
class BaseLimits:
    """Limits of a base that drives on a path; infinite: none.

    Attributes:
        speed: m/s, of the origin of the base frame.
        turning: rad/s.
        acceleration: m/s^2, of the origin, forward and sideways each.
        turning_acceleration: rad/s^2.
        force: N, forward, of all drives or brakes together: the sum of their torques by the wheels' radius.
    """

    speed: float = np.inf
    turning: float = np.inf
    acceleration: float = np.inf
    turning_acceleration: float = np.inf
    force: float = np.inf

    @classmethod
    def of(cls, words: str) -> BaseLimits:
        """Read limits such as "0.8 m/s, 1 m/s^2, 60 deg/s, 90 deg/s^2, 300 N".

        Raises:
            InputError: a part is no number with one of these units, or a unit occurs twice.
        """
        table: dict[str, float] = {}
        for part in words.split(","):
            match = _LIMIT.fullmatch(part)
            name, scale = _UNITS.get(match["unit"], ("", 1.0)) if match else ("", 1.0)
            if not match or not name or name in table:
                units = ", ".join(_UNITS)
                raise InputError(
                    f"base_limits: expected numbers with units ({units}), each once, got {part!r}"
                )
            try:
                number = float(match["number"])
            except ValueError:
                raise InputError(f"base_limits: {match['number']!r} is no number") from None
            table[name] = scale * positive_number("base_limits", number)
        return cls(**table)


@dataclass(frozen=True, eq=False)
class BasePath:
    """A base at P places of a path.

    Attributes:
        pose, d, dd: x, y and yaw, and their derivatives over s, (P, 3).
    """

    pose: np.ndarray
    d: np.ndarray
    dd: np.ndarray

    def some(self, rows: np.ndarray) -> BasePath:
        """Some of the places."""
        return BasePath(self.pose[rows], self.d[rows], self.dd[rows])

    def rows(self, u: np.ndarray, x: np.ndarray) -> np.ndarray:
        """(P, 9) rows of `BaseMotion` with path accelerations u and squared path speeds x, (P,) each."""
        values = np.zeros((len(self.pose), 9))
        rates = self.d * u[:, None] + self.dd * x[:, None]
        values[:, :2], values[:, 8] = self._in_base(rates), rates[:, 2]
        values[:, 5] = self.d[:, 2] * np.sqrt(x)
        return values

    def slopes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the rows over u and over x, (P, 9) each."""
        one, none = np.ones(len(x)), np.zeros(len(x))
        of_x = self.rows(none, one)
        of_x[:, 5] = self.d[:, 2] / (2 * np.sqrt(x))
        return self.rows(one, none), of_x

    def half_planes(
        self, limits: BaseLimits, wrench: tuple[np.ndarray, np.ndarray, np.ndarray]
    ) -> tuple[list[str], np.ndarray]:
        """Names (L,) and rows alpha u + beta x <= gamma, (3, P, L), of limits of the base.

        Args:
            limits: those that are infinite give no rows.
            wrench: coefficients of u, of x and of 1, (P, 6) each: on the contacts.
        """
        none, names, blocks = np.zeros(len(self.d)), [], list[np.ndarray]()
        most = self.d[:, 0] ** 2 + self.d[:, 1] ** 2, self.d[:, 2] ** 2
        for name, square, limit in zip(
            ("base speed", "base turning"), most, (limits.speed, limits.turning), strict=True
        ):
            if np.isfinite(limit):
                names.append(name)
                blocks.append(np.stack([none, square / limit**2, none + 1]))
        along, bends = self._in_base(self.d), self._in_base(self.dd)
        rate, turning = limits.acceleration, limits.turning_acceleration
        pairs = [("base acceleration", rate, along[:, k], bends[:, k], none) for k in (0, 1)]
        pairs += [("base acceleration", turning, self.d[:, 2], self.dd[:, 2], none)]
        pairs += [("base force", limits.force, wrench[0][:, 0], wrench[1][:, 0], wrench[2][:, 0])]
        for name, limit, of_u, of_x, rest in pairs:
            if np.isfinite(limit):
                names += [name] * 2
                for sign in (1.0, -1.0):
                    scaled = sign / limit
                    blocks.append(np.stack([scaled * of_u, scaled * of_x, 1 - scaled * rest]))
        return names, np.stack(blocks, axis=2) if blocks else np.empty((3, len(self.d), 0))

    def _in_base(self, vectors: np.ndarray) -> np.ndarray:
        """(P, 2) in base axes of vectors in the world."""
        c, s = np.cos(self.pose[:, 2]), np.sin(self.pose[:, 2])
        return np.column_stack([c * vectors[:, 0] + s * vectors[:, 1], c * vectors[:, 1] - s * vectors[:, 0]])


class Run(NamedTuple):
    """A robot and the motion of its joints; with `whole` its base drives by the same timing."""

    robot: StandingMechanism
    motion: Trajectory
    whole: bool

    @classmethod
    def of(cls, robot: StandingMechanism, timing: PathTiming) -> Run:
        """A path with its timing."""
        path = timing.path
        if path.joints == robot.n:
            return cls(robot, Trajectory(timing=timing), False)
        course, arm = (
            Trajectory.from_path(path.some(part), timing.s, timing.x)
            for part in (slice(_COUNT), slice(_COUNT, None))
        )
        return cls(Robot.of(robot).driving(DriveProfile.of_course(course)), arm, True)

    def slowed(self, factor: float) -> Run:
        """All times multiplied by a factor; those of what acts at given times stay."""
        robot = Robot.of(self.robot).at_pace(factor) if self.whole else self.robot
        return Run(robot, self.motion.time_scaled(factor), self.whole)


def able_to_drive(robot: Robot) -> Robot:
    """The robot on a base whose motion rows of timings give."""
    return robot.driving(_STILL)
