"""Limits of motions with gears that give, on feet that do not: no contact may be lost while the drives ring.

Programs know of ringing what jumps with their overshoot say; for a motion that breaks the limit GN and GT at
jumps are tightened, or where these do not count, GN and GT.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ocptip.standing.elastic.drives import on_its_drives
from ocptip.standing.limit_kinds.limit import Sampled, WholeMotionLimit, Worst
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism

_TIGHTER = 0.05  # by how much, at most, they are tightened at once


class RingingTipLimit(WholeMotionLimit):
    """Tip-over reserve of the loads while the drives ring, at most that of jumps."""

    name, quantity, setting = "tip-over while gears ring", "GN_gears", "jump_tip_over"
    asks = "GN"
    of_motion = False

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: MotionLimits) -> bool:
        return robot.chain is not None and not robot.swings

    def worst(self, values: np.ndarray, at: Sampled) -> list[Worst]:
        found = on_its_drives(self.robot, at.motion)
        if found is None:
            return []
        worst = getattr(found, self.asks)
        return [self.found(worst.value, worst.time, "after the end" if worst.time > at.motion.end else "")]

    def tightened(self, asked: MotionLimits, excess: float) -> MotionLimits:
        name = self.setting if asked.overshoot > 0 else self.asks
        number = getattr(asked, name)
        return replace(asked, **{name: max(number - min(max(excess, 0.01), _TIGHTER), number / 2)})


class RingingSlipLimit(RingingTipLimit):
    """Slip reserve of these loads."""

    name, quantity, setting = "slip while gears ring", "GT_gears", "jump_slip"
    asks = "GT"
