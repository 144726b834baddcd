"""Contacts whose normal and tangential forces balance apart: the most that their tangential load can grow.

That is so on one plane. There the tangential load can grow by a factor s while the normal load stays, and the
largest s with |T_i| <= limit_i at all contacts is 1 / usage. A primal-dual interior-point method with the
scaling of Nesterov and Todd and Mehrotra's corrector (Vandenberghe: The CVXOPT linear and quadratic cone
program solvers, 2010) eliminates forces contact by contact. What is left are the balances, six as a rule,
where general solvers factorise a system of all forces: a state takes a twentieth of their time.
"""

from __future__ import annotations

import numpy as np

from ocptip.numerics.jit.compiled import compiled

_STEPS = 30
_GAP, _USEFUL = 1e-11, 1e-8  # between the bounds of s, relative to it: the goal, and what counts as a result
_BALANCED = 1e-8  # units of a force; the caller balances forces exactly
_NEARLY = 0.99  # of the step to the boundary
_LEAST = 0.1  # of the limits at the start, of the largest one
_SOLUTIONS = 3  # of the system: limits of magnitudes apart make the first one inexact
_TINY = 1e-300


def largest_growth(
    A: np.ndarray, fixed: np.ndarray, growing: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The largest s (N,) with A x = fixed + s growing, x (N, n, 3) there, and multipliers y (N, r).

    All x_i are in the cone x_0 >= |(x_1, x_2)|. Of any y with y . growing = -1 and A_i'y in that cone for all
    i, y . fixed is an upper bound of s; here it is s. All are NaN where the method does not end.

    Args:
        A: (N, n, 3, r), what forces contribute to r balances; forces and loads are numbers of about 1.
        fixed, growing: (N, r), loads; s is about 1.
    """
    count, n, _, r = A.shape
    s, x, y = np.full(count, np.nan), np.full((count, n, 3), np.nan), np.full((count, r), np.nan)
    # The shortest forces that hold the fixed load
    flat = A.reshape(count, 3 * n, r)
    shortest = flat @ np.linalg.solve(flat.swapaxes(1, 2) @ flat, fixed[:, :, None])
    start = np.ascontiguousarray(shortest.reshape(count, n, 3)[:, :, 0])
    _grow(*(np.ascontiguousarray(value) for value in (A, fixed, growing)), start, s, x, y)
    return s, x, y


@compiled
def _grow(A, fixed, growing, start, factors, forces, multipliers):
    """Puts s, x and y of all states."""
    count, n, r = A.shape[0], A.shape[1], A.shape[3]
    x, dx, z, dz, w, both = (
        np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4)),
        np.empty((n, 4)),
    )  # fmt: skip
    target, excess, wanted, error = np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4)), np.empty(r)
    scaled, system = np.empty((n, 3, r)), np.empty((r + 1, 2 * r + 2))
    y, change, left = np.empty(r), np.empty(r + 1), np.empty(r + 1)
    for k in range(count):
        largest, s = _TINY, 0.0
        for i in range(n):
            largest = max(largest, abs(start[k, i]))
        for c in range(r):
            y[c] = 0.0
        for i in range(n):
            x[i, 0], x[i, 1], x[i, 2] = max(start[k, i], _LEAST * largest), 0.0, 0.0
            z[i, 0], z[i, 1], z[i, 2] = 1.0 / n, 0.0, 0.0
        for _ in range(_STEPS):
            gap, worst, last = 0.0, 0.0, -1.0
            for c in range(r):
                error[c] = -s * growing[k, c] - fixed[k, c]
                last -= growing[k, c] * y[c]
            for i in range(n):
                for d in range(3):
                    gap += x[i, d] * z[i, d]
                    excess[i, d] = -z[i, d]
                    for c in range(r):
                        error[c] += A[k, i, d, c] * x[i, d]
                        excess[i, d] += A[k, i, d, c] * y[c]
            for c in range(r):
                worst = max(worst, abs(error[c]))
            if gap <= _USEFUL * s and worst < _BALANCED:
                factors[k] = s
                for i in range(n):
                    for d in range(3):
                        forces[k, i, d] = x[i, d]
                for c in range(r):
                    multipliers[k, c] = y[c]
            elif factors[k] > 0:
                break  # rounding has taken over
            if gap <= _GAP * s or not gap < np.inf:
                break
            _scaling(x, z, w)
            _scale(w, z, both)
            _scale(w, excess, excess)
            for c in range(r):
                for i in range(n):
                    for d in range(3):
                        wanted[i, d] = A[k, i, d, c]
                _scale(w, wanted, wanted)
                for i in range(n):
                    for d in range(3):
                        scaled[i, d, c] = wanted[i, d]
            _invert(scaled, growing[k], system)
            step = 0.0
            for turn in range(2):  # towards the optimum, then with what that is wrong by to second order
                for i in range(n):
                    a, b, c0 = both[i, 0], both[i, 1], both[i, 2]
                    target[i, 0], target[i, 1], target[i, 2] = (
                        -(a * a + b * b + c0 * c0),
                        -2 * a * b,
                        -2 * a * c0,
                    )
                    if turn == 1:
                        p, q = dx[i, 0], dz[i, 0]
                        target[i, 0] -= p * q + dx[i, 1] * dz[i, 1] + dx[i, 2] * dz[i, 2]
                        target[i, 1] -= p * dz[i, 1] + q * dx[i, 1]
                        target[i, 2] -= p * dz[i, 2] + q * dx[i, 2]
                        target[i, 0] += (1 - step) * (1 - step) * (1 - step) * gap / n
                    square = a * a - b * b - c0 * c0
                    first = (a * target[i, 0] - b * target[i, 1] - c0 * target[i, 2]) / square
                    wanted[i, 0] = first - excess[i, 0]
                    wanted[i, 1] = (target[i, 1] - first * b) / a - excess[i, 1]
                    wanted[i, 2] = (target[i, 2] - first * c0) / a - excess[i, 2]
                for c in range(r + 1):
                    change[c] = 0.0
                for solution in range(_SOLUTIONS + 1):
                    for i in range(n):
                        for d in range(3):
                            dx[i, d] = wanted[i, d]
                            for c in range(r):
                                dx[i, d] -= scaled[i, d, c] * change[c]
                    if solution == _SOLUTIONS:
                        break
                    left[r] = last
                    for c in range(r):
                        left[c] = error[c] - change[r] * growing[k, c]
                        left[r] -= growing[k, c] * change[c]
                        for i in range(n):
                            for d in range(3):
                                left[c] += scaled[i, d, c] * dx[i, d]
                    for c in range(r + 1):
                        for e in range(r + 1):
                            change[c] += system[c, r + 1 + e] * left[e]
                for i in range(n):
                    for d in range(3):
                        dz[i, d] = excess[i, d]
                        for c in range(r):
                            dz[i, d] += scaled[i, d, c] * change[c]
                step = min(1.0, _NEARLY**turn * min(_inside(both, dx), _inside(both, dz)))
            _scale(w, dx, dx)
            s += step * change[r]
            for i in range(n):
                for d in range(3):
                    x[i, d] += step * dx[i, d]
                    z[i, d] *= 1 - step
                    for c in range(r):
                        z[i, d] += step * A[k, i, d, c] * (y[c] + change[c])
            for c in range(r):
                y[c] += step * change[c]


@compiled
def _scaling(x, z, w):
    """Puts the root of the point (three) and the size of the scaling W of each cone with W z = W^-1 x."""
    for i in range(len(x)):
        of_x, of_z = _height(x[i, 0], x[i, 1], x[i, 2]), _height(z[i, 0], z[i, 1], z[i, 2])
        product = x[i, 0] * z[i, 0] + x[i, 1] * z[i, 1] + x[i, 2] * z[i, 2]
        unit = np.sqrt(2 * (1 + product / (of_x * of_z)))
        w[i, 0] = (x[i, 0] / of_x + z[i, 0] / of_z) / unit
        w[i, 1] = (x[i, 1] / of_x - z[i, 1] / of_z) / unit
        w[i, 2] = (x[i, 2] / of_x - z[i, 2] / of_z) / unit
        w[i, 3] = np.sqrt(of_x / of_z)


@compiled
def _height(a, b, c):
    """The root of a^2 - b^2 - c^2."""
    across = np.sqrt(b * b + c * c)
    return np.sqrt((a - across) * (a + across))


@compiled
def _scale(w, v, out):
    """Puts W v, without differences of large numbers."""
    for i in range(len(w)):
        along = w[i, 1] * v[i, 1] + w[i, 2] * v[i, 2]
        share = v[i, 0] + along / (1 + w[i, 0])
        first = w[i, 0] * v[i, 0] + along
        out[i, 0] = w[i, 3] * first
        out[i, 1] = w[i, 3] * (v[i, 1] + share * w[i, 1])
        out[i, 2] = w[i, 3] * (v[i, 2] + share * w[i, 2])


@compiled
def _inside(v, change):
    """How often changes fit between v and the boundaries of all cones."""
    most = _TINY
    for i in range(len(v)):
        size = _height(v[i, 0], v[i, 1], v[i, 2])
        a, b, c = v[i, 0] / size, v[i, 1] / size, v[i, 2] / size
        inward = (a * change[i, 0] - b * change[i, 1] - c * change[i, 2]) / size
        share = (inward + change[i, 0] / size) / (a + 1)
        b, c = change[i, 1] / size - share * b, change[i, 2] / size - share * c
        most = max(most, np.sqrt(b * b + c * c) - inward)
    return 1 / most


@compiled
def _invert(scaled, growing, system):
    """Puts the inverse of [[G'G, growing], [growing', 0]] into the right half of the system, G (3 n, r)."""
    size = len(growing) + 1
    for c in range(size):
        for e in range(2 * size):
            system[c, e] = 1.0 if e == size + c else 0.0
    for c in range(size - 1):
        system[c, size - 1] = system[size - 1, c] = growing[c]
        for e in range(size - 1):
            for i in range(len(scaled)):
                for d in range(3):
                    system[c, e] += scaled[i, d, c] * scaled[i, d, e]
    for c in range(size):
        pivot = c
        for e in range(c + 1, size):
            if abs(system[e, c]) > abs(system[pivot, c]):
                pivot = e
        for e in range(2 * size):
            value = system[pivot, e]
            system[pivot, e] = system[c, e]
            system[c, e] = value
        head = system[c, c]
        for e in range(2 * size):
            system[c, e] /= head
        for b in range(size):
            factor = system[b, c]
            if b != c:
                for e in range(2 * size):
                    system[b, e] -= factor * system[c, e]
