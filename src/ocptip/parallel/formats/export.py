"""A parallel robot in the formats of other programs: URDF and MJCF.

Both hold the complete legs, all coupling joints included, with the platform on leg 1, and name things alike:
links `leg1_link1` by the leg's rows, joints `leg1_joint1`, `platform`. Joint positions are those of
`ParallelRobot`. Lines from joint to joint are drawn as a sketch; they have no mass and touch nothing.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import MARK
from ocptip.parallel.description.body_inertia import BodyInertia
from ocptip.parallel.description.entries import elementary_rotation
from ocptip.parallel.description.mdh import Frame, central_inertia, row_frame
from ocptip.parallel.description.robot_description import REVOLUTE, RobotDescription
from ocptip.parallel.formats.skeleton import (
    BASE,
    PLATFORM,
    SKETCH_RADIUS,
    Skeleton,
    joint_name,
    link_name,
    numbers,
)
from ocptip.parallel.robot import ParallelRobot

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
    _fixed_joint(root, f"{PLATFORM}_mount", link_name(*skeleton.carrier), PLATFORM, skeleton.mount)
    for closure in skeleton.closures:
        if closure.other is None:
            _link(root, closure.name, BodyInertia(), [])
            _fixed_joint(root, f"{closure.name}_mount", PLATFORM, closure.name, closure.frame)
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
    _fixed_joint(root, f"{foot}_mount", BASE, foot, skeleton.place(i))
    for k, (row, parent, joint) in enumerate(
        zip(leg.topology.rows, leg.topology.parents, leg.topology.joints, strict=True)
    ):
        body = skeleton.body(i, k)
        if body.mass == 0 and body.first_moment.any():
            raise InputError(f"leg {i + 1}, body {k + 1}: URDF needs mass where there is a first moment")
        _link(root, link_name(i, k), body, skeleton.segments(i, k))
        before = foot if parent < 0 else link_name(i, parent)
        if joint is None:
            _fixed_joint(root, f"leg{i + 1}_fixed{k + 1}", before, link_name(i, k), row_frame(row))
            continue
        kind = "continuous" if row.sigma == REVOLUTE else "prismatic"
        made = _joint(root, joint_name(i, joint), kind, before, link_name(i, k), row_frame(row))
        ET.SubElement(made, "axis", xyz="0 0 1")
        if kind == "prismatic":
            ET.SubElement(made, "limit", lower="-1000", upper="1000", effort=_LIMIT, velocity=_LIMIT)
        _, viscous, coulomb = skeleton.legs[i].drives[:, joint].tolist()
        if viscous or coulomb:
            ET.SubElement(made, "dynamics", damping=repr(viscous), friction=repr(coulomb))


def _link(root: ET.Element, name: str, body: BodyInertia, ends: list[np.ndarray]) -> None:
    link = ET.SubElement(root, "link", name=name)
    if not body.massless:
        center, about = central_inertia(body)
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=numbers(center), rpy="0 0 0")
        ET.SubElement(inertial, "mass", value=repr(float(body.mass)))
        names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        values = about[np.triu_indices(3)]
        ET.SubElement(inertial, "inertia", {n: repr(float(v)) for n, v in zip(names, values, strict=True)})
    for end in ends:
        visual = ET.SubElement(link, "visual")
        ET.SubElement(visual, "origin", xyz=numbers(end / 2), rpy=numbers(_towards(end)))
        shape = ET.SubElement(visual, "geometry")
        length = repr(float(np.linalg.norm(end)))
        ET.SubElement(shape, "cylinder", radius=repr(SKETCH_RADIUS), length=length)


def _joint(root: ET.Element, name: str, kind: str, parent: str, child: str, frame: Frame) -> ET.Element:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=numbers(frame[1]), rpy=numbers(_roll_pitch_yaw(frame[0])))
    return joint


def _fixed_joint(root: ET.Element, name: str, parent: str, child: str, frame: Frame) -> None:
    _joint(root, name, "fixed", parent, child, frame)


def _roll_pitch_yaw(R: np.ndarray) -> tuple[float, float, float]:
    """Angles of R = Rz(yaw) Ry(pitch) Rx(roll), also where only roll - yaw counts."""
    cosine = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], cosine)
    yaw = math.atan2(R[1, 0], R[0, 0]) if cosine > 1e-9 else 0.0
    rest = (elementary_rotation("z", yaw) @ elementary_rotation("y", pitch)).T @ R
    return math.atan2(rest[2, 1], rest[2, 2]), pitch, yaw


def _towards(end: np.ndarray) -> tuple[float, float, float]:
    """Roll, pitch, yaw that turn z onto a direction."""
    return 0.0, math.atan2(math.hypot(end[0], end[1]), end[2]), math.atan2(end[1], end[0])
