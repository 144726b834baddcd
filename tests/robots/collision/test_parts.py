"""Hulls of meshes whose corners have more neighbours than coal can count."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from ocptip.robots.collision.parts import NEIGHBOURS, convex_parts
from ocptip.robots.collision.shapes import Hull
from tests.quick import some


def circle(count, height):
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.column_stack([0.1 * np.cos(turn), 0.1 * np.sin(turn), np.full(count, height)])


def cone(count):
    return np.vstack([circle(count, 0.0), [[0.0, 0.0, 0.2]]])


def disc(count):
    return np.vstack([circle(count, 0.0), circle(count, 0.02)])


TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]


@pytest.mark.parametrize("turn", some(1, [TURN, np.eye(3)]), ids=["turned", "upright"])
@pytest.mark.parametrize(
    "points", some(1, [cone(300), cone(1000), disc(700)]), ids=["cone", "fine cone", "disc"]
)
def test_corners_with_hundreds_of_neighbours_are_thinned_out(points, turn):
    points = points @ turn
    with pytest.raises(RuntimeError, match="neighbors"):  # coal's; without it thinning out is not needed
        Hull(points).solid()
    parts = convex_parts(points, ConvexHull(points).simplices)
    assert len(parts) == 1
    Hull(parts[0]).solid()
    whole = ConvexHull(parts[0])
    assert np.max(whole.equations[:, :3] @ points.T + whole.equations[:, 3:]) < 1e-12  # m: it contains all
    assert whole.volume < 1.01 * ConvexHull(points).volume


def test_ordinary_hulls_stay_as_they_are():
    points = cone(NEIGHBOURS)
    (part,) = convex_parts(points, ConvexHull(points).simplices)
    np.testing.assert_array_equal(np.unique(part, axis=0), np.unique(points, axis=0))
