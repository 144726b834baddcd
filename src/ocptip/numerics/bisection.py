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
) -> tuple[float, T]:
    """Narrow an interval with a result at one end and none at the other.

    Args:
        find: the result at a value, or None.
        without: the end without a result.
        having: the other end, above or below.
        found: the result there.
        near: whether the ends, the lower one first, are near enough to each other.

    Returns:
        The last value without a result, and the result next to it.
    """
    while not near(*sorted((without, having))):
        middle = 0.5 * (without + having)
        new = find(middle)
        if new is None:
            without = middle
        else:
            having, found = middle, new
    return without, found
