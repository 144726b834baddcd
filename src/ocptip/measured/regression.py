"""Which few causes explain residuals in noise that is not white: regression with selection, and its errors.

Feasible generalised least squares: the noise of every signal is an autoregressive process whose order
(Bayesian information criterion) and coefficients come from what all causes together leave over. So
vibrations, drift and filters count as noise. What is whitened by it, with missing samples as additional
unknowns, is a plain regression. Causes are taken in one by one, the most significant first, exchanged for
others and dropped again as long as the sum of squares says so. A cause is taken in if its t value is beyond
what chance gives with a probability of `level` over the number of causes (Bonferroni). Then `level` is the
probability of any finding where there is nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import linalg, signal, stats

_SAME = 1e-8  # share of a cause's sum of squares below which others say the same


@dataclass(frozen=True, eq=False)
class Block:
    """One signal.

    Attributes:
        values: (N,) residuals; anything where they are not kept.
        columns: (N, K) what each cause would add to them per unit.
        kept: (N,) True where samples count.
        least: noise that is there in any case, such as rounding.
        shape: filter (1, -a1, ...) that whitens noise which was white before the signal was filtered.
    """

    values: np.ndarray
    columns: np.ndarray
    kept: np.ndarray
    least: float = 0.0
    shape: np.ndarray = field(default_factory=lambda: np.ones(1))


@dataclass(frozen=True, eq=False)
class Whitened:
    """Sums of a signal after whitening, in units of its noise.

    Attributes:
        products: (K, K), `columns' columns`.
        projections: (K,), `columns' values`.
        square: of the values.
        count: degrees of freedom that the values have.
        noise: standard deviation of the signal's innovations.
        spread: of what all causes leave over, standard deviation.
        order: of the autoregressive process.
    """

    products: np.ndarray
    projections: np.ndarray
    square: float
    count: int
    noise: float
    spread: float
    order: int


def whitened(block: Block, left: np.ndarray | None = None) -> Whitened:
    """Whiten a signal by the noise that all causes leave over in it.

    Args:
        block: the signal.
        left: (N,) the noise, where other signals also identify the causes: if all causes are fitted to a few
            samples alone, less than the noise remains.
    """
    inside = np.flatnonzero(block.kept)
    part = slice(inside[0], inside[-1] + 1)
    kept, y = block.kept[part], np.where(block.kept[part], block.values[part], 0.0)
    active = np.flatnonzero(np.any(block.columns[part][kept] != 0, axis=0))
    X = np.where(kept[:, None], block.columns[part][:, active], 0.0)
    size = np.linalg.norm(X, axis=0)
    X = X / size
    alone = left is None
    rest = y - X @ np.linalg.lstsq(X, y, rcond=_SAME)[0] if left is None else left[part].copy()
    rest[~kept] = np.interp(np.flatnonzero(~kept), np.flatnonzero(kept), rest[kept])
    spread = float(np.std(rest[kept]))
    filtering = autoregression(rest) if alone else coloured(rest, block.shape)
    if alone and len(filtering) > 1:  # once more, with the weights that belong to this noise
        rows = np.asarray(signal.lfilter(filtering, [1.0], np.column_stack([rest, X]), axis=0))
        rest = rest - X @ _solved(rows[len(filtering) :, 1:], rows[len(filtering) :, 0])
        filtering = autoregression(rest)
    order = len(filtering) - 1
    rows = np.asarray(signal.lfilter(filtering, [1.0], np.column_stack([y, X]), axis=0))
    lost = _without(rows, np.flatnonzero(~kept), filtering)
    rows = rows[order:]
    count = len(rows) - lost
    y, X = rows[:, 0], rows[:, 1:]
    best, _, rank, _ = np.linalg.lstsq(X, y, rcond=_SAME)
    freedom = max(count - int(rank), 1)
    square = np.sum((y - X @ best) ** 2) / freedom
    if not alone:
        square = max(square, np.mean(signal.lfilter(filtering, [1.0], rest)[order:][kept[order:]] ** 2))
    noise = max(float(np.sqrt(square)), block.least, 1e-300)
    K = block.columns.shape[1]
    products, projections = np.zeros((K, K)), np.zeros(K)
    X = X * size / noise
    products[np.ix_(active, active)] = X.T @ X
    projections[active] = X.T @ (y / noise)
    return Whitened(products, projections, float(y @ y) / noise**2, freedom, noise, spread, order)


def coloured(left: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """The whitening filter of noise whose filter is known: what that leaves of colour is of first order.

    Few samples do not tell more: parameters have taken away part of the noise at their frequencies.
    """
    before = np.asarray(signal.lfilter(shape, [1.0], left))[len(shape) - 1 :]
    return np.convolve(shape, autoregression(before, 1))


def _without(rows: np.ndarray, missing: np.ndarray, filtering: np.ndarray) -> int:
    """Take what missing samples can be out of whitened rows, in place; the number of directions of these.

    Samples that no filter joins are apart: every group of them by itself.
    """
    order, lost = len(filtering) - 1, 0
    for run in np.split(missing, np.flatnonzero(np.diff(missing) > order) + 1):
        first, last = (max(run[0], order), min(run[-1] + order + 1, len(rows))) if len(run) else (0, 0)
        later = np.arange(first, last)[:, None] - run
        indices = np.where((later >= 0) & (later <= order), filtering[np.clip(later, 0, order)], 0.0)
        indices = indices[:, np.any(indices != 0, axis=0)]
        if indices.size:
            indices = linalg.orth(indices)
            rows[first:last] -= indices @ (indices.T @ rows[first:last])
            lost += indices.shape[1]
    return lost


def autoregression(values: np.ndarray, order: int | None = None) -> np.ndarray:
    """Coefficients (1, -a1, -a2, ...) that whiten values (N,); the order is that of minimum BIC, or given."""
    N = len(values)
    most = int(min(10 * np.log10(N), N // 10)) if order is None else order
    values = values - values.mean()
    if most < 1 or not values.any():
        return np.ones(1)
    lags = np.lib.stride_tricks.sliding_window_view(values, most + 1)[:, ::-1]
    products = lags.T @ lags
    best, least = np.ones(1), N * np.log(max(products[0, 0], 1e-300) / len(lags)) if order is None else np.inf
    for lag in range(1 if order is None else order, most + 1):
        product = products[1 : lag + 1, 1 : lag + 1]
        a = _solved(product, products[1 : lag + 1, 0], 1e-12)
        error = max(float(products[0, 0] - a @ products[1 : lag + 1, 0]), 1e-12 * products[0, 0])
        criterion = N * np.log(error / len(lags)) + lag * np.log(N)
        if criterion < least:
            best, least = np.concatenate([[1.0], -a]), criterion
    return best


def _solved(matrix: np.ndarray, right: np.ndarray, smallest: float = _SAME) -> np.ndarray:
    """Least squares; directions with less than this share of the largest singular value are left out."""
    return np.linalg.lstsq(matrix, right, rcond=smallest)[0]


@dataclass(frozen=True, eq=False)
class Cause:
    """A cause that was taken in.

    Attributes:
        index: its number.
        value: its size.
        error: standard error of it, with the other accepted causes free as well.
        explained: share of the sum of squares, in units of noise, that goes when it comes last.
        rivals: numbers of causes that would explain it as well, as far as the noise separates them.
    """

    index: int
    value: float
    error: float
    explained: float
    rivals: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Explanation:
    """The fit of deviations by their causes.

    Attributes:
        causes: taken in, the most important first.
        values: (K,) sizes of all causes; zero for those left out, but for those that are always in.
        errors: (K,) standard errors of causes alone beside what was taken in; infinite where nothing is seen.
        freedom: degrees of freedom.
        square: of what is left, in units of noise; about `freedom` if that is noise.
        unexplained: probability that chance leaves so much more than all causes together do.
        threshold: t value beyond which a cause counts.
    """

    causes: tuple[Cause, ...]
    values: np.ndarray
    errors: np.ndarray
    freedom: int
    square: float
    unexplained: float
    threshold: float


class _Sums:
    """Sums of squares of subsets of causes; all sizes in units that make products 1."""

    def __init__(self, blocks: Sequence[Whitened], prior: np.ndarray) -> None:
        products = sum((b.products for b in blocks), np.diag(prior))
        projections = sum((b.projections for b in blocks), np.zeros(len(prior)))
        self.square = sum(b.square for b in blocks)
        self.freedom = sum(b.count for b in blocks)
        self.size = np.sqrt(np.diag(products))
        self.seen = self.size > 0
        scale = np.where(self.seen, self.size, 1.0)
        self.products, self.projections = products / np.outer(scale, scale), projections / scale

    def left(self, chosen: list[int]) -> float:
        """Sum of squares that causes leave over."""
        return self.square - float(self.projections[chosen] @ self.fitted(chosen))

    def fitted(self, chosen: list[int]) -> np.ndarray:
        """Their sizes."""
        return _solved(self.products[np.ix_(chosen, chosen)], self.projections[chosen])

    def gains(self, chosen: list[int]) -> tuple[np.ndarray, np.ndarray]:
        """(K,) how much less each further cause leaves over, and the share of it that is new."""
        product = self.products[np.ix_(chosen, chosen)]
        other = self.products[chosen]
        solved = _solved(product, np.column_stack([other, self.projections[chosen]]))
        new = 1.0 - np.sum(other * solved[:, :-1], axis=0)
        left = self.projections - other.T @ solved[:, -1]
        usable = self.seen & (new > _SAME)
        usable[chosen] = False
        return np.where(usable, left**2 / np.where(usable, new, 1.0), 0.0), np.where(usable, new, 0.0)


def explain(
    blocks: Sequence[Whitened],
    level: float,
    *,
    always: Sequence[int] = (),
    prior: np.ndarray | None = None,
    most: int | None = None,
) -> Explanation:
    """Find the few causes that explain signals.

    Args:
        blocks: the signals.
        level: probability of finding anything where there is nothing.
        always: causes that are no findings, but always free.
        prior: (K,), 1 / variance of causes whose size is known elsewhere to be 0; zeros: none is.
        most: maximum number of accepted causes.
    """
    K = len(blocks[0].projections)
    sums = _Sums(blocks, np.zeros(K) if prior is None else prior)
    nuisance = [k for k in always if sums.seen[k]]
    candidates = int(sums.seen.sum()) - len(nuisance)
    threshold = float(stats.t.isf(0.5 * level / max(candidates, 1), sums.freedom))
    chosen = _chosen(sums, nuisance, threshold**2, K if most is None else most)
    everything = [int(k) for k in np.flatnonzero(sums.seen)]
    least, chosen_squares = sums.left(everything), sums.left(nuisance + chosen)
    parameters = int(np.linalg.matrix_rank(sums.products[np.ix_(everything, everything)], tol=_SAME))
    more = max(parameters - len(nuisance) - len(chosen), 1)
    values, errors = _sizes(sums, nuisance, chosen)
    causes = [_cause(sums, nuisance, chosen, k, values, errors, threshold) for k in chosen]
    return Explanation(
        tuple(sorted(causes, key=lambda c: -c.explained)), values, errors, sums.freedom, chosen_squares,
        float(stats.chi2.sf(max(chosen_squares - least, 0.0), more)), threshold,
    )  # fmt: skip


def _chosen(sums: _Sums, nuisance: list[int], enough: float, most: int) -> list[int]:
    """Take in, exchange and drop until nothing changes, or causes come back that were chosen before."""
    chosen: list[int] = []
    before: set[frozenset[int]] = set()
    while len(chosen) < most and frozenset(chosen) not in before:
        before.add(frozenset(chosen))
        gains, _ = sums.gains(nuisance + chosen)
        best = int(np.argmax(gains))
        if gains[best] <= enough:
            return chosen
        chosen.append(best)
        chosen = _exchanged(sums, nuisance, chosen)
        chosen = _without_needless(sums, nuisance, chosen, enough)
    return chosen


def _exchanged(sums: _Sums, nuisance: list[int], chosen: list[int]) -> list[int]:
    """Replace causes by others, one at a time, while that leaves less over."""
    for _ in range(len(sums.seen)):
        left, better = sums.left(nuisance + chosen), None
        least = left - 1e-6 * max(abs(left), 1.0)
        for k in chosen:
            rest = [c for c in chosen if c != k]
            gains, _ = sums.gains(nuisance + rest)
            best = int(np.argmax(gains))
            if (now := sums.left(nuisance + rest) - gains[best]) < least:
                least, better = now, [*rest, best]
        if better is None:
            break
        chosen = better
    return chosen


def _without_needless(sums: _Sums, nuisance: list[int], chosen: list[int], enough: float) -> list[int]:
    """Drop causes that the others make needless, the last one taken in at last."""
    while len(chosen) > 1:
        left = sums.left(nuisance + chosen)
        costs = [sums.left(nuisance + [c for c in chosen if c != k]) - left for k in chosen]
        index = int(np.argmin(costs))
        if costs[index] > enough:
            return chosen
        chosen = [c for k, c in enumerate(chosen) if k != index]
    return chosen


def _sizes(sums: _Sums, nuisance: list[int], chosen: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """(K,) sizes and standard errors."""
    inside = nuisance + chosen
    values, errors = np.zeros(len(sums.seen)), np.full(len(sums.seen), np.inf)
    _, new = sums.gains(inside)
    errors[new > 0] = 1 / (sums.size[new > 0] * np.sqrt(new[new > 0]))
    if inside:
        values[inside] = sums.fitted(inside) / sums.size[inside]
        spread = np.diag(linalg.pinvh(sums.products[np.ix_(inside, inside)]))
        errors[inside] = np.sqrt(np.maximum(spread, 0.0)) / sums.size[inside]
    return values, errors


def _cause(
    sums: _Sums,
    nuisance: list[int],
    chosen: list[int],
    k: int,
    values: np.ndarray,
    errors: np.ndarray,
    threshold: float,
) -> Cause:
    rest = nuisance + [c for c in chosen if c != k]
    gains, _ = sums.gains(rest)
    without = sums.left(rest)
    rivals = [
        int(j) for j in np.argsort(-gains) if j not in (k, *rest) and gains[k] - gains[j] < threshold**2
        and gains[j] > threshold**2
    ]  # fmt: skip
    share = gains[k] / max(without, 1e-300)
    return Cause(k, float(values[k]), float(errors[k]), float(share), tuple(rivals))
