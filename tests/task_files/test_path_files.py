"""Files of paths: waypoints, motions; what they may be wrong about is refused in one line that says where."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ocptip.basics.errors import InputError, InputWarning
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.task import MotionTask
from ocptip.robots.kinematics import gripper_pose
from ocptip.task_files.cycle import read_task
from ocptip.task_files.motion import load_task
from ocptip.task_files.path import GivenPath, load_path, refuse_early
from tests.places import EXAMPLES

Q = "[[waypoint]]\nat_deg = [{}]\n"
FIRST, SECOND, THIRD = "90, -90, 90, -90, -90, 0", "40, -80, 70, -90, -90, 0", "-20, -90, 90, -90, -90, 0"
POSE = "[[waypoint]]\nat_pose = {{ position = [{}], rpy_deg = [180, 0, 0] }}\n"


@cache
def _task() -> MotionTask:
    return load_task(EXAMPLES / "tasks" / "ur5_cart.toml")


@cache
def _cycle() -> CycleTask:
    found = read_task(EXAMPLES / "tasks" / "ur5_pick_and_place.toml")
    assert isinstance(found, CycleTask)
    return found


def _load(folder: Path, text: str, task: MotionTask | CycleTask | None = None, **how: float) -> GivenPath:
    path = folder / "path.toml"
    path.write_text(text, encoding="utf-8")
    return load_path(path, task or _task(), **how)


def test_waypoints_of_joints(tmp_path: Path) -> None:
    points = "".join(map(Q.format, (FIRST, SECOND, THIRD)))
    (fit,) = _load(tmp_path, points).paths
    assert np.rad2deg(fit.path.start) == pytest.approx([90, -90, 90, -90, -90, 0])
    assert np.rad2deg(fit.path.goal) == pytest.approx([-20, -90, 90, -90, -90, 0])
    assert fit.how == "smooth curve through 3 points"
    (lines,) = _load(tmp_path, 'between = "lines"\n' + points).paths
    assert len(lines.path.corners) == 1
    (blended,) = _load(tmp_path, 'between = "lines"\npath_tolerance = 2\n' + points).paths
    assert not blended.path.corners.size
    assert np.rad2deg(blended.distance.max()) == pytest.approx(2)
    (typed,) = _load(tmp_path, 'between = "lines"\npath_tolerance = 2\n' + points, tolerance=1.0).paths
    assert np.rad2deg(typed.distance.max()) == pytest.approx(1)


def test_waypoints_of_the_gripper(tmp_path: Path) -> None:
    """Poses in any of the three ways; the branch is that of the task's start."""
    text = POSE.format("0.3, 0.5, 0.9") + POSE.format("0.5, 0.3, 0.95")
    for between in ("spline", "lines", "tool lines"):
        (fit,) = _load(tmp_path, f'between = "{between}"\n' + text).paths
        point, _ = gripper_pose(_task().robot.arm, fit.path.goal)
        assert point == pytest.approx([0.5, 0.3, 0.95], abs=1e-6)
        assert fit.path.start == pytest.approx(_task().start, abs=1e-6)


def test_a_joint_trajectory_keeps_its_motion_as_a_comparison(tmp_path: Path) -> None:
    task = _task()
    rows = np.linspace(task.start, task.goal, 4)
    points = [
        {"positions": row.tolist(), "time_from_start": {"sec": k, "nanosec": 0}} for k, row in enumerate(rows)
    ]
    file = tmp_path / "motion.json"
    names = list(task.robot.names)
    file.write_text(json.dumps({"joint_names": names, "points": points}), encoding="utf-8")
    with pytest.warns(InputWarning, match="1000 ms apart, with positions only"):
        found = load_path(file, task)
    assert len(found.motions) == 1
    assert found.paths[0].path.goal == pytest.approx(task.goal)
    file.write_text(json.dumps({"joint_names": [*names[:-1], "elbow"], "points": points}), encoding="utf-8")
    with pytest.raises(InputError, match="joint_names: expected shoulder_pan_joint"):
        load_path(file, task)
    file.write_text(json.dumps({"joint_names": names, "points": points[:1]}), encoding="utf-8")
    with pytest.raises(InputError, match="at least two samples"):
        load_path(file, task)
    file.write_text(json.dumps({"joint_names": names, "points": []}), encoding="utf-8")
    with pytest.raises(InputError, match=r"motion\.json"):
        load_path(file, task)


def test_segments_of_a_cycle_have_paths_of_their_own(tmp_path: Path) -> None:
    task = _cycle()
    ways = [(segment.task.start, segment.task.goal) for segment in task.segments]
    parts = [
        "[[segment]]\n" + "".join(f"[[segment.waypoint]]\nat_deg = {np.rad2deg(q).tolist()}\n" for q in way)
        for way in ways
    ]
    found = _load(tmp_path, "".join(parts), task)
    assert len(found.paths) == len(task.segments)
    with pytest.raises(InputError, match=rf"segment: {len(parts) - 1} paths, .* has {len(parts)} segments"):
        _load(tmp_path, "".join(parts[1:]), task)
    with pytest.raises(InputError, match="off the end of 1"):
        _load(tmp_path, "".join([parts[0], parts[0], *parts[2:]]), task)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", r"path\.toml: waypoint: at least one"),
        (Q.format(FIRST), r"^path\.toml: waypoint: at least two are needed for a path, got 1"),
        (Q.format(FIRST) * 2, r"^path\.toml: waypoint: none of 2 differs from the others by more than 5e-05"),
        (Q.format("1, 2, 3") * 2, r"waypoint\[1\].at_deg"),
        (Q.format("nan, 0, 0, 0, 0, 0") * 2, r"waypoint\[1\].at_deg"),
        (Q.format(FIRST) + "[[waypoint]]\nat = [1]\n", r"waypoint\[2\]"),
        ('between = "curves"\n' + Q.format(FIRST) * 2, "between"),
        ("path_tolerance = -1\n" + Q.format(FIRST) * 2, "path_tolerance"),
        (POSE.format("0.3, 0.5, 0.9") + POSE.format("1.5, 0.5, 0.9"), r"waypoint\[2\].at_pose.*cannot reach"),
        pytest.param(
            'between = "tool lines"\n' + POSE.format("0.3, 0.5, 0.9") + POSE.format("-0.3, -0.5, 0.9"),
            r"path\.toml: waypoint: line from pose 1 to 2, at \d+ % of it",
            marks=pytest.mark.slow,
        ),
        ('between = "tool lines"\n' + Q.format(FIRST) * 2, "only the first may be joint positions"),
        ("[motion]\n", "is a motion task"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint) as error:
        _load(tmp_path, text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("a.csv", "q1,q2\n1,2\n", r"a\.csv: header: expected one column time_s, got q1, q2; points without"),
        ("a.csv", "time_s,q1_deg\n0,1\nx,2\n", r"a\.csv: line 3, time_s: expected a number"),
        ("a.csv", "time_s,q1_deg\n0,1\n1,2,3\n", r"a\.csv: line 3: expected 2 values"),
        ("a.toml", 'between = "curves"\n[[waypoint]]\nat = [1]\n', r"a\.toml: between"),
    ],
)
def test_what_needs_no_robot_is_refused_before_the_task_is_read(tmp_path, name, text, complaint):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=complaint):
        refuse_early(tmp_path / name)


def test_only_the_first_lines_of_a_table_are_read_before_the_task(tmp_path):
    rows = "".join(f"{k},{k}\n" for k in range(40))
    (tmp_path / "a.csv").write_text(f"time_s,q1_deg\n{rows}wrong,1\n")
    refuse_early(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text(rows)
    refuse_early(tmp_path / "b.csv", {"time_s": 1, "q1_deg": 2})
    comments = "".join(f"# note {k}\n" for k in range(50))
    (tmp_path / "c.csv").write_text(f"{comments}time,a\n0,0\n1,0.5\n")
    refuse_early(tmp_path / "c.csv")
