"""`ocptip completion`: a script that completes commands, options and files in a shell."""

from __future__ import annotations

import argparse
import re
from argparse import Namespace
from typing import Any

from ocptip.basics.errors import InputError
from ocptip.cli.command import Answer, Report
from ocptip.cli.main import parser


def run(options: Namespace) -> Report:
    """Print the script."""
    try:
        import shtab
    except ImportError:
        raise InputError("completion: needs the package shtab (pip install 'ocptip[completion]')") from None
    whole = parser()
    for action in whole._actions:
        if isinstance(action, argparse._SubParsersAction):
            action.help = "command"  # shtab leaves out what the help does not show
            for choice in action.choices.values():
                _complete_files(choice, shtab.FILE)
    script = shtab.complete(whole, shell=options.shell)
    return Answer(script, {"shell": options.shell, "script": script})


def _complete_files(command: argparse.ArgumentParser, files: Any) -> None:
    """Complete the names of files where the metavar of an argument names one."""
    for action in command._actions:
        if re.search(r"FILE|DIR|\.\w+|MOTION|PATH|ROBOT", f"{action.metavar}"):
            action.complete = files  # type: ignore[attr-defined]
