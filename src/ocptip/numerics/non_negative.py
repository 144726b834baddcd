"""Least squares over non-negative numbers, for small dense problems.

The active-set method of Lawson and Hanson (Solving Least Squares Problems, 1974, chapter 23). SciPy's nnls
(1.17.1) finds the same minima (4,000 random problems, some with linearly dependent columns), but the import
of scipy.optimize takes 0.37 s of CPU time, two thirds of a whole verdict on a scene; and here unknowns may
have any sign among the others.
"""

from __future__ import annotations

import numpy as np

from ocptip.numerics.jit.compiled import compiled

_SLOPE, _ZERO = 1e-15, 1e-15  # of columns and a right-hand side of length 1
_DEPENDENT = 1e-13  # of a column of length 1: what others leave of it is rounding


def non_negative(A: np.ndarray, b: np.ndarray, signed: int = 0) -> tuple[np.ndarray, float]:
    """x >= 0 (n,) with the minimum |A x - b|, and that minimum; A (m, n), b (m,).

    Args:
        A, b: of the equations.
        signed: number of the last columns whose x may be negative.

    Raises:
        RuntimeError: it takes more than 3 n steps.
    """
    lengths, unit = np.sqrt(np.sum(A * A, axis=0)), float(np.sqrt(b @ b)) or 1.0
    scale = np.where(lengths > 0, lengths, 1.0)
    x, done = _of_unit_columns(np.ascontiguousarray((A / scale).T), b / unit, A.shape[1] - signed)
    if not done:
        raise RuntimeError("too many steps")
    x *= unit / scale
    left = A @ x - b
    return x, float(np.sqrt(left @ left))


@compiled
def _of_unit_columns(columns: np.ndarray, b: np.ndarray, bounded: int) -> tuple[np.ndarray, bool]:
    """x (n,) for columns (n, m), of which the first `bounded` have no negative x; whether it is the best."""
    n = len(columns)
    chosen = np.empty(n, np.int64)  # the columns that take part: those of any sign, then as they came
    count = n - bounded
    for k in range(count):
        chosen[k] = bounded + k
    x, tried = np.zeros(n), np.zeros(n, np.bool_)
    basis, R, parts, projected = np.zeros((n, len(b))), np.zeros((n, n)), np.zeros(n), np.zeros(n, np.bool_)
    lefts = np.zeros((n + 1, len(b)))
    for i in range(len(b)):
        lefts[0, i] = b[i]
    left = _least_squares(columns, chosen[:count], 0, x, basis, R, parts, projected, lefts)
    for _ in range(3 * max(n, 1)):
        new, steepest = -1, _SLOPE
        for k in range(bounded):
            slope = _product(columns[k], left)
            if slope > steepest and x[k] == 0 and not tried[k]:
                new, steepest = k, slope
        if new < 0:
            return x, True
        chosen[count] = new
        wanted = np.zeros(n)
        rest = _least_squares(columns, chosen[: count + 1], count, wanted, basis, R, parts, projected, lefts)
        # A column that depends on the chosen ones would enter and leave for ever: it is not tried again until
        # another one helped.
        if wanted[new] <= _ZERO:  # depends on the others, but for rounding
            tried[new] = True
            continue
        for k in range(n):
            tried[k] = False
        count += 1
        while True:
            share, inside = 1.0, True
            for k in chosen[:count]:
                if k < bounded and wanted[k] <= 0:
                    share, inside = min(share, x[k] / (x[k] - wanted[k]) if x[k] > 0 else 0.0), False
            if inside:
                break
            for k in range(n):
                x[k] += share * (wanted[k] - x[k])
            # Columns before the first one that leaves keep their factors: only those after it are computed
            # again.
            kept, same = 0, count
            for index in range(count):
                k = chosen[index]
                if k >= bounded or x[k] > _ZERO:
                    chosen[kept] = k
                    kept += 1
                else:
                    x[k], same = 0.0, min(same, index)
            count = kept
            for k in range(n):
                wanted[k] = 0.0
            rest = _least_squares(columns, chosen[:count], same, wanted, basis, R, parts, projected, lefts)
        x, left = wanted, rest
    return x, False


@compiled
def _least_squares(columns, chosen, known, x, basis, R, parts, projected, lefts):
    """Puts the best x of the chosen columns into x, and returns b = lefts[0] less their sum.

    Each column is made orthogonal to those before it twice; one that depends on them gets 0. The results of
    the first `known` columns are in basis, R, parts, `own` and lefts already, from an earlier call.
    """
    size = len(chosen)
    for k in range(known, size):
        column, left = columns[chosen[k]].copy(), lefts[k + 1]
        for j in range(k + 1):
            R[j, k] = 0.0
        # One pass of Gram-Schmidt loses digits where columns are nearly dependent; the second one restores
        # them.
        for _ in range(2):
            for j in range(k):
                if projected[j]:
                    share = _product(basis[j], column)
                    R[j, k] += share
                    for i in range(len(column)):
                        column[i] -= share * basis[j, i]
        R[k, k] = np.sqrt(_product(column, column))
        projected[k] = R[k, k] > _DEPENDENT
        for i in range(len(left)):
            left[i] = lefts[k, i]
        if projected[k]:
            for i in range(len(column)):
                basis[k, i] = column[i] / R[k, k]
            parts[k] = _product(basis[k], left)
            for i in range(len(left)):
                left[i] -= parts[k] * basis[k, i]
    for k in range(size - 1, -1, -1):
        if projected[k]:
            total = parts[k]
            for j in range(k + 1, size):
                total -= R[k, j] * x[chosen[j]]
            x[chosen[k]] = total / R[k, k]
    return lefts[size]


@compiled
def _product(a, b):
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total
