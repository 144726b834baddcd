"""Angles of joints that may turn more than once: copies a whole number of turns away."""

from __future__ import annotations

import numpy as np

from ocptip.numerics.vectors import TURN
from ocptip.robots.model import ArmModel

_SLACK = 1e-9  # rad: rounding must not take an angle at its limit away


def within_limits(model: ArmModel, angles: np.ndarray, near: np.ndarray | float = 0.0) -> np.ndarray:
    """Copies of joint angles, whole turns away, that are nearest to `near` within the joint limits.

    Args:
        angles: (..., n), rad.
        near: rad, broadcast to `angles`.

    Returns:
        (..., n), rad; NaN where no copy is within the limits.
    """
    low, high = model.limits.angle_min - _SLACK, model.limits.angle_max + _SLACK
    fewest, most = np.ceil((low - angles) / TURN), np.floor((high - angles) / TURN)
    turns = np.clip(np.round((near - angles) / TURN), fewest, np.maximum(fewest, most))
    return np.where(fewest <= most, angles + TURN * turns, np.nan)
