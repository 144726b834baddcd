"""Worst values of stops of a motion, and from which share of the planned speed they are safe, by scenario."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.motion.check import MotionCheck
from ocptip.motion.stops.broken import (
    BRAKES,
    CANCEL,
    broken_contacts,
    broken_drives,
    broken_duration,
    broken_postures,
    broken_within,
)
from ocptip.motion.violations import statement
from ocptip.numerics.bisection import borders
from ocptip.reserves.tipping import moment_at
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.alike_friction import AlikeFriction
from ocptip.standing.footing import Footing
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import WITHIN_OF, Limits
from ocptip.standing.margins import Margins
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.along_path import Path, PathStops, StopPoints
from ocptip.standing.stops.by_brakes import BrakeCheck, Brakes, stops_of_motion
from ocptip.standing.stops.by_cancel import Cancel, CancelCheck, cancel_times, cancelled_motion
from ocptip.standing.stops.joint_stops import JointStops
from ocptip.standing.within.cancelled import alike_of_cancels, worst_of_cancels
from ocptip.standing.within.in_motion import ALIKE, WorstInstant
from ocptip.standing.within.worst_case import worst_case_of
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
        how = motion.states(self.places), limits.torque_ratio, self._stops.time, acting
        self._paths = [Path.of(robot, *how, interface) for interface in range(len(robot.interfaces))]
        self._c, self._d = self._paths[0].bounds.lines

    @property
    def alike(self) -> list[float]:
        """Share of the friction that equally compliant feet of each interface use in stops, at least."""
        return [AlikeFriction(path.footing).most(StopPoints.of(path).wrenches) for path in self._paths]

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
        results = [(self.places[k], speed, 0.0)]
        while x > 0 and k + 1 < len(self.places):
            way = self.places[k + 1] - self.places[k]
            later = max(self._after(k, x), 0.0)
            last = later <= 0
            if last:  # with the mean deceleration of this piece
                u = max(np.max(self._c[k] + self._d[k] * x), -1e300)
                way = min(way, x / max(-2 * u, 1e-300))
            time += 2 * way / (np.sqrt(x) + np.sqrt(later))
            results.append((self.places[k] + way, np.sqrt(later), time))
            x, k = later, k + 1
        places, speeds, times = np.array(results).T
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
        """Largest x (K,) up to which the curve u_min keeps the limits of all interfaces at each place; 0: not
        even at rest.
        """
        return np.min([self._safe_squares_on(path) for path in self._paths], axis=0)

    def _safe_squares_on(self, path: Path) -> np.ndarray:
        points = StopPoints.of(path)
        fine = self._fine(path.footing, points.wrenches)
        safe = np.ones(len(self.places))
        bad = np.flatnonzero(~np.logical_and.reduceat(fine, points.starts))
        if not len(bad):
            return safe
        first = np.array([p + int(np.argmin(fine[p:])) for p in points.starts[bad]])
        start = first == points.starts[bad]
        safe[bad[start]] = 0.0
        on_path, first = bad[~start], first[~start]

        def kept(x: np.ndarray) -> np.ndarray:
            return self._fine(path.footing, self._wrenches(path, on_path, x))

        safe[on_path], _ = borders(kept, points.x[first - 1], points.x[first], _HALVINGS)
        return safe

    def _wrenches(self, path: Path, places: np.ndarray, x: np.ndarray) -> np.ndarray:
        of_u, of_x, rest = (part[places] for part in path.wrenches)
        u = np.minimum(np.max(self._c[places] + self._d[places] * x[:, None], axis=1), 0.0)
        return rest + x[:, None] * of_x + np.where(np.isfinite(u), u, 0.0)[:, None] * of_u

    def _fine(self, footing: Footing, wrenches: np.ndarray) -> np.ndarray:
        """(P,) whether the limits of GN and GT are kept."""
        states = footing.contact_states(wrenches)
        fine = footing.tip_over.evaluate(states).GN <= self._stops.GN * (1 + 1e-9)
        rows = np.flatnonzero(fine)
        GT = footing.slip.above(wrenches[rows], self._stops.GT)
        fine[rows] = GT <= self._stops.GT * (1 + 1e-9)
        return fine


def _mean(z: np.ndarray) -> np.ndarray:
    """(exp(z) - 1) / z."""
    small = np.abs(z) < 1e-12
    return np.where(small, 1.0, np.expm1(z) / np.where(small, 1.0, z))


LEVELS = 5  # halvings of the speed's share


class PathTable:
    """Stops along the path."""

    def __init__(
        self,
        robot: StandingMechanism,
        motion: Trajectory,
        limits: Limits,
        times: np.ndarray,
        checked: MotionCheck,
    ) -> None:
        path = StoppedPath(robot, motion, limits)
        safe = path.safe_speeds()
        self._checked, self._interfaces, self._alike = checked, robot.interfaces, path.alike
        self.curve = np.array([path.places, safe])
        self.speeds = np.interp(times, path.places, safe)
        self.durations = np.array([path.stop(t).times[-1] for t in times])

    def worst(self) -> dict[str, Any]:
        """Worst values of the check, and when the stop passes there."""
        base, *objects = map(self._worst_of, self._interfaces, self._alike)
        table = {"longest_stop_s": float(np.max(self.durations)), **base}
        return table | of_objects(self._interfaces, objects)

    def _worst_of(self, footing: Footing, alike: float) -> dict[str, Any]:
        table: dict[str, Any] = _if_alike(alike)
        for name in ("GN", "GT"):
            if worst := self._checked.worst.get(footing.result(f"{name}_stop")):
                table[name] = worst.value
                table[f"{name}_at_s"] = worst.time
                table[f"{name}_detail"] = worst.detail
        if "GN" in table:
            table["tipping_margin_Nm"] = moment_at(table["GN"], footing.tip_over.reference_moment)
        return table

    def violations(self) -> list[Worst]:
        """None: the check says so."""
        return []


def _if_alike(share: float) -> dict[str, Any]:
    """The entry on equally compliant feet; none where only the best sharing of the load counts."""
    return {} if np.isnan(share) else {ALIKE: share}


def of_objects(interfaces: Sequence[Footing], rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The entry of the worst values on objects, by name; none without objects."""
    names = (interface.name for interface in interfaces[1:])
    return {"objects": dict(zip(names, rows, strict=True))} if rows else {}


class JointTable(ABC):
    """Stops in which every joint stops by itself.

    Args:
        robot, motion, limits: whose.
        rule: how joints stop, and what stops have to keep.
        stops: begun at instants, s, of each interface.
        checks: that find them, one of each interface.
        times: of the table.
    """

    words = ""

    def __init__(
        self,
        robot: Robot,
        motion: Trajectory,
        limits: Limits,
        rule: Brakes | Cancel,
        stops: Sequence[tuple[np.ndarray, JointStops]],
        checks: Sequence[BrakeCheck | CancelCheck],
        times: np.ndarray,
    ) -> None:
        self._robot, self._motion, self._limits, self._rule = robot, motion, limits, rule
        self._checks, ((self._times, self._found), *self._of_objects) = checks, stops
        q, qd, _ = motion.states(times)
        process = robot.during(motion).acting(times)
        given = [q, qd, process, *([times] if isinstance(rule, Cancel) else [])]
        runs = [check.stops(*given) for check in checks]
        self.durations = runs[0].rests
        self.speeds = self._safe(given, self._kept(runs))

    def _kept(self, stops: Sequence[JointStops]) -> np.ndarray:
        """(N,) whether all contacts are kept, and everything comes to rest."""
        kept = [
            (stop.GN <= self._rule.GN) & (stop.GT <= self._rule.GT) & np.isfinite(stop.rests)
            for stop in stops
        ]
        return np.all(kept, axis=0)

    def _safe(self, given: Sequence[np.ndarray], kept: np.ndarray) -> np.ndarray:
        """Largest shares of the speed by halving; 0 where even the smallest checked one is not safe."""
        todo, safe = np.flatnonzero(~kept), np.ones(len(kept))
        q, qd, *more = (part[todo] for part in given)

        def fine(shares: np.ndarray) -> np.ndarray:
            states = q, shares[:, None] * qd, *more
            return self._kept([check.stops(*states) for check in self._checks])

        safe[todo], _ = borders(fine, np.zeros(len(todo)), np.ones(len(todo)), LEVELS)
        return safe

    def worst(self) -> dict[str, Any]:
        """Values and where they are."""
        result, units, interfaces = self._found, self._robot.units, self._robot.interfaces
        base, i = self._worst_of(interfaces[0], self._times, result)
        pairs = zip(interfaces[1:], self._of_objects, strict=True)
        objects = [self._worst_of(footing, *stops)[0] for footing, stops in pairs]
        over, joint = result.farthest
        displacements = [
            float(way) if unit == "m" else float(np.rad2deg(way))
            for way, unit in zip(np.max(result.displacements, axis=0), units, strict=True)
        ]
        return {
            **base,
            **self._more(i),
            "longest_stop_s": float(np.max(result.rests)) if np.isfinite(result.rests).all() else None,
            "ways": {"values": displacements, "units": ["m" if unit == "m" else "deg" for unit in units]},
            "beyond_angle_limit": max(over, 0.0),
            "joint_nearest_its_limit": joint + 1,
            "clearance_m": result.clearance if np.isfinite(result.clearance) else None,
            "postures_looked_at": result.postures,
            **of_objects(interfaces, objects),
        }

    def _worst_of(self, footing: Footing, times: np.ndarray, stops: JointStops) -> tuple[dict[str, Any], int]:
        """Values of the contacts, and the number of the worst stop."""
        i, greatest = int(np.argmax(np.maximum(stops.GN, stops.GT))), float(np.max(stops.GN))
        return {
            "GN": greatest,
            "GT": float(np.max(stops.GT)),
            "tipping_margin_Nm": moment_at(greatest, footing.tip_over.reference_moment),
            "begun_s": float(times[i]),
            "after_s": float(stops.after[i]),
            **_if_alike(stops.alike),
        }, i

    def _more(self, i: int) -> dict[str, Any]:
        """Further entries, and those of the worst stop."""
        return {}

    def violations(self) -> list[Worst]:
        """The broken limits."""
        result, further = self._found, self._own_violations()
        further += broken_postures(self._robot, self._times, result, self._limits, self.words)
        every = zip(self._robot.interfaces, ((self._times, result), *self._of_objects), strict=True)
        contacts = [
            broken
            for footing, stops in every
            for broken in broken_contacts(footing, *stops, self._rule, self.words)
        ]
        return [*contacts, *further] if not self._in_check else further

    @property
    @abstractmethod
    def _in_check(self) -> bool:
        """The check of the motion says which limits of the contacts are broken."""

    @abstractmethod
    def _own_violations(self) -> list[Worst]:
        """Broken limits that only this scenario has."""


class BrakeTable(JointTable):
    """Stops by brakes."""

    words = BRAKES

    def __init__(
        self, robot: Robot, motion: Trajectory, limits: Limits, brakes: Brakes, times: np.ndarray
    ) -> None:
        every = range(len(robot.interfaces))
        results = [stops_of_motion(robot, motion, brakes, interface=interface) for interface in every]
        checks = [BrakeCheck(robot, brakes, interface) for interface in every]
        super().__init__(robot, motion, limits, brakes, results, checks, times)
        self._least = np.array(brakes.least)

    @property
    def _in_check(self) -> bool:
        return self._limits.brakes is not None

    def _more(self, i: int) -> dict[str, Any]:
        return {"brake_torques": self._found.torques[i].tolist()}

    def _own_violations(self) -> list[Worst]:
        rests, texts = self._found.rests, self._too_weak()
        if not np.isfinite(rests).all() and not self._limits.brakes:
            i = int(np.argmax(rests))
            texts = [f"brakes that close at {self._times[i]:.4f} s do not bring the arm to rest", *texts]
        return [statement(text) for text in texts]

    def _too_weak(self) -> list[str]:
        """The brake that holds the smallest share of the torque at rest, if that is below 1; else empty."""
        robot, times = self._robot, self._times
        q = self._motion.states(times)[0]
        asked, _ = robot.loads(q, 0 * q, 0 * q, robot.during(self._motion).acting(times))
        i, joint = np.unravel_index(np.argmax(np.abs(asked) / self._least), asked.shape)
        needs, unit = float(abs(asked[i, joint])), robot.motor_units[joint]
        if needs <= self._least[joint]:
            return []
        return [
            f"the arm drops: at {times[i]:.4f} s joint {joint + 1} needs {needs:.4g} {unit} to rest, its "
            f"brake holds {self._least[joint]:.4g}"
        ]


class CancelTable(JointTable):
    """Stops by a controller that is cancelled."""

    words = CANCEL

    def __init__(
        self, robot: Robot, motion: Trajectory, limits: Limits, cancel: Cancel, times: np.ndarray
    ) -> None:
        every = range(len(robot.interfaces))
        results = [cancelled_motion(robot, motion, cancel, interface) for interface in every]
        checks = [CancelCheck(robot, cancel, interface=interface) for interface in every]
        super().__init__(robot, motion, limits, cancel, results, checks, times)
        self._cancel, self._within, self._alike = cancel, dict[str, WorstInstant](), dict[str, float]()
        self.durations = self.durations + cancel.reaction
        for interface, footing in enumerate(robot.interfaces if limits.tolerance.given else ()):
            cases = worst_case_of(robot, limits.tolerance, interface)
            worst = worst_of_cancels(cases, motion, cancel, cancel_times(motion))
            for name, instant in zip(WITHIN_OF, worst, strict=True):
                if instant is not None:
                    self._within[footing.result(name)] = instant
            if alike := alike_of_cancels(cases, motion, cancel, cancel_times(motion)):
                self._alike[footing.name] = alike.value

    @property
    def _in_check(self) -> bool:
        return self._limits.cancel is not None

    def _worst_of(self, footing: Footing, times: np.ndarray, stops: JointStops) -> tuple[dict[str, Any], int]:
        """The same, and what the contacts have within the uncertainty."""
        worst, i = super()._worst_of(footing, times, stops)
        for name in WITHIN_OF:
            if when := self._within.get(footing.result(name)):
                worst[f"{name}_within"] = when.most
                if name == "GN":
                    reference = footing.tip_over.reference_moment
                    worst["tipping_margin_within_Nm"] = moment_at(when.most, reference)
        if (alike := self._alike.get(footing.name)) is not None:
            worst[f"{ALIKE}_within"] = alike
        return worst, i

    def _more(self, i: int) -> dict[str, Any]:
        result, robot, cancel = self._found, self._robot, self._cancel
        margins = Margins.under(result.wrenches, robot.tip_over, robot.slip)
        force = float(np.min(margins.min_foot_force))
        return {
            "deceleration": list(cancel.decelerations),
            "reaction_s": cancel.reaction,
            "tipping_margin_Nm": float(np.min(margins.tipping_moment)),
            "foot_force_N": force if np.isfinite(force) else None,
            "torque_ratio": float(np.max(result.drives)),
            **{f"{name[:2]}_worst_case{name[2:]}": when.to_dict() for name, when in self._within.items()},
        }

    def _own_violations(self) -> list[Worst]:
        stops = self._times, self._found
        if self._in_check:
            return broken_drives(*stops)
        within = broken_within(self._within, self._limits)
        return [*within, *broken_drives(*stops), *broken_duration(*stops, self._cancel)]
