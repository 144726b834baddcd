"""Warnings about suspicious input: it can be used, but nearly always it has a wrong unit."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from ocptip.basics.errors import InputWarning

FARTHEST = 50.0
"""Lengths of a robot and its base above this, m, are taken for millimetres."""
_ROUNDED = 0.99  # of the mass in a URDF: less than that is no rounding of two digits


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


def too_light(mass: float, resting: float) -> str:
    """Why a base of this mass, kg, cannot hold the resting links of a URDF, kg; empty if it can."""
    if mass >= _ROUNDED * resting:
        return ""
    return (
        f"{mass:.4g} kg is less than the {resting:.4g} kg of those links of the URDF that do not move and "
        "are part of the base; give the mass of the whole base"
    )
