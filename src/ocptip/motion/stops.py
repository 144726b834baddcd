"""Stops of a motion, begun at any instant: along its path (category 1 and 2) and by brakes (category 0).

Categories of IEC 60204-1: 0 takes the drives' power away at once, 1 after a controlled stop, 2 leaves it on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.motion.check import MotionCheck
from ocptip.motion.cycles.check import CycleCheck
from ocptip.motion.cycles.task import Task
from ocptip.motion.path_stops import StoppedPath
from ocptip.motion.stop_rules import BRAKES, HOLDING, Kinds, StopRules
from ocptip.motion.task import MotionTask
from ocptip.numerics.threads import one_thread
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.by_brakes import BrakeCheck, Brakes, BrakeStops, stops_of_motion
from ocptip.trajectories.trajectory import Trajectory

ROWS = 12  # of the table
LEVELS = 5  # halvings of the speed's share for brakes
_CLOSE = 1e-9
_OF_STOPS = "GN_stop", "GT_stop", "GN_brakes", "GT_brakes"


@dataclass(frozen=True, eq=False)
class Stops:
    """What was found about the stops of a motion.

    Attributes:
        kinds: "path", "brakes" or "both": which were looked at.
        verified: no stop breaks a limit.
        violations: one sentence per broken limit of stops by brakes (those along the path are in the check).
        worst: by category ("path", "brakes"), plain data with units in the keys: `GN`, `GT`, `begun_s`,
            `after_s`, ...
        times: (K,), s: instants of the table.
        path_speeds, brake_speeds: (K,), largest safe share of the planned speed, at most 1, for stops along
            the path and by brakes begun there; None if not checked.
        path_times, brake_times: (K,), s, that stops from the planned speed take.
        curve: (2, M): times, s, and shares for stops along the path at all places looked at; for figures.
        assumed: what was assumed, one sentence each.
    """

    kinds: Kinds
    verified: bool
    violations: tuple[str, ...]
    worst: dict[str, dict[str, Any]]
    times: np.ndarray
    path_speeds: np.ndarray | None
    brake_speeds: np.ndarray | None
    path_times: np.ndarray | None
    brake_times: np.ndarray | None
    curve: np.ndarray | None
    assumed: tuple[str, ...]

    @property
    def found(self) -> list[str]:
        """In words: the worst of each category."""
        found = []
        if path := self.worst.get("path"):
            least = (
                ""
                if self.path_speeds is None
                else f", safe up to {np.min(self.path_speeds):.2f} of the speed"
            )
            longest = f"rests within {path['longest_stop_s']:.3f} s"
            values = ", ".join(f"{name} at most {path[name]:.3f}" for name in ("GN", "GT") if name in path)
            found.append(f"along the path (category 1 and 2): {values}, {longest}{least}")
        if brakes := self.worst.get("brakes"):
            found.append(
                f"by brakes (category 0): GN at most {brakes['GN']:.3g}, GT {brakes['GT']:.3g}, worst when "
                f"stopped at {brakes['begun_s']:.3f} s (after {brakes['after_s']:.3f} s)"
            )
        return found

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        columns = {
            "time_s": self.times,
            "path_safe_speed": self.path_speeds,
            "path_stop_s": self.path_times,
            "brakes_safe_speed": self.brake_speeds,
            "brakes_stop_s": self.brake_times,
        }
        known = {
            name: [value if np.isfinite(value) else None for value in values.tolist()]
            for name, values in columns.items()
            if values is not None
        }
        table = [dict(zip(known, row, strict=True)) for row in zip(*known.values(), strict=True)]
        return {
            "kinds": self.kinds,
            "verified": self.verified,
            "violations": list(self.violations),
            "worst": self.worst,
            "safe_speed_by_time": table,
            "assumed": list(self.assumed),
        }


@one_thread
def check_stops(
    robot: StandingMechanism,
    motion: Trajectory,
    limits: Limits,
    rules: StopRules,
    checked: MotionCheck,
    kinds: Kinds = "both",
) -> Stops:
    """Look at stops of a motion.

    Args:
        robot, motion: whose.
        limits: of the motion, with stops along the path unless `kinds` is "brakes": see `StopRules.asked`.
        rules: how it is stopped.
        checked: the motion's check under these limits, which has looked at stops that they ask for.
        kinds: along the path, by brakes (arms only), or both.

    Raises:
        InputError: brake torques are missing or too many, or nothing bounds the deceleration.
    """
    times = np.linspace(0, motion.end, ROWS + 1)[:-1] + motion.end / (2 * ROWS)
    worst: dict[str, dict[str, Any]] = {}
    path = brakes = None
    if kinds != "brakes":
        path = _PathTable(robot, motion, limits, times)
        worst["path"] = path.worst(checked)
    lacking = "" if kinds == "path" or limits.brakes else rules.lacking(robot)
    if kinds != "path" and isinstance(robot, Robot) and not lacking:
        asked = limits.brakes or rules.safe(limits, robot, "brakes").brakes
        assert asked is not None
        brakes = _BrakeTable(robot, motion, limits, asked, rules.guessed, times)
        worst["brakes"] = brakes.worst()
    stops = limits.stops
    violations = brakes.violations() if brakes else (lacking,) if lacking else ()
    kept = all(checked.worst[name].excess <= _CLOSE for name in _OF_STOPS if name in checked.worst)
    return Stops(
        kinds=kinds,
        verified=kept and not violations,
        violations=violations,
        worst=worst,
        times=times,
        path_speeds=path and path.speeds,
        brake_speeds=brakes and brakes.speeds,
        path_times=path and path.durations,
        brake_times=brakes and brakes.durations,
        curve=path and path.curve,
        assumed=_assumed(robot, rules, kinds, lacking, 0.0 if stops is None else stops.time),
    )


def stops_of(
    task: MotionTask, motion: Trajectory, checked: MotionCheck, kinds: Kinds | None = None
) -> Stops | None:
    """Stops of the kinds asked for, or else of those that the task's limits ask for; else None."""
    limits = task.limits
    if kinds is None:
        if not limits.stoppable:
            return None
        kinds = "path" if limits.brakes is None else "brakes" if limits.stops is None else "both"
    if limits.stops is None and kinds != "brakes":
        limits = task.stops.asked(limits)
    return check_stops(task.robot, motion, limits, task.stops, checked, kinds)


def stops_by_segment(
    task: Task, motion: Trajectory, checked: CycleCheck, kinds: Kinds | None = None
) -> dict[str, Stops]:
    """The same by the names of segments, in their own times; the name of a motion is empty."""
    rows = zip(task.segments, motion.segments, checked.segments, strict=True)
    found = {segment.name: stops_of(segment.task, own, check, kinds) for segment, own, check in rows}
    return {name: stops for name, stops in found.items() if stops}


def stops_to_dict(task: Task, stops: Mapping[str, Stops]) -> dict[str, Any]:
    """An entry for JSON: of a motion, or of a cycle one by segment; none if they were not asked for."""
    if not stops:
        return {}
    rows = [{"segment": name, **own.to_dict()} for name, own in stops.items()]
    return {"stops": rows if task.is_cycle else stops[""].to_dict()}


class _PathTable:
    """Stops along the path."""

    def __init__(
        self, robot: StandingMechanism, motion: Trajectory, limits: Limits, times: np.ndarray
    ) -> None:
        self._path = StoppedPath(robot, motion, limits)
        safe = self._path.safe_speeds()
        self.curve = np.array([self._path.places, safe])
        self.speeds = np.interp(times, self._path.places, safe)
        self.durations = np.array([self._path.stop(t).times[-1] for t in times])

    def worst(self, checked: MotionCheck) -> dict[str, Any]:
        """Of the check: values, and when the stop passes there."""
        found: dict[str, Any] = {"longest_stop_s": float(np.max(self.durations))}
        for name in ("GN", "GT"):
            if worst := checked.worst.get(f"{name}_stop"):
                found[name] = worst.value
                found[f"{name}_at_s"] = worst.time
                found[f"{name}_detail"] = worst.detail
        return found


class _BrakeTable:
    """Stops by brakes."""

    def __init__(
        self,
        robot: Robot,
        motion: Trajectory,
        limits: Limits,
        brakes: Brakes,
        guessed: bool,
        times: np.ndarray,
    ) -> None:
        self._robot, self._limits, self._brakes, self._guessed = robot, limits, brakes, guessed
        self._check = BrakeCheck(robot, brakes)
        self._motion = motion
        self._times, self._found = stops_of_motion(robot, motion, brakes)
        q, qd, _ = motion.states(times)
        process = robot.during(motion).acting(times)
        own = self._check.stops(q, qd, process)
        self.durations = own.rests
        self.speeds = self._safe(q, qd, process, self._kept(own))

    def _kept(self, found: BrakeStops) -> np.ndarray:
        return (found.GN <= self._brakes.GN) & (found.GT <= self._brakes.GT) & np.isfinite(found.rests)

    def _safe(self, q: np.ndarray, qd: np.ndarray, process: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Largest shares of the speed found by halving; 0 where even the least one looked at is not safe."""
        low, high = np.where(kept, 1.0, 0.0), np.ones(len(q))
        todo = np.flatnonzero(~kept)
        for _ in range(LEVELS if len(todo) else 0):
            middle = 0.5 * (low[todo] + high[todo])
            fine = self._kept(self._check.stops(q[todo], middle[:, None] * qd[todo], process[todo]))
            low[todo], high[todo] = np.where(fine, middle, low[todo]), np.where(fine, high[todo], middle)
        return low

    def worst(self) -> dict[str, Any]:
        """Values and where they are."""
        found, units = self._found, self._robot.units
        i = int(np.argmax(np.maximum(found.GN, found.GT)))
        over, joint = found.outside
        ways = [
            float(way) if unit == "m" else float(np.rad2deg(way))
            for way, unit in zip(np.max(found.ways, axis=0), units, strict=True)
        ]
        return {
            "GN": float(np.max(found.GN)),
            "GT": float(np.max(found.GT)),
            "begun_s": float(self._times[i]),
            "after_s": float(found.after[i]),
            "brake_torques": found.torques[i].tolist(),
            "longest_stop_s": float(np.max(found.rests)) if np.isfinite(found.rests).all() else None,
            "ways": {"values": ways, "units": ["m" if unit == "m" else "deg" for unit in units]},
            "beyond_angle_limit": max(over, 0.0),
            "joint_nearest_its_limit": joint + 1,
            "clearance_m": found.clearance if np.isfinite(found.clearance) else None,
            "postures_looked_at": found.postures,
        }

    def _too_weak(self) -> list[str]:
        """The brake that holds least of what is asked for at rest, if that is less than all; empty: none."""
        robot, times = self._robot, self._times
        q = self._motion.states(times)[0]
        asked, _ = robot.loads(q, 0 * q, 0 * q, robot.during(self._motion).acting(times))
        holds = np.array(self._brakes.least)
        i, joint = np.unravel_index(np.argmax(np.abs(asked) / holds), asked.shape)
        needs, unit = float(abs(asked[i, joint])), robot.motor_units[joint]
        if needs <= holds[joint]:
            return []
        return [
            f"the arm drops: at {times[i]:.4f} s joint {joint + 1} needs {needs:.4g} {unit} to rest, its "
            f"brake holds {holds[joint]:.4g}"
        ]

    def violations(self) -> tuple[str, ...]:
        """One sentence per broken limit."""
        brakes, found, said = self._brakes, self._found, []
        reserves = (("GN", found.GN, brakes.GN), ("GT", found.GT, brakes.GT))
        for name, values, limit in () if self._limits.brakes else reserves:  # else the check says so
            i = int(np.argmax(values))
            if not values[i] <= limit:
                said.append(
                    f"{name} is {values[i]:.4g} in a stop by brakes begun at {self._times[i]:.4f} s, "
                    f"must be <= {limit:.4g}{' (brake torques are a guess)' if self._guessed else ''}"
                )
        if not np.isfinite(found.rests).all() and not self._limits.brakes:
            i = int(np.argmax(found.rests))
            said.append(f"brakes that close at {self._times[i]:.4f} s do not bring the arm to rest")
        said += self._too_weak()
        over, joint = found.outside
        if over > _CLOSE:
            said.append(f"joint {joint + 1} leaves its limits by {over:.3g} {self._robot.units[joint]}")
        if found.clearance < self._limits.clearance:
            gap, asked = 1e3 * found.clearance, 1e3 * self._limits.clearance
            said.append(f"clearance is {gap:.1f} mm in a stop by brakes, must be >= {asked:.1f} mm")
        return tuple(said)


def _assumed(
    robot: StandingMechanism, rules: StopRules, kinds: Kinds, lacking: str, time: float
) -> tuple[str, ...]:
    said = []
    if robot.support.elastic is not None:
        said.append("compliant feet: their forces and lifts during stops are not checked, only GN and GT")
    if kinds != "brakes":
        hardest = "as hard as limits of torque and acceleration allow, and all gentler ones"
        if time > 0:
            hardest = f"from full speed to rest in {time:g} s or more within the drives' limits"
        said.append(f"category 1 and 2: stops along the path, {hardest}; every instant of the check")
    if kinds == "path":
        return (*said, "category 0 (brakes) not checked")
    if not isinstance(robot, Robot):
        return (*said, "category 0: not computed for parallel robots")
    if lacking:
        return (*said, lacking)
    given = "as given"
    if rules.guessed:
        given = (
            f"{BRAKES[0]:g} to {BRAKES[1]:g} times the torque limits, a guess, at least {HOLDING:g} times "
            "what gravity asks in any posture; give brake_torque_min_Nm, _max_Nm in [stops]"
        )
    delay = "at once" if rules.delay[1] == 0 else f"after {rules.delay[0]:g} to {rules.delay[1]:g} s"
    said.append(f"category 0: brakes act {delay}, their torques are {given}; constant torques while braking")
    if robot.varying is not None:
        said.append("category 0: what acts on the gripper stays what it is when the stop begins")
    if not robot.arm.may_collide:
        said.append("category 0: collisions not checked, no collision geometry")
    return tuple(said)
