"""Arms with fewer than six effective axes: nearest postures, their misses, poses that ask for less."""

from itertools import pairwise

import casadi as cs
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.published.arms import load_arm
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.inverse.pose_search import NEAREST, effective_axes
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.model import ArmModel, JointLimits
from tests.quick import some

ABOUT = {"z": np.eye(3), "y": Rotation.from_rotvec([-np.pi / 2, 0, 0]).as_matrix()}
"""Joint axes to link axes: joints turn about z of their link."""


def arm_with(axes, offsets, name):
    """An arm whose joints turn about axes of the base, "z" or "y", at zero angles.

    Offsets (n + 1, 3), m, base axes at zero angles: base to joint 1, and so on to the gripper.
    """
    turns = [np.eye(3), *(ABOUT[axis] for axis in axes)]
    n = len(axes)
    return ArmModel(
        name=name,
        joint_names=tuple(f"j{k}" for k in range(1, n + 1)),
        rotations=np.array([before.T @ turn for before, turn in pairwise(turns)]),
        offsets=np.array([turn.T @ np.array(way) for turn, way in zip(turns[1:], offsets[1:], strict=True)]),
        masses=np.ones(n),
        centres=np.zeros((n, 3)),
        inertias=np.tile(0.01 * np.eye(3), (n, 1, 1)),
        limits=JointLimits.unlimited(n),
        mount_position=np.array(offsets[0]),
    )


FIVE = arm_with(
    "zyyyz", [[0, 0, 0.1], [0, 0, 0.1], [0, 0, 0.3], [0, 0, 0.3], [0, 0, 0.1], [0, 0, 0.1]], "five"
)
SCARA = arm_with("zzz", [[0, 0, 0.3], [0.3, 0, 0], [0.25, 0, 0], [0, 0, -0.05]], "scara")
FOUR_PARALLEL = arm_with(
    "zyyyyz",
    [[0, 0, 0.1], [0.2, 0, 0.1], [0.1, 0, 0.3], [0, 0, 0.3], [0.2, 0, 0], [0.1, 0, 0.1], [0, 0, 0.1]],
    "four parallel",
)
ARMS = {"five": (FIVE, 5), "scara": (SCARA, 3), "four parallel": (FOUR_PARALLEL, 5)}
SKEW = np.array([0.6, 0.0, 0.8])
ANGLES = np.array([0.3, 0.5, 0.9, 0.4, 0.2, -0.7])


def written(arm, q, digits, turned=0.0):
    """The pose of a posture as a file has it, with so many digits, turned by degrees about a skew axis."""
    position, rotation = gripper_pose(arm, q)
    turn = Rotation.from_matrix(rotation) * Rotation.from_rotvec(np.deg2rad(turned) * SKEW)
    return np.round(position, digits), Rotation.from_quat(np.round(turn.as_quat(), digits)).as_matrix()


def independent_miss(arm, position, rotation, q):
    """Least squared miss from a posture on, by SciPy and finite differences."""

    def errors(angles):
        at, turn = gripper_pose(arm, angles)
        return np.concatenate([at - position, Rotation.from_matrix(rotation.T @ turn).as_rotvec()])

    return least_squares(errors, q, xtol=1e-15, ftol=1e-15, gtol=1e-15).fun


@pytest.mark.parametrize("name", some(3, ARMS))
@pytest.mark.parametrize("digits", some(1, [4, 6, 9]))
def test_poses_with_rounded_digits_are_reached(name, digits):
    arm, effective = ARMS[name]
    assert effective_axes(arm) == effective
    q = ANGLES[: arm.n]
    position, rotation = written(arm, q, digits)
    target = PoseTarget(position, rotation)
    found = target.postures(arm)
    misses = target.misses(arm, found)
    assert np.all(misses <= NEAREST)
    least = independent_miss(arm, position, rotation, q)
    near = found[np.argmin(np.abs(found - q).max(axis=1))] if name != "four parallel" else found[0]
    here = independent_miss(arm, position, rotation, near)
    close = {"rel": 1e-3, "abs": 1e-11}
    assert np.hypot(*misses.T).min() == pytest.approx(np.linalg.norm(least), **close)
    assert np.linalg.norm(target.misses(arm, near[None])) == pytest.approx(np.linalg.norm(here), **close)
    assert np.all(target.reached(arm, found, 1e-12))
    assert not np.any(target.reached(arm, found + 1e-3, 1e-6))


@pytest.mark.parametrize("name", some(1, ARMS))
def test_poses_beyond_the_allowed_miss_are_refused_with_their_miss(name):
    arm, _ = ARMS[name]
    position, rotation = written(arm, ANGLES[: arm.n], 9, turned=0.1)
    least = independent_miss(arm, position, rotation, ANGLES[: arm.n])
    degrees = np.rad2deg(np.linalg.norm(least[3:]))
    assert 0.01 < degrees < 0.1
    text = rf"misses by .* mm and {degrees:.2f} degrees .*0\.1 mm and 0\.01 degrees"
    with pytest.raises(InputError, match=text):
        solve_inverse_kinematics(arm, position, rotation)


@pytest.mark.slow
def test_a_small_miss_is_not_printed_as_zero():
    """A pose above the plane of an arm that only moves in it."""
    position, rotation = written(SCARA, ANGLES[:3], 9)
    with pytest.raises(InputError, match=r"misses by 0\.2[0-9] mm and 0.00 degrees"):
        solve_inverse_kinematics(SCARA, position + np.array([0, 0, 2e-4]), rotation)
    found = solve_inverse_kinematics(SCARA, position + np.array([0, 0, 4e-7]), rotation)
    assert found.residuals == pytest.approx(4e-7, abs=1e-9)


def test_where_the_rank_is_full_nothing_but_exact_postures_count():
    arm = load_arm("FP1W2F")
    q = np.array([0.4, 0.7, -1.0, 0.3, 0.9, 0.2])
    target = PoseTarget(*gripper_pose(arm, q))
    assert effective_axes(arm) == 6
    assert target.reached(arm, q[None], 1e-9)[0]
    assert not target.reached(arm, q[None] + 2e-5, 1e-9)[0]
    assert np.all(target.misses(arm, q[None] + 2e-5) < NEAREST)


@pytest.mark.parametrize("orientation", ["axis", "free"])
@pytest.mark.parametrize("name", some(len(ARMS), [*ARMS, "FP1W2F"]))
def test_poses_that_ask_for_less(name, orientation):
    arm, _ = ARMS.get(name) or (load_arm(name), 6)
    axis = np.array([0.6, 0.0, 0.8]) if arm.n == 6 else np.array([0.0, 0.0, 1.0])
    position, rotation = gripper_pose(arm, ANGLES[: arm.n])
    own = rotation @ Rotation.from_rotvec(0.8 * axis).as_matrix()
    other = own if orientation == "axis" else Rotation.from_rotvec([1, 2, 3]).as_matrix()
    target = PoseTarget(position, other, orientation=orientation, tool_axis=axis)
    found = target.postures(arm)
    at, turned = gripper_pose(arm, found)
    assert np.abs(at - position).max() < 1e-7
    if orientation == "axis":
        assert np.abs(turned @ axis - other @ axis).max() < 1e-7
    q = cs.SX.sym("q", arm.n)
    rows = target.equations(arm, q)
    values = cs.Function("rows", [q], [rows, cs.jacobian(rows, q)])
    assert rows.shape == (target.conditions, 1)
    for posture in found[:10]:
        miss, slope = (np.array(part) for part in values(posture))
        assert np.abs(miss).max() < 1e-7
        assert np.linalg.matrix_rank(slope, tol=1e-4) <= target.independent(arm)
    assert np.abs(np.array(values(found[0] + 0.01)[0])).max() > 1e-4


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"orientation": "any"}, "orientation: must be one of full, axis, free, got 'any'"),
        ({"tool_axis": [0, 0, 2]}, "tool_axis: must have length 1"),
        ({"orientation": "free", "symmetric_about": "z"}, "orientation: 'free' contradicts symmetric_about"),
        ({"orientation": "axis", "symmetric_about": "z", "fold": 2}, "orientation: 'axis' contradicts"),
    ],
)
def test_what_is_no_orientation_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        PoseTarget([0, 0, 1], np.eye(3), **given)
