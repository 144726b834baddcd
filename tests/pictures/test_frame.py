import numpy as np
import pytest
from hypothesis import given, seed
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from ocptip.pictures.frame import hull


@seed(1)
@given(st.integers(0, 10**6), st.integers(3, 60), st.booleans())
def test_hull_is_that_of_qhull(own_seed, count, coarse):
    rng = np.random.default_rng(own_seed)
    points = rng.normal(size=(count, 2))
    if coarse:  # many points twice, and on the edges
        points = np.vstack([np.round(2 * points), [[-9, -9], [9, -9], [9, 0], [9, 9], [0, 9]]])
    corners, expected = points[hull(points)], points[ConvexHull(points).vertices]
    assert {*map(tuple, corners)} == {*map(tuple, expected)}
    x, y = corners.T
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert area == pytest.approx(ConvexHull(points).volume)  # positive: to the left all the way


@pytest.mark.parametrize("points", [np.zeros((0, 2)), np.ones((1, 2)), [[0, 0], [1, 1], [2, 2], [0.5, 0.5]]])
def test_hull_without_area_is_all_points(points):
    assert hull(np.asarray(points, float)).tolist() == list(range(len(points)))
