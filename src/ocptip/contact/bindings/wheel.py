"""A wheel that rolls freely in one direction and grips across it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.automaton import Mode
from ocptip.contact.bindings.binding import (
    Binding,
    ForcePiece,
    PoolVariable,
    friction_parameters,
    normal_vector,
)

_AXIS = np.array([0.0, 0.0, 1.0])  # of the wheel, in contact axes
_GRIPS = (("stick", ("l1", "l2")), ("slide", ("g+", "l2")), ("slide", ("g-", "l1")))
_LIFTS = (("separate", ("gn", "g+")), ("separate", ("gn", "g-")))


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeWheel(Binding):
    """A wheel without drive or brake: pushes, grips across its rolling direction, rolls along it.

    The rolling direction is `tangent`, by default the base axis x. Across it the contact is an ordinary one
    in the plane; along it there is no force, and the motion is free. An omni or mecanum wheel that is locked
    is the same with the free direction of its rollers as `tangent`.

    Attributes:
        friction: Coulomb coefficient across the rolling direction, 1e-6 to 1000.
    """

    kind: ClassVar[str] = "free-wheel"

    friction: float

    def check_parameters(self) -> None:
        if self.planar:
            raise InputError("free-wheel: for spatial supports; in the plane it has friction 0")
        friction_parameters(self, "friction")

    def pool(self) -> list[PoolVariable]:
        n, s, r = normal_vector(self), _AXIS, np.cross(_AXIS, normal_vector(self))
        edges = [n + self.friction * s, n - self.friction * s]
        return [
            PoolVariable("gn", acceleration=n),
            PoolVariable("g+", acceleration=s),
            PoolVariable("g-", acceleration=-s),
            PoolVariable("r+", acceleration=r),
            PoolVariable("r-", acceleration=-r),
            *(PoolVariable(f"l{k}", force=edge / np.linalg.norm(edge)) for k, edge in enumerate(edges, 1)),
        ]

    def modes(self) -> list[Mode]:
        return [Mode(name, (*own, rolls)) for name, own in (*_GRIPS, *_LIFTS) for rolls in ("r+", "r-")]

    def force_pieces(self) -> list[ForcePiece]:
        return [ForcePiece(0.0, np.inf, 0.0, self.friction, rolls=True)]
