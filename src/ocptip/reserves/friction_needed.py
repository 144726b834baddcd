"""How much friction a base needs that slides: GT above 1 counts its acceleration and does not say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ocptip.contact.bindings.binding import LARGEST_FRICTION
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.resting import solve_resting
from ocptip.contact.support import Support
from ocptip.reserves.slip import Slip

_TIMES = (1.0, 4.0, 16.0, 64.0, 256.0)  # times as much friction, to tell how much is enough


def friction_needed(support: Support, wrench: np.ndarray) -> float:
    """Factor on the friction of all contacts with which a support just holds a wrench (6,).

    Below 1 it is GT. Infinite where no friction holds the wrench; NaN where not all contacts are feet.
    """
    contacts = support.contacts
    if not all(isinstance(contact, UnilateralContact) for contact in contacts):
        return np.nan
    roughest = max((contact.friction for contact in contacts), default=0.0)  # pyright: ignore
    for times in _TIMES:
        if times * roughest > LARGEST_FRICTION:
            break
        rough = support.varied([replace(c, friction=times * c.friction) for c in contacts])  # pyright: ignore
        states = solve_resting(rough, wrench[None], warm_start=False)
        if states.persistent[0]:
            needed = times * float(Slip(rough).evaluate(states, derivatives=False).GT[0])
            if needed <= times:  # pyramids reach beyond the cones
                return needed
    return np.inf


def needed_text(factor: float) -> str:
    """In words: "1.64 times the friction would hold it"."""
    return f"{factor:.3g} times the friction would hold it" if np.isfinite(factor) else "no friction holds it"
