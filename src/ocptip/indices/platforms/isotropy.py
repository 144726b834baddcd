"""1/CDN_OE of Stewart-Gough platforms: condition number with respect to an operation ellipsoid.

The sum of squared velocities of the ellipsoid's six vertices, q' W q, is compared with the sum of squared leg
rates, q' N q. 1/CDN_OE = sqrt(lambda_min / lambda_max) with the eigenvalues of (W, N); 0 exactly in singular
poses, 1 (isotropic) where every motion of the ellipsoid costs the same leg rates. Source: [Naw07] 5.2, (5.7).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs  # pyright: ignore[reportAttributeAccessIssue] # not in its stubs

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.write import Record
from ocptip.indices.platforms.platform import PlatformPose, rank_defect


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
    L, failed = dpotrf(W, lower=1)
    if failed or np.diagonal(L).min() <= 1e-12 * np.diagonal(L).max():
        raise InputError("W: must be positive definite (an operation ellipsoid needs a volume)")
    forms = dtrtrs(L, pose.jacobian.T, lower=1)[0].T
    _, values, rows = np.linalg.svd(forms, full_matrices=False)
    screws = dtrtrs(L, rows.T, lower=1, trans=1)[0]
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
