"""Smooth stand-ins for extremal eigenvalues of a CasADi matrix, and for their ratios.

Indices are ratios of extremal eigenvalues, which have no derivative where eigenvalues meet: exactly in the
best poses of symmetric designs.

All functions take SX or MX matrices; SX gives far smaller programs. Scale the matrices to entries near one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import casadi as cs

from ocptip.basics.errors import InputError

if TYPE_CHECKING:
    Symbolic = Any  # CasADi's stubs have no operators between values that are SX or MX
else:
    Symbolic = cs.SX | cs.MX


def isotropy_surrogate(A: Symbolic, B: Symbolic, p: int = 8) -> Symbolic:
    """Smooth stand-in CI_p for c = sqrt(lambda_min / lambda_max) of B x = lambda A x.

    CI_p = (m^2 / (tr M^p tr M^-p))^(1/2p), M = A^-1 B: in [0, 1], one only where all eigenvalues are equal,
    and c <= CI_p <= m^(1/p) c.

    Args:
        A, B: (m, m) symmetric positive definite expressions.
        p: a power of two; 4 or 8 is good.

    Raises:
        InputError: shapes differ or p is no power of two.
    """
    m = same_order(A, B)
    forward = _power_trace(_solve(A, B), p)
    backward = _power_trace(_solve(B, A), p)
    return (m * m / (forward * backward)) ** (1.0 / (2 * p))


def soft_smallest_eigenvalue(A: Symbolic, p: int = 8) -> Symbolic:
    """(tr A^-p)^(-1/p): between m^(-1/p) and 1 times the smallest eigenvalue of a positive definite A."""
    m = order("A", A)
    return _power_trace(_solve(A, type(A)(cs.DM.eye(m))), p) ** (-1.0 / p)


def _solve(A: Symbolic, B: Symbolic) -> Symbolic:
    """A^-1 B by L D L' without permutation: right for positive definite A."""
    return by_scalars(lambda a, b: cs.ldl_solve(b, *cs.ldl(a, False)), A, B)


def by_scalars(compute: Callable[..., cs.SX], *matrices: Symbolic) -> Symbolic:
    """What CasADi computes of SX matrices alone, of SX or MX matrices."""
    if isinstance(matrices[0], cs.SX):
        return compute(*matrices)
    symbols = [cs.SX.sym("entries", *matrix.shape) for matrix in matrices]
    return cs.Function("by_scalars", symbols, [compute(*symbols)])(*matrices)


def _power_trace(M: Symbolic, p: int) -> Symbolic:
    """tr M^p by repeated squaring."""
    if isinstance(p, bool) or not isinstance(p, int) or p < 1 or p & (p - 1):
        raise InputError(f"p: expected a power of two, got {p!r}")
    while p > 2:
        M, p = M @ M, p // 2
    return cs.trace(M) if p == 1 else cs.sum1(cs.sum2(M * M.T))


def order(name: str, A: Symbolic) -> int:
    """Number of rows of a square matrix; InputError with its name otherwise."""
    if not isinstance(A, cs.SX | cs.MX) or A.shape[0] != A.shape[1]:
        raise InputError(f"{name}: expected a square SX or MX matrix, got {type(A).__name__}")
    return A.shape[0]


def same_order(A: Symbolic, B: Symbolic) -> int:
    """Number of rows of two square matrices A and B of one kind; InputError otherwise."""
    if order("A", A) != order("B", B) or type(A) is not type(B):
        raise InputError(f"B: expected the same kind and shape as A, got {B.shape} for {A.shape}")
    return A.shape[0]
