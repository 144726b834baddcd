"""Parallel robots from URDF: a tree of links plus a list of cut joints.

The root link is the base. Leg 1 is the chain of joints from the root to the platform's link; every cut adds
the leg that ends there, and says which frame (link) of it coincides with which frame of the platform in the
real robot, and how the two are joined. Legs share no moving joint, and every moving joint belongs to a leg.

==========  ===========================================================================================
kind        what the cut joint is
==========  ===========================================================================================
fixed       the leg has all its coupling joints: the two frames are one
revolute    the z axes of the two frames are one
universal   a cross on the z axes of the two frames, which are perpendicular; the origins coincide
spherical   the origins coincide
==========  ===========================================================================================
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.basics.errors import InputError, naming, positive_number
from ocptip.parallel.description.frames import Frame, compose, inverse, rotation_angles, rotation_vector
from ocptip.parallel.description.platform import COORDINATES, BodyInertia, Platform, product_of
from ocptip.parallel.description.robot_description import RobotDescription, SerialLeg
from ocptip.parallel.export import Skeleton, joint_name, link_name
from ocptip.parallel.kinematics.closures import LegClosure
from ocptip.parallel.robot import ParallelRobot
from tests.oracles.parallel_urdf.assembly import closed_home, free_coordinates, platform_frame
from tests.oracles.parallel_urdf.legs import Cut, UrdfLeg

if TYPE_CHECKING:
    from tests.oracles.parallel_urdf.tree import UrdfTree

_OPEN_ANGLE = 1e-3


@dataclass(frozen=True, eq=False)
class LinkPlace:
    """Where a link of the URDF is in the robot.

    Attributes:
        leg: number of the leg (from 0) whose body it is part of; -1 for the base. The platform's links are on
            leg 1.
        row: MDH row (from 0) of that leg whose frame it is fixed to; -1 for the base.
        rotation: (3, 3), link axes to the row frame's axes (world axes for the base).
        position: (3,), m, link's origin in the row's frame (world axes for the base).
    """

    leg: int
    row: int
    rotation: np.ndarray
    position: np.ndarray


@dataclass(frozen=True, eq=False)
class UrdfRobot:
    """A robot read from URDF, and how its parts are called there.

    Attributes:
        description: the robot; joint positions are those of the URDF, world axes those of its root link.
        joints: per leg the URDF's joints; joints that a cut adds are called "cut1 universal 1" and so on.
        links: place of every link.
        platform: rotation (3, 3) and origin (3,), m, of the description's platform frame in the frame of the
            platform's link; the two are the same unless a locked coordinate of the link is not zero.
    """

    description: RobotDescription
    joints: tuple[tuple[str, ...], ...]
    links: dict[str, LinkPlace]
    platform: Frame


def read_parallel_urdf(path: str | os.PathLike[str], **options: Any) -> RobotDescription:
    """Read a parallel robot from a URDF file; arguments as of :func:`convert_parallel_urdf`."""
    return convert_parallel_urdf(path, **options).description


def convert_parallel_urdf(
    path: str | os.PathLike[str],
    *,
    platform: str,
    cuts: Sequence[Cut | tuple[str, ...]],
    actuated: Sequence[str],
    home: Mapping[str, float] | None = None,
    free: Sequence[str] | None = None,
    convention: str = "xyz",
    redundant: Sequence[str] = (),
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    name: str | None = None,
    tolerance: float = 1e-4,
    snap: float = 1e-9,
) -> UrdfRobot:
    """Read a parallel robot from a URDF file and keep the names.

    The legs become MDH rows. Zero joint positions, joint directions, masses and the friction of `dynamics`
    tags are the file's; what is rigid with the platform is part of it. Limits, meshes and mimic tags are not
    used.

    Args:
        path: the URDF file.
        platform: link at the end of leg 1.
        cuts: one per further leg, as :class:`Cut` or tuples (leg link, platform link[, kind]).
        actuated: joints with motors, in the order of the motor forces.
        home: joint positions of an assembled configuration, rad or m; those that are not given are zero.
        free: free coordinates out of x, y, z, phi1, phi2, phi3; None: found in the home pose.
        convention: Euler angles of the platform.
        redundant: joints that are coordinates besides the platform's.
        gravity: (3,), m/s^2, in axes of the root link.
        name: of the robot; default the file's.
        tolerance: largest gap of the cuts in the home pose that is closed silently, m.
        snap: angles nearer than this (rad) to a multiple of pi/2 and offsets nearer than this (m) to zero are
            exactly so. Files with few digits (rpy="1.5708 0 0") need about 1e-5.

    Raises:
        InputError: a file that cannot be read, unknown names (with those that exist), joints in no leg or in
            two, or cuts that are open in the home pose (with the gap in mm).
    """
    from tests.oracles.parallel_urdf.tree import UrdfTree

    Platform((True,) * 6, convention)  # refuses an unknown convention
    tree = UrdfTree(path)
    with naming(Path(path).name):
        legs = _legs(tree, platform, cuts, snap)
        q = tree.joint_positions(home or {})
        frames = tree.frames(q)
        for number, leg in enumerate(legs[1:], start=1):
            _require_closed(number, leg.cut, frames, positive_number("tolerance", tolerance))
        assembly = _Assembly(tree, legs, platform, frames, q, convention, snap)
        mask = _mask(free) if free is not None else assembly.mask()
        description, moved = assembly.description(
            mask,
            name=name or tree.name,
            actuated=_pairs(tree, legs, "actuated", actuated),
            redundant=_pairs(tree, legs, "redundant", redundant),
            gravity=gravity,
        )
    return UrdfRobot(description, tuple(leg.names for leg in legs), _places(tree, legs), moved)


class _Assembly:
    """The legs put together in the home pose."""

    def __init__(
        self,
        tree: UrdfTree,
        legs: Sequence[UrdfLeg],
        platform: str,
        frames: Mapping[str, Frame],
        q: np.ndarray,
        convention: str,
        snap: float,
    ) -> None:
        self._tree, self._legs, self._convention = tree, legs, convention
        self._q = [leg.home(q, frames) for leg in legs]
        self._ends = [leg.end(frames) for leg in legs]
        self._sides = [compose(inverse(frames[platform]), frames[leg.platform_link]) for leg in legs]
        self._closures = self._closed_by_links()
        self._q, (R, p) = closed_home(self._closures, self._q, frames[platform])
        self._home = product_of(rotation_angles(R, snap)), p

    def mask(self) -> tuple[bool, ...]:
        """Free platform coordinates."""
        return free_coordinates(self._closures, self._q, self._home, self._convention)

    def description(
        self, mask: tuple[bool, ...], *, redundant: tuple[tuple[int, int], ...], **options: Any
    ) -> tuple[RobotDescription, Frame]:
        """The robot, and its platform frame in the platform link's."""
        placed, z = platform_frame(self._home, mask, self._convention)
        moved = compose(inverse(self._home), placed)
        back = inverse(moved)
        legs = [
            leg.leg(self._tree, compose(back, side), end, values, wanted=sum(mask[:3]))
            for leg, side, end, values in zip(self._legs, self._sides, self._ends, self._q, strict=True)
        ]
        legs, inertia = self._with_platform(legs, moved)
        home = np.concatenate([z, [self._q[leg][joint] for leg, joint in redundant]])
        body = Platform(mask, self._convention, inertia)
        given = {**options, "platform": body, "home": home, "redundant": redundant}
        return RobotDescription(legs=tuple(legs), **given), moved

    def _closed_by_links(self) -> list[LegClosure]:
        """The legs with the platform's link as platform frame."""
        parts = zip(self._legs, self._sides, self._ends, self._q, strict=True)
        legs = (leg.leg(self._tree, side, end, values, wanted=None) for leg, side, end, values in parts)
        return [LegClosure(i, leg) for i, leg in enumerate(legs)]

    def _with_platform(self, legs: Sequence[SerialLeg], moved: Frame) -> tuple[list[SerialLeg], BodyInertia]:
        """Legs without, and the platform with the bodies that are rigid with it."""
        total, lighter = np.zeros(10), []
        for source, leg, side in zip(self._legs, legs, self._sides, strict=True):
            own, body = source.without_last_body(self._tree, leg, compose(inverse(moved), side))
            lighter.append(own)
            total += body.vector
        return lighter, BodyInertia.from_vector(total)


def _legs(tree: UrdfTree, platform: str, cuts: Sequence[Cut | tuple[str, ...]], snap: float) -> list[UrdfLeg]:
    body = tree.link("platform", platform)
    if body == 0:
        raise InputError(f"platform: link {platform!r} does not move; it must be at the end of a leg")
    if not cuts:
        raise InputError("cuts: a parallel robot needs at least one, else it is a serial arm")
    legs = [UrdfLeg(tree, 0, Cut(platform, platform), tree.chain(body), snap)]
    for number, given in enumerate(cuts, start=1):
        cut = _cut(number, given)
        where = f"cuts[{number}]"
        if tree.link(f"{where}.platform", cut.platform) != body:
            raise InputError(f"{where}.platform: link {cut.platform!r} is not fixed on {platform!r}")
        end = tree.link(f"{where}.leg", cut.leg)
        if end == 0:
            raise InputError(f"{where}.leg: link {cut.leg!r} does not move; it must be at the end of a leg")
        legs.append(UrdfLeg(tree, number, cut, tree.chain(end), snap))
    used = [joint for leg in legs for joint in leg.chain]
    for joint, name in enumerate(tree.joints, start=1):
        if used.count(joint) != 1:
            many = "none of the legs" if joint not in used else "more than one leg"
            ends = ", ".join(leg.cut.leg for leg in legs)
            raise InputError(
                f"joint {name!r}: belongs to {many}; the legs are the chains from the root link "
                f"{tree.links[0]!r} to {ends}, and every moving joint must be in one of them"
            )
    return legs


def _cut(number: int, given: object) -> Cut:
    if isinstance(given, Cut):
        return given
    parts = given if isinstance(given, tuple | list) else ()
    if len(parts) not in (2, 3) or not all(isinstance(part, str) for part in parts):
        raise InputError(f"cuts[{number}]: expected a Cut or (leg link, platform link, kind), got {given!r}")
    return Cut(*parts)


def _require_closed(number: int, cut: Cut, frames: Mapping[str, Frame], tolerance: float) -> None:
    (A, a), (B, b) = frames[cut.leg], frames[cut.platform]
    gap, angle = float(np.linalg.norm(a - b)), 0.0
    if cut.kind == "fixed":
        angle = float(np.linalg.norm(rotation_vector(A.T @ B)))
    elif cut.kind == "revolute":
        angle = math.atan2(float(np.linalg.norm(np.cross(A[:, 2], B[:, 2]))), float(A[:, 2] @ B[:, 2]))
    elif cut.kind == "universal":
        angle = abs(math.asin(max(-1.0, min(1.0, float(A[:, 2] @ B[:, 2])))))
    if gap > tolerance or angle > _OPEN_ANGLE:
        raise InputError(
            f"cuts[{number}]: {cut.leg!r} and {cut.platform!r} ({cut.kind}) are {1000 * gap:.3g} mm and "
            f"{math.degrees(angle):.3g} deg apart in the home pose; give the joint positions of an assembled "
            "configuration as `home`"
        )


def _mask(free: Sequence[str]) -> tuple[bool, ...]:
    for coordinate in free:
        if coordinate not in COORDINATES:
            raise InputError(f"free: expected names among {', '.join(COORDINATES)}, got {coordinate!r}")
    return tuple(coordinate in free for coordinate in COORDINATES)


def _pairs(
    tree: UrdfTree, legs: Sequence[UrdfLeg], argument: str, names: Sequence[str]
) -> tuple[tuple[int, int], ...]:
    pairs = []
    for name in names:
        joint = tree.joint(argument, name)
        pairs += [(i, leg.chain.index(joint)) for i, leg in enumerate(legs) if joint in leg.chain]
    return tuple(pairs)


def _places(tree: UrdfTree, legs: Sequence[UrdfLeg]) -> dict[str, LinkPlace]:
    zero = tree.frames(np.zeros(len(tree.joints)))
    places = {}
    for link, frame in zero.items():
        joint = tree.link("link", link)
        if joint == 0:
            places[link] = LinkPlace(-1, -1, *frame)
            continue
        for i, leg in enumerate(legs):
            if joint in leg.chain:
                row = leg.chain.index(joint)
                places[link] = LinkPlace(i, row, *compose(inverse(leg.frames[row]), frame))
    return places


def urdf_cuts(robot: ParallelRobot | RobotDescription) -> tuple[Cut, ...]:
    """The cut joints of `to_urdf` as the reader takes them.

    Raises:
        InputError: a leg branches; the reader knows chains only.
    """
    skeleton = Skeleton.of(robot)
    for closure in skeleton.closures:
        if skeleton.legs[closure.leg].topology.parents != tuple(range(-1, closure.row)):
            raise InputError(
                f"leg {closure.leg + 1}: branches or has loops; only chains can be read from URDF"
            )
    return tuple(Cut(link_name(c.leg, c.row), c.name, "fixed") for c in skeleton.closures)


def urdf_home(robot: ParallelRobot | RobotDescription) -> dict[str, float]:
    """Joint positions of the home pose by the names of `to_urdf`, rad or m."""
    skeleton = Skeleton.of(robot)
    return {joint_name(i, j): float(value) for i, q in enumerate(skeleton.home) for j, value in enumerate(q)}
