"""All IK solutions by continuation: the arm with sixteen real ones, closed forms, the search, proofs."""

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.published.arms import load_arm
from ocptip.robots.dh import DHRow, arm_from_dh
from ocptip.robots.inverse import complete
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.kinematics import gripper_pose
from tests.robots.sample_arms import random_arm

DEGREE = np.pi / 180
# Manseur and Doty, A robot manipulator with 16 real inverse kinematic solution sets, Int. J. Robotics
# Research 8 (5), 1989: a, alpha, d, and the pose of the hand.
SIXTEEN = arm_from_dh(
    "sixteen",
    [
        DHRow(a=a, alpha=alpha, d=d)
        for a, alpha, d in (
            (0.3, np.pi / 2, 0.0),
            (1.0, DEGREE, 0.0),
            (0.0, np.pi / 2, 0.2),
            (1.5, DEGREE, 0.0),
            (0.0, np.pi / 2, 0.0),
            (0.0, DEGREE, 0.0),
        )
    ],
)
HAND = np.array(
    [
        [-0.760117, -0.641689, 0.102262, -1.140175],
        [0.133333, 0.0, 0.991071, 0.0],
        [-0.635959, 0.766965, 0.085558, 0.0],
    ]
)


@pytest.mark.parametrize("seed", range(5))
def test_equations_hold_and_give_the_angles_back(seed):
    """Without continuation: the equations of a pose at the angles that it came from."""
    arm, rng = random_arm(seed, 6), np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, 6)
    pose = gripper_pose(arm, q)
    forms = complete._forms(arm, *pose)
    moving = q[[0, 1, 3, 4]]
    y = np.append(np.column_stack([np.cos(moving), np.sin(moving)]).ravel(), 1.0)
    assert np.abs(np.einsum("i,nij,j->n", y, forms, y)).max() < 1e-13
    np.testing.assert_allclose(complete._joints(arm, y, *pose), q, atol=1e-9)
    other = y.copy()
    other[:2] = np.cos(moving[0] + 0.1), np.sin(moving[0] + 0.1)
    assert np.abs(np.einsum("i,nij,j->n", other, forms, other)).max() > 1e-3


@pytest.mark.slow
def test_sixteen_real_solutions_all_proved():
    left, _, right = np.linalg.svd(HAND[:, :3])
    found = solve_inverse_kinematics(
        SIXTEEN, HAND[:, 3], left @ right, method="complete", within_limits=False
    )
    assert len(found.branches) == found.proved == 16
    assert found.starts == 64
    assert found.residuals.max() < 1e-10
    apart = np.abs(np.exp(1j * found.branches[:, None]) - np.exp(1j * found.branches)).max(axis=2)
    assert apart[~np.eye(16, dtype=bool)].min() > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("name", ["FP1W2F", "FSFS", "W1P1P2W2"])
def test_closed_forms_have_the_same_solutions(name):
    arm = load_arm(name)
    pose = gripper_pose(arm, np.random.default_rng(3).uniform(-2.5, 2.5, 6))
    exact, found = (
        solve_inverse_kinematics(arm, *pose, within_limits=False, method=method)
        for method in ("closed-form", "complete")
    )
    assert found.method == "complete"
    np.testing.assert_allclose(found.branches, exact.branches, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_search_misses_none_on_general_arms(seed):
    arm = random_arm(seed, 6)
    pose = gripper_pose(arm, np.random.default_rng(seed).uniform(-np.pi, np.pi, 6))
    searched, found = (
        solve_inverse_kinematics(arm, *pose, within_limits=False, method=method)
        for method in ("search", "complete")
    )
    assert found.proved == len(found.branches)
    np.testing.assert_allclose(found.branches, searched.branches, atol=1e-6)


def test_other_arms_are_refused():
    with pytest.raises(InputError, match="'complete' is for six independent joints that turn"):
        solve_inverse_kinematics(random_arm(0, 7), np.zeros(3), np.eye(3), method="complete")
