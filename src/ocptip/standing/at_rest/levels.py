"""The largest levels that many postures keep, and what limits them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class LargestLevels:
    """The largest levels in N postures.

    Attributes:
        levels: (N,), kg, rad or N; 0 where a limit is broken at level zero.
        limits: (N,) which of `names` decides.
        names: of the limits: tipping axes, friction, torques of joints, and last the maximum asked for.
        kept_at_zero: (N,) True where all limits are kept at level zero.
    """

    levels: np.ndarray
    limits: np.ndarray
    names: tuple[str, ...]
    kept_at_zero: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence[LargestLevels]) -> LargestLevels:
        """The levels of all postures of parts with the same limits, one or more."""
        arrays = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("levels", "limits", "kept_at_zero")
        )
        levels, limits, kept = arrays
        return cls(levels, limits, parts[0].names, kept)


def largest_tried(name: str) -> str:
    """Name of the maximum asked for among the limits."""
    return f"largest {name} tried"
