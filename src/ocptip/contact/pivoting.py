"""Complementary pivoting ruled by mode automata: the compiled kernel.

The system is `C x = rhs`, x >= 0, where the columns of `C` belong to contacts and each contact's basic
columns form one of its admissible subsets. Lemke's scheme: a start basis `B0`, an artificial variable `z0`
with the covering column `B0 e`, and then pivots. The automaton of the leaving variable's contact names the
variable that enters.

Ties are the rule, not the exception (rank of the force columns is at most 6): the right-hand side is
therefore perturbed symbolically by `epsilon B0 rho` with a fixed generic vector `rho` > 0 and an
infinitesimal epsilon. The perturbation's image in the current basis is carried along as one column `p`
and decides every tie; a perturbed problem has no ties, so no basis can come twice.

All numbers are scaled: the largest element of a right-hand side is 1.
"""

from __future__ import annotations

import numpy as np

from ocptip.contact.basis import (
    apply_inverse,
    block_inverse,
    column_image,
    exchange,
    factorise,
    largest_residual,
    load_basis,
    polish,
    recall,
    remember,
)
from ocptip.contact.tables import right_hand_sides, unpacked
from ocptip.numerics.jit.compiled import compiled

SOLVED, RAY, PIVOT_LIMIT, SINGULAR, INACCURATE = 0, 1, 2, 3, 4
RESIDUAL_TOLERANCE = 1e-9
"""Largest natural residual, relative to the largest right-hand side, of a state called solved."""

_MAX_PIVOTS = 2000

_ZERO = 1e-13
_PIVOT_TOLERANCE = 1e-9
_TIE_TOLERANCE = 1e-10
_NEGATIVE_TOLERANCE = 1e-10
_REFACTOR_EVERY = 64
_CRASH_CONTACTS, _CRASH_STEPS = 3, 12
_CRASH_PIVOT = 1e-3


@compiled
def _choose_start(rhs, row_start, start_count, start_first, start_inverse, negative, choice):
    """For each contact the start candidate whose local solution has the smallest negative sum.

    `start_inverse` is (rows, columns, candidates): the candidates are the contiguous index.
    """
    # Only the local block of each contact is used: coupling between contacts is what the pivots resolve.
    for k in range(choice.shape[0]):
        r0, c0, count = row_start[k], start_first[k], start_count[k]
        size = row_start[k + 1] - r0
        for c in range(count):
            negative[c] = 0.0
        for i in range(size):
            for c in range(count):
                value = start_inverse[i, 0, c0 + c] * rhs[r0]
                for j in range(1, size):
                    value += start_inverse[i, j, c0 + c] * rhs[r0 + j]
                negative[c] -= value if value < 0.0 else 0.0
        best = 0
        for c in range(1, count):
            if negative[c] < negative[best]:
                best = c
        choice[k] = c0 + best


@compiled
def _press(
    columns, extent, first_column, row_start, subsets, subset_start, successor, entering,
    lifts, subset, element, owner, inverse_t, x, p, d,
):  # fmt: skip
    """Let negative variables leave, the most negative first, before the method proper begins.

    First the normal accelerations of up to three contacts: from "everything lifts off" this closes the
    contacts that are pressed most. Then some steps with any negative variable. Each costs a third of a step
    of the method proper, whose path from there is less than half as long. Any regular basis of admissible
    subsets is a valid start. Returns the number of exchanges.
    """
    m = row_start[-1]
    for step in range(_CRASH_STEPS):
        r, worst = -1, -_ZERO
        for i in range(m):
            normal = lifts[first_column[owner[i]] + element[i]] != 0
            if x[i] < worst and (normal or step >= _CRASH_CONTACTS):
                r, worst = i, x[i]
        if r < 0:
            return step
        k = owner[r]
        size = row_start[k + 1] - row_start[k]
        place = subset_start[k] + subset[k] * size
        while subsets[place] != element[r]:
            place += 1
        c = first_column[k] + entering[place]
        column_image(inverse_t, columns, c, extent, d)
        # A small pivot would give an ill-conditioned start, which costs more than the steps that it saves.
        if abs(d[r]) < _CRASH_PIVOT:
            return step
        element[r] = entering[place]
        subset[k] = successor[place]
        exchange(inverse_t, x, p, d, r)
    return _CRASH_STEPS


@compiled
def _lemke(
    columns, extent, first_column, row_start, subsets, subset_start, successor, entering, rhs,
    subset, element, owner, inverse_t, basis_t, x, p, d, ratio, cover, e, rho, largest_pivot,
):  # fmt: skip
    """Pivot from the current (inverted) basis until the artificial variable leaves.

    Returns (status, pivots). On SOLVED the slots hold a complementary basis.
    """
    m, width = row_start[-1], x.shape[0]
    # the artificial variable enters: B x - cover z0 = rhs with cover = B0 e; worst row leaves
    # z0 is the smallest value with which no variable is negative: x + e z0 >= 0.
    z0 = 0.0
    for i in range(m):
        if x[i] < 0.0 and -x[i] / e[i] > z0:
            z0 = -x[i] / e[i]
    artificial = -1
    # Among ties the perturbation rho decides, as in all later ratio tests, so that no basis can come twice.
    best = np.inf
    for i in range(m):
        if x[i] < 0.0 and -x[i] / e[i] >= z0 - _TIE_TOLERANCE and rho[i] / e[i] < best:
            best = rho[i] / e[i]
            artificial = i
    # In the start basis the images of the perturbation and of the covering column are known without solving.
    for i in range(m):
        cover[i] = 0.0
        p[i] = rho[i]
        d[i] = -e[i]
    for slot in range(m):
        c = first_column[owner[slot]] + element[slot]
        for i in range(m):
            cover[i] += columns[c, i] * e[slot]
    leaving_contact, leaving_element = owner[artificial], element[artificial]
    exchange(inverse_t, x, p, d, artificial)
    owner[artificial] = -1
    pivots = 1
    while pivots < _MAX_PIVOTS:
        # The automaton replaces the complement rule of Lemke's method: it names the variable that has to
        # enter.
        k = leaving_contact
        size = row_start[k + 1] - row_start[k]
        place = subset_start[k] + subset[k] * size
        while subsets[place] != leaving_element:
            place += 1
        new_element = entering[place]
        subset[k] = successor[place]

        c = first_column[k] + new_element
        column_image(inverse_t, columns, c, extent, d)
        dmax = 1.0
        for i in range(m):
            if d[i] > dmax:
                dmax = d[i]
        # Pivots below this are rounding errors of the column: to divide by them would destroy the basis.
        limit = _PIVOT_TOLERANCE * dmax
        theta = np.inf
        for i in range(width):  # branch-free, so that it is vectorised
            value = x[i] if x[i] > 0.0 else 0.0
            ratio[i] = value / d[i] if d[i] > limit else np.inf
        for i in range(m):
            theta = ratio[i] if ratio[i] < theta else theta
        if theta == np.inf:
            return RAY, pivots
        r = -1
        best = np.inf
        for i in range(m):
            if ratio[i] < np.inf and (ratio[i] - theta) * d[i] <= _TIE_TOLERANCE:
                # If the artificial variable ties, it leaves at once: the basis is then complementary, the
                # state solved.
                if i == artificial:
                    r = i
                    break
                # The perturbation excludes cycles. The largest pivot does not, but loses fewer digits: later
                # attempts try it.
                key = -d[i] if largest_pivot else p[i] / d[i]
                if key < best:
                    best = key
                    r = i
        leaving_contact, leaving_element = owner[r], element[r]
        exchange(inverse_t, x, p, d, r)
        owner[r] = k
        element[r] = new_element
        pivots += 1
        if leaving_contact < 0:
            return SOLVED, pivots
        # Every exchange adds rounding errors to the updated inverse; a fresh factorisation removes them.
        if pivots % _REFACTOR_EVERY == 0:
            if not factorise(columns, first_column, element, owner, cover, basis_t, inverse_t):
                return SINGULAR, pivots
            apply_inverse(inverse_t, rhs, x)
    return PIVOT_LIMIT, pivots


@compiled
def _next_random(state):
    """Deterministic uniform numbers in [0, 1) (a linear congruential generator, 53 bits)."""
    state[0] = state[0] * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
    return np.float64(state[0] >> np.uint64(11)) / 9007199254740992.0


@compiled
def _solve_all(
    integers, floats, warm, memory, first_attempt, attempts, initial, rhs_all, hints, check_rhs, seeds,
    out_subset, out_x, out_status, out_pivots, out_attempt, out_residual, out_force, out_acceleration,
):  # fmt: skip
    """Solve all right-hand sides of one system, see `solve_batch`.

    Args:
        integers, floats: the system (`tables.packed`), from which are read:
        columns: (P, m) all columns of the system, as rows.
        extent: (P, 2) each column is zero before the first and from the second row number on.
        first_column: (n,) index of each contact's first column.
        row_start: (n + 1,) first row (and slot) of each contact.
        subsets, successor, entering: automata of all contacts, flattened; contact k begins at
            `subset_start[k]`.
        start_*: candidates for the start basis with the inverses of their local blocks (see
            `_choose_start`); `block_start` if no candidate has entries outside its contact's rows.
        lifts: (P,) 1 for variables that accelerate a contact along its normal.
        gauge: (m, c) directions in which the right-hand side may be shifted without changing the physics
            (distribution of forces that the equations leave open); used by the later attempts.
        check_matrix: (P, m) columns of the original system, for the residual.
        force_columns, acceleration_columns, force_offset: (P, d), (P, d), (n, d) what each variable adds
            to its contact's force and acceleration.
        warm: start from the previous state's basis; the first one from `initial` if initial[0] >= 0.
        memory: with `warm`, number of bases that are kept after they solved a state; a state starts from the
            first of them in which it has no negative variable. 0: from the previous state's.
        first_attempt, attempts: which starts are tried before a state is given up: 1 guessed, 2 the
            regular one, 3 with another tie rule, from 4 on random (`seeds`, (N,), per state).
        rhs_all: (N, m) right-hand sides (not scaled).
        hints: (N, m) right-hand sides by which the first start basis is chosen.
        check_rhs: (N, m) right-hand sides of the original system.
        out_*: results: subsets (N, n), basic values in canonical order (N, m), status, pivots, attempt
            and relative residual of each state, contact forces and accelerations (N, n, d).
    """
    (
        columns, extent, first_column, row_start, subsets, subset_start, successor, entering,
        start_count, start_first, start_subset, start_inverse, block_start, lifts, gauge,
        check_matrix, force_columns, force_offset, acceleration_columns,
    ) = unpacked(integers, floats)  # fmt: skip
    n = first_column.shape[0]
    m = row_start[n]
    width = (m + 7) // 8 * 8  # padded with zeros: the vector loops then have no remainder
    inverse_t, basis_t = np.zeros((m, width)), np.empty((m, m))
    x, p, d, ratio = np.zeros(width), np.zeros(width), np.zeros(width), np.zeros(width)
    e, rho, cover, rhs, work = np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    element, owner, subset = np.empty(m, np.int64), np.empty(m, np.int64), np.empty(n, np.int64)
    generator, choice = np.empty(1, np.uint64), np.empty(n, np.int64)
    candidates = 0
    for k in range(n):
        candidates = max(candidates, start_count[k])
    negative = np.empty(candidates)
    for i in range(m):
        # Multiples of the golden ratio modulo 1 are all different and evenly spread: a generic direction.
        rho[i] = 1.0 + ((i + 1) * 0.6180339887498949) % 1.0
    inverses, bases = np.empty((memory, m, width)), np.empty((memory, 2 * m + n), np.int64)
    order, remembered, loaded = np.empty(memory, np.int64), 0, -1
    for i in range(memory):
        order[i] = i
    have_basis = False
    if warm and initial[0] >= 0:
        for k in range(n):
            subset[k] = initial[k]
        load_basis(row_start, n, subset, subsets, subset_start, element, owner)
        have_basis = factorise(columns, first_column, element, owner, cover, basis_t, inverse_t)

    for state in range(rhs_all.shape[0]):
        # With a largest element of 1 all tolerances of the kernel are absolute numbers.
        scale = 0.0
        for i in range(m):
            scale = max(scale, abs(rhs_all[state, i]))
        if scale == 0.0:
            scale = 1.0
        generator[0] = seeds[state]
        status, total = INACCURATE, 0
        attempt = 0 if warm and have_basis else first_attempt
        residual = np.inf
        while attempt < attempts:
            for i in range(m):
                rhs[i] = rhs_all[state, i] / scale
                e[i] = 0.2 + _next_random(generator) if attempt >= 4 else 1.0
            if attempt == 0 and remembered > 0:
                loaded = recall(
                    loaded, remembered, inverses, bases, rhs, x, order, inverse_t, subset, element, owner
                )
            # Forces that the equations leave open may all lie on one side of a limit: a random shift moves
            # them.
            if attempt >= 6:
                for c in range(gauge.shape[1]):
                    w = 4.0 * _next_random(generator) - 2.0
                    for i in range(m):
                        rhs[i] += w * gauge[i, c]
            # A warm start (attempt 0) keeps the basis of the state before; all others build one from the
            # contacts.
            if attempt > 0:
                if attempt < 4:
                    for i in range(m):
                        work[i] = hints[state, i] if attempt == 1 else rhs[i]
                    _choose_start(work, row_start, start_count, start_first, start_inverse, negative, choice)
                else:
                    for k in range(n):
                        choice[k] = start_first[k] + int(_next_random(generator) * start_count[k])
                for k in range(n):
                    subset[k] = start_subset[choice[k]]
                load_basis(row_start, n, subset, subsets, subset_start, element, owner)
                if block_start:
                    block_inverse(row_start, choice, start_inverse, inverse_t)
                elif not factorise(columns, first_column, element, owner, cover, basis_t, inverse_t):
                    status = SINGULAR
                    have_basis = False
                    attempt += 1
                    continue
            apply_inverse(inverse_t, rhs, x)
            if attempt == 1:
                total += _press(
                    columns, extent, first_column, row_start, subsets, subset_start, successor, entering,
                    lifts, subset, element, owner, inverse_t, x, p, d,
                )  # fmt: skip
            worst = 0.0
            for i in range(m):
                worst = min(worst, x[i])
            status, pivots = SOLVED, 0
            if worst < -_ZERO:
                status, pivots = _lemke(
                    columns, extent, first_column, row_start, subsets, subset_start, successor, entering, rhs,
                    subset, element, owner, inverse_t, basis_t, x, p, d, ratio, cover, e, rho,
                    attempt > 2 and attempt % 2 == 1,
                )  # fmt: skip
            total += pivots
            have_basis = False
            if attempt > 0 or pivots > 0:
                loaded = -1
            if status == SOLVED:
                if pivots > 0 or attempt == 1:  # exchanges leave rounding errors in x
                    apply_inverse(inverse_t, rhs, x)
                smallest, residual = polish(columns, first_column, element, owner, inverse_t, rhs, x, d, work)
                # the updated inverse may have drifted: factorise afresh before giving up
                if not smallest >= -_NEGATIVE_TOLERANCE and factorise(
                    columns, first_column, element, owner, cover, basis_t, inverse_t
                ):
                    apply_inverse(inverse_t, rhs, x)
                    smallest, residual = polish(
                        columns, first_column, element, owner, inverse_t, rhs, x, d, work
                    )
                # Values below 0 by rounding are set to 0, so the residual on the original equations has to be
                # computed again.
                if smallest < 0.0 or gauge.shape[1] > 0:
                    for i in range(m):
                        rhs[i] = check_rhs[state, i] / scale
                        x[i] = max(x[i], 0.0)
                    residual = max(
                        -smallest,
                        largest_residual(check_matrix, first_column, element, owner, rhs, x, work),
                    )
                if residual <= RESIDUAL_TOLERANCE:
                    have_basis = True
                    break
                status = INACCURATE
            attempt += 1
        if memory > 0 and have_basis and loaded < 0:
            # the least used one makes room
            loaded = order[min(remembered, memory - 1)]
            remembered = min(remembered + 1, memory)
            remember(loaded, inverses, bases, inverse_t, subset, element, owner)
        out_status[state] = status
        out_pivots[state] = total
        out_attempt[state] = attempt
        out_residual[state] = residual
        if status == SOLVED:
            for slot in range(m):
                k = owner[slot]
                place = subset_start[k] + subset[k] * (row_start[k + 1] - row_start[k])
                place_in_contact = 0
                while subsets[place + place_in_contact] != element[slot]:
                    place_in_contact += 1
                out_x[state, row_start[k] + place_in_contact] = x[slot] * scale
            for k in range(n):
                out_subset[state, k] = subset[k]
                size = row_start[k + 1] - row_start[k]
                base = subset_start[k] + subset[k] * size
                for j in range(force_offset.shape[1]):
                    out_force[state, k, j] = force_offset[k, j]
                    out_acceleration[state, k, j] = 0.0
                for place in range(size):
                    c = first_column[k] + subsets[base + place]
                    value = out_x[state, row_start[k] + place]
                    for j in range(force_offset.shape[1]):
                        out_force[state, k, j] += force_columns[c, j] * value
                        out_acceleration[state, k, j] += acceleration_columns[c, j] * value
        else:
            for i in range(m):
                out_x[state, i] = np.nan
            for k in range(n):
                out_subset[state, k] = -1
                for j in range(force_offset.shape[1]):
                    out_force[state, k, j] = out_acceleration[state, k, j] = np.nan


@compiled
def solve_batch(
    integers, floats, warm, memory, first_attempt, attempts, largest, seeds, sides, codes, numbers
):
    """Solve many wrenches of one system, with all results in two arrays.

    The only entry from Python, also for one wrench: so machine code of the solver is made once.

    Args:
        integers, floats, ..., attempts: see `_solve_all`.
        largest: of a wrench's elements.
        seeds: (N,) of random numbers.
        sides: (3, N, m) right-hand sides, hints, and right-hand sides of the original system; (3, 0, 0) for
            a single wrench: they are computed here.
        codes: (N (n + 3),) results: subsets, status, pivots, attempts. The first n: the subsets of a basis to
            start from, or -1.
        numbers: (N (w + m + 1 + 2 n d),) the wrenches, and results: basic values, residuals, forces,
            accelerations.

    Returns:
        Whether it is one wrench and solved; also False for a wrench with NaN or larger elements.
    """
    n, m, d, w, count = integers[0], integers[1], integers[7], integers[8], seeds.shape[0]
    if count == 0:
        return False
    for i in range(count * w):
        if not abs(numbers[i]) <= largest:
            return False
    rhs, hint, plain = sides[0], sides[1], sides[2]
    if sides.shape[1] < count:
        one, original, hinted = right_hand_sides(integers, floats, numbers[:w])
        rhs, hint, plain = one.reshape((1, m)), hinted.reshape((1, m)), original.reshape((1, m))
    status, pivots, attempt = count * n, count * (n + 1), count * (n + 2)
    basic, residual, force = count * w, count * (w + m), count * (w + m + 1)
    acceleration = force + count * n * d
    _solve_all(
        integers, floats, warm, memory, first_attempt, attempts, codes[:n], rhs, hint, plain, seeds,
        codes[:status].reshape((count, n)), numbers[basic:residual].reshape((count, m)),
        codes[status:pivots], codes[pivots:attempt], codes[attempt:], numbers[residual:force],
        numbers[force:acceleration].reshape((count, n, d)), numbers[acceleration:].reshape((count, n, d)),
    )  # fmt: skip
    return count == 1 and codes[n] == SOLVED
