"""The `ocptip` command: parses arguments, prints, and turns every expected error into one line.

Exit codes: 0 the base stands (the motion is verified), 1 it does not (or no verified answer was found), 2 bad
input, 3 an error in ocptip itself, with its traceback if OCPTIP_DEBUG is set in the environment.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from ocptip.cli.command import (
    BAD_INPUT,
    DEBUG,
    INTERNAL_ERROR,
    MOVES,
    STANDS,
    _kernels_are_compiled,
    _print,
    _refuse,
)


class _Parser(argparse.ArgumentParser):
    """Reports a wrong command line in one line on stderr."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"ocptip: {message} (see {self.prog} --help)\n")


class _Version(argparse.Action):
    """Looks the version up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> NoReturn:
        from ocptip.basics.version import version

        print(f"ocptip {version()}")
        parser.exit()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (argparse itself exits for --help and errors)."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    options = _parser().parse_args(arguments)
    try:
        return options.run(options)
    except Exception as error:  # Python itself would exit with 1, which means "does not stand"
        if os.environ.get(DEBUG):
            import traceback

            traceback.print_exc()
        text = " ".join(f"{type(error).__name__}: {error}".split())
        print(
            f"ocptip: internal error: {text}; please report it ({DEBUG}=1 shows the traceback)",
            file=sys.stderr,
        )
        return INTERNAL_ERROR


def _parser() -> argparse.ArgumentParser:
    from ocptip.cli.parallel import add_parser as add_parallel
    from ocptip.cli.place import add_parser as add_place
    from ocptip.cli.plan import add_parser as add_plan
    from ocptip.cli.rate import add_parser as add_rate

    parser = _Parser(prog="ocptip", description="Does it stand, with what reserve, and how sure is that?")
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    stand = commands.add_parser(
        "stand",
        help="verdict, reserves and contact forces of a scene",
        description="Does the base of a scene file stand? Prints verdict, contact forces and reserves.",
        epilog="exit code: 0 it stands, 1 it does not (or no verified answer), 2 bad input",
    )
    stand.add_argument("scene", metavar="SCENE.toml", help="the scene (format: see docs/scenes.md)")
    stand.add_argument("--json", action="store_true", help="print JSON instead of the table")
    stand.add_argument("--plot", metavar="FILE", help="draw the scene into a .png, .pdf or .svg file")
    stand.add_argument(
        "--gn-reference",
        metavar="NM",
        type=float,
        help="reference moment M0 of GN, N m (default: a tenth of the largest moment reserve at rest)",
    )
    stand.set_defaults(run=_stand)
    add_plan(commands)
    add_place(commands)
    _add_check(commands)
    add_rate(commands)
    add_parallel(commands)
    return parser


def _add_check(commands: argparse._SubParsersAction) -> None:
    check = commands.add_parser(
        "check",
        help="does a given motion keep all limits at every instant?",
        description="Checks a motion, or says what it violates and when: reserves, torques, clearance, "
        "speeds, accelerations, angles.",
        epilog="exit code: 0 the motion as given is verified, 1 it is not, 2 bad input",
    )
    check.add_argument("motion", metavar="MOTION", help="plan.json or other ramp commands, or samples as CSV")
    robot = check.add_mutually_exclusive_group()
    robot.add_argument("--case", metavar="A..H", help="a printed case (default: the one the motion names)")
    robot.add_argument("--task", metavar="TASK.toml", help="robot, support and limits of a task file")
    check.add_argument("--base", metavar="SET", help="base data of a case: printed or effective (default)")
    for option, text in (
        ("--gn", "largest tip-over reserve GN"),
        ("--gt", "largest slip reserve GT"),
        ("--torque-ratio", "largest joint torque, relative to its limit"),
        ("--clearance", "smallest clearance, m"),
    ):
        check.add_argument(option, metavar="X", type=float, help=f"{text} (default: that of the task)")
    check.add_argument(
        "--time-scale", metavar="F", type=float, nargs="+", default=[], help="check also with all times x F"
    )
    check.add_argument("--step", metavar="S", type=float, default=0.01, help="first spacing, s (0.01)")
    check.add_argument("--json", action="store_true", help="print JSON instead of the table")
    check.set_defaults(run=_check)


def _stand(options: argparse.Namespace) -> int:
    from ocptip.basics.errors import InputError, OcptipError

    try:
        # Here, not at the top: NumPy, SciPy and Numba take a second that --help need not wait for.
        from ocptip.cli.stand import check_plot_target, stand
        from ocptip.task_files.scene import read_scene

        if options.plot is not None:
            check_plot_target(options.plot)
        scene = read_scene(options.scene)
        if sys.stderr.isatty() and not _kernels_are_compiled():
            print("compiling the contact solver (first run only, some seconds) ...", file=sys.stderr)
        report = stand(scene, reference_moment=options.gn_reference)
        if options.plot is not None:
            from ocptip.pictures.scene import plot_scene

            plot_scene(scene, report.states, report.tip, report.slip, options.plot)
    except InputError as error:
        return _refuse(f"{error}")
    except OcptipError as error:
        return _refuse(f"computation failed: {error}")
    except OSError as error:
        return _refuse(f"{error.filename or options.plot}: {error.strerror or error}")
    _print(report.to_json() if options.json else report.to_text())
    return STANDS if report.persistent else MOVES


def _check(options: argparse.Namespace) -> int:
    from ocptip.basics.errors import InputError, OcptipError

    try:
        from pathlib import Path

        from ocptip.cli.check import check, choose_task, with_limits
        from ocptip.trajectories.read import load_motion

        motion = load_motion(options.motion)
        task = with_limits(
            choose_task(options.motion, options.case, options.base, options.task),
            gn=options.gn,
            gt=options.gt,
            torque_ratio=options.torque_ratio,
            clearance=options.clearance,
        )
        if sys.stderr.isatty() and not _kernels_are_compiled():
            print("compiling the contact solver (first run only, some seconds) ...", file=sys.stderr)
        name = Path(options.motion).name
        report = check(name, motion, task, factors=options.time_scale, step=options.step)
    except InputError as error:
        return _refuse(f"{error}")
    except OcptipError as error:
        return _refuse(f"computation failed: {error}")
    _print(report.to_json() if options.json else report.to_text())
    return STANDS if report.verified else MOVES
