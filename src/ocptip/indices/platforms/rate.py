"""All indices of a platform pose that need no search, with their meaning."""

from __future__ import annotations

import math

import numpy as np

from ocptip.basics.errors import finite_array, rotation_matrix
from ocptip.indices.entry import IndexEntry
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
)

_NO_ELLIPSOID = "not rated: needs an operation ellipsoid"


def rate_platform(
    platform: StewartPlatform,
    position: object = (0.0, 0.0, 0.0),
    rotation: object = None,
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
    status = "singular pose" if pose.singular else "ok"
    spread = _spread(pose.platform)
    control, complexes = control_number(pose), best_complex(pose)
    entries = [
        IndexEntry(
            "ctn",
            "CTN",
            control.value,
            0.0,
            1.0,
            "1",
            "how evenly leg rates control the pose: ratio of smallest to largest rate of the passive joints",
            status,
        ),
        *_of_the_tool(pose, position, rotation, ellipsoid, status),
        IndexEntry(
            "inv_cdn_points",
            "1/CDN_3P",
            inverse_condition_number_points(pose, pose.platform) if spread else math.nan,
            0.0,
            1.0,
            "1",
            "smallest to largest motion of the platform anchors per leg motion",
            status if spread else "not rated: platform anchors on one line",
        ),
        IndexEntry(
            "inv_cdn",
            "1/CDN",
            inverse_condition_number(pose),
            0.0,
            1.0,
            "1",
            "plain condition of the Jacobian about the base origin, in metres; changes with the unit",
            status,
        ),
        IndexEntry(
            "manipulability",
            "MPB",
            manipulability(pose),
            0.0,
            math.inf,
            "m^3",
            "volume of leg rates per volume of platform motions; not comparable between platforms",
            status,
        ),
        IndexEntry(
            "sigma_r",
            "sigma_R",
            complexes.sigma_r,
            0.0,
            math.inf,
            "m",
            "smallest leg motion per rad of platform rotation",
            status,
        ),
        IndexEntry(
            "sigma_s",
            "sigma_S",
            complexes.sigma_s,
            0.0,
            math.sqrt(platform.n_legs / 3.0),
            "1",
            "smallest leg motion per metre of platform translation",
            status,
        ),
    ]
    six = platform.n_legs == MINIMUM_LEGS
    entries.append(
        IndexEntry(
            "rigidity_rate",
            "phi",
            rigidity_rate(pose).angle if six else math.nan,
            0.0,
            math.pi / 2.0,
            "rad",
            "angle between the motion that legs of fixed length would allow to a scalable platform and all "
            "rigid motions",
            status if six else "not rated: defined for six legs",
        )
    )
    return entries


def _of_the_tool(
    pose: PlatformPose,
    position: np.ndarray,
    rotation: np.ndarray,
    ellipsoid: OperationEllipsoid | None,
    status: str,
) -> list[IndexEntry]:
    conditioning = cl = math.nan
    if ellipsoid is None:
        status = _NO_ELLIPSOID
    else:
        conditioning = platform_conditioning(pose, ellipsoid.W(rotation, position)).value
        point = rotation @ ellipsoid.center + position
        cl = inverse_condition_number_cl(pose, point, ellipsoid.characteristic_length)
    return [
        IndexEntry(
            "inv_cdn_oe",
            "1/CDN_OE",
            conditioning,
            0.0,
            1.0,
            "1",
            "smallest to largest motion of the operation ellipsoid per leg motion",
            status,
        ),
        IndexEntry(
            "inv_cdn_cl",
            "1/CDN_CL",
            cl,
            0.0,
            1.0,
            "1",
            "the same with a sphere of equal size about the ellipsoid's centre",
            status,
        ),
    ]


def _spread(points: np.ndarray) -> bool:
    """True if the points are not on one line."""
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(values[1] > 1e-9 * values[0])
