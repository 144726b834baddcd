"""States that a motion may be in when every joint by itself is late, and overshoots where it jumps.

A joint that is late by up to d is, at a time t, where it should be at a time T in [t - d, t]; d is the delay
in the motion's own time, times 1 + speed. Where its acceleration jumps at T, it has that before, or that
after and the share kappa of the step more, or of the sum of its last two, three, ... steps since t - d, which
add up. `certificate.trusted.late` encloses the same for all t. Here it is looked at instants, and at events
and the longest delay after them: there the joints between whose jumps less than the delay lies are combined
in all ways.

A state says where each joint is at the end of its stretch of times T without a jump; `room` is how long that
stretch is. The deviation "delay" goes back within it, exactly if the acceleration is constant.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from math import prod
from typing import TypeVar

import numpy as np

from ocptip.standing.jumps import SMALLEST
from ocptip.standing.tolerance import Tolerance
from ocptip.trajectories.arm_motion import INSIDE
from ocptip.trajectories.sampled import Motion

MOST = 5000  # combinations of what joints do at one instant; of more, all alike, or all but one
JUMP = 1e-6  # of the largest acceleration of a joint: smaller ones are none

T = TypeVar("T")

_Way = tuple[float, float, float, float, str]
"""What a joint may be doing: angle, speed, acceleration, room, word."""


@dataclass(frozen=True, eq=False)
class Looked:
    """States (N, 3 n) at times (N,), s, with room (N, n), s, for delays; what jumps there do, in words."""

    s: np.ndarray
    times: np.ndarray
    room: np.ndarray
    words: list[str]

    def joined(self, other: Looked) -> Looked:
        """Both."""
        parts = ((self.s, other.s), (self.times, other.times), (self.room, other.room))
        return Looked(*(np.concatenate(pair) for pair in parts), [*self.words, *other.words])

    def some(self, rows: np.ndarray) -> Looked:
        """Those of some rows."""
        return Looked(self.s[rows], self.times[rows], self.room[rows], [self.words[k] for k in rows])


class _Events:
    """Events of a motion, and what joints do on both sides of them."""

    def __init__(self, motion: Motion, tolerance: Tolerance) -> None:
        self.motion, self.times = motion, motion.event_times
        self.delay, self.more = tolerance.delay * (1 + tolerance.speed), tolerance.overshoot
        self.q, self.qd, self.before = motion.states(self.times - INSIDE)
        self.after = motion.states(self.times + INSIDE)[2]
        self.step = self.after - self.before
        self.small = SMALLEST * motion.acceleration_peaks
        self.jumps = np.abs(self.step) > JUMP * np.max(np.abs(self.step), axis=0, initial=1e-300)
        self.smooth = np.max(np.abs(self.step), axis=0, initial=0.0) <= self.small
        self.jumps[:, self.smooth] = False

    def room(self, times: np.ndarray) -> np.ndarray:
        """(N, n), s: how late joints may be at times without having a jump still before them."""
        found = np.full((len(times), self.motion.n), self.delay)
        for j in range(self.motion.n):
            own = self.times[self.jumps[:, j]]
            last = np.searchsorted(own, times + INSIDE, side="right") - 1
            since = times - np.append(own, -np.inf)[last]
            found[:, j] = np.clip(since, 0.0, self.delay)
        return found

    def ways(self, t: float, joint: int, own: np.ndarray, then: np.ndarray) -> list[_Way]:
        """What one joint may be doing at t: (3,) its state there, and the delay before."""
        inside = (self.times >= t - self.delay - INSIDE) & (self.times <= t + INSIDE)
        if self.smooth[joint]:
            return self._smooth_ways(inside, joint, own, then)
        found: list[_Way] = []
        low, at_once = t - self.delay, False
        sums: list[float] = []  # of the last step, the last two, and so on
        for e in np.flatnonzero(inside & self.jumps[:, joint]):
            time, step, state = self.times[e], self.step[e, joint], (self.q[e, joint], self.qd[e, joint])
            if self.delay:
                found.append((*state, self.before[e, joint], max(time - low, 0.0), "late"))
            sums, low, at_once = [step, *(s + step for s in sums)], max(time, low), t - time <= INSIDE
            if self.more:
                for size in sorted(set(sums)):
                    found.append((*state, self.after[e, joint] + self.more * size, 0.0, "overshooting"))
        if not (at_once and self.more):  # that is between what it was before and overshooting
            found.append((*own, min(max(t - low, 0.0), self.delay), "on time"))
        return found

    def _smooth_ways(self, inside: np.ndarray, joint: int, own: np.ndarray, then: np.ndarray) -> list[_Way]:
        """Of an acceleration that does not jump: on time, late, and where it was beyond in between."""
        between = np.column_stack([part[inside, joint] for part in (self.q, self.qd, self.after)])
        every = np.vstack([own, then, between])[:, 2]
        if np.ptp(every) <= self.small[joint]:
            return [(*own, self.delay, "on time")]
        low, high = sorted(every[:2])
        beyond = between[(between[:, 2] < low) | (between[:, 2] > high)]
        return [(*own, 0.0, "on time"), *((*state, 0.0, "late") for state in (then, *beyond))]


def on_time(motion: Motion, tolerance: Tolerance, times: np.ndarray) -> Looked:
    """States at instants, where joints are late only as far as their accelerations did not jump."""
    room = _Events(motion, tolerance).room(times)
    return Looked(np.hstack(motion.states(times)), times, room, [""] * len(times))


def jump_states(motion: Motion, tolerance: Tolerance) -> Looked:
    """States around the events at which accelerations jump, or, where they do not, are late."""
    n, events = motion.n, _Events(motion, tolerance)
    states, times, room, words = [], [], [], []
    instants = np.unique(np.concatenate([events.times, events.times + events.delay]))
    if not (events.delay or events.more):
        instants = np.empty(0)
    for t in instants:
        own, then = (
            part.reshape(3, n).T for part in np.hstack(motion.states([t + INSIDE, t - events.delay]))
        )
        ways = [events.ways(t, j, own[j], then[j]) for j in range(n)]
        joints = [j for j in range(n) if len(ways[j]) > 1 or ways[j][0][-1] != "on time"]
        if not joints:
            continue
        for chosen in combinations(ways):
            q, qd, qdd, late, doing = zip(*chosen, strict=True)
            states.append([*q, *qd, *qdd])
            times.append(t)
            room.append(late)
            words.append(_doing(joints, [doing[j] for j in joints]))
    parts = np.array(states).reshape(-1, 3 * n), np.array(times), np.array(room).reshape(-1, n)
    return Looked(*parts, words)


def _doing(joints: list[int], what: list[str]) -> str:
    """ "joints 1, 2 overshooting, joint 4 late"."""
    found = []
    for word in dict.fromkeys(what):
        own = [f"{j + 1}" for j, doing in zip(joints, what, strict=True) if doing == word]
        found.append(f"joint{'s' if len(own) > 1 else ''} {', '.join(own)} {word}")
    return ", ".join(found)


def combinations(ways: list[list[T]]) -> list[tuple[T, ...]]:
    """All, or of too many those in which all joints but one do the same."""
    if prod(map(len, ways)) <= MOST:
        return list(product(*ways))
    found = []
    for k in range(max(map(len, ways))):
        usual = [own[min(k, len(own) - 1)] for own in ways]
        found.append(tuple(usual))
        for j, own in enumerate(ways):
            found += [(*usual[:j], other, *usual[j + 1 :]) for other in own if other is not usual[j]]
    return found
