"""Runs any command: options in; text or JSON, files and exit code out."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from importlib import import_module
from typing import Any

from ocptip.basics.errors import InputWarning, naming
from ocptip.basics.outputs import require_replaceable_file
from ocptip.cli.command import Command, Report, explained, require_files, say
from ocptip.cli.layout import headline_of
from ocptip.cli.terminal import coloured, latest, lines_while
from ocptip.numerics.fork_server import cores, prepare_workers
from ocptip.numerics.threads import one_thread


def run(command: Command, options: argparse.Namespace, own_process: bool) -> int:
    """Run, write, print; returns the exit code."""
    _refuse_targets(command, options)
    if own_process and command.preload and options.jobs != 1 and not getattr(options, "scheduler", None):
        require_files(options.jobs or cores())
        prepare_workers(command.preload)  # they start while the command itself loads what it needs
    latest.quiet = options.quiet
    module = import_module(command.module)
    first = "" if command.group == "start" else "working ..."  # pages wait for their user

    def lines(first: str) -> AbstractContextManager[None]:
        return lines_while(sys.stderr, f"ocptip {command.name}", first) if own_process else nullcontext()

    with suspicions() as messages, one_thread, lines(first):
        report: Report = module.run(options)
    report.warnings, report.verbose = messages, options.verbose
    answer = report.to_text() if report.early and not options.json and not options.quiet else ""
    if answer:
        _print(answer)
    with lines("writing files ..."):
        failure = written(report)
    text = report.to_json() if options.json else report.to_text()
    if options.quiet and not options.json:
        text = "\n".join([headline_of(text), *report.unmet])
    if rest := text.removeprefix(answer).removeprefix("\n"):
        _print(rest)
    return report.exit_code if failure is None else say(*explained(failure))


def _refuse_targets(command: Command, options: argparse.Namespace) -> None:
    """Refuse, before anything is computed, to replace files that ocptip did not write."""
    given = [(name, path) for name in command.files if (path := getattr(options, name)) is not None]
    for name, path in given:
        with naming(f"--{name}"):
            for one in (path, os.path.splitext(path)[0] + ".h") if name == "c" else (path,):
                require_replaceable_file(one, overwrite=options.overwrite)


@contextmanager
def suspicions() -> Iterator[list[str]]:
    """Say what is suspicious about the input on stderr, and collect it; other warnings pass unchanged."""
    messages: list[str] = []
    with warnings.catch_warnings():
        others = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *rest: Any, **named: Any) -> None:
            if not issubclass(category, InputWarning):
                return others(message, category, *rest, **named)
            messages.append(f"{message}")
            with suppress(OSError):  # stderr may be full
                print(f"warning: {message}", file=sys.stderr)
            return None

        warnings.showwarning = show
        warnings.simplefilter("always", InputWarning)
        yield messages


def written(report: Report) -> OSError | None:
    """Write the files; an error is returned, not raised: a full disk must not cost the result."""
    try:
        for path in report.write():
            report.written.append(path)
    except OSError as error:
        return error
    return None


def _print(text: str) -> None:
    try:
        print(coloured(text, sys.stdout), flush=True)
    except OSError as error:
        # The reader (`| head`) has left, or the disk is full; Python would complain when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            raise OSError(error.errno, error.strerror, "stdout") from None
