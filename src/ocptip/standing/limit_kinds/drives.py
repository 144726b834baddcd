"""Limits of motions with elastic joints on rigid feet: no contact may be lost while the drives ring.

Programs approximate ringing by the overshoot of acceleration steps. For a motion that breaks the limit, GN
and GT at these steps are tightened, or where they do not count, GN and GT.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ocptip.standing.elastic.drives import on_its_drives
from ocptip.standing.limit_kinds.limit import Sampled, WholeMotionLimit, Worst
from ocptip.standing.limit_kinds.nominal import ContactLimit
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism

_TIGHTER = 0.05  # by how much, at most, they are tightened at once


class RingingLimit(WholeMotionLimit, ContactLimit):
    """A quantity of the contacts under the loads while the drives ring, with the limit of acceleration
    steps.
    """

    words = "{} while gears ring", "{}_gears"
    after_steps = True
    of_contacts = of_motion = False

    @property
    def width(self) -> int:
        return 0  # programs know nothing of it

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return robot.chain is not None and not robot.swings

    def worst(self, values: np.ndarray, at: Sampled) -> list[Worst]:
        found = on_its_drives(self.robot, at.motion)
        if found is None:
            return []
        worst = getattr(found, self.quantity.symbol)
        return [self.found(worst.value, worst.time, "after the end" if worst.time > at.motion.end else "")]

    def tightened(self, asked: Limits, excess: float) -> Limits:
        name = self.setting if asked.overshoot > 0 else self.quantity.symbol
        number = getattr(asked, name)
        return replace(asked, **{name: max(number - min(max(excess, 0.01), _TIGHTER), number / 2)})
