"""The largest slope of the floor on which a base at rest keeps its contacts, in the worst direction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ocptip.contact.support import Load, Support
from ocptip.contact.verdict import equilibrium
from ocptip.numerics.bisection import border
from ocptip.standing.at_rest.alike_friction import AlikeFriction
from ocptip.standing.at_rest.directions import AROUND, slopes, tilted
from ocptip.standing.footing import Footing

MOST_TILT = np.pi / 3
_CLOSE = np.radians(0.005)
_CLOSER = tuple(np.pi / AROUND / 2**k for k in range(3))  # rad: from the worst direction to its neighbours
_ALONG = 1e-9  # relative: forces that are so nearly along gravity are weights


@dataclass(frozen=True, eq=False)
class FloorSlope:
    """The largest slope of the floor, from the nominal one on.

    Attributes:
        angle: rad; the base keeps its contacts on all smaller slopes, downhill in any direction.
        downhill: (3,) the worst direction, base axes.
        loss: beyond it the base "tips" or "slides"; empty where no slope up to `MOST_TILT` loses a contact.
        contacts: of the axis about which it tips, from 1.
        tips: rad, the smallest slope on which it tips if friction holds; None off one plane, and where it
            does on none up to `MOST_TILT`.
        alike: it slides there if its feet are equally compliant; rigid ones could hold it.
    """

    angle: float
    downhill: np.ndarray
    loss: str
    contacts: tuple[int, ...] = ()
    tips: float | None = None
    alike: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, the angle in degrees."""
        angle = {"angle_deg": float(np.degrees(self.angle)), "downhill": self.downhill.tolist()}
        tips = None if self.tips is None else float(np.degrees(self.tips))
        how = {"loss": self.loss or None, "if_equally_compliant": self.alike}
        return {**angle, **how, "contacts": list(self.contacts), "tips_at_deg": tips}


@dataclass(frozen=True, eq=False)
class Weight:
    """A body that weighs.

    Attributes:
        name: in words.
        mass: kg, nominal; negative for a load that pulls upwards.
        center: (3,), m, from the base's centre of mass, base axes.
        less, more: kg, by which the mass may be off.
        half: (3,), m, half sides of the box about the centre.
        link: its number if it is a link of the arm, else 0.
    """

    name: str
    mass: float
    center: np.ndarray
    less: float = 0.0
    more: float = 0.0
    half: np.ndarray = field(default_factory=lambda: np.zeros(3))
    link: int = 0


def tilted_wrench(support: Support, loads: Sequence[Load]) -> Callable[[np.ndarray], np.ndarray]:
    """The wrench (6,) on a base by gravity (3,); loads along the nominal one turn with it, others do not."""
    fixed, hanging = fixed_and_hanging(support, loads)
    weights = [Weight("base", support.mass, np.zeros(3)), *hanging]

    def wrench(gravity: np.ndarray) -> np.ndarray:
        return fixed + sum(w.mass * np.r_[gravity, np.cross(w.center, gravity)] for w in weights)

    return wrench


def fixed_and_hanging(support: Support, loads: Sequence[Load]) -> tuple[np.ndarray, list[Weight]]:
    """Loads that are no weights, as a wrench, and those that are."""
    size = float(np.linalg.norm(support.gravity))
    down, fixed, weights = support.gravity / size, support.wrench(list(loads)) - support.weight, []
    for number, load in enumerate(loads, 1):
        if load.force is None:
            continue
        force = np.asarray(load.force, dtype=float)
        if force.any() and np.linalg.norm(np.cross(force, down)) <= _ALONG * np.linalg.norm(force):
            point = np.zeros(3) if load.point is None else np.asarray(load.point, dtype=float)
            arm = point - support.center_of_mass
            weights.append(Weight(f"load {number}", float(force @ down) / size, arm))
            fixed[:3] -= force
            fixed[3:] -= np.cross(arm, force)
    return fixed, weights


def largest_slope(
    footing: Footing, gravity: np.ndarray, wrench: Callable[[np.ndarray], np.ndarray]
) -> FloorSlope | None:
    """The largest slope that loses no contact; None where one is lost without any.

    Args:
        footing: the base on its contacts.
        gravity: (3,) m/s^2, base axes, on the nominal floor.
        wrench: (6,) on the base under a gravity (3,).
    """

    def holds(load: np.ndarray) -> bool:
        if not equilibrium(footing.support, load).stands:
            return False
        # Springs decide how the load is shared, and so how much friction there is.
        springs = footing.support.elastic and footing.contact_states(load[None])
        return not springs or bool(footing.slip.evaluate(springs, derivatives=False).GT[0] < 1)

    if not holds(wrench(gravity)):
        return None
    alike = AlikeFriction.if_held(footing, wrench(gravity)[None])

    def kept(side: np.ndarray, angle: float) -> bool:
        load = wrench(tilted(gravity, side, angle))
        return holds(load) and (alike is None or alike.slips(load[None]) is None)

    angle, worst = MOST_TILT, None

    def narrow(sides: np.ndarray) -> np.ndarray | None:
        nonlocal angle, worst
        for side in sides:
            if not kept(side, angle):
                angle, worst = border(lambda tilt, side=side: kept(side, tilt), 0.0, angle, _near)[0], side
        return worst

    edges = [np.cross(gravity, axis.direction) for axis in footing.tip_over.axes]
    across = [sign * edge / np.linalg.norm(edge) for edge in edges if edge.any() for sign in (1.0, -1.0)]
    directions = slopes(gravity)
    sides = np.array([*across, *directions.sides])
    directions.search(narrow, narrow(sides), _CLOSER)
    if worst is None:
        return FloorSlope(angle, np.zeros(3), "")
    beyond = wrench(tilted(gravity, worst, angle + 2 * _CLOSE))
    loss, contacts = _loss(footing, beyond)
    tips = angle if loss == "tips" else _tips(footing, gravity, wrench, sides)
    return FloorSlope(angle, worst, loss, contacts, tips, loss == "slides" and holds(beyond))


def _tips(
    footing: Footing,
    gravity: np.ndarray,
    wrench: Callable[[np.ndarray], np.ndarray],
    sides: np.ndarray,
) -> float | None:
    """The smallest slope, rad, downhill along one of some sides, on which a base on one plane tips."""
    if (moments := footing.tip_over.affine_moments) is None:
        return None
    slope, offset = moments

    def falls(side: np.ndarray, angle: float) -> bool:
        return bool(np.min(slope @ wrench(tilted(gravity, side, angle)) + offset) < 0)

    least = None
    for side in sides:
        if falls(side, least or MOST_TILT):
            most = least or MOST_TILT
            least = border(lambda tilt, side=side: not falls(side, tilt), 0.0, most, _near)[1]
    return least


def _near(low: float, high: float) -> bool:
    return high - low <= _CLOSE


def _loss(footing: Footing, wrench: np.ndarray) -> tuple[str, tuple[int, ...]]:
    """Whether a base tips or slides that loses a contact under a wrench (6,), and about which contacts."""
    margins = footing.tip_over.evaluate(footing.contact_states(wrench[None])).margins[0]
    if np.min(margins, initial=np.inf) >= 0:
        return "slides", ()
    axis = footing.tip_over.axes[int(np.argmin(margins))]
    return "tips", tuple(dict.fromkeys(axis.numbers))
