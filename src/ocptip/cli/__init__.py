"""The `ocptip` command: parses arguments, prints, and turns every expected error into one line.

Exit codes: 0 the base stands, 1 it does not (or no verified answer was found), 2 bad input.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

STANDS, MOVES, BAD_INPUT = 0, 1, 2


class _Parser(argparse.ArgumentParser):
    """Reports a wrong command line in one line on stderr."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"ocptip: {message} (see {self.prog} --help)\n")


class _Version(argparse.Action):
    """Looks the version up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> NoReturn:
        import ocptip

        print(f"ocptip {ocptip.__version__}")
        parser.exit()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (argparse itself exits for --help and errors)."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    options = _parser().parse_args(arguments)
    return options.run(options)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="ocptip", description="Does it stand, with what reserve, and how sure is that?")
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    stand = commands.add_parser(
        "stand",
        help="verdict, reserves and contact forces of a scene",
        description="Does the base of a scene file stand? Prints verdict, contact forces and reserves.",
        epilog="exit code: 0 it stands, 1 it does not (or no verified answer), 2 bad input",
    )
    stand.add_argument("scene", metavar="SCENE.toml", help="the scene (format: see README)")
    stand.add_argument("--json", action="store_true", help="print JSON instead of the table")
    stand.add_argument("--plot", metavar="FILE", help="draw the scene into a .png, .pdf or .svg file")
    stand.add_argument(
        "--gn-reference",
        metavar="NM",
        type=float,
        help="reference moment M0 of GN, N m (default: a tenth of the largest moment reserve at rest)",
    )
    stand.set_defaults(run=_stand)
    return parser


def _stand(options: argparse.Namespace) -> int:
    from ocptip.errors import InputError, OcptipError

    try:
        # Here, not at the top: NumPy, SciPy and Numba take a second that --help need not wait for.
        from ocptip.cli.stand import check_plot_target, stand
        from ocptip.scene import read_scene

        if options.plot is not None:
            check_plot_target(options.plot)
        scene = read_scene(options.scene)
        if sys.stderr.isatty() and not _kernels_are_compiled():
            print("compiling the contact solver (first run only, some seconds) ...", file=sys.stderr)
        report = stand(scene, reference_moment=options.gn_reference)
        if options.plot is not None:
            from ocptip.plots import plot_scene

            plot_scene(scene, report.states, report.tip, report.slip, options.plot)
    except InputError as error:
        return _refuse(f"{error}")
    except OcptipError as error:
        return _refuse(f"computation failed: {error}")
    except OSError as error:
        return _refuse(f"{error.filename or options.plot}: {error.strerror or error}")
    _print(report.to_json() if options.json else report.to_text())
    return STANDS if report.persistent else MOVES


def _print(text: str) -> None:
    try:
        print(text, flush=True)
    except BrokenPipeError:
        # The reader (`| head`) has left; without this Python would complain when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _refuse(message: str) -> int:
    print("ocptip: " + message.replace("\n", " "), file=sys.stderr)
    return BAD_INPUT


def _kernels_are_compiled() -> bool:
    """True if Numba's cache holds the solver (where the cache is: beside the source, or in the user's)."""
    from pathlib import Path

    from ocptip.contact import pivoting

    cache = Path(pivoting.solve_batch.stats.cache_path or os.devnull)
    return any(cache.glob("pivoting.solve_batch-*.nbi"))
