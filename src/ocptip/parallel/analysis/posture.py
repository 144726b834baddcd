"""One pose of a parallel robot: joints with their ranges, motors, distance from singular poses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.text import quantity
from ocptip.numerics.vectors import nearest_turn
from ocptip.parallel.analysis.singularity import Singularity
from ocptip.parallel.description.robot_description import REVOLUTE
from ocptip.parallel.robot import ParallelRobot


@dataclass(frozen=True)
class JointInRange:
    """A joint with a range.

    Attributes:
        leg, joint: numbers from 0.
        value, low, high: rad or m; of a turning joint the turn nearest to the middle of its range.
        unit: "rad" or "m".
    """

    leg: int
    joint: int
    value: float
    low: float
    high: float
    unit: str

    @property
    def left(self) -> float:
        """Distance to the nearer end over half the range; negative beyond; one end: rad or m."""
        distance = min(self.value - self.low, self.high - self.value)
        half = (self.high - self.low) / 2
        return distance / half if np.isfinite(half) else distance

    def __str__(self) -> str:
        """The joint, its value and its range."""
        scale, unit = (180 / np.pi, "deg") if self.unit == "rad" else (1.0, "m")
        ends = f"{scale * self.low:.4g} to {scale * self.high:.4g} {unit}"
        return f"leg {self.leg + 1} joint {self.joint + 1}: {scale * self.value:.4g} in {ends}"


class ChainPosture:
    """A parallel robot in one pose.

    Args:
        robot: the robot.
        z: (m,) coordinates, m and rad.

    Attributes:
        z: as given.
        found: positions of all joints; its `assembly` names their assembly mode.
        motors: (n_a,) positions of the motors, rad or m.

    Raises:
        InputError: the pose is out of reach.
    """

    def __init__(self, robot: ParallelRobot, z: ArrayLike) -> None:
        self.z = robot.kinematics.coordinates("z", z)
        self._robot, self.found = robot, robot.ik(self.z)
        self.motors = np.array([self.found.q[leg][joint] for leg, joint in robot.description.actuated])

    @cached_property
    def singularity(self) -> Singularity:
        """The distance from singular poses."""
        return self._robot.singularity(self.z, self.found.q)

    @cached_property
    def joints(self) -> tuple[JointInRange, ...]:
        """Joints that have a range, those nearest to its ends first."""
        return tuple(sorted(self._in_ranges(), key=lambda joint: joint.left))

    def _in_ranges(self) -> Iterator[JointInRange]:
        legs = zip(self._robot.description.legs, self.found.q, strict=True)
        for leg, (described, values) in enumerate(legs):
            for joint, (row, value) in enumerate(zip(described.joint_rows, values, strict=True)):
                low, high = row.range
                if np.isfinite(row.range).any():
                    turns, both = row.sigma == REVOLUTE, np.isfinite(row.range).all()
                    place = nearest_turn(value, (low + high) / 2) if turns and both else value
                    yield JointInRange(leg, joint, float(place), low, high, "rad" if turns else "m")

    @property
    def beyond(self) -> list[str]:
        """What makes the pose unusable: joints beyond their range, singular poses, another assembly."""
        joints = [str(joint) for joint in self.joints if joint.left < 0]
        kinds = [f"singular: {', '.join(self.singularity.kinds)}"] if self.singularity.kinds else []
        legs = ", ".join(str(leg + 1) for leg in self.found.searched)
        lost = [f"leg {legs}: a singular pose or the end of its reach lies before home"] if legs else []
        return [*joints, *kinds, *lost]

    @property
    def lines(self) -> list[tuple[str, str]]:
        """Names and values."""
        rows, found = self._robot.description.motor_rows, self.singularity
        motors = ", ".join(
            f"{np.degrees(value):.1f} deg" if row.sigma == REVOLUTE else quantity(float(value), "m", 4)
            for row, value in zip(rows, self.motors, strict=True)
        )
        nearest = [("nearest end of a range", str(self.joints[0]))] if self.joints else []
        return [
            ("smallest singular value, platform", f"{found.platform:.3g}"),
            ("smallest singular value, legs", f"{found.legs.min():.3g} (leg {found.legs.argmin() + 1})"),
            ("conditioning of the motors", f"{found.conditioning:.3g}"),
            ("motors", motors),
            *nearest,
        ]

    def __repr__(self) -> str:
        """What makes it unusable, and the values."""
        values = "; ".join(f"{name} {value}" for name, value in self.lines)
        return f"<ChainPosture {'; '.join(self.beyond) or 'usable'}: {values}>"
