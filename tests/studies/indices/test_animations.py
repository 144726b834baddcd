"""What the moving pictures show: the indices at joint 5, singular positions of both platforms."""

import numpy as np
import pytest

from studies.indices import animations
from studies.indices.designs.optimal_planar import optimal_planar_pose

POINTS = np.random.default_rng(0).normal(size=(2, 7))


def test_manipulability_falls_with_the_sine_of_joint_5():
    """[Naw07] 4.6: det J is the sine of joint 5 times a function of joints 2 and 3."""
    many = {angle: animations.indices(*POINTS, angle) for angle in (np.pi / 3, 0.1, 1e-3)}
    shares = many[0.1]["MPB"] / many[np.pi / 3]["MPB"]
    np.testing.assert_allclose(shares, np.sin(0.1) / np.sin(np.pi / 3), rtol=1e-9)
    for name in ("DM_inf", "DM_2"):  # near the singular pose at 0 they are not more than the way there
        assert np.all(many[1e-3][name] <= np.degrees(1e-3) * 1.001)


def test_planar_determinant_is_that_of_the_moved_robot():
    pose = optimal_planar_pose(1.75, "+")
    assert animations.planar_determinant(pose.base, pose.platform, *np.zeros((2, 1)), 0.0) == pytest.approx(
        np.linalg.det(pose.jacobian) * np.prod(pose.lengths)
    )


def test_some_turns_of_a_planar_robot_are_singular_everywhere():
    """[Naw07] 7.2.1: there are orientations in which it is singular whatever its translation."""
    pose = optimal_planar_pose(1.75, "-")
    base, platform = (np.arctan2(*points[0, ::-1]) for points in (pose.base, pose.platform))
    everywhere = base - platform
    values = [
        animations.planar_determinant(pose.base, pose.platform, *POINTS, everywhere + turn)
        for turn in (0.0, np.pi, 0.3)
    ]
    np.testing.assert_allclose(values[:2], 0.0, atol=1e-12)
    assert np.abs(values[2]).max() > 0.1


@pytest.mark.parametrize("axis", [0.0, 0.7])
def test_platform_turned_by_a_right_angle_is_singular_wherever_it_is(axis):
    """[Naw07] 7.3: for a = pi / 2 and angles of pi / 2, whatever b and the translation."""
    assert np.abs(animations.platform_determinant(*POINTS, 0.0, axis)).max() > 100
    for angle in (np.pi / 2, -np.pi / 2):
        np.testing.assert_allclose(animations.platform_determinant(*POINTS, angle, axis), 0.0, atol=1e-9)


@pytest.mark.slow
def test_pictures_are_written(tmp_path):
    assert animations.main(["--out", str(tmp_path), "--grid", "9", "--frames", "2"]) == 0
    assert len(list(tmp_path.glob("published_*.gif"))) == 3
