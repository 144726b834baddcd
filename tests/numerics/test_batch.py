"""Batch evaluation equals CasADi's own, for all counts around the block size and all output shapes."""

from concurrent.futures import ThreadPoolExecutor

import casadi as cs
import numpy as np
import pytest

from ocptip.numerics.batch import BatchFunction, PointFunction


@pytest.mark.parametrize("count", [1, 15, 16, 63, 64, 65, 130])
def test_vectors_matrices_sparse_outputs_and_shared_inputs(count):
    x, g = cs.SX.sym("x", 3), cs.SX.sym("g", 2)
    matrix = cs.horzcat(x, x**2) * cs.repmat(g.T, 3, 1)
    sparse = cs.SX(3, 1)
    sparse[1] = x[0] * g[1]
    function = cs.Function("f", [x, g], [matrix, sparse, cs.sumsqr(x)])
    batch = BatchFunction(function)
    states, shared = np.random.default_rng(0).normal(size=(count, 3)), np.array([2.0, -1.0])
    got = batch(states, shared)
    assert [value.shape for value in got] == [(count, 3, 2), (count, 3), (count, 1)]
    for k, state in enumerate(states):
        for value, expected in zip(got, function(state, shared), strict=True):
            np.testing.assert_array_equal(value[k].reshape(expected.shape), np.array(expected))


def test_memory_is_not_shared_between_calls():
    x = cs.SX.sym("x")
    batch = BatchFunction(cs.Function("f", [x], [2 * x]))
    first = batch(np.ones((1, 1)))[0]
    batch(np.zeros((1, 1)))
    assert first[0, 0] == 2


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
