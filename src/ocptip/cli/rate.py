"""`ocptip rate`: all performance indices of an arm or a platform in a pose, with their meaning."""

from __future__ import annotations

import argparse
import json
import math
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ocptip.cli.command import MOVES, STANDS, _print, _refuse

if TYPE_CHECKING:
    import numpy as np

    from ocptip.indices.entry import IndexEntry
    from ocptip.indices.metric import OperationEllipsoid
    from ocptip.robots.model import ArmModel

_WIDTH = 110
_URDF_SUFFIXES = (".urdf", ".xml")
_HEXAPOD = "6UPS"


def add_parser(commands: Any) -> None:
    """Add `rate` to the commands of the parser. Loads no numerics."""
    rate = commands.add_parser(
        "rate",
        help="how well conditioned is a pose of an arm or a platform?",
        description="Prints the performance indices of a pose: value, range, meaning.",
        epilog="exit code: 0 a regular pose, 1 a singular one, 2 bad input",
    )
    rate.add_argument(
        "robot",
        metavar="ROBOT",
        help="an arm (FP1W2F, FSFS, W1P1P2W2, IRB2000), a URDF file, the platform 6UPS, or a platform file "
        "(.toml)",
    )
    rate.add_argument(
        "pose",
        metavar="POSE",
        nargs="*",
        type=float,
        help="arm: joint angles, degrees; platform: x y z in m and rotation vector in degrees (default: its "
        "home pose)",
    )
    rate.add_argument(
        "--rates",
        metavar="W",
        nargs="+",
        type=float,
        help="joint rates (any unit) of a motion: rates it, too",
    )
    rate.add_argument(
        "--ellipsoid",
        metavar=("A", "B", "C"),
        nargs=3,
        type=float,
        help="half-axes of the operation ellipsoid along the axes of the gripper or platform frame, m "
        "(default for arms: sphere of 0.1)",
    )
    rate.add_argument(
        "--center", metavar=("X", "Y", "Z"), nargs=3, type=float, help="its centre in that frame, m (0 0 0)"
    )
    rate.add_argument("--base-link", metavar="LINK", help="URDF: link that rests")
    rate.add_argument("--tool-frame", metavar="FRAME", help="URDF: link or frame of the end-effector")
    rate.add_argument(
        "--lock",
        metavar="JOINT=DEG",
        action="append",
        default=[],
        help="URDF: joint that does not move, at this angle (sliding joints: JOINT=0.2m); may be repeated",
    )
    rate.add_argument("--json", action="store_true", help="print JSON instead of the table")
    rate.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Rate and print; returns the exit code."""
    from ocptip.basics.errors import InputError, OcptipError
    from ocptip.basics.write import versions

    try:
        data, text = _rate_platform(options) if _is_platform(options.robot) else _rate_arm(options)
    except InputError as error:
        return _refuse(f"{error}")
    except OcptipError as error:
        return _refuse(f"computation failed: {error}")
    data["versions"] = versions()
    _print(json.dumps(data, indent=2, allow_nan=False) if options.json else text)
    return MOVES if data["singular"] else STANDS


def _is_platform(robot: str) -> bool:
    return robot.upper() == _HEXAPOD or Path(robot).suffix.lower() == ".toml"


def _rate_arm(options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    import numpy as np

    from ocptip.basics.errors import InputError, bounded_array
    from ocptip.indices.arms.rate import rate_arm

    model = _arm(options)
    if len(options.pose) != model.n:
        raise InputError(f"POSE: {model.name} has {model.n} joints, got {len(options.pose)} angles (degrees)")
    q = np.radians(bounded_array("POSE", options.pose, (model.n,)))
    if options.rates is not None and len(options.rates) != model.n:
        raise InputError(f"--rates: {model.name} has {model.n} joints, got {len(options.rates)} rates")
    rating = rate_arm(model, q, ellipsoid=_ellipsoid(options), rates=options.rates)
    lines = [
        (
            "worst rates",
            _numbers(rating.operation.worst_rates, 3) + "  (joint rates that move the tool least)",
        )
    ]
    if rating.distance is not None and rating["dm_2"].status == "ok":
        step = np.degrees(rating.distance.step_2)
        lines.append(
            ("shortest way", _numbers(step, 1) + "  deg of joints 2 to 5 to the singularity (linearised)")
        )
    half_axes, center = rating.ellipsoid.half_axes, rating.ellipsoid.center
    lines.append(
        ("ellipsoid", f"half-axes {_numbers(half_axes, 4)} m, centre {_numbers(center, 4)} m, gripper frame")
    )
    outside = np.flatnonzero((q < model.limits.angle_min) | (q > model.limits.angle_max))
    if outside.size:
        lines.append(("note", f"outside of the joint limits: joint {', '.join(str(k + 1) for k in outside)}"))
    data = {**rating.to_dict(), "outside_limits": (outside + 1).tolist()}
    return data, _table(model.name, rating.singular, rating.entries, lines)


def _rate_platform(options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    from ocptip.basics.errors import InputError, bounded_array
    from ocptip.indices.platforms.rate import rate_platform
    from ocptip.indices.platforms.singular_motion import singular_motion
    from ocptip.task_files.platform_points import read_platform, rotation_from_degrees

    for name in ("rates", "base_link", "tool_frame", "lock"):
        if getattr(options, name):
            raise InputError(f"--{name.replace('_', '-')}: not for platforms")
    if options.robot.upper() == _HEXAPOD:
        from ocptip.indices.platforms.from_parallel import platform_of_robot
        from ocptip.parallel.description.ready_made import ups6

        file = platform_of_robot(ups6())
    else:
        file = read_platform(options.robot)
    position, rotation = file.position, file.rotation
    if options.pose:
        if len(options.pose) != 6:
            raise InputError(
                f"POSE: a platform needs x y z (m), rotation vector (deg), got {len(options.pose)} numbers"
            )
        position = bounded_array("POSE", options.pose[:3], (3,))
        rotation = rotation_from_degrees("POSE", bounded_array("POSE", options.pose[3:], (3,)))
    ellipsoid = _ellipsoid(options) or file.ellipsoid
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
    return data, _table(file.platform.name, pose.singular, entries, lines)


def _arm(options: argparse.Namespace) -> ArmModel:
    from ocptip.basics.errors import InputError
    from ocptip.published.arms import arm_by_name

    if Path(options.robot).suffix.lower() not in _URDF_SUFFIXES:
        for name in ("base_link", "tool_frame", "lock"):
            if getattr(options, name):
                raise InputError(f"--{name.replace('_', '-')}: only for URDF files")
        return arm_by_name(options.robot)
    for name in ("base_link", "tool_frame"):
        if getattr(options, name) is None:
            raise InputError(f"--{name.replace('_', '-')}: needed for a URDF file")
    from ocptip.robots.urdf import arm_from_urdf

    return arm_from_urdf(
        options.robot,
        base_link=options.base_link,
        tool_frame=options.tool_frame,
        locked_joints={name: _angle_or_length(value) for name, value in map(_lock, options.lock)},
    )


def _lock(text: str) -> tuple[str, str]:
    from ocptip.basics.errors import InputError

    name, equals, value = text.partition("=")
    if not (name and equals):
        raise InputError(f"--lock: expected JOINT=DEGREES or JOINT=LENGTHm, got {text!r}")
    return name, value


def _angle_or_length(text: str) -> float:
    """ "30" (degrees) in rad, "0.2m" in m."""
    from ocptip.basics.errors import InputError

    try:
        return float(text[:-1]) if text.endswith("m") else math.radians(float(text))
    except ValueError:
        raise InputError(f"--lock: expected JOINT=DEGREES or JOINT=LENGTHm, got {text!r}") from None


def _ellipsoid(options: argparse.Namespace) -> OperationEllipsoid | None:
    from ocptip.basics.errors import InputError
    from ocptip.indices.metric import OperationEllipsoid

    if options.ellipsoid is None:
        if options.center is not None:
            raise InputError("--center: needs --ellipsoid")
        return None
    center = (0.0, 0.0, 0.0) if options.center is None else options.center
    try:
        return OperationEllipsoid(center=center, half_axes=options.ellipsoid)
    except InputError as error:
        raise InputError(f"--ellipsoid: {error}") from None


def _table(
    robot: str,
    singular: bool,
    entries: tuple[IndexEntry, ...] | list[IndexEntry],
    lines: list[tuple[str, str]],
) -> str:
    verdict = "SINGULAR pose" if singular else "regular pose"
    rows = [("index", "value", "range", "meaning")]
    rows += [(e.symbol, _value(e), _range(e), _meaning(e)) for e in entries]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    text = [f"{robot}: {verdict}.", ""]
    for row in rows:
        head = "  ".join(f"{cell:<{width}}" for cell, width in zip(row[:3], widths, strict=True)) + "  "
        text.append(textwrap.fill(row[3], _WIDTH, initial_indent=head, subsequent_indent=" " * len(head)))
    width = max(len(name) for name, _ in lines)
    return "\n".join([*text, "", *(f"{name:<{width}}  {content}" for name, content in lines)])


def _value(entry: IndexEntry) -> str:
    if math.isnan(entry.value):
        return "-"
    number = "infinite" if math.isinf(entry.value) else f"{entry.value + 0.0:.4g}"
    return number if entry.unit == "1" else f"{number} {entry.unit}"


def _range(entry: IndexEntry) -> str:
    bounds = (f"{entry.lower:.3g}", "inf" if math.isinf(entry.upper) else f"{entry.upper:.3g}")
    return f"{bounds[0]} .. {bounds[1]}"


def _meaning(entry: IndexEntry) -> str:
    return entry.meaning if entry.status == "ok" else f"{entry.meaning} ({entry.status})"


def _numbers(values: np.ndarray, decimals: int) -> str:
    return ", ".join(f"{round(x, decimals) + 0.0:.{decimals}f}" for x in values)
