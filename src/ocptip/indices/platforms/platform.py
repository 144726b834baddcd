"""Stewart-Gough platforms: anchor points, pose, legs as lines, the Jacobian and the rates of the unactuated
joints.

A platform has n >= 6 legs from b_i on the base to p_i on the moving platform. A platform screw q = (angular
velocity, velocity of the point at the origin of the base frame) causes the leg rates J q. The joints at both
ends of a leg turn as well, and nothing drives them: their angular velocities are the rest of the velocity of
p_i (and, seen from the platform, of b_i) across the leg, divided by its length. Source: [Naw07] 2.2 and 6.3,
(2.5) to (2.7), (6.4), (6.5).

Planar RPR platforms have n >= 3 legs. A planar screw q = (angular velocity, velocity of the point at the
origin) has three numbers; everything else is as above with the third coordinate zero. Source: [Naw07] 7.2,
(7.8) to (7.15).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, rotation_matrix
from ocptip.basics.frozen import settle
from ocptip.indices.reviewed import RANK_TOLERANCE
from ocptip.numerics.vectors import cross, skew

MINIMUM_LEGS = 6
LEG_TOLERANCE = 1e-9
"""Legs shorter than this share of the platform's extent have no direction."""


@dataclass(frozen=True, eq=False)
class StewartPlatform:
    """A Stewart-Gough platform: the anchor points of its legs on both bodies.

    Attributes:
        base: (n, 3) anchors b_i in the base frame, m; n >= 6.
        platform: (n, 3) anchors p_i in the frame of the moving platform, m.
        name: for messages and titles.

    Raises:
        InputError: too few legs, different numbers of anchors, no finite numbers.
    """

    base: np.ndarray
    platform: np.ndarray
    name: str = "platform"

    def __post_init__(self) -> None:
        settle(self, **anchor_pair(self.base, self.platform, 3, MINIMUM_LEGS))

    @property
    def n_legs(self) -> int:
        """Number of legs."""
        return len(self.base)

    def at(self, position: object = (0.0, 0.0, 0.0), rotation: object = None) -> PlatformPose:
        """The platform in a pose.

        Args:
            position: (3,) origin of the platform frame in the base frame, m.
            rotation: (3, 3) rotation matrix, platform frame to base frame; default: no rotation.

        Raises:
            InputError: no rotation matrix, or a leg of length zero.
        """
        position = finite_array("position", position, (3,))
        rotation = np.eye(3) if rotation is None else rotation_matrix("rotation", rotation)
        return PlatformPose(self.base, self.platform @ rotation.T + position)

    def anchors(self, positions: ArrayLike, rotations: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Base and platform anchors (N, n, 3) in the base frame, m, of many poses; arguments as for `at`."""
        t = np.atleast_2d(
            finite_array("positions", positions, (3,) if np.ndim(positions) == 1 else (None, 3))
        )
        shape = (3, 3) if np.ndim(rotations) == 2 else (None, 3, 3)
        R = finite_array("rotations", rotations, shape).reshape(-1, 3, 3)
        if len(R) and np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max() > 1e-9:
            raise InputError("rotations: no rotation matrices")
        if len(t) != len(R) and 1 not in (len(t), len(R)):
            raise InputError(f"rotations: expected {len(t)} as positions, got {len(R)}")
        moved = self.platform @ R.transpose(0, 2, 1) + t[:, None, :]
        return np.broadcast_to(self.base, moved.shape), moved


@dataclass(frozen=True, eq=False)
class AnchoredPose:
    """All anchor points of a platform in a pose; in space :class:`PlatformPose`, or in the plane.

    Of many poses at once (`of_many`) all arrays have a leading dimension.
    """

    base: np.ndarray
    platform: np.ndarray

    _DIMENSION: ClassVar[int]
    _FEWEST_LEGS: ClassVar[int]

    def __post_init__(self) -> None:
        settle(self, **anchor_pair(self.base, self.platform, self._DIMENSION, self._FEWEST_LEGS))
        refuse_zero_legs(self.lengths, self.scale[1])

    @classmethod
    def of_many(cls, base: np.ndarray, platform: np.ndarray) -> Self:
        """Poses with anchors (N, n, dimension), without checks."""
        poses = object.__new__(cls)
        settle(poses, base=base, platform=platform)
        return poses

    @property
    def n_legs(self) -> int:
        """Number of legs."""
        return self.base.shape[-2]

    @cached_property
    def legs(self) -> np.ndarray:
        """(n, dimension) l_i = p_i - b_i, m."""
        return self.platform - self.base

    @cached_property
    def lengths(self) -> np.ndarray:
        """(n,) leg lengths, m."""
        return np.sqrt(np.einsum("...ij,...ij->...i", self.legs, self.legs))

    @cached_property
    def jacobian(self) -> np.ndarray:
        """J: leg rates per screw."""
        raise NotImplementedError

    @cached_property
    def scale(self) -> tuple[np.ndarray, Any]:
        """Centroid of all anchors and their rms distance from it: origin and unit for the numerics."""
        return centroid_and_extent(self.base, self.platform)

    @cached_property
    def scaled(self) -> Self:
        """The same pose with the centroid as origin and the extent as unit length; not checked again."""
        centre, extent = self.scale[0][..., None, :], np.asarray(self.scale[1])[..., None, None]
        return self.of_many((self.base - centre) / extent, (self.platform - centre) / extent)

    @cached_property
    def singular_values(self) -> np.ndarray:
        """Singular values of the Jacobian in the scaled frame, largest first: dimensionless."""
        return np.linalg.svd(self.scaled.jacobian, compute_uv=False)


@dataclass(frozen=True, eq=False)
class PlatformPose(AnchoredPose):
    """A platform in a pose: all anchor points in the base frame.

    Attributes:
        base: (n, 3) anchors b_i in the base frame, m; n >= 6.
        platform: (n, 3) anchors p_i in the base frame, m.

    Raises:
        InputError: as for :class:`StewartPlatform`, and a leg of length zero.
    """

    _DIMENSION, _FEWEST_LEGS = 3, MINIMUM_LEGS

    @cached_property
    def spears(self) -> np.ndarray:
        """(n, 6) legs as oriented lines: unit direction, then moment about the origin in m."""
        directions = self.legs / self.lengths[..., None]
        return np.concatenate([directions, cross(self.base, directions)], axis=-1)

    @cached_property
    def jacobian(self) -> np.ndarray:
        """J: (n, 6) leg rates per screw; row i is (moment, direction) of leg i (2.7)."""
        return self.spears[..., [3, 4, 5, 0, 1, 2]]

    @cached_property
    def passive_map(self) -> np.ndarray:
        """A: (6 n, 6) angular velocities of all unactuated joints per screw, 1/s; |A q|^2 = sum of (6.5)."""
        across = skew(self.spears[..., :3] * (1.0 / self.lengths)[..., None])
        rows = np.empty((*self.base.shape[:-2], 2, self.n_legs, 3, 6))
        for k, points in enumerate((self.platform, self.base)):
            rows[..., k, :, :, :3] = -across @ skew(points)
            rows[..., k, :, :, 3:] = across
        return rows.reshape(*self.base.shape[:-2], -1, 6)

    @cached_property
    def N(self) -> np.ndarray:
        """(6, 6) q' N q = sum of squared leg rates."""
        return self.jacobian.T @ self.jacobian

    @cached_property
    def Z(self) -> np.ndarray:
        """(6, 6) q' Z q = sum of squared angular velocities of the unactuated joints."""
        return self.passive_map.T @ self.passive_map

    @property
    def singular(self) -> bool:
        """True if the legs' lines lie in one linear complex, up to rounding."""
        return rank_defect(self.singular_values) > 0

    def exchanged(self, legs: object = None) -> PlatformPose:
        """The pose with base and platform anchors of the given legs (indices; default: all) exchanged."""
        chosen = slice(None) if legs is None else np.asarray(legs, dtype=int)
        base, platform = self.base.copy(), self.platform.copy()
        base[chosen], platform[chosen] = self.platform[chosen], self.base[chosen]
        return PlatformPose(base, platform)

    def screw_from_scaled(self, screws: np.ndarray) -> np.ndarray:
        """Screws (6, k) of the scaled frame as screws of the base frame (angular velocities unchanged)."""
        centre, extent = self.scale
        angular, linear = screws[:3], screws[3:]
        return np.vstack([angular, extent * linear + skew(centre) @ angular])


def rank_defect(singular_values: np.ndarray) -> int:
    """Number of singular values that are zero up to rounding."""
    return int((singular_values <= RANK_TOLERANCE * singular_values.max()).sum())


def anchor_pair(base: object, platform: object, dimension: int, minimum: int) -> dict[str, np.ndarray]:
    """Both anchor sets, `base` and `platform`, as arrays (n, dimension).

    Raises:
        InputError: no such arrays, fewer than `minimum` legs, different numbers.
    """
    base = finite_array("base", base, (None, dimension))
    platform = finite_array("platform", platform, (None, dimension))
    if len(base) != len(platform):
        raise InputError(
            f"platform: needs one anchor for each of the {len(base)} base anchors, got {len(platform)}"
        )
    if len(base) < minimum:
        raise InputError(f"base: needs at least {minimum} legs, got {len(base)}")
    return {"base": base, "platform": platform}


def legs_exist(base: np.ndarray, platform: np.ndarray) -> np.ndarray:
    """(N,) True where all legs between anchors (N, n, 3) have a length."""
    lengths = np.linalg.norm(platform - base, axis=-1)
    return lengths.min(axis=-1) > LEG_TOLERANCE * centroid_and_extent(base, platform)[1]


def refuse_zero_legs(lengths: np.ndarray, extent: float) -> None:
    """Raise InputError if a leg has no direction: shorter than rounding compared with the extent."""
    short = int(lengths.argmin())
    if lengths[short] <= LEG_TOLERANCE * extent:
        raise InputError(
            f"leg {short + 1}: base and platform anchor coincide (length {lengths[short]:.3g} m); "
            "a leg needs a direction"
        )


def centroid_and_extent(base: np.ndarray, platform: np.ndarray) -> tuple[np.ndarray, Any]:
    """Centroid (..., 3) of both anchor sets and root mean square distance (...) from it."""
    points = np.concatenate([base, platform], axis=-2)
    centre = points.sum(axis=-2) / points.shape[-2]
    arms = (points - centre[..., None, :]).reshape(*centre.shape[:-1], -1)
    return centre, np.sqrt((arms[..., None, :] @ arms[..., None])[..., 0, 0] / points.shape[-2])


PLANAR_LEGS = 3


@dataclass(frozen=True, eq=False)
class PlanarPlatformPose(AnchoredPose):
    """A planar platform in a pose: all anchor points in the base frame.

    Attributes:
        base: (n, 2) anchors b_i in the base frame, m; n >= 3.
        platform: (n, 2) anchors p_i in the base frame, m.

    Raises:
        InputError: too few legs, different numbers of anchors, no finite numbers, a leg of length zero.
    """

    _DIMENSION, _FEWEST_LEGS = 2, PLANAR_LEGS

    @cached_property
    def jacobian(self) -> np.ndarray:
        """J: (n, 3) leg rates per planar screw; row i is (moment about the origin, direction)."""
        unit = self.legs / self.lengths[:, None]
        moment = self.base[:, 0] * unit[:, 1] - self.base[:, 1] * unit[:, 0]
        return np.column_stack([moment, unit])

    @cached_property
    def passive_map(self) -> np.ndarray:
        """A: (2 n, 3) angular velocities of the unactuated joints per planar screw."""
        normal = np.column_stack([-self.legs[:, 1], self.legs[:, 0]]) / (self.lengths**2)[:, None]
        rows = []
        for points in (self.platform, self.base):
            turn = points[:, 0] * normal[:, 1] - points[:, 1] * normal[:, 0]
            rows.append(np.column_stack([turn, normal]))
        return np.vstack(rows)

    def screw_from_scaled(self, screws: np.ndarray) -> np.ndarray:
        """Planar screws (3, k) of the scaled frame as screws of the base frame."""
        centre, extent = self.scale
        spin, linear = screws[0], screws[1:]
        return np.vstack([spin, extent * linear + np.outer([centre[1], -centre[0]], spin)])
