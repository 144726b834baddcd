"""Cells and reaches of load, tilt and push charts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class ChartCell:
    """Postures whose TCP is in one cell of the chart.

    Attributes:
        azimuth: rad, ends of the sector; None: all around.
        reach: m, ends.
        height: m, ends; None: all heights.
        postures: that were sampled there and do not collide.
        any_posture: kg, deg or N: the smallest of their largest levels: whatever the posture.
        best_posture: the largest of them.
        limit, limit_best: what decides there.
    """

    azimuth: tuple[float, float] | None
    reach: tuple[float, float]
    height: tuple[float, float] | None
    postures: int
    any_posture: float
    best_posture: float
    limit: str
    limit_best: str

    def to_dict(self, name: str, unit: str) -> dict[str, Any]:
        """Plain data: degrees, m; the name and the unit of the levels are part of keys."""
        azimuth = self.azimuth and [float(round(np.degrees(end), 9)) for end in self.azimuth]
        return {
            "azimuth_deg": azimuth,
            "reach_m": list(self.reach),
            "height_m": self.height and list(self.height),
            "postures": self.postures,
            f"{name}_any_posture_{unit}": self.any_posture,
            "limit": self.limit,
            f"{name}_best_posture_{unit}": self.best_posture,
            "limit_best_posture": self.limit_best,
        }


@dataclass(frozen=True)
class ReachBySector:
    """Largest reaches of one level, m, by sector; None where no posture was sampled.

    Attributes:
        level: kg, deg or N.
        any_posture: within it every sampled posture keeps the limits at this level.
        best_posture: the largest one of a posture that keeps them; None where none does.
    """

    level: float
    any_posture: tuple[float | None, ...]
    best_posture: tuple[float | None, ...]
