"""Planar RPR platforms: n >= 3 legs in a plane, in a pose.

A planar screw is q = (angular velocity, velocity of the point at the origin), three numbers; everything else
is as for Stewart-Gough platforms with the third coordinate zero. Source: [Naw07] 7.2, (7.8) to (7.15).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ocptip.indices.platforms.platform import AnchoredPose

MINIMUM_LEGS = 3


@dataclass(frozen=True, eq=False)
class PlanarPlatformPose(AnchoredPose):
    """A planar platform in a pose: all anchor points in the base frame.

    Attributes:
        base: (n, 2) anchors b_i in the base frame, m; n >= 3.
        platform: (n, 2) anchors p_i in the base frame, m.

    Raises:
        InputError: too few legs, different numbers of anchors, no finite numbers, a leg of length zero.
    """

    _DIMENSION, _FEWEST_LEGS = 2, MINIMUM_LEGS

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
