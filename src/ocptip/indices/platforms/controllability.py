"""Control number CTN of Stewart-Gough platforms and of planar RPR platforms.

Near a singularity small changes of leg lengths move the platform uncontrollably. What can be measured of that
are the angular velocities of the unactuated joints: with the sum of squared leg rates fixed to one, the sum
of squared rates of the unactuated joints lies between lambda_- and lambda_+ (rad^2/m^2): CTN = sqrt(lambda_-
/ lambda_+). CTN is 0 exactly in singular poses and 1 where every motion moves the unactuated joints equally
much. It depends on the anchors themselves, not only on the lines of the legs. Source: [Naw07] 6.3, (6.4) to
(6.7), and 7.2 for the planar case.

Numerically: with J the leg rates and A = Q R the rates of the unactuated joints per screw, the singular
values of J R^-1 are 1/sqrt(lambda). That loses no digits near a singularity, as the eigenvalues of J'J would.

1/CDN_OE of Stewart-Gough platforms: condition number with respect to an operation ellipsoid.

The sum of squared velocities of the ellipsoid's six vertices, q' W q, is compared with the sum of squared leg
rates, q' N q. 1/CDN_OE = sqrt(lambda_min / lambda_max) with the eigenvalues of (W, N); 0 exactly in singular
poses, 1 (isotropic) where every motion of the ellipsoid costs the same leg rates. Source: [Naw07] 5.2, (5.7).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.write import Record
from ocptip.indices.platforms.platform import PlanarPlatformPose, PlatformPose, rank_defect


@dataclass(frozen=True, eq=False)
class OperationConditioning(Record):
    """1/CDN_OE of a platform pose with its evidence.

    Attributes:
        value: 1/CDN_OE, 0 (singular) to 1 (isotropic).
        lambdas: (6,) eigenvalues of (W, N), smallest first; infinite where the legs hold still. Their range
            contains 18 / n.
        screws: (6, 6) column k belongs to lambdas[k], base frame, q' W q = 1.
        residual: largest |W- or N-orthogonality defect| of the screws.
    """

    value: float
    lambdas: np.ndarray
    screws: np.ndarray
    residual: float

    _plain = ("value", "lambdas", "fastest", "residual")

    @property
    def fastest(self) -> np.ndarray:
        """Screw of the largest lambda: most motion of the ellipsoid per leg motion."""
        return self.screws[:, -1]


def platform_conditioning(pose: PlatformPose, W: object) -> OperationConditioning:
    """1/CDN_OE of a platform pose (5.7).

    Args:
        pose: the platform, n >= 6 legs.
        W: (6, 6) metric of the operation ellipsoid in that pose, base frame, rotation first:
            `OperationEllipsoid.W(rotation, position)`.

    Raises:
        InputError: W is not symmetric positive definite.
    """
    W = finite_array("W", W, (6, 6))
    if np.abs(W - W.T).max() > 1e-9 * np.abs(W).max():
        raise InputError("W: must be symmetric")
    L, failed = scipy.linalg.lapack.dpotrf(W, lower=1)
    if failed or np.diagonal(L).min() <= 1e-12 * np.diagonal(L).max():
        raise InputError("W: must be positive definite (an operation ellipsoid needs a volume)")
    forms = scipy.linalg.lapack.dtrtrs(L, pose.jacobian.T, lower=1)[0].T
    _, values, rows = np.linalg.svd(forms, full_matrices=False)
    screws = scipy.linalg.lapack.dtrtrs(L, rows.T, lower=1, trans=1)[0]
    J = pose.jacobian @ screws
    residual = max(
        float(np.abs(screws.T @ W @ screws - np.eye(6)).max()),
        float(np.abs(J.T @ J - np.diag(values**2)).max() / values[0] ** 2),
    )
    finite = 6 - rank_defect(pose.singular_values)
    lambdas = np.full(6, np.inf)
    lambdas[:finite] = 1.0 / values[:finite] ** 2
    value = float(values[-1] / values[0]) if finite == 6 else 0.0
    return OperationConditioning(value, lambdas, screws, residual)


@dataclass(frozen=True, eq=False)
class ControlNumber(Record):
    """Control number of a pose with its evidence.

    Attributes:
        value: CTN, 0 (singular) to 1.
        lambdas: (6,), in the plane (3,): stationary values of the sum of squared rates of the unactuated
            joints per sum of squared leg rates, rad^2/m^2, smallest first; infinite where the legs hold
            still.
        screws: (6, 6) column k is the screw of lambdas[k] in the base frame (angular velocity rad/s, then
            velocity of the point at the origin m/s), scaled to a unit sum of squared rates of the unactuated
            joints. In the plane (3, 3): rotation, then velocity. None where `indeterminate`.
        residual: largest |A'A-orthogonality or J'J-orthogonality defect| of the screws.
        indeterminate: True if a motion exists that no joint of any leg feels (all legs on one line or all
            parallel): the pose is singular and the eigenvalue problem is not defined.
    """

    value: float
    lambdas: np.ndarray
    screws: np.ndarray | None
    residual: float
    indeterminate: bool

    _plain = ("value", "lambdas", "least_controllable", "residual", "indeterminate")

    @property
    def singular(self) -> bool:
        """True if CTN is zero."""
        return self.value == 0.0

    @property
    def least_controllable(self) -> np.ndarray | None:
        """Screw e_+ of lambda_+: the motion with the most passive rotation per leg motion."""
        return None if self.screws is None else self.screws[:, -1]


def control_number(pose: PlatformPose | PlanarPlatformPose) -> ControlNumber:
    """Control number of a platform in a pose (6.7), n >= 6 legs, or n >= 3 legs in the plane.

    Raises:
        InputError: no such pose.
    """
    if not isinstance(pose, PlatformPose | PlanarPlatformPose):
        raise InputError(f"pose: expected a PlatformPose or PlanarPlatformPose, got {type(pose).__name__}")
    scaled, extent = pose.scaled, pose.scale[1]
    J, A = scaled.jacobian, scaled.passive_map
    size = J.shape[1]
    R = np.linalg.qr(A, mode="r")
    pivots = np.abs(np.diagonal(R))
    if pivots.min() <= _BLIND * pivots.max():
        return ControlNumber(0.0, np.full(size, np.inf), None, 0.0, True)
    forms = scipy.linalg.lapack.dtrtrs(R, J.T, trans=1)[0].T
    _, values, rows = np.linalg.svd(forms, full_matrices=False)
    screws = scipy.linalg.lapack.dtrtrs(R, rows.T)[0]
    feels, drives = A @ screws, J @ screws
    residual = max(
        float(np.abs(feels.T @ feels - np.eye(size)).max()),
        float(np.abs(drives.T @ drives - np.diag(values**2)).max() / max(values[0] ** 2, _TINY)),
    )
    suspicious = values[-1] < _SUSPICIOUS * values[0]
    finite = size - (rank_defect(pose.singular_values) if suspicious else 0)
    lambdas = np.full(size, np.inf)
    lambdas[:finite] = 1.0 / (values[:finite] * extent) ** 2
    value = float(values[-1] / values[0]) if finite == size else 0.0
    return ControlNumber(value, lambdas, pose.screw_from_scaled(screws), residual, False)


_SUSPICIOUS = 1e-6
"""Above this share the Jacobian cannot be rank deficient."""

_BLIND = 1e-12
"""Pivots of the rates of the unactuated joints below this share of the largest are zero."""

_TINY = np.finfo(float).tiny
