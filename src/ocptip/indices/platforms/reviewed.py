"""Indices of a platform pose that need no search, and those of the literature: what they measure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, finite_array, positive_number, rotation_matrix
from ocptip.basics.write import Record
from ocptip.indices.meanings import PLATFORM, IndexEntry
from ocptip.indices.metric import OperationEllipsoid, velocity_map
from ocptip.indices.platforms.controllability import control_number, platform_conditioning
from ocptip.indices.platforms.platform import MINIMUM_LEGS, PlatformPose, StewartPlatform
from ocptip.indices.reviewed import RANK_TOLERANCE
from ocptip.numerics.threads import one_thread
from ocptip.numerics.vectors import cross


@dataclass(frozen=True, eq=False)
class BestComplex(Record):
    """Best approximating linear complexes of a platform's legs.

    Attributes:
        sigma_r: smallest root sum of squared leg rates (m/s) at unit angular velocity: scales with lengths.
        complex_r: (6,) the screw (c, c_hat) that attains it, |c| = 1: the legs nearly are its path normals.
        sigma_s: the same for unit translations, dimensionless.
        direction_s: (3,) the translation that attains it.
    """

    sigma_r: float
    complex_r: np.ndarray
    sigma_s: float
    direction_s: np.ndarray


@dataclass(frozen=True, eq=False)
class RigidityRate(Record):
    """Rigidity rate of a six-legged platform.

    Attributes:
        angle: phi, 0 (singular) to pi/2, rad.
        motion: (7,) infinitesimal self-motion (q, q_hat, s): angular velocity, velocity of the point at the
            origin, rate of scaling; velocity of x is q_hat + q x x + s x. Unit length in the scaled frame of
            the pose. None where it is not unique.
        residual: largest leg rate the motion causes, in the scaled frame.
    """

    angle: float
    motion: np.ndarray | None
    residual: float


def manipulability(pose: PlatformPose) -> float:
    """|det J|, m^3; for more than six legs sqrt(det J'J).

    Scales with the third power of lengths and may be largest next to a singularity: not comparable between
    platforms.
    """
    return 0.0 if pose.singular else float(np.prod(pose.singular_values) * pose.scale[1] ** 3)


def inverse_condition_number(pose: PlatformPose) -> float:
    """1/CDN of J'J with respect to the identity, 0 to 1 (5.1, 5.2).

    Adds angles to lengths: depends on the unit (here metres) and on the origin of the base frame.
    """
    return _ratio(pose, np.linalg.svd(pose.jacobian, compute_uv=False))


def inverse_condition_number_cl(pose: PlatformPose, operation_point: object, length: object) -> float:
    """1/CDN_CL: origin in the operation point, velocities divided by a characteristic length (3.4).

    The same as 1/CDN_OE for a sphere of radius length * sqrt(3/2) about the operation point.

    Args:
        pose: the platform.
        operation_point: (3,) in the base frame, m.
        length: characteristic length, m.

    Raises:
        InputError: an argument outside of its range.
    """
    point = finite_array("operation_point", operation_point, (3,))
    length = positive_number("length", length)
    forms = pose.jacobian.copy()
    forms[:, :3] -= cross(point, forms[:, 3:])
    forms[:, 3:] *= length
    return _ratio(pose, np.linalg.svd(forms, compute_uv=False))


def inverse_condition_number_points(pose: PlatformPose, points: object) -> float:
    """Three-point condition number: 1/CDN with the sum of squared velocities of points of the platform.

    Args:
        pose: the platform.
        points: (k, 3) points of the platform in the base frame, m; k >= 3, not on one line.

    Raises:
        InputError: fewer points, or all of them on one line.
    """
    points = finite_array("points", points, (None, 3))
    if not spans_a_plane(points):
        raise InputError(
            f"points: expected at least three points that are not on one line, got {len(points)}"
        )
    R = np.asarray(np.linalg.qr(velocity_map(points), mode="r"))
    return _ratio(pose, np.linalg.svd(np.linalg.solve(R.T, pose.jacobian.T), compute_uv=False))


def spans_a_plane(points: np.ndarray) -> bool:
    """True if points (k, 3) are at least three and not on one line."""
    if len(points) < 3:
        return False
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(values[1] > 1e-9 * values[0])


def best_complex(pose: PlatformPose) -> BestComplex:
    """Best approximating linear complexes (6.2): two numbers, because translations need a separate one.

    sigma_R^2 is the smallest eigenvalue of A - F G^-1 F', with the blocks A, F, G of J'J; computed here from
    the singular values of the moments' part orthogonal to the directions.
    """
    scaled, (centre, extent) = pose.scaled.jacobian, pose.scale
    moments, directions = scaled[:, :3], scaled[:, 3:]
    left, values, rows = np.linalg.svd(directions, full_matrices=False)
    used = values > RANK_TOLERANCE * values[0]
    left = left[:, used]
    rest = moments - left @ (left.T @ moments)
    _, distances, axes = np.linalg.svd(rest, full_matrices=False)
    c = axes[-1]
    linear = -(rows[used].T / values[used]) @ (left.T @ (moments @ c))
    screw = np.concatenate([c, extent * linear + cross(centre, c)])
    zero = RANK_TOLERANCE * pose.singular_values[0]
    sigma_r = 0.0 if distances[-1] <= zero else float(distances[-1] * extent)
    return BestComplex(sigma_r, screw, 0.0 if values[-1] <= zero else float(values[-1]), rows[-1])


def rigidity_rate(pose: PlatformPose) -> RigidityRate:
    """Rigidity rate: angle of the self-motion with scalings to the displacements ([Naw07] 6.1.3).

    With the legs' lengths fixed a platform that may also be scaled has one infinitesimal self-motion
    (q, q_hat, s); phi = atan2(|s|, |q|), the bilinear form q.q + s^2.

    Raises:
        InputError: the platform has more than six legs: then there is no such motion in general.
    """
    if pose.n_legs != MINIMUM_LEGS:
        raise InputError(f"pose: the rigidity rate is defined for six legs, got {pose.n_legs}")
    scaled = pose.scaled
    units = scaled.spears[:, :3]
    rows = np.column_stack([scaled.jacobian, np.einsum("ij,ij->i", units, scaled.platform)])
    _, values, directions = np.linalg.svd(rows)
    motion = directions[-1]
    residual = float(np.abs(rows @ motion).max())
    unique = values[-1] > RANK_TOLERANCE * values[0]
    centre, extent = pose.scale
    q, linear, s = motion[:3], motion[3:6], motion[6]
    moved = np.concatenate([q, extent * linear - cross(q, centre) - s * centre, [s]])
    if pose.singular:
        return RigidityRate(0.0, moved if unique else None, residual)
    return RigidityRate(float(np.arctan2(abs(s), np.linalg.norm(q))), moved, residual)


def _ratio(pose: PlatformPose, values: np.ndarray) -> float:
    return 0.0 if pose.singular else float(values[-1] / values[0])


@one_thread
def rate_platform(
    platform: StewartPlatform,
    position: ArrayLike = (0.0, 0.0, 0.0),
    rotation: ArrayLike | None = None,
    ellipsoid: OperationEllipsoid | None = None,
) -> list[IndexEntry]:
    """All indices of a platform pose, the trustworthy ones first.

    Args:
        platform: anchors; n >= 6 legs.
        position: (3,) origin of the platform frame in the base frame, m.
        rotation: (3, 3) platform frame to base frame; default: none.
        ellipsoid: operation ellipsoid in the platform frame; without it the indices of a tool are NaN.

    Returns:
        Entries ctn, inv_cdn_oe, inv_cdn_cl, inv_cdn_points, inv_cdn, manipulability, sigma_r, sigma_s,
        rigidity_rate.

    Raises:
        InputError: no rotation matrix, or a leg of length zero.
    """
    position = finite_array("position", position, (3,))
    rotation = np.eye(3) if rotation is None else rotation_matrix("rotation", rotation)
    rated = PlacedPlatform(platform, position, rotation, ellipsoid)
    values, pose, spread = rated.values(PLATFORM), rated.pose, rated.spread
    special = {}
    if ellipsoid is None:
        special |= dict.fromkeys(("inv_cdn_oe", "inv_cdn_cl"), "not rated: needs an operation ellipsoid")
    if not spread:
        special["inv_cdn_points"] = "not rated: platform anchors on one line"
    if platform.n_legs != MINIMUM_LEGS:
        special["rigidity_rate"] = "not rated: defined for six legs"
    usual = "singular pose" if pose.singular else "ok"
    upper = {"sigma_s": math.sqrt(platform.n_legs / 3.0)}
    return [
        PLATFORM[name].entry(name, value, special.get(name, usual), upper.get(name))
        for name, value in values.items()
    ]


@dataclass(frozen=True, eq=False)
class PlacedPlatform:
    """A platform in a pose with its tool; indices are computed when they are asked for.

    Attributes:
        platform: the anchors.
        position: (3,) origin of the platform frame in the base frame, m.
        rotation: (3, 3) platform frame to base frame.
        ellipsoid: operation ellipsoid in the platform frame, or None.
    """

    platform: StewartPlatform
    position: np.ndarray
    rotation: np.ndarray
    ellipsoid: OperationEllipsoid | None = None

    @cached_property
    def pose(self) -> PlatformPose:
        """All anchors in the base frame; InputError: no rotation matrix, or a leg of length zero."""
        return self.platform.at(self.position, self.rotation)

    def moved(
        self, pose: np.ndarray | None = None, ellipsoid: OperationEllipsoid | None = None
    ) -> PlacedPlatform:
        """With another pose (6,), position and rotation vector, m and rad, or tool; what is None stays."""
        ellipsoid = self.ellipsoid if ellipsoid is None else ellipsoid
        if pose is None:
            return replace(self, ellipsoid=ellipsoid)
        turn = Rotation.from_rotvec(pose[3:]).as_matrix()
        return PlacedPlatform(self.platform, pose[:3], turn, ellipsoid)

    def values(self, names: Iterable[str]) -> dict[str, float]:
        """Indices by names of `PLATFORM`; NaN where one is not rated, see :func:`rate_platform`."""
        return {name: float(_VALUES[name](self)) for name in names}

    @cached_property
    def spread(self) -> bool:
        """Whether the platform anchors span a plane at least."""
        return spans_a_plane(self.pose.platform)

    @cached_property
    def _complexes(self) -> BestComplex:
        return best_complex(self.pose)

    def _inv_cdn_oe(self) -> float:
        if self.ellipsoid is None:
            return math.nan
        return platform_conditioning(self.pose, self.ellipsoid.W(self.rotation, self.position)).value

    def _inv_cdn_cl(self) -> float:
        if self.ellipsoid is None:
            return math.nan
        point = self.rotation @ self.ellipsoid.center + self.position
        return inverse_condition_number_cl(self.pose, point, self.ellipsoid.characteristic_length)

    def _inv_cdn_points(self) -> float:
        return inverse_condition_number_points(self.pose, self.pose.platform) if self.spread else math.nan

    def _rigidity_rate(self) -> float:
        return rigidity_rate(self.pose).angle if self.pose.n_legs == MINIMUM_LEGS else math.nan


_VALUES: dict[str, Callable[[PlacedPlatform], float]] = {
    "ctn": lambda rated: control_number(rated.pose).value,
    "inv_cdn_oe": PlacedPlatform._inv_cdn_oe,
    "inv_cdn_cl": PlacedPlatform._inv_cdn_cl,
    "inv_cdn_points": PlacedPlatform._inv_cdn_points,
    "inv_cdn": lambda rated: inverse_condition_number(rated.pose),
    "manipulability": lambda rated: manipulability(rated.pose),
    "sigma_r": lambda rated: rated._complexes.sigma_r,
    "sigma_s": lambda rated: rated._complexes.sigma_s,
    "rigidity_rate": PlacedPlatform._rigidity_rate,
}
"""The functions that compute the indices, by name."""
