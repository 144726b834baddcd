"""Joints that move: each with a speed and an acceleration anywhere in an interval about zero.

At a posture the wrench on the base and the torques are linear in the accelerations and quadratic in the
speeds. So the ends of the accelerations decide. The worst speeds are searched from all ends.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import combinations, product

import numpy as np

_SWEEPS = 8


class JointBox:
    """Speeds and accelerations of n joints.

    Args:
        speed: (n,), rad/s (sliding joints: m/s), the largest one in both directions.
        acceleration: (n,), rad/s^2 (m/s^2), likewise.
    """

    def __init__(self, speed: np.ndarray, acceleration: np.ndarray) -> None:
        self.speed, self.acceleration, n = speed, acceleration, len(speed)
        self._pairs = np.array([*((k, k) for k in range(n)), *combinations(range(n), 2)])
        if not np.any(speed):
            self._pairs = self._pairs[:0]
        unit, none = np.eye(n), np.zeros(n)
        rates = [np.r_[none, none, one] for one in unit]
        rates += [np.r_[none, unit[i] + (i != j) * unit[j], none] for i, j in self._pairs]
        self._rates = np.array(rates)  # (K, 3 n)

    def parts(
        self, values: Callable[[np.ndarray, np.ndarray], np.ndarray], s: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Parts of values per acceleration (k, d, n), and per product of two speeds (k, d, n, n), symmetric.

        Args:
            values: (m, d) of states (m, 3 n) and of the rows of `s` that they are of.
            s: (k, 3 n) states at rest.
        """
        count, n = len(s), len(self.speed)
        rows = np.repeat(np.arange(count), len(self._rates))
        moving = values((s[:, None] + self._rates).reshape(-1, s.shape[1]), rows)
        change = moving.reshape(count, len(self._rates), -1) - values(s, np.arange(count))[:, None]
        products = np.zeros((count, change.shape[2], n, n))
        for number, (i, j) in enumerate(self._pairs, n):
            both = change[:, number]
            if i != j:
                both = (both - products[:, :, i, i] - products[:, :, j, j]) / 2
            products[:, :, i, j] = products[:, :, j, i] = both
        return np.swapaxes(change[:, :n], 1, 2), products

    def most(self, parts: tuple[np.ndarray, np.ndarray], a: np.ndarray) -> np.ndarray:
        """(k, R): no functional a (R, d) of the values changes by more."""
        linear, products = parts
        change = np.abs(np.tensordot(a, linear, (1, 1))) @ self.acceleration
        if np.any(self.speed):
            i, j = self._pairs.T
            size = self.speed[i] * self.speed[j] * np.where(i == j, 1.0, 2.0)
            change += np.abs(np.tensordot(a, products[:, :, i, j], (1, 1))) @ size
        return change.T

    def least(self, parts: tuple[np.ndarray, np.ndarray], a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where functionals a (k, d) of the values are minimal: what to add to states at rest, (k, 3 n), and
        the change (k,) of the functionals."""
        linear, products = parts
        slopes = _times(a, linear)
        value, speeds = -np.abs(slopes) @ self.acceleration, np.zeros(slopes.shape)
        if np.any(self.speed):
            bent = _times(a, products)
            speeds = self._slowest(bent)
            fast = np.sum(speeds * (bent @ speeds[:, :, None])[:, :, 0], axis=1)
            value, speeds = value + np.minimum(fast, 0.0), np.where(fast[:, None] < 0, speeds, 0.0)
        return np.hstack([0 * slopes, speeds, -np.sign(slopes) * self.acceleration]), value

    def _slowest(self, products: np.ndarray) -> np.ndarray:
        """(k, n) speeds v with minimal v . products (k, n, n) . v: from the best ends joint by joint."""
        n = len(self.speed)
        diagonal = products[:, range(n), range(n)]
        convex = products.copy()  # lower than the products: what helps at its largest is left out
        convex[:, range(n), range(n)] = np.minimum(diagonal, 0.0)
        ends = self._ends
        both = (ends[:, :, None] * ends[:, None]).reshape(len(ends), -1)
        values = convex.reshape(len(convex), n * n) @ both.T
        speeds = ends[np.argmin(values, axis=1)]
        for i in [*range(n)] * _SWEEPS:
            slope = np.einsum("kj,kj->k", products[:, i], speeds) - diagonal[:, i] * speeds[:, i]
            bent = diagonal[:, i] > 0
            inside = np.clip(-slope / np.where(bent, diagonal[:, i], 1.0), -self.speed[i], self.speed[i])
            speeds[:, i] = np.where(bent, inside, np.where(slope > 0, -1.0, 1.0) * self.speed[i])
        return speeds

    @cached_property
    def _ends(self) -> np.ndarray:
        """(2^(n - 1), n): all signs together change nothing."""
        signs = product((1.0,), *((1.0, -1.0) for _ in self.speed[1:]))
        return np.array(list(signs)) * self.speed


def _times(a: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """(k, ...) of functionals a (k, d) and parts (k, d, ...)."""
    shape = parts.shape
    return (a[:, None] @ parts.reshape(*shape[:2], int(np.prod(shape[2:])))).reshape(len(a), *shape[2:])
