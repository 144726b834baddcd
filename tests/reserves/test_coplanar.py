import numpy as np
import pytest

from ocptip.reserves.coplanar import largest_growth


def loads(seed, n, count=20):
    """Contacts anywhere on a plane with friction, normal loads that they hold and tangential ones."""
    rng = np.random.default_rng(seed)
    mu, places = rng.uniform(0.1, 0.9, n), rng.normal(size=(n, 2))
    A = np.zeros((n, 3, 6))
    A[:, 0, 2], A[:, 0, 3], A[:, 0, 4] = 1 / mu, places[:, 1] / mu, -places[:, 0] / mu
    A[:, 1, 0], A[:, 2, 1] = 1.0, 1.0
    A[:, 1, 5], A[:, 2, 5] = -places[:, 1], places[:, 0]
    held = np.zeros((count, n, 3))
    held[:, :, 0] = rng.uniform(0.05, 1, (count, n))
    growing = np.zeros((count, 6))
    growing[:, [0, 1, 5]] = rng.normal(size=(count, 3)) * mu.mean()
    return np.repeat(A[None], count, axis=0), np.einsum("nkr,snk->sr", A, held), growing


@pytest.mark.parametrize("n", [3, 4, 6, 8, 12])
def test_forces_and_multipliers_prove_each_other(n):
    A, fixed, growing = loads(n, n)
    s, x, y = largest_growth(A, fixed, growing)
    np.testing.assert_allclose(np.einsum("snkr,snk->sr", A, x), fixed + s[:, None] * growing, atol=1e-8)
    assert np.all(np.linalg.norm(x[:, :, 1:], axis=2) <= x[:, :, 0] + 1e-9)
    prices = np.einsum("snkr,sr->snk", A, y)
    assert np.all(np.linalg.norm(prices[:, :, 1:], axis=2) <= prices[:, :, 0] + 1e-9)
    np.testing.assert_allclose(np.einsum("sr,sr->s", y, growing), -1.0, atol=1e-9)
    np.testing.assert_allclose(np.einsum("sr,sr->s", y, fixed), s, rtol=1e-9)


def test_the_growth_of_a_block_on_four_corners_is_that_of_coulomb():
    """Pushed along any direction at the height of its contacts: friction times weight."""
    places, mu, weight = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1.0]]), 0.4, 1.0
    A = np.zeros((1, 4, 3, 6))
    A[0, :, 0, 2], A[0, :, 0, 3], A[0, :, 0, 4] = 1 / mu, places[:, 1] / mu, -places[:, 0] / mu
    A[0, :, 1, 0] = A[0, :, 2, 1] = 1.0
    A[0, :, 1, 5], A[0, :, 2, 5] = -places[:, 1], places[:, 0]
    for angle in (0.0, 0.3, 2.0):
        push = np.array([[np.cos(angle), np.sin(angle), 0, 0, 0, 0]])
        s, _, _ = largest_growth(A, np.array([[0, 0, weight, 0, 0, 0]]), push)
        np.testing.assert_allclose(s, mu * weight, rtol=1e-10)
    twist = np.array([[0, 0, 0, 0, 0, 1.0]])
    s, _, _ = largest_growth(A, np.array([[0, 0, weight, 0, 0, 0]]), twist)
    np.testing.assert_allclose(s, mu * weight * np.sqrt(2), rtol=1e-10)


def test_a_load_that_no_normal_forces_hold_has_no_growth():
    A, fixed, growing = loads(1, 4, 3)
    fixed[1] = -fixed[1]
    s, x, y = largest_growth(A, fixed, growing)
    assert np.isnan(s[1])
    assert np.isnan(x[1]).all()
    assert np.isnan(y[1]).all()
    assert np.isfinite(s[[0, 2]]).all()
