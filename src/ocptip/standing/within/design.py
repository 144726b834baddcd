"""How narrow the feet and how light the base of a robot at rest may be: inverse design by bisection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ocptip.basics.text import percent, quantity
from ocptip.contact.support import Load, Support
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.rest import SEARCHED, scene_case

MOST = 10.0
"""Largest factor on the distances of the feet, and on the mass of the base, that is tried."""

_CLOSE = 1.002  # ratio of the ends at which the bisection ends
_LOST = 1 - 1e-9


BALLAST, FOOT_WIDTH, SPEED = "ballast_kg", "foot_width_factor", "speed_override"


@dataclass(frozen=True)
class DesignLevels:
    """What a robot holds, resists or stands on with another base, or at another speed.

    Attributes:
        quantity: that differs: `BALLAST`, kg at the centre of mass of the base, `FOOT_WIDTH`, a factor on
            the distances of the contacts from their middle, or `SPEED`, a factor on the speeds of the joints,
            whose square is that on their accelerations.
        value: of it.
        levels: kg, deg or N, by cells of the reach: what all postures up to the end of the cell keep; None:
            there is no posture.
    """

    quantity: str
    value: float
    levels: tuple[float | None, ...]

    def to_dict(self, name: str, unit: str) -> dict[str, Any]:
        """Plain data for JSON; the name and the unit of the levels are part of a key."""
        return {self.quantity: self.value, f"{name}_up_to_reach_{unit}": list(self.levels)}


class LoadedBase(Protocol):
    """A base with all that loads it, also in the worst case: `CaseWithin`, or motions."""

    def tip(self) -> tuple[float, Any]:
        """Use of the limit of tip-over, 1 at the limit, and what is worst."""
        ...

    def slip(self) -> tuple[float, Any]:
        """Use of the limit of slip, 1 at the limit, and what is worst."""
        ...


@dataclass(frozen=True)
class Design:
    """The smallest bases with which no contact is lost; each quantity alone is changed.

    Attributes:
        feet: factor on the horizontal distances of the contacts from their middle; None: none up to `MOST`.
        size_m: extents of the contacts along x and y of the base then; None as `feet`.
        base_mass_kg: with the difference added or removed at the centre of mass of the base; None: none up to
            `MOST` times the present one.
    """

    feet: float | None
    size_m: tuple[float, float] | None
    base_mass_kg: float | None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return dict(vars(self))

    def lines(self, present: Support) -> list[str]:
        """In words, beside the present base."""
        least, none = 1.001 / MOST, f"up to {MOST:g} times the present one keeps the limits"
        if self.size_m is None or self.feet is None:
            texts = [f"feet: no width {none}"]
        else:
            x, y = self.size_m
            share = f"{percent(self.feet)} of the present width{' or less' * (self.feet < least)}"
            texts = [f"feet: {share} keep the limits, {x:.3g} x {y:.3g} m"]
        if self.base_mass_kg is None:
            return [*texts, f"base mass: no mass {none}"]
        more, less = self.base_mass_kg - present.mass, " or less" * (self.base_mass_kg < least * present.mass)
        change = f"{quantity(abs(more), 'kg', 3)} {'more' if more > 0 else 'less'} at its centre of mass"
        return [*texts, f"base mass: {quantity(self.base_mass_kg, 'kg', 3)}{less} keep the limits, {change}"]


def smallest_design(support: Support, case: Callable[[Support], LoadedBase]) -> Design:
    """The narrowest feet and the lightest base.

    It is assumed that wider feet and more mass help. The answers are on the safe side, to 0.2 %.

    Args:
        support: the present base, spatial.
        case: what is on the base and what deviates, for other bases.
    """
    feet = _smallest(lambda factor: case(widened(support, factor)))
    mass = _smallest(lambda factor: case(ballasted(support, factor * support.mass)))
    size = None
    if feet is not None:
        x, y, _ = np.ptp(np.array([c.position for c in widened(support, feet).contacts]), axis=0)
        size = float(x), float(y)
    return Design(feet, size, None if mass is None else mass * support.mass)


def widened(support: Support, factor: float) -> Support:
    """The base with its contacts moved horizontally: their distances from their middle times a factor."""
    places = np.array([contact.position for contact in support.contacts])
    down = support.gravity / np.linalg.norm(support.gravity)
    level = places - places.mean(axis=0)
    level -= np.outer(level @ down, down)
    moved = zip(support.contacts, places + (factor - 1) * level, strict=True)
    return support.varied([replace(contact, position=place) for contact, place in moved])


def ballasted(support: Support, mass: float) -> Support:
    """The base with another mass, kg; the difference is at its centre of mass, its inertia in proportion."""
    return support.varied(mass=mass, inertia=mass / support.mass * support.inertia)


def scene_design(support: Support, loads: Sequence[Load], tolerance: Uncertainty) -> Design:
    """The smallest design of a scene; of the uncertainty counts what a scene can have."""
    counts = tolerance.only(*(name for name in SEARCHED if name in tolerance.given))
    return smallest_design(support, lambda other: scene_case(other, loads, None, counts))


def _smallest(case: Callable[[float], LoadedBase]) -> float | None:
    """The smallest factor with which no contact is lost; None where it is above `MOST`."""

    def stands_upright(factor: float) -> bool:
        return case(factor).tip()[0] < _LOST

    def keeps_contacts(factor: float) -> bool:
        values = case(factor)
        return values.tip()[0] < _LOST and values.slip()[0] < _LOST

    # Tipping is a closed form and decides nearly always; slip takes a search, so it is asked last.
    result = _bisected(stands_upright, 1 / MOST)
    if result is None or keeps_contacts(result):
        return result
    return _bisected(keeps_contacts, result)


def _bisected(kept: Callable[[float], bool], low: float) -> float | None:
    high = MOST
    if kept(low):
        return low
    if not kept(high):
        return None
    while high / low > _CLOSE:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if kept(middle) else (middle, high)
    return high
