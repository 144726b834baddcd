"""Reading motions from files: profile commands, points of trajectory controllers, samples as CSV."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.doubts import doubt_degrees
from ocptip.basics.errors import InputError, naming, positive_number, refuse_huge
from ocptip.basics.read import parse_json, parse_yaml, read_text
from ocptip.trajectories.bags import is_bag, motion_in_bag, refuse_of_other_files
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.read_csv import motion_from_csv, motion_of_table, require_units
from ocptip.trajectories.read_points import motion_of_points, trajectory_in
from ocptip.trajectories.trajectory import Trajectory

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
) -> Trajectory:
    """Read a motion from a file: profile commands, a joint trajectory, or CSV with samples.

    Ramp commands: JSON as :meth:`Trajectory.from_dict`; `plan.json` is one such file; where it names a
    controller, the motion is what that makes of them. Joint trajectory: JSON or YAML like
    `trajectory_msgs/JointTrajectory`, alone or in a message that holds one, angles in rad, lengths in m; the
    motion is what ROS 2's joint trajectory controller makes of it: quintic polynomials between points that
    have velocities and accelerations, cubic ones where accelerations are empty, straight lines where
    velocities are empty as well. The drives are assumed to spread the corners of these lines over one update
    of the controller. CSV: a header that names time, positions and, if at hand, speeds and accelerations of
    all joints, in any order, see `ocptip.trajectories.csv_columns`; other columns are left out. With
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

    Raises:
        InputError: the file cannot be read or holds no motion, or angles of a joint that slides; names file,
            and key or line and column.
    """
    return _read(path, names, units, unit, start, rate, columns, topic, several=False)


def load_motions(
    path: str | os.PathLike[str],
    names: Sequence[str] | None = None,
    units: Sequence[str] = (),
    *,
    unit: str | None = None,
    start: np.ndarray | None = None,
    rate: float | None = None,
    columns: Mapping[str, str | int] | None = None,
    topic: str | None = None,
) -> Trajectory:
    """Read a motion as :func:`load_motion` does, or the segments of the plan.json of a cycle.

    Raises:
        InputError: see :func:`load_motion`; names the segment.
    """
    return _read(path, names, units, unit, start, rate, columns, topic, several=True)


def _read(
    path: str | os.PathLike[str],
    names: Sequence[str] | None,
    units: Sequence[str],
    unit: str | None,
    start: np.ndarray | None,
    rate: float | None,
    columns: Mapping[str, str | int] | None,
    topic: str | None,
    *,
    several: bool,
) -> Trajectory:
    """The motion of a file; several motions only if they are wanted."""
    path = Path(path)
    bag = is_bag(path)
    refuse_of_other_files(bag, [topic] if topic else [], columns)
    found = motion_in_bag(path, names, topic) if bag else None
    text = "" if bag else read_text(path)
    try:
        if isinstance(found, dict):
            return motion_of_points(found, names, rate, start)
        if found is not None:
            return motion_of_table(found, names, units, "rad")
        if path.suffix.lower() in (".yaml", ".yml"):
            return motion_of_points(trajectory_in(parse_yaml(text)), names, rate, start)
        if not text.lstrip().startswith(("{", "[")):
            return motion_from_csv(text, names, units, unit, columns)
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
