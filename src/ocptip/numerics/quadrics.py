"""All solutions of k - 1 homogeneous quadratic equations y' A_i y = 0 in k unknowns, by continuation.

A system whose solutions are known is deformed into the wanted one, and every solution is followed along its
path (Sommese and Wampler, The numerical solution of systems of polynomials, 2005). Deformations that stay
within a family of systems and start at a general complex member reach every isolated solution of every
member, with probability one; the ends of the paths are checked afterwards by Kantorovich's theorem, whose
bounds are exact for quadratic equations. All paths are followed at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_STEPS = 2000
_TOLERANCE = 1e-5
_NEAR = 1e-9
_REGULAR = 1e-9
_HUGE = 1e20


@dataclass(frozen=True, eq=False)
class Deformation:
    """A(t) = C0 + C1 t + C2 t^2 from a system at t = 0 to one at t = 1.

    Attributes:
        coefficients: (3, k - 1, k, k), symmetric in the last two.
    """

    coefficients: np.ndarray

    @classmethod
    def between(cls, first: np.ndarray, last: np.ndarray, middle: np.ndarray | None = None) -> Deformation:
        """From forms (k - 1, k, k) to others; a parabola through the middle ones at t = 1/2, if given."""
        bend = np.zeros_like(first + last) if middle is None else 2.0 * (first + last - 2.0 * middle)
        return cls(np.stack([first + 0.0 * bend, last - first - bend, bend]))

    def forms(self, t: np.ndarray) -> np.ndarray:
        """(P, k - 1, k, k) at t (P,)."""
        return np.tensordot(np.stack([np.ones_like(t), t, t * t], axis=1), self.coefficients, axes=1)

    def slopes(self, t: np.ndarray) -> np.ndarray:
        """dA/dt, (P, k - 1, k, k)."""
        return np.tensordot(np.stack([np.ones_like(t), 2.0 * t], axis=1), self.coefficients[1:], axes=1)


def total_degree(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Forms y_i^2 - y_0^2 (k - 1, k, k), and all their 2^(k - 1) solutions (2^(k - 1), k)."""
    forms = np.zeros((k - 1, k, k), dtype=complex)
    for i in range(k - 1):
        forms[i, i + 1, i + 1], forms[i, 0, 0] = 1.0, -1.0
    signs = 1.0 - 2.0 * ((np.arange(2 ** (k - 1))[:, None] >> np.arange(k - 1)) & 1)
    return forms, np.column_stack([np.ones(len(signs)), signs]).astype(complex)


def follow(
    way: Deformation, starts: np.ndarray, tolerance: float = _TOLERANCE
) -> tuple[np.ndarray, np.ndarray]:
    """Follow the solutions from t = 0 to t = 1.

    Args:
        way: the deformation.
        starts: (P, k) solutions at t = 0, complex, of any length.
        tolerance: largest error of a prediction, before it is corrected.

    Returns:
        Ends (P, k) of length 1, and how far each path came (P,): 1, or a little less where it runs into a
        singular solution.
    """
    y = starts / np.linalg.norm(starts, axis=1, keepdims=True)
    t, step = np.zeros(len(y)), np.full(len(y), 0.01)
    for _ in range(_STEPS):
        on = np.flatnonzero((t < 1.0) & (1.0 - t > _NEAR) & (step > 1e-3 * _NEAR))
        if not on.size:
            break
        h = np.minimum(step[on], 1.0 - t[on])
        there = np.where(step[on] >= 1.0 - t[on], 1.0, t[on] + h)
        guess = _predicted(way, y[on], t[on], h)
        result, first, last = _corrected(way.forms(there), guess, y[on].conj())
        good = (last < 1e-9) & (first < 100.0 * tolerance)
        moved = on[good]
        y[moved] = result[good] / np.linalg.norm(result[good], axis=1, keepdims=True)
        t[moved] = there[good]
        # The error of the predictor is of fifth order in the step, and the first Newton step measures it.
        wish = 0.8 * (tolerance / np.maximum(first, 1e-30)) ** 0.2
        step[on] = h * np.where(good, np.clip(wish, 0.2, 4.0), np.clip(wish, 0.1, 0.5))
    return y, t


def _predicted(way: Deformation, y: np.ndarray, t: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Runge and Kutta's step of fourth order."""
    # Solutions are defined up to a factor; the plane through y at right angles to it removes that freedom.
    patch = y.conj()

    def slope(y: np.ndarray, t: np.ndarray) -> np.ndarray:
        moved = np.einsum("pi,pnij,pj->pn", y, way.slopes(t), y)
        return _solved(_jacobian(way.forms(t), y, patch), -moved)

    wide = h[:, None]
    a = slope(y, t)
    b = slope(y + wide / 2 * a, t + h / 2)
    c = slope(y + wide / 2 * b, t + h / 2)
    d = slope(y + wide * c, t + h)
    return y + wide / 6 * (a + 2 * b + 2 * c + d)


def _corrected(
    forms: np.ndarray, y: np.ndarray, patch: np.ndarray, steps: int = 3
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Newton's method; the solutions, and the lengths of the first and the last step."""
    first = last = np.zeros(len(y))
    for k in range(steps):
        values = np.einsum("pi,pnij,pj->pn", y, forms, y)
        change = _solved(_jacobian(forms, y, patch), -values)
        y = y + change
        last = np.linalg.norm(change, axis=1)
        first = last if k == 0 else first
    return y, first, last


def _jacobian(forms: np.ndarray, y: np.ndarray, patch: np.ndarray) -> np.ndarray:
    """(P, k, k) of the equations and of the plane that fixes the length of y."""
    return np.concatenate([2.0 * np.einsum("pnij,pj->pni", forms, y), patch[:, None, :]], axis=1)


def _solved(matrices: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Solutions for right sides (P, k - 1), the last row's is zero; `_HUGE` where a matrix is singular."""
    right = np.concatenate([values, np.zeros((len(values), 1))], axis=1)[..., None]
    matrices = np.where(np.isfinite(matrices), matrices, 0.0)
    try:
        result = np.linalg.solve(matrices, right)[..., 0]
        return np.where(np.abs(result) < _HUGE, result, 0.0) + np.where(np.abs(result) < _HUGE, 0.0, _HUGE)
    except np.linalg.LinAlgError:
        out = np.full(right.shape[:2], _HUGE + 0j)
        for p in range(len(values)):
            if np.linalg.cond(matrices[p]) < 1e15:
                out[p] = np.linalg.solve(matrices[p], right[p])[..., 0]
        return out


def polished(forms: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solutions near y, and what is proved of them.

    Kantorovich: with |J^-1 F| <= b, |J^-1 J'| <= m and 2 b m < 1 there is a solution within 2 b, and no
    other one within 1 / m.

    Args:
        forms: (k - 1, k, k).
        y: (P, k); real ones stay real.

    Returns:
        Solutions (P, k) of length 1; radius (P,) within which one exists, infinite where nothing is proved;
        radius (P,) within which it is the only one in the plane at right angles to y.
    """
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    result, _, _ = _corrected(np.broadcast_to(forms, (len(y), *forms.shape)), y, y.conj(), steps=4)
    size = np.linalg.norm(result, axis=1, keepdims=True)
    result = result / np.where(size > 0, size, 1.0)
    around, alone = np.full(len(y), np.inf), np.zeros(len(y))
    curvature = 2.0 * float(np.sqrt(np.sum(np.linalg.norm(forms, ord=2, axis=(1, 2)) ** 2)))
    for p, one in enumerate(result):
        J = np.vstack([2.0 * forms @ one, one.conj()])
        values = np.linalg.svd(J, compute_uv=False)
        if values[-1] < _REGULAR:
            continue
        defect = np.append(np.einsum("i,nij,j->n", one, forms, one), 0.0)
        # The theorem holds for exact numbers: the rounding error of the defect is added to it.
        rounding = 1e-15 * len(one) * curvature
        b, m = (np.linalg.norm(defect) + rounding) / values[-1], curvature / values[-1]
        if 2.0 * b * m < 1.0:
            around[p], alone[p] = 2.0 * b, 1.0 / m
    return result, around, alone


def distinct(y: np.ndarray, apart: float = 1e-7) -> np.ndarray:
    """Indices of the first of every group of equal solutions (P, k), whatever their factors."""
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    kept: list[int] = []
    for p, one in enumerate(y):
        others = y[kept]
        along = others.conj() @ one
        if not np.any(np.linalg.norm(one - along[:, None] * others, axis=1) < apart):
            kept.append(p)
    return np.array(kept, dtype=int)
