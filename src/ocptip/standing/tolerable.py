"""How much of a tolerance a robot at rest can have: why a task within a tolerance is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ocptip.standing.tolerance import Tolerance
from ocptip.standing.worst_case import WorstCase

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


def why_not_at_rest(cases: WorstCase, s: np.ndarray, kept: Callable[[WorstCase], bool]) -> str:
    """Which quantity alone is too much, and how much of it is not; else how much of everything together.

    Args:
        cases: of the robot within the tolerance.
        s: (1, 3 n) state at rest.
        kept: whether nothing is lost within a tolerance.
    """
    own = cases.deviations.tolerance
    if not kept(cases.within(Tolerance())):
        return "it cannot have any tolerance"
    for name in AT_REST:
        alone = own.only(name) if name in own.given else None
        if alone is not None and not kept(cases.within(alone)):
            factor = _largest(cases, alone, kept)
            found = alone.scaled(factor) if factor > 0 else None
            return f"of {alone} alone it can have {found or 'none'}" if found else f"it can have no {alone}"
    factor = _largest(cases, own.only(*AT_REST), kept)
    return f"each alone it could have, together {100 * factor:.0f} % of everything"


def _largest(cases: WorstCase, tolerance: Tolerance, kept: Callable[[WorstCase], bool]) -> float:
    low, high = 0.0, 1.0
    while high - low > CLOSE:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if kept(cases.within(tolerance.scaled(middle))) else (low, middle)
    return low
