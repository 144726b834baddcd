"""Find what proves that a motion can be cancelled at any time: boxes of times, contact forces, weights.

Nothing here has to be trusted: `checker` checks the result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ocptip.basics.text import percent, silent
from ocptip.certificate.claimed import limit_within
from ocptip.certificate.find_within import HIGHEST, CheckedRows, SearchedClaims, SearchWithin
from ocptip.certificate.result import ANGLES, CANCELS
from ocptip.certificate.trusted.cancelled import SPLITS, Boxes, Cancelled
from ocptip.certificate.trusted.checker import (
    ANGLE_MARGIN_CANCEL,
    COVERS_OF_CANCELS,
    NOMINAL_CANCEL,
    TORQUES_CANCEL,
    WITHIN_CANCEL,
)
from ocptip.certificate.trusted.described import ANGLE, Intervals, angle_margins, limits_of
from ocptip.certificate.trusted.drives import Drives
from ocptip.certificate.trusted.forms import K
from ocptip.certificate.trusted.late import Rows
from ocptip.certificate.trusted.plain import DECELERATIONS, NOTHING
from ocptip.certificate.trusted.terms import Terms
from ocptip.standing.arm import Robot
from ocptip.standing.footing import Footing
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN, Limits
from ocptip.standing.within.worst_case import worst_case_of

_LONGEST, _SHORTEST = 0.1, 3e-4  # s: of the first boxes, and of those that are not divided
_AT_ONCE = 300  # boxes
_MOST = 20_000  # boxes that are checked
_MOST_SHARED = 600  # of these, boxes of which other shares of the load are tried, which takes long
_OF_DELAYS = 0.25, 10.0  # times the whole delay: size of all accelerations of a joint; where friction lacks
_PATIENT = 40  # rows of each 300 boxes of which the tightest bounds are tried
_HEAVY = 4_000  # boxes up to which those are divided whose torques are too large, unless they are short
_SHORT = 2e-3  # s
_LARGE = 1e9  # N m
_LESS = (0.3, 0.1, 0.03)  # of the load of a contact
_ENOUGH = 1e3  # share of the friction with which only normal forces count


@dataclass(eq=False)
class _Proved:
    """Boxes of the cover: forces, weights, and the smallest moment, N m."""

    forces: list[np.ndarray] = field(default_factory=list)
    weights: list[np.ndarray] = field(default_factory=list)
    places: list[tuple[int, str]] = field(default_factory=list)
    least: float = np.inf
    torques: dict[str, float] = field(default_factory=dict)


def proved_of_cancels(bounds: Mapping[str, float]) -> set[str]:
    """Names of sampled values that bounds of cancels are about, as `check_motion` has them."""
    inside = bounds.get(ANGLE_MARGIN_CANCEL, -1.0) >= -ANGLE
    proved = {name for names in COVERS_OF_CANCELS.values() for name in names if name in bounds}
    return proved | (set(ANGLES) if inside else set())


def cancel_claims(
    robot: Robot,
    model: Mapping[str, Any],
    motion: Mapping[str, Any],
    tolerance: Mapping[str, Any] | None,
    limits: Limits,
    worst: Mapping[str, Worst],
    knots: np.ndarray,
    say: Callable[[str], None] = silent,
) -> SearchedClaims:
    """Bounds and covers of the claims about cancels, nominal and within a tolerance, and what is short.

    Args:
        robot: the arm on its support.
        model, motion, tolerance: of a certificate.
        limits: with those of cancels.
        worst: sampled values; where a contact is lost already, nothing is tried.
        knots: see `SearchWithin`.
        say: called with how much is proved.
    """
    assert limits.cancel is not None
    nominal = {TIP_WITHIN: limits.cancel.GN, SLIP_WITHIN: limits.cancel.GT}
    kinds: dict[str, tuple[Footing, Mapping[str, Any], dict[str, float]]] = {
        NOMINAL_CANCEL: (robot, NOTHING, nominal)
    }
    if tolerance is not None:
        goals = {name: limit_within(limits, name) for name in nominal}
        kinds[WITHIN_CANCEL] = worst_case_of(robot, limits.tolerance).footing, tolerance, goals
    every = SearchedClaims({}, {}, [])
    for key, (footing, goal, goals) in kinds.items():
        names = COVERS_OF_CANCELS[key]
        if any(name in worst and worst[name].value >= 1 for name in names):
            continue
        search = SearchWithin(footing, model, motion, goal, goals, knots)
        worlds = zip(TORQUES_CANCEL, (NOTHING, tolerance), strict=True) if key == NOMINAL_CANCEL else ()
        drives = {name: Drives(model, world) for name, world in worlds if world is not None}
        result = SearchCancels(search, model, motion, drives, limits.torque_ratio, say).claims()
        within = " within tolerance" if key == WITHIN_CANCEL else ""
        every.short.extend((start, end, claim + within, by) for start, end, claim, by in result.short)
        if result.short:
            continue
        every.bounds.update({name: result.bounds[goal] for name, goal in zip(names, goals, strict=True)})
        angle = result.bounds[ANGLE_MARGIN_CANCEL]
        every.bounds[ANGLE_MARGIN_CANCEL] = min(angle, every.bounds.get(ANGLE_MARGIN_CANCEL, angle))
        every.bounds.update({name: result.bounds[name] for name in drives if name in result.bounds})
        every.cover[key] = result.cover
    return every


class SearchCancels:
    """Searches what proves that no contact is lost in any cancel.

    Args:
        search: of the contacts within a tolerance.
        model, motion: of a certificate.
        drives: bounds of torques by the names of their claims; empty: nothing is claimed of these.
        torque: largest share of their limits.
        say: called with how much is proved.
    """

    def __init__(
        self,
        search: SearchWithin,
        model: Mapping[str, Any],
        motion: Mapping[str, Any],
        drives: Mapping[str, Drives],
        torque: float,
        say: Callable[[str], None] = silent,
    ) -> None:
        self._search, self._motion, self._drives, self._torque = search, motion, drives, torque
        self._say = say
        self._cancelled = Cancelled(motion, model[DECELERATIONS], search.sharing.late)
        self._limits, self._contacts = limits_of(model), search.sharing.contacts
        self._splits: dict[tuple[int, str], str] = {}
        self._shared = 0

    def claims(self) -> SearchedClaims:
        """The bounds, by the names of those within a tolerance, and the cover; or what is short."""
        boxes, places = self._first()
        done, total, tried, angle = _Proved(), 0, 0, np.inf
        case = "the worst case of cancels" if self._search.sharing.late.delay else "cancels"
        roots = 1 + max(root for root, _ in places)
        while len(places):
            left_share = sum(0.5 ** len(way) for _, way in places) / roots
            holds, margins = np.zeros(len(places), dtype=bool), np.zeros(len(places))
            sizes = self._sizes(boxes)
            for begin in range(0, len(places), _AT_ONCE):
                boxes_left = f"{len(places) - begin} boxes left"
                self._say(f"proving {case}: {percent(1 - left_share)}, {boxes_left} ...")
                for rows in self._cancelled.rows(boxes.some(slice(begin, begin + _AT_ONCE))):
                    part, here = self._search.checked(rows), begin + rows.number
                    shares = {k: one.shares(rows, self._limits["torque"]) for k, one in self._drives.items()}
                    light = np.max(list(shares.values()), axis=0, initial=0.0) <= self._torque
                    light |= (np.max(sizes[here, :2], axis=1) < _SHORT) | (total > _HEAVY)
                    good = self._good(part) & light
                    holds[here], margins[here] = good, part.moments
                    for name, values in shares.items():
                        most = float(np.max(values[good], initial=done.torques.get(name, 0.0)))
                        done.torques[name] = most
                    sizes[here, 2:] *= self._relevance(rows, part.terms, part.moments)
                    done.forces += list(np.moveaxis(part.forces[..., good], -1, 0))
                    done.weights += list(np.moveaxis(part.weights[..., good], -1, 0))
                    done.places += [places[k] for k in here[good]]
                    done.least = min(done.least, float(np.min(part.moments[good], initial=np.inf)))
                    inside = angle_margins(rows.q, self._limits)[good]
                    angle = min(angle, float(np.min(inside, initial=np.inf)))
            total += len(places)
            left = np.flatnonzero(~holds)
            worst = left[np.argsort(margins[left])[: int(len(left) > 2 * tried)]]  # else it was tried
            tried = len(left) if len(worst) else tried
            self._say(f"proving {case}: dividing the worst box ...")
            lost, by = self._lost(boxes.some(worst), sizes[worst], margins[worst])
            if len(lost.piece):
                return SearchedClaims({}, {}, self._short(lost, by))
            if len(left) and (total + 2 * len(left) > _MOST or self._shared > _MOST_SHARED):
                return SearchedClaims({}, {}, self._short(boxes.some(left), margins[left]))
            which = np.argmax(sizes[left], axis=1)
            boxes, places = self._halved(boxes.some(left), [places[k] for k in left], which)
        unit, bounds = self._contacts.unit, dict(self._search.goals)
        if self._contacts.flat:
            value = unit / (unit + done.least) if done.least > 0 else HIGHEST
            bounds[TIP_WITHIN] = min(value * (1 + 1e-9), HIGHEST)
        bounds |= {name: most * (1 + 1e-9) for name, most in done.torques.items() if 0 < most <= self._torque}
        return SearchedClaims({**bounds, ANGLE_MARGIN_CANCEL: min(angle, 1e6) - 1e-9}, self._cover(done), [])

    def _good(self, part: CheckedRows) -> np.ndarray:
        """Which rows are proved; of some that lack friction only, the tightest bounds are tried."""
        good = part.holds & ~part.loose & ~part.beyond
        rows = np.flatnonzero(~good & (part.moments >= self._contacts.needed))[:_PATIENT]
        if len(rows):
            some = part.terms.some(rows), part.forces[:, 0][..., rows], part.weights[..., rows]
            good[rows] = self._search.sharing.held(*some, self._search.goals[SLIP_WITHIN]) >= 0
            if self._contacts.flat and len(rows := rows[~good[rows]]):
                good[rows] = self._shared_otherwise(part, rows)
        return good

    def _shared_otherwise(self, part: CheckedRows, rows: np.ndarray) -> np.ndarray:
        """Which rows are proved if one contact gets less of the load than by their weights, or than an equal
        share; the factor that presses all contacts most is kept. Forces and weights of these change in place.
        """
        sharing, count = self._search.sharing, self._contacts.count
        self._shared += len(rows)
        less = np.ones((len(_LESS), count, count))
        less[:, np.arange(count), np.arange(count)] = np.array(_LESS)[:, None]
        less = less.reshape(-1, count).T[:, None, :, None]  # (contacts, 1, tries, 1)
        own = part.weights[..., None, rows]
        tried = np.concatenate([less * own, less * np.ones_like(own)], axis=2)  # (contacts, 2, tries, rows)
        every = tried.reshape(count, 2, -1)
        terms = part.terms.some(np.tile(rows, tried.shape[2]))
        none = np.zeros((2, count, 3, every.shape[2]))
        pressed = sharing.held(terms, none, every, _ENOUGH, patient=False).reshape(tried.shape[2:])
        best = tried[:, :, np.argmax(pressed, axis=0), np.arange(len(rows))]
        some = part.terms.some(rows), none[..., : len(rows)], best, self._search.goals[SLIP_WITHIN]
        good = sharing.held(*some) >= 0
        part.forces[:, 0][..., rows[good]], part.weights[..., rows[good]] = 0.0, best[..., good]
        return good

    def _lost(self, boxes: Boxes, sizes: np.ndarray, margins: np.ndarray) -> tuple[Boxes, np.ndarray]:
        """A tiny box in one that is not proved, if there is one, and its smallest moment, N m: of halves of
        halves only the worst is divided. Where a moment is too small, friction is not checked again.
        """
        tips = bool(np.any(margins < self._contacts.needed))
        while len(boxes.piece) and np.max(sizes) > _SHORTEST:
            halves = self._without_rest(boxes.halves(np.argmax(sizes, axis=1)), [])[0]
            margins, sizes = np.full(len(halves.piece), np.inf), self._sizes(halves)
            for rows in self._cancelled.rows(halves) if len(halves.piece) else ():
                terms = self._search.sharing.terms(rows)
                moments = self._search.sharing.moments(terms)
                good = moments >= self._contacts.needed if tips else self._good(self._search.checked(rows))
                margins[rows.number] = np.where(good, np.inf, np.minimum(moments, _LARGE))
                sizes[rows.number, 2:] *= self._relevance(rows, terms, moments)
            worst = np.argsort(margins)[: int(np.any(np.isfinite(margins)))]
            boxes, sizes, margins = halves.some(worst), sizes[worst], margins[worst]
        return boxes, margins

    def _first(self) -> tuple[Boxes, list[tuple[int, str]]]:
        boxes = self._cancelled.whole()
        places = [(k, "") for k in range(len(boxes.piece))]
        while True:
            sizes = self._sizes(boxes)[:, :2]
            long = np.max(sizes, axis=1) > _LONGEST
            if not np.any(long):
                return self._without_rest(boxes, places)
            rest = np.flatnonzero(~long)
            which, long_places = np.argmax(sizes[long], axis=1), [places[k] for k in np.flatnonzero(long)]
            more, others = self._halved(boxes.some(long), long_places, which)
            pairs = zip(vars(boxes.some(rest)).values(), vars(more).values(), strict=True)
            boxes, places = Boxes(*map(np.concatenate, pairs)), [*(places[k] for k in rest), *others]

    def _without_rest(
        self, boxes: Boxes, places: list[tuple[int, str]]
    ) -> tuple[Boxes, list[tuple[int, str]]]:
        going = np.flatnonzero(~self._cancelled.rested(boxes))
        return boxes.some(going), [places[k] for k in going if places]

    def _sizes(self, boxes: Boxes) -> np.ndarray:
        """(B, 2 + 2 n) s: of t, of the time after it, and of delays and accelerations."""
        begin, end = np.array(self._motion["times"])[boxes.piece].T
        sizes = boxes.high - boxes.low
        sizes[:, 0] *= 0.5 * (end - begin)
        sizes[:, 2:] *= self._search.sharing.late.delay
        sizes[:, len(SPLITS) :] = 0.0
        return sizes

    def _relevance(self, rows: Rows, terms: Terms, moments: np.ndarray) -> np.ndarray:
        """(R, 2 n): how much of the moments delays of joints may change, and accelerations, 1 of the most."""
        n, m = len(rows.q.r), terms.numbers
        if m < n:  # no joint is delayed
            return np.zeros((len(rows.number), 2 * n))
        wrenches = np.einsum(
            "t,ktir->kir", 0.5 * (terms.low + terms.high), terms.needed(terms.parts.c[K : K + m])
        )
        tips = np.max(np.abs(np.einsum("ai,kir->akr", self._contacts.axes, wrenches)), axis=0)
        unsure = np.einsum("kr,kjr->jr", tips[n:], rows.qdd.c[K + n : K + m] != 0)
        most = np.maximum(np.max(tips[:n] + unsure, axis=0), 1e-300)
        tipping, slipping = _OF_DELAYS
        share = np.where(moments >= self._contacts.needed, slipping, tipping)
        return (np.concatenate([tips[:n] + unsure, share * unsure]) / most).T

    def _halved(
        self, boxes: Boxes, places: list[tuple[int, str]], which: np.ndarray
    ) -> tuple[Boxes, list[tuple[int, str]]]:
        self._splits |= {place: SPLITS[k] for place, k in zip(places, which.tolist(), strict=True)}
        halves = [(root, way + side) for side in "01" for root, way in places]
        return self._without_rest(boxes.halves(which), halves)

    def _short(self, boxes: Boxes, margins: np.ndarray) -> list[tuple[float, float, str, float]]:
        """The times of cancels that are not proved, with the smallest moments, N m."""
        times, contacts = Intervals(self._motion, boxes.piece, *boxes.ends).ends, self._contacts
        lacking = np.clip((contacts.needed - margins) / contacts.unit, 0.0, _LARGE)
        rows = np.vstack([times, lacking]).T.tolist()
        return [(start, end, CANCELS, by) for start, end, by in rows]

    def _cover(self, done: _Proved) -> dict[str, Any]:
        """Trees of boxes, and forces and weights in their order."""
        number = {place: k for k, place in enumerate(done.places)}
        trees, order = [], []
        for root in range(len(self._cancelled.whole().piece)):
            todo, tree = [""], []
            while todo:
                way = todo.pop()
                tree.append(split := self._splits.get((root, way), "."))
                if split != ".":
                    todo += [way + "1", way + "0"]
                elif (root, way) in number:
                    order.append(number[root, way])
            trees.append("".join(tree))
        return {
            "trees": trees,
            "forces": np.array(done.forces)[order].tolist(),
            "weights": np.array(done.weights)[order].tolist(),
        }
