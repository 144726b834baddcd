"""The largest possible share of an uncertainty, and reasons why motions within it are refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ocptip.numerics.bisection import border
from ocptip.standing.tolerance import Uncertainty

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
UNDESCRIBED = "it is not stable in the nominal model"
IN_MOTION = (*AT_REST, "speed", "drive_speed", "delay", "damping")


def why_not(
    tolerance: Uncertainty, names: Sequence[str], kept: Callable[[Uncertainty], bool]
) -> tuple[str, float]:
    """Which quantity alone is too much, and how much of it is not; else how much of everything together.

    Args:
        tolerance: with which something is lost.
        names: of the quantities that count, likely culprits first.
        kept: whether nothing is lost within an uncertainty.
    """
    if not kept(Uncertainty()):
        return UNDESCRIBED, 0.0
    too_much, factor = culprit(tolerance, names, kept)
    return culprit_words(too_much, factor), factor


def culprit_words(too_much: Uncertainty, factor: float) -> str:
    """The result of `culprit`, in words."""
    if len(too_much.given) > 1:
        return f"each of them alone is possible, all together at {100 * factor:.0f} %"
    possible = too_much.scaled(factor) if factor else "none of it"
    return f"{too_much} alone is too much, possible is {possible}"


def culprit(
    tolerance: Uncertainty, names: Sequence[str], kept: Callable[[Uncertainty], bool]
) -> tuple[Uncertainty, float]:
    """The first quantity that alone is too much, else everything, and which factor of it is not."""
    for name in names:
        if name in tolerance.given and not kept(alone := tolerance.only(name)):
            return alone, largest(alone, kept)
    counting = tolerance.only(*(name for name in names if name in tolerance.given))
    return counting, largest(counting, kept)


def largest(tolerance: Uncertainty, kept: Callable[[Uncertainty], bool], close: float = CLOSE) -> float:
    """The largest factor of an uncertainty, 0 to 1, with which nothing is lost, by bisection."""
    if kept(tolerance):
        return 1.0

    def kept_share(share: float) -> bool:
        return kept(tolerance.scaled(share))

    return border(kept_share, 0.0, 1.0, lambda low, high: high - low <= close)[0]
