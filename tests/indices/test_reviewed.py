import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.indices.arms.operation import operation_indices
from ocptip.indices.lines import adjoint
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.reviewed import (
    inv_cdn,
    inv_cdn_cl,
    inv_cdn_points,
    manipulability,
)
from tests.indices.sample_axes import random_axes, random_ellipsoid, random_pose

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@given(seeds)
def test_condition_number_against_numpy_and_its_flaw(rng):
    J, (rotation, position) = random_axes(rng), random_pose(rng)
    assert inv_cdn(J) == pytest.approx(1 / np.linalg.cond(J))
    assert inv_cdn(adjoint(rotation, np.zeros(3)) @ J) == pytest.approx(inv_cdn(J))
    assert inv_cdn(adjoint(rotation, 5 * position) @ J) != pytest.approx(inv_cdn(J), rel=1e-6)


@given(seeds)
def test_characteristic_length_is_an_operation_sphere(rng):
    J, point, length = random_axes(rng), rng.normal(size=3), rng.uniform(0.1, 2)
    sphere = OperationEllipsoid.sphere(length * np.sqrt(1.5), point)
    assert sphere.characteristic_length == pytest.approx(length)
    value = inv_cdn_cl(J, point, length)
    assert value == pytest.approx(operation_indices(J, sphere).inv_cdn_oe)
    rotation, position = random_pose(rng)
    moved = inv_cdn_cl(adjoint(rotation, position) @ J, rotation @ point + position, length)
    assert moved == pytest.approx(value)
    bigger = J * np.array([1, 1, 1, 3, 3, 3])[:, None]
    assert inv_cdn_cl(bigger, 3 * point, 3 * length) == pytest.approx(value)


@given(seeds)
def test_point_condition_is_the_index_of_the_ellipsoid_if_the_points_are_its_vertices(rng):
    J, ellipsoid, pose = random_axes(rng), random_ellipsoid(rng), random_pose(rng)
    value = inv_cdn_points(J, ellipsoid.vertices(*pose))
    assert value == pytest.approx(operation_indices(J, ellipsoid, *pose).inv_cdn_oe)
    three = ellipsoid.vertices(*pose)[:3]
    moved = adjoint(*pose) @ J
    assert inv_cdn_points(moved, three @ pose[0].T + pose[1]) == pytest.approx(inv_cdn_points(J, three))


@given(seeds)
def test_manipulability(rng):
    J = random_axes(rng)
    assert manipulability(J) == pytest.approx(abs(np.linalg.det(J)))
    assert manipulability(adjoint(*random_pose(rng)) @ J) == pytest.approx(manipulability(J), rel=1e-6)
    assert manipulability(J[:, rng.permutation(6)]) == pytest.approx(manipulability(J))
    scaled = J * np.array([1, 1, 1, 2, 2, 2])[:, None]
    assert manipulability(scaled) == pytest.approx(8 * manipulability(J))
    seven = random_axes(rng, 7)
    assert manipulability(seven) == pytest.approx(np.sqrt(np.linalg.det(seven @ seven.T)))


def test_singular_axes_give_exact_zeros():
    J = random_axes(np.random.default_rng(1))
    J[:, 3] = J[:, 1]
    assert inv_cdn(J) == 0.0
    assert inv_cdn_cl(J, [0, 0, 1], 0.3) == 0.0
    assert inv_cdn_points(J, np.eye(3)) == 0.0
    assert manipulability(J) < 1e-12


def test_many_poses_at_once():
    rng = np.random.default_rng(2)
    J, points = np.array([random_axes(rng) for _ in range(3)]), rng.normal(size=(3, 4, 3))
    for k in range(3):
        assert inv_cdn(J)[k] == inv_cdn(J[k])
        assert inv_cdn_cl(J, points[:, 0], 0.4)[k] == pytest.approx(inv_cdn_cl(J[k], points[k, 0], 0.4))
        assert inv_cdn_points(J, points)[k] == pytest.approx(inv_cdn_points(J[k], points[k]))
        assert manipulability(J)[k] == pytest.approx(manipulability(J[k]))


def test_bad_input_is_refused():
    J = random_axes(np.random.default_rng(3))
    with pytest.raises(InputError, match="n >= 6 axes"):
        inv_cdn(J[:, :5])
    with pytest.raises(InputError, match="NaN"):
        manipulability(np.full((6, 6), np.nan))
    with pytest.raises(InputError, match="length"):
        inv_cdn_cl(J, [0, 0, 0], 0.0)
    with pytest.raises(InputError, match="on a line"):
        inv_cdn_points(J, [[0, 0, 0], [1, 1, 1], [2, 2, 2]])
    with pytest.raises(InputError, match="k >= 3"):
        inv_cdn_points(J, [[0, 0, 0], [1, 1, 1]])


@given(seeds)
def test_more_than_six_axes_have_six_singular_values(rng):
    """The eigenvalues of J J' M' M are those of (M J) (M J)' without zeros; M: velocities of the points."""
    J, points = random_axes(rng, int(rng.integers(7, 10))), rng.normal(size=(4, 3))
    M = np.vstack([np.hstack([[[0, z, -y], [-z, 0, x], [y, -x, 0]], np.eye(3)]) for x, y, z in points])
    squares = np.sort(np.linalg.eigvals(J @ J.T @ M.T @ M).real)
    assert inv_cdn_points(J, points) == pytest.approx(np.sqrt(squares[0] / squares[-1]), rel=1e-6)
    assert inv_cdn_points(J, points) > 1e-6
    J[:] = J[:, :1]
    assert inv_cdn_points(J, points) == 0.0
