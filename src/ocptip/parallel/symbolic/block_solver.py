"""Small linear systems of symbolic entries, solved along their block triangular structure.

Blocks of one to three unknowns are solved by Cramer's rule, so that the only divisors are factors of the
determinant: the code fails where the matrix is singular and nowhere else. Larger blocks are split by a Schur
complement after the first three unknowns, whose block must then be regular as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs
import numpy as np
from scipy.sparse.csgraph import shortest_path

from ocptip.basics.errors import InputError
from ocptip.numerics.vectors import cross_terms as cross
from ocptip.parallel.symbolic.spatial_sx import dot, times

Matrix = list[list[cs.SX]]


class BlockSystem:
    """A square matrix of SX scalars with structural zeros.

    Attributes:
        matrix: its rows.
        blocks: pairs (rows, columns) of the diagonal blocks, in the order in which A x = b is solved.
    """

    def __init__(self, matrix: Matrix) -> None:
        self.matrix = matrix
        pattern = np.array([[not entry.is_zero() for entry in row] for row in matrix])
        row_of = _matching(pattern)
        if row_of is None:
            raise InputError("the symbolic matrix is structurally singular: an unknown cannot be determined")
        # What an unknown needs is known by its row; those that need each other are a block.
        reach = np.isfinite(shortest_path(pattern[row_of], unweighted=True))
        block = reach & reach.T
        first = [i for i in range(len(matrix)) if not block[i, :i].any()]
        groups = [np.flatnonzero(block[i]).tolist() for i in sorted(first, key=lambda i: reach[i].sum())]
        self.blocks = [([row_of[i] for i in group], group) for group in groups]

    def solve(self, right: Sequence[cs.SX]) -> list[cs.SX]:
        """x of A x = b."""
        return _substituted(self.matrix, self.blocks, right)

    def solve_transposed(self, right: Sequence[cs.SX]) -> list[cs.SX]:
        """y of A^T y = b."""
        transposed = [list(column) for column in zip(*self.matrix, strict=True)]
        return _substituted(transposed, [(columns, rows) for rows, columns in reversed(self.blocks)], right)

    def own_row(self, column: int) -> int | None:
        """The row of a column that is a diagonal block by itself; None if its block is larger."""
        for rows, columns in self.blocks:
            if columns == [column]:
                return rows[0]
        return None


def _substituted(
    matrix: Matrix, blocks: Sequence[tuple[list[int], list[int]]], right: Sequence[cs.SX]
) -> list[cs.SX]:
    """x of A x = b, block by block."""
    known: dict[int, cs.SX] = {}
    for rows, columns in blocks:
        rest = []
        for r in rows:
            value = right[r]
            for c, x in known.items():
                value = value - matrix[r][c] * x
            rest.append(value)
        block = [[matrix[r][c] for c in columns] for r in rows]
        known.update(zip(columns, solve_dense(block, rest), strict=True))
    return [known[c] for c in range(len(matrix))]


def solve_dense(matrix: Matrix, right: Sequence[cs.SX]) -> list[cs.SX]:
    """x of A x = b for a small dense matrix; zero right-hand sides stay structurally zero."""
    if all(value.is_zero() for value in right):
        return [cs.SX(0.0) for _ in right]
    size = len(matrix)
    if size == 1:
        return [right[0] / matrix[0][0]]
    if size == 2:
        (a, b), (c, d) = matrix
        inverse = 1 / (a * d - b * c)
        return [(d * right[0] - b * right[1]) * inverse, (a * right[1] - c * right[0]) * inverse]
    if size == 3:
        columns = [[row[k] for row in matrix] for k in range(3)]
        normal = cross(columns[1], columns[2])
        other = cross(columns[0], list(right))
        inverse = 1 / dot(columns[0], normal)
        first = dot(right, normal) * inverse
        return [first, dot(other, columns[2]) * inverse, -dot(other, columns[1]) * inverse]
    return _schur(matrix, right)


def adjugate(matrix: Matrix) -> tuple[Matrix, cs.SX]:
    """Adjugate and determinant of a 3 x 3 matrix."""
    rows = [cross(matrix[1], matrix[2]), cross(matrix[2], matrix[0]), cross(matrix[0], matrix[1])]
    return [[rows[j][i] for j in range(3)] for i in range(3)], dot(matrix[0], rows[0])


def _schur(matrix: Matrix, right: Sequence[cs.SX]) -> list[cs.SX]:
    adjoint, determinant = adjugate([row[:3] for row in matrix[:3]])
    inverse = 1 / determinant
    columns = [[row[k] for row in matrix[:3]] for k in range(3, len(matrix))] + [list(right[:3])]
    # Scaled by the determinant; the division happens once per product with the lower rows.
    reduced = [times(adjoint, column) for column in columns]
    below = [[x * inverse for x in row[:3]] for row in matrix[3:]]
    rest = []
    for row, scaled_row, value in zip(matrix[3:], below, right[3:], strict=True):
        entries = [row[3 + k] - dot(scaled_row, reduced[k]) for k in range(len(columns) - 1)]
        rest.append((entries, value - dot(scaled_row, reduced[-1])))
    last = solve_dense([entries for entries, _ in rest], [value for _, value in rest])
    first = []
    for k in range(3):
        value = reduced[-1][k]
        for column, x in zip(reduced[:-1], last, strict=True):
            value = value - column[k] * x
        first.append(value * inverse)
    return first + last


def _matching(pattern: np.ndarray) -> list[int] | None:
    """For each column a different row with an entry there (augmenting paths); None if there is none."""
    size = len(pattern)
    column_of: dict[int, int] = {}

    def place(column: int, seen: set[int]) -> bool:
        for row in range(size):
            if pattern[row][column] and row not in seen:
                seen.add(row)
                if row not in column_of or place(column_of[row], seen):
                    column_of[row] = column
                    return True
        return False

    if not all(place(column, set()) for column in range(size)):
        return None
    return [row for _, row in sorted((column, row) for row, column in column_of.items())]
