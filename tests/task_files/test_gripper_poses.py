"""Gripper poses in task files: symmetric grippers, margins to angle limits."""

import shutil

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.cli.check import _offsets
from ocptip.motion.planner.free_ends import FOUND_MARGIN
from ocptip.motion.planner.one_start import free_ends
from ocptip.task_files.motion import load_task
from ocptip.trajectories.arm_motion import ArmMotion
from tests.places import EXAMPLES

CART = (EXAMPLES / "tasks/ur5_cart.toml").read_text(encoding="utf-8")
GOAL = "rpy_deg = [180, 0, -90]"
OPTIMISED = 'optimised = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"]'


def load(folder, *changes):
    shutil.copy(EXAMPLES / "tasks/ur5.urdf", folder)
    text = CART
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "task.toml").write_text(text, encoding="utf-8")
    return load_task(folder / "task.toml")


def test_a_symmetric_gripper_has_more_postures_and_a_free_end(tmp_path):
    free = load(tmp_path, (GOAL, f'{GOAL}, symmetric_about = "z"'), (OPTIMISED, ""))
    twofold = load(tmp_path, (GOAL, f'{GOAL}, symmetric_about = "z", fold = 2'), (OPTIMISED, ""))
    assert 24 < len(twofold.choices) < len(free.choices)
    assert free.optimised == tuple(range(6))
    assert free_ends(free).free == (False, True)
    assert not free_ends(twofold)
    assert not free_ends(load(tmp_path, (GOAL, f'{GOAL}, symmetric_about = "z"')))
    for task in (free, twofold):
        for k, target in enumerate(task.targets):
            ends = np.array([pair[k] for pair in task.choices])
            assert target.residuals(task.robot.arm, ends).max() < 1e-8


def test_check_compares_with_the_pose(tmp_path):
    """A posture between those that the task holds is as good; one that misses the pose is not."""
    task = load(tmp_path, (GOAL, f'{GOAL}, symmetric_about = "z"'))
    limits = task.robot.limits
    for turn, joint in ((0.2, 5), (0.2, 0)):
        goal = task.goal + turn * np.eye(6)[joint]
        motion = ArmMotion.with_passive(task.start, goal, [None] * 6, limits.speed, limits.acceleration)
        start_off, goal_off = _offsets(motion, task)["deg"]
        assert start_off == 0
        assert goal_off == pytest.approx(0.0 if joint == 5 else np.rad2deg(turn), abs=1e-6)


def test_margins_of_postures_and_of_the_task(tmp_path):
    task = load(tmp_path, ("clearance = 0.01", "angle_margin_deg = 10\nclearance = 0.01"))
    assert task.limits.angle_margin == pytest.approx(np.deg2rad(10))
    limits = task.robot.limits
    ends = np.array([q for pair in task.choices for q in pair])
    wide = np.deg2rad(10) - 1e-9
    assert np.all((ends >= limits.angle_min + wide) & (ends <= limits.angle_max - wide))
    near = float(np.rad2deg(task.goal[2])) + 0.5 * np.rad2deg(FOUND_MARGIN)
    found = load(tmp_path, ("[arm.limits]", f"[arm.limits]\nangle_max_deg = {{ elbow_joint = {near} }}"))
    assert max(pair[1][2] for pair in found.choices) < task.goal[2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ('symmetric_about = "tool"', "motion.goal_pose.symmetric_about: must be x, y or z, got 'tool'"),
        ("fold = 2", "motion.goal_pose.fold: needs symmetric_about"),
        ('symmetric_about = "z", fold = 99', "motion.goal_pose.fold: must be a whole number of 2 to 12"),
        ('symetric_about = "z"', "motion.goal_pose.symetric_about: unknown key"),
    ],
)
def test_mistakes_are_named(tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        load(tmp_path, (GOAL, f"{GOAL}, {change}"))
    with pytest.raises(InputError, match=r"limits.angle_margin_deg: must be >= 0, got -1"):
        load(tmp_path, ("clearance = 0.01", "angle_margin_deg = -1"))
