"""Parameters out of recorded loads that are linear in them, with their covariance.

The motion is taken as it was planned, from the begin that the angles say; joints that are late have their
own. What is left of a delay of each kind of signals is a parameter. Every signal is whitened by the
autoregressive noise that the parameters leave over (`regression.whitened`), so that vibrations and filters
count as the noise that they are. Directions of parameters that no signal tells stay as described.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import stats

from ocptip.basics.errors import InputError
from ocptip.measured.clocks import AROUND, distance, find_clock
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import ANGLE, Recording, Signal
from ocptip.measured.regression import Block, whitened
from ocptip.measured.signals import resolution

_ROUNDS = 3
_QUIET = 1e-9  # rad, m: least noise of an angle
_LATE = 4.0  # standard errors from which a joint has a delay of its own
_TINY = 0.25  # samples: step of slopes over time
_UNSEEN = 1e-9  # share of the largest eigenvalue of the scaled normal equations, and of a direction
CONFIDENCE = 0.95

Model = Callable[[str, np.ndarray, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Known loads (C, N) and columns (C, N, K) of C signals.

In: their kind; q, qd, qdd (N, n); what acts on the gripper if that varies, see `StandingMechanism.acting`.
"""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters and how sure they are.

    Attributes:
        values: (K,).
        covariance: (K, K); of the directions that are seen.
        seen: (K,) False where the recording does not tell a parameter: it is as described.
        freedom: degrees of freedom.
        residuals: rms of what is left by kind of signals, SI.
        delays: s, by kind: how late they are after the joints.
    """

    values: np.ndarray
    covariance: np.ndarray
    seen: np.ndarray
    freedom: int
    residuals: Mapping[str, float]
    delays: Mapping[str, float]

    @property
    def errors(self) -> np.ndarray:
        """(K,) standard errors; infinite where a parameter is not seen."""
        return np.where(self.seen, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)), np.inf)

    @property
    def half(self) -> np.ndarray:
        """(K,) half widths of the 95 % intervals."""
        return float(stats.t.isf(0.5 * (1 - CONFIDENCE), self.freedom)) * self.errors


class Ran:
    """A motion as it was run.

    Args:
        recording: of it.
        predictor: of robot and plan.

    Raises:
        InputError: no signal follows the motion.
    """

    def __init__(self, recording: Recording, predictor: Predictor) -> None:
        self.recording, self.predictor = recording, predictor
        first, single = find_clock(recording, predictor)
        angles = recording.of(ANGLE)
        own = [single[one.name] for one in angles if np.isfinite(single.get(one.name, np.nan))]
        self.begin = float(np.median(own)) if own else first  # of most joints
        self.begins = np.full(predictor.robot.n, self.begin)
        if angles:
            self._refine(angles)

    def _refine(self, angles: Sequence[Signal]) -> None:
        """One begin by all angles; their own of joints that differ by more than their errors explain."""
        times, joints = self.recording.times, [one.index for one in angles]
        weights = np.zeros(len(angles))
        for _ in range(_ROUNDS):
            q, qd, _ = self.predictor.states(times, self.begins)
            later = np.zeros(len(angles))
            for k, one in enumerate(angles):
                good = np.isfinite(one.values)
                slope = qd[good, one.index] - qd[good, one.index].mean()
                away = one.values[good] - q[good, one.index]
                away = away - away.mean()
                square = float(slope @ slope)
                if square > 0:
                    later[k] = -float(slope @ away) / square
                    noise = float(np.std(away + later[k] * slope))
                    weights[k] = square / max(noise, _QUIET) ** 2
            self.begins[joints] += later
        told = weights > 0
        found = self.begins[joints]
        order = np.argsort(found)  # the median by weights: a joint that is late does not turn it
        common = float(found[order[np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())]])
        late = told & ((found - common) ** 2 * weights > _LATE**2)
        self.begin = self.begins[:] = common
        self.begins[joints] = np.where(late, found, common)

    @cached_property
    def away(self) -> np.ndarray:
        """(N,) True away from instants at which accelerations jump."""
        events = np.unique(self.predictor.jumps[:, None] + np.unique(self.begins))
        return distance(self.recording.times, events) > AROUND * self.recording.period

    def states(self, lag: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """q, qd, qdd, (N, n) each, and a process that varies, that signals show which are late by this."""
        times = self.recording.times - lag
        acting = self.predictor.robot.acting(times - self.begin)
        return *self.predictor.states(times, self.begins), acting


def estimate(
    ran: Ran,
    measured: Mapping[str, np.ndarray],
    model: Model,
    first: np.ndarray,
    *,
    free_zeros: Sequence[str] = (),
    kept: Callable[[str, int, np.ndarray], np.ndarray] | None = None,
) -> Estimate:
    """Least squares.

    Args:
        ran: the motion.
        measured: (C, N) by kind of signals; nan where a sample is missing.
        model: what they should be.
        first: (K,) parameters as described.
        free_zeros: kinds whose signals may each be shifted by a constant.
        kept: samples of a signal that count, by kind, number and speeds (N, n).

    Raises:
        InputError: fewer samples than parameters.
    """
    kinds, values = list(measured), np.asarray(first, dtype=float)
    lags, K, step = dict.fromkeys(kinds, 0.0), len(first), _TINY * ran.recording.period
    zeros = sum(len(measured[kind]) for kind in free_zeros)
    covariance, seen, freedom, spread = np.zeros((K, K)), np.zeros(K, dtype=bool), 1, {}
    for _ in range(_ROUNDS):
        blocks, owners, zero = [], [], K + len(kinds)
        for at, kind in enumerate(kinds):
            states = ran.states(lags[kind])
            known, columns = model(kind, *states)
            ends = [np.add(*_loads(model(kind, *ran.states(lags[kind] + s)), values)) for s in (step, -step)]
            later = (ends[0] - ends[1]) / (2 * step)
            for c, y in enumerate(measured[kind]):
                own = np.zeros((len(y), K + len(kinds) + zeros))
                own[:, :K], own[:, K + at] = columns[c], later[c]
                if kind in free_zeros:
                    own[:, zero] = 1.0
                    zero += 1
                good = np.isfinite(y) & ran.away
                if kept is not None:
                    good &= kept(kind, c, states[1])
                if good.sum() > 10 and own[good].any():
                    blocks.append(Block(y - known[c] - columns[c] @ first, own, good, resolution(y)))
                    owners.append(kind)
        if sum(int(block.kept.sum()) for block in blocks) <= 2 * K:
            raise InputError(f"recording: too few samples of {', '.join(kinds)} for {K} parameters")
        change, spread_of, unseen, freedom, left = _solved(blocks)
        values = first + change[:K]
        lags = {kind: lags[kind] + float(change[K + at]) for at, kind in enumerate(kinds)}
        covariance, seen = spread_of[:K, :K], ~unseen[:K]
        spread = {
            kind: float(np.sqrt(np.mean([s**2 for s, own in zip(left, owners, strict=True) if own == kind])))
            for kind in dict.fromkeys(owners)
        }
    return Estimate(values, covariance, seen, freedom, spread, lags)


def _loads(parts: tuple[np.ndarray, np.ndarray], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return parts[0], parts[1] @ values


def _solved(blocks: Sequence[Block]) -> tuple[np.ndarray, np.ndarray, np.ndarray, int, list[float]]:
    """Values, covariance, which are not seen, degrees of freedom and what is left of each signal."""
    white = [whitened(block) for block in blocks]
    products = np.sum([one.products for one in white], axis=0)
    projections = np.sum([one.projections for one in white], axis=0)
    size = np.sqrt(np.diag(products))
    scale = np.where(size > 0, size, 1.0)
    roots, axes = np.linalg.eigh(products / np.outer(scale, scale))
    told = roots > _UNSEEN * roots[-1]
    inverse = (axes[:, told] / roots[told]) @ axes[:, told].T / np.outer(scale, scale)
    unseen = np.sum(axes[:, ~told] ** 2, axis=1) > 1e-6
    found = inverse @ projections
    left = [float(np.std((b.values - b.columns @ found)[b.kept])) for b in blocks]
    freedom = max(sum(one.count for one in white) - int(told.sum()), 1)
    return found, inverse, unseen, freedom, left
