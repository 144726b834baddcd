"""Limits of stops along the path: reserves while a motion is stopped at any instant, see `stops.along_path`.

Checks and programs look at the corners of the curve u_min(x). Rows of a program are those of the worst
corner, whose choice may change from one x of the program to the next.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ocptip.reserves.slip import known
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.limit import FAR_FROM_SLIPPING, Look, MomentLimit, StateLimit, TableLimit
from ocptip.standing.limit_kinds.rows import NEGLIGIBLE, NodeRows, RowNodes
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.along_path import Path, StopPoints, StopSlopes, stop_slopes

STOP_INNER = 3e-3  # by so much tighter are programs: corners move between their nodes


@dataclass(frozen=True, eq=False)
class StopRows(NodeRows):
    """Rows of stops: where, and slopes over the wrench there, (rows, 6)."""

    points: StopPoints | None = None
    on_wrench: np.ndarray | None = None


class StopLimit(StateLimit, TableLimit):
    """One reserve during all stops along the path."""

    of_contacts, of_motion = True, False
    unit = 1.0
    table, inner_share = "stops", STOP_INNER

    def __init__(self, robot: StandingMechanism, asked: MotionLimits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        assert asked.stops is not None  # else it is not wanted
        self._stops = asked.stops

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: MotionLimits) -> bool:
        return asked.stops is not None

    # --- what happens -------------------------------------------------------------------------------------

    def detail(self, look: Look, time: float) -> str:
        points = self._points(look(time))
        worst = int(points.worst(self._values(points)[:, None])[1][0, 0])
        if points.x[worst] == points.u[worst] == 0:
            return "rest after a stop"
        left = 100 * np.sqrt(points.x[worst])
        return f"a stop passing with {left:.0f} % of the speed, s'' = {points.u[worst]:.3g} 1/s"

    def measure(self, at: Instants) -> np.ndarray:
        points = self._points(at)
        return points.worst(self._values(points)[:, None])[0]

    def _values(self, points: StopPoints) -> np.ndarray:
        """The reserve at points, (P,)."""
        raise NotImplementedError

    def _points(self, at: Instants) -> StopPoints:
        """Corners; kept with the instants, for the other reserve."""
        key = "stops", self.asked.torque_ratio, self._stops.time
        if key not in at.memo:
            at.memo[key] = self._points_of(at.motion_states, at.process)
        return at.memo[key]

    def _points_of(
        self, states: tuple[np.ndarray, np.ndarray, np.ndarray], process: np.ndarray
    ) -> StopPoints:
        path = Path.of(self.robot, states, self.asked.torque_ratio, self._stops.time, process)
        return StopPoints.of(self.robot, path)

    # --- rows of a program --------------------------------------------------------------------------------

    @cached_property
    def _slopes(self) -> StopSlopes:
        return stop_slopes(self.robot, self._stops.time)

    def _rows_of(self, points: StopPoints) -> tuple[np.ndarray, np.ndarray]:
        """Values (P, width) of rows, the greatest the worst, and slopes (P, width, 6) over the wrench."""
        raise NotImplementedError

    def rows(self, at: RowNodes, mask: np.ndarray) -> NodeRows:
        i, k = np.nonzero(mask)
        nodes, place = np.unique(i, return_inverse=True)
        q, qd, qdd = at.motion_states
        points = self._points_of((q[nodes], qd[nodes], qdd[nodes]), at.process[nodes])
        values, slopes = self._rows_of(points)
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


class StopTipLimit(StopLimit, MomentLimit):
    """Tip-over reserve during stops; in programs the moments about the tipping axes."""

    name, quantity, setting = "tip-over in stops", "GN_stop", "GN"

    def _values(self, points: StopPoints) -> np.ndarray:
        return points.tip.GN

    def _rows_of(self, points: StopPoints) -> tuple[np.ndarray, np.ndarray]:
        moments, slopes = self._map(points.wrenches)
        return -moments / self.unit, -slopes / self.unit

    def moments(self, at: Instants) -> np.ndarray:
        """The least during stops."""
        points = self._points(at)
        return -points.worst(-self._map(points.wrenches)[0])[0]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(self.width, -np.inf), np.full(self.width, -self.least_moment / self.unit)


class StopSlipLimit(StopLimit):
    """Slip reserve during stops; its own curvature over the wrench is left out."""

    name, quantity, setting = "slip in stops", "GT_stop", "GT"
    width = 1

    def _values(self, points: StopPoints) -> np.ndarray:
        return self.robot.slip.greatest(points.wrenches)

    def _rows_of(self, points: StopPoints) -> tuple[np.ndarray, np.ndarray]:
        reserve = self.robot.slip.evaluate(points.states)
        GT, slopes = reserve.for_program()
        return GT[:, None], slopes[:, None]

    def near(self, at: Instants, share: float) -> np.ndarray:
        return self.use(at)[:, None] >= share

    def use(self, at: Instants) -> np.ndarray:
        """(N,), exact from `FAR_FROM_SLIPPING` on."""
        if self not in at.memo:
            points = self._points(at)
            GT = known(self.robot.slip.above(points.wrenches, FAR_FROM_SLIPPING * self.number))
            at.memo[self] = points.worst(GT[:, None])[0][:, 0] / self.number
        return at.memo[self]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([-np.inf]), np.array([self.number])
