"""Margins of contacts against being lost, in N, N m, mm and per cent, beside the relative GN and GT."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ocptip.basics.text import percent, quantity
from ocptip.reserves.equal_compliance import equal_sharing, face_each_other
from ocptip.reserves.friction_needed import FrictionDemand
from ocptip.standing.instants import Loaded

_ALIKE = 1e-6
_LEAST, _MOST = ("force", "moment", "edge", "alike"), ("friction", "equal_friction", "missing")


@dataclass(frozen=True)
class Margin:
    """The worst instant of one quantity.

    Attributes:
        value: in the unit of its name.
        time: s; None where it is not of one instant.
        contacts: which, counted from 1: the two of a tipping axis, or all that are alike (to 1e-6).
    """

    value: float
    time: float | None = None
    contacts: tuple[int, ...] = ()

    def later(self, seconds: float) -> Margin:
        """This margin with its time shifted by `seconds`."""
        return replace(self, time=None if self.time is None else self.time + seconds)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {"value": self.value, "time": self.time, "contacts": list(self.contacts)}

    @property
    def where(self) -> str:
        """The contacts: "contact 3", "contacts 1 and 2"; empty without any."""
        *others, last = [f"{k}" for k in self.contacts] or [""]
        return f"contacts {', '.join(others)} and {last}" if others else last and f"contact {last}"

    def __str__(self) -> str:
        """Where and when."""
        return f"({self.where}{', ' if self.contacts else ''}{self.time:.3f} s)"


@dataclass(frozen=True)
class ContactMargins:
    """Worst values of the contacts over some instants; None where a quantity has no meaning there.

    Attributes:
        force: minimum distance of a normal force from the end at which its contact lets go, N: for ordinary
            contacts the normal force. Rigid feet whose sharing is not determined: as if equally compliant.
        moment: minimum moment left about a tipping axis, N m; negative where the base tips: so much is
            missing.
        edge: minimum distance of the zero-moment point from the edge of the support polygon, m, negative
            beyond it; only for ordinary contacts on one plane.
        friction: maximum share of a contact's friction in use, where forces are shared optimally; where the
            base slides, the factor on the friction that would hold it.
        missing: the tangential force that is missing at that instant, N; None unless the base slides, and
            tangential forces would hold it.
        unique: the normal forces are determined; otherwise those of motion.csv are one possible sharing.
        weak: number of instants of the first grid at which forces can hold the base, but the contact solver
            came upon a motion, see `contact.resting`; there may be more at which it did not. 0 on declared
            springs, whose forces are unique.
        first_weak: the first of them, s; infinite without any.
        alike: where the sharing of rigid feet is not determined: the minimum normal force of equally
            compliant feet, N, below zero if one would have to pull; it lifts then for a while, and the others
            hold the base.
        equal_friction: the share of the friction in use with these normal forces; 1 and more: it slips.
    """

    force: Margin | None
    moment: Margin | None
    edge: Margin | None
    friction: Margin | None
    unique: bool
    weak: int = 0
    first_weak: float = np.inf
    alike: Margin | None = None
    equal_friction: Margin | None = None
    missing: Margin | None = None

    @classmethod
    def of(cls, loaded: Loaded, times: np.ndarray) -> ContactMargins:
        """Margins of instants at times (N,), s."""
        tip, tip_over = loaded.tip, loaded.footing.tip_over
        pairs = [(min(axis.contacts) + 1, max(axis.contacts) + 1) for axis in tip_over.axes]
        weak = loaded.states.persistent & loaded.states.without_basis
        support = loaded.footing.support
        if support.elastic and not face_each_other(support):
            weak[:] = False  # declared springs decide how the load is shared
        unique, equal = loaded.footing.slip.redistribution == "tangential", equal_sharing(loaded.states)
        force = equal.normal_forces if equal else tip.normal_reserves
        needed, missing = _beyond_friction(loaded, times)
        return cls(
            force=_least(np.maximum(force, 0.0), times),
            moment=None if tip_over.free_rotation else _least(tip.margins, times, pairs),
            edge=_least(tip.edge_distances[:, None], times, [()]),
            friction=needed or _most(loaded.largest_slip.usage, times),
            unique=unique,
            weak=int(np.count_nonzero(weak)),
            first_weak=float(np.min(times[weak], initial=np.inf)),
            alike=equal and _least(equal.if_all_pressed, times),
            equal_friction=equal and _most(equal.usage, times),
            missing=missing,
        )

    def worse(self, other: ContactMargins) -> ContactMargins:
        """The worse of both, quantity by quantity."""
        signs = {**dict.fromkeys(_LEAST, 1.0), **dict.fromkeys(_MOST, -1.0)}
        worst = {
            name: _smaller(getattr(self, name), getattr(other, name), sign) for name, sign in signs.items()
        }
        weak, first = self.weak + other.weak, min(self.first_weak, other.first_weak)
        return replace(self, **worst, weak=weak, first_weak=first)

    @property
    def uncounted(self) -> ContactMargins:
        """These margins without the weak instants, which are counted elsewhere."""
        return replace(self, weak=0, first_weak=np.inf)

    @property
    def differs(self) -> str:
        """The failure, lift-off or slip, that only equally compliant feet show; else empty."""
        alike, friction, does = self.alike, self.equal_friction, []
        if alike and alike.value < 0:
            does.append(f"{alike.where} lift{'s' * (len(alike.contacts) < 2)}")
        if friction and friction.value >= 1:
            slips = f"{friction.where} slip{'s' * (len(friction.contacts) < 2)}"
            does.append(f"{slips}, needing {of_friction(friction.value)}")
        return f"with equally compliant feet {' and '.join(does)}" if does else ""

    def later(self, seconds: float) -> ContactMargins:
        """These margins with their times shifted by `seconds`."""
        known = {name: margin for name in (*_LEAST, *_MOST) if (margin := getattr(self, name))}
        shifted = {name: margin.later(seconds) for name, margin in known.items()}
        return replace(self, **shifted, first_weak=self.first_weak + seconds)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; units are in the keys."""
        names = {"least_normal_force_N": self.force, "least_moment_Nm": self.moment}
        names |= {"least_edge_distance_m": self.edge, "friction_use": self.friction}
        names |= {"friction_missing_N": self.missing}
        data = {name: margin and margin.to_dict() for name, margin in names.items()}
        first = self.first_weak if self.weak else None
        return {
            **data,
            "normal_forces_unique": self.unique,
            "least_force_if_feet_give_alike_N": self.alike and self.alike.to_dict(),
            "equal_compliance": self.alike
            and {
                "friction_use": self.equal_friction and self.equal_friction.to_dict(),
                "agrees": not self.differs,
            },
            "weak_instants": self.weak,
            "first_weak_s": first,
        }

    def lines(self) -> list[str]:
        """At which contacts, and when; what equally compliant feet do beside the best sharing."""
        named = (
            ("minimum foot force", self.alike or self.force, lambda value: quantity(value, "N", 3)),
            ("minimum tipping margin", self.moment, lambda value: quantity(value, "N m", 3)),
            ("zero-moment point to the edge", self.edge, lambda value: quantity(1e3 * value, "mm", 3)),
            ("maximum friction used", self.friction, percent),
            ("tangential force that is missing", self.missing, lambda value: quantity(value, "N", 3)),
            ("the same with equally compliant feet", self.equal_friction, percent),
        )
        return [f"{name} {text(instant.value)} {instant}" for name, instant, text in named if instant]


def of_friction(share: float) -> str:
    """A share in words; that of a foot next to lifting is a number without use."""
    return f"{percent(share) if share < 10 else 'far more than all'} of the friction"


def _least(
    values: np.ndarray, times: np.ndarray, names: list[tuple[int, ...]] | None = None
) -> Margin | None:
    """The minimum of values (N, m) at times (N,); None if none is finite. Columns are contacts if not
    named.
    """
    known = np.where(np.isfinite(values), values, np.inf)
    if not np.isfinite(known).any():
        return None
    i, k = np.unravel_index(np.argmin(known), known.shape)
    value = float(known[i, k])
    if names:
        return Margin(value, float(times[i]), names[k])
    alike = np.flatnonzero(known[i] <= value + _ALIKE * abs(value))
    return Margin(value, float(times[i]), tuple(int(j) + 1 for j in alike))


def _beyond_friction(loaded: Loaded, times: np.ndarray) -> tuple[Margin | None, Margin | None]:
    """At the instant at which the base slides fastest: the factor on the friction that would hold it, and the
    tangential force that is missing, N. None unless it slides, and such a factor or force is known. The
    factor is infinite where no friction holds.
    """
    k = int(np.argmax(np.nan_to_num(loaded.largest_slip.slide_acceleration)))
    if not loaded.largest_slip.slide_acceleration[k] > 0:
        return None, None
    demand = FrictionDemand.of(loaded.states.support, loaded.states.wrenches[k])
    needed = Margin(demand.factor, float(times[k])) if demand.factor > 1 else None
    missing = Margin(demand.missing, float(times[k])) if 0 < demand.missing < np.inf else None
    return needed, missing


def _most(values: np.ndarray, times: np.ndarray) -> Margin | None:
    """The maximum of values (N, contacts) at times (N,); None if none is finite."""
    least = _least(-values, times)
    return least and Margin(-least.value + 0.0, least.time, least.contacts)


def _smaller(one: Margin | None, other: Margin | None, sign: float = 1.0) -> Margin | None:
    """The one of the smaller value times sign; what is None does not count."""
    known = [margin for margin in (one, other) if margin]
    return min(known, key=lambda margin: sign * margin.value, default=None)
