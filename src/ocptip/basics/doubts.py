"""Warnings about input that can be used but is hardly what was meant: nearly always a wrong unit."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from ocptip.basics.errors import InputWarning

FARTHEST = 50.0
"""Lengths of a robot and its base above this, m, are taken for millimetres."""


def doubt(message: str) -> None:
    """Warn with an InputWarning."""
    warnings.warn(message, InputWarning, stacklevel=3)


def doubt_degrees(where: str, angles: Any) -> None:
    """Warn if angles that should be degrees, not all zero, are all within a turn in radians."""
    largest = np.abs(np.asarray(angles, dtype=float)).max(initial=0.0)
    if 0 < largest < 2 * np.pi:
        doubt(f"{where}: no angle is above {largest:.4g} degrees; are they radians?")


def doubt_metres(where: str, lengths: Any) -> None:
    """Warn if one of some lengths, m, is above `FARTHEST`."""
    largest = np.abs(np.asarray(lengths, dtype=float)).max(initial=0.0)
    if largest > FARTHEST:
        doubt(f"{where}: {largest:.4g} m is far for a robot; are these millimetres?")
