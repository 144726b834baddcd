"""Matrix inequalities and eigenvalue ratios as constraints of a nonlinear program (CasADi).

`ldl` and `lifted` are exact, `trace` is conservative: what it accepts satisfies the index. Leading principal
minors are not offered: an optimiser's tolerance on a tiny determinant lets the index be violated by far.

All functions take SX or MX matrices; SX gives far smaller programs. Scale the matrices to entries near one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.indices.arms.symbolic import (
    Symbolic,
    by_scalars,
    isotropy_surrogate,
    order,
    same_order,
    soft_smallest_eigenvalue,
)

Method = Literal["ldl", "lifted", "trace"]
METHODS = ("ldl", "lifted", "trace")

PIVOT_MARGIN = 1e-6
"""Pivots must stay above this, well above the feasibility tolerance of an optimiser."""


@dataclass(frozen=True, eq=False)
class ConstraintBlock:
    """Constraints lower <= g <= upper with their auxiliary variables.

    Attributes:
        g: (m, 1) expression.
        lower, upper: (m,) bounds of g.
        variables: (k, 1) auxiliary variables to add to the program; k may be 0.
        guess: start values (k,) of the auxiliary variables from the numeric values of the matrices that the
            block was made of, in the order of the arguments.
    """

    g: Symbolic
    lower: np.ndarray
    upper: np.ndarray
    variables: Symbolic
    guess: Callable[..., np.ndarray]


def psd_constraint(
    A: Symbolic, *, floor: Symbolic | float = 0.0, method: Method = "lifted", p: int = 8, name: str = "psd"
) -> ConstraintBlock:
    """A - floor * identity positive semidefinite, i.e. the smallest eigenvalue of A >= floor.

    Args:
        A: (m, m) symmetric expression; only the lower triangle is read.
        floor: number or scalar expression.
        method: "ldl": pivots of L D L', the last >= 0, the others >= PIVOT_MARGIN: few constraints, exact
            where one eigenvalue is at its bound, slightly conservative where two are; "lifted": A - floor = L
            L' with the triangle L as variables, exact and robust; "trace": (tr A^-p)^(-1/p) >= floor with the
            pivots of A >= PIVOT_MARGIN, conservative by at most a factor m^(-1/p); for positive floors and a
            positive definite start.
        p: power of "trace": a power of two.
        name: prefix of the auxiliary variables.

    Raises:
        InputError: A is not square, unknown method, or p no power of two.
    """
    m = order("A", A)
    if method == "trace":
        # The trace alone does not see the signs of the eigenvalues.
        pivots = [pivot - PIVOT_MARGIN for pivot in _pivots(A)]
        return inequality(cs.vertcat(soft_smallest_eigenvalue(A, p) - floor, *pivots))
    shifted = A - floor * cs.DM.eye(m)
    if method == "ldl":
        # A pivot of -1e-8, which an optimiser takes for zero, would make all later ones meaningless.
        pivots = _pivots(shifted)
        return inequality(cs.vertcat(*[pivot - PIVOT_MARGIN for pivot in pivots[:-1]], pivots[-1]))
    if method == "lifted":
        return _lifted(shifted, floor, name)
    raise InputError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")


def ratio_constraint(
    A: Symbolic, B: Symbolic, ratio: float, *, method: Method = "lifted", p: int = 8, name: str = "ratio"
) -> ConstraintBlock:
    """sqrt(lambda_min / lambda_max) >= ratio, with the eigenvalues of B x = lambda A x.

    "ldl" and "lifted": some s satisfies s A <= B <= (s / ratio^2) A as matrices, s being a variable.
    "trace": 6^(-1/p) times :func:`isotropy_surrogate` >= ratio, conservative.

    Args:
        A: (m, m) symmetric expression, positive definite in regular poses.
        B: (m, m) symmetric expression, positive definite.
        ratio: bound of the index, 0 < ratio <= 1.
        method, p, name: as for :func:`psd_constraint`.

    Returns:
        The block; `guess(A, B)` takes the numeric values of both matrices.

    Raises:
        InputError: an argument outside of its range.
    """
    m = same_order(A, B)
    ratio = positive_number("ratio", ratio)
    if ratio > 1.0:
        raise InputError(f"ratio: an index is at most 1, got {ratio}")
    if method == "trace":
        return inequality(float(m) ** (-1.0 / p) * isotropy_surrogate(A, B, p) - ratio)
    s = type(A).sym(f"{name}_s")
    lower = psd_constraint(B - s * A, method=method, name=f"{name}_lower")
    upper = psd_constraint(s * A - ratio**2 * B, method=method, name=f"{name}_upper")

    def guess(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
        factor = np.linalg.inv(np.linalg.cholesky(b))
        inverse = np.maximum(np.linalg.eigvalsh(factor @ a @ factor.T), 1e-12)
        middle = ratio / np.sqrt(inverse[0] * inverse[-1])
        return np.concatenate([[middle], lower.guess(b - middle * a), upper.guess(middle * a - ratio**2 * b)])

    return ConstraintBlock(
        cs.vertcat(lower.g, upper.g, s),
        np.concatenate([lower.lower, upper.lower, [0.0]]),
        np.concatenate([lower.upper, upper.upper, [np.inf]]),
        cs.vertcat(s, lower.variables, upper.variables),
        guess,
    )


def _lifted(matrix: Symbolic, floor: Symbolic | float, name: str) -> ConstraintBlock:
    m = matrix.shape[0]
    entries = type(matrix).sym(name, m * (m + 1) // 2)
    L = type(matrix).zeros(m, m)
    places = [(i, j) for j in range(m) for i in range(j, m)]
    for k, (i, j) in enumerate(places):
        L[i, j] = entries[k]
    product = L @ L.T
    equal = cs.vertcat(*[matrix[i, j] - product[i, j] for i, j in places])
    diagonal = cs.vertcat(*[entries[k] for k, (i, j) in enumerate(places) if i == j])
    count, value = len(places), _constant(floor)

    def guess(a: np.ndarray) -> np.ndarray:
        shifted = np.array(a, dtype=float) - value * np.eye(m)
        values, vectors = np.linalg.eigh((shifted + shifted.T) / 2.0)
        values = np.maximum(values, _START_FLOOR * max(values[-1], 1e-6))
        factor = np.linalg.cholesky((vectors * values) @ vectors.T)
        return np.array([factor[i, j] for i, j in places])

    return ConstraintBlock(
        cs.vertcat(equal, diagonal),
        np.zeros(count + m),
        np.concatenate([np.zeros(count), np.full(m, np.inf)]),
        entries,
        guess,
    )


_START_FLOOR = 1e-3
"""Start values of a lifted triangle: eigenvalues of at least this share of the largest."""


def inequality(g: Symbolic) -> ConstraintBlock:
    """g >= 0, entry by entry."""
    m = g.shape[0]
    return ConstraintBlock(g, np.zeros(m), np.full(m, np.inf), type(g)(0, 1), lambda *matrices: np.zeros(0))


def _pivots(A: Symbolic) -> list[Symbolic]:
    """D of A = L D L', without permutation."""
    return cs.vertsplit(by_scalars(lambda a: cs.ldl(a, False)[0], A))


def _constant(value: Symbolic | float) -> float:
    """The number behind a floor; 0 for an expression, whose value is not known to `guess`."""
    if isinstance(value, cs.SX | cs.MX):
        return float(cs.evalf(value)) if value.is_constant() else 0.0
    return float(value)
