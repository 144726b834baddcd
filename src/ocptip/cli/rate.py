"""`ocptip rate`: all performance indices of an arm or a platform in a pose, with their meaning."""

from __future__ import annotations

import math
import textwrap
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, bounded_array, naming
from ocptip.basics.toml import Table
from ocptip.basics.write import versions
from ocptip.cli.command import Answer, Report
from ocptip.cli.layout import named
from ocptip.cli.options import naming_options
from ocptip.cli.parallel import read_robot, with_ranges
from ocptip.cli.rate_along import rate_along
from ocptip.cli.rate_workspace import rate_workspace
from ocptip.indices.arms.rate import rate_arm
from ocptip.indices.meanings import IndexEntry
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.from_parallel import platform_of_robot
from ocptip.indices.platforms.parallel_robots import rate_parallel
from ocptip.indices.platforms.platform import PlatformFile
from ocptip.indices.platforms.rate import rate_platform
from ocptip.indices.platforms.singular_motion import singular_motion
from ocptip.parallel.description.ready_made import READY_MADE, ups6
from ocptip.parallel.robot import ParallelRobot
from ocptip.published.arms import arm_by_name
from ocptip.robots.model import ArmModel
from ocptip.robots.payload import Payload
from ocptip.robots.urdf import arm_from_urdf
from ocptip.robots.urdf_file import read_urdf
from ocptip.task_files.arm import arm_of_file
from ocptip.task_files.platform_points import read_platform, rotation_from_degrees

_WIDTH = 110
_URDF_SUFFIXES = (".urdf", ".xml")
_URDF_OPTIONS = ("base_link", "tool_frame", "lock")
_HEXAPOD = "6UPS"


def run(options: Namespace) -> Report:
    """Rate the arm or the platform in its pose."""
    _refuse_together(options)
    is_file = Path(options.robot).suffix.lower() == ".toml"
    keys = Table.read(Path(options.robot)) if is_file else {}
    name = options.robot.lower()
    hexapod, over = options.robot.upper() == _HEXAPOD, options.along or options.workspace
    if "leg" in keys or (name in map(str.lower, READY_MADE) and (over or not hexapod)):
        return _rate_parallel(options)
    is_platform = hexapod or (is_file and "arm" not in keys)
    return _rate_platform(options) if is_platform else _rate_arm(options)


def _rate_parallel(options: Namespace) -> Report:
    """A robot of `ocptip parallel` in a pose of its coordinates, or along a motion."""
    over = options.along or options.workspace
    tool = () if over else ("ellipsoid", "center")
    _refuse_given(options, ("rates", "payload", *tool, *_URDF_OPTIONS), "not for parallel robots")
    description = read_robot(options.robot)
    robot = ParallelRobot(with_ranges(description, options.range) if options.range else description)
    if options.along:
        return rate_along(robot, options, _ellipsoid(options))
    names, z = robot.description.platform.coordinates, robot.description.home
    if options.pose:
        if len(options.pose) != len(names):
            wanted = ", ".join(names)
            raise InputError(f"POSE: expected {wanted} (m, degrees), got {len(options.pose)} numbers")
        z = np.where([one.startswith("phi") for one in names], np.radians(options.pose), options.pose)
    if options.workspace:
        return rate_workspace(robot, z, options, _ellipsoid(options))
    entries, kinds = rate_parallel(robot, z)
    data = {
        "robot": robot.description.name,
        "kind": "parallel",
        "z": z.tolist(),
        "singular": bool(kinds),
        "kinds": list(kinds),
        "indices": [entry.to_dict() for entry in entries],
    }
    return _answer(entries, [("singular", ", ".join(kinds) or "nothing")], data)


def _rate_arm(options: Namespace) -> Report:
    _refuse_given(options, ("range",), "not for arms, whose file has the ranges")
    model = _arm(options).with_payload(_payload(options))
    if options.along:
        return rate_along(model, options, _ellipsoid(options))
    if len(options.pose) != model.n:
        raise InputError(f"POSE: {model.name} has {model.n} joints, got {len(options.pose)} angles (degrees)")
    q = np.radians(bounded_array("POSE", options.pose, (model.n,)))
    if options.workspace:
        return rate_workspace(model, q, options, _ellipsoid(options))
    if options.rates is not None and len(options.rates) != model.n:
        raise InputError(f"--rates: {model.name} has {model.n} joints, got {len(options.rates)} rates")
    rating = rate_arm(model, q, ellipsoid=_ellipsoid(options), rates=options.rates)
    worst = _numbers(rating.operation.worst_rates, 3)
    lines = [("worst rates", f"{worst}  (joint rates that move the tool least)")]
    if rating.distance is not None and rating["dm_2"].status == "ok":
        step = _numbers(np.degrees(rating.distance.step_2), 1)
        lines.append(("shortest way", f"{step}  deg of joints 2 to 5 to the singularity (linearised)"))
    half_axes, center = rating.ellipsoid.half_axes, rating.ellipsoid.center
    lines.append(
        ("ellipsoid", f"half-axes {_numbers(half_axes, 4)} m, centre {_numbers(center, 4)} m, gripper frame")
    )
    outside = np.flatnonzero((q < model.limits.angle_min) | (q > model.limits.angle_max))
    if outside.size:
        lines.append(("note", f"outside of the joint limits: joint {', '.join(str(k + 1) for k in outside)}"))
    payload = model.payload.to_dict() if model.payload else None
    if model.payload:
        lines.append(("payload", f"{model.payload.mass:.4g} kg, {model.payload}"))
    data = {**rating.to_dict(), "outside_limits": (outside + 1).tolist(), "payload": payload}
    return _answer(rating.entries, lines, data)


def _rate_platform(options: Namespace) -> Report:
    _refuse_given(options, ("rates", "payload", "range", *_URDF_OPTIONS), "not for platforms")
    hexapod = options.robot.upper() == _HEXAPOD
    file = platform_of_robot(ups6()) if hexapod else read_platform(options.robot)
    if options.along:
        return rate_along(file, options, _ellipsoid(options))
    position, rotation = file.position, file.rotation
    if options.pose:
        if len(options.pose) != 6:
            raise InputError(
                f"POSE: a platform needs x y z (m), rotation vector (deg), got {len(options.pose)} numbers"
            )
        position = bounded_array("POSE", options.pose[:3], (3,))
        rotation = rotation_from_degrees("POSE", bounded_array("POSE", options.pose[3:], (3,)))
    ellipsoid = _ellipsoid(options) or file.ellipsoid
    if options.workspace:
        at = PlatformFile(file.platform, position, rotation, ellipsoid)
        return rate_workspace(at, None, options, None)
    entries = rate_platform(file.platform, position, rotation, ellipsoid)
    pose = file.platform.at(position, rotation)
    motion = singular_motion(pose)
    lines = [
        ("least control", f"{_numbers(motion.screw, 3)}  (angular, linear velocity at the base origin)"),
        ("legs close to", motion.lines),
    ]
    data = {
        "robot": file.platform.name,
        "kind": "platform",
        "position": position.tolist(),
        "rotation": rotation.tolist(),
        "singular": pose.singular,
        "ellipsoid": None if ellipsoid is None else ellipsoid.to_dict(),
        "indices": [entry.to_dict() for entry in entries],
        "singular_motion": motion.to_dict(),
    }
    return _answer(entries, lines, data)


def _arm(options: Namespace) -> ArmModel:
    if Path(options.robot).suffix.lower() not in _URDF_SUFFIXES:
        _refuse_given(options, _URDF_OPTIONS, "only for URDF files")
        is_file = Path(options.robot).suffix.lower() == ".toml"
        return arm_of_file(options.robot) if is_file else arm_by_name(options.robot)
    wanted, file = [_lock(text) for text in options.lock], read_urdf(options.robot)
    locked: dict[str, float] = {}
    for slides in (False, True):
        try:
            own = {name: value for name, value, way in wanted if way == slides}
            locked |= file.locked(own, slides=slides)
        except InputError as error:
            raise InputError(f"--lock: {error}") from None
    names = {"base_link": options.base_link, "tool_frame": options.tool_frame}
    # Most indices need no masses; those that do say what is missing.
    with naming_options(*names):
        return arm_from_urdf(options.robot, **names, locked_joints=locked, accept_inertia=True)


def _payload(options: Namespace) -> Payload | None:
    if options.payload is None:
        return None
    mass, *place = options.payload
    if len(place) not in (0, 3):
        raise InputError(f"--payload: expected KG or KG X Y Z, got {len(options.payload)} numbers")
    try:
        return Payload(mass, place or (0.0, 0.0, 0.0))
    except InputError as error:
        raise InputError(f"--payload: {error}") from None


def _refuse_together(options: Namespace) -> None:
    """Refuse options that need others, or exclude each other."""
    if options.along and options.workspace:
        raise InputError("--workspace: not together with --along")
    for name in ("plot", "index"):
        if getattr(options, name) and not (options.along or options.workspace):
            raise InputError(f"--{name}: needs --along or --workspace")
    for name in ("cells", "range"):
        if getattr(options, name) is not None and not options.workspace:
            raise InputError(f"--{name}: needs --workspace")


def _refuse_given(options: Namespace, names: Sequence[str], why: str) -> None:
    for name in names:
        if getattr(options, name):
            raise InputError(f"--{name.replace('_', '-')}: {why}")


def _lock(text: str) -> tuple[str, float, bool]:
    """Joint and angle ("elbow=30", degrees) in rad, or position ("lift=0.2m") in m; whether it is such."""
    name, _, value = text.partition("=")
    try:
        if not name:
            raise ValueError
        slides = value.endswith("m")
        return name, float(value[:-1]) if slides else math.radians(float(value)), slides
    except ValueError:
        raise InputError(f"--lock: expected JOINT=DEGREES or JOINT=LENGTHm, got {text!r}") from None


def _ellipsoid(options: Namespace) -> OperationEllipsoid | None:
    if options.ellipsoid is None:
        if options.center is not None:
            raise InputError("--center: needs --ellipsoid")
        return None
    center = (0.0, 0.0, 0.0) if options.center is None else options.center
    with naming("--ellipsoid"):
        return OperationEllipsoid(center=center, half_axes=options.ellipsoid)


def _answer(entries: Sequence[IndexEntry], lines: list[tuple[str, str]], data: dict[str, Any]) -> Report:
    """Every index with its range and meaning, then the named lines."""
    rows = [("index", "value", "range", "meaning"), *map(_row, entries)]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    regular = not data["singular"]
    text = [f"{data['robot']}: {'regular' if regular else 'SINGULAR'} pose.", ""]
    for row in rows:
        head = "  ".join(f"{cell:<{width}}" for cell, width in zip(row[:3], widths, strict=True)) + "  "
        text.append(textwrap.fill(row[3], _WIDTH, initial_indent=head, subsequent_indent=" " * len(head)))
    text = "\n".join([*text, "", *named(lines)])
    return Answer(regular, text, {**data, "versions": versions()})


def _row(entry: IndexEntry) -> tuple[str, str, str, str]:
    """Symbol, value, range, meaning."""
    value = "infinite" if math.isinf(entry.value) else f"{entry.value + 0.0:.4g}"
    value = "-" if math.isnan(entry.value) else value if entry.unit == "1" else f"{value} {entry.unit}"
    upper = "inf" if math.isinf(entry.upper) else f"{entry.upper:.3g}"
    meaning = entry.meaning if entry.status == "ok" else f"{entry.meaning} ({entry.status})"
    return entry.symbol, value, f"{entry.lower:.3g} .. {upper}", meaning


def _numbers(values: np.ndarray, decimals: int) -> str:
    return ", ".join(f"{round(x, decimals) + 0.0:.{decimals}f}" for x in values)
