"""Calls of `Search` as jobs, the same for this process and for a pool of workers."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, as_completed
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any, Generic, TypeVar

from ocptip.motion.planner.one_start import Search
from ocptip.motion.task import MotionTask
from ocptip.numerics.threads import one_thread
from ocptip.numerics.workers import WorkerDiedError

LOST = "lost: "
"""Status of a start begins so if it killed its worker process again and again."""

_TASKS_IN_MEMORY = 4  # per worker
T = TypeVar("T")


class Job(Generic[T]):
    """A method of `Search`, called once for one task.

    Attributes:
        future: its call in a pool; None in this process.
        lost: why there is no result; empty unless the job killed its workers.
    """

    def __init__(self, result: Callable[[], T], future: Future[T] | None = None) -> None:
        self._result, self.future, self.lost = result, future, ""

    def result(self) -> T | None:
        """The result of the method, to be taken once; None if the workers died that ran it."""
        try:
            return self._result()
        except WorkerDiedError as error:
            self.lost = f"{LOST}{error}"
            return None


class Jobs(AbstractContextManager):
    """Begins jobs; at its end those are cancelled that wait for a worker.

    Args:
        pool: runs jobs as soon as it has a free worker. None: a job runs in this process, when somebody asks
            for its result.
    """

    def __init__(self, pool: Executor | None) -> None:
        self._pool, self._begun = pool, list[Future]()
        self._search = cache(Search)  # its functions are built once per task
        self._payload = cache(_payload)

    def begin(self, method: Callable[..., T], task: MotionTask, *arguments: Any) -> Job[T]:
        """Let a method of `Search` run for a task."""
        if self._pool is not None:
            future = self._pool.submit(call, method, self._payload(task), *arguments)
            self._begun.append(future)
            return Job(future.result, future)

        def here() -> T:
            with one_thread:
                return method(self._search(task), *arguments)

        return Job(here)

    def as_they_end(self, jobs: Iterable[Job[T]]) -> Iterator[Job[T]]:
        """Jobs in the order in which they end; those of this process run one after the other."""
        waiting = {job.future: job for job in jobs if job.future is not None}
        yield from (waiting[future] for future in as_completed(waiting)) if waiting else jobs

    def __exit__(self, *error: object) -> None:
        for future in self._begun:
            future.cancel()


def _payload(task: MotionTask) -> bytes:
    return pickle.dumps(replace(task, source=None))


def call(method: Callable[..., T], payload: bytes, *arguments: Any) -> T:
    """The result of a method of `Search` for a pickled task; what a worker runs."""
    with one_thread:
        return method(_search(payload), *arguments)


@lru_cache(maxsize=_TASKS_IN_MEMORY)
def _search(payload: bytes) -> Search:
    """One search per task and worker process, so that its functions are built once."""
    return Search(pickle.loads(payload))
