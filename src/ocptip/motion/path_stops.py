"""Stops of a motion along its path (category 1 and 2): when they begin, how long they last."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.along_path import Path, PathStops, StopPoints
from ocptip.trajectories.trajectory import Trajectory

SPACING = 4e-3  # s, between places of the path
_HALVINGS = 16


@dataclass(frozen=True, eq=False)
class Stop:
    """One stop along the path.

    Attributes:
        places: (K,), s: where on the path, by the time as planned.
        speeds: (K,): shares of the planned speed.
        times: (K,), s since the stop began.
    """

    places: np.ndarray
    speeds: np.ndarray
    times: np.ndarray


class StoppedPath:
    """All stops of a motion along its path, on a grid of places with both sides of every switching time.

    Args:
        robot, motion: whose.
        limits: with stops.
    """

    def __init__(self, robot: StandingMechanism, motion: Trajectory, limits: Limits) -> None:
        self._stops = limits.stops or PathStops(limits.GN, limits.GT)
        self.places = motion.both_sides(SPACING)
        acting = robot.during(motion).acting(self.places)
        states, least = motion.states(self.places), self._stops.time
        path = Path.of(robot, states, limits.torque_ratio, least, acting)
        self._c, self._d = path.bounds.lines
        self._path = path
        self._robot = robot

    def begun(self, place: float, speed: float) -> float:
        """When a stop from the planned speed began that passes a place with this share of it, s."""
        k = int(np.searchsorted(self.places, place))
        x = speed**2
        while k > 0 and x < 1:
            k -= 1
            x = self._before(k, x)
        return float(self.places[k]) if k or x >= 1 else 0.0

    def stop(self, place: float, speed: float = 1.0) -> Stop:
        """The stop that begins at a place with this share of the planned speed."""
        k = min(int(np.searchsorted(self.places, place)), len(self.places) - 1)
        x, time = speed**2, 0.0
        found = [(self.places[k], speed, 0.0)]
        while x > 0 and k + 1 < len(self.places):
            way = self.places[k + 1] - self.places[k]
            later = max(self._after(k, x), 0.0)
            last = later <= 0
            if last:  # with the mean deceleration of this piece
                u = max(np.max(self._c[k] + self._d[k] * x), -1e300)
                way = min(way, x / max(-2 * u, 1e-300))
            time += 2 * way / (np.sqrt(x) + np.sqrt(later))
            found.append((self.places[k] + way, np.sqrt(later), time))
            x, k = later, k + 1
        places, speeds, times = np.array(found).T
        return Stop(places, speeds, times)

    def safe_speeds(self) -> np.ndarray:
        """Largest share of the planned speed, at most 1, at which a stop begun at each place stands, (K,).

        All smaller shares are safe as well. 0 where even a stop that ends there, from any speed, does not
        stand.
        """
        safe = self._safe_squares()
        for k in range(len(safe) - 2, -1, -1):
            safe[k] = min(safe[k], self._before(k, safe[k + 1]))
        return np.sqrt(np.clip(safe, 0.0, 1.0))

    def _before(self, k: int, x: float) -> float:
        """x at place k of the stop that comes to the next place with x; each bound by itself is linear."""
        c, z = self._bounds(k)
        return float(np.min(x * np.exp(-z) - c * _mean(-z), initial=np.inf))

    def _after(self, k: int, x: float) -> float:
        c, z = self._bounds(k)
        return float(np.max(x * np.exp(z) + c * _mean(z))) if len(c) else 0.0

    def _bounds(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Twice the way to the next place times c and d of the bounds at place k."""
        way, known = self.places[k + 1] - self.places[k], np.isfinite(self._c[k])
        return 2 * way * self._c[k][known], np.clip(2 * way * self._d[k][known], -500, 500)

    def _safe_squares(self) -> np.ndarray:
        """Largest x (K,) up to which the curve u_min keeps the limits at each place; -1: not even at rest."""
        points = StopPoints.of(self._robot, self._path)
        fine = self._fine(points.wrenches)
        safe = np.ones(len(self.places))
        bad = np.flatnonzero(~np.logical_and.reduceat(fine, points.starts))
        if not len(bad):
            return safe
        first = np.array([p + int(np.argmin(fine[p:])) for p in points.starts[bad]])
        start = first == points.starts[bad]
        safe[bad[start]] = 0.0
        at, first = bad[~start], first[~start]
        low, high = points.x[first - 1], points.x[first]
        for _ in range(_HALVINGS if len(at) else 0):
            middle = 0.5 * (low + high)
            fine = self._fine(self._wrenches(at, middle))
            low, high = np.where(fine, middle, low), np.where(fine, high, middle)
        safe[at] = low
        return safe

    def _wrenches(self, at: np.ndarray, x: np.ndarray) -> np.ndarray:
        of_u, of_x, rest = (part[at] for part in self._path.wrenches)
        u = np.minimum(np.max(self._c[at] + self._d[at] * x[:, None], axis=1), 0.0)
        return rest + x[:, None] * of_x + np.where(np.isfinite(u), u, 0.0)[:, None] * of_u

    def _fine(self, wrenches: np.ndarray) -> np.ndarray:
        """(P,) whether the limits of GN and GT are kept."""
        states = self._robot.contact_states(wrenches)
        fine = self._robot.tip_over.evaluate(states).GN <= self._stops.GN * (1 + 1e-9)
        rows = np.flatnonzero(fine)
        GT = self._robot.slip.above(wrenches[rows], self._stops.GT)
        fine[rows] = GT <= self._stops.GT * (1 + 1e-9)
        return fine


def _mean(z: np.ndarray) -> np.ndarray:
    """(exp(z) - 1) / z."""
    small = np.abs(z) < 1e-12
    return np.where(small, 1.0, np.expm1(z) / np.where(small, 1.0, z))
