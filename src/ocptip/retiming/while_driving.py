"""Timing of a path while the base drives: limits depend on the place and on the time at which it is passed.

A timing is solved with what acts at the times of the timing before, in a window around them. Once places are
passed within their windows, the rows that were solved are those of the result. Where rounds do not come to
that, rows hold for everything that the base does from its start to its end, whenever a place is passed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.retiming.rows import PathClock
from ocptip.standing.limits import Limits
from ocptip.standing.tolerance import NONE
from ocptip.trajectories.drive_profile import DriveProfile
from ocptip.trajectories.path import PathTiming
from ocptip.trajectories.trajectory import INSIDE

_SHIFTS = 0.0, -1.0, -0.5, 0.5, 1.0  # of the window; the first clock is the timing itself
_WINDOWS = 0.02, 0.005  # of the duration, to either side: a narrow one is faster, where rounds come to it
_ROUNDS = 10
_STEP = 0.05  # s, between instants of a whole profile


def clocks_to_try(
    profile: DriveProfile, timed: Callable[[Limits, Sequence[PathClock]], PathTiming], limits: Limits
) -> Iterator[tuple[PathClock, ...]]:
    """Clocks with which to time a path: settled ones, then those that stand at every instant of the profile.

    The nominal model is quick: within an uncertainty its clocks are the beginning.

    Args:
        profile: of the base.
        timed: the timing within limits, with rows by clocks; without any the base rests.
        limits: of the result.

    Raises:
        InputError: with none of them the path can be timed; says why by the first.
    """
    plain = replace(limits, tolerance=NONE)
    timing, clocks, why = timed(plain, ()), None, None
    try:
        for kept in (plain, limits) if limits.tolerance.given else (limits,):
            clocks = _settled(partial(timed, kept), timing)
            timing = clocks[0].timing if clocks else timing
    except InputError as error:
        clocks, why = None, error
    if clocks:
        yield clocks
    every = _of_all_times(profile, timing)
    try:
        timed(limits, every)
    except InputError as error:
        if clocks is None:
            raise why or error from None
        return
    yield every


def _settled(
    solve: Callable[[Sequence[PathClock]], PathTiming], timing: PathTiming
) -> tuple[PathClock, ...] | None:
    """Clocks around a timing from which a timing by them is nowhere farther; None: no round comes to that."""
    settled, windows = None, list(_WINDOWS)
    for _ in range(_ROUNDS):
        window = windows[0] * timing.node_times[-1]
        clocks = tuple(PathClock(timing, share * window) for share in _SHIFTS)
        following = solve(clocks)
        if np.max(np.abs(following.node_times - timing.passes(following.s)[0])) <= window:
            settled = clocks
            del windows[0]
            if not windows:
                break
        timing = following
    return settled


def _of_all_times(profile: DriveProfile, timing: PathTiming) -> tuple[PathClock, ...]:
    """Clocks that stand at the instants of a profile, each with other accelerations."""
    edges = profile.knots
    times = [edges - INSIDE, edges + INSIDE, np.arange(0.0, profile.end + _STEP, _STEP)]
    every = np.unique(np.clip(np.concatenate(times), 0.0, profile.end + _STEP))
    _, first = np.unique(np.round(profile.rows(every), 9), axis=0, return_index=True)
    return tuple(PathClock(timing, fixed=float(time)) for time in every[np.sort(first)])
