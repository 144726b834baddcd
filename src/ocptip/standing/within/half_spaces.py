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

_CHUNK = 20_000  # pairs of an instant and a half space that are evaluated at once


class Beyond(NamedTuple):
    """P pairs of an instant and a half space, those of one instant together, the worst first.

    Attributes:
        instants, planes: (P,) numbers of them.
        number: (P, n) which case of every joint is the worst.
        theta: (P, size) the worst deviations there.
        values: (P,), N, how far the load is beyond, to first order.
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
    above: float,
    most: int,
) -> Beyond:
    """The half spaces that loads are farthest beyond, with the combination that is the worst for each.

    Args:
        deviations: of an arm on its base.
        options: (D, n, K, 4) at D instants: angle, speed, acceleration, maximum delay; NaN beyond these.
        acting: (D, 6) what a process is that varies; else (D, 0).
        planes: (m, 6), see `Slip.half_spaces`.
        above: N, pairs that go no farther are left out.
        most: number of half spaces of an instant.
    """
    count, n = options.shape[:2]
    usual = np.sum(~np.isnan(options[..., 0]), axis=2) - 1
    here = options[np.arange(count)[:, None], np.arange(n), usual]
    s = np.hstack([here[..., :3].transpose(0, 2, 1).reshape(count, -1), acting])
    wrenches, over = deviations.wrench_and_slopes(s, deviations.nominal(count))
    moved = np.zeros((count, 6, n, 1))
    if options.shape[2] > 1:
        every, theta = np.tile(np.eye(6), (count, 1)), np.repeat(deviations.nominal(count), 6, axis=0)
        slopes = deviations.state_slopes(np.repeat(s, 6, axis=0), theta, every)[0]
        slopes = slopes.reshape(count, 6, -1)[:, :, : 3 * n].reshape(count, 6, 3, n)
        moved = np.einsum("dwcj,djkc->dwjk", slopes, options[..., :3] - here[:, :, None, :3])
    late, at = np.zeros((count, 6, n)), deviations.places.get("delay")
    if at is not None:
        late, over = over[:, :, at].copy(), over.copy()
        over[:, :, at] = 0.0  # the maximum delay is that of a case
    max_delay = options[..., 3]

    instants, numbers = _pairs(deviations, planes, wrenches, over, moved, late, max_delay, above)
    found = []
    for k in range(0, max(len(instants), 1), _CHUNK):
        i, a = instants[k : k + _CHUNK], planes[numbers[k : k + _CHUNK]]
        gains = np.einsum("pw,pwjk->pjk", a, moved[i])
        gains = gains + np.maximum(np.einsum("pw,pwj->pj", a, late[i]), 0.0)[:, :, None] * max_delay[i]
        gains = np.where(np.isnan(gains), -np.inf, gains)
        change = np.einsum("pw,pwt->pt", a, over[i])
        own = deviations.some(i)
        theta = own.least(-change, np.zeros((len(i), n)))
        values = np.einsum("pw,pw->p", a, wrenches[i]) + np.sum(np.max(gains, axis=2), axis=1)
        values += np.einsum("pt,pt->p", change, theta - own.nominal(len(i)))
        kept = np.flatnonzero(values > above)
        number = np.argmax(gains, axis=2)[kept]
        if at is not None:
            worse = np.einsum("pw,pwj->pj", a, late[i])[kept] > 0
            theta[kept, at] = worse * max_delay[i[kept][:, None], np.arange(n), number]
        found.append((i[kept], numbers[k : k + _CHUNK][kept], number, theta[kept], values[kept]))
    every = Beyond(*(np.concatenate(part) for part in zip(*found, strict=True)))
    order = np.lexsort((-every.values, every.instants))
    own = every.instants[order]
    order = order[np.arange(len(own)) - np.searchsorted(own, own) < most]
    return Beyond(*(part[order] for part in every))


def _pairs(
    deviations: Deviations,
    planes: np.ndarray,
    wrenches: np.ndarray,
    over: np.ndarray,
    moved: np.ndarray,
    late: np.ndarray,
    max_delay: np.ndarray,
    above: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Instants and half spaces that some combination may go beyond: none goes farther than a length."""
    scaling = np.r_[np.ones(3), np.full(3, 1 / deviations.robot.support.length)]
    size = float(np.max(np.linalg.norm(planes / scaling, axis=1), initial=0.0))
    span = np.maximum(np.abs(deviations.low), np.abs(deviations.high)) + np.abs(deviations.nominal(len(over)))
    for name, most in deviations.radii.items():
        span[:, deviations.places[name]] = most
    reach = np.einsum("dt,dt->d", np.linalg.norm(scaling[:, None] * over, axis=1), span)
    by_case = np.linalg.norm(scaling[:, None, None] * moved, axis=1)
    by_case = by_case + np.linalg.norm(scaling[:, None] * late, axis=1)[:, :, None] * max_delay
    reach += np.sum(np.nanmax(by_case, axis=2), axis=1)
    instants, numbers = np.nonzero(wrenches @ planes.T > above - size * reach[:, None])
    return instants, numbers
