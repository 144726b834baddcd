"""Limits of a mechanism on functions of its state that are neither torques nor coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ocptip.robots.kinematics import TCP

TCP_SPEED, POINT_SPEED = "tcp_speed_m_s", "point_speed_m_s"
"""Speeds of an arm's TCP and of origins of its joints' frames, in results."""


@dataclass(frozen=True, eq=False)
class FurtherLimits:
    """Limits of a mechanism on functions of its state that are neither torques nor coordinates.

    Attributes:
        names: (k,), of quantities; a check reports the worst of each name.
        details: (k,), which one, e.g. "motor 2".
        lower, upper: (k,), infinite where there is none.
        units: (k,), numbers that make the quantity about 1.
    """

    names: tuple[str, ...] = ()
    details: tuple[str, ...] = ()
    lower: np.ndarray = field(default_factory=lambda: np.empty(0))
    upper: np.ndarray = field(default_factory=lambda: np.empty(0))
    units: np.ndarray = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of_points(cls, speeds: Mapping[str, float]) -> FurtherLimits:
        """Limits of the speeds of points of an arm, m/s, by their names."""
        values = np.array(list(speeds.values()), dtype=float)
        return cls(
            names=tuple(TCP_SPEED if point == TCP else POINT_SPEED for point in speeds),
            details=tuple("TCP" if point == TCP else point for point in speeds),
            lower=np.full(len(values), -np.inf),
            upper=values,
            units=values,
        )

    @property
    def count(self) -> int:
        """Number of quantities k."""
        return len(self.names)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the quantities for columns of tables, such as "motor_speed_motor_2"."""
        pairs = zip(self.names, self.details, strict=True)
        return tuple(f"{name}_{detail.replace(' ', '_')}" for name, detail in pairs)

    @property
    def limited(self) -> np.ndarray:
        """(k,) True where there is a limit."""
        return np.isfinite(self.lower) | np.isfinite(self.upper)

    def described(self, k: int, excess: float) -> tuple[float, float, bool]:
        """Value of a quantity (its size, if it has an upper limit), limit, and whether that is a minimum.

        Args:
            k: which quantity.
            excess: of :meth:`excess`.
        """
        if np.isfinite(self.upper[k]):
            return float(self.upper[k] + excess * self.units[k]), float(self.upper[k]), False
        return float(self.lower[k] - excess * self.units[k]), float(self.lower[k]), True

    def excess(self, values: np.ndarray) -> np.ndarray:
        """The violations of limits by values (..., k), in their units; negative within the limits."""
        return np.maximum(self.lower - values, values - self.upper) / self.units
