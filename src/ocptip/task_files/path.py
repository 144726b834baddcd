"""Paths for `ocptip retime`: waypoints from TOML files, motions of others. Format: docs/retiming.md."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ocptip.basics import schema
from ocptip.basics.errors import InputError, naming, positive_number
from ocptip.basics.read import read_text
from ocptip.basics.schema import Keys
from ocptip.basics.toml import Table
from ocptip.motion.cycles.check import segments_of
from ocptip.motion.cycles.task import Task
from ocptip.motion.task import MotionTask
from ocptip.robots.inverse.joint_angles import within_limits
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.kinematics import gripper_pose
from ocptip.task_files.doubts import require_kind
from ocptip.task_files.tables.joints import end_keys, read_end
from ocptip.trajectories.csv_text import text_table, times_of
from ocptip.trajectories.drive_profile import POSE, UNITS
from ocptip.trajectories.path_fit import FittedPath, blended_lines, path_of_motion, spline_through
from ocptip.trajectories.read import load_motion
from ocptip.trajectories.tool_path import tool_lines
from ocptip.trajectories.trajectory import Trajectory

_FIRST = 20  # lines of a CSV file that are read before the task
BETWEEN = ("spline", "lines", "tool lines")
_WAYPOINT = Keys(
    "waypoint",
    "A posture on the path, or a pose of the gripper.",
    {
        **end_keys("at", "waypoint"),
        "at": schema.vector("Coordinates of a parallel robot, m and rad.", otherwise="the other keys"),
        "base": schema.vector(
            "Pose of the base there: x and y, m, and yaw, degrees; with `--base-limits`.", default=None
        ),
    },
)
_PATH = {
    "between": schema.choice(
        "Smooth curve of the joints, their straight lines, or straight lines of the gripper.",
        BETWEEN,
        default="spline",
    ),
    "path_tolerance": schema.number(
        "Largest distance of the path from the waypoints; sliding joints, tool lines: mm.",
        "deg or mm",
        bound=">= 0",
        default=0.0,
    ),
    "waypoint": schema.tables(_WAYPOINT, required=True),
}
PATH = Keys(
    "path",
    "Waypoints of a motion, or of each segment of a cycle: `ocptip retime`.",
    _PATH,
    by=("segment",),
    variants={
        "segment": Keys(
            "path of a cycle",
            "Waypoints of each segment of a cycle.",
            {"segment": schema.tables(Keys("path of a segment", "Waypoints of a segment.", _PATH))},
        )
    },
)


@dataclass(frozen=True, eq=False)
class GivenPath:
    """A path, and the motion that it was taken from.

    Attributes:
        paths: one, or of a cycle one per segment.
        motions: with the times of the file, as many; empty where it has none.
    """

    paths: tuple[FittedPath, ...]
    motions: tuple[Trajectory, ...] = ()


def load_path(
    path: str | os.PathLike[str],
    task: Task,
    *,
    tolerance: float | None = None,
    unit: str | None = None,
    rate: float | None = None,
    columns: Mapping[str, str | int] | None = None,
    topic: str | None = None,
    with_base: bool = False,
    smooth: bool = False,
) -> GivenPath:
    """Read a path: waypoints (TOML), or any motion that `load_motion` reads, whose times are a comparison.

    Args:
        path: the file.
        task: whose robot moves; each segment of a cycle has a separate path.
        tolerance: degrees (sliding joints, tool lines: mm): how far the path may be from what is given:
            corners are blended, noise is smoothed. Default: that of a file of waypoints, or none.
        unit, rate, columns, topic: see `load_motion`; the task's start is where the robot is at 0 s.
        with_base: motions also have x, y, m, and yaw of the base; columns of paths begin with them.
        smooth: see `path_along`.

    Raises:
        InputError: the file cannot be read, holds no path, or one of another robot; one line that says where.
    """
    path = Path(path)
    if tolerance is not None:
        positive_number("--path-tolerance", tolerance, zero_allowed=True)
    if path.suffix.lower() == ".toml":
        return _waypoints(path, task, tolerance)
    base = (POSE, UNITS) if with_base else ((), ())
    names, units = (*base[0], *task.robot.names), (*base[1], *task.robot.units)
    start = np.append(np.zeros(len(base[0])), task.start)
    known = {"unit": unit or "", "start": start, "rate": rate, "columns": columns, "topic": topic}
    motion = load_motion(path, names, units, several=True, **known)
    with naming(path.name):
        return path_along(motion, task, tolerance, smooth)


def path_along(
    motion: Trajectory, task: Task, tolerance: float | None = None, smooth: bool = False
) -> GivenPath:
    """The path of a motion, whose times are a comparison; see :func:`load_path`.

    Its curvature has no steps if it is to be smooth, or if joints have jerk limits and a smooth curve along
    the motion can be followed at nearly its speed.
    """
    if motion.n != task.robot.n + len(POSE):  # with its base
        task.robot.require_fit(motion.n)
    motions = segments_of(task, motion).segments
    within = None if not tolerance else joint_tolerance(task, tolerance, motion.n > task.robot.n)
    paths = []
    for one, segment in zip(motions, task.segments, strict=True):
        limited = bool(np.isfinite(segment.task.limits.jerks(segment.task.robot.limits)).any())
        try:
            path = path_of_motion(one, within, smooth=smooth or limited)
        except InputError:
            if smooth or not limited:
                raise
            path = path_of_motion(one, within)
        paths.append(path)
    return GivenPath(tuple(paths), motions)


def joint_tolerance(task: Task, tolerance: float, with_base: bool = False) -> np.ndarray:
    """(n,), rad or m, from degrees and mm; those of the base come first."""
    units = (*(UNITS if with_base else ()), *task.robot.units)
    return np.where(np.array(units) == "rad", np.deg2rad(tolerance), 1e-3 * tolerance)


def refuse_early(path: str | os.PathLike[str], columns: Mapping[str, str | int] | None = None) -> None:
    """Refuse a file for what no robot is needed to see, as its task may take long to read.

    Checked are files of waypoints, and the first lines of CSV files; others are not.

    Args:
        path: of the file.
        columns: of CSV files, see `ocptip.trajectories.read.load_motion`.

    Raises:
        InputError: no such file, no TOML, unknown keys, or an unknown interpolation between waypoints; no
            table, or no column of times.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".toml":
        with Table.read(path, PATH) as data:
            _tables(data)
    if suffix == ".csv":
        with naming(f"{path}"):
            lines = read_text(path).splitlines()
            table_lines = (
                k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")
            )
            table = text_table("\n".join(lines[: next(table_lines, 0) + _FIRST]), columns)
            if table.header:
                times_of(table)


def _tables(data: Table) -> list[Table]:
    """The tables of a file of waypoints that hold a path each."""
    require_kind(data, "retime")
    data.close(early=True)
    tables = data.tables("segment") if "segment" in data else [data]
    for table in tables:
        if table is not data:
            table.close(early=True)
        _ = table["between"]  # complains
    return tables


def _waypoints(path: Path, task: Task, tolerance: float | None) -> GivenPath:
    with Table.read(path, PATH) as data:
        tables = _tables(data)
        tasks = [segment.task for segment in task.segments]
        if len(tables) != len(tasks):
            raise data.error(f"{len(tables)} paths, {task.name} has {len(tasks)} segments", "segment")
        paths, before = [], tasks[0].start
        for table, segment_task in zip(tables, tasks, strict=True):
            paths.append(_path(table, segment_task, before, tolerance))
            before = paths[-1].path.goal
        for number, (one, other) in enumerate(pairwise(paths), 1):
            gap = float(np.abs(one.path.goal - other.path.start).max())
            if gap > 1e-6:
                raise data.error(
                    f"{number + 1} starts {gap:.3g} (rad or m) off the end of {number}", "segment"
                )
        return GivenPath(tuple(paths))


def _path(table: Table, task: MotionTask, before: np.ndarray, tolerance: float | None) -> FittedPath:
    """The path of one motion; `before` is where the robot is."""
    between = table["between"]
    given: float = table["path_tolerance"]
    within = given if tolerance is None else tolerance
    points = table.tables("waypoint")
    ends = [read_end(task.robot, point, "at", task.limits) for point in points]
    base = _base(table, points, between)
    for point in points:
        point.close()
    with table.at("waypoint", points="waypoint", poses="waypoint"):
        if between == "tool lines":
            return _tool_path(table, task, ends, before, within)
        postures = []
        for branches, _ in ends:
            near = postures[-1] if postures else before
            postures.append(_nearest(task, branches, near)[0])
        places, most = np.hstack([base, postures]), joint_tolerance(task, within, base.size > 0)
        return spline_through(places, most) if between == "spline" else blended_lines(places, most)


def _base(table: Table, points: Sequence[Table], between: str) -> np.ndarray:
    """(M, 3) x, y and yaw of the base at waypoints; (M, 0) where they have none."""
    given = [point["base"] for point in points]
    known = [given_base for given_base in given if given_base is not None]
    if not known:
        return np.empty((len(points), 0))
    if len(known) < len(given) or between == "tool lines":
        raise table.error("base: of all waypoints or of none, and not on tool lines", "waypoint")
    return np.array(known) * [1.0, 1.0, np.pi / 180]


def _nearest(task: MotionTask, branches: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Postures (k, n), the nearest first; what is given as joint angles stays as it is."""
    if len(branches) == 1 or (arm := task.robot.arm) is None:
        return branches
    copies = within_limits(arm, branches, near)
    return copies[np.argsort(np.sum((copies - near) ** 2, axis=1), kind="stable")]


def _tool_path(
    table: Table,
    task: MotionTask,
    ends: Sequence[tuple[np.ndarray, PoseTarget | None]],
    before: np.ndarray,
    tolerance: float,
) -> FittedPath:
    if (arm := task.robot.arm) is None:
        raise table.error(f"the {task.robot.kind} has no gripper poses", "between")
    poses = []
    for number, (postures, target) in enumerate(ends, 1):
        if target is None and number > 1:
            raise table.error(f"{number}: on tool lines only the first may be joint positions", "waypoint")
        poses.append(target or PoseTarget(*gripper_pose(arm, postures[0])))
    return tool_lines(arm, poses, _nearest(task, ends[0][0], before), 1e-3 * tolerance)
