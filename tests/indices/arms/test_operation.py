import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh

from ocptip.basics.errors import InputError
from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.operation import operation_indices
from ocptip.indices.arms.values import index_values
from ocptip.indices.lines import adjoint, spear
from ocptip.indices.metric import OperationEllipsoid
from ocptip.published.arms import irb_2000
from tests.indices.sample_axes import (
    distance_to_point,
    published_motion,
    random_axes,
    random_ellipsoid,
    random_pose,
)

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)

# (half-axes a, b, c in mm, t, PI_OE, 1/CDN_OE, lambda_min in mm^2, DC in mm^2), [Naw07] 3.5
PUBLISHED = [
    ((100, 100, 100), 0.60, 0.228157, 0.009430, 2082.227856, 40000),
    ((100, 100, 100), 0.75, 0.546932, 0.026440, 11965.364194, 40000),
    ((100, 100, 100), 0.90, 0.731434, 0.049976, 21399.800676, 40000),
    ((300, 50, 50), 0.60, 0.764344, 0.015685, 5842.220352, 10000),
    ((300, 50, 50), 0.75, 0.976617, 0.023462, 9537.811310, 10000),
    ((300, 50, 50), 0.90, 0.996572, 0.033967, 9931.565011, 10000),
    ((50, 300, 300), 0.60, 0.163408, 0.020116, 9612.801947, 360000),
    ((50, 300, 300), 0.75, 0.399026, 0.057153, 57319.899153, 360000),
    ((50, 300, 300), 0.90, 0.509598, 0.100977, 93488.391607, 360000),
]


def published_ellipsoid(a, b, c):
    """Half-axes in mm: a along the tool axis (gripper z), b lateral (y), c across both (x)."""
    return OperationEllipsoid(np.zeros(3), half_axes=np.array([c, b, a]) * 1e-3)


@pytest.mark.parametrize(("half_axes", "t", "pi_oe", "inv_cdn_oe", "smallest", "constant"), PUBLISHED)
def test_published_values(half_axes, t, pi_oe, inv_cdn_oe, smallest, constant):
    pose = arm_pose(irb_2000(), published_motion(t))
    result = operation_indices(pose.jacobian, published_ellipsoid(*half_axes), pose.rotation, pose.position)
    assert result.pi_oe == pytest.approx(pi_oe, abs=5.1e-7)
    assert result.inv_cdn_oe == pytest.approx(inv_cdn_oe, abs=5.1e-7)
    assert result.eigenvalues[-1] * 1e6 == pytest.approx(smallest, abs=1e-6)
    assert result.design_constant * 1e6 == pytest.approx(constant)


def test_published_value_beside_the_singularity():
    values = index_values(irb_2000(), published_motion(0.55), names=["pi_oe"])
    assert values["pi_oe"] == pytest.approx(0.111063972617886, abs=1e-14)


@pytest.mark.parametrize(
    ("shape", "radius", "pi_max", "cdn_max"),
    [
        ("sphere", 50, 0.7405, None),
        ("sphere", 300, None, 0.1324),
        ("prolate", 300, 0.9966, None),
        ("oblate", 50, 0.7405, None),
        ("oblate", 300, None, 0.1011),
    ],
)
def test_published_maxima_between_the_singularities(shape, radius, pi_max, cdn_max):
    r = radius
    half_axes = {"sphere": (r, r, r), "prolate": (r, 50, 50), "oblate": (50, r, r)}[shape]
    q = np.array([published_motion(t) for t in np.linspace(0.5, 0.985465, 801)])
    values = index_values(
        irb_2000(), q, ellipsoid=published_ellipsoid(*half_axes), names=["pi_oe", "inv_cdn_oe"]
    )
    if pi_max is not None:
        assert values["pi_oe"].max() == pytest.approx(pi_max, abs=5.1e-5)
    if cdn_max is not None:
        assert values["inv_cdn_oe"].max() == pytest.approx(cdn_max, abs=6e-5)


def test_isotropic_axes():
    third, half = np.sqrt(3) / 3, np.sqrt(2) / 2
    lines = []
    for r, h, z, phase in ((-third, -half, half, 0.0), (third, half, half, np.pi / 3)):
        for k in range(3):
            phi = phase + 2 * np.pi * k / 3
            foot, direction = [r * np.cos(phi), r * np.sin(phi), h], [-np.sin(phi), np.cos(phi), z]
            lines.append(spear(foot, direction))
    J = np.array(lines).T
    result = operation_indices(J, OperationEllipsoid.sphere(1.0))
    assert (result.pi_oe, result.inv_cdn_oe) == pytest.approx((1.0, 1.0), abs=1e-13)
    assert result.eigenvalues == pytest.approx(np.full(6, 8.0))
    assert distance_to_point(J.T, np.zeros(3)) == pytest.approx(np.full(6, np.sqrt(2 / 3)))


@given(seeds)
def test_indices_are_the_extremal_eigenvalues(rng):
    J, ellipsoid, pose = random_axes(rng), random_ellipsoid(rng), random_pose(rng)
    result = operation_indices(J, ellipsoid, *pose)
    Z = J.T @ ellipsoid.W(*pose) @ J
    assert np.sort(result.eigenvalues) == pytest.approx(np.linalg.eigvalsh(Z), abs=1e-10 * np.trace(Z))
    vertices = ellipsoid.vertices(*pose)
    constant = np.sum(distance_to_point(J[:, 5], vertices) ** 2)
    assert result.design_constant == pytest.approx(constant)
    assert 0 <= result.inv_cdn_oe <= result.pi_oe <= 1
    assert result.eigenvalues[-1] <= constant * (1 + 1e-12)
    for value, rates in zip(result.eigenvalues, result.rates, strict=True):
        assert np.linalg.norm(rates) == pytest.approx(1)
        assert rates @ Z @ rates == pytest.approx(value, abs=1e-9 * np.trace(Z))
    assert np.abs(result.worst_rates) == pytest.approx(np.abs(result.rates[5]))


@given(seeds)
def test_invariance(rng):
    J, ellipsoid, pose = random_axes(rng), random_ellipsoid(rng), random_pose(rng)
    result = operation_indices(J, ellipsoid, *pose)
    expected = pytest.approx([result.pi_oe, result.inv_cdn_oe], rel=1e-8)
    rotation, position = random_pose(rng)
    moved = operation_indices(
        adjoint(rotation, position) @ J, ellipsoid, rotation @ pose[0], rotation @ pose[1] + position
    )
    assert [moved.pi_oe, moved.inv_cdn_oe] == expected
    factor = rng.uniform(0.01, 100)
    larger = OperationEllipsoid(factor * ellipsoid.center, ellipsoid.axes, factor * ellipsoid.half_axes)
    stretched = J * np.repeat([1, factor], 3)[:, None]
    scaled = operation_indices(stretched, larger, pose[0], factor * pose[1])
    assert [scaled.pi_oe, scaled.inv_cdn_oe] == expected
    reversed_axes = operation_indices(J * rng.choice([-1, 1], 6), ellipsoid, *pose)
    assert [reversed_axes.pi_oe, reversed_axes.inv_cdn_oe] == expected
    order = operation_indices(J[:, [*rng.permutation(5), 5]], ellipsoid, *pose)
    assert [order.pi_oe, order.inv_cdn_oe] == expected


@given(seeds)
def test_zero_exactly_in_singular_configurations(rng):
    J, ellipsoid, pose = random_axes(rng), random_ellipsoid(rng), random_pose(rng)
    assert operation_indices(J, ellipsoid, *pose).pi_oe > 0
    i, j = rng.choice(6, 2, replace=False)
    J[:, i] = J[:, j]
    result = operation_indices(J, ellipsoid, *pose)
    assert (result.pi_oe, result.inv_cdn_oe) == (0, 0)
    assert result.singular
    assert np.abs(J @ result.worst_rates).max() < 1e-13 * np.linalg.norm(J)


@given(seeds)
def test_six_lines_of_one_complex_are_singular(rng):
    meeting = spear(rng.normal(size=3), rng.normal(size=3))
    points = np.cross(meeting[:3], meeting[3:]) + np.outer(rng.normal(size=6), meeting[:3])
    J = spear(points, rng.normal(size=(6, 3))).T
    result = operation_indices(J, random_ellipsoid(rng), *random_pose(rng))
    assert result.pi_oe < 1e-12
    assert result.inv_cdn_oe < 1e-12


@given(seeds)
def test_larger_ellipsoids_move_more(rng):
    J, ellipsoid, pose = random_axes(rng), random_ellipsoid(rng), random_pose(rng)
    larger = OperationEllipsoid(
        ellipsoid.center, ellipsoid.axes, ellipsoid.half_axes * (1 + rng.uniform(0, 1, 3))
    )
    small, large = operation_indices(J, ellipsoid, *pose), operation_indices(J, larger, *pose)
    assert (large.eigenvalues >= small.eigenvalues * (1 - 1e-9)).all()
    assert large.design_constant >= small.design_constant


@given(seeds)
def test_sphere(rng):
    J, center, radius = random_axes(rng), rng.normal(size=3), rng.uniform(0.1, 1)
    Z = J.T @ OperationEllipsoid.sphere(radius, center).W() @ J
    distances = distance_to_point(J.T, center)
    assert np.diag(Z) == pytest.approx(6 * distances**2 + 4 * radius**2)
    on_axis = np.cross(J[:3, 5], J[3:, 5]) + rng.normal() * J[:3, 5]
    assert operation_indices(J, OperationEllipsoid.sphere(radius, on_axis)).inv_cdn_oe < 1


@given(seeds)
def test_design_constant_and_first_joint_along_motions(rng):
    arm = irb_2000()
    ellipsoid = random_ellipsoid(rng)
    q = rng.uniform(-2, 2, (3, 6))
    q[2] = q[1]
    q[2, 0] += 1.0
    pose = arm_pose(arm, q)
    result = operation_indices(pose.jacobian, ellipsoid, pose.rotation, pose.position)
    assert result.design_constant == pytest.approx(np.full(3, result.design_constant[0]))
    assert result.pi_oe[2] == pytest.approx(result.pi_oe[1], rel=1e-7, abs=1e-12)


@given(seeds)
def test_weighted_indices(rng):
    J, ellipsoid, pose = random_axes(rng), random_ellipsoid(rng), random_pose(rng)
    inertias = rng.uniform(0.1, 5, 6)
    plain = operation_indices(J, ellipsoid, *pose)
    equal = operation_indices(J, ellipsoid, *pose, inertias=np.full(6, 0.7))
    assert [equal.pi_oe, equal.inv_cdn_oe] == pytest.approx([plain.pi_oe, plain.inv_cdn_oe])
    weighted = operation_indices(J, ellipsoid, *pose, inertias=inertias)
    more = operation_indices(J, ellipsoid, *pose, inertias=13 * inertias)
    assert [more.pi_oe, more.inv_cdn_oe] == pytest.approx([weighted.pi_oe, weighted.inv_cdn_oe])
    Z = J.T @ ellipsoid.W(*pose) @ J
    values = eigh(Z, np.diag(inertias / 2), eigvals_only=True)
    assert weighted.inv_cdn_oe == pytest.approx(np.sqrt(max(values[0], 0) / values[-1]), rel=1e-5, abs=1e-8)
    constant = 2 / inertias[5] * np.sum(distance_to_point(J[:, 5], ellipsoid.vertices(*pose)) ** 2)  # (3.19)
    assert weighted.design_constant == pytest.approx(constant)
    assert weighted.pi_oe == pytest.approx(np.sqrt(max(values[0], 0) / constant), rel=1e-5, abs=1e-8)
    energy = weighted.rates**2 @ inertias / 2
    assert energy == pytest.approx(np.ones(6))
    assert 0 <= weighted.inv_cdn_oe <= weighted.pi_oe <= 1


def test_seven_axes():
    rng = np.random.default_rng(4)
    J, ellipsoid = random_axes(rng, 7), random_ellipsoid(rng)
    result = operation_indices(J, ellipsoid)
    Z = J.T @ ellipsoid.W() @ J
    values = np.linalg.eigvalsh(Z)[1:]
    assert result.inv_cdn_oe == pytest.approx(np.sqrt(values[0] / values[-1]))
    assert np.isnan(result.pi_oe)
    assert result.to_dict()["pi_oe"] is None


def test_many_poses_at_once():
    rng = np.random.default_rng(5)
    J, ellipsoid = np.array([random_axes(rng) for _ in range(4)]), random_ellipsoid(rng)
    rotations, positions = map(np.array, zip(*[random_pose(rng) for _ in range(4)], strict=True))
    inertias = rng.uniform(1, 2, (4, 6))
    many = operation_indices(J, ellipsoid, rotations, positions, inertias=inertias)
    for k in range(4):
        one = operation_indices(J[k], ellipsoid, rotations[k], positions[k], inertias=inertias[k])
        assert many.pi_oe[k] == pytest.approx(one.pi_oe)
        assert many.eigenvalues[k] == pytest.approx(one.eigenvalues)


def test_bad_input_is_refused():
    J, ellipsoid = random_axes(np.random.default_rng(6)), OperationEllipsoid.sphere(0.1)
    with pytest.raises(InputError, match="jacobian"):
        operation_indices(J[:5], ellipsoid)
    with pytest.raises(InputError, match="inertias: all must be > 0"):
        operation_indices(J, ellipsoid, inertias=[1, 1, 1, 1, 1, 0])
    with pytest.raises(InputError, match="inertias: expected shape"):
        operation_indices(J, ellipsoid, inertias=[1, 1])
