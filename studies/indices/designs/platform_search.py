"""Searches over the poses of a platform: the best pose in an index, and the quality index.

Source: section 10, and (6.1) for the quality index.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, SolverError, finite_array, positive_number, whole_number
from ocptip.indices.platforms.platform import PlatformPose, StewartPlatform
from ocptip.indices.platforms.reviewed import manipulability
from ocptip.numerics.threads import one_thread


@dataclass(frozen=True, eq=False)
class BestPose:
    """The pose with the largest value of an index that a search found.

    Attributes:
        value: index there.
        position: (3,) of the platform frame, m.
        rotation_vector: (3,), rad.
        pose: the platform there.
        found: (starts,) best value of each start, largest first: how much the starts agree.
        evaluations: of the index.
    """

    value: float
    position: np.ndarray
    rotation_vector: np.ndarray
    pose: PlatformPose
    found: np.ndarray
    evaluations: int


@dataclass(frozen=True, eq=False)
class QualityIndex:
    """Manipulability of a pose relative to the largest one found for the same platform (6.1).

    Attributes:
        value: 1 in the best pose of the search, never more.
        manipulability, largest: of the pose and of the best pose, m^3.
        best: the search's result; None if the pose itself is the best one.
    """

    value: float
    manipulability: float
    largest: float
    best: BestPose | None


@one_thread
def best_pose(
    platform: StewartPlatform,
    index: Callable[[PlatformPose], float],
    *,
    position: object,
    half_range: object,
    half_angle: float,
    starts: int = 8,
    seed: int = 0,
) -> BestPose:
    """Largest value of an index over a box of poses, by a simplex search from several starts.

    Indices are not differentiable where eigenvalues meet, which they do in the best poses; the search uses
    values only and restarts its simplex until that helps no more.

    Args:
        platform: anchors.
        index: of a pose; the larger, the better.
        position: (3,) middle of the box of positions, m; the first start, without rotation.
        half_range: (3,) half the box, m, all >= 0 (0: fixed).
        half_angle: half the box of rotation vectors, per component, rad, 0 to pi (0: no rotation).
        starts: number of starts, >= 1.
        seed: of the random starts.

    Raises:
        InputError: an argument outside of its range.
        SolverError: the index exists in no start.
    """
    middle = np.concatenate([finite_array("position", position, (3,)), np.zeros(3)])
    half = np.concatenate([finite_array("half_range", half_range, (3,)), np.zeros(3)])
    half[3:] = positive_number("half_angle", half_angle, zero_allowed=True)
    if (half < 0).any() or half[3] > np.pi:
        raise InputError(f"half_range, half_angle: must be >= 0, angle at most pi, got {half.tolist()}")
    starts = whole_number("starts", starts, 1)
    free = np.flatnonzero(half > 0)
    evaluations = 0

    def placed(x: np.ndarray) -> np.ndarray:
        pose = middle.copy()
        pose[free] += half[free] * np.clip(x, -1.0, 1.0)
        return pose

    def anchors(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return platform.base, platform.platform @ Rotation.from_rotvec(pose[3:]).as_matrix().T + pose[:3]

    def cost(x: np.ndarray) -> float:
        nonlocal evaluations
        evaluations += 1
        value = _value(index, *anchors(placed(x)))
        outside = float(np.sum(np.maximum(np.abs(x) - 1.0, 0.0)))
        return np.inf if np.isnan(value) else -value + outside * (1.0 + abs(value))

    rng = np.random.default_rng(seed)
    results = []
    for start in range(starts):
        x = np.zeros(len(free)) if start == 0 else rng.uniform(-1, 1, len(free))
        results.append(_climb(cost, x))
    results.sort(key=lambda item: item[0])
    best, x = results[0]
    if not np.isfinite(best):
        raise SolverError("best_pose: the index exists in no start")
    final = placed(x)
    pose = PlatformPose(*anchors(final))
    found = -np.array([value for value, _ in results])
    return BestPose(float(index(pose)), final[:3], final[3:], pose, found, evaluations)


def quality_index(
    platform: StewartPlatform,
    position: object,
    rotation: object = None,
    *,
    half_range: object,
    half_angle: float,
    starts: int = 8,
    seed: int = 0,
) -> QualityIndex:
    """Quality index (6.1): manipulability divided by the largest one found for the same platform.

    The box of the search has the given pose's position as its middle. A search: more starts can only lower
    the value. Every platform attains 1 somewhere: not for comparing platforms.

    Args:
        platform: anchors.
        position, rotation: pose to rate, (3,) m and (3, 3).
        half_range, half_angle, starts, seed: as for :func:`best_pose`.

    Raises:
        InputError: an argument outside of its range.
        SolverError: every pose found is singular.
    """
    own = manipulability(platform.at(position, rotation))
    best = best_pose(
        platform,
        manipulability,
        position=position,
        half_range=half_range,
        half_angle=half_angle,
        starts=starts,
        seed=seed,
    )
    largest = max(own, best.value)
    if largest == 0.0:
        raise SolverError("quality_index: every pose found is singular")
    return QualityIndex(own / largest, own, largest, None if own >= best.value else best)


def _value(index: Callable[[PlatformPose], float], base: np.ndarray, platform: np.ndarray) -> float:
    """The index of a pose given by its anchors; NaN where a leg has length zero."""
    try:
        return float(index(PlatformPose(base, platform)))
    except InputError:
        return np.nan


def _climb(cost: Callable[[np.ndarray], float], x: np.ndarray) -> tuple[float, np.ndarray]:
    """Simplex search, restarted until a round improves the cost by less than 1e-10 of it."""
    value = cost(x)
    if not len(x):
        return value, x
    size = 0.3
    for _ in range(12):
        simplex = np.vstack([x, x + size * np.diag(np.where(x > 0, -1.0, 1.0))])
        options = {
            "initial_simplex": simplex,
            "xatol": 1e-10,
            "fatol": 1e-13,
            "adaptive": True,
            "maxiter": 200 * len(x),
        }
        result = minimize(cost, x, method="Nelder-Mead", options=options)
        gain = value - result.fun
        if result.fun <= value:
            value, x = float(result.fun), result.x
        if not gain > 1e-10 * abs(value):
            break
        size = max(0.5 * size, 0.02)
    return value, x
