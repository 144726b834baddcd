"""Parameters out of recorded loads that are linear in them, with their covariance.

The motion is taken as planned, from the begin that follows from the angles; delayed joints have separate
begins. The remaining delay of each kind of signals is a parameter. Every signal is whitened by the
autoregressive noise that the parameters leave over (`regression.whitened`), so that vibrations and filters
count as the noise that they are. Directions of parameters that no signal identifies stay nominal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import signal, stats

from ocptip.basics.errors import InputError
from ocptip.measured.clocks import AROUND, distance, find_clock
from ocptip.measured.low_pass import Band, LowPass, low_pass_of
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import ANGLE, Recording, Signal
from ocptip.measured.regression import Block, autoregression, coloured, whitened
from ocptip.measured.signals import resolution

_ROUNDS, _ROUNDS_FILTERED = 3, 5
_CUTOFF = 0.03  # standard error of the logarithm of a cutoff that was searched
_QUIET = 1e-9  # rad, m: least noise of an angle
_LATE = 4.0  # standard errors from which a joint has a delay of its own
_TINY = 0.25  # samples: step of slopes over time
_UNSEEN = 1e-9  # share of the largest eigenvalue of the scaled normal equations, and of a direction
_LEAST_SHARE = 0.1
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
        seen: (K,) False where the recording does not identify a parameter: it stays nominal.
        freedom: degrees of freedom.
        residuals: rms of what is left by kind of signals, SI.
        delays: s, by kind: delay after the joints.
        signals: each by itself: its kind, its number among those measured, rms of what is left, and rms of
            what plain least squares leaves.
        away: (K,) how far these are from plain least squares, in standard errors of the latter.
        low_passes: the filter of a kind of signals, where the signals identify one.
    """

    values: np.ndarray
    covariance: np.ndarray
    seen: np.ndarray
    freedom: int
    residuals: Mapping[str, float]
    delays: Mapping[str, float]
    signals: Sequence[tuple[str, int, float, float]]
    away: np.ndarray
    low_passes: Mapping[str, LowPass]

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
        known = [single[one.name] for one in angles if np.isfinite(single.get(one.name, np.nan))]
        self.begin = float(np.median(known)) if known else first  # of most joints
        self.begins = np.full(predictor.robot.n, self.begin)
        if angles:
            self._refine(angles)

    def _refine(self, angles: Sequence[Signal]) -> None:
        """One begin from all angles; a separate one for joints that differ by more than their errors."""
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
        seen = weights > 0
        begin = self.begins[joints]
        order = np.argsort(begin)  # the median by weights: a joint that is late does not turn it
        common = float(begin[order[np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())]])
        late = seen & ((begin - common) ** 2 * weights > _LATE**2)
        self.begin = self.begins[:] = common
        self.begins[joints] = np.where(late, begin, common)

    @cached_property
    def away(self) -> np.ndarray:
        """(N,) True away from acceleration steps."""
        events = np.unique(self.predictor.jumps[:, None] + np.unique(self.begins))
        return distance(self.recording.times, events) > AROUND * self.recording.period

    def states(self, lag: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """q, qd, qdd, (N, n) each, and a process that varies, as signals with this delay show them."""
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
    bandwidths: Mapping[str, float | None] | None = None,
) -> Estimate:
    """Least squares.

    Args:
        ran: the motion.
        measured: (C, N) by kind of signals; nan where a sample is missing.
        model: what they should be.
        first: (K,) nominal parameters.
        free_zeros: kinds whose signals may each be shifted by a constant.
        kept: samples of a signal that count, by kind, number and speeds (N, n).
        bandwidths: kinds whose low-pass filter is searched, with its cutoff, Hz, as far as it is known.

    Raises:
        InputError: fewer samples than parameters.
    """
    kinds, values = list(measured), np.asarray(first, dtype=float)
    lags, K, step = dict.fromkeys(kinds, 0.0), len(first), _TINY * ran.recording.period
    zeros = sum(len(measured[kind]) for kind in free_zeros)
    low_passes = dict[str, LowPass]()
    made, rounds = _Made(first, values), 0
    while True:
        made, zero = _Made(first, values), K + 2 * len(kinds)
        for index, kind in enumerate(kinds):
            states = ran.states(lags[kind])
            known, columns = model(kind, *states)
            ends = [np.add(*_loads(model(kind, *ran.states(lags[kind] + s)), values)) for s in (step, -step)]
            later = (ends[0] - ends[1]) / (2 * step)
            rows = []
            for c, y in enumerate(measured[kind]):
                offset_columns = np.zeros((len(y), K + 2 * len(kinds) + zeros))
                offset_columns[:, :K], offset_columns[:, K + index] = columns[c], later[c]
                if kind in free_zeros:
                    offset_columns[:, zero] = 1.0
                    zero += 1
                good = np.isfinite(y) & ran.away
                if kept is not None:
                    good &= kept(kind, c, states[1])
                if good.sum() > 10 and offset_columns[good].any():
                    rows.append(_Row(kind, c, y, known[c], offset_columns, good))
            if not rounds and kind in (bandwidths or {}) and rows:
                assert bandwidths is not None
                low_pass = low_pass_of(
                    [row.plain() for row in rows], 1 / ran.recording.period, bandwidths[kind]
                )
                low_passes |= {kind: low_pass} if low_pass else {}
            made.add(rows, low_passes.get(kind), K + len(kinds) + index)
        if sum(int(block.kept.sum()) for block in made.blocks) <= 2 * K:
            raise InputError(f"recording: too few samples of {', '.join(kinds)} for {K} parameters")
        prior = np.zeros(K + 2 * len(kinds) + zeros)
        prior[[K + len(kinds) + kinds.index(kind) for kind in low_passes]] = 1 / _CUTOFF**2
        change, spread_of, unseen, freedom = _solved(made.blocks, prior, together=bool(low_passes))
        values = first + change[:K]
        for index, kind in enumerate(kinds):
            if rounds or kind not in low_passes:  # slopes over time are worth little before there is friction
                lags[kind] += float(change[K + index])
        rounds += 1
        if rounds >= (_ROUNDS_FILTERED if low_passes else _ROUNDS):
            break
    plain, errors = plain_least_squares(made.blocks, prior)
    covariance, seen = spread_of[:K, :K], ~unseen[:K]
    left = made.left(change, low_passes), made.left(plain, low_passes)
    signals = [
        (row.kind, row.number, *rms) for row, rms in zip(made.rows, zip(*left, strict=True), strict=True)
    ]
    spread = {
        kind: float(
            np.sqrt(np.mean([rms**2 for offset_columns, _, rms, _ in signals if offset_columns == kind]))
        )
        for kind in dict.fromkeys(row.kind for row in made.rows)
    }
    away = np.where(seen, np.abs(change[:K] - plain[:K]) / np.maximum(errors[:K], 1e-300), 0.0)
    return Estimate(values, covariance, seen, freedom, spread, lags, signals, away, low_passes)


@dataclass(frozen=True, eq=False)
class _Row:
    """One signal of a round: what was measured, what is known, and columns (N, ...) of what is not."""

    kind: str
    number: int
    values: np.ndarray
    known: np.ndarray
    columns: np.ndarray
    kept: np.ndarray

    def plain(self) -> Block:
        """For the search of a filter: what is known also goes through it."""
        columns = np.column_stack([self.known, self.columns])
        return Block(
            self.values, columns[:, np.any(columns != 0, axis=0)], self.kept, resolution(self.values)
        )


class _Made:
    """The blocks of a round.

    Args:
        first, values: (K,) nominal parameters, and those of this round.
    """

    def __init__(self, first: np.ndarray, values: np.ndarray) -> None:
        self._first, self._values = first, values
        self.rows, self.blocks = list[_Row](), list[Block]()

    def add(self, rows: Sequence[_Row], low_pass: LowPass | None, cutoff: int) -> None:
        """Signals of a kind; the column `cutoff` is of their filter, if there is one."""
        for row in rows:
            K, least = len(self._first), resolution(row.values)
            model, now = (row.known + row.columns[:, :K] @ v for v in (self._first, self._values))
            if low_pass is None:
                block = Block(row.values - model, row.columns, row.kept, least)
            else:
                block = Band(low_pass).block(row.values, model, now, row.columns, row.kept, least)
                block.columns[:, cutoff] = block.columns[:, -1]
                block = replace(block, columns=block.columns[:, :-1])
                if block.kept.sum() <= 10:
                    continue
            self.rows.append(row)
            self.blocks.append(block)

    def left(self, change: np.ndarray, low_passes: Mapping[str, LowPass]) -> list[float]:
        """Standard deviation of each signal from the model with changed parameters, where samples count."""
        results, K = [], len(self._first)
        for row in self.rows:
            model = row.known + row.columns[:, :K] @ (self._first + change[:K])
            model, kept = model + row.columns[:, K:] @ change[K:], row.kept
            if low_pass := low_passes.get(row.kind):
                model, kept = low_pass(model), Band(low_pass).clear(kept) & kept
            results.append(float(np.std((row.values - model)[kept])))
        return results


def _loads(parts: tuple[np.ndarray, np.ndarray], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return parts[0], parts[1] @ values


def _solved(
    blocks: Sequence[Block], prior: np.ndarray, *, together: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Values, covariance, which are not seen, and degrees of freedom.

    `prior` is 1 / variance of what is known to be zero. `together`: the noise is what a fit of all signals
    leaves over, for each has few samples.
    """
    if together:
        white = [whitened(b, left) for b, left in zip(blocks, _left_over(blocks, prior), strict=True)]
    else:
        white = [whitened(block) for block in blocks]
    products = np.sum([one.products for one in white], axis=0) + np.diag(prior)
    projections = np.sum([one.projections for one in white], axis=0)
    inverse, seen, axes = _inverse(products)
    unseen = np.sum(axes[:, ~seen] ** 2, axis=1) > 1e-6
    freedom = max(sum(one.count for one in white) - int(seen.sum()), 1)
    return inverse @ projections, inverse, unseen, freedom


def _inverse(products: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inverse of normal equations in the identified directions; which scaled axes these are, and all axes."""
    size = np.sqrt(np.diag(products))
    scale = np.where(size > 0, size, 1.0)
    roots, axes = np.linalg.eigh(products / np.outer(scale, scale))
    seen = roots > _UNSEEN * roots[-1]
    return (axes[:, seen] / roots[seen]) @ axes[:, seen].T / np.outer(scale, scale), seen, axes


def _left_over(blocks: Sequence[Block], prior: np.ndarray) -> list[np.ndarray]:
    """The residuals of plain least squares of each signal, divided by the share that it cannot fit (HC3).

    Few samples for many parameters leave too little, most where the parameters have their frequencies.
    """
    plain, _ = plain_least_squares(blocks, prior)
    left = [block.values - block.columns @ plain for block in blocks]
    spreads = [float(np.std(residual[block.kept])) for residual, block in zip(left, blocks, strict=True)]
    scaled = [b.columns * b.kept[:, None] / max(s, 1e-300) for b, s in zip(blocks, spreads, strict=True)]
    inverse, _, _ = _inverse(np.sum([X.T @ X for X in scaled], axis=0) + np.diag(prior))
    shares = [1 - np.einsum("ij,jk,ik->i", X, inverse, X) for X in scaled]
    return [residual / np.maximum(share, _LEAST_SHARE) for residual, share in zip(left, shares, strict=True)]


def plain_least_squares(blocks: Sequence[Block], prior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values without whitening, each signal by its spread, and their standard errors in coloured noise.

    The errors are those of the sandwich formula, with the autoregressive noise that the fit leaves over.
    `prior` is 1 / variance of what is known to be zero.
    """
    spreads = []
    for block in blocks:
        X = block.columns[block.kept]
        result, _, rank, _ = np.linalg.lstsq(X, block.values[block.kept], rcond=_UNSEEN)
        square = float(np.sum((block.values[block.kept] - X @ result) ** 2))
        spreads.append(max(np.sqrt(square / max(len(X) - int(rank), 1)), block.least, 1e-300))
    weighted = [
        (np.where(b.kept, b.values, 0.0) / s, np.where(b.kept[:, None], b.columns, 0.0) / s)
        for b, s in zip(blocks, spreads, strict=True)
    ]
    inverse, _, _ = _inverse(np.sum([X.T @ X for _, X in weighted], axis=0) + np.diag(prior))
    result = inverse @ np.sum([X.T @ y for y, X in weighted], axis=0)
    middle = np.diag(prior)
    for (y, X), block in zip(weighted, blocks, strict=True):
        left = np.where(block.kept, y - X @ result, 0.0)
        filtered = len(block.shape) > 1
        filtering = coloured(left, block.shape) if filtered else autoregression(left[block.kept])
        innovation = float(np.std(signal.lfilter(filtering, [1.0], left)[block.kept]))
        colored = np.asarray(signal.lfilter([1.0], filtering, X[::-1], axis=0)) * innovation
        middle += colored.T @ colored
    return result, np.sqrt(np.maximum(np.diag(inverse @ middle @ inverse), 0.0))
