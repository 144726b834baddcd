"""Lemke's method for the linear complementarity problem w = M z + q, w, z >= 0, w'z = 0.

This is the ordinary, pairwise method: a solver to compare with, not the solver of the package. It is
written to be a fair opponent. The tableau is condensed: only the columns of the non-basic variables are
stored, n x (n + 2) numbers with the artificial variable and the right-hand side, so that a pivot costs one
rank-1 update of n (n + 2) numbers and nothing is allocated on the way.

The three pivot rules differ only in the ratio test, which is where degenerate contact problems are won or
lost:

`"textbook"`
    Smallest ratio, first row among exactly equal ones, any pivot above zero. It cycles, or pivots on
    rounding errors, where the problem is degenerate.
`"lexicographic"`
    Rows whose ratios agree within a tolerance are tied; ties are broken by comparing the rows of the
    inverse basis, which excludes cycling in exact arithmetic. Pivots below 1e-9 are refused.
`"largest-pivot"`
    The same tolerance for ties; among tied rows the one with the largest pivot leaves. No proof against
    cycling, but the best conditioned basis.

Source: C. E. Lemke, "Bimatrix equilibrium points and mathematical programming", Management Science 11,
1965; R. W. Cottle, J.-S. Pang and R. E. Stone, "The Linear Complementarity Problem", section 4.4. On the
tolerances: J. A. Tomlin, "Robust implementation of Lemke's method for the linear complementarity problem",
Mathematical Programming Study 7, 1978.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError, finite_array, positive_number
from ocptip.numerics.jit.compiled import compiled

RULES = ("textbook", "lexicographic", "largest-pivot")
STATUSES = ("solved", "ray", "pivot limit", "inaccurate")

_TEXTBOOK, _LEXICOGRAPHIC, _LARGEST_PIVOT = range(3)
_SOLVED, _RAY, _PIVOT_LIMIT, _INACCURATE = range(4)

# Smallest pivot that is accepted, and distance at which two ratios count as equal; of the textbook's rule: 0.
_LEXICOGRAPHIC_PIVOT, _LARGEST_PIVOT_LEAST = 1e-9, 1e-10
_TIE_TOLERANCE = 1e-10
_EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True)
class LcpSolution:
    """Answer of :func:`solve_lcp`.

    Attributes:
        z: (n,) the last basic point, not below zero; a solution only where `status` is "solved".
        w: (n,) M z + q, computed from the original data.
        status: "solved": verified, the residual is small; "ray": no row can leave the basis, there may be
            no solution; "pivot limit": stopped, probably cycling: raise the limit or change the rule;
            "inaccurate": the method ended regularly, but at a point that fails the verification.
        pivots: Number of basis exchanges.
        residual: max |min(z, M z + q)|, computed from the original data.
        rule: Pivot rule used.
    """

    z: np.ndarray
    w: np.ndarray
    status: str
    pivots: int
    residual: float
    rule: str

    @property
    def solved(self) -> bool:
        """Whether the answer is a verified solution."""
        return self.status == "solved"

    def to_dict(self) -> dict:
        """Plain numbers and lists, for JSON."""
        return {
            "z": self.z.tolist(),
            "w": self.w.tolist(),
            "status": self.status,
            "pivots": self.pivots,
            "residual": self.residual,
            "rule": self.rule,
        }


@dataclass(frozen=True)
class LcpBatch:
    """Answers of :func:`solve_lcp_many` for k right-hand sides; see :class:`LcpSolution`.

    Attributes:
        z: (k, n).
        status: (k,) strings.
        pivots: (k,) integers.
        residual: (k,).
        rule: Pivot rule used.
    """

    z: np.ndarray
    status: np.ndarray
    pivots: np.ndarray
    residual: np.ndarray
    rule: str

    @property
    def solved(self) -> np.ndarray:
        """(k,) booleans: which answers are verified solutions."""
        return self.status == "solved"

    def to_dict(self) -> dict:
        """Plain numbers and lists, for JSON."""
        return {
            "z": self.z.tolist(),
            "status": self.status.tolist(),
            "pivots": self.pivots.tolist(),
            "residual": self.residual.tolist(),
            "rule": self.rule,
        }


def solve_lcp(
    M: np.ndarray,
    q: np.ndarray,
    rule: str = "lexicographic",
    max_pivots: int | None = None,
    *,
    scale: bool = True,
    accuracy: float = 1e-8,
) -> LcpSolution:
    """Solve w = M z + q, w, z >= 0, w'z = 0 by Lemke's method.

    Args:
        M: (n, n) matrix.
        q: (n,) vector.
        rule: "textbook", "lexicographic" or "largest-pivot"; see the module's docstring.
        max_pivots: Stop after so many basis exchanges; None: 200 + 20 n.
        scale: Divide q by its largest magnitude first. The tolerances of the pivot rules are absolute, so
            without it a problem whose q is tiny ends in a false ray.
        accuracy: Largest residual, with its own rounding error, that counts as solved; a fraction of
            max |q|.

    Raises:
        InputError: Shapes do not fit, numbers are not finite, or the rule is unknown.
    """
    q = finite_array("q", q, (None,))
    M, code, limit, accuracy = _checked("q", M, q.shape[0], rule, max_pivots, accuracy)
    z = np.empty((1, q.shape[0]))
    status, pivots, residual = _solve_many(M, q[None, :], code, limit, scale, accuracy, z)
    return LcpSolution(z[0], M @ z[0] + q, STATUSES[status[0]], int(pivots[0]), float(residual[0]), rule)


def solve_lcp_many(
    M: np.ndarray,
    Q: np.ndarray,
    rule: str = "lexicographic",
    max_pivots: int | None = None,
    *,
    scale: bool = True,
    accuracy: float = 1e-8,
) -> LcpBatch:
    """Solve the problem for many right-hand sides, one after the other inside the compiled code.

    Args:
        M: (n, n) matrix.
        Q: (k, n), one right-hand side per row.
        rule: See :func:`solve_lcp`, also for the remaining arguments.
        max_pivots: Limit for each single problem.
        scale: Whether each row is divided by its largest magnitude first.
        accuracy: Largest residual that counts as solved, as a fraction of the row's max |q|.

    Raises:
        InputError: Shapes do not fit, numbers are not finite, or the rule is unknown.
    """
    Q = finite_array("Q", Q, (None, None))
    M, code, limit, accuracy = _checked("Q", M, Q.shape[1], rule, max_pivots, accuracy)
    z = np.empty(Q.shape)
    status, pivots, residual = _solve_many(M, Q, code, limit, scale, accuracy, z)
    return LcpBatch(z, np.array(STATUSES)[status], pivots, residual, rule)


def _checked(
    name: str, M: np.ndarray, n: int, rule: str, max_pivots: int | None, accuracy: float
) -> tuple[np.ndarray, int, int, float]:
    """Return matrix, code of the rule, pivot limit and accuracy, or raise InputError."""
    if n == 0:
        raise InputError(f"{name}: must hold at least one number per problem")
    M = finite_array("M", M, (n, n))
    if rule not in RULES:
        raise InputError(f"rule: must be one of {', '.join(RULES)}, got {rule!r}")
    if max_pivots is None:
        max_pivots = 200 + 20 * n
    if isinstance(max_pivots, bool) or not isinstance(max_pivots, int | np.integer) or max_pivots < 0:
        raise InputError(f"max_pivots: must be an integer >= 0 or None, got {max_pivots!r}")
    return M, RULES.index(rule), int(max_pivots), positive_number("accuracy", accuracy)


@compiled
def _solve_many(M, Q, rule, max_pivots, scale, accuracy, Z):
    """Solve for every row of Q into the rows of Z; return statuses, pivots, residuals."""
    count, n = Q.shape
    tableau = np.empty((n, n + 2))
    basis = np.empty(n, dtype=np.int64)
    column = np.empty(n + 1, dtype=np.int64)
    place = np.empty(2 * n + 1, dtype=np.int64)
    tied = np.empty(n, dtype=np.int64)
    status = np.empty(count, dtype=np.int64)
    pivots = np.empty(count, dtype=np.int64)
    residual = np.empty(count)
    for k in range(count):
        q, z = Q[k], Z[k]
        size = 0.0
        for i in range(n):
            size = max(size, abs(q[i]))
        factor = size if scale and size > 0.0 else 1.0
        status[k], pivots[k] = _solve_one(
            M, q, factor, rule, max_pivots, tableau, basis, column, place, tied, z
        )
        residual[k], rounding = _residual(M, q, z)
        # Not "residual > limit": a NaN must not pass. Where z is so large that M z swallows q, a residual of
        # zero proves nothing.
        if status[k] == _SOLVED and not residual[k] + rounding <= accuracy * size:
            status[k] = _INACCURATE
    return status, pivots, residual


@compiled
def _residual(M, q, z):
    """Natural residual max |min(z, M z + q)| and a bound of the rounding error in it."""
    n = q.shape[0]
    worst = 0.0
    largest = 0.0
    for i in range(n):
        w = q[i]
        magnitude = abs(q[i])
        for j in range(n):
            term = M[i, j] * z[j]
            w += term
            magnitude += abs(term)
        largest = max(largest, magnitude)
        deviation = abs(min(z[i], w))
        if not deviation <= worst:
            worst = deviation
    return worst, n * _EPSILON * largest


@compiled
def _solve_one(M, q, factor, rule, max_pivots, tableau, basis, column, place, tied, z):
    """Lemke's method for q / factor; writes z and returns (status, number of pivots).

    Variables are numbered w: 0..n-1, z: n..2n-1, artificial: 2n. Row i of the tableau T reads
    x[basis[i]] + sum_j T[i, j] x[column[j]] = T[i, n + 1]; place[v] is the row of the basic variable v, or
    -1 - j where v is non-basic in column j.
    """
    n = q.shape[0]
    leaving_row = 0
    for i in range(n):
        z[i] = 0.0
        tableau[i, n] = -1.0
        tableau[i, n + 1] = q[i] / factor
        for j in range(n):
            tableau[i, j] = -M[i, j]
        basis[i] = i
        column[i] = n + i
        place[i] = i
        place[n + i] = -1 - i
        if tableau[i, n + 1] < tableau[leaving_row, n + 1]:
            leaving_row = i
    column[n] = 2 * n
    place[2 * n] = -1 - n
    lowest = tableau[leaving_row, n + 1]
    if lowest >= 0.0:
        return _SOLVED, 0
    if rule == _LEXICOGRAPHIC:
        # The row that leaves first must be the lexicographically smallest of (q, I): the last of the tied.
        for i in range(n):
            if tableau[i, n + 1] <= lowest + _TIE_TOLERANCE:
                leaving_row = i

    entering = n
    pivots = 0
    status = _PIVOT_LIMIT
    while pivots < max_pivots:
        left = basis[leaving_row]
        _exchange(tableau, basis, column, place, leaving_row, entering)
        pivots += 1
        if left == 2 * n:
            status = _SOLVED
            break
        entering = -1 - place[left + n if left < n else left - n]
        leaving_row = _ratio_test(tableau, column, place, tied, entering, rule)
        if leaving_row < 0:
            status = _RAY
            break
    for i in range(n):
        # Rounding leaves basic variables at -1e-17; a vertex of the problem has none below zero.
        if n <= basis[i] < 2 * n:
            z[basis[i] - n] = max(tableau[i, n + 1], 0.0) * factor
    return status, pivots


@compiled
def _exchange(T, basis, column, place, r, c):
    """Exchange the basic variable of row r for the non-basic variable of column c."""
    rows, width = T.shape
    inverse = 1.0 / T[r, c]
    T[r, c] = 1.0
    for j in range(width):
        T[r, j] *= inverse
    for i in range(rows):
        factor = T[i, c]
        if i != r and factor != 0.0:
            T[i, c] = 0.0
            for j in range(width):
                T[i, j] -= factor * T[r, j]
    basis[r], column[c] = column[c], basis[r]
    place[basis[r]] = r
    place[column[c]] = -1 - c


@compiled
def _ratio_test(T, column, place, tied, c, rule):
    """Row that blocks the variable of column c, or -1 where none does."""
    n = T.shape[0]
    rhs = n + 1
    smallest = _LEXICOGRAPHIC_PIVOT if rule == _LEXICOGRAPHIC else _LARGEST_PIVOT_LEAST
    pivot_tolerance = 0.0 if rule == _TEXTBOOK else smallest
    tie_tolerance = 0.0 if rule == _TEXTBOOK else _TIE_TOLERANCE
    best = -1
    lowest = np.inf
    for i in range(n):
        if T[i, c] > pivot_tolerance:
            ratio = T[i, rhs] / T[i, c]
            if ratio < lowest:
                best, lowest = i, ratio
    if best < 0 or rule == _TEXTBOOK:
        return best

    count = 0
    artificial = place[2 * n]
    for i in range(n):
        if T[i, c] > pivot_tolerance and T[i, rhs] / T[i, c] <= lowest + tie_tolerance:
            if i == artificial:
                # Leaving now solves the problem: no tie needs to be broken.
                return i
            tied[count] = i
            count += 1

    if rule == _LARGEST_PIVOT:
        for k in range(count):
            if T[tied[k], c] > T[best, c]:
                best = tied[k]
        return best
    return _lexicographic_row(T, column, place, tied, count, c, tie_tolerance)


@compiled
def _lexicographic_row(T, column, place, tied, count, c, tie_tolerance):
    """The tied row whose row of the inverse basis, divided by its pivot, is lexicographically smallest.

    Column k of the inverse basis is the tableau's column of w_k: a stored one where w_k is non-basic, a
    unit vector where it is basic.
    """
    n = T.shape[0]
    for k in range(n):
        if count == 1:
            break
        if column[c] == k:
            continue
        where = place[k]
        lowest = np.inf
        for t in range(count):
            i = tied[t]
            entry = T[i, -1 - where] if where < 0 else (1.0 if where == i else 0.0)
            lowest = min(lowest, entry / T[i, c])
        kept = 0
        for t in range(count):
            i = tied[t]
            entry = T[i, -1 - where] if where < 0 else (1.0 if where == i else 0.0)
            if entry / T[i, c] <= lowest + tie_tolerance:
                tied[kept] = i
                kept += 1
        count = kept
    return tied[0]
