"""How much of a tolerance is possible: why something within a tolerance is refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ocptip.standing.tolerance import Tolerance

CLOSE = 1e-3  # of a tolerance: how near the bisection gets
AT_REST = (
    "tilt",
    "extra_mass",
    "payload_mass",
    "push",
    "base_push",
    "base_mass",
    "arm_mass",
    "center_of_mass",
    "payload_center",
    "friction",
)  # what counts without motion, likely culprits first
IN_MOTION = (*AT_REST, "speed", "delay", "damping")


def why_not(tolerance: Tolerance, names: Sequence[str], kept: Callable[[Tolerance], bool]) -> str:
    """Which quantity alone is too much, and how much of it is not; else how much of everything together.

    Args:
        tolerance: with which something is lost.
        names: of the quantities that count, likely culprits first.
        kept: whether nothing is lost within a tolerance.
    """
    if not kept(Tolerance()):
        return "it does not stand as described"
    given = [name for name in names if name in tolerance.given]
    for name in given:
        alone = tolerance.only(name)
        if not kept(alone):
            factor = largest(alone, kept)
            return f"of {alone} alone it can have {alone.scaled(factor)}" if factor else f"no {alone} alone"
    share = 100 * largest(tolerance.only(*given), kept)
    return f"each alone it can have, together {share:.0f} % of everything"


def largest(tolerance: Tolerance, kept: Callable[[Tolerance], bool], close: float = CLOSE) -> float:
    """The largest factor of a tolerance, 0 to 1, with which nothing is lost, by bisection."""
    if kept(tolerance):
        return 1.0
    low, high = 0.0, 1.0
    while high - low > close:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if kept(tolerance.scaled(middle)) else (low, middle)
    return low
