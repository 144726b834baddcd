"""Bisection between a value with a result and one without; it keeps the last result."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def bisected(
    find: Callable[[float], T | None],
    without: float,
    having: float,
    found: T,
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
        last = found if presumed[1] == having else results[1]
        if results[0] is None and last is not None:
            return presumed[0], last
    while not near(*sorted((without, having))):
        middle = 0.5 * (without + having)
        new = find(middle)
        if new is None:
            without = middle
        else:
            having, found = middle, new
    return without, found
