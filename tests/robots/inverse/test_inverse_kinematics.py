"""Inverse kinematics: closed form and search against each other, the printed motions, and refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.published.arms import arm_names, experiment_poses, load_arm, start_and_goal
from ocptip.robots.inverse.closed_form import closed_form_branches, closed_form_family
from ocptip.robots.inverse.inverse_kinematics import pose_residuals, solve_inverse_kinematics
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.urdf.arm import arm_from_urdf
from tests import places
from tests.published.printed_ramps import COLUMNS, implied_angles, printed_times, times
from tests.quick import examples, some
from tests.robots.sample_arms import random_arm

UR5 = arm_from_urdf(places.UR5, base_link="base_link", tool_frame="tool0")
CLOSED = {name: load_arm(name) for name in arm_names()} | {"ur5": UR5}
ANGLES = st.lists(st.floats(-3.1, 3.1), min_size=6, max_size=6)


def test_families():
    found = {name: closed_form_family(model) for name, model in CLOSED.items()}
    assert found == {
        "FP1W2F": "spherical wrist",
        "FSFS": "spherical shoulder",
        "W1P1P2W2": "three parallel axes",
        "ur5": "three parallel axes",
    }
    assert closed_form_family(random_arm(0, 6)) is None
    assert closed_form_family(random_arm(0, 7)) is None


@pytest.mark.parametrize("name", some(2, CLOSED))
def test_closed_form_contains_the_angles_it_came_from_and_every_branch_fits(name):
    model = CLOSED[name].mounted([0.1, -0.2, 0.3])
    states = np.random.default_rng(0).uniform(-np.pi, np.pi, (150, 6))
    for q in states:
        pose = gripper_pose(model, q)
        branches = closed_form_branches(model, *pose)
        assert len(branches) in (2, 4, 6, 8)
        assert pose_residuals(model, branches, *pose).max() < 1e-10
        assert np.abs(branches - q).max(axis=1).min() < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("name", some(1, CLOSED))
def test_search_finds_no_branch_that_closed_form_misses_nor_the_other_way_round(name):
    model = CLOSED[name]
    for q in np.random.default_rng(1).uniform(-np.pi, np.pi, (12, 6)):
        pose = gripper_pose(model, q)
        exact = solve_inverse_kinematics(model, *pose, within_limits=False)
        found = solve_inverse_kinematics(model, *pose, within_limits=False, method="search")
        assert (exact.method, found.method) == ("closed-form", "search")
        np.testing.assert_allclose(found.branches, exact.branches, atol=1e-6)


@pytest.mark.parametrize("name", CLOSED)
@examples(60)
@given(angles=ANGLES)
def test_any_pose_is_reproduced_singular_ones_included(name, angles):
    model = CLOSED[name]
    pose = gripper_pose(model, np.array(angles))
    result = solve_inverse_kinematics(model, *pose, within_limits=False)
    assert result.residuals.max() < 1e-7
    assert (result.residuals[result.conditioning > 1e-6] < 1e-10).all()
    gaps = np.abs(result.branches[:, None] - result.branches[None]).max(axis=2)
    assert (gaps[~np.eye(len(gaps), dtype=bool)] > 1e-6).all()


@pytest.mark.parametrize("name", some(2, CLOSED))
@pytest.mark.parametrize("distance", some(3, [0.0, 1e-7, 1e-5, 1e-9, 1e-8, 1e-3]))
def test_poses_next_to_singular_ones_are_not_called_unreachable(name, distance):
    model = CLOSED[name]
    rng = np.random.default_rng(8)
    for _ in range(15):
        q = np.round(rng.uniform(-2, 2, 6)) * np.pi / 2 + distance * rng.normal(size=6)
        result = solve_inverse_kinematics(model, *gripper_pose(model, q), within_limits=False)
        assert result.residuals.max() < 1e-7


@pytest.mark.parametrize("name", CLOSED)
def test_singular_pose_at_zero_angles(name):
    model = CLOSED[name]
    result = solve_inverse_kinematics(model, *gripper_pose(model, np.zeros(6)), within_limits=False)
    assert result.residuals.max() < 1e-10


@pytest.mark.parametrize("name", arm_names())
def test_start_and_goal_are_those_of_the_printed_motions(name):
    start, goal = (np.rad2deg(q) for q in start_and_goal(name))
    for joint in range(3):
        implied = implied_angles(name, joint + 1, (start[joint], goal[joint]))
        np.testing.assert_allclose([start[joint], goal[joint]], implied, atol=1e-3)
        for column in COLUMNS[name]:
            late = times(column, joint + 1, start[joint], goal[joint]) - printed_times(column, joint + 1)
            assert np.abs(late).max() < 7e-5


def test_printed_lengths_miss_the_printed_motions_by_more():
    refined, printed = (start_and_goal("FP1W2F", geometry=g)[0] for g in ("refined", "printed"))
    assert 0.005 < np.abs(np.rad2deg(refined - printed))[:3].max() < 0.05


@pytest.mark.parametrize("name", arm_names())
def test_start_and_goal_reach_their_poses_within_limits(name):
    model = load_arm(name)
    for q, pose in zip(start_and_goal(name), experiment_poses(), strict=True):
        assert pose_residuals(model, q, pose.position, pose.rotation)[0] < 1e-10
        assert (q >= model.limits.angle_min).all()
        assert (q <= model.limits.angle_max).all()


def test_passive_joint_4_of_fsfs_cruises_as_printed():
    start, goal = (np.rad2deg(q) for q in start_and_goal("FSFS"))
    assert abs(goal[3] - start[3]) == pytest.approx(135 * 1.8749, abs=0.02)  # speed limit times t_4''


@pytest.mark.slow
def test_search_without_closed_form_and_with_other_numbers_of_joints():
    for joints in (3, 4, 6):
        model = random_arm(joints, joints)
        q = np.random.default_rng(2).uniform(-2, 2, joints)
        result = solve_inverse_kinematics(model, *gripper_pose(model, q), within_limits=False)
        assert result.method == "search"
        assert result.family is None
        assert np.abs(result.branches - q).max(axis=1).min() < 1e-7
        assert result.residuals.max() < 1e-10


def test_seven_joints_give_points_of_the_continuum():
    model = random_arm(5, 7)
    pose = gripper_pose(model, np.linspace(-1, 1, 7))
    result = solve_inverse_kinematics(model, *pose, within_limits=False)
    assert len(result.branches) == 64
    assert result.residuals.max() < 1e-10


@pytest.mark.slow
def test_search_is_repeatable():
    model = load_arm("FSFS")
    pose = gripper_pose(model, np.linspace(-1, 1, 6))
    first, second = (solve_inverse_kinematics(model, *pose, method="search", seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.branches, second.branches)
    assert first.to_dict() == second.to_dict()


def test_turns_follow_the_wish():
    model = load_arm("FP1W2F")
    pose = gripper_pose(model, np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0]))
    near = np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0 + 4 * np.pi])
    np.testing.assert_allclose(
        solve_inverse_kinematics(model, *pose, near=near).nearest(near), near, atol=1e-9
    )
    far = solve_inverse_kinematics(model, *pose, near=near + 100 * np.eye(6)[5]).branches[:, 5]
    assert (far <= model.limits.angle_max[5]).all()
    assert (far > model.limits.angle_max[5] - 2 * np.pi).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"position": [0, 0, 5.0]}, r"cannot reach position \(0\.0, 0\.0, 5000\.0\) mm.*misses by 4\d\d\d"),
        ({"position": [0, 0, np.nan]}, "position: contains NaN"),
        ({"rotation": 2 * np.eye(3)}, "rotation: not a rotation matrix"),
        ({"method": "guess"}, "method: must be one of auto, closed-form, search, complete, got 'guess'"),
        ({"near": [0.0]}, "near: expected shape 6"),
    ],
)
def test_bad_poses_are_refused(arguments, message):
    defaults = {"position": [0.3, 0.0, 0.3], "rotation": np.eye(3)}
    with pytest.raises(InputError, match=message):
        solve_inverse_kinematics(load_arm("FP1W2F"), **(defaults | arguments))


def test_no_closed_form_is_said():
    with pytest.raises(InputError, match="arm 'random' has no closed form; use 'search'"):
        solve_inverse_kinematics(random_arm(0, 6), np.zeros(3), np.eye(3), method="closed-form")


def test_limits_in_the_way_are_named():
    model = load_arm("W1P1P2W2")
    pose = experiment_poses()[0]
    tight = model.with_limits(angle_max=np.deg2rad([160, 160, 160, 160, 100, 50]))
    with pytest.raises(InputError, match=r"only beyond joint limits .* 'joint 6' at 107\.\d+ degrees"):
        solve_inverse_kinematics(
            tight.with_limits(angle_min=np.deg2rad([-160, -160, -160, -160, -100, 0])),
            pose.position,
            pose.rotation,
        )
