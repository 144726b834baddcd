"""Oriented lines (spears), screws and linear complexes in Plücker coordinates.

Every 6-vector holds the direction or angular part first and the moment or linear part second. A spear is a
line with an orientation: unit direction g and moment x × g for any point x of the line. A screw q is an
instantaneous motion: angular velocity, then velocity of the point at the origin. A linear complex (c, ĉ) is
the set of lines (l, l̂) with ĉ·l + c·l̂ = 0. Arrays may carry leading dimensions. Source: [Naw07] 1.1, 1.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.write import Record
from ocptip.numerics.vectors import cross, skew

TRANSLATION_TOLERANCE = 1e-12
"""rad/m: screws with less angular velocity per linear velocity are taken for translations."""

COMPLEX_TOLERANCE = 1e-9
"""Default threshold of the classification of pencils and bundles, relative to the largest value possible."""

_SWAP = [3, 4, 5, 0, 1, 2]


def spear(point: ArrayLike, direction: ArrayLike) -> np.ndarray:
    """The oriented line through a point.

    Args:
        point: (3,) or (n, 3), m.
        direction: (3,) or (n, 3), any length > 0.

    Returns:
        (6,) or (n, 6): unit direction, moment in m.

    Raises:
        InputError: shapes differ or are no such arrays, or a direction is zero.
    """
    shape = (3,) if np.ndim(direction) == 1 else (None, 3)
    points, directions = finite_array("point", point, shape), finite_array("direction", direction, shape)
    if points.shape != directions.shape:
        raise InputError(f"point: expected shape {directions.shape}, that of direction, got {points.shape}")
    lengths = np.linalg.norm(directions, axis=-1, keepdims=True)
    if (lengths == 0).any():
        raise InputError(f"direction: must not be zero, got {direction!r}")
    unit = directions / lengths
    return np.concatenate([unit, cross(points, unit)], axis=-1)


def foot_point(line: np.ndarray) -> np.ndarray:
    """Foot of the perpendicular from the origin on spears (..., 6): (..., 3), m."""
    return cross(line[..., :3], line[..., 3:])


def adjoint(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Ad(R, t): (6, 6) matrix that moves lines and screws as x' = R x + t moves points."""
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = rotation
    matrix[3:, :3] = skew(np.asarray(translation, dtype=float)) @ rotation
    return matrix


def dual_cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a ⊗ b of dual vectors (..., 6); also the rate of change of b when a body turns about a (1.21)."""
    mixed = cross(a[..., 3:], b[..., :3]) + cross(a[..., :3], b[..., 3:])
    return np.concatenate([cross(a[..., :3], b[..., :3]), mixed], axis=-1)


def point_velocity(screw: np.ndarray, point: np.ndarray) -> np.ndarray:
    """v(x) = q̂ + q × x, m/s, of points (..., 3) (1.16)."""
    return screw[..., 3:] + cross(screw[..., :3], point)


@dataclass(frozen=True, eq=False)
class ScrewMotion(Record):
    """A screw by its axis.

    Attributes:
        angular: angular speed ω >= 0, rad/s; 0 for a translation.
        linear: velocity ω̂ along the axis, m/s (for a translation its speed).
        pitch: ω̂ / ω, m/rad; infinite for a translation.
        direction: (3,) unit vector of the axis (of the translation).
        axis: (6,) spear of the axis; None for a translation, which has none.
    """

    angular: float
    linear: float
    pitch: float
    direction: np.ndarray
    axis: np.ndarray | None

    @property
    def is_translation(self) -> bool:
        """True if nothing turns."""
        return self.axis is None


def screw_decompose(screw: object, *, tolerance: float = TRANSLATION_TOLERANCE) -> ScrewMotion:
    """Axis, pitch and speeds of a screw (1.3).

    Args:
        screw: (6,), rad/s and m/s.
        tolerance: rad/m; less angular velocity per linear velocity counts as none.

    Raises:
        InputError: no such array, or the zero screw.
    """
    q = finite_array("screw", screw, (6,))
    angular_part, linear_part = q[:3], q[3:]
    omega, speed = float(np.linalg.norm(angular_part)), float(np.linalg.norm(linear_part))
    if omega <= tolerance * speed:
        if speed == 0.0:
            raise InputError("screw: the zero screw has neither axis nor direction")
        return ScrewMotion(0.0, speed, np.inf, linear_part / speed, None)
    direction = angular_part / omega
    linear = float(direction @ linear_part)
    moment = (linear_part - linear * direction) / omega
    return ScrewMotion(omega, linear, linear / omega, direction, np.concatenate([direction, moment]))


PENCIL_TYPES = {
    "degenerate": "a plane field and a bundle with its carrier point in that plane",
    "hyperbolic": "all lines that meet two skew real axes",
    "elliptic": "all real lines that meet two conjugate imaginary axes",
    "parabolic": "null lines of a regular complex that meet the singular axis",
}
"""Types of pencils of linear complexes, and the lines that all complexes of the pencil have in common."""

BUNDLE_TYPES = {
    "degenerate": "a bundle or a plane field of lines",
    "double pencil": "one pencil of lines, counted twice",
    "two pencils": "two pencils of lines with one common line",
    "single line": "one real line",
    "regulus": "one family of rulings of a ruled quadric",
    "imaginary": "no real line",
}
"""Types of bundles of linear complexes, and the lines that all complexes of the bundle have in common."""


def pencil_type(a: object, b: object, *, tolerance: float = COMPLEX_TOLERANCE) -> str:
    """Type of the pencil λ a + μ b of linear complexes: a key of `PENCIL_TYPES` (1.4).

    Args:
        a, b: (6,), linearly independent.
        tolerance: eigenvalues of the Klein form on the pencil below this count as zero; the largest possible
            is one, lengths being measured in units of the largest linear part.

    Raises:
        InputError: no such arrays, or linearly dependent.
    """
    values = _klein_spectrum([finite_array("a", a, (6,)), finite_array("b", b, (6,))])
    positive, negative = int((values > tolerance).sum()), int((values < -tolerance).sum())
    if positive + negative == 0:
        return "degenerate"
    if positive + negative == 1:
        return "parabolic"
    return "hyperbolic" if positive == negative else "elliptic"


def bundle_type(a: object, b: object, c: object, *, tolerance: float = COMPLEX_TOLERANCE) -> str:
    """Type of the bundle λ a + μ b + ν c of linear complexes: a key of `BUNDLE_TYPES` (1.4).

    The common lines are the singular members of the polar bundle, whose signature complements that of the
    bundle itself to (3, 3). Arguments and errors as for :func:`pencil_type`.
    """
    values = _klein_spectrum(
        [finite_array("a", a, (6,)), finite_array("b", b, (6,)), finite_array("c", c, (6,))]
    )
    positive, negative = int((values > tolerance).sum()), int((values < -tolerance).sum())
    if positive + negative < 2:
        return "double pencil" if positive + negative else "degenerate"
    if positive + negative == 2:
        return "two pencils" if positive == negative else "single line"
    return "regulus" if positive and negative else "imaginary"


def _klein_spectrum(complexes: list[np.ndarray]) -> np.ndarray:
    """Eigenvalues of the Klein form on the span, in an orthonormal basis and a fitting unit of length."""
    span = np.array(complexes)
    moment, direction = np.abs(span[:, 3:]).max(), np.abs(span[:, :3]).max()
    if moment > 0 and direction > 0:
        span[:, 3:] *= direction / moment
    norms = np.linalg.norm(span, axis=1, keepdims=True)
    if not norms.all():
        raise InputError("linear complexes: the zero vector is none")
    basis, triangle = np.linalg.qr((span / norms).T)
    if np.abs(np.diag(triangle)).min() <= 1e-12:
        raise InputError("linear complexes: must be linearly independent")
    return np.linalg.eigvalsh(basis.T @ basis[_SWAP])
