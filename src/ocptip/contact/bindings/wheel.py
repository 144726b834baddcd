"""Wheels that roll freely in one direction, or are driven or braked there, and grip across it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product
from typing import ClassVar

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.frozen import settle
from ocptip.contact.bindings.automaton import Mode
from ocptip.contact.bindings.binding import (
    Binding,
    ForcePiece,
    PoolVariable,
    friction_parameters,
    normal_vector,
    positive_parameters,
)
from ocptip.contact.bindings.pyramid import corrected_friction

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
        return [Mode(name, (*grips, rolls)) for name, grips in (*_GRIPS, *_LIFTS) for rolls in ("r+", "r-")]

    def force_pieces(self) -> list[ForcePiece]:
        return [ForcePiece(0.0, np.inf, 0.0, self.friction, along=0.0)]


_APEX, _SIGNS = "l0", (1, -1)
_CORNERS = {(r, s): f"l{'+' if r > 0 else '-'}{'+' if s > 0 else '-'}" for r in _SIGNS for s in _SIGNS}
_RAYS = {1: "p+", -1: "p-"}  # with forces across at their limit, and less and less of them along
_SLIDES = {1: "g-", -1: "g+"}, {1: "r-", -1: "r+"}  # accelerations against a force across, and along


def _cells() -> list[tuple[str, ...]]:
    """Tetrahedra that fill the set of forces: below the corners, where friction limits those along, two
    that share the diagonal of the corners; above, to the rays, three.
    """
    front, across, other, back = (_CORNERS[pair] for pair in product(_SIGNS, _SIGNS))
    left, right = _RAYS[1], _RAYS[-1]
    below = [(_APEX, front, across, back), (_APEX, front, other, back)]
    above = [(front, other, left, back), (front, left, back, right), (front, across, back, right)]
    return below + above


def _limited_modes() -> list[Mode]:
    """Modes of a wheel with a limit along: what is at rest, on a face, an edge or at the apex of the set."""

    def on(*corners: str) -> list[tuple[str, ...]]:
        """Triangles of the cells on a face."""
        every = {three for cell in _cells() for three in combinations(cell, 3) if {*three} <= {*corners}}
        return sorted(every)

    across, along = _SLIDES
    limited_modes = [Mode("stick", cell) for cell in _cells()]
    for r in _SIGNS:
        face = [_CORNERS[r, s] for s in _SIGNS]
        limited_modes += [Mode("slide", (along[r], *three)) for three in on(_APEX, *face)]
        limited_modes += [Mode("roll", (along[r], *three)) for three in on(*face, *_RAYS.values())]
        limited_modes.append(Mode("roll", ("gn", *_RAYS.values(), along[r]), redundant=True))
    for s in _SIGNS:
        face = [_CORNERS[r, s] for r in _SIGNS]
        limited_modes += [Mode("slide", (across[s], *three)) for three in on(_APEX, *face, _RAYS[s])]
    for (r, s), corner in _CORNERS.items():
        moves = along[r], across[s]
        limited_modes += [Mode("slide", (*moves, corner, end)) for end in (_APEX, _RAYS[s])]
        limited_modes.append(Mode("separate", ("gn", *moves, _APEX)))
        limited_modes.append(Mode("slide", ("gn", *moves, _RAYS[s]), redundant=True))
    return limited_modes


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenWheel(Binding):
    """A wheel whose drive or brake holds it up to a torque: beyond it rolls.

    The rolling direction is `tangent`, by default the base axis x. Along it the force is at most torque /
    radius, and within the friction; across it friction alone limits it. The friction pyramid has four faces,
    along and across, so that `facets` has no meaning.

    Attributes:
        friction: Coulomb coefficient, 1e-6 to 1000.
        torque: Largest torque of drive or brake at the wheel, N m.
        radius: Radius of the wheel, m.
    """

    kind: ClassVar[str] = "driven-wheel"

    friction: float
    torque: float
    radius: float

    def check_parameters(self) -> None:
        if self.planar:
            raise InputError("driven-wheel: for spatial supports; in the plane use a unilateral contact")
        if self.stiffness is not None:
            raise InputError("stiffness: not for a driven-wheel, whose torque no compliant contact limits")
        friction_parameters(self, "friction")
        positive_parameters(self, "torque", "radius")
        settle(self, facets=4)

    @property
    def force(self) -> float:
        """Largest force along the rolling direction, N."""
        return self.torque / self.radius

    @property
    def _slope(self) -> float:
        return corrected_friction(self.friction, self.facets)

    def pool(self) -> list[PoolVariable]:
        # Loads are counted in shares of the normal force at which friction is as strong as the torque: their
        # sum but for those along the rays is that force.
        n, s, slope = normal_vector(self), _AXIS, self._slope
        r = np.cross(_AXIS, n)
        moves = {"gn": n, "g+": s, "g-": -s, "r+": r, "r-": -r}
        corners = {name: n + slope * (a * r + b * s) for (a, b), name in _CORNERS.items()}
        rays = {name: n + slope * sign * s for sign, name in _RAYS.items()}
        return [
            *(PoolVariable(name, acceleration=way, auxiliary=(0.0,)) for name, way in moves.items()),
            PoolVariable(_APEX, auxiliary=(1.0,)),
            *(PoolVariable(name, force=edge, auxiliary=(1.0,)) for name, edge in corners.items()),
            *(PoolVariable(name, force=edge, auxiliary=(0.0,)) for name, edge in rays.items()),
        ]

    def auxiliary_rhs(self) -> tuple[float, ...]:
        return (self.force / self._slope,)

    def modes(self) -> list[Mode]:
        return _limited_modes()

    def force_pieces(self) -> list[ForcePiece]:
        return [ForcePiece(0.0, np.inf, 0.0, self.friction, along=self.force)]
