import clarabel
import numpy as np
import pytest
from scipy.sparse import csc_matrix

from ocptip.numerics.cone_program import columns_of, no_columns
from tests.quick import some


@pytest.mark.parametrize("seed", some(4, range(20)))
def test_the_same_entries_as_scipy(seed):
    rng = np.random.default_rng(seed)
    shape = rng.integers(0, 6, size=2)
    matrix = rng.normal(size=shape) * (rng.uniform(size=shape) < rng.uniform())
    ours, theirs = columns_of(matrix), csc_matrix(matrix)
    assert ours.shape == theirs.shape
    for name in ("data", "indices", "indptr"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))


def test_clarabel_solves_the_same_program():
    rng = np.random.default_rng(0)
    A, x = rng.normal(size=(8, 5)), rng.uniform(size=5)
    A[np.abs(A) < 0.3] = 0.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    b, cost, cones = A @ x + 1.0, A.T @ -rng.uniform(size=8), [clarabel.NonnegativeConeT(8)]
    ours = clarabel.DefaultSolver(no_columns(5), cost, columns_of(A), b, cones, settings).solve()
    theirs = clarabel.DefaultSolver(csc_matrix((5, 5)), cost, csc_matrix(A), b, cones, settings).solve()
    assert str(ours.status) == "Solved"
    assert list(ours.x) == list(theirs.x)
