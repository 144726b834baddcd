"""Simulation of a parallel robot under motor forces: Runge-Kutta on (z, s'), joints by inverse kinematics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import finite_array, positive_number
from ocptip.parallel.robot import ParallelRobot

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
    state = _Joints(robot)
    count = int(np.ceil(duration / step - 1e-9))
    times = np.append(step * np.arange(count), duration)
    history = [(z, s)]
    energies = [robot.energy(z, s, state.at(z))]

    def slope(time: float, z: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sd = robot.forward_dynamics(z, s, law(time, z, s), state.at(z))
        return np.linalg.solve(robot.kinematics.rate_matrices(z, np.zeros_like(z))[0], s), sd

    for t, h in zip(times[:-1], np.diff(times), strict=True):
        k1 = slope(t, z, s)
        k2 = slope(t + h / 2, z + h / 2 * k1[0], s + h / 2 * k1[1])
        k3 = slope(t + h / 2, z + h / 2 * k2[0], s + h / 2 * k2[1])
        k4 = slope(t + h, z + h * k3[0], s + h * k3[1])
        z = z + h / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        s = s + h / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
        history.append((z, s))
        energies.append(robot.energy(z, s, state.at(z)))
    return Trajectory(
        times,
        np.array([pair[0] for pair in history]),
        np.array([pair[1] for pair in history]),
        np.array(energies),
        state.worst,
    )


class _Joints:
    """Joint positions along a motion, each from the one before."""

    def __init__(self, robot: ParallelRobot) -> None:
        kinematics = robot.kinematics
        self._solve = kinematics.joints if robot.complete_legs else kinematics.point_joints
        self._last: tuple[np.ndarray, ...] | None = None
        self.worst = 0.0

    def at(self, z: np.ndarray) -> tuple[np.ndarray, ...]:
        found = self._solve(z, self._last)
        self._last = found.q
        self.worst = max(self.worst, found.residual)
        return found.q


def _law(motors: MotorLaw | Sequence[float] | None, count: int) -> MotorLaw:
    if callable(motors):
        return motors
    fixed = np.zeros(count) if motors is None else finite_array("motors", motors, (count,))
    return lambda time, z, s: fixed
