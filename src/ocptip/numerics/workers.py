"""Where calls run that take long: processes of this machine, or of a Dask cluster; what a dead one costs."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any

from ocptip.basics.errors import InputError, OcptipError
from ocptip.basics.version import version
from ocptip.numerics.fork_server import THREADS, cores, environment, interrupts_held, start_method

_DEATHS = 2  # of processes, after which a call is given up
_PATIENCE = 10.0  # s, until a cluster has answered and has a worker
_one_call = threading.Lock()


class WorkerDiedError(OcptipError):
    """A call whose processes died, again and again; other calls go on."""


@contextmanager
def worker_pool(
    executor: Executor | None, jobs: int | None, calls: int, scheduler: str | None = None
) -> Iterator[Executor]:
    """The caller's executor, left open; else a Dask cluster; else processes that end with the work.

    Where the work ends early, so do the workers: nobody waits for results that nobody reads.

    Args:
        executor: of the caller.
        jobs: number of processes of this machine, one per core by default.
        calls: that there will be; there are no more processes.
        scheduler: address of a Dask scheduler, such as "tcp://10.0.0.1:8786".

    Raises:
        InputError: of the cluster, see `Cluster`.
    """
    if executor is not None:
        yield executor
        return
    pool = Cluster(scheduler) if scheduler else Workers(min(jobs or cores(), calls))
    try:
        yield pool
        pool.shutdown(wait=False)
    except BaseException:
        pool.end()
        raise


@contextmanager
def processes(executor: Executor | None, jobs: int | None, calls: int) -> Iterator[Executor | None]:
    """The caller's executor, left open, else processes for several searches and checks; arguments are as of
    `worker_pool`.

    They keep what they have built and loaded. What nobody has asked for ends with the block. None: with one
    job all is done in this process.
    """
    if executor is not None or (jobs or cores()) == 1:
        yield executor
        return
    pool = Workers(min(jobs or cores(), calls))
    try:
        yield pool
    finally:
        pool.end()


@contextmanager
def calls_begun(
    executor: Executor | None, jobs: int | None, calls: int
) -> Iterator[Callable[..., Callable[[], Any]]]:
    """A function that begins a call and gives what waits for its result; arguments are as of `worker_pool`.

    With one job the call is made in this process, when its result is asked for.
    """
    with processes(executor, jobs, calls) as pool:
        if pool is None:
            yield partial
        else:
            yield lambda function, *arguments: pool.submit(function, *arguments).result


class Workers(Executor):
    """Processes of this machine that leave interrupts to their parent, and that can be ended at once.

    A process that dies affects only the call that it runs: a new one takes its place and runs that again; the
    second time the call's future raises `WorkerDiedError`. (A ProcessPoolExecutor loses all calls, and nobody
    can tell which one it was. Here every process is a separate pool, with a thread that waits for it.)

    Args:
        count: of processes, started when they are needed.
    """

    def __init__(self, count: int) -> None:
        self._threads = ThreadPoolExecutor(count)
        self._mine = threading.local()
        self._pools: list[ProcessPoolExecutor] = []
        self._ended = False

    @property
    def processes(self) -> list[multiprocessing.Process]:
        """All that have been started and have not died."""
        return [process for pool in list(self._pools) for process in list((pool._processes or {}).values())]

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future:
        """As of every executor."""
        return self._threads.submit(self._run, function, arguments, named)

    def _run(self, function: Callable[..., Any], arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
        for _ in range(_DEATHS):
            try:
                return self._begun(function, arguments, named).result()
            except BrokenExecutor:
                if self._ended:
                    raise
        raise WorkerDiedError(f"its worker process died {_DEATHS} times (out of memory?)")

    def _begun(
        self, function: Callable[..., Any], arguments: tuple[Any, ...], named: dict[str, Any]
    ) -> Future:
        """The call in this thread's process; in a new one if there is none, or it has died.

        A process is spared interrupts from its first instruction. The environment limits its libraries to one
        thread before they start any.
        """
        pool = getattr(self._mine, "pool", None)
        with interrupts_held(), environment(THREADS):
            if pool is not None:
                try:
                    return pool.submit(function, *arguments, **named)
                except BrokenExecutor:
                    self._pools.remove(pool)
            context = multiprocessing.get_context(start_method())
            self._mine.pool = pool = ProcessPoolExecutor(1, mp_context=context, initializer=_serve)
            self._pools.append(pool)
            return pool.submit(function, *arguments, **named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As of every executor."""
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures or not wait)
        for pool in list(self._pools):
            pool.shutdown(wait=wait)

    def end(self) -> None:
        """End the processes with what they are doing."""
        self._ended = True
        self._threads.shutdown(wait=False, cancel_futures=True)
        for process in self.processes:
            process.terminate()


class Cluster(Executor):
    """The workers of a Dask scheduler; a call whose worker dies is run again by another one.

    A worker runs one call at a time, however many threads it has: what a process keeps between calls (the
    functions of a task's programs) belongs to one thread.

    Args:
        address: of the scheduler, such as "tcp://10.0.0.1:8786".

    Raises:
        InputError: `distributed` is not installed, nobody answers there, or no worker has this version of
            ocptip.
    """

    def __init__(self, address: str) -> None:
        try:
            import distributed
        except ImportError:
            raise InputError("--scheduler: needs Dask: pip install 'ocptip[cluster]'") from None
        try:
            self._client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
            self._client.wait_for_workers(1, timeout=_PATIENCE)
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(f"--scheduler {address}: no scheduler with workers there ({error})") from None
        self._killed = distributed.KilledWorker
        self._executor = self._client.get_executor(pure=False)
        try:
            theirs = self._executor.submit(version).result()
        except ImportError as error:
            self.end()
            raise InputError(f"--scheduler {address}: its workers lack ocptip ({error})") from None
        if theirs != version():
            self.end()
            raise InputError(f"--scheduler {address}: its workers have ocptip {theirs}, this is {version()}")

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future:
        """As of every executor."""
        inner, outer = self._executor.submit(_alone, function, *arguments, **named), Future()
        outer.add_done_callback(lambda one: one.cancelled() and inner.cancel())

        def done(future: Future) -> None:
            if not outer.set_running_or_notify_cancel():
                return None
            if future.cancelled():
                return outer.set_exception(WorkerDiedError("the cluster has dropped it"))
            error = future.exception()
            if error is None:
                return outer.set_result(future.result())
            if isinstance(error, self._killed):
                error = WorkerDiedError(f"its workers died again and again (out of memory?): {error}")
            return outer.set_exception(error)

        inner.add_done_callback(done)
        return outer

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As of every executor; without `wait` running calls are also dropped. The cluster goes on."""
        self._executor.shutdown(wait=wait)
        self._client.close()

    def end(self) -> None:
        """Leave the cluster; what it was to do is dropped, what it does it ends in vain."""
        self.shutdown(wait=False)


def _alone(function: Callable[..., Any], /, *arguments: Any, **named: Any) -> Any:
    with _one_call:
        return function(*arguments, **named)


def _serve() -> None:
    """In a worker: leave interrupts to the parent, and do not outlive it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
