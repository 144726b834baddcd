"""A map over the floor: the best placement that stands in each cell, or the limit that fails."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from ocptip.placement.limits.arm import Reach
from ocptip.placement.limits.kinds import BASE_LIMITS
from ocptip.placement.problem import CRITERIA, PlacementProblem
from ocptip.placement.result import Placement
from ocptip.placement.scan import Scan, scan
from ocptip.placement.terrain import Patch

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
