"""The `ocptip` command.

Exit codes: 0 yes (it stands, it is verified), 1 no, 2 bad input, or too little disk, memory or open files,
3 an error in ocptip itself, with its traceback if OCPTIP_DEBUG is set in the environment, 130 interrupted.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NoReturn

from ocptip.cli.command import BAD_INPUT, INTERRUPTED, explained, say, stops
from ocptip.cli.commands import COMMANDS


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
    try:
        return _main(arguments)
    except KeyboardInterrupt:
        return say(INTERRUPTED, "interrupted")
    except OSError as error:  # of --help and --version
        return say(*explained(error))


def _main(arguments: Sequence[str] | None) -> int:
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    options = _parser().parse_args(arguments)
    command = next(c for c in COMMANDS if c.name == options.command)
    if arguments is None:  # a process of its own
        # OpenBLAS takes memory for each thread, and raises SIGINT at itself where it gets none.
        os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
        import_module("ocptip.numerics.few_cycles")
        _stop_on_signals()
    return command.execute(options, own_process=arguments is None)


def _stop_on_signals() -> None:
    """Let Ctrl-C and SIGTERM stop the command, whose results are kept; and remember that one came."""

    def stop(number: int, _: object) -> NoReturn:
        stops.append(number)
        raise KeyboardInterrupt

    def unraisable(lost: Any) -> None:
        if lost.exc_type is not KeyboardInterrupt:
            sys.__unraisablehook__(lost)

    sys.unraisablehook = unraisable  # callbacks of libraries cannot raise
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as of commands in the background
            signal.signal(number, stop)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="ocptip", description="Does it stand, with what reserve, and how sure is that?")
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add_to(commands)
    return parser
