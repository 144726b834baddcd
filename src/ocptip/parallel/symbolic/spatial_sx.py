"""Vectors and rotations of CasADi scalars with exact structural zeros.

A vector is a list of three SX scalars. A rotation is a chain of turns about coordinate axes. Passing a vector
between two frames then costs four multiplications and two additions per turn, and nothing for multiples of
pi/2. Zero components stay zero for the simplification of CasADi.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.parallel.description.entries import exact_cos_sin

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
