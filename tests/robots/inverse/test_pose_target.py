"""Poses of grippers that may be turned: postures reach them, equations vanish there and nowhere near."""

import casadi as cs
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.published.arms import load_arm
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.inverse.pose_target import SAMPLED, SAMPLED_TURNS, PoseTarget
from ocptip.robots.kinematics import gripper_pose
from tests.quick import some
from tests.robots.sample_arms import random_arm

SIX = load_arm("FP1W2F")
ANGLES = np.array([0.4, 0.7, -1.0, 0.3, 0.9, 0.2])


def target_at(arm, q, **symmetry):
    return PoseTarget(*gripper_pose(arm, q), **symmetry)


def misses(arm, target, q):
    """Of postures (k, n), m and rad, by another way than the target's: its axis, or all of its axes."""
    position, rotation = gripper_pose(arm, q)
    turns = [0.0] if target.fold == 0 else 2 * np.pi * np.arange(target.fold) / target.fold
    wanted = [target.rotation @ Rotation.from_rotvec(t * np.eye(3)[2]).as_matrix() for t in turns]
    columns = [2] if target.turns_freely else [0, 1, 2]
    off = [np.abs(rotation - w)[:, :, columns].max(axis=(1, 2)) for w in wanted]
    return np.maximum(np.min(off, axis=0), np.abs(position - target.position).max(axis=1))


@pytest.mark.parametrize("symmetry", [{}, {"symmetric_about": "z"}, {"symmetric_about": "z", "fold": 2}])
def test_postures_reach_the_pose(symmetry):
    target = target_at(SIX, ANGLES, **symmetry)
    found = target.postures(SIX)
    assert misses(SIX, target, found).max() < 1e-8
    assert target.residuals(SIX, found).max() < 1e-8
    assert np.abs(found - ANGLES).max(axis=1).min() < 1e-7
    branches = len(solve_inverse_kinematics(SIX, target.position, target.rotation).branches)
    assert len(found) == branches if not symmetry else len(found) > branches
    assert len(found) <= 8 * SAMPLED_TURNS
    assert target.residuals(SIX, found + 0.01).min() > 1e-4


@pytest.mark.parametrize("symmetry", [{}, {"symmetric_about": "x"}, {"symmetric_about": "y", "fold": 4}])
def test_seven_axes_have_postures_of_a_continuum(symmetry):
    arm = random_arm(5, 7)
    target = target_at(arm, np.linspace(-1, 1, 7), **symmetry)
    found = target.postures(arm)
    assert 10 < len(found) <= SAMPLED * max(target.fold, 1)
    assert target.residuals(arm, found).max() < 1e-8


@pytest.mark.parametrize("axis", ["", "x", "y", "z"])
def test_equations_vanish_at_postures_and_have_full_rank(axis):
    target = target_at(SIX, ANGLES, symmetric_about=axis)
    q = cs.SX.sym("q", 6)
    rows = target.equations(SIX, q)
    values = cs.Function("rows", [q], [rows, cs.jacobian(rows, q)])
    for posture in target.postures(SIX)[:20]:
        at, slope = (np.array(part) for part in values(posture))
        assert np.abs(at).max() < 1e-8
        assert np.linalg.matrix_rank(slope, tol=1e-3) == target.conditions
    assert np.abs(np.array(values(ANGLES + 0.01)[0])).max() > 1e-4


def test_the_nearest_turn_of_a_fold_is_that_of_the_posture():
    target = target_at(SIX, ANGLES, symmetric_about="z", fold=2)
    for posture in target.postures(SIX):
        own = target.nearest(SIX, posture)
        assert own.fold == 0
        assert own.residuals(SIX, posture[None])[0] < 1e-8
    plain = target_at(SIX, ANGLES)
    assert plain.nearest(SIX, ANGLES) is plain


@pytest.mark.parametrize(
    ("symmetry", "message"),
    [
        ({"symmetric_about": "w"}, "symmetric_about: must be x, y or z, got 'w'"),
        ({"fold": 2}, "fold: needs symmetric_about"),
        ({"symmetric_about": "z", "fold": 1}, "fold: must be a whole number of 2 to 12, got 1"),
        ({"symmetric_about": "z", "fold": 2.5}, "fold: must be a whole number"),
    ],
)
def test_what_is_no_symmetry_is_refused(symmetry, message):
    with pytest.raises(InputError, match=message):
        PoseTarget([0, 0, 1], np.eye(3), **symmetry)


@pytest.mark.parametrize("symmetry", some(2, [{}, {"symmetric_about": "z"}]))
@pytest.mark.parametrize("joints", some(1, [6, 7]))
def test_poses_out_of_reach_are_refused(symmetry, joints):
    arm = SIX if joints == 6 else random_arm(5, 7)
    with pytest.raises(InputError, match="pose: "):
        PoseTarget([50.0, 0, 0], np.eye(3), **symmetry).postures(arm)
