"""DM_inf and DM_2: how far the joints have to turn to a singularity, and where a motion heads.

det J is linearised in the joint angles. Turning axis 1 or 6 cannot change it, so the angles are those of
joints 2 to 5, in radians. DM_inf is the smallest angle by which all four would have to turn, DM_2 the
shortest path if the sum of squared angles counts. Source: [Naw07] 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.write import Record
from ocptip.indices.arms.operation import checked_inertias
from ocptip.indices.lines import dual_cross
from ocptip.indices.reviewed import RANK_TOLERANCE, checked_jacobian

GRADIENT_TOLERANCE = 1e-12
"""Derivatives of the determinant below this are zero; lengths measured by the largest moment of an axis."""

INNER = slice(1, 5)
"""Joints 2 to 5, which can change the distance."""

_BEHIND = np.triu(np.ones((6, 6)), 1)[:, :, None]


@dataclass(frozen=True, eq=False)
class SingularityDistance(Record):
    """Linearised distance to the nearest singularity of N poses (no leading N for a single pose).

    Attributes:
        determinant: (N,) det J, m^3.
        gradient: (N, 4) g: its derivatives by the angles of joints 2 to 5, m^3/rad; exact zeros where it does
            not depend on a joint.
        dm_inf: (N,) rad (4.5); 0 singular, infinite where the determinant is stationary.
        dm_2: (N,) rad (4.7), likewise.
        singular: (N,) True if det J = 0.
        stationary: (N,) True if the gradient vanishes: with `singular` a singularity of higher order,
            otherwise a stationary point of the manipulability.
        energy_inf: (N,) J (4.19): rotational energy needed in each joint at unit time; None without inertias.
        energy_2: (N,) J (4.15): smallest total rotational energy; None without inertias.
        inertias: (N, 4), kg m^2, of joints 2 to 5, or None.
    """

    determinant: np.ndarray
    gradient: np.ndarray
    dm_inf: np.ndarray
    dm_2: np.ndarray
    singular: np.ndarray
    stationary: np.ndarray
    energy_inf: np.ndarray | None = None
    energy_2: np.ndarray | None = None
    inertias: np.ndarray | None = None

    _plain = (
        "determinant",
        "gradient",
        "dm_inf",
        "dm_2",
        "step_inf",
        "step_2",
        "energy_inf",
        "energy_2",
        "status",
    )

    @property
    def step_inf(self) -> np.ndarray:
        """(N, 4) rad: the step of joints 2 to 5 by +-DM_inf to the linearised singularity; zero for joints
        that do not matter, zero where DM_inf is 0 or infinite (4.5)."""
        return -self._signs() * self._finite(self.dm_inf)[..., None]

    @property
    def step_2(self) -> np.ndarray:
        """(N, 4) rad: shortest step to the linearised singularity (4.6); zero where DM_2 is 0 or infinite."""
        norm = np.linalg.norm(self.gradient, axis=-1, keepdims=True)
        direction = self.gradient / np.where(norm > 0, norm, 1.0)
        return -np.sign(self.determinant)[..., None] * direction * self._finite(self.dm_2)[..., None]

    @cached_property
    def status(self) -> np.ndarray | str:
        """(N,) "regular", "singular", "singular of higher order" or "stationary"."""
        ordinary = np.where(self.singular, "singular", "regular")
        flat = np.where(self.singular, "singular of higher order", "stationary")
        words = np.where(self.stationary, flat, ordinary)
        return str(words) if words.ndim == 0 else words

    def motion_angle(self, rates: object) -> np.ndarray:
        """Sigma: where a motion heads, rad in [-pi/2, pi/2] (4.8).

        -pi/2: straight to the linearised singularity; 0: parallel to it; pi/2: straight away from it.

        Args:
            rates: (..., 6) joint rates, rad/s or any multiple; those of joints 1 and 6 do not matter.

        Returns:
            (...); NaN where it is not defined: in singular and stationary poses (there see
            :func:`stationary_motion_angle`) and where joints 2 to 5 rest.

        Raises:
            InputError: wrong shape or not finite.
        """
        inner = finite_array("rates", rates, (..., 6))[..., INNER]
        product = np.linalg.norm(inner, axis=-1) * np.linalg.norm(self.gradient, axis=-1)
        defined = (product > 0) & ~self.singular & ~self.stationary
        cosine = np.sum(inner * self.gradient, axis=-1) / np.where(defined, product, 1.0)
        angle = np.arcsin(np.clip(np.sign(self.determinant) * cosine, -1.0, 1.0))
        return np.where(defined, angle, np.nan)[()]

    def _signs(self) -> np.ndarray:
        return np.sign(self.determinant)[..., None] * np.sign(self.gradient)

    def _finite(self, values: np.ndarray | None) -> np.ndarray:
        assert values is not None
        return np.where(np.isfinite(values), values, 0.0)


def singularity_distance(jacobian: np.ndarray, *, inertias: object = None) -> SingularityDistance:
    """DM_inf and DM_2 of six-axis arms, and their energy-weighted versions.

    Args:
        jacobian: (..., 6, 6), columns are the spears of the axes from base to end-effector; moments in m.
        inertias: (..., 6), kg m^2, as for `operation_indices`, those of joints 2 to 5 > 0; None: no weighted
            versions.

    Raises:
        InputError: wrong shape, not finite, not six axes, or an inertia that is not positive.
    """
    matrix = checked_jacobian(jacobian)
    if matrix.shape[-1] != 6:
        raise InputError(f"jacobian: DM is defined for six axes, got {matrix.shape[-1]}")
    scaled, length = _scaled(matrix)
    adjugate, values, det = _adjugate(scaled)
    singular = values[..., -1] <= RANK_TOLERANCE * values[..., 0]
    gradient = (_turned(scaled, INNER) * adjugate[..., None, :, :]).sum(axis=(-1, -2))
    gradient = np.where(np.abs(gradient) <= GRADIENT_TOLERANCE, 0.0, gradient)
    det = np.where(singular, 0.0, det)
    stationary = np.logical_not(gradient.any(axis=-1))

    def distance(size: np.ndarray) -> np.ndarray:
        ratio = np.abs(det) / np.where(stationary, 1.0, size)
        return np.where(singular, 0.0, np.where(stationary, np.inf, ratio))[()]

    volume = length**3
    energies: dict[str, np.ndarray] = {}
    if inertias is not None:
        inner = np.broadcast_to(checked_inertias(inertias, 6, INNER), (*det.shape, 4))
        each = np.sum(np.sqrt(2.0 / inner) * np.abs(gradient), axis=-1)
        total = np.sqrt(2.0 * np.sum(gradient**2 / inner, axis=-1))
        energies = {"energy_inf": distance(each) ** 2, "energy_2": distance(total) ** 2, "inertias": inner}
    return SingularityDistance(
        determinant=(volume * det)[()],
        gradient=volume[..., None] * gradient,
        dm_inf=distance(np.abs(gradient).sum(axis=-1)),
        dm_2=distance(np.linalg.norm(gradient, axis=-1)),
        singular=singular,
        stationary=stationary,
        **energies,
    )


@dataclass(frozen=True, eq=False)
class Curvatures:
    """Principal curvatures of |det J| over the angles of joints 2 to 5 in a stationary point.

    Attributes:
        values: (k,) m^3/rad^2, ascending; k = 3 for a spherical wrist (joint 4 does not matter), else 4.
        directions: (k, 4) unit steps of joints 2 to 5 that belong to them.
    """

    values: np.ndarray
    directions: np.ndarray

    @property
    def worst(self) -> np.ndarray:
        """(4,) direction of the most negative curvature, in which a singularity is nearest to second order.

        [Naw07] takes the curvature of smallest magnitude; that contradicts the example given there.
        """
        return self.directions[0]


def stationary_curvatures(jacobian: np.ndarray) -> Curvatures:
    """Curvatures of the manipulability where its gradient vanishes, from exact second derivatives (5.5 b).

    Args:
        jacobian: (6, 6), as for :func:`singularity_distance`; not singular.

    Raises:
        InputError: wrong shape, not finite, or singular.
    """
    matrix = finite_array("jacobian", checked_jacobian(jacobian), (6, 6))
    scaled, length = _scaled(matrix)
    if np.linalg.cond(scaled) > 1.0 / RANK_TOLERANCE:
        raise InputError("jacobian: is singular; curvatures are meant for stationary points with det J not 0")
    first = _turned(scaled, slice(None))
    logs = np.linalg.solve(scaled, np.swapaxes(first, -1, -2))
    traces = np.trace(logs, axis1=-2, axis2=-1)
    columns = scaled.T
    inverse = np.linalg.inv(scaled)
    hessian = np.empty((6, 6))
    for i in range(6):
        for j in range(i, 6):
            second = dual_cross(columns[i], first[j])
            hessian[i, j] = traces[i] * traces[j] - np.sum(logs[i] * logs[j].T) + np.sum(inverse * second)
            hessian[j, i] = hessian[i, j]
    hessian = hessian[INNER, INNER] * abs(np.linalg.det(scaled))
    moving = np.abs(hessian).max(axis=0) > GRADIENT_TOLERANCE
    values, vectors = np.linalg.eigh(hessian[np.ix_(moving, moving)])
    directions = np.zeros((len(values), 4))
    directions[:, moving] = vectors.T
    return Curvatures(float(length) ** 3 * values, directions)


def stationary_motion_angle(curvatures: Curvatures, rates: object) -> float:
    """Sigma in a stationary point: -pi/2 along the worst direction (in either sense), 0 across it (4.11).

    Args:
        rates: (6,) joint rates.

    Raises:
        InputError: wrong shape, not finite, or joints 2 to 5 rest.
    """
    inner = finite_array("rates", rates, (6,))[INNER]
    size = float(np.linalg.norm(inner))
    if size == 0.0:
        raise InputError("rates: joints 2 to 5 rest, the motion has no direction")
    return -float(np.arcsin(min(1.0, abs(curvatures.worst @ inner) / size)))


def _scaled(jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The Jacobian with lengths in units of the largest moment of an axis, and that unit in m."""
    length = np.linalg.norm(jacobian[..., 3:, :], axis=-2).max(axis=-1)
    length = np.where(length > 0, length, 1.0)
    scaled = jacobian.copy()
    scaled[..., 3:, :] /= length[..., None, None]
    return scaled, length


def _turned(jacobian: np.ndarray, joints: slice) -> np.ndarray:
    """(..., k, 6, 6): row [i, j] is the derivative of axis j by the i-th joint (zero up to itself)."""
    columns = np.swapaxes(jacobian, -1, -2)
    products = dual_cross(columns[..., joints, None, :], columns[..., None, :, :])
    return products * _BEHIND[joints]


def _adjugate(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """adj(A) = det(A) inv(A), accurate for singular matrices too; singular values of A; det(A)."""
    left, values, right = np.linalg.svd(matrix)
    orientation = np.sign(np.linalg.det(left @ right))
    others = np.where(np.eye(6, dtype=bool), 1.0, values[..., None, :]).prod(axis=-1)
    weighted = np.swapaxes(right, -1, -2) * (orientation[..., None] * others)[..., None, :]
    return weighted @ np.swapaxes(left, -1, -2), values, orientation * values.prod(axis=-1)
