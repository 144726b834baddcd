"""Optimality conditions of redistributions and Newton steps on them.

The cone programs of `fractional` and `minimax` give a point and multipliers to some eight digits. From there,
with the active contacts known, the conditions are a square system whose solution is exact to rounding, and
whose signs prove the optimum: for fixed t the cone program is convex, so that its conditions suffice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_STEPS = 4
_REGULARISATION = 1e-13
_APEX = 1e-4
_EXACT = 1e-11
_SETTLED = 1e-14  # residual that steps do not lower


@dataclass(frozen=True)
class ForceRange:
    """Normal forces and limits of n contacts in N states, in units of the largest force of the state.

    Attributes:
        normal: (N, n) normal forces p_i at z = 0.
        per_z: (N, n, nz) their change P_i per unit of z.
        radius, slope: (N, n) limit = radius + slope times the normal force.
        lower, upper: (N, n) finite ends of the normal force.
    """

    normal: np.ndarray
    per_z: np.ndarray
    radius: np.ndarray
    slope: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @property
    def rough(self) -> np.ndarray:
        """(N, n) True for contacts that have a tangential limit."""
        return (self.radius != 0) | (self.slope != 0)

    def normals(self, z: np.ndarray) -> np.ndarray:
        """(N, n) normal forces at z, not outside their ends."""
        return np.clip(self.normal + np.einsum("siz,sz->si", self.per_z, z), self.lower, self.upper)

    def limits(self, z: np.ndarray) -> np.ndarray:
        """(N, n) tangential limits at z."""
        return np.maximum(self.radius + self.slope * self.normals(z), 0.0)

    def take(self, rows: np.ndarray) -> ForceRange:
        """The selected states."""
        return ForceRange(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class RefinedPoint:
    """Result of the Newton steps, see `FractionalOptimum`; `proven` (N,): all conditions hold."""

    t: np.ndarray
    z: np.ndarray
    pull: np.ndarray
    normal_pull: np.ndarray
    residual: np.ndarray
    proven: np.ndarray


@dataclass(frozen=True)
class ActiveSet:
    """Which conditions hold with equality.

    Attributes:
        cone: (N, n) True where |T_i| = t limit_i.
        pinned: (N, n, d) force components (n, t1, t2) that are fixed: a normal force at an end of its range,
            all components at the apex of a friction cone.
        target: (N, n) normal force at which it is pinned.
    """

    cone: np.ndarray
    pinned: np.ndarray
    target: np.ndarray


def refined(
    q: np.ndarray,
    Q: np.ndarray,
    forces: ForceRange,
    z: np.ndarray,
    t: np.ndarray,
    pull: np.ndarray,
    normal_pull: np.ndarray,
) -> RefinedPoint:
    """Newton steps from z (N, nz), t (N,) and the derivatives pull (N, n, k), normal_pull (N, n).

    Unknown are z, t, the multipliers w_i of the contacts on their cone and a of the pinned components:

        sum w_i (Q_i'T_i/|T_i| - t slope_i P_i) + (pinned rows)'a = 0,    sum w_i limit_i = 1,

    with T = q + Q z and P = forces.per_z.
    """
    w = lengths(pull)
    active = _active_set(q + forces_of(Q, z), forces, z, t, w, normal_pull)
    end_pull = normal_pull + t[:, None] * w * forces.slope
    a = np.concatenate([end_pull[:, :, None], pull], axis=2) * active.pinned
    w = np.where(active.cone, w, 0.0)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        # The active set stays fixed: then the conditions are smooth, and Newton's method is quadratic. A
        # wrong guess fails the test of the signs.
        matrix, rhs, unit = _conditions(q, Q, forces, active, z, t, w, a)
        for _ in range(_STEPS):
            if np.all(np.abs(rhs) < _SETTLED):
                break
            step = solve_each(matrix, rhs)
            dz, dt, dw, da = np.split(step, np.cumsum([z.shape[1], 1, w.shape[1]]), axis=1)
            z, t, w, a = z + dz, t + dt[:, 0], w + dw, a + da.reshape(a.shape)
            matrix, rhs, unit = _conditions(q, Q, forces, active, z, t, w, a)
        residual = np.max(np.abs(rhs), axis=1)
        proven = (residual < _EXACT) & _signs_hold(q + forces_of(Q, z), forces, active, z, t, w, a)
    return RefinedPoint(
        t=t,
        z=z,
        pull=w[:, :, None] * unit + a[:, :, 1:],
        normal_pull=a[:, :, 0] - t[:, None] * w * forces.slope,
        residual=residual,
        proven=proven,
    )


def _active_set(
    T: np.ndarray, forces: ForceRange, z: np.ndarray, t: np.ndarray, w: np.ndarray, normal_pull: np.ndarray
) -> ActiveSet:
    """Guess from a nearly optimal point: active is what has a multiplier larger than its slack."""
    limits, normals = forces.limits(z), forces.normals(z)
    # At the apex of a cone the direction of the force is undefined; all its components are pinned instead.
    largest = np.max(limits, axis=1, keepdims=True)
    apex_normal = np.where(forces.slope >= 0, forces.lower, forces.upper)
    apex = (limits < _APEX * largest) & (np.abs(forces.radius + forces.slope * apex_normal) < _EXACT)
    apex &= forces.rough  # without friction no cone closes where the normal force ends
    slack = 1.0 - lengths(T) / np.maximum(t[:, None] * limits, _EXACT)
    cone = (w * largest > slack) & ~apex & forces.rough
    end_pull = normal_pull + t[:, None] * w * forces.slope
    end = np.where(end_pull < 0, forces.lower, forces.upper)
    at_end = np.abs(normals - end) < np.abs(end_pull) * largest
    pinned = np.repeat(apex[:, :, None], T.shape[2] + 1, axis=2)
    pinned[:, :, 0] = (at_end | apex) & np.any(forces.per_z != 0, axis=2)
    return ActiveSet(cone, pinned, np.where(apex, apex_normal, end))


def _conditions(
    q: np.ndarray,
    Q: np.ndarray,
    forces: ForceRange,
    active: ActiveSet,
    z: np.ndarray,
    t: np.ndarray,
    w: np.ndarray,
    a: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Jacobian (N, p, p), negative residuals (N, p) and unit vectors T_i/|T_i| (N, n, k).

    Rows: stationarity in z and t, contacts on their cone, pinned components. Rows of conditions that are not
    active say that their multiplier stays zero.
    """
    count, n, k = q.shape
    nz = Q.shape[3]
    P, slope, cone = forces.per_z, forces.slope, active.cone
    T = q + forces_of(Q, z)
    normals = forces.normal + np.einsum("siz,sz->si", P, z)
    limits, size = forces.radius + slope * normals, np.where(cone, lengths(T), 1.0)
    unit = T / size[:, :, None]
    along = np.einsum("sikz,sik->siz", Q, unit)
    G = (along - (t[:, None] * slope)[:, :, None] * P) * cone[:, :, None]
    rows = np.concatenate([P[:, :, None], Q], axis=2) * active.pinned[:, :, :, None]
    rows = rows.reshape(count, n * (k + 1), nz)
    error = np.concatenate([(normals - active.target)[:, :, None], T], axis=2) * active.pinned

    p = nz + 1 + n + n * (k + 1)
    cones, pins = slice(nz + 1, nz + 1 + n), slice(nz + 1 + n, p)
    kept = np.concatenate([cone, active.pinned.reshape(count, -1)], axis=1)
    matrix, rhs = np.zeros((count, p, p)), np.zeros((count, p))
    matrix[:, :nz, :nz] = (
        weighted_gram(w / size, Q) - weighted_gram(w / size, along[:, :, None]) + _REGULARISATION * np.eye(nz)
    )
    matrix[:, :nz, nz] = matrix[:, nz, :nz] = -np.einsum("si,siz->sz", w * slope, P)
    matrix[:, cones, :nz], matrix[:, :nz, cones] = G, G.swapaxes(1, 2)
    matrix[:, cones, nz] = matrix[:, nz, cones] = -limits * cone
    matrix[:, pins, :nz], matrix[:, :nz, pins] = rows, rows.swapaxes(1, 2)
    matrix[:, nz + 1 :, nz + 1 :] = -np.where(kept, _REGULARISATION, 1.0)[:, :, None] * np.eye(p - nz - 1)
    rhs[:, :nz] = -np.einsum("si,siz->sz", w, G) - np.einsum("siz,si->sz", rows, a.reshape(count, -1))
    rhs[:, nz] = np.sum(w * limits, axis=1) - 1.0
    rhs[:, cones] = (t[:, None] * limits - size) * cone
    rhs[:, pins] = -error.reshape(count, -1)
    return matrix, rhs, unit


def _signs_hold(
    T: np.ndarray,
    forces: ForceRange,
    active: ActiveSet,
    z: np.ndarray,
    t: np.ndarray,
    w: np.ndarray,
    a: np.ndarray,
) -> np.ndarray:
    """(N,) True where all forces are admissible and all multipliers push towards the inside.

    At an apex the multiplier must lie in the dual of the friction cone.
    """
    normals = forces.normal + np.einsum("siz,sz->si", forces.per_z, z)
    limits = forces.radius + forces.slope * normals
    bearable = np.abs(forces.slope) * t[:, None] * lengths(a[:, :, 1:])
    outwards = np.where(active.target == forces.lower, a[:, :, 0], -a[:, :, 0]) + bearable
    inside = (normals >= forces.lower - _EXACT) & (normals <= forces.upper + _EXACT)
    within = lengths(T) <= t[:, None] * limits + _EXACT
    signs = (w >= -_EXACT) & (~active.pinned[:, :, 0] | (outwards <= _EXACT))
    return np.all(inside & within & signs, axis=1)


def forces_of(Q: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Q_i z: (N, n, k) from Q (N, n, k, nz) and z (N, nz)."""
    return np.einsum("sikz,sz->sik", Q, z)


def weighted_gram(weights: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """sum_i weights_i Q_i'Q_i: (N, nz, nz) from weights (N, n) and Q (N, n, k, nz)."""
    count, n, k, nz = Q.shape
    flat = Q.reshape(count, n * k, nz)
    return (flat * np.repeat(weights, k, axis=1)[:, :, None]).swapaxes(1, 2) @ flat


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Euclidean lengths over the last axis."""
    return np.sqrt(np.einsum("...k,...k->...", vectors, vectors))


def solve_each(matrix: np.ndarray, rhs: np.ndarray) -> np.ndarray:
    """Solutions (N, p) of the systems (N, p, p); NaN where one is singular or not finite."""
    usable = np.all(np.isfinite(matrix), axis=(1, 2))
    solution = np.full(rhs.shape, np.nan)
    try:
        solution[usable] = np.linalg.solve(matrix[usable], rhs[usable, :, None])[:, :, 0]
    except np.linalg.LinAlgError:  # rarely
        usable[usable] = np.linalg.slogdet(matrix[usable])[0] != 0
        solution[usable] = np.linalg.solve(matrix[usable], rhs[usable, :, None])[:, :, 0]
    return solution
