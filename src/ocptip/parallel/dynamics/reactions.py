"""Joint reactions: what every joint of a parallel robot transmits, by free bodies from the leg ends inwards.

Lagrange multipliers give the wrenches at the leg ends (and at inner loops); from there Newton and Euler go
body by body towards the base. With over-constrained closures, or more motors than coordinates, rigid bodies
do not fix the multipliers: those of minimum norm are one choice, and `unique` says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.basics.write import Record
from ocptip.numerics.vectors import cross
from ocptip.parallel.analysis.mobility import stacked_closures
from ocptip.parallel.dynamics.terms import platform_terms
from ocptip.parallel.kinematics.closures import LegClosure
from ocptip.parallel.kinematics.platform import Kinematics, RobotMotion

_RANK = 1e-11


@dataclass(frozen=True, eq=False)
class JointReactions(Record):
    """The reactions that joints transmit, world axes, N and N m.

    Attributes:
        joints: per leg (rows, 6): force and moment of the body before a joint on the one behind it, about the
            origin of the joint's frame; motor forces and friction are their parts along the axis.
        ends: per leg (ends, 6): force and moment of the leg on the platform, about the coupling point.
        motors: (n_a,) motor forces they belong to.
        unique: False if rigid bodies do not fix them (over-constrained, or redundant motors).
        residual: largest unbalanced force, relative.
    """

    joints: tuple[np.ndarray, ...]
    ends: tuple[np.ndarray, ...]
    motors: np.ndarray
    unique: bool
    residual: float


def joint_reactions(
    kinematics: Kinematics, motion: RobotMotion, sd: np.ndarray, gravity: np.ndarray, wrench: np.ndarray
) -> JointReactions:
    """Reactions at one instant.

    Args:
        kinematics: of the robot.
        motion: of the complete legs.
        sd: (m,) s''.
        gravity: (3,), m/s^2, world axes.
        wrench: (6,) external wrench on the platform about its origin, world axes.
    """
    system = MultiplierSystem(kinematics, motion, gravity, wrench)
    accelerations = tuple(leg.Jq @ sd + leg.drift for leg in motion.legs)
    result = system.forces(accelerations, motion.T @ sd + motion.T_drift)
    joints, ends, row = [], [], 0
    for leg, part, qdd in zip(kinematics.legs, motion.legs, result.joints, strict=True):
        rows = len(leg.row_scale(1.0))
        on_leg = result.multipliers[row : row + rows]
        row += rows
        outer, at_ends = _end_wrenches(leg, on_leg)
        joints.append(_reactions(leg, part.q, part.qd, qdd, gravity, outer))
        ends.append(-at_ends)
    return JointReactions(tuple(joints), tuple(ends), result.motors, result.unique, result.residual)


@dataclass(frozen=True, eq=False)
class ClosureForces:
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


class MultiplierSystem:
    """The equations at one instant, M v' + h = S' tau + J_c' lambda: legs, a free-flying platform, closures.

    Least squares, because the multipliers of over-constrained robots are not unique; the residual tells
    whether forces exist.

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
        for i, (leg, part) in enumerate(zip(legs, motion.legs, strict=True)):
            block = slice(self._starts[i], self._starts[i + 1])
            M_i, c_i, g_i, *_ = leg.dynamics(part.q, part.qd, gravity)
            M[block, block], h[block] = M_i, c_i + g_i
        body = kinematics.description.platform.inertia
        M_P, c_P, g_P = platform_terms(body, motion.R, motion.t[3:], gravity)
        M[-6:, -6:], h[-6:] = M_P, c_P + g_P - wrench
        self.M, self.h = M, h
        self._idle = np.zeros((count, sum(leg.idle for leg in legs)))
        column = 0
        for i, (leg, part) in enumerate(zip(legs, motion.legs, strict=True)):
            block = slice(self._starts[i], self._starts[i + 1])
            self._idle[block, column : column + leg.idle] = leg.idle_motions(part.q)
            column += leg.idle
        self.J = stacked_closures(legs, [part.q for part in motion.legs], motion.R)
        self.S = np.zeros((count, len(kinematics.description.actuated)))
        for k, (leg, joint) in enumerate(kinematics.description.actuated):
            self.S[self._starts[leg] + joint, k] = 1.0

    def forces(self, joints: tuple[np.ndarray, ...], twist: np.ndarray) -> ClosureForces:
        """Motor forces for joint accelerations per leg (n_f,) and the platform's acceleration (6,).

        Idle freedoms take the accelerations that need no forces.
        """
        v = np.concatenate([*joints, twist])
        right = self.M @ v + self.h
        matrix = np.hstack([self.S, self.J.T, -self.M @ self._idle])
        solution, _, rank, _ = np.linalg.lstsq(matrix, right, rcond=_RANK)
        residual = np.abs(matrix @ solution - right).max() / max(np.abs(right).max(), 1e-300)
        motors, multipliers, idle = np.split(solution, np.cumsum([self.S.shape[1], len(self.J)]))
        moved = (v + self._idle @ idle)[: self._starts[-1]]
        joints = tuple(np.split(moved, self._starts[1:-1]))
        unique = rank == matrix.shape[1]
        return ClosureForces(motors, multipliers, float(residual), joints, bool(unique))


def _end_wrenches(leg: LegClosure, multipliers: np.ndarray) -> tuple[dict[int, np.ndarray], np.ndarray]:
    """Wrenches (6,) on a leg's rows from its multipliers, about their origins; and at its ends."""
    outer: dict[int, np.ndarray] = {}
    ends = np.zeros((len(leg.end_rows), 6))
    index = 0
    for k, (row, turn) in enumerate(zip(leg.end_rows, leg.end_rotations, strict=True)):
        size = 3 if turn is None else 6
        ends[k, :size] = multipliers[index : index + size]
        outer[row] = outer.get(row, np.zeros(6)) + ends[k]
        index += size
    for a, b in leg.loop_rows:
        force = np.append(multipliers[index : index + 3], np.zeros(3))
        outer[a] = outer.get(a, np.zeros(6)) + force
        outer[b] = outer.get(b, np.zeros(6)) - force
        index += 3
    return outer, ends


def _reactions(
    leg: LegClosure,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    gravity: np.ndarray,
    outer: dict[int, np.ndarray],
) -> np.ndarray:
    """(rows, 6) what the joints transmit, world axes, about the origins of their frames."""
    wrenches, origins = leg.body_loads(q, qd, qdd, gravity), leg.frames(q)[1]
    for row, wrench in outer.items():
        wrenches[row] -= wrench
    for row in reversed(range(len(wrenches))):
        parent, force = leg.topology.parents[row], wrenches[row, :3]
        if parent >= 0:
            moment = wrenches[row, 3:] + cross(origins[row] - origins[parent], force)
            wrenches[parent] += np.concatenate([force, moment])
    return wrenches
