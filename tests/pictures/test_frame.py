import io

import numpy as np
import pytest
from hypothesis import given, seed
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial import ConvexHull

from ocptip.pictures.frame import encoded, hull


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


@pytest.mark.parametrize("channels", [3, 4])
def test_pictures_come_back(channels):
    pixels = np.random.default_rng(1).integers(0, 256, (7, 11, channels), dtype=np.uint8)
    with Image.open(io.BytesIO(encoded(pixels, 130))) as image:
        image.load()
        assert (image.format, image.mode) == ("PNG", "RGB")
        assert image.info["dpi"] == pytest.approx((130, 130), abs=0.01)
        np.testing.assert_array_equal(np.asarray(image), pixels[:, :, :3])
