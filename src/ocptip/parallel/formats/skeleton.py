"""A parallel robot as a tree of named frames with closures: what the exports to other formats share.

The platform hangs on the first leg end that holds its orientation, in general on leg 1; all other ends, and
the inner loops of branched legs, are closures.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.parallel.description.body_inertia import BodyInertia
from ocptip.parallel.description.mdh import Frame, compose
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.kinematics.closures import LegClosure
from ocptip.parallel.kinematics.platform import Kinematics
from ocptip.parallel.robot import ParallelRobot

PLATFORM = "platform"
BASE = "base"
SKETCH_RADIUS = 0.01
"""Radius of the lines that are drawn from joint to joint, m."""


@dataclass(frozen=True, eq=False)
class Closure:
    """Two frames that coincide in the real robot.

    Attributes:
        leg, row: of the first frame (from 0).
        other: row of the second frame, in the same leg; None: the second frame is on the platform.
        frame: the second frame in the platform frame, or in its row's (its origin only, for inner loops).
        rigid: True if the axes also coincide; else only the origins.
        name: of the second frame.
    """

    leg: int
    row: int
    other: int | None
    frame: Frame
    rigid: bool
    name: str


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A robot's tree, assembled in the home pose.

    Attributes:
        description: the robot.
        legs: its legs with base frames.
        home: (n,) joint positions per leg, rad or m.
        carrier: leg and row (from 0) that carry the platform.
        mount: platform frame in that row's frame.
        closures: all others.
    """

    description: RobotDescription
    legs: tuple[LegClosure, ...]
    home: tuple[np.ndarray, ...]
    carrier: tuple[int, int]
    mount: Frame
    closures: tuple[Closure, ...]

    @classmethod
    def of(cls, robot: ParallelRobot | RobotDescription) -> Skeleton:
        """Assemble a robot.

        Raises:
            InputError: it cannot be assembled, or no leg holds the platform's orientation.
        """
        if not isinstance(robot, ParallelRobot | RobotDescription):
            raise InputError(
                f"robot: expected a ParallelRobot or RobotDescription, got {type(robot).__name__}"
            )
        kinematics = robot.kinematics if isinstance(robot, ParallelRobot) else Kinematics(robot)
        ends = [
            (i, row, kappa, turn)
            for i, leg in enumerate(kinematics.legs)
            for row, kappa, turn in zip(leg.end_rows, leg.couplings, leg.end_rotations, strict=True)
        ]
        held = [k for k, end in enumerate(ends) if end[3] is not None]
        if not held:
            raise InputError(
                f"{kinematics.description.name}: no leg end holds the platform's orientation; give one of "
                "them its three coupling joints as rows and an end_rotation"
            )
        leg, row, kappa, turn = ends.pop(held[0])
        closures = [_end_closure(ends, k) for k in range(len(ends))]
        for i, one in enumerate(kinematics.legs):
            closures += [
                Closure(i, a, b, (np.eye(3), np.zeros(3)), False, f"leg{i + 1}_loop{k}")
                for k, (a, b) in enumerate(one.loop_rows, start=1)
            ]
        home = kinematics.joints(kinematics.description.home, [one.home for one in kinematics.legs]).q
        assert turn is not None, "the home pose fixes the orientation of every serial end"
        mount = (turn, -turn @ kappa)
        legs = tuple(kinematics.legs)
        return cls(kinematics.description, legs, home, (leg, row), mount, tuple(closures))

    def body(self, leg: int, row: int) -> BodyInertia:
        """Inertia of a row's body about its frame."""
        bodies = self.legs[leg].leg.bodies
        return bodies[row] if row < len(bodies) else BodyInertia()

    def segments(self, leg: int, row: int) -> list[np.ndarray]:
        """(3,) points, in a row's frame, m, where the rows and the platform behind it begin at home.

        Lines from the frame's origin to them are the sketch of the body; row -1 is the base.
        """
        one = self.legs[leg]
        rotations, origins = one.frames(self.home[leg])
        own = (rotations[row], origins[row]) if row >= 0 else (np.eye(3), np.zeros(3))
        points = [origins[k] for k, parent in enumerate(one.topology.parents) if parent == row]
        return [local for point in points if np.linalg.norm(local := own[0].T @ (point - own[1])) > 1e-6]

    def platform_points(self) -> list[np.ndarray]:
        """(3,) coupling points in the platform frame, m."""
        return [kappa for leg in self.legs for kappa in leg.couplings if np.linalg.norm(kappa) > 1e-6]

    def place(self, leg: int) -> Frame:
        """Base frame of a leg, world axes."""
        return self.legs[leg].base, self.legs[leg].origin


def link_name(leg: int, row: int) -> str:
    """Name of the body of a row; both from 0."""
    return f"leg{leg + 1}_link{row + 1}"


def joint_name(leg: int, joint: int) -> str:
    """Name of a joint; both from 0."""
    return f"leg{leg + 1}_joint{joint + 1}"


def numbers(values: Iterable[float]) -> str:
    """Numbers of an XML attribute, to the last digit."""
    return " ".join(repr(float(v) + 0.0) for v in values)


def _end_closure(ends: list[tuple[int, int, np.ndarray, np.ndarray | None]], k: int) -> Closure:
    leg, row, kappa, turn = ends[k]
    number = sum(other[0] == leg for other in ends[:k])
    several = sum(other[0] == leg for other in ends) > 1
    name = f"{PLATFORM}_leg{leg + 1}" + (f"_end{number + 1}" if several else "")
    R = np.eye(3) if turn is None else turn.T
    return Closure(leg, row, None, compose((np.eye(3), kappa), (R, np.zeros(3))), turn is not None, name)
