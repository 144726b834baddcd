"""Which of the possible states of every joint at an instant are the worst, together, for the contacts.

Of moments about tipping axes, and of friction where it has no half spaces, these are chosen by slopes, and at
the worst instants no other state of a single joint is worse. For a half space of friction the worst states
are those of every joint by itself, see `half_spaces`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ocptip.reserves.slip import known
from ocptip.standing.within.half_spaces import farthest, selected, usual_cases
from ocptip.standing.within.worst_case import WorstCase

_CHOICES = 2  # how often they are chosen, by the slopes at what was chosen before
_WORST = 16  # instants, of each moment and of the slip reserve, at which other ways are tried joint by joint
_EXCHANGES = 8  # times, at most
_WORSE = 1e-9  # N m, or of GT: by less another way is not worse
CLOSER = 200  # instants, for each moment and for friction, at which the worst are searched
_PLANES, _TRIED = 4, 64  # half spaces of an instant, and combinations of all, whose friction is evaluated


def worst_options(
    options: np.ndarray,
    cases: WorstCase,
    acting: np.ndarray,
    matters: np.ndarray | None = None,
    functions: Sequence[int] | None = None,
    most: int | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which case of every joint is worst for each moment and for friction, by their slopes.

    Args:
        options: (D, n, K, 4) at D instants: angle, speed, acceleration, maximum delay; NaN beyond these.
        cases: the functions, F of them.
        acting: (D, 6) what a process is that varies; else (D, 0).
        matters: where a function, of all, stays below this by its slopes, it is not checked more closely.
        functions: F numbers of those that are evaluated, see `WorstCase.function`; default: all.
        most: number of instants, for each function, that are checked more closely: those with the largest
            values by the slopes; default: all.

    Returns:
        Numbers (D, F, n) of cases; the functions' values there, (D, F), and slopes (D, F, 3 n or more) over
        states; where a function does not matter, less precisely.
    """
    count, n = options.shape[:2]
    size = 3 * n + acting.shape[1]
    each = np.arange(cases.axes + 1) if functions is None else np.array(functions, dtype=int)
    number = np.repeat(usual_cases(options)[:, None], len(each), axis=1)
    values, slopes = np.empty((count, len(each))), np.empty((count, len(each), size))
    row, which = (index.ravel() for index in np.indices((count, len(each))))
    few = count if most is None else most
    for turn in range(1 + _CHOICES):
        chosen, states = selected(options, row, number[row, which], acting)
        if few < count:  # the same cases for every function; what is asked is which instants come first
            index = np.s_[:: len(each)]
            result = cases.estimated(states[index], each.tolist(), chosen[index, :, 3])
            values[row, which], result = result[0].ravel(), result[1].reshape(len(row), -1)
        else:
            values[row, which], result = cases.function(states, each[which], chosen[..., 3])
        slopes[row, which] = result[:, :size]
        if turn < _CHOICES:
            over = slopes[row, which, : 3 * n].reshape(-1, 3, n)
            gains = _gains(over, options[row])
            gained = np.sum(np.max(gains, axis=2), axis=1) - np.einsum("rsj,rjs->r", over, chosen[..., :3])
            number[row, which] = np.argmax(gains, axis=2)
            if few < count:
                estimated = np.zeros((count, len(each)))
                estimated[row, which] = values[row, which] + gained
                ranks = _ranks(estimated)
                kept, few = ranks[row, which] < few, count
                row, which, gained = row[kept], which[kept], gained[kept]
            if matters is not None:
                values[row, which] += gained
                kept = values[row, which] >= matters[each[which]]
                row, which = row[kept], which[kept]
    return number, values, slopes


def worst_beyond(
    options: np.ndarray,
    cases: WorstCase,
    acting: np.ndarray,
    planes: np.ndarray,
    above: float,
    most: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Which half spaces loads are farthest beyond, with the case of every joint that is worst for each.

    Args: see `farthest`.

    Returns:
        Of R pairs the instant (R,), numbers (R, n) of cases, slopes (R, 3 n or more) of the distance over the
        state, and the distance (R,), N.
    """
    result = farthest(cases.deviations, options, acting, planes, above, most)
    a, n = planes[result.planes], options.shape[1]

    def at(number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        chosen, states = selected(options, result.instants, number, acting)
        worst = cases.least(states, lambda wrench: (-np.einsum("rw,rw->r", a, wrench), -a), chosen[..., 3])
        return -worst.values, cases.deviations.state_slopes(states, worst.theta, a)[0]

    slopes = at(result.number)[1][:, : 3 * n].reshape(-1, 3, n)
    number = np.argmax(_gains(slopes, options[result.instants]), axis=2)
    values, slopes = at(number)
    return result.instants, number, slopes, values


def chosen_by_slopes(
    options: np.ndarray, cases: WorstCase, acting: np.ndarray, functions: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (D, F, n) of cases and values (D, F): by slopes, and exchanged at the worst instants.

    Args: see `worst_options`.
    """
    number, values, _ = worst_options(options, cases, acting, functions=functions, most=CLOSER)
    return exchanged(options, cases, acting, number, values, functions), values


def slipping(options: np.ndarray, cases: WorstCase, acting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Instants (R,) and numbers (R, n) of cases that use much friction, the worst of all combinations among
    them.

    A share of the friction is enough for all combinations if none goes beyond its half spaces. So that share
    is raised to what is used, until no combination beyond it uses more. Nothing where a share is enough that
    nobody asks about, see `WorstCase.enough`. Where there are no half spaces, or the base slides, so that GT
    counts its acceleration, combinations chosen by slopes are among them.

    Args: see `worst_options`.
    """
    slip, n = cases.footing.slip, options.shape[1]
    usual = usual_cases(options)
    s = selected(options, np.arange(len(options)), usual, acting)[1]
    wrenches = cases.deviations.wrench(s, cases.deviations.nominal(len(s)))[0]
    most, before = cases.enough or float(np.max(known(slip.greatest(wrenches)), initial=0.0)), -1.0
    instants, number = [np.empty(0, dtype=int)], [np.empty((0, n), dtype=int)]
    while (level := max(slip.level_below(most), cases.enough)) > before:
        if (planes := slip.half_spaces(level)) is None:
            break
        beyond, before = farthest(cases.deviations, options, acting, planes, 0.0, _PLANES), level
        some = np.argsort(-beyond.values, kind="stable")[:_TRIED]
        instants.append(beyond.instants[some])
        number.append(beyond.number[some])
        if len(some):
            chosen, states = selected(options, instants[-1], number[-1], acting)
            most = max(most, float(np.max(known(cases.slip(states, max_delay=chosen[..., 3]).values))))
    if before < 0 or most >= 1:
        by_slopes, values = chosen_by_slopes(options, cases, acting, [cases.axes])
        some = np.argsort(-values[:, 0], kind="stable")[:_TRIED]
        instants.append(some)
        number.append(by_slopes[some, 0])
    return np.concatenate(instants), np.concatenate(number)


def _ranks(values: np.ndarray) -> np.ndarray:
    """Of each value (D, F) in its column; 0: the largest."""
    return np.argsort(np.argsort(-values, axis=0, kind="stable"), axis=0)


def _gains(slopes: np.ndarray, options: np.ndarray) -> np.ndarray:
    """(R, n, K), what options (R, n, K, 4) contribute by slopes (R, 3, n) over the state."""
    gains = np.einsum("rsj,rjks->rjk", slopes, options[..., :3])
    return np.where(np.isnan(gains), -np.inf, gains)


def exchanged(
    options: np.ndarray,
    cases: WorstCase,
    acting: np.ndarray,
    number: np.ndarray,
    values: np.ndarray,
    functions: Sequence[int] | None = None,
) -> np.ndarray:
    """Numbers (D, F, n) of cases of which, at the worst instants, no other of a single joint is worse.

    Args and functions: see `worst_options`, whose numbers and values these are.
    """
    number, values = number.copy(), values.copy()
    each = np.arange(values.shape[1]) if functions is None else np.array(functions, dtype=int)
    ranks = _ranks(values)
    row, which = np.nonzero(ranks < _WORST)
    for _ in range(_EXCHANGES):
        option = number[row, which]  # (R, n)
        other = np.arange(options.shape[2]) != option[:, :, None]
        r, joint, way = np.nonzero(other & ~np.isnan(options[row][..., 0]))
        if not len(r):
            break
        tried = option[r]
        tried[np.arange(len(r)), joint] = way
        chosen, states = selected(options, row[r], tried, acting)
        result = cases.function(states, each[which[r]], chosen[..., 3])[0]
        order = np.argsort(-result, kind="stable")
        better, first = np.unique(r[order], return_index=True)
        best = order[first]
        worse = result[best] > values[row[better], which[better]] + _WORSE
        if not worse.any():
            break
        row, which = row[better[worse]], which[better[worse]]
        number[row, which], values[row, which] = tried[best[worse]], result[best[worse]]
    return number
