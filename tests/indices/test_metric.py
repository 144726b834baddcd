import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.indices.lines import adjoint, point_velocity, screw_decompose
from ocptip.indices.metric import OperationEllipsoid, velocity_map
from tests.indices.sample_axes import distance_to_point, point_metric, random_ellipsoid, random_pose

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@given(seeds)
def test_metric_is_the_sum_of_squared_velocities_of_the_vertices(rng):
    ellipsoid, (rotation, position) = random_ellipsoid(rng), random_pose(rng)
    screw, vertices = rng.normal(size=6), ellipsoid.vertices(rotation, position)
    direct = sum(np.sum(point_velocity(screw, x) ** 2) for x in vertices)
    metric = ellipsoid.W(rotation, position)
    assert screw @ metric @ screw == pytest.approx(direct)
    motion = screw_decompose(screw)
    distances = [distance_to_point(motion.axis, x) for x in vertices]
    by_axis = motion.angular**2 * np.sum(np.square(distances)) + 6 * motion.linear**2  # (3.16)
    assert by_axis == pytest.approx(direct)
    inverse = np.linalg.inv(adjoint(rotation, position))
    assert metric == pytest.approx(inverse.T @ ellipsoid.W() @ inverse, abs=1e-9)
    factor = ellipsoid.factor(rotation, position)
    assert factor.T @ factor == pytest.approx(metric)
    assert np.linalg.eigvalsh(metric)[0] > 0


def test_own_frame_has_the_printed_diagonal():
    a, b, c = 0.3, 0.2, 0.5
    squares = [2 * (b**2 + c**2), 2 * (a**2 + c**2), 2 * (a**2 + b**2), 6, 6, 6]  # (3.23)
    ellipsoid = OperationEllipsoid(np.zeros(3), half_axes=[a, b, c])
    assert ellipsoid.W() == pytest.approx(np.diag(squares))
    assert OperationEllipsoid.sphere(0.3).characteristic_length == pytest.approx(0.3 * np.sqrt(2 / 3))


@given(seeds, st.integers(4, 60))
def test_reduction_of_a_point_cloud(rng, count):
    cloud = rng.normal(size=(count, 3)) @ np.diag(rng.uniform(0.5, 2.0, 3))
    ellipsoid = OperationEllipsoid.from_points(cloud)
    rotation, position = random_pose(rng)
    exact = point_metric(cloud @ rotation.T + position)
    assert count / 6 * ellipsoid.W(rotation, position) == pytest.approx(exact, abs=1e-9 * count)
    stacked = velocity_map(cloud)
    assert stacked.T @ stacked == pytest.approx(point_metric(cloud), abs=1e-9 * count)


def test_solid_ellipsoid_against_sampled_points():
    rng = np.random.default_rng(5)
    half_axes = np.array([0.3, 0.5, 0.2])
    points = rng.normal(size=(200_000, 3))
    points *= rng.uniform(size=(len(points), 1)) ** (1 / 3) / np.linalg.norm(points, axis=1, keepdims=True)
    sampled = OperationEllipsoid.from_points(points * half_axes)
    expected = np.sort(np.sqrt(0.6) * half_axes)
    assert np.sort(sampled.half_axes) == pytest.approx(expected, rel=5e-3)


@given(seeds)
def test_vertices_of_a_sphere_may_be_chosen_freely(rng):
    axes, center = random_pose(rng)
    turned = OperationEllipsoid(center, axes, np.full(3, 0.4))
    assert turned.W() == pytest.approx(OperationEllipsoid.sphere(0.4, center).W(), abs=1e-12)


def test_many_poses_at_once():
    rng = np.random.default_rng(3)
    ellipsoid = random_ellipsoid(rng)
    rotations, positions = zip(*[random_pose(rng) for _ in range(4)], strict=True)
    many = ellipsoid.W(np.array(rotations), np.array(positions))
    for k in range(4):
        assert many[k] == pytest.approx(ellipsoid.W(rotations[k], positions[k]))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"half_axes": [0.1, 0.0, 0.1]}, "volume"),
        ({"half_axes": [0.1, -0.1, 0.1]}, "volume"),
        ({"half_axes": [0.1, 0.1]}, "half_axes"),
        ({"axes": np.diag([1.0, 1.0, -1.0])}, "rotation"),
        ({"axes": np.ones((3, 3))}, "rotation"),
        ({"center": [0, np.nan, 0]}, "center"),
    ],
)
def test_bad_ellipsoids_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        OperationEllipsoid(**{"center": np.zeros(3), **arguments})


def test_flat_point_clouds_are_refused():
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    with pytest.raises(InputError, match="one plane"):
        OperationEllipsoid.from_points(flat)
    with pytest.raises(InputError, match="at least 4"):
        OperationEllipsoid.from_points(flat[:3])
    with pytest.raises(InputError, match="radius"):
        OperationEllipsoid.sphere(-1.0)


def test_plain_data_round_trip():
    ellipsoid = random_ellipsoid(np.random.default_rng(9))
    again = OperationEllipsoid(**ellipsoid.to_dict())
    assert again.W() == pytest.approx(ellipsoid.W())
    with pytest.raises(ValueError, match="read-only"):
        ellipsoid.half_axes[0] = 1.0
