"""Linear algebra on one thread: matrices here are small, and more threads only wait for each other."""

from __future__ import annotations

import threading
from contextlib import ContextDecorator

from threadpoolctl import threadpool_limits


class _OneThread(ContextDecorator):
    """Within this, or within a function that has it as decorator, BLAS and OpenMP run on one thread.

    What is nested costs nothing. BLAS has one limit for the whole process: where Python threads are in it at
    the same time, the last one out may leave one thread behind, as `threadpool_limits` does.
    """

    def __init__(self) -> None:
        self._own = threading.local()

    def __enter__(self) -> None:
        depth = getattr(self._own, "depth", 0)
        if depth == 0:
            self._own.limits = threadpool_limits(1)
        self._own.depth = depth + 1

    def __exit__(self, *_: object) -> None:
        self._own.depth -= 1
        if self._own.depth == 0:
            self._own.limits.restore_original_limits()


one_thread = _OneThread()
