"""The `ocptip` command.

Exit codes: 0 yes (stable, verified), 1 no, 2 bad input, or too little disk, memory or open files. 3 is an
error in ocptip itself; the environment variable OCPTIP_DEBUG shows its traceback. 130 is an interrupt.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Sequence
from types import FrameType
from typing import Any, NoReturn

from ocptip.basics.interrupts import comes_again, interrupt, send_lost_again
from ocptip.basics.text import did_you_mean
from ocptip.cli.command import BAD_INPUT, FURTHER_CODES, INTERRUPTED, explained, say, stops
from ocptip.cli.commands import COMMANDS, GROUPS

_EXIT = 5.0  # s, that an interrupted process may take to end
_SAME = 1.0  # s, in which a second signal asks for nothing new


class _Parser(argparse.ArgumentParser):
    """Reports a wrong command line in one line on stderr."""

    command: argparse.ArgumentParser | None = None
    """Of the command whose options were parsed last."""

    def error(self, message: str) -> NoReturn:
        command = _Parser.command or self
        if message.startswith("unrecognized arguments: "):
            message += _near_option(message.split()[2], command)
        self.exit(BAD_INPUT, f"ocptip: {message} (see {command.prog} --help)\n")

    def parse_known_args(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, args: Any = None, namespace: Any = None
    ) -> Any:
        """As `argparse`, but options may stand anywhere among positional arguments."""
        words = list(sys.argv[1:] if args is None else args)
        _Parser.command = self if self._subparsers is None else None
        return super().parse_known_args(self._options_last(words), namespace)

    def _options_last(self, words: list[str]) -> list[str]:
        """Positional arguments, then options with their values; unchanged for the choice of a command.

        `argparse` gives an option that takes several values, or an optional one, all words up to the next
        option: it would refuse `--stops PLAN`. It also refuses positional arguments on both sides of one.
        """
        if self._subparsers is not None:
            return words
        actions = {name: one for one in self._actions for name in one.option_strings}
        end = words.index("--") if "--" in words else len(words)
        positional: list[str] = []
        options: list[str] = []
        k = 0
        while k < end:
            first, k = k, k + 1
            if not _is_option(words[first]):
                positional.append(words[first])
                continue
            if (action := actions.get(words[first])) and k < end and _takes_one(action, words[k]):
                options.append(f"{words[first]}={words[k]}")  # `argparse` takes "-80,20" for an option
                k += 1
                continue
            if action:
                k = min(k + self._count_values(action, words[k:end]), end)
            options += words[first:k]
        return (
            [*positional, *options] if end == len(words) else [*options, "--", *positional, *words[end + 1 :]]
        )

    def _count_values(self, action: Any, words: list[str]) -> int:
        """How many of the words after an option are its values."""
        if action.nargs is None or isinstance(action.nargs, int):
            return 1 if action.nargs is None else action.nargs
        most = 1 if action.nargs == "?" else len(words)
        others = (k for k, word in enumerate(words) if _is_option(word) or not action.accepts(word))
        count = min(next(others, len(words)), most)
        return max(count, 1) if action.nargs == "+" else count  # argparse refuses a first word that is wrong


def _near_option(word: str, parser: argparse.ArgumentParser) -> str:
    """The option that a wrong one may stand for, by its name, else by its help; "" if none is near."""
    helps = {one.option_strings[-1]: one.help or "" for one in parser._actions if one.option_strings}
    if not _is_option(word) and "--task" in helps:
        return "; a task file is given by --task TASK.toml"
    if not (name := re.escape(word.lstrip("-"))):
        return ""
    found = {option: re.search(rf"\b{name}\b", text, re.IGNORECASE) for option, text in helps.items()}
    about = {option: match.start() for option, match in found.items() if match}
    if 0 not in about.values() and (near := did_you_mean(word, helps)):
        return near
    return f"; did you mean {min(about, key=about.__getitem__)!r}?" if about else ""


def _is_option(word: str) -> bool:
    """Whether a word is an option, not a negative number or a name."""
    return word.startswith("-") and len(word) > 1 and not word[1].isdigit() and word[1] != "."


def _takes_one(action: argparse.Action, word: str) -> bool:
    """Whether a word that begins like a negative number is the one value of a long option."""
    return action.nargs is None and action.option_strings[0].startswith("--") and _is_negative(word)


def _is_negative(word: str) -> bool:
    return word.startswith("-") and len(word) > 1 and not _is_option(word)


class _Version(argparse.Action):
    """Looks the version up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> NoReturn:
        from ocptip.basics.version import version

        print(f"ocptip {version()}")
        parser.exit()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (argparse itself exits for --help and errors)."""
    try:
        code = _main(arguments)
    except KeyboardInterrupt:
        code = say(INTERRUPTED, "interrupted")
    except OSError as error:  # of --help and --version
        code = say(*explained(error))
    if arguments is None and code == INTERRUPTED:
        # Python's exit waits for the thread that writes to workers. Where the same signal ended these with a
        # full queue, some versions wait for ever (CPython issue 94777).
        threading.Thread(target=_exit_later, args=(code,), daemon=True).start()
    return code


def _exit_later(code: int) -> NoReturn:
    """End the process if it has not ended by itself."""
    time.sleep(_EXIT)
    os._exit(code)


def _main(arguments: Sequence[str] | None) -> int:
    """Run a command; every error becomes one line on stderr."""
    for stream in (sys.stdout, sys.stderr):
        if reconfigure := getattr(stream, "reconfigure", None):
            reconfigure(errors="backslashreplace")
    whole, words = parser(), list(sys.argv[1:] if arguments is None else arguments)
    if not words:
        whole.print_help()
        return 0
    _refuse_unknown(words, whole)
    options = whole.parse_args(words)
    if options.command is None:
        whole.error("no command given")
    command = next(c for c in COMMANDS if c.name == options.command)
    if arguments is None:  # a process of its own
        # OpenBLAS takes memory for each thread, and raises SIGINT at itself where it gets none.
        os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
        _stop_on_signals()
    try:
        from ocptip.cli.run import run  # loads NumPy, which --help does without

        return run(command, options, own_process=arguments is None)
    except KeyboardInterrupt as stop:
        return say(INTERRUPTED, f"interrupted {stop}".rstrip())
    except Exception as error:  # Python itself would exit with 1, which means "no"
        return say(*explained(error))


def _stop_on_signals() -> None:
    """Let Ctrl-C and SIGTERM stop the command, whose results are kept; a second signal ends it at once."""

    def stop(number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if not stops:
            stops.append((number, now))
        elif not comes_again(number):
            if now > stops[0][1] + _SAME:  # `timeout` sends its signal twice, which is one request
                os._exit(INTERRUPTED)
            return
        interrupt(KeyboardInterrupt, number, frame)

    send_lost_again()
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as of commands in the background
            signal.signal(number, stop)


def parser() -> argparse.ArgumentParser:
    """The whole command line."""
    whole = _Parser(
        prog="ocptip",
        description="Keeps standing robots standing: stability margins, base placement, arm motions, proofs.",
        epilog=f"{_listed()}\n\nexit codes: 0 yes, 1 no, {FURTHER_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="ocptip COMMAND ... | ocptip COMMAND --help",
        allow_abbrev=False,
    )
    whole.add_argument("-V", "--version", action=_Version, nargs=0, help="print the version and exit")
    commands = whole.add_subparsers(prog="ocptip", dest="command", metavar="COMMAND", help=argparse.SUPPRESS)
    for command in COMMANDS:
        command.add_to(commands)
    return whole


def _listed() -> str:
    """The commands by groups."""
    width = max(len(command.name) for command in COMMANDS)
    parts = []
    for group, commands in GROUPS.items():
        rows = [f"  {one.name:<{width}}  {one.help}" for one in commands]
        parts.append("\n".join([f"{group}:", *rows]))
    return "\n\n".join(parts)


def _refuse_unknown(words: Sequence[str], whole: argparse.ArgumentParser) -> None:
    """Refuse a command that does not exist, with the nearest one that does."""
    names = [command.name for command in COMMANDS]
    word = next(iter(words), "")
    if word and not word.startswith("-") and word not in names:
        whole.error(f"no such command: {word!r}{did_you_mean(word, names)}")
