"""Reading motions from files: ramp commands, points of trajectory controllers, samples as CSV."""

from __future__ import annotations

import csv
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.doubts import doubt_degrees
from ocptip.basics.errors import InputError, finite_array, refuse_huge
from ocptip.basics.toml import read_text
from ocptip.trajectories.arm_motion import ArmMotion
from ocptip.trajectories.controllers import controller_points
from ocptip.trajectories.sampled import REST, Motion, SampledMotion

_ENOUGH, _JUMP = 8, 4.0  # rows and ratio of accelerations from which a file counts as cut off
_NEAREST = 1e-4  # s: least distance of rows read from a file


_SAME = 1e-8  # rad, m and rad/s, m/s: rows at one time may differ by this (rounding)


_COLUMN = re.compile(r"(?P<kind>q|qd)(?P<joint>[1-9][0-9]*)_(?P<unit>deg|rad|m)(?P<per_second>_s)?")


def load_motion(
    path: str | os.PathLike[str], names: Sequence[str] | None = None, units: Sequence[str] = ()
) -> Motion:
    """Read a motion from a file: ramp commands, a joint trajectory, or CSV with samples.

    Ramp commands: JSON as :meth:`ArmMotion.from_dict`; `plan.json` is one such file; where it names a
    controller, the motion is what that makes of them. Joint trajectory: JSON
    or YAML like `trajectory_msgs/JointTrajectory`, angles in rad, lengths in m; the motion is what ROS 2's
    joint trajectory controller makes of it: quintic polynomials between points that have velocities and
    accelerations, cubic ones where accelerations are empty, straight lines where velocities are empty, too
    (whose corners the drives are taken to spread over the least distance of points).
    CSV: a header with the columns `time_s`, `q1_deg` .. `qn_deg` and, if at hand, `qd1_deg_s` .. `qdn_deg_s`
    (or `_rad`, `_rad_s`; of sliding joints `_m`, `_m_s`), in any order; other columns are ignored. A time may
    be repeated (left and right of a jump of the acceleration) if angles and speeds are the same.

    Args:
        path: the file.
        names: of the robot's joints; those of a joint trajectory are put into this order.
        units: "rad" or "m" per coordinate of the robot that is to move so; by default not looked at.

    Raises:
        InputError: the file cannot be read or holds no motion, or angles of a joint that slides; names file,
            and key or line and column.
    """
    path = Path(path)
    text = read_text(path)
    try:
        if path.suffix.lower() in (".yaml", ".yml"):
            return _from_points(_yaml(text), names)
        if text.lstrip().startswith(("{", "[")):
            data = _json(text)
            if isinstance(data, dict) and "points" in data:
                return _from_points(data, names)
            motion = ArmMotion.from_dict(data)
            _require_units(data.get("units", ["deg"] * motion.n), units)
            _refuse_huge_commands(motion)
            if "controller" in data:
                return _as_run(motion, data["controller"])
            turning = np.array(data.get("units", ["deg"] * motion.n)) == "deg"
            doubt_degrees("start, commands", np.rad2deg(motion.angle_ranges[turning]))
            return motion
        return _from_csv(text, units)
    except InputError as error:
        raise InputError(error.text, error.path, path.name) from None


def motion_origin(path: str | os.PathLike[str]) -> dict[str, str]:
    """Return what a motion file says about its robot: the texts `case` and `base`, those that it has."""
    path = Path(path)
    text = read_text(path)
    try:
        data = _json(text) if text.lstrip().startswith("{") else {}
    except InputError as error:
        raise InputError(error.text, error.path, path.name) from None
    return {key: data[key] for key in ("case", "base") if isinstance(data.get(key), str)}


def _as_run(motion: ArmMotion, controller: Any) -> SampledMotion:
    """What a controller makes of ramp commands, by the entry `controller` of plan.json."""
    try:
        slower, times = controller["slower"], {key: controller[f"{key}_s"] for key in ("step", "rise_time")}
        return controller_points(motion.time_scaled(slower), controller["name"], **times)
    except (KeyError, TypeError):
        keys = "name, slower, step_s, rise_time_s"
        raise InputError(f"controller: expected a table with {keys}, got {controller!r}") from None


def _require_units(given: Sequence[str], units: Sequence[str]) -> None:
    """Refuse angles of joints that slide, and ways of joints that turn."""
    if len(given) == len(units):  # other numbers of joints are refused by the robot
        for joint, (own, unit) in enumerate(zip(given, units, strict=True), 1):
            if (own == "m") != (unit == "m"):
                slides = "moves in m" if unit == "m" else "turns"
                raise InputError(f"units: joint {joint} {slides}, but the motion gives {own}")


def _refuse_huge_commands(motion: ArmMotion) -> None:
    for number, joint in enumerate(motion.joints, start=1):
        refuse_huge(f"start[{number}]", joint.phi_start)
        for which, command in enumerate(joint.commands, start=1):
            for key, value in vars(command).items():
                refuse_huge(f"commands[{number}][{which}].{key}", value)


def _json(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"broken JSON: {error}") from None
    except RecursionError:
        raise InputError("broken JSON: nested too deeply") from None


def _yaml(text: str) -> Any:
    import yaml

    try:
        return next(iter(yaml.safe_load_all(text)), None)
    except yaml.YAMLError as error:
        raise InputError(f"broken YAML: {' '.join(str(error).split())}") from None


def _from_points(data: Any, names: Sequence[str] | None) -> SampledMotion:
    """The motion of a joint trajectory, see :func:`load_motion`."""
    if not isinstance(data, dict) or not isinstance(data.get("points"), list):
        raise InputError("points: expected a joint trajectory with joint_names and a list of points")
    joints, points = data.get("joint_names"), data["points"]
    if not isinstance(joints, list) or not all(isinstance(name, str) for name in joints):
        raise InputError(f"joint_names: expected a list of names, got {joints!r}")
    order = list(range(len(joints)))
    if names is not None:
        if sorted(joints) != sorted(names):
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
        columns[key] = np.reshape(rows, (-1, len(joints)))[:, order]
        refuse_huge(key, float(np.max(np.abs(columns[key]), initial=0.0)))
    speeds, gaps = columns.get("velocities"), np.diff(times)
    period = float(np.min(gaps)) if speeds is None and len(gaps) and np.all(gaps > 0) else None
    return SampledMotion(times, columns["positions"], speeds, columns.get("accelerations"), period)


def _stamp(number: int, point: Any) -> float:
    """Time of a point, s."""
    stamp = point.get("time_from_start") if isinstance(point, dict) else None
    parts = [stamp.get(key, 0) for key in ("sec", "nanosec")] if isinstance(stamp, dict) else []
    if not parts or not all(isinstance(v, int) and not isinstance(v, bool) for v in parts):
        raise InputError(f"points[{number}].time_from_start: expected sec and nanosec, got {stamp!r}")
    return parts[0] + 1e-9 * parts[1]


def _from_csv(text: str, units: Sequence[str]) -> SampledMotion:
    lines = [(k, row) for k, row in enumerate(csv.reader(text.splitlines()), 1) if any(map(str.strip, row))]
    if not lines:
        raise InputError(
            "is empty; expected ramp commands, a joint trajectory, or columns time_s, q1_deg, q2_deg, ..."
        )
    header = [name.strip() for name in lines[0][1]]
    time, angles, speeds = _columns(header)
    for columns in filter(None, (angles, speeds)):
        _require_units([header[c].split("_")[1] for c in columns], units)
    wanted = [time, *angles, *speeds]
    table = np.empty((len(lines) - 1, len(wanted)))
    for row, (number, cells) in enumerate(lines[1:]):
        if len(cells) != len(header):
            raise InputError(
                f"line {number}: expected {len(header)} values as in the header, got {len(cells)}"
            )
        table[row] = [_cell(number, header[c], cells[c]) for c in wanted]
    table[:, 1:] *= [np.deg2rad(1.0) if "_deg" in header[c] else 1.0 for c in wanted[1:]]
    for row in range(1, len(table)):
        later = table[row, 0] - table[row - 1, 0]
        if later < 0:
            raise InputError(
                f"line {lines[row + 1][0]}: time_s {table[row, 0]:.9g} comes after {table[row - 1, 0]:.9g}"
            )
        if later == 0 and np.abs(table[row, 1:] - table[row - 1, 1:]).max() > _SAME:
            raise InputError(
                f"line {lines[row + 1][0]}: time_s {table[row, 0]:.9g} again, with other angles or speeds"
            )
    table, n = _spaced(table), len(angles)
    motion = SampledMotion(table[:, 0], table[:, 1 : n + 1], table[:, n + 1 :] if speeds else None)
    if not speeds:
        _refuse_cut(motion.times, motion.angles)
    in_degrees = [joint for joint, column in enumerate(angles) if header[column].endswith("_deg")]
    doubt_degrees("columns q_deg", np.rad2deg(motion.angles[:, in_degrees]))
    return motion


def _refuse_cut(times: np.ndarray, angles: np.ndarray) -> None:
    """Refuse angles (N, n) that begin or end in full motion, as those of a file that is cut off.

    A motion comes to rest in about the way in which it moves otherwise: the acceleration that would take the
    speed between the last two samples to zero is of the size of the others.
    """
    if len(times) < _ENOUGH:
        return
    widths = np.diff(times)[:, None]
    speeds = np.diff(angles, axis=0) / widths
    inside = np.max(np.abs(np.diff(speeds, axis=0)) / (0.5 * (widths[1:] + widths[:-1])), axis=0)
    ends = 2 * np.abs(speeds[[0, -1]]) / widths[[0, -1]]
    for end, (where, verb) in zip((0, -1), (("first", "begins"), ("last", "ends")), strict=True):
        usual = np.maximum(inside, ends[-1 - end])
        moving = (np.abs(speeds[end]) > REST) & (ends[end] > _JUMP * usual)
        if moving.any():
            joint = int(np.argmax(moving))
            raise InputError(
                f"the motion {verb} before it rests: between the {where} two rows joint {joint + 1} moves "
                f"with {abs(speeds[end, joint]):.4g} rad/s (or m/s); is the file cut off?"
            )


def _spaced(table: np.ndarray) -> np.ndarray:
    """The rows whose times (first column) are not too near to the one kept before; the last row always."""
    kept: list[int] = []
    for row, time in enumerate(table[:, 0]):
        if not kept or time - table[kept[-1], 0] >= _NEAREST:
            kept.append(row)
    if kept and kept[-1] != len(table) - 1:
        if len(kept) > 1:
            kept.pop()
        kept.append(len(table) - 1)
    return table[kept]


def _columns(header: Sequence[str]) -> tuple[int, list[int], list[int]]:
    """Column of the time, columns of the joints' angles, and of their speeds if there are any."""
    if header.count("time_s") != 1:
        raise InputError(f"header: expected one column time_s, got {', '.join(header)}")
    found: dict[str, dict[int, int]] = {"q": {}, "qd": {}}
    for column, name in enumerate(header):
        match = _COLUMN.fullmatch(name)
        if match is None or (match["kind"] == "qd") != bool(match["per_second"]):
            continue
        joints, joint = found[match["kind"]], int(match["joint"])
        if joint in joints:
            raise InputError(f"header: {header[joints[joint]]} and {name} are the same quantity")
        joints[joint] = column
    n = max([0, *found["q"], *found["qd"]])
    for kind, example in (("q", "deg"), ("qd", "deg_s")):
        missing = [joint for joint in range(1, n + 1) if joint not in found[kind]]
        if (kind == "q" or found[kind]) and (missing or not n):
            raise InputError(f"header: {kind}{(missing or [1])[0]}_{example} is missing")
    angles, speeds = ([found[kind][joint] for joint in sorted(found[kind])] for kind in ("q", "qd"))
    return header.index("time_s"), angles, speeds


def _cell(line: int, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"line {line}, {name}: expected a number, got {text!r}") from None
    if not np.isfinite(value):
        raise InputError(f"line {line}, {name}: must be finite, got {text.strip()}")
    refuse_huge(f"line {line}, {name}", value)
    return value
