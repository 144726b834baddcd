"""State that belongs to the whole process, changed for a while and put back.

CasADi's simplification and the environment of new processes cannot be given as arguments. Every change is
undone whatever happens inside, and threads that want the same one wait for each other.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

_expressions, _environment = threading.Lock(), threading.Lock()


@contextmanager
def expressions_as_written() -> Iterator[None]:
    """CasADi keeps expressions as they are written, without simplifying them.

    Expressions that another thread builds meanwhile are not simplified either: longer, of the same value.
    """
    import casadi as cs  # others only start processes, before they load anything

    with _expressions:
        before = cs.GlobalOptions.getSimplificationOnTheFly()
        cs.GlobalOptions.setSimplificationOnTheFly(False)
        try:
            yield
        finally:
            cs.GlobalOptions.setSimplificationOnTheFly(before)


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
