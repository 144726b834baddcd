"""Vectors in space and angles: cross products, skew matrices, whole turns, distinct rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

TURN = 2 * np.pi
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product along the last axis, (..., 3); a quarter of the time of numpy.cross for few vectors."""
    if a.ndim == b.ndim == 1:
        return np.array(cross_terms(a, b))
    return a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]


def cross_terms(a: Sequence[Any] | np.ndarray, b: Sequence[Any] | np.ndarray) -> list[Any]:
    """a x b of three scalars each, numbers or CasADi's."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def perpendicular(vector: np.ndarray) -> np.ndarray:
    """(3,) of length one, orthogonal to a vector (3,)."""
    across = np.cross(vector, np.eye(3)[np.argmin(np.abs(vector))])
    return across / np.linalg.norm(across)


def distinct_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct ones of rows (N, k), and of each row which it is (N,)."""
    if len(rows) and np.array_equal(rows[1:], rows[:-1]):  # sorting one row takes longer than all else
        return rows[:1], np.zeros(len(rows), dtype=np.intp)
    distinct, which = np.unique(rows, axis=0, return_inverse=True)
    return distinct, which.reshape(-1)


def skew(vector: np.ndarray) -> np.ndarray:
    """[v]×: (..., 3, 3) with [v]× x = v × x, of vectors (..., 3)."""
    matrix = np.zeros((*vector.shape, 3))
    matrix[..., _NEXT, _LAST], matrix[..., _LAST, _NEXT] = -vector, vector
    return matrix


def wrapped(angles: ArrayLike) -> np.ndarray:
    """The same angles, rad, in (-pi, pi]."""
    return np.arctan2(np.sin(angles), np.cos(angles))


def nearest_turn(angles: ArrayLike, near: ArrayLike = 0.0) -> np.ndarray:
    """The same angles, rad, whole turns away, at most half a turn from `near`."""
    angles = np.asarray(angles)
    return angles + TURN * np.round((np.asarray(near) - angles) / TURN)
