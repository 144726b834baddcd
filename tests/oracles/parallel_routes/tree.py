"""Equations of motion of the tree with cut loops (openSYMORO's way, (3.2) to (3.9)).

All loops but one are cut at the platform, which stays on the first leg. A recursive Newton-Euler in link axes
gives the forces of all joints of the tree; the cut loops W_a q_a' + W_p q_p' = 0 then carry the passive
joints' forces over to the motors: tau_m = tau_a + J_pa' tau_p.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.parallel.description.body_inertia import BodyInertia
from ocptip.parallel.description.mdh import moved_inertia
from ocptip.parallel.description.robot_description import REVOLUTE, Leg
from ocptip.parallel.dynamics.reactions import body_loads, body_states, inertial_load, transmitted
from ocptip.parallel.kinematics.closures import LegClosure
from ocptip.parallel.kinematics.platform import Kinematics, RobotMotion

_RANK = 1e-11


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
    if not isinstance(legs[0].leg, Leg):
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
        more_force, more_moment = inertial_load(_on_end(platform, leg), states[-1])
        loads[-1] = force + more_force, moment + more_moment
    tau = np.zeros(leg.n)
    rows = zip(leg.topology.rows, leg.topology.joints, transmitted(leg, states, loads), strict=True)
    for row, joint, (force, moment) in rows:
        if joint is not None:
            tau[joint] = moment[2] if row.sigma == REVOLUTE else force[2]
    drive, viscous, coulomb = leg.drives
    return tau + drive * qdd + viscous * qd + coulomb * np.sign(qd)


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
