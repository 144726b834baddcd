"""Progress lines and colours in a terminal while a command computes; elsewhere a line every few seconds."""

from __future__ import annotations

import os
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import TracebackType
from typing import TextIO

EVERY = 10.0
"""s, between lines."""

_BAR = 24  # characters
_VERDICT = re.compile(r"\b(NOT \w+|NO \w+|[A-Z]{4,}(?: [A-Z]{2,})*)")
_GOOD = ("PROVED", "CHECKED", "STABLE", "STANDS", "VERIFIED", "CERTIFIED", "AGREES", "PLACED")
_GREEN, _RED, _PLAIN = "\x1b[32m", "\x1b[31m", "\x1b[0m"


@dataclass
class _Latest:
    """The text that a terminal would show now (may be empty), and whether output is suppressed."""

    text: str = ""
    quiet: bool = False


latest = _Latest()
"""Set by `Progress`, read by the thread that writes lines."""


class Progress:
    """A bar on a terminal: starts done, best value, seconds. Elsewhere `lines_while` shows the same.

    Args:
        stream: where to.
        begin: shown until the first start has finished.
        none: shown as long as no start has a value.
        best: format of the best value so far.
        what: is counted.
    """

    def __init__(
        self, stream: TextIO, begin: str, none: str = "", best: str = "", what: str = "starts"
    ) -> None:
        self._stream, self._shown = stream, stream.isatty() and not latest.quiet
        self._begin = time.monotonic()
        self._first, self._none, self._best, self._what = begin, none, best, what

    def __enter__(self) -> Progress:
        self._show(self._first)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._show("")

    def __call__(self, done: int, total: int, best: float | None) -> None:
        """Show that `done` of `total` have finished, and the best value so far."""
        filled = _BAR * done // max(total, 1)
        bar = "#" * filled + "." * (_BAR - filled)
        seconds = time.monotonic() - self._begin
        value = self._none if best is None else self._best.format(best)
        # Lines have a clock of their own.
        text = f"[{bar}] {done}/{total} {self._what}{value and ', '}{value}"
        self._show(text, f", {seconds:.0f} s")

    def stage(self, text: str) -> None:
        """Show what is computed now."""
        self._show(text)

    def _show(self, text: str, clock: str = "") -> None:
        latest.text = text
        if self._shown:
            self._stream.write(f"\r{text}{clock}\x1b[K")  # erases the rest of the line
            self._stream.flush()


@contextmanager
def lines_while(stream: TextIO, name: str, first: str = "", every: float = EVERY) -> Iterator[None]:
    """While a command computes, write a line every few seconds, unless the stream is a terminal.

    Args:
        stream: where to.
        name: of the command.
        first: what it does until it says what.
        every: s, between lines.
    """
    if stream.isatty() or latest.quiet:
        yield
        return
    begin, done = time.monotonic(), threading.Event()

    def write() -> None:
        while not done.wait(every):
            if latest.text:
                with suppress(OSError, ValueError):  # nobody reads it any longer
                    stream.write(f"{name}: {latest.text} ({time.monotonic() - begin:.0f} s)\n")
                    stream.flush()

    latest.text = first
    thread = threading.Thread(target=write, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def coloured(text: str, stream: TextIO) -> str:
    """The text with the verdict of its first line in green or red, on terminals that want it (NO_COLOR)."""
    if not stream.isatty() or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return text
    head, *rest = text.split("\n", 1)

    def colour(verdict: re.Match[str]) -> str:
        return f"{_GREEN if verdict[0].startswith(_GOOD) else _RED}{verdict[0]}{_PLAIN}"

    return "\n".join([_VERDICT.sub(colour, head, count=1), *rest])
