"""What the commands that plan have in common: progress bar, folder for files, aligned summary."""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TextIO

STANDS, MOVES, BAD_INPUT, INTERNAL_ERROR = 0, 1, 2, 3
_BAR = 24  # characters


class Progress:
    """A bar on a terminal: starts done, best value, seconds. Says nothing if the stream is no terminal.

    Args:
        stream: where to.
        begin: shown until the first start has finished.
        best: what to say of the best value so far, which may be None.
    """

    def __init__(self, stream: TextIO, begin: str, best: Callable[[float | None], str]) -> None:
        self._stream, self._shown, self._begin = stream, stream.isatty(), time.monotonic()
        self._first, self._best = begin, best

    def __enter__(self) -> Progress:
        self._show(self._first)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._show("")

    def __call__(self, done: int, total: int, best: float | None) -> None:
        """Show that `done` of `total` starts have finished, and the best value so far."""
        filled = _BAR * done // max(total, 1)
        bar = "#" * filled + "." * (_BAR - filled)
        seconds = time.monotonic() - self._begin
        self._show(f"[{bar}] {done}/{total} starts, {self._best(best)}, {seconds:.0f} s")

    def _show(self, text: str) -> None:
        if self._shown:
            self._stream.write(f"\r{text}\x1b[K")  # erases the rest of the line
            self._stream.flush()


def say_if_compiling() -> None:
    """On a terminal, say why the first run takes longer."""
    if sys.stderr.isatty() and not _kernels_are_compiled():
        print("compiling the contact solver (first run only, some seconds) ...", file=sys.stderr)


def require_least(options: argparse.Namespace, **least: int) -> None:
    """Raise InputError if an option that is given is below its least value; names it as it is typed."""
    from ocptip.basics.errors import InputError

    for name, bound in least.items():
        value = getattr(options, name)
        if value is not None and value < bound:
            raise InputError(f"--{name}: must be >= {bound}, got {value}")


def output_directory(options: argparse.Namespace, command: str, name: str) -> Path:
    """Where files go; refused before anything is computed if they cannot.

    Raises:
        InputError: --out is no directory, has no parent, or may not be written.
    """
    from ocptip.basics.errors import InputError

    path = Path(options.out or f"ocptip-{command}-" + re.sub(r"[^\w.-]+", "-", name))
    if path.exists() and not path.is_dir():
        raise InputError(f"--out: {path} is not a directory")
    if not path.parent.is_dir():
        raise InputError(f"--out: no such directory: {path.parent}")
    place = path if path.is_dir() else path.parent
    try:
        with tempfile.TemporaryDirectory(dir=place, prefix=".ocptip-"):
            pass
    except OSError as error:
        raise InputError(f"--out: cannot write into {place}: {error.strerror}") from None
    return path


def summary(head: str, lines: Sequence[tuple[str, str]], written: Sequence[Path]) -> str:
    """A headline and aligned lines (name, text), the written files last."""
    lines = list(lines)
    if written:
        names = ", ".join(path.name for path in written)
        lines.append(("written", f"{written[0].parent}{os.sep}: {names}"))
    width = max(len(name) for name, _ in lines)
    return "\n".join([head, *(f"{name:<{width}}  {text}" for name, text in lines)])


DEBUG = "OCPTIP_DEBUG"


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
