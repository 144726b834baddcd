"""The low-pass filter of recorded signals: identified from the signals themselves.

A drive or a logger that filters torques filters neither angles nor the model. What is whitened then counts
most where the filter has taken everything away, and parameters are pulled aside. So the model is filtered as
the signals were, and both are compared up to the frequency at which the filter leaves half.

The filter is a Butterworth of order 1, 2 or 4, causal or zero-phase (forward and backward). Order, direction
and cutoff are those with which the model leaves the minimum residual. What is not sure of the cutoff is a
parameter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from scipy import optimize, signal

from ocptip.measured.regression import Block, autoregression

ORDERS = (1, 2, 4)
_LONGEST = 3000  # samples: more of a recording do not make the filter better known
_LOWEST, _HIGHEST = 8.0, 0.35  # periods per recording; share of the rate
_TRIED, _TRIED_NEAR = 8, 3  # cutoffs of each kind, before the best is refined
_CLOSE = 1e-3  # of the logarithm of a cutoff
_EVIDENCE = 0.03  # by how much a filter must lessen the logarithm of what is left, rms, to be believed
_UNKNOWN = 0.5  # s around rests, where friction is not known and filters have smeared it
_RIPPLE = 60.0  # dB by which the band filter stops
_NEAR = 1.3  # factor by which a cutoff may be off that is given
_SHORT = 0.25  # of a period of the band: gaps that are shorter are bridged
_MEMORY = 3.0  # periods of the cutoff, after which a filter has forgotten
_SIMULATED, _ORDER = 4000, 4  # samples of noise, and order of the filter that whitens them
_SAME = 1e-8
_STEP = 0.01  # share of the cutoff: step of slopes over it


@dataclass(frozen=True)
class LowPass:
    """A Butterworth low-pass.

    Attributes:
        cutoff: Hz, at which half of the power is left in each direction.
        order: of one direction.
        causal: it runs forward only; else forward and backward, without delay.
        rate: Hz, of the samples.
    """

    cutoff: float
    order: int
    causal: bool
    rate: float

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """(N, ...) filtered along the first axis; before and after them signals rest."""
        result = self._run(values)
        return result if self.causal else self._run(result[::-1])[::-1]

    def _run(self, values: np.ndarray) -> np.ndarray:
        sections, start = _designed(self.order, self.cutoff, self.rate)
        start = start.reshape(*start.shape, *[1] * (values.ndim - 1)) * values[0]
        return signal.sosfilt(sections, values, axis=0, zi=start)[0]

    @property
    def band(self) -> float:
        """Hz, at which half of the amplitude is left."""
        left = 3.0 if self.causal else 1.0
        return self.cutoff * left ** (0.5 / self.order)

    def softer(self, factor: float) -> LowPass:
        """This filter with its cutoff multiplied by `factor`."""
        return replace(self, cutoff=factor * self.cutoff)

    def __str__(self) -> str:
        """In words."""
        way = "causal" if self.causal else "zero-phase"
        return f"{way} low-pass of {self.cutoff:.3g} Hz (Butterworth of order {self.order})"


@lru_cache(maxsize=256)
def _designed(order: int, cutoff: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Sections, and their state at rest under 1."""
    sections = np.asarray(signal.butter(order, cutoff, fs=rate, output="sos"))
    return sections, np.asarray(signal.sosfilt_zi(sections))


class Band:
    """Signals and model up to the band of a filter, at as low a rate.

    Args:
        low_pass: that the signals went through.
    """

    def __init__(self, low_pass: LowPass) -> None:
        self.low_pass = low_pass
        self._every = max(1, int(low_pass.rate / (2 * low_pass.band)))
        self._memory = int(np.ceil(_MEMORY * low_pass.rate / low_pass.cutoff))

    @cached_property
    def _shape(self) -> np.ndarray:
        """Whitens noise that was white before filter and band; see `Block.shape`."""
        white = np.random.default_rng(0).normal(size=(_SIMULATED * self._every, 1))
        return autoregression(self._limited(self.low_pass(white))[:: self._every, 0], _ORDER)

    def block(
        self,
        values: np.ndarray,
        model: np.ndarray,
        now: np.ndarray,
        columns: np.ndarray,
        kept: np.ndarray,
        least: float,
    ) -> Block:
        """The residuals of signals (N,), and columns (N, K); of these the filter was applied to `values`
        only.

        The last column is what a softer filter changes, per share of its cutoff.

        Args:
            values: as recorded; anything where they are not kept.
            model: (N,) what they should be at the begin of the estimation.
            now: (N,) with the parameters of this round.
            columns: (N, K).
            kept: (N,) samples that count.
            least: see `Block`.
        """
        there = np.isfinite(values)  # what does not count is there, too: the filter has spread it
        y = np.interp(np.arange(len(kept)), np.flatnonzero(there), values[there])
        filtered = self.low_pass(np.column_stack([model, columns]))
        ends = [self.low_pass.softer(factor)(now) for factor in (1 + _STEP, 1 - _STEP)]
        softer = (ends[0] - ends[1]) / (2 * _STEP)
        both = self._limited(np.column_stack([y - filtered[:, 0], filtered[:, 1:], softer]))
        rows = slice(self._every // 2, None, self._every)
        return Block(both[rows, 0], both[rows, 1:], self.clear(kept)[rows], least, self._shape)

    def clear(self, kept: np.ndarray) -> np.ndarray:
        """(N,) True away from samples that do not count; gaps too short for the band to show do no harm."""
        bad, longest = np.zeros(len(kept), dtype=bool), _SHORT * self.low_pass.rate / self.low_pass.band
        out = np.flatnonzero(~kept)
        for run in np.split(out, np.flatnonzero(np.diff(out) > 1) + 1):
            if len(run) > longest:
                bad[max(run[0] - self._memory, 0) : run[-1] + 1 + self._memory] = True
        return ~bad

    def _limited(self, values: np.ndarray) -> np.ndarray:
        """Without what is above the band, no phase."""
        if self._every == 1:
            return values
        window: Any = "kaiser", signal.kaiser_beta(_RIPPLE)
        taps = np.asarray(signal.firwin(8 * self._every + 1, 1 / self._every, window=window))
        padded = np.pad(values, ((len(taps) // 2,) * 2, (0, 0)), mode="edge")
        return signal.oaconvolve(padded, taps[:, None], mode="valid", axes=0)


def low_pass_of(blocks: Sequence[Block], rate: float, given: float | None = None) -> LowPass | None:
    """The filter that some signals went through; None: none can be identified.

    Args:
        blocks: signals, and what the model without filter says, one column per parameter.
        rate: Hz.
        given: Hz, its cutoff as far as it is known; None: it is searched.
    """
    blocks = [_searched(_busiest(block), rate) for block in blocks]
    longest = max(len(block.values) for block in blocks)
    low, high = _LOWEST * rate / longest, _HIGHEST * rate
    if given is not None:
        low, high = given / _NEAR, min(given * _NEAR, high)
    if low >= high:
        return None
    kinds = [(order, causal) for order in ORDERS for causal in (True, False)]
    cutoffs = np.geomspace(low, high, _TRIED if given is None else _TRIED_NEAR)
    results = [_best(blocks, LowPass(high, *kind, rate), cutoffs) for kind in kinds]
    least, low_pass = min(results, key=lambda one: one[0])
    gained = _cost(blocks, None) - least
    if given is None and gained < _EVIDENCE * sum(block.kept.sum() for block in blocks):
        return None
    return low_pass


def _best(blocks: Sequence[Block], low_pass: LowPass, cutoffs: np.ndarray) -> tuple[float, LowPass]:
    """The minimum cost and its filter of this kind, from the best of some cutoffs on."""
    tried = [replace(low_pass, cutoff=float(cutoff)) for cutoff in cutoffs]
    best = tried[int(np.argmin([_cost(blocks, one) for one in tried]))]
    step = float(np.log(cutoffs[1] / cutoffs[0]))
    refined = optimize.minimize_scalar(
        lambda x: _cost(blocks, best.softer(float(np.exp(x)))),
        bounds=(-step, min(step, float(np.log(0.49 * low_pass.rate / best.cutoff)))),
        method="bounded",
        options={"xatol": _CLOSE},
    )
    return float(refined.fun), best.softer(float(np.exp(refined.x)))


def _busiest(block: Block) -> Block:
    """The part of at most `_LONGEST` samples in which most changes."""
    N = len(block.values)
    if N <= _LONGEST:
        return block
    change = np.append(0.0, np.cumsum(np.abs(np.diff(np.where(block.kept, block.values, 0.0)))))
    first = int(np.argmax(change[_LONGEST - 1 :] - change[: N - _LONGEST + 1]))
    part = slice(first, first + _LONGEST)
    return Block(block.values[part], block.columns[part], block.kept[part], block.least)


def _searched(block: Block, rate: float) -> Block:
    """Without the surroundings of rests, as far as enough is left: the same samples for all filters."""
    wide = Band(LowPass(_MEMORY / _UNKNOWN, 1, True, rate)).clear(block.kept) & np.isfinite(block.values)
    return replace(block, kept=wide) if wide.sum() > 4 * block.columns.shape[1] else block


def _cost(blocks: Sequence[Block], low_pass: LowPass | None) -> float:
    """Sum over signals of samples times the logarithm of the rms that the filtered model leaves."""
    total = 0.0
    for block in blocks:
        kept = block.kept
        X = block.columns if low_pass is None else low_pass(block.columns)
        size = np.linalg.norm(X[kept], axis=0)
        X = X[kept][:, size > 0] / size[size > 0]
        gram, y = X.T @ X + _SAME * np.eye(X.shape[1]), block.values[kept]
        left = y - X @ np.linalg.solve(gram, X.T @ y)
        total += 0.5 * len(y) * np.log(np.mean(left**2) + block.least**2)
    return total
