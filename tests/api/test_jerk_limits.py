"""Jerk limits of a URDF: cycles and retimed paths keep them, or the answer notes that no timing does."""

from __future__ import annotations

import numpy as np
import pytest

import ocptip
from ocptip.motion.plan import plan_motion
from ocptip.task_files.cycle import load_cycle
from ocptip.task_files.motion import load_task
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.trajectory import Trajectory
from tests.motion.test_task import TWO_JOINTS, URDF

JERK = 40.0  # rad/s^3


def limited(folder, text):
    """A task file with a URDF whose joints have jerk limits."""
    urdf = TWO_JOINTS.replace('<robot name="two">', '<robot name="two" version="1.2">')
    for effort in ("40", "20"):
        urdf = urdf.replace(f'effort="{effort}"', f'effort="{effort}" jerk="{JERK:g}"')
    (folder / "two.urdf").write_text(urdf, encoding="utf-8")
    path = folder / "task.toml"
    path.write_text(text, encoding="utf-8")
    return path


def largest_jerk(motion):
    """By differences of the sampled accelerations, (n,), rad/s^3."""
    times, h = np.linspace(0, motion.end, 4001)[1:-1], 1e-5
    return np.max(np.abs(motion.states(times + h)[2] - motion.states(times - h)[2]) / (2 * h), axis=0)


def test_segments_of_cycles_keep_them(tmp_path):
    head, _, rest = URDF.partition("goal_deg")
    text = f'{head}[[segment]]\ngoal_deg{rest}[[segment]]\ngoal = "start"\n'
    task = load_cycle(limited(tmp_path, text))
    accelerations = task.robot.limits.acceleration
    for segment in task.segments:
        assert segment.task.rise_times == pytest.approx(2 * accelerations / JERK)
    plan = plan_motion(task, starts=1, jobs=1)
    for part in plan.parts:
        assert np.all(largest_jerk(part.motion) <= JERK * (1 + 1e-6))


def test_retimed_paths_keep_them_where_the_curvature_has_no_step(tmp_path):
    task = load_task(limited(tmp_path, URDF))
    ends = np.stack([task.goal - task.start, task.start])
    line = Trajectory.from_path(JointPath([0.0, 1.0], ends[:, None]), np.linspace(0, 1, 9), np.ones(9))
    plan = ocptip.retime(task, line)
    (timing,) = plan.timings
    assert np.all(timing.timed.motion.jerk_peaks <= JERK * (1 + 1e-6))
    assert np.max(timing.timed.motion.jerk_peaks) > 0.9 * JERK
    assert not any("jerk" in note for note in plan.task.robot.notes)


def test_a_path_with_a_step_of_its_curvature_is_noted(tmp_path):
    task = load_task(limited(tmp_path, URDF))
    half = 0.5 * (task.goal - task.start)
    bend = np.array([0.2, -0.2])
    pieces = np.stack([[0 * half, bend], [half, half], [task.start, task.start + half]])
    bent = JointPath([0.0, 0.5, 1.0], np.stack([pieces[0], 2 * pieces[1], pieces[2]]))
    assert bent.bends.tolist() == [1]
    plan = ocptip.retime(task, Trajectory.from_path(bent, np.linspace(0, 1, 9), np.ones(9)))
    (note,) = [note for note in plan.task.robot.notes if "jerk" in note]
    assert "jerk limits of joints hip, knee are not kept" in note
    assert "s = 0.5000" in note
