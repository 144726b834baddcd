"""Complementary pivoting ruled by mode automata: the compiled kernel.

The system is `C x = rhs`, x >= 0, where the columns of `C` belong to contacts and each contact's basic
columns form one of its admissible subsets. Lemke's scheme: a start basis `B0`, an artificial variable
`z0` with the covering column `B0 e`, and then pivots in which the variable that enters is the one that
the automaton of the leaving variable's contact names.

Ties are the rule, not the exception (rank of the force columns is at most 6): the right-hand side is
therefore perturbed symbolically by `epsilon B0 rho` with a fixed generic vector `rho` > 0 and an
infinitesimal epsilon. The perturbation's image in the current basis is carried along as one column `p`
and decides every tie; a perturbed problem has no ties, so no basis can come twice.

All numbers are scaled: the largest element of a right-hand side is 1.
"""

from __future__ import annotations

import numba
import numpy as np

SOLVED, RAY, PIVOT_LIMIT, SINGULAR, INACCURATE = 0, 1, 2, 3, 4

_PIVOT_TOLERANCE = 1e-9
_TIE_TOLERANCE = 1e-10
_NEGATIVE_TOLERANCE = 1e-10
_REFACTOR_EVERY = 24


@numba.njit(cache=True)
def _load_basis(columns, first_column, row_start, n, subset, subsets, subset_start, element, owner, B):
    """Fill the basis matrix of the current subsets, slots in canonical order (contact by contact)."""
    for k in range(n):
        size = row_start[k + 1] - row_start[k]
        base = subset_start[k] + subset[k] * size
        for place in range(size):
            slot = row_start[k] + place
            e = subsets[base + place]
            element[slot] = e
            owner[slot] = k
            for i in range(B.shape[0]):
                B[i, slot] = columns[first_column[k] + e, i]


@numba.njit(cache=True)
def _fill_from_slots(columns, first_column, element, owner, cover, B):
    """Fill the basis matrix from the slots as they are; owner -1 is the artificial variable."""
    m = B.shape[0]
    for slot in range(m):
        if owner[slot] < 0:
            for i in range(m):
                B[i, slot] = -cover[i]
        else:
            c = first_column[owner[slot]] + element[slot]
            for i in range(m):
                B[i, slot] = columns[c, i]


@numba.njit(cache=True)
def _invert(B, inverse):
    """Gauss-Jordan inverse with partial pivoting; destroys B. Returns False if B is singular."""
    m = B.shape[0]
    for i in range(m):
        for j in range(m):
            inverse[i, j] = 0.0
        inverse[i, i] = 1.0
    for c in range(m):
        best, row = abs(B[c, c]), c
        for i in range(c + 1, m):
            if abs(B[i, c]) > best:
                best, row = abs(B[i, c]), i
        if best < 1e-11:
            return False
        if row != c:
            for j in range(m):
                t = B[c, j]
                B[c, j] = B[row, j]
                B[row, j] = t
                t = inverse[c, j]
                inverse[c, j] = inverse[row, j]
                inverse[row, j] = t
        f = 1.0 / B[c, c]
        for j in range(m):
            B[c, j] *= f
            inverse[c, j] *= f
        for i in range(m):
            if i != c:
                f = B[i, c]
                if f != 0.0:
                    for j in range(c, m):
                        B[i, j] -= f * B[c, j]
                    for j in range(m):
                        inverse[i, j] -= f * inverse[c, j]
    return True


@numba.njit(cache=True)
def _times(A, b, out):
    m = A.shape[0]
    for i in range(m):
        s = 0.0
        for j in range(A.shape[1]):
            s += A[i, j] * b[j]
        out[i] = s


@numba.njit(cache=True)
def _start_subsets(rhs, row_start, n, start_count, start_first, start_subset, start_inverse, subset):
    """For each contact the start subset whose own local solution is least negative."""
    for k in range(n):
        r0 = row_start[k]
        size = row_start[k + 1] - r0
        best = np.inf
        for c in range(start_first[k], start_first[k] + start_count[k]):
            negative = 0.0
            for i in range(size):
                s = 0.0
                for j in range(size):
                    s += start_inverse[c, i, j] * rhs[r0 + j]
                if s < 0.0:
                    negative -= s
            if negative < best:
                best = negative
                subset[k] = start_subset[c]


@numba.njit(cache=True)
def _pivot(inverse, x, p, d, r):
    """Replace slot r by the column whose image is d, in the inverse and in the two right-hand sides."""
    m = x.shape[0]
    f = 1.0 / d[r]
    for j in range(m):
        inverse[r, j] *= f
    x[r] *= f
    p[r] *= f
    for i in range(m):
        if i != r:
            g = d[i]
            if g != 0.0:
                for j in range(m):
                    inverse[i, j] -= g * inverse[r, j]
                x[i] -= g * x[r]
                p[i] -= g * p[r]


@numba.njit(cache=True)
def _lemke(
    columns, first_column, row_start, n, subsets, subset_start, successor, entering,
    rhs, subset, element, owner, inverse, B, x, p, d, cover, e, rho, largest_pivot, max_pivots,
):  # fmt: skip
    """Pivot from the current (inverted) basis until the artificial variable leaves.

    Returns (status, pivots). On SOLVED the slots hold a complementary basis.
    """
    m = x.shape[0]
    # the artificial variable enters: B x - cover z0 = rhs, cover = B0 e
    r = -1
    z0 = 0.0
    for i in range(m):
        if x[i] < 0.0 and -x[i] / e[i] > z0:
            z0 = -x[i] / e[i]
    best = np.inf
    for i in range(m):
        if x[i] < 0.0 and -x[i] / e[i] >= z0 - _TIE_TOLERANCE and rho[i] / e[i] < best:
            best = rho[i] / e[i]
            r = i
    if r < 0:
        return SOLVED, 0
    for i in range(m):
        p[i] = rho[i]
        d[i] = -e[i]
    leaving_contact, leaving_element = owner[r], element[r]
    _pivot(inverse, x, p, d, r)
    owner[r] = -1
    artificial = r
    pivots = 1
    since_refactor = 0
    while pivots < max_pivots:
        k = leaving_contact
        size = row_start[k + 1] - row_start[k]
        base = subset_start[k] + subset[k] * size
        place = 0
        while subsets[base + place] != leaving_element:
            place += 1
        new_element = entering[base + place]
        subset[k] = successor[base + place]

        a = columns[first_column[k] + new_element]
        dmax = 0.0
        for i in range(m):
            s = 0.0
            for j in range(m):
                s += inverse[i, j] * a[j]
            d[i] = s
            if s > dmax:
                dmax = s
        limit = _PIVOT_TOLERANCE * max(1.0, dmax)
        theta = np.inf
        for i in range(m):
            if d[i] > limit:
                t = max(x[i], 0.0) / d[i]
                if t < theta:
                    theta = t
        if theta == np.inf:
            return RAY, pivots
        r = -1
        best = np.inf
        for i in range(m):
            if d[i] > limit and max(x[i], 0.0) - theta * d[i] <= _TIE_TOLERANCE:
                if i == artificial:
                    r = i
                    break
                key = -d[i] if largest_pivot else p[i] / d[i]
                if key < best:
                    best = key
                    r = i
        leaving_contact, leaving_element = owner[r], element[r]
        _pivot(inverse, x, p, d, r)
        owner[r] = k
        element[r] = new_element
        pivots += 1
        if leaving_contact < 0:
            return SOLVED, pivots
        since_refactor += 1
        if since_refactor == _REFACTOR_EVERY:
            since_refactor = 0
            _fill_from_slots(columns, first_column, element, owner, cover, B)
            if not _invert(B, inverse):
                return SINGULAR, pivots
            _times(inverse, rhs, x)
    return PIVOT_LIMIT, pivots


@numba.njit(cache=True)
def _polish(columns, first_column, element, owner, inverse, rhs, x, work):
    """One step of iterative refinement of x on the columns themselves; returns the smallest x."""
    m = x.shape[0]
    _times(inverse, rhs, x)
    for _ in range(2):
        for i in range(m):
            work[i] = rhs[i]
        for slot in range(m):
            c = first_column[owner[slot]] + element[slot]
            v = x[slot]
            for i in range(m):
                work[i] -= columns[c, i] * v
        worst = 0.0
        for i in range(m):
            if abs(work[i]) > worst:
                worst = abs(work[i])
        if worst < 1e-15:
            break
        for i in range(m):
            s = 0.0
            for j in range(m):
                s += inverse[i, j] * work[j]
            x[i] += s
    smallest = np.inf
    for i in range(m):
        if not x[i] >= smallest:
            smallest = x[i]
    return smallest


@numba.njit(cache=True)
def _next_random(state):
    """Deterministic uniform numbers in [0, 1) (a linear congruential generator, 53 bits)."""
    state[0] = state[0] * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
    return np.float64(state[0] >> np.uint64(11)) / 9007199254740992.0


@numba.njit(cache=True)
def solve_batch(
    columns, first_column, row_start, subsets, subset_start, successor, entering,
    start_count, start_first, start_subset, start_inverse,
    rhs_all, gauge, warm, initial, max_pivots, attempts, check_matrix, check_rhs, tolerance,
    out_subset, out_x, out_status, out_pivots, out_attempt, out_residual,
):  # fmt: skip
    """Solve many right-hand sides of one system.

    Args:
        columns: (P, m) all columns of the system, as rows.
        first_column: (n,) index of each contact's first column.
        row_start: (n + 1,) first row (and slot) of each contact.
        subsets, successor, entering: automata of all contacts, flattened; contact k begins at
            `subset_start[k]`.
        start_*: candidates for the start basis with the inverses of their local blocks.
        rhs_all: (N, m) right-hand sides (not scaled).
        gauge: (m, c) directions in which the right-hand side may be shifted without changing the physics
            (distribution of forces that the equations leave open); used by the later attempts.
        warm: start from the previous state's basis; the first one from `initial` if initial[0] >= 0.
        attempts: number of different starts tried before a state is given up.
        check_matrix, check_rhs: (m, P), (N, m) the original system, for the residual.
        tolerance: largest residual of a solved state.
        out_*: results: subsets (N, n), basic values in canonical order (N, m), status, pivots, attempt
            and relative residual of each state.
    """
    n = first_column.shape[0]
    m = row_start[n]
    count = rhs_all.shape[0]
    inverse, B = np.empty((m, m)), np.empty((m, m))
    x, p, d, e, rho, cover = np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    rhs, work = np.empty(m), np.empty(m)
    element, owner, subset = np.empty(m, np.int64), np.empty(m, np.int64), np.empty(n, np.int64)
    generator = np.empty(1, np.uint64)
    have_basis = False
    if warm and initial[0] >= 0:
        for k in range(n):
            subset[k] = initial[k]
        _load_basis(columns, first_column, row_start, n, subset, subsets, subset_start, element, owner, B)
        have_basis = _invert(B, inverse)

    for state in range(count):
        scale = 0.0
        for i in range(m):
            scale = max(scale, abs(rhs_all[state, i]))
        if scale == 0.0:
            scale = 1.0
        generator[0] = np.uint64(20091)
        status, total, attempt = INACCURATE, 0, 0
        residual = np.inf
        while attempt < attempts:
            for i in range(m):
                rhs[i] = rhs_all[state, i] / scale
            if attempt >= 6 and gauge.shape[1] > 0:
                for c in range(gauge.shape[1]):
                    w = 4.0 * _next_random(generator) - 2.0
                    for i in range(m):
                        rhs[i] += w * gauge[i, c]
            if attempt == 0 and not (warm and have_basis):
                attempt = 1
            for i in range(m):
                e[i] = 0.2 + _next_random(generator) if attempt >= 3 else 1.0
                rho[i] = 1.0 + ((i + 1) * 0.6180339887498949) % 1.0
            if attempt > 0:
                if attempt < 4:
                    _start_subsets(
                        rhs, row_start, n, start_count, start_first, start_subset, start_inverse, subset
                    )
                else:
                    for k in range(n):
                        subset[k] = start_subset[
                            start_first[k] + int(_next_random(generator) * start_count[k])
                        ]
                _load_basis(
                    columns, first_column, row_start, n, subset, subsets, subset_start, element, owner, B
                )
                if not _invert(B, inverse):
                    status = SINGULAR
                    attempt += 1
                    have_basis = False
                    continue
            _times(inverse, rhs, x)
            worst = 0.0
            for i in range(m):
                worst = min(worst, x[i])
            status, pivots = SOLVED, 0
            if worst < -1e-13:
                _fill_from_slots(columns, first_column, element, owner, cover, B)
                _times(B, e, cover)
                status, pivots = _lemke(
                    columns, first_column, row_start, n, subsets, subset_start, successor, entering,
                    rhs, subset, element, owner, inverse, B, x, p, d, cover, e, rho,
                    attempt % 2 == 0, max_pivots,
                )  # fmt: skip
            total += pivots
            have_basis = False
            if status == SOLVED:
                smallest = _polish(columns, first_column, element, owner, inverse, rhs, x, work)
                if not smallest >= -_NEGATIVE_TOLERANCE:
                    # the updated inverse may have drifted: factorise afresh before giving up
                    _fill_from_slots(columns, first_column, element, owner, cover, B)
                    if _invert(B, inverse):
                        smallest = _polish(columns, first_column, element, owner, inverse, rhs, x, work)
                residual = 0.0 if smallest >= 0.0 else -smallest
                for i in range(m):
                    work[i] = check_rhs[state, i] / scale
                for slot in range(m):
                    c = first_column[owner[slot]] + element[slot]
                    v = max(x[slot], 0.0)
                    for i in range(m):
                        work[i] -= check_matrix[c, i] * v
                for i in range(m):
                    if not abs(work[i]) <= residual:
                        residual = abs(work[i])
                if residual <= tolerance:
                    have_basis = True
                    break
                status = INACCURATE
            attempt += 1
        out_status[state] = status
        out_pivots[state] = total
        out_attempt[state] = attempt
        out_residual[state] = residual
        if status == SOLVED:
            for k in range(n):
                out_subset[state, k] = subset[k]
            for slot in range(m):
                k = owner[slot]
                size = row_start[k + 1] - row_start[k]
                base = subset_start[k] + subset[k] * size
                place = 0
                while subsets[base + place] != element[slot]:
                    place += 1
                out_x[state, row_start[k] + place] = max(x[slot], 0.0) * scale
        else:
            for k in range(n):
                out_subset[state, k] = -1
            for i in range(m):
                out_x[state, i] = np.nan
