"""States of an arm while a cancelled motion comes to rest, over boxes of two times, in Taylor forms.

The motion is cancelled at a time t, and every joint decelerates at a constant rate until it holds. A joint
with a delay of up to d is where it should be at a time after t between after - d and after: still in the
motion before t, then decelerating, then at rest. It overshoots only at the steps themselves, see `late`.
Boxes are intervals of t, with s the place in these, of the time after t, and of each joint's delay and place
between its extreme accelerations. Over a box each joint has one enclosure: a polynomial of s and of e, the
place within its interval of times, and an interval of its accelerations. All combinations of the joints are
in there, of which delays allow each. Plain data and NumPy only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.certificate.trusted.described import Intervals
from ocptip.certificate.trusted.forms import Form, K, U, alike, length
from ocptip.certificate.trusted.late import ALIKE, Ends, Late, Rows
from ocptip.certificate.trusted.plain import JUMP, require

_APART = 1e-9  # s: boxes begin so much after the delay, so that no joint of theirs is still in the motion

CREEP = 1e-6  # rad/s or m/s: joints that are not faster hold at once
MOST = 200_000  # boxes
_CELLS = 8  # of the time before a cancel in which joints may still be
_LEAF, SPLITS = ".", "taABCDEFGHIJKLMNOPQRSTUVWXYZbcdefghijklmnopqrsuvwxyz"
"""A box is one of the cover, or it is halved in t, in the time after t, in the delay of a joint, or in its
acceleration: the delays of n joints have the letters from A on, their accelerations the n after these."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """Intervals of times, B of them.

    Attributes:
        piece: (B,) of the motion.
        low, high: (B, 2 + 2 n) ends of t, in u, of the time after t, s, of delays, shares of the largest, and
            of accelerations, shares from the lowest to the highest possible one.
    """

    piece: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(
        cls, piece: np.ndarray, t: tuple[np.ndarray, np.ndarray], after: tuple[np.ndarray, np.ndarray], n: int
    ) -> Boxes:
        """With all delays and accelerations of n joints."""
        ends = zip(t, after, (0.0, 1.0), strict=True)
        low, high = (
            np.column_stack([when, late, np.full((len(piece), 2 * n), share)]) for when, late, share in ends
        )
        return cls(piece, low, high)

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """(B,) of t, in u."""
        return self.low[:, 0], self.high[:, 0]

    def some(self, rows: Any) -> Boxes:
        """Some of them."""
        return Boxes(self.piece[rows], self.low[rows], self.high[rows])

    def halves(self, which: np.ndarray) -> Boxes:
        """First and second halves, each in one of its intervals, (B,)."""
        low, high, place = self.low.copy(), self.high.copy(), (np.arange(len(which)), which)
        low[place] = high[place] = 0.5 * (self.low[place] + self.high[place])
        both = (self.piece, self.piece), (self.low, low), (high, self.high)
        return Boxes(*map(np.concatenate, both))


class Cancelled:
    """States of joints after a cancel.

    Args:
        motion: of a certificate.
        decelerations: (n,) rad/s^2 or m/s^2.
        late: delays of the joints, and overshoot at steps of their accelerations.
    """

    def __init__(self, motion: Mapping[str, Any], decelerations: Sequence[float], late: Late) -> None:
        self._motion, self._late = motion, late
        self._rate = np.array(decelerations, dtype=float)[:, None]

    def whole(self) -> Boxes:
        """Two boxes of each piece between the rests, which together are all times: while delayed joints may
        still be in the motion, and after that until everything rests.
        """
        pieces = np.arange(1, len(self._motion["times"]) - 1)
        one, delay = np.ones(len(pieces)), self._late.delay
        intervals = Intervals(self._motion, pieces, -one, one)
        begin = np.full(len(pieces), delay + _APART)
        ends = begin + np.max(self._fastest(intervals.qd) / self._rate, axis=0) * (1 + U) + 2 * CREEP
        first, last = (np.ravel(np.column_stack(pair)) for pair in ((0 * begin, begin), (begin, ends)))
        one = np.ones(len(first))
        return Boxes.of(np.repeat(pieces, 2), (-one, one), (first, last), len(self._rate))

    def cover(self, trees: Any) -> Boxes:
        """Boxes that together are all times: halves of halves of `whole`, of each a text of `SPLITS`, first
        halves first. Those in which everything has rested for as long as joints are delayed are left out.
        """
        whole = self.whole()
        require(isinstance(trees, list) and len(trees) == len(whole.piece), "trees: one of each is expected")
        pieces, rows = [], []
        for piece, *ends, tree in zip(whole.piece, whole.low, whole.high, trees, strict=True):
            require(isinstance(tree, str) and len(tree) <= MOST, "trees: texts are expected")
            todo = [ends]
            for split in tree:
                require(bool(todo), "trees: a box is divided that is not there")
                low, high = todo.pop()
                if split == _LEAF:
                    pieces.append(piece)
                    rows.append((low, high))
                    continue
                which = SPLITS.find(split)
                require(0 <= which < len(low), "trees: a box is divided that is not there")
                left, right = high.copy(), low.copy()
                left[which] = right[which] = 0.5 * (low[which] + high[which])
                todo += [[right, high], [low, left]]
            require(not todo, "trees: a box is missing")
        boxes = Boxes(np.array(pieces), *map(np.array, zip(*rows, strict=True)))
        return boxes.some(~self.rested(boxes))

    def rested(self, boxes: Boxes) -> np.ndarray:
        """(B,) where everything has rested for as long as joints are delayed: those are states of others."""
        intervals, first = Intervals(self._motion, boxes.piece, *boxes.ends), boxes.low[:, 1]
        longest = np.max(self._fastest(intervals.qd) / self._rate, axis=0) * (1 + U)
        return (first > longest + self._late.delay + CREEP) & (first > 0)

    @staticmethod
    def _fastest(qd: Form) -> np.ndarray:
        low, high = qd.range
        return np.maximum(high, -low)

    def rows(self, boxes: Boxes) -> list[Rows]:
        """The states in boxes, those with about as many joints of unsure accelerations together."""
        intervals, rate = Intervals(self._motion, boxes.piece, *boxes.ends), self._rate
        delay, delays = self._late.delay, slice(2, 2 + len(rate))
        first = (boxes.low[:, 1:2] - delay * boxes.high[:, delays]).T - U  # of each joint, (n, B)
        last = (boxes.high[:, 1:2] - delay * boxes.low[:, delays]).T + U
        low, high = intervals.qd.range
        fastest = np.maximum(high, -low)
        still = fastest <= CREEP
        sign = np.where(still, 0.0, np.where(low > -CREEP, 1.0, np.where(high < CREEP, -1.0, 0.0)))
        longest = np.where(still, 0.0, fastest / rate * (1 + U))  # until it rests
        slowest = np.maximum(low, -high)
        shortest = np.where(slowest > CREEP, slowest / rate * (1 - U), 0.0)
        creep = np.where(slowest > CREEP, 0.0, CREEP)  # at so little speed it may also hold at once
        early = (first < 0) & (delay > 0)  # it may still be in the motion
        moves, rests = ~still & (first < longest), still | (last > shortest)
        slower, unsure = -sign * rate, np.where(still | (sign != 0), 0.0, rate)
        known = slower, unsure, moves, rests & (first <= longest)
        joint, box = np.nonzero(early)
        pairs = joint, box
        before = self._before(first, last, boxes.piece, intervals, pairs)
        centre, spread = self._accelerations(*known, first, last, boxes, intervals, pairs, before)

        # while it decelerates: from the state at t
        e = np.zeros((length(1), *low.shape))
        e[0], e[K] = 0.5 * (first + last), 0.5 * (last - first)
        after = Form(e, U * (1 + np.abs(first) + np.abs(last)) + np.zeros(low.shape))
        faster, further = after * slower, after * after * (0.5 * slower)
        if len(box):  # or in the motion, before t
            since = _decelerating(*(part[pairs] for part in known), share=0.0)
            changes = _changes(*before, last[pairs], since)
            for form, change in zip((faster, further), changes, strict=True):
                form.c[(slice(None), *pairs)], form.r[pairs] = change.c, change.r
        over = np.where(early, 0.0, np.maximum(last - shortest, 0.0)) * (1 + U)  # it may have rested so long
        jump = np.where(early, JUMP, 0.0)
        qd = _moved(faster + intervals.qd, slower * -0.5 * over, 0.5 * rate * over + 100 * jump + creep)
        q = further + intervals.qd * after + intervals.q
        loose = 0.25 * rate * over**2 + jump * (1 + 100 * delay) + creep * (1 + np.abs(last))
        q = _moved(q, slower * -0.25 * over**2, loose)

        # at rest: from the place where it rests, as long as it may still have been moving
        left = np.maximum(longest - first, 0.0) * (1 + U)
        turns = np.where(sign == 0, 1.0, 0.0)  # or it is still
        halted = intervals.qd * intervals.qd * (0.5 * sign / rate) + intervals.q
        aside = turns * 0.5 * fastest * longest * (1 + U) + creep * (1 + longest)
        halted = _moved(halted, slower * 0.25 * left**2, 0.25 * rate * left**2 * (1 - turns) + aside)
        speed = Form.of(np.zeros(low.shape))
        slow = 0.5 * rate * left * (1 + turns) + creep
        speed = _moved(speed, slower * -0.5 * left, slow)
        resting = ~early & (left <= over) | (~early & (sign == 0))
        states = _chosen(resting, halted, q), _chosen(resting, speed, qd)
        return self._placed([*states, Form.of(centre)], spread, intervals.ends)

    def _before(
        self,
        first: np.ndarray,
        last: np.ndarray,
        piece: np.ndarray,
        intervals: Intervals,
        pairs: tuple[np.ndarray, np.ndarray],
    ) -> tuple[np.ndarray, Ends]:
        """Times before t, (2 C + 1, P), s, of joints in boxes that may still be in the motion: `_CELLS` cells
        of when they are, and as many from then until t; and bounds (2 C, P) of accelerations in them.
        """
        joint, box = pairs
        alike, where = np.unique(np.stack([box, first[pairs], last[pairs]]), axis=1, return_inverse=True)
        number, begin, until = alike[0].astype(int), -alike[1], np.maximum(-alike[2], 0.0)
        start, end = intervals.ends[:, number]
        blur = U * (1 + np.abs(start) + np.abs(end))
        shares = np.linspace(1.0, 0.0, _CELLS + 1)[:, None]
        ago = np.concatenate([until + (begin - until) * shares, until * shares[1:]])
        cells = np.broadcast_to(piece[number], ago[1:].shape)
        parts = start - blur - ago[:-1], end + blur - ago[1:], cells
        result = self._late.accelerations(*(part.ravel() for part in parts))
        bounds = (part.reshape(len(part), *cells.shape)[joint, :, where.ravel()].T for part in result)
        return ago[:, where.ravel()], tuple(bounds)  # type: ignore[return-value]

    def _accelerations(
        self,
        slower: np.ndarray,
        unsure: np.ndarray,
        moves: np.ndarray,
        halts: np.ndarray,
        first: np.ndarray,
        last: np.ndarray,
        boxes: Boxes,
        intervals: Intervals,
        pairs: tuple[np.ndarray, np.ndarray],
        before: tuple[np.ndarray, Ends],
    ) -> tuple[np.ndarray, np.ndarray]:
        """Middle and half widths of accelerations (n, B): of the motion where it is early, decelerating, at
        rest, and all of them with the overshoot of steps that are less than the delay ago.

        Args:
            slower, unsure: its deceleration, plus or minus.
            moves: it may decelerate.
            halts: it may have come to rest less than the delay ago, or rest.
            first, last: (n, B) when joints are, s after t.
            pairs: joints and boxes in which they may still be in the motion.
            before: see `_before`.
        """
        share, extra = self._late.overshoot, np.zeros((2, *slower.shape))
        low, high = np.full(slower.shape, np.inf), np.full(slower.shape, -np.inf)
        columns = np.flatnonzero((boxes.low[:, 1] - self._late.delay - U < 0) & (self._late.delay > 0))
        if len(pairs[0]):
            cells = slice(_CELLS)  # of when it is
            low[pairs], high[pairs] = np.min(before[1][0][cells], axis=0), np.max(before[1][1][cells], axis=0)
        if share and len(columns):
            start, end = intervals.ends[:, columns]
            blur = U * (1 + np.abs(start) + np.abs(end))
            now = start + boxes.low[columns, 1]  # what was a delay before that is over
            extra[..., columns] = self._late.exceeded(now - blur, end + blur, boxes.piece[columns])
            # a step of the motion overshoots where the joint is, and after it nothing does until the cancel
            there = start + first[:, columns] - blur, end + last[:, columns] + blur
            events = self._late.events
            step = np.searchsorted(events, there[0], "left") < np.searchsorted(events, there[1], "right")
            low[:, columns] += np.where(step, extra[0][:, columns], 0.0)
            high[:, columns] += np.where(step, extra[1][:, columns], 0.0)
            slowest, fastest = (part[:, columns] for part in intervals.qdd.range)  # at t, where the step is
            begun = (slower - unsure)[:, columns], (slower + unsure)[:, columns]
            extra[0][:, columns] = np.minimum(0.0, extra[0][:, columns] + share * (begun[0] - fastest))
            extra[1][:, columns] = np.maximum(0.0, extra[1][:, columns] + share * (begun[1] - slowest))
        here = first <= 0  # at the step where it begins to decelerate, which overshoots
        how = {"share": share, "less": extra[0], "more": extra[1], "here": here}
        least, most = _decelerating(slower, unsure, moves, halts, **how)
        ahead = last >= 0  # it may have begun to decelerate
        least, most = (np.where(ahead, part, far) for part, far in ((least, np.inf), (most, -np.inf)))
        least, most = np.minimum(least, low), np.maximum(most, high)
        blur, width = U * (np.abs(least) + np.abs(most)), most - least
        least, most = (least + width * part[:, 2 + len(width) :].T for part in (boxes.low, boxes.high))
        half = 0.5 * (most - least) * (1 + U) + 2 * blur
        return 0.5 * (least + most), np.where(width > 0, half, 0.0)

    def _placed(self, states: list[Form], spread: np.ndarray, ends: np.ndarray) -> list[Rows]:
        """Rows of states (n, B): with e of each joint, or one if none is delayed, and e of unsure
        accelerations.
        """
        n = len(spread)
        count = n if self._late.delay else 1
        place = np.arange(n) if self._late.delay else np.zeros(n, dtype=int)
        boxed, results = spread > 0, []
        group = np.digitize(np.count_nonzero(boxed, axis=0), ALIKE)
        for k in np.unique(group):
            here = np.flatnonzero(group == k)
            m = count + int(np.max(np.count_nonzero(boxed[:, here], axis=0)))
            squares = K + 2 * m + np.cumsum([0, *range(m, 0, -1)])
            forms = []
            for form in states:
                c = np.zeros((length(m), n, len(here)))
                c[:K] = form.c[:K, :, here]
                if len(form.c) > K:
                    for j, e in enumerate(place):
                        c[K + e, j], c[K + m + e, j] = form.c[K, j, here], form.c[K + 1, j, here]
                        c[squares[e], j] = form.c[K + 2, j, here]
                forms.append(Form(c, form.r[:, here]))
            joint, row = np.nonzero(boxed[:, here])
            number = K + count - 1 + np.cumsum(boxed[:, here], axis=0)[joint, row]
            forms[2].c[number, joint, row] = spread[joint, here[row]]
            q, qd, qdd = forms
            results.append(Rows(here, here, np.ones((n, len(here))), q, qd, qdd, ends[:, here]))
        return results


def _decelerating(
    slower: np.ndarray,
    unsure: np.ndarray,
    moves: np.ndarray,
    halts: np.ndarray,
    *,
    share: float,
    less: np.ndarray | float = 0.0,
    more: np.ndarray | float = 0.0,
    here: np.ndarray | bool = True,
) -> Ends:
    """Minimum and maximum accelerations (n, B) since the cancel, with overshoot; see `_accelerations`."""
    begun = slower - unsure, slower + unsure
    stop = -share * begun[1] * moves, -share * begun[0] * moves  # steps to rest
    least = np.where(moves, begun[0] + np.where(here, less, 0.0), np.inf)
    most = np.where(moves, begun[1] + np.where(here, more, 0.0), -np.inf)
    rest = less + np.minimum(stop[0], 0.0), more + np.maximum(stop[1], 0.0)
    least = np.where(halts | ~moves, np.minimum(least, rest[0]), least)
    return least, np.where(halts | ~moves, np.maximum(most, rest[1]), most)


def _changes(ago: np.ndarray, motion: Ends, last: np.ndarray, since: Ends) -> tuple[Form, Form]:
    """Changes of speed from t to a time near it, and of position beyond what the speed at t gives.

    Args:
        ago: (2 C + 1, P) times before t, s, from the longest to 0.
        motion: (2 C, P) bounds of accelerations in between.
        last: (P,), s: the longest time after t; negative: all times are before t.
        since: (P,) bounds of accelerations after t.

    Returns:
        Forms (P,) in the place e between all times.
    """
    ahead = np.maximum(last, 0.0) * np.linspace(0.0, 1.0, _CELLS + 1)[1:, None]
    times = np.concatenate([-ago, ahead])  # (E, P)
    width, used = np.diff(times, axis=0), times <= last
    middle, half = 0.5 * (times[0] + last), 0.5 * (last - times[0])

    # bounds of the speed at these times, between which they are linear: backwards from t, and forward
    least, most = (
        np.concatenate([one, np.repeat(other[None], _CELLS, axis=0)]) * width
        for one, other in zip(motion[::-1], since, strict=True)
    )
    low, high = (np.cumsum(np.pad(steps, ((1, 0), (0, 0))), axis=0) for steps in (least, most))
    low, high = (part - part[len(ago) - 1] for part in (low, high))

    # a parabola near them; any will do
    e = (times - middle) / half
    powers = e ** np.arange(3)[:, None, None]
    weighted = powers * used * (np.pad(width, ((1, 0), (0, 0))) + np.pad(width, ((0, 1), (0, 0))))
    A = np.einsum("iep,jep->pij", weighted, powers) + (1e-9 * half)[:, None, None] * np.eye(3)
    c = np.linalg.solve(A, np.einsum("iep,ep->pi", weighted, 0.5 * (low + high))[..., None])[..., 0].T
    fit = np.einsum("ip,iep->ep", c, powers)
    above, below = (np.max(np.where(used, part, -np.inf), axis=0) for part in (high - fit, fit - low))
    bend = np.abs(c[2]) * np.max(np.where(used[1:], 0.5 * width / half, 0.0), axis=0) ** 2  # between these
    size = np.sum(np.abs(least) + np.abs(most), axis=0) + np.sum(np.abs(c), axis=0)
    radius = (0.5 * (above + below) + bend) * (1 + U) + U * size
    c[0] += 0.5 * (above - below)
    one = np.zeros((length(1), len(last)))
    one[K] = 1.0
    place, zero = Form(one, np.zeros(len(last))), -middle / half

    speed = place * (place * c[2] + c[1]) + c[0]
    way = place * (place * (place * (c[2] / 3) + 0.5 * c[1]) + c[0])
    begun = zero * (zero * (zero * (c[2] / 3) + 0.5 * c[1]) + c[0])
    way = (way + -begun) * half
    far = np.max(np.abs(times), axis=0)
    return Form(speed.c, speed.r + radius), Form(way.c, way.r + radius * far * (1 + U) + U * half * size)


def _moved(form: Form, by: np.ndarray, radius: np.ndarray) -> Form:
    """The form plus `by`, plus or minus the radius."""
    moved = form + by
    return Form(moved.c, moved.r + radius * (1 + U))


def _chosen(first: np.ndarray, one: Form, other: Form) -> Form:
    """One form where `first`, the other elsewhere."""
    a, b = alike(one.c, other.c)
    return Form(np.where(first, a, b), np.where(first, one.r, other.r))
