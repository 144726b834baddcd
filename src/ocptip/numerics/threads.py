"""Linear algebra on one thread: matrices here are small, and more threads only wait for each other."""

from __future__ import annotations

import threading
from contextlib import ContextDecorator
from typing import Any

from threadpoolctl import LibController, register, threadpool_limits


class _BlasOfCasadi(LibController):
    """The copy of OpenBLAS in CasADi, in which Ipopt's linear solver computes; its name is not the usual."""

    user_api, internal_api = "blas", "openblas_of_casadi"
    filename_prefixes = ("libcasadi-tp-openblas",)

    def get_num_threads(self) -> Any:
        return self.dynlib.openblas_get_num_threads()

    def set_num_threads(self, num_threads: int) -> None:
        self.dynlib.openblas_set_num_threads(num_threads)

    def get_version(self) -> None:
        return None


register(_BlasOfCasadi)


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
            self._own.limits = [threadpool_limits(1)]
        self._own.depth = depth + 1

    def loaded(self) -> None:
        """To be called within this after a library was loaded: that library also runs on one thread."""
        if getattr(self._own, "depth", 0):
            self._own.limits.append(threadpool_limits(1))

    def __exit__(self, *_: object) -> None:
        self._own.depth -= 1
        if self._own.depth == 0:
            for limits in reversed(self._own.limits):
                limits.restore_original_limits()


one_thread = _OneThread()
