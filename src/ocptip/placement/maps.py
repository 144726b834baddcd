"""Placements evaluated by the thousand (`scan`), and a map over the floor: the best one that stands in
each cell, or the limit that fails.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.numerics.threads import one_thread
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.limits.arm import Reach
from ocptip.placement.limits.contact import SlipIndexLimit
from ocptip.placement.limits.kinds import BASE_LIMITS
from ocptip.placement.limits.limit import ConstraintRows
from ocptip.placement.problem import CRITERIA, PlacementProblem
from ocptip.placement.result import FEASIBLE, Placement
from ocptip.placement.search.starts import solutions
from ocptip.placement.terrain import Patch

_CHUNK = 2000  # placements at once
_PER_ROUND = 64  # states whose contacts are solved per round, shared among the groups
_NO_CAUSE = ""


@dataclass(frozen=True, eq=False)
class Scan:
    """The best of each group of placements; without groups, each placement with its best IK solutions.

    Attributes:
        parameters: (N, k).
        angles: (N, tasks, n), rad; NaN where a task is out of reach.
        criteria: (N, 4): GN, GT, GK, GE; NaN where not feasible.
        totals: (N,) objective; NaN where not feasible.
        causes: N words: the kind of the most violated constraint ("reach": a pose is out of reach, "base
            clearance", "torque", ...) of the placement and IK solution of minimum violation; "" where
            feasible.
        states: number of evaluated states of the arm.
        solved: of these, how many had their contacts solved.
    """

    parameters: np.ndarray
    angles: np.ndarray
    criteria: np.ndarray
    totals: np.ndarray
    causes: np.ndarray
    states: int
    solved: int

    @property
    def feasible(self) -> np.ndarray:
        """(N,) all constraints hold."""
        return self.causes == _NO_CAUSE

    @property
    def best(self) -> int | None:
        """Number of the feasible row with the minimum objective; None if there is none."""
        return int(np.nanargmin(self.totals)) if np.isfinite(self.totals).any() else None


@one_thread
def scan(
    problem: PlacementProblem,
    parameters: np.ndarray,
    *,
    patch: int = 0,
    groups: np.ndarray | None = None,
    seed: int = 0,
) -> Scan:
    """Evaluate placements with all IK solutions, and give the best feasible one of each group.

    Contacts are solved only where the rest of the objective, with a lower bound of GT, is below the best
    total of the group so far. So a search of a whole grid (one group), or a map over x and y with the best
    angle in each cell (one group per cell), costs far less than the evaluation of all states.

    With several tasks each takes the IK solution that is best by the objective of this task, which need not
    be the best combination where a criterion is the maximum over tasks.

    Args:
        problem: tasks, limits, weights.
        parameters: (N, k) of the patch.
        patch: its number.
        groups: (N,) group of each placement, 0 to G - 1; default: each is one.
        seed: of the joint angles tried where part of the orientation is free or the arm has no closed form.

    Raises:
        InputError: parameters or groups of wrong shape, or NaN.
    """
    terrain = problem.terrain[patch]
    parameters = finite_array("parameters", parameters, (None, terrain.size))
    N = len(parameters)
    groups = np.arange(N) if groups is None else np.asarray(groups)
    if groups.shape != (N,) or groups.dtype.kind not in "iu" or (N and groups.min() < 0):
        raise InputError(f"groups: expected {N} whole numbers >= 0, got {groups!r}")
    work = _Scanner(Evaluator(problem), patch, parameters, groups)
    rng = np.random.default_rng(seed)
    for first in range(0, N, _CHUNK):
        work.evaluate(np.arange(first, min(first + _CHUNK, N)), rng)
    work.solve()
    return work.result()


class _Scanner:
    """Rough values of all states first, then contacts where they can matter."""

    def __init__(self, evaluator: Evaluator, patch: int, parameters: np.ndarray, groups: np.ndarray) -> None:
        self.evaluator, self.patch, self.parameters, self.groups = evaluator, patch, parameters, groups
        self.tasks, self.n = len(evaluator.problem.tasks), evaluator.arm.n
        count = int(groups.max()) + 1 if len(groups) else 0
        self.margin = np.full(count, -np.inf)  # of the least violating state
        self.cause = np.full(count, "reach", dtype=object)
        self.where = np.zeros(count, dtype=int)
        self.where[groups[::-1]] = np.arange(len(groups))[::-1]  # first placement of each group
        self.angles = np.full((count, self.tasks, self.n), np.nan)
        self.criteria, self.total = np.full((count, 4), np.nan), np.full(count, np.inf)
        self.states = self.solved = 0
        self._waiting: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def evaluate(self, numbers: np.ndarray, rng: np.random.Generator) -> None:
        """Rough values of some placements."""
        margin, cause = worst(self.evaluator.ground(self.patch, self.parameters[numbers]), len(numbers))
        blocked = cause != _NO_CAUSE
        nowhere = np.full((int(blocked.sum()), self.tasks, self.n), np.nan)
        self._note(numbers[blocked], margin[blocked], cause[blocked], nowhere)
        alive = numbers[~blocked]
        if self.tasks == 1:
            q, who, rough = self._states(0, alive, rng)
            if len(q):
                self._sort(alive[who], *rough, q[:, None])
            return
        chosen, bound = np.empty((len(alive), 0, self.n)), []
        smallest, why = np.full(len(alive), np.inf), np.full(len(alive), _NO_CAUSE, dtype=object)
        for t in range(self.tasks):
            q, who, (share, kind, values) = self._states(t, alive, rng)
            rank = np.where(kind == _NO_CAUSE, self.evaluator.totals(values), 1e6 - share)
            order = np.lexsort((rank, who))
            places, first = np.unique(who, return_index=True)
            reached = order[first]
            alive, chosen, smallest, why = alive[places], chosen[places], smallest[places], why[places]
            bound = [values_[places] for values_ in bound] + [values[reached]]
            chosen = np.concatenate([chosen, q[reached][:, None]], axis=1)
            why = np.where(share[reached] < smallest, kind[reached], why)
            smallest = np.minimum(smallest, share[reached])
        values = np.max(bound, axis=0)
        counts = [sum(c.counts for c in cases) for cases in self.evaluator.cases]
        values[:, 3] = np.average([b[:, 3] for b in bound], axis=0, weights=counts)
        self._sort(alive, smallest, why, values, chosen)

    def _states(
        self, t: int, numbers: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Angles (S, n), their placement (index into numbers), and margin, cause, criteria of a task."""
        evaluator = self.evaluator
        none = np.empty(0), np.empty(0, dtype=object), np.empty((0, 4))
        if not len(numbers):
            return np.empty((0, self.n)), np.empty(0, dtype=int), none
        q = solutions(evaluator, t, self.patch, self.parameters[numbers], rng)
        who, which = np.nonzero(np.isfinite(q).all(axis=2))
        q = q[who, which]
        self.states += len(q)
        if not len(q):
            return q, who, none
        evaluation = evaluator.task(t, self.patch, self.parameters[numbers[who]], q, contacts=False)
        margin, cause = worst(evaluation.rows, len(q))
        least = evaluator.least_criteria([evaluation])
        if (limit := evaluator.problem.limits.GT) is not None:
            smallest = 1 - least[:, CRITERIA.index("GT")] / limit
            cause[smallest < np.minimum(margin, -FEASIBLE)] = SlipIndexLimit.kind
            margin = np.minimum(margin, smallest)
        return q, who, (margin, cause, least)

    def _sort(
        self, numbers: np.ndarray, margin: np.ndarray, cause: np.ndarray, values: np.ndarray, q: np.ndarray
    ) -> None:
        """Keep feasible states for later, note the violations of the others."""
        good = cause == _NO_CAUSE
        self._note(numbers[~good], margin[~good], cause[~good], q[~good])
        if good.any():
            self._waiting.append((numbers[good], self.evaluator.totals(values[good]), q[good]))

    def _note(self, numbers: np.ndarray, margin: np.ndarray, cause: np.ndarray, q: np.ndarray) -> None:
        """Causes of the minimum violation per group, as long as the group has no feasible state."""
        groups = self.groups[numbers]
        order = np.lexsort((-margin, groups))
        places, first = np.unique(groups[order], return_index=True)
        reached = order[first]
        better = (margin[reached] > self.margin[places]) & ~np.isfinite(self.total[places])
        places, reached = places[better], reached[better]
        self.margin[places], self.cause[places] = margin[reached], cause[reached]
        self.where[places], self.angles[places] = numbers[reached], q[reached]

    def solve(self) -> None:
        """Solve contacts in the order of the lower bounds until no state can be better than the best."""
        if not self._waiting:
            return
        numbers, bound, q = (np.concatenate([w[i] for w in self._waiting]) for i in range(3))
        order = np.lexsort((bound, self.groups[numbers]))
        numbers, bound, q = numbers[order], bound[order], q[order]
        groups = self.groups[numbers]
        while len(numbers):
            count = max(_PER_ROUND // len(np.unique(groups)), 1)
            starts = np.searchsorted(groups, groups)  # first state of the same group
            now = np.arange(len(groups)) - starts < count
            self._exact(numbers[now], q[now])
            open_ = ~now & (bound < self.total[groups])
            numbers, bound, q, groups = numbers[open_], bound[open_], q[open_], groups[open_]

    def _exact(self, numbers: np.ndarray, q: np.ndarray) -> None:
        evaluator, patch, p = self.evaluator, self.patch, self.parameters[numbers]
        self.solved += len(q)
        fast = evaluator.problem.stands[patch].conforms
        results = [
            evaluator.task(t, patch, p, q[:, t], clearances=False, fast=fast) for t in range(self.tasks)
        ]
        margin, cause = worst(tuple(r for evaluation in results for r in evaluation.rows), len(q))
        criteria = evaluator.criteria(results)
        total = evaluator.totals(criteria)
        good = cause == _NO_CAUSE
        self._note(numbers[~good], margin[~good], cause[~good], q[~good])
        indices = np.flatnonzero(good)
        groups = self.groups[numbers[indices]]
        order = np.lexsort((total[indices], groups))
        places, first = np.unique(groups[order], return_index=True)
        best = indices[order[first]]
        better = total[best] < self.total[places]
        places, best = places[better], best[better]
        self.total[places], self.criteria[places] = total[best], criteria[best]
        self.where[places], self.angles[places] = numbers[best], q[best]
        self.cause[places] = _NO_CAUSE

    def result(self) -> Scan:
        """The best of each group."""
        return Scan(
            self.parameters[self.where],
            self.angles,
            self.criteria,
            np.where(np.isfinite(self.total), self.total, np.nan),
            self.cause,
            self.states,
            self.solved,
        )


def worst(rows: tuple[ConstraintRows, ...], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Smallest margin (N,) and the kind of its constraint where that is broken, else ""."""
    margin, kind = np.full(count, np.inf), np.full(count, _NO_CAUSE, dtype=object)
    for r in rows:
        if not r.margins.shape[1]:
            continue
        least_margin = np.min(np.nan_to_num(r.margins, nan=-np.inf), axis=1)
        kind[least_margin < np.minimum(margin, -FEASIBLE)] = r.kind
        margin = np.minimum(margin, least_margin)
    return margin, kind


CELLS = 33
"""Cells per axis."""

UNEVEN_CELLS = 17
"""The same on uneven ground, where every place has different contacts."""

_SETTINGS = 18  # samples of the parameters that are not on an axis
_REPEATS = 2  # where part of the orientation is free, and joint angles are a random choice
_MORE = 0.05  # margin of the map about what is in reach
_LEAST_SHAPE = 0.7  # of the map's sides
_NOT_REACHED = [limit.kind for limit in (Reach, *BASE_LIMITS)]


@dataclass(frozen=True, eq=False)
class PlacementMap:
    """Best placements over one or two parameters of a patch.

    Attributes:
        patch: the patch.
        shown: numbers of the parameters on the axes, one or two: the world's x and y if the patch has them.
        axes: per shown parameter its values, m or rad.
        found: one row per cell, the first axis fastest.
    """

    patch: Patch
    shown: tuple[int, ...]
    axes: tuple[np.ndarray, ...]
    scan: Scan

    @classmethod
    def of(cls, best: Placement, cells: int | None = None) -> PlacementMap:
        """Map of the patch of a placement; the parameters not shown take its values and others.

        A coarse scan finds out where tasks are in reach, the fine one looks there.

        Args:
            best: the placement.
            cells: per axis, at least 2; default `CELLS`, on uneven ground `UNEVEN_CELLS`.
        """
        problem, patch = best.problem, best.problem.terrain[best.patch]
        cells = cells or (UNEVEN_CELLS if patch.conforming else CELLS)
        low, high = _window(problem, patch)
        coarse = cls._scanned(best, low, high, max(cells // 2, 2), _SETTINGS // 2, 1)
        for i, (a, b) in zip(coarse.shown, coarse.in_reach(), strict=True):
            low[i] = max(low[i], min(a, best.parameters[i]))
            high[i] = min(high[i], max(b, best.parameters[i]))
        if patch.horizontal:
            _widen(low, high, *_window(problem, patch), patch.horizontal)
        free = any(task.orientation != "full" for task in problem.tasks)
        return cls._scanned(best, low, high, cells, _SETTINGS, _REPEATS if free else 1)

    @classmethod
    def _scanned(
        cls, best: Placement, low: np.ndarray, high: np.ndarray, cells: int, settings: int, repeats: int
    ) -> PlacementMap:
        problem, patch = best.problem, best.problem.terrain[best.patch]
        shown = patch.horizontal or tuple(range(min(patch.size, 2)))
        hidden = [i for i in range(patch.size) if i not in shown]
        axes = tuple(np.linspace(low[i], high[i], cells) for i in shown)
        count = max(round(settings ** (1 / max(len(hidden), 1))), 2)
        tries = [_samples(patch, i, best.parameters[i], low[i], high[i], count) for i in hidden]
        combinations = list(product(*tries))
        hidden_values = np.array(combinations, dtype=float).reshape(len(combinations), len(hidden))
        hidden_values = np.repeat(hidden_values, repeats, axis=0)
        grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, len(shown))
        parameters = np.empty((len(grid), len(hidden_values), patch.size))
        parameters[:, :, shown] = grid[:, None]
        parameters[:, :, hidden] = hidden_values
        groups = np.repeat(np.arange(len(grid)), len(hidden_values))
        result = scan(problem, parameters.reshape(-1, patch.size), patch=best.patch, groups=groups)
        return cls(patch, tuple(shown), axes, result)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the tables: (cells,), or (second axis, first axis)."""
        return tuple(len(axis) for axis in reversed(self.axes))

    def values(self, name: str) -> np.ndarray:
        """A criterion or "total" by cell; NaN without a placement that keeps all constraints."""
        flat = self.scan.totals if name == "total" else self.scan.criteria[:, CRITERIA.index(name)]
        return np.where(self.scan.feasible, flat, np.nan).reshape(self.shape)

    @property
    def causes(self) -> np.ndarray:
        """Kind of the constraint that fails by cell, "" where there is a placement."""
        return self.scan.causes.astype(str).reshape(self.shape)

    def in_reach(self) -> list[tuple[float, float]]:
        """Per axis the range of the cells in which all tasks are in reach, with a margin."""
        inside, ranges = ~np.isin(self.causes, _NOT_REACHED), []
        for k, axis in enumerate(self.axes):
            map_axis = inside.ndim - 1 - k
            indices = np.flatnonzero(inside.any(axis=tuple(i for i in range(inside.ndim) if i != map_axis)))
            if not len(indices):
                ranges.append((float(axis[0]), float(axis[-1])))
                continue
            more = (axis[1] - axis[0]) + _MORE * (axis[indices[-1]] - axis[indices[0]])
            ranges.append((float(axis[indices[0]] - more), float(axis[indices[-1]] + more)))
        return ranges


def _window(problem: PlacementProblem, patch: Patch) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the patch's parameters from which a task may be in reach."""
    boxes = [patch.box(task.position, problem.reach) for task in problem.tasks]
    low, high = np.max([b[0] for b in boxes], axis=0), np.min([b[1] for b in boxes], axis=0)
    if np.any(low > high):
        low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
    thin = high - low < 1e-6
    return low - 0.05 * thin, high + 0.05 * thin


def _widen(
    low: np.ndarray, high: np.ndarray, least: np.ndarray, most: np.ndarray, axes: tuple[int, int]
) -> None:
    """Widen the narrower of two axes, within bounds, so that the map is not a mere strip."""
    wanted = _LEAST_SHAPE * max(high[i] - low[i] for i in axes)
    for i in axes:
        more = max(wanted - (high[i] - low[i]), 0.0) / 2
        low[i], high[i] = max(low[i] - more, least[i]), min(high[i] + more, most[i])


def _samples(patch: Patch, i: int, value: float, low: float, high: float, count: int) -> np.ndarray:
    """Values of a parameter that is not shown, that of the placement among them."""
    if patch.angular[i] and high - low > 2 * np.pi - 1e-9:
        return value + 2 * np.pi * np.arange(count) / count
    return np.unique(np.append(np.linspace(low, high, count - 1), np.clip(value, low, high)))
