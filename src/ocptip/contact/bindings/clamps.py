"""Five kinds of local clamps, each reduced to one contact point with a set of admissible forces.

The upper jaw (index o in thesis M) pushes the base along +n, the lower jaw (u) along -n. `K_n` is the
normal force on the base at the reduced point. Source: thesis M, 3.2.1 to 3.2.5 and A.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ocptip.basics.errors import positive_number, refuse_huge
from ocptip.basics.frozen import settle
from ocptip.contact.bindings.automaton import Mode
from ocptip.contact.bindings.binding import (
    Binding,
    ForcePiece,
    PoolVariable,
    edge_vectors,
    friction_parameters,
    normal_vector,
    positive_parameters,
    sliding_variables,
)
from ocptip.contact.bindings.unilateral import following, preceding, stick_triples


@dataclass(frozen=True, kw_only=True, eq=False)
class _Clamp(Binding):
    """Shared parameters of all clamps: one friction coefficient per jaw.

    Attributes:
        friction_upper: friction coefficient of the jaw that pushes along the normal.
        friction_lower: friction coefficient of the opposite jaw.
    """

    friction_upper: float
    friction_lower: float

    def check_parameters(self) -> None:
        friction_parameters(self, "friction_upper", "friction_lower")

    @property
    def directions(self) -> int:
        """Number of edges of one cone: S, or 2 in the plane."""
        return 2 if self.planar else self.facets


@dataclass(frozen=True, kw_only=True, eq=False)
class _PreloadedClamp(_Clamp):
    """A clamp with a preload.

    Attributes:
        clamp_force: preload F > 0, N.
    """

    clamp_force: float

    def check_parameters(self) -> None:
        super().check_parameters()
        positive_parameters(self, "clamp_force")


@dataclass(frozen=True, kw_only=True, eq=False)
class _ActuatedClamp(_PreloadedClamp):
    """A clamp pressed by an actuator all the time, or by a weight.

    Attributes:
        holding_power: electric power of the actuator, W; 0: a weight, or a drive that holds by itself.
    """

    holding_power: float = 0.0

    def check_parameters(self) -> None:
        super().check_parameters()
        power = positive_number("holding_power", self.holding_power, zero_allowed=True)
        refuse_huge("holding_power", power)
        settle(self, holding_power=power)

    def power(self) -> float:
        return self.holding_power


@dataclass(frozen=True, kw_only=True, eq=False)
class RigidClamp(_Clamp):
    """Two rigid jaws without preload or play (3.2.1): no normal motion, two opposite friction cones."""

    kind: ClassVar[str] = "rigid-clamp"

    def pool(self) -> list[PoolVariable]:
        edges = _cone_edges(self)
        return [
            *sliding_variables(self),
            *(PoolVariable(f"l{h + 1}", force=k) for h, k in enumerate(edges)),
        ]

    def modes(self) -> list[Mode]:
        if self.planar:
            ring = [("l1", "l2"), ("g+", "l2"), ("g+", "l4"), ("l3", "l4"), ("g-", "l3"), ("g-", "l1")]
            return [Mode("stick" if e[0].startswith("l") else "slide", e) for e in ring]
        s = self.facets
        modes = [Mode("stick", triple) for first in (1, s + 1) for triple in stick_triples(s, first)]
        for h in range(1, s + 1):
            g, g_next = f"g{h}", f"g{following(h, s)}"
            for shift in (0, s):
                l_before, l_here = f"l{shift + preceding(h, s)}", f"l{shift + h}"
                modes.append(Mode("slide", (g, l_before, l_here)))
                modes.append(Mode("slide", (g, g_next, l_here)))
        return modes

    def force_pieces(self) -> list[ForcePiece]:
        return [
            ForcePiece(0.0, np.inf, 0.0, self.friction_upper),
            ForcePiece(-np.inf, 0.0, 0.0, -self.friction_lower),
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceVariableHalfRigidClamp(_PreloadedClamp):
    """Upper jaw rigid, lower jaw pressed by a stiff preloaded spring (3.2.2): no normal motion."""

    kind: ClassVar[str] = "force-variable-half-rigid-clamp"

    def pool(self) -> list[PoolVariable]:
        lower = edge_vectors(self, self.friction_lower, -1.0)
        gamma = self.friction_upper / (self.friction_upper + self.friction_lower)  # (3.56), same S for both
        return [
            *sliding_variables(self),
            *(PoolVariable(f"l{h + 1}", force=k, auxiliary=(-k[0],)) for h, k in enumerate(lower)),
            PoolVariable("lo", force=normal_vector(self), auxiliary=(-gamma,)),
            PoolVariable("le", auxiliary=(-1.0,)),
            PoolVariable("lb", auxiliary=(1.0,)),
        ]

    def auxiliary_rhs(self) -> tuple[float, ...]:
        return (self.clamp_force,)

    def modes(self) -> list[Mode]:
        if self.planar:
            return [
                Mode("stick", ("l1", "l2", "le")),
                Mode("stick", ("l1", "l2", "lb")),
                Mode("stick", ("lo", "l1", "lb")),
                Mode("stick", ("lo", "l2", "lb")),
                Mode("slide", ("g-", "l1", "le")),
                Mode("slide", ("g+", "l2", "le")),
                Mode("slide", ("g-", "lo", "l1")),
                Mode("slide", ("g+", "lo", "l2")),
                Mode("redundant", ("g-", "lo", "le"), redundant=True),
                Mode("redundant", ("g+", "lo", "le"), redundant=True),
            ]
        s = self.facets
        modes = [Mode("stick", (*triple, extra)) for triple in stick_triples(s) for extra in ("le", "lb")]
        for h in range(1, s + 1):
            g, g_next = f"g{h}", f"g{following(h, s)}"
            l_before, l_here = f"l{preceding(h, s)}", f"l{h}"
            modes += [
                Mode("stick", ("lo", l_before, l_here, "lb")),
                Mode("slide", (g, l_before, l_here, "le")),
                Mode("slide", (g, g_next, l_here, "le")),
                Mode("slide", (g, "lo", l_before, l_here)),
                Mode("slide", (g, g_next, "lo", l_here)),
                Mode("redundant", (g, g_next, "lo", "le"), redundant=True),
            ]
        return modes

    def force_pieces(self) -> list[ForcePiece]:
        f, upper, lower = self.clamp_force, self.friction_upper, self.friction_lower
        return [
            ForcePiece(-f, np.inf, (lower + upper) * f, upper),
            ForcePiece(-np.inf, -f, 0.0, -lower),
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceConstantHalfRigidClamp(_ActuatedClamp):
    """Upper jaw rigid, lower jaw pressed with a constant force (3.2.4, A.2): can open upwards."""

    kind: ClassVar[str] = "force-constant-half-rigid-clamp"

    def pool(self) -> list[PoolVariable]:
        upper = edge_vectors(self, self.friction_upper)
        return [
            PoolVariable("gn", acceleration=normal_vector(self)),
            *sliding_variables(self),
            *(PoolVariable(f"l{h + 1}", force=k, auxiliary=(k[0],)) for h, k in enumerate(upper)),
            PoolVariable("lb", auxiliary=(-1.0,)),
        ]

    def force_offset(self) -> np.ndarray:
        return normal_vector(self, -self.clamp_force * (1.0 + self.friction_lower / self.friction_upper))

    def auxiliary_rhs(self) -> tuple[float, ...]:
        return (self.clamp_force * self.friction_lower / self.friction_upper,)

    def modes(self) -> list[Mode]:
        if self.planar:
            return [
                Mode("stick", ("l1", "l2", "lb")),
                Mode("slide", ("g+", "l2", "lb")),
                Mode("slide", ("g-", "l1", "lb")),
                Mode("separate", ("gn", "l1", "l2")),
                Mode("separate", ("gn", "g+", "l2")),
                Mode("separate", ("gn", "g-", "l1")),
                Mode("redundant", ("g-", "gn", "lb"), redundant=True),
                Mode("redundant", ("g+", "gn", "lb"), redundant=True),
            ]
        s = self.facets
        modes = [Mode("stick", (*triple, "lb")) for triple in stick_triples(s)]
        modes += [Mode("separate", ("gn", *triple)) for triple in stick_triples(s)]
        for h in range(1, s + 1):
            g, g_next = f"g{h}", f"g{following(h, s)}"
            l_before, l_here = f"l{preceding(h, s)}", f"l{h}"
            modes += [
                Mode("slide", (g, l_before, l_here, "lb")),
                Mode("slide", (g, g_next, l_here, "lb")),
                Mode("separate", ("gn", g, l_before, l_here)),
                Mode("separate", ("gn", g, g_next, l_here)),
                Mode("redundant", (g, g_next, "gn", "lb"), redundant=True),
            ]
        return modes

    def force_pieces(self) -> list[ForcePiece]:
        f, upper, lower = self.clamp_force, self.friction_upper, self.friction_lower
        return [ForcePiece(-f, np.inf, (lower + upper) * f, upper)]


@dataclass(frozen=True, kw_only=True, eq=False)
class _TwoSidedClamp(_PreloadedClamp):
    """Both jaws on one source of force through a lever.

    Attributes:
        lever_ratio: travel of the upper over the lower jaw, i = ds_o / ds_u > 0; the jaws press with
            F_u = (1 + i) F and F_o = (1 + 1/i) F.
    """

    lever_ratio: float = 1.0

    def check_parameters(self) -> None:
        super().check_parameters()
        positive_parameters(self, "lever_ratio")

    def auxiliary_rhs(self) -> tuple[float, ...]:
        return (self.clamp_force,)

    @property
    def upper_force(self) -> float:
        """Force F_o of the upper jaw when the lower one is free, N."""
        return (1.0 + 1.0 / self.lever_ratio) * self.clamp_force

    @property
    def lower_force(self) -> float:
        """Force F_u of the lower jaw when the upper one is free, N."""
        return (1.0 + self.lever_ratio) * self.clamp_force

    def _jaw_variables(self) -> list[PoolVariable]:
        i = self.lever_ratio
        weights = [i / (1.0 + i)] * self.directions + [1.0 / (1.0 + i)] * self.directions
        return [
            PoolVariable(f"l{h}", force=k, auxiliary=(w * abs(k[0]),))
            for h, (k, w) in enumerate(zip(_cone_edges(self), weights, strict=True), 1)
        ]  # (A.5)

    def _between_piece(self) -> ForcePiece:
        i, f, upper, lower = self.lever_ratio, self.clamp_force, self.friction_upper, self.friction_lower
        slope = (upper - i * lower) / (1.0 + i)
        return ForcePiece(-self.lower_force, self.upper_force, (upper + lower) * f, slope)  # (3.69)

    def _closed_modes(self, upper_extra: str, lower_extra: str) -> list[Mode]:
        """The modes both two-sided clamps share; `*_extra` marks a jaw that is at its limit."""
        if self.planar:
            return [
                Mode("stick", ("l1", "l2", upper_extra)),
                Mode("stick", ("l3", "l4", lower_extra)),
                Mode("stick", ("l1", "l2", "lb")),
                Mode("stick", ("l3", "l4", "lb")),
                Mode("stick", ("l1", "l3", "lb")),
                Mode("stick", ("l2", "l4", "lb")),
                Mode("slide", ("g-", "l1", upper_extra)),
                Mode("slide", ("g+", "l2", upper_extra)),
                Mode("slide", ("g-", "l3", lower_extra)),
                Mode("slide", ("g+", "l4", lower_extra)),
                Mode("slide", ("g-", "l1", "l3")),
                Mode("slide", ("g+", "l2", "l4")),
            ]
        s = self.facets
        modes = []
        for first, extra in ((1, upper_extra), (s + 1, lower_extra)):
            modes += [
                Mode("stick", (*triple, e)) for triple in stick_triples(s, first) for e in (extra, "lb")
            ]
        for h in range(1, s + 1):
            g, g_next = f"g{h}", f"g{following(h, s)}"
            before, here = preceding(h, s), h
            up_before, up, low_before, low = f"l{before}", f"l{here}", f"l{s + before}", f"l{s + here}"
            modes += [
                Mode("stick", (up_before, up, low_before, "lb")),
                Mode("stick", (up, low_before, low, "lb")),
                Mode("slide", (g, up_before, up, low_before)),
                Mode("slide", (g, up, low_before, low)),
                Mode("slide", (g, g_next, up, low)),
                Mode("slide", (g, up_before, up, upper_extra)),
                Mode("slide", (g, g_next, up, upper_extra)),
                Mode("slide", (g, low_before, low, lower_extra)),
                Mode("slide", (g, g_next, low, lower_extra)),
            ]
        return modes


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceVariableTwoSidedClamp(_TwoSidedClamp):
    """Both jaws on one stiff spring through a lever (3.2.3, A.1): no normal motion."""

    kind: ClassVar[str] = "force-variable-two-sided-clamp"

    def pool(self) -> list[PoolVariable]:
        return [
            *sliding_variables(self),
            *self._jaw_variables(),
            PoolVariable("le", auxiliary=(-1.0,)),
            PoolVariable("lb", auxiliary=(1.0,)),
        ]

    def modes(self) -> list[Mode]:
        return self._closed_modes("le", "le")

    def force_pieces(self) -> list[ForcePiece]:
        return [
            self._between_piece(),
            ForcePiece(self.upper_force, np.inf, 0.0, self.friction_upper),
            ForcePiece(-np.inf, -self.lower_force, 0.0, -self.friction_lower),
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceConstantTwoSidedClamp(_TwoSidedClamp, _ActuatedClamp):
    """Both jaws pressed by a constant force through a lever (3.2.5, A.3): yields in both directions."""

    kind: ClassVar[str] = "force-constant-two-sided-clamp"

    def pool(self) -> list[PoolVariable]:
        return [
            PoolVariable("gn+", acceleration=normal_vector(self)),
            PoolVariable("gn-", acceleration=normal_vector(self, -1.0)),
            *sliding_variables(self),
            *self._jaw_variables(),
            PoolVariable("le", auxiliary=(-1.0,)),
            PoolVariable("lb", auxiliary=(1.0,)),
        ]

    def modes(self) -> list[Mode]:
        if self.planar:
            pairs = [("g-",), ("g+",)]
        else:
            pairs = [(f"g{h}", f"g{following(h, self.facets)}") for h in range(1, self.facets + 1)]
        redundant = [
            Mode("redundant", (*pair, gn, "le"), redundant=True) for pair in pairs for gn in ("gn-", "gn+")
        ]
        return [
            Mode("yield" if {"gn-", "gn+"} & set(mode.elements) else mode.name, mode.elements)
            for mode in self._closed_modes("gn-", "gn+")
        ] + redundant

    def force_pieces(self) -> list[ForcePiece]:
        return [self._between_piece()]


def _cone_edges(clamp: _Clamp) -> np.ndarray:
    """Edges l1.. of the upper cone (+n), then of the lower cone (-n), same tangential directions."""
    upper = edge_vectors(clamp, clamp.friction_upper)
    lower = edge_vectors(clamp, clamp.friction_lower, -1.0)
    return np.vstack([upper, lower])
