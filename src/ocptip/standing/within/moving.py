"""The worst that an uncertainty allows for an arm at rest on a base that drives."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ocptip.reserves.friction_needed import FrictionDemand
from ocptip.robots.base_motion import BaseMotion
from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.worst_case import WorstCase, worst_case_of
from ocptip.trajectories.drive_profile import DriveProfile

_STARTS = 13  # of the search for the largest friction utilisation: nominal, and both ends of six axes
_STILL = DriveProfile.of_velocities(np.array([0.0, 1.0]), np.zeros((2, 3)))


@lru_cache(maxsize=8)
def driving_case_of(robot: Robot, tolerance: Uncertainty, interface: int = 0) -> WorstCase:
    """The worst case of a robot at rest whose base may move: its motion is part of the states.

    Of one of the robot's `interfaces`; 0: the base.
    """
    return worst_case_of(robot.driving(_STILL), tolerance, interface)


class MovingCase:
    """A posture on a base that moves, within an uncertainty; deviations are those of `Deviations`.

    Args:
        cases: see `driving_case_of`, within at least this uncertainty.
        q: (n,), rad (sliding joints: m).
        base_motion: at one instant.
        tolerance: of floor, base, arm and payload.
    """

    def __init__(
        self, cases: WorstCase, q: np.ndarray, base_motion: BaseMotion, tolerance: Uncertainty
    ) -> None:
        self._s = np.concatenate([q, np.zeros(2 * len(q)), base_motion.rows(1)[0]])[None]
        self._cases = cases.within(tolerance)

    def tip(self) -> tuple[float, np.ndarray]:
        """GN at the worst, more than 1 where the base tips, and the deviations there."""
        axes = self._cases.axes
        if not axes:
            free = self._cases.footing.tip_over.free_rotation
            return (1.0 if free else 0.0), np.zeros(self._cases.deviations.size)
        worst = self._cases.moments(np.repeat(self._s, axes, axis=0), np.arange(axes))
        k = int(np.argmin(worst.values))
        return float(self._cases.tip_ratio(worst.values[k])), worst.theta[k]

    def slip(self) -> tuple[float, np.ndarray]:
        """The maximum GT of the search, and the deviations there."""
        worst = self._cases.slip(self._s, starts=_STARTS)
        return float(worst.values[0]), worst.theta[0]

    def demand(self, off: np.ndarray) -> FrictionDemand:
        """Of friction, with these deviations."""
        wrench = self._cases.deviations.wrench(self._s, off[None])[0][0]
        return FrictionDemand.of(self._cases.footing.support, wrench)

    def words(self, off: np.ndarray) -> str:
        """The deviations in words."""
        return self._cases.deviations.words(off)
