"""Compilation of the inner loops with Numba, with the machine code kept on disk where that is possible."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property, update_wrapper
from pathlib import Path
from types import FunctionType
from typing import Any, Literal

import numpy as np

from ocptip.numerics.jit.private import complaint, trusted

_interpreting = False  # in all of this process, see `interpreted`


class Kernel:
    """A function that Numba, loaded only then, compiles when it is called for the first time.

    The machine code is kept for the next start of the program if a cache exists. Numba refuses if it finds no
    writable folder for it (a read-only installation of a user without a home): then every process compiles
    the function again. Machine code does not hold the interpreter's lock: several threads may run it.
    """

    def __init__(
        self, function: FunctionType, inline: Literal["never", "always"], any_order: bool = False
    ) -> None:
        update_wrapper(self, function)
        self._function, self._inline, self._any_order = function, inline, any_order

    def __call__(self, *arguments: Any) -> Any:
        return self._function(*arguments) if _interpreting else self.machine_code(*arguments)

    @cached_property
    def machine_code(self) -> Any:
        """Numba's dispatcher of the function, in which the kernels that it calls are theirs."""
        import numba

        own, code = self._function.__globals__, self._function.__code__
        callees = {
            name: own[name].machine_code for name in code.co_names if isinstance(own.get(name), Kernel)
        }
        function = FunctionType(code, {**own, **callees}, code.co_name)
        options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "inline": self._inline}
        if self._any_order:
            options["fastmath"] = {"reassoc", "nsz", "contract"}
        try:
            made = numba.njit(cache=True, **options)(function)
            if self._moved(made):
                made = numba.njit(cache=True, **options)(function)
        except RuntimeError:
            return numba.njit(**options)(function)
        _watch(made, callees.values())
        return made

    def _moved(self, made: Any) -> bool:
        """Whether Numba keeps machine code where others could put theirs; then it gets a private folder."""
        from numba.core import config

        kept = getattr(getattr(made, "_cache", None), "cache_path", None)
        beside = Path(self._function.__code__.co_filename).parent / "__pycache__"
        if kept is None or Path(kept) == beside:  # as safe as the source itself
            return False
        folder = Path(kept)
        if complaint(folder) and not any(folder.iterdir()):  # made by Numba just now
            with suppress(OSError):
                folder.chmod(0o700)
        instead = trusted(folder)
        if instead != folder:
            setattr(config, "CACHE_DIR", str(instead))  # noqa: B010  # it declares none
        return instead != folder


def compiled(function: Callable) -> Kernel:
    """Decorate a function for inner loops: plain Python and NumPy without keyword arguments and closures."""
    assert isinstance(function, FunctionType)
    return Kernel(function, "never")


def compiled_inline(function: Callable) -> Kernel:
    """As `compiled`, put into its callers: for the smallest loops, whose calls cost as much as they do."""
    assert isinstance(function, FunctionType)
    return Kernel(function, "always")


def compiled_in_any_order(function: Callable) -> Kernel:
    """As `compiled`, with sums in whatever order is fastest, and products fused with them.

    Loops that add up then use the vector units; the last bits of the results depend on the processor.
    """
    assert isinstance(function, FunctionType)
    return Kernel(function, "never", any_order=True)


@contextmanager
def interpreted() -> Iterator[None]:
    """Let Python run the kernels in this block, with the same results to the last bit, or to rounding.

    For a process that solves a few small problems and ends: loading Numba and machine code takes longer.
    """
    global _interpreting
    before, _interpreting = _interpreting, True
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        _interpreting = before


def _watch(made: Any, callees: Iterable[Any]) -> None:
    """Make kept machine code stale where a file has changed whose functions it contains.

    Numba only compares the time and size of the file that defines the function. (A version of Numba that
    keeps them elsewhere does so as before.)
    """
    own, stamps = getattr(made, "_cache", None), [_stamp(one) for one in callees]
    if own is not None and stamps:
        own._cache_file._source_stamp = tuple(dict.fromkeys([_stamp(made), *stamps]))


def _stamp(made: Any) -> Any:
    return getattr(getattr(getattr(made, "_cache", None), "_cache_file", None), "_source_stamp", None)
