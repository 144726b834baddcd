"""Simulation of a parallel robot under motor forces: Runge-Kutta on (z, s'), joints by inverse kinematics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import finite_array, positive_number
from ocptip.parallel.compiled_dynamics import CompiledDynamics, compiled_obstacle
from ocptip.parallel.robot import ParallelRobot

_LONG = 200  # steps: fewer are done before machine code is made

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
    law = _law(motors, len(robot.description.actuated))
    count = int(np.ceil(duration / step - 1e-9))
    times = np.append(step * np.arange(count), duration)
    equations = _equations(robot, z, count)
    history = [(z, s)]
    energies = []

    def slope(time: float, z: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return equations.slope(z, s, law(time, z, s))

    for t, h in zip(times[:-1], np.diff(times), strict=True):
        k1 = slope(t, z, s)
        energies.append(equations.energy(z, s))
        k2 = slope(t + h / 2, z + h / 2 * k1[0], s + h / 2 * k1[1])
        k3 = slope(t + h / 2, z + h / 2 * k2[0], s + h / 2 * k2[1])
        k4 = slope(t + h, z + h * k3[0], s + h * k3[1])
        z = z + h / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        s = s + h / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
        history.append((z, s))
    energies.append(equations.energy(z, s))
    return Trajectory(
        times,
        np.array([pair[0] for pair in history]),
        np.array([pair[1] for pair in history]),
        np.array(energies),
        equations.closure,
    )


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

    def slope(self, z: np.ndarray, s: np.ndarray, motors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """z' and s''."""
        sd = self._robot.forward_dynamics(z, s, motors, self._at(z))
        return np.linalg.solve(self._robot.kinematics.rate_matrices(z, np.zeros_like(z))[0], s), sd

    def energy(self, z: np.ndarray, s: np.ndarray) -> tuple[float, float]:
        """Kinetic and potential energy, J."""
        return self._robot.energy(z, s, self._at(z))

    def _at(self, z: np.ndarray) -> tuple[np.ndarray, ...]:
        found = self._solve(z, self._last)
        self._last = found.q
        self.closure = max(self.closure, found.residual)
        return found.q


def _law(motors: MotorLaw | Sequence[float] | None, count: int) -> MotorLaw:
    if callable(motors):
        return motors
    fixed = np.zeros(count) if motors is None else finite_array("motors", motors, (count,))
    return lambda time, z, s: fixed
