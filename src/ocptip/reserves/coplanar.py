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
_PIVOT = 1e-14  # of the system's diagonal
_TINY = 1e-300


def largest_growth(
    A: np.ndarray, fixed: np.ndarray, growing: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The largest s (N,) with A x = fixed + s growing, x (N, n, 3) there, and multipliers y (N, r).

    All x_i are in the cone x_0 >= |(x_1, x_2)|. Of any y with y . growing = -1 and A_i'y in that cone for all
    i, y . fixed is an upper bound of s; here it is s. All are NaN where the method does not end.

    Args:
        A: (N, n, 3, r), or (1, n, 3, r), what forces contribute to r balances.
        fixed, growing: (N, r), loads. They, forces and s are numbers of about 1.
    """
    count, n, r = len(fixed), A.shape[1], A.shape[3]
    s, x, y = np.full(count, np.nan), np.full((count, n, 3), np.nan), np.full((count, r), np.nan)
    # The shortest forces that hold the fixed load
    flat = A.reshape(-1, 3 * n, r)
    shortest = flat @ np.linalg.solve(flat.swapaxes(1, 2) @ flat, fixed[:, :, None])
    start = np.ascontiguousarray(shortest.reshape(count, n, 3)[:, :, 0])
    grow(*(np.ascontiguousarray(value) for value in (A, fixed, growing)), start, s, x, y)
    return s, x, y


@compiled
def grow(A, fixed, growing, start, factors, forces, multipliers):
    """Puts s, x and y of all states; start (N, n): limits x_0 to begin with."""
    count, n, r = len(fixed), A.shape[1], A.shape[3]
    x, dx, z, dz, both = (
        np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4)),
    )  # fmt: skip
    w = np.empty((n, 5))
    target, excess, wanted, error = np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4)), np.empty(r)
    scaled, system = np.empty((n, 3, r)), np.empty((r + 1, r + 1))
    y, change, left = np.empty(r), np.empty(r + 1), np.empty(r + 1)
    for k in range(count):
        a_k = A[k % len(A)]
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
                        error[c] += a_k[i, d, c] * x[i, d]
                        excess[i, d] += a_k[i, d, c] * y[c]
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
                        wanted[i, d] = a_k[i, d, c]
                _scale(w, wanted, wanted)
                for i in range(n):
                    for d in range(3):
                        scaled[i, d, c] = wanted[i, d]
            _factorise(scaled, growing[k], system)
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
                            value = wanted[i, d]
                            for c in range(r):
                                value -= scaled[i, d, c] * change[c]
                            dx[i, d] = value
                    if solution == _SOLUTIONS:
                        break
                    off = last
                    for c in range(r):
                        value = error[c] - change[r] * growing[k, c]
                        off -= growing[k, c] * change[c]
                        for i in range(n):
                            for d in range(3):
                                value += scaled[i, d, c] * dx[i, d]
                        left[c] = value
                    left[r] = off
                    _add_solution(system, left, change)
                for i in range(n):
                    for d in range(3):
                        value = excess[i, d]
                        for c in range(r):
                            value += scaled[i, d, c] * change[c]
                        dz[i, d] = value
                step = min(1.0, _NEARLY**turn * min(_inside(both, dx), _inside(both, dz)))
            _scale(w, dx, dx)
            s += step * change[r]
            for i in range(n):
                for d in range(3):
                    x[i, d] += step * dx[i, d]
                    z[i, d] *= 1 - step
                    for c in range(r):
                        z[i, d] += step * a_k[i, d, c] * (y[c] + change[c])
            for c in range(r):
                y[c] += step * change[c]


@compiled
def _scaling(x, z, w):
    """Puts the root of the point (three) and the size of the scaling W of each cone with W z = W^-1 x.

    Last is what `_scale` would divide by for each vector.
    """
    for i in range(len(x)):
        of_x, of_z = _height(x[i, 0], x[i, 1], x[i, 2]), _height(z[i, 0], z[i, 1], z[i, 2])
        product = x[i, 0] * z[i, 0] + x[i, 1] * z[i, 1] + x[i, 2] * z[i, 2]
        unit = np.sqrt(2 * (1 + product / (of_x * of_z)))
        w[i, 0] = (x[i, 0] / of_x + z[i, 0] / of_z) / unit
        w[i, 1] = (x[i, 1] / of_x - z[i, 1] / of_z) / unit
        w[i, 2] = (x[i, 2] / of_x - z[i, 2] / of_z) / unit
        w[i, 3], w[i, 4] = np.sqrt(of_x / of_z), 1 / (1 + w[i, 0])


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
        share = v[i, 0] + along * w[i, 4]
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
def _factorise(scaled, growing, system):
    """Puts factors L D L' of [[G'G, growing], [growing', 0]], G (3 n, r): L, and 1 / D on the diagonal."""
    r = len(growing)
    for c in range(r + 1):
        for e in range(c + 1):
            value = 0.0
            if c < r:
                for i in range(len(scaled)):
                    for d in range(3):
                        value += scaled[i, d, c] * scaled[i, d, e]
            elif e < r:
                value = growing[e]
            least = _PIVOT * value  # a pivot below is rounding
            for f in range(e):
                value -= system[f, c] * system[e, f]  # above the diagonal are D L'
            if e < c:
                system[e, c], system[c, e] = value, value * system[e, e]
            else:
                system[c, c] = 1 / (max(value, least) if c < r else value)


@compiled
def _add_solution(system, left, change):
    """Adds to `change` what the factorised system gives for `left`, which is overwritten."""
    for c in range(len(left)):
        value = left[c]
        for e in range(c):
            value -= system[c, e] * left[e]
        left[c] = value
    for back in range(len(left)):
        c = len(left) - 1 - back
        value = left[c] * system[c, c]
        for e in range(c + 1, len(left)):
            value -= system[e, c] * left[e]
        left[c] = value
        change[c] += value
