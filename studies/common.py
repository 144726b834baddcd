"""What the studies share: tables and numbers as text, progress, the state of the source, kept rows."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import signal
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

import ocptip
from ocptip.basics.errors import InputError, OcptipError
from ocptip.basics.write import plain, versions, write_json

try:
    import fcntl
except ImportError:  # Windows: one process at a time
    fcntl = None  # type: ignore[assignment]

EXAMPLES = Path(ocptip.__file__).parent / "examples"
RESULTS = Path(__file__).parent / "results"
PLANNING = (
    "basics",
    "contact",
    "motion",
    "numerics",
    "published",
    "reserves",
    "robots",
    "standing",
    "trajectories",
)
"""Packages that decide the numbers of plans."""

PLACING = (*PLANNING, "indices", "placement", "task_files")
"""Packages that decide the numbers of placements."""

# --- text ---------------------------------------------------------------------------------------------------


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 1) -> list[str]:
    """Lines of a Markdown table; the first `left` columns are aligned to the left, the rest to the right."""
    rule = ["---"] * left + ["---:"] * (len(head) - left)
    return ["| " + " | ".join(row) + " |" for row in (head, rule, *rows)]


def number(value: float | None, digits: int = 3, infinite: str = "none") -> str:
    """Fixed digits, a dash for None, a word for infinity."""
    return "-" if value is None else f"{value:.{digits}f}" if math.isfinite(value) else infinite


def percent(share: float | None, digits: int = 0) -> str:
    """A share in per cent, or a dash."""
    return "-" if share is None else f"{100 * share:.{digits}f} %"


def software(versions: Mapping[str, str]) -> str:
    """Packages with their versions."""
    return ", ".join(f"{package} {number}" for package, number in versions.items())


def json_text(data: Mapping[str, Any], rows: str = "rows") -> str:
    """Strict JSON with the entry `rows` one line per row."""
    compact = json.dumps(plain(data[rows]), separators=(",", ":"), allow_nan=False).replace("},{", "},\n{")
    head = json.dumps(plain({**data, rows: []}), indent=1, allow_nan=False)
    return head.replace(f'"{rows}": []', f'"{rows}": {compact}')


def say(text: str) -> None:
    """One line on a terminal in place of the one before, nothing elsewhere."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)


def progress(done: int, total: int, what: str) -> None:
    """A bar on a terminal, nothing elsewhere; the line ends when all is done."""
    bar = "#" * (30 * done // max(total, 1))
    say(f"[{bar:<30}] {done}/{total} {what}" + ("\n" if done == total else ""))


def ended(name: str, study: Callable[[], str], kept: str = "nothing written.") -> int:
    """Run a study and print the text it returns.

    Args:
        name: of the study, for messages.
        study: refuses its input by OSError, ValueError or OcptipError.
        kept: what is left of it when it is interrupted.

    Returns:
        Exit code: 0; 1 if it refuses, 130 if it is interrupted, both with a line on stderr.
    """
    try:
        text = study()
    except (OSError, ValueError, OcptipError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"\nInterrupted; {kept}", file=sys.stderr)
        return 130
    print(text, end="")
    return 0


def leave_interrupts_to_parent() -> None:
    """In a worker process: Ctrl-C ends the study, not the worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


# --- where results come from --------------------------------------------------------------------------------


def machine() -> dict[str, Any]:
    """The machine in short."""
    return {"architecture": platform.machine(), "cores": os.cpu_count()}


def commit() -> str:
    """The commit of the source, with a plus sign if it has been changed since."""
    root = Path(__file__).parents[1]
    call = ["git", "-C", str(root), "describe", "--always", "--dirty=+", "--exclude=*"]
    return subprocess.run(call, capture_output=True, text=True, check=False).stdout.strip()


def digest(data: Any) -> str:
    """Short digest of plain data."""
    return hashlib.sha256(json.dumps(plain(data), sort_keys=True).encode()).hexdigest()[:12]


@cache
def source_state(*packages: str) -> str:
    """Short digest of the source code of packages of ocptip and of all versions.

    It tells what made a result.
    """
    found = hashlib.sha256(json.dumps(versions(), sort_keys=True).encode())
    root = Path(ocptip.__file__).parent
    for package in packages:
        for path in sorted((root / package).rglob("*.py")):
            found.update(path.read_bytes())
    return found.hexdigest()[:12]


def task_digest(path: Path) -> str:
    """Short digest of a TOML task file and of the files that it names."""
    found = hashlib.sha256(path.read_bytes())
    for text in _strings(tomllib.loads(path.read_text(encoding="utf-8"))):
        if len(text) < 256 and (named := path.parent / text).is_file():
            found.update(named.read_bytes())
    return found.hexdigest()[:12]


def _strings(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _strings(item)


def state_notes(states: Sequence[str | None], now: str, what: str = "rows") -> list[str]:
    """Items of a Markdown list: how many rows other states of the source than the present one have made.

    Args:
        states: digests, one per row; None for rows from the time before there were digests.
        now: the present digest.
        what: the rows are.
    """
    unknown, older = states.count(None), sum(one not in (None, now) for one in states)
    counts = {
        "another state of the source code or packages than the present one": older,
        "an unknown state of the source code and packages": unknown,
    }
    return [f"- Made by {who}: {count} of {len(states)} {what}." for who, count in counts.items() if count]


# --- finished rows ------------------------------------------------------------------------------------------


def kept_result(folder: Path, name: str, options: dict[str, Any]) -> dict[str, Any] | None:
    """A result that :func:`keep_result` has written with these options (plain data); None if there is none.

    Files from before the options were part of their name are read, too.
    """
    for path in (folder / f"{name}-{digest(options)}.json", folder / f"{name}.json"):
        result = json.loads(path.read_text()) if path.exists() else {}
        if result.get("options") == options:
            return result
    return None


def keep_result(folder: Path, name: str, result: Mapping[str, Any]) -> None:
    """Write a result into a file for its name and its entry `options`; others stay as they are."""
    write_json(folder / f"{name}-{digest(result['options'])}.json", result, indent=None)


class RowFile:
    """Finished rows of a study in one JSON file, each with the options and the state of the source behind it.

    Rows of other options stay in the file. Older files lack some options in their rows: then those of the
    whole file count, or, if it has none either, the present ones.

    Args:
        path: made by the first row.
        options: what all rows of interest have in common, plain data.
        identity: names of the entries that tell these rows from each other.
        state: of the source, written into every new row.
    """

    def __init__(self, path: Path, options: dict[str, Any], identity: Sequence[str], state: str) -> None:
        self.path, self.options, self.identity, self.state = path, options, tuple(identity), state

    @property
    def own(self) -> list[dict[str, Any]]:
        """The rows with these options, in the order in which they came."""
        return [row for row in self._read() if self._fits(row, self.options)]

    def find(self, **identity: Any) -> dict[str, Any] | None:
        """The row with these options and this identity."""
        return next((row for row in self.own if self._fits(row, identity)), None)

    def put(self, row: Mapping[str, Any]) -> None:
        """Write a row; it replaces one of the same options and identity."""
        row = plain({**row, **self.options, "state": self.state})
        same = self.options | {name: row[name] for name in self.identity}
        rows = self._read()
        at = next((i for i, other in enumerate(rows) if self._fits(other, same)), len(rows))
        rows[at : at + 1] = [row]
        write_json(self.path, {"versions": versions(), "rows": rows}, indent=1)

    def _read(self) -> list[dict[str, Any]]:
        data = json.loads(self.path.read_text()) if self.path.exists() else {"rows": []}
        shared = {name: data[name] for name in self.options if name in data}
        return [{**shared, **row} for row in data["rows"]]

    @staticmethod
    def _fits(row: dict[str, Any], wanted: dict[str, Any]) -> bool:
        return all(row.get(name, value) == value for name, value in wanted.items())


class JsonLines:
    """A file of JSON lines that only grows, even if several processes write it at the same time.

    A line that was being written when its process was killed is no line: it is not read, and the next line
    that is written takes its place.

    Args:
        path: made by the first line.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> list[Any]:
        """All whole lines.

        Raises:
            InputError: a line is broken; names its number.
        """
        text = self.path.read_bytes() if self.path.exists() else b""
        found = []
        for count, line in enumerate(text[: text.rfind(b"\n") + 1].splitlines(), 1):
            try:
                found.append(json.loads(line))
            except ValueError:
                raise broken_line(self.path, count) from None
        return found

    def append(self, data: Any, *, first: bool = False) -> None:
        """Write plain data as a line to the disk; with `first` only if the file has none."""
        with self._locked() as stream:
            if not (first and stream.tell()):
                stream.write(json.dumps(data).encode() + b"\n")

    @contextmanager
    def _locked(self) -> Iterator[BinaryIO]:
        """The file, for this process alone, at the end of its last whole line."""
        with self.path.open("a+b") as stream:
            if fcntl:
                fcntl.flock(stream, fcntl.LOCK_EX)  # until the file is closed, what is written included
            if stream.seek(0, os.SEEK_END):
                stream.seek(-1, os.SEEK_END)
                if stream.read() != b"\n":
                    stream.seek(0)
                    stream.truncate(stream.read().rfind(b"\n") + 1)
                    stream.seek(0, os.SEEK_END)
            yield stream


def broken_line(path: Path, number: int) -> InputError:
    """The error for a line that cannot be read."""
    return InputError(f"{path}: line {number} is broken; delete it to run that start again")
