"""The scenario of a replay: how it differs from the planned one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.binding import DAMPING_RATIO, Binding
from ocptip.contact.bindings.clamps import (
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    RigidClamp,
)
from ocptip.contact.bindings.unilateral import UnilateralContact, feet
from ocptip.contact.support import Support
from ocptip.numerics.inertia import union
from ocptip.robots.payload import Payload
from ocptip.standing.arm import Robot
from ocptip.standing.parts import Part

_CONSTANT = ForceConstantHalfRigidClamp | ForceConstantTwoSidedClamp
_VARIABLE = ForceVariableHalfRigidClamp | ForceVariableTwoSidedClamp


@dataclass(frozen=True)
class World:
    """How the replayed scenario differs from the planned one.

    Attributes:
        stiffness: of all feet, N/m, with damping; None: nominal.
        damping: ratio of the lowest mode, for `stiffness`.
        tilt: of floor, base and robot, rad.
        downhill: rad, direction of the tilt from the base's x axis to its y axis.
        payload: kg more at the TCP.
        friction: factor on all coefficients.
        speed: factor.
        masses: factors on the masses of base, links, payload and objects, in this order; those left out: 1.
        late: s, delay of each joint; empty: none.
        shifts: m, by which the centre of mass of each object is off, axes of what carries it; empty: none.
    """

    stiffness: float | None = None
    damping: float = DAMPING_RATIO
    tilt: float = 0.0
    downhill: float = 0.0
    payload: float = 0.0
    friction: float = 1.0
    speed: float = 1.0
    masses: tuple[float, ...] = ()
    late: tuple[float, ...] = ()
    shifts: tuple[tuple[float, float, float], ...] = ()

    def text(self) -> str:
        """In words; empty where nothing differs."""
        parts = []
        if self.stiffness is not None:
            parts.append(f"feet of {self.stiffness:.3g} N/m, {100 * self.damping:.3g} % damping")
        if self.tilt:
            toward = np.array([np.cos(self.downhill), np.sin(self.downhill)])
            x, y = np.round(toward, 2) + 0.0
            parts.append(
                f"floor tilted by {np.degrees(self.tilt):.3g} deg, downhill towards ({x:g}, {y:g}, 0)"
            )
        if self.payload:
            parts.append(f"{self.payload:.3g} kg more at the TCP")
        if self.friction != 1:
            parts.append(f"friction x {self.friction:.3g}")
        if self.speed != 1:
            parts.append(f"speed x {self.speed:.4g}")
        return ", ".join(parts)

    def robot(self, robot: Robot) -> Robot:
        """The robot there, but for the factors on masses and shifted centres."""
        arm, support = robot.arm, robot.support
        if self.payload:
            arm = arm.with_payload(with_more(arm.payload, self.payload))
        contacts = []
        for contact in support.contacts:
            changes = self._frictions(contact)
            if self.stiffness is not None:
                none = {"tangential_stiffness": None, "damping": None}
                changes |= {"stiffness": self.stiffness, "damping_ratio": self.damping, **none}
            contacts.append(replace(contact, **changes))
        objects = []
        for one in robot.objects:
            slippery = [replace(c, **self._frictions(c)) for c in feet(one.contacts, one.friction)]
            objects.append(replace(one, contacts=slippery, friction=None))
        return robot.varied(
            arm=arm,
            support=support.varied(contacts, gravity=self.gravity(support.gravity)),
            objects=tuple(objects),
            reference_moment=robot.tip_over.reference_moment,
        )

    def _frictions(self, contact: Binding) -> dict[str, Any]:
        """Coefficients of a contact there, by name."""
        named = vars(contact).items()
        return {key: self.friction * value for key, value in named if key.startswith("friction")}

    def parts(self, parts: Sequence[Part]) -> tuple[Part, ...]:
        """The parts of the motion in this scenario, without the factors on masses and shifted centres."""
        there = [part.time_scaled(1 / self.speed) for part in parts]
        return tuple(replace(part, robot=self.robot(part.robot)) for part in there)

    def gravity(self, gravity: np.ndarray) -> np.ndarray:
        """(3,) in base axes."""
        if not self.tilt:
            return gravity
        down = gravity / np.linalg.norm(gravity)
        side = np.array([np.cos(self.downhill), np.sin(self.downhill), 0.0])
        side = side - (side @ down) * down
        size = np.linalg.norm(gravity)
        return size * (np.cos(self.tilt) * down + np.sin(self.tilt) * side / np.linalg.norm(side))


def with_more(payload: Payload | None, mass: float) -> Payload:
    """A payload and a point mass at the TCP."""
    if payload is None:
        return Payload(mass)
    both = union(
        (payload.mass, payload.center_of_mass, payload.inertia), (mass, np.zeros(3), np.zeros((3, 3)))
    )
    return Payload(*both)


@dataclass(frozen=True)
class Jaw:
    """One side of a contact that can push.

    Attributes:
        name: of the contact's number, from 1, and the side.
        normal: (3,) direction in which the ground pushes the base.
        friction: coefficient.
        force: N, with which a spring presses the jaw onto the base at the start; 0: it has none.
        stiffness: N/m, of that spring; 0: its force is constant.
        lever: travel towards the base per travel of the other jaw, which has the spring; 0: no lever.
    """

    name: str
    normal: np.ndarray
    friction: float
    force: float = 0.0
    stiffness: float = 0.0
    lever: float = 0.0

    @property
    def slides(self) -> bool:
        """Whether it is a moving body; else it is the ground."""
        return bool(self.force or self.lever)


def jaws_of(contact: Binding, number: int) -> list[Jaw]:
    """The surfaces that touch the base at a contact: the ground, or both jaws of a clamp.

    Raises:
        InputError: rigid bodies that touch do not behave like this contact.
    """
    name, below, normal = f"{number + 1}", f"{number + 1}_lower", np.asarray(contact.normal)
    if isinstance(contact, UnilateralContact):
        return [Jaw(name, normal, contact.friction)]
    if isinstance(contact, RigidClamp):
        return [Jaw(name, normal, contact.friction_upper), Jaw(below, -normal, contact.friction_lower)]
    if not isinstance(contact, _CONSTANT | _VARIABLE):
        raise InputError(
            f"contact {name}: a {contact.kind} has no model for a simulator; feet and clamps have"
        )
    force, stiffness = contact.clamp_force, 0.0
    if isinstance(contact, _VARIABLE):
        stiffness = contact.stiffness or 0.0
        if not stiffness:
            raise InputError(
                f"contact {name}: a {contact.kind} keeps its preload by a spring of unknown stiffness; give "
                "all contacts a stiffness, or --stiffness"
            )
    if isinstance(contact, ForceConstantTwoSidedClamp | ForceVariableTwoSidedClamp):
        # The source of force moves by ds, the jaws by i / (1 + i) ds and 1 / (1 + i) ds.
        lever = 1 + 1 / contact.lever_ratio
        upper = Jaw(name, normal, contact.friction_upper, lever * force, lever**2 * stiffness)
        return [upper, Jaw(below, -normal, contact.friction_lower, lever=1 / contact.lever_ratio)]
    upper, lower = contact.friction_upper, contact.friction_lower
    return [Jaw(name, normal, upper), Jaw(below, -normal, lower, force, stiffness)]


def sliding_jaws(support: Support) -> list[Jaw]:
    """Jaws that are bodies; each is a joint."""
    return [jaw for k, contact in enumerate(support.contacts) for jaw in jaws_of(contact, k) if jaw.slides]
