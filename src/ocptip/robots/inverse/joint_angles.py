"""Angles of joints that may turn more than once: copies a whole number of turns away.

Lengths have no copies, nor have angles that other joints follow (`ArmModel.periodic`).
"""

from __future__ import annotations

import numpy as np

from ocptip.numerics.vectors import TURN, nearest_turn, wrapped
from ocptip.robots.model import ArmModel

_SLACK = 1e-9  # rad and m: rounding must not take a joint at its limit away
_ENDLESS = 1.0  # m: where to look on a sliding joint without limits, to either side


def within_limits(model: ArmModel, angles: np.ndarray, near: np.ndarray | float = 0.0) -> np.ndarray:
    """Copies of joint angles, whole turns away, that are nearest to `near` within the joint limits.

    Args:
        angles: (..., n), rad (sliding joints: m).
        near: rad, broadcast to `angles`.

    Returns:
        (..., n), rad; NaN where no copy is within the limits.
    """
    low, high = model.limits.angle_min - _SLACK, model.limits.angle_max + _SLACK
    fewest, most = np.ceil((low - angles) / TURN), np.floor((high - angles) / TURN)
    turns = np.clip(np.round((near - angles) / TURN), fewest, np.maximum(fewest, most))
    copies = np.where(fewest <= most, angles + TURN * turns, np.nan)
    single = np.where((low <= angles) & (angles <= high), angles, np.nan)
    return np.where(model.periodic, copies, single)


def once_around(model: ArmModel, q: np.ndarray) -> np.ndarray:
    """Equivalent joint angles in (-pi, pi]; coordinates that are not periodic are unchanged."""
    return np.where(model.periodic, wrapped(q), q)


def nearest_copies(model: ArmModel, q: np.ndarray, near: np.ndarray | float = 0.0) -> np.ndarray:
    """Equivalent joint angles at most half a turn from `near`, regardless of limits; others are unchanged."""
    return np.where(model.periodic, nearest_turn(q, near), q)


def search_box(model: ArmModel, *, limits: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds (n,) between which a search begins: within one turn, and within the limits.

    What has no copies always begins within its limits; without `limits` the others begin anywhere.
    """
    low, high = model.limits.angle_min, model.limits.angle_max
    least, most = (np.maximum(low, -np.pi), np.minimum(high, np.pi)) if limits else (-np.pi, np.pi)
    wide = np.where(model.prismatic, _ENDLESS, np.pi)
    middle = np.where(np.isfinite(low), low + wide, np.where(np.isfinite(high), high - wide, 0.0))
    first = np.where(np.isfinite(low), low, middle - wide)
    last = np.where(np.isfinite(high), high, middle + wide)
    return np.where(model.periodic, least, first), np.where(model.periodic, most, last)
