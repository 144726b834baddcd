"""One index of one pose: value, bounds, unit and what it means."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class IndexEntry:
    """One performance index of a pose.

    Attributes:
        name: unique within a rating, e.g. "pi_oe".
        symbol: as in the literature, e.g. "PI_OE".
        value: the index; infinite where it is defined so; NaN where it is not defined for this mechanism.
        lower, upper: bounds of its values; upper is infinite if there is none.
        unit: "1" for dimensionless.
        meaning: one sentence for people who read the number.
        status: "ok", or what is special about this pose.
    """

    name: str
    symbol: str
    value: float
    lower: float
    upper: float
    unit: str
    meaning: str
    status: str = "ok"

    def to_dict(self) -> dict[str, Any]:
        """Plain data; infinity and NaN as None."""
        fields = {"name": self.name, "symbol": self.symbol, "unit": self.unit}
        numbers = {"value": self.value, "lower": self.lower, "upper": self.upper}
        finite = {key: x if math.isfinite(x) else None for key, x in numbers.items()}
        return {**fields, **finite, "meaning": self.meaning, "status": self.status}
