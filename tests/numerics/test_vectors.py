"""Cross products of single vectors, many and expressions; angles a whole number of turns away."""

import casadi as cs
import numpy as np
import pytest

from ocptip.numerics.vectors import TURN, cross, cross_terms, distinct_rows, nearest_turn, skew


@pytest.mark.parametrize("shapes", [((3,), (3,)), ((5, 3), (5, 3)), ((3,), (4, 3)), ((2, 1, 3), (6, 3))])
def test_cross_is_numpys(shapes):
    rng = np.random.default_rng(1)
    a, b = (rng.normal(size=shape) for shape in shapes)
    np.testing.assert_array_equal(cross(a, b), np.cross(a, b))
    np.testing.assert_allclose((skew(a) @ b[..., None])[..., 0], np.cross(a, b), rtol=1e-12, atol=1e-15)


def test_cross_of_expressions():
    a, b = cs.SX.sym("a", 3), cs.SX.sym("b", 3)
    found = cs.Function("cross", [a, b], [cs.vertcat(*cross_terms(cs.vertsplit(a), cs.vertsplit(b)))])
    assert found([1, 2, 3], [4, 5, 7]).full().ravel() == pytest.approx(np.cross([1, 2, 3], [4, 5, 7]))


def test_nearest_turn():
    rng = np.random.default_rng(2)
    angles, near = rng.uniform(-30, 30, (2, 200))
    for wanted in (0.0, near):
        found = nearest_turn(angles, wanted)
        assert np.abs(found - wanted).max() <= np.pi + 1e-12
        np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * angles), atol=1e-12)
    within = rng.uniform(-np.pi, np.pi, 50)
    np.testing.assert_array_equal(nearest_turn(within), within)
    np.testing.assert_array_equal(nearest_turn(within + 5 * TURN, within + 5 * TURN), within + 5 * TURN)
    assert np.isnan(nearest_turn(np.array([np.nan]))).all()


@pytest.mark.parametrize("rows", [[[1, 0]], [[1, 0], [1, 0]], [[1, 0], [0, 1], [1, 0]], np.empty((0, 2))])
def test_distinct_rows_and_their_places_give_the_rows(rows):
    rows = np.array(rows)
    distinct, which = distinct_rows(rows)
    np.testing.assert_array_equal(distinct[which], rows)
    assert len(distinct) == len({tuple(row) for row in rows})
    assert which.shape == (len(rows),)
