"""Joint reactions: what every joint of a parallel robot transmits, by free bodies from the leg ends inwards.

Lagrange multipliers give the wrenches at the leg ends (and at inner loops); from there Newton and Euler go
body by body towards the base. With over-constrained closures, or more motors than coordinates, rigid bodies
do not fix the multipliers: those of least norm are one choice, and `unique` says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.basics.write import Record
from ocptip.parallel.kinematics.closures import LegClosure
from ocptip.parallel.kinematics.platform import Kinematics, RobotMotion
from ocptip.parallel.routes.kkt import KKTSystem
from ocptip.parallel.routes.tree import body_loads, body_states, transmitted


@dataclass(frozen=True, eq=False)
class JointReactions(Record):
    """What joints transmit, world axes, N and N m.

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
    system = KKTSystem(kinematics, motion, gravity, wrench)
    accelerations = tuple(leg.Jq @ sd + leg.drift for leg in motion.legs)
    found = system.forces(accelerations, motion.T @ sd + motion.T_drift)
    joints, ends, row = [], [], 0
    for leg, part, qdd in zip(kinematics.legs, motion.legs, found.joints, strict=True):
        rows = len(leg.row_scale(1.0))
        on_leg = found.multipliers[row : row + rows]
        row += rows
        outer, at_ends = _end_wrenches(leg, on_leg)
        joints.append(_reactions(leg, part.q, part.qd, qdd, gravity, outer))
        ends.append(-at_ends)
    return JointReactions(tuple(joints), tuple(ends), found.motors, found.unique, found.residual)


def _end_wrenches(leg: LegClosure, multipliers: np.ndarray) -> tuple[dict[int, np.ndarray], np.ndarray]:
    """Wrenches (6,) on a leg's rows from its multipliers, about their origins; and at its ends."""
    outer: dict[int, np.ndarray] = {}
    ends = np.zeros((len(leg.end_rows), 6))
    at = 0
    for k, (row, turn) in enumerate(zip(leg.end_rows, leg.end_rotations, strict=True)):
        size = 3 if turn is None else 6
        ends[k, :size] = multipliers[at : at + size]
        outer[row] = outer.get(row, np.zeros(6)) + ends[k]
        at += size
    for a, b in leg.loop_rows:
        force = np.append(multipliers[at : at + 3], np.zeros(3))
        outer[a] = outer.get(a, np.zeros(6)) + force
        outer[b] = outer.get(b, np.zeros(6)) - force
        at += 3
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
    states = body_states(leg, q, qd, qdd, gravity)
    loads = body_loads(leg, states)
    turns = leg.frames(q)[0]
    for row, wrench in outer.items():
        force, moment = loads[row]
        loads[row] = force - turns[row].T @ wrench[:3], moment - turns[row].T @ wrench[3:]
    return np.array(
        [
            np.concatenate([turn @ f, turn @ n])
            for turn, (f, n) in zip(turns, transmitted(leg, states, loads), strict=True)
        ]
    )
