"""How far loads are beyond half spaces of friction, over all combinations of what is uncertain.

Contacts hold a wrench w with a share of their friction where a . w <= 0 for all half spaces a of
`Slip.half_spaces`. For one of them the worst combination is the worst case of every joint, and the worst end
of every deviation, each by itself: up to products of small numbers no other one goes farther. So no search
over combinations can miss it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ocptip.standing.within.deviations import Deviations

_CHUNK = 32  # instants that are evaluated at once
_ROUNDING = 1e-9  # relative, of a bound that leaves half spaces out


class Beyond(NamedTuple):
    """P pairs of an instant and a half space, those of one instant together, the worst first.

    Attributes:
        instants, planes: (P,) numbers of them.
        number: (P, n) which case of every joint is the worst.
        theta: (P, size) the worst deviations there.
        values: (P,), N, how far the load is beyond at most, to first order.
    """

    instants: np.ndarray
    planes: np.ndarray
    number: np.ndarray
    theta: np.ndarray
    values: np.ndarray


def farthest(
    deviations: Deviations,
    options: np.ndarray,
    acting: np.ndarray,
    planes: np.ndarray,
    above: float | None,
    most: int,
) -> Beyond:
    """The half spaces that loads are farthest beyond, with the combination that is the worst for each.

    Args:
        deviations: of an arm on its base.
        options: (D, n, K, 4) at D instants: angle, speed, acceleration, maximum delay; NaN beyond these.
        acting: (D, 6) what a process is that varies; else (D, 0).
        planes: (m, 6), see `Slip.half_spaces`.
        above: N, pairs that go no farther are left out; None: those that go less far than the usual cases do
            beyond any half space of the instant, so that every instant has one.
        most: number of half spaces of an instant.
    """
    count, n = options.shape[:2]
    here, s = selected(options, np.arange(count), usual_cases(options), acting)
    wrenches, over = deviations.wrench_and_slopes(s, deviations.nominal(count))
    moved = np.zeros((count, 6, n, 1))
    if options.shape[2] > 1:
        every, theta = np.tile(np.eye(6), (count, 1)), np.repeat(deviations.nominal(count), 6, axis=0)
        slopes = deviations.state_slopes(np.repeat(s, 6, axis=0), theta, every)[0]
        slopes = slopes.reshape(count, 6, s.shape[1])[:, :, : 3 * n].reshape(count, 6, 3, n)
        moved = np.einsum("dwcj,djkc->dwjk", slopes, options[..., :3] - here[:, :, None, :3])
    late, delay_place = np.zeros((count, 6, n)), deviations.places.get("delay")
    if delay_place is not None:
        late, over = over[:, :, delay_place].copy(), over.copy()
        over[:, :, delay_place] = 0.0  # the maximum delay is that of a case
    max_delay = np.nan_to_num(options[..., 3])
    middle, half, radii = _intervals(deviations, count)
    usually = wrenches @ planes.T
    least = np.max(usually, axis=1) if above is None else np.full(count, above)
    # Component by component deviations reach at least as far as along any plane: what cannot be the worst
    # by that bound, nearly everything, is left out.
    reach = np.einsum("dwt,dt->dw", np.abs(over), half) + _component_gains(moved, late, max_delay)
    for name, radius in radii.items():
        reach += radius * np.linalg.norm(over[:, :, deviations.places[name]], axis=2)
    bound = (wrenches + np.einsum("dwt,dt->dw", over, middle)) @ planes.T + reach @ np.abs(planes).T
    needed = np.maximum(least, np.max(usually, axis=1)) if most == 1 else least
    able = bound >= (needed - _ROUNDING * np.max(np.abs(bound), axis=1, initial=0.0))[:, None]
    near = np.flatnonzero(np.any(able, axis=1))

    parts = []
    for k in range(0, max(len(near), 1), _CHUNK):
        chunk = near[k : k + _CHUNK]
        some = np.flatnonzero(np.any(able[chunk], axis=0))
        change = planes[some] @ over[chunk]  # (C, m, size)
        values = usually[np.ix_(chunk, some)] + (change @ middle[chunk, :, None])[..., 0]
        values += (np.abs(change) @ half[chunk, :, None])[..., 0]
        for name, radius in radii.items():
            values += radius * np.linalg.norm(change[:, :, deviations.places[name]], axis=2)
        gains = _gains(planes[some], moved[chunk], late[chunk], max_delay[chunk])
        values += np.sum(np.max(gains, axis=3), axis=2)
        values = np.maximum(values, usually[np.ix_(chunk, some)])  # but for rounding
        best = np.argsort(-values, axis=1, kind="stable")[:, :most]
        i, rank = np.nonzero(np.take_along_axis(values, best, axis=1) >= least[chunk, None])
        parts.append((chunk[i], some[best[i, rank]], values[i, best[i, rank]]))
    instants, numbers, values = (np.concatenate(part) for part in zip(*parts, strict=True))

    a = planes[numbers]
    gains = _gains(a[:, None], moved[instants], late[instants], max_delay[instants])[:, 0]
    number = np.argmax(gains, axis=2)
    slopes = np.einsum("pw,pwt->pt", a, over[instants])
    theta = deviations.some(instants).least(-slopes, np.zeros((len(instants), n)))
    if delay_place is not None:
        worse = np.einsum("pw,pwj->pj", a, late[instants]) > 0
        theta[:, delay_place] = worse * max_delay[instants[:, None], np.arange(n), number]
    return Beyond(instants, numbers, number, theta, values)


def usual_cases(options: np.ndarray) -> np.ndarray:
    """Numbers (D, n) of the cases of joints that move as commanded: the last ones."""
    return np.sum(~np.isnan(options[..., 0]), axis=2) - 1


def selected(
    options: np.ndarray, row: np.ndarray, number: np.ndarray, acting: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Options (R, n, 4) of instants (R,) by numbers (R, n), and the states (R, 3 n or more) of these."""
    option = options[row[:, None], np.arange(options.shape[1]), number]
    states = option[..., :3].transpose(0, 2, 1).reshape(len(row), 3 * options.shape[1])
    return option, np.hstack([states, acting[row]])


def _gains(planes: np.ndarray, moved: np.ndarray, late: np.ndarray, max_delay: np.ndarray) -> np.ndarray:
    """(C, m, n, K), N, by how much farther the cases of joints go than the usual ones; -inf beyond these."""
    count, _, n, kinds = moved.shape
    gains = (planes @ moved.reshape(count, 6, n * kinds)).reshape(count, planes.shape[-2], n, kinds)
    gains = gains + np.maximum(planes @ late, 0.0)[..., None] * max_delay[:, None]
    return np.where(np.isnan(gains), -np.inf, gains)


def _component_gains(moved: np.ndarray, late: np.ndarray, max_delay: np.ndarray) -> np.ndarray:
    """(C, 6), N and N m: at least the change of each component of the wrench by the cases of joints."""
    changes = np.abs(np.nan_to_num(moved)) + np.abs(late)[..., None] * max_delay[:, None]
    return np.sum(np.max(changes, axis=3), axis=2)


def _intervals(deviations: Deviations, count: int) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    """Middles and half lengths (D, size) of deviations, less the nominal ones, and radii of the others.

    The radius of gravity is that of a ball around the cap of a tilt.
    """
    nominal, intervals = deviations.nominal(count), deviations.intervals
    middle, half = np.zeros_like(nominal), np.zeros_like(nominal)
    low, high = deviations.low[..., intervals], deviations.high[..., intervals]
    middle[:, intervals], half[:, intervals] = (low + high) / 2 - nominal[:, intervals], (high - low) / 2
    return middle, half, deviations.radii
