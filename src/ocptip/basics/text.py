"""Numbers as people read them, for tables and pictures."""

from __future__ import annotations

import math

import numpy as np

NOISE = 1e-9
"""Values below this, relative to the largest one beside them, are shown as zero."""


def without_noise(values: np.ndarray) -> np.ndarray:
    """Zero where a value is nothing but rounding; NaN and infinity stay."""
    finite = np.abs(values[np.isfinite(values)])
    return np.where(np.abs(values) <= NOISE * (finite.max() if finite.size else 0.0), 0.0, values)


def ratio(value: float) -> str:
    """A dimensionless number of the size of one: "0.166", "infinite", "-"."""
    if not math.isfinite(value):
        return "infinite" if value > 0 else "-"
    return f"{value if abs(value) > NOISE else 0.0:.3g}"


def percent(share: float) -> str:
    """A share: "16 %", "-"."""
    return f"{100 * share:.0f} %" if math.isfinite(share) else "-"


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """A quantity: "116.5 N", "unlimited", "-"."""
    if not math.isfinite(value):
        return "unlimited" if value > 0 else "-"
    return f"{value + 0.0:.{digits}g} {unit}"
