"""States of an arm while a cancelled motion comes to rest, over boxes of two times, in Taylor forms.

The motion is cancelled at a time t, and every joint decelerates at a constant rate until it holds.
A joint with a delay of up to d is where it should be at a time after t between after - d and after: still in
the motion before t, then decelerating, then at rest. Boxes are intervals of t, with s the place in these, and
of the time after t. Over a box each joint has one enclosure: a polynomial of s and of e, the place within its
interval of times, and an interval of its accelerations. All combinations of the joints are in there, of which
delays allow each. Plain data and NumPy only.
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
_SPLITS = "ta."  # a box is halved in t, or in the time after t, or it is one of the cover


@dataclass(frozen=True, eq=False)
class Boxes:
    """Intervals of times, B of them.

    Attributes:
        piece: (B,) of the motion.
        start, end: (B,) of t, in u.
        first, last: (B,) of the time after t, s.
    """

    piece: np.ndarray
    start: np.ndarray
    end: np.ndarray
    first: np.ndarray
    last: np.ndarray

    def some(self, rows: Any) -> Boxes:
        """Some of them."""
        return Boxes(*(part[rows] for part in vars(self).values()))

    def halves(self, late: np.ndarray) -> Boxes:
        """First and second halves, in t, or where `late` (B,) in the time after it."""
        middle = np.where(late, 0.5 * (self.first + self.last), 0.5 * (self.start + self.end))
        left = np.where(late, self.end, middle), np.where(late, middle, self.last)
        right = np.where(late, self.start, middle), np.where(late, middle, self.first)
        both = (
            (self.piece, self.start, left[0], self.first, left[1]),
            (
                self.piece,
                right[0],
                self.end,
                right[1],
                self.last,
            ),
        )
        return Boxes(*(np.concatenate(pair) for pair in zip(*both, strict=True)))


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
        twice = np.repeat(pieces, 2)
        first, last = (np.ravel(np.column_stack(pair)) for pair in ((0 * begin, begin), (begin, ends)))
        return Boxes(twice, -np.ones(len(twice)), np.ones(len(twice)), first, last)

    def cover(self, trees: Any) -> Boxes:
        """Boxes that together are all times: halves of halves of `whole`, of each a text of `_SPLITS`, first
        halves first. Those in which everything has rested for as long as joints are delayed are left out.
        """
        whole = self.whole()
        require(isinstance(trees, list) and len(trees) == len(whole.piece), "trees: one of each is expected")
        rows = []
        for number, tree in enumerate(trees):
            require(isinstance(tree, str) and len(tree) <= MOST, "trees: texts are expected")
            todo = [tuple(float(part[number]) for part in list(vars(whole).values())[1:])]
            for split in tree:
                require(todo and split in _SPLITS, "trees: a box is divided that is not there")
                start, end, first, last = todo.pop()
                if split == "t":
                    middle = 0.5 * (start + end)
                    todo += [(middle, end, first, last), (start, middle, first, last)]
                elif split == "a":
                    middle = 0.5 * (first + last)
                    todo += [(start, end, middle, last), (start, end, first, middle)]
                else:
                    rows.append((int(whole.piece[number]), start, end, first, last))
            require(not todo, "trees: a box is missing")
        piece, *ends = zip(*rows, strict=True)
        boxes = Boxes(np.array(piece), *map(np.array, ends))
        return boxes.some(~self.rested(boxes))

    def rested(self, boxes: Boxes) -> np.ndarray:
        """(B,) where everything has rested for as long as joints are delayed: those are states of others."""
        intervals = Intervals(self._motion, boxes.piece, boxes.start, boxes.end)
        longest = np.max(self._fastest(intervals.qd) / self._rate, axis=0) * (1 + U)
        return (boxes.first > longest + self._late.delay + CREEP) & (boxes.first > 0)

    @staticmethod
    def _fastest(qd: Form) -> np.ndarray:
        low, high = qd.range
        return np.maximum(high, -low)

    def rows(self, boxes: Boxes) -> list[Rows]:
        """The states in boxes, those with about as many joints of unsure accelerations together."""
        intervals, rate = Intervals(self._motion, boxes.piece, boxes.start, boxes.end), self._rate
        delay = self._late.delay
        first, last = boxes.first - delay - U, boxes.last + U
        low, high = intervals.qd.range
        fastest = np.maximum(high, -low)
        still = fastest <= CREEP
        sign = np.where(still, 0.0, np.where(low > -CREEP, 1.0, np.where(high < CREEP, -1.0, 0.0)))
        longest = np.where(still, 0.0, fastest / rate * (1 + U))  # until it rests
        slowest = np.maximum(low, -high)
        shortest = np.where(slowest > CREEP, slowest / rate * (1 - U), 0.0)
        creep = np.where(slowest > CREEP, 0.0, CREEP)  # at so little speed it may also hold at once
        early = np.broadcast_to((first < 0) & (delay > 0), low.shape)  # it may still be in the motion
        moves, rests = ~still & (first < longest), still | (last > shortest)
        slower, unsure = -sign * rate, np.where(still | (sign != 0), 0.0, rate)
        known = boxes, intervals, slower, unsure, moves, rests & (first <= longest)
        columns = np.flatnonzero(early[0])
        ago, motion = self._before(boxes.some(columns), intervals.ends[:, columns])
        centre, spread = self._accelerations(*known, columns, motion)

        # while it decelerates: from the state at t
        e = np.zeros((length(1), *low.shape))
        e[0], e[K] = 0.5 * (first + last), 0.5 * (last - first)
        after = Form(e, np.broadcast_to(U * (1 + np.abs(first) + np.abs(last)), low.shape) + 0.0)
        faster, further = after * slower, after * after * (0.5 * slower)
        if len(columns):  # or in the motion, before t
            taken = (part[:, columns] for part in known[2:])
            since = _decelerating(*taken, share=0.0)
            changes = _changes(ago, motion, last[columns], since)
            for form, change in zip((faster, further), changes, strict=True):
                form.c[..., columns], form.r[..., columns] = change.c, change.r
        over = np.where(early, 0.0, np.maximum(last - shortest, 0.0)) * (1 + U)  # it may have rested so long
        jump = np.where(early, JUMP, 0.0)
        qd = _moved(faster + intervals.qd, slower * -0.5 * over, 0.5 * rate * over + 100 * jump + creep)
        q = further + intervals.qd * after + intervals.q
        loose = 0.25 * rate * over**2 + jump * (1 + 100 * delay) + creep * (1 + last)
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

    def _before(self, boxes: Boxes, ends: np.ndarray) -> tuple[np.ndarray, Ends]:
        """Times before t, (C + 1, B), s, from a delay to none, and bounds of accelerations (n, C, B) of the
        motion in between.
        """
        blur = U * (1 + np.abs(ends).sum(axis=0))
        shares = np.linspace(1.0, 0.0, _CELLS + 1)[:, None]
        ago = (self._late.delay + U - boxes.first) * shares
        pieces = np.broadcast_to(boxes.piece, ago[1:].shape)
        parts = ends[0] - blur - ago[:-1], ends[1] + blur - ago[1:], pieces
        result = self._late.accelerations(*(part.ravel() for part in parts))
        return ago, tuple(part.reshape(len(part), *pieces.shape) for part in result)  # type: ignore[return-value]

    def _accelerations(
        self,
        boxes: Boxes,
        intervals: Intervals,
        slower: np.ndarray,
        unsure: np.ndarray,
        moves: np.ndarray,
        halts: np.ndarray,
        columns: np.ndarray,
        motion: Ends,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Middle and half widths of accelerations (n, B): of the motion where it is early, decelerating, at
        rest, and all of them with the overshoot of steps that are less than the delay ago.

        Args:
            slower, unsure: its deceleration, plus or minus.
            moves: it may decelerate.
            halts: it may have come to rest less than the delay ago, or rest.
            columns: of the boxes in which it may still be in the motion.
            motion: bounds of its accelerations there.
        """
        share, extra = self._late.overshoot, np.zeros((2, *slower.shape))
        low, high = np.full(slower.shape, np.inf), np.full(slower.shape, -np.inf)
        if len(columns):
            low[:, columns], high[:, columns] = np.min(motion[0], axis=1), np.max(motion[1], axis=1)
            start, end = intervals.ends[:, columns]
            blur = U * (1 + np.abs(start) + np.abs(end))
            start = start + boxes.first[columns]  # what was a delay before that is over
            if share:
                extra[..., columns] = self._late.exceeded(start - blur, end + blur, boxes.piece[columns])
            low, high = low + extra[0], high + extra[1]
            slowest, fastest = (
                part[:, columns] for part in intervals.qdd.range
            )  # at t, from where the step is
            begun = (slower - unsure)[:, columns], (slower + unsure)[:, columns]
            extra[0][:, columns] = np.minimum(0.0, extra[0][:, columns] + share * (begun[0] - fastest))
            extra[1][:, columns] = np.maximum(0.0, extra[1][:, columns] + share * (begun[1] - slowest))
        least, most = _decelerating(slower, unsure, moves, halts, share=share, less=extra[0], more=extra[1])
        least, most = np.minimum(least, low), np.maximum(most, high)
        half = 0.5 * (most - least) * (1 + U) + U * (np.abs(least) + np.abs(most))
        return 0.5 * (least + most), np.where(most > least, half, 0.0)

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
) -> Ends:
    """Minimum and maximum accelerations (n, B) since the cancel, with overshoot; see `_accelerations`."""
    begun = slower - unsure, slower + unsure
    stop = -share * begun[1] * moves, -share * begun[0] * moves  # steps to rest
    least = np.where(moves, begun[0] + less, np.inf)
    most = np.where(moves, begun[1] + more, -np.inf)
    rest = less + np.minimum(stop[0], 0.0), more + np.maximum(stop[1], 0.0)
    least = np.where(halts | ~moves, np.minimum(least, rest[0]), least)
    return least, np.where(halts | ~moves, np.maximum(most, rest[1]), most)


def _changes(ago: np.ndarray, motion: Ends, last: np.ndarray, since: Ends) -> tuple[Form, Form]:
    """Changes of speed from t to a time near it, and of position beyond what the speed at t gives.

    Args:
        ago: (C + 1, B) times before t, s, from the longest to 0.
        motion: (n, C, B) bounds of accelerations in between.
        last: (B,), s: the longest time after t.
        since: (n, B) bounds of accelerations there.

    Returns:
        Forms (n, B) in the place e between all times.
    """
    ahead = last * np.linspace(0.0, 1.0, _CELLS + 1)[1:, None]
    times = np.concatenate([-ago, ahead])  # (E, B)
    width = np.diff(times, axis=0)
    middle, half = 0.5 * (times[0] + times[-1]), 0.5 * (times[-1] - times[0])

    # bounds of the speed at these times, between which they are linear: backwards from t, and forward
    least, most = (
        np.concatenate([one, np.repeat(other[:, None], _CELLS, axis=1)], axis=1) * width
        for one, other in zip(motion[::-1], since, strict=True)
    )
    low, high = (np.cumsum(np.pad(steps, ((0, 0), (1, 0), (0, 0))), axis=1) for steps in (least, most))
    low, high = (part - part[:, [len(ago) - 1]] for part in (low, high))

    # a parabola near them; any will do
    e = (times - middle) / half
    powers = e ** np.arange(3)[:, None, None]
    weighted = powers * (np.pad(width, ((1, 0), (0, 0))) + np.pad(width, ((0, 1), (0, 0))))
    A = np.einsum("ieb,jeb->bij", weighted, powers) + (1e-9 * half)[:, None, None] * np.eye(3)
    c = np.linalg.solve(A, np.einsum("ieb,neb->bin", weighted, 0.5 * (low + high))).transpose(1, 2, 0)
    fit = np.einsum("inb,ieb->neb", c, powers)
    above, below = np.max(high - fit, axis=1), np.min(low - fit, axis=1)
    bend = np.abs(c[2]) * np.max(0.5 * width / half, axis=0) ** 2  # between these times
    size = np.sum(np.abs(least) + np.abs(most), axis=1) + np.sum(np.abs(c), axis=0)
    radius = (0.5 * (above - below) + bend) * (1 + U) + U * size
    c[0] += 0.5 * (above + below)
    one = np.zeros((length(1), *c.shape[1:]))
    one[K] = 1.0
    place, zero = Form(one, np.zeros(c.shape[1:])), -middle / half

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
