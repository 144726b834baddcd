"""Platforms of two groups of g legs with g-fold rotational symmetry, by eleven parameters.

Scale: the first anchors y_i lie on a circle of radius R1 = 2/sqrt(3). Because of the symmetry the matrices
N and Z of a pose have few entries, which are sums of one term per group. Source: [Naw07] 7.3, (7.16) to
(7.27).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.indices.platforms.platform import PlatformPose
from studies.indices.designs.optimal_planar import ANCHOR_RADIUS, exchanged_legs


@dataclass(frozen=True)
class LegGroup:
    """g legs from x_i to y_i, images of one leg under rotations by 2 pi / g about the z-axis.

    Attributes:
        radius: signed radius R of the circle of the anchors y_i.
        y_height, x_height: z of the anchors y_i (a) and x_i (b).
        reach: r, signed length of the leg's top view.
        angle: Phi, rad, between the radius to y_i and the leg's top view.
        phase: rotation of the group, rad.
    """

    radius: float
    y_height: float
    x_height: float
    reach: float
    angle: float
    phase: float = 0.0

    @property
    def squared_length(self) -> float:
        """L^2 of the legs."""
        return (self.y_height - self.x_height) ** 2 + self.reach**2

    def anchors(self, g: int) -> tuple[np.ndarray, np.ndarray]:
        """(g, 3) anchors y_i and x_i."""
        phi = self.phase + 2.0 * np.pi * np.arange(g) / g
        y = np.column_stack([self.radius * np.cos(phi), self.radius * np.sin(phi), np.full(g, self.y_height)])
        x = y + self.reach * np.column_stack([np.cos(self.angle + phi), np.sin(self.angle + phi), 0.0 * phi])
        x[:, 2] = self.x_height
        return y, x

    def forms(self) -> dict[str, float]:
        """Entries of N (e, f, g) and of Z (r, s, t) per leg, averaged over the group.

        e, r: angular block; f, s: mixed block; g, t: linear block. f12 = N[0, 4], s12 = Z[0, 4]; the other
        entries follow from symmetry: N[1, 3] = -f12, N[2, 5] = -2 f11.
        """
        a, b, r, R, L2 = self.y_height, self.x_height, self.reach, self.radius, self.squared_length
        d, cos, sin = a - b, np.cos(self.angle), np.sin(self.angle)
        rho2 = R * R + r * r + 2.0 * R * r * cos
        n = {
            "e11": ((R * d) ** 2 + 2.0 * R * r * a * d * cos + (a * r) ** 2) / (2.0 * L2),
            "e33": (R * r * sin) ** 2 / L2,
            "f11": R * r * d * sin / (2.0 * L2),
            "f12": -r * (R * d * cos + a * r) / (2.0 * L2),
            "g11": r * r / (2.0 * L2),
            "g33": d * d / L2,
        }
        z = {
            "r11": (R * R / 2.0 + a * a + rho2 / 2.0 + b * b - 2.0 * n["e11"]) / L2,
            "r33": (R * R + rho2 - 2.0 * n["e33"]) / L2,
            "s11": -2.0 * n["f11"] / L2,
            "s12": (-(a + b) - 2.0 * n["f12"]) / L2,
            "t11": (2.0 - 2.0 * n["g11"]) / L2,
            "t33": (2.0 - 2.0 * n["g33"]) / L2,
        }
        return n | z


@dataclass(frozen=True)
class SymmetricPlatform:
    """Two groups of g legs each.

    Attributes:
        first, second: the groups.
        g: legs per group, >= 3.
    """

    first: LegGroup
    second: LegGroup
    g: int = 3

    @classmethod
    def from_parameters(
        cls,
        *,
        a1: float,
        b1: float,
        r1: float,
        phi1: float,
        F: float,
        a2: float,
        b2: float,
        r2: float,
        phi2: float,
        mu: float = 0.0,
        g: int = 3,
    ) -> SymmetricPlatform:
        """The platform from the parameters of the source; F is the ratio of the radii of the anchors y."""
        return cls(
            LegGroup(ANCHOR_RADIUS, a1, b1, r1, phi1), LegGroup(ANCHOR_RADIUS * F, a2, b2, r2, phi2, mu), g
        )

    def parameters(self) -> dict[str, float]:
        """The parameters of :meth:`from_parameters`."""
        one, two = self.first, self.second
        return {
            "a1": one.y_height,
            "b1": one.x_height,
            "r1": one.reach,
            "phi1": one.angle,
            "F": two.radius / ANCHOR_RADIUS,
            "a2": two.y_height,
            "b2": two.x_height,
            "r2": two.reach,
            "phi2": two.angle,
            "mu": two.phase,
            "g": self.g,
        }

    def pose(self, exchanged: object = ()) -> PlatformPose:
        """The platform: x_i on the base, y_i on the moving platform; `exchanged` legs the other way round.

        Raises:
            InputError: an index that is no leg, or a leg of length zero.
        """
        (y1, x1), (y2, x2) = self.first.anchors(self.g), self.second.anchors(self.g)
        pose = PlatformPose(np.vstack([x1, x2]), np.vstack([y1, y2]))
        legs = exchanged_legs(exchanged, pose.n_legs)
        return pose.exchanged(legs) if legs else pose

    def proportionality_defects(self) -> np.ndarray:
        """(7,) defects of "Z and N are proportional diagonal matrices" (7.27); all zero makes CTN = 1."""
        one, two = self.first.forms(), self.second.forms()
        m = {key: one[key] + two[key] for key in one}
        return np.array(
            [
                m["f11"],
                m["f12"],
                m["s11"],
                m["s12"],
                m["g11"] * m["t33"] - m["g33"] * m["t11"],
                m["e11"] * m["t33"] - m["g33"] * m["r11"],
                m["e33"] * m["t33"] - m["g33"] * m["r33"],
            ]
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {name: float(value) if name != "g" else self.g for name, value in self.parameters().items()}
