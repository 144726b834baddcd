"""Vectors, rotations and small linear systems of CasADi scalars with exact structural zeros."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np
from scipy.sparse.csgraph import shortest_path

from ocptip.basics.errors import InputError
from ocptip.numerics.vectors import cross_terms as cross
from ocptip.parallel.description.platform import exact_cos_sin

Vector = list[cs.SX]


@dataclass(frozen=True)
class Turn:
    """Rotation about one coordinate axis (0, 1, 2) by an angle given as cosine and sine."""

    axis: int
    cos: cs.SX
    sin: cs.SX

    @property
    def inverse(self) -> Turn:
        """The turn by the negative angle."""
        return Turn(self.axis, self.cos, -self.sin)

    @property
    def trivial(self) -> bool:
        """True if the angle is exactly zero."""
        return self.cos.is_one() and self.sin.is_zero()

    def then(self, other: Turn) -> Turn:
        """The sum of two turns about the same axis, by the addition theorem."""
        return Turn(
            self.axis,
            self.cos * other.cos - self.sin * other.sin,
            self.sin * other.cos + self.cos * other.sin,
        )

    def apply(self, vector: Vector) -> Vector:
        """R v."""
        i, j = (self.axis + 1) % 3, (self.axis + 2) % 3
        turned = list(vector)
        turned[i] = self.cos * vector[i] - self.sin * vector[j]
        turned[j] = self.sin * vector[i] + self.cos * vector[j]
        return turned


def turn(axis: int, angle: cs.SX | float) -> Turn:
    """A turn by an angle in radians; numbers that are multiples of pi/2 get an exact cosine and sine."""
    angle = cs.SX(angle)
    if angle.is_constant():
        cos, sin = exact_cos_sin(float(angle))
        return Turn(axis, cs.SX(cos), cs.SX(sin))
    return Turn(axis, cs.cos(angle), cs.sin(angle))


class Rotation:
    """R = R_1 R_2 ... R_k of turns; neighbours about the same axis are merged, zero turns dropped."""

    def __init__(self, turns: Iterable[Turn] = ()) -> None:
        merged: list[Turn] = []
        for one in turns:
            if merged and merged[-1].axis == one.axis:
                one = merged.pop().then(one)
            if not one.trivial:
                merged.append(one)
        self.turns = tuple(merged)

    def __matmul__(self, other: Rotation) -> Rotation:
        return Rotation((*self.turns, *other.turns))

    @property
    def inverse(self) -> Rotation:
        """R^T."""
        return Rotation(one.inverse for one in reversed(self.turns))

    def __call__(self, vector: Vector) -> Vector:
        """R v."""
        for one in reversed(self.turns):
            vector = one.apply(vector)
        return vector

    def matrix(self) -> list[Vector]:
        """The nine entries, row by row."""
        columns = [self(unit(k)) for k in range(3)]
        return [[columns[k][row] for k in range(3)] for row in range(3)]


def unit(axis: int) -> Vector:
    """Unit vector along a coordinate axis."""
    return [cs.SX(1.0 if k == axis else 0.0) for k in range(3)]


def zero() -> Vector:
    """The zero vector."""
    return [cs.SX(0.0) for _ in range(3)]


def vector(values: Sequence[cs.SX | float] | np.ndarray) -> Vector:
    """A vector of SX scalars."""
    return [cs.SX(value) for value in values]


def plus(*vectors: Vector) -> Vector:
    """Sum of vectors, from left to right."""
    total = vectors[0]
    for other in vectors[1:]:
        total = [a + b for a, b in zip(total, other, strict=True)]
    return total


def minus(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return [x - y for x, y in zip(a, b, strict=True)]


def scaled(factor: cs.SX | float, vector_: Vector) -> Vector:
    """factor * v."""
    return [factor * x for x in vector_]


def dot(a: Sequence[cs.SX], b: Sequence[cs.SX]) -> cs.SX:
    """Inner product."""
    total = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        total = total + x * y
    return total


def times(matrix: Sequence[Sequence[cs.SX]], vector_: Sequence[cs.SX]) -> Vector:
    """Matrix times vector."""
    return [dot(row, vector_) for row in matrix]


def acceleration_matrix(omega: Vector, alpha: Vector) -> list[Vector]:
    """Om = skew(alpha) + skew(omega)^2: accelerations of the points of a body relative to its origin."""
    xx, yy, zz = (w * w for w in omega)
    xy, xz, yz = omega[0] * omega[1], omega[0] * omega[2], omega[1] * omega[2]
    return [
        [-(yy + zz), xy - alpha[2], xz + alpha[1]],
        [xy + alpha[2], -(xx + zz), yz - alpha[0]],
        [xz - alpha[1], yz + alpha[0], -(xx + yy)],
    ]


def spin_moment(inertia: Sequence[cs.SX], omega: Vector, alpha: Vector, matrix: Sequence[Vector]) -> Vector:
    """I omega' + omega x (I omega) about the origin of the frame, with the entries of Om.

    Args:
        inertia: XX, XY, XZ, YY, YZ, ZZ first.
        omega, alpha: angular velocity and acceleration, body axes.
        matrix: Om of both.
    """
    xx, xy, xz, yy, yz, zz = inertia[:6]
    x, y, z = omega
    return [
        xx * alpha[0] + (zz - yy) * (y * z) - xy * matrix[2][0] + xz * matrix[1][0] + yz * (y * y - z * z),
        yy * alpha[1] + (xx - zz) * (x * z) + xy * matrix[2][1] - yz * matrix[0][1] + xz * (z * z - x * x),
        zz * alpha[2] + (yy - xx) * (x * y) - xz * matrix[1][2] + yz * matrix[0][2] + xy * (x * x - y * y),
    ]


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
