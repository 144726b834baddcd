"""Reading motions from files: profile commands, points of trajectory controllers, samples as CSV."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import (
    InputError,
    doubt,
    doubt_degrees,
    finite_array,
    naming,
    positive_number,
    refuse_huge,
)
from ocptip.basics.read import parse_json, parse_yaml, read_text
from ocptip.basics.text import some
from ocptip.trajectories.bags import is_bag, motion_in_bag, refuse_of_other_files
from ocptip.trajectories.controllers import UPDATE_RATE, controller_points
from ocptip.trajectories.csv_text import text_table
from ocptip.trajectories.points import Points
from ocptip.trajectories.read_csv import motion_of_table, require_units
from ocptip.trajectories.trajectory import Trajectory

FAR = 0.02  # s: points with positions only that are farther apart are no set points of a controller
_STILL = 1e-6  # rad or m: a joint that goes less does not move
_WRAPPERS = ("goal", "trajectory", "joint_trajectory")  # of actions, RobotTrajectory and DisplayTrajectory
_STAMPS = (("sec", "nanosec"), ("secs", "nsecs"))  # of ROS 2 and ROS 1


def trajectory_in(data: Any) -> dict[str, Any] | None:
    """The joint trajectory in a message, bare or wrapped; None if there is none.

    Raises:
        InputError: there are several, or points of joints with several degrees of freedom.
    """
    while isinstance(data, dict) and "points" not in data:
        multi = data.get("multi_dof_joint_trajectory")
        if isinstance(multi, dict) and multi.get("points"):
            raise InputError("multi_dof_joint_trajectory: has points; expected a base that does not move")
        data = next((data[key] for key in reversed(_WRAPPERS) if key in data), None)
        if isinstance(data, list):  # of a DisplayTrajectory
            if len(data) != 1:
                raise InputError(
                    f"trajectory: holds {len(data)} trajectories, expected one; give each a separate file"
                )
            data = data[0]
    return data if isinstance(data, dict) else None


def motion_of_points(
    data: Any, names: Sequence[str] | None, rate: float | None = None, start: np.ndarray | None = None
) -> Trajectory:
    """The motion that a controller makes of a joint trajectory.

    Args:
        data: the message.
        names: of the robot's joints; None: those of the message.
        rate: updates of the controller, Hz: corners of points with positions only last one; default 500.
        start: (n,), rad or m: where the robot rests at 0 s; None: unknown.

    Raises:
        InputError: it is no joint trajectory, or lacks a joint or the point at 0 s.
    """
    if not isinstance(data, dict) or not isinstance(data.get("points"), list):
        raise InputError("points: expected a joint trajectory with joint_names and a list of points")
    joints, points = data.get("joint_names"), data["points"]
    if not isinstance(joints, list) or not all(isinstance(name, str) for name in joints):
        raise InputError(f"joint_names: expected a list of names, got {joints!r}")
    names = list(joints) if names is None else list(names)
    if len(set(joints)) < len(joints) or not set(names) <= set(joints):
        raise InputError(f"joint_names: expected {', '.join(names)}, got {', '.join(joints)}")
    order = [joints.index(name) for name in names]
    times = np.array([_stamp(k, point) for k, point in enumerate(points, 1)])
    columns = {}
    for key in ("positions", "velocities", "accelerations"):
        rows = [point.get(key) or [] for point in points]
        if key != "positions" and not any(rows):
            continue
        for k, row in enumerate(rows, 1):
            if not isinstance(row, list) or len(row) != len(joints):
                raise InputError(f"points[{k}].{key}: expected {len(joints)} numbers, got {row!r}")
            rows[k - 1] = finite_array(f"points[{k}].{key}", row, (len(joints),))
        columns[key] = np.reshape(rows, (-1, len(joints)))
        refuse_huge(key, float(np.max(np.abs(columns[key]), initial=0.0)))
    assumed = _left_out(joints, names, columns["positions"])
    columns = {key: values[:, order] for key, values in columns.items()}
    if len(times) and times[0] > 0:
        first = _first(times[0], names, start)
        assumed.append(
            f"the point at 0 s is the task's start, at rest; the file's first is at {times[0]:.9g} s"
        )
        times = np.append(0.0, times)
        for key, values in columns.items():
            columns[key] = np.vstack([first if key == "positions" else np.zeros(len(names)), values])
    speeds, accelerations = columns.get("velocities"), columns.get("accelerations")
    period = 1 / (rate or UPDATE_RATE) if speeds is None else None
    given = Points(times, columns["positions"], speeds, accelerations, period)
    moving = np.max(np.abs(np.diff(given.angles, axis=0)), axis=1) > _STILL
    gap = float(np.max(np.diff(given.times)[moving], initial=0.0))
    if period is not None and gap > max(FAR, period) * (1 + 1e-6):
        doubt(
            f"points: are up to {1e3 * gap:.4g} ms apart, with positions only: a controller draws straight "
            "lines between them, with speed steps at the corners; give velocities, or points at most "
            f"{1e3 * FAR:g} ms apart"
        )
    return Trajectory(points=given, assumed=tuple(assumed))


def _first(time: float, names: Sequence[str], start: np.ndarray | None) -> np.ndarray:
    """Where the robot is before a first point at a time, s, (n,); InputError where nothing says it."""
    if start is None:
        raise InputError(
            f"points[1].time_from_start: is {time:.9g} s; a controller moves there from where the robot "
            "is, which nothing says; name a task, whose start is the point at 0 s, or give a point at 0 s"
        )
    if len(start) != len(names):
        raise InputError(f"joint_names: has {len(names)} joints, the robot has {len(start)}")
    return start


def _left_out(joints: Sequence[str], names: Sequence[str], positions: np.ndarray) -> list[str]:
    """Notes on joints that the robot does not have; a warning where they move."""
    others = [k for k, name in enumerate(joints) if name not in names]
    if not others:
        return []
    moving = [joints[k] for k in others if np.ptp(positions[:, k]) > _STILL] if len(positions) else []
    if moving:
        doubt(f"joint_names: {some(moving)} moves, but is no joint of the robot; its motion is left out")
    return [f"the file's joints {some([joints[k] for k in others])} are none of the robot's: left out"]


def _stamp(number: int, point: Any) -> float:
    """Time of a point, s."""
    stamp = point.get("time_from_start") if isinstance(point, dict) else None
    given = stamp if isinstance(stamp, dict) else {}
    keys = next((stamp_keys for stamp_keys in _STAMPS if given and set(given) <= set(stamp_keys)), ())
    parts = [given.get(key, 0) for key in keys]
    if not parts or not all(isinstance(v, int) and not isinstance(v, bool) for v in parts):
        raise InputError(
            f"points[{number}].time_from_start: expected sec and nanosec, or secs and nsecs, got {stamp!r}"
        )
    return parts[0] + 1e-9 * parts[1]


CERTIFICATE = "ocptip certificate"
"""How the format begins that certificates name."""


def load_motion(
    path: str | os.PathLike[str],
    names: Sequence[str] | None = None,
    units: Sequence[str] = (),
    *,
    unit: str | None = None,
    start: np.ndarray | None = None,
    rate: float | None = None,
    columns: Mapping[str, str | int] | None = None,
    topic: str | None = None,
    several: bool = False,
) -> Trajectory:
    """Read a motion from a file: profile commands, a joint trajectory, or CSV with samples.

    Ramp commands: JSON as :meth:`Trajectory.from_dict`; `plan.json` is one such file; where it names a
    controller, the motion is what that makes of them. Joint trajectory: JSON or YAML like
    `trajectory_msgs/JointTrajectory`, alone or in a message that holds one, angles in rad, lengths in m; the
    motion is what ROS 2's joint trajectory controller makes of it: quintic polynomials between points that
    have velocities and accelerations, cubic ones where accelerations are empty, straight lines where
    velocities are empty as well. The drives are assumed to spread the corners of these lines over one update
    of the controller. CSV: a header that names time, positions and, if at hand, speeds and accelerations of
    all joints, in any order, see `ocptip.trajectories.read_csv`; other columns are left out. With
    accelerations that are those of the motion between the samples, as in motion.csv, it is taken unchanged; a
    time may be repeated at acceleration steps. All else is fitted (`ocptip.trajectories.fit`). Bags of ROS: a
    joint trajectory, or joint states as samples, in rad and m.

    Args:
        path: the file.
        names: of the robot's joints; those of a joint trajectory or of a CSV file are put into this order.
        units: "rad" or "m" per coordinate of the robot that is to move so; by default not checked.
        unit: "deg" or "rad", of CSV columns of turning joints that do not say it; such are refused otherwise.
        start: (n,), rad or m, where the robot rests at 0 s: from there a controller moves to a first point
            that is later; None: unknown, such trajectories are refused.
        rate: updates of the controller per second, for points with positions only; default: 500.
        columns: of CSV files, what their columns are: names as in `motion.csv`, each with the title or the
            number, from 1, of a column.
        topic: of bags, see `ocptip.trajectories.bags.motion_in_bag`.
        several: also the segments of the plan.json of a cycle, which is refused otherwise.

    Raises:
        InputError: the file cannot be read or holds no motion, or angles of a joint that slides; names file,
            and key, segment, or line and column.
    """
    path = Path(path)
    bag = is_bag(path)
    refuse_of_other_files(bag, [topic] if topic else [], columns)
    result = motion_in_bag(path, names, topic) if bag else None
    text = "" if bag else read_text(path)
    try:
        if isinstance(result, dict):
            return motion_of_points(result, names, rate, start)
        if result is not None:
            return motion_of_table(result, names, units, "rad")
        if path.suffix.lower() in (".yaml", ".yml"):
            return motion_of_points(trajectory_in(parse_yaml(text)), names, rate, start)
        if not text.lstrip().startswith(("{", "[")):
            return motion_of_table(text_table(text, columns), names, units, unit)
        data = _json(text)
        points = None if {"commands", "path", "segments"} & set(data) else trajectory_in(data)
        if points is not None:
            return motion_of_points(points, names, rate, start)
        if not isinstance(data, dict) or "segments" not in data:
            return _from_commands(data, units)
        if several:
            return _from_segments(data["segments"], units)
        raise InputError("segments: several motions, a cycle; its robots are those of a task file")
    except InputError as error:
        raise InputError(error.text, error.path, path.name) from None


def motion_origin(path: str | os.PathLike[str]) -> dict[str, str]:
    """Return what a motion file says about its robot: the texts `case` and `base`, those that it has."""
    path = Path(path)
    if is_bag(path):
        return {}
    text = read_text(path)
    try:
        data = _json(text) if text.lstrip().startswith("{") else {}
    except InputError as error:
        raise InputError(error.text, error.path, path.name) from None
    return {key: data[key] for key in ("case", "base") if isinstance(data.get(key), str)}


def _as_run(motion: Trajectory, controller: Any) -> Trajectory:
    """The motion that a controller makes of profile commands or a timed path, by entry `controller`."""
    try:
        slower, step = controller["slower"], controller["step_s"]
        if motion.profiles is not None:
            motion = motion.with_rise_times(motion.rise_times or controller["rise_time_s"])
        return controller_points(motion.slowed(slower), controller["name"], step=step)
    except (KeyError, TypeError):
        keys = "name, slower, step_s, rise_time_s"
        raise InputError(f"controller: expected a table with {keys}, got {controller!r}") from None


def _from_commands(data: Any, units: Sequence[str]) -> Trajectory:
    """Profile commands, or a path with its timing, exact or as a controller runs them."""
    motion = Trajectory.from_dict(data)
    require_units(data.get("units", ["deg"] * motion.n), units)
    _refuse_huge_commands(motion)
    if "controller" in data:
        return _as_run(motion, data["controller"])
    turning = np.array(data.get("units", ["deg"] * motion.n)) == "deg"
    if not {"units", "digest"} & data.keys():  # neither named nor written by ocptip itself
        doubt_degrees("start, commands", np.rad2deg(motion.angle_ranges[turning]))
    return motion


def _from_segments(rows: Any, units: Sequence[str]) -> Trajectory:
    """The motions of a cycle's plan."""
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise InputError("segments: expected a list of motions with start, commands and rest_s")
    motions, pauses = [], []
    for number, row in enumerate(rows, 1):
        with naming(f"segments[{number}]"):
            motions.append(_from_commands(row, units))
            pauses.append(positive_number("rest_s", row.get("rest_s", 0.0), zero_allowed=True))
            refuse_huge("rest_s", pauses[-1])
    return Trajectory.from_segments(motions, pauses)


def _refuse_huge_commands(motion: Trajectory) -> None:
    for number, joint in enumerate(motion.joints, start=1):
        refuse_huge(f"start[{number}]", joint.phi_start)
        for which, command in enumerate(joint.commands, start=1):
            for key, value in vars(command).items():
                refuse_huge(f"commands[{number}][{which}].{key}", value)


def _json(text: str) -> Any:
    """The data of a text; certificates, which may be beside a motion, are none."""
    data = parse_json(text)
    if isinstance(data, dict) and str(data.get("format", "")).startswith(CERTIFICATE):
        raise InputError("is a certificate; ocptip certify checks it")
    return data
