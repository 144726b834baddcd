import numpy as np
import pytest
from hypothesis import given, seed
from hypothesis import strategies as st
from scipy.optimize import lsq_linear, nnls

from ocptip.numerics.non_negative import non_negative
from tests.quick import examples


@seed(1)
@examples(60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(1, 16), st.booleans(), st.integers(-6, 6))
def test_nothing_is_nearer(number, m, n, alike, power):
    rng = np.random.default_rng(number)
    A, b = 10.0**power * rng.normal(size=(m, n)), rng.normal(size=m)
    if alike:  # columns and rows that depend on each other
        A[:, n // 2 :] = A[:, : n - n // 2]
        b = A @ np.abs(rng.normal(size=n))
    x, residual = non_negative(A, b)
    assert np.all(x >= 0)
    assert residual == pytest.approx(np.linalg.norm(A @ x - b), abs=1e-12 * np.linalg.norm(b))
    slopes = A.T @ (b - A @ x) / (np.linalg.norm(A, axis=0) * np.linalg.norm(b))  # Kuhn and Tucker
    assert np.max(slopes) <= 1e-12
    assert np.max(np.abs(slopes[x > 0]), initial=0.0) <= 1e-12
    scipy_x, _ = nnls(A, b)
    assert residual <= np.linalg.norm(A @ scipy_x - b) + 1e-10 * np.linalg.norm(b)


@seed(2)
@examples(40)
@given(st.integers(0, 2**32 - 1), st.integers(3, 12), st.integers(1, 8), st.integers(0, 8))
def test_the_last_ones_may_have_any_sign(number, m, n, signed):
    rng, signed = np.random.default_rng(number), min(signed, n)
    A, b = rng.normal(size=(m, n)), rng.normal(size=m)
    x, residual = non_negative(A, b, signed=signed)
    assert np.all(x[: n - signed] >= 0)
    low = np.r_[np.zeros(n - signed), np.full(signed, -np.inf)]
    with np.errstate(all="ignore"):  # it divides by zero now and then
        other = lsq_linear(A, b, (low, np.full(n, np.inf)), tol=1e-14)
    assert residual <= np.sqrt(2 * other.cost) + 1e-9


def test_nothing_to_find():
    assert non_negative(np.zeros((2, 0)), np.ones(2)) == (pytest.approx([]), pytest.approx(np.sqrt(2)))
    x, residual = non_negative(np.zeros((2, 3)), np.ones(2))
    assert list(x) == [0, 0, 0]
    assert residual == pytest.approx(np.sqrt(2))
    x, _ = non_negative(np.ones((1, 2)), np.zeros(1))
    assert list(x) == [0, 0]
