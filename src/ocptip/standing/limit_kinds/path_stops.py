"""Limits of stops along the path: margins while a motion is stopped at any instant, see `stops.along_path`.

Checks and programs evaluate the corners of the curve u_min(x). Rows of a program are those of the worst
corner, whose choice may change from one x of the program to the next.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.limit import InstantAt, StateLimit, TableLimit
from ocptip.standing.limit_kinds.nominal import ContactLimit
from ocptip.standing.limit_kinds.rows import NEGLIGIBLE, NodeRows, RowNodes
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.along_path import Path, StopPoints, StopSlopes, stop_slopes

STOP_INNER = 3e-3  # by so much tighter are programs: corners move between their nodes


@dataclass(frozen=True, eq=False)
class StopRows(NodeRows):
    """Rows of stops: where, and slopes over the wrench there, (rows, 6)."""

    points: StopPoints | None = None
    on_wrench: np.ndarray | None = None


class StopLimit(StateLimit, TableLimit, ContactLimit):
    """One quantity during all stops along the path."""

    words = "{} in stops", "{}_stop"
    of_motion = False
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
        key = "stops", self.asked.torque_ratio, self._time
        if key not in at.memo:
            at.memo[key] = self._points_of(at.motion_states, at.process)
        return at.memo[key]

    def _points_of(
        self, states: tuple[np.ndarray, np.ndarray, np.ndarray], process: np.ndarray
    ) -> StopPoints:
        path = Path.of(self.robot, states, self.asked.torque_ratio, self._time, process)
        return StopPoints.of(self.robot, path)

    # --- rows of a program --------------------------------------------------------------------------------

    @cached_property
    def _slopes(self) -> StopSlopes:
        return stop_slopes(self.robot, self._time)

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
