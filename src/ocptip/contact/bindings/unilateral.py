"""The ordinary contact: no penetration, no adhesion, Coulomb friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, positive_number
from ocptip.basics.frozen import settle
from ocptip.contact.bindings.automaton import Mode
from ocptip.contact.bindings.binding import (
    Binding,
    ForcePiece,
    PoolVariable,
    edge_vectors,
    friction_parameters,
    normal_vector,
    sliding_variables,
)

LEAST_FRICTION = 1e-6
"""Smallest friction coefficient above none: below it friction is lost in the rounding of the other forces."""


@dataclass(frozen=True, kw_only=True, eq=False)
class UnilateralContact(Binding):
    """Ordinary unilateral contact (3.1).

    Attributes:
        friction: Coulomb coefficient, 1e-6 to 1000, or 0, a castor. Without friction the pyramid is one edge,
            the normal, and the contact slides or separates.
    """

    kind: ClassVar[str] = "unilateral"

    friction: float

    def check_parameters(self) -> None:
        if positive_number("friction", self.friction, zero_allowed=True) == 0:
            settle(self, friction=0.0)
            return
        friction_parameters(self, "friction")
        if self.friction < LEAST_FRICTION:
            raise InputError(
                f"friction: must be 0 (none) or at least {LEAST_FRICTION:g}, got {self.friction:g}"
            )

    def pool(self) -> list[PoolVariable]:
        forces = edge_vectors(self, self.friction) if self.friction else [normal_vector(self)]
        return [
            PoolVariable("gn", acceleration=normal_vector(self)),
            *sliding_variables(self),
            *(PoolVariable(f"l{h + 1}", force=k) for h, k in enumerate(forces)),
        ]

    def modes(self) -> list[Mode]:
        if self.friction == 0:
            return self._frictionless_modes()
        if self.planar:
            return [
                Mode("stick", ("l1", "l2")),
                Mode("slide", ("g+", "l2")),
                Mode("separate", ("gn", "g+")),
                Mode("separate", ("gn", "g-")),
                Mode("slide", ("g-", "l1")),
            ]
        s = self.facets
        modes = [Mode("stick", triple) for triple in stick_triples(s)]
        for h in range(1, s + 1):
            g, g_next = f"g{h}", f"g{following(h, s)}"
            l_before, l_here = f"l{preceding(h, s)}", f"l{h}"
            modes.append(Mode("slide", (g, l_before, l_here)))
            modes.append(Mode("slide", (g, g_next, l_here)))
            modes.append(Mode("separate", ("gn", g, g_next)))
        return modes

    def _frictionless_modes(self) -> list[Mode]:
        if self.planar:
            pairs = [("g-",), ("g+",)]
        else:
            pairs = [(f"g{h}", f"g{following(h, self.facets)}") for h in range(1, self.facets + 1)]
        slide = [Mode("slide", (*pair, "l1")) for pair in pairs]
        return slide + [Mode("separate", ("gn", *pair)) for pair in pairs]

    def force_pieces(self) -> list[ForcePiece]:
        return [ForcePiece(0.0, np.inf, 0.0, self.friction)]


def feet(contacts: Sequence[Binding] | ArrayLike, friction: float | None = None) -> list[Binding]:
    """Contacts unchanged, or ordinary ones at positions (n, 3), m, with normal z and one friction
    coefficient.

    Raises:
        InputError: no friction for positions, or friction beside contacts that have one.
    """
    bindings = (
        [contact for contact in contacts if isinstance(contact, Binding)] if np.iterable(contacts) else []
    )
    if bindings:
        if friction is not None:
            raise InputError("friction: for positions only; these contacts already have a coefficient")
        return list(contacts)  # pyright: ignore[reportArgumentType] # others are refused by the support
    places = finite_array("contacts", contacts, (None, 3))
    if friction is None:
        raise InputError("friction: missing; contacts given as positions need it")
    return [UnilateralContact(position=place, friction=friction) for place in places]


def preceding(h: int, facets: int) -> int:
    """Cyclic predecessor of the 1-based index h."""
    return facets if h == 1 else h - 1


def following(h: int, facets: int) -> int:
    """Cyclic successor of the 1-based index h."""
    return 1 if h == facets else h + 1


def stick_triples(facets: int, first: int = 1) -> list[tuple[str, str, str]]:
    """Edges of the pyramid in triples that fill it: a triangulation of its cross-section.

    Any triangulation gives a closed mode list with S - 2 stick modes. Thesis M takes a fan from one
    edge, across which a force may have to pass S - 2 triangles; here every triangle halves the rest, so
    that no more than about log2(S) pivots lead from a face to the middle.

    Args:
        facets: number S of edges.
        first: number of the cone's first edge variable (S + 1 for a second cone).
    """
    triples: list[tuple[int, int, int]] = []

    def fill(a: int, b: int) -> None:
        if b - a > 1:
            c = (a + b) // 2
            triples.append((a, c, b))
            fill(a, c)
            fill(c, b)

    third, two_thirds = facets // 3, 2 * facets // 3
    triples.append((0, third, two_thirds))
    fill(0, third)
    fill(third, two_thirds)
    fill(two_thirds, facets)
    names = [f"l{first + e}" for e in range(facets)]
    return [(names[a], names[b], names[c % facets]) for a, b, c in triples]
