"""A whole motion at the worst of its tolerance: every instant, and every joint by itself where it jumps.

Looked at are instants, and states around jumps of accelerations: within the longest delay after an event
each joint that jumps there may not have done so yet, or just has, and then its acceleration overshoots. Every
joint does one or the other, in all combinations. What one jump rings on when the next one comes is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from ocptip.basics.text import quantity
from ocptip.standing.jumps import SMALLEST
from ocptip.standing.limit import Worst as Measured
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerable import IN_MOTION, largest, why_not
from ocptip.standing.tolerance import Tolerance
from ocptip.standing.worst_case import Worst, WorstCase, worst_case_of
from ocptip.trajectories.arm_motion import INSIDE
from ocptip.trajectories.sampled import Motion

MOST_JOINTS = 7  # that jump within a delay and are combined in all ways; of more, one by one
JUMP = 1e-6  # of the largest acceleration of a joint: smaller ones are none
EXACT = 48  # instants that are looked at exactly, those that look worst up to products of deviations
STARTS = 5  # of the search for the worst slip
SPACING, ROUGHLY = 0.01, 0.02  # s, share: how closely it is looked at what a motion can have
NEARER, FRESH = 2, 9  # rounds of instants around the worst


@dataclass(frozen=True)
class WorstInstant:
    """The worst that was found of one reserve.

    Attributes:
        value: GN or GT.
        time: s.
        how: the deviations, in words.
        left: what is left there, in words.
        bound: of GN: what it can be at most at this instant, with products of deviations that were not tried;
            None for GT, which is the worst that a search found.
    """

    value: float
    time: float
    how: str
    left: str
    bound: float | None

    def __str__(self) -> str:
        return f"{self.how}, at {self.time:.3f} s: {self.left}"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return dict(vars(self))


@dataclass(frozen=True)
class WithinTolerance:
    """A motion at the worst of a tolerance.

    Attributes:
        tolerance: of the arm, its base, the floor and the drives.
        tip, slip: the worst instants; tip is None where the base cannot tip.
        states: number of states looked at.
    """

    tolerance: Tolerance
    tip: WorstInstant | None
    slip: WorstInstant
    states: int

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        tip = self.tip and self.tip.to_dict()
        given = self.tolerance.to_dict()
        return {"tolerance": given, "tip": tip, "slip": self.slip.to_dict(), "states": self.states}

    def measured(self, limits: MotionLimits) -> list[Measured]:
        """As the other worst values of a check."""
        found = []
        for worst, name in ((self.tip, "GN_worst_case"), (self.slip, "GT_worst_case")):
            if worst is not None:
                most, value = getattr(limits, name), worst.value if worst.bound is None else worst.bound
                found.append(Measured(name, value, worst.time, most, worst.how, value - most))
        return found


def worst_within(
    robot: StandingMechanism, motion: Motion, tolerance: Tolerance, times: np.ndarray
) -> WithinTolerance:
    """The worst of the contacts in a motion, everything off at once as far as the tolerance goes.

    Args:
        robot: an arm on its base.
        motion: of it.
        tolerance: of both.
        times: (N,), s, to look at; more are taken around the worst.

    Raises:
        InputError: the robot is no arm.
    """
    return _worst_of(worst_case_of(robot, tolerance), motion, times)


def tolerable(robot: StandingMechanism, motion: Motion, limits: MotionLimits) -> tuple[float, str]:
    """How much of everything in its tolerance a motion can have, 0 to 1, and in words what is too much."""
    cases = worst_case_of(robot, limits.tolerance)
    times = motion.both_sides(SPACING)

    def kept(tolerance: Tolerance) -> bool:
        found = _worst_of(cases.within(tolerance), motion, times)
        return all(worst.excess <= 0 for worst in found.measured(limits))

    share = largest(limits.tolerance, kept, ROUGHLY)
    return share, why_not(limits.tolerance, IN_MOTION, kept)


def _worst_of(cases: WorstCase, motion: Motion, times: np.ndarray) -> WithinTolerance:
    tolerance = cases.deviations.tolerance
    jumps = jump_states(motion, tolerance)
    looked = _Looked(np.hstack(motion.states(times)), times, [""] * len(times)).joined(jumps)
    tip = None
    if cases.axes:
        tip = _worst_tip(cases, _refined(cases, motion, looked, _least_moments))
    at = _refined(cases, motion, looked, _greatest_slips)
    return WithinTolerance(tolerance, tip, _worst_slip(cases, at), len(looked.times))


@dataclass(frozen=True, eq=False)
class _Looked:
    """States (N, 3 n) at times (N,), s; what jumps there do, in words."""

    s: np.ndarray
    times: np.ndarray
    words: list[str]

    def joined(self, other: _Looked) -> _Looked:
        return _Looked(
            np.vstack([self.s, other.s]),
            np.concatenate([self.times, other.times]),
            [*self.words, *other.words],
        )

    def some(self, rows: np.ndarray) -> _Looked:
        return _Looked(self.s[rows], self.times[rows], [self.words[k] for k in rows])


def jump_states(motion: Motion, tolerance: Tolerance) -> _Looked:
    """States around the events at which accelerations jump, or, where they do not, are late.

    A late joint whose acceleration does not jump has that of the delay before, or of an event since then, if
    it was beyond.
    """
    n, delay, more = motion.n, tolerance.delay, tolerance.overshoot
    found = _Looked(np.empty((0, 3 * n)), np.empty(0), [])
    events = motion.event_times
    if not (delay or more) or not len(events):
        return found
    q, qd, before = motion.states(events - INSIDE)
    after = motion.states(events + INSIDE)[2]
    step = after - before
    jumps = np.abs(step) > JUMP * np.max(np.abs(step), axis=0, initial=1e-300)
    smooth = np.max(np.abs(step), axis=0) <= SMALLEST * motion.acceleration_peaks
    jumps[:, smooth] = False
    states, times, words = [], [], []
    for t in np.unique(np.concatenate([events, events + delay])):
        inside = (events >= t - delay - INSIDE) & (events <= t + INSIDE)
        own, then = np.hstack(motion.states(np.array([t + INSIDE, t - delay])))
        changed = np.abs(own - then)[2 * n :] > SMALLEST * motion.acceleration_peaks
        joints = np.flatnonzero(np.any(jumps[inside], axis=0) | (smooth & changed))
        if not len(joints):
            continue
        options = []
        for j in joints:
            places, of_joint = np.flatnonzero(inside & jumps[:, j]), []
            if smooth[j]:
                between = np.column_stack([q[inside, j], qd[inside, j], after[inside, j]])
                low, high = sorted([own[2 * n + j], then[2 * n + j]])
                beyond = between[(between[:, 2] < low) | (between[:, 2] > high)]
                options.append(
                    [(*own[j::n], "on time"), *((*state, "late") for state in (then[j::n], *beyond))]
                )
                continue
            if delay:
                of_joint = [(q[e, j], qd[e, j], before[e, j], "late") for e in places]
            e, high = places[-1], after[places[-1], j] + more * np.sum(step[places, j])
            of_joint.append((q[e, j], qd[e, j], high, "overshooting" if more else "on time"))
            options.append(of_joint)
        for chosen in _combinations(options):
            state = own.copy()
            for j, (angle, speed, acceleration, _) in zip(joints, chosen, strict=True):
                state[[j, n + j, 2 * n + j]] = angle, speed, acceleration
            states.append(state)
            times.append(t)
            words.append(_doing(joints, [own[3] for own in chosen]))
    return _Looked(np.array(states).reshape(-1, 3 * n), np.array(times), words)


def _doing(joints: np.ndarray, what: list[str]) -> str:
    """ "joints 1, 2 overshooting, joint 4 late"."""
    found = []
    for word in dict.fromkeys(what):
        own = [f"{j + 1}" for j, doing in zip(joints, what, strict=True) if doing == word]
        found.append(f"joint{'s' if len(own) > 1 else ''} {', '.join(own)} {word}")
    return ", ".join(found)


def _combinations(options: list[list[tuple]]) -> list[tuple]:
    """All, or of too many those in which all joints but one do the same."""
    if len(options) <= MOST_JOINTS:
        return list(product(*options))
    found = []
    for k in range(max(map(len, options))):
        usual = [own[min(k, len(own) - 1)] for own in options]
        found.append(tuple(usual))
        for j, own in enumerate(options):
            found += [(*usual[:j], other, *usual[j + 1 :]) for other in own if other is not usual[j]]
    return found


def _least_moments(cases: WorstCase, s: np.ndarray) -> np.ndarray:
    return -np.min(cases.estimated_moments(s), axis=1)


def _greatest_slips(cases: WorstCase, s: np.ndarray) -> np.ndarray:
    return cases.estimated_slip(s)


def _refined(cases: WorstCase, motion: Motion, looked: _Looked, badness: Any) -> _Looked:
    """The states that look worst, with instants around the worst one."""
    bad = badness(cases, looked.s)
    for _ in range(NEARER):
        row = int(np.argmax(bad))
        if looked.words[row]:
            break
        plain = np.array([not word for word in looked.words])
        times = np.sort(looked.times[plain])
        near = np.searchsorted(times, looked.times[row])
        left, right = times[max(near - 1, 0)], times[min(near + 1, len(times) - 1)]
        fresh = np.linspace(left, right, FRESH + 2)[1:-1]
        new = _Looked(np.hstack(motion.states(fresh)), fresh, [""] * FRESH)
        looked, bad = looked.joined(new), np.concatenate([bad, badness(cases, new.s)])
    return looked.some(np.argsort(-bad, kind="stable")[:EXACT])


def _worst_tip(cases: WorstCase, at: _Looked) -> WorstInstant:
    rows, axes = (
        np.repeat(np.arange(len(at.times)), cases.axes),
        np.tile(np.arange(cases.axes), len(at.times)),
    )
    found = cases.moments(at.s[rows], axes)
    k = int(np.argmin(found.values))
    row, state = int(rows[k]), at.s[rows[k : k + 1]]
    missed = float(cases.deviations.missed(state, found.theta[k : k + 1], found.slopes[k : k + 1])[0])
    moment = float(found.values[k])
    first, second = sorted(c + 1 for c in cases.robot.tip_over.axes[axes[k]].contacts)
    left = f"{quantity(moment, 'N m', 3)} left about contacts {first} and {second}"
    left += _kept(cases, state, found.theta[k : k + 1])
    value, bound = (float(cases.tip_ratio(np.array(m))) for m in (moment, moment - missed))
    return WorstInstant(value, float(at.times[row]), _how(cases, found, k, at.words[row]), left, bound)


def _worst_slip(cases: WorstCase, at: _Looked) -> WorstInstant:
    found = cases.slip(at.s, STARTS)
    k = int(np.argmax(found.values))
    left = f"slip GT {found.values[k]:.3g}{_kept(cases, at.s[k : k + 1], found.theta[k : k + 1])}"
    how = _how(cases, found, k, at.words[k])
    return WorstInstant(float(found.values[k]), float(at.times[k]), how, left, None)


def _how(cases: WorstCase, found: Worst, k: int, words: str) -> str:
    return ", ".join(part for part in (cases.deviations.words(found.theta[k]), words) if part)


def _kept(cases: WorstCase, s: np.ndarray, theta: np.ndarray) -> str:
    """Which contact keeps how much of its normal force; nothing where they share it in several ways."""
    if cases.robot.slip.redistribution != "tangential":
        return ""
    states = cases.robot.contact_states(cases.deviations.wrench(s, theta)[0])
    reserves = cases.robot.tip_over.evaluate(states).normal_reserves[0]
    if not states.solved[0] or not np.isfinite(reserves).any():
        return ""
    k = int(np.nanargmin(reserves))
    return f", contact {k + 1} keeps {quantity(max(float(reserves[k]), 0.0), 'N', 3)}"
