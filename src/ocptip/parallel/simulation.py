"""Simulation of a parallel robot under motor forces: Runge-Kutta on (z, s'), joints by inverse kinematics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, positive_number
from ocptip.parallel.compiled_dynamics import CompiledDynamics, compiled_obstacle
from ocptip.parallel.robot import ParallelRobot

_LONG = 200  # steps: fewer are done before machine code is made
_WEIGHTS = np.array([1, 2, 2, 1]) / 6

MotorLaw = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A simulated motion.

    Attributes:
        times: (N,), s.
        z: (N, m) coordinates.
        s: (N, m) quasi-velocities.
        energy: (N, 2), J: kinetic and potential.
        closure: largest closure error of the joint positions, m or rad.
    """

    times: np.ndarray
    z: np.ndarray
    s: np.ndarray
    energy: np.ndarray
    closure: float

    @property
    def energy_drift(self) -> float:
        """Largest change of the total energy, relative to the largest kinetic energy; of free motions only
        this is an error."""
        total = self.energy.sum(axis=1)
        return float(np.abs(total - total[0]).max() / max(self.energy[:, 0].max(), 1e-300))


def simulate(
    robot: ParallelRobot,
    z: ArrayLike,
    s: ArrayLike,
    *,
    duration: float,
    step: float,
    motors: MotorLaw | Sequence[float] | None = None,
) -> Trajectory:
    """Integrate the equations of motion with the classic Runge-Kutta method.

    Long motions (200 steps and more) run as machine code, except those of robots with redundant joints or
    legs with branches or loops of their own.

    Args:
        robot: its Euler angles must stay away from their singularity.
        z, s: (m,) start: coordinates and quasi-velocities.
        duration, step: s; the last step is shortened to end at `duration`.
        motors: forces (n_a,), or a function of time, z and s; None: none.

    Raises:
        SolverError: a singular pose on the way.
        InputError: wrong shapes, or a pose out of reach.
    """
    duration, step = positive_number("duration", duration), positive_number("step", step)
    z, s = robot.kinematics.coordinates("z", z), robot.kinematics.coordinates("s", s)
    shape = (len(robot.description.actuated),)
    law = _law(motors, shape)
    count = int(np.ceil(duration / step - 1e-9))
    times = np.append(step * np.arange(count), duration)
    equations = _equations(robot, z, count)
    m, states, energies = robot.m, np.empty((count + 1, 2 * robot.m)), np.empty((count + 1, 2))
    stages = np.empty((4, 2 * m))
    states[0, :m], states[0, m:] = z, s

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        forces = np.asarray(law(time, state[:m], state[m:]), dtype=float)
        if forces.shape != shape:
            raise InputError(
                f"motors: expected {shape[0]} forces at t = {time:.6g} s, got shape {forces.shape}"
            )
        return equations.slope(state, forces)

    state = states[0].copy()
    for k, (t, h) in enumerate(zip(times[:-1].tolist(), np.diff(times).tolist(), strict=True)):
        stages[0] = slope(t, state)
        energies[k] = equations.energy(state)
        stages[1] = slope(t + h / 2, state + h / 2 * stages[0])
        stages[2] = slope(t + h / 2, state + h / 2 * stages[1])
        stages[3] = slope(t + h, state + h * stages[2])
        state = state + h * (_WEIGHTS @ stages)
        states[k + 1] = state
    energies[count] = equations.energy(state)
    return Trajectory(times, states[:, :m], states[:, m:], energies, equations.closure)


def _equations(robot: ParallelRobot, z: np.ndarray, count: int) -> _Searched | CompiledDynamics:
    """The equations of motion; compiled where that is possible and worth it."""
    if count >= _LONG and not compiled_obstacle(robot):
        return CompiledDynamics(robot, z)
    return _Searched(robot)


class _Searched:
    """Equations of motion of any robot: joint positions along a motion, each from the one before."""

    def __init__(self, robot: ParallelRobot) -> None:
        self._robot, kinematics = robot, robot.kinematics
        self._solve = kinematics.joints if robot.complete_legs else kinematics.point_joints
        self._last: tuple[np.ndarray, ...] | None = None
        self.closure = 0.0

    def slope(self, state: np.ndarray, motors: np.ndarray) -> np.ndarray:
        """(z', s'') of a state (z, s)."""
        z, s = np.split(state, 2)
        sd = self._robot.forward_dynamics(z, s, motors, self._at(z))
        rates = np.linalg.solve(self._robot.kinematics.rate_matrices(z, np.zeros_like(z))[0], s)
        return np.concatenate([rates, sd])

    def energy(self, state: np.ndarray) -> tuple[float, float]:
        """Kinetic and potential energy, J."""
        z, s = np.split(state, 2)
        return self._robot.energy(z, s, self._at(z))

    def _at(self, z: np.ndarray) -> tuple[np.ndarray, ...]:
        found = self._solve(z, self._last)
        self._last = found.q
        self.closure = max(self.closure, found.residual)
        return found.q


def _law(motors: MotorLaw | Sequence[float] | None, shape: tuple[int]) -> MotorLaw:
    if callable(motors):
        return motors
    fixed = np.zeros(shape) if motors is None else finite_array("motors", motors, shape)
    return lambda time, z, s: fixed
