"""Equations of motion in quasi-velocities, tau_s = M s'' + c + g, and their other forms (thesis P, 3.3).

tau_s is the generalised force dual to s': force and moment about the platform's origin, world axes, as far as
free. Platform and legs are projected with the legs' inverse Jacobians (3.48) to (3.54).

With more motors than coordinates (5.5.2) J_a^T tau_a = tau_s has many solutions: the shortest one, the
shortest in a weighted norm, and the best within limits of the motors. Forces of the null space of J_a^T
pretension the robot without moving it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import clarabel
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, SolverError, finite_array
from ocptip.basics.write import Record
from ocptip.numerics.cone_program import INFEASIBLE, quiet_settings, solve_cones
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


_SINGULAR = 1e-9
_LIMIT_TOLERANCE = 1e-7


@dataclass(frozen=True, eq=False)
class MotorForces(Record):
    """Motor forces for a generalised force, with evidence.

    Attributes:
        forces: (n_a,), N or N m.
        residual: largest entry of J_a^T tau_a - tau_s relative to the largest of tau_s.
        null_space: (n_a, n_a - rank), orthonormal: forces that balance each other.
        smallest_singular_value: of J_a, relative to its largest.
        at_limit: (n_a,) -1, 0 or 1 where a force lies at its lower or upper limit.
        status: of the solver; "closed form" where there was none.
    """

    forces: np.ndarray
    residual: float
    null_space: np.ndarray
    smallest_singular_value: float
    at_limit: np.ndarray
    status: str


def motor_forces(
    jacobian: ArrayLike,
    generalized_force: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    least_squares: bool = False,
) -> MotorForces:
    """Motor forces of minimum (weighted) norm.

    Args:
        jacobian: J_a, (n_a, m): motor rates from the platform's quasi-velocities.
        generalized_force: tau_s, (m,).
        weights: (n_a,) > 0: minimises sum w_i tau_i^2; default all 1.
        least_squares: with fewer motors than coordinates (n_a < m) return the closest force; its residual is
            large.

    Raises:
        InputError: wrong shapes, weights not positive, or too few motors.
        SolverError: J_a is singular to 1e-9: the motors do not hold the platform.
    """
    J, tau, w = _checked(jacobian, generalized_force, weights)
    if len(J) < J.shape[1] and not least_squares:
        raise InputError(
            f"jacobian: {len(J)} motors cannot move {J.shape[1]} coordinates (under-actuated); "
            "least_squares=True returns the forces that come closest"
        )
    null, smallest = _null_space(J)
    # Singular values of the scaled matrix, not normal equations: the conditioning is not squared.
    root = 1 / np.sqrt(w)
    forces = root * (np.linalg.pinv((J * root[:, None]).T, rcond=1e-13) @ tau)
    return _result(J, tau, forces, null, smallest, np.zeros(len(J), dtype=int), "closed form")


def limited_motor_forces(
    jacobian: ArrayLike,
    generalized_force: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    preferred: ArrayLike | None = None,
) -> MotorForces:
    """Motor forces within limits, closest to preferred ones: a quadratic program.

    min sum w_i (tau_i - preferred_i)^2 subject to J_a^T tau_a = tau_s, lower <= tau_a <= upper.

    Args:
        jacobian, generalized_force, weights: see :func:`motor_forces`.
        lower, upper: (n_a,), may be infinite.
        preferred: (n_a,), for example a pretension; default zero.

    Raises:
        InputError: wrong shapes, lower above upper, or too few motors.
        SolverError: no forces within the limits hold tau_s, or the solution could not be verified.
    """
    J, tau, w = _checked(jacobian, generalized_force, weights)
    n = len(J)
    low, high = (np.asarray(value, dtype=float) for value in (lower, upper))
    if low.shape != (n,) or high.shape != (n,) or np.isnan(low).any() or np.isnan(high).any():
        raise InputError(f"lower, upper: expected {n} numbers each, got {lower!r} and {upper!r}")
    if not np.all(low <= high):
        motor = int(np.argmax(low > high))
        raise InputError(f"lower, upper: motor {motor + 1} has lower {low[motor]} above upper {high[motor]}")
    wish = np.zeros(n) if preferred is None else finite_array("preferred", preferred, (n,))
    if n < J.shape[1]:
        raise InputError(f"jacobian: {n} motors cannot move {J.shape[1]} coordinates (under-actuated)")
    null, smallest = _null_space(J)
    finite = [np.concatenate([high, wish, tau]), low]
    scale = max(1.0, *(np.abs(part[np.isfinite(part)]).max(initial=0.0) for part in finite))
    eye = np.eye(n)
    bounded_high, bounded_low = np.isfinite(high), np.isfinite(low)
    A = np.vstack([J.T, eye[bounded_high], -eye[bounded_low]])
    b = np.concatenate([tau, high[bounded_high], -low[bounded_low]]) / scale
    inequalities = int(bounded_high.sum() + bounded_low.sum())
    cones: list[Any] = [clarabel.ZeroConeT(J.shape[1])]
    if inequalities:
        cones.append(clarabel.NonnegativeConeT(inequalities))
    answer = solve_cones(-w * wish / scale, A, b, cones, quiet_settings(), quadratic=np.diag(w))
    status = str(answer.status)
    forces = np.clip(scale * np.array(answer.x), low, high)
    if status in INFEASIBLE:
        raise SolverError("no motor forces within the limits hold the generalised force (infeasible)")
    tolerance = _LIMIT_TOLERANCE * (high - low + np.abs(forces) + 1e-300)
    tolerance[~np.isfinite(tolerance)] = _LIMIT_TOLERANCE * scale
    at_limit = (forces >= high - tolerance).astype(int) - (forces <= low + tolerance).astype(int)
    # The clipped solution is put back on the equations by the motors that are free to move.
    free = at_limit == 0
    if free.any():
        forces[free] += np.linalg.lstsq(J[free].T, tau - J.T @ forces, rcond=None)[0]
    result = _result(J, tau, forces, null, smallest, at_limit, status)
    overrun = max(float(np.max(low - forces)), float(np.max(forces - high)))
    if status != "Solved" or result.residual > 1e-7 or overrun > _LIMIT_TOLERANCE * scale:
        raise SolverError(
            f"motor forces within limits: status {status}, residual {result.residual:.1e}, largest overrun "
            f"of a limit {max(overrun, 0.0):.1e}"
        )
    return result


def _checked(
    jacobian: ArrayLike, generalized_force: ArrayLike, weights: ArrayLike | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    J = finite_array("jacobian", jacobian, (None, None))
    tau = finite_array("generalized_force", generalized_force, (J.shape[1],))
    w = np.ones(len(J)) if weights is None else finite_array("weights", weights, (len(J),))
    if not np.all(w > 0):
        raise InputError(f"weights: must be > 0, got {weights!r}")
    return J, tau, w


def _null_space(J: np.ndarray) -> tuple[np.ndarray, float]:
    singular = scipy.linalg.svdvals(J)
    smallest = float(singular[-1] / singular[0]) if singular[0] > 0 else 0.0
    if smallest < _SINGULAR:
        raise SolverError(
            f"J_a is singular (smallest over largest singular value {smallest:.1e}): the motors do not "
            "hold the platform in this pose (type II singularity)"
        )
    return scipy.linalg.null_space(J.T), smallest


def _result(
    J: np.ndarray,
    tau: np.ndarray,
    forces: np.ndarray,
    null: np.ndarray,
    smallest: float,
    at_limit: np.ndarray,
    status: str,
) -> MotorForces:
    residual = float(np.abs(J.T @ forces - tau).max() / max(np.abs(tau).max(), 1e-300))
    return MotorForces(forces, residual, null, smallest, at_limit, status)
