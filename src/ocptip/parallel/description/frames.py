"""Orientation and twist of the platform in all 12 Euler conventions; frames of the rows of a table.

Orientations are written once, for scalars; what comes in as CasADi expressions goes out as such.
R_P = R_a(phi1) R_b(phi2) R_c(phi3), omega = E phi' (3.40), world axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as cs
import numpy as np

from ocptip.numerics.vectors import cross_terms, skew
from ocptip.parallel.description.platform import (
    BodyInertia,
    Entry,
    Platform,
    elementary_rotation,
    turn_about,
    value_of,
)
from ocptip.parallel.description.robot_description import FIXED, PRISMATIC, REVOLUTE, MDHRow

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


Frame = tuple[np.ndarray, np.ndarray]
"""Rotation (3, 3), frame axes to outer axes, and origin (3,), m, outer axes."""


def compose(a: Frame, b: Frame) -> Frame:
    """Frame b, given in frame a, in a's outer axes."""
    return a[0] @ b[0], a[1] + a[0] @ b[1]


def inverse(a: Frame) -> Frame:
    """The outer frame in frame a."""
    return a[0].T, -a[0].T @ a[1]


def moved_inertia(body: BodyInertia, frame: Frame) -> BodyInertia:
    """Inertia about another frame, in its axes.

    Args:
        body: about the origin of its frame, in its axes.
        frame: the frame of the body, given in the other one.
    """
    R, d = frame
    s, inertia, mass = R @ body.first_moment, R @ body.inertia @ R.T, body.mass
    # Inertia about another point: I + skew terms of the first moment and of the mass.
    shifted = inertia - skew(d) @ skew(s) - skew(s) @ skew(d) - mass * skew(d) @ skew(d)
    return BodyInertia(mass, s + mass * d, 0.5 * (shifted + shifted.T), grouped=body.grouped)


def central_inertia(body: BodyInertia) -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass (3,), m, and inertia about it (3, 3), kg m^2, body axes; the origin without mass."""
    center = body.first_moment / body.mass if body.mass else np.zeros(3)
    return center, body.central


def row_frame(row: MDHRow, joint: float = 0.0) -> Frame:
    """Frame j in frame a(j) (2.11); no joint value counts for a fixed row."""
    gamma, alpha = elementary_rotation("z", row.gamma), elementary_rotation("x", row.alpha)
    r = value_of(row.r) + (joint if row.sigma == PRISMATIC else 0.0)
    before = gamma @ alpha
    arm = np.array([0.0, 0.0, value_of(row.b)]) + gamma @ [value_of(row.d), 0.0, 0.0] + before @ [0.0, 0.0, r]
    if row.sigma == REVOLUTE:
        c, s = math.cos(value_of(row.theta) + joint), math.sin(value_of(row.theta) + joint)
        return before @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), arm
    return before @ elementary_rotation("z", row.theta), arm


def standard_frame(a: Entry, alpha: Entry) -> Frame:
    """Frame i of a standard row, at the end of its link, in frame i of modified rows, on the joint's axis."""
    return elementary_rotation("x", alpha), np.array([value_of(a), 0.0, 0.0])


def modified_rows(rows: Sequence[MDHRow], links: Sequence[tuple[Entry, Entry]]) -> tuple[MDHRow, ...]:
    """Modified rows of a chain that is given by standard Denavit-Hartenberg rows.

    A standard row is Rz(theta) Tz(d) Tx(a) Rx(alpha): its a and alpha stand in the modified row after it.

    Args:
        rows: joints with theta and r (the standard d), nothing else.
        links: (a, alpha) of each, m and rad.
    """
    before = [(0.0, 0.0), *links[:-1]]
    return tuple(replace(row, d=a, alpha=alpha) for row, (a, alpha) in zip(rows, before, strict=True))


def fixed_row(frame: Frame, snap: float = 0.0) -> MDHRow:
    """The row without a joint that leads to a frame, given in the frame before: any frame has one."""
    R, p = frame
    sine = math.hypot(R[0, 2], R[1, 2])
    alpha = math.atan2(sine, R[2, 2])
    if sine <= max(snap, 1e-12):
        gamma = math.atan2(p[1], p[0]) if math.hypot(p[0], p[1]) > snap else 0.0
        # z axes parallel: only gamma + theta counts, or gamma - theta if they point against each other.
        turn = math.atan2(R[1, 0], R[0, 0])
        theta = turn - gamma if R[2, 2] > 0 else gamma - turn
        b, d, r = p[2], math.hypot(p[0], p[1]), 0.0
    else:
        gamma, theta = math.atan2(R[0, 2], -R[1, 2]), math.atan2(R[2, 0], R[2, 1])
        along = np.column_stack([[0.0, 0.0, 1.0], [math.cos(gamma), math.sin(gamma), 0.0], R[:, 2]])
        b, d, r = np.linalg.solve(along, p)
    angles = (snapped_angle(value, snap) for value in (gamma, alpha, theta))
    lengths = (snapped_length(float(value), snap) for value in (b, d, r))
    (gamma, alpha, theta), (b, d, r) = angles, lengths
    return MDHRow(FIXED, gamma=gamma, b=b, alpha=alpha, d=d, theta=theta, r=r)


def rotation_angles(R: np.ndarray, snap: float = 0.0) -> tuple[tuple[str, float], ...]:
    """Elementary rotations whose product is R (3, 3): about z, x and z; those by zero are left out."""
    row = fixed_row((R, np.zeros(3)), snap)
    alpha = value_of(row.alpha)
    if alpha == 0.0:
        turns = (("z", snapped_angle(value_of(row.gamma) + value_of(row.theta), snap)),)
    else:
        turns = (("z", value_of(row.gamma)), ("x", alpha), ("z", value_of(row.theta)))
    return tuple((axis, angle) for axis, angle in turns if angle != 0.0)


def snapped_angle(angle: float, snap: float) -> float:
    """The angle, or the multiple of pi/2 that is nearer than `snap` (at least 1e-12), rad."""
    turns = round(angle / (math.pi / 2))
    exact = turns * (math.pi / 2)
    return exact if abs(angle - exact) <= max(snap, 1e-12) else angle


def snapped_length(length: float, snap: float) -> float:
    return 0.0 if abs(length) <= max(snap, 1e-15) else length
