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

Near a singularity the legs nearly are path normals of the screw of minimum control e_+, i.e. lines of its
linear complex. If more eigenvalues lambda are about as large as lambda_+, the legs are close to the lines
that all complexes of the spanned pencil or bundle have in common. Source: [Naw07] 6.3.3, (6.10).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # subpackages load on first use
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, number_from
from ocptip.basics.write import Record
from ocptip.indices.lines import (
    BUNDLE_TYPES,
    COMPLEX_TOLERANCE,
    PENCIL_TYPES,
    ScrewMotion,
    bundle_type,
    pencil_type,
    screw_decompose,
)
from ocptip.indices.platforms.platform import (
    PlanarPlatformPose,
    PlatformPose,
    StewartPlatform,
    legs_exist,
    rank_defect,
)
from ocptip.indices.reviewed import RANK_TOLERANCE


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


def control_numbers(platform: StewartPlatform, positions: ArrayLike, rotations: ArrayLike) -> np.ndarray:
    """Control numbers of many poses at once.

    Args:
        platform: anchors.
        positions: (k, 3) or (3,), m, base frame.
        rotations: (k, 3, 3) or (3, 3) rotation matrices, platform frame to base frame.

    Returns:
        (k,) as `control_number` gives them one by one; NaN where a leg has length zero.

    Raises:
        InputError: shapes that do not fit.
    """
    base, moved = platform.anchors(positions, rotations)
    exists = legs_exist(base, moved)
    poses = PlatformPose.of_many(base[exists], moved[exists]).scaled
    R = np.linalg.qr(poses.passive_map, mode="r")
    pivots = np.abs(np.diagonal(R, axis1=1, axis2=2))
    values = np.linalg.svd(poses.jacobian, compute_uv=False)
    regular = values[:, -1] > RANK_TOLERANCE * values[:, 0]
    regular &= pivots.min(axis=1) > _BLIND * pivots.max(axis=1)
    forms = np.linalg.solve(R[regular].transpose(0, 2, 1), poses.jacobian[regular].transpose(0, 2, 1))
    values = np.linalg.svd(forms, compute_uv=False)
    ratios = np.where(exists, 0.0, np.nan)
    ratios[np.flatnonzero(exists)[regular]] = values[:, -1] / values[:, 0]
    return ratios


NEAR = 0.1
"""Poses with a larger control number are not near a singularity: their legs are close to no line system."""

_FAR = "none: the pose is far from a singularity"
_TRANSLATION = 1e-9
"""Angular velocity, times the platform's extent, below this share of the linear velocity is none."""

_DIMENSIONS = {1: "complex", 2: "pencil", 3: "bundle"}


@dataclass(frozen=True, eq=False)
class SingularMotion:
    """The motion of minimum control of a platform pose.

    Attributes:
        control: the control number of the pose.
        screw: (6,) the screw of minimum control e_+, base frame; an exact self-motion in a singular pose.
        motion: its axis and pitch.
        screws: (6, k) all screws whose lambda is close to lambda_+, e_+ first.
        kind: "complex" (k = 1), "pencil" (2), "bundle" (3) or "more"; "none" far from a singularity.
        type: type of the pencil or bundle, see `PENCIL_TYPES` and `BUNDLE_TYPES`; for one complex "singular"
            (a rotation or a translation: the legs nearly meet its axis) or "regular"; "none" far from a
            singularity.
        lines: the lines the legs are close to, in words.
    """

    control: ControlNumber
    screw: np.ndarray
    motion: ScrewMotion
    screws: np.ndarray
    kind: str
    type: str
    lines: str

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "control_number": self.control.to_dict(),
            "screw": self.screw.tolist(),
            "motion": self.motion.to_dict(),
            "kind": self.kind,
            "type": self.type,
            "lines": self.lines,
        }


def singular_motion(
    pose: PlatformPose, *, closeness: float = 0.25, tolerance: float | None = None, near: float = NEAR
) -> SingularMotion:
    """Screw of minimum control of a pose and the type of the line system its legs are close to (7.5).

    Args:
        pose: the platform.
        closeness: eigenvalues lambda >= closeness * lambda_+ count as close to lambda_+; in a singular pose
            the infinite ones do.
        tolerance: of the classification, see :func:`ocptip.indices.lines.pencil_type`; default about the
            control number, for the type that holds in the limit.
        near: largest control number at which line systems are named.

    Raises:
        InputError: no platform pose, or closeness not between 0 and 1.
    """
    if not isinstance(pose, PlatformPose):
        raise InputError(f"pose: expected a PlatformPose, got {type(pose).__name__}")
    closeness = number_from("closeness", closeness)
    if not 0.0 < closeness <= 1.0:
        raise InputError(f"closeness: expected 0 < closeness <= 1, got {closeness}")
    control = control_number(pose)
    screw = control.least_controllable
    if control.value > near and screw is not None:
        motion = screw_decompose(screw, tolerance=_TRANSLATION / pose.scale[1])
        return SingularMotion(control, screw, motion, screw[:, None], "none", "none", _FAR)
    if tolerance is None:
        tolerance = max(COMPLEX_TOLERANCE, control.value)
    screws = _kernel(pose) if control.screws is None else _close(control.lambdas, control.screws, closeness)
    count = screws.shape[1]
    # The Klein form is compared in the scaled frame, where angles and lengths weigh alike.
    scaled = [_in_scaled_frame(pose, screws[:, k]) for k in range(count)]
    motion = screw_decompose(screws[:, 0], tolerance=_TRANSLATION / pose.scale[1])
    if count == 1:
        kind, lines = _complex(scaled[0], motion, tolerance)
    elif count == 2:
        kind = pencil_type(*scaled, tolerance=tolerance)
        lines = PENCIL_TYPES[kind]
    elif count == 3:
        kind = bundle_type(*scaled, tolerance=tolerance)
        lines = BUNDLE_TYPES[kind]
    else:
        kind, lines = "degenerate", "fewer lines than a ruled quadric"
    return SingularMotion(control, screws[:, 0], motion, screws, _DIMENSIONS.get(count, "more"), kind, lines)


def _close(lambdas: np.ndarray, screws: np.ndarray, closeness: float) -> np.ndarray:
    top = lambdas[-1]
    chosen = np.isinf(lambdas) if np.isinf(top) else lambdas >= closeness * top
    return screws[:, chosen][:, ::-1]


def _kernel(pose: PlatformPose) -> np.ndarray:
    _, values, rows = np.linalg.svd(pose.scaled.jacobian)
    return pose.screw_from_scaled(rows[values <= RANK_TOLERANCE * values[0]].T)[:, ::-1]


def _in_scaled_frame(pose: PlatformPose, screw: np.ndarray) -> np.ndarray:
    centre, extent = pose.scale
    return np.concatenate([screw[:3], (screw[3:] + np.cross(screw[:3], centre)) / extent])


def _complex(screw: np.ndarray, motion: ScrewMotion, tolerance: float) -> tuple[str, str]:
    norm = screw @ screw
    if motion.is_translation:
        return "singular", "lines orthogonal to one direction"
    if abs(2.0 * screw[:3] @ screw[3:]) <= tolerance * norm:
        return "singular", "lines that meet one line"
    return "regular", "path normals of one screw motion"
