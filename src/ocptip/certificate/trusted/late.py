"""States of an arm within an interval of time whose joints are delayed independently, in Taylor forms.

A joint with a delay of up to d is, at a time t, where it should be at a time T in [t - d, t]. If there is an
acceleration step inside that interval, T is before it, or after it, or at the step itself, when the
acceleration overshoots. Each of these is a case: a piece of the motion, T between two lines of t, and an
addition to the acceleration. All combinations of the joints' cases are rows. Over a row the joints'
coordinates are forms in s, the place within the interval, and in e_1 ... e_n, one for each joint's T.

A case may hold more states than there are: a line that is replaced by one further out, a piece that is
continued beyond its end. Plain data and NumPy only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from math import comb, prod
from typing import Any

import numpy as np

from ocptip.certificate.trusted.forms import Form, K, U, joined, length, polynomial
from ocptip.certificate.trusted.plain import VELOCITIES, require

SLACK = (
    1e-9  # s: delays are looked at a little further than declared, so that rounded times count for nothing
)
REST = 1.0  # s before and after a motion: what else is looked at if nothing is late
MOST = 1e5  # combinations of branches of all intervals
ALIKE = (1, 3)  # numbers of boxes from which rows go with others
Ends = tuple[np.ndarray, np.ndarray]
_SMALL = 1e-5  # of a joint's greatest acceleration: changes below it are bounds of errors, not jumps


@dataclass(frozen=True)
class _Branch:
    """Joint, piece; T is from `low` to `high`, (2,) each, s, at both ends of the interval; addition to the
    acceleration; bounds (3,) of what coordinates, speeds and accelerations differ from the piece's."""

    joint: int
    piece: int
    low: tuple[float, float]
    high: tuple[float, float]
    more: float
    loose: np.ndarray


@dataclass(frozen=True)
class _Box:
    """Cases of a joint on an interval from start to end, s."""

    joint: int
    start: float
    end: float
    branches: list[_Branch]


@dataclass(frozen=True, eq=False)
class Rows:
    """Combinations of cases, R of them.

    Attributes:
        number: (R,) in the order of intervals, of combinations of each.
        interval: (R,) of which interval.
        branches: (n, R) how many joints have there, apart or in a box.
        q, qd, qdd: forms (n, R) in s, e_1 ... e_n and, of each box, how far its acceleration is off.
        ends: (2, R), s: from when to when.
    """

    number: np.ndarray
    interval: np.ndarray
    branches: np.ndarray
    q: Form
    qd: Form
    qdd: Form
    ends: np.ndarray

    def some(self, rows: slice) -> Rows:
        """Some of the combinations."""
        q, qd, qdd = (Form(form.c[..., rows], form.r[..., rows]) for form in (self.q, self.qd, self.qdd))
        number, interval, branches = self.number[rows], self.interval[rows], self.branches[:, rows]
        return Rows(number, interval, branches, q, qd, qdd, self.ends[:, rows])


class Late:
    """Possible states of joints that are delayed, and overshoot at acceleration steps.

    Args:
        motion: of a certificate.
        delay: s, of every joint by itself, at most.
        overshoot: share of its height by which an acceleration step is exceeded.

    A base that drives has three more joints, the integrals of its velocities: on time, with overshoot.

    Attributes:
        delay: a little more, s; 0 without delay and overshoot.
        joints: number of them, those of a base that drives last.
        delayed: number of those that may be delayed: the others, which are last, have no e.
        events: (E,) times between pieces, s.
        start, end: s: everything rests before, and from then on.
    """

    def __init__(self, motion: Mapping[str, Any], delay: float, overshoot: float) -> None:
        self._times = np.array(motion["times"], dtype=float)
        self._c = np.array(motion["angles"], dtype=float)
        self.delayed = self._c.shape[1]
        if VELOCITIES in motion:
            self._times[[0, -1], [0, 1]] += -REST, REST  # the base may drive before and after the motion
            padded = np.pad(self._c, ((0, 0), (0, 0), (0, K - self._c.shape[2])))
            self._c = np.concatenate([padded, _integrated(motion[VELOCITIES], self._times)], axis=1)
        self.joints = self._c.shape[1]
        self.delay = delay + SLACK if delay or overshoot else 0.0
        self._delays = np.full(self.joints, self.delay)
        # Not quite on time, so that what the base does before the motion is a case of its first instant.
        self._delays[self.delayed :] = SLACK if self.delay else 0.0
        self.overshoot = overshoot
        self.events = self._times[:-1, 1]
        self.start = 0.0 if self.delay else -REST
        self.end = float(self.events[-1]) + (self.delay or REST)
        half = 0.5 * (self._times[:, 1] - self._times[:, 0])
        self._rate = np.where(half > 0, 1 / np.where(half > 0, half, 1.0), 0.0)
        left, blur = self._about(np.ones(len(half)))
        right, other = self._about(-np.ones(len(half)))
        self._step = right[1:] - left[:-1]  # (events, n, degrees): Taylor coefficients of the difference
        self._blur = blur[:-1] + other[1:]
        degrees = np.arange(self._c.shape[2])
        size = np.abs(self._c) * (degrees * np.maximum(degrees - 1, 0)) * (self._rate**2)[:, None, None]
        self._peaks = np.max(np.sum(size, axis=2), axis=0)  # (n,)

    def _about(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Taylor coefficients in time about u (pieces,): (pieces, n, degrees), and bounds of rounding."""
        values, blur = np.zeros_like(self._c), np.zeros_like(self._c)
        for i in range(self._c.shape[2]):
            for k in range(i, self._c.shape[2]):
                term = comb(k, i) * self._c[:, :, k] * (u ** (k - i) * self._rate**i)[:, None]
                values[:, :, i] += term
                blur[:, :, i] += U * np.abs(term)
        return values, blur

    def _changes(
        self, starts: np.ndarray, ends: np.ndarray, pieces: np.ndarray | None = None
    ) -> tuple[list[range], list[np.ndarray], np.ndarray]:
        """Changes at switching times in intervals from start to end, (N,), s, and in the delay before them;
        of pieces (N,) only those before them.

        Returns:
            The numbers of their switching times; for each interval which are acceleration steps, (times, n);
            bounds (N, n, 3) of what coordinates, speeds and accelerations change at the others.
        """
        first = np.searchsorted(self.events, starts - self.delay, "right")
        after = np.searchsorted(self.events, ends)
        after = after if pieces is None else np.minimum(after, pieces)
        first = np.minimum(first, after)
        counts = np.maximum(after - first, 0)
        owner = np.repeat(np.arange(len(starts)), counts)
        event = np.arange(len(owner)) + np.repeat(first - np.cumsum(counts) + counts, counts)
        reach = (self.delay + ends - starts)[owner, None, None]
        size = np.abs(self._step[event]) + self._blur[event]  # (pairs, n, degrees)
        k = np.arange(size.shape[2])
        one, two = k[1:], k[2:]
        parts = (
            size * reach**k,
            size[..., 1:] * one * reach ** (one - 1),
            size[..., 2:] * two * (two - 1) * reach ** (two - 2),
        )
        differs = (1 + U) * np.stack([np.sum(part, axis=2) for part in parts], axis=2)
        jumps = differs[..., 2] > _SMALL * self._peaks
        smooth = np.zeros((len(starts), self.joints, 3))
        np.add.at(smooth, owner, np.where(jumps[..., None], 0.0, differs))
        smooth[..., 2] *= 1 + self.overshoot
        inside = list(map(range, first.tolist(), after.tolist()))
        return inside, np.split(jumps, np.cumsum(counts)[:-1]), smooth

    def _branches(
        self, joint: int, start: float, end: float, inside: range, jumping: np.ndarray, smooth: np.ndarray
    ) -> list[_Branch]:
        """The cases of one joint from start to end, s; the rest is its part of `_changes`."""
        d, events, least = float(self._delays[joint]), self.events, _SMALL * self._peaks[joint]
        jumps = [
            k for k, jump in zip(inside, jumping.tolist(), strict=True) if jump and events[k] > start - d
        ]
        low, high, branches = (start - d, end - d), (start, end), []
        loose, rounded, sums = smooth, 0.0, {}  # sums: over steps that end at an event, by where they begin
        for k in jumps:
            e = float(events[k])
            until = (e, e) if e < 0.5 * sum(high) else high
            branches.append(_Branch(joint, k, low, until, 0.0, loose))
            jump, blur = (2 * self.overshoot * x[k, joint, 2] for x in (self._step, self._blur))
            rounded += blur
            sums = {i: x + float(jump) for i, x in {**sums, k: 0.0}.items() if e - events[i] <= d}
            for more in sorted({x for x in sums.values() if abs(x) > least}):
                loose = smooth + np.array([0.0, 0.0, rounded])
                branches.append(_Branch(joint, k + 1, (e, e), (e, e), more, loose))
            small = max((abs(x) for x in sums.values() if abs(x) <= least), default=0.0)
            loose = smooth + np.array([0.0, 0.0, small + rounded])
            low = (e, e) if e > start - d + 0.5 * (end - start) else (start - d, end - d)
        return [*branches, _Branch(joint, inside.stop, low, high, 0.0, loose)]

    def rows(self, starts: np.ndarray, ends: np.ndarray, apart: np.ndarray | None = None) -> list[Rows]:
        """All rows of intervals, those with about as many boxes together.

        Args:
            starts, ends: (N,) of the intervals, s.
            apart: (N, n) joints whose cases are rows of their combinations; the cases of other joints become
                one box, with any of their accelerations at any T. None: all joints.
        """
        branches, boxes, chosen, interval, counted = self._combined(starts, ends, apart)
        states, spread = self._states(branches), np.zeros(len(branches))
        if boxes:
            placed, more = self._boxes(boxes)
            states = [joined(*pair) for pair in zip(states, placed, strict=True)]
            spread = np.concatenate([spread, more])
        group = np.digitize(np.count_nonzero(spread[chosen], axis=0), ALIKE)
        results = []
        for k in np.unique(group):
            here = np.flatnonzero(group == k)
            q, qd, qdd = self._placed(states, chosen[:, here], spread)
            when = np.stack([starts[interval[here]], ends[interval[here]]])
            results.append(Rows(here, interval[here], counted[:, here], q, qd, qdd, when))
        return results

    def places(self, starts: np.ndarray, ends: np.ndarray) -> tuple[Form, Form]:
        """Coordinates and speeds (n, N) in s and e_1 ... e_n of delayed joints, over intervals from start to
        end, (N,), s; what their accelerations do does not matter.
        """
        none = np.zeros((len(starts), self.joints), dtype=bool)
        branches, boxes, chosen, _, _ = self._combined(starts, ends, none)
        states = self._states(branches)[:2]
        if boxes:
            states = [joined(*pair) for pair in zip(states, self._boxes(boxes)[0], strict=False)]
        q, qd = self._placed(states, chosen, np.zeros(len(states[0].r)))
        return q, qd

    def accelerations(self, starts: np.ndarray, ends: np.ndarray, pieces: np.ndarray) -> Ends:
        """Minimum and maximum accelerations (n, N) of the motion from start to end, (N,), s, and in no later
        piece than `pieces`, (N,).
        """
        first = np.minimum(np.searchsorted(self.events, starts, "left"), pieces)
        counts = np.minimum(np.searchsorted(self.events, ends, "right"), pieces) - first + 1
        begin = np.cumsum(counts) - counts
        owner = np.repeat(np.arange(len(counts)), counts)
        piece = np.arange(len(owner)) + np.repeat(first - begin, counts)
        middle, rate = 0.5 * self._times[piece].sum(axis=1), self._rate[piece]
        low, high = (np.clip((times[owner] - middle) * rate, -1, 1) for times in (starts, ends))
        blur = U * (np.abs(starts) + np.abs(ends))[owner] * rate + 2 * U * np.abs(middle) * rate
        u = Form.of(0.5 * (low + high), 0.5 * (high - low), radius=blur)
        k = np.arange(2, self._c.shape[2])[:, None]
        value = polynomial(np.moveaxis(self._c[piece], 0, 2)[:, 2:] * (k * (k - 1)), u) * rate**2
        least, most = value.range
        return np.minimum.reduceat(least, begin, axis=1), np.maximum.reduceat(most, begin, axis=1)

    def exceeded(self, starts: np.ndarray, ends: np.ndarray, pieces: np.ndarray) -> Ends:
        """Minimum and maximum, (n, N), of what overshoot adds to accelerations at steps from the delay before
        a start to an end, (N,), s, and before a piece.
        """
        less, more = [], []
        changes = zip(starts.tolist(), ends.tolist(), *self._changes(starts, ends, pieces), strict=True)
        for start, end, inside, jumps, smooth in changes:
            for joint in range(self.joints):
                parts = self._branches(joint, start, end, inside, jumps[:, joint], smooth[joint])
                less.append(min(0.0, *(part.more - part.loose[2] for part in parts)))
                more.append(max(0.0, *(part.more + part.loose[2] for part in parts)))
        return tuple(np.reshape(part, (-1, self.joints)).T for part in (less, more))  # type: ignore[return-value]

    def _combined(
        self, starts: np.ndarray, ends: np.ndarray, apart: np.ndarray | None
    ) -> tuple[list[_Branch], list[_Box], np.ndarray, np.ndarray, np.ndarray]:
        """Cases, boxes, which of them joints take (n, R), boxes counted after the cases, and for each
        combination its interval (R,) and how many cases joints have there (n, R).
        """
        branches: list[_Branch] = []
        boxes: list[_Box] = []
        interval, chosen, counted, most = [], [], [], 0
        changes = zip(starts.tolist(), ends.tolist(), *self._changes(starts, ends), strict=True)
        for number, (start, end, inside, jumps, smooth) in enumerate(changes):
            patterns, counts = [], []
            for joint in range(self.joints):
                new = self._branches(joint, start, end, inside, jumps[:, joint], smooth[joint])
                if self.delay and apart is not None and not apart[number, joint] and len(new) > 1:
                    boxes.append(_Box(joint, start, end, new))
                    patterns.append([-len(boxes)])
                else:
                    patterns.append(list(range(len(branches), len(branches) + len(new))))
                    branches += new
                counts.append(len(new))
            most += prod(len(each) for each in patterns)
            require(most <= MOST, "cover_within: too many combinations")
            for combination in product(*patterns):
                interval.append(number)
                chosen.append(combination)
                counted.append(counts)
        index = np.array(chosen).T
        index = np.where(index < 0, len(branches) - 1 - index, index)
        return branches, boxes, index, np.array(interval), np.array(counted).T

    def _states(self, branches: list[_Branch]) -> list[Form]:
        """Coordinates, speeds and accelerations (cases,), with one coefficient of e and one of e s."""
        piece, joints = np.array([(b.piece, b.joint) for b in branches], dtype=int).reshape(-1, 2).T
        low, high = np.array([(b.low, b.high) for b in branches]).reshape(-1, 2, 2).transpose(1, 2, 0)
        middle, rate = 0.5 * self._times[piece].sum(axis=1), self._rate[piece]
        lines = np.array([0.5 * (low[0] + low[1]), 0.5 * (high[0] + high[1])])
        turns = np.array([0.5 * (low[1] - low[0]), 0.5 * (high[1] - high[0])])
        c = np.zeros((length(1), len(piece)))
        c[0], c[1] = (0.5 * lines.sum(axis=0) - middle) * rate, 0.5 * turns.sum(axis=0) * rate
        c[K], c[K + 1] = 0.5 * (lines[1] - lines[0]) * rate, 0.5 * (turns[1] - turns[0]) * rate
        size = (np.abs(low).sum(axis=0) + np.abs(high).sum(axis=0) + np.abs(middle)) * rate
        u = Form(c, U * size)
        coefficients, states = self._c[piece, joints], []
        for order in range(3):
            value = polynomial(coefficients.T, u) * rate**order
            loose = np.array([b.loose[order] for b in branches])
            states.append(Form(value.c, (value.r + loose) * (1 + U)))
            coefficients = coefficients[:, 1:] * np.arange(1, coefficients.shape[1])
        states[2] = states[2] + np.array([b.more for b in branches])
        return states

    def _boxes(self, boxes: list[_Box]) -> tuple[list[Form], np.ndarray]:
        """Coordinates, speeds and accelerations for any T in the delay, forms (boxes,) in s and e; and by how
        much accelerations may be off by themselves."""
        first, last = np.array([(box.start, box.end) for box in boxes]).T
        delay = self._delays[[box.joint for box in boxes]]
        middle, half = 0.5 * (first + last - delay), 0.5 * (last - first + delay)
        owner = np.repeat(np.arange(len(boxes)), [len(box.branches) for box in boxes])
        parts = [part for box in boxes for part in box.branches]
        piece, joints = np.array([(part.piece, part.joint) for part in parts]).T
        low, high = (  # of T in branches
            np.clip(value, (middle - half)[owner], (middle + half)[owner])
            for value in (
                [min(part.low + part.high) for part in parts],
                [max(part.low + part.high) for part in parts],
            )
        )
        size = U * (np.abs(first) + np.abs(last) + delay)[owner]

        def within(origin: np.ndarray, rate: np.ndarray) -> Form:
            """T from low to high, less an origin, times a rate."""
            blur = (size + U * np.abs(origin)) * rate
            return Form.of((0.5 * (low + high) - origin) * rate, 0.5 * (high - low) * rate, radius=blur)

        rate = self._rate[piece]
        u, z = within(0.5 * self._times[piece].sum(axis=1), rate), within(middle[owner], 1 / half[owner])
        c = np.zeros((length(1), len(boxes)))
        c[1], c[K] = 0.5 * (last - first) / half, 0.5 * delay / half
        time = Form(c, U * (np.abs(first) + np.abs(last) + delay) / half)
        coefficients, results, spread = self._c[piece, joints], [], np.zeros(len(boxes))
        for order in range(3):
            value = polynomial(coefficients.T, u) * rate**order + np.array(
                [part.more * (order == 2) for part in parts]
            )
            loose = np.array([part.loose[order] for part in parts])
            line = _line(value, z, owner, 0 if order == 2 else 2)
            low_, high_ = (value - polynomial(line[:, owner], z)).range
            ends = np.full((2, len(boxes)), np.inf)
            np.minimum.at(ends[0], owner, low_ - loose)
            np.minimum.at(ends[1], owner, -high_ - loose)
            centre, spread = 0.5 * (ends[0] - ends[1]), 0.5 * (-ends[0] - ends[1])
            form = polynomial(line, time) + centre
            spread = spread * (1 + U) + U * np.abs(ends).sum(axis=0)
            results.append(Form(form.c, form.r + spread * (order < 2)))
            coefficients = coefficients[:, 1:] * np.arange(1, coefficients.shape[1])
        return results, spread

    def _placed(self, states: list[Form], index: np.ndarray, spread: np.ndarray) -> list[Form]:
        """States of cases and boxes, coordinates first, at their joints' numbers: (n, R)."""
        n, count = index.shape
        if not self.delay:
            return [
                Form(form.c[:K, index], form.r[index] + np.abs(form.c[K:]).sum(axis=0)[index])
                for form in states
            ]
        boxed, results = spread[index] > 0, []
        late, positions = self.delayed, index[self.delayed :]
        m = late + int(np.max(np.count_nonzero(boxed, axis=0)))
        for form in states:
            c, r = np.zeros((length(m), n, count)), form.r[index]
            c[:K] = form.c[:K, index]
            r[late:] = (r[late:] + np.abs(form.c[K:]).sum(axis=0)[positions]) * (1 + U)
            square = K + 2 * m
            for j in range(late):
                c[K + j, j], c[K + m + j, j] = form.c[K, index[j]], form.c[K + 1, index[j]]
                c[square, j] = form.c[K + 2, index[j]]
                square += m - j
            results.append(Form(c, r))
        joint, row = np.nonzero(boxed)
        if not len(joint):
            return results
        number = K + late - 1 + np.cumsum(boxed, axis=0)[joint, row]
        results[2].c[number, joint, row] = spread[index[joint, row]]
        return results


def _integrated(velocities: Any, times: np.ndarray) -> np.ndarray:
    """(pieces, 3, 6): integrals of velocities (pieces, 3, degrees), polynomials of u in times (pieces, 2)."""
    v = np.array(velocities, dtype=float)
    half, values = 0.5 * np.diff(times, axis=1)[:, :, None], np.zeros((len(v), 3, K))
    values[:, :, 1 : 1 + v.shape[2]] = half * v / np.arange(1, 1 + v.shape[2])
    return values


def _line(value: Form, z: Form, owner: np.ndarray, degree: int) -> np.ndarray:
    """(degree + 1, boxes): polynomials of z near the values, forms (N,), of boxes; any will do."""
    x = np.array([-1.0, 0.0, 1.0])[:, None]
    state, values = z.c[0] + x * z.c[1], sum(c * x**k for k, c in enumerate(value.c[:K]))
    powers = state ** np.arange(degree + 1)[:, None, None]  # (degrees, 3, N)
    weighted = powers * (np.abs(z.c[1]) + 1e-3)
    count = int(owner[-1]) + 1
    A = np.zeros((count, degree + 1, degree + 1))
    b = np.zeros((count, degree + 1))
    np.add.at(A, owner, np.einsum("isn,jsn->nij", weighted, powers))
    np.add.at(b, owner, np.einsum("isn,sn->ni", weighted, values))
    return np.linalg.solve(A + 1e-9 * np.eye(degree + 1), b[..., None])[..., 0].T
