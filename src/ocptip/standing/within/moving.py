"""The worst that an uncertainty allows for an arm at rest on a base that drives."""

from __future__ import annotations

import numpy as np

from ocptip.reserves.friction_needed import FrictionDemand
from ocptip.robots.base_motion import BaseMotion
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.worst_case import WorstCase

_STARTS = 13  # of the search for the largest friction utilisation: nominal, and both ends of six axes


class MovingCase:
    """A posture on a base that moves, within an uncertainty; deviations are those of `Deviations`.

    Args:
        cases: of the robot on its support, as it rests, within at least this uncertainty.
        q: (n,), rad (sliding joints: m).
        base_motion: at one instant.
        tolerance: of floor, base, arm and payload.
    """

    def __init__(
        self, cases: WorstCase, q: np.ndarray, base_motion: BaseMotion, tolerance: Uncertainty
    ) -> None:
        self._s, self._motion = np.concatenate([q, np.zeros(2 * len(q))])[None], base_motion.rows(1)
        self._cases = cases.within(tolerance)

    def tip(self) -> tuple[float, np.ndarray]:
        """GN at the worst, more than 1 where the base tips, and the deviations there."""
        axes = self._cases.axes
        if not axes:
            free = self._cases.footing.tip_over.free_rotation
            return (1.0 if free else 0.0), np.zeros(self._cases.deviations.size)
        cases = self._cases.moving(np.repeat(self._motion, axes, axis=0))
        worst = cases.moments(np.repeat(self._s, axes, axis=0), np.arange(axes))
        k = int(np.argmin(worst.values))
        return float(cases.tip_ratio(worst.values[k])), (worst.theta - cases.deviations.nominal(axes))[k]

    def slip(self) -> tuple[float, np.ndarray]:
        """The maximum GT of the search, and the deviations there."""
        cases = self._cases.moving(self._motion)
        worst = cases.slip(self._s, starts=_STARTS)
        return float(worst.values[0]), (worst.theta - cases.deviations.nominal(1))[0]

    def demand(self, off: np.ndarray) -> FrictionDemand:
        """Of friction, with these deviations."""
        cases = self._cases.moving(self._motion)
        wrench = cases.deviations.wrench(self._s, cases.deviations.nominal(1) + off)[0][0]
        return FrictionDemand.of(cases.footing.support, wrench)

    def words(self, off: np.ndarray) -> str:
        """The deviations in words."""
        return self._cases.deviations.words(off)
