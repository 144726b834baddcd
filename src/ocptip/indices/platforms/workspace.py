"""Indices of platforms over many poses: maps and statistics.

An index of a pose serves control; for design it is taken over a sample of the workspace (minimum, mean,
percentile).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.indices.platforms.platform import LEG_TOLERANCE, StewartPlatform
from ocptip.indices.reviewed import RANK_TOLERANCE
from ocptip.numerics.vectors import skew


def control_numbers(platform: StewartPlatform, positions: ArrayLike, rotations: ArrayLike) -> np.ndarray:
    """Control numbers of many poses at once.

    Args:
        platform: anchors.
        positions: (k, 3) or (3,), m, base frame.
        rotations: (k, 3, 3) or (3, 3) rotation matrices, platform frame to base frame.

    Returns:
        (k,) as `control_number` gives them one by one; NaN where a leg has length zero.

    Raises:
        InputError: shapes that do not fit.
    """
    b, p = _anchors(platform, positions, rotations)
    count, n = p.shape[:2]
    points = np.concatenate([b, p], axis=1)
    centre = points.mean(axis=1, keepdims=True)
    extent = np.sqrt(((points - centre) ** 2).sum(axis=(1, 2)) / (2 * n))[:, None, None]
    b, p = (b - centre) / extent, (p - centre) / extent
    legs = p - b
    lengths = np.linalg.norm(legs, axis=2)
    exists = lengths.min(axis=1) > LEG_TOLERANCE
    values = np.full(count, np.nan)
    b, p, legs, lengths = b[exists], p[exists], legs[exists], lengths[exists]
    units = legs / lengths[..., None]
    J = np.concatenate([np.cross(b, units), units], axis=2)
    across = skew(units / lengths[..., None])
    A = np.concatenate(
        [np.concatenate([-across @ skew(points), across], axis=3) for points in (p, b)], axis=1
    ).reshape(len(b), 6 * n, 6)
    R = np.linalg.qr(A, mode="r")
    pivots = np.abs(np.diagonal(R, axis1=1, axis2=2))
    sighted = pivots.min(axis=1) > 1e-12 * pivots.max(axis=1)
    regular = _regular(J) & sighted
    ratios = np.zeros(len(b))
    forms = np.linalg.solve(R[regular].transpose(0, 2, 1), J[regular].transpose(0, 2, 1))
    singular_values = np.linalg.svd(forms, compute_uv=False)
    ratios[regular] = singular_values[:, -1] / singular_values[:, 0]
    values[exists] = ratios
    return values


def _anchors(
    platform: StewartPlatform, positions: ArrayLike, rotations: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """(k, n, 3) base and platform anchors of k poses."""
    t = np.atleast_2d(finite_array("positions", positions, (3,) if np.ndim(positions) == 1 else (None, 3)))
    shape = (3, 3) if np.ndim(rotations) == 2 else (None, 3, 3)
    R = finite_array("rotations", rotations, shape).reshape(-1, 3, 3)
    if len(R) and np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max() > 1e-9:
        raise InputError("rotations: no rotation matrices")
    if len(t) != len(R) and 1 not in (len(t), len(R)):
        raise InputError(f"rotations: expected {len(t)} as positions, got {len(R)}")
    count = max(len(t), len(R))
    moved = platform.platform @ R.transpose(0, 2, 1) + t[:, None, :]
    return np.broadcast_to(platform.base, (count, *platform.base.shape)), moved


def _regular(J: np.ndarray) -> np.ndarray:
    if not len(J):
        return np.zeros(0, dtype=bool)
    values = np.linalg.svd(J, compute_uv=False)
    return values[:, -1] > RANK_TOLERANCE * values[:, 0]
