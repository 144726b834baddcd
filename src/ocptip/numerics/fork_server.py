"""The process that workers are forked from: it loads their modules while a command loads others.

Loads no numerics, so that it can be started before they are loaded.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing import forkserver

THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_start_method = ["spawn"]
_environment = threading.Lock()


def prepare_workers(modules: Sequence[str]) -> None:
    """Load modules for later processes while this one loads others; on Linux only, elsewhere nothing.

    They are then forked from one that has them, with its environment of now: for a process that does one
    thing, such as a command.

    Args:
        modules: names to import; one that cannot be imported is left out.
    """
    if not sys.platform.startswith("linux"):
        return
    multiprocessing.get_context("forkserver").set_forkserver_preload(list(modules))
    with interrupts_held(), environment(THREADS):
        forkserver.ensure_running()
    _start_method[0] = "forkserver"


def start_method() -> str:
    """How processes start: "forkserver" if they are prepared, else "spawn"."""
    return _start_method[0]


def cores() -> int:
    """Number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Interrupts of this thread come afterwards; a process started here gets none at all."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def environment(values: Mapping[str, str]) -> Iterator[None]:
    """The environment has these values, for a process that is started inside."""
    with _environment:
        before = {name: os.environ.get(name) for name in values}
        os.environ.update(values)
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value
