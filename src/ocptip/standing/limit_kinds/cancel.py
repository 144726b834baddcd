"""Limits of stops by a controller that is cancelled: margins while every joint decelerates by itself.

Checks evaluate whole stops. Rows of a program are those of the worst state of the stop that begins at a node:
which one that is, and which joints still move then, is chosen where a solve begins, so that rows are smooth,
with exact derivatives (the curvature of GT over the wrench is left out). Stops within the uncertainty are
not rows: where they break a limit, the nominal ones are tightened.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from ocptip.standing.arm import Robot
from ocptip.standing.instants import Instants, Loaded
from ocptip.standing.limit_kinds.limit import WHOLE, Sampled, StateLimit, TableLimit, Worst
from ocptip.standing.limit_kinds.nominal import ContactLimit
from ocptip.standing.limit_kinds.rows import NEGLIGIBLE, NodeRows, RowNodes
from ocptip.standing.limit_kinds.worst_case import WithinLimit
from ocptip.standing.limits import WITHIN_OF, Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.by_cancel import (
    Cancel,
    StopStates,
    cancel_slopes,
    cancel_times,
    cancelled_motion,
    stop_states,
)
from ocptip.standing.stops.joint_stops import without_creep
from ocptip.standing.within.cancelled import worst_of_cancels
from ocptip.standing.within.worst_case import worst_case_of


def cancel_of(robot: StandingMechanism, asked: Limits) -> tuple[Robot, Cancel]:
    """The arm and its controller, where the limits ask for cancels."""
    assert isinstance(robot, Robot)
    assert asked.cancel is not None
    return robot, asked.cancel


@dataclass(frozen=True, eq=False)
class CancelRows(NodeRows):
    """Rows of stops: sign, moves, weights (rows, n) of their states, and weights of the wrench (rows, 6)."""

    chosen: tuple[np.ndarray, ...] = ()
    weights: np.ndarray = field(default_factory=lambda: np.empty(0))


class _Stopped(Loaded):
    """States of the stops that begin at N nodes."""

    def __init__(self, robot: Robot, at: StopStates, count: int, process: np.ndarray) -> None:
        self.robot, self.count, self.states_of_stops = robot, count, at
        self.wrenches = robot.loads(at.q, at.qd, at.qdd, process[at.owner] if process.size else None)[1]

    def some(self, rows: np.ndarray) -> Loaded:
        """Some of the states."""
        found = Loaded()
        found.robot, found.wrenches = self.robot, self.wrenches[rows]
        return found

    def worst(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Maximum of values (M, width) at each node, (N, width), and the number of its state."""
        owner = self.states_of_stops.owner
        greatest = np.full((self.count, values.shape[1]), -np.inf)
        np.maximum.at(greatest, owner, values)
        number = np.zeros(greatest.shape, dtype=int)
        rows, places = np.nonzero(values == greatest[owner])
        number[owner[rows], places] = rows
        return greatest, number


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

    # --- rows of a program --------------------------------------------------------------------------------

    _fixed: tuple[np.ndarray, ...] | None = None  # sign, moves, weights, (N, width, n) each

    @property
    def _arm(self) -> tuple[Robot, Cancel]:
        return cancel_of(self.robot, self.asked)

    def _stopped(self, q: np.ndarray, qd: np.ndarray, process: np.ndarray) -> _Stopped:
        robot, cancel = self._arm
        return _Stopped(robot, stop_states(q, qd, np.array(cancel.decelerations)), len(q), process)

    def _worst_of(self, stops: _Stopped) -> tuple[np.ndarray, np.ndarray]:
        """(N, width) badness of the worst state of each stop, and its number.

        Where half spaces tell which state is worst, only that one is evaluated exactly.
        """
        rows = self.quantity.half_spaces()
        if rows is None:
            return stops.worst(self.quantity.exact(stops))
        number = stops.worst(np.max(stops.wrenches @ rows.T, axis=1)[:, None])[1]
        return self.quantity.exact(stops.some(number[:, 0])), number

    def _chosen(self, q: np.ndarray, qd: np.ndarray, process: np.ndarray) -> tuple[np.ndarray, ...]:
        """The worst states: sign, moves, weights, (N, width, n) each."""
        stops = self._stopped(q, qd, process)
        number, at = self._worst_of(stops)[1], stops.states_of_stops
        sign = np.repeat(np.sign(without_creep(qd))[:, None], number.shape[1], axis=1)
        return sign, at.moves[number].astype(float), at.weights[number]

    def chosen(self, at: Instants) -> CancelLimit:
        other = copy(self)
        other._fixed = self._chosen(at.angles, at.speeds, at.process)
        return other

    def _badness(self, at: Instants) -> np.ndarray:
        """(N, width), the worst of the stop that begins there."""
        key = self.name, self.asked.cancel and self.asked.cancel.decelerations
        if key not in at.memo:
            at.memo[key] = self._worst_of(self._stopped(at.angles, at.speeds, at.process))[0]
        return at.memo[key]

    def near(self, at: Instants, share: float) -> np.ndarray:
        return self.quantity.near(self._badness(at), share)

    def use(self, at: Instants) -> np.ndarray:
        return self.quantity.use(self._badness(at))

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.quantity.bounds()

    def rows(self, at: RowNodes, mask: np.ndarray) -> NodeRows:
        i, k = np.nonzero(mask)
        if self._fixed is not None:
            chosen = tuple(part[i, k] for part in self._fixed)
        else:
            nodes, place = np.unique(i, return_inverse=True)
            q, qd, _ = at.motion_states
            chosen = tuple(part[place, k] for part in self._chosen(q[nodes], qd[nodes], at.process[nodes]))
        slopes, unit = cancel_slopes(self._arm[0], self._arm[1].decelerations), self.quantity.unit
        wrenches = slopes.wrenches(at.s[i], *chosen)
        values, weights, _ = self.quantity.rows(wrenches, np.arange(len(k)), k)
        gradient = slopes.gradient(at.s[i], *chosen, weights / unit)
        return CancelRows(at, i, k, values / unit, gradient, chosen=chosen, weights=weights / unit)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert isinstance(rows, CancelRows)
        some = np.flatnonzero(np.abs(on) > NEGLIGIBLE)
        chosen = tuple(part[some] for part in rows.chosen)
        weights = on[some, None] * rows.weights[some]
        slopes = cancel_slopes(self._arm[0], self._arm[1].decelerations)
        return some, slopes.hessian(rows.at.s[rows.nodes[some]], *chosen, weights)


class WorstCancelLimit(WithinLimit):
    """The margin in cancelled motions within the uncertainty; programs use nominal stops, then tighten."""

    # A change of the nominal value is about this share of the one that it makes within the uncertainty: there
    # a step of an acceleration counts with its overshoot, and friction is reduced.
    nominal_share = 0.4
    smallest_step, largest_step = 1e-3, 0.3

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
        if worst is None:
            return []
        return [self.found(worst.value if worst.bound is None else worst.bound, worst.time, worst.how)]

    def inner(self, asked: Limits) -> Limits:
        return asked

    def tightened(self, asked: Limits, excess: float) -> Limits:
        assert asked.cancel is not None
        value = getattr(asked.cancel, self._symbol)
        step = min(max(self.nominal_share * excess, self.smallest_step), self.largest_step)
        return replace(asked, cancel=replace(asked.cancel, **{self._symbol: max(value - step, value / 2)}))
