"""Springs of joints fitted to angles and the gripper, from far away.

How springs swing depends on their stiffness as waves do on their frequency: sums of squares have many minima,
and a step along slopes ends in the nearest. So each spring is tried over a range of stiffness, the steps a
small part of a period at the motion's end, before all are fitted together. Noise counts as white here.
What angles tell of them, and of delays, has standard errors, within which loads may change it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from ocptip.measured.prediction import Elasticity, Predictor
from ocptip.measured.recording import ANGLE, GRIPPER, Signal
from ocptip.measured.signals import noise_of

_FACTORS = np.geomspace(0.4, 2.5, 37)  # of the bend: 2.5 % of a frequency each
_TIMES = 2  # that each spring is tried
_DAMPING = 1e-3, 1.0
_MOST = 40  # evaluations of the fit of all
DELAY, BEND, DAMP = "delay", "bend", "damping"
"""What `Loose` is about."""


@dataclass(frozen=True, eq=False)
class Swinging:
    """The signals that springs have to explain.

    Attributes:
        predictor: of the robot.
        signals: angles and gripper; others do not count.
        kept: of each signal (N,), True where samples count.
        times: (N,), s, of the motion.
        delays, changes: as for `Predictor.swing`.
        free: of each signal (N, K), what other causes change, whose size is free.
    """

    predictor: Predictor
    signals: Sequence[Signal]
    kept: Sequence[np.ndarray]
    times: np.ndarray
    delays: np.ndarray
    changes: np.ndarray
    free: Sequence[np.ndarray]

    def fitted(self, elastic: Elasticity) -> Elasticity:
        """Springs with bends and dampings of least squares; those that are stiff stay so."""
        springs = np.flatnonzero(elastic.bends > 0)
        left = self._left(elastic, springs)
        x = np.concatenate([np.log(elastic.bends[springs]), elastic.damping[springs]])
        for _ in range(_TIMES):
            before = x.copy()
            for k in range(len(springs)):
                tried = [x + np.log(factor) * (np.arange(len(x)) == k) for factor in _FACTORS]
                x = min([x, *tried], key=lambda at: float(np.sum(left(at) ** 2)))
            if np.array_equal(x, before):
                break
        low = np.concatenate([x[: len(springs)] - 1.0, np.full(len(springs), 0.5 * _DAMPING[0])])
        high = np.concatenate([x[: len(springs)] + 1.0, np.full(len(springs), 1.01 * _DAMPING[1])])
        x = optimize.least_squares(left, x, bounds=(low, high), x_scale=0.05, max_nfev=_MOST).x
        return self._with(elastic, springs, x)

    def _with(self, elastic: Elasticity, springs: np.ndarray, x: np.ndarray) -> Elasticity:
        bends, damping = elastic.bends.copy(), elastic.damping.copy()
        bends[springs] = np.exp(x[: len(springs)])
        damping[springs] = np.clip(x[len(springs) :], *_DAMPING)
        return replace(elastic, bends=bends, damping=damping)

    def _left(self, elastic: Elasticity, springs: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """A function of logarithms of bends, and dampings: what is left over, in units of noise."""
        q = self.predictor.states(self.times, self.delays)[0]
        place, slopes = self.predictor.gripper(q)
        rows, targets, columns = [], [], []
        for one, kept, others in zip(self.signals, self.kept, self.free, strict=True):
            if one.kind not in (ANGLE, GRIPPER):
                continue
            shown = np.where(elastic.seen, np.eye(len(elastic.bends))[one.index], 0.0) + np.zeros_like(q)
            planned, turn = (
                (q[:, one.index], shown) if one.kind == ANGLE else (place[:, one.index], slopes[:, one.index])
            )
            away = np.where(kept, one.values - planned, 0.0)
            noise = max(noise_of(away, kept), 1e-12)
            targets.append(away[kept] / noise)
            rows.append((kept, turn[kept] / noise))
            columns.append(others[kept] / noise)
        target, free = np.concatenate(targets), np.vstack(columns)
        size = np.linalg.norm(free, axis=0)
        own = np.linalg.svd(free[:, size > 0] / size[size > 0], full_matrices=False)
        basis = own[0][:, own[1] > 1e-8]

        def left(x: np.ndarray) -> np.ndarray:
            now = self._with(elastic, springs, x)
            bent = self.predictor.swing(self.times, self.delays, self.changes, now)[0]
            away = target - np.concatenate([np.sum(turn * bent[kept], axis=1) for kept, turn in rows])
            return away - basis @ (basis.T @ away)

        return left


@dataclass(frozen=True)
class Loose:
    """A delay, a bend or a damping of a joint, which is known with a standard error.

    Attributes:
        kind: `DELAY`, `BEND` or `DAMP`.
        joint: its number, from 0.
        error: s, rad / N m or a ratio.
    """

    kind: str
    joint: int
    error: float


def loosened(
    delays: np.ndarray, elastic: Elasticity, loose: Sequence[Loose], off: Sequence[float]
) -> tuple[np.ndarray, Elasticity]:
    """Delays and springs with the given differences."""
    delays, bends, damping = delays.copy(), elastic.bends.copy(), elastic.damping.copy()
    for one, more in zip(loose, off, strict=True):
        {DELAY: delays, BEND: bends, DAMP: damping}[one.kind][one.joint] += more
    return delays, Elasticity(np.maximum(bends, 0.0), np.clip(damping, *_DAMPING), elastic.seen)
