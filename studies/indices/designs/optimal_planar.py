"""Planar RPR platforms in poses with control number 1. Source: section 8, (7.8) to (7.15)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

import numpy as np

from ocptip.basics.errors import InputError, number_from, whole_number
from ocptip.indices.platforms.platform import PLANAR_LEGS, PlanarPlatformPose

ANCHOR_RADIUS = 2.0 / math.sqrt(3.0)
"""Radius of the circle of the anchors y_i: fixes the scale of the optimal poses."""

LARGEST_R = 4.0 / 3.0 * math.sqrt(2.0)
"""Largest leg length |r| of an optimal planar pose in that scale."""


def optimal_planar_angle(r: float, branch: Literal["-", "+"]) -> float:
    """Angle Phi between the radius to y_i and the leg at which CTN = 1, rad (7.13, 7.14).

    Args:
        r: leg length with sign (negative: the mirror image), 0 < |r| <= 4 sqrt(2) / 3.
        branch: "-" or "+", the two solutions.

    Raises:
        InputError: r or branch outside of that.
    """
    r = number_from("r", r)
    if not 0.0 < abs(r) <= LARGEST_R * (1.0 + 1e-12):
        raise InputError(f"r: expected 0 < |r| <= 4 sqrt(2) / 3 = {LARGEST_R:.6f}, got {r}")
    if branch not in ("-", "+"):
        raise InputError(f"branch: expected '-' or '+', got {branch!r}")
    root = math.sqrt(max(32.0 - 9.0 * r * r, 0.0))
    cosine = -(abs(r) * math.sqrt(3.0) + (root if branch == "+" else -root)) / 8.0
    return math.copysign(math.acos(cosine), r)


def optimal_planar_pose(
    r: float, branch: Literal["-", "+"] = "-", n: int = 3, exchanged: Iterable[int] = ()
) -> PlanarPlatformPose:
    """Planar platform of n legs closed under rotations by 2 pi / n in a pose with CTN = 1 ([Naw07] 7.2.1).

    The base anchors x_i carry legs of length |r| to platform anchors y_i on a circle of radius 2/sqrt(3); all
    three eigenvalues are 2/r^2.

    Args:
        r, branch: see :func:`optimal_planar_angle`.
        n: number of legs, >= 3.
        exchanged: indices of legs whose base and platform anchors change places.

    Raises:
        InputError: an argument outside of its range.
    """
    angle = optimal_planar_angle(r, branch)
    n = whole_number("n", n, PLANAR_LEGS)
    phi = 2.0 * np.pi * np.arange(n) / n
    y = ANCHOR_RADIUS * np.column_stack([np.cos(phi), np.sin(phi)])
    x = y + abs(r) * np.column_stack([np.cos(angle + phi), np.sin(angle + phi)])
    chosen = exchanged_legs(exchanged, n)
    base, platform = x.copy(), y.copy()
    base[chosen], platform[chosen] = y[chosen], x[chosen]
    return PlanarPlatformPose(base, platform)


def exchanged_legs(value: Iterable[int], n: int) -> list[int]:
    """Return `value` as indices of legs 0..n-1, or raise InputError."""
    try:
        chosen = [int(leg) for leg in value]
    except (TypeError, ValueError):
        raise InputError(f"exchanged: expected indices of legs, got {value!r}") from None
    for leg in chosen:
        if not 0 <= leg < n:
            raise InputError(f"exchanged: legs are counted 0 to {n - 1}, got {leg}")
    return chosen
