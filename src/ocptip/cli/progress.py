"""What is said on a terminal while a command computes; elsewhere a line every few seconds."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import TextIO

from ocptip.cli.piped import latest
from ocptip.contact import pivoting

_BAR = 24  # characters


class Progress:
    """A bar on a terminal: starts done, best value, seconds. Elsewhere `lines_while` says the same.

    Args:
        stream: where to.
        begin: shown until the first start has finished.
        none: what to say as long as no start has a value.
        best: format of the best value so far.
        what: is counted.
    """

    def __init__(
        self, stream: TextIO, begin: str, none: str = "", best: str = "", what: str = "starts"
    ) -> None:
        self._stream, self._shown, self._begin = stream, stream.isatty(), time.monotonic()
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
        said = self._none if best is None else self._best.format(best)
        said = f"{said}, " if said else ""
        self._show(f"[{bar}] {done}/{total} {self._what}, {said}{seconds:.0f} s")

    def stage(self, text: str) -> None:
        """Show what is computed now."""
        self._show(text)

    def _show(self, text: str) -> None:
        latest.text = text
        if self._shown:
            self._stream.write(f"\r{text}\x1b[K")  # erases the rest of the line
            self._stream.flush()


def say_if_compiling() -> None:
    """On a terminal, say why the first run takes longer."""
    if sys.stderr.isatty() and not _kernels_are_compiled():
        print("compiling the contact solver (first run only, some seconds) ...", file=sys.stderr)


def _kernels_are_compiled() -> bool:
    """True if Numba's cache holds the solver (where the cache is: beside the source, or in the user's)."""
    cache = Path(pivoting.solve_batch.machine_code.stats.cache_path or os.devnull)
    return any(cache.glob("pivoting.solve_batch-*.nbi"))
