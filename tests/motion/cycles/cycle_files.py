"""A task file of a cycle: a modular arm on three feet swings out, and back with a load."""

from __future__ import annotations

from ocptip import load_task
from ocptip.motion.files.plan_files import write_plan
from ocptip.motion.motion_plan import MotionPlan
from ocptip.task_files.cycle import read_task
from ocptip.trajectories.trajectory import Trajectory
from tests.motion.test_task import FEET
from tests.pictures.plan_stand_in import plan_of

CYCLE = (
    'name = "swing"\n'
    + FEET
    + """\
[arm]
name = "FP1W2F"
mount_position = [0, 0, 0]
[payload.part]
mass = 1.0
[[obstacle]]
kind = "floor"
height = -0.14
[motion]
start_deg = [-40, 35, -18, 45, -37, 180]
optimised = [1, 2]
commands = 2
[[segment]]
name = "out"
goal_deg = [20, 30, -8, 45, -18, 150]
dwell = 0.3
[[segment]]
name = "back"
payload = "part"
goal = "start"
"""
)


def written(folder, text=CYCLE, name="swing.toml"):
    """The file."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def planned(folder, slower=2.0):
    """The folder of a plan of it, without planning: one ramp per joint at a share of its limits."""
    task = read_task(written(folder))
    task = load_task(task, GN=0.99, GT=0.99)
    parts, start = [], task.starts[0]
    for segment in task.segments:
        limits, none, goal = segment.task.robot.limits, [None] * segment.task.robot.n, segment.goals[0]
        motion = Trajectory.ending_together(
            start, goal, none, limits.speed / slower, limits.acceleration / slower
        )
        parts.append(plan_of(segment.between(start, goal), motion))
        start = goal
    write_plan(folder / "swing", MotionPlan.of_cycle(task, parts, seconds=1.0, options={}))
    return folder / "swing"
