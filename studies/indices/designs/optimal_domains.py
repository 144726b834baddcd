"""Where the families of platforms with control number 1 are real: roots and boundary curves.

The main family L_H has the parameters (t, r1) and up to four roots b1; which of them are real changes at
the curves S = 0 and S_1 S_2 = 0. On the curve W = 0 both solutions of the angle Phi1 are the same. The
special family L_S has one bound of |r1| for each t. Source: [Naw07] 7.3.1, 7.3.2, (7.50) to (7.65), (7.82).
"""

from __future__ import annotations

import math

import numpy as np

from ocptip.basics.errors import InputError, number_from
from studies.indices.designs.optimal_planar import LARGEST_R

TOUCHING_POINT = (0.54775168735, 1.98271818060)
"""N = (t, r1): the curves S = 0 and S_1 S_2 = 0 touch (and at the mirror images)."""

W_MEETS_S = (0.09284698744, 1.72934680750)
"""T~ = (t, r1): the curves W = 0 and S = 0 touch."""

W_CROSSES_S12 = (0.53727775658, 1.95363846420)
"""M~ = (t, r1): the curves W = 0 and S_1 S_2 = 0 cross."""

W_MEETS_S12 = (0.59278998698, 2.05195821570)
"""K = (t, r1): the curves W = 0 and S_1 S_2 = 0 touch."""

_HALF = 1e-12


def main_roots(t: float, r1: float) -> dict[int, float]:
    """The real roots b1 of the main family (7.50 to 7.57).

    Args:
        t: -1 < t < 1, not 0.
        r1: not 0.

    Returns:
        Root number 1 to 4 -> b1; for t = +-1/2 the roots b1- and b1+ have the numbers 1 and 2. May be empty.

    Raises:
        InputError: t or r1 outside of that.
    """
    t, r1 = shape_parameter(t), number_from("r1", r1)
    if r1 == 0.0:
        raise InputError("r1: must not be 0")
    if abs(4.0 * t * t - 1.0) < _HALF:
        return _roots_at_half(math.copysign(1.0, t), r1)
    S, inner = discriminants(t, r1)
    if S < 0.0:
        return {}
    roots = {}
    lead = t * r1 * (24.0 * t**4 - 84.0 * t * t + 33.0)
    divisor = 18.0 * math.sqrt(2.0) * (4.0 * t * t - 1.0)
    for number, sign, discriminant in ((1, 1.0, inner[1]), (3, -1.0, inner[0])):
        if discriminant >= 0.0:
            middle = lead + sign * 12.0 * t * math.sqrt(S)
            roots[number] = (middle + math.sqrt(discriminant)) / divisor
            roots[number + 1] = (middle - math.sqrt(discriminant)) / divisor
    return roots


def discriminants(t: float, r1: float) -> tuple[float, tuple[float, float]]:
    """S and (S_1, S_2) of [Naw07] 7.3.1; S_1, S_2 are NaN where S < 0."""
    q, u = r1 * r1, t * t
    S = q * (4 * u**4 - 16 * u**3 + 15 * u * u + 2 * u - 5) + 24 * u * u - 12 * u + 15
    if S < 0.0:
        return S, (math.nan, math.nan)
    rest = 48 + 1920 * u * u + 192 * u + q * (640 * u**4 - 1216 * u**3 - 624 * u * u - 40 * u + 25)
    mixed = 8.0 * r1 * math.sqrt(S) * (40 * u * u + 4 * u + 1)
    return S, (3.0 * (1.0 - u) * (rest - mixed), 3.0 * (1.0 - u) * (rest + mixed))


def outer_border(t: float) -> float:
    """|r1| where S = 0: the largest one with any real root for |t| <= 0.5478 (7.59).

    Raises:
        InputError: t outside of -1 < t < 1, or 0.
    """
    u = shape_parameter(t) ** 2
    square = -(12 * u * u - 24 * u - 15) * (8 * u * u - 4 * u + 5)
    return math.sqrt(square) / ((4 * u * u - 8 * u - 5) * (u - 1))


def inner_borders(t: float) -> tuple[float, float]:
    """|r1| where S_1 = 0 or S_2 = 0: lower and upper curve (7.58); NaN where the curve is not real.

    Raises:
        InputError: t outside of -1 < t < 1, or 0.
    """
    u = shape_parameter(t) ** 2
    inner = (4 * u - 1) * (2 * u + 1) * (32 * u * u + 8 * u + 5) * (40 * u * u + 4 * u + 1)
    if inner < 0.0:
        return math.nan, math.nan
    divisor = -3.0 * (320 * u**3 + 112 * u * u - 32 * u + 5) * (64 * u**3 - 144 * u * u - 48 * u - 7)
    values = []
    for sign in (-1.0, 1.0):
        top = 320 * u**3 + 336 * u * u + 24 * u - 5 + sign * 4.0 * math.sqrt(inner)
        square = (40 * u * u + 4 * u + 1) * top / divisor
        values.append(4.0 * math.sqrt(square) if square >= 0.0 else math.nan)
    return values[0], values[1]


def angle_borders(t: float) -> tuple[float, float]:
    """|r1| where W = 0 for one of the roots b1: lower and upper curve (7.63 to 7.65); NaN where not real.

    Raises:
        InputError: t outside of -1 < t < 1, or 0.
    """
    u = shape_parameter(t) ** 2
    inner = (2 * u + 1) * (u - 1)
    inner *= (((((((12800 * u - 6400) * u + 4224) * u + 128) * u + 344) * u - 84) * u) - 67) * u - 10
    if inner < 0.0:
        return math.nan, math.nan
    mixed = 4.0 * abs(t) * (40 * u * u + 4 * u + 1) * math.sqrt(inner)
    top = 25600 * u**7 - 13056 * u**5 + 5632 * u**4 - 864 * u**3 - 2136 * u * u - 551 * u - 45
    divisor = (u - 1) * (8 * u + 1) * (5120 * u**5 - 2048 * u**4 - 2688 * u**3 + 976 * u * u + 584 * u + 81)
    squares = sorted(16.0 / 3.0 * (top + sign * mixed) / divisor for sign in (-1.0, 1.0))
    return math.sqrt(squares[0]), math.sqrt(squares[1])


def special_limit(t: float) -> float:
    """Largest |r1| of the special family for t (7.82).

    Raises:
        InputError: t outside of -1 < t < 1, or 0.
    """
    u = shape_parameter(t) ** 2
    q = 9 * u**3 - 17 * u * u - 13 * u - 3
    root = math.sqrt(-(u + 1) * q * (5 * u * u + 2 * u + 1))
    return float(2 * (1 + 3 * u) * root / abs(math.sqrt(3.0) * (u + 1) * q * t))


def shape_parameter(t: object) -> float:
    """Return t as a number with 0 < |t| < 1, or raise InputError."""
    value = number_from("t", t)
    if not 0.0 < abs(value) < 1.0:
        raise InputError(f"t: expected -1 < t < 1 and not 0, got {value}")
    return value


def _roots_at_half(sign: float, r1: float) -> dict[int, float]:
    if abs(r1) > LARGEST_R * (1.0 + 1e-12):
        return {}
    lead = 3.0 * r1**4
    w = math.sqrt(max(-3.0 * r1**6 * (9.0 * r1 * r1 - 32.0), 0.0))
    outer = sign * r1 * math.sqrt(2.0) / 4.0
    roots = {1: outer * (lead - w) / (lead + w)}
    if abs(lead - w) > 1e-12 * lead:
        roots[2] = outer * (lead + w) / (lead - w)
    return roots


def real_root_counts(t: np.ndarray, r1: np.ndarray) -> np.ndarray:
    """Number of real roots b1 on a grid: (len(t), len(r1)) integers 0 to 4, for maps of the domain."""
    return np.array([[len(main_roots(a, b)) for b in r1] for a in t], dtype=int)
