"""A basis of the contacts' columns and its inverse: the compiled linear algebra under `pivoting`.

Slot i of a basis holds the variable `element[i]` of contact `owner[i]`. Inverses are stored transposed and
padded with zeros, so that the inner loops run over whole rows of memory.

Bases that have solved other states before are kept: that of the next state may be among them.
"""

from __future__ import annotations

import numpy as np

from ocptip.numerics.jit.compiled import compiled

_REFINED = 1e-14
_SINGULAR_TOLERANCE = 1e-11


@compiled
def load_basis(row_start, n, subset, subsets, subset_start, element, owner):
    """Put the current subsets into the slots, in canonical order (contact by contact)."""
    for k in range(n):
        size = row_start[k + 1] - row_start[k]
        base = subset_start[k] + subset[k] * size
        for place in range(size):
            element[row_start[k] + place] = subsets[base + place]
            owner[row_start[k] + place] = k


@compiled
def block_inverse(row_start, choice, start_inverse, inverse_t):
    """Inverse of a start basis that is block diagonal: every contact has columns in the rows of this contact
    only.
    """
    for j in range(inverse_t.shape[0]):
        for i in range(inverse_t.shape[1]):
            inverse_t[j, i] = 0.0
    for k in range(choice.shape[0]):
        r0 = row_start[k]
        for i in range(row_start[k + 1] - r0):
            for j in range(row_start[k + 1] - r0):
                inverse_t[r0 + j, r0 + i] = start_inverse[i, j, choice[k]]


@compiled
def factorise(columns, first_column, element, owner, cover, basis_t, inverse_t):
    """Invert the basis of the current slots (owner -1: the artificial variable) by Gauss-Jordan.

    Both matrices are kept transposed, so that rows of memory are columns of the basis. Returns False if
    the basis is singular.
    """
    m = basis_t.shape[0]
    for slot in range(m):
        if owner[slot] < 0:
            for i in range(m):
                basis_t[slot, i] = -cover[i]
        else:
            c = first_column[owner[slot]] + element[slot]
            for i in range(m):
                basis_t[slot, i] = columns[c, i]
        for i in range(inverse_t.shape[1]):
            inverse_t[slot, i] = 0.0
        inverse_t[slot, slot] = 1.0
    for c in range(m):
        best, row = abs(basis_t[c, c]), c
        for i in range(c + 1, m):
            if abs(basis_t[i, c]) > best:
                best, row = abs(basis_t[i, c]), i
        if best < _SINGULAR_TOLERANCE:
            return False
        if row != c:
            for j in range(m):
                t = basis_t[c, j]
                basis_t[c, j] = basis_t[row, j]
                basis_t[row, j] = t
                t = inverse_t[c, j]
                inverse_t[c, j] = inverse_t[row, j]
                inverse_t[row, j] = t
        f = 1.0 / basis_t[c, c]
        for j in range(m):
            basis_t[c, j] *= f
            inverse_t[c, j] *= f
        for i in range(m):
            f = basis_t[i, c]
            if i != c and f != 0.0:
                for j in range(c, m):
                    basis_t[i, j] -= f * basis_t[c, j]
                for j in range(m):
                    inverse_t[i, j] -= f * inverse_t[c, j]
    return True


@compiled
def apply_inverse(inverse_t, b, out):
    """out = inverse @ b."""
    for i in range(out.shape[0]):
        out[i] = 0.0
    for j in range(b.shape[0]):
        for i in range(out.shape[0]):
            out[i] += b[j] * inverse_t[j, i]


@compiled
def column_image(inverse_t, columns, c, extent, d):
    """d = inverse @ column c (the inverse is stored transposed: whole rows of memory are added).

    Here and in `exchange` no single zeros are skipped: the tests would cost more than the products.
    """
    for i in range(d.shape[0]):
        d[i] = 0.0
    for j in range(extent[c, 0], extent[c, 1]):
        f = columns[c, j]
        for i in range(d.shape[0]):
            d[i] += f * inverse_t[j, i]


@compiled
def exchange(inverse_t, x, p, d, r):
    """Replace slot r by the column whose image is d, in the inverse and in the two right-hand sides."""
    width = d.shape[0]
    f = 1.0 / d[r]
    keep = d[r]
    # With d[r] = 0 the loops need no exception for row r, and run without a test.
    d[r] = 0.0
    for j in range(inverse_t.shape[0]):
        g = inverse_t[j, r] * f
        for i in range(width):
            inverse_t[j, i] -= g * d[i]
        inverse_t[j, r] = g
    g = x[r] * f
    for i in range(width):
        x[i] -= g * d[i]
    x[r] = g
    g = p[r] * f
    for i in range(width):
        p[i] -= g * d[i]
    p[r] = g
    d[r] = keep


@compiled
def polish(columns, first_column, element, owner, inverse_t, rhs, x, d, work):
    """Refine the basic values x = inverse @ rhs of the current basis: (smallest, residual)."""
    m = element.shape[0]
    worst = np.inf
    # Iterative refinement: the residual comes from the original columns, so errors of the updated inverse
    # shrink.
    for step in range(3):
        worst = largest_residual(columns, first_column, element, owner, rhs, x, work)
        if worst < _REFINED or step == 2:
            break
        apply_inverse(inverse_t, work, d)
        for i in range(m):
            x[i] += d[i]
    smallest = np.inf
    for i in range(m):
        if not x[i] >= smallest:
            smallest = x[i]
    return smallest, worst


@compiled
def largest_residual(columns, first_column, element, owner, rhs, x, work):
    """Largest element of work = rhs - (basic columns) x."""
    m = element.shape[0]
    for i in range(m):
        work[i] = rhs[i]
    for slot in range(m):
        c = first_column[owner[slot]] + element[slot]
        v = x[slot]
        for i in range(m):
            work[i] -= columns[c, i] * v
    worst = 0.0
    for i in range(m):
        if not abs(work[i]) <= worst:
            worst = abs(work[i])
    return worst


ZERO = 1e-13  # a variable that is less negative is zero


@compiled
def recall(known, count, inverses, bases, rhs, x, order, inverse_t, subset, element, owner):
    """Load the known basis in which the state has no negative variable, else the smallest violation.

    `known` is the row of the basis that is loaded. The bases are tried in the `order` in which they served,
    the loaded one moves one place forward. Returns its row.
    """
    m, n = rhs.shape[0], subset.shape[0]
    best, least = known, -np.inf
    for place in range(count):
        row = order[place]
        apply_inverse(inverses[row], rhs, x)
        smallest = 0.0
        for i in range(m):
            smallest = x[i] if x[i] < smallest else smallest
        if smallest > least:
            best, least = row, smallest
        if smallest >= -ZERO:
            # Bases that serve often move to the front, so that most states need one trial.
            if place > 0:
                order[place], order[place - 1] = order[place - 1], row
            break
    if best != known:
        for i in range(inverse_t.shape[0]):
            for j in range(inverse_t.shape[1]):
                inverse_t[i, j] = inverses[best, i, j]
        for k in range(n):
            subset[k] = bases[best, 2 * m + k]
        for i in range(m):
            element[i], owner[i] = bases[best, i], bases[best, m + i]
    return best


@compiled
def remember(row, inverses, bases, inverse_t, subset, element, owner):
    """Store the loaded basis as a known one."""
    m = element.shape[0]
    for i in range(inverse_t.shape[0]):
        for j in range(inverse_t.shape[1]):
            inverses[row, i, j] = inverse_t[i, j]
    for i in range(m):
        bases[row, i], bases[row, m + i] = element[i], owner[i]
    for k in range(subset.shape[0]):
        bases[row, 2 * m + k] = subset[k]
