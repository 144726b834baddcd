"""What can be typed, what commands answer, and what errors they end with. Loads no numerics."""

from __future__ import annotations

import argparse
import errno
import json
import os
import sys
import traceback
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from ocptip.cli.arguments import Argument

try:
    import resource
except ImportError:  # Windows
    resource = None

YES, NO, BAD_INPUT, INTERNAL_ERROR, INTERRUPTED = 0, 1, 2, 3, 130
DEBUG = "OCPTIP_DEBUG"
FOR_PLANS = (
    *("ocptip.motion.plan", "ocptip.certificate.checks", "ocptip.motion.planner.kernels"),
    *("scipy.spatial", "clarabel"),  # each process would load them on its first check
)
"""Modules that are loaded by processes which plan."""
stops: list[tuple[int, float]] = []
"""Signals that asked this process to stop."""
FURTHER_CODES = f"{BAD_INPUT} bad input, {INTERNAL_ERROR} internal error, {INTERRUPTED} interrupted"
_FILES, _FILES_PER_JOB = 32, 8
_LONGEST = 4000  # characters of a message
_NO_MEMORY = "Cannot allocate memory", "bad_alloc", "libllvmlite"  # which is large


@dataclass
class Report(ABC):
    """The answer of a command, as text, as data and as files.

    Attributes:
        yes: the answer is yes: it stands, it is verified. Commands that only make something say yes.
        written: the files that were written.
        warnings: what was suspicious about the input.
        verbose: the text has all details.
        early: the text ends with the files, and the part before them is printed before they are written.
    """

    early: ClassVar[bool] = False
    yes: bool = field(default=True, kw_only=True)
    written: list[Path] = field(default_factory=list, init=False)
    warnings: list[str] = field(default_factory=list, init=False)
    verbose: bool = field(default=False, init=False)

    @property
    def good(self) -> bool:
        """Whether the answer is yes, in the end."""
        return self.yes

    @property
    def unmet(self) -> list[str]:
        """Lines that follow the verdict with --quiet: the requirements that are not met, or that all are."""
        return []

    @abstractmethod
    def to_text(self) -> str:
        """The answer for people. ASCII only, but for names."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The answer as data."""

    def to_json(self) -> str:
        """The answer as strict JSON; what is not finite becomes null."""
        from ocptip.basics.write import plain

        data = {**self.to_dict(), "warnings": self.warnings}
        return json.dumps(plain(data), indent=2, allow_nan=False)

    def write(self) -> Iterator[Path]:
        """Write the files that were asked for, and name each when it is complete."""
        return iter(())

    @property
    def exit_code(self) -> int:
        """Exit code of the command."""
        return YES if self.good else NO


@dataclass
class ResultReport(Report):
    """A report on what a function of the API returned.

    Attributes:
        found: the result.
        out: file that it is saved to; None: nowhere.
    """

    result: Any
    out: str | Path | None = None

    def to_dict(self) -> dict[str, Any]:
        """The result as data."""
        return self.result.to_dict()

    def write(self) -> Iterator[Path]:
        """The file that was asked for."""
        if self.out is not None and (path := self.result.save(self.out)) is not None:
            yield path


@dataclass
class FolderReport(Report):
    """A report on a result that writes a folder.

    Attributes:
        found: the result.
        directory: where files go.
        figures: whether figures are among them.
    """

    result: Any
    directory: Path
    figures: bool

    def to_dict(self) -> dict[str, Any]:
        """The result as data, and the list `written`."""
        return {**self.result.to_dict(), "written": self.written}

    def write(self) -> Iterator[Path]:
        """The files of the result."""
        yield from self.result.write(self.directory, figures=self.figures, extra={"warnings": self.warnings})


@dataclass
class Answer(Report):
    """A report that is complete from the start, for commands that write no files.

    Attributes:
        text, data: what `to_text` and `to_dict` return.
    """

    text: str
    data: dict[str, Any]

    def to_text(self) -> str:
        """The text."""
        return self.text

    def to_dict(self) -> dict[str, Any]:
        """The data."""
        return self.data


@dataclass(frozen=True)
class Command:
    """A command; the function `run` of the module `cli/<group>/<name>.py` turns its options into a report.

    Attributes:
        name: as it is typed.
        help: for the list of commands.
        description: for the help of the command.
        codes: what the exit codes 0 and 1 mean.
        arguments: without those that every command has.
        preload: modules that its processes need.
        files: options that name files which are written.
        group: in the help, and folder of its module.
    """

    name: str
    help: str
    description: str
    codes: str
    arguments: Sequence[Argument]
    preload: Sequence[str] = ()
    files: Sequence[str] = ()
    group: str = ""

    @property
    def module(self) -> str:
        """The module whose function `run` answers."""
        return f"ocptip.cli.{self.group.replace(' ', '_')}.{self.name}"

    def add_to(self, commands: Any) -> None:
        """Add it to the subparsers of the command line."""
        epilog = f"exit codes: {self.codes}, {FURTHER_CODES}"
        parser = commands.add_parser(
            self.name, help=self.help, description=self.description, epilog=epilog, allow_abbrev=False
        )
        for add in self.arguments:
            add(parser)
        parser.usage = f"ocptip {self.name} [options] {_positionals(parser)}"
        if self.files and "--overwrite" not in parser._option_string_actions:
            named = f"replace {' and '.join(f'--{name}' for name in self.files)}, written by ocptip or not"
            parser.add_argument("--overwrite", action="store_true", help=named)
        output = parser.add_argument_group("output").add_mutually_exclusive_group()
        output.add_argument("--json", action="store_true", help="print JSON instead of text")
        output.add_argument("-v", "--verbose", action="store_true", help="print all details")
        output.add_argument("-q", "--quiet", action="store_true", help="print the verdict only, no progress")


def _positionals(parser: argparse.ArgumentParser) -> str:
    """Positional arguments in words, for the first line of the help."""
    words = []
    for action in parser._actions:
        if not action.option_strings:
            word = f"{action.metavar or '|'.join(action.choices or [action.dest])}"
            more = f"{word} ..." if action.nargs in ("+", "*") else word
            words.append(f"[{more}]" if action.nargs in ("?", "*") else more)
    return " ".join(words)


def require_files(jobs: int) -> None:
    """Raise OSError where the system allows this process fewer open files than its workers need."""
    if resource is None:
        return
    limit, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = _FILES + _FILES_PER_JOB * jobs
    if most == resource.RLIM_INFINITY or limit < needed <= most:
        limit = max(limit, needed)
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, most))
    if limit < needed:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))


def explained(error: Exception) -> tuple[int, str]:
    """The exit code, and the message."""
    causes = list(_causes(error))
    # Libraries turn an interruption into an error of theirs, or lose it in a callback and fail later.
    if stops or any(isinstance(cause, KeyboardInterrupt) for cause in causes):
        return INTERRUPTED, "interrupted"
    if lack := next(filter(None, map(_lack, causes)), ""):
        return BAD_INPUT, lack
    from ocptip.basics.errors import InputError, OcptipError

    if isinstance(error, InputError):
        return BAD_INPUT, f"{error}"
    if isinstance(error, OcptipError):
        return BAD_INPUT, f"computation failed: {error}"
    if isinstance(error, OSError) and error.filename:
        return BAD_INPUT, f"{error.filename}: {error.strerror or error}"
    if os.environ.get(DEBUG):
        traceback.print_exception(error)
    text = f"{type(error).__name__}: {error}; please report it ({DEBUG}=1 shows the traceback)"
    return INTERNAL_ERROR, f"internal error: {text}"


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """The error and those behind it."""
    seen: list[BaseException] = []
    while error is not None and error not in seen:
        seen.append(error)
        yield error
        error = error.__cause__ or error.__context__


def _lack(error: BaseException) -> str:
    """The resource that the system lacks, if that is the cause of an error; else empty."""
    code, text = getattr(error, "errno", None), f"{error}"
    if isinstance(error, MemoryError) or code == errno.ENOMEM or any(words in text for words in _NO_MEMORY):
        return f"out of memory{_allowed('RLIMIT_AS', 'ulimit -v', 2**20, 'MiB')}"
    if code in (errno.EMFILE, errno.ENFILE):
        return f"too many open files{_allowed('RLIMIT_NOFILE', 'ulimit -n', 1, 'files')}"
    if "can't start new thread" in text:
        return f"the system starts no more threads{_allowed('RLIMIT_NPROC', 'ulimit -u', 1, 'processes')}"
    if code in (errno.ENOSPC, errno.EDQUOT):
        return f"{getattr(error, 'filename', None) or 'stdout'}: {os.strerror(code)}"
    return ""


def _allowed(name: str, command: str, unit: int, word: str) -> str:
    """How much of something this process may have, where that is limited."""
    if resource is None or not hasattr(resource, name):
        return ""
    limit = resource.getrlimit(getattr(resource, name))[0]
    return (
        ""
        if limit == resource.RLIM_INFINITY
        else f"; this process may have {limit // unit} {word} ({command})"
    )


def say(code: int, message: str) -> int:
    """Say one line on stderr; returns the code."""
    line = "".join(c if c.isprintable() else " " if c.isspace() else repr(c)[1:-1] for c in message)
    if len(line) > _LONGEST:
        line = f"{line[:_LONGEST]} ... ({len(line)} characters)"
    with suppress(OSError):  # stderr may be full
        print(f"ocptip: {line}", file=sys.stderr)
    return code
