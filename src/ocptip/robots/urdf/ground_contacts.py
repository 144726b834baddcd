"""Where the base of a URDF touches the ground: wheels, casters, else the lowest points of its solids."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ocptip.robots.model import ArmModel
from ocptip.robots.pinocchio import load_pinocchio
from ocptip.robots.urdf.collision import outlines_of_links
from ocptip.robots.urdf.file import UrdfFile
from ocptip.robots.urdf.parser import pinocchio_model
from ocptip.robots.urdf.resting import resting_configuration, resting_links

_APART = 1e-3  # m: contacts that are nearer to each other are one
_WHEEL = re.compile(r"wheel(?!ed)", re.IGNORECASE)
_CASTER = re.compile(r"cast[eo]r|(^|_)ball(_|$)", re.IGNORECASE)
_FOOTPRINT = re.compile(r"(^|_)base_footprint$")  # on the ground below the base, by convention of ROS

_LEVEL, _BELOW = 0.02, 0.002
"""m: what is within `_LEVEL` of the lowest wheel touches the ground, in points within `_BELOW` of its lowest
one."""

_FLAT = 0.2
"""Largest share of the vertical in the direction of an axle, and of the horizontal in that of a swivel."""

_TRAIL = 0.005
"""m, between swivel and axle: a wheel with more of it turns by itself, which makes it a caster."""

_ROUND = 0.1
"""Largest share by which the radius of a wheel differs between directions."""

_INSIDE = 0.01
"""m, by which the centre of mass is inside of contacts that carry a base alone."""

_AREA = 1e-3
"""m^2, that feet alone enclose at least."""

_DIAGONALS = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
_DIRECTIONS = np.linspace(0, 2 * np.pi, 360, endpoint=False)


@dataclass(frozen=True, eq=False)
class GroundContact:
    """A point of the base on the ground.

    Attributes:
        kind: casters have no friction.
        position: (3,), m, frame of the arm's base link.
        reason: why it is taken for a contact.
        rocker: joint between base and wheel that moves in the URDF; empty: there is none.
        pivot: whether it stands for two wheels on a rocker; else the rocker counts as fixed.
    """

    kind: Literal["wheel", "caster", "foot"]
    position: np.ndarray
    reason: str
    rocker: str = ""
    pivot: bool = False


@dataclass(frozen=True, eq=False)
class _Wheel:
    """A link that is a wheel or a caster.

    Attributes:
        name: of the link.
        origin: (3,), m, base link, a point of the axle.
        axle: (3,), unit vector, base link; None: the file gives no horizontal axis.
        points: (k, 3), m, base link, of its outline.
        named: whether it, or its joint, is called wheel or caster.
        caster: why it is a caster; empty if it is none.
        rocker: see `GroundContact`.
        pivot: origin and axis of the rocker, (2, 3), m, base link; None unless it turns about a horizontal
            axis.
    """

    name: str
    origin: np.ndarray
    axle: np.ndarray | None
    points: np.ndarray
    named: bool
    caster: str
    rocker: str
    pivot: np.ndarray | None

    @property
    def low(self) -> float:
        """m, height of its lowest point."""
        return float(self.points[:, 2].min())

    @property
    def round(self) -> bool:
        """Whether it extends as far from the axle in all directions as down to its lowest point."""
        if self.axle is None:
            return False
        across = np.linalg.svd(self.axle[None])[2][1:]
        directions = np.stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)])
        far = ((self.points - self.origin) @ across.T @ directions).max(axis=0)
        return bool(np.ptp(far) < _ROUND * far.max())

    def contact(self, *, driven: bool) -> GroundContact:
        """Below the middle of the axle; without one in the middle of the lowest points."""
        lowest = self.points[self.points[:, 2] < self.low + _BELOW]
        point, about = 0.5 * (lowest.min(axis=0) + lowest.max(axis=0)), ""
        if self.axle is not None:
            along = self.axle[:2] / np.linalg.norm(self.axle[:2])
            point[:2] = self.origin[:2] + along * (along @ (point[:2] - self.origin[:2]))
            direction = ", ".join(f"{value:.3g}" for value in self.axle.round(3) + 0.0)
            about = f", radius {self.origin[2] - self.low:.4g} m, axle ({direction})"
            if (width := np.ptp(lowest @ self.axle)) > 0:
                about += f", touches {1e3 * width:.3g} mm wide"
        kind, why = ("wheel", "") if driven or not self.caster else ("caster", f" {self.caster}")
        fixed = f", on {self.rocker}, which counts as fixed" if self.rocker else ""
        reason = f"{self.name}: {kind}{why}{about}{fixed}"
        return GroundContact(kind, np.array([*point[:2], self.low]), reason, self.rocker)


def ground_contacts(file: UrdfFile, arm: ArmModel, centre: np.ndarray) -> list[GroundContact]:
    """Contacts of the links that rest; empty if no geometry shows any.

    Wheels are links behind joints that turn without end about a horizontal axis, and links that are called
    so. A wheel is a caster by its name, or where it swivels without end about a vertical axis beside its
    axle. Where all wheels would be casters they are driven, for something has to hold the base. A base that
    its wheels and casters do not carry stands on its lowest points as well, which are casters then. Where no
    other link has collision geometry, these are points of the visual one.

    Args:
        file: the URDF.
        arm: read from it, not mounted.
        centre: (3,), m, base link: centre of mass of what rests.

    Raises:
        InputError: the geometry cannot be read.
    """
    resting = resting_links(file, arm)
    named = [link for link in resting if link in file.above and _is_wheel(file, link)]
    outlines = outlines_of_links(file.path, arm, resting, visual=named)
    lowest = min((points[:, 2].min() for points in outlines.values()), default=0.0)
    wheels = [
        wheel
        for wheel in _wheels(file, arm, named, outlines)
        if wheel.named or (wheel.round and wheel.low < lowest + _LEVEL)
    ]
    if not wheels:
        return _lowest_points(outlines)
    ground = min(wheel.low for wheel in wheels)
    touching = [wheel for wheel in wheels if wheel.low < ground + _LEVEL]
    driven = all(wheel.caster for wheel in touching)
    results = list[GroundContact]()
    for contact in (one for rocking in _by_rocker(touching) for one in _contacts_of(rocking, driven)):
        if all(np.linalg.norm(contact.position - other.position) > _APART for other in results):
            results.append(contact)  # else it is the fork of a caster, or its wheel
    if inside(np.array([contact.position for contact in results]), centre[None])[0] < _INSIDE:
        names = {wheel.name for wheel in wheels}
        others = {link: points for link, points in outlines.items() if link not in names}
        if not others:
            seen = outlines_of_links(file.path, arm, resting, visual=resting)
            others = {link: points for link, points in seen.items() if link not in names}
        for contact in _lowest_points(others, 0.0):
            above = f"{1e3 * (contact.position[2] - ground):.0f} mm above that of the wheels"
            reason = f"{contact.reason}, {above}, for the wheels alone do not carry the base"
            results.append(GroundContact("caster", np.array([*contact.position[:2], ground]), reason))
    return results


def _by_rocker(wheels: Sequence[_Wheel]) -> list[list[_Wheel]]:
    """Wheels on the same rocker together, others alone, in their order."""
    groups: dict[str, list[_Wheel]] = {}
    for wheel in wheels:
        groups.setdefault(wheel.rocker or f"of {wheel.name} alone", []).append(wheel)
    return list(groups.values())


def _contacts_of(wheels: Sequence[_Wheel], driven: bool) -> list[GroundContact]:
    """One contact for two wheels on a rocker, else one for each.

    A rocker that turns freely takes no moment about its axis. So the resultant of two wheels passes through
    that axis: it stands where the line between their contacts crosses the axis, seen from above.
    """
    each = [wheel.contact(driven=driven) for wheel in wheels]
    pivot = wheels[0].pivot
    if len(wheels) != 2 or pivot is None or each[0].kind != each[1].kind:
        return each
    first, second = (contact.position for contact in each)
    sideways = np.array([-pivot[1, 1], pivot[1, 0]])  # normal to the axis
    crossing = (second - first)[:2] @ sideways
    if abs(crossing) < _FLAT * np.linalg.norm(second - first):
        return each
    share = float((pivot[0] - first)[:2] @ sideways / crossing)
    if not 0 <= share <= 1:
        return each
    names = " and ".join(wheel.name for wheel in wheels)
    reason = f"{wheels[0].rocker}: pivot on which {names} rock, {each[0].kind}s; until its stop"
    place = first + share * (second - first)
    return [GroundContact(each[0].kind, place, reason, wheels[0].rocker, pivot=True)]


def inside(contacts: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N,) m, how far points (N, 2 or 3) are inside the convex hull of contacts (k, 3), seen from above."""
    along = np.stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)])
    return np.min((contacts[:, :2] @ along).max(axis=0) - points[:, :2] @ along, axis=1)


def _is_wheel(file: UrdfFile, link: str) -> bool:
    joint = file.above[link]
    names = f"{joint.name} {link}"
    return joint.kind == "continuous" or bool(_WHEEL.search(names) or _CASTER.search(names))


def _wheels(
    file: UrdfFile, arm: ArmModel, links: Sequence[str], outlines: Mapping[str, np.ndarray]
) -> Iterator[_Wheel]:
    """The wheels and casters among some links; what turns with a wheel is part of it."""
    pin, robot = load_pinocchio(), pinocchio_model(file.path)
    data = robot.createData()
    pin.framesForwardKinematics(robot, data, resting_configuration(robot, arm))
    numbers = {f.name: k for k, f in enumerate(robot.frames) if f.type == pin.FrameType.BODY}
    to_base = data.oMf[numbers[arm.base_link]].inverse()
    places = {link: to_base * data.oMf[numbers[link]] for link in file.links}
    ahead = {joint.name for joint in file.way(arm.base_link)}
    axes = {
        link: places[link].rotation @ (np.array(joint.axis) / np.linalg.norm(joint.axis))
        for link, joint in file.above.items()
        if joint.axis is not None and any(joint.axis)
    }
    axles = {link: axes[link] for link in links if link in axes and abs(axes[link][2]) < _FLAT}
    ground = next((places[link].translation[2] for link in file.links if _FOOTPRINT.search(link)), None)
    for link in links:
        way = [joint.child for joint in file.way(link) if joint.name not in ahead]
        behind = [other for other in links if link in (joint.child for joint in file.way(other)[:-1])]
        if not axles.keys().isdisjoint(way[:-1]):
            continue  # a part of a wheel
        names = f"{file.above[link].name} {link}"
        named = bool(_WHEEL.search(names) or _CASTER.search(names))
        if link not in axles and (not named or not axles.keys().isdisjoint(behind)):
            continue  # turns about a vertical axis, or carries a wheel
        parts = [outlines[k] for k in file.links if k in outlines and link in _links_of(file, k)]
        origin = places[link].translation
        if not parts and ground is None:
            continue
        points = np.vstack(parts) if parts else np.array([[*origin[:2], ground]])
        caster = "by its name" if _CASTER.search(" ".join([names, *way[:-1]])) else ""
        for swivel in way[:-1] if link in axles else ():
            if file.above[swivel].kind == "continuous" and np.linalg.norm(axes[swivel][:2]) < _FLAT:
                across = np.cross(axles[link], [0.0, 0.0, 1.0])
                trail = abs(float(across @ (origin - places[swivel].translation)))
                if trail > _TRAIL:
                    caster = caster or f"that swivels freely, {1e3 * trail:.0f} mm behind its swivel"
        moving = [k for k in way[:-1] if file.above[k].kind in ("revolute", "prismatic")]
        rocker, pivot = ", ".join(file.above[k].name for k in moving), None
        if len(moving) == 1 and file.above[moving[0]].kind == "revolute" and abs(axes[moving[0]][2]) < _FLAT:
            pivot = np.array([places[moving[0]].translation, axes[moving[0]]])
        yield _Wheel(link, origin, axles.get(link), points, named, caster, rocker, pivot)


def _links_of(file: UrdfFile, link: str) -> list[str]:
    """A link and those that carry it."""
    return [link, *(joint.parent for joint in file.way(link))]


def _lowest_points(outlines: Mapping[str, np.ndarray], area: float = _AREA) -> list[GroundContact]:
    """The lowest points that are outermost in four directions; none if they enclose less area, m^2."""
    if not outlines:
        return []
    level = min(points[:, 2].min() for points in outlines.values())
    rows = [
        (link, point)
        for link, points in outlines.items()
        if points[:, 2].min() < level + _LEVEL
        for point in points[points[:, 2] < points[:, 2].min() + _BELOW]
    ]
    low = np.array([point for _, point in rows])
    chosen = dict.fromkeys(np.argmax(low[:, :2] @ _DIAGONALS.T, axis=0).tolist())
    corners = low[[*chosen]]
    x, y = corners[:, 0], corners[:, 1]
    if abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 2 * area:
        return []
    return [
        GroundContact("foot", np.array([*low[k, :2], level]), f"{rows[k][0]}: among its lowest points")
        for k in chosen
    ]
