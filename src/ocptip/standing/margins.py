"""Margins of contacts of single states against being lost: in N m, N, m and shares, beside GN and GT."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ocptip.basics.text import percent, quantity
from ocptip.contact.resting import solve_resting
from ocptip.contact.states import ContactStates
from ocptip.reserves.equal_compliance import reported_slip
from ocptip.reserves.feet_on_plane import feet_on_plane
from ocptip.reserves.force_sets import ForceSets
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver

_HOLDS = 1 - 1e-6  # friction utilisation up to which feet hold the base beyond doubt
_SHARED = "how rigid contacts share the load is not determined; normal forces are "
_EQUAL, _ONE_OF_MANY = _SHARED + "those of equally compliant feet", _SHARED + "one of them"
_UNITS = {"tipping_moment": "_Nm", "edge_distance": "_m", "normal_forces": "_N", "min_foot_force": "_N"}


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of the contacts in one state, or in N states: then every field begins with an axis N.

    NaN where no contact state is known. Where the base moves, GN, GT and forces are those of one of the
    motions that the contact laws allow. Fields that name contacts count them from 1, as files and reports do;
    the columns of arrays are in the order of the support's contacts.

    Attributes:
        stable: contacts are maintained: forces within the friction cones hold the base.
        tips, slips: how contacts are lost where they are: one lifts off; one slides.
        GN: tip-over index: from 1 on the base tips.
        GT: friction utilisation where forces are shared optimally: from 1 on the base slips.
        tipping_moment: N m that can be added about the nearest tipping axis. Infinite without an axis, zero
            about a line of contacts. Where the base tips it is negative: so much is missing.
        tipping_contacts: (2,) the contacts of that axis, from 1; 0 for none.
        edge_distance: m, of the zero-moment point from the edge of the support polygon; NaN unless ordinary
            contacts lie in one plane.
        normal_forces: (n,) N, see `note`.
        min_foot_force: N, minimum distance of a normal force from the end at which its contact lets go, for
            ordinary contacts the normal force; infinite where no contact can.
        friction_used: (n,) tangential force over its limit with these normal forces; NaN without load.
        note: what is open about the normal forces; empty where they are unique.
    """

    stable: np.ndarray
    tips: np.ndarray
    slips: np.ndarray
    GN: np.ndarray
    GT: np.ndarray
    tipping_moment: np.ndarray
    tipping_contacts: np.ndarray
    edge_distance: np.ndarray
    normal_forces: np.ndarray
    min_foot_force: np.ndarray
    friction_used: np.ndarray
    note: str = ""

    @classmethod
    def under(cls, wrenches: np.ndarray, tip_over: TipOver, slip: Slip) -> Margins:
        """Under wrenches (N, 6) on a base, N and N m; of feet on a plane without a contact solver."""
        feet = feet_on_plane(tip_over.support)
        if feet is not None and not feet.unique and slip.redistribution != "full":
            feet = None
        if feet is None or tip_over.affine_moments is None or tip_over.reference_moment is None:
            return cls.of(solve_resting(tip_over.support, wrenches), tip_over, slip)
        slope, offset = tip_over.affine_moments
        moments, shared = wrenches @ slope.T + offset, feet.share(wrenches)
        nearest = np.argmin(moments, axis=1)
        least, count = moments[np.arange(len(wrenches)), nearest], len(wrenches)
        total = np.sum(shared.normal_forces, axis=1)
        holds = (least > 0) & (shared.usage < _HOLDS)  # False where it is not known
        result = cls(
            stable=np.ones(count, dtype=bool),
            tips=np.zeros(count, dtype=bool),
            slips=np.zeros(count, dtype=bool),
            GN=tip_over.reference_moment / (tip_over.reference_moment + least),
            GT=shared.usage,
            tipping_moment=least,
            tipping_contacts=tip_over.pairs[nearest + 1],
            edge_distance=least / total,
            normal_forces=shared.normal_forces,
            min_foot_force=np.min(shared.normal_forces, axis=1),
            friction_used=shared.friction_used,
            note="" if feet.unique else _EQUAL,
        )
        if not holds.all():
            left = np.flatnonzero(~holds)
            others = cls.of(solve_resting(tip_over.support, wrenches[left]), tip_over, slip)
            for name, values in result._arrays().items():
                values[left] = getattr(others, name)
        return result

    @classmethod
    def of(cls, states: ContactStates, tip_over: TipOver, slip: Slip) -> Margins:
        """Margins of contact states, as `contact.resting` gives them, by those of their support."""
        tip, slipping = tip_over.evaluate(states), slip.evaluate(states, derivatives=False)
        shown, unique = reported_slip(states, slipping), slip.redistribution == "tangential"
        lifts = tip.lifting_contact >= 0
        return cls(
            stable=states.persistent,
            tips=lifts,
            slips=~lifts & states.solved & ~states.persistent,
            GN=tip.GN,
            GT=slipping.GT,
            tipping_moment=np.where(states.solved, _moments(states, tip_over, tip.margins), np.nan),
            tipping_contacts=tip_over.pairs[tip.nearest_axis + 1],
            edge_distance=tip.edge_distances,
            normal_forces=shown.normal_forces,
            min_foot_force=np.min(
                np.minimum(*ForceSets(states.support).distances(shown.normal_forces)), axis=1
            ),
            friction_used=shown.usage,
            note="" if unique else _ONE_OF_MANY if shown is slipping else _EQUAL,
        )

    def __len__(self) -> int:
        """Number of states; a single one has no length."""
        return len(self.GN)

    def __getitem__(self, k: int | slice | np.ndarray) -> Margins:
        """Those of some of the states, or of one."""
        return Margins(**{name: values[k] for name, values in self._arrays().items()}, note=self.note)

    def _arrays(self) -> dict[str, np.ndarray]:
        return {name: getattr(self, name) for name in _ARRAYS}

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; units are in the keys."""
        named = {f"{name}{_UNITS.get(name, '')}": values for name, values in self._arrays().items()}
        return {**{name: values.tolist() for name, values in named.items()}, "note": self.note}

    def __repr__(self) -> str:
        """The verdict and the margins of one state; of several how many are stable, and the worst one."""
        if np.ndim(self.GN) == 0:
            return f"<Margins {self._text()}>"
        if not len(self):
            return "<Margins of no states>"
        worst = int(np.nanargmax(np.append(np.maximum(self.GN, self.GT), -np.inf))) % len(self)
        head = f"{len(self)} states, {np.count_nonzero(self.stable)} stable; worst is [{worst}]"
        return f"<Margins of {head}: {self[worst]._text()}>"

    def _text(self) -> str:
        losses = [word for word, does in (("tips", self.tips), ("slips", self.slips)) if does]
        verdict = "stable" if self.stable else " and ".join(losses) or "no contact state is known"
        first, second = self.tipping_contacts
        about = f" about contacts {first} and {second}" if first else ""
        moment, force = quantity(float(self.tipping_moment), "N m", 3), float(self.min_foot_force)
        note = f" ({self.note})" if self.note else ""
        return (
            f"{verdict}: tipping margin {moment}{about}, friction used {percent(float(self.GT))}, "
            f"minimum foot force {quantity(force, 'N', 3)}{note}"
        )


_ARRAYS = tuple(item.name for item in fields(Margins) if item.name != "note")


def _moments(states: ContactStates, tip_over: TipOver, margins: np.ndarray) -> np.ndarray:
    """(N,) N m left about the nearest axis; on a plane the load alone decides, also where it moves."""
    if tip_over.free_rotation:
        return np.zeros(len(states))
    if (affine := tip_over.affine_moments) is not None:
        slope, offset = affine
        return np.min(states.wrenches @ slope.T + offset, axis=1)
    return np.min(margins, axis=1, initial=np.inf)
