"""Bases that have solved other states before: the next state's may be among them."""

from __future__ import annotations

import numpy as np

from ocptip.contact.basis import apply_inverse
from ocptip.numerics.jit.compiled import compiled

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
