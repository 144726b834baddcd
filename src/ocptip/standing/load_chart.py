"""What load charts consist of: cells with their payloads, and reaches of payloads."""

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
        any_posture: kg, the smallest of their largest payloads: whatever the posture.
        best_posture: kg, the largest of them.
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

    def to_dict(self) -> dict[str, Any]:
        """Plain data: degrees, m and kg."""
        azimuth = self.azimuth and [float(round(np.degrees(end), 9)) for end in self.azimuth]
        return {
            "azimuth_deg": azimuth,
            "reach_m": list(self.reach),
            "height_m": self.height and list(self.height),
            "postures": self.postures,
            "payload_any_posture_kg": self.any_posture,
            "limit": self.limit,
            "payload_best_posture_kg": self.best_posture,
            "limit_best_posture": self.limit_best,
        }


@dataclass(frozen=True)
class ReachBySector:
    """Largest reaches of one payload, m, by sector; None where no posture was sampled.

    Attributes:
        payload: kg.
        any_posture: within it every sampled posture holds the payload.
        best_posture: the largest one of a posture that holds the payload; None where none does.
    """

    payload: float
    any_posture: tuple[float | None, ...]
    best_posture: tuple[float | None, ...]
