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

from copy import copy
from functools import cached_property
from typing import Any

import numpy as np

from ocptip.standing.arm import Robot
from ocptip.standing.instants import Instants, Loaded, wrenches_on
from ocptip.standing.limit_kinds.limit import (
    WHOLE,
    InstantAt,
    Limit,
    Sampled,
    StateLimit,
    TableLimit,
    Worst,
)
from ocptip.standing.limit_kinds.nominal import ContactLimit, ContactRowsLimit
from ocptip.standing.limit_kinds.rows import NEGLIGIBLE, NodeRows, RowNodes
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.along_path import Path, StopPoints, StopSlopes, stop_slopes
from ocptip.standing.stops.by_brakes import BrakeCheck, Brakes, Closing, closing_of, stops_of_motion
from ocptip.standing.stops.by_cancel import (
    Cancel,
    CancelSlopes,
    StopStates,
    cancel_slopes,
    cancelled_motion,
)
from ocptip.standing.stops.joint_stops import without_creep


class StoppedLimit(StateLimit, ContactLimit):
    """Rows of one state of the stop that begins at a node, smooth as what is `chosen` for it is kept."""

    of_motion = False

    _fixed: tuple[np.ndarray, ...] | None = None  # (N, width, ...) each, of the nodes of a program

    @property
    def _slopes(self) -> Any:
        """Wrenches in states of stops with derivatives: a `Closing` or `CancelSlopes`."""
        raise NotImplementedError(f"{self.name}: no rows")

    def _choose(self, s: np.ndarray, before: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
        """What makes each row the worst, (N, width, ...) each, of stops that begin in states (N, S).

        Args:
            s: states.
            before: see `Instants.before`.
        """
        raise NotImplementedError(f"{self.name}: no rows")

    def _values(
        self, s: np.ndarray, k: np.ndarray, chosen: tuple[np.ndarray, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values (R,) of rows k and their slopes (R, 6) over the wrench."""
        return self.quantity.rows(self._slopes.wrenches(s, *chosen), np.arange(len(k)), k)[:2]

    def chosen(self, instants: Instants) -> Limit:
        other = copy(self)
        other._fixed = self._choose(instants.s, instants.before)
        return other

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        if self._fixed is not None:
            chosen = tuple(part[i, k] for part in self._fixed)
        else:
            nodes, place = np.unique(i, return_inverse=True)
            chosen = tuple(part[place, k] for part in self._choose(row_nodes.s[nodes]))
        values, weights = self._values(row_nodes.s[i], k, chosen)
        unit = self.quantity.unit
        weights = weights / unit
        gradient = self._slopes.gradient(row_nodes.s[i], *chosen, weights)
        return NodeRows(row_nodes, i, k, values / unit, gradient, chosen=chosen, weights=weights)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        some = np.flatnonzero(np.abs(on) > NEGLIGIBLE)
        chosen = (part[some] for part in rows.chosen)
        weights = on[some, None] * rows.weights[some]
        return some, self._slopes.hessian(rows.at.s[rows.nodes[some]], *chosen, weights)


class BrakeLimit(TableLimit, StoppedLimit, ContactRowsLimit):
    """One quantity during all stops by brakes."""

    words = "{} in stops by brakes", "{}_brakes"
    takes_objects = of_arms = True
    scenario = WHOLE
    table, largest_step, rows_first = "brakes", 0.05, True

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        times, result = stops_of_motion(self._arm, sampled.motion, self._brakes, interface=self.interface)
        values = np.where(np.isfinite(result.rests), getattr(result, self.setting), np.inf)
        k = int(np.argmax(values))
        detail = f"a stop by brakes, worst {1e3 * result.after[k]:.3g} ms later"
        if not np.isfinite(result.rests[k]):
            detail = "brakes that close then do not bring the arm to rest"
        return [self.worst_value(float(values[k]), float(times[k]), detail)]

    @cached_property
    def _arm(self) -> Robot:
        return Robot.of(self.robot)  # it was wanted

    @cached_property
    def _brakes(self) -> Brakes:
        assert self.asked.brakes is not None
        return self.asked.brakes

    @cached_property
    def _check(self) -> BrakeCheck:
        return BrakeCheck(self._arm, self._brakes, self.interface)

    # --- rows of a program --------------------------------------------------------------------------------

    @property
    def _slopes(self) -> Closing:
        return closing_of(self._arm, self.interface)

    def _choose(self, s: np.ndarray, before: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
        """(N, width, n) torques of the brakes on the joints; 0 for joints at rest."""
        q, qd = np.split(s[:, : 2 * self.robot.n], 2, axis=1)
        return (self.quantity.brake_torques(self._check, q, qd),)

    def badness(self, instants: Instants, share: float) -> np.ndarray:
        return self.quantity.brake_badness(self._check, self._slopes, instants.angles, instants.speeds, share)

    def near(self, instants: Instants, share: float) -> np.ndarray:
        return ~(self.quantity.uses(self.badness(instants, share)) < share)


STOP_INNER = 3e-3  # by so much tighter are programs: corners move between their nodes


class StopLimit(StateLimit, TableLimit, ContactRowsLimit):
    """One quantity during all stops along the path."""

    words = "{} in stops", "{}_stop"
    of_motion, takes_objects, smooth = False, True, False
    table, inner_share = "stops", STOP_INNER

    @property
    def _time(self) -> float:
        assert self.asked.stops is not None  # else it is not wanted
        return self.asked.stops.time

    # --- what happens -------------------------------------------------------------------------------------

    def detail(self, instant_at: InstantAt, time: float) -> str:
        points = self._points(instant_at(time))
        worst = int(points.worst(self.quantity.largest(points)[:, None])[1][0, 0])
        if points.x[worst] == points.u[worst] == 0:
            return "rest after a stop"
        left = 100 * np.sqrt(points.x[worst])
        return f"a stop passing with {left:.0f} % of the speed, s'' = {points.u[worst]:.3g} 1/s"

    def measure(self, instants: Instants) -> np.ndarray:
        points = self._points(instants)
        return points.worst(self.quantity.largest(points)[:, None])[0]

    def _points(self, instants: Instants) -> StopPoints:
        """Corners; kept with the instants, for the other quantity."""
        key = "stops", self.asked.torque_ratio, self._time, self.interface
        if key not in instants.memo:
            instants.memo[key] = self._points_of(instants.motion_states, instants.process)
        return instants.memo[key]

    def _points_of(
        self, states: tuple[np.ndarray, np.ndarray, np.ndarray], process: np.ndarray
    ) -> StopPoints:
        how = self.asked.torque_ratio, self._time, process, self.interface
        return StopPoints.of(Path.of(self.robot, states, *how))

    # --- rows of a program --------------------------------------------------------------------------------

    @cached_property
    def _slopes(self) -> StopSlopes:
        return stop_slopes(self.robot, self._time, self.interface)

    def badness(self, instants: Instants, share: float) -> np.ndarray:
        if self not in instants.memo:
            points = self._points(instants)
            instants.memo[self] = points.worst(self.quantity.exact(points))[0]
        return instants.memo[self]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(self.width, -np.inf), self.quantity.worst()

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        nodes, place = np.unique(i, return_inverse=True)
        q, qd, qdd = row_nodes.motion_states
        points = self._points_of((q[nodes], qd[nodes], qdd[nodes]), row_nodes.process[nodes])
        values, slopes = self.quantity.exact_rows(points)
        which = points.worst(values)[1][place, k]
        weights = slopes[which, k]
        chosen = points.select(which)
        gradient = self._slopes.gradient(row_nodes.s[i], self.asked.torque_ratio, chosen, weights)
        return NodeRows(row_nodes, i, k, values[which, k], gradient, chosen=(chosen,), weights=weights)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        some = np.flatnonzero(np.abs(on) > NEGLIGIBLE)
        nodes, weights = rows.nodes[some], on[some, None] * rows.weights[some]
        points = rows.chosen[0].select(some)
        return some, self._slopes.hessian(rows.at.s[nodes], self.asked.torque_ratio, points, weights)


def cancel_of(robot: StandingMechanism, asked: Limits) -> tuple[Robot, Cancel]:
    """The arm and its controller, where the limits ask for cancels."""
    assert asked.cancel is not None
    return Robot.of(robot), asked.cancel


class _Stopped(Loaded):
    """States of the stops that begin at N nodes, with the wrenches on an interface."""

    def __init__(
        self, robot: Robot, stop_states: StopStates, count: int, process: np.ndarray, interface: int
    ) -> None:
        acting = process[stop_states.owner] if process.size else None
        wrenches = wrenches_on(robot, interface, stop_states.q, stop_states.qd, stop_states.qdd, acting)
        super().__init__(robot.interfaces[interface], wrenches)
        self.count, self.states_of_stops = count, stop_states

    def some(self, rows: np.ndarray) -> Loaded:
        """Some of the states."""
        return Loaded(self.footing, self.wrenches[rows])

    def worst(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Maximum of values (M, width) at each node, (N, width), and the number of its state."""
        return worst_by_owner(values, self.states_of_stops.owner, self.count)


def worst_by_owner(values: np.ndarray, owner: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Maximum of values (M, width) of each of `count` owners, and the number of its row, (N, width) each."""
    greatest = np.full((count, values.shape[1]), -np.inf)
    np.maximum.at(greatest, owner, values)
    number = np.zeros(greatest.shape, dtype=int)
    rows, places = np.nonzero(values == greatest[owner])
    number[owner[rows], places] = rows
    return greatest, number


class CancelLimit(TableLimit, StoppedLimit, ContactRowsLimit):
    """One quantity during all stops of a cancelled motion."""

    words = "{} in cancels", "{}_cancel"
    takes_objects = of_arms = True
    scenario = WHOLE
    table, largest_step, rows_first = "cancel", 0.05, True

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        robot, cancel = cancel_of(sampled.robot, self.asked)
        times, result = cancelled_motion(robot, sampled.motion, cancel, self.interface)
        values = getattr(result, self.setting)
        k = int(np.argmax(values))
        detail = f"joints decelerate from then on, worst {1e3 * result.after[k]:.3g} ms later"
        return [self.worst_value(float(values[k]), float(times[k]), detail)]

    # --- rows of a program --------------------------------------------------------------------------------

    @property
    def _arm(self) -> tuple[Robot, Cancel]:
        return cancel_of(self.robot, self.asked)

    @property
    def _slopes(self) -> CancelSlopes:
        return cancel_slopes(self._arm[0], self._arm[1].decelerations, interface=self.interface)

    def _stopped(self, s: np.ndarray) -> _Stopped:
        robot, cancel = self._arm
        q, qd, _, process = np.split(s, robot.n * np.arange(1, 4), axis=1)
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

    def _choose(self, s: np.ndarray, before: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
        """The worst states: sign, moves, weights, (N, width, n) each."""
        stops, qd = self._stopped(s), s[:, self.robot.n : 2 * self.robot.n]
        number, states_of_stops = self._worst_of(stops)[1], stops.states_of_stops
        sign = np.repeat(np.sign(without_creep(qd))[:, None], number.shape[1], axis=1)
        return sign, states_of_stops.moves[number].astype(float), states_of_stops.weights[number]

    def badness(self, instants: Instants, share: float) -> np.ndarray:
        """(N, width), the worst of the stop that begins there."""
        key = self.name, self.asked.cancel and self.asked.cancel.decelerations
        if key not in instants.memo:
            instants.memo[key] = self._worst_of(self._stopped(instants.s))[0]
        return instants.memo[key]
