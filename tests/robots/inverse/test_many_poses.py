"""Inverse kinematics of many poses at once against the closed forms pose by pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.published.arms import load_arm
from ocptip.robots.inverse.closed_form import branches_within_limits
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.inverse.joint_angles import within_limits
from ocptip.robots.inverse.pose_search import search
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.urdf.arm import arm_from_urdf
from tests.places import UR5
from tests.quick import some


def random_angles(arm, count, seed=0):
    low, high = np.maximum(arm.limits.angle_min, -np.pi), np.minimum(arm.limits.angle_max, np.pi)
    return low + np.random.default_rng(seed).random((count, arm.n)) * (high - low)


@pytest.fixture(scope="module", params=some(2, ["FP1W2F", "ur5", "FSFS", "W1P1P2W2"]))
def arm(request):
    if request.param == "ur5":
        return arm_from_urdf(UR5, base_link="base_link", tool_frame="tool0")
    return load_arm(request.param)


def test_branches_are_those_of_the_closed_form(arm):
    positions, rotations = gripper_pose(arm, random_angles(arm, 40))
    found = branches_within_limits(arm, positions, rotations)
    for own, position, rotation in zip(found, positions, rotations, strict=True):
        expected = solve_inverse_kinematics(arm, position, rotation).branches
        own = own[np.isfinite(own).all(axis=1)]
        assert len(own) == len(expected)
        apart = np.abs(own[:, None] - expected[None]).max(axis=2)
        assert apart.min(axis=1).max() < 1e-6
        assert apart.min(axis=0).max() < 1e-6


def test_singular_poses_are_reached_by_at_least_one_branch(arm):
    q = np.random.default_rng(3).integers(-1, 2, (60, 6)) * np.pi / 2
    positions, rotations = gripper_pose(arm, q)
    found = branches_within_limits(arm, positions, rotations)
    for own, position, rotation in zip(found, positions, rotations, strict=True):
        one_by_one = solve_inverse_kinematics(arm, position, rotation, within_limits=False)
        inside = np.isfinite(within_limits(arm, one_by_one.branches)).all(axis=1)
        assert np.isfinite(own).all(axis=1).any() == inside.any()


def test_unreachable_poses_have_no_branches(arm):
    assert np.isnan(branches_within_limits(arm, np.array([[9.0, 0.0, 0.0]]), np.eye(3)[None])).all()


def test_search_finds_poses_near_its_start_and_honours_free_directions(arm):
    q = random_angles(arm, 60, seed=1)
    positions, rotations = gripper_pose(arm, q)
    near = np.clip(q + 0.05, arm.limits.angle_min, arm.limits.angle_max)
    found, error = search(arm, near, positions, rotations)
    assert np.mean(error < 1e-9) > 0.95
    good = error < 1e-9
    assert np.abs(gripper_pose(arm, found)[0] - positions)[good].max() < 1e-9
    roll = Rotation.from_rotvec([0.0, 0.0, 1.0]).as_matrix()  # about the tool axis: free
    found, error = search(arm, near, positions, rotations @ roll, "axis")
    assert np.mean(error < 1e-9) > 0.9
    turned = gripper_pose(arm, found)[1][error < 1e-9]
    assert np.abs(turned[:, :, 2] - rotations[error < 1e-9][:, :, 2]).max() < 1e-8


def test_search_turns_an_opposite_tool_axis_round():
    arm = load_arm("FP1W2F")
    q = random_angles(arm, 20, seed=2)
    positions, rotations = gripper_pose(arm, q)
    opposite = rotations @ np.diag([1.0, -1.0, -1.0])
    before = search(arm, q, positions, rotations, "axis")[1]
    after = search(arm, q, positions, opposite, "axis")[1]
    assert before.max() < 1e-12
    assert np.median(after) < 1.0  # moved towards it instead of staying where the error has no gradient


def test_within_limits_takes_the_copy_nearest_to_zero():
    arm = load_arm("FP1W2F")
    angles = np.array([0.1, 0.2, -0.3, 0.0, 0.0, 9.0])
    assert within_limits(arm, angles)[5] == pytest.approx(9.0 - 2 * np.pi)
    assert np.isnan(within_limits(arm, np.full(6, 3.0))[0])
    assert within_limits(arm, angles, near=14.0)[5] == pytest.approx(9.0 + 2 * np.pi)
