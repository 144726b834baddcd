"""Inertia of rigid bodies: other reference points, unions, and which matrices no body has."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array

ROUNDED = 1e-2
"""Share of the largest principal moment that counts as rounding in files, which give two digits at worst."""

RigidBody = tuple[float, np.ndarray, np.ndarray]
"""Mass, kg; centre of mass (3,), m; inertia (3, 3) about it, kg m^2; all in one frame."""


def symmetric_matrix(value: ArrayLike) -> np.ndarray:
    """(3, 3) of itself, of (6,) numbers xx, xy, xz, yy, yz, zz, or of three principal values.

    Raises:
        InputError: another shape, not finite or not symmetric.
    """
    matrix = finite_array("inertia", value, (...,))
    if matrix.shape == (6,):
        xx, xy, xz, yy, yz, zz = matrix
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if matrix.shape == (3,):
        return np.diag(matrix)
    if matrix.shape != (3, 3):
        given = " x ".join(map(str, matrix.shape)) or "a single number"
        raise InputError(
            f"inertia: expected shape 3 x 3, six numbers xx, xy, xz, yy, yz, zz or three principal values, "
            f"got {given}"
        )
    if np.abs(matrix - matrix.T).max() > 1e-9 * max(1e-300, np.abs(matrix).max()):
        raise InputError(f"inertia: must be symmetric, got {matrix.tolist()}")
    return matrix


def parallel_axis(mass: float, lever: np.ndarray) -> np.ndarray:
    """(3, 3), kg m^2: what a mass adds to the inertia about a point that is `lever` (3,), m, away from it."""
    return mass * (lever @ lever * np.eye(3) - np.outer(lever, lever))


def pseudo_inertia(mass: float, first_moment: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """(4, 4) of a body by ten numbers in which everything is linear: [[sum m r r', sum m r], [., m]].

    Positive definite for bodies that exist. First moment (3,) and inertia (3, 3) are those about the origin.
    """
    values = np.empty((4, 4))
    values[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    values[:3, 3] = values[3, :3] = first_moment
    values[3, 3] = mass
    return values


def union(first: RigidBody, second: RigidBody) -> RigidBody:
    """The two bodies, of which one has mass, as one."""
    mass = first[0] + second[0]
    centre = (first[0] * first[1] + second[0] * second[1]) / mass
    inertia_first, other = (inertia + parallel_axis(m, c - centre) for m, c, inertia in (first, second))
    return mass, centre, inertia_first + other


def why_impossible(inertia: np.ndarray, rounding: float) -> str:
    """Why no body has this inertia (3, 3) about its centre of mass, kg m^2; empty if one has.

    Args:
        inertia: symmetric.
        rounding: excess, kg m^2, that counts as rounding.
    """
    principal = np.linalg.eigvalsh(inertia)
    if principal[0] >= -rounding and principal[2] <= principal[0] + principal[1] + rounding:
        return ""
    shown = ", ".join(f"{value:.4g}" for value in principal)
    return (
        f"no body has these principal values about its centre of mass ({shown} kg m^2): none may be negative "
        "and the largest must not exceed the sum of the other two"
    )
