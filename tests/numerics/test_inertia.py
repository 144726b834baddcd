"""Inertia of rigid bodies, against clouds of point masses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.numerics.inertia import parallel_axis, symmetric_matrix, union, why_impossible
from tests.quick import examples


def body(masses, points):
    """A cloud of point masses as a rigid body."""
    centre = masses @ points / masses.sum()
    return (
        masses.sum(),
        centre,
        sum(parallel_axis(m, p - centre) for m, p in zip(masses, points, strict=True)),
    )


@examples(30)
@given(st.integers(0, 10_000))
def test_the_union_of_two_clouds_is_the_cloud_of_both(seed):
    rng = np.random.default_rng(seed)
    masses, points = rng.uniform(0.1, 5, 12), rng.normal(size=(12, 3))
    together = union(body(masses[:5], points[:5]), body(masses[5:], points[5:]))
    for value, expected in zip(together, body(masses, points), strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-12)
    assert not why_impossible(together[2], 1e-12)


def test_a_flat_cloud_is_at_the_limit_of_what_is_possible():
    flat = body(np.ones(4), np.array([[1, 0, 0], [-1, 0, 0], [0, 2, 0], [0, -2, 0.0]]))[2]
    np.testing.assert_allclose(flat, np.diag([8, 2, 10]))
    assert not why_impossible(flat, 1e-12)
    assert "largest must not exceed" in why_impossible(flat + np.diag([0, 0, 0.01]), 1e-3)
    assert "(-1, 1, 1 kg m^2)" in why_impossible(np.diag([1, -1, 1]), 1e-9)


def test_forms_of_a_matrix():
    matrix = np.array([[1, 2, 3], [2, 4, 5], [3, 5, 6.0]])
    np.testing.assert_array_equal(symmetric_matrix([1, 2, 3, 4, 5, 6]), matrix)
    np.testing.assert_array_equal(symmetric_matrix(matrix), matrix)
    np.testing.assert_array_equal(symmetric_matrix([1, 2, 3]), np.diag([1, 2, 3]))
    with pytest.raises(InputError, match="inertia: must be symmetric"):
        symmetric_matrix(matrix + np.triu(np.ones((3, 3)), 1))
    for other, got in (
        ([1, 2, 3, 4], "got 4"),
        ([[1, 2], [3]], "expected numbers"),
        (2.0, "a single number"),
    ):
        with pytest.raises(InputError, match=rf"^inertia: .*{got}"):
            symmetric_matrix(other)
