"""Progress where no terminal shows it: a line every few seconds."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TextIO

EVERY = 10.0
"""s, between lines."""


@dataclass
class _Latest:
    """What a terminal would show now; empty: nothing."""

    text: str = ""


latest = _Latest()
"""Set by `progress.Progress`, read by the thread that writes lines."""


@contextmanager
def lines_while(stream: TextIO, name: str, every: float = EVERY) -> Iterator[None]:
    """While a command computes, write a line every few seconds, unless the stream is a terminal.

    Args:
        stream: where to.
        name: of the command.
        every: s, between lines.
    """
    if stream.isatty():
        yield
        return
    begin, done = time.monotonic(), threading.Event()

    def write() -> None:
        while not done.wait(every):
            if latest.text:
                with suppress(OSError, ValueError):  # nobody reads it any longer
                    stream.write(f"{name}: {latest.text} ({time.monotonic() - begin:.0f} s)\n")
                    stream.flush()

    latest.text = ""
    thread = threading.Thread(target=write, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
