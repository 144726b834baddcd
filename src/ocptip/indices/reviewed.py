"""Indices of serial arms from the literature: condition numbers and manipulability.

They are here to compare with and because they are asked for; each has a known flaw, named with it. All take
Jacobians (..., 6, n) whose columns are the spears of the axes, base frame, moments in m. Source: [Naw07]
3.1 and 4.1.
"""

from __future__ import annotations

import numpy as np

from ocptip.basics.errors import InputError, finite_array, positive_number
from ocptip.indices.metric import velocity_map
from ocptip.numerics.vectors import cross

RIGID = 6
"""Degrees of freedom of a rigid body."""

RANK_TOLERANCE = 1e-13
"""Singular values below this share of the largest are zero: a few hundred units of rounding."""


def inverse_condition(matrix: np.ndarray) -> np.ndarray:
    """Smallest over largest singular value of maps (..., m, n) of rank 6: exactly 0 if the rank is lower.

    Points of a rigid body move with more than six coordinates, redundant arms have more than six rates: the
    singular values beyond the sixth are zero in every pose and count for nothing.
    """
    values = np.linalg.svd(matrix, compute_uv=False)
    smallest, largest = values[..., RIGID - 1], values[..., 0]
    deficient = smallest <= RANK_TOLERANCE * largest
    ratio = np.where(deficient, 0.0, smallest / np.where(largest > 0, largest, 1.0))
    return ratio[()]


def checked_jacobian(jacobian: object) -> np.ndarray:
    """Return a finite Jacobian (..., 6, n), n >= 6, or raise InputError."""
    array = finite_array("jacobian", jacobian, (..., 6, None))
    if array.shape[-1] < 6:
        raise InputError(f"jacobian: expected shape (..., 6, n) with n >= 6 axes, got {array.shape}")
    return array


def inv_cdn(jacobian: np.ndarray) -> np.ndarray:
    """1/CDN: inverse condition number of the Jacobian as it stands (Salisbury and Craig).

    Flaw: mixes radians and metres, so it changes with the unit of length, and with the origin.
    """
    return inverse_condition(checked_jacobian(jacobian))


def inv_cdn_cl(jacobian: np.ndarray, point: object, length: float) -> np.ndarray:
    """1/CDN_CL: the same about an operation point, lengths divided by a characteristic length (3.4).

    Equals the index of an operation sphere of radius length * sqrt(3/2) about the point.

    Args:
        point: (..., 3), m, base frame.
        length: characteristic length, m. See `OperationEllipsoid.characteristic_length` for a way to choose
            it, and `characteristic_length` of `studies.indices.designs.arm_design` for the classical one.

    Raises:
        InputError: bad shapes, length not positive.
    """
    matrix = checked_jacobian(jacobian).copy()
    points = np.asarray(point, dtype=float)
    columns = np.swapaxes(matrix, -1, -2)
    columns[..., 3:] -= cross(points[..., None, :], columns[..., :3])
    columns[..., 3:] /= positive_number("length", length)
    return inverse_condition(matrix)


def inv_cdn_points(jacobian: np.ndarray, points: object) -> np.ndarray:
    """Inverse condition number of the map to the velocities of some points of the end-effector (Gosselin).

    Args:
        points: (..., k, 3), m, base frame; three that are not on a line, or more.

    Flaw: the choice of the points is arbitrary and changes the value.

    Raises:
        InputError: bad shapes, or all points on one line.
    """
    matrix, cloud = checked_jacobian(jacobian), finite_array("points", points, (..., None, 3))
    if cloud.shape[-2] < 3:
        raise InputError(f"points: expected shape (..., k, 3), k >= 3, got {cloud.shape}")
    centred = cloud - cloud.mean(axis=-2, keepdims=True)
    spread = np.linalg.eigvalsh(np.swapaxes(centred, -1, -2) @ centred)
    if not (spread[..., 1] > 1e-14 * spread[..., 2]).all():
        raise InputError("points: need three that are not on a line")
    return inverse_condition(velocity_map(cloud) @ matrix)


def manipulability(jacobian: np.ndarray) -> np.ndarray:
    """MPB: |det J|, or sqrt(det J J') for more than six axes (Yoshikawa); m^3 for revolute axes.

    Independent of the base frame. Flaws: scales with the cube of the unit of length, says nothing about the
    end-effector, and does not see the order of the axes.
    """
    matrix = checked_jacobian(jacobian)
    if matrix.shape[-1] == 6:
        return np.abs(np.linalg.det(matrix))[()]
    return np.prod(np.linalg.svd(matrix, compute_uv=False), axis=-1)[()]
