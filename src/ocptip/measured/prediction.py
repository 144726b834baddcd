"""Predictions of the signals of a planned motion, also of a robot that differs slightly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy import linalg

from ocptip.measured.recording import ANGLE, BASE, GRIPPER, POWER, SHIFT, SPEED, TORQUE, WRENCH
from ocptip.robots.dynamics import mass_sensitivities
from ocptip.robots.kinematics import gripper_batch
from ocptip.standing.arm import Robot
from ocptip.standing.mechanism import StandingMechanism
from ocptip.trajectories.trajectory import INSIDE, Trajectory

DAMPING = 0.05
"""Ratio with which the search for that of springs begins."""

_FAR = 1.0  # rad, m: no spring of a joint bends so far
_STEP = 5e-4  # s, of springs
_JUMP = 0.05  # of the greatest acceleration: jumps that are smaller are not left out
_DIFFERENCE = 1e-3  # N m: step of the power's slope over torques


@dataclass(frozen=True, eq=False)
class Elasticity:
    """Elasticity of the joints.

    Attributes:
        bends: (n,), rad / N m; 0 where a joint is stiff.
        damping: (n,), ratio for each joint by itself, the others being stiff, at the begin of the motion.
        seen: (n,) True where the encoder is behind the spring.
    """

    bends: np.ndarray
    damping: np.ndarray
    seen: np.ndarray

    @classmethod
    def none(cls, n: int) -> Elasticity:
        """Elasticity of stiff joints."""
        return cls(np.zeros(n), np.full(n, DAMPING), np.ones(n, dtype=bool))


@dataclass(frozen=True, eq=False)
class State:
    """The robot at N instants, as planned.

    Attributes:
        q, qd, qdd: (N, n), of the links.
        encoders: (N, n), what encoders of the joints show.
        drives: (N, n), rad/s, speeds of the drives, which are in front of springs.
        torques: (N, n), N m.
        wrenches: (N, 6), on the sensor.
        slopes: (N, n + 6, 4 L + 1), of torques and wrenches, see `robots.dynamics.mass_sensitivities`.
    """

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    encoders: np.ndarray
    drives: np.ndarray
    torques: np.ndarray
    wrenches: np.ndarray
    slopes: np.ndarray


@dataclass
class KnownRobot:
    """The present estimates of a robot and of its clocks.

    Attributes:
        clock: s.
        error: standard error of it; infinite: unknown.
        delays: (n,), s, of joints.
        elastic: springs of joints.
        loads: (K,) of `causes.of_loads`, and of `causes.of_motion`.
        motion: the same of `causes.of_motion`.
        errors: standard errors of these.
    """

    clock: float
    error: float
    delays: np.ndarray
    elastic: Elasticity
    loads: np.ndarray
    motion: np.ndarray
    errors: np.ndarray


class Predictor:
    """Predicts signals of a planned motion.

    A process that varies keeps the clock of the motion as commanded.

    Args:
        robot: an arm on its base.
        motion: of it, as planned.

    Raises:
        InputError: a parallel robot.
    """

    def __init__(self, robot: StandingMechanism, motion: Trajectory) -> None:
        robot = Robot.of(robot, f"only recordings of arms are compared, not of a {robot.kind}")
        self.robot, self.motion = robot.during(motion), motion
        self._masses = mass_sensitivities(robot.arm.without_process)
        self._linear, self._swings = lru_cache(8)(self._linearised), lru_cache(16)(self._swung)

    def states(self, times: np.ndarray, delays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(N, n) each, at times (N,), s, of the motion, each joint with its delay; at rest outside."""
        results = [np.empty((len(times), self.robot.n)) for _ in range(3)]
        for delay in np.unique(delays):
            delayed_times = times - delay
            moving = (delayed_times >= 0) & (delayed_times <= self.motion.end)
            states = self.motion.states(np.clip(delayed_times, 0.0, self.motion.end))
            for k, (into, values) in enumerate(zip(results, states, strict=True)):
                still = values if k == 0 else np.where(moving[:, None], values, 0.0)
                into[:, delays == delay] = still[:, delays == delay]
        return results[0], results[1], results[2]

    def events(self, delays: np.ndarray, *, small: bool = False) -> np.ndarray:
        """Times, s, of acceleration steps; also of small ones, if these are asked for."""
        times = self.motion.event_times if small else self.jumps
        return np.unique(times[:, None] + np.unique(np.append(delays, 0.0)))

    @cached_property
    def jumps(self) -> np.ndarray:
        """Times, s, of the motion with an acceleration step of more than a small part of the peak.

        Motions of points have steps at each of them, most of which are small.
        """
        times, still = self.motion.event_times, np.zeros(self.robot.n)
        before, after = (self.states(times + side, still)[2] for side in (-INSIDE, INSIDE))
        peak = np.maximum(np.abs([before, after]).max(axis=(0, 1)), 1e-300)
        return times[(np.abs(after - before) > _JUMP * peak).any(axis=1)]

    def state(
        self,
        times: np.ndarray,
        delays: np.ndarray,
        changes: np.ndarray,
        elastic: Elasticity | None = None,
        *,
        slopes: bool = True,
    ) -> State:
        """The robot at times, s, of the motion, with other masses, see `mass_sensitivities`, and springs.

        Without slopes loads are those of the nominal masses.
        """
        robot, sensor = self.robot, self.robot.sensor
        q, qd, qdd = self.states(times, delays)
        encoders, drives = q, qd
        if elastic is not None and (elastic.bends > 0).any():
            bent, rate, change = self.swing(times, delays, changes, elastic)
            encoders = q + np.where(elastic.seen, bent, 0.0)
            q, qd, qdd = q + bent, qd + rate, qdd + change
        torques, wrenches = robot.loads(q, qd, qdd, robot.acting(times))
        seen = sensor.reads(robot.support, wrenches)
        if not slopes:
            return State(q, qd, qdd, encoders, drives, torques, seen, np.empty((len(q), robot.n + 6, 0)))
        given = (q, qd, qdd, robot.support.gravity, sensor.position)
        loads, over = self._masses(*given, changes)
        if changes.any():
            loads = loads - self._masses(*given, 0 * changes)[0]
            torques = torques + loads[:, : robot.n]
            seen = seen + loads[:, robot.n :] @ np.kron(np.eye(2), sensor.rotation)
        turn = np.eye(robot.n + 6)
        turn[robot.n :, robot.n :] = np.kron(np.eye(2), sensor.rotation.T)
        return State(q, qd, qdd, encoders, drives, torques, seen, turn @ over)

    def swing(
        self, times: np.ndarray, delays: np.ndarray, changes: np.ndarray, elastic: Elasticity
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(N, n), rad, rad/s, rad/s^2: how the joints' springs bend under the motion, from rest.

        Linear about the motion of the drives: inertia, Coriolis and gravity terms at every instant; average
        acceleration method, with both sides of every acceleration step among its instants. Then one step of
        Newton's method with the torques of the bent robot: bends of mrad are off by tenths of microradians.
        """
        end = float(np.ceil(10 * max(float(times.max()), self.motion.end)) / 10)
        given = (delays, changes, elastic.bends, elastic.damping)
        grid, curves = self._swings(*(values.tobytes() for values in given), end)
        bent, rate, change = (
            np.stack([np.interp(times, grid, values) for values in curve.T], axis=1) for curve in curves
        )
        return bent, rate, change

    def _swung(
        self, delays: bytes, changes: bytes, bends: bytes, damping: bytes, end: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Times (T,) and how joints bend, speeds and accelerations of that, (3, T, n)."""
        bent, ratio = np.frombuffer(bends), np.frombuffer(damping)
        springs = np.flatnonzero(bent > 0)
        grid, torques, M, C, G = self._linear(delays, changes, tuple(springs), end)
        stiffness = 1 / bent[springs]
        rates = 2 * ratio[springs] * np.sqrt(stiffness * np.abs(np.diagonal(M[0])))
        K, C = G + np.diag(stiffness), C + np.diag(rates)
        values = np.zeros((3, len(grid), self.robot.n))
        with np.errstate(over="ignore", invalid="ignore"):
            swung = _integrated(np.diff(grid), M, C, K, -torques)
            if (
                np.isfinite(swung).all() and np.abs(swung[0]).max() < _FAR
            ):  # else no springs: the arm would fall
                values[:, :, springs] = swung
                late, changed = np.frombuffer(delays), np.frombuffer(changes)
                q, qd, qdd = (a + b for a, b in zip(self.states(grid, late), values, strict=True))
                left = (
                    self._torques(grid, q, qd, qdd, changed)[:, springs]
                    + swung[0] * stiffness
                    + swung[1] * rates
                )
                values[:, :, springs] += _integrated(np.diff(grid), M, C, K, -left)
        return grid, values

    def _linearised(
        self, delays: bytes, changes: bytes, springs: tuple[int, ...], end: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Times, torques of springs, and their slopes over accelerations, speeds and angles there."""
        late, changed = np.frombuffer(delays), np.frombuffer(changes)
        grid = np.arange(min(0.0, float(late.min())) - _STEP, end + _STEP, _STEP)  # from rest
        events = self.events(late, small=True)  # where accelerations jump, both sides
        sides = (events[(events > grid[0]) & (events < grid[-1]), None] + np.array([-INSIDE, INSIDE])).ravel()
        grid = np.unique(np.concatenate([grid, sides]))
        states = self.states(grid, late)
        chosen = list(springs)

        def needed(k: int = 0, j: int = 0, step: float = 0.0) -> np.ndarray:
            given = list(states)
            given[k] = given[k] + step * (np.arange(self.robot.n) == j)
            return self._torques(grid, given[0], given[1], given[2], changed)[:, chosen]

        torques = needed()
        M, C, G = (
            np.stack([(needed(k, j, step) - torques) / step for j in chosen], axis=-1)
            for k, step in ((2, 1.0), (1, 1e-3), (0, 1e-5))
        )
        return grid, torques, M, C, G

    def _torques(
        self, times: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, changes: np.ndarray
    ) -> np.ndarray:
        load = self.robot.loads(q, qd, qdd, self.robot.acting(times))[0]
        if changes.any():
            given = (q, qd, qdd, self.robot.support.gravity, np.zeros(3))
            loads = [self._masses(*given, change)[0][:, : self.robot.n] for change in (changes, 0 * changes)]
            load = load + loads[0] - loads[1]
        return load

    def power(self, state: State) -> np.ndarray:
        """(N, n), W, of the drives."""
        motors = self.robot.motors
        return motors.power(state.torques, self.robot.motor_speeds(state.q, state.drives))

    def power_slopes(self, state: State) -> np.ndarray:
        """(N, n), W / N m: of the drives' powers over their torques."""
        speeds = self.robot.motor_speeds(state.q, state.drives)
        ends = [self.robot.motors.power(state.torques + sign * _DIFFERENCE, speeds) for sign in (0.5, -0.5)]
        return (ends[0] - ends[1]) / _DIFFERENCE

    def gripper(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (N, 3), m, base frame, and their slopes (N, 3, n) over joint values."""
        position, _, jacobian = gripper_batch(self.robot.arm)(q)
        return position, jacobian[:, :3]

    def signal(self, kind: str, index: int, state: State) -> np.ndarray:
        """(N,) what a signal should be."""
        if kind == POWER:
            powers = self.power(state)
            return powers.sum(axis=1) if index == 0 else powers[:, index - 1]
        if kind == GRIPPER:
            return self.gripper(state.q)[0][:, index]
        if kind in (BASE, SHIFT):
            return np.zeros(len(state.q))
        values = {ANGLE: state.encoders, SPEED: state.qd, TORQUE: state.torques, WRENCH: state.wrenches}
        return values[kind][:, index]


def _integrated(
    dt: np.ndarray, M: np.ndarray, C: np.ndarray, K: np.ndarray, forces: np.ndarray
) -> np.ndarray:
    """(3, N, k): position, speed and acceleration of M a + C v + K d = f from rest; average acceleration.

    Steps dt (N - 1,), s.
    """
    N, k = forces.shape
    h, one, nil = dt[:, None, None], np.eye(k), np.zeros((len(dt), k, k))
    inverse = np.linalg.inv(M[1:] + h / 2 * C[1:] + h**2 / 4 * K[1:])
    way = np.concatenate([one + nil, h * one, h**2 / 4 * one], axis=2)  # without the next acceleration
    speed = np.concatenate([nil, one + nil, h / 2 * one], axis=2)
    pushed = -inverse @ (C[1:] @ speed + K[1:] @ way)
    steps = np.concatenate([way + h**2 / 4 * pushed, speed + h / 2 * pushed, pushed], axis=1)
    a = np.einsum("nij,nj->ni", inverse, forces[1:])
    right = np.zeros((N, 3 * k))
    right[0, :k] = np.linalg.solve(K[0], forces[0])
    right[1:] = np.concatenate([h[:, 0] ** 2 / 4 * a, h[:, 0] / 2 * a, a], axis=1)
    # all steps at once: a system with ones on its diagonal and a band below
    band = np.zeros((6 * k, N, 3 * k))
    row, column = np.indices((3 * k, 3 * k))
    band[3 * k + row - column, :-1, column] = -steps.transpose(1, 2, 0)
    (solve,) = linalg.get_lapack_funcs(("tbtrs",), (band,))
    result, _ = solve(band.reshape(6 * k, -1), right.reshape(-1, 1), uplo="L", diag="U")
    return result.reshape(N, 3, k).transpose(1, 0, 2)
