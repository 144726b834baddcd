"""Stops by a cancelled trajectory: every joint decelerates at a constant rate, then holds.

- ros2_controllers 6.9.0, joint_trajectory_controller.cpp, `decelerate_to_hold_position`
  (`constraints.decelerate_on_cancel`): each joint stops by itself after |v| / a. Without that option the
  drives are commanded the present position; the acceleration limits stand for how hard they brake.
- Universal_Robots_Client_Library 2.14.0, external_control.urscript, `stopj(4.0)`: all joints come to rest
  together on a straight line in joint space; the slowest has its rate, the others less.

Until the controller reacts the motion goes on as planned, so a stop begins in a state of the motion. Between
the stops of two joints all accelerations are constant. What acts on the base is evaluated on both sides of
every stop of a joint, and at `INSIDE` of each time in between.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, positive_number, share_of_one
from ocptip.numerics.batch import BatchFunction
from ocptip.standing.acting import BASE
from ocptip.standing.arm import Robot
from ocptip.standing.instants import wrench_expression, wrenches_on
from ocptip.standing.stops.joint_stops import JointStops, StopCheck, instants_of, without_creep
from ocptip.standing.within.deviations import Deviations
from ocptip.trajectories.trajectory import INSIDE as BESIDE
from ocptip.trajectories.trajectory import Trajectory

SPACING = 0.01  # s, between instants of a motion at which joints begin to decelerate
NEAR = 2e-3  # s: instants nearer to the last one that is kept are left out
PEAKS, FRESH, ROUNDS = 4, 7, 2  # of the refinement: worst instants, new ones on either side of each, rounds
INSIDE = np.array([0.0, 1 / 3, 2 / 3, 1.0])  # of each time between stops of joints; 0 and 1 are its two sides
SHORTEST = 1e-9  # s: times between stops of joints that are shorter have no states of their own
LONGEST = 2.0  # s
BASE_STEPS = 32  # of a drive profile that count after a cancel: those with the largest accelerations
_ENDING = 1e-9  # relative: just before a base has come to rest


@dataclass(frozen=True)
class Cancel:
    """The stops of a controller whose motion is cancelled, and the limits of these stops.

    Attributes:
        decelerations: n, rad/s^2 (sliding joints: m/s^2), of each joint until it rests.
        reaction: s, at most from the cancel until the joints decelerate.
        longest: s, at most from the cancel until everything rests.
        GN, GT: largest values during any stop, at most 1.
        together: all joints come to rest at the same time, and only one of them decelerates at its rate.
        base_deceleration: m/s^2, of a base that drives, from when the joints decelerate; 0: it drives on.
    """

    decelerations: tuple[float, ...]
    reaction: float = 0.0
    longest: float = LONGEST
    GN: float = 0.9
    GT: float = 0.9
    together: bool = False
    base_deceleration: float = 0.0

    def __post_init__(self) -> None:
        for name in ("GN", "GT"):
            share_of_one(f"cancel.{name}", getattr(self, name))
        for value in self.decelerations:
            positive_number("cancel.decelerations", value)
        positive_number("cancel.reaction", self.reaction, zero_allowed=True)
        positive_number("cancel.base_deceleration", self.base_deceleration, zero_allowed=True)
        if not positive_number("cancel.longest", self.longest) > self.reaction:
            raise InputError(
                f"cancel.longest: must be > the reaction time, {self.reaction:g} s, got {self.longest:g}"
            )

    def rates(self, qd: np.ndarray) -> np.ndarray:
        """(N, n), at which joints with speeds (N, n) decelerate."""
        speeds, most = np.abs(without_creep(qd)), np.array(self.decelerations)
        if not self.together:
            return np.broadcast_to(most, speeds.shape)
        longest = np.max(speeds / most, axis=1, keepdims=True)
        return np.divide(speeds, longest, out=np.tile(most, (len(qd), 1)), where=speeds > 0)

    def states(self, q: np.ndarray, qd: np.ndarray) -> StopStates:
        """States of stops from angles and speeds (N, n), see `stop_states`."""
        # Joints that rest together part a stop into nothing: as many instants as with n stops of joints.
        inside = np.linspace(0, 1, (len(INSIDE) - 1) * q.shape[1] + 1) if self.together else INSIDE
        return stop_states(q, qd, self.rates(qd), inside)

    def states_at(self, q: np.ndarray, qd: np.ndarray, owner: np.ndarray, after: np.ndarray) -> StopStates:
        """States of some of these stops, (M,), at times (M,), s, after their joints began to decelerate."""
        qd, rates = without_creep(qd)[owner], self.rates(qd)[owner]
        rests, slower = np.abs(qd) / rates, -np.sign(qd) * rates
        moves, way = rests > after[:, None] + SHORTEST, np.minimum(after[:, None], rests)
        steps, angles = np.ones(len(owner), dtype=bool), q[owner] + way * (qd + 0.5 * slower * way)
        speeds, accelerations = (np.where(moves, part, 0.0) for part in (qd + slower * way, slower))
        return StopStates(owner, after, steps, angles, speeds, accelerations, moves, np.zeros_like(way))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)


class StopStates(NamedTuple):
    """States during N stops: M rows.

    Attributes:
        owner: (M,) which stop.
        after: (M,), s, since the joints began to decelerate.
        before: (M,) True just before a joint rests, False just after, and in between.
        q, qd, qdd: (M, n).
        moves: (M, n) True for joints that still decelerate.
        weights: (M, n), of the times that the joints need, whose sum is `after`.
    """

    owner: np.ndarray
    after: np.ndarray
    before: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    moves: np.ndarray
    weights: np.ndarray


def stop_states(
    q: np.ndarray, qd: np.ndarray, decelerations: np.ndarray, inside: np.ndarray = INSIDE
) -> StopStates:
    """States of stops from angles and speeds (N, n) at decelerations (N, n); the last of each is at rest."""
    count, n = q.shape
    qd = without_creep(qd)
    rests = np.abs(qd) / decelerations  # (N, n), s
    order = np.argsort(rests, axis=1)
    ends = np.take_along_axis(rests, order, axis=1)
    begins = np.hstack([np.zeros((count, 1)), ends[:, :-1]])
    after = begins[:, :, None] + inside * (ends - begins)[:, :, None]  # (N, n, K)
    middle = 0.5 * (begins + ends)
    keep = np.repeat((ends - begins > SHORTEST)[:, :, None], len(inside), axis=2)
    owner, phase, place = np.nonzero(keep)
    owner, phase, place = (
        np.append(moving, rest)
        for moving, rest in (
            (owner, np.arange(count)),
            (phase, np.full(count, n - 1)),
            (place, np.full(count, len(inside) - 1)),
        )
    )
    last = np.arange(len(owner)) >= len(owner) - count
    after = after[owner, phase, place]
    moves = (rests[owner] > middle[owner, phase][:, None]) & ~last[:, None]
    way = np.minimum(after[:, None], rests[owner])
    rate = (np.sign(qd) * decelerations)[owner]
    weights, rows, share = np.zeros((len(owner), n)), np.arange(len(owner)), inside[place]
    weights[rows, order[owner, phase]] = share
    later = phase > 0
    weights[rows[later], order[owner[later], phase[later] - 1]] = 1 - share[later]
    return StopStates(
        owner,
        after,
        place == len(inside) - 1,
        q[owner] + way * (qd[owner] - 0.5 * rate * way),
        np.where(moves, qd[owner] - rate * way, 0.0),
        np.where(moves, -rate, 0.0),
        moves,
        weights,
    )


def meanwhile(
    robot: Robot,
    cancel: Cancel,
    begun: tuple[np.ndarray, np.ndarray, np.ndarray],
    acting: np.ndarray,
    overshoot: float = 0.0,
) -> tuple[StopStates, np.ndarray]:
    """States of stops, and (M, size) what acts there.

    A process stays what it is. A base drives on as its profile says, also after the arm has come to rest
    where the cancel left it; or it brakes with a constant deceleration, and the radius of its curve stays.
    Then there are more states: where its acceleration steps, which overshoots.

    Args:
        robot: with what acts on it.
        cancel: how it stops.
        begun: times (N,), s, at which the joints begin to decelerate, their angles and speeds (N, n).
        acting: (N, size) what acts then.
        overshoot: share of a step of the base's acceleration that is exceeded.
    """
    times, q, qd = begun
    states = cancel.states(q, qd)
    if robot.acts.drive_profile is None:
        return states, acting[states.owner]
    base = _braking if cancel.base_deceleration else _driving_on
    rows, owner, after, steps = base(robot, cancel, times, states, overshoot)
    more = cancel.states_at(q, qd, owner, after)
    every = StopStates(*(np.concatenate(pair) for pair in zip(states, more, strict=True)))
    result = acting[every.owner]
    result[:, -BASE:] = np.concatenate([rows, steps])
    return every, result


_Base = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Rows (M, 9) of `BaseMotion` in states; of further states (K,): which stops, when, s, and rows (K, 9)."""


def _driving_on(
    robot: Robot, cancel: Cancel, times: np.ndarray, states: StopStates, overshoot: float
) -> _Base:
    profile = robot.acts.drive_profile
    assert profile is not None
    before, after = (profile.rows(profile.knots + side) for side in (-BESIDE, BESIDE))
    some = np.argsort(-np.linalg.norm(after, axis=1), kind="stable")[:BASE_STEPS]
    knots, stepped = profile.knots[some], (after + overshoot * (after - before))[some]
    owner, number = np.nonzero(knots > times[:, None])
    rows = profile.rows(times[states.owner] + states.after)
    return rows, owner, (knots - times[:, None])[owner, number], stepped[number]


def _braking(robot: Robot, cancel: Cancel, times: np.ndarray, states: StopStates, overshoot: float) -> _Base:
    profile = robot.acts.drive_profile
    assert profile is not None
    v = profile.velocities.at(times, range(1))[0]
    reach = max(np.linalg.norm(contact.position[:2]) for contact in robot.support.contacts)
    speed = np.maximum(np.hypot(v[:, 0], v[:, 1]), reach * np.abs(v[:, 2]))  # of a wheel, if it turns alone
    lasts = np.maximum(speed / cancel.base_deceleration, _ENDING)

    def rows_at(owner: np.ndarray, after: np.ndarray) -> np.ndarray:
        share, rows = 1 - after / lasts[owner], np.zeros((len(owner), BASE))
        slow = -v[owner] / lasts[owner, None]
        turning = v[owner, 2:] * share[:, None]
        rows[:, :2] = slow[:, :2] + turning * share[:, None] * v[owner][:, [1, 0]] * [-1, 1]
        rows[:, 5], rows[:, 8] = turning[:, 0], slow[:, 2]
        return np.where((share > 0)[:, None], rows, 0.0)

    every = np.arange(len(times))
    begins, ends = rows_at(every, 0 * lasts), rows_at(every, (1 - _ENDING) * lasts)
    stepped = begins + overshoot * (begins - profile.rows(times))
    rows = np.concatenate([stepped, ends, -overshoot * ends])
    when = np.concatenate([0 * lasts, lasts, lasts])
    return rows_at(states.owner, states.after), np.tile(every, 3), when, rows


@lru_cache(maxsize=8)
def cancel_slopes(
    robot: Robot, decelerations: tuple[float, ...], deviations: Deviations | None = None, interface: int = 0
) -> CancelSlopes:
    """Those of a robot; their functions take a second to build."""
    return CancelSlopes(robot, decelerations, deviations, interface)


class CancelSlopes:
    """Derivatives of functions of the wrench in a state of a stop, over the state s where it begins.

    Which joints still move, in which direction, and which joints' stops say when it is, is fixed. With
    deviations, so are these, and accelerations are a share of those where it begins and a fixed part.

    Args:
        robot: the arm on its support.
        decelerations: n.
        deviations: of the robot, whose wrench it is; None: nominal.
        interface: of the robot's `interfaces`, on which the nominal wrench is; 0: the base.
    """

    def __init__(
        self,
        robot: Robot,
        decelerations: tuple[float, ...],
        deviations: Deviations | None = None,
        interface: int = 0,
    ) -> None:
        n = robot.n
        size = 3 * n + robot.acts.size
        s, on_wrench, rate = cs.SX.sym("s", size), cs.SX.sym("on_wrench", 6), cs.DM(decelerations)
        sign, moves, weights = (cs.SX.sym(name, n) for name in ("sign", "moves", "weights"))
        q, qd, qdd, *process = cs.vertsplit(s, sorted({0, n, 2 * n, 3 * n, size}))
        rests = sign * qd / rate
        after = cs.dot(weights, rests)
        slope = moves * after + (1 - moves) * rests
        stopped = q + slope * (qd - sign * rate * slope / 2), moves * (qd - sign * rate * after)
        chosen = [sign, moves, weights]
        if deviations is None:
            state = *stopped, -moves * sign * rate, *process
            wrench = wrench_expression(robot, interface, *state)
        else:
            share, fixed = cs.SX.sym("share", n), cs.SX.sym("fixed", n)
            theta = cs.SX.sym("theta", deviations.size)
            chosen, state = [*chosen, share, fixed, theta], (*stopped, share * qdd + fixed, *process)
            wrench = deviations.wrench.function(cs.vertcat(*state), theta)
        hessian, gradient = cs.hessian(cs.dot(on_wrench, wrench), s)
        arguments = [s, *chosen, on_wrench]
        self._state = BatchFunction(cs.Function("cancel_state", arguments[:-1], [cs.vertcat(*state)]))
        self._wrench = BatchFunction(cs.Function("cancel_wrench", arguments[:-1], [wrench]))
        self._gradient = BatchFunction(cs.Function("cancel_slopes", arguments, [gradient]))
        self._hessian = BatchFunction(cs.Function("cancel_bends", arguments, [hessian]))

    def states(self, s: np.ndarray, *chosen: np.ndarray) -> np.ndarray:
        """(P, 3 n) of the stops, arguments as of `wrenches`."""
        return self._state(s, *chosen)[0]

    def wrenches(self, s: np.ndarray, *chosen: np.ndarray) -> np.ndarray:
        """(P, 6) of states s (P, 3 n); chosen: sign, moves, weights, (P, n) each.

        With deviations also share, fixed, (P, n) each, and theta, (P, size).
        """
        return self._wrench(s, *chosen)[0]

    def gradient(self, s: np.ndarray, *chosen: np.ndarray) -> np.ndarray:
        """Slopes (P, 3 n) of on_wrench . wrench; chosen: as above, and on_wrench (P, 6)."""
        return self._gradient(s, *chosen)[0]

    def hessian(self, s: np.ndarray, *chosen: np.ndarray) -> np.ndarray:
        """Curvature (P, 3 n, 3 n) of the same."""
        return self._hessian(s, *chosen)[0]


class CancelCheck(StopCheck):
    """Checks stops by a controller of a cancelled motion.

    Args:
        robot: the arm on its support.
        cancel: how it stops, and what stops have to keep; greater GT need not be exact.
        exact, interface: see `StopCheck`.
    """

    def __init__(self, robot: Robot, cancel: Cancel, exact: bool = True, interface: int = 0) -> None:
        super().__init__(robot, cancel.GN, cancel.GT, exact, interface)
        self._cancel = cancel

    def stops(
        self,
        q: np.ndarray,
        qd: np.ndarray,
        process: np.ndarray | None = None,
        begun: np.ndarray | None = None,
    ) -> JointStops:
        """From angles and speeds, (N, n) each, and what acts there, (N, size), see `meanwhile`.

        Times are from the beginning of the deceleration, `begun` (N,), s: of a base that drives.
        """
        begun = np.zeros(len(q)) if begun is None else begun
        process = np.empty((len(q), 0)) if process is None else process
        states, acting = meanwhile(self._robot, self._cancel, (begun, q, qd), process)
        torques, wrenches = self._robot.loads(states.q, states.qd, states.qdd, acting)
        if self._interface:
            wrenches = wrenches_on(self._robot, self._interface, states.q, states.qd, states.qdd, acting)
        loads = wrenches[:, None], torques[:, None]
        postures = states.q[::-1], states.owner[::-1], states.after[::-1]
        result = self._worst(q, states.owner, states.after, loads, (states.q[None], states.owner), postures)
        result.rests[:] = np.max(np.abs(without_creep(qd)) / self._cancel.rates(qd), axis=1)
        np.maximum.at(
            result.drives, states.owner, np.max(np.abs(torques) / self._robot.limits.torque, axis=1)
        )
        return result


def cancel_times(motion: Trajectory) -> np.ndarray:
    """Instants at which joints begin to decelerate, s, `SPACING` apart and at all switching times.

    A motion through points has one at each; speeds change little between two that are near each other.
    """
    kept: list[float] = []
    for time in instants_of(motion, SPACING).tolist():
        if not kept or time - kept[-1] > NEAR:
            kept.append(time)
    return np.array(kept)


@lru_cache(maxsize=8)
def cancelled_motion(
    robot: Robot, motion: Trajectory, cancel: Cancel, interface: int = 0
) -> tuple[np.ndarray, JointStops]:
    """Stops begun at instants of a motion, s: those of `cancel_times`, and more around the worst."""
    check, acting = CancelCheck(robot, cancel, interface=interface), robot.during(motion)

    def stops(times: np.ndarray) -> JointStops:
        q, qd, _ = motion.states(times)
        return check.stops(q, qd, acting.acting(times), times)

    times = cancel_times(motion)
    result = stops(times)
    for _ in range(ROUNDS):
        worst = np.argsort(-np.maximum(result.GN, result.GT), kind="stable")[:PEAKS]
        left, right = times[np.maximum(worst - 1, 0)], times[np.minimum(worst + 1, len(times) - 1)]
        new = np.setdiff1d(np.linspace(left, right, 2 * FRESH + 3)[1:-1].ravel(), times)
        if not len(new):
            break
        result = result.joined(stops(new))
        times = np.concatenate([times, new])
        order = np.argsort(times)
        times, result = times[order], result.some(order)
    return times, result
