"""A parallel robot as a MuJoCo model (MJCF): bodies with mass only, closures as equality constraints.

MuJoCo has no moving bodies without mass, and our legs have many: crosses of universal joints, coupling
joints. Nothing is made up for them:

- a body without mass and one body behind it become one body with several joints, which is the same mechanism;
- a leg's last body, which the platform holds rigidly, gets an equal share of the platform's inertia, and the
  platform keeps the rest: welded together they are the platform again.

Closures of leg ends are `weld`s, ends that turn freely and inner loops are `connect`s, both between sites
(MuJoCo 3.2.3 or newer). MuJoCo's constraints are soft. The stiffest it allows are used; accelerations still
differ by about 1e-4 of those the cut tree would have.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import MARK
from ocptip.parallel.description.frames import (
    Frame,
    central_inertia,
    compose,
    inverse,
    moved_inertia,
    row_frame,
)
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.description.robot_description import FIXED, REVOLUTE, RobotDescription
from ocptip.parallel.export import (
    BASE,
    PLATFORM,
    SKETCH_RADIUS,
    Skeleton,
    joint_name,
    link_name,
)
from ocptip.parallel.robot import ParallelRobot
from ocptip.robots.simulators import inertial, quaternion, text

_STEP = 0.001
_GLUE = 10.0  # m, torquescale: bodies of legs turn easily, and MuJoCo sizes its stiffness by that
_STILL: Frame = (np.eye(3), np.zeros(3))
_LEAST = 1e-14  # MuJoCo's smallest mass and moment of inertia, with a margin
_ROUNDING = 1e-9


@dataclass(eq=False)
class _Solid:
    """Rows that become one body.

    Attributes:
        name: of the body.
        frame: of its last row in the home pose, in the frame of the body before (world axes: none).
        joints: (joint, sigma, axis frame in `frame`) from the base on.
        inertia: about its last row's frame.
        children: bodies behind it.
        sites: (name, frame) of closures.
        segments: ends of the lines drawn from a point.
    """

    name: str
    frame: Frame
    joints: list[tuple[int, int, Frame]] = field(default_factory=list)
    inertia: BodyInertia = field(default_factory=BodyInertia)
    children: list[_Solid] = field(default_factory=list)
    sites: list[tuple[str, Frame]] = field(default_factory=list)
    segments: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)


def to_mjcf(robot: ParallelRobot | RobotDescription) -> str:
    """The robot as an MJCF model with closures, motors (`motor1` ...), and a keyframe `home`.

    Motor forces are the controls, in the order of the description. Drive inertia and friction are the joints'
    `armature`, `damping` and `frictionloss`. The model starts in the home pose (by the joints' `ref`, so that
    positions are those of `ParallelRobot`): MuJoCo scales its constraints by the inertia there, and at zero
    joint positions legs may be singular.

    Args:
        robot: its mobility may differ from the description, but legs must reach the home pose.

    Raises:
        InputError: it cannot be assembled, no leg holds the platform's orientation, or a body cannot be
            MuJoCo's: no mass where neither the body behind nor the platform has some, or an inertia that no
            real body has.
    """
    skeleton = Skeleton.of(robot)
    legs = [_LegSolids(skeleton, i) for i in range(len(skeleton.legs))]
    _add_platform(skeleton, legs)
    root = ET.Element("mujoco", model=skeleton.description.name)
    root.append(ET.Comment(f" {MARK} "))
    _settings(root, skeleton)
    base = ET.SubElement(ET.SubElement(root, "worldbody"), "body", name=BASE)
    order: list[tuple[int, int]] = []
    for i, leg in enumerate(legs):
        _segments(base, [(np.zeros(3), end) for end in [skeleton.place(i)[1]] if np.any(end)])
        for solid in leg.roots:
            _body(base, skeleton, i, solid, order)
    _equalities(root, skeleton)
    actuator = ET.SubElement(root, "actuator")
    for number, (leg, joint) in enumerate(skeleton.description.actuated, start=1):
        ET.SubElement(actuator, "motor", name=f"motor{number}", joint=joint_name(leg, joint))
    home = [skeleton.home[leg][joint] for leg, joint in order]
    ET.SubElement(ET.SubElement(root, "keyframe"), "key", name="home", qpos=text(home))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


class _LegSolids:
    """Bodies of a leg.

    Attributes:
        roots: bodies on the base.
        place: per row the body it belongs to, and its frame there.
    """

    def __init__(self, skeleton: Skeleton, number: int) -> None:
        leg = skeleton.legs[number]
        self._rows, self._number = leg.topology.rows, number
        self._parents, self._joints = leg.topology.parents, leg.topology.joints
        self._kept = set(leg.topology.ends)
        self.roots: list[_Solid] = []
        self.place: list[tuple[_Solid, Frame]] = []
        merged: dict[int, _Solid] = {}
        for row in range(len(self._rows)):
            self._add(skeleton, row, merged)

    def _add(self, skeleton: Skeleton, k: int, merged: dict[int, _Solid]) -> None:
        row, parent = self._rows[k], self._parents[k]
        joint = self._joints[k]
        joint_frame = row_frame(row, 0.0 if joint is None else skeleton.home[self._number][joint])
        before = self.place[parent] if parent >= 0 else None
        body, segments = skeleton.body(self._number, k), skeleton.segments(self._number, k)
        if row.sigma == FIXED and before is not None:
            solid, frame = before[0], compose(before[1], joint_frame)
        elif parent in merged:
            solid, frame = self._joined(merged.pop(parent), joint_frame), _STILL
        else:
            place = skeleton.place(self._number) if before is None else before[1]
            solid, frame = _Solid(link_name(self._number, k), compose(place, joint_frame)), _STILL
            (self.roots if before is None else before[0].children).append(solid)
        if joint is not None:
            solid.joints.append((joint, row.sigma, _STILL))
            solid.name = link_name(self._number, k)
        solid.inertia = _sum(solid.inertia, moved_inertia(body, frame))
        solid.segments += [(frame[1], frame[0] @ end + frame[1]) for end in segments]
        self.place.append((solid, frame))
        if self._can_join(k, body):
            merged[k] = solid

    def _joined(self, solid: _Solid, joint_frame: Frame) -> _Solid:
        """A body without mass, from now on that of the row behind: its frame moves there."""
        back = inverse(joint_frame)
        solid.frame = compose(solid.frame, joint_frame)
        solid.joints = [(joint, sigma, compose(back, frame)) for joint, sigma, frame in solid.joints]
        solid.segments = []
        self.place = [(one, compose(back, frame) if one is solid else frame) for one, frame in self.place]
        return solid

    def _can_join(self, k: int, body: BodyInertia) -> bool:
        """True if nothing but one moving row depends on the body of a row."""
        children = [j for j, parent in enumerate(self._parents) if parent == k]
        single = len(children) == 1 and self._rows[children[0]].sigma != FIXED
        return body.massless and single and k not in self._kept and self._rows[k].sigma != FIXED


def _add_platform(skeleton: Skeleton, legs: list[_LegSolids]) -> None:
    """Put the platform on its carrier, share its inertia with bodies that are welded to it; add all sites."""
    solid, frame = legs[skeleton.carrier[0]].place[skeleton.carrier[1]]
    platform = _Solid(PLATFORM, compose(frame, skeleton.mount))
    solid.children.append(platform)
    # Bodies that are one with the platform, and the platform's frame in theirs.
    rigid = [(solid, platform.frame)]
    for closure in skeleton.closures:
        held, place = legs[closure.leg].place[closure.row]
        held.sites.append((f"{closure.name}_leg", place))
        if closure.other is None:
            platform.sites.append((f"{closure.name}_other", closure.frame))
            if closure.rigid:
                rigid.append((held, compose(place, inverse(closure.frame))))
        else:
            other, there = legs[closure.leg].place[closure.other]
            other.sites.append((f"{closure.name}_other", there))
    needy = [(held, place) for held, place in rigid if not _real(held.inertia)]
    share = BodyInertia.from_vector(skeleton.description.platform.inertia.vector / (len(needy) + 1))
    for held, place in needy:
        held.inertia = _sum(held.inertia, moved_inertia(share, place))
    platform.inertia = share
    platform.segments = [(np.zeros(3), end) for end in skeleton.platform_points()]


def _body(
    parent: ET.Element, skeleton: Skeleton, leg: int, solid: _Solid, order: list[tuple[int, int]]
) -> None:
    """Write a body and those behind it; append its joints to the order of MuJoCo's positions."""
    element = ET.SubElement(parent, "body", name=solid.name, **_pose(solid.frame))
    _inertial(element, solid)
    for joint, sigma, frame in solid.joints:
        order.append((leg, joint))
        armature, damping, friction = skeleton.legs[leg].drives[:, joint]
        terms = {"armature": armature, "damping": damping, "frictionloss": friction}
        ET.SubElement(
            element,
            "joint",
            name=joint_name(leg, joint),
            type="hinge" if sigma == REVOLUTE else "slide",
            pos=text(frame[1]),
            axis=text(frame[0][:, 2]),
            ref=text(skeleton.home[leg][joint]),
            attrib={name: text(value) for name, value in terms.items() if value},
        )
    _segments(element, solid.segments)
    for name, frame in solid.sites:
        ET.SubElement(element, "site", name=name, **_pose(frame))
    for child in solid.children:
        _body(element, skeleton, leg, child, order)


def _inertial(element: ET.Element, solid: _Solid) -> None:
    if not solid.joints and solid.inertia.massless:
        return  # rests, or is welded to a body with mass
    body = solid.inertia.mass, *central_inertia(solid.inertia)
    if not _real(solid.inertia):
        moments = np.linalg.eigvalsh(body[2])
        raise InputError(
            f"{solid.name}: MuJoCo cannot simulate this body (mass {solid.inertia.mass:.3g} kg, principal "
            f"moments {text(moments.round(9))} kg m^2); every moving body needs mass and the moments of "
            "inertia of a real body"
        )
    inertial(element, body)


def _real(body: BodyInertia) -> bool:
    """True if a body in three dimensions can have this inertia, and MuJoCo takes it."""
    if not body.mass > _LEAST:
        return False
    moments = np.linalg.eigvalsh(body.central)
    return bool(moments[0] > _LEAST and moments[0] + moments[1] >= moments[2] * (1 - _ROUNDING))


def _sum(a: BodyInertia, b: BodyInertia) -> BodyInertia:
    return BodyInertia.from_vector(a.vector + b.vector)


def _settings(root: ET.Element, skeleton: Skeleton) -> None:
    """Units, gravity, solver; stiff closures; a sketch that touches nothing."""
    ET.SubElement(root, "compiler", angle="radian", autolimits="false", inertiafromgeom="false")
    option: dict[str, Any] = {
        "timestep": text(_STEP),
        "integrator": "implicitfast",
        "solver": "Newton",
        "tolerance": "1e-12",
    }
    ET.SubElement(root, "option", gravity=text(skeleton.description.gravity), **option)
    defaults = ET.SubElement(root, "default")
    ET.SubElement(defaults, "equality", solref=text([2 * _STEP, 1.0]), solimp="0.9999 0.9999 0.001 0.5 2")
    touchless: dict[str, Any] = {"contype": "0", "conaffinity": "0", "mass": "0"}
    colour = "0.4 0.5 0.6 1"
    ET.SubElement(defaults, "geom", type="capsule", size=text(SKETCH_RADIUS), rgba=colour, **touchless)
    ET.SubElement(defaults, "site", size=text(SKETCH_RADIUS / 2))


def _equalities(root: ET.Element, skeleton: Skeleton) -> None:
    equality = ET.SubElement(root, "equality")
    for closure in skeleton.closures:
        sites: dict[str, Any] = {"site1": f"{closure.name}_leg", "site2": f"{closure.name}_other"}
        glue: dict[str, Any] = {"torquescale": text(_GLUE)} if closure.rigid else {}
        ET.SubElement(equality, "weld" if closure.rigid else "connect", name=closure.name, **sites, **glue)


def _segments(element: ET.Element, segments: Iterable[tuple[np.ndarray, np.ndarray]]) -> None:
    for start, end in segments:
        ET.SubElement(element, "geom", fromto=text([*start, *end]))


def _pose(frame: Frame) -> dict[str, Any]:
    """Attributes pos and quat."""
    return {"pos": text(frame[1]), "quat": text(quaternion(frame[0]))}
