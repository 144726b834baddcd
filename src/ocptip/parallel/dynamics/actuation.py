"""Motor forces of parallel robots with more motors than degrees of freedom (thesis P, 5.5.2).

J_a^T tau_a = tau_s has many solutions then: the shortest one, the shortest in a weighted norm, and the best
within limits of the motors. Forces of the null space of J_a^T pretension the robot without moving it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import clarabel
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, SolverError, finite_array
from ocptip.basics.write import Record
from ocptip.numerics.cone_program import INFEASIBLE, quiet_settings, solve_cones

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
