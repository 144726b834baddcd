"""Equations of motion of the tree with cut loops (openSYMORO's way, (3.2) to (3.9)).

All loops but one are cut at the platform, which stays on the first leg. A recursive Newton-Euler in link axes
gives the forces of all joints of the tree; the cut loops W_a q_a' + W_p q_p' = 0 then carry the passive
joints' forces over to the motors: tau_m = tau_a + J_pa' tau_p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.numerics.vectors import cross
from ocptip.parallel.description.frames import moved_inertia, row_frame
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.description.robot_description import REVOLUTE
from ocptip.parallel.kinematics.closures import LegClosure
from ocptip.parallel.kinematics.platform import Kinematics, RobotMotion

_RANK = 1e-11

Wrench = tuple[np.ndarray, np.ndarray]
"""Force and moment (3,) in the axes of a row's frame, about its origin."""


def tree_forces(
    kinematics: Kinematics,
    motion: RobotMotion,
    motor_acceleration: np.ndarray,
    gravity: np.ndarray,
    wrench: np.ndarray,
) -> np.ndarray:
    """Motor forces (n_a,) by the tree with cut loops.

    Args:
        kinematics: of the robot; the first leg serial, as many motors as coordinates.
        motion: of the complete legs.
        motor_acceleration: (n_a,) q_a''.
        gravity: (3,), m/s^2, world axes.
        wrench: (6,) external wrench on the platform about its origin, world axes.

    Raises:
        InputError: the robot is not of this kind.
    """
    description, legs = kinematics.description, kinematics.legs
    if not legs[0].leg.serial:
        raise InputError("tree: leg 1 branches or has loops")
    if len(description.actuated) != description.m:
        raise InputError("tree: needs as many motors as coordinates")
    if any(leg.idle for leg in legs):
        raise InputError("tree: a leg has idle freedoms")
    starts = np.concatenate([[0], np.cumsum([leg.n for leg in legs])])
    active = [int(starts[leg]) + joint for leg, joint in description.actuated]
    passive = [j for j in range(starts[-1]) if j not in active]

    W, drift = _cut_loops(legs, motion, starts)
    inverse = np.linalg.pinv(W[:, passive], rcond=_RANK)
    J_pa = -inverse @ W[:, active]
    qdd = np.zeros(starts[-1])
    qdd[active] = motor_acceleration
    qdd[passive] = J_pa @ motor_acceleration - inverse @ drift

    forces = []
    for i, (leg, part) in enumerate(zip(legs, motion.legs, strict=True)):
        carried = description.platform.inertia if i == 0 else None
        forces.append(
            leg_newton_euler(leg, part.q, part.qd, qdd[starts[i] : starts[i + 1]], gravity, carried)
        )
    J1, _ = legs[0].jacobian(motion.legs[0].q)
    forces[0] = forces[0] - J1.T @ np.linalg.solve(legs[0].platform_side(motion.R).T, wrench)
    tau = np.concatenate(forces)
    return tau[active] + J_pa.T @ tau[passive]


def leg_newton_euler(
    leg: LegClosure,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    gravity: np.ndarray,
    platform: BodyInertia | None = None,
) -> np.ndarray:
    """Joint forces (n,) of a leg by recursive Newton-Euler in link axes, the platform on its end if given."""
    states = body_states(leg, q, qd, qdd, gravity)
    loads = body_loads(leg, states)
    if platform is not None:
        force, moment = loads[-1]
        more_force, more_moment = _inertial_load(_on_end(platform, leg), states[-1])
        loads[-1] = force + more_force, moment + more_moment
    tau = np.zeros(leg.n)
    rows = zip(leg.topology.rows, leg.topology.joints, transmitted(leg, states, loads), strict=True)
    for row, joint, (force, moment) in rows:
        if joint is not None:
            tau[joint] = moment[2] if row.sigma == REVOLUTE else force[2]
    drive, viscous, coulomb = leg.drives
    return tau + drive * qdd + viscous * qd + coulomb * np.sign(qd)


@dataclass(frozen=True, eq=False)
class BodyState:
    """Motion of a row's frame, in its own axes, and where it stands.

    Attributes:
        turn: (3, 3) to the axes of the row before; arm: (3,), m, origin in that row's frame.
        w, wd: (3,) angular velocity and acceleration; a: (3,) acceleration of the origin minus gravity.
    """

    turn: np.ndarray
    arm: np.ndarray
    w: np.ndarray
    wd: np.ndarray
    a: np.ndarray


def body_states(
    leg: LegClosure, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, gravity: np.ndarray
) -> list[BodyState]:
    """Motion of all rows of a leg from the base on."""
    topology = leg.topology
    states: list[BodyState] = []
    still = BodyState(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), leg.base.T @ -gravity)
    for row, parent, joint in zip(topology.rows, topology.parents, topology.joints, strict=True):
        A, arm = row_frame(row, 0.0 if joint is None else q[joint])
        before = still if parent < 0 else states[parent]
        w, wd = A.T @ before.w, A.T @ before.wd
        a = A.T @ (before.a + cross(before.wd, arm) + cross(before.w, cross(before.w, arm)))
        if joint is not None:
            rate = np.array([0.0, 0.0, qd[joint]])
            if row.sigma == REVOLUTE:
                wd = wd + cross(w, rate) + [0.0, 0.0, qdd[joint]]
                w = w + rate
            else:
                a = a + 2 * cross(w, rate) + [0.0, 0.0, qdd[joint]]
        states.append(BodyState(A, arm, w, wd, a))
    return states


def body_loads(leg: LegClosure, states: Sequence[BodyState]) -> list[Wrench]:
    """Wrench that moves and carries every row's own body."""
    bodies = [*leg.leg.bodies, *[BodyInertia()] * (len(states) - len(leg.leg.bodies))]
    return [_inertial_load(body, state) for body, state in zip(bodies, states, strict=True)]


def transmitted(leg: LegClosure, states: Sequence[BodyState], loads: Sequence[Wrench]) -> list[Wrench]:
    """Wrench that every row gets from the one before: its own load and those of the rows behind it."""
    found = list(loads)
    for k in reversed(range(len(found))):
        parent = leg.topology.parents[k]
        if parent >= 0:
            force, moment = found[parent]
            turned = states[k].turn @ found[k][0]
            moment = moment + states[k].turn @ found[k][1] + cross(states[k].arm, turned)
            found[parent] = force + turned, moment
    return found


def _inertial_load(body: BodyInertia, state: BodyState) -> Wrench:
    """Wrench that moves and carries one body."""
    s, w, wd = body.first_moment, state.w, state.wd
    force = body.mass * state.a + cross(wd, s) + cross(w, cross(w, s))
    return force, body.inertia @ wd + cross(w, body.inertia @ w) + cross(s, state.a)


def _cut_loops(
    legs: Sequence[LegClosure], motion: RobotMotion, starts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """W and W' q' of the loops between the first leg, which carries the platform, and the others."""
    C1 = legs[0].platform_side(motion.R)
    J1, drift1 = legs[0].jacobian(motion.legs[0].q, motion.legs[0].qd)
    to_twist = np.linalg.inv(C1)
    omega = (to_twist @ J1 @ motion.legs[0].qd)[3:]
    J_t = to_twist @ J1
    drift_t = to_twist @ (drift1 - legs[0].platform_drift(motion.R, omega))
    rows, drifts = [], []
    for i, leg in enumerate(legs[1:], start=1):
        C = leg.platform_side(motion.R)
        J, drift = leg.jacobian(motion.legs[i].q, motion.legs[i].qd)
        W = np.zeros((len(J), starts[-1]))
        W[:, : starts[1]] = C @ J_t
        W[:, starts[i] : starts[i + 1]] = -J
        rows.append(W)
        drifts.append(C @ drift_t + leg.platform_drift(motion.R, omega) - drift)
    return np.vstack(rows), np.concatenate(drifts)


def _on_end(platform: BodyInertia, leg: LegClosure) -> BodyInertia:
    """The platform's inertia about the leg's last frame, in its axes."""
    turn = leg.end_rotations[0]
    assert turn is not None, "the home pose fixes it"
    return moved_inertia(platform, (turn, -turn @ leg.couplings[0]))
