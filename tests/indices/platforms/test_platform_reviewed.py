import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh

from ocptip.basics.errors import InputError
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import platform_conditioning
from ocptip.indices.platforms.platform import PlatformPose
from ocptip.indices.platforms.reviewed import (
    best_complex,
    inverse_condition_number,
    inverse_condition_number_cl,
    inverse_condition_number_points,
    manipulability,
    rigidity_rate,
)
from tests.indices.sample_axes import point_metric
from tests.indices.sample_platforms import LEGS, SEEDS, flat_pose, moved, random_motion, random_pose
from tests.quick import examples


@examples(30)
@given(SEEDS, LEGS, st.floats(0.01, 100))
def test_manipulability_is_the_determinant_and_scales_with_volume(seed, n, factor):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng, n)
    expected = abs(np.linalg.det(pose.jacobian)) if n == 6 else math.sqrt(np.linalg.det(pose.N))
    assert manipulability(pose) == pytest.approx(expected, rel=1e-7)
    other = moved(pose, *random_motion(rng), factor)
    assert manipulability(other) == pytest.approx(factor**3 * manipulability(pose), rel=1e-8)


@examples(30)
@given(SEEDS, LEGS)
def test_plain_condition_number_is_that_of_the_form(seed, n):
    pose = random_pose(np.random.default_rng(seed), n)
    values = np.linalg.eigvalsh(pose.N)
    assert inverse_condition_number(pose) == pytest.approx(math.sqrt(values[0] / values[-1]), rel=1e-6)


def test_plain_condition_number_changes_with_origin_and_unit():
    rng = np.random.default_rng(4)
    pose = random_pose(rng)
    value = inverse_condition_number(pose)
    turned = moved(pose, random_motion(rng)[0], np.zeros(3))
    assert inverse_condition_number(turned) == pytest.approx(value, rel=1e-9)
    assert abs(inverse_condition_number(moved(pose, np.eye(3), np.ones(3))) - value) > 1e-3 * value
    assert abs(inverse_condition_number(moved(pose, np.eye(3), np.zeros(3), 10.0)) - value) > 1e-3 * value


@examples(30)
@given(SEEDS, LEGS, st.floats(0.05, 2.0))
def test_characteristic_length_is_a_sphere(seed, n, radius):
    """[Naw07] 3.4.1: CDN_CL with CL = R sqrt(2/3) equals CDN_OE of a sphere of radius R about the point."""
    rng = np.random.default_rng(seed)
    pose, point = random_pose(rng, n), rng.normal(size=3)
    sphere = OperationEllipsoid.sphere(radius, point)
    expected = platform_conditioning(pose, sphere.W()).value
    value = inverse_condition_number_cl(pose, point, radius * math.sqrt(2 / 3))
    assert value == pytest.approx(expected, rel=1e-8)
    R, t = random_motion(rng)
    other = inverse_condition_number_cl(moved(pose, R, t, 3.0), 3.0 * R @ point + t, radius * math.sqrt(6))
    assert other == pytest.approx(value, rel=1e-8)


@examples(30)
@given(SEEDS, LEGS)
def test_three_points_are_a_metric_of_three_points(seed, n):
    rng = np.random.default_rng(seed)
    pose, points = random_pose(rng, n), rng.normal(size=(3, 3))
    values = eigh(pose.N, point_metric(points), eigvals_only=True)
    expected = math.sqrt(values[0] / values[-1])
    assert inverse_condition_number_points(pose, points) == pytest.approx(expected, rel=1e-5)


@examples(40)
@given(SEEDS, LEGS)
def test_best_complex_is_the_minimum(seed, n):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng, n)
    best = best_complex(pose)
    A, F, G = pose.N[:3, :3], pose.N[:3, 3:], pose.N[3:, 3:]
    smallest = np.linalg.eigvalsh(A - F @ np.linalg.solve(G, F.T))[0]
    assert best.sigma_r**2 == pytest.approx(smallest, rel=1e-6)
    assert best.sigma_s**2 == pytest.approx(np.linalg.eigvalsh(G)[0], rel=1e-8)
    assert np.linalg.norm(best.complex_r[:3]) == pytest.approx(1.0, rel=1e-12)
    assert np.linalg.norm(pose.jacobian @ best.complex_r) == pytest.approx(best.sigma_r, rel=1e-8)
    translation = np.concatenate([np.zeros(3), best.direction_s])
    assert np.linalg.norm(pose.jacobian @ translation) == pytest.approx(best.sigma_s, rel=1e-8)
    for _ in range(10):
        other = best.complex_r + 0.1 * rng.normal(size=6)
        other /= np.linalg.norm(other[:3])
        assert np.linalg.norm(pose.jacobian @ other) >= best.sigma_r * (1 - 1e-12)


@examples(30)
@given(SEEDS, LEGS, st.floats(0.01, 100))
def test_sigmas_do_not_depend_on_the_frame_but_sigma_r_on_the_unit(seed, n, factor):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng, n)
    a, b = best_complex(pose), best_complex(moved(pose, *random_motion(rng), factor))
    assert b.sigma_r == pytest.approx(factor * a.sigma_r, rel=1e-8)
    assert b.sigma_s == pytest.approx(a.sigma_s, rel=1e-8)


def test_best_complex_of_parallel_legs_uses_the_pseudo_inverse():
    rng = np.random.default_rng(7)
    base = rng.normal(size=(6, 3))
    pose = PlatformPose(base, base + np.array([0.1, 0.2, 1.0]))
    best = best_complex(pose)
    assert best.sigma_s == 0.0
    assert best.sigma_r == 0.0
    assert np.linalg.norm(pose.jacobian @ best.complex_r) < 1e-12


@examples(30)
@given(SEEDS, st.floats(0.01, 100))
def test_rigidity_rate_and_its_invariance(seed, factor):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng)
    rate = rigidity_rate(pose)
    q, linear, s = rate.motion[:3], rate.motion[3:6], rate.motion[6]
    v = linear + np.cross(q, pose.platform) + s * pose.platform
    np.testing.assert_allclose(np.einsum("ij,ij->i", pose.legs, v), 0.0, atol=1e-9)
    assert 0.0 <= rate.angle <= math.pi / 2
    assert rate.angle == pytest.approx(math.atan2(abs(s), np.linalg.norm(q)))
    other = rigidity_rate(moved(pose, *random_motion(rng), factor))
    assert other.angle == pytest.approx(rate.angle, abs=1e-8)
    # base anchors may slide along their lines; the exchange of both bodies matters
    slid = PlatformPose(pose.base - rng.uniform(0.1, 1, (6, 1)) * pose.legs, pose.platform)
    assert rigidity_rate(slid).angle == pytest.approx(rate.angle, abs=1e-8)
    assert abs(rigidity_rate(pose.exchanged()).angle - rate.angle) > 1e-9


@examples(20)
@given(SEEDS, LEGS)
def test_all_are_zero_in_a_singular_pose(seed, n):
    rng = np.random.default_rng(seed)
    pose = flat_pose(rng, n)
    best = best_complex(pose)
    assert manipulability(pose) == 0.0
    assert inverse_condition_number(pose) == 0.0
    assert inverse_condition_number_cl(pose, [0, 0, 0], 0.5) == 0.0
    assert inverse_condition_number_points(pose, rng.normal(size=(3, 3))) == 0.0
    assert best.sigma_r <= 1e-12 or best.sigma_s <= 1e-12
    if n == 6:
        assert rigidity_rate(pose).angle == 0.0


def test_bad_arguments_are_refused():
    pose = random_pose(np.random.default_rng(0), 7)
    with pytest.raises(InputError, match="defined for six legs, got 7"):
        rigidity_rate(pose)
    with pytest.raises(InputError, match="length: must be > 0"):
        inverse_condition_number_cl(pose, [0, 0, 0], 0.0)
    with pytest.raises(InputError, match="operation_point: expected shape 3"):
        inverse_condition_number_cl(pose, [0, 0], 1.0)
    with pytest.raises(InputError, match="not on one line, got 2"):
        inverse_condition_number_points(pose, np.eye(3)[:2])
    with pytest.raises(InputError, match="not on one line"):
        inverse_condition_number_points(pose, np.outer([0, 1, 2], [1, 2, 3]))
