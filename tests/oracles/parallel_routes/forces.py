"""Motor forces of a parallel robot by three routes that the library does not take.

- constraints: derivatives of the closures, bodies by their energies; no geometric Jacobian;
- tree: all loops but one cut, a recursion in link axes;
- multipliers: complete legs, a free-flying platform and Lagrange multipliers.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ocptip.parallel.analysis.singularity import require_regular
from ocptip.parallel.dynamics.reactions import MultiplierSystem
from ocptip.parallel.dynamics.terms import InverseDynamics, motor_drift
from ocptip.parallel.robot import ParallelRobot
from tests.oracles.parallel_routes.constraint import ConstraintRoute
from tests.oracles.parallel_routes.tree import tree_forces

ROUTES = ("constraints", "tree", "multipliers")


def forces_by(route, robot, z, zd, zdd, q=None, *, rates="euler", wrench=None) -> InverseDynamics:
    """Forces by one of `ROUTES`; arguments as of `ParallelRobot.inverse_dynamics`."""
    z, zd, zdd = (np.asarray(one, dtype=float) for one in (z, zd, zdd))
    kinematics, gravity = robot.kinematics, robot.description.gravity
    s, sd = kinematics.quasi(z, zd, zdd) if rates == "euler" else (zd, zdd)
    wrench = np.zeros(6) if wrench is None else np.asarray(wrench, dtype=float)
    complete = route != "constraints" or robot.complete_legs
    joints = robot.ik(z).q if q is None else q
    if not complete:
        joints = [one[: leg.point] for one, leg in zip(joints, kinematics.legs, strict=True)]
    require_regular(kinematics, z, joints, complete=complete)
    motion = kinematics.motion(z, s, joints, complete=complete)
    jacobian = kinematics.actuated_jacobian(motion)
    residual = 0.0
    if route == "constraints":
        H = kinematics.rate_matrices(z, np.zeros(robot.m))[0]
        zd = np.linalg.solve(H, s)
        zdd = np.linalg.solve(H, sd - kinematics.rate_matrices(z, zd)[1] @ zd)
        terms, J_z = _constraints(robot).terms(z, zd, [part.q for part in motion.legs], gravity)
        tau_s = np.linalg.solve(H.T, terms.force(zdd)) - motion.T.T @ wrench
        jacobian = J_z @ np.linalg.inv(H)
        motors = np.linalg.lstsq(jacobian.T, tau_s, rcond=None)[0]
        residual = float(np.abs(jacobian.T @ motors - tau_s).max() / max(np.abs(tau_s).max(), 1e-300))
    elif route == "tree":
        acceleration = jacobian @ sd + motor_drift(robot.description.actuated, motion)
        motors = tree_forces(kinematics, motion, acceleration, gravity, wrench)
    else:
        system = MultiplierSystem(kinematics, motion, gravity, wrench)
        accelerations = tuple(leg.Jq @ sd + leg.drift for leg in motion.legs)
        found = system.forces(accelerations, motion.T @ sd + motion.T_drift)
        motors, residual = found.motors, found.residual
    return InverseDynamics(motors, jacobian.T @ motors, residual)


@cache
def _constraints(robot: ParallelRobot) -> ConstraintRoute:
    return ConstraintRoute(robot.kinematics, complete=robot.complete_legs)
