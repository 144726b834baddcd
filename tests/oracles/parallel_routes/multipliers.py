"""Accelerations of all joints and the platform with Lagrange multipliers, least squares (2.15)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.parallel.dynamics.reactions import MultiplierSystem
from ocptip.parallel.robot import ParallelRobot

_RANK = 1e-11


@dataclass(frozen=True, eq=False)
class AllAccelerations:
    """Accelerations under given motor forces.

    Attributes:
        joints: per leg (n_f,).
        twist: (6,) acceleration of the platform, world axes.
        residual: largest unbalanced force or closure acceleration, relative.
    """

    joints: tuple[np.ndarray, ...]
    twist: np.ndarray
    residual: float


def accelerations(
    robot: ParallelRobot, z: np.ndarray, s: np.ndarray, motors: np.ndarray, q: list[np.ndarray]
) -> AllAccelerations:
    """Accelerations under motor forces (n_a,) at coordinates z, quasi-velocities s and joint positions q."""
    motion = robot.kinematics.motion(z, s, q, complete=True)
    system = MultiplierSystem(robot.kinematics, motion, robot.description.gravity, np.zeros(6))
    drift = [
        leg.jacobian(part.q, part.qd)[1] - leg.platform_drift(motion.R, motion.t[3:])
        for leg, part in zip(robot.kinematics.legs, motion.legs, strict=True)
    ]
    count, rows = len(system.h), len(system.J)
    matrix = np.block([[system.M, system.J.T], [system.J, np.zeros((rows, rows))]])
    right = np.concatenate([system.S @ motors - system.h, *(-part for part in drift)])
    solution = np.linalg.lstsq(matrix, right, rcond=_RANK)[0]
    residual = np.abs(matrix @ solution - right).max() / max(np.abs(right).max(), 1e-300)
    joints = tuple(np.split(solution[: count - 6], np.cumsum([leg.n for leg in robot.kinematics.legs])[:-1]))
    return AllAccelerations(joints, solution[count - 6 : count], float(residual))
