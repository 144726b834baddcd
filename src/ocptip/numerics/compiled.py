"""Compilation of the inner loops with Numba, with the machine code kept on disk where that is possible."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numba


def compiled(function: Callable, *, inline: Literal["never", "always"] = "never") -> Callable:
    """Compile a function on first use; keep the code for the next start of the program if a cache exists.

    Numba refuses to decorate if it finds no writable folder for its cache (a read-only installation of a
    user without a home): then the function is compiled anew in every process.

    Compiled code does not hold the interpreter's lock: several threads may run it at once.
    """
    try:
        made = numba.njit(cache=True, nogil=True, error_model="numpy", inline=inline)(function)
    except RuntimeError:
        return numba.njit(nogil=True, error_model="numpy", inline=inline)(function)
    _watch_callees(made)
    return made


def _watch_callees(made: Any) -> None:
    """Let kept machine code be stale, too, where a file has changed whose functions it contains.

    Numba compares the time and size of the function's own file only. (A version of Numba that keeps them
    elsewhere does so as before.)
    """
    function, own = made.py_func, getattr(made, "_cache", None)
    callees = (function.__globals__.get(name) for name in function.__code__.co_names)
    stamps = [_stamp(one) for one in callees if isinstance(one, type(made))]
    if own is not None and stamps:
        own._cache_file._source_stamp = tuple(dict.fromkeys([_stamp(made), *stamps]))


def _stamp(made: Any) -> Any:
    return getattr(getattr(getattr(made, "_cache", None), "_cache_file", None), "_source_stamp", None)


def compiled_inline(function: Callable) -> Callable:
    """As `compiled`, put into its callers: for the smallest loops, whose calls cost as much as they do."""
    return compiled(function, inline="always")
