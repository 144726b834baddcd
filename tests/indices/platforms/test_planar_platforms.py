import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh

from ocptip.basics.errors import InputError
from ocptip.indices.platforms.controllability import control_number
from ocptip.indices.platforms.platform import PlanarPlatformPose, PlatformPose
from studies.indices.designs.optimal_planar import LARGEST_R, optimal_planar_angle, optimal_planar_pose
from tests.indices.sample_platforms import SEEDS
from tests.quick import examples

LEGS = st.sampled_from([3, 4, 6, 7])
REACH = st.floats(0.02, LARGEST_R).flatmap(lambda r: st.sampled_from([r, -r]))
BRANCHES = st.sampled_from(["-", "+"])


def random_planar(rng, n):
    return PlanarPlatformPose(rng.normal(size=(n, 2)), rng.normal(size=(n, 2)) + np.array([0.0, 2.0]))


@examples(30)
@given(SEEDS, st.sampled_from([6, 7, 9]))
def test_forms_are_rows_3_to_5_of_the_spatial_ones(seed, n):
    pose = random_planar(np.random.default_rng(seed), n)
    spatial = PlatformPose(np.pad(pose.base, ((0, 0), (0, 1))), np.pad(pose.platform, ((0, 0), (0, 1))))
    part = np.ix_([2, 3, 4], [2, 3, 4])
    np.testing.assert_allclose(pose.jacobian.T @ pose.jacobian, spatial.N[part], atol=1e-10)
    Z = pose.passive_map.T @ pose.passive_map
    np.testing.assert_allclose(Z, spatial.Z[part], rtol=1e-8, atol=1e-10)


@examples(40)
@given(SEEDS, LEGS, st.floats(0.01, 100))
def test_control_number_and_its_invariance(seed, n, factor):
    rng = np.random.default_rng(seed)
    pose = random_planar(rng, n)
    control = control_number(pose)
    J, A = pose.jacobian, pose.passive_map
    inverse = eigh(J.T @ J, A.T @ A, eigvals_only=True)
    assert control.value == pytest.approx(math.sqrt(inverse[0] / inverse[-1]), rel=1e-5)
    assert control.lambdas.shape == (3,)
    screw = control.least_controllable
    assert np.linalg.norm(A @ screw) == pytest.approx(1.0, rel=1e-9)
    assert np.linalg.norm(J @ screw) ** 2 * control.lambdas[-1] == pytest.approx(1.0, rel=1e-5)
    angle, t = rng.uniform(-3, 3), rng.normal(size=2)
    R = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    other = PlanarPlatformPose(factor * pose.base @ R.T + t, factor * pose.platform @ R.T + t)
    assert control_number(other).value == pytest.approx(control.value, rel=1e-7)


@examples(20)
@given(SEEDS, LEGS)
def test_legs_through_one_point_are_singular(seed, n):
    rng = np.random.default_rng(seed)
    base, point = rng.normal(size=(n, 2)), rng.normal(size=2)
    pose = PlanarPlatformPose(base, base + rng.uniform(0.2, 0.8, (n, 1)) * (point - base))
    control = control_number(pose)
    assert control.value <= 1e-12
    turn, *v = control.least_controllable
    assert np.allclose([v[0] - turn * point[1], v[1] + turn * point[0]], 0, atol=1e-9)
    parallel = control_number(PlanarPlatformPose(base, base + np.array([0.4, 0.1])))
    assert parallel.value == 0.0


@examples(60)
@given(REACH, BRANCHES, st.integers(3, 7), st.data())
def test_optimal_poses(r, branch, n, data):
    exchanged = data.draw(st.sets(st.integers(0, n - 1)))
    control = control_number(optimal_planar_pose(r, branch, n, sorted(exchanged)))
    assert control.value == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(control.lambdas, 2 / r**2, rtol=1e-9)


@pytest.mark.parametrize("r", [0.3, 1.0, 1.6, LARGEST_R])
@pytest.mark.parametrize("branch", ["-", "+"])
@pytest.mark.parametrize("n", [3, 4, 5])
@pytest.mark.parametrize("exchanged", [(), (0,)])
def test_published_optimal_poses(r, branch, n, exchanged):
    control = control_number(optimal_planar_pose(r, branch, n, exchanged))
    assert control.value == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(control.lambdas, 2 / r**2, rtol=1e-12)


@examples(30)
@given(REACH, BRANCHES)
def test_angle_solves_the_condition_and_the_curve(r, branch):
    angle, a = optimal_planar_angle(r, branch), abs(r)
    c = math.cos(angle)
    assert 16 * c * c + 3 * r * r + 4 * math.sqrt(3) * a * c - 8 == pytest.approx(0, abs=1e-10)
    x, y = optimal_planar_pose(r, branch).base[0]
    R = 2 / math.sqrt(3)
    rho2 = (x - R) ** 2 + y * y
    value = 16 * (x - R) ** 2 + 3 * rho2**2 + 4 * math.sqrt(3) * rho2 * (x - R) - 8 * rho2
    assert value == pytest.approx(0, abs=1e-9)
    assert 2 / 3 - 1e-9 <= math.hypot(x, y) <= 2 + 1e-9


def test_pose_next_to_an_optimal_one_is_worse():
    pose = optimal_planar_pose(1.2, "+")
    shifted = PlanarPlatformPose(pose.base, pose.platform + np.array([0.05, 0.0]))
    assert control_number(shifted).value < 0.98


def test_named_points_and_their_relations():
    R = 2 / math.sqrt(3)

    def point(branch, r):
        return optimal_planar_pose(r, branch).base[0]

    def tangent(branch, r, step=1e-6):
        d = point(branch, r + step) - point(branch, r - step)
        return d / np.linalg.norm(d)

    S, Y = np.zeros(2), np.array([R, 0.0])
    rA, rC = 2 / 3 * math.sqrt(6), 2 / 3 * math.sqrt(2)
    A, B, C, D = point("-", rA), point("+", rA), point("+", rC), point("+", LARGEST_R)
    np.testing.assert_allclose(A, [1.154701, 1.632993], atol=1e-6)
    np.testing.assert_allclose(B, [0, 1.154701], atol=1e-6)
    np.testing.assert_allclose(C, [0.384900, 0.544331], atol=1e-6)
    np.testing.assert_allclose(D, [0.384900, 1.721326], atol=1e-6)
    np.testing.assert_allclose(point("-", LARGEST_R), D, atol=1e-6)

    def parallel(u, v):
        return abs(u[0] * v[1] - u[1] * v[0]) / np.linalg.norm(u) / np.linalg.norm(v)

    assert np.linalg.norm(Y - S) == pytest.approx(np.linalg.norm(B - S))
    assert np.linalg.norm(A - Y) == pytest.approx(np.linalg.norm(B - Y))
    assert abs((Y - S) @ (B - S)) < 1e-12
    cos = (A - Y) @ (B - Y) / np.linalg.norm(A - Y) / np.linalg.norm(B - Y)
    assert math.acos(cos) == pytest.approx(math.pi / 4)
    start = np.array([math.cos(optimal_planar_angle(1e-9, b)) for b in "-+"])
    assert start == pytest.approx([math.sqrt(0.5), -math.sqrt(0.5)], abs=1e-8)  # orthogonal branches at Y
    assert parallel(B - Y, [-1, 1]) == pytest.approx(0, abs=1e-12)
    assert parallel(B - S, tangent("+", rA)) == pytest.approx(0, abs=1e-6)
    assert (A - S) @ tangent("-", rA) == pytest.approx(0, abs=1e-6)
    assert (C - S) @ tangent("+", rC) == pytest.approx(0, abs=1e-6)
    assert parallel(C - Y, tangent("+", rC)) == pytest.approx(0, abs=1e-6)
    assert parallel(C - S, A - S) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: optimal_planar_pose(0.0), "r: expected 0 <"),
        (lambda: optimal_planar_pose(1.9), "r: expected 0 <"),
        (lambda: optimal_planar_pose(1.0, "x"), "branch: expected '-' or '\\+', got 'x'"),
        (lambda: optimal_planar_pose(1.0, "+", 2), "n: must be a whole number >= 3"),
        (lambda: optimal_planar_pose(1.0, "+", 3, [3]), "exchanged: legs are counted 0 to 2, got 3"),
        (lambda: optimal_planar_pose(1.0, "+", 3, 2), "exchanged: expected indices"),
        (lambda: PlanarPlatformPose(np.eye(2), np.eye(2)), "at least 3 legs, got 2"),
        (lambda: PlanarPlatformPose(np.ones((3, 2)), np.ones((3, 2))), "leg 1: base and platform"),
    ],
)
def test_bad_arguments_are_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
