"""Flight-simulator platforms: anchors on two equal circles, the classical six-legged design.

The base anchors sit in pairs at +-alpha about 0, 120 and 240 degrees, the platform anchors opposite to them;
alpha is the design parameter, half the height h the pose parameter. Source: [Naw07] 6.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError, number_from, positive_number
from ocptip.indices.platforms.platform import StewartPlatform

LARGEST_ALPHA = math.pi / 6.0
OPTIMAL_CTN = math.sqrt(2.0 * math.sqrt(5.0) - 4.0)
"""Largest control number of all these platforms in their middle poses, about 0.687."""


@dataclass(frozen=True)
class FlightSimulator:
    """A flight-simulator platform in units of its circles' radius.

    Attributes:
        alpha: half the angle between the anchors of a pair, 0 <= alpha < pi/6, rad.
        height: h > 0; base at z = -h, platform at z = +h in the middle pose, m.
        radius: of both circles, m.
    """

    alpha: float
    height: float
    radius: float = 1.0

    def __post_init__(self) -> None:
        alpha = number_from("alpha", self.alpha)
        if not 0.0 <= alpha < LARGEST_ALPHA:
            raise InputError(f"alpha: expected 0 <= alpha < pi/6 (singular there), got {alpha}")
        positive_number("height", self.height)
        positive_number("radius", self.radius)

    @classmethod
    def optimal(cls, radius: float = 1.0) -> FlightSimulator:
        """The design and height with the largest control number."""
        gamma = math.sqrt(2.0 * math.sqrt(5.0) - 2.0)
        alpha = -math.atan((math.sqrt(5.0) * gamma - math.sqrt(15.0)) / 5.0)
        return cls(alpha, positive_number("radius", radius) * gamma / 4.0, radius)

    @property
    def platform(self) -> StewartPlatform:
        """The anchors; the platform frame has its origin in the platform's centre."""
        third, sixth = 2.0 * math.pi / 3.0, math.pi / 3.0
        base = np.array([k * third + s * self.alpha for k in range(3) for s in (-1, 1)])
        moving = np.array([base[i + 1] - sixth if i % 2 == 0 else base[i - 1] + sixth for i in range(6)])
        fixed = self.radius * np.column_stack([np.cos(base), np.sin(base), np.zeros(6)])
        fixed[:, 2] = -self.height
        top = self.radius * np.column_stack([np.cos(moving), np.sin(moving), np.zeros(6)])
        return StewartPlatform(fixed, top, "flight simulator")

    @property
    def position(self) -> np.ndarray:
        """(3,) platform origin in the middle pose, m."""
        return np.array([0.0, 0.0, self.height])

    def lambdas(self) -> np.ndarray:
        """(6,) eigenvalues of the control number in the middle pose, rad^2/m^2, in closed form, sorted."""
        h = self.height / self.radius
        delta = LARGEST_ALPHA - self.alpha
        s, k = math.sin(delta), math.cos(delta)
        square = 4.0 * (h * h + s * s)
        first = (1.0 + 2.0 * h * h - 4.0 * h * h * k * k / square) / (2.0 * h * h * k * k)
        third = 2.0 / math.sin(2.0 * delta) ** 2 - 2.0 / square
        fourth = 1.0 / (s * s) - 2.0 / square
        sixth = 2.0 * s * s / (h * h * square)
        return np.sort([first, first, third, fourth, fourth, sixth]) / self.radius**2
