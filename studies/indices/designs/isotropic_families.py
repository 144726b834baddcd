"""Families of leg lines that are isotropic with respect to an operation spheroid (1/CDN_OE = 1).

Two groups of g >= 3 lines, each closed under rotations by 2 pi / g about the z-axis; the operation
ellipsoid is a spheroid about z with half-axes (1, 1, p) and its centre in the origin, which fixes the
scale. The anchors may sit anywhere on the lines. Source: [Naw07] 5.3, (5.9).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError, finite_array, number_from, positive_number, whole_number
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.platform import PlatformPose
from ocptip.numerics.vectors import cross


@dataclass(frozen=True)
class LineGroup:
    """g lines, the images of one line under rotations by 2 pi / g about the z-axis.

    Attributes:
        radius: signed distance r of the lines' points of the gorge circle from the z-axis.
        height: h, z of that circle.
        slope: z-component of the direction (-sin, cos, slope).
        phase: angle of the first point, rad.
    """

    radius: float
    height: float
    slope: float
    phase: float = 0.0

    @property
    def cone_angle(self) -> float:
        """Half opening angle between the lines and the z-axis, rad."""
        return math.atan2(1.0, abs(self.slope))

    def points_and_directions(self, g: int) -> tuple[np.ndarray, np.ndarray]:
        """(g, 3) points on the gorge circle and (g, 3) unit directions."""
        angle = self.phase + 2.0 * np.pi * np.arange(g) / g
        height, slope = np.full(g, self.height), np.full(g, self.slope)
        points = np.column_stack([self.radius * np.cos(angle), self.radius * np.sin(angle), height])
        directions = np.column_stack([-np.sin(angle), np.cos(angle), slope])
        return points, directions / math.hypot(1.0, self.slope)


@dataclass(frozen=True)
class IsotropicFamily:
    """A member of one of the families: lines and spheroid.

    Attributes:
        first, second: the two groups of lines.
        p: third half-axis of the spheroid (1, 1, p).
        g: lines per group.
    """

    first: LineGroup
    second: LineGroup
    p: float
    g: int

    @property
    def ellipsoid(self) -> OperationEllipsoid:
        """The spheroid."""
        return OperationEllipsoid(np.zeros(3), np.eye(3), np.array([1.0, 1.0, abs(self.p)]))

    @property
    def spears(self) -> np.ndarray:
        """(2 g, 6) the lines, first group first: direction, then moment."""
        points, directions = self._lines()
        return np.hstack([directions, cross(points, directions)])

    def pose(self, base_offset: object = -1.0, platform_offset: object = 1.0) -> PlatformPose:
        """A platform with its anchors on the lines.

        Args:
            base_offset, platform_offset: signed distances of the anchors from the gorge circle along the
                lines; one number or (2 g,).

        Raises:
            InputError: wrong shape, or a leg of length zero.
        """
        points, directions = self._lines()
        anchors = []
        for name, offset in (("base_offset", base_offset), ("platform_offset", platform_offset)):
            single = np.ndim(offset) == 0
            values = np.full(2 * self.g, number_from(name, offset)) if single else offset
            along = finite_array(name, values, (2 * self.g,))
            anchors.append(points + along[:, None] * directions)
        return PlatformPose(*anchors)

    def _lines(self) -> tuple[np.ndarray, np.ndarray]:
        groups = [group.points_and_directions(self.g) for group in (self.first, self.second)]
        return np.vstack([p for p, _ in groups]), np.vstack([d for _, d in groups])


def isotropic_u1(
    p: float, r2: float, *, mu: float = 0.0, g: int = 3, signs: tuple[int, int, int] = (1, 1, 1)
) -> IsotropicFamily:
    """Family U1: both groups on hyperboloids of revolution.

    Args:
        p: third half-axis of the spheroid, > 0.
        r2: radius of the second group, 0 < |r2| < 2/3.
        mu: rotation of the second group against the first, rad.
        g: lines per group, >= 3.
        signs: s1, s2, s3, each +1 or -1: slopes of both groups and the sign of the heights.

    Raises:
        InputError: an argument outside of its range.
    """
    p, r2 = positive_number("p", p), number_from("r2", r2)
    if not 0.0 < abs(r2) < 2.0 / 3.0:
        raise InputError(f"r2: expected 0 < |r2| < 2/3, got {r2}")
    s1, s2, s3 = sign_triple(signs)
    q = r2 * r2
    z1 = s1 * math.sqrt(2.0 * q * (1.0 - 2.0 * q)) / (2.0 * (1.0 - 2.0 * q))
    z2 = s2 * math.sqrt(8.0 - 18.0 * q) / 2.0
    root = math.sqrt(18.0 * q * q - 16.0 * q - 8.0 * p * p * q + 4.0 * p * p + 4.0)
    h2, h1 = s3 * root / 2.0, -s3 * root / (6.0 * (1.0 - 2.0 * q))
    r1 = -s1 * s2 * r2 * math.sqrt(2.0 * (8.0 - 18.0 * q)) / (6.0 * math.sqrt(q * (1.0 - 2.0 * q)))
    second = LineGroup(r2, h2, z2, number_from("mu", mu))
    return IsotropicFamily(LineGroup(r1, h1, z1), second, p, whole_number("g", g, 3))


def isotropic_u2(
    p: float, *, mu: float = 0.0, g: int = 3, signs: tuple[int, int, int] = (1, 1, 1)
) -> IsotropicFamily:
    """Family U2: the first group in a plane, the second on a cone of revolution.

    Args:
        p, mu, g: as for :func:`isotropic_u1`.
        signs: of r1, z2 and h1.

    Raises:
        InputError: an argument outside of its range.
    """
    p = positive_number("p", p)
    s1, s2, s3 = sign_triple(signs)
    h1 = s3 * math.sqrt(1.0 + p * p) / 3.0
    second = LineGroup(0.0, -3.0 * h1, s2 * math.sqrt(2.0), number_from("mu", mu))
    return IsotropicFamily(LineGroup(s1 * 2.0 / 3.0, h1, 0.0), second, p, whole_number("g", g, 3))


def sign_triple(signs: object) -> tuple[int, int, int]:
    """Return `signs` as three numbers +1 or -1, or raise InputError."""
    try:
        values = tuple(signs)
    except TypeError:
        raise InputError(f"signs: expected three numbers +1 or -1, got {signs!r}") from None
    if len(values) != 3 or any(value not in (1, -1) for value in values):
        raise InputError(f"signs: expected three numbers +1 or -1, got {signs!r}")
    return tuple(int(value) for value in values)
