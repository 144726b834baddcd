"""Find the part of a certificate for an uncertainty: intervals, contact forces, weights of rules, bounds.

Nothing here has to be trusted: `checker` checks the result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ocptip.basics.text import percent, silent
from ocptip.certificate.interior import Interior
from ocptip.certificate.trusted.forms import K, numbers_of
from ocptip.certificate.trusted.late import Rows
from ocptip.certificate.trusted.sharing import Rule, Sharing
from ocptip.certificate.trusted.terms import Terms
from ocptip.reserves.equal_compliance import reported_normal_forces
from ocptip.standing.footing import Footing
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN

HIGHEST = 1 - 1e-6  # reserves of 1 are lost
_LONGEST, _SHORTEST = 0.01, 2e-4  # s, of intervals
_DENSE = 2  # switching times per longest interval, from which intervals do not end at them
_MOST_COMBINATIONS = (81, 1000, 1000, 1000, 1000, 0)  # combinations of branches in round after round
_MOST, _TOO_MANY = 6000, 20_000  # rows of combinations: for more intervals; at all
_LAST = 8000  # rows of the intervals that lack a proof: so few are gone on with, however many there were
LOSS_WITHIN = 5e-3
"""Relative, how far claims are from the sampled worst values: nearer ones take several times as long."""
_LOSS = 2e-4  # relative, how far those of GT are from what is proved where that is not enough
_STEP = 0.01  # relative: first step of a share, and of what it exceeds its goal by, which is near enough
_SEARCHED = 8  # rows for which a share is searched at a time: all of them take long
_STEPS_OF_WEIGHTS = (0.5,) * 8 + (0.2,) * 8  # how far they go from try to try
_PATIENCE, _SLOW = 4, 0.9  # after so many tries, the share that may be left of what is missing
_IN_VAIN, _FEW = 1.6, 4  # so many times the intervals before: what is missing is not their length
_IDLE = 2e-3  # of the largest weight: contacts below it may carry nothing
_LIGHT, _LIGHTER = 0.5, 1e-3  # of the mean of weights: below it contacts get by so much less
_FACETS = (12,)  # of cones, while weights are looked for
_DIGITS = 6  # of forces, N


@dataclass(frozen=True, eq=False)
class SearchedClaims:
    """A part of a certificate.

    Attributes:
        bounds: of `TIP_WITHIN` and `SLIP_WITHIN`; the goals where something is short.
        cover: of its intervals; empty where something is short.
        short: of intervals that are not proved: start, end, claim, and by how much.
    """

    bounds: dict[str, float]
    cover: dict[str, Any]
    short: list[tuple[float, float, str, float]]


@dataclass(eq=False)
class CheckedRows:
    """Rows of intervals with what was named for them."""

    interval: np.ndarray
    terms: Terms
    forces: np.ndarray
    weights: np.ndarray
    moments: np.ndarray
    beyond: np.ndarray  # GT is greater than what was to be good enough
    holds: np.ndarray
    loose: np.ndarray  # GN is greater than what was to be good enough


class SearchWithin:
    """Searches bounds of GN and GT within an uncertainty, and what proves them.

    Args:
        footing: the base, or an object, on contacts with the minimum friction.
        model, motion, tolerance: of a certificate.
        goals: bounds that are good enough; better ones are not searched.
        knots: s, at which what acts on the gripper bends.
        carried: the object in the model; None: the base.
        say: called with how much is proved.

    Attributes:
        sharing: the claims of the checker.
        goals: as given.
    """

    def __init__(
        self,
        footing: Footing,
        model: Mapping[str, Any],
        motion: Mapping[str, Any],
        tolerance: Mapping[str, Any],
        goals: Mapping[str, float],
        knots: np.ndarray,
        carried: Mapping[str, Any] | None = None,
        say: Callable[[str], None] = silent,
    ) -> None:
        self._footing, self.goals, self._knots, self._say = footing, goals, knots, say
        self._interior = Interior(footing.support)
        self.sharing = Sharing(model, motion, tolerance, goals, carried)
        contacts = self.sharing.contacts
        self._several = contacts.count > 3 or not contacts.flat  # else the wrench says what feet bear
        self._starts, self._ends = np.zeros((2, 0))
        self._apart = np.zeros((0, self.sharing.late.joints), dtype=bool)
        self._parts: list[CheckedRows] = []

    def _run(self, most_short: float) -> bool:
        """Check intervals; where a proof is missing take joints apart, then divide the interval. False: there
        are too many intervals, or more than this share of them lacks a proof at first.
        """
        late = self.sharing.late
        starts, ends = self._first()
        apart = np.zeros((len(starts), late.joints), dtype=bool)
        missing, total = np.inf, 0
        for most in _MOST_COMBINATIONS:
            done = 1 - np.sum(ends - starts) / (late.end - late.start)
            self._say(f"proving the worst case: {percent(done)}, {len(starts)} intervals left ...")
            groups = late.rows(starts, ends, apart)
            if (count := sum(len(rows.number) for rows in groups)) > _TOO_MANY:
                return False
            total += count
            short, beyond = np.zeros((2, len(starts)), dtype=bool)
            further, parts = apart.copy(), []
            for rows in groups:
                part = self.checked(rows)
                bad = ~part.holds | part.loose
                short[rows.interval[bad]], beyond[rows.interval[part.beyond]] = True, True
                self._take_apart(rows, part, bad | part.beyond, further, most)
                parts.append(part)
            if np.mean(short) > most_short:
                return False
            before, missing = missing, max(_FEW, np.count_nonzero(short))
            left = sum(np.count_nonzero(short[rows.interval]) for rows in groups)
            useful = (total < _MOST or left < _LAST) and missing <= _IN_VAIN * before and most > 0
            more = (
                useful & (short | beyond & (most == _MOST_COMBINATIONS[0])) & np.any(further & ~apart, axis=1)
            )
            halved = useful & short & ~more & (ends - starts > _SHORTEST)
            self._keep(starts, ends, apart, parts, ~(more | halved))
            middle = 0.5 * (starts[halved] + ends[halved])
            apart = np.concatenate([further[more], apart[halved], apart[halved]])
            starts, ends = (
                np.concatenate([starts[more], starts[halved], middle]),
                np.concatenate([ends[more], middle, ends[halved]]),
            )
            if not len(starts):
                break
        return True

    def _keep(
        self,
        starts: np.ndarray,
        ends: np.ndarray,
        apart: np.ndarray,
        parts: list[CheckedRows],
        done: np.ndarray,
    ) -> None:
        place = len(self._starts) + np.cumsum(done) - 1
        for part in parts:
            rest_of_part = _some(part, done[part.interval])
            rest_of_part.interval = place[rest_of_part.interval]
            self._parts.append(rest_of_part)
        self._starts = np.concatenate([self._starts, starts[done]])
        self._ends = np.concatenate([self._ends, ends[done]])
        self._apart = np.concatenate([self._apart, apart[done]])

    def _take_apart(
        self, rows: Rows, part: CheckedRows, wanted: np.ndarray, apart: np.ndarray, most: int
    ) -> None:
        """Further joints of intervals of some rows, those first whose accelerations tip the base most, up to
        `most` combinations.
        """
        late, terms = self.sharing.late, part.terms
        boxed = ~apart[rows.interval].T & (rows.branches > 1)  # (n, R)
        wanted = wanted & np.any(boxed, axis=0)
        if not late.delay or not np.any(wanted):
            return
        c = terms.needed(terms.parts.c[K : K + numbers_of(len(terms.parts.c))[0]])
        wrenches = np.einsum("t,ktir->kir", 0.5 * (terms.low + terms.high), c)
        tips = np.abs(np.einsum("ai,kir->kar", self.sharing.contacts.axes, wrenches)).max(axis=1, initial=0.0)
        number = late.delayed - 1 + np.cumsum(boxed, axis=0)
        for row in np.flatnonzero(wanted):
            apart_here, counts = apart[rows.interval[row]], rows.branches[:, row]
            some = np.flatnonzero(boxed[:, row])
            for joint in some[np.argsort(-tips[number[some, row], row])]:
                apart_here[joint] |= np.prod(counts[apart_here]) * counts[joint] <= most

    def _first(self) -> tuple[np.ndarray, np.ndarray]:
        late = self.sharing.late
        knots = self._knots[(self._knots > late.start) & (self._knots < late.end)]
        cuts = np.unique(np.concatenate([late.events, late.events + late.delay, knots]))
        if late.delay and len(cuts) > _DENSE * (late.end - late.start) / _LONGEST:
            # any delay has switching times inside, also before short intervals
            cuts = np.array([late.start, *knots, late.end])
        cuts = np.append(cuts[:-1][np.diff(cuts) > _SHORTEST / 10], cuts[-1])
        ends = [np.zeros(1)]
        for a, b in pairwise(cuts):
            ends.append(np.linspace(a, b, max(1, int(np.ceil((b - a) / _LONGEST))) + 1)[1:])
        every = np.unique(np.concatenate([[late.start], *ends, [late.end]]))
        return every[:-1], every[1:]

    # --- forces and rules ---------------------------------------------------------------------------------

    def checked(self, rows: Rows) -> CheckedRows:
        """Forces and weights for rows, and what they prove."""
        sharing, terms = self.sharing, self.sharing.terms(rows)
        forces = self._forces(terms)
        weights, capacity = self._weights(terms, forces)
        slack, beyond = np.full(len(rows.interval), -np.inf), np.zeros(len(rows.interval), dtype=bool)
        for share in (self.goals[SLIP_WITHIN], HIGHEST):
            short = np.flatnonzero(~(slack >= 0))
            if not len(short):
                break
            slack[short] = sharing.held(
                *(terms.some(short), forces[:, 0][..., short], weights[..., short], share), patient=False
            )
            if len(short := short[~(slack[short] >= 0)]) and self._several:
                some, force = terms.some(short), forces[:, 0][..., short]
                better = self._lighter if sharing.contacts.flat else self._improved
                weights[..., short], slack[short] = better(
                    some, force, weights[..., short], capacity[:, short], share
                )
            for rule in _RULES if self._several and sharing.contacts.flat else ():
                if not len(short := short[~(slack[short] >= 0)]):
                    break
                force = rule(weights[..., short])  # the rule shares the whole wrench
                none = np.zeros((2, *forces.shape[2:4], len(short)))
                with np.errstate(invalid="ignore"):  # too few contacts may be left
                    result = sharing.held(terms.some(short), none, force, share, patient=False)
                better = result > slack[short]
                forces[:, 0][..., short[better]], slack[short[better]] = 0.0, result[better]
                weights[..., short[better]] = force[..., better]
            if share < HIGHEST:
                beyond = ~(slack >= 0)
        moments, loose = np.full(len(slack), np.inf), np.zeros(len(slack), dtype=bool)
        checked = CheckedRows(rows.interval, terms, forces, weights, moments, beyond, slack >= 0, loose)
        if sharing.contacts.flat:
            checked.moments = sharing.moments(terms)
            checked.holds &= checked.moments > 0
            checked.loose = checked.moments < sharing.contacts.needed
        if not sharing.contacts.flat:
            margins = sharing.margins(terms, forces, weights)
            checked.holds &= margins["tip-over within tolerance"] >= 0
        return checked

    def _lighter(
        self, terms: Terms, forces: np.ndarray, weights: np.ndarray, _: np.ndarray, share: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Weights with which contacts that are nearly lost follow their tipping axis alone."""
        light = weights[:, 0] < _LIGHT * np.mean(weights[:, 0], axis=0)
        weights = weights.copy()
        weights[:, 0] *= np.where(light, _LIGHTER, 1.0)
        return weights, self.sharing.held(terms, forces, weights, share, patient=False)

    def _improved(
        self, terms: Terms, forces: np.ndarray, weights: np.ndarray, capacity: np.ndarray, share: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Weights with which the contact that slips first slips later, and how much room there is."""
        best, most = weights.copy(), np.full(terms.size.shape[1], -np.inf)
        rows, before = np.arange(len(most)), most.copy()
        rough = self.sharing.contacts.bears[1::3]
        for k, step in enumerate(_STEPS_OF_WEIGHTS):
            rooms = self.sharing.rooms(terms.some(rows), forces[..., rows], weights, share, facets=_FACETS)
            slack = np.min(rooms, axis=0)
            better = slack > most[rows]
            best[..., rows[better]], most[rows[better]] = weights[..., better], slack[better]
            going = most[rows] < 0
            if k % _PATIENCE == _PATIENCE - 1:  # what hardly moves does not arrive
                going &= most[rows] > _SLOW * before[rows]
                before = most.copy()
            rows, rooms, weights = rows[going], rooms[:, going], weights[..., going].copy()
            if not len(rows):
                break
            used = np.clip(share - rooms / np.maximum(capacity[:, rows], 1e-6), 0.05, 20.0)
            weights[:, 1] *= (np.exp(np.mean(np.log(used[rough]), axis=0)) / used) ** step
            weights[:, 1] = np.clip(weights[:, 1] / np.max(weights[:, 1], axis=0), 1e-6, None)
            weights[~rough, 1] = 0.0
        rows = np.flatnonzero(most < 0)
        most[rows] = self.sharing.held(terms.some(rows), forces[..., rows], best[..., rows], share)
        return best, most

    def _forces(self, terms: Terms) -> np.ndarray:
        """(2, rules, contacts, 3, R) that hold the wrench of the middle weights at both ends."""
        count = terms.size.shape[1]
        if not self._several:
            return np.zeros((2, 1, self.sharing.contacts.count, 3, count))
        wrenches = np.concatenate([terms.described(s) for s in (-1.0, 1.0)], axis=1).T  # (2 R, 6)
        every = np.concatenate([wrenches, *(wrenches + couple for couple in self.sharing.contacts.couples)])
        states = self._footing.contact_states(every)
        if self.sharing.contacts.flat and np.all(self.sharing.contacts.bears):
            forces = np.zeros((len(every), self.sharing.contacts.count, 3))
            forces[:, :, 0] = reported_normal_forces(states)  # unique, whatever is solved together
        else:
            slip = self._footing.slip.evaluate(states, derivatives=False, least=0.5 * self.goals[SLIP_WITHIN])
            share = np.where(np.arange(len(every)) < len(wrenches), self.goals[SLIP_WITHIN], 1.0)
            forces = self._interior.between(slip.forces, every, share)
            forces[:, :, 1:] = 0.0  # the rule shares what is tangential
        shaped = forces.reshape(-1, 2, count, *forces.shape[1:])  # rules, ends, R, contacts, 3
        return np.round(np.moveaxis(shaped, (1, 2), (0, -1)), _DIGITS)

    def _weights(self, terms: Terms, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(contacts, 2, R): shares in proportion to what contacts bear at least; and that, (contacts, R)."""
        contacts, count = self.sharing.contacts.count, terms.size.shape[1]
        weights = np.ones((contacts, 2, count))
        if self._several:
            normal = np.maximum(forces[0, 0, :, 0], forces[1, 0, :, 0])
            weights[:, 0] = np.maximum(normal, 1e-3 * np.max(np.abs(normal), axis=0))
        if self.sharing.contacts.flat:
            return weights, np.ones((contacts, count))
        rule = Rule(self.sharing.contacts, np.ones(contacts, dtype=bool), weights)
        constant, error = rule.constant(forces[:, 0].reshape(2, -1, count), np.zeros(6), terms.size)
        capacity = np.empty((contacts, count))
        for k, pieces in enumerate(self.sharing.contacts.sets):
            block = np.s_[3 * k : 3 * k + 3]
            place = rule.rule[:, block], constant[:, block], error[block]
            rows = [[(np.array([slope, 0.0, 0.0]), radius)] for *_, radius, slope in pieces]
            capacity[k] = np.max([self.sharing.least(terms, place, row) for row in rows], axis=0)
        largest, rough = np.max(capacity, axis=0), self.sharing.contacts.bears[1::3, None]
        weights[:, 1] = rough * np.clip(capacity / np.where(largest > 0, largest, 1.0), 1e-4, None)
        return weights, capacity

    # --- what was found -----------------------------------------------------------------------------------

    def claims(self, most_short: float = 1.0) -> SearchedClaims | None:
        """The bounds, and the cover; None: not tried, there are too many intervals, or more than this share
        of them is short at first."""
        if not self._run(most_short):
            return None
        bounds, short = dict(self.goals), self._short()
        if short:
            return SearchedClaims(bounds, {}, short)
        if self.sharing.contacts.flat:
            unit = self.sharing.contacts.unit
            least = min(float(np.min(part.moments, initial=np.inf)) for part in self._parts)
            value = unit / (unit + least) if least > 0 else HIGHEST
            bounds[TIP_WITHIN] = min(value * (1 + 1e-9), HIGHEST)
        bounds[SLIP_WITHIN] = self._proved_share()
        return SearchedClaims(bounds, self._cover(), [])

    def _proved_share(self) -> float:
        """The minimum share of friction that is proved to be enough for all rows.

        It is searched for the few that lack most; those of the others that lack then are searched on.
        """
        share, left = self.goals[SLIP_WITHIN], [_some(part, part.beyond & part.holds) for part in self._parts]
        while True:
            left, slack = self._lacking(left, share)
            if not len(slack) or share >= HIGHEST:
                return share
            least, few = np.sort(slack)[:_SEARCHED][-1], []
            for part in left:
                here, slack = slack[: len(part.interval)], slack[len(part.interval) :]
                few.append(_some(part, here <= least))
            share = self._enough(few, share)

    def _enough(self, some: list[CheckedRows], low: float) -> float:
        """The minimum share above `low` that is proved to be enough for some rows."""
        goal, step, high = self.goals[SLIP_WITHIN], _STEP * low, HIGHEST
        while high - low > max(2 * _LOSS * low, _STEP * (high - goal)):
            share = 0.5 * (low + high) if high < HIGHEST else min(low + step, 0.5 * (low + high))
            more, slack = self._lacking(some, share)
            if len(slack):
                low, some = share, more  # the others need less
            else:
                high = share
            step *= 2
        return high

    def _lacking(self, some: list[CheckedRows], share: float) -> tuple[list[CheckedRows], np.ndarray]:
        """The rows that are not proved to hold with a share of the friction, and how far they are from it."""
        held = [self.sharing.held(part.terms, part.forces[:, 0], part.weights, share) for part in some]
        lack = [~(slack >= 0) for slack in held]
        slack = np.concatenate([slack[here] for slack, here in zip(held, lack, strict=True)])
        parts = [_some(part, here) for part, here in zip(some, lack, strict=True)]
        return parts, np.nan_to_num(slack, nan=-np.inf)

    def _cover(self) -> dict[str, Any]:
        order = np.argsort(self._starts)
        rank = np.empty(len(order), dtype=int)
        rank[order] = np.arange(len(order))
        owner = np.concatenate([part.interval for part in self._parts])
        forces = np.concatenate([part.forces for part in self._parts], axis=-1)
        weights = np.concatenate([part.weights for part in self._parts], axis=-1)
        rows = np.argsort(rank[owner], kind="stable")
        return {
            "ends": [*self._starts[order].tolist(), float(np.max(self._ends))],
            "apart": [np.flatnonzero(indices).tolist() for indices in self._apart[order]],
            "forces": np.moveaxis(forces, -1, 0)[rows].tolist(),
            "weights": np.moveaxis(weights, -1, 0)[rows].tolist(),
        }

    def _short(self) -> list[tuple[float, float, str, float]]:
        results = []
        for part in self._parts:
            bad = np.flatnonzero(~part.holds)
            if not len(bad):
                continue
            some = _some(part, ~part.holds)
            for name, margin in self.sharing.margins(some.terms, some.forces, some.weights).items():
                for k, short in zip(some.interval, margin, strict=True):
                    if not short >= 0:
                        results.append(
                            (float(self._starts[k]), float(self._ends[k]), name, float(min(-short, 1e9)))
                        )
        return results


def _without_idle(weights: np.ndarray) -> np.ndarray:
    """Weights (contacts, 2, R) in which contacts with negligible loads carry nothing."""
    idle = weights[:, :1] < _IDLE * np.max(weights[:, :1], axis=0)
    return np.where(idle, 0.0, weights)


_RULES = (np.array, _without_idle, np.ones_like)
"""Weights that are tried: those of what contacts bear, without idle contacts, all contacts alike."""


def _some(part: CheckedRows, rows: np.ndarray) -> CheckedRows:
    names = ("interval", "forces", "weights", "moments", "beyond", "holds", "loose")
    return CheckedRows(
        terms=part.terms.some(rows), **{name: getattr(part, name)[..., rows] for name in names}
    )
