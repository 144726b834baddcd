"""Objects that only contacts hold as free bodies of a MuJoCo model, and how they move in a replay."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.robots.kinematics import gripper_pose, jacobian
from ocptip.robots.simulators import RIGID, SENSOR, SOLE, add, inertial, quaternion, text, upright
from ocptip.standing.arm import Robot
from ocptip.standing.instants import Instants
from ocptip.standing.objects import BASE, GRIPPER
from ocptip.standing.parts import Part
from ocptip.standing.simulation.world import Jaw, jaws_of

LIFTED, SLID = 0.05e-3, 0.5e-3  # m: more than that is a lift, a slide
OBJECT_BODY = "object "  # begins the name of a free body
_PULL = 1.0  # m: length of the tendon of a cup, so that its force keeps size and direction
_SAMPLES = 1e-3  # s between the instants of a prediction


def add_objects(
    root: ET.Element,
    carriers: Mapping[str, ET.Element],
    contact: ET.Element,
    sensors: ET.Element,
    robot: Robot,
    start: np.ndarray,
) -> None:
    """Each object as a free body at its place, small spheres as its contacts, and what is measured there.

    A sphere touches the face of a thin box, which is a part of what carries the object.

    Args:
        root: of the model; it has a worldbody.
        carriers: bodies of "gripper", the last link, and "base".
        contact, sensors: of the model.
        robot: with the objects.
        start: (n,), posture.
    """
    world, tendons = root.find("worldbody"), ET.Element("tendon")
    assert world is not None
    arm, bodies = robot.arm, dict(carriers)
    # Rotation and origin of the axes in which contacts are given, in those of the bodies that carry them.
    axes = {
        GRIPPER: (arm.tool_rotation, arm.offsets[-1]),
        BASE: (np.eye(3), -robot.without_objects().support.center_of_mass),
    }
    places = object_states(robot, start[None], np.zeros((1, arm.n)))[0][0].reshape(-1, 7)
    for carried, place in zip(robot.carried, places, strict=True):
        name, body = carried.object.name, carried.object.body
        free = add(world, "body", name=OBJECT_BODY + name, pos=text(place[:3]), quat=text(place[3:]))
        add(free, "freejoint", name=OBJECT_BODY + name)
        inertial(free, (body.mass, body.center_of_mass, body.inertia))
        below, (turn, origin) = bodies[carried.object.on], axes[carried.object.on]
        for number, one in enumerate(carried.footing.support.contacts):
            position = np.asarray(one.position)
            jaws = jaws_of(one, number)
            if any(jaw.stiffness or jaw.lever for jaw in jaws):
                raise InputError(f"object {name!r}: a {one.kind} has no model for a simulator on objects")
            for jaw in jaws:
                foot, floor = (f"{OBJECT_BODY}{name} {what}{jaw.name}" for what in ("foot", "ground"))
                normal, inside = turn @ jaw.normal, origin + turn @ position
                own_normal, own_place = (
                    carried.rotation.T @ jaw.normal,
                    carried.rotation.T @ (position - carried.origin),
                )
                if jaw.force:
                    ends = (free, foot, own_place), (below, floor, inside + _PULL * normal)
                    _pull(tendons, foot, jaw, ends)
                    continue
                there = {"pos": text(inside), "quat": text(upright(normal))}
                add(below, "site", name=floor, **there)
                face = {"pos": text(inside - 0.01 * normal), "quat": there["quat"]}
                add(
                    below, "geom", name=floor, type="box", size="0.03 0.03 0.01", rgba="0.8 0.8 0.8 1", **face
                )
                centre = text(own_place + SOLE * own_normal)
                add(free, "geom", name=foot, type="sphere", size=text(SOLE), pos=centre)
                sliding = text([max(jaw.friction, 1e-5)] * 2 + [1e-3, 1e-5, 1e-5])
                numbers = {key: text(value) for key, value in RIGID.items()}
                add(contact, "pair", geom1=foot, geom2=floor, friction=sliding, **numbers)
                seen = text(own_place - SENSOR * own_normal)
                add(free, "site", name=foot, type="sphere", size=text(SOLE), pos=seen)
                add(sensors, "touch", name=f"{foot}_force", site=foot)
                add(
                    sensors, "framepos", name=f"{foot}_place", objtype="site", objname=foot, reftype="site",
                    refname=floor,
                )  # fmt: skip
        bodies[name], axes[name] = free, (carried.rotation.T, -carried.rotation.T @ carried.origin)
    if len(tendons):
        root.append(tendons)


def _pull(
    tendons: ET.Element, name: str, jaw: Jaw, ends: Sequence[tuple[ET.Element, str, np.ndarray]]
) -> None:
    """The constant force of a cup: a tendon far longer than any slide."""
    tendon = add(tendons, "spatial", name=name, stiffness=text(jaw.force / _PULL), springlength="0 0")
    for body, site, place in ends:
        add(body, "site", name=f"{site}_pull", pos=text(place))
        add(tendon, "site", site=f"{site}_pull")


def shift_centres(spec: Any, robot: Robot, shifts: Sequence[Sequence[float]]) -> None:
    """Put the centres of mass of the objects of an MjSpec off by shifts (3,), m; none: where they were."""
    for carried, shift in zip(robot.carried, shifts or np.zeros((len(robot.carried), 3)), strict=False):
        place = carried.object.body.center_of_mass + carried.rotation.T @ np.asarray(shift)
        spec.body(OBJECT_BODY + carried.object.name).ipos = place


def object_states(robot: Robot, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, 7 k), m and quaternions, and velocities (N, 6 k) of objects that stay in their places.

    As MuJoCo has them: velocities in world axes, angular ones in axes of the object.

    Args:
        robot: its base rests.
        q, qd: (N, n).
    """
    points, turns = gripper_pose(robot.arm, q)
    speeds = np.einsum("kij,kj->ki", jacobian(robot.arm, q), qd)
    still = np.zeros_like(points), np.tile(np.eye(3), (len(q), 1, 1)), np.zeros_like(speeds)
    moves = {GRIPPER: (points, turns, speeds), BASE: still}
    places, velocities = [np.empty((len(q), 0))], [np.empty((len(q), 0))]
    for carried in robot.carried:
        origin, turn, speed = moves[carried.carrier]
        lever, axes = turn @ carried.origin, turn @ carried.rotation
        places += [origin + lever, np.array([quaternion(one) for one in axes])]
        spin = speed[:, 3:]
        velocities += [speed[:, :3] + np.cross(spin, lever), np.einsum("kji,kj->ki", axes, spin)]
    return np.hstack(places), np.hstack(velocities)


@dataclass(frozen=True)
class Moved:
    """How an object moved on what carries it.

    Attributes:
        lift: m, maximum height of one of its contacts.
        slide: m, the farthest that a contact that pressed was from where it stood at the start.
    """

    lift: float
    slide: float

    @property
    def stays(self) -> bool:
        """No lift above `LIFTED`, no slide above `SLID`."""
        return self.lift <= LIFTED and self.slide <= SLID


def moved_objects(robot: Robot, sensed: np.ndarray) -> dict[str, Moved]:
    """Lift and slide of each object by name.

    Args:
        robot: with the objects.
        sensed: (T, s) of the sensors of `add_objects`: force and place of each contact.
    """
    table, index = {}, 0
    for carried in robot.carried:
        lift = slide = 0.0
        for number, one in enumerate(carried.footing.support.contacts):
            for _ in (jaw for jaw in jaws_of(one, number) if not jaw.force):
                force, place = sensed[:, index], np.nan_to_num(sensed[:, index + 1 : index + 4], nan=np.inf)
                across = np.linalg.norm(place[:, :2] - place[0, :2], axis=1)
                lift = max(lift, float(place[:, 2].max()) + SENSOR)
                slide = max(slide, float(np.max(across, where=force > 0, initial=0.0)))
                index += 4
        table[carried.object.name] = Moved(lift, slide)
    return table


def predicted_objects(parts: Sequence[Part]) -> dict[str, bool]:
    """Whether each object keeps its contacts during these motions, by name."""
    table: dict[str, bool] = {}
    for part in parts:
        if part.robot.objects:
            times = np.append(np.arange(0.0, part.motion.end, _SAMPLES), part.motion.end)
            robot = part.robot.during(part.motion)
            for interface in Instants.of_states(robot, *part.motion.states(times), times).interfaces[1:]:
                kept = bool(interface.states.persistent.all())
                table[interface.footing.name] = table.get(interface.footing.name, True) and kept
    return table
