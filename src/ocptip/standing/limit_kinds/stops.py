"""Limits of stops: margins while a motion is stopped at any instant, by brakes, along its path, or cancelled.

Checks evaluate whole stops; rows of a program are of one state of a stop, so that they are smooth. The check
detects what is worse elsewhere in a stop, and rows are tightened until nothing is. Derivatives are exact but
for the curvature of GT over the wrench.

- Brakes (category 0, `stops.by_brakes`): rows are of the moment when the brakes close, which is nearly always
  the worst. Directions of the joints and the worst brake torques are chosen where a solve begins.
- Along the path (category 1 and 2, `stops.along_path`): rows are of the worst corner of u_min(x).
- A cancelled controller (`stops.by_cancel`): rows are of the worst state of the stop that begins at a node.
  Those within the uncertainty are in `worst_cancels`.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ocptip.standing.arm import Robot
from ocptip.standing.instants import Instants, Loaded, wrenches_on
from ocptip.standing.limit_kinds.limit import WHOLE, InstantAt, Sampled, StateLimit, TableLimit, Worst
from ocptip.standing.limit_kinds.nominal import ContactLimit
from ocptip.standing.limit_kinds.rows import NEGLIGIBLE, NodeRows, RowNodes
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.along_path import Path, StopPoints, StopSlopes, stop_slopes
from ocptip.standing.stops.by_brakes import BrakeCheck, Brakes, closing_of, stops_of_motion
from ocptip.standing.stops.by_cancel import (
    Cancel,
    CancelSlopes,
    StopStates,
    cancel_slopes,
    cancelled_motion,
)
from ocptip.standing.stops.joint_stops import without_creep


@dataclass(frozen=True, eq=False)
class BrakeRows(NodeRows):
    """Rows of stops: torques on the joints (rows, n), and weights of the wrench (rows, 6)."""

    torques: np.ndarray = field(default_factory=lambda: np.empty(0))
    weights: np.ndarray = field(default_factory=lambda: np.empty(0))


class BrakeLimit(StateLimit, TableLimit, ContactLimit):
    """One quantity during all stops by brakes."""

    words = "{} in stops by brakes", "{}_brakes"
    of_motion = False
    scenario = WHOLE
    table, largest_step, rows_first = "brakes", 0.05, True

    _fixed: np.ndarray | None = None  # (N, width, n) torques at the nodes of a program

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return asked.brakes is not None and isinstance(robot, Robot)

    def worst(self, values: np.ndarray, at: Sampled) -> list[Worst]:
        times, found = stops_of_motion(self._arm, at.motion, self._brakes)
        values = np.where(np.isfinite(found.rests), getattr(found, self.setting), np.inf)
        k = int(np.argmax(values))
        detail = f"a stop by brakes, worst {1e3 * found.after[k]:.3g} ms later"
        if not np.isfinite(found.rests[k]):
            detail = "brakes that close then do not bring the arm to rest"
        return [self.found(float(values[k]), float(times[k]), detail)]

    @cached_property
    def _arm(self) -> Robot:
        assert isinstance(self.robot, Robot)  # it was wanted
        return self.robot

    @cached_property
    def _brakes(self) -> Brakes:
        assert self.asked.brakes is not None
        return self.asked.brakes

    @cached_property
    def _check(self) -> BrakeCheck:
        return BrakeCheck(self._arm, self._brakes)

    # --- rows of a program --------------------------------------------------------------------------------

    def chosen(self, at: Instants) -> BrakeLimit:
        other = copy(self)
        other._fixed = self._torques(at.angles, at.speeds)
        return other

    def _torques(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """(N, width, n) of the brakes on the joints, at which each row is worst; 0 for joints at rest."""
        return self.quantity.brake_torques(self._check, q, qd)

    def _badness(self, at: Instants, share: float) -> np.ndarray:
        closing = closing_of(self._arm)
        return self.quantity.brake_badness(self._check, closing, at.angles, at.speeds, share)

    def near(self, at: Instants, share: float) -> np.ndarray:
        return self.quantity.near_by_difference(self._badness(at, share), share)

    def use(self, at: Instants) -> np.ndarray:
        return self.quantity.use(self._badness(at, 1.0))

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.quantity.bounds()

    def rows(self, at: RowNodes, mask: np.ndarray) -> NodeRows:
        i, k = np.nonzero(mask)
        q, qd, _ = at.motion_states
        if self._fixed is not None:
            torques = self._fixed[i, k]
        else:
            nodes, place = np.unique(i, return_inverse=True)
            torques = self._torques(q[nodes], qd[nodes])[place, k]
        closing = closing_of(self._arm)
        wrenches, unit = closing.wrenches(q[i], qd[i], torques), self.quantity.unit
        values, weights, _ = self.quantity.rows(wrenches, np.arange(len(k)), k)
        weights = weights / unit
        slopes = closing.gradient(q[i], qd[i], torques, weights)
        return BrakeRows(at, i, k, values / unit, slopes, torques=torques, weights=weights)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert isinstance(rows, BrakeRows)
        some = np.flatnonzero(np.abs(on) > NEGLIGIBLE)
        q, qd, _ = (part[rows.nodes[some]] for part in rows.at.motion_states)
        weights = on[some, None] * rows.weights[some]
        return some, closing_of(self._arm).hessian(q, qd, rows.torques[some], weights)


STOP_INNER = 3e-3  # by so much tighter are programs: corners move between their nodes


@dataclass(frozen=True, eq=False)
class StopRows(NodeRows):
    """Rows of stops: where, and slopes over the wrench there, (rows, 6)."""

    points: StopPoints | None = None
    on_wrench: np.ndarray | None = None


class StopLimit(StateLimit, TableLimit, ContactLimit):
    """One quantity during all stops along the path."""

    words = "{} in stops", "{}_stop"
    of_motion, takes_objects, smooth = False, True, False
    table, inner_share = "stops", STOP_INNER

    @property
    def _time(self) -> float:
        assert self.asked.stops is not None  # else it is not wanted
        return self.asked.stops.time

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return asked.stops is not None

    # --- what happens -------------------------------------------------------------------------------------

    def detail(self, instant_at: InstantAt, time: float) -> str:
        points = self._points(instant_at(time))
        worst = int(points.worst(self.quantity.largest(points)[:, None])[1][0, 0])
        if points.x[worst] == points.u[worst] == 0:
            return "rest after a stop"
        left = 100 * np.sqrt(points.x[worst])
        return f"a stop passing with {left:.0f} % of the speed, s'' = {points.u[worst]:.3g} 1/s"

    def measure(self, at: Instants) -> np.ndarray:
        points = self._points(at)
        return points.worst(self.quantity.largest(points)[:, None])[0]

    def _points(self, at: Instants) -> StopPoints:
        """Corners; kept with the instants, for the other quantity."""
        key = "stops", self.asked.torque_ratio, self._time, self.interface
        if key not in at.memo:
            at.memo[key] = self._points_of(at.motion_states, at.process)
        return at.memo[key]

    def _points_of(
        self, states: tuple[np.ndarray, np.ndarray, np.ndarray], process: np.ndarray
    ) -> StopPoints:
        how = self.asked.torque_ratio, self._time, process, self.interface
        return StopPoints.of(Path.of(self.robot, states, *how))

    # --- rows of a program --------------------------------------------------------------------------------

    @cached_property
    def _slopes(self) -> StopSlopes:
        return stop_slopes(self.robot, self._time, self.interface)

    def _badness(self, at: Instants) -> np.ndarray:
        """(N, width), the worst of the stops."""
        if self not in at.memo:
            points = self._points(at)
            at.memo[self] = points.worst(self.quantity.exact(points))[0]
        return at.memo[self]

    def near(self, at: Instants, share: float) -> np.ndarray:
        return self.quantity.near(self._badness(at), share)

    def use(self, at: Instants) -> np.ndarray:
        return self.quantity.use(self._badness(at))

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(self.width, -np.inf), self.quantity.worst()

    def rows(self, at: RowNodes, mask: np.ndarray) -> NodeRows:
        i, k = np.nonzero(mask)
        nodes, place = np.unique(i, return_inverse=True)
        q, qd, qdd = at.motion_states
        points = self._points_of((q[nodes], qd[nodes], qdd[nodes]), at.process[nodes])
        values, slopes = self.quantity.exact_rows(points)
        which = points.worst(values)[1][place, k]
        on_wrench = slopes[which, k]
        chosen = points.select(which)
        gradient = self._slopes.gradient(at.s[i], self.asked.torque_ratio, chosen, on_wrench)
        return StopRows(at, i, k, values[which, k], gradient, chosen, on_wrench)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert isinstance(rows, StopRows)
        assert rows.points is not None
        assert rows.on_wrench is not None
        some = np.flatnonzero(np.abs(on) > NEGLIGIBLE)
        nodes, weights = rows.nodes[some], on[some, None] * rows.on_wrench[some]
        points = rows.points.select(some)
        return some, self._slopes.hessian(rows.at.s[nodes], self.asked.torque_ratio, points, weights)


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

    def curvature(self, hessian: Callable[..., np.ndarray], on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows whose multiplier (rows,) counts, and their second derivatives times it."""
        some = np.flatnonzero(np.abs(on) > NEGLIGIBLE)
        chosen = (part[some] for part in self.chosen)
        return some, hessian(self.at.s[self.nodes[some]], *chosen, on[some, None] * self.weights[some])


class _Stopped(Loaded):
    """States of the stops that begin at N nodes, with the wrenches on an interface."""

    def __init__(self, robot: Robot, at: StopStates, count: int, process: np.ndarray, interface: int) -> None:
        acting = process[at.owner] if process.size else None
        wrenches = wrenches_on(robot, interface, at.q, at.qd, at.qdd, acting)
        super().__init__(robot.interfaces[interface], wrenches)
        self.count, self.states_of_stops = count, at

    def some(self, rows: np.ndarray) -> Loaded:
        """Some of the states."""
        return Loaded(self.footing, self.wrenches[rows])

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
    of_motion, takes_objects = False, True
    scenario = WHOLE
    table, largest_step, rows_first = "cancel", 0.05, True

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return asked.cancel is not None and isinstance(robot, Robot)

    def worst(self, values: np.ndarray, at: Sampled) -> list[Worst]:
        robot, cancel = cancel_of(at.robot, self.asked)
        times, found = cancelled_motion(robot, at.motion, cancel, self.interface)
        values = getattr(found, self.setting)
        k = int(np.argmax(values))
        detail = f"joints decelerate from then on, worst {1e3 * found.after[k]:.3g} ms later"
        return [self.found(float(values[k]), float(times[k]), detail)]

    # --- rows of a program --------------------------------------------------------------------------------

    _fixed: tuple[np.ndarray, ...] | None = None  # sign, moves, weights, (N, width, n) each

    @property
    def _arm(self) -> tuple[Robot, Cancel]:
        return cancel_of(self.robot, self.asked)

    @property
    def _slopes(self) -> CancelSlopes:
        return cancel_slopes(self._arm[0], self._arm[1].decelerations, interface=self.interface)

    def _stopped(self, q: np.ndarray, qd: np.ndarray, process: np.ndarray) -> _Stopped:
        robot, cancel = self._arm
        return _Stopped(robot, cancel.states(q, qd), len(q), process, self.interface)

    def _worst_of(self, stops: _Stopped) -> tuple[np.ndarray, np.ndarray]:
        """(N, width) badness of the worst state of each stop, and its number.

        Where half spaces tell which state is worst, only that one is evaluated exactly.
        """
        rows, value = self.quantity.half_spaces(), self.quantity.exact
        if self.quantity.smooth:
            value = self.quantity.badness
        if rows is None:
            return stops.worst(value(stops))
        number = stops.worst(np.max(stops.wrenches @ rows.T, axis=1)[:, None])[1]
        return value(stops.some(number[:, 0])), number

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
        slopes, unit = self._slopes, self.quantity.unit
        wrenches = slopes.wrenches(at.s[i], *chosen)
        values, weights, _ = self.quantity.rows(wrenches, np.arange(len(k)), k)
        gradient = slopes.gradient(at.s[i], *chosen, weights / unit)
        return CancelRows(at, i, k, values / unit, gradient, chosen=chosen, weights=weights / unit)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert isinstance(rows, CancelRows)
        return rows.curvature(self._slopes.hessian, on)
