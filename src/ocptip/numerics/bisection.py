"""Bisection that keeps what was found on the side where something is found."""

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
    """Narrow an interval at one end of which something is found, and at the other nothing.

    Args:
        find: what is found at a value, or None.
        without: the end where nothing is found.
        having: the other end, above or below.
        found: what is found there.
        near: whether the ends, the lower one first, are near enough to each other.

    Returns:
        The last value at which nothing was found, and what was found next to it.
    """
    while not near(*sorted((without, having))):
        middle = 0.5 * (without + having)
        new = find(middle)
        if new is None:
            without = middle
        else:
            having, found = middle, new
    return without, found
