"""Processes that run starts: they leave interrupts to their parent and end with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from ocptip.numerics.process_state import environment

_THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_PATIENCE = 5.0  # s


def cores() -> int:
    """Number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def worker_pool(executor: Executor | None, jobs: int | None, starts: int) -> Iterator[Executor]:
    """The caller's executor, left open, or a process pool that ends with the planning.

    Where the planning ends early, so do the workers: nobody waits for starts that nobody reads.
    """
    if executor is not None:
        yield executor
        return
    count = min(jobs or cores(), starts)
    pool = Workers(count, mp_context=multiprocessing.get_context("spawn"), initializer=_serve)
    try:
        yield pool
        pool.shutdown(wait=False)
    except BaseException:
        pool.end()
        raise


class Workers(ProcessPoolExecutor):
    """A process pool whose workers leave interrupts to their parent, and that can be ended at once."""

    def submit(self, *arguments: Any, **options: Any) -> Future:
        """Like the base class, which may start a worker here: from its first instruction it is spared.

        Ipopt's libraries start threads of their own, out of reach of threadpoolctl: a worker, which takes
        over the environment before it loads anything, gets one of each.
        """
        with _interrupts_held(), environment(_THREADS):
            return super().submit(*arguments, **options)

    def end(self) -> None:
        """End the workers with what they are doing; 3.14 has `terminate_workers`.

        Before, starts that wait must be cancelled by the pool's own thread: it stumbles over a cancelled one
        when it finds its workers gone.
        """
        futures = [item.future for item in list(self._pending_work_items.values())]
        workers = list((self._processes or {}).values())
        self.shutdown(wait=False, cancel_futures=True)
        latest = time.monotonic() + _PATIENCE
        while not all(f.done() or f.running() for f in futures) and time.monotonic() < latest:
            time.sleep(0.01)
        for worker in workers:
            worker.terminate()


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Interrupts of this thread come afterwards; a process started here gets none at all."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve() -> None:
    """In a worker: leave interrupts to the parent, and do not outlive it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        multiprocessing.parent_process().join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
