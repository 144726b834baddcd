"""All indices of a platform pose that need no search, with their meaning."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import finite_array, rotation_matrix
from ocptip.indices.entry import IndexEntry
from ocptip.indices.meanings import PLATFORM
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import control_number
from ocptip.indices.platforms.isotropy import platform_conditioning
from ocptip.indices.platforms.platform import MINIMUM_LEGS, PlatformPose, StewartPlatform
from ocptip.indices.platforms.reviewed import (
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
    position = finite_array("position", position, (3,))
    rotation = np.eye(3) if rotation is None else rotation_matrix("rotation", rotation)
    pose = platform.at(position, rotation)
    complexes, spread = best_complex(pose), spans_a_plane(pose.platform)
    conditioning, cl = _of_the_tool(pose, position, rotation, ellipsoid)
    values = {
        "ctn": control_number(pose).value,
        "inv_cdn_oe": conditioning,
        "inv_cdn_cl": cl,
        "inv_cdn_points": inverse_condition_number_points(pose, pose.platform) if spread else math.nan,
        "inv_cdn": inverse_condition_number(pose),
        "manipulability": manipulability(pose),
        "sigma_r": complexes.sigma_r,
        "sigma_s": complexes.sigma_s,
        "rigidity_rate": rigidity_rate(pose).angle if platform.n_legs == MINIMUM_LEGS else math.nan,
    }
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


def _of_the_tool(
    pose: PlatformPose,
    position: np.ndarray,
    rotation: np.ndarray,
    ellipsoid: OperationEllipsoid | None,
) -> tuple[float, float]:
    """The indices inv_cdn_oe and inv_cdn_cl; NaN without ellipsoid."""
    if ellipsoid is None:
        return math.nan, math.nan
    point = rotation @ ellipsoid.center + position
    return (
        platform_conditioning(pose, ellipsoid.W(rotation, position)).value,
        inverse_condition_number_cl(pose, point, ellipsoid.characteristic_length),
    )
