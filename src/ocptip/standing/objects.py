"""Objects that nothing but contacts holds: on a tray in the gripper, on the deck of the base, in stacks.

To its contacts an object is what the base is to the ground. Its interface is a `Footing` in the axes of what
carries it. The interface under an object carries the object and all that stands on it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from typing import Any, Self

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, bounded_array, positive_number, rotation_matrix
from ocptip.basics.frozen import settle
from ocptip.basics.text import did_you_mean
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.contact.bindings.unilateral import feet
from ocptip.contact.support import Support
from ocptip.numerics.inertia import RigidBody, union
from ocptip.robots.base_motion import BaseMotion, acceleration_of
from ocptip.robots.dynamics import gripper_motion, gripper_motion_function
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.model import ArmModel
from ocptip.robots.payload import Payload
from ocptip.standing.footing import Footing

GRIPPER, BASE = CARRIERS = ("gripper", "base")
"""What carries objects; others stand on objects."""

ROUND = 8
"""Contacts of a round footprint, on its edge: their polygon has 92 % of its radius."""

FARTHEST = 1e3
"""m, of an object from what carries it: the inertia of one farther away is no number to compute with."""

_PULL_FRICTION = 1e-5  # of what pulls an object onto a cup: none, but clamps need some

_ROUNDED = 1e-9  # share of a mass or an inertia that is rounding

_NAME = re.compile(r"[\w-]+")


@dataclass(frozen=True, eq=False, kw_only=True)
class Object:
    """A rigid object on contacts. Its frame stands where it does, z points away from what carries it.

    Attributes:
        name: letters, digits, "_" and "-".
        mass: kg.
        inertia: (3, 3), kg m^2, about the centre of mass, object axes; also six or three numbers, see
            `Payload`.
        contacts: points (n, 3), m, object axes, of ordinary contacts with normal z; or contacts of any kind.
        friction: coefficient of the contacts that are given as points.
        center_of_mass: (3,), m, object axes.
        on: "gripper", "base", or the name of the object below.
        position: (3,), m: of the object's frame in gripper or base axes; on an object from the middle of its
            top, in its axes.
        rotation: (3, 3): object axes to those.
        top: m, object axes: height at which another object stands on this one.
        body: mass, centre of mass and inertia.

    Raises:
        InputError: a value cannot be used; names it.
    """

    name: str
    mass: float
    inertia: ArrayLike
    contacts: Sequence[Binding] | ArrayLike
    friction: float | None = None
    center_of_mass: ArrayLike = (0.0, 0.0, 0.0)
    on: str = GRIPPER
    position: ArrayLike = (0.0, 0.0, 0.0)
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    top: float = 0.0
    body: Payload = field(init=False)

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name) or self.name in CARRIERS:
            raise InputError(
                f"name: expected letters, digits, _ and -, not {GRIPPER} or {BASE}, got {self.name!r}"
            )
        body = Payload(self.mass, np.asarray(self.center_of_mass), np.asarray(self.inertia))
        if body.is_point:
            raise InputError("inertia: must not be zero; an object of no extension stands on nothing")
        feet(self.contacts, self.friction)  # refuses what is none
        position = bounded_array("position", self.position, (3,))
        for name, place in (("position", position), ("center_of_mass", body.center_of_mass)):
            if (farthest := np.abs(place).max()) > FARTHEST:
                raise InputError(f"{name}: at most {FARTHEST:g} m from the origin, got {farthest:g} m")
        settle(
            self,
            body=body,
            position=position,
            rotation=rotation_matrix("rotation", self.rotation),
            top=float(bounded_array("top", self.top, ())),
        )

    @classmethod
    def box(cls, name: str, mass: float, size: ArrayLike, **others: Any) -> Self:
        """A homogeneous box that stands on its corners.

        Args:
            name: of it.
            mass: kg.
            size: (3,), m, along its axes.
            others: `friction`, `on`, `position`, `rotation`; and what is not as in a homogeneous box.

        Raises:
            InputError: a value cannot be used; names it.
        """
        sides = bounded_array("box", size, (3,))
        if (sides <= 0).any():
            raise InputError(f"box: dimensions must be > 0, got {sides.tolist()}")
        corners = [(x, y, 0.0) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
        inertia = positive_number("mass", mass) / 12 * (np.sum(sides**2) - sides**2)
        return cls._shaped(name, mass, inertia, np.multiply(corners, sides / 2), sides[2], others)

    @classmethod
    def cylinder(cls, name: str, mass: float, size: ArrayLike, **others: Any) -> Self:
        """A homogeneous upright cylinder, such as a glass, that stands on its edge.

        Args:
            name: of it.
            mass: kg.
            size: (2,), m: radius and height.
            others: see `box`.

        Raises:
            InputError: a value cannot be used; names it.
        """
        radius, height = bounded_array("cylinder", size, (2,))
        if not (radius > 0 and height > 0):
            raise InputError(f"cylinder: radius and height must be > 0, got {[radius, height]}")
        turns = 2 * np.pi * np.arange(ROUND) / ROUND
        edge = radius * np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
        across = radius**2 / 4 + height**2 / 12
        inertia = positive_number("mass", mass) * np.array([across, across, radius**2 / 2])
        return cls._shaped(name, mass, inertia, edge, height, others)

    @classmethod
    def _shaped(
        cls, name: str, mass: float, inertia: np.ndarray, edge: np.ndarray, height: float, others: Any
    ) -> Self:
        usual = {"inertia": inertia, "contacts": edge, "center_of_mass": (0.0, 0.0, height / 2)}
        return cls(name=name, mass=mass, top=height, **{**usual, **others})


def cup(
    position: ArrayLike, radius: float, force: float, friction: float, points: int = ROUND
) -> list[ForceConstantHalfRigidClamp]:
    """A suction cup or a round magnet: it holds an object on its rim, and pulls it with a constant force.

    The pull has no friction; that of the rim grows with what presses on it. A moment peels the rim, a force
    across and a torsion slide it.

    Args:
        position: (3,), m, of the middle of the rim, object axes; the rim is at right angles to z.
        radius: of the rim, m.
        force: N, with which it holds: of a cup pressure difference times area, as makers print it.
        friction: coefficient of the rim.
        points: contacts on the rim.

    Raises:
        InputError: a value cannot be used; names it.
    """
    middle, turns = bounded_array("position", position, (3,)), 2 * np.pi * np.arange(points) / points
    edge = positive_number("radius", radius) * np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    share = positive_number("force", force) / points
    return [
        ForceConstantHalfRigidClamp(
            position=middle + place,
            clamp_force=share,
            friction_upper=positive_number("friction", friction),
            friction_lower=_PULL_FRICTION,
        )
        for place in edge
    ]


@dataclass(frozen=True, eq=False)
class CarriedObject:
    """An object in the axes of what carries it, with all that stand on it.

    Attributes:
        object: the lowest one.
        carrier: "gripper" or "base".
        rotation, origin: of its frame in the carrier's axes, (3, 3) and (3,), m.
        bodies: it and all that stand on it by name, in those axes.
        gravity: m/s^2.
    """

    object: Object
    carrier: str
    rotation: np.ndarray
    origin: np.ndarray
    bodies: dict[str, RigidBody]
    gravity: float

    @cached_property
    def footing(self) -> Footing:
        """Its interface: all these bodies as one on the contacts of the object."""
        mass, center, inertia = reduce(union, self.bodies.values())
        turn = self.rotation
        contacts = [
            replace(
                foot,
                position=self.origin + turn @ np.asarray(foot.position),
                normal=turn @ np.asarray(foot.normal),
                tangent=None if foot.tangent is None else turn @ np.asarray(foot.tangent),
            )
            for foot in feet(self.object.contacts, self.object.friction)
        ]
        given = {"mass": mass, "center_of_mass": center, "inertia": inertia}
        support = Support(contacts, **given, gravity=-self.gravity * turn[:, 2])
        return Footing(support, name=self.object.name)

    @cached_property
    def corners(self) -> np.ndarray:
        """(2, n, 3), m, carrier axes: its contacts around their middle, and as many points on its top.

        Of an object without a known top, twice as high as its centre of mass.
        """
        places = np.array([np.asarray(contact.position) for contact in self.footing.support.contacts])
        local = (places - self.origin) @ self.rotation
        away = local - local.mean(axis=0)
        around = places[np.argsort(np.arctan2(away[:, 1], away[:, 0]), kind="stable")]
        height = self.object.top or 2 * float(self.object.body.center_of_mass[2])
        return np.stack([around, around + height * self.rotation[:, 2]])

    def deviated(self, motion: Sequence[cs.SX], shares: cs.SX, shifts: cs.SX) -> cs.SX:
        """The wrench (6,) on it about the nominal centre of mass of its interface, where bodies are off.

        Args:
            motion: of the carrier, see `carrier_expressions`.
            shares: (k,) by which masses and inertias of its bodies are off, relative.
            shifts: (3 k,), m, by which their centres of mass are.
        """
        about, (_, spin, change) = cs.SX(self.footing.support.center_of_mass), motion
        wrench = cs.SX.zeros(6)
        for k, (mass, center, inertia) in enumerate(self.bodies.values()):
            place, share, tensor = cs.SX(center) + shifts[3 * k : 3 * k + 3], 1 + shares[k], cs.SX(inertia)
            force = -mass * share * acceleration_of(motion, place)
            turning = share * (tensor @ change + cs.cross(spin, tensor @ spin))
            wrench = wrench + cs.vertcat(force, cs.cross(place - about, force) - turning)
        return wrench


def carried_objects(objects: Sequence[Object], gravity: np.ndarray) -> tuple[CarriedObject, ...]:
    """Objects in the axes of what carries them, those below before those on them.

    Args:
        objects: in any order.
        gravity: (3,), m/s^2.

    Raises:
        InputError: a name occurs twice, or an object stands on nothing that is carried.
    """
    table: dict[str, CarriedObject] = {}
    names, left = [one.name for one in objects], list(objects)
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"object {name!r}: the name occurs {names.count(name)} times")
    while left:
        one = next((carried for carried in left if carried.on in (*CARRIERS, *table)), None)
        if one is None:
            known = [*CARRIERS, *names]
            raise InputError(
                f"object {left[0].name!r}: on: expected {GRIPPER}, {BASE} or an object that stands on one of "
                f"them, got {left[0].on!r}{did_you_mean(left[0].on, known)}"
            )
        left.remove(one)
        below, turn, origin = table.get(one.on), np.eye(3), np.zeros(3)
        if below:
            turn, origin = below.rotation, below.origin + below.object.top * below.rotation[:, 2]
        origin, turn = origin + turn @ np.asarray(one.position), turn @ one.rotation
        body = one.body.seen_from(turn, origin)
        size = float(np.linalg.norm(gravity))
        carrier = below.carrier if below else one.on
        table[one.name] = CarriedObject(one, carrier, turn, origin, {one.name: body}, size)
        while below:
            below.bodies[one.name] = body
            below = table.get(below.object.on)
    return tuple(table.values())


def loaded(
    arm: ArmModel, support: Support, objects: Sequence[Object], sign: int = 1
) -> tuple[ArmModel, Support]:
    """The arm with the objects on its gripper as a part of its payload; the base with those on its deck.

    Args:
        arm, support, objects: as they are.
        sign: -1: takes off what has been loaded.

    Raises:
        InputError: a name occurs twice, an object stands on nothing, or the payload is far away.
    """
    loads: dict[str, list[RigidBody]] = {name: [] for name in CARRIERS}
    for carried_object in carried_objects(objects, support.gravity):
        mass, center, inertia = carried_object.bodies[carried_object.object.name]
        loads[carried_object.carrier].append((sign * mass, center, sign * inertia))
    if loads[GRIPPER]:
        payload = arm.payload
        held = [(payload.mass, payload.center_of_mass, payload.inertia)] if payload else []
        if payload and (farthest := np.abs(payload.center_of_mass).max()) > FARTHEST:
            raise InputError(
                f"payload beside objects: its centre of mass must be at most {FARTHEST:g} m from the "
                f"gripper, got {farthest:g} m"
            )
        if sign > 0:
            left = Payload(*reduce(union, [*held, *loads[GRIPPER]]))
        else:
            left = _what_remains(held[0], reduce(union, loads[GRIPPER]))
        arm = arm.with_payload(left)
    if loads[BASE]:
        base = support.mass, support.center_of_mass, support.inertia
        mass, center, inertia = reduce(union, loads[BASE], base)
        support = support.varied(mass=mass, center_of_mass=center, inertia=inertia)
    return arm, support


def _what_remains(held: RigidBody, taken: RigidBody) -> Payload | None:
    """What is held less what is taken, whose mass and inertia are negative; nothing but rounding: None."""
    if held[0] + taken[0] < _ROUNDED * held[0]:
        return None
    mass, center, inertia = union(held, taken)
    extended = np.abs(inertia).max() > _ROUNDED * np.abs(held[2]).max()
    return Payload(mass, center, 0.5 * (inertia + inertia.T) if extended else np.zeros((3, 3)))


def carrier_motions(
    arm: ArmModel,
    gravity: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    base_motion: BaseMotion | None,
) -> dict[str, BaseMotion]:
    """Motions of gripper and base at states (N, n), in their axes, accelerations less gravity (m/s^2)."""
    rows = np.zeros((len(q), 9)) if base_motion is None else base_motion.rows(len(q))
    return {
        GRIPPER: gripper_motion(arm, q, qd, qdd, gravity, base_motion),
        BASE: BaseMotion(rows[:, :3] - gravity, rows[:, 3:6], rows[:, 6:]),
    }


def carrier_expressions(
    arm: ArmModel, gravity: np.ndarray | cs.SX, q: cs.SX, qd: cs.SX, qdd: cs.SX, base: Sequence[cs.SX]
) -> dict[str, list[cs.SX]]:
    """The same as CasADi columns, three each, from those of the base; none: it rests."""
    pull = cs.SX(gravity)
    at_mount = pull - acceleration_of(base, cs.SX(arm.mount_position)) if base else pull
    motion = gripper_motion_function(arm, bool(base))(q, qd, qdd, at_mount, *base[1:])
    a, *turning = base or [cs.SX.zeros(3)] * 3
    return {GRIPPER: cs.vertsplit(motion, 3), BASE: [a - pull, *turning]}


def outlines(arm: ArmModel, carried: Sequence[CarriedObject], q: np.ndarray) -> list[np.ndarray]:
    """A closed line (k, 3), m, base axes, around each object in posture q (n,)."""
    place, turn = gripper_pose(arm, q)
    moved = [
        carried_object.corners if carried_object.carrier == BASE else carried_object.corners @ turn.T + place
        for carried_object in carried
    ]
    return [np.vstack([low, low[:1], high, high[:1], low[:1]]) for low, high in moved]


def objects_note(objects: Sequence[Object]) -> tuple[str, ...]:
    """What is assumed of objects, as a sentence for reports."""
    if not objects:
        return ()
    names = ", ".join(one.name for one in objects)
    return (f"objects ({names}): rigid; their collisions are not checked, [payload.shape] adds a solid",)
