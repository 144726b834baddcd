"""What of the base is known to within bounds only: mass, centre of mass, friction.

With the arm at its place the wrench on the contacts is affine in the base's mass and in mass times centre of
mass. So it is a mean of the wrenches at the corners of all bounds, and since the wrenches that contacts carry
within a share of their friction are a convex set, and addable moments are concave, no value inside the bounds
is worse than at the worst corner. Cones of friction lie in each other: the smallest friction is the worst.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import product

import numpy as np

from ocptip.basics.errors import InputError, finite_array, number_from
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.support import Support

_ALONG = 1e-9  # sine of the angle up to which an axis counts as along gravity


@dataclass(frozen=True, eq=False)
class Corner:
    """Base mass and centre of mass at ends of their bounds.

    Attributes:
        name: e.g. "base mass -5 %, centre of mass +10 mm in x, friction -20 %"; "" without tolerances.
        mass: kg.
        shift: (3,), m, base axes, of the centre of mass.
        per_gravity: (6, 3): change of the wrench about the nominal centre of mass per gravity in base axes.
    """

    name: str
    mass: float
    shift: np.ndarray
    per_gravity: np.ndarray


@dataclass(frozen=True, eq=False)
class Tolerance:
    """How far the base may differ from its description.

    Attributes:
        base_mass: relative half width of the mass, below 1; or (2,), kg: least and largest mass.
        center_of_mass: (3,), m: half sides of the box about the centre of mass, base axes.
        friction: relative reduction of all friction coefficients, below 1.
    """

    base_mass: float | Sequence[float] = 0.0
    center_of_mass: Sequence[float] = (0.0, 0.0, 0.0)
    friction: float = 0.0

    def __post_init__(self) -> None:
        setter = object.__setattr__
        if np.ndim(self.base_mass):
            low, high = mass = finite_array("base_mass", self.base_mass, (2,))
            if not 0 < low <= high:
                raise InputError(f"base_mass: expected 0 < least <= largest mass, kg, got {mass.tolist()}")
            setter(self, "base_mass", mass)
        for name in ("friction",) if np.ndim(self.base_mass) else ("base_mass", "friction"):
            if not 0 <= number_from(name, getattr(self, name)) < 1:
                raise InputError(f"{name}: must be >= 0 and below 1, got {getattr(self, name)!r}")
        half = finite_array("center_of_mass", self.center_of_mass, (3,))
        if np.any(half < 0):
            raise InputError(f"center_of_mass: half sides must be >= 0, got {half.tolist()}")
        setter(self, "center_of_mass", half)

    @property
    def given(self) -> bool:
        """Whether anything is uncertain."""
        return bool(np.any(self.base_mass) or np.any(self.center_of_mass) or self.friction)

    def masses(self, nominal: float) -> list[float]:
        """Ends of the interval of the base's mass, kg; one if it is known.

        Raises:
            InputError: the nominal mass is not inside.
        """
        if np.ndim(self.base_mass):
            low, high = self.base_mass
            if not low <= nominal <= high:
                raise InputError(
                    f"tolerance.base_mass: {low:g} to {high:g} kg without the base's mass {nominal:g} kg"
                )
            return sorted({float(low), float(high)})
        return sorted({nominal * (1 - self.base_mass), nominal * (1 + self.base_mass)})

    def corners(self, support: Support, gravity: np.ndarray) -> tuple[Corner, ...]:
        """All combinations of ends that differ in their wrench.

        Args:
            support: the base, as described.
            gravity: (N, 3), base axes, of some poses; what has no influence in any of them has none.
        """
        along = np.linalg.norm(np.cross(gravity[:, None], np.eye(3)), axis=2)
        matters = np.any(along > _ALONG * np.linalg.norm(gravity, axis=1)[:, None], axis=0)
        half = np.where(matters, self.center_of_mass, 0.0)
        found = []
        for mass, *shift in product(self.masses(support.mass), *(sorted({-h, h}) for h in half)):
            d = np.array(shift)
            across = np.array([[0, -d[2], d[1]], [d[2], 0, -d[0]], [-d[1], d[0], 0]])
            change = np.vstack([(mass - support.mass) * np.eye(3), mass * across])
            found.append(Corner(self._name(mass / support.mass - 1, d), mass, d, change))
        return tuple(found)

    def _name(self, more: float, shift: np.ndarray) -> str:
        parts = [f"base mass {100 * more:+.3g} %"] if more else []
        moved = [f"{1000 * d:+.3g} mm in {axis}" for d, axis in zip(shift, "xyz", strict=True) if d]
        parts += ["centre of mass " + " and ".join(moved)] if moved else []
        parts += [f"friction {-100 * self.friction:.3g} %"] if self.friction else []
        return ", ".join(parts)

    def contacts(self, nominal: Sequence[Binding]) -> tuple[Binding, ...]:
        """The contacts with the least friction."""
        return tuple(
            replace(
                contact,
                **{
                    field.name: (1 - self.friction) * getattr(contact, field.name)
                    for field in fields(contact)
                    if field.name.startswith("friction")
                },
            )
            for contact in nominal
        )
