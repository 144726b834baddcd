"""Lemke's method in rational arithmetic: an oracle without rounding, tolerances or cycling.

With the lexicographic ratio test the method is finite, and on the copositive matrix of Stewart and
Trinkle's contact problem it ends at a solution, never on a ray. All data are the given floats, converted
exactly; the products W' inv(M) W are formed in rational numbers, so that their rank is exactly the rank of
W and the degeneracy of the contact problem is not blurred by rounding.

Data and answers are `fractions.Fraction`. Inside, every row of the tableau holds integers without a common
divisor: the tableau's rank is that of W, so they stay short, and one divisor per row is far cheaper than
one per entry.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import gcd, lcm
from typing import NamedTuple

import numpy as np

from ocptip.contact.bindings.pyramid import corrected_friction, edge_directions


class ExactLcpSolution(NamedTuple):
    """Answer of :func:`exact_lemke`: `z` is a solution if `solved`, else the method ended on a ray."""

    z: list[Fraction]
    solved: bool
    pivots: int


class ExactContactSolution(NamedTuple):
    """Contact forces (n, 3) [N], axes n, t1, t2; base acceleration (6,); exact natural residual (0)."""

    forces: np.ndarray
    acceleration: np.ndarray
    residual: Fraction


def rational(array: object) -> list:
    """Nested lists of the exact values of an array's floats."""
    array = np.asarray(array, dtype=float)
    if array.ndim == 1:
        return [Fraction(float(x)) for x in array]
    return [rational(row) for row in array]


def product(A: Sequence, B: Sequence) -> list[list[Fraction]]:
    """Matrix product of nested lists."""
    columns = list(zip(*B, strict=True))
    return [
        [sum((a * b for a, b in zip(row, col, strict=True) if a and b), Fraction(0)) for col in columns]
        for row in A
    ]


def natural_residual(M: Sequence, q: Sequence, z: Sequence) -> Fraction:
    """max |min(z, M z + q)|, exactly."""
    w = [
        qi + sum((m * x for m, x in zip(row, z, strict=True)), Fraction(0))
        for row, qi in zip(M, q, strict=True)
    ]
    return max(abs(min(a, b)) for a, b in zip(z, w, strict=True))


def exact_lemke(M: Sequence, q: Sequence) -> ExactLcpSolution:
    """Solve w = M z + q, w, z >= 0, w'z = 0 by the lexicographic Lemke method, covering vector 1.

    Args:
        M: n rows of n Fractions.
        q: n Fractions.
    """
    n = len(q)
    if min(q) >= 0:
        return ExactLcpSolution([Fraction(0)] * n, True, 0)
    # Variables: w 0..n-1, z n..2n-1, artificial 2n. Row i reads
    # T[i][n + 2] x[basis[i]] + sum_j T[i][j] x[column[j]] = T[i][n + 1], j = 0..n, with T[i][n + 2] > 0.
    T = []
    for row, value in zip(M, q, strict=True):
        unit = lcm(*(m.denominator for m in row), value.denominator)
        T.append([int(-m * unit) for m in row] + [-unit, int(value * unit), unit])
    basis = list(range(n))
    column = list(range(n, 2 * n + 1))

    # Lexicographically smallest row of (q, I): the last of equal ones.
    row = max(i for i in range(n) if q[i] == min(q))
    entering = n
    pivots = 0
    while True:
        left = basis[row]
        _exchange(T, row, entering)
        basis[row], column[entering] = column[entering], basis[row]
        pivots += 1
        if left == 2 * n:
            break
        entering = column.index(left + n if left < n else left - n)
        rows = [i for i in range(n) if T[i][entering] > 0]
        if not rows:
            break
        row = _lexicographic_row(T, basis, column, rows, entering)
    z = [Fraction(0)] * n
    for row, variable in zip(T, basis, strict=True):
        if n <= variable < 2 * n:
            z[variable - n] = Fraction(row[n + 1], row[n + 2])
    return ExactLcpSolution(z, left == 2 * n, pivots)


def _exchange(T: list[list[int]], r: int, c: int) -> None:
    """Exchange the basic variable of row r for the non-basic variable of column c."""
    pivot_row = T[r]
    pivot_row[c], pivot_row[-1] = pivot_row[-1], pivot_row[c]
    if pivot_row[-1] < 0:
        pivot_row = T[r] = [-a for a in pivot_row]
    pivot = pivot_row[-1]
    for i, row in enumerate(T):
        factor = row[c]
        if i == r or factor == 0:
            continue
        common = gcd(factor, pivot)
        own, other = pivot // common, factor // common
        row[c] = 0
        updated = [own * a - other * b for a, b in zip(row[:-1], pivot_row[:-1], strict=True)]
        updated.append(own * row[-1])
        common = gcd(*updated)
        T[i] = [a // common for a in updated]


def _lexicographic_row(
    T: list[list[int]], basis: list[int], column: list[int], rows: list[int], c: int
) -> int:
    """Row with the lexicographically smallest (right-hand side, row of the inverse basis) over its pivot."""
    n = len(T)
    rows = _smallest(T, rows, {i: T[i][n + 1] for i in rows}, c)
    for k in range(n):
        if len(rows) == 1:
            break
        if k in column:
            stored = column.index(k)
            if stored == c:
                continue
            entries = {i: T[i][stored] for i in rows}
        else:
            entries = {i: T[i][-1] if basis[i] == k else 0 for i in rows}
        rows = _smallest(T, rows, entries, c)
    return rows[0]


def _smallest(T: list[list[int]], rows: list[int], entries: dict[int, int], c: int) -> list[int]:
    """Rows of the smallest entries[i] / T[i][c]; all pivots are positive."""
    best: list[int] = []
    for i in rows:
        difference = entries[i] * T[best[0]][c] - entries[best[0]] * T[i][c] if best else -1
        if difference < 0:
            best = [i]
        elif difference == 0:
            best.append(i)
    return best


def stewart_trinkle_lcp(
    W: np.ndarray, inverse_mass: np.ndarray, friction: np.ndarray, facets: int, wrench: np.ndarray
) -> tuple[list[list[Fraction]], list[Fraction], list[list[Fraction]]]:
    """Exact matrix and vector of the contact LCP, and the (6, n (S + 1)) map of forces to wrenches.

    Unknowns as in studies.baselines.contact_lcp.StewartTrinkleContactProblem, accelerations in m/s^2.
    """
    n = len(friction)
    slopes = rational([corrected_friction(mu, facets) / np.cos(np.pi / facets) for mu in friction])
    directions = rational(edge_directions(facets))
    W, inverse_mass = rational(W), rational(inverse_mass)
    wrench_map = [[row[3 * k] for k in range(n)] for row in W]
    for i, row in enumerate(W):
        for k in range(n):
            wrench_map[i] += [row[3 * k + 1] * a + row[3 * k + 2] * b for a, b in directions]
    transposed = [list(row) for row in zip(*wrench_map, strict=True)]
    mobility = product(transposed, inverse_mass)
    M = product(mobility, wrench_map)
    for i, row in enumerate(M):
        row += [Fraction(int(i >= n and (i - n) // facets == k)) for k in range(n)]
    for k in range(n):
        limit = [Fraction(0)] * (n * (facets + 2))
        limit[k] = slopes[k]
        for h in range(facets):
            limit[n + facets * k + h] = Fraction(-1)
        M.append(limit)
    q = [row[0] for row in product(mobility, [[x] for x in rational(wrench)])] + [Fraction(0)] * n
    return M, q, wrench_map


def exact_stewart_trinkle(
    W: np.ndarray, inverse_mass: np.ndarray, friction: np.ndarray, facets: int, wrench: np.ndarray
) -> ExactContactSolution:
    """Contact forces and acceleration of a base on ordinary unilateral contacts, solved without rounding.

    Args:
        W: (6, 3n) map of contact forces (per contact n, t1, t2) to wrenches on the base.
        inverse_mass: (6, 6).
        friction: (n,) Coulomb coefficients; the pyramid is the package's (2.84).
        facets: Number of the pyramid's faces.
        wrench: (6,) wrench on the base.

    Returns:
        Forces (n, 3) [N] and acceleration (6,), each rounded once from rational numbers, and the exact
        natural residual of the LCP, which is 0.
    """
    M, q, wrench_map = stewart_trinkle_lcp(W, inverse_mass, friction, facets, wrench)
    z, solved, _ = exact_lemke(M, q)
    if not solved:
        raise AssertionError("Lemke's method cannot end on a ray here: the matrix is copositive")
    n = len(friction)
    directions = rational(edge_directions(facets))
    forces = np.empty((n, 3))
    for k in range(n):
        beta = z[n + facets * k : n + facets * (k + 1)]
        forces[k, 0] = float(z[k])
        for axis in range(2):
            forces[k, 1 + axis] = float(sum(b * d[axis] for b, d in zip(beta, directions, strict=True)))
    magnitudes = [[x] for x in z[: n * (facets + 1)]]
    total = [[a + b[0]] for a, b in zip(rational(wrench), product(wrench_map, magnitudes), strict=True)]
    acceleration = np.array([float(row[0]) for row in product(rational(inverse_mass), total)])
    return ExactContactSolution(forces, acceleration, natural_residual(M, q, z))
