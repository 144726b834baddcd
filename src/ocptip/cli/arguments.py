"""Arguments that several commands share. Loads no numerics."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from typing import Any

Argument = Callable[[Any], None]
"""Adds itself to a parser, or to a group of one."""


def argument(
    name: str,
    metavar: str | tuple[str, ...] | None,
    text: str,
    *,
    accepts: Callable[[str], bool] | None = None,
    **options: Any,
) -> Argument:
    """An argument with its help, as `argparse` takes it.

    Args:
        name: with "--" of an option.
        metavar: what stands for its value in the help.
        text: its help.
        accepts: whether a word can be one of its values, for options that take several; default: whatever
            `type` and `choices` accept.
        options: of `argparse.ArgumentParser.add_argument`.
    """
    if metavar:
        options["metavar"] = metavar

    def add(parser: Any) -> None:
        action = parser.add_argument(name, help=text, **options)
        action.accepts = accepts or _accepted(action.type, action.choices)

    return add


def either(*arguments: Argument) -> Argument:
    """Arguments of which at most one may be given."""

    def add(parser: Any) -> None:
        exclusive = parser.add_mutually_exclusive_group()
        for one in arguments:
            one(exclusive)

    return add


def group(title: str, *arguments: Argument) -> Argument:
    """Arguments under a separate title in the help."""

    def add(parser: Any) -> None:
        under = parser.add_argument_group(title)
        for one in arguments:
            one(under)

    return add


def _accepted(convert: Callable[[str], Any] | None, choices: Any) -> Callable[[str], bool]:
    def accepts(word: str) -> bool:
        if choices is not None:
            return word in choices
        try:
            return convert is None or convert(word) is not None
        except ValueError:
            return False

    return accepts


_STOPS = ("path", "brakes", "both", "cancel", "all")


def is_range(word: str) -> bool:
    """NAME=LOW:HIGH."""
    return "=" in word


def is_index(word: str) -> bool:
    """The name of a performance index, such as dm_2; robots are in capitals, or files."""
    return re.fullmatch(r"[a-z][a-z0-9_]*", word) is not None


TOLERANCE = argument(
    "--tolerance",
    "SET",
    "uncertainty of floor, masses, friction and drives: none, workshop (default), "
    "site, or a TOML file with [tolerance]",
)
LIMITS = group(
    "limits",
    *(
        argument(option, unit, f"{text} (default: as in the task, or {default})", type=float)
        for option, unit, text, default in (
            ("--gn", "X", "maximum tip-over index GN; 1: a contact lifts", 0.9),
            ("--gt", "X", "maximum friction utilisation GT; 1: a contact slips", 0.9),
            ("--torque-ratio", "X", "maximum torque / torque limit of any joint", 1),
            ("--clearance", "M", "minimum distance between colliding bodies, m", 0.01),
            ("--foot-lift", "M", "maximum lift of a compliant foot, m", 0),
            ("--tcp-speed", "V", "maximum speed of the TCP, m/s", "none"),
        )
    ),
    TOLERANCE,
)
JOBS = argument("--jobs", "N", "processes (default: one per core)", type=int)
SCHEDULER = argument("--scheduler", "ADDRESS", "run on the workers of a Dask cluster at this address")
SEED = argument("--seed", "N", "seed of the random numbers (default: 0)", type=int, default=0)
OUT = group(
    "files",
    argument(
        "--out", "DIR", "output folder (default: ocptip-COMMAND-NAME); for several tasks DIR/NAME of each"
    ),
    argument("--overwrite", None, "replace files that ocptip did not write", action="store_true"),
    argument("--no-figures", None, "write no figures", action="store_true"),
)
BASE_DESIGN = group(
    "design of the base",
    argument(
        "--ballast",
        "KG",
        "also with so much more mass at the centre of mass of the base, kg",
        nargs="+",
        type=float,
        default=[],
    ),
    argument(
        "--foot-width",
        "F",
        "also with distances of the contacts from their middle times F",
        nargs="+",
        type=float,
        default=[],
    ),
    argument(
        "--speed-override",
        "F",
        "also with joint speeds times F and joint accelerations times its square",
        nargs="+",
        type=float,
        default=[],
    ),
)

DESIGN = argument(
    "--design",
    None,
    "print how narrow the feet and how light the base may be within the uncertainty",
    action="store_true",
)
SENSITIVITIES = argument(
    "--sensitivities", None, "list which changes would help, and by how much", action="store_true"
)
MOTION_OF = (
    either(
        argument("--case", "A..H", "the motion belongs to a published case (default: as the file says)"),
        argument("--task", "TASK.toml", "the motion belongs to this task (default: as the folder says)"),
    ),
    argument("--base", "SET", "base data of a published case: printed or effective (default)"),
)
COST_PER_SECOND = argument(
    "--price-per-second", "W", "minimise energy + W joules per second of duration", type=float
)
RATE = argument(
    "--rate",
    "HZ",
    "points per second for the controller (default: 100; linear: its update rate, 500)",
    type=float,
)
EFFORT = argument("--effort", None, "write torques into trajectory.json", action="store_true")
MAX_DURATION = argument("--max-duration", "S", "maximum duration of the motion, s", type=float)
UNIT = argument("--unit", None, "unit of angles in columns without one", choices=("deg", "rad"))
COLUMNS = argument(
    "--columns",
    "FILE.toml",
    "map of CSV columns: a table [columns] with name = title or number, names as in motion.csv",
)
TOPIC = argument(
    "--topic",
    "NAME",
    "topic of a bag; NAME#2: the second trajectory there (default: the only one of a known type)",
)
BAG = argument("--bag", "DIR", "write trajectory and margins over time as a bag of ROS 2 (MCAP)")
TOPICS = argument(
    "--topic",
    "NAME",
    "topic of a bag: joint states, or the wrench of the sensor in the base; may be repeated",
    action="append",
    dest="topics",
    default=[],
)
CANCEL = (
    argument(
        "--deceleration",
        "D",
        "deceleration of a cancelled controller, deg/s^2 (sliding joints: m/s^2), one number, or one per "
        "joint with commas; or a share of the acceleration limits, 46%% (default: as in the task, or 100%%); "
        "or `stopj(4)` of Universal Robots, rad/s^2: all joints stop together (for check alone)",
    ),
    argument("--reaction", "MS", "maximum time from a cancel until joints decelerate, ms", type=float),
)
GATE = group(
    "gate for pipelines",
    argument(
        "--require",
        "TEXT",
        "bounds that must hold for exit code 0, such as 'tilt >= 5 deg, push >= 20 N, friction used <= 80 "
        "%%'",
    ),
    argument("--junit", "FILE", "write verdict and requirements as a JUnit report (XML)"),
)


def drive_profile(more: str = "") -> Argument:
    """The motion of the base of a command; `more` ends its help."""
    return argument(
        "--drive-profile",
        "PROFILE",
        "how the base drives meanwhile: CSV with velocities (v, w) or a course (x, y, yaw), a bag, or "
        f"'2 m, 0.8 m/s, 1 m/s^2'{more}",
    )


BASE_LIMITS = argument(
    "--base-limits",
    "LIMITS",
    "PATH also has x, y and yaw of the base, timed together with the arm within these limits, such as "
    "'1 m/s, 1 m/s^2, 60 deg/s, 90 deg/s^2, 300 N' (force of all drives)",
)
FILE_OF_MOTION = group(
    "format of the motion",
    COLUMNS,
    TOPIC,
    argument(
        "--rate",
        "HZ",
        "update rate of the controller that interpolates points without speeds (default: 500)",
        type=float,
    ),
    UNIT,
    argument(
        "--rise-time",
        "S",
        "rise time of accelerations of profile commands, s (default: as in the motion or the task)",
        type=float,
    ),
)
BASE_LINK = argument("--base-link", "LINK", "link at rest in the URDF (default: root, or the driven base)")
TOOL_FRAME = argument("--tool-frame", "FRAME", "end-effector link in the URDF (default: detected by name)")


def objective(default: str) -> Argument:
    """The option for the quantity that a plan minimises."""
    text = f"what is minimised (default: {default})"
    return argument("--objective", None, text, choices=("energy", "time", "both"))


def time_scale(text: str) -> Argument:
    """Factors of the duration that are also checked."""
    return argument("--time-scale", "F", text, type=float, nargs="+", default=[])


def stops(name: str, text: str, default: str) -> Argument:
    """Protective stops; without a value `default`."""

    def kind(word: str) -> str:
        if word not in (*_STOPS, default):
            raise argparse.ArgumentTypeError(
                f"must be {', '.join(_STOPS[:-1])} or {_STOPS[-1]}, got {word!r}"
            )
        return word

    return argument(
        name, "|".join(_STOPS), text, nargs="?", const=default, type=kind, accepts=_STOPS.__contains__
    )
