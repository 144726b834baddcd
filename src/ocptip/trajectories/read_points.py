"""Joint trajectories: messages of ROS 1 and ROS 2, and the motion that a controller makes of them.

ROS 2's joint trajectory controller (`joint_trajectory_controller/src/trajectory.cpp`) interpolates between
points by quintics, cubics or straight lines, whichever their fields allow. Before a first point after 0 s it
interpolates from where the robot is. So does this module.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ocptip.basics.doubts import doubt
from ocptip.basics.errors import InputError, finite_array, refuse_huge
from ocptip.basics.text import some
from ocptip.trajectories.controllers import UPDATE_RATE
from ocptip.trajectories.points import Points
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
    keys = next((own for own in _STAMPS if given and set(given) <= set(own)), ())
    parts = [given.get(key, 0) for key in keys]
    if not parts or not all(isinstance(v, int) and not isinstance(v, bool) for v in parts):
        raise InputError(
            f"points[{number}].time_from_start: expected sec and nanosec, or secs and nsecs, got {stamp!r}"
        )
    return parts[0] + 1e-9 * parts[1]
