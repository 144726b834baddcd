"""Matrix exponentials of many steps at once, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from ocptip.standing.elastic.steps import exponentials


@pytest.mark.parametrize("fast", [0.5, 60.0, 3000.0])  # rad/s
def test_exponentials_of_springs_under_loads_are_those_of_scipy(fast):
    rng, d, count = np.random.default_rng(0), 6, 120  # more than are made at once
    root = rng.normal(size=(count, d, d))
    stiffness = fast**2 * (np.eye(d) + 0.1 * root @ np.swapaxes(root, 1, 2))
    A = np.zeros((count, 2 * d + 4, 2 * d + 4))
    A[:, :d, d : 2 * d] = np.eye(d)
    A[:, d : 2 * d, :d], A[:, d : 2 * d, d : 2 * d] = -stiffness, -0.1 * fast * np.eye(d)
    A[:, d : 2 * d, 2 * d :] = rng.normal(size=(count, d, 4)) * [10, 1e2, 1e4, 1e6]
    A[:, [-3, -2, -1], [-4, -3, -2]] = 1.0
    A *= rng.uniform(0.1, 2, (count, 1, 1)) / fast
    scale = np.repeat([1.0, 2.0 ** np.round(np.log2(fast)), 1.0], [d, d, 4])
    small = np.repeat([1.0, fast, 1e-7], [d, d, 4])  # without it SciPy's are off by 1e-8
    found, true = exponentials(A, scale, 2 * d), expm(A * (small / small[:, None])) * (small[:, None] / small)
    size = np.abs(true[:, : 2 * d]).max(axis=0)
    assert np.max(np.abs(found - true)[:, : 2 * d] / size) < 1e-13
    np.testing.assert_allclose(found[:, 2 * d :], true[:, 2 * d :], rtol=1e-12, atol=1e-14)
