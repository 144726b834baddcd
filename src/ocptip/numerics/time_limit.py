"""Ends a computation after some time as Ctrl-C does: what is finished by then is kept."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

from ocptip.basics.errors import InputError
from ocptip.basics.interrupts import TimeIsUpError, interrupt

T = TypeVar("T")


@contextmanager
def interrupted_after(seconds: float) -> Iterator[None]:
    """Raise `TimeIsUpError` in this thread, the main one, after some time, s; infinite: never.

    A limit around this one goes on afterwards.

    Raises:
        InputError: this is not the main thread, or the system has no timers.
    """
    if seconds == float("inf"):
        yield
        return
    if seconds <= 0:
        raise TimeIsUpError
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        raise InputError("seconds: a time limit needs the main thread of a process, and not Windows")

    stop = partial(interrupt, TimeIsUpError)
    before, began = signal.signal(signal.SIGALRM, stop), time.monotonic()
    around, _ = signal.setitimer(signal.ITIMER_REAL, seconds)  # 0: there is none
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        if around:
            signal.setitimer(signal.ITIMER_REAL, max(around - (time.monotonic() - began), 1e-6))


class TimeBudget:
    """A time limit that begins now.

    Args:
        seconds: of wall time; None: no limit.

    Attributes:
        given: whether there is a limit.
        left_out: names of the computations that the limit, or an interrupt, ended.
    """

    def __init__(self, seconds: float | None) -> None:
        self.given, self.left_out = seconds is not None, list[str]()
        self._end = float("inf") if seconds is None else time.perf_counter() + seconds

    @property
    def left(self) -> float:
        """s; infinite without a limit."""
        return max(self._end - time.perf_counter(), 0.0)

    def within(self, compute: Callable[[], T], otherwise: T, name: str = "", share: float = 1.0) -> T:
        """The result of a computation, or something else if the time is up before.

        A user's interrupt ends the computation as well, and leaves no time for later ones.

        Args:
            compute: the computation.
            otherwise: the result without it.
            name: of the computation in `left_out`; empty: the caller says what is left out.
            share: of the time left that the computation may take.
        """
        try:
            with interrupted_after(share * self.left):
                return compute()
        except KeyboardInterrupt as stopped:
            if not isinstance(stopped, TimeIsUpError):
                self._end = 0.0
            self.left_out += [name] * bool(name)
            return otherwise
