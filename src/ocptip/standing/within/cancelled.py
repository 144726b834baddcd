"""Stops of a cancelled motion at the worst of an uncertainty.

All deviations count in every state of a stop. Around the steps of its acceleration (where it begins to
decelerate, where it rests) a joint may be delayed, or its acceleration may overshoot: in all combinations of
the joints, of which the worst for each moment and for slip is taken by slopes. A joint that is faster than
planned also counts as decelerating harder, by the square.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ocptip.standing.stops.by_cancel import Cancel, StopStates, stop_states
from ocptip.standing.within.in_motion import EXACT, WorstInstant, worst_slip_of, worst_tip_of
from ocptip.standing.within.late_joints import CLOSER, DelayedStates, worst_options
from ocptip.standing.within.worst_case import WorstCase
from ocptip.trajectories.trajectory import Trajectory

_STEP = 1e-9  # s


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


def _states(
    cases: WorstCase, motion: Trajectory, cancel: Cancel, times: np.ndarray, functions: Sequence[int]
) -> DelayedStates:
    """States of the stops, and those at steps of accelerations that are worst for some functions."""
    acting = cases.deviations.robot.during(motion)
    process = acting.acting(times)
    start, rate = motion.states(times), np.array(cancel.decelerations)
    at = stop_states(*start[:2], rate)
    own = np.hstack([at.q, at.qd, at.qdd, process[at.owner]])
    late, more = cases.deviations.tolerance.late, cases.deviations.tolerance.overshoot
    rests = np.abs(start[1]) / rate
    since = at.after[:, None] - np.where(at.qdd != 0, 0.0, rests[at.owner])
    words = [_after(after) for after in at.after.tolist()]
    found = DelayedStates(own, times[at.owner], np.clip(since, 0.0, late), words)
    if not (late or more):
        return found
    options, when, stop = _options(start, at, rate, late, more)
    number, values, _ = worst_options(options, cases, process[stop], functions=functions, most=CLOSER)
    for k in range(values.shape[1]):
        rows = np.argsort(-values[:, k], kind="stable")[:EXACT]
        chosen = options[rows[:, None], np.arange(options.shape[1]), number[rows, k]]
        s = np.hstack([chosen[..., :3].transpose(0, 2, 1).reshape(len(rows), -1), process[stop[rows]]])
        step = [f"{_after(float(when[row]))}, joints delayed or overshooting" for row in rows]
        found = found.joined(DelayedStates(s, times[stop[rows]], chosen[..., 3], step))
    return found


def _after(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms after the joints began to decelerate"


def _options(
    start: tuple[np.ndarray, np.ndarray, np.ndarray],
    at: StopStates,
    rate: np.ndarray,
    late: float,
    more: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The possible delayed states of each joint just after steps of accelerations.

    Returns:
        (D, n, K, 4): angle, speed, acceleration and maximum delay, NaN beyond these; (D,), s, after the
        joints began to decelerate; (D,) the stop.
    """
    rows = np.flatnonzero(at.before | (at.after == 0))
    stop, when = at.owner[rows], at.after[rows]
    q, qd, qdd = (part[stop] for part in start)
    rests, sign = np.abs(qd) / rate, np.sign(qd)
    ends, from_start = q + 0.5 * qd * rests, when[:, None] < late + _STEP
    moves = rests > when[:, None] + _STEP
    way = np.minimum(when[:, None], rests)
    now = q + way * (qd - 0.5 * sign * rate * way), np.where(moves, qd - sign * rate * way, 0.0)
    since = when[:, None] - np.where(moves, 0.0, rests)
    stops = ~moves & (since < late + _STEP)
    none, slower = np.zeros_like(q), -sign * rate
    options = [(*now, np.where(moves, slower, 0.0), np.clip(since, 0.0, late), np.ones_like(moves))]
    if late:
        options.append((q, qd, qdd, late - when[:, None] + none, from_start))
        options.append((ends, none, slower, np.minimum(late - since, rests), stops & (qd != 0)))
    if more:
        options.append((q, qd, slower + more * (slower - qdd), none, from_start))
        options.append((ends, none, -more * slower, none, stops & (qd != 0)))
    found = np.stack([np.stack(np.broadcast_arrays(*way[:4]), axis=-1) for way in options], axis=2)
    known = np.stack([np.broadcast_to(way[4], q.shape) for way in options], axis=2)
    order = np.argsort(~known, axis=2, kind="stable")
    found = np.where(known[..., None], found, np.nan)
    return np.take_along_axis(found, order[..., None], axis=2), when, stop
