"""A parallel robot in the formats of other programs: URDF and MJCF.

Both hold the complete legs, all coupling joints included, with the platform on leg 1, and name things alike:
links `leg1_link1` by the leg's rows, joints `leg1_joint1`, `platform`. Joint positions are those of
`ParallelRobot`. Lines from joint to joint are drawn as a sketch; they have no mass and touch nothing.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import MARK
from ocptip.parallel.description.frames import Frame, central_inertia, compose, row_frame
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.description.robot_description import REVOLUTE, RobotDescription
from ocptip.parallel.kinematics.closures import LegClosure
from ocptip.parallel.kinematics.platform import Kinematics
from ocptip.parallel.robot import ParallelRobot
from ocptip.robots.simulators import add, text, urdf_joint, urdf_link

_LIMIT = "1000000"


def to_urdf(robot: ParallelRobot | RobotDescription) -> str:
    """The robot as URDF: a tree, because URDF knows no loops.

    A frame `platform_leg2` on the platform coincides with the last link of leg 2 in the closed robot, and so
    on; comments in the file list the pairs and the home positions of the joints. Drive inertia is lost.

    Args:
        robot: its mobility may differ from the description, but legs must reach the home pose.

    Raises:
        InputError: it cannot be assembled, no leg holds the platform's orientation, or a body without mass
            has a first moment.
    """
    skeleton = Skeleton.of(robot)
    root = ET.Element("robot", name=skeleton.description.name)
    for line in _remarks(skeleton):
        root.append(ET.Comment(f" {line} "))
    points = [skeleton.place(i)[1] for i in range(len(skeleton.legs))]
    _link(root, BASE, BodyInertia(), [p for p in points if np.linalg.norm(p) > 1e-6])
    for i in range(len(skeleton.legs)):
        _leg(root, skeleton, i)
    _link(root, PLATFORM, skeleton.description.platform.inertia, skeleton.platform_points())
    _joint(root, f"{PLATFORM}_mount", "fixed", link_name(*skeleton.carrier), PLATFORM, skeleton.mount)
    for closure in skeleton.closures:
        if closure.other is None:
            _link(root, closure.name, BodyInertia(), [])
            _joint(root, f"{closure.name}_mount", "fixed", PLATFORM, closure.name, closure.frame)
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _remarks(skeleton: Skeleton) -> list[str]:
    lines = [f"{MARK}; SI units, rad"]
    for closure in skeleton.closures:
        other = closure.name if closure.other is None else link_name(closure.leg, closure.other)
        what = "are one frame" if closure.rigid else "have one origin"
        lines.append(f"cut: {link_name(closure.leg, closure.row)} and {other} {what}")
    homes = (f"{joint_name(i, j)} {float(v)!r}" for i, q in enumerate(skeleton.home) for j, v in enumerate(q))
    # "--" may not be in a comment of XML, but numbers never have it.
    return [*lines, "home: " + ", ".join(homes)]


def _leg(root: ET.Element, skeleton: Skeleton, i: int) -> None:
    leg = skeleton.legs[i]
    foot = f"leg{i + 1}_base"
    _link(root, foot, BodyInertia(), [])
    _joint(root, f"{foot}_mount", "fixed", BASE, foot, skeleton.place(i))
    for k, (row, parent, joint) in enumerate(
        zip(leg.topology.rows, leg.topology.parents, leg.topology.joints, strict=True)
    ):
        body = skeleton.body(i, k)
        if body.mass == 0 and body.first_moment.any():
            raise InputError(f"leg {i + 1}, body {k + 1}: URDF needs mass where there is a first moment")
        _link(root, link_name(i, k), body, skeleton.segments(i, k))
        before = foot if parent < 0 else link_name(i, parent)
        if joint is None:
            _joint(root, f"leg{i + 1}_fixed{k + 1}", "fixed", before, link_name(i, k), row_frame(row))
            continue
        kind = "continuous" if row.sigma == REVOLUTE else "prismatic"
        made = _joint(root, joint_name(i, joint), kind, before, link_name(i, k), row_frame(row))
        add(made, "axis", xyz="0 0 1")
        if kind == "prismatic":
            add(made, "limit", lower="-1000", upper="1000", effort=_LIMIT, velocity=_LIMIT)
        _, viscous, coulomb = skeleton.legs[i].drives[:, joint].tolist()
        if viscous or coulomb:
            add(made, "dynamics", damping=text(viscous), friction=text(coulomb))


def _link(root: ET.Element, name: str, body: BodyInertia, ends: list[np.ndarray]) -> None:
    link = urdf_link(root, name, None if body.massless else (body.mass, *central_inertia(body)))
    for end in ends:
        visual = add(link, "visual")
        add(visual, "origin", xyz=text(end / 2), rpy=text(_towards(end)))
        length = text(np.linalg.norm(end))
        add(add(visual, "geometry"), "cylinder", radius=text(SKETCH_RADIUS), length=length)


def _joint(root: ET.Element, name: str, kind: str, parent: str, child: str, frame: Frame) -> ET.Element:
    return urdf_joint(root, name, kind, parent, child, frame[1], frame[0])


def _towards(end: np.ndarray) -> tuple[float, float, float]:
    """Roll, pitch, yaw that turn z onto a direction."""
    return 0.0, np.arctan2(np.hypot(end[0], end[1]), end[2]), np.arctan2(end[1], end[0])


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
        frame = (rotations[row], origins[row]) if row >= 0 else (np.eye(3), np.zeros(3))
        points = [origins[k] for k, parent in enumerate(one.topology.parents) if parent == row]
        return [local for point in points if np.linalg.norm(local := frame[0].T @ (point - frame[1])) > 1e-6]

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


def _end_closure(ends: list[tuple[int, int, np.ndarray, np.ndarray | None]], k: int) -> Closure:
    leg, row, kappa, turn = ends[k]
    number = sum(other[0] == leg for other in ends[:k])
    several = sum(other[0] == leg for other in ends) > 1
    name = f"{PLATFORM}_leg{leg + 1}" + (f"_end{number + 1}" if several else "")
    R = np.eye(3) if turn is None else turn.T
    return Closure(leg, row, None, compose((np.eye(3), kappa), (R, np.zeros(3))), turn is not None, name)
