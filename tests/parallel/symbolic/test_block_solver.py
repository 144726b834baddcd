"""Symbolic linear systems: right for regular matrices, and divided by factors of the determinant only."""

from __future__ import annotations

import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.parallel.symbolic.spatial_sx import BlockSystem, adjugate


def symbolic(matrix: np.ndarray) -> list[list[cs.SX]]:
    return [[cs.SX(float(v)) for v in row] for row in matrix]


def numbers(entries) -> np.ndarray:
    return np.array(cs.DM(cs.evalf(cs.vertcat(*entries)))).ravel()


@given(size=st.integers(1, 6), seed=st.integers(0, 10**6), density=st.sampled_from([0.3, 0.6, 1.0]))
def test_solutions(size, seed, density):
    rng = np.random.default_rng(seed)
    matrix = rng.uniform(-1, 1, (size, size)) * (rng.random((size, size)) < density)
    matrix[rng.permutation(size), np.arange(size)] += 2.0
    leading = np.linalg.svd(matrix[:3, :3], compute_uv=False)[-1]
    if np.linalg.cond(matrix) > 1e3 or (size > 3 and leading < 1e-2):
        return
    right = rng.uniform(-1, 1, size)
    system = BlockSystem(symbolic(matrix))
    b = [cs.SX(float(v)) for v in right]
    assert numbers(system.solve(b)) == pytest.approx(np.linalg.solve(matrix, right), abs=1e-7)
    if size <= 3:
        assert numbers(system.solve_transposed(b)) == pytest.approx(
            np.linalg.solve(matrix.T, right), abs=1e-7
        )


def test_blocks_follow_the_structure():
    a = [cs.SX.sym(f"a{k}") for k in range(5)]
    o = cs.SX(0)
    system = BlockSystem([[o, a[0], o], [a[1], a[2], o], [o, a[3], a[4]]])
    assert system.blocks[0] == ([0], [1])
    assert system.own_row(0) == 1
    assert BlockSystem([[a[0], a[1]], [a[2], a[3]]]).own_row(0) is None


@pytest.mark.parametrize("size", [2, 3])
def test_zero_pivots_do_no_harm(size):
    matrix = np.roll(np.eye(size), 1, axis=0) + 0.5 * np.tri(size, k=-1).T
    names = cs.SX.sym("m", size, size)
    entries = [[names[i, j] for j in range(size)] for i in range(size)]
    right = cs.SX.sym("b", size)
    solution = BlockSystem(entries).solve([right[k] for k in range(size)])
    function = cs.Function("solve", [names, right], [cs.vertcat(*solution)])
    b = np.arange(1.0, size + 1)
    assert matrix[0, 0] == 0
    assert np.array(function(matrix, b)).ravel() == pytest.approx(np.linalg.solve(matrix, b))


def test_adjugate():
    matrix = np.random.default_rng(0).uniform(-1, 1, (3, 3))
    rows, determinant = adjugate(symbolic(matrix))
    found = np.array([numbers(row) for row in rows])
    assert float(determinant) == pytest.approx(np.linalg.det(matrix))
    assert found @ matrix == pytest.approx(np.linalg.det(matrix) * np.eye(3), abs=1e-12)


def test_structurally_singular_matrix_is_refused():
    a, o = cs.SX.sym("a"), cs.SX(0)
    with pytest.raises(InputError, match="structurally singular"):
        BlockSystem([[a, a, o], [o, o, o], [a, a, a]])
