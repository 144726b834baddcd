"""Limits of stops by a controller that is cancelled: margins while every joint decelerates by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ocptip.standing.arm import Robot
from ocptip.standing.limit_kinds.limit import WHOLE, Sampled, StateLimit, TableLimit, Worst
from ocptip.standing.limit_kinds.nominal import ContactLimit
from ocptip.standing.limit_kinds.worst_case import WithinLimit
from ocptip.standing.limits import WITHIN_OF, Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.by_cancel import Cancel, cancel_times, cancelled_motion
from ocptip.standing.within.cancelled import worst_of_cancels
from ocptip.standing.within.worst_case import worst_case_of


def cancel_of(robot: StandingMechanism, asked: Limits) -> tuple[Robot, Cancel]:
    """The arm and its controller, where the limits ask for cancels."""
    assert isinstance(robot, Robot)
    assert asked.cancel is not None
    return robot, asked.cancel


class CancelLimit(StateLimit, TableLimit, ContactLimit):
    """One quantity during all stops of a cancelled motion."""

    words = "{} in cancels", "{}_cancel"
    of_motion = False
    scenario = WHOLE
    table, largest_step, rows_first = "cancel", 0.05, True

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return asked.cancel is not None and isinstance(robot, Robot)

    def worst(self, values: np.ndarray, at: Sampled) -> list[Worst]:
        robot, cancel = cancel_of(at.robot, self.asked)
        times, found = cancelled_motion(robot, at.motion, cancel)
        values = getattr(found, self.setting)
        k = int(np.argmax(values))
        detail = f"joints decelerate from then on, worst {1e3 * found.after[k]:.3g} ms later"
        return [self.found(float(values[k]), float(times[k]), detail)]


class WorstCancelLimit(WithinLimit):
    """The same within the uncertainty; programs know the nominal stops, and are tightened."""

    smallest_step, largest_step = 1e-3, 0.05

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...], symbol: str) -> None:
        super().__init__(robot, asked, joints)
        self._symbol, self.setting = symbol, WITHIN_OF[symbol]
        self.name, self.result = f"{symbol} in cancels within tolerance", f"{symbol}_cancel_worst_case"

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return bool(asked.tolerance.given) and CancelLimit.wanted(robot, asked)

    @classmethod
    def of(
        cls, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]
    ) -> tuple[WorstCancelLimit, ...]:
        return tuple(cls(robot, asked, joints, symbol) for symbol in WITHIN_OF)

    def worst(self, values: np.ndarray, at: Sampled) -> list[Worst]:
        robot, cancel = cancel_of(at.robot, self.asked)
        if cancel not in at.memo:
            cases, times = worst_case_of(robot, self.asked.tolerance), cancel_times(at.motion)
            found = worst_of_cancels(cases, at.motion, cancel, times)
            at.memo[cancel] = dict(zip(WITHIN_OF, found, strict=True))
        worst = at.memo[cancel][self._symbol]
        return [] if worst is None else [self._of(worst)]

    def inner(self, asked: Limits) -> Limits:
        return asked

    def tightened(self, asked: Limits, excess: float) -> Limits:
        assert asked.cancel is not None
        value = getattr(asked.cancel, self._symbol)
        step = min(max(excess, self.smallest_step), self.largest_step)
        return replace(asked, cancel=replace(asked.cancel, **{self._symbol: max(value - step, value / 2)}))
