"""Regressor: generalized forces as a linear function of the inertia parameters (section 7), any robot."""

from __future__ import annotations

import numpy as np

from ocptip.parallel.description.body_inertia import BodyInertia
from ocptip.parallel.dynamics.terms import platform_terms
from ocptip.parallel.kinematics.platform import Kinematics, RobotMotion


def regressor(kinematics: Kinematics, motion: RobotMotion, sd: np.ndarray, gravity: np.ndarray) -> np.ndarray:
    """W (m, 10 bodies): tau_s = W p without friction, drives and external wrench.

    p is `RobotDescription.inertia_vector`: DynPar 2 of all bodies, leg by leg, the platform last. Columns of
    equal legs may be added. For generated code see :func:`ocptip.parallel.code.lean.lean_function`.

    Args:
        kinematics: of the robot.
        motion: of all joints, or of the joints up to the coupling points.
        sd: (m,) s''.
        gravity: (3,), m/s^2, world axes.
    """
    columns = []
    for leg, part in zip(kinematics.legs, motion.legs, strict=True):
        n = len(part.q)
        q, qd = leg.padded(part.q), leg.padded(part.qd)
        qdd = part.Jq @ sd + part.drift
        for unit in np.eye(len(leg.inertia)):
            M, c, g = leg.body_dynamics(q, qd, gravity, unit)[:3]
            columns.append(part.Jq.T @ (M[:n, :n] @ qdd + c[:n] + g[:n]))
    acceleration = motion.T @ sd + motion.T_drift
    for unit in np.eye(10):
        M, c, g = platform_terms(BodyInertia.from_vector(unit), motion.R, motion.t[3:], gravity)
        columns.append(motion.T.T @ (M @ acceleration + c + g))
    return np.array(columns).T
