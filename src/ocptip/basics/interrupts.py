"""Interrupts and time limits are signals. Their exception is raised only where nothing loses it.

A library in C++ drops an exception, or turns it into another: a block `interrupts_after` keeps it
until the library has returned. Elsewhere in CasADi, in `__del__` and in callbacks of weak references, which
every import has, the signal comes again a little later.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_AGAIN = 0.02  # s, until a signal whose exception would be lost comes again

_coming = set[int]()
"""Signals that come again: nobody sent them a second time."""

_numbers = dict[type[KeyboardInterrupt], int]()
"""The signal that an exception was last raised for."""


class TimeIsUpError(KeyboardInterrupt):
    """An interrupt by a time limit, not by a user."""


def interrupt(error: type[KeyboardInterrupt], number: int, frame: FrameType | None) -> None:
    """Raise the exception of a signal, whose handler was called in this frame, now or a little later."""
    wrapper = sys.modules.get("casadi.casadi")  # which tries another conversion after an exception
    while wrapper is not None and frame is not None:
        if frame.f_globals is vars(wrapper):
            return _send_again(number)
        frame = frame.f_back
    _numbers[error] = number
    raise error


def comes_again(number: int) -> bool:
    """Whether a signal is one that has come before; asked once by its handler."""
    again = number in _coming
    _coming.discard(number)
    return again


def send_lost_again() -> None:
    """From now on an interrupt that Python drops comes again when the callback has returned."""

    def unraisable(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            return sys.__unraisablehook__(lost)
        return _send_again(_numbers.get(lost.exc_type, signal.SIGINT))

    sys.unraisablehook = unraisable


def _send_again(number: int) -> None:
    if number == getattr(signal, "SIGALRM", None):
        signal.setitimer(signal.ITIMER_REAL, _AGAIN)  # which ends with the block of the time limit
    else:
        threading.Timer(_AGAIN, _send, (number,)).start()


def _send(number: int) -> None:
    _coming.add(number)
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)  # wakes it if it waits
    else:
        signal.raise_signal(number)


@contextmanager
def interrupts_after(errors: list[BaseException]) -> Iterator[None]:
    """Raise the first of `errors` after the block, and add what handlers of signals raise inside it."""
    inside = True

    def keep(number: int, frame: Any) -> None:
        try:
            handlers[number](number, None if inside else frame)  # nothing is lost here, in whatever frame
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
