"""Compilation of the inner loops with Numba, with the machine code kept on disk where that is possible."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cached_property, update_wrapper
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from ocptip.numerics.jit.private import complaint, trusted

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

_interpreting = False  # in all of this process, see `interpreted`
_held = set[str]()  # source files whose kernels this process compiles now


class Kernel:
    """A function that Numba, loaded only then, compiles when it is called for the first time.

    The machine code is kept for the next start of the program if a cache exists. Numba refuses if it finds no
    writable folder for it (a read-only installation of a user without a home): then every process compiles
    the function again. Machine code does not hold the interpreter's lock: several threads may run it.
    """

    def __init__(self, function: FunctionType, any_order: bool = False) -> None:
        update_wrapper(self, function)
        self._function, self._any_order = function, any_order

    def __call__(self, *arguments: Any) -> Any:
        return self._function(*arguments) if _interpreting else self.machine_code(*arguments)

    def prepare(self, arguments: str) -> None:
        """Load the machine code for these arguments, or compile it, without a call.

        Args:
            arguments: of each f (float), i (integer) or b (bool), and the dimensions of an array, such as
                "f2 i1 f" for `kernel(matrix, numbers, factor)`.
        """
        kinds, types = {"f": "float64", "i": "int64", "b": "boolean"}, []
        for one in arguments.split():
            size = int(one[1:] or 0)
            types.append(kinds[one[0]] + (f"[{':,' * (size - 1)}::1]" if size else ""))
        self.machine_code.compile(f"({', '.join(types)})")

    @cached_property
    def machine_code(self) -> Any:
        """Numba's dispatcher of the function, in which the kernels that it calls are theirs."""
        try:
            made = self._compiler(cache=True)
            if self._moved(made):
                made = self._compiler(cache=True)
        except RuntimeError:
            return self._compiler()
        _watch(made, self._files())
        _compile_once(made, self._function.__code__.co_filename)
        return made

    def _compiler(self, **options: Any) -> Any:
        import numba

        callees = {name: kernel.machine_code for name, kernel in self._callees().items()}
        code = self._function.__code__
        function = FunctionType(code, {**self._function.__globals__, **callees}, code.co_name)
        if self._any_order:
            options["fastmath"] = {"reassoc", "nsz", "contract"}
        # Nothing takes the address of a kernel, so that no function for C is made of it.
        return numba.njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)  # pyright: ignore[reportCallIssue]

    def _callees(self) -> dict[str, Kernel]:
        known, names = self._function.__globals__, self._function.__code__.co_names
        return {name: known[name] for name in names if isinstance(known.get(name), Kernel)}

    def _files(self) -> set[str]:
        """The files of this function and of all that it calls."""
        called = (kernel._files() for kernel in self._callees().values())
        return {self._function.__code__.co_filename}.union(*called)

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
    """Decorate a function for inner loops: plain Python and NumPy without keyword arguments and closures.

    Loops over elements compile several times faster than operations on whole arrays: for `a[:] = b` Numba
    also compiles the message about shapes that do not match.
    """
    assert isinstance(function, FunctionType)
    return Kernel(function)


def compiled_in_any_order(function: Callable) -> Kernel:
    """As `compiled`, with sums in whatever order is fastest, and products fused with them.

    Loops that add up then use the vector units; the last bits of the results depend on the processor.
    """
    assert isinstance(function, FunctionType)
    return Kernel(function, any_order=True)


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


def _compile_once(made: Any, source: str) -> None:
    """Let one process at a time compile kernels of a source file: others wait, and load what it has kept.

    Workers begin with the same kernels, and each would compile them.
    """
    kept = getattr(getattr(getattr(made, "_cache", None), "_cache_file", None), "_index_path", None)
    if kept is None or os.path.exists(kept):
        return
    compile_it = made.compile

    def alone(signature: Any) -> Any:
        with _alone(source):
            return compile_it(signature)

    made.compile = alone


@contextmanager
def _alone(source: str) -> Iterator[None]:
    """Hold a file's lock, which ends with the process, unless this process holds it already."""
    threads = import_module("numba.core.compiler_lock").global_compiler_lock
    with threads, ExitStack() as held:  # that of the threads first, or one would wait for it with the other
        if fcntl is not None and source not in _held:
            with suppress(OSError):
                file = held.enter_context(open(source, "rb"))
                fcntl.flock(file, fcntl.LOCK_EX)
            _held.add(source)
            held.callback(_held.discard, source)
        yield


def _watch(made: Any, files: Iterable[str]) -> None:
    """Make kept machine code stale where a file has changed whose functions it contains.

    Numba only compares the file that defines the function. (A version of Numba that keeps the code elsewhere
    does so as before.)
    """
    kept = getattr(getattr(made, "_cache", None), "_cache_file", None)
    if kept is not None:
        kept._source_stamp = tuple(sha256(Path(file).read_bytes()).digest() for file in sorted(files))
