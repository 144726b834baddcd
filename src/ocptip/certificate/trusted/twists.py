"""Friction of contacts on one plane is enough, however it is shared: shown for every twist.

Contacts that press with friction limits c_i >= 0 bear any tangential forces with |t_i| <= c_i. What these add
up to is a convex set; along a twist y of the base within the plane it reaches to sum c_i |v_i(y)|, v_i the
velocity that y gives to the i-th contact. So they can hold a wrench w exactly if for all these twists

    y . w + sum c_i |v_i(y)| >= 0.

The twists are cut into triangles. In one of them |v_i| is at least d_i . v_i, with any |d_i| <= 1: the rest
is linear in y, with its minimum at a corner. There it is a functional of the wrench, as the limits are. What
is not shown in a triangle is tried in its four quarters. NumPy only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from ocptip.certificate.trusted.forms import U

_DEPTH = 8, 12  # so often triangles are quartered, quickly and patiently
_MOST = 60, 400  # of a row that are left: it is given up
_PATIENT = 4  # quartered so often they are looked at most closely
_CLOSELY = 2  # quartered so often they are looked at closely
_TOGETHER = 600  # triangles of rows that are looked at together, at least six of each
_WIDE = 0.95  # length of the mean of directions of a velocity below which it turns in the triangle

Least = Callable[..., np.ndarray]


def _icosahedron() -> np.ndarray:
    """Corners (20, 3, 3) of triangles round the origin."""
    long = 0.5 * (1 + np.sqrt(5))
    points = np.array(
        [np.roll([0.0, a, b * long], shift) for shift, a, b in product(range(3), (-1.0, 1.0), (-1.0, 1.0))]
    )
    near = np.abs(np.linalg.norm(points[:, None] - points, axis=2) - 2) < 0.1
    return np.array(
        [
            points[[i, j, k]]
            for i in range(12)
            for j in range(i)
            for k in range(j)
            if near[i, j] and near[j, k] and near[k, i]
        ]
    )


_FIRST = _icosahedron()
_QUARTERS = 0.5 * np.array(  # corners of quarters of a triangle: (4, 3, 3) of its corners
    [
        [[2, 0, 0], [1, 1, 0], [1, 0, 1]],
        [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
        [[1, 0, 1], [0, 1, 1], [0, 0, 2]],
        [[1, 1, 0], [0, 1, 1], [1, 0, 1]],
    ]
)


@dataclass(frozen=True)
class FrictionLimits:
    """Friction limits of m contacts, N, in R rows: functionals of the wrench.

    Attributes:
        rule: (R, m, 6).
        constant: (2, R, m), at s = -1 and s = 1 of what is linear between.
        error: (R, m).
    """

    rule: np.ndarray
    constant: np.ndarray
    error: np.ndarray


class Twists:
    """Of contacts on a plane, in rows of wrenches that lie in boxes.

    Args:
        grasp, rounded: (6, 3 m) wrench per contact force, normal and two tangential ones of each, and a bound
            of its rounding.
        middle, half: (6, R) of the boxes.
        limits: none of them negative.
    """

    def __init__(
        self,
        grasp: np.ndarray,
        rounded: np.ndarray,
        middle: np.ndarray,
        half: np.ndarray,
        limits: FrictionLimits,
    ) -> None:
        tangential = np.delete(grasp, np.s_[::3], axis=1)
        basis = np.zeros((6, 3))  # two translations, and the rotation about the plane's normal
        basis[:3, :2], basis[3:, 2] = grasp[:3, 1:3], grasp[:3, 0]
        basis[:, 2] /= max(
            float(np.mean(np.linalg.norm((tangential.T @ basis[:, 2]).reshape(-1, 2), axis=1))), 1e-9
        )
        self._basis, self._velocity = basis, (tangential.T @ basis).reshape(-1, 2, 3)
        self._back = np.linalg.pinv(self._velocity)  # (m, 3, 2)
        self._middle, self._limits = middle.T, limits
        self._around = (half * (1 + U) + 8 * U * np.abs(middle)).T
        typical = np.einsum("rmi,ri->rm", limits.rule, self._middle) + limits.constant.mean(axis=0)
        self._typical = np.maximum(typical, 1e-9)
        size = np.abs(self._middle) + self._around
        self._blur = 8 * U * size @ np.abs(basis)  # of y . w, (R, 3)
        most = np.einsum("rmi,ri->rm", np.abs(limits.rule), size) + np.max(np.abs(limits.constant), axis=0)
        blurred = np.delete(rounded, np.s_[::3], axis=1) + 8 * U * np.abs(tangential)
        self._blur += most @ (blurred.T @ np.abs(basis)).reshape(-1, 2, 3).sum(axis=1)  # of velocities

    def slack(self, least: Least, patient: bool) -> np.ndarray:
        """(R,): the minimum over all twists, or the value that prevents a proof; proved where >= 0.

        Args:
            least: function of rows (K,), functionals (A, 6, K) of the wrench, constants (2, A, K), and
                whether to use the tightest bound; gives lower bounds (A, K) of their sum.
            patient: more subdivisions before a row is given up.
        """
        most, deepest = _MOST[patient], _DEPTH[patient]
        slack, lost = np.full(len(self._middle), np.inf), np.zeros(len(self._middle), dtype=bool)
        rows, which = (
            np.repeat(np.arange(len(slack)), len(_FIRST)),
            np.tile(np.arange(len(_FIRST)), len(slack)),
        )
        corners = _FIRST  # of different triangles; those of rows are some of them
        for depth in range(deepest + 1):
            h, constant, error, gap = self._functionals(rows, which, corners)
            result = np.min(self._in_box(rows, h, constant) - error, axis=1)
            left = np.flatnonzero(~(result >= 0))
            if depth >= _CLOSELY:
                near = partial(least, closely=patient and depth >= _PATIENT)
                value = _closely(near, rows[left], h[left], constant[:, left])
                result[left] = np.min(value - error[left], axis=1)
                lost[rows[left[np.min(value + gap[left], axis=1) < 0]]] = True
                left = np.flatnonzero(~(result >= 0))
            lost |= np.bincount(rows[left], minlength=len(slack)) > most
            ended = (result >= 0) | lost[rows] | (depth == deepest)
            np.minimum.at(slack, rows[ended], result[ended])
            left = np.flatnonzero(~ended & (slack[rows] >= 0))
            if not len(left):
                break
            rows = np.repeat(rows[left], 4)
            used, which = np.unique(which[left], return_inverse=True)
            which = (4 * which.reshape(-1, 1) + np.arange(4)).reshape(-1)
            corners = np.einsum("qkc,pcy->pqky", _QUARTERS, corners[used]).reshape(-1, 3, 3)
        return slack

    def _functionals(
        self, rows: np.ndarray, which: np.ndarray, corners: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of P rows and triangles of corners (Q, 3, 3): functionals (P, 3, 6), constants (2, P, 3) and errors
        (P, 3), and about how much more smaller triangles can show at the corners (P, 3)."""
        row_limits = self._limits
        share, most = self._shares(rows, which, corners)
        gap = ((most - share) @ self._typical[rows][:, :, None])[:, :, 0]
        h = (corners @ self._basis.T)[which] + share @ row_limits.rule[rows]
        error = (np.abs(corners)[which] @ self._blur[rows][:, :, None])[:, :, 0]
        error += (np.abs(share) @ row_limits.error[rows][:, :, None])[:, :, 0]
        return h, (share @ row_limits.constant[:, rows][..., None])[..., 0], error * (1 + U), gap

    def _in_box(self, rows: np.ndarray, h: np.ndarray, constant: np.ndarray) -> np.ndarray:
        """(P, 3) lower bounds of functionals of any wrench in the boxes."""
        inside = h @ self._middle[rows][:, :, None] - np.abs(h) @ self._around[rows][:, :, None]
        return np.min(constant, axis=0) + inside[:, :, 0]

    def _shares(
        self, rows: np.ndarray, which: np.ndarray, corners: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(P, 3, m): d . v of the contacts at the corners of triangles, and |v|."""
        v = np.einsum("mty,qcy->qmct", self._velocity, corners)
        speed = np.linalg.norm(v, axis=3)
        d = np.mean(v / np.maximum(speed, 1e-12)[..., None], axis=2)
        size = np.linalg.norm(d, axis=2)
        d /= np.maximum(size, 1e-12)[:, :, None]
        share = np.einsum("qmt,qmct->qcm", d * (1 - U), v)[which]
        # a contact whose velocity turns a lot: there d is the force that is missing of a typical wrench
        pairs = np.flatnonzero((np.min(size, axis=1) < _WIDE)[which])
        whose, every, row, which = which, np.arange(len(pairs)), rows[pairs], which[pairs]
        turning, limit = np.argmin(size, axis=1)[which], self._typical[rows[pairs]]
        force = limit[:, :, None] * d[which]
        force[every, turning] = 0.0
        missing = (self._middle @ self._basis)[row]
        missing += force.reshape(-1, 2 * limit.shape[1]) @ self._velocity.reshape(-1, 3)
        needed = -(missing[:, None] @ self._back[turning])[:, 0] / limit[every, turning][:, None]
        needed /= np.maximum(np.linalg.norm(needed, axis=1), 1.0)[:, None]
        share[pairs, :, turning] = (v[which, turning] @ (needed * (1 - U))[:, :, None])[:, :, 0]
        return share, np.swapaxes(speed, 1, 2)[whose]


def _closely(least: Least, rows: np.ndarray, h: np.ndarray, constant: np.ndarray) -> np.ndarray:
    """(P, 3) lower bounds by `least`, some triangles of many rows at once; rows ascend."""
    values = np.empty(h.shape[:2])
    begins, counts = np.unique(rows, return_index=True, return_counts=True)[1:]
    first, last = 0, int(np.max(counts, initial=0))
    while first < last:
        here = np.flatnonzero(counts > first)
        slots = np.arange(first, min(first + max(6, _TOGETHER // len(here)), last))
        first = int(slots[-1]) + 1
        pairs = begins[here] + np.minimum(slots[:, None], counts[here] - 1)  # (slots, K)
        in_order = np.moveaxis(h[pairs], 1, 3).reshape(-1, 6, len(here))
        ends = np.moveaxis(constant[:, pairs], 2, 3).reshape(2, -1, len(here))
        value = least(rows[begins[here]], in_order, ends).reshape(len(slots), -1, len(here))
        values[pairs] = np.moveaxis(value, 1, 2)
    return values
