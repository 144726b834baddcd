"""States of a motion whose joints are delayed independently, and overshoot at acceleration steps.

A joint with a delay of up to d is, at a time t, where it should be at a time T in [t - d, t]; d is the delay
in the time of the motion, times 1 + speed. At a step of its acceleration at T, it has the value before, or
that after and the share kappa of the step more. It may also add the share of the sum of its last two, three,
... steps since t - d. `certificate.trusted.late` encloses the same for all t. Here instants are evaluated:
any, and switching times and the longest delay after them. There the joints between whose steps less than the
delay lies are combined completely; of a motion with too many steps for that, see `worst_options`.

A state says where each joint is at the end of its stretch of times T without a step; `max_delay` is how long
that stretch is. The deviation "delay" goes back within it, exactly if the acceleration is constant. Where it
is not, the value at t - d is another state; between two steps it lies between the values next to these.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import NamedTuple, TypeVar

import numpy as np

from ocptip.basics.text import numbered
from ocptip.standing.arm import Robot
from ocptip.standing.limit_kinds.jumps import SMALLEST
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.worst_case import WorstCase
from ocptip.standing.within.worst_options import chosen_by_slopes, slipping
from ocptip.trajectories.trajectory import INSIDE, Trajectory

MOST = 5000  # combinations of what joints do at one instant; of more, all alike, or all but one
MOST_OF_ALL = 20_000  # combinations in a motion; of more, those that are worst by slopes
BETWEEN = 0.005  # s: instants at which joints whose accelerations change without jumps are combined
BASE_STEPS = "base overshooting"
JUMP = 1e-6  # of the largest acceleration of a joint: smaller ones are none

T = TypeVar("T")

_State = tuple[float, float, float]
"""Angle, speed, acceleration of a joint."""

_Way = tuple[float, float, float, float, str]
"""A possible delayed state of a joint: angle, speed, acceleration, maximum delay, word."""


class DelayCase(NamedTuple):
    """A possible state of a joint at an instant.

    Attributes:
        event: number of the switching time, of those in the delay before; None: it is on time.
        steps: how many of the last steps of the acceleration, with that of the switching time, it overshoots;
            0: it still is in the state before it.
        max_delay: s, further delay without another step.
    """

    event: int | None
    steps: int
    max_delay: float


def delay_cases(
    events: Sequence[float] | np.ndarray, t: float, delay: float, overshoots: bool
) -> list[DelayCase]:
    """Possible states at t of a joint with acceleration steps at `events`, s, increasing, in the delay before
    t.
    """
    result: list[DelayCase] = []
    low, at_once = t - delay, False
    for event, time in enumerate(events):
        if delay:
            result.append(DelayCase(event, 0, max(time - low, 0.0)))
        low, at_once = max(time, low), t - time <= INSIDE
        if overshoots:
            result += [DelayCase(event, steps, 0.0) for steps in range(1, event + 2)]
    if not (at_once and overshoots):  # that is between what it was before and overshooting
        result.append(DelayCase(None, 0, min(max(t - low, 0.0), delay)))
    return result


@dataclass(frozen=True, eq=False)
class DelayedStates:
    """States at times (N,), s, with room (N, n), s, for delays; the acceleration steps there, in words.

    States s (N, 3 n) are angles, speeds, accelerations; what a process is that varies, 6 more.
    """

    s: np.ndarray
    times: np.ndarray
    max_delay: np.ndarray
    words: list[str]

    def joined(self, other: DelayedStates) -> DelayedStates:
        """Both."""
        pairs = (self.s, other.s), (self.times, other.times), (self.max_delay, other.max_delay)
        s, times, max_delay = (np.concatenate(pair) for pair in pairs)
        return DelayedStates(s, times, max_delay, [*self.words, *other.words])

    def some(self, rows: np.ndarray) -> DelayedStates:
        """Those of some rows."""
        return DelayedStates(
            self.s[rows], self.times[rows], self.max_delay[rows], [self.words[k] for k in rows]
        )


class Events:
    """Switching times of a motion, and the accelerations of joints on both sides of them.

    Attributes:
        times: (E,), s.
        delay, more: of the uncertainty: maximum delay, s, and share of a step that overshoots.
        q, qd, before, after, step: (E, n) of the joints there, and what their accelerations change by.
        jumps: (E, n) which of these changes are acceleration steps.
        small: (n,) changes of acceleration that count for nothing.
    """

    def __init__(self, motion: Trajectory, tolerance: Uncertainty) -> None:
        self.motion, self.times = motion, motion.event_times
        self.delay, self.more = tolerance.late, tolerance.overshoot
        self.q, self.qd, self.before = motion.states(self.times - INSIDE)
        self.after = motion.states(self.times + INSIDE)[2]
        self.step = self.after - self.before
        self.small = SMALLEST * motion.acceleration_peaks
        self.jumps = np.abs(self.step) > JUMP * np.max(np.abs(self.step), axis=0, initial=1e-300)
        self.smooth = np.max(np.abs(self.step), axis=0, initial=0.0) <= self.small
        self.jumps[:, self.smooth] = False
        # Lists: of a recording, options are asked for at ten thousands of instants.
        parts = (self.q, self.qd, self.before, self.after, self.step)
        self._by_joint = list(zip(*(part.T.tolist() for part in parts), strict=True))
        self._jumping = [np.flatnonzero(column).tolist() for column in self.jumps.T]
        self._times = self.times.tolist()

    def max_delay(self, times: np.ndarray) -> np.ndarray:
        """(N, n), s: maximum delay of joints at times without an acceleration step in between."""
        scalars = np.full((len(times), self.motion.n), self.delay)
        for j in range(self.motion.n):
            time = self.times[self.jumps[:, j]]
            last = np.searchsorted(time, times + INSIDE, side="right") - 1
            since = times - np.append(time, -np.inf)[last]
            scalars[:, j] = np.clip(since, 0.0, self.delay)
        return scalars

    def inside(self, times: np.ndarray) -> list[slice]:
        """Which switching times are in the delay before each of these times, s."""
        first = np.searchsorted(self.times, times - self.delay - INSIDE)
        last = np.searchsorted(self.times, times + INSIDE, side="right")
        return list(map(slice, first.tolist(), last.tolist()))

    def options(self, t: float, inside: slice, joint: int, state: _State, then: _State) -> list[_Way]:
        """The possible delayed states of one joint at t, with switching times `inside` its delay, from its
        states (3,) at t and one delay before.
        """
        if self.smooth[joint]:
            return self._smooth_options(inside, joint, state, then)
        jumping = self._jumping[joint]
        jumps = jumping[bisect_left(jumping, inside.start) : bisect_left(jumping, inside.stop)]
        q, qd, before, after, step = self._by_joint[joint]
        table: dict[_Way, None] = {}
        until = before[jumps[0]] if jumps else state[2]
        if self.delay and abs(then[2] - until) > self.small[joint]:  # it changes without a jump, too
            table[*then, 0.0, "delayed"] = None
        total = 0.0
        for case in delay_cases([self._times[e] for e in jumps], t, self.delay, self.more > 0):
            if case.event is None:
                way = *state, case.max_delay, "on time"
            else:
                e, acceleration, word = jumps[case.event], before[jumps[case.event]], "delayed"
                if case.steps:  # with one step more than in the case before
                    last = step[jumps[case.event + 1 - case.steps]]
                    total = last if case.steps == 1 else total + last
                    acceleration, word = after[e] + self.more * total, "overshooting"
                way = q[e], qd[e], acceleration, case.max_delay, word
            table[way] = None
        return list(table)

    def _smooth_options(self, inside: slice, joint: int, begun: _State, then: _State) -> list[_Way]:
        """Options of a joint without acceleration step: on time, delayed, and the extremes in between."""
        between = self.after[inside, joint]
        low, high = sorted((begun[2], then[2]))
        least, most = between.min(initial=low), between.max(initial=high)
        if most - least <= self.small[joint]:
            return [(*begun, self.delay, "on time")]
        places = inside.start + np.flatnonzero((between < low) | (between > high))
        q, qd, after = (part[places, joint].tolist() for part in (self.q, self.qd, self.after))
        late: list[_State] = [then, *zip(q, qd, after, strict=True)]
        return [(*begun, 0.0, "on time"), *((*state, 0.0, "delayed") for state in late)]


def on_time(
    motion: Trajectory, tolerance: Uncertainty, times: np.ndarray, robot: Robot | None = None
) -> DelayedStates:
    """States at instants, where joints are delayed only as far as there was no acceleration step.

    What acts on the gripper of a robot `during` the motion is never delayed: it keeps the clock of the
    motion.
    """
    max_delay = Events(motion, tolerance).max_delay(times)
    acting = np.empty((len(times), 0)) if robot is None else robot.acting(times)
    return DelayedStates(np.hstack([*motion.states(times), acting]), times, max_delay, [""] * len(times))


def jump_states(
    motion: Trajectory,
    tolerance: Uncertainty,
    cases: WorstCase | None = None,
    robot: Robot | None = None,
) -> DelayedStates:
    """States around the switching times: at acceleration steps, and elsewhere with delays.

    Args:
        motion: that has the switching times.
        tolerance: its delay and its overshoot.
        cases: of motions with more than `MOST_OF_ALL` combinations the worst for these are evaluated; without
            them, all.
        robot: `during` the motion: if its process varies, its knots are evaluated as well.
    """
    n, events = motion.n, Events(motion, tolerance)
    result: list[_Instant] = []
    instants = [events.times, events.times + events.delay]
    if robot is not None:
        instants.append(robot.acts.knots)
    instants = np.unique(np.concatenate(instants))
    if events.delay and events.smooth.any():  # accelerations that change in between are late there, too
        instants = _filled(instants)
    if not (events.delay or events.more):
        instants = np.empty(0)
    acting = np.empty((len(instants), 0)) if robot is None else robot.acting(instants)
    knots, overshooting = _base_steps(robot, events.more)
    words = [""] * len(instants) + [BASE_STEPS] * len(knots)
    instants = np.append(instants, knots)
    now, before = (
        np.stack(motion.states(times), axis=2).tolist()  # (N, n, 3)
        for times in (instants + INSIDE, instants - events.delay - INSIDE)
    )
    acting = [*acting, *overshooting]
    given = zip(instants.tolist(), events.inside(instants), now, before, acting, words, strict=True)
    for t, inside, begun, then, acts, word in given:
        options = [events.options(t, inside, j, begun[j], then[j]) for j in range(n)]
        joints = [j for j in range(n) if len(options[j]) > 1 or options[j][0][-1] != "on time"]
        if joints or word:
            result.append(_Instant(t, joints, options, acts, word))
    if cases is not None and sum(prod(map(len, instant.options)) for instant in result) > MOST_OF_ALL:
        return _worst_combinations(result, cases)
    most = MOST if cases is None else MOST_OF_ALL
    every = [instant.combined(combinations(instant.options, most)) for instant in result]
    if not every:
        return on_time(motion, tolerance, np.empty(0), robot)
    s, times, max_delay = (
        np.concatenate([getattr(one, part) for one in every]) for part in ("s", "times", "max_delay")
    )
    return DelayedStates(s, times, max_delay, [word for one in every for word in one.words])


def _base_steps(robot: Robot | None, overshoot: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (K,), s, of acceleration steps of a base that drives, and what acts there if they overshoot."""
    times = robot.acts.knots if robot is not None and robot.acts.end and overshoot else np.empty(0)
    if robot is None or not len(times):
        return times, np.empty((0, 0))
    before, after = (robot.acting(times + side) for side in (-INSIDE, INSIDE))
    steps = np.abs(after - before).max(axis=1, initial=0.0) > JUMP
    return times[steps], (after + overshoot * (after - before))[steps]


def _filled(instants: np.ndarray) -> np.ndarray:
    """With instants between those that are farther apart than `BETWEEN`."""
    counts = np.maximum(np.ceil(np.diff(instants) / BETWEEN), 1).astype(int)
    parts = [
        np.linspace(a, b, count, endpoint=False)
        for a, b, count in zip(instants[:-1], instants[1:], counts, strict=True)
    ]
    return np.concatenate([*parts, instants[-1:]])


@dataclass(frozen=True)
class _Instant:
    """The possible delayed states at a time t, s; listed are joints with others than being on time.

    `of_base`: what a base that drives does there, in words.
    """

    t: float
    joints: list[int]
    options: list[list[_Way]]
    acting: np.ndarray
    of_base: str

    def combined(self, chosen: Sequence[Sequence[_Way]]) -> DelayedStates:
        """The states of combinations of cases."""
        numbers = np.array([[way[:4] for way in options] for options in chosen])  # (C, n, 4)
        states = numbers[:, :, :3].transpose(0, 2, 1).reshape(len(chosen), -1)
        states = np.hstack([states, np.tile(self.acting, (len(chosen), 1))])
        words = [self.words([options[j][4] for j in self.joints]) for options in chosen]
        return DelayedStates(states, np.full(len(chosen), self.t), numbers[:, :, 3], words)

    def words(self, what: list[str]) -> str:
        """`"joints 1, 2 overshooting, joint 4 delayed"` of what the listed joints do."""
        words = []
        for word in dict.fromkeys(what):
            numbers = [int(j) + 1 for j, one in zip(self.joints, what, strict=True) if one == word]
            words.append(f"{numbered('joint', numbers)} {word}")
        return ", ".join([*words, self.of_base] if self.of_base else words)


def _worst_combinations(every: list[_Instant], cases: WorstCase) -> DelayedStates:
    """The combinations of each instant that are the worst for a moment, by slopes, and those that are the
    worst for friction.

    At the worst instants of each they are the worst that exchanging the case of one joint at a time leads to.
    """
    n = len(every[0].options)
    counts = np.array([[len(of_joint) for of_joint in instant.options] for instant in every])
    options = np.full((len(every), n, np.max(counts), 4), np.nan)
    given = np.arange(options.shape[2]) < counts[:, :, None]
    options[given] = [way[:4] for instant in every for of_joint in instant.options for way in of_joint]
    acting = np.array([instant.acting for instant in every])
    number = chosen_by_slopes(options, cases, acting, range(cases.axes))[0].tolist()
    instants, slips = slipping(options, cases, acting)
    tips = {(i, choice) for i, picked in enumerate(number) for choice in map(tuple, picked)}
    chosen = sorted(tips.union(zip(instants.tolist(), map(tuple, slips.tolist()), strict=True)))
    rows, choices = np.array([i for i, _ in chosen]), np.array([choice for _, choice in chosen])
    numbers = options[rows[:, None], np.arange(n), choices]  # (C, n, 4)
    states = np.hstack([numbers[..., :3].transpose(0, 2, 1).reshape(len(rows), -1), acting[rows]])
    words = []
    for i, choice in chosen:
        by_joint = every[i].options
        words.append(every[i].words([by_joint[j][choice[j]][4] for j in every[i].joints]))
    return DelayedStates(states, np.array([instant.t for instant in every])[rows], numbers[..., 3], words)


def combinations(options: list[list[T]], most: int = MOST) -> list[tuple[T, ...]]:
    """All combinations, or if they are more than `most`, those in which all joints but one have the same
    case.
    """
    if prod(map(len, options)) <= most:
        return list(product(*options))
    results = []
    for k in range(max(map(len, options))):
        usual = [option[min(k, len(option) - 1)] for option in options]
        results.append(tuple(usual))
        for j, option in enumerate(options):
            results += [(*usual[:j], other, *usual[j + 1 :]) for other in option if other is not usual[j]]
    return results
