"""Many tasks in one call: side by side, answered as they come; what an earlier call has finished is kept."""

from __future__ import annotations

import hashlib
import io
import json
import sys
from argparse import Namespace
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager, nullcontext, redirect_stderr
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError
from ocptip.basics.outputs import OUTPUTS, require_unchanged
from ocptip.basics.read import read_json, read_text
from ocptip.basics.text import table
from ocptip.basics.version import version
from ocptip.basics.write import plain
from ocptip.cli.command import Report, explained
from ocptip.cli.run import suspicions, written
from ocptip.motion.files.source import TaskSource
from ocptip.numerics.workers import worker_pool

_OF_THE_CALL = (
    "command",
    "task",
    "many",
    "out",
    "overwrite",
    "no_figures",
    "json",
    "jobs",
    "scheduler",
    "require",
    "junit",
)
"""Options that do not change an answer."""


@dataclass(frozen=True)
class Asked:
    """One task of a call.

    Attributes:
        task: as it was read, with what the options change.
        name: of the task.
        directory: where its files go.
        digest: of all that its answer depends on.
    """

    task: Any
    name: str
    directory: Path
    digest: str = ""


Work = Callable[[Asked, Namespace, Executor | None], Report]
"""Answers one task, its calls run by an executor."""


def digest_of(source: TaskSource | None, options: Namespace) -> str:
    """Hash of a task's file, of the files that it names, and of what is typed; empty without a file."""
    if source is None:
        return ""
    typed = {name: value for name, value in vars(options).items() if name not in _OF_THE_CALL}
    if options.tolerance is not None and (file := Path(options.tolerance)).is_file():
        typed["tolerance"] = read_text(file)
    files = {name: hashlib.sha256(content).hexdigest() for name, content in source.files.items()}
    data = plain([version(), dict(source.data), files, typed])
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()


@contextmanager
def cluster(options: Namespace) -> Iterator[Executor | None]:
    """The workers of the scheduler that was named; None without one."""
    with worker_pool(None, None, 1, options.scheduler) if options.scheduler else nullcontext() as pool:
        yield pool


def answer_many(options: Namespace, read: Callable[[Namespace], Asked], work: Work) -> ManyReport:
    """Answer all tasks, write their files, and print a line for each when it is finished.

    Every task is one call of a worker process. A task that cannot be read, or whose answer is an error, is
    also one line; the others continue.

    Raises:
        InputError: two tasks have the same name, or --out cannot be made.
        KeyboardInterrupt: says how many are finished.
    """
    if options.out is not None:
        Path(options.out).mkdir(exist_ok=True)
    rows: dict[int, _TaskRow] = {}
    asked: dict[int, Asked] = {}
    for k, typed in enumerate(options.task):
        try:
            one = {"task": typed, "many": True}  # --out names the folder of its folder
            asked[k] = read(Namespace(**{**vars(options), **one}))
        except Exception as error:
            rows[k] = _TaskRow(typed, *explained(error))
    _refuse_doubles(asked.values())
    for k, one in list(asked.items()):
        if (row := _kept(one, options)) is not None:
            rows[k] = row
            del asked[k]
    show = _Saying(len(options.task), options.json)
    for k in sorted(rows):
        show(rows[k])
    alone = Namespace(**{**vars(options), "jobs": 1, "scheduler": None})  # starts run in the worker
    try:
        with worker_pool(None, options.jobs, max(len(asked), 1), options.scheduler) as pool:
            futures = {pool.submit(_answered, work, one, alone): k for k, one in asked.items()}
            for future in as_completed(futures):
                k = futures[future]
                rows[k] = _finished(asked[k], future, options)
                show(rows[k])
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"after {len(rows)} of {len(options.task)} tasks; the same call keeps them and goes on"
        ) from None
    return ManyReport([rows[k] for k in sorted(rows)])


def _refuse_doubles(asked: Any) -> None:
    by_folder: dict[Path, str] = {}
    for one in asked:
        if one.directory in by_folder:
            raise InputError(f"two tasks would write into {one.directory}: both are called {one.name!r}")
        by_folder[one.directory] = one.name


def _answered(work: Work, one: Asked, options: Namespace) -> tuple[Report | None, list[str], int, str]:
    """In a worker: the report and the warnings, or else exit code and text of the error."""
    try:
        with redirect_stderr(io.StringIO()), suspicions() as messages:
            return work(one, options, None), messages, 0, ""
    except Exception as error:
        return None, [], *explained(error)


def _finished(one: Asked, future: Any, options: Namespace) -> _TaskRow:
    """Take the result of a worker, and write its files."""
    try:
        report, messages, code, text = future.result()
    except Exception as error:  # the worker, not the task
        report, messages, (code, text) = None, [], explained(error)
    if report is None:
        return _TaskRow(one.name, code, text)
    for warning in messages:
        print(f"warning: {one.name}: {warning}", file=sys.stderr)
    report.warnings = messages
    failure = written(report)
    code, text = report.exit_code, report.to_text().splitlines()[0]
    if failure is not None:
        code, text = explained(failure)
    return _TaskRow(one.name, code, text, plain(json.loads(report.to_json())))


def _kept(one: Asked, options: Namespace) -> _TaskRow | None:
    """The result of an earlier call for the same task; None if its folder is not complete, or of another."""
    main, picture = (OUTPUTS[options.command][0], f"{options.command}.png")
    try:
        data = read_json(one.directory / main)
        require_unchanged(one.directory)
        same = bool(one.digest) and data.get("digest") == one.digest and not data["interrupted"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    if not same or not (options.no_figures or (one.directory / picture).exists()):
        return None
    text = f"{one.name}: kept, {one.directory} holds its answer"
    return _TaskRow(one.name, 0 if data["verified"] else 1, text, data, kept=True)


@dataclass(frozen=True)
class _TaskRow:
    """The result of a task: its name, exit code, a line, its JSON."""

    name: str
    code: int
    text: str
    data: dict[str, Any] | None = None
    kept: bool = False

    @property
    def cells(self) -> list[str]:
        """Cells of the final table."""
        answer = ("yes", "NO", "BAD INPUT", "ERROR")[min(self.code, 3)]
        known = self.data or {}
        energy, seconds = known.get("energy_J"), known.get("duration_s")
        return [
            self.name,
            answer,
            "-" if energy is None else f"{energy:.1f} J",
            "-" if seconds is None else f"{seconds:.3f} s",
            "kept" if self.kept else "",
        ]

    def to_dict(self) -> dict[str, Any]:
        """The content of its JSON file; else what went wrong."""
        data = {"verified": False, "status": self.text} if self.data is None else self.data
        return {"task": self.name, "exit_code": self.code, "kept": self.kept, **data}


class _Saying:
    """Prints a line per task as it comes; with --json on stderr."""

    def __init__(self, total: int, as_json: bool) -> None:
        self._done, self._total, self._as_json = 0, total, as_json

    def __call__(self, row: _TaskRow) -> None:
        self._done += 1
        text = row.text if row.name in row.text else f"{row.name}: {row.text}"
        line = f"[{self._done}/{self._total}] {text}"
        print(line, file=sys.stderr if self._as_json else sys.stdout, flush=True)


@dataclass
class ManyReport(Report):
    """The results of many tasks, in the order in which they were typed; their files are already written."""

    rows: list[_TaskRow]

    @property
    def good(self) -> bool:
        """True if all answers are yes."""
        return self.exit_code == 0

    @property
    def exit_code(self) -> int:
        """The worst one."""
        return max(row.code for row in self.rows)

    def to_text(self) -> str:
        """A table; the lines have been printed."""
        head = ["task", "answer", "energy", "time", ""]
        return "\n".join(["", *table([head, *(row.cells for row in self.rows)], left=(0, 1, 4))])

    def to_dict(self) -> dict[str, Any]:
        """One entry, the list of all."""
        return {"tasks": [row.to_dict() for row in self.rows]}

    def to_json(self) -> str:
        """A list, one entry per task."""
        return json.dumps(plain(self.to_dict()["tasks"]), indent=2, allow_nan=False)
