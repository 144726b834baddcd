"""The surfaces that touch the base at a contact, in a simulator of rigid bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp, RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support


@dataclass(frozen=True)
class Jaw:
    """One side of a contact that can push.

    Attributes:
        contact: number, from 0.
        normal: (3,) direction in which the ground pushes the base.
        friction: coefficient.
        force: N, with which a jaw that yields presses; 0: a rigid one.
    """

    contact: int
    normal: np.ndarray
    friction: float
    force: float = 0.0

    def name(self, what: str) -> str:
        """Name of a geom, site or sensor."""
        return f"{what}{self.contact + 1}"


def jaws_of(contact: Binding, number: int) -> list[Jaw]:
    """The surfaces that touch the base at a contact: the ground, or both jaws of a clamp.

    Raises:
        InputError: rigid bodies that touch do not behave like this contact.
    """
    if isinstance(contact, UnilateralContact):
        return [Jaw(number, np.asarray(contact.normal), contact.friction)]
    if isinstance(contact, RigidClamp | ForceConstantHalfRigidClamp):
        upper, lower, normal = contact.friction_upper, contact.friction_lower, np.asarray(contact.normal)
        force = getattr(contact, "clamp_force", 0.0)
        return [Jaw(number, normal, upper), Jaw(number, -normal, lower, force)]
    raise InputError(
        f"contact {number + 1}: a {contact.kind} has no model for a simulator: the stiffness that keeps its "
        "preload, or its lever, is not described; feet, rigid and force-constant half-rigid clamps have one"
    )


def pressed(support: Support) -> list[int]:
    """Numbers, from 0, of contacts with a jaw that presses with a constant force; each is a joint."""
    return [k for k, own in enumerate(support.contacts) if isinstance(own, ForceConstantHalfRigidClamp)]
