"""Tool lines: the gripper is where it should be, by another library's kinematics; else it is said why not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.model import ArmModel
from ocptip.task_files.motion import load_task
from ocptip.trajectories.tool_path import ToolPath, tool_lines
from tests.places import EXAMPLES
from tests.robots.pinocchio_twin import twin

DOWN = Rotation.from_euler("xyz", [180, 0, 0], degrees=True).as_matrix()
TURNED = Rotation.from_euler("xyz", [180, 0, -90], degrees=True).as_matrix()
POINTS = np.array([[0.3, 0.5, 0.9], [0.5, 0.3, 0.95], [0.5, -0.3, 0.95]])
POSES = [PoseTarget(point, turn) for point, turn in zip(POINTS, (DOWN, DOWN, TURNED), strict=True)]


@cache
def _arm() -> tuple[ArmModel, np.ndarray]:
    task = load_task(EXAMPLES / "tasks" / "ur5_cart.toml")
    return task.robot.arm, task.start[None]


def _gripper(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and rotations by Pinocchio."""
    model = twin(_arm()[0])
    data, points, turns = model.createData(), [], []
    for one in q:
        pin.framesForwardKinematics(model, data, one)
        pose = data.oMf[model.getFrameId("G")]
        points.append(pose.translation.copy())
        turns.append(pose.rotation.copy())
    return np.array(points), np.array(turns)


@cache
def _lines(tolerance: float) -> ToolPath:
    arm, start = _arm()
    return tool_lines(arm, POSES, start, tolerance)


def test_the_gripper_keeps_its_lines_and_turns_evenly() -> None:
    fit = _lines(0.0)
    assert len(fit.path.corners) == 1
    corner = fit.path.breakpoints[fit.path.corners[0]]
    for k, (begin, end) in enumerate(((0.0, corner), (corner, 1.0))):
        points, turns = _gripper(fit.path.at(np.linspace(begin, end, 301))[0])
        way = POINTS[k + 1] - POINTS[k]
        share = (points - POINTS[k]) @ way / (way @ way)
        assert np.abs(points - POINTS[k] - share[:, None] * way).max() < 3e-5
        assert share[0] == pytest.approx(0, abs=3e-5)
        assert share[-1] == pytest.approx(1, abs=3e-5)
        whole = Rotation.from_matrix(POSES[k].rotation.T @ POSES[k + 1].rotation).as_rotvec()
        wanted = POSES[k].rotation @ Rotation.from_rotvec(share[:, None] * whole).as_matrix()
        assert np.abs(turns - wanted).max() < 5e-5
    assert fit.tool.max() < 3e-5


def test_blends_keep_the_tolerance_of_the_gripper() -> None:
    fit = _lines(0.01)
    assert not fit.path.corners.size
    points, _ = _gripper(fit.path.at(np.linspace(0, 1, 1001))[0])
    nearest = np.min(np.linalg.norm(points - POINTS[1], axis=1))
    assert 0.002 < nearest <= 0.01 + 3e-5
    assert nearest == pytest.approx(fit.blended, rel=0.35)
    off = []
    for begin, end in ((0, 1), (1, 2)):
        way = POINTS[end] - POINTS[begin]
        share = np.clip((points - POINTS[begin]) @ way / (way @ way), 0, 1)
        off.append(np.linalg.norm(points - POINTS[begin] - share[:, None] * way, axis=1))
    assert np.min(off, axis=0).max() <= 0.01 + 3e-5


def test_the_first_posture_that_can_follow_is_taken() -> None:
    """Out of reach for the elbow as it is, not for another branch, and the other way round."""
    arm, start = _arm()
    far = [POSES[0], PoseTarget(np.array([0.6, 0.5, 0.9]), DOWN)]
    with pytest.raises(
        InputError, match=r"line from pose 1 to 2, at 7\d % of it .*would have to turn at once"
    ):
        tool_lines(arm, far, start)
    postures = POSES[0].postures(arm)
    assert tool_lines(arm, far, postures).path.joints == 6


@pytest.mark.parametrize(
    ("poses", "text"),
    [
        (POSES[:1], "at least two are needed for a path, got 1"),
        ([POSES[0], POSES[0]], "at least two are needed for a path, got 1 that differ"),
        pytest.param(
            [POSES[0], PoseTarget(np.array([1.5, 0.5, 0.9]), DOWN)],
            r"line from pose 1 to 2, at \d+ % .*cannot reach",
            marks=pytest.mark.slow,
        ),
        ([PoseTarget(POINTS[0], DOWN, "z", 2), POSES[1]], "fold: not on tool lines"),
    ],
)
def test_lines_that_cannot_be_are_refused(poses: list[PoseTarget], text: str) -> None:
    arm, start = _arm()
    with pytest.raises(InputError, match=text):
        tool_lines(arm, poses, POSES[0].postures(arm) if len(poses) > 1 and "reach" in text else start)


def test_poses_that_are_nearly_the_same_decide_nothing() -> None:
    plain = _lines(0.01)
    for size in (0.0, 1e-6):
        near = PoseTarget(POINTS[1] + [size, 0.0, -size], POSES[1].rotation)
        fit = tool_lines(_arm()[0], [*POSES[:2], near, *POSES[2:]], _arm()[1], 0.01)
        assert fit.how == f"{plain.how}, without 1 nearly the same as the one before"
        s = np.linspace(0, 1, 101)
        np.testing.assert_allclose(fit.path.at(s)[0], plain.path.at(s)[0], atol=1e-4)


def test_a_gripper_that_may_turn_freely_does() -> None:
    arm, start = _arm()
    free = [PoseTarget(point, DOWN, "z") for point in POINTS[:2]]
    fit = tool_lines(arm, free, start)
    points, turns = _gripper(fit.path.at(np.linspace(0, 1, 101))[0])
    assert np.abs(turns[:, :, 2] - DOWN[:, 2]).max() < 5e-5
    assert np.abs(points[-1] - POINTS[1]).max() < 3e-5
    assert "turning freely" in fit.how
