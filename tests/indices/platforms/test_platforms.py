import numpy as np
import pytest
from hypothesis import given

from ocptip.basics.errors import InputError
from ocptip.indices.platforms.platform import PlatformPose, StewartPlatform
from tests.indices.sample_platforms import LEGS, SEEDS, random_motion, random_pose
from tests.quick import examples


def velocities(screw, points):
    return screw[3:] + np.cross(screw[:3], points)


@examples(30)
@given(SEEDS, LEGS)
def test_jacobian_gives_rates_of_leg_lengths(seed, n):
    rng = np.random.default_rng(seed)
    pose, screw, step = random_pose(rng, n), rng.normal(size=6), 1e-6
    ahead = pose.platform + step * velocities(screw, pose.platform)
    back = pose.platform - step * velocities(screw, pose.platform)
    rates = [np.linalg.norm(points - pose.base, axis=1) for points in (ahead, back)]
    np.testing.assert_allclose(pose.jacobian @ screw, (rates[0] - rates[1]) / (2 * step), atol=1e-8)


@examples(30)
@given(SEEDS, LEGS)
def test_passive_map_gives_the_turning_of_legs_against_both_bodies(seed, n):
    rng = np.random.default_rng(seed)
    pose, screw = random_pose(rng, n), rng.normal(size=6)
    unit = pose.legs / pose.lengths[:, None]
    total = 0.0
    for points, q in ((pose.platform, screw), (pose.base, -screw)):
        v = velocities(q, points)
        across = v - np.einsum("ij,ij->i", v, unit)[:, None] * unit
        total += (np.linalg.norm(across, axis=1) ** 2 / pose.lengths**2).sum()
    assert np.linalg.norm(pose.passive_map @ screw) ** 2 == pytest.approx(total, rel=1e-12)
    assert screw @ pose.Z @ screw == pytest.approx(total, rel=1e-10)


@examples(30)
@given(SEEDS, LEGS)
def test_forms_equal_the_blocks_of_the_source(seed, n):
    pose = random_pose(np.random.default_rng(seed), n)
    N, Z = np.zeros((6, 6)), np.zeros((6, 6))
    for b, p in zip(pose.base, pose.platform, strict=True):
        leg, m = p - b, np.cross(b, p)
        square = leg @ leg
        N += np.block([[np.outer(m, m), np.outer(m, leg)], [np.outer(leg, m), np.outer(leg, leg)]]) / square
        B, P = np.cross(b, np.eye(3)).T, np.cross(p, np.eye(3)).T
        S = (P + B) / square - 2 * np.outer(m, leg) / square**2
        R = (P.T @ P + B.T @ B) / square - 2 * np.outer(m, m) / square**2
        T = 2 * (square * np.eye(3) - np.outer(leg, leg)) / square**2
        Z += np.block([[R, S], [S.T, T]])
    np.testing.assert_allclose(pose.N, N, atol=1e-10 * np.abs(N).max())
    np.testing.assert_allclose(pose.Z, Z, atol=1e-10 * np.abs(Z).max())
    assert np.linalg.eigvalsh(pose.Z)[0] > 0


def test_at_moves_the_platform_only():
    rng = np.random.default_rng(3)
    platform = StewartPlatform(rng.normal(size=(6, 3)), rng.normal(size=(6, 3)), "p")
    R, t = random_motion(rng)
    pose = platform.at(t, R)
    np.testing.assert_array_equal(pose.base, platform.base)
    np.testing.assert_allclose((pose.platform - t) @ R, platform.platform, atol=1e-14)
    assert pose.n_legs == platform.n_legs == 6


def test_screws_come_back_from_the_scaled_frame():
    rng = np.random.default_rng(5)
    pose = random_pose(rng)
    shift = np.array([50.0, -20.0, 3.0])
    pose = PlatformPose(pose.base + shift, pose.platform + shift)
    screws = rng.normal(size=(6, 4))
    extent = pose.scale[1]
    here = pose.jacobian @ pose.screw_from_scaled(screws)
    np.testing.assert_allclose(here, extent * (pose.scaled.jacobian @ screws), atol=1e-11)


def test_exchanged_swaps_chosen_legs():
    pose = random_pose(np.random.default_rng(0))
    other = pose.exchanged([1, 4])
    np.testing.assert_array_equal(other.base[1], pose.platform[1])
    np.testing.assert_array_equal(other.platform[4], pose.base[4])
    np.testing.assert_array_equal(other.base[0], pose.base[0])
    np.testing.assert_array_equal(pose.exchanged().base, pose.platform)


def test_parallel_legs_are_singular_and_random_ones_not():
    rng = np.random.default_rng(1)
    base = rng.normal(size=(6, 3))
    assert PlatformPose(base, base + np.array([0.3, 0.2, 1.0])).singular
    assert not random_pose(rng).singular


@pytest.mark.parametrize(
    ("base", "platform", "message"),
    [
        (np.zeros((5, 3)), np.ones((5, 3)), "at least 6 legs, got 5"),
        (np.zeros((6, 3)), np.ones((7, 3)), "one anchor for each of the 6"),
        (np.zeros((6, 2)), np.ones((6, 2)), "base: expected shape n x 3"),
        (np.full((6, 3), np.nan), np.ones((6, 3)), "base: contains NaN"),
    ],
)
def test_bad_anchors_are_refused(base, platform, message):
    with pytest.raises(InputError, match=message):
        StewartPlatform(base, platform)
    with pytest.raises(InputError, match=message):
        PlatformPose(base, platform)


def test_leg_without_length_is_refused():
    base = np.random.default_rng(2).normal(size=(6, 3))
    platform = base + np.array([0.0, 0.0, 1.0])
    platform[3] = base[3]
    with pytest.raises(InputError, match="leg 4: base and platform anchor coincide"):
        StewartPlatform(base, platform).at()


@pytest.mark.parametrize("rotation", [-np.eye(3), np.eye(3) + 0.01, np.zeros((3, 3))])
def test_no_rotation_matrix_is_refused(rotation):
    pose = random_pose(np.random.default_rng(2))
    with pytest.raises(InputError, match="rotation: not a rotation matrix"):
        StewartPlatform(pose.base, pose.platform).at([0, 0, 1], rotation)
