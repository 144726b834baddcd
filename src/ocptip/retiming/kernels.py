"""Inner loops of the timing of a path, compiled.

Between nodes i and i + 1, where x goes from p to q, every limit is a row a p + b q <= c. What keeps all rows
of an interval is a convex polygon in (p, q), of which edges are few.
"""

from __future__ import annotations

import numpy as np

from ocptip.numerics.jit.compiled import compiled

MOST = 96
"""Edges of a polygon, at most."""

_ZERO = 1e-13
_SURELY = 1e-12  # of the right-hand side: so far inside, no rounding makes a row cut


@compiled
def reduced(alpha, beta, gamma, caps, left, right, widths, ends, extra, counts, rows, numbers, corners):
    """Put the polygons of N intervals into counts (N,), rows (N, MOST, 3), numbers (N, MOST), corners.

    Rows alpha u + beta x <= gamma, (P, L) each, hold at places; left and right (N,) are the intervals'.
    Extra rows (E, 3) of interval i are those from ends[i] to ends[i + 1]. Numbers of rows: l at the left
    place, L + l at the right one, 2 L + e extra; -3 and -4: x at the left and right place is at its cap;
    -1, -2: it is 0. A polygon without corners has count 0; its number 0 is the row that emptied it.
    """
    size = alpha.shape[1]
    other, other_numbers = np.empty((MOST, 2)), np.empty(MOST, dtype=np.int64)
    for i in range(len(left)):
        # u is constant in an interval: u = (x_right - x_left) / (2 width), so every row is a line in both x.
        one, two, h = left[i], right[i], 1 / (2 * widths[i])
        polygon, names = corners[i], numbers[i]
        polygon[0, 0] = polygon[0, 1] = polygon[1, 1] = polygon[3, 0] = 0.0
        polygon[1, 0] = polygon[2, 0] = caps[one]
        polygon[2, 1] = polygon[3, 1] = caps[two]
        names[0], names[1], names[2], names[3] = -2, -3, -4, -1
        n, reach = 4, _reach(polygon, 4)
        for k in range(2 * size + ends[i + 1] - ends[i]):
            # Objects have thousands of rows, of which few cut: bounds of p or q, and of q - p, tell.
            if k < size:
                most = _most(beta[one, k], reach[0], reach[1]) + _most(alpha[one, k] * h, reach[4], reach[5])
                if most < gamma[one, k] - _SURELY * abs(gamma[one, k]):
                    continue
            elif k < 2 * size:
                entry = k - size
                most = _most(beta[two, entry], reach[2], reach[3]) + _most(
                    alpha[two, entry] * h, reach[4], reach[5]
                )
                if most < gamma[two, entry] - _SURELY * abs(gamma[two, entry]):
                    continue
            a, b, c = _row(alpha, beta, gamma, one, two, h, extra, ends[i], size, k)
            n = clipped(polygon, names, n, a, b, c, k, other, other_numbers)
            if n == 0:
                names[0] = k
                break
            reach = _reach(polygon, n)
        counts[i] = n
        for k in range(n):
            number = names[k]
            if number >= 0:
                a, b, c = _row(alpha, beta, gamma, one, two, h, extra, ends[i], size, number)
            elif number == -1:
                a, b, c = -1.0, 0.0, 0.0
            elif number == -2:
                a, b, c = 0.0, -1.0, 0.0
            elif number == -3:
                a, b, c = 1.0, 0.0, caps[one]
            else:
                a, b, c = 0.0, 1.0, caps[two]
            rows[i, k, 0], rows[i, k, 1], rows[i, k, 2] = a, b, c


@compiled
def _reach(polygon, n):
    """Minimum and maximum of p, q and q - p over the corners of a polygon."""
    p = low = high = polygon[0, 0]
    q = left = right = polygon[0, 1]
    least = most = q - p
    for k in range(1, n):
        p, q = polygon[k, 0], polygon[k, 1]
        low, high = min(low, p), max(high, p)
        left, right = min(left, q), max(right, q)
        least, most = min(least, q - p), max(most, q - p)
    return low, high, left, right, least, most


@compiled
def _most(factor, low, high):
    """Maximum of factor * x over low <= x <= high."""
    return factor * (high if factor > 0 else low)


@compiled
def _row(alpha, beta, gamma, one, two, h, extra, first, size, k):
    """Coefficients a, b, c of row k of an interval, see `reduced`."""
    if k < size:
        u = alpha[one, k] * h
        return beta[one, k] - u, u, gamma[one, k]
    if k < 2 * size:
        u = alpha[two, k - size] * h
        return -u, beta[two, k - size] + u, gamma[two, k - size]
    row = extra[first + k - 2 * size]
    return row[0], row[1], row[2]


@compiled
def clipped(polygon, names, n, a, b, c, name, other, other_names):
    """Cut a polygon of n corners by a p + b q <= c; returns the new number. names[k]: edge after corner k."""
    outside = False
    # Most rows cut nothing: this test is cheaper than a copy of the polygon.
    for k in range(n):
        if a * polygon[k, 0] + b * polygon[k, 1] > c:
            outside = True
            break
    if not outside:
        return n
    m = 0
    here, size = _beyond(polygon, n - 1, a, b, c)
    inside = here <= size
    for k in range(n):
        before = n - 1 if k == 0 else k - 1
        there, size = _beyond(polygon, k, a, b, c)
        stays = there <= size
        if inside != stays:
            near, far, share = before, k, here / (here - there)
            if abs(polygon[k, 0]) + abs(polygon[k, 1]) < abs(polygon[before, 0]) + abs(polygon[before, 1]):
                near, far, share = k, before, there / (there - here)  # rounds by what is near 0, not far off
            share = min(max(share, 0.0), 1.0)
            for r in range(2):
                other[m, r] = polygon[near, r] + share * (polygon[far, r] - polygon[near, r])
            other_names[m] = name if inside else names[before]
            m += 1
        if stays:
            other[m, 0], other[m, 1] = polygon[k, 0], polygon[k, 1]
            other_names[m] = names[k]
            m += 1
        here, inside = there, stays
    # Double corners would let the number of corners grow with every cut through a corner.
    kept = 0
    for k in range(m):  # edges without length go
        following = 0 if k == m - 1 else k + 1
        same = m > 1 and other[k, 0] == other[following, 0] and other[k, 1] == other[following, 1]
        if not same and kept < MOST - 2:
            polygon[kept, 0], polygon[kept, 1] = other[k, 0], other[k, 1]
            names[kept] = other_names[k]
            kept += 1
    if m > 0 and kept == 0:
        polygon[0, 0], polygon[0, 1], names[0] = other[0, 0], other[0, 1], name
        kept = 1
    return kept


@compiled
def _beyond(polygon, k, a, b, c):
    """By how much corner k is beyond a p + b q <= c, and what of that is rounding: relative to the corner,
    not to the polygon, which in short intervals is a strip to speeds that no neighbour allows.
    """
    p, q = a * polygon[k, 0], b * polygon[k, 1]
    return p + q - c, _ZERO * (abs(c) + abs(p) + abs(q))


@compiled
def controllable(counts, corners, bounds, result):
    """From which x at the nodes the rest can be done: `found` (N + 1, 2), minimum and maximum.

    bounds (N + 1, 2) are the minimum and maximum x that are allowed. Returns -1, or the interval that fails.
    """
    count = len(counts)
    polygon, names = np.empty((MOST, 2)), np.empty(MOST, dtype=np.int64)
    other, other_names = np.empty((MOST, 2)), np.empty(MOST, dtype=np.int64)
    result[count, 0], result[count, 1] = bounds[count, 0], bounds[count, 1]
    for i in range(count - 1, -1, -1):
        n = counts[i]
        for k in range(n):
            polygon[k, 0], polygon[k, 1] = corners[i, k, 0], corners[i, k, 1]
        # One step backward: x at the right end must be one from which the rest can be done.
        n = clipped(polygon, names, n, 0.0, 1.0, result[i + 1, 1], 0, other, other_names)
        n = clipped(polygon, names, n, 0.0, -1.0, -result[i + 1, 0], 0, other, other_names)
        least, greatest = np.inf, -np.inf
        for k in range(n):
            least, greatest = min(least, polygon[k, 0]), max(greatest, polygon[k, 0])
        result[i, 0], result[i, 1] = max(least, bounds[i, 0]), min(greatest, bounds[i, 1])
        if not result[i, 0] <= result[i, 1]:
            return i
    return -1


@compiled
def greatest(counts, rows, numbers, result, x, active):
    """The maximum x (N + 1,) from x[0] on, and the number of the row that ends it, (N,), -5: what follows.

    Returns -1, or the interval in which nothing is left.
    """
    for i in range(len(counts)):
        least, most = result[i + 1, 0], result[i + 1, 1]
        size = _ZERO * (1 + most)
        active[i] = -5
        for k in range(counts[i]):
            a, b, c = rows[i, k, 0], rows[i, k, 1], rows[i, k, 2]
            rest = c - a * x[i]
            if b > _ZERO * abs(a):
                if rest < b * most:
                    most, active[i] = rest / b, numbers[i, k]
            elif b < -_ZERO * abs(a):
                least = max(least, rest / b)
        # Rounding may leave a gap in a strip without width; only a clear gap is a contradiction.
        if most < least - 1e3 * size - 1e-9 * abs(least):
            return i
        x[i + 1] = min(max(most, result[i + 1, 0]), result[i + 1, 1])
    return -1
