"""The minimax usage of the friction limits of contacts in one plane, by duality in three dimensions.

Tangential forces f_i (2,) at n contacts balance a load h of three components: sum J_i' f_i = h with J_i (2,
3), the columns of all J_i together orthonormal. The minimum over f of the largest usage |f_i| / l_i is the
largest ratio of h . u to sum l_i |J_i u| over planar motions u: the power of the load against the friction of
contacts that all slide. The maximum is at a rotation about a contact or at a smooth point; Newton steps reach
it on half the square of the friction's power minus h . u, which is convex. Forces and motion are two bounds
that prove each other.
"""

from __future__ import annotations

import numpy as np

from ocptip.numerics.jit.compiled import compiled

_GAP = 1e-10  # relative: between the bounds of a value that is good enough
_STEPS = 60  # Newton steps
_NOISE = 1e-10  # relative
_SURE, _STILL = 1e-7, 1e-7  # gap between the bounds; speed of a contact turned about, relative to the largest
_LEAST_LIMIT = 1e-6  # of a contact that carries load, relative to the largest


def planar_forces(q: np.ndarray, J: np.ndarray, limits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces (N, n, 2) with the minimax usage that balance what q balances, and pulls (N, n, 2).

    A pull is the velocity of its contact in the motion u, scaled so that the friction's power is 1. Whether
    they are optimal is for the caller to see: the largest usage and sum pull . q are upper and lower bound.

    Args:
        q: (N, n, 2) tangential forces, N.
        J: (N, n, 2, 3) with orthonormal columns.
        limits: (N, n) > 0, N.
    """
    loads = np.einsum("sik,sikr->sr", q, J)
    forces, pulls = np.zeros(q.shape), np.zeros(q.shape)
    solve_planar(loads, np.ascontiguousarray(limits), np.ascontiguousarray(J), forces, pulls)
    return forces, pulls


def usage_map(
    wrenches: np.ndarray,
    loads: np.ndarray,
    limits: np.ndarray,
    preloads: np.ndarray,
    J: np.ndarray,
    derivatives: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The minimax usage as a function of the wrench, with two derivatives.

    Args:
        wrenches: (N, 6).
        loads: (3, 6): the load h that the forces balance is loads @ wrench.
        limits: (n, 6): friction limits are limits @ wrench + preloads.
        preloads: (n,), N.
        J: (n, 2, 3) with orthonormal columns.
        derivatives: else they are zero.

    Returns:
        Usage (N,), slopes (N, 6), second derivatives (N, 6, 6). Where the limits are not all positive, or
        the optimum is not certain, the usage is NaN and the derivatives are zero.
    """
    count = len(wrenches)
    slopes, bends = np.zeros((count, 6)), np.zeros((count, 6, 6))
    usage = _usages(np.ascontiguousarray(wrenches), loads, limits, preloads, J, derivatives, slopes, bends)
    return usage, slopes, bends


@compiled
def _usages(wrenches, loads, limits, preloads, J, derivatives, slopes, bends):
    """Usages (N,); puts slopes and second derivatives."""
    count, n = len(wrenches), len(limits)
    h, most, safe = np.empty((count, 3)), np.empty((count, n)), np.empty((count, n))
    forces, pulls = np.zeros((count, n, 2)), np.zeros((count, n, 2))
    usage, good = np.zeros(count), np.empty(count, dtype=np.bool_)
    for s in range(count):
        for r in range(3):
            h[s, r] = 0.0
            for k in range(6):
                h[s, r] += loads[r, k] * wrenches[s, k]
        least, largest = np.inf, 0.0
        for i in range(n):
            most[s, i] = preloads[i]
            for k in range(6):
                most[s, i] += limits[i, k] * wrenches[s, k]
            least, largest = min(least, most[s, i]), max(largest, abs(most[s, i]))
        # A limit near 0 makes the usage a ratio of rounding errors: such states are left to the cone program.
        good[s] = least > _LEAST_LIMIT * largest
        for i in range(n):
            safe[s, i] = most[s, i] if good[s] else 1.0
    solve_planar(h, safe, J.reshape(1, n, 2, 3), forces, pulls)
    for s in range(count):
        for i in range(n):
            x, y = forces[s, i, 0], forces[s, i, 1]
            usage[s] = max(usage[s], np.sqrt(x * x + y * y) / abs(most[s, i]))
    _derive(h, most, J, loads, limits, pulls, usage, slopes, bends, derivatives, good)
    for s in range(count):
        if not good[s]:
            usage[s] = np.nan
    return usage


@compiled
def _derive(h, most, J, loads, limits, pulls, usage, slopes, bends, derivatives, good):
    """Puts slopes and second derivatives of usages; not `good` is where both bounds of the usage disagree.

    Half the square of the usage rho is the largest h . u - D(u)^2 / 2 over motions u, D the friction's power:
    by the envelope theorem its slope is that of h and of the limits at the best u. Its curvature is C' H^-1 C
    minus that of the squared limits, with H the curvature over u and C the slope of the gradient over u. At a
    rotation about a contact u stays as it is, and rho is a ratio of affine functions.
    """
    count, n = most.shape
    u, g, L, slope = np.empty(3), np.empty(3), np.empty(6), np.empty(6)
    H, C, column = np.empty((3, 3)), np.empty((6, 3)), np.empty(3)  # C is kept transposed
    for s in range(count):
        rho = usage[s]
        largest = 0.0
        for r in range(3):
            u[r] = 0.0
        for i in range(n):
            x, y = pulls[s, i, 0], pulls[s, i, 1]
            largest = max(largest, np.sqrt(x * x + y * y))
            for r in range(3):
                u[r] += J[i, 0, r] * x + J[i, 1, r] * y
        # The power of the load in u, scaled to unit power of the friction, is the lower bound of the usage.
        if not abs(rho - _power(h[s], u)) <= _SURE * max(1.0, rho):
            good[s] = False
            continue
        if not derivatives or rho < _SURE:
            continue
        for r in range(3):
            g[r] = H[r, 0] = H[r, 1] = H[r, 2] = 0.0
        for k in range(6):
            L[k] = C[k, 0] = C[k, 1] = C[k, 2] = 0.0
        pivots = False
        for i in range(n):
            x, y = pulls[s, i, 0], pulls[s, i, 1]
            speed = np.sqrt(x * x + y * y)
            for k in range(6):
                L[k] += speed * limits[i, k]
            # The contact about which the base turns has no velocity, so its friction has no derivative there.
            if speed <= _STILL * largest:
                pivots = True
                continue
            x, y = x / speed, y / speed
            for r in range(3):
                along = x * J[i, 0, r] + y * J[i, 1, r]
                g[r] += most[s, i] * along
                for k in range(6):
                    C[k, r] -= rho * along * limits[i, k]
                across = most[s, i] / speed * (x * J[i, 1, r] - y * J[i, 0, r])
                for c in range(3):
                    H[r, c] += across * (x * J[i, 1, c] - y * J[i, 0, c])
        for k in range(6):
            slope[k] = u[0] * loads[0, k] + u[1] * loads[1, k] + u[2] * loads[2, k]
            slopes[s, k] = slope[k] - rho * L[k]
        if pivots:
            for k in range(6):
                for m in range(6):
                    bends[s, k, m] = 2 * rho * L[k] * L[m] - slope[k] * L[m] - L[k] * slope[m]
            continue
        for r in range(3):
            for k in range(6):
                C[k, r] += loads[r, k] - rho * g[r] * L[k]
            for c in range(3):
                H[r, c] += g[r] * g[c]
        for k in range(6):
            _solve_3(H, C[k], column)
            for m in range(6):
                bends[s, m, k] = (
                    _power(C[m], column) - rho * rho * L[m] * L[k] - slopes[s, m] * slopes[s, k]
                ) / rho


@compiled
def solve_planar(loads, limits, bases, forces, pulls):
    """Puts forces and pulls (N, n, 2) for loads (N, 3), friction limits (N, n), bases J (N or 1, n, 2, 3)."""
    count, n = limits.shape
    pivots = np.empty((n, 3))
    hessian, gradient, error = np.empty((3, 3)), np.empty(3), np.empty(3)
    u, d, v = np.empty(3), np.empty(3), np.empty((n, 3))
    for s in range(count):
        load, limit, basis = loads[s], limits[s], bases[s % len(bases)]
        force, drawn = forces[s], pulls[s]
        for i in range(n):
            # The rotation about contact i is the motion orthogonal to both of its rows: their cross product.
            a, b = basis[i, 0], basis[i, 1]
            x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
            length = np.sqrt(x * x + y * y + z * z)
            pivots[i, 0], pivots[i, 1], pivots[i, 2] = x / length, y / length, z / length
        size, largest = 0.0, 0.0
        for r in range(3):
            size += load[r] * load[r]
        for i in range(n):
            largest = max(largest, limit[i])
        if np.sqrt(size) <= 1e-12 * largest:  # no force is needed
            continue
        # At the rotations about contacts the friction's power has kinks, at which Newton's method cannot end:
        # they are compared first.
        if _best_pivot(load, limit, basis, pivots, v, u, d, force):
            friction = _slide(limit, basis, u, v)
            for i in range(n):
                drawn[i, 0], drawn[i, 1] = v[i, 0] / friction, v[i, 1] / friction
            continue
        # leave the pivot the way its contact is pulled, as far as the value falls
        value = _value(load, limit, basis, u, v)
        factor = np.sqrt(_power(u, u))
        for _ in range(60):
            _add(u, factor, d)
            below = _value(load, limit, basis, u, v) < value
            if below:
                break
            _add(u, -factor, d)
            factor *= 0.5
        for _ in range(_STEPS):
            friction = _slide(limit, basis, u, v)
            least = np.inf
            for r in range(3):
                gradient[r] = hessian[r, 0] = hessian[r, 1] = hessian[r, 2] = 0.0
            for i in range(n):
                speed = v[i, 2]
                least = min(least, speed)
                # At a kink there is no derivative; the loop ends, and the caller sees from the bounds that
                # this failed.
                if speed == 0.0:
                    break
                x, y = v[i, 0] / speed, v[i, 1] / speed
                for r in range(3):
                    gradient[r] += limit[i] * (x * basis[i, 0, r] + y * basis[i, 1, r])
                    across = limit[i] / speed * (x * basis[i, 1, r] - y * basis[i, 0, r])
                    for c in range(3):
                        hessian[r, c] += across * (x * basis[i, 1, c] - y * basis[i, 0, c])
            if least == 0.0:
                break
            lower, upper = _power(load, u) / friction, 0.0
            for r in range(3):
                error[r] = friction * gradient[r] - load[r]
                for c in range(3):
                    hessian[r, c] = friction * hessian[r, c] + gradient[r] * gradient[c]
            # all forces at the usage `friction`, then corrected (J is orthonormal) to balance the load
            for i in range(n):
                x = friction * limit[i] * v[i, 0] / v[i, 2] - _power(basis[i, 0], error)
                y = friction * limit[i] * v[i, 1] / v[i, 2] - _power(basis[i, 1], error)
                upper = max(upper, np.sqrt(x * x + y * y) / limit[i])
                force[i, 0], force[i, 1] = x, y
                drawn[i, 0], drawn[i, 1] = v[i, 0] / friction, v[i, 1] / friction
            if upper - lower <= _GAP * max(1.0, upper):
                break
            _solve_3(hessian, error, d)
            slope = _power(error, d)
            value = 0.5 * friction * friction - _power(load, u)
            factor = 1.0
            _add(u, -1.0, d)
            if slope > _NOISE * abs(value):  # nearer to the optimum the value cannot tell a good step
                while factor > 1e-9 and _value(load, limit, basis, u, v) > value - 0.2 * factor * slope:
                    factor *= 0.5
                    _add(u, factor, d)


@compiled
def _best_pivot(load, limit, basis, pivots, v, u, pull, forces):
    """Puts into u the best rotation about a contact; True if it is the optimum, else pull is a direction that
    improves it.

    u is scaled so that the friction's power is the usage.
    """
    n = len(limit)
    best, contact, side = -1.0, 0, 1.0
    for i in range(n):
        friction = _slide(limit, basis, pivots[i], v)
        power = _power(load, pivots[i])
        if abs(power) > best * friction:
            best, contact, side = abs(power) / friction, i, 1.0 if power >= 0 else -1.0
    for r in range(3):
        u[r] = side * pivots[contact, r]
    friction = _slide(limit, basis, u, v)
    for r in range(3):
        pull[r] = load[r]
    for i in range(n):
        if i != contact:
            share = best * limit[i] / v[i, 2]
            forces[i, 0], forces[i, 1] = share * v[i, 0], share * v[i, 1]
            for r in range(3):
                pull[r] -= share * (v[i, 0] * basis[i, 0, r] + v[i, 1] * basis[i, 1, r])
    # the contact turned about has to hold the rest of the load with no more than the others' usage
    first, second = basis[contact, 0], basis[contact, 1]
    a, b, c = _power(first, first), _power(first, second), _power(second, second)
    x, y = _power(first, pull), _power(second, pull)
    x, y = (c * x - b * y) / (a * c - b * b), (a * y - b * x) / (a * c - b * b)
    forces[contact, 0], forces[contact, 1] = x, y
    force = np.sqrt(x * x + y * y)
    x, y = (c * x - b * y) / (a * c - b * b), (a * y - b * x) / (a * c - b * b)  # moves it along the force
    for r in range(3):
        u[r] *= best / friction
        pull[r] = (x * first[r] + y * second[r]) / max(force, 1e-300)
    return force <= best * limit[contact] * (1 + _GAP)


@compiled
def _slide(limit, basis, u, v):
    """Power of the friction in motion u; velocities and speeds of the contacts go to v (n, 3)."""
    total = 0.0
    for i in range(len(limit)):
        v[i, 0], v[i, 1] = _power(basis[i, 0], u), _power(basis[i, 1], u)
        v[i, 2] = np.sqrt(v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1])
        total += limit[i] * v[i, 2]
    return total


@compiled
def _value(load, limit, basis, u, v):
    friction = _slide(limit, basis, u, v)
    return 0.5 * friction * friction - _power(load, u)


@compiled
def _power(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _add(u, factor, d):
    for r in range(3):
        u[r] += factor * d[r]


@compiled
def _solve_3(A, b, x):
    """Puts the solution of three equations into x (Cramer's rule)."""
    c0 = A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1]
    c1 = A[1, 2] * A[2, 0] - A[1, 0] * A[2, 2]
    c2 = A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0]
    det = A[0, 0] * c0 + A[0, 1] * c1 + A[0, 2] * c2
    e0, e1, e2 = (
        A[1, 2] * b[2] - b[1] * A[2, 2],
        A[1, 1] * b[2] - b[1] * A[2, 1],
        A[1, 0] * b[2] - b[1] * A[2, 0],
    )
    x[0] = (b[0] * c0 + A[0, 1] * e0 - A[0, 2] * e1) / det
    x[1] = (-A[0, 0] * e0 + b[0] * c1 + A[0, 2] * e2) / det
    x[2] = (A[0, 0] * e1 - A[0, 1] * e2 + b[0] * c2) / det
