"""Compilation of the inner loops with Numba, with the machine code kept on disk where that is possible."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numba


def compiled(function: Callable, *, inline: Literal["never", "always"] = "never") -> Callable:
    """Compile a function on first use; keep the code for the next start of the program if a cache exists.

    Numba refuses to decorate if it finds no writable folder for its cache (a read-only installation of a
    user without a home): then the function is compiled anew in every process.

    Compiled code does not hold the interpreter's lock: several threads may run it at once.
    """
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy", inline=inline)(function)
    except RuntimeError:
        return numba.njit(nogil=True, error_model="numpy", inline=inline)(function)


def compiled_inline(function: Callable) -> Callable:
    """As `compiled`, put into its callers: for the smallest loops, whose calls cost as much as they do."""
    return compiled(function, inline="always")
