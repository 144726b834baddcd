"""Directions of tilts and pushes; the search of the worst one: all around, then closer about the worst."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

AROUND = 24  # directions of tilt, and of pushes along the floor
CLOSER = tuple(np.radians([15.0, 7.5, 4.0, 2.0]))  # rad: from the worst direction so far to its neighbours
_EPSILON = 1e-300


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions, and those near one of them.

    Attributes:
        sides: (k, 3) unit vectors; (k, 6) pairs of them.
        near: (j, 3) directions at an angle, rad, from one.
    """

    sides: np.ndarray
    near: Callable[[np.ndarray, float], np.ndarray]

    def search(
        self,
        evaluate: Callable[[np.ndarray], np.ndarray | None],
        worst: np.ndarray | None,
        angles: tuple[float, ...] = CLOSER,
    ) -> None:
        """Evaluate directions ever closer to the worst one; `evaluate` returns the worst one so far."""
        for angle in angles:
            if worst is not None:
                worst = evaluate(self.near(worst, angle))

    def with_each(self, other: Directions) -> Directions:
        """Pairs of directions: of one kind and of another, which may deviate both."""

        def near(pair: np.ndarray, angle: float) -> np.ndarray:
            one, two = pair[:3], pair[3:]
            return _pairs(np.vstack([one, self.near(one, angle)]), np.vstack([two, other.near(two, angle)]))

        return Directions(_pairs(self.sides, other.sides), near)


def _pairs(ones: np.ndarray, others: np.ndarray) -> np.ndarray:
    return np.array([np.r_[pair] for pair in product(ones, others)])


NO_DIRECTION = Directions(np.zeros((1, 3)), lambda side, angle: np.empty((0, 3)))
"""Of what has none, or is zero."""


def slopes(gravity: np.ndarray) -> Directions:
    """Horizontal directions downhill."""
    return Directions(around(gravity), lambda side, angle: beside(gravity, side, angle))


def pushes(gravity: np.ndarray) -> Directions:
    """Directions of a push: horizontal ones, down, up, and between."""
    down, sides = gravity / max(np.linalg.norm(gravity), _EPSILON), around(gravity)
    between = [
        np.cos(dip) * sides[::step] + sign * np.sin(dip) * down
        for dip, step in zip(np.radians([22.5, 45, 67.5]), (2, 3, 6), strict=True)
        for sign in (1, -1)
    ]
    return Directions(np.vstack([sides, *between, down, -down]), _about)


def around(gravity: np.ndarray, count: int = AROUND) -> np.ndarray:
    """(count, 3) horizontal directions all around."""
    down = gravity / max(np.linalg.norm(gravity), _EPSILON)
    level = np.linalg.svd(down[None])[2][1:]
    turns = 2 * np.pi * np.arange(count) / count
    return np.cos(turns)[:, None] * level[0] + np.sin(turns)[:, None] * level[1]


def beside(gravity: np.ndarray, downhill: np.ndarray, angle: float) -> np.ndarray:
    """(2, 3) the directions at an angle, rad, on both sides of a horizontal one (3,)."""
    across = np.cross(gravity, downhill) / max(np.linalg.norm(gravity), _EPSILON)
    return np.cos(angle) * downhill + np.sin(angle) * np.array([across, -across])


def _about(direction: np.ndarray, angle: float) -> np.ndarray:
    """(8, 3) the directions at an angle, rad, from one (3,)."""
    return np.cos(angle) * direction + np.sin(angle) * around(direction, 8)


def tilted(gravity: np.ndarray, downhill: np.ndarray, tilt: float | np.ndarray) -> np.ndarray:
    """(..., 3) gravity on a floor tilted by (...), rad, downhill towards (..., 3)."""
    size = np.linalg.norm(gravity)
    down, tilt = gravity / max(size, _EPSILON), np.asarray(tilt)[..., None]
    return size * (np.cos(tilt) * down + np.sin(tilt) * downhill)


def beyond_by_tilt(
    gravity: np.ndarray, tilt: np.ndarray, over: np.ndarray, facets: np.ndarray, left: np.ndarray
) -> np.ndarray:
    """By how much a tilt of the floor moves wrenches beyond half spaces, at most, (N, R).

    Args:
        gravity: (3,), m/s^2.
        tilt: (N, 1), rad, in any direction.
        over: (N, 6, 3) derivatives of wrenches over gravity.
        facets: (R, 6) of half spaces.
        left: (N, R) how far wrenches are within them: rows where a bound by components, which costs
            little, stays below get that bound, the others the exact one.
    """
    change = 2 * np.linalg.norm(gravity) * np.sin(tilt / 2)
    result = (np.sqrt(np.einsum("nwt,nwt->nw", over, over)) * change) @ np.abs(facets).T
    close = np.flatnonzero(np.any(result > left, axis=1))
    tilt = tilt[close]
    pull = np.stack([over[close, :, axis] @ facets.T for axis in range(3)])  # (3, k, R)
    along = -np.tensordot(gravity, pull, 1)
    size = np.sqrt(np.einsum("tkr,tkr->kr", pull, pull)) * np.linalg.norm(gravity)
    # cos(a) - cos(a + tilt) at the angle a of pull and gravity, up to its largest value at pi.
    across = np.sqrt(np.maximum(size**2 - along**2, 0.0))
    most = along * (1 - np.cos(tilt)) + across * np.sin(tilt)
    result[close] = np.where(along < -np.cos(tilt) * size, along + size, most)
    return result
