"""Orientation and twist of the platform in all 12 Euler conventions, for numbers and CasADi expressions.

The formulas are written once, for scalars; what comes in as CasADi expressions goes out as such.
R_P = R_a(phi1) R_b(phi2) R_c(phi3), omega = E phi' (3.40), world axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import casadi as cs
import numpy as np

from ocptip.numerics.vectors import cross_terms
from ocptip.parallel.description.entries import turn_about
from ocptip.parallel.description.platform import Platform

Scalar = Any


def euler_rotation(convention: str, phi: Sequence[Scalar]) -> Any:
    """(3, 3) platform axes to world axes.

    Args:
        convention: three axis letters of the moved axes.
        phi: three angles, rad; numbers or CasADi scalars.
    """
    first, second, third = _turns(convention, phi)
    return _pack(_product(_product(first, second), third))


def rate_matrix(convention: str, phi: Sequence[Scalar]) -> Any:
    """E, (3, 3): omega = E phi', world axes."""
    return _pack(_columns(_axes(convention, phi)))


def rate_matrix_derivative(convention: str, phi: Sequence[Scalar], rates: Sequence[Scalar]) -> Any:
    """E', (3, 3), time derivative of E at the given angular rates: omega' = E phi'' + E' phi'."""
    a, b, c = _axes(convention, phi)
    w1 = [v * rates[0] for v in a]
    w2 = [u + v * rates[1] for u, v in zip(w1, b, strict=True)]
    return _pack(_columns(([0.0, 0.0, 0.0], cross_terms(w1, b), cross_terms(w2, c))))


class PlatformCoordinates:
    """Free platform coordinates z, quasi-velocities s' and the platform's twist t = (r', omega).

    t = T s', s' = H z', world axes. With no, one or three free rotations T only selects and s' is the twist
    itself, restricted to what is free; with two, whose span of angular velocities turns with the platform,
    s' = z' and T holds the columns of E.

    Where coordinates d depend on z, `z` below stands for all that move, (z, d): first the free ones, then the
    dependent ones; s' is the rate of these.

    Attributes:
        m: number of free coordinates.
        indices: of the free ones among x, y, z, phi1, phi2, phi3.
        dependent: indices of the dependent ones.
        order: both.
    """

    def __init__(self, platform: Platform) -> None:
        self.convention = platform.convention
        self.indices = [i for i, free in enumerate(platform.mask) if free]
        self.dependent = [i for i, along in enumerate(platform.dependent) if along]
        self.order = self.indices + self.dependent
        self.m = len(self.indices)
        self._turning = [i - 3 for i in self.order if i >= 3]
        self._selection = np.zeros((6, len(self.order)))
        for column, i in enumerate(self.order):
            row = 3 + "xyz".index(self.convention[i - 3]) if i >= 3 and len(self._turning) == 1 else i
            self._selection[row, column] = 1.0

    @property
    def quasi(self) -> bool:
        """True if s' is a part of the twist; False if s' = z' (two free rotations, or dependent ones)."""
        return len(self._turning) != 2 and not self.dependent

    def full(self, z: Sequence[Scalar] | np.ndarray) -> list[Scalar]:
        """All six coordinates, zeros where none is free."""
        values: list[Scalar] = [0.0] * 6
        for k, i in enumerate(self.order):
            values[i] = z[k]
        return values

    def pose(self, z: Sequence[Scalar] | np.ndarray) -> tuple[Any, Any]:
        """Position (3,), m, world axes, and rotation (3, 3), platform axes to world axes."""
        full = self.full(z)
        return _pack(full[:3]), euler_rotation(self.convention, full[3:])

    def selection(self, z: np.ndarray) -> np.ndarray:
        """T, (6, m): t = T s'."""
        if self.quasi:
            return self._selection
        T = self._selection.copy()
        turning = [column for column, i in enumerate(self.order) if i >= 3]
        T[3:, turning] = rate_matrix(self.convention, self.full(z)[3:])[:, self._turning]
        return T

    def selection_drift(self, z: np.ndarray, s_rates: np.ndarray) -> np.ndarray:
        """T' s', (6,)."""
        drift = np.zeros(6)
        if not self.quasi:
            rates = self.full(s_rates)[3:]
            drift[3:] = rate_matrix_derivative(self.convention, self.full(z)[3:], rates) @ rates
        return drift

    def rates(self, z: np.ndarray) -> np.ndarray:
        """H, (m, m): s' = H z'."""
        H = np.eye(self.m)
        if self.quasi and len(self._turning) == 3:
            H[-3:, -3:] = rate_matrix(self.convention, self.full(z)[3:])
        return H

    def rates_derivative(self, z: np.ndarray, z_rates: np.ndarray) -> np.ndarray:
        """H', (m, m): s'' = H z'' + H' z'."""
        D = np.zeros((self.m, self.m))
        if self.quasi and len(self._turning) == 3:
            full = self.full(z)[3:], self.full(z_rates)[3:]
            D[-3:, -3:] = rate_matrix_derivative(self.convention, *full)
        return D

    def conditioning(self, z: np.ndarray) -> float:
        """Smallest singular value of the moving columns of E: 0 where the Euler angles are singular, 1
        without rotations."""
        if not self._turning:
            return 1.0
        E = rate_matrix(self.convention, self.full(z)[3:])[:, self._turning]
        return float(np.linalg.svd(E, compute_uv=False)[-1])


def rotation_vector(R: np.ndarray) -> np.ndarray:
    """(3,) rotation vector (axis times angle, rad) of a rotation matrix; angles up to pi."""
    w = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = float(np.linalg.norm(w)), 0.5 * (np.trace(R) - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-7:
        return w * (angle / sine)
    if cosine > 0:
        return w
    symmetric = 0.5 * (R + np.eye(3))  # angle near pi: the axis from R + 1 = 2 a a'
    column = symmetric[:, int(np.argmax(np.diag(symmetric)))]
    return angle * column / np.linalg.norm(column)


def _turns(convention: str, phi: Sequence[Scalar]) -> list[list[list[Scalar]]]:
    return [turn_about(letter, *_cos_sin(phi[k])) for k, letter in enumerate(convention)]


def _cos_sin(angle: Scalar) -> tuple[Scalar, Scalar]:
    lib = cs if _symbolic(angle) else math
    return lib.cos(angle), lib.sin(angle)


def _axes(convention: str, phi: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar], list[Scalar]]:
    """e_a, R_a e_b, R_a R_b e_c, world axes."""
    first, second, _ = _turns(convention, phi)
    a, b, c = ("xyz".index(letter) for letter in convention)
    both = _product(first, second)
    return [float(a == i) for i in range(3)], [first[i][b] for i in range(3)], [both[i][c] for i in range(3)]


def _product(A: list[list[Scalar]], B: list[list[Scalar]]) -> list[list[Scalar]]:
    return [[A[i][0] * B[0][j] + A[i][1] * B[1][j] + A[i][2] * B[2][j] for j in range(3)] for i in range(3)]


def _columns(vectors: Sequence[Sequence[Scalar]]) -> list[list[Scalar]]:
    return [[vector[i] for vector in vectors] for i in range(3)]


def _symbolic(value: Scalar) -> bool:
    return isinstance(value, cs.SX | cs.MX)


def _pack(values: list) -> Any:
    if isinstance(values[0], list):
        if any(_symbolic(v) for row in values for v in row):
            return cs.vertcat(*(cs.horzcat(*row) for row in values))
    elif any(_symbolic(v) for v in values):
        return cs.vertcat(*values)
    return np.array(values, dtype=float)
