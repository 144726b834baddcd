"""CasADi functions at single points: values, shapes, and that earlier results stay what they were."""

from concurrent.futures import ThreadPoolExecutor

import casadi as cs
import numpy as np
import pytest

from ocptip.numerics.point import PointFunction


@pytest.fixture(scope="module", params=[cs.SX, cs.MX])
def function(request):
    """Of a column and a matrix: a column, a matrix and a sparse matrix."""
    x, A = request.param.sym("x", 3), request.param.sym("A", 2, 3)
    sparse = cs.diag(x)
    return PointFunction(cs.Function("f", [x, A], [A @ x, A * x[0], sparse]))


def expected(x, A):
    return A @ x, A * x[0], np.diag(x)


def test_values_and_shapes(function):
    x, A = np.array([1.0, 2.0, 3.0]), np.arange(6.0).reshape(2, 3)
    for found, wanted in zip(function(x, A), expected(x, A), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_results_do_not_change_with_the_next_call(function):
    x, A = np.ones(3), np.ones((2, 3))
    before = function(x, A)
    function(5 * x, 7 * A)
    for found, wanted in zip(before, expected(x, A), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_threads_do_not_mix_their_arguments(function):
    A = np.ones((2, 3))

    def look(k):
        return all(function(np.full(3, float(k)), A)[0][0] == 3 * k for _ in range(200))

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(look, range(8)))
