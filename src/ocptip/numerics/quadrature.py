"""Gauss-Legendre quadrature over intervals."""

from __future__ import annotations

from functools import cache

import numpy as np

from ocptip.basics.errors import whole_number
from ocptip.basics.frozen import read_only


def gauss_legendre(intervals: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the Gauss-Legendre nodes (s) in all intervals ((S, 2), s) and their weights (s), both (N,).

    Raises:
        InputError: order is not a whole number >= 1.
    """
    x, w = unit_gauss_legendre(whole_number("order", order, 1))
    left, right = intervals.T
    length = (right - left)[:, None]
    return (left[:, None] + length * x).ravel(), (length * w).ravel()


@cache
def unit_gauss_legendre(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights on [0, 1], (order,) each."""
    x, w = np.polynomial.legendre.leggauss(order)
    return read_only((x + 1) / 2), read_only(w / 2)
