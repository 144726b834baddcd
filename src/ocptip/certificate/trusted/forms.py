"""Taylor forms: enclosures of functions of s in [-1, 1], with all errors, those of rounding included.

A form is a polynomial of degree 5 and a bound of the distance from it. Many are worked on at once, the last
axis counting intervals. Every operation adds to the bound what it cuts off and what it may round, from
above: U times the absolute values that took part covers up to a hundred roundings of double precision, and
TINY what underflows.

Forms may depend on m further numbers e_j in [-1, 1], too: after the powers of s they then have coefficients
of e_1 ... e_m, e_1 s ... e_m s and e_i e_j (i <= j); what is of higher degree is cut off.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

ORDER = 5
K = ORDER + 1
U = 2.0**-46
TINY = 1e-280
# Bernstein coefficients of s^j on [-1, 1]: row i, column j
BERNSTEIN = np.array(
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


def length(m: int) -> int:
    """Number of coefficients of forms in s and m further numbers."""
    return K + 2 * m + m * (m + 1) // 2


# degrees in s and in the further numbers of groups of coefficients; which two groups make none
_DEGREES = [*((k, 0) for k in range(K)), (0, 1), (1, 1), (0, 2)]
_DROPPED = np.array([[float((a + b, i + j) not in _DEGREES) for b, j in _DEGREES] for a, i in _DEGREES])


@lru_cache
def numbers_of(count: int) -> tuple[int, np.ndarray, np.ndarray]:
    """For forms with `count` coefficients: m, and the pairs i <= j."""
    m = next(m for m in range(count) if length(m) == count)
    return m, *np.triu_indices(m)


def _groups(size: np.ndarray, m: int) -> np.ndarray:
    """Absolute values of coefficients, summed by their degrees."""
    if not m:
        return size
    ends = (size[K : K + m], size[K + m : K + 2 * m], size[K + 2 * m :])
    return np.concatenate([size[:K], *(part.sum(axis=0)[None] for part in ends)])


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
        least, most = sorted((self.c, other.c), key=len)
        c = np.zeros((len(most), *np.broadcast_shapes(most.shape[1:], least.shape[1:])))
        c += most
        c[: len(least)] += least
        return Form(c, (self.r + other.r + U * np.abs(c).sum(axis=0)) * (1 + U) + TINY)

    def __sub__(self, other: Form | np.ndarray | float) -> Form:
        return self + (-other)

    def __mul__(self, other: Form | np.ndarray | float) -> Form:
        if not isinstance(other, Form):
            k = np.asarray(other)
            return Form(self.c * k, (np.abs(k) * (self.r + U * self.size)) * (1 + U) + TINY)
        first, second = alike(self.c, other.c)
        rank = max(first.ndim, second.ndim)
        a, b = (c.reshape(len(c), *[1] * (rank - c.ndim), *c.shape[1:]) for c in (first, second))
        m = numbers_of(len(a))[0]
        c = np.zeros(np.broadcast_shapes(a.shape, b.shape))
        for k in range(K):
            c[k:K] += a[k] * b[: K - k]
        if m:
            (a0, a1), (b0, b1) = (x[K : K + 2 * m].reshape(2, m, *x.shape[1:]) for x in (a, b))
            c[K : K + m] = a[0] * b0 + b[0] * a0
            c[K + m : K + 2 * m] = a[0] * b1 + a[1] * b0 + b[0] * a1 + b[1] * a0
            row = K + 2 * m
            for constant, bends in ((a[0], b[row:]), (b[0], a[row:])):
                if bends.any():
                    c[row:] += constant * bends
            for i in range(m):  # e_i e_j with j = i ... m - 1 are neighbours
                if a0[i].any():
                    c[row : row + m - i] += a0[i] * b0[i:]
                if b0[i].any():
                    c[row + 1 : row + m - i] += b0[i] * a0[i + 1 :]
                row += m - i
        size_a, size_b = _groups(np.abs(a), m), _groups(np.abs(b), m)
        A, B = size_a.sum(axis=0), size_b.sum(axis=0)
        dropped = _DROPPED[: len(size_a), : len(size_b)]
        cut = np.sum(size_a * np.tensordot(dropped, size_b, axes=1), axis=0)
        r = A * other.r + B * self.r + self.r * other.r + cut + U * A * B
        return Form(c, r * (1 + U) + TINY)

    def half(self, k: int, side: float) -> Form:
        """Where the number e_k, counted from 0, has this sign, -1 or 1: in its place within this half."""
        c, (m, i, j) = self.c.copy(), numbers_of(len(self.c))
        mixed, square = np.flatnonzero((i == k) != (j == k)), K + 2 * m + np.flatnonzero((i == k) & (j == k))
        places = [(0, K + k), (1, K + m + k), *((K + i[p] + j[p] - k, K + 2 * m + p) for p in mixed)]
        for place, part in places:
            c[place] += 0.5 * side * self.c[part]
            c[part] *= 0.5
        c[0] += 0.25 * self.c[square][0]
        c[K + k] += 0.5 * side * self.c[square][0]
        c[square] *= 0.25
        return Form(c, (self.r + 4 * U * self.size) * (1 + U) + TINY)

    @property
    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """A lower and an upper bound: the minimum and the maximum Bernstein coefficient, and the errors."""
        b = np.tensordot(BERNSTEIN, self.c[:K], axes=1)
        slack = (self.r + U * self.size + np.abs(self.c[K:]).sum(axis=0)) * (1 + U) + TINY
        return b.min(axis=0) - slack, b.max(axis=0) + slack


def alike(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of as many numbers: those of a form in s alone go with zeros."""
    most = max(len(a), len(b))
    return tuple(
        c if len(c) == most else np.concatenate([c, np.zeros((most - len(c), *c.shape[1:]))]) for c in (a, b)
    )  # type: ignore[return-value]


def linear(matrix: np.ndarray, v: Form) -> Form:
    """Constant (m, k) or (m, k) per... times forms (k, N): (m, N)."""
    terms = U * matrix.shape[-1]  # each rounds
    r = np.abs(matrix) @ (v.r + terms * v.size)
    return Form(matrix @ v.c, r * (1 + terms) + TINY)


def times_rows(R: Form, A: np.ndarray) -> Form:
    """Forms (m, k, N) times a constant (k,) or (k, l): (m, N) or (m, l, N)."""
    terms = U * A.shape[0]  # each rounds
    c = np.moveaxis(np.tensordot(R.c, A, axes=(2, 0)), 2, -1)
    r = np.moveaxis(np.tensordot(R.r + terms * R.size, np.abs(A), axes=(1, 0)), 1, -1)
    return Form(c, r * (1 + terms) + TINY)


def dot(a: Form, b: Form) -> Form:
    """Sum over the first axis of a times b."""
    terms = a * b
    total = terms[0]
    for k in range(1, len(terms.r)):
        total = total + terms[k]
    return total


def polynomial(c: np.ndarray, u: Form) -> Form:
    """Polynomials (..., degrees, N) at u (N,): (..., N); their coefficients may be rounded."""
    value = Form.of(np.zeros_like(c[..., 0, :]))
    for k in reversed(range(c.shape[-2])):
        value = value * u + Form.of(c[..., k, :], radius=U * np.abs(c[..., k, :]))
    return value


def stack(*forms: Form, axis: int = 0) -> Form:
    """Forms of one shape along a new axis."""
    most = max((f.c for f in forms), key=len)
    return Form(
        np.stack([alike(f.c, most)[0] for f in forms], axis=1 + axis),
        np.stack([f.r for f in forms], axis=axis),
    )


def joined(*forms: Form) -> Form:
    """Forms along their first axis."""
    most = max((f.c for f in forms), key=len)
    return Form(
        np.concatenate([alike(f.c, most)[0] for f in forms], axis=1), np.concatenate([f.r for f in forms])
    )


def beside(forms: list[Form]) -> Form:
    """Forms of as many numbers along their last axis."""
    return Form(*(np.concatenate(parts, axis=-1) for parts in zip(*((f.c, f.r) for f in forms), strict=True)))


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


def known(values: np.ndarray) -> np.ndarray:
    """The values with -infinity for those that are not numbers, which prove nothing."""
    return np.where(np.isnan(values), -np.inf, values)
