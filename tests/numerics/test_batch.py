"""Batch evaluation equals CasADi's own, for all counts around the block size and all output shapes."""

import casadi as cs
import numpy as np
import pytest

from ocptip.numerics.batch import BatchFunction


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
