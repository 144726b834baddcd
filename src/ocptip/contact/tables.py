"""The tables of a `ContactSystem` for compiled code: two arrays instead of twenty.

Every array that Python hands to a compiled function costs 0.1 microseconds, as much as many of its loops.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ocptip.numerics.jit.compiled import compiled


def packed(system: Any) -> tuple[np.ndarray, np.ndarray]:
    """Integers (sizes first) and floats of a `ContactSystem`, in the order in which `unpacked` reads them."""
    support = system.support
    columns, plain = system.matrix.T, system.plain_matrix.T
    used = columns != 0
    last = used.shape[1] - np.argmax(used[:, ::-1], axis=1)
    contacts = [c.columns for c in support.contacts]
    force = np.vstack([c.force.T for c in contacts])
    acceleration = np.vstack([c.acceleration.T for c in contacts]) / support.mass
    sizes = [
        support.n_contacts, len(system.rhs_offset), len(columns), len(system.subsets),
        len(system.start_inverse), len(system.start_subset), system.gauge.shape[1], support.dimension,
        support.wrench_size, system.block_start,
    ]  # fmt: skip
    integers = [
        sizes, system.first_column, system.row_start, system.subset_start, system.start_count,
        system.start_first, system.start_subset, system.subsets, system.successor, system.entering,
        system.lifts, np.column_stack([np.argmax(used, axis=1), last]),
    ]  # fmt: skip
    floats = [
        columns, plain, system.start_inverse, system.gauge, force, acceleration, system.force_offset,
        system.rhs_offset, system.plain_rhs_offset, system.rhs_matrix.T, system.hint_matrix.T,
    ]  # fmt: skip
    return _joined(integers, np.int64), _joined(floats, np.float64)


def _joined(parts: list[Any], kind: type) -> np.ndarray:
    return np.concatenate([np.asarray(part, dtype=kind).ravel() for part in parts])


@compiled
def unpacked(integers, floats):
    """What the compiled functions take of a system, as views of the two arrays, see `pivoting`."""
    n, m, columns, places = integers[0], integers[1], integers[2], integers[3]
    largest, starts, free, d = integers[4], integers[5], integers[6], integers[7]
    index = 10
    first_column, index = integers[index : index + n], index + n
    row_start, index = integers[index : index + n + 1], index + n + 1
    subset_start, index = integers[index : index + n], index + n
    start_count, index = integers[index : index + n], index + n
    start_first, index = integers[index : index + n], index + n
    start_subset, index = integers[index : index + starts], index + starts
    subsets, index = integers[index : index + places], index + places
    successor, index = integers[index : index + places], index + places
    entering, index = integers[index : index + places], index + places
    lifts, index = integers[index : index + columns], index + columns
    extent = integers[index : index + 2 * columns].reshape((columns, 2))

    index, size = 0, columns * m
    matrix, index = floats[index : index + size].reshape((columns, m)), index + size
    check_matrix, index = floats[index : index + size].reshape((columns, m)), index + size
    size = largest * largest * starts
    start_inverse, index = floats[index : index + size].reshape((largest, largest, starts)), index + size
    gauge, index = floats[index : index + m * free].reshape((m, free)), index + m * free
    force_columns, index = floats[index : index + columns * d].reshape((columns, d)), index + columns * d
    acceleration_columns, index = (
        floats[index : index + columns * d].reshape((columns, d)),
        index + columns * d,
    )
    force_offset = floats[index : index + n * d].reshape((n, d))
    return (
        matrix, extent, first_column, row_start, subsets, subset_start, successor, entering,
        start_count, start_first, start_subset, start_inverse, integers[9] != 0, lifts, gauge,
        check_matrix, force_columns, force_offset, acceleration_columns,
    )  # fmt: skip


@compiled
def right_hand_sides(integers, floats, wrench):
    """Right-hand side (m,), that of the original system, and the hints of one wrench, see `pivoting`."""
    m, w = integers[1], integers[8]
    index = floats.shape[0] - 2 * m * (w + 1)
    rhs, plain, hint = floats[index : index + m].copy(), floats[index + m : index + 2 * m].copy(), np.zeros(m)
    index += 2 * m
    for j in range(w):
        for i in range(m):
            rhs[i] += floats[index + j * m + i] * wrench[j]
            plain[i] += floats[index + j * m + i] * wrench[j]
            hint[i] += floats[index + (w + j) * m + i] * wrench[j]
    return rhs, plain, hint
