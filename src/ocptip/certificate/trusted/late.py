"""States that an arm may be in within an interval of time if every joint by itself is late, in Taylor forms.

A joint that is late by up to d is, at a time t, where it should be at a time T in [t - d, t]. Where its
acceleration jumps inside that interval, T is before the jump, or after it, or at the jump itself, when the
acceleration overshoots. Each of these ways is a branch: a piece of the motion, T between two lines of t, and
an addition to the acceleration. All combinations of the joints' branches are rows; over a row the joints'
coordinates are forms in s, the place within the interval, and in e_1 ... e_n, one for each joint's T.

A branch may hold more states than there are: a line that is replaced by one further out, a piece that is
continued beyond its end. Plain data and NumPy only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from math import comb, prod
from typing import Any

import numpy as np

from ocptip.certificate.trusted.forms import Form, K, U, length, polynomial

SLACK = (
    1e-9  # s: delays are looked at a little further than declared, so that rounded times count for nothing
)
REST = 1.0  # s before and after a motion: what else is looked at if nothing is late
MOST = 250  # combinations of branches; of more, joints' branches are put into one box
_SMALL = 1e-5  # of a joint's greatest acceleration: changes below it are bounds of errors, not jumps


@dataclass(frozen=True)
class _Branch:
    """Piece; T is from `low` to `high`, (2,) each, s, at both ends of the interval; addition to the
    acceleration; bounds (3,) of what coordinates, speeds and accelerations differ from the piece's."""

    piece: int
    low: tuple[float, float]
    high: tuple[float, float]
    more: float
    loose: np.ndarray


@dataclass(frozen=True, eq=False)
class Rows:
    """Combinations of branches, R of them.

    Attributes:
        interval: (R,) of which interval.
        q, qd, qdd: forms (n, R).
    """

    interval: np.ndarray
    q: Form
    qd: Form
    qdd: Form


class Late:
    """What joints that are late, and overshoot where they jump, may be doing.

    Args:
        motion: of a certificate.
        delay: s, of every joint by itself, at most.
        overshoot: share of its height by which a jump of an acceleration is exceeded.

    Attributes:
        delay: a little more, s; 0 if nothing is late and nothing overshoots.
        events: (E,) times between pieces, s.
        start, end: s: everything rests before, and from then on.
    """

    def __init__(self, motion: Mapping[str, Any], delay: float, overshoot: float) -> None:
        self._times = np.array(motion["times"], dtype=float)
        self._c = np.array(motion["angles"], dtype=float)
        self.delay = delay + SLACK if delay or overshoot else 0.0
        self._overshoot = overshoot
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
        found, blur = np.zeros_like(self._c), np.zeros_like(self._c)
        for i in range(self._c.shape[2]):
            for k in range(i, self._c.shape[2]):
                term = comb(k, i) * self._c[:, :, k] * (u ** (k - i) * self._rate**i)[:, None]
                found[:, :, i] += term
                blur[:, :, i] += U * np.abs(term)
        return found, blur

    def _differs(self, event: int, joint: int, reach: float) -> np.ndarray:
        """(3,): by how much coordinates, speeds and accelerations of the pieces at an event differ within."""
        size = np.abs(self._step[event, joint]) + self._blur[event, joint]
        k = np.arange(len(size))
        first, second = k[1:], k[2:]
        return (1 + U) * np.array(
            [
                np.sum(size * reach**k),
                np.sum(size[1:] * first * reach ** (first - 1)),
                np.sum(size[2:] * second * (second - 1) * reach ** (second - 2)),
            ]
        )

    def _branches(self, joint: int, start: float, end: float) -> list[_Branch]:
        """Of one joint from start to end, s."""
        d, reach, events = self.delay, self.delay + end - start, self.events
        inside = range(int(np.searchsorted(events, start - d, "right")), int(np.searchsorted(events, end)))
        changes = {k: self._differs(k, joint, reach) for k in inside}
        least = _SMALL * self._peaks[joint]
        jumps = [k for k in inside if changes[k][2] > least]
        smooth = np.sum([changes[k] for k in inside if k not in jumps] or [np.zeros(3)], axis=0)
        smooth[2] *= 1 + self._overshoot
        low, high, found = (start - d, end - d), (start, end), []
        loose, rounded, sums = smooth, 0.0, {}  # sums: over steps that end at an event, by where they begin
        for k in jumps:
            e = float(events[k])
            until = (e, e) if e < 0.5 * sum(high) else high
            found.append(_Branch(k, low, until, 0.0, loose))
            own, blur = (2 * self._overshoot * x[k, joint, 2] for x in (self._step, self._blur))
            rounded += blur
            sums = {i: x + float(own) for i, x in {**sums, k: 0.0}.items() if e - events[i] <= d}
            for more in sorted({x for x in sums.values() if abs(x) > least}):
                found.append(_Branch(k + 1, (e, e), (e, e), more, smooth + np.array([0.0, 0.0, rounded])))
            small = max((abs(x) for x in sums.values() if abs(x) <= least), default=0.0)
            loose = smooth + np.array([0.0, 0.0, small + rounded])
            low = (e, e) if e > start - d + 0.5 * (end - start) else (start - d, end - d)
        return [*found, _Branch(inside.stop, low, high, 0.0, loose)]

    def rows(self, starts: np.ndarray, ends: np.ndarray) -> Rows:
        """All rows of intervals from starts to ends, (N,) each, s, interval by interval."""
        joints = self._c.shape[1]
        branches: list[_Branch] = []
        owners: list[int] = []
        choices: list[list[list[int]]] = []  # of intervals and joints: numbers of branches
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            own = []
            for joint in range(joints):
                new = self._branches(joint, start, end)
                own.append(list(range(len(branches), len(branches) + len(new))))
                branches += new
                owners += [joint] * len(new)
            choices.append(own)
        states = self._states(branches, np.array(owners))
        boxes: list[list[int]] = []
        for own in choices:
            for joint in reversed(range(joints)):
                if prod(len(ways) for ways in own) <= MOST:
                    break
                if len(own[joint]) > 1:
                    boxes.append(own[joint])
                    own[joint] = [len(branches) + len(boxes) - 1]
        interval, chosen = [], []
        for number, own in enumerate(choices):
            for combination in product(*own):
                interval.append(number)
                chosen.append(combination)
        if boxes:
            states = [_appended(form, boxes, spread) for form, spread in zip(states, (0, 0, 1), strict=True)]
        index = np.array(chosen).T  # (n, R)
        return Rows(np.array(interval), *(self._placed(form, index) for form in states))

    def _states(self, branches: list[_Branch], joints: np.ndarray) -> list[Form]:
        """Coordinates, speeds and accelerations (branches,), with one coefficient of e and one of e s."""
        piece = np.array([b.piece for b in branches])
        low, high = np.array([b.low for b in branches]).T, np.array([b.high for b in branches]).T  # (2, F)
        middle, rate = 0.5 * self._times[piece].sum(axis=1), self._rate[piece]
        lines = np.array([0.5 * (low[0] + low[1]), 0.5 * (high[0] + high[1])])
        turns = np.array([0.5 * (low[1] - low[0]), 0.5 * (high[1] - high[0])])
        c = np.zeros((length(1), len(piece)))
        c[0], c[1] = (0.5 * lines.sum(axis=0) - middle) * rate, 0.5 * turns.sum(axis=0) * rate
        c[K], c[K + 1] = 0.5 * (lines[1] - lines[0]) * rate, 0.5 * (turns[1] - turns[0]) * rate
        size = (np.abs(low).sum(axis=0) + np.abs(high).sum(axis=0) + np.abs(middle)) * rate
        u = Form(c, U * size)
        own, found = self._c[piece, joints], []
        for order in range(3):
            value = polynomial(own.T, u) * rate**order
            loose = np.array([b.loose[order] for b in branches])
            found.append(Form(value.c, (value.r + loose) * (1 + U)))
            own = own[:, 1:] * np.arange(1, own.shape[1])
        found[2] = found[2] + np.array([b.more for b in branches])
        return found

    def _placed(self, form: Form, index: np.ndarray) -> Form:
        """Forms of branches at their joints' numbers: (n, R)."""
        n, count = index.shape
        if not self.delay:
            return Form(form.c[:K, index], form.r[index] + np.abs(form.c[K:]).sum(axis=0)[index])
        c = np.zeros((length(n), n, count))
        c[:K] = form.c[:K, index]
        square = K + 2 * n
        for j in range(n):
            c[K + j, j], c[K + n + j, j] = form.c[K, index[j]], form.c[K + 1, index[j]]
            c[square, j] = form.c[K + 2, index[j]]
            square += n - j
        return Form(c, form.r[index])


def _appended(form: Form, boxes: list[list[int]], spread: int) -> Form:
    """With boxes round some forms: intervals, given as errors or, spread, by e."""
    low, high = form.range
    ends = np.array([[np.min(low[box]), np.max(high[box])] for box in boxes]).T
    c = np.zeros((len(form.c), len(boxes)))
    c[0], half = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0]) * (1 + U) + U * np.abs(ends).sum(axis=0)
    if spread:
        c[K] = half
    r = np.zeros(len(boxes)) if spread else half
    return Form(np.concatenate([form.c, c], axis=1), np.concatenate([form.r, r]))
