"""Inner loops in Python that run as machine code."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, update_wrapper
from hashlib import sha256
from pathlib import Path
from struct import Struct
from threading import RLock
from types import FunctionType
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from ocptip.numerics.jit.lowering import Lowered
from ocptip.numerics.jit.machine import Library, keep_code, kept_code, target
from ocptip.numerics.jit.module import Module
from ocptip.numerics.jit.values import BOOL, FLOAT, INT, WORD, ValueKind

_NUMBERS = {
    **dict.fromkeys((bool, np.bool_), ValueKind(BOOL)),
    **dict.fromkeys((int, np.int64), ValueKind(INT)),
    **dict.fromkeys((float, np.float64), ValueKind(FLOAT)),
}
_ELEMENTS = {np.dtype(of).char: of for of in (FLOAT, INT, WORD, BOOL)}
_FORMATS = {FLOAT: "d", INT: "q", WORD: "Q", BOOL: "q"}
_LANGUAGE = {
    str(Path(__file__).with_name(f"{name}.py"))
    for name in ("compiled", "lowering", "expressions", "module", "values")
}
_SMALL = 25  # of LLVM's units for the cost of a call: functions that are put into those that call them
_interpreting = False  # in all of this process, see `interpreted`
_making = RLock()


class Kernel:
    """A function whose machine code is loaded, or made, when it is called first with such arguments.

    Machine code does not hold the interpreter's lock: several threads may run it.
    """

    def __init__(self, function: FunctionType, any_order: bool = False) -> None:
        update_wrapper(self, function)
        self.function, self.any_order = function, any_order
        self.made: dict[tuple[ValueKind, ...], MachineCode] = {}
        self._by_types: dict[tuple, MachineCode] = {}

    def __call__(self, *arguments: Any) -> Any:
        if _interpreting:
            return self.function(*arguments)
        types = tuple([(a.dtype.char, a.ndim) if isinstance(a, np.ndarray) else type(a) for a in arguments])
        code = self._by_types.get(types)
        if code is None:
            code = self._by_types[types] = self._for_types(types)
        return code(arguments)

    def prepare(self, arguments: str) -> None:
        """Load or make the machine code for these arguments, without a call.

        Args:
            arguments: of each f (float), i (integer) or b (bool), and the dimensions of an array, such as
                "f2 i1 f" for `kernel(matrix, numbers, factor)`.
        """
        kinds = {"f": FLOAT, "i": INT, "b": BOOL}
        self._machine_code(tuple(ValueKind(kinds[one[0]], int(one[1:] or 0)) for one in arguments.split()))

    def _for_types(self, types: tuple) -> MachineCode:
        kinds = []
        for k, of in enumerate(types):
            array = isinstance(of, tuple)
            if (of[0] if array else of) not in (_ELEMENTS if array else _NUMBERS):
                raise TypeError(f"{self.function.__name__}: no machine code for argument {k + 1}, {of}")
            kinds.append(ValueKind(_ELEMENTS[of[0]], of[1]) if array else _NUMBERS[of])
        return self._machine_code(tuple(kinds))

    def _machine_code(self, kinds: tuple[ValueKind, ...]) -> MachineCode:
        with _making:
            if kinds not in self.made:
                files = _digest(frozenset(self._files() | _LANGUAGE))
                constants = " ".join(sorted(self._constants()))
                key = f"{self.function.__qualname__} {self.any_order} {kinds} {files} {constants}".encode()
                content = kept_code(key)
                if content is None:
                    content = self._make(kinds)
                    keep_code(key, content)
                self.made[kinds] = MachineCode(kinds, content)
            return self.made[kinds]

    def _make(self, kinds: tuple[ValueKind, ...]) -> bytes:
        """A line with the kinds of the results, and machine code."""
        module = Module(_callee, Lowered)
        results = module.entry(self.function, self.any_order, kinds)
        code, machine = llvm.parse_assembly(str(module.module)), target()
        # Without sums in any order, vectors and large functions that callees are put into make code only 2 %
        # faster, and take a third of LLVM's time.
        vectors = self._adds_in_any_order()
        tuning = llvm.create_pipeline_tuning_options(speed_level=2)
        tuning.loop_vectorization = tuning.slp_vectorization = vectors
        if not vectors:
            tuning.inlining_threshold = _SMALL
        builder = llvm.create_pass_builder(machine, tuning)
        builder.getModulePassManager().run(code, builder)
        head = " ".join(f"{kind.of} {kind.dimensions}" for kind in results)
        return head.encode() + b"\n" + machine.emit_object(code)

    def _adds_in_any_order(self) -> bool:
        """Whether this function or one that it calls may take sums in any order."""
        return self.any_order or any(kernel._adds_in_any_order() for kernel in self._called())

    def _files(self) -> set[str]:
        """The files of this function and of all that it calls."""
        return {self.function.__code__.co_filename}.union(*(kernel._files() for kernel in self._called()))

    def _constants(self) -> set[str]:
        """The numbers that this function and all that it calls read from modules, which may be imported."""
        known = self.function.__globals__
        mine = {
            f"{n}={known[n]!r}"
            for n in self.function.__code__.co_names
            if isinstance(known.get(n), _CONSTANT)
        }
        return mine.union(*(kernel._constants() for kernel in self._called()))

    def _called(self) -> list[Kernel]:
        known = self.function.__globals__
        return [known[n] for n in self.function.__code__.co_names if isinstance(known.get(n), Kernel)]


_CONSTANT = int, float, tuple


@cache
def _digest(files: frozenset[str]) -> str:
    return " ".join(sha256(Path(file).read_bytes()).hexdigest() for file in sorted(files))


class MachineCode:
    """Machine code of a kernel for arguments of given kinds.

    Args:
        kinds: of the arguments.
        content: see `Kernel._make`.
    """

    def __init__(self, kinds: tuple[ValueKind, ...], content: bytes) -> None:
        head, code = content.split(b"\n", 1)
        words = iter(head.decode().split())
        self._results = [ValueKind(of, int(next(words))) for of in words]
        self._pack = Struct("".join("q" if kind.dimensions else _FORMATS[kind.of] for kind in kinds))
        layout = (
            "q" * (1 + kind.dimensions) if kind.dimensions else _FORMATS[kind.of] for kind in self._results
        )
        self._unpack = Struct("".join(layout))
        self._row = ctypes.c_int64 * (self._unpack.size // 8)
        library = Library(code)
        self._run = library.function("run", ctypes.c_char_p, ctypes.c_void_p, ctypes.c_void_p)
        self._release = library.function("release", ctypes.c_void_p, ctypes.c_void_p)

    def __call__(self, arguments: tuple) -> Any:
        row, copies = [], []
        for one in arguments:
            if isinstance(one, np.ndarray):
                if not one.flags.c_contiguous:
                    copies.append((one, one := np.ascontiguousarray(one)))
                row.append(id(one))
            else:
                row.append(one)
        results, memory = self._row(), ctypes.c_void_p()
        self._run(self._pack.pack(*row), results, ctypes.byref(memory))
        for one, copy in copies:
            if one.flags.writeable:
                one[...] = copy
        if not self._results:
            return None
        numbers = list(self._unpack.unpack_from(results))
        entries = [_taken(kind, numbers) for kind in self._results]
        if memory:
            self._release(ctypes.byref(memory), None)
        return tuple(entries) if len(entries) > 1 else entries[0]


def _callee(value: Any) -> tuple[FunctionType, bool] | None:
    return (value.function, value.any_order) if isinstance(value, Kernel) else None


def _taken(kind: ValueKind, row: list) -> Any:
    """The next value of a row of results, which loses it; an array is copied."""
    first = row.pop(0)
    if not kind.dimensions:
        return bool(first) if kind.of == BOOL else first
    shape = row[: kind.dimensions]
    del row[: kind.dimensions]
    array = np.empty(shape, dtype=kind.of)
    ctypes.memmove(array.ctypes.data, first, array.nbytes)
    return array


def compiled(function: Callable) -> Kernel:
    """Decorate a function for inner loops: plain loops over elements of arrays, see `lowering`."""
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
    """Let Python run the kernels in this block, with the same results to the last bit, or to rounding."""
    global _interpreting
    before, _interpreting = _interpreting, True
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        _interpreting = before
