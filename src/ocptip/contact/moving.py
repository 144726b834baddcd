"""What of a base that does not stand begins to move, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ocptip.contact.support import Support

_VERBS = {
    "slide": ("slides", "slide"),
    "roll": ("rolls", "roll"),
    "separate": ("lifts off", "lift off"),
    "yield": ("yields", "yield"),
}
_STRAIGHT = 1e-6  # of the support's length: contacts nearer than this to a line are on it


def what_moves(support: Support, modes: Sequence[str]) -> str:
    """The contacts that slide, lift off or yield; if all stick, about what the base tips nevertheless.

    Args:
        support: the base.
        modes: of its contacts in a state that does not maintain all contacts.
    """
    parts = []
    for mode in dict.fromkeys(modes):
        if mode != "stick":
            numbers = [k for k, m in enumerate(modes, 1) if m == mode]
            one, many = _VERBS.get(mode, (mode, mode))
            parts.append(f"{_contacts(numbers)} {many if len(numbers) > 1 else one}")
    return "; ".join(parts) or _without_area(support)


def _without_area(support: Support) -> str:
    """Why a base may turn while all its contacts stick: they span nothing that could resist."""
    positions = np.array([contact.position for contact in support.contacts])
    spread = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    everyone = _contacts(list(range(1, len(positions) + 1)))
    where = "are on one line" if spread[0] > _STRAIGHT * support.length else "are at one point"
    if len(positions) == 1:
        where = "is the only one"
    return f"{everyone} {where}, about which nothing keeps it from tipping"


def _contacts(numbers: Sequence[int]) -> str:
    *others, last = map(str, numbers)
    return f"contacts {', '.join(others)} and {last}" if others else f"contact {last}"
