"""Bisection between a value with a result and one without, of one interval or of many."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def bisected(
    find: Callable[[float], T | None],
    without: float,
    having: float,
    result: T,
    near: Callable[[float, float], bool],
    likely: Callable[[float], bool] | None = None,
) -> tuple[float, T]:
    """Narrow an interval with a result at one end and none at the other.

    Args:
        find: the result at a value, or None.
        without: the end without a result.
        having: the other end, above or below.
        found: the result there.
        near: whether the ends, the lower one first, are near enough to each other.
        likely: a cheap prediction whether there is a result at a value. A costly `find` is then evaluated at
            the two final ends only, or everywhere if it contradicts the prediction there.

    Returns:
        The last value without a result, and the result next to it.
    """
    if likely is not None:
        presumed = bisected(lambda value: value if likely(value) else None, without, having, having, near)
        results = [find(end) if end not in (without, having) else None for end in presumed]
        last = result if presumed[1] == having else results[1]
        if results[0] is None and last is not None:
            return presumed[0], last
    while not near(*sorted((without, having))):
        middle = 0.5 * (without + having)
        new = find(middle)
        if new is None:
            without = middle
        else:
            having, result = middle, new
    return without, result


def border(
    kept: Callable[[float], bool], inside: float, outside: float, near: Callable[[float, float], bool]
) -> tuple[float, float]:
    """The last value at which something is kept, as at `inside`, and the next where not; see `bisected`."""
    return bisected(lambda value: None if kept(value) else value, inside, outside, outside, near)


def borders(
    kept: Callable[[np.ndarray], np.ndarray], inside: np.ndarray, outside: np.ndarray, halvings: int
) -> tuple[np.ndarray, np.ndarray]:
    """The same of many intervals (N,); `kept` says so (N,) at one value in each."""
    for _ in range(halvings if len(inside) else 0):
        middle = (inside + outside) / 2
        good = kept(middle)
        inside, outside = np.where(good, middle, inside), np.where(good, outside, middle)
    return inside, outside
