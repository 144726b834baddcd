"""States of linear systems over many steps at once: as step by step; matrix exponentials as SciPy's."""

import numpy as np
import pytest
from scipy.linalg import expm

from ocptip.standing.elastic.steps import ends_of_steps, exponentials, powers, states_within


def test_all_steps_at_once_are_the_steps_one_after_the_other():
    rng = np.random.default_rng(0)
    steps = np.tile(np.eye(6), (9, 1, 1))
    steps[:, :2] += 0.1 * rng.normal(size=(9, 2, 6))
    steps[:, 3, 2] = 0.25  # time
    counts = np.array([3, 1, 4, 40, 1, 2, 3, 40, 17])
    z = np.array([0.3, -0.2, 1.0, 0.0, 0.0, 0.0])
    ends = ends_of_steps(steps, counts, z, 2)
    states, owner = states_within(steps, counts, ends)
    for i, count in enumerate(counts):
        z[2:] = 1.0, 0.0, 0.0, 0.0
        expected = powers(steps[i], z, count)
        np.testing.assert_allclose(states[owner == i], expected[1:], rtol=1e-12, atol=1e-14)
        z = expected[-1].copy()
    np.testing.assert_allclose(ends[-1], z, rtol=1e-12, atol=1e-14)


def test_what_grows_without_end_has_no_numbers_and_no_warnings():
    steps = np.full((3, 3, 3), 1e200)
    assert not np.isfinite(ends_of_steps(steps, np.array([2, 2, 2]), np.ones(3), 1)[-1]).any()


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
