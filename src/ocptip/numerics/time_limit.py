"""Ends a computation after some time as Ctrl-C does: what is finished by then is kept."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from ocptip.basics.errors import InputError

T = TypeVar("T")


class TimeIsUpError(KeyboardInterrupt):
    """An interrupt by a time limit, not by a user."""


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

    def stop(*_: Any) -> None:
        raise TimeIsUpError

    before, began = signal.signal(signal.SIGALRM, stop), time.monotonic()
    around, _ = signal.setitimer(signal.ITIMER_REAL, seconds)  # 0: there is none
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        if around:
            signal.setitimer(signal.ITIMER_REAL, max(around - (time.monotonic() - began), 1e-6))


@contextmanager
def interrupts_after(errors: list[BaseException]) -> Iterator[None]:
    """Raise the first of `errors` after the block, and add what handlers of signals raise inside it.

    For libraries in C++: they would turn the exception of a handler into an error of theirs, or lose it.
    """
    inside = True

    def keep(number: int, frame: Any) -> None:
        try:
            handlers[number](number, frame)
        except BaseException as error:
            if not inside:
                raise
            errors.append(error)

    in_main_thread = threading.current_thread() is threading.main_thread()  # others cannot set handlers
    numbers = [getattr(signal, name, None) for name in ("SIGINT", "SIGTERM", "SIGALRM") if in_main_thread]
    handlers: dict[int, Any] = {n: signal.getsignal(n) for n in numbers if n is not None}
    handlers = {number: handler for number, handler in handlers.items() if callable(handler)}
    try:
        for number in handlers:
            signal.signal(number, keep)
        yield
    finally:
        inside = False  # from here an interrupt may leave `keep` as the handler: it hands all on
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if errors:
            raise errors[0]


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
