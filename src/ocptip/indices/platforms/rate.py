"""All indices of a platform pose that need no search, with their meaning."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import finite_array, rotation_matrix
from ocptip.indices.meanings import PLATFORM, IndexEntry
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import control_number, platform_conditioning
from ocptip.indices.platforms.platform import MINIMUM_LEGS, StewartPlatform
from ocptip.indices.platforms.reviewed import (
    BestComplex,
    best_complex,
    inverse_condition_number,
    inverse_condition_number_cl,
    inverse_condition_number_points,
    manipulability,
    rigidity_rate,
    spans_a_plane,
)
from ocptip.numerics.threads import one_thread


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
    rated = RatedPose(platform, position, rotation, ellipsoid)
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


class RatedPose:
    """A platform in a pose, whose indices are computed when they are asked for.

    Arguments as for :func:`rate_platform`; InputError likewise.
    """

    def __init__(
        self,
        platform: StewartPlatform,
        position: ArrayLike = (0.0, 0.0, 0.0),
        rotation: ArrayLike | None = None,
        ellipsoid: OperationEllipsoid | None = None,
    ) -> None:
        self.position = finite_array("position", position, (3,))
        self.rotation = np.eye(3) if rotation is None else rotation_matrix("rotation", rotation)
        self.pose, self.ellipsoid = platform.at(self.position, self.rotation), ellipsoid

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


_VALUES: dict[str, Callable[[RatedPose], float]] = {
    "ctn": lambda rated: control_number(rated.pose).value,
    "inv_cdn_oe": RatedPose._inv_cdn_oe,
    "inv_cdn_cl": RatedPose._inv_cdn_cl,
    "inv_cdn_points": RatedPose._inv_cdn_points,
    "inv_cdn": lambda rated: inverse_condition_number(rated.pose),
    "manipulability": lambda rated: manipulability(rated.pose),
    "sigma_r": lambda rated: rated._complexes.sigma_r,
    "sigma_s": lambda rated: rated._complexes.sigma_s,
    "rigidity_rate": RatedPose._rigidity_rate,
}
"""The functions that compute the indices, by name."""
