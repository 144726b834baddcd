"""Least squares over non-negative numbers, for small dense problems.

The active-set method of Lawson and Hanson (Solving Least Squares Problems, 1974, chapter 23), here because
the import of scipy.optimize takes longer than most verdicts, and for unknowns of any sign among the others.
"""

from __future__ import annotations

import numpy as np

_SLOPE, _ZERO = 1e-13, 1e-15  # of columns and a right-hand side of length 1


def non_negative(A: np.ndarray, b: np.ndarray, signed: int = 0) -> tuple[np.ndarray, float]:
    """x >= 0 (n,) with the least |A x - b|, and that; A (m, n), b (m,).

    Args:
        A, b: of the equations.
        signed: number of the last columns whose x may be negative.

    Raises:
        RuntimeError: it takes more than 3 n steps.
    """
    lengths, unit = np.linalg.norm(A, axis=0), float(np.linalg.norm(b)) or 1.0
    scale = np.where(lengths > 0, lengths, 1.0)
    bounded = np.arange(A.shape[1]) < A.shape[1] - signed
    x = _of_unit_columns(A / scale, b / unit, bounded) * unit / scale
    return x, float(np.linalg.norm(A @ x - b))


def _of_unit_columns(A: np.ndarray, b: np.ndarray, bounded: np.ndarray) -> np.ndarray:
    free, tried = ~bounded, np.zeros(len(bounded), dtype=bool)
    x = _least_squares(A, b, free)
    for _ in range(3 * max(len(bounded), 1)):
        slope = np.where(free | tried, -np.inf, A.T @ (b - A @ x))
        if not np.max(slope, initial=-np.inf) > _SLOPE:
            return x
        new = int(np.argmax(slope))
        free[new] = True
        wanted = _least_squares(A, b, free)
        if wanted[new] <= _ZERO:  # depends on the others, but for rounding
            free[new], tried[new] = False, True
            continue
        tried[:] = False
        while (down := np.flatnonzero(free & bounded & (wanted <= 0))).size:
            x += np.min(x[down] / (x[down] - wanted[down])) * (wanted - x)
            free &= (x > _ZERO) | ~bounded
            x[~free] = 0.0
            wanted = _least_squares(A, b, free)
        x = wanted
    raise RuntimeError("too many steps")


def _least_squares(A: np.ndarray, b: np.ndarray, free: np.ndarray) -> np.ndarray:
    x = np.zeros(A.shape[1])
    x[free] = np.linalg.lstsq(A[:, free], b, rcond=None)[0]
    return x
