"""Stops of a cancelled motion at the worst of an uncertainty.

All deviations count in every state of a stop. Around the steps of its acceleration (those of the motion,
where it begins to decelerate, where it rests) a joint may be delayed, or its acceleration may overshoot. Of
all combinations of the joints the worst for each moment is taken by slopes, and the worst for slip, see
`worst_options`. A joint that is faster than planned also counts as decelerating harder, by the square.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ocptip.reserves.equal_compliance import equally_compliant
from ocptip.standing.contact_margins import Margin
from ocptip.standing.stops.by_cancel import NEAR, Cancel, meanwhile
from ocptip.standing.stops.joint_stops import SLOW
from ocptip.standing.within.alike import friction_if_alike
from ocptip.standing.within.in_motion import EXACT, WorstInstant, worst_slip_of, worst_tip_of
from ocptip.standing.within.late_joints import DelayedStates, Events
from ocptip.standing.within.worst_case import WorstCase
from ocptip.standing.within.worst_options import chosen_by_slopes, slipping
from ocptip.trajectories.trajectory import INSIDE, Trajectory

_STEP = 1e-9  # s
_SOON = 1e-5  # s after a joint starts to move: it is fast enough that a cancel decelerates it
_MOST = 8  # states of a joint with the smallest accelerations, and with the largest; more have recordings


def worst_of_cancels(
    cases: WorstCase, motion: Trajectory, cancel: Cancel, times: np.ndarray
) -> Iterator[WorstInstant | None]:
    """The worst instants for tip-over (None: no tipping axis), then for slip, which takes longer (None: at
    most `WorstCase.enough`).

    Their times are when the joints begin to decelerate.

    Args:
        cases: of the arm within its uncertainty.
        motion, cancel: that is cancelled, and how it stops.
        times: (N,), s, when joints begin to decelerate.
    """
    every = range(cases.axes + 1)
    if cases.axes:
        yield worst_tip_of(cases, _states(cases, motion, cancel, times, every[:-1]))
    else:
        yield None
    yield worst_slip_of(cases, _states(cases, motion, cancel, times, every[-1:]))


def alike_of_cancels(
    cases: WorstCase, motion: Trajectory, cancel: Cancel, times: np.ndarray
) -> Margin | None:
    """Share of the friction that equally compliant feet use in these stops, at least; None where only the
    best sharing of the load counts.
    """
    if equally_compliant(cases.footing.support) is None:
        return None
    return friction_if_alike(cases, _states(cases, motion, cancel, times, (cases.axes,)))


def _states(
    cases: WorstCase, motion: Trajectory, cancel: Cancel, times: np.ndarray, functions: Sequence[int]
) -> DelayedStates:
    """States of the stops, and those at steps of accelerations that are worst for some functions."""
    acting = cases.deviations.robot.during(motion)
    events = Events(motion, cases.deviations.tolerance)
    if (events.delay or events.more) and len(events.times) * NEAR < motion.end:  # else it is a recording
        starting = np.any(events.jumps & (np.abs(events.qd) < SLOW), axis=1)
        times = np.unique(np.concatenate([times, events.times, events.times[starting] + _SOON]))
    q, qd, _ = motion.states(times)
    rate = cancel.rates(qd)
    states, acts = meanwhile(acting, cancel, (times, q, qd), acting.acting(times), events.more)
    rows_of_states = np.hstack([states.q, states.qd, states.qdd, acts])
    since = states.after[:, None] - np.where(states.qdd != 0, 0.0, (np.abs(qd) / rate)[states.owner])
    words = [_after(after) for after in states.after.tolist()]
    delayed_states = DelayedStates(
        rows_of_states, times[states.owner], np.clip(since, 0.0, events.delay), words
    )
    if not (events.delay or events.more):
        return delayed_states
    rows = np.flatnonzero(states.before | (states.after == 0))
    stop, when = states.owner[rows], states.after[rows]
    options = _options(events, times[stop], when, rate[stop])
    if functions[0] == cases.axes:
        picked, number = slipping(options, cases, acts[rows])
    else:
        number, values = chosen_by_slopes(options, cases, acts[rows], functions)
        worst = np.argsort(-values, axis=0, kind="stable")[:EXACT].T  # (F, EXACT)
        picked = worst.ravel()
        number = np.concatenate([number[some, k] for k, some in enumerate(worst)])
    chosen = options[picked[:, None], np.arange(options.shape[1]), number]
    joints = chosen[..., :3].transpose(0, 2, 1).reshape(len(picked), 3 * options.shape[1])
    step = [f"{_after(float(when[row]))}, joints delayed or overshooting" for row in picked]
    s = np.hstack([joints, acts[rows[picked]]])
    return delayed_states.joined(DelayedStates(s, times[stop[picked]], chosen[..., 3], step))


def _after(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms after the joints began to decelerate"


def _options(events: Events, begun: np.ndarray, when: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """The possible delayed states of each joint after a cancel.

    The steps of its acceleration are those of the motion, the cancel, and its rest. Around each in the delay
    it is before the step, or overshoots by a sum of steps up to it: by the minimum or the maximum of these.

    Args:
        events: of the motion.
        begun: (D,), s, when joints begin to decelerate.
        when: (D,), s, after that.
        rate: (D, n) decelerations.

    Returns:
        (D, n, K, 4): angle, speed, acceleration and maximum delay; NaN beyond these.
    """
    late, now, low = events.delay, begun + when, begun + when - events.delay
    (q, qd, _), qdd = events.motion.states(begun), events.motion.states(begun + INSIDE)[2]
    rests, slower, none = np.abs(qd) / rate, -np.sign(qd) * rate, np.zeros_like(qd)
    way = np.minimum(when[:, None], rests)
    moves = rests > when[:, None] + _STEP
    on_time = q + way * (qd + 0.5 * slower * way), np.where(moves, qd + slower * way, 0.0)

    first = np.searchsorted(events.times, low - INSIDE)
    last = np.searchsorted(events.times, begun + INSIDE, side="right")
    event = last[:, None] - np.arange(np.max(last - first, initial=0), 0, -1)  # (D, M), the latest at the end
    inside, event = event >= first[:, None], np.maximum(event, 0)

    def steps(of_motion: np.ndarray, at_cancel: np.ndarray, at_rest: np.ndarray) -> np.ndarray:
        """(D, M + 2, n)."""
        return np.concatenate([of_motion, at_cancel[:, None], at_rest[:, None]], axis=1)

    moment = steps(events.times[event][..., None] + none[:1], begun[:, None] + none, begun[:, None] + rests)
    there = steps(events.q[event], q, q + 0.5 * qd * rests), steps(events.qd[event], qd, none)
    before = steps(events.before[event], qdd, slower)
    step = steps(events.after[event], slower, none) - before
    known = steps(
        events.jumps[event] & inside[..., None],
        np.abs(slower - qdd) > events.small,
        (qd != 0) & ~moves,
    )
    known &= moment > low[:, None, None] - _STEP
    latest = np.maximum.accumulate(np.where(known, moment, low[:, None, None]), axis=1)
    since = np.clip(now[:, None] - latest[:, -1], 0.0, late)
    options = [np.stack([*on_time, np.where(moves, slower, 0.0), since], axis=-1)[:, None]]
    given = [np.ones_like(known[:, :1])]
    if late:
        then = events.motion.states(np.where(when < late, low, begun))
        until = np.take_along_axis(before, np.argmax(known, axis=1)[:, None], axis=1)[:, 0]
        options.append(np.stack([*then, none], axis=-1)[:, None])
        given.append(((when < late)[:, None] & (np.abs(then[2] - until) > events.small))[:, None])
        max_delay = np.diff(latest, axis=1, prepend=low[:, None, None] + none[:, None])
        options.append(np.stack([*there, before, max_delay], axis=-1))
        given.append(known)
    if events.more:
        indices = np.where(known, step, 0.0)
        sums = np.cumsum(indices, axis=1)
        for extreme in (np.maximum, np.minimum):
            more = events.more * (sums - extreme.accumulate(sums - indices, axis=1))
            options.append(np.stack([*there, before + step + more, np.zeros_like(more)], axis=-1))
            given.append(known)
    result, known = np.concatenate(options, axis=1), np.concatenate(given, axis=1)
    acceleration = np.where(known, result[..., 2], np.inf)
    rank = np.argsort(np.argsort(acceleration, axis=1, kind="stable"), axis=1)
    known &= (rank < _MOST) | (rank >= np.sum(known, axis=1, keepdims=True) - _MOST)
    order = np.argsort(~known, axis=1, kind="stable")[:, : int(np.max(np.sum(known, axis=1)))]
    result = np.where(known[..., None], result, np.nan)
    return np.take_along_axis(result, order[..., None], axis=1).swapaxes(1, 2)
