"""Gripper poses in task files: symmetric grippers, margins to angle limits."""

import shutil

import numpy as np
import pytest

from ocptip.api.check import offsets_of
from ocptip.basics.errors import InputError, InputWarning
from ocptip.motion.planner.free_ends import FOUND_MARGIN
from ocptip.motion.planner.one_start import free_ends
from ocptip.robots.kinematics import gripper_pose
from ocptip.task_files.motion import load_task
from ocptip.trajectories.trajectory import Trajectory
from tests.places import EXAMPLES

CART = (EXAMPLES / "tasks/ur5_cart.toml").read_text(encoding="utf-8")
GOAL = "rpy_deg = [180, 0, -90]"
OPTIMISED = 'optimised = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"]'

LINK = """
<link name="l{k}"><inertial><mass value="4"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<joint name="j{k}" type="{kind}"><parent link="{before}"/><child link="l{k}"/><origin xyz="{way}"/>
<axis xyz="0 0 1"/><limit lower="{low}" upper="{high}" effort="150" velocity="2"/></joint>"""
_AXES = (
    ("revolute", "0 0 0.3", -2.6, 2.6),
    ("revolute", "0.3 0 0", -2.6, 2.6),
    ("prismatic", "0.25 0 0", -0.2, 0.0),
    ("revolute", "0 0 0", -3.1, 3.1),
)
FOUR = '<robot name="four"><link name="base"/>' + "".join(
    LINK.format(k=k, kind=kind, before=f"l{k - 1}" if k > 1 else "base", way=way, low=low, high=high)
    for k, (kind, way, low, high) in enumerate(_AXES, 1)
)
FOUR += '<link name="tool0"/><joint name="t" type="fixed"><parent link="l4"/><child link="tool0"/>'
FOUR += '<origin xyz="0 0 -0.05"/></joint></robot>'
FOUR_TASK = """
[base]
mass = 120
center_of_mass = [0, 0, 0.2]
feet = [[0.4, 0.4, 0], [0.4, -0.4, 0], [-0.4, -0.4, 0], [-0.4, 0.4, 0]]
friction = 0.6
[arm]
urdf = "four.urdf"
mount_position = [0, 0, 0.5]
[motors]
kind = "estimated"
[motion]
start_pose = { POSE }
goal_deg = [10, 20, 30]
goal_m = [-0.1]
"""


def load(folder, *changes):
    shutil.copy(EXAMPLES / "tasks/ur5.urdf", folder)
    text = CART
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "task.toml").write_text(text, encoding="utf-8")
    return load_task(folder / "task.toml")


@pytest.mark.slow
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
        motion = Trajectory.ending_together(task.start, goal, [None] * 6, limits.speed, limits.acceleration)
        start_off, goal_off = offsets_of(motion, task)["deg"]
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


def test_orientations_that_ask_for_less(tmp_path):
    """The same keys as in placements: any turn about a tool axis, or any orientation."""
    about = load(tmp_path, (GOAL, f'{GOAL}, orientation = "axis", tool_axis = [0, 0, 2]'), (OPTIMISED, ""))
    short = load(tmp_path, (GOAL, f'{GOAL}, symmetric_about = "z"'), (OPTIMISED, ""))
    free = load(tmp_path, (GOAL, f'{GOAL}, orientation = "free"'))
    for ours, same in zip(about.choices, short.choices, strict=True):
        np.testing.assert_allclose(ours[1], same[1], atol=1e-12)
    assert free_ends(about).free == (False, True)
    assert not free_ends(free)  # three joints are optimised, the position has three conditions
    target = free.targets[1]
    ends = np.array([goal for _, goal in free.choices])
    at, turned = gripper_pose(free.robot.arm, ends)
    np.testing.assert_allclose(at, np.broadcast_to(target.position, at.shape), atol=1e-7)
    assert np.abs(turned - target.rotation).max(axis=(1, 2)).min() > 0.01
    with pytest.raises(InputError, match=r"goal_pose\.orientation: .*full, axis, free"):
        load(tmp_path, (GOAL, f'{GOAL}, orientation = "any"'))


def test_the_nearest_posture_of_an_arm_with_four_axes(tmp_path):
    """Its miss is named; the pose is what FOUR reaches, but for the last digits."""
    (tmp_path / "four.urdf").write_text(FOUR, encoding="utf-8")
    pose = "position = [0.36691, 0.34984, 0.7], quaternion = [0.0, 0.00002, 0.68164, 0.73169]"
    text = FOUR_TASK.replace("POSE", pose)
    (tmp_path / "task.toml").write_text(text, encoding="utf-8")
    with pytest.warns(InputWarning, match=r"start_pose: four lacks an axis there; .* 0\.0023 degrees"):
        task = load_task(tmp_path / "task.toml")
    assert np.rad2deg(task.targets[0].misses(task.robot.arm, task.start[None])[0, 1]) < 0.003
    (tmp_path / "task.toml").write_text(text.replace("0.00002", "0.002"), encoding="utf-8")
    with pytest.raises(InputError, match=r"start_pose: arm 'four' cannot reach .* misses by .* degrees"):
        load_task(tmp_path / "task.toml")
