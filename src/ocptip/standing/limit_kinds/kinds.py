"""The kinds of limits of a standing mechanism. A new kind is one class here and one line in `KINDS`.

A kind that needs a new number adds a field to `standing.limits.Limits`, as `AskedLimit` says.
"""

from __future__ import annotations

import numpy as np

from ocptip.standing.instants import Instants, NodeColumns
from ocptip.standing.limit_kinds.clearance import ClearanceLimit, LateClearanceLimit
from ocptip.standing.limit_kinds.elastic import (
    FootForceLimit,
    FootLiftLimit,
    JumpFootForceLimit,
    RingingLimit,
)
from ocptip.standing.limit_kinds.jumps import JumpLimit
from ocptip.standing.limit_kinds.limit import (
    TOLERANCE,
    WHOLE,
    AskedLimit,
    InstantAt,
    Limit,
    QuantityLimit,
    Sampled,
    StateLimit,
    Worst,
)
from ocptip.standing.limit_kinds.nominal import NominalLimit
from ocptip.standing.limit_kinds.rows import Curvature, NodeRows, RowNodes
from ocptip.standing.limit_kinds.stops import BrakeLimit, CancelLimit, StopLimit, cancel_of
from ocptip.standing.limit_kinds.worst_cancels import WorstCancelLimit
from ocptip.standing.limit_kinds.worst_case import WorstCaseLimit, WorstTorqueLimit
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.by_cancel import cancel_times

RESTS_INSIDE = 1e-4  # rad or m, by which programs keep joints that are cancelled further inside
FURTHER_INSIDE = 1e-4  # distance in their units with which programs keep further limits: rounding


class TorqueLimit(QuantityLimit, AskedLimit):
    """Torques of the joints, or forces of linear motors, as shares of the motors' limits."""

    name, result, setting = "torque", "torque_ratio", "torque_ratio"
    affine = True

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        self.units, self.width = robot.limits.torque, robot.n

    def measure(self, instants: Instants) -> np.ndarray:
        return np.max(np.abs(instants.torques) / self.units, axis=1)[:, None]

    def detail(self, instant_at: InstantAt, time: float) -> str:
        return self.robot.joint_label(int(np.argmax(np.abs(instant_at(time).torques[0]) / self.units)))

    def refusals(self, instants: Instants) -> list[str]:
        robot, torques, allowed = self.robot, np.abs(instants.torques[0]), self.number * self.units
        return [
            f"{robot.joint_label(int(j))} needs {torques[j]:.4g} {robot.motor_units[j]} to hold the "
            f"{robot.kind}, must be <= {allowed[j]:.4g}"
            for j in np.flatnonzero(torques > allowed)
        ]

    def path_excess(self, instants: Instants) -> float:
        return np.max(np.abs(instants.torques) / self.units) / self.number - 1

    def uses(self, instants: Instants) -> np.ndarray:
        return np.abs(instants.torques) / self.units / self.number

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        allowed = np.full(self.width, self.number)
        return -allowed, allowed

    def first(self, columns: NodeColumns) -> int:
        return columns.torque.start


class PeakLimit(Limit):
    """Maximum speeds or accelerations: a motion knows them exactly, programs have them in the structure."""

    scenario = WHOLE

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        motion = sampled.motion
        ratio = getattr(motion, f"{self.name}_peaks") / getattr(self.robot.limits, self.name)
        j = int(np.argmax(ratio))
        value = float(ratio[j])
        excess = value - 1 - motion.peak_rounding
        return [Worst(f"{self.name}_ratio", value, np.nan, 1.0, self.robot.joint_label(j), excess)]


class SpeedLimit(PeakLimit):
    """Maximum speeds of the joints."""

    name = "speed"


class AccelerationLimit(PeakLimit):
    """Maximum accelerations of the joints."""

    name = "acceleration"


class JerkLimit(PeakLimit):
    """Maximum jerks of the joints, where such limits exist; see `Trajectory.largest_jerks`."""

    name = "jerk"

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return bool(np.isfinite(asked.jerks(robot.limits)).any())

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        motion, jerks = sampled.motion, self.asked.jerks(self.robot.limits)
        ratio = np.divide(motion.largest_jerks, jerks, out=np.zeros(len(jerks)), where=np.isfinite(jerks))
        j = int(np.argmax(ratio))
        value, more = float(ratio[j]), motion.jerk_source
        if value == np.inf:
            step, turns = motion.acceleration_steps[j], self.robot.units[j] == "rad"
            size = f"{np.rad2deg(step):.4g} deg" if turns else f"{step:.4g} m"
            more = f"its acceleration steps by up to {size}/s^2"
        detail = ", ".join(filter(None, (self.robot.joint_label(j), more)))
        return [Worst("jerk_ratio", value, np.nan, 1.0, detail, value - 1 - motion.jerk_rounding)]


class DurationLimit(Limit):
    """Duration of the motion; programs have it as bounds of the end time."""

    name = "duration"
    scenario = WHOLE

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        end, least, most = sampled.motion.end, self.asked.min_duration, self.asked.max_duration
        if least == 0 and most == np.inf:
            return []
        early = least - end > end - most
        bound, excess = (least, least - end) if early else (most, end - most)
        return [Worst("duration_s", end, np.nan, bound, "", excess, least=early)]


class AngleLimit(Limit):
    """Angles of the joints, or a platform's coordinates; a motion knows its extremes exactly."""

    name = "angle"
    scenario = WHOLE
    of_place = True
    reach = 0.2

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        self.width = robot.n
        self._units = np.array(robot.units)
        self._margin = np.where(self._units == "rad", asked.angle_margin, 0.0)
        self._low, self._high = robot.limits.angle_min + self._margin, robot.limits.angle_max - self._margin

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        low, high = sampled.motion.angle_ranges.T
        return self._worst(np.minimum(low - self._low, self._high - high)[None], np.array([np.nan]))

    def _worst(self, slack: np.ndarray, times: np.ndarray, suffix: str = "") -> list[Worst]:
        """The joint with the minimum slack (T, n) of those that turn, and of those that slide."""
        results = []
        for unit, name, scale in (("rad", "angle_margin_deg", 180 / np.pi), ("m", "position_margin_m", 1.0)):
            if (joints := np.flatnonzero(self._units == unit)).size:
                row, place = np.unravel_index(np.argmin(slack[:, joints]), (len(slack), len(joints)))
                j = int(joints[place])
                least, short = float(scale * self._margin[j]), -float(scale * slack[row, j])
                where = self.robot.joint_label(j)
                time = (
                    float(times[row]) if np.isfinite(times[row]) else np.nan
                )  # one NaN: results compare equal
                results.append(Worst(f"{name}{suffix}", least - short, time, least, where, short, least=True))
        return results

    def refusals(self, instants: Instants) -> list[str]:
        q, results = instants.angles[0], []
        for j in np.flatnonzero((q < self._low - TOLERANCE) | (q > self._high + TOLERANCE)):
            values, unit, digits = (q[j], self._low[j], self._high[j]), "m", 4
            if self.robot.units[j] == "rad":
                values, unit, digits = np.rad2deg(values), "degrees", 2
            here, least, greatest = (f"{value:.{digits}f}" for value in values)
            less = " less angle_margin" if self._margin[j] > 0 else ""
            results.append(
                f"{self.robot.joint_label(int(j))} at {here} {unit} is outside its limits{less} "
                f"{least} to {greatest}"
            )
        return results

    def uses(self, instants: Instants) -> np.ndarray:
        uses = super().uses(instants)
        uses[:, self.joints] = self._beyond(instants.angles)[:, self.joints]
        return uses

    def _beyond(self, q: np.ndarray) -> np.ndarray:
        """(N, n): 1 at the limit."""
        return 1 + np.maximum(self._low - q, q - self._high)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self._low, self._high

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        return NodeRows(row_nodes, i, k, row_nodes.s[i, k])

    def jacobian(self, rows: NodeRows) -> np.ndarray:
        return rows.at.by_states(rows.nodes, np.eye(rows.at.s.shape[1])[rows.places])

    def add_hessian(self, rows: NodeRows, on: np.ndarray, H: Curvature, on_s: np.ndarray) -> None:
        on_s[rows.nodes, rows.places] += on


class CancelAngleLimit(StateLimit, AngleLimit):
    """Angles at which joints rest after the motion is cancelled: q + qd |qd| / (2 a), a the deceleration.

    Programs take it as constant, which it is unless joints come to rest together.

    The nominal motion; a joint that is faster within an uncertainty gets farther.
    """

    name = "angle in cancels"
    of_motion = of_place = False

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return CancelLimit.wanted(robot, asked)

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        self._rates = cancel_of(robot, asked)[1].rates

    def _rests(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """(N, n), where joints come to rest."""
        return q + qd * np.abs(qd) / (2 * self._rates(qd))

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        times = cancel_times(sampled.motion)
        rests = self._rests(*sampled.motion.states(times)[:2])
        return self._worst(np.minimum(rests - self._low, self._high - rests), times, "_cancel")

    def refusals(self, instants: Instants) -> list[str]:
        return []

    def uses(self, instants: Instants) -> np.ndarray:
        return self._beyond(self._rests(instants.angles, instants.speeds))

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self._low + RESTS_INSIDE, self._high - RESTS_INSIDE

    def bounds_of(self, rows: NodeRows) -> tuple[np.ndarray, np.ndarray]:
        # A joint that starts or ends at an end stop rests there: half of its distance is enough.
        q, k = rows.at.motion_states[0][rows.nodes, rows.places], rows.places
        low, high = self._low[k], self._high[k]
        below, above = (np.clip(left / 2, 0.0, RESTS_INSIDE) for left in (q - low, high - q))
        return low + below, high - above

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        n, count = self.robot.n, np.arange(len(i))
        q, qd, _ = row_nodes.motion_states
        slopes = np.zeros((len(i), row_nodes.s.shape[1]))
        slopes[count, k], slopes[count, n + k] = 1.0, np.abs(qd[i, k]) / self._rates(qd[i])[count, k]
        return NodeRows(row_nodes, i, k, self._rests(q[i], qd[i])[count, k], slopes)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        count, k, size = np.arange(len(rows.nodes)), rows.places, rows.at.s.shape[1]
        qd, column = rows.at.motion_states[1][rows.nodes], self.robot.n + k
        bends = np.zeros((len(count), size, size))
        bends[count, column, column] = on * np.sign(qd[count, k]) / self._rates(qd)[count, k]
        return count, bends


class CancelDurationLimit(StateLimit):
    """Time from a cancel until everything rests, exact by the peaks of speeds. Rows are speeds, as shares of
    those that stop in time.
    """

    name = "duration of cancels"
    scenario = WHOLE
    of_motion = False

    @classmethod
    def wanted(cls, robot: StandingMechanism, asked: Limits) -> bool:
        return CancelLimit.wanted(robot, asked)

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        self._cancel, self.width = cancel_of(robot, asked)[1], robot.n
        self._rates = np.array(self._cancel.decelerations)
        self._fastest = self._rates * (self._cancel.longest - self._cancel.reaction)

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        lasts, longest = (
            sampled.motion.speed_peaks / self._rates + self._cancel.reaction,
            self._cancel.longest,
        )
        j = int(np.argmax(lasts))
        value, joint = float(lasts[j]), self.robot.joint_label(j)
        return [Worst("duration_s_cancel", value, np.nan, longest, joint, value - longest)]

    def uses(self, instants: Instants) -> np.ndarray:
        return np.abs(instants.speeds) / self._fastest

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        most = np.full(self.width, 1 - FURTHER_INSIDE)
        return -most, most

    def rows_at(self, row_nodes: RowNodes, i: np.ndarray, k: np.ndarray) -> NodeRows:
        slopes = np.zeros((len(i), row_nodes.s.shape[1]))
        slopes[np.arange(len(i)), self.robot.n + k] = 1 / self._fastest[k]
        return NodeRows(row_nodes, i, k, row_nodes.motion_states[1][i, k] / self._fastest[k], slopes)

    def curvature(self, rows: NodeRows, on: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.empty(0, dtype=int), np.empty((0, rows.at.s.shape[1], rows.at.s.shape[1]))


class FurtherLimit(QuantityLimit):
    """Further limits of the mechanism, see `FurtherLimits`."""

    name = "further"

    def __init__(self, robot: StandingMechanism, asked: Limits, joints: tuple[int, ...]) -> None:
        super().__init__(robot, asked, joints)
        self._own = further_limits = robot.further_limits
        self.units, self.width = further_limits.units, further_limits.count

    def measure(self, instants: Instants) -> np.ndarray:
        return self._own.excess(instants.further)

    def worst(self, values: np.ndarray, sampled: Sampled) -> list[Worst]:
        points, results = self._own, []
        for name in dict.fromkeys(points.names):
            columns = [k for k in range(points.count) if points.names[k] == name and points.limited[k]]
            if columns:
                chosen = values[:, columns]
                row, column = np.unravel_index(np.argmax(chosen), chosen.shape)
                k, excess = columns[column], float(chosen[row, column])
                value, limit, least = points.described(k, excess)
                results.append(
                    Worst(name, value, float(sampled.times[row]), limit, points.details[k], excess, least)
                )
        return results

    def refusals(self, instants: Instants) -> list[str]:
        points, excess, results = self._own, self.measure(instants)[0], []
        for k in np.flatnonzero(excess > 0).tolist():
            value, limit, least = points.described(k, float(excess[k]))
            sign = ">=" if least else "<="
            results.append(
                f"{points.names[k]} of {points.details[k]} is {value:.4g}, must be {sign} {limit:.4g}"
            )
        return results

    def path_excess(self, instants: Instants) -> float:
        return float(np.max(self.measure(instants), initial=-np.inf))

    def uses(self, instants: Instants) -> np.ndarray:
        return 1 + self.measure(instants)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        points = self._own
        return points.lower / points.units + FURTHER_INSIDE, points.upper / points.units - FURTHER_INSIDE

    def first(self, columns: NodeColumns) -> int:
        return columns.further.start


KINDS: tuple[type[Limit], ...] = (
    NominalLimit,
    JumpLimit,
    StopLimit,
    BrakeLimit,
    CancelLimit,
    TorqueLimit,
    ClearanceLimit,
    LateClearanceLimit,
    SpeedLimit,
    AccelerationLimit,
    JerkLimit,
    DurationLimit,
    AngleLimit,
    CancelAngleLimit,
    CancelDurationLimit,
    FurtherLimit,
    WorstCaseLimit,
    WorstTorqueLimit,
    WorstCancelLimit,
    FootForceLimit,
    JumpFootForceLimit,
    FootLiftLimit,
    RingingLimit,
)


def limits_of(
    robot: StandingMechanism, asked: Limits, joints: tuple[int, ...] | None = None
) -> tuple[Limit, ...]:
    """All limits of each kind that is asked for.

    Args:
        robot: whose.
        asked: the task's numbers.
        joints: coordinates that are optimised, 0-based; default all.
    """
    joints = tuple(range(robot.n)) if joints is None else joints
    wanted = (kind for kind in KINDS if kind.wanted(robot, asked))
    return tuple(limit for kind in wanted for limit in kind.of(robot, asked, joints))
