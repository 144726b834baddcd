"""Stops by brakes (category 0): drives lose their torque, every joint brakes by itself, the path is left.

From every checked instant, a few stops are computed by forward dynamics: with the minimum and with the
maximum torques of all brakes, and with those ends of the intervals that load the nearest tipping axis most
when the brakes close. At every state during the stop all combinations of torques within the intervals count:
the wrench on the base is affine in them, so that the minimum moments about the tipping axes are exact. For
slip the worst of three combinations is taken: that of the nearest axis, all minima, all maxima. Where the
stop ends the base also has to stand at rest.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import product
from typing import Any

import casadi as cs
import numpy as np

from ocptip.basics.errors import share_of_one
from ocptip.numerics.batch import BatchFunction
from ocptip.robots.braking import Braked, MotionTerms, brake, terms
from ocptip.standing.arm import Robot
from ocptip.standing.instants import wrench_expression, wrenches_on
from ocptip.standing.stops.joint_stops import JointStops, StopCheck, instants_of, of_owner, without_creep
from ocptip.trajectories.trajectory import Trajectory

SPACING = 0.02  # s, between instants of a motion at which brakes close
CREEPING = 1e-4  # rad/s (m/s): joints that have just begun to move
MOMENTS = 40  # of each stop, about; more of those that take much longer than others are left out


@dataclass(frozen=True)
class Brakes:
    """Brakes of an arm, and what stops by them have to keep.

    Attributes:
        least, greatest: minimum and maximum torque of each of n brakes, N m (sliding joints: N).
        delay: s, minimum and maximum time from when the drives lose their torque until the brakes act.
        GN, GT: maximum during any stop, at most 1.
    """

    least: tuple[float, ...]
    greatest: tuple[float, ...]
    delay: tuple[float, float] = (0.0, 0.0)
    GN: float = 0.9
    GT: float = 0.9

    def __post_init__(self) -> None:
        for name in ("GN", "GT"):
            share_of_one(f"brakes.{name}", getattr(self, name))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)


class BrakeCheck(StopCheck):
    """Checks stops by the brakes of an arm.

    Args:
        robot: the arm on its support.
        brakes: its brakes, and what stops have to keep; greater GT need not be exact.
        interface: of the robot's `interfaces`, see `StopCheck`.
    """

    def __init__(self, robot: Robot, brakes: Brakes, interface: int = 0) -> None:
        super().__init__(robot, brakes.GN, brakes.GT, interface=interface)
        self._delay = brakes.delay
        self._brakes = np.array(brakes.least), np.array(brakes.greatest)

    def stops(self, q: np.ndarray, qd: np.ndarray, process: np.ndarray | None = None) -> JointStops:
        """From angles and speeds, (N, n) each; a process that varies stays what it is then, (N, 6)."""
        low, high = self._brakes
        qd = without_creep(qd)
        worst = self._box(q, qd, np.full(len(q), self._delay[1]), process)[3]
        cases = [(low, self._delay[1]), (high, self._delay[0]), (worst, self._delay[1])]
        if self._delay[1] > self._delay[0]:
            cases.append((high, self._delay[1]))
        torques = np.concatenate([np.broadcast_to(torque, q.shape) for torque, _ in cases])
        delays = np.repeat([delay for _, delay in cases], len(q))
        many = np.tile(q, (len(cases), 1)), np.tile(qd, (len(cases), 1))
        owner = np.tile(np.arange(len(q)), len(cases))
        given = {"delay": delays, "process": of_owner(process, owner)}
        run = brake(self._robot.arm, *many, self._robot.support.gravity, torques, **given)
        return self._checked(q, run, owner, process)

    def _checked(
        self, q: np.ndarray, run: Braked, owner: np.ndarray, process: np.ndarray | None
    ) -> JointStops:
        going = np.any(run.speeds != 0, axis=2)
        going[np.arange(len(going)) % max(1, len(going) // MOMENTS) != 0] = False
        going[-1] = True  # rest after the stop counts, too
        k, i = np.nonzero(going)
        loads = self._wrenches(run.angles[k, i], run.speeds[k, i], run.times[k], of_owner(process, owner[i]))
        ends = run.angles[-1], owner, np.full(len(owner), run.times[-1])
        pairs = zip(ends, (run.angles[k, i], owner[i], run.times[k]), strict=True)
        postures = tuple(np.concatenate(pair) for pair in pairs)
        result = self._worst(q, owner[i], run.times[k], loads, (run.angles, owner), postures)
        np.maximum.at(result.rests, owner, run.rests)
        return result

    def _wrenches(
        self, q: np.ndarray, qd: np.ndarray, after: np.ndarray, process: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Three wrenches (M, 3, 6) on the interface per state, and the brakes' torques (M, 3, n)."""
        rest, by_torque, (low, high), corner = self._box(q, qd, after, process)
        moving = qd != 0
        torques = np.stack([corner, low, high], axis=1) * moving[:, None]
        return rest[:, None] + np.einsum("sij,stj->sti", by_torque, torques), torques

    def _box(
        self, q: np.ndarray, qd: np.ndarray, after: np.ndarray, process: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Wrench without brakes (M, 6), its slope over their torques (M, 6, n), their ends and worst corner.

        Joints that rest stay at rest. The worst corner loads the nearest tipping axis most.
        """
        result, response = self.response(self._robot, q, qd, qd != 0, process)
        rest, per_acceleration = _on_interface(self._robot, self._interface, result, q, qd, process)
        per_torque = per_acceleration @ response
        rest = rest - np.einsum("sij,sj->si", per_torque, result.bias)
        by_torque = -per_torque * np.sign(qd)[:, None]
        none = np.zeros_like(q)
        acts, surely = (after[:, None] >= self._delay[0]), (after[:, None] >= self._delay[1])
        low, high = np.where(surely, self._brakes[0], none), np.where(acts, self._brakes[1], none)
        if not self._map.count:
            return rest, by_torque, (low, high), high
        least, corners = self._corners(rest, by_torque, low, high)
        nearest = np.argmin(least, axis=1)
        return rest, by_torque, (low, high), corners[np.arange(len(q)), nearest]

    def _corners(
        self, rest: np.ndarray, by_torque: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Minimum moments (M, axes) about the tipping axes, ends of the intervals there (M, axes, n)."""
        middle = 0.5 * (low + high)
        moments, slopes = self._map(rest + np.einsum("sij,sj->si", by_torque, middle))
        pull = np.einsum("sai,sij->saj", slopes, by_torque)
        least = moments - np.sum(np.abs(pull) * 0.5 * (high - low)[:, None], axis=2)
        return least, np.where(pull < 0, high[:, None], low[:, None])

    def worst_corners(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """When brakes close: minimum moments (M, axes), N m, and the joints' torques there (M, axes, n)."""
        qd = without_creep(qd)
        rest, by_torque, (low, high), _ = self._box(q, qd, np.full(len(q), self._delay[1]))
        least, corners = self._corners(rest, by_torque, low, high)
        return least, -np.sign(qd)[:, None] * corners

    def combinations(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """When brakes close: the three checked wrenches (M, 3, 6), and the joints' torques (M, 3, n)."""
        qd = without_creep(qd)
        wrenches, torques = self._wrenches(q, qd, np.full(len(q), self._delay[1]))
        return wrenches, -np.sign(qd)[:, None] * torques

    def gentlest(self, q: np.ndarray, must: np.ndarray) -> tuple[float, float, np.ndarray]:
        """GN and GT when brakes close on a slow motion from q (n,) whose directions (n,) are best for that.

        Args:
            q: rad (m).
            must: (n,) joints that move, in either direction; the others may.
        """
        kinds = [(-1.0, 1.0) if moves else (-1.0, 0.0, 1.0) for moves in must]
        directions = np.array(list(product(*kinds)))
        directions = directions[np.any(directions != 0, axis=1)]
        count = len(directions)
        none = np.full(count, self._delay[1])
        wrenches, _ = self._wrenches(np.tile(q, (count, 1)), directions * CREEPING, none)
        owner = np.repeat(np.arange(count), wrenches.shape[1])
        GN, GT = np.zeros(count), np.zeros(count)
        for worst, values in zip((GN, GT), self._reserves(wrenches.reshape(-1, 6), owner), strict=True):
            np.maximum.at(worst, owner, values)
        best = int(np.argmin(np.maximum(GN / self._GN, GT / self._GT)))
        return float(GN[best]), float(GT[best]), directions[best]

    @staticmethod
    def response(
        robot: Robot,
        q: np.ndarray,
        qd: np.ndarray,
        moving: np.ndarray,
        process: np.ndarray | None = None,
    ) -> tuple[MotionTerms, np.ndarray]:
        """Dynamics, and accelerations per torque (M, n, n) where only joints `moving` (M, n) move."""
        result = terms(robot.arm, q, qd, robot.support.gravity, robot.support.center_of_mass, process)
        both = moving[:, :, None] & moving[:, None]
        inertia = result.inertia * both
        inertia[:, np.arange(q.shape[1]), np.arange(q.shape[1])] += ~moving
        return result, np.linalg.inv(inertia) * both


def _on_interface(
    robot: Robot,
    interface: int,
    motion_terms: MotionTerms,
    q: np.ndarray,
    qd: np.ndarray,
    process: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """The wrench (M, 6) on an interface without accelerations, weight included, and its slope over them."""
    if not interface:
        return motion_terms.rest + robot.support.weight, motion_terms.per_acceleration
    rest = wrenches_on(robot, interface, q, qd, 0 * q, process)
    units = [np.broadcast_to(unit, q.shape) for unit in np.eye(robot.n)]
    slopes = [wrenches_on(robot, interface, q, qd, unit, process) - rest for unit in units]
    return rest, np.stack(slopes, axis=2)


@lru_cache(maxsize=16)
def stops_of_motion(
    robot: Robot, motion: Trajectory, brakes: Brakes, spacing: float = SPACING, interface: int = 0
) -> tuple[np.ndarray, JointStops]:
    """Stops begun at instants of a motion, s, `spacing` apart and at all switching times."""
    times = instants_of(motion, spacing)
    q, qd, _ = motion.states(times)
    check = BrakeCheck(robot, brakes, interface)
    return times, check.stops(q, qd, robot.during(motion).acting(times))


@lru_cache(maxsize=8)
def closing_of(robot: Robot, interface: int = 0) -> Closing:
    """That of a robot, made once."""
    return Closing(robot, interface)


class Closing:
    """The wrench on an interface when brakes close, as a function of angles and speeds, with derivatives.

    With inverse dynamics T(q, qd, a) and wrench w(q, qd, a), a the accelerations at which T is what the
    brakes give on all joints that move (their torque is not zero), the slope of l . w(q, qd, a(q, qd)) is
    that of l . w - m . T at constant a and m, where m annuls the slope over a.

    Args:
        robot: the arm on its support.
        interface: of its `interfaces`; 0: the base.
    """

    def __init__(self, robot: Robot, interface: int = 0) -> None:
        n = robot.n
        s, weights, forces = cs.SX.sym("s", 3 * n), cs.SX.sym("weights", 6), cs.SX.sym("forces", n)
        state = cs.vertsplit(s, n)
        torque, wrench = robot.load_expressions(*state)[0], wrench_expression(robot, interface, *state)
        hessian, gradient = cs.hessian(cs.dot(weights, wrench) - cs.dot(forces, torque), s)
        arguments = [s, weights, forces]
        self._robot, self._interface = robot, interface
        self._gradient = BatchFunction(cs.Function("closing_slopes", arguments, [gradient]))
        self._second = BatchFunction(cs.Function("closing_bends", arguments, [hessian]))
        self._torque = BatchFunction(cs.Function("closing_torque", [s], [cs.jacobian(torque, s)]))

    def wrenches(self, s: np.ndarray, torques: np.ndarray) -> np.ndarray:
        """(N, 6) in states s (N, 3 n) or more, with these torques (N, n) of the brakes on the joints."""
        (rest, slopes), _, _, a = self._accelerations(s, torques)
        return rest + np.einsum("sij,sj->si", slopes, a)

    def gradient(self, s: np.ndarray, torques: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Slopes (N, 3 n) of weights . wrench; zero over the accelerations of the motion."""
        s, forces, _ = self._at(s, torques, weights)
        slopes = self._gradient(s, weights, forces)[0]
        slopes[:, 2 * self._robot.n :] = 0.0
        return slopes

    def hessian(self, s: np.ndarray, torques: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Curvature (N, 3 n, 3 n) of the same."""
        n = self._robot.n
        s, forces, inverse = self._at(s, torques, weights)
        whole, torque = self._second(s, weights, forces)[0], self._torque(s)[0]
        turn = np.zeros((len(s), 3 * n, 3 * n))  # how s changes with angles and speeds
        turn[:, : 2 * n, : 2 * n] = np.eye(2 * n)
        turn[:, 2 * n :, : 2 * n] = -inverse @ torque[:, :, : 2 * n]
        return turn.transpose(0, 2, 1) @ whole @ turn

    def _at(
        self, s: np.ndarray, torques: np.ndarray, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States (N, 3 n) with the accelerations, m (N, n), inverse inertia of the joints that move."""
        (_, slopes), inverse, moving, a = self._accelerations(s, torques)
        forces = np.einsum("si,sij,sjk->sk", weights, slopes, inverse)
        return np.hstack([moving, a]), forces, inverse

    def _accelerations(
        self, s: np.ndarray, torques: np.ndarray
    ) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
        """See `_on_interface`; inverse inertia, angles and speeds (N, 2 n), and accelerations (N, n)."""
        n = self._robot.n
        moving = s[:, : 2 * n]
        q, qd = moving[:, :n], moving[:, n:]
        result, inverse = BrakeCheck.response(self._robot, q, qd, torques != 0)
        on_interface = _on_interface(self._robot, self._interface, result, q, qd)
        return on_interface, inverse, moving, np.einsum("sij,sj->si", inverse, torques - result.bias)
