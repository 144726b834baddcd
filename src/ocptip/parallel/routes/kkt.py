"""Equations of motion with Lagrange multipliers: complete legs, a free-flying platform, closures (2.15).

Works for every robot of the library: redundant drives, over-constrained legs, branches. Least squares,
because the multipliers of over-constrained robots are not unique; the residual tells whether forces exist.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.parallel.analysis.mobility import stacked_closures
from ocptip.parallel.dynamics.terms import platform_terms
from ocptip.parallel.kinematics.platform import Kinematics, RobotMotion

_RANK = 1e-11


@dataclass(frozen=True, eq=False)
class KKTForces:
    """Motor forces and closure forces.

    Attributes:
        motors: (n_a,) motor forces, N or N m.
        multipliers: closure forces, one per closure row; one choice of many if the robot is over-constrained.
        residual: largest unbalanced force, relative to the largest force.
        joints: per leg (n_f,) accelerations, those of idle freedoms included.
        unique: True if no other motor and closure forces balance the same motion.
    """

    motors: np.ndarray
    multipliers: np.ndarray
    residual: float
    joints: tuple[np.ndarray, ...]
    unique: bool


@dataclass(frozen=True, eq=False)
class KKTAccelerations:
    """Accelerations under given motor forces.

    Attributes:
        joints: per leg (n_f,).
        twist: (6,) acceleration of the platform, world axes.
        residual: largest unbalanced force or closure acceleration, relative.
    """

    joints: tuple[np.ndarray, ...]
    twist: np.ndarray
    residual: float


class KKTSystem:
    """The equations at one instant: M v' + h = S' tau + J_c' lambda, J_c v' + drift = 0.

    Args:
        kinematics: of the robot.
        motion: of the complete legs.
        gravity: (3,), m/s^2, world axes.
        wrench: (6,) external wrench on the platform about its origin, world axes.
    """

    def __init__(
        self, kinematics: Kinematics, motion: RobotMotion, gravity: np.ndarray, wrench: np.ndarray
    ) -> None:
        legs = kinematics.legs
        self._starts = np.concatenate([[0], np.cumsum([leg.n for leg in legs])])
        count = int(self._starts[-1]) + 6
        M, h = np.zeros((count, count)), np.zeros(count)
        drifts = []
        for i, (leg, part) in enumerate(zip(legs, motion.legs, strict=True)):
            own = slice(self._starts[i], self._starts[i + 1])
            M_i, c_i, g_i, *_ = leg.dynamics(part.q, part.qd, gravity)
            M[own, own], h[own] = M_i, c_i + g_i
            drift = leg.jacobian(part.q, part.qd)[1]
            drifts.append(drift - leg.platform_drift(motion.R, motion.t[3:]))
        body = kinematics.description.platform.inertia
        M_P, c_P, g_P = platform_terms(body, motion.R, motion.t[3:], gravity)
        M[-6:, -6:], h[-6:] = M_P, c_P + g_P - wrench
        self._M, self._h = M, h
        self._idle = np.zeros((count, sum(leg.idle for leg in legs)))
        column = 0
        for i, (leg, part) in enumerate(zip(legs, motion.legs, strict=True)):
            own = slice(self._starts[i], self._starts[i + 1])
            self._idle[own, column : column + leg.idle] = leg.idle_motions(part.q)
            column += leg.idle
        self._J = stacked_closures(legs, [part.q for part in motion.legs], motion.R)
        self._drift = np.concatenate(drifts)
        self._S = np.zeros((count, len(kinematics.description.actuated)))
        for k, (leg, joint) in enumerate(kinematics.description.actuated):
            self._S[self._starts[leg] + joint, k] = 1.0

    def forces(self, joints: tuple[np.ndarray, ...], twist: np.ndarray) -> KKTForces:
        """Motor forces for joint accelerations per leg (n_f,) and the platform's acceleration (6,).

        Idle freedoms take the accelerations that need no forces.
        """
        v = np.concatenate([*joints, twist])
        right = self._M @ v + self._h
        matrix = np.hstack([self._S, self._J.T, -self._M @ self._idle])
        solution, _, rank, _ = np.linalg.lstsq(matrix, right, rcond=_RANK)
        residual = np.abs(matrix @ solution - right).max() / max(np.abs(right).max(), 1e-300)
        motors, multipliers, idle = np.split(solution, np.cumsum([self._S.shape[1], len(self._J)]))
        moved = (v + self._idle @ idle)[: self._starts[-1]]
        joints = tuple(np.split(moved, self._starts[1:-1]))
        unique = rank == matrix.shape[1]
        return KKTForces(motors, multipliers, float(residual), joints, bool(unique))

    def accelerations(self, motors: np.ndarray) -> KKTAccelerations:
        """Accelerations under motor forces (n_a,)."""
        count, rows = len(self._h), len(self._J)
        matrix = np.block([[self._M, self._J.T], [self._J, np.zeros((rows, rows))]])
        right = np.concatenate([self._S @ motors - self._h, -self._drift])
        solution = np.linalg.lstsq(matrix, right, rcond=_RANK)[0]
        residual = np.abs(matrix @ solution - right).max() / max(np.abs(right).max(), 1e-300)
        joints = tuple(solution[a:b] for a, b in zip(self._starts[:-1], self._starts[1:], strict=True))
        return KKTAccelerations(joints, solution[count - 6 : count], float(residual))
