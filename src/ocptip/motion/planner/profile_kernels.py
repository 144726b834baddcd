"""The loops of `profiles`: joint states at nodes, their derivatives, and chain rules with these.

The corners of a joint depend on a few variables of this joint only, so that the loops go over these and not
over all of x. Innermost are the nodes, side by side in memory, but where rows are of single nodes: that is
what the processor's vector units want, and why each line has few arrays.

States come in groups of three (angle, speed and acceleration of a joint; force or moment of a process) that
depend on variables of the group, and through the time of the node on all others:

    d state / dx = slope over the variables of the group + rate of the state * d time / dx

Steps at a corner are exact (0 or 1, given) or spread smoothly over [-half_width, half_width], twice
continuously differentiable. Behind a smooth step its first integral is exactly the time since the corner, so
that a motion of steps that add to zero ends exactly where the sharp one does. In S-curves a step is the mean
of these over the last rise time: with exact steps its ends are two switching times.
"""

import numpy as np

from ocptip.numerics.jit.compiled import compiled, compiled_in_any_order


@compiled
def _third_integral(t, e):
    """Third integral of the smooth step at time t."""
    u = min(max((t + e) / (2 * e), 0.0), 1.0)
    v = max(t - e, 0.0)
    u6 = u * u * u * u * u * u
    return 8 * e * e * e * u6 * (1 / 12 - u / 14 + u * u / 56) + v * (4 * e * e / 7 + v * (e / 2 + v / 6))


@compiled_in_any_order
def _smooth_steps(t, e, u, of):
    """Put second and first integral of the step at times t (N,), itself and two derivatives into of (5, N).

    u (N,) is overwritten.
    """
    N = len(t)
    for i in range(N):
        u[i] = min(max((t[i] + e) / (2 * e), 0.0), 1.0)
    for i in range(N):
        over = max(t[i] - e, 0.0)
        u4 = u[i] * u[i] * u[i] * u[i]
        of[0, i] = 4 * e * e * u4 * u[i] * (0.5 - 0.5 * u[i] + u[i] * u[i] / 7) + over * (0.5 * over + e)
    for i in range(N):
        u4 = u[i] * u[i] * u[i] * u[i]
        of[1, i] = 2 * e * u4 * (2.5 - 3 * u[i] + u[i] * u[i]) + max(t[i] - e, 0.0)
    for i in range(N):
        of[2, i] = u[i] * u[i] * u[i] * (10 - 15 * u[i] + 6 * u[i] * u[i])
    for i in range(N):
        v = 1 - u[i]
        of[3, i] = 30 * u[i] * u[i] * v * v / (2 * e)
    for i in range(N):
        v = 1 - u[i]
        of[4, i] = 60 * u[i] * v * (v - u[i]) / (4 * e * e)


@compiled
def _smooth_rises(t, e, r, u, before, of):
    """Integrals and derivatives of smooth rises within r; u (N,) and before (5, N) are overwritten."""
    N, end = len(t), of[4]  # a row that is not needed yet
    for i in range(N):
        end[i] = t[i] - r
    _smooth_steps(end, e, u, before)
    _smooth_steps(t, e, u, of)
    for i in range(N):
        third = _third_integral(t[i], e) - _third_integral(t[i] - r, e)
        of[4, i] = (of[3, i] - before[3, i]) / r
        of[3, i] = (of[2, i] - before[2, i]) / r
        of[2, i] = (of[1, i] - before[1, i]) / r
        of[1, i] = (of[0, i] - before[0, i]) / r
        of[0, i] = third / r


@compiled
def _exact_rises(t, begun, done, r, of):
    """Integrals and derivatives of exact rises; `begun`, `done`: 1 where the begin or end is past, else 0."""
    for i in range(len(t)):
        now, s = t[i], t[i] - r
        of[0, i] = (begun[i] * now * now * now - done[i] * s * s * s) / (6 * r)
        of[1, i] = (begun[i] * now * now - done[i] * s * s) / (2 * r)
        of[2, i] = (begun[i] * now - done[i] * s) / r
        of[3, i] = (begun[i] - done[i]) / r
        of[4, i] = 0.0


@compiled_in_any_order
def _exact_steps(t, mask, of):
    """Integrals and derivatives of steps without rise, by their mask (N,)."""
    N = len(t)
    for i in range(N):
        of[1, i] = t[i] * mask[i]
    for i in range(N):
        of[0, i] = 0.5 * t[i] * t[i] * mask[i]
    for i in range(N):
        of[2, i] = mask[i]
        of[3, i] = of[4, i] = 0.0


@compiled
def put_corners(x, joints, K, ramps, steps, times, d_steps):
    """Put accelerations (joints, K + 1), and steps and times of the corners, of optimised joints.

    Args:
        x: variables.
        joints: optimised ones.
        K: commands of each.
        ramps, steps, times, d_steps: of `Corners`, zero as they come.
    """
    P = 3 * K + 1
    for j in range(len(joints)):
        variables, joint, time = x[j * P : (j + 1) * P], joints[j], 0.0
        for k in range(K + 1):
            d = variables[K + k]
            ramp = ((variables[k] if k < K else 0.0) - (variables[k - 1] if k > 0 else 0.0)) / d
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
                time += variables[2 * K + 1 + k]


@compiled
def put_passive_corners(
    end, joints, distances, cruises, rounding, trapezoid, steps, times, d_steps, d_times, second
):
    """Corners of non-optimised joints, whose one variable is the end time, with two derivatives.

    Args:
        end: s.
        joints, distances, cruises: of each that moves; rad, and s at the speed at which it cruises.
        rounding: s, of the transition between both forms of profiles; 0: `trapezoid` says which.
        trapezoid: of each.
        steps, times, d_steps, d_times: of `Corners`, zero as they come.
        second: (n, 2) of acceleration and of t'.
    """
    for k in range(len(joints)):
        joint, way = joints[k], distances[k]
        if rounding == 0.0:  # (5.16), (5.17)
            p, p1, p2 = (end - cruises[k], 1.0, 0.0) if trapezoid[k] else (end / 2, 0.5, 0.0)
        else:
            u, v = end / 2, end - cruises[k]
            root = np.sqrt((u - v) * (u - v) + rounding * rounding)
            slope = -0.5 * (u - v) / root
            p, p1 = (u + v - root) / 2, (1.5 - slope) / 2
            p2 = -0.125 * rounding * rounding / (root * root * root)
        g, g1 = p * (end - p), p1 * (end - p) + p * (1 - p1)
        g2 = p2 * (end - p) + 2 * p1 * (1 - p1) - p * p2
        a, a1 = way / g, -way * g1 / (g * g)
        second[joint, 0], second[joint, 1] = way * (2 * g1 * g1 / (g * g * g) - g2 / (g * g)), p2
        for corner, sign in ((0, 1.0), (1, -1.0), (2, -1.0), (3, 1.0)):
            steps[joint, corner], d_steps[joint, corner, 0] = a * sign, a1 * sign
        times[joint, 1], times[joint, 2], times[joint, 3] = p, end - p, end
        d_times[joint, 1, 0], d_times[joint, 2, 0], d_times[joint, 3, 0] = p1, 1 - p1, 1.0


@compiled
def add_corners_curvature(hessian, x, joints, K, ramps, passive, end, second, on_steps, on_times):
    """Add second derivatives of corners' steps and times, with weights (n, C) each, to hessian (nx, nx).

    Args:
        joints, K, ramps: of `put_corners`.
        passive, second: joints and results of `put_passive_corners`.
        end: the variable that is the end time.
    """
    for joint in passive:
        a, t = on_steps[joint], on_times[joint]
        hessian[end, end] += second[joint, 0] * (a[0] - a[1] - a[2] + a[3]) + second[joint, 1] * (t[1] - t[2])
    P = 3 * K + 1
    for j in range(len(joints)):
        first, joint = j * P, joints[j]
        for k in range(K + 1):
            column = first + K + k
            cross = (on_steps[joint, 2 * k] - on_steps[joint, 2 * k + 1]) / x[column] ** 2
            if k < K:
                hessian[first + k, column] -= cross
                hessian[column, first + k] -= cross
            if k > 0:
                hessian[first + k - 1, column] += cross
                hessian[column, first + k - 1] += cross
            hessian[column, column] += 2 * ramps[j, k] * cross


@compiled_in_any_order
def _add(target, one, first, other, second):
    """Add one * first + other * second to the target, (N,) but first and second."""
    for i in range(len(target)):
        target[i] += one[i] * first + other[i] * second


@compiled_in_any_order
def _add_one(target, one, first):
    """Add one * first to the target, (N,) but first."""
    for i in range(len(target)):
        target[i] += one[i] * first


@compiled
def joint_states(
    t, behind, masks, ends, half_width, rise, start, alpha, tau, d_alpha, d_tau, counts, used, size, own_size
):
    """States of n joints at N nodes.

    Args:
        t: node times (N,), s.
        behind: (n, N), s, delay of joints at nodes; or (0, 0): none.
        masks: (n, C, N), or anything where half_width is not 0.
        ends: the same for the ends of rises; anything where there are none.
        half_width: of the smooth steps, s; 0 for exact ones.
        rise: (n,), s, 0 for trapezoidal profiles.
        start: (n,), rad.
        alpha, tau: (n, C) steps and times of the corners.
        d_alpha, d_tau: (n, C, P) their derivatives over the variables of the joint.
        counts, used: (n,), how many variables and corners a joint has.
        size: S, number of states, 3 n or more; what is more is zero.
        own_size: maximum number of variables of a group; 0: without derivatives.

    Returns:
        Angles, speeds, accelerations (S, N), their rates (S, N), their slopes over the variables of the
        groups (S / 3, own_size, 3, N), the steps (n, C, 5, N; of corners that are used).
    """
    N = len(t)
    n, C = alpha.shape
    values, rates = np.zeros((size, N)), np.zeros((size, N))
    slopes = np.zeros((size // 3, own_size, 3, N))
    steps, since = np.empty((n, C, 5, N)), np.empty(N)
    u, before = np.empty(N), np.empty((5, N))
    for j in range(n):
        q, w, a, jerk = values[j], values[n + j], values[2 * n + j], rates[2 * n + j]
        for i in range(N):
            q[i] = start[j]
        for c in range(used[j]):
            of, s = steps[j, c], alpha[j, c]
            for i in range(N):
                since[i] = t[i] - tau[j, c]
            if len(behind):
                _add_one(since, behind[j], -1.0)
            if half_width > 0 and rise[j] > 0:
                _smooth_rises(since, half_width, rise[j], u, before, of)
            elif half_width > 0:
                _smooth_steps(since, half_width, u, of)
            elif rise[j] > 0:
                _exact_rises(since, masks[j, c], ends[j, c], rise[j], of)
            else:
                _exact_steps(since, masks[j, c], of)
            _add_one(q, of[0], s)
            _add_one(w, of[1], s)
            _add_one(a, of[2], s)
            _add_one(jerk, of[3], s)
            for p in range(min(counts[j], own_size)):
                grows, late = d_alpha[j, c, p], -s * d_tau[j, c, p]
                if grows != 0.0 or late != 0.0:
                    for k in range(3):
                        _add(slopes[j, p, k], of[k], grows, of[k + 1], late)
        for i in range(N):
            rates[j, i], rates[n + j, i] = w[i], a[i]
    return values, rates, slopes, steps


@compiled_in_any_order
def over_all_variables(nodes, slopes, profile_slopes, rates, rows, columns, counts, T):
    """Slopes (R, nx) over x of functions of the states at nodes (R,) with slopes (R, S) over these.

    Args:
        nodes, slopes: of the functions.
        own, rates: of `joint_states`.
        rows: (G, 3), the states of each group.
        columns, counts: (G, maximum number of variables) and (G,), the variables of each group.
        T: (N, nx), d time / dx.
    """
    values = np.empty((len(nodes), T.shape[1]))
    for r in range(len(nodes)):
        i, rate, row, on = nodes[r], 0.0, values[r], slopes[r]
        for k in range(len(on)):
            rate += on[k] * rates[k, i]
        for x in range(len(row)):
            row[x] = rate * T[i, x]
        for g in range(len(rows)):
            a, b, c = on[rows[g, 0]], on[rows[g, 1]], on[rows[g, 2]]
            for p in range(counts[g]):
                of = profile_slopes[g, p]
                row[columns[g, p]] += a * of[0, i] + b * of[1, i] + c * of[2, i]
    return values


@compiled_in_any_order
def _total(of):
    total = 0.0
    for i in range(len(of)):
        total += of[i]
    return total


@compiled_in_any_order
def _put_three(target, first, a, second, b, third, c):
    """Put first * a + second * b + third * c into the target, all (N,)."""
    for i in range(len(target)):
        target[i] = first[i] * a[i] + second[i] * b[i] + third[i] * c[i]


@compiled_in_any_order
def _sum_of_three(first, a, second, b, third, c):
    """Sum of first * a + second * b + third * c, all (N,)."""
    total = 0.0
    for i in range(len(first)):
        total += first[i] * a[i] + second[i] * b[i] + third[i] * c[i]
    return total


@compiled
def place(r, c):
    """Where the entry r, c of a symmetric matrix stands in its upper half, column below column."""
    return c * (c + 1) // 2 + r if r <= c else r * (r + 1) // 2 + c


@compiled_in_any_order
def slopes_at_all_nodes(on, profile_slopes, rates, rows, columns, counts, T):
    """As `over_all_variables`, one function at each node: slopes (nx, N) for slopes on (S, N)."""
    values, along = np.zeros((T.shape[1], T.shape[0])), np.zeros(T.shape[0])
    for k in range(len(on)):
        for i in range(len(along)):
            along[i] += on[k, i] * rates[k, i]
    for x in range(len(values)):
        for i in range(len(along)):
            values[x, i] = along[i] * T[i, x]
    for g in range(len(rows)):
        for p in range(counts[g]):
            target, of = values[columns[g, p]], profile_slopes[g, p]
            for k in range(3):
                for i in range(len(along)):
                    target[i] += on[rows[g, k], i] * of[k, i]
    return values


@compiled
def add_curvature(hessian, H, profile_slopes, rates, rows, columns, counts, on_t, mixed):
    """Add the sum over nodes of S' H S, S = d states / dx, as far as it is over variables of the groups.

    Args:
        hessian: (nx, nx), added to.
        H: upper halves (S (S + 1) / 2, N), see `place`.
        own, rates, rows, columns, counts: as in `over_all_variables`.
        on_t: (N,), added to: weights of the second derivatives of node times t, for t times t.
        mixed: (nx, N), added to: mixed times d time / dx, and its transpose, are to be added as well.
    """
    size, N = rates.shape
    bent = np.zeros((size, N))
    for r in range(size):
        for c in range(size):
            _add_product(bent[r], H[place(r, c)], rates[c])
        _add_product(on_t, bent[r], rates[r])
    for g in range(len(rows)):
        for p in range(counts[g]):
            for k in range(3):
                _add_product(mixed[columns[g, p]], profile_slopes[g, p, k], bent[rows[g, k]])
    for g in range(len(rows)):
        x, y, z = rows[g, 0], rows[g, 1], rows[g, 2]
        for p in range(counts[g]):
            of, column = profile_slopes[g, p], columns[g, p]
            for other in range(g + 1):
                a, b, c = rows[other, 0], rows[other, 1], rows[other, 2]
                for r in (a, b, c):
                    _put_three(bent[r], H[place(r, x)], of[0], H[place(r, y)], of[1], H[place(r, z)], of[2])
                for k in range(p + 1 if other == g else counts[other]):
                    by, row = profile_slopes[other, k], columns[other, k]
                    total = _sum_of_three(by[0], bent[a], by[1], bent[b], by[2], bent[c])
                    hessian[row, column] += total
                    if other != g or k != p:
                        hessian[column, row] += total


@compiled_in_any_order
def _add_product(target, first, second):
    """Add first * second to the target, all (N,)."""
    for i in range(len(target)):
        target[i] += first[i] * second[i]


@compiled
def add_second_derivatives(
    hessian, weights, steps, alpha, d_alpha, d_tau, columns, counts, used, T, on_t, mixed, on_steps, on_times
):
    """Add what second derivatives of the states hold of products of first derivatives of the corners.

    Args:
        hessian: (nx, nx), added to.
        weights: (S, N) of the states.
        steps, alpha, d_alpha, d_tau, counts, used: as in `joint_states`.
        columns: (n, P or more), the variables of the joints.
        T: (N, nx), d time / dx.
        on_t, mixed: of `add_curvature`, added to; half of what on_t makes goes into mixed in the end.
        on_steps, on_times: (n, C), added to: weights of the second derivatives of the corners' steps, times.
    """
    n = len(alpha)
    cross, bent = np.empty(weights.shape[1]), np.empty(weights.shape[1])
    for j in range(n):
        on_q, on_w, on_a = weights[j], weights[n + j], weights[2 * n + j]
        for c in range(used[j]):
            of, s = steps[j, c], alpha[j, c]
            _put_three(cross, on_q, of[1], on_w, of[2], on_a, of[3])
            _put_three(bent, on_q, of[2], on_w, of[3], on_a, of[4])
            crossing, twice = _total(cross), s * _total(bent)
            on_steps[j, c] += _sum_of_three(on_q, of[0], on_w, of[1], on_a, of[2])
            on_times[j, c] -= s * crossing
            _add_one(on_t, bent, s)
            for p in range(counts[j]):
                grows, late = d_alpha[j, c, p], d_tau[j, c, p]
                if grows == 0.0 and late == 0.0:
                    continue
                _add(mixed[columns[j, p]], cross, grows, bent, -s * late)
                for r in range(counts[j]):
                    hessian[columns[j, p], columns[j, r]] += (
                        twice * late * d_tau[j, c, r]
                        - crossing * late * d_alpha[j, c, r]
                        - crossing * grows * d_tau[j, c, r]
                    )
    for x in range(len(mixed)):
        for i in range(len(on_t)):
            mixed[x, i] += 0.5 * on_t[i] * T[i, x]
