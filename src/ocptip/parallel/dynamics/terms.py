"""Equations of motion in quasi-velocities, tau_s = M s'' + c + g, and their other forms (thesis P, 3.3).

tau_s is the generalised force dual to s': force and moment about the platform's origin, world axes, as far as
free. Platform and legs are projected with the legs' inverse Jacobians (3.48) to (3.54).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import Record
from ocptip.numerics.vectors import cross, skew
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.kinematics.platform import Kinematics, RobotMotion

FORMS = ("S", "X", "Z", "A", "AA")


@dataclass(frozen=True, eq=False)
class DynamicTerms(Record):
    """Force = M acceleration + c + g in one of the forms.

    ==== ========================= =====================================================
    form acceleration              force
    ==== ========================= =====================================================
    S    s''                       tau_s, dual to s'
    X    z''                       tau_s
    Z    z''                       tau_z = H' tau_s, dual to z' (ParaDyn's form)
    A    s''                       motor forces tau_a
    AA   q_a'', of the motors      motor forces tau_a
    ==== ========================= =====================================================

    Attributes:
        form: see above.
        M: mass matrix; symmetric in the forms S, Z and AA.
        c: centrifugal, Coriolis and friction forces.
        g: gravity forces.
    """

    form: str
    M: np.ndarray
    c: np.ndarray
    g: np.ndarray

    def force(self, acceleration: np.ndarray) -> np.ndarray:
        """M acceleration + c + g."""
        return self.M @ acceleration + self.c + self.g


@dataclass(frozen=True, eq=False)
class InverseDynamics(Record):
    """Result of the inverse dynamics.

    Attributes:
        motors: (n_a,) motor forces, N or N m; of redundant drives those with the smallest norm.
        generalized: (m,) tau_s dual to s', N and N m.
        residual: part of tau_s that the motors cannot balance, relative.
    """

    motors: np.ndarray
    generalized: np.ndarray
    residual: float


def quasi_terms(kinematics: Kinematics, motion: RobotMotion, gravity: np.ndarray) -> DynamicTerms:
    """Form S by projection of legs and platform.

    Args:
        kinematics: of the robot.
        motion: of all joints, or of the joints up to the coupling points.
        gravity: (3,), m/s^2, world axes.
    """
    M_P, c_P, g_P = platform_terms(kinematics.description.platform.inertia, motion.R, motion.t[3:], gravity)
    T = motion.T
    M = T.T @ M_P @ T
    c = T.T @ (M_P @ motion.T_drift + c_P)
    g = T.T @ g_P
    for leg, part in zip(kinematics.legs, motion.legs, strict=True):
        n = len(part.q)
        M_i, c_i, g_i, *_ = leg.dynamics(leg.padded(part.q), leg.padded(part.qd), gravity)
        M_i = M_i[:n, :n]
        M += part.Jq.T @ M_i @ part.Jq
        c += part.Jq.T @ (M_i @ part.drift + c_i[:n])
        g += part.Jq.T @ g_i[:n]
    return DynamicTerms("S", 0.5 * (M + M.T), c, g)


def platform_terms(
    body: BodyInertia, R: np.ndarray, omega: np.ndarray, gravity: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M_P (6, 6), c_P (6,) and g_P (6,) of the platform about P, world axes (3.47)."""
    s, inertia = R @ body.first_moment, R @ body.inertia @ R.T
    M = np.block([[body.mass * np.eye(3), -skew(s)], [skew(s), inertia]])
    c = np.concatenate([cross(omega, cross(omega, s)), cross(omega, inertia @ omega)])
    return M, c, -np.concatenate([body.mass * gravity, cross(s, gravity)])


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


def needs_complete_legs(kinematics: Kinematics) -> bool:
    """True if the joints behind the coupling points take part: by the table, or by inertia or friction."""
    description = kinematics.description
    if not description.coupling_form:
        return True
    for leg in description.legs:
        tail = (*leg.drive_inertia[leg.n :], *leg.viscous[leg.n :], *leg.coulomb[leg.n :])
        if any(tail) or not all(body.massless for body in leg.bodies[leg.n :]):
            return True
    return False


def converted(
    terms: DynamicTerms,
    form: str,
    *,
    rates: tuple[np.ndarray, np.ndarray],
    zd: np.ndarray,
    jacobian: np.ndarray,
    motor_drift: np.ndarray,
) -> DynamicTerms:
    """Form S in another form.

    Args:
        terms: form S.
        form: S, X, Z, A or AA.
        rates: H and H', s'' = H z'' + H' z'.
        zd: (m,) z'.
        jacobian: J_a (n_a, m).
        motor_drift: (n_a,) q_a'' = J_a s'' + drift.

    Raises:
        InputError: unknown form; A and AA need as many motors as coordinates.
    """
    if form not in FORMS:
        raise InputError(f"form: must be one of {', '.join(FORMS)}, got {form!r}")
    if form == "S":
        return terms
    M, c, g = terms.M, terms.c, terms.g
    if form in ("X", "Z"):
        H, D = rates
        M, c = M @ H, c + M @ D @ zd
        return DynamicTerms("Z", H.T @ M, H.T @ c, H.T @ g) if form == "Z" else DynamicTerms("X", M, c, g)
    if jacobian.shape[0] != jacobian.shape[1]:
        raise InputError(
            f"form {form}: needs as many motors as coordinates, got {len(jacobian)} and {jacobian.shape[1]}"
        )
    if form == "AA":
        inverse = np.linalg.inv(jacobian)
        c, M = c - M @ inverse @ motor_drift, M @ inverse
    return DynamicTerms(form, *(np.linalg.solve(jacobian.T, value) for value in (M, c, g)))


def motor_drift(description_actuated: Sequence[tuple[int, int]], motion: RobotMotion) -> np.ndarray:
    """(n_a,) motor accelerations at s'' = 0."""
    return np.array([motion.legs[leg].drift[joint] for leg, joint in description_actuated])
