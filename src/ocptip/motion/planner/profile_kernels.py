"""The loops of `profiles`: joint states at nodes and their derivatives.

A joint's corners depend on its own few variables only, so that the loops go over these and not over all of x.
Steps at a corner are exact (0 or 1, given) or spread smoothly over [-half_width, half_width], twice
continuously differentiable. Behind a smooth step its first integral is exactly the time since the corner, so
that a motion of steps that add to zero ends exactly where the sharp one does. In S-curves a step is the mean
of these over the last rise time: with exact steps its ends are two events.
"""

import numpy as np

from ocptip.numerics.compiled import compiled, compiled_inline


@compiled_inline
def _risen_step(t, begun, done, r):
    """As `_smooth_step` of a step that rises within r; 0 or 1 say whether its begin and end have passed."""
    s = t - r
    phi0 = (begun * t - done * s) / r
    phi1 = (begun * t * t - done * s * s) / (2 * r)
    return (begun * t * t * t - done * s * s * s) / (6 * r), phi1, phi0, (begun - done) / r, 0.0


@compiled_inline
def _third_integral(t, e):
    """Third integral of the smooth step at time t."""
    u = min(max((t + e) / (2 * e), 0.0), 1.0)
    v = max(t - e, 0.0)
    u6 = u * u * u * u * u * u
    return 8 * e * e * e * u6 * (1 / 12 - u / 14 + u * u / 56) + v * (4 * e * e / 7 + v * (e / 2 + v / 6))


@compiled_inline
def _smooth_step(t, e):
    """Second and first integral of the step at time t, the step itself, its derivative and the next."""
    u = min(max((t + e) / (2 * e), 0.0), 1.0)
    v = 1 - u
    over = max(t - e, 0.0)
    phi0 = u * u * u * (10 - 15 * u + 6 * u * u)
    phi1 = 2 * e * u * u * u * u * (2.5 - 3 * u + u * u) + over
    phi2 = 4 * e * e * u * u * u * u * u * (0.5 - 0.5 * u + u * u / 7) + over * (0.5 * over + e)
    return phi2, phi1, phi0, 30 * u * u * v * v / (2 * e), 60 * u * v * (v - u) / (4 * e * e)


@compiled
def put_corners(x, joints, K, ramps, steps, times, d_steps):
    """Put accelerations of ramps (joints, K + 1), and steps and times of the corners, of optimised joints.

    Args:
        x: variables.
        joints: optimised ones.
        K: commands of each.
        ramps, steps, times, d_steps: of `Corners`, zero as they come.
    """
    P = 3 * K + 1
    for j in range(len(joints)):
        own, joint, time = x[j * P : (j + 1) * P], joints[j], 0.0
        for k in range(K + 1):
            d = own[K + k]
            ramp = ((own[k] if k < K else 0.0) - (own[k - 1] if k > 0 else 0.0)) / d
            ramps[j, k] = ramp
            for corner, sign in ((2 * k, 1.0), (2 * k + 1, -1.0)):
                steps[joint, corner] = sign * ramp
                row = d_steps[joint, corner]
                if k < K:
                    row[k] = sign / d
                if k > 0:
                    row[k - 1] = -sign / d
                row[K + k] = -sign * ramp / d
            times[joint, 2 * k] = time
            time += d
            times[joint, 2 * k + 1] = time
            if k < K:
                time += own[2 * K + 1 + k]


@compiled
def add_corners_curvature(hessian, x, joints, K, ramps, on_steps):
    """Add second derivatives of the steps of optimised joints, with weights on_steps (n, C), to (nx, nx)."""
    P = 3 * K + 1
    for j in range(len(joints)):
        first, joint = j * P, joints[j]
        for k in range(K + 1):
            at = first + K + k
            cross = (on_steps[joint, 2 * k] - on_steps[joint, 2 * k + 1]) / x[at] ** 2
            if k < K:
                hessian[first + k, at] -= cross
                hessian[at, first + k] -= cross
            if k > 0:
                hessian[first + k - 1, at] += cross
                hessian[at, first + k - 1] += cross
            hessian[at, at] += 2 * ramps[j, k] * cross


@compiled
def joint_states(
    t, T, behind, masks, ends, half_width, rise, start, alpha, tau, d_alpha, d_tau, columns, counts
):
    """States of n joints at N nodes.

    Args:
        t, T: node times (N,), s, and their derivatives (N, nx).
        behind: (N, n), s, by how much joints are late at nodes; or (0, 0): none is.
        masks: (N, n, C), or anything where half_width is not 0.
        ends: the same for the ends of rises; anything where there are none.
        half_width: of the smooth steps, s; 0 for exact ones.
        rise: (n,), s, 0 for ramps.
        start: (n,), rad.
        alpha, tau: (n, C) steps and times of the corners.
        d_alpha, d_tau: (n, C, P) their derivatives with respect to x[columns].
        columns, counts: (n, P) and (n,): the first `counts` of `columns` are the joint's own variables.

    Returns:
        Angles, speeds, accelerations (N, 3 n), their derivatives (N, 3 n, nx), the steps (N, n, C, 5).
    """
    N, nx = T.shape
    n, C = alpha.shape
    values, jacobian = np.zeros((N, 3 * n)), np.zeros((N, 3 * n, nx))
    steps = np.zeros((N, n, C, 5))
    for i in range(N):
        for j in range(n):
            q = start[j]
            w = a = 0.0
            rate = jerk = 0.0  # derivatives of speed and acceleration with respect to t
            J2, J1, J0 = jacobian[i, j], jacobian[i, n + j], jacobian[i, 2 * n + j]
            own_time = t[i] - behind[i, j] if len(behind) else t[i]
            for c in range(C):
                since = own_time - tau[j, c]
                if half_width > 0:
                    phi2, phi1, phi0, slope, bend = _smooth_step(since, half_width)
                    if rise[j] > 0:
                        r = rise[j]
                        b2, b1, b0, bs, _ = _smooth_step(since - r, half_width)
                        third = _third_integral(since, half_width) - _third_integral(since - r, half_width)
                        bend = (slope - bs) / r
                        slope = (phi0 - b0) / r
                        phi0 = (phi1 - b1) / r
                        phi1 = (phi2 - b2) / r
                        phi2 = third / r
                elif rise[j] > 0:
                    phi2, phi1, phi0, slope, bend = _risen_step(since, masks[i, j, c], ends[i, j, c], rise[j])
                else:
                    phi0 = masks[i, j, c]
                    phi1 = since * phi0
                    phi2 = 0.5 * since * phi1
                    slope = bend = 0.0
                if phi0 == 0.0 and phi2 == 0.0 and slope == 0.0:
                    continue  # the corner is still to come
                of = steps[i, j, c]
                of[0], of[1], of[2], of[3], of[4] = phi2, phi1, phi0, slope, bend
                s = alpha[j, c]
                q += phi2 * s
                w += phi1 * s
                a += phi0 * s
                rate += phi0 * s
                jerk += slope * s
                for p in range(counts[j]):
                    k = columns[j, p]
                    own, late = d_alpha[j, c, p], s * d_tau[j, c, p]
                    J2[k] += phi2 * own - phi1 * late
                    J1[k] += phi1 * own - phi0 * late
                    J0[k] += phi0 * own - slope * late
            values[i, j], values[i, n + j], values[i, 2 * n + j] = q, w, a
            for k in range(nx):
                J2[k] += w * T[i, k]
                J1[k] += rate * T[i, k]
                J0[k] += jerk * T[i, k]
    return values, jacobian, steps


@compiled
def add_second_derivatives(hessian, weights, steps, nx, alpha, d_alpha, d_tau, columns, counts):
    """Add what second derivatives of the states hold of products of first derivatives of the corners.

    Args:
        hessian: (nx, nx), added to.
        weights: (N, 3 n) of the states.
        steps, alpha, d_alpha, d_tau, columns, counts: as in `joint_states`.

    Returns:
        Weights of the second derivatives of the corners' steps and times (n, C) each, of those of t times t
        (N,), and u (N, nx): the sum over nodes of (dt/dx) u' and its transpose is to be added.
    """
    N, n, C, _ = steps.shape
    on_steps, on_times = np.zeros((n, C)), np.zeros((n, C))
    on_t, mixed = np.zeros(N), np.zeros((N, nx))
    crossing, twice = np.zeros((n, C)), np.zeros((n, C))
    for i in range(N):
        for j in range(n):
            on_q, on_w, on_a = weights[i, j], weights[i, n + j], weights[i, 2 * n + j]
            if on_q == 0.0 and on_w == 0.0 and on_a == 0.0:
                continue
            for c in range(C):
                of = steps[i, j, c]
                s = alpha[j, c]
                cross = on_q * of[1] + on_w * of[2] + on_a * of[3]
                bent = (on_q * of[2] + on_w * of[3] + on_a * of[4]) * s
                on_steps[j, c] += on_q * of[0] + on_w * of[1] + on_a * of[2]
                on_times[j, c] -= s * cross
                crossing[j, c] += cross
                twice[j, c] += bent
                on_t[i] += bent
                for p in range(counts[j]):
                    mixed[i, columns[j, p]] += cross * d_alpha[j, c, p] - bent * d_tau[j, c, p]
    for j in range(n):
        for c in range(C):
            for p in range(counts[j]):
                first = columns[j, p]
                for r in range(counts[j]):
                    hessian[first, columns[j, r]] += (
                        twice[j, c] * d_tau[j, c, p] * d_tau[j, c, r]
                        - crossing[j, c] * d_tau[j, c, p] * d_alpha[j, c, r]
                        - crossing[j, c] * d_alpha[j, c, p] * d_tau[j, c, r]
                    )
    return on_steps, on_times, on_t, mixed
