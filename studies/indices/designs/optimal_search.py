"""Search for symmetric platforms with control number 1 from random starts: a check that no family is missing.

Least squares on the seven conditions (7.27) over the nine shape parameters of two groups of legs; every
regular solution is classified by leg lengths and shape. Families: [Naw07] 7.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares

from ocptip.basics.errors import InputError, whole_number
from ocptip.indices.platforms.controllability import control_number
from studies.indices.designs.symmetric_platforms import SymmetricPlatform

Family = Literal["L_H", "L_S", "other"]
_SAME = 1e-4  # up to which heights and lengths, relative, are equal
_NAMES = ("a1", "b1", "r1", "phi1", "F", "a2", "b2", "r2", "phi2")


@dataclass(frozen=True, eq=False)
class FoundPlatform:
    """A regular solution of the seven conditions.

    Attributes:
        platform: its parameters.
        family: "L_H" (all legs equally long), "L_S" (one group in a plane) or "other".
        value: control number.
        defect: largest defect of (7.27).
    """

    platform: SymmetricPlatform
    family: Family
    value: float
    defect: float


@dataclass(frozen=True, eq=False)
class OptimalSearch:
    """Outcome of :func:`search_optimal`.

    Attributes:
        found: regular solutions with control number 1.
        starts: number of starts.
        unsolved: starts without a solution; nearly all of them run off to legs of infinite or vanishing
            length.
        singular: starts that ended in a singular pose, where the conditions hold trivially.
    """

    found: tuple[FoundPlatform, ...]
    starts: int
    unsolved: int
    singular: int

    def count(self, family: Family) -> int:
        """Number of solutions of a family."""
        return sum(item.family == family for item in self.found)

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "starts": self.starts,
            "unsolved": self.unsolved,
            "singular": self.singular,
            "families": {name: self.count(name) for name in ("L_H", "L_S", "other")},
            "found": [
                {"family": item.family, "value": item.value, "defect": item.defect}
                | {"parameters": item.platform.to_dict()}
                for item in self.found
            ],
        }


def search_optimal(starts: int = 60, seed: int = 0) -> OptimalSearch:
    """Solve the conditions (7.27) from random starts.

    Args:
        starts: number of starts, >= 1.
        seed: of the starts.

    Raises:
        InputError: starts is no positive integer.
    """
    starts = whole_number("starts", starts, 1)
    rng = np.random.default_rng(seed)
    found, unsolved, singular = [], 0, 0
    for _ in range(starts):
        start = rng.uniform(-2.0, 2.0, 9)
        start[[3, 8]] = rng.uniform(-np.pi, np.pi, 2)
        result = least_squares(
            lambda x: _platform(x).proportionality_defects(),
            start,
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
            max_nfev=400,
        )
        platform = _platform(result.x)
        defect = float(np.abs(result.fun).max())
        if defect > 1e-10:
            unsolved += 1
            continue
        value = _value(platform)
        if value < 1.0 - 1e-5:
            singular += value < 1e-3
            unsolved += value >= 1e-3
            continue
        found.append(FoundPlatform(platform, classify(platform), value, defect))
    return OptimalSearch(tuple(found), starts, unsolved, singular)


def classify(platform: SymmetricPlatform) -> Family:
    """Family of a platform with control number 1, by its shape."""
    one, two = platform.first, platform.second
    flat = [abs(group.y_height - group.x_height) <= _SAME for group in (one, two)]
    if flat[0] != flat[1]:
        return "L_S"
    equal = abs(one.squared_length - two.squared_length) <= _SAME * one.squared_length
    return "L_H" if equal and not any(flat) else "other"


def _platform(x: np.ndarray) -> SymmetricPlatform:
    return SymmetricPlatform.from_parameters(**dict(zip(_NAMES, map(float, x), strict=True)))


def _value(platform: SymmetricPlatform) -> float:
    """Control number; 0 where a leg has no length, which is singular."""
    try:
        return control_number(platform.pose()).value
    except InputError:
        return 0.0
