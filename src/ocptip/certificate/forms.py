"""Taylor forms: enclosures of functions of s in [-1, 1], with all errors, those of rounding included.

A form is a polynomial of degree 5 and a bound of the distance from it. Many are worked on at once, the last
axis counting intervals. Every operation adds to the bound what it cuts off and what it may round, from
above: U times the absolute values that took part covers up to a hundred roundings of double precision, and
TINY what underflows.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

ORDER = 5
K = ORDER + 1
U = 2.0**-46
TINY = 1e-280
# Bernstein coefficients of s^j on [-1, 1]: row i, column j
_BERNSTEIN = np.array(
    [
        [
            sum(
                (-1.0) ** (j - m) * math.comb(j, m) * 2.0**m * math.comb(i, m) / math.comb(ORDER, m)
                for m in range(min(i, j) + 1)
            )
            for j in range(K)
        ]
        for i in range(K)
    ]
)


class Form:
    """Functions of s in [-1, 1]: within r (shape) of the polynomial with coefficients c (6, shape)."""

    __slots__ = ("c", "r")
    __array_ufunc__ = None  # arrays leave operators to the form

    def __init__(self, c: np.ndarray, r: np.ndarray) -> None:
        self.c, self.r = c, r

    @classmethod
    def of(cls, *c: np.ndarray, radius: Any = 0.0) -> Form:
        """From the coefficients of 1, s, s^2 ..., plus or minus the radius."""
        shape = np.broadcast_shapes(*(np.shape(x) for x in c), np.shape(radius))
        full = np.zeros((K, *shape))
        for k, x in enumerate(c):
            full[k] = x
        return cls(full, np.broadcast_to(radius, shape) + 0.0)

    @property
    def size(self) -> np.ndarray:
        """A bound of the absolute values of the polynomial."""
        return np.abs(self.c).sum(axis=0)

    def __getitem__(self, index: Any) -> Form:
        return Form(self.c[(slice(None), *(index if isinstance(index, tuple) else (index,)))], self.r[index])

    def __neg__(self) -> Form:
        return Form(-self.c, self.r)

    def __add__(self, other: Form | np.ndarray | float) -> Form:
        if not isinstance(other, Form):
            other = Form.of(np.broadcast_to(other, self.r.shape))
        c = self.c + other.c
        return Form(c, (self.r + other.r + U * np.abs(c).sum(axis=0)) * (1 + U) + TINY)

    def __sub__(self, other: Form | np.ndarray | float) -> Form:
        return self + (-other)

    def __mul__(self, other: Form | np.ndarray | float) -> Form:
        if not isinstance(other, Form):
            k = np.asarray(other)
            return Form(self.c * k, (np.abs(k) * (self.r + U * self.size)) * (1 + U) + TINY)
        rank = max(self.c.ndim, other.c.ndim)
        a, b = (f.c.reshape(K, *[1] * (rank - f.c.ndim), *f.r.shape) for f in (self, other))
        c = np.zeros(np.broadcast_shapes(a.shape, b.shape))
        size_a, size_b = np.abs(a), np.abs(b)
        tails = size_b[::-1].cumsum(axis=0)[::-1]  # of |b| from a degree on
        cut = 0.0
        for k in range(K):
            c[k:] += a[k] * b[: K - k]
            if k:
                cut = cut + size_a[k] * tails[K - k]
        A, B = size_a.sum(axis=0), tails[0]
        r = A * other.r + B * self.r + self.r * other.r + cut + U * A * B
        return Form(c, r * (1 + U) + TINY)

    @property
    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """A lower and an upper bound: the least and the greatest Bernstein coefficient, and the errors."""
        b = np.tensordot(_BERNSTEIN, self.c, axes=1)
        slack = (self.r + U * self.size) * (1 + U) + TINY
        return b.min(axis=0) - slack, b.max(axis=0) + slack

    def slope(self) -> Form:
        """Derivative with respect to s, of polynomials only (r must be 0)."""
        c = np.zeros_like(self.c)
        c[:-1] = self.c[1:] * np.arange(1, K).reshape(-1, *[1] * self.r.ndim)
        return Form(c, U * np.abs(c).sum(axis=0) + TINY)


def linear(matrix: np.ndarray, v: Form) -> Form:
    """Constant (m, k) or (m, k) per... times forms (k, N): (m, N)."""
    terms = U * matrix.shape[-1]  # each rounds
    r = np.abs(matrix) @ (v.r + terms * v.size)
    return Form(matrix @ v.c, r * (1 + terms) + TINY)


def stack(*forms: Form) -> Form:
    """Forms of one shape along a new first axis."""
    return Form(np.stack([f.c for f in forms], axis=1), np.stack([f.r for f in forms]))


def cos_sin(q: Form) -> tuple[Form, Form]:
    """By Taylor's formula about the middle, with Lagrange's remainder."""
    q0, rest = q.c[0], Form(q.c.copy(), q.r)
    rest.c[0] = 0.0
    D = rest.size + rest.r
    d = rest * rest
    one = Form.of(np.ones_like(q0))
    cosine = one - d * 0.5 * (one - d * (1 / 12) * (one - d * (1 / 30)))
    sine = rest * (one - d * (1 / 6) * (one - d * (1 / 20) * (one - d * (1 / 42))))
    cosine = Form(cosine.c, cosine.r + D**8 / 40320 * (1 + U))
    sine = Form(sine.c, sine.r + D**9 / 362880 * (1 + U))
    c0, s0 = np.cos(q0), np.sin(q0)  # of the machine's library, right to a few last places
    both = cosine.size + sine.size + cosine.r + sine.r
    out = [cosine * c0 - sine * s0, sine * c0 + cosine * s0]
    return tuple(Form(f.c, f.r + U * both) for f in out)  # type: ignore[return-value]
