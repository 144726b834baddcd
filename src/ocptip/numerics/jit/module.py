"""A module of LLVM with the functions of a kernel, and how it is called from Python."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

from llvmlite import ir

from ocptip.numerics.jit.values import INTEGER, POINTER, ValueKind, loaded

Callee = Callable[[Any], tuple[FunctionType, bool] | None]


class Module:
    """The functions that a kernel calls, in one module of LLVM.

    Args:
        callee: gives the Python function behind a global name's value, and whether its sums may be taken in
            any order; None for what is no kernel.
        lower: adds a Python function to this module, see `Lowered`.
    """

    def __init__(self, callee: Callee, lower: Callable[..., Any]) -> None:
        self.callee, self.module, self._lower = callee, ir.Module("kernels"), lower
        self._functions: dict[tuple[FunctionType, tuple[ValueKind, ...]], Any] = {}
        self.allocate, self.release = self._allocate(), self._release()

    def function(self, python: FunctionType, any_order: bool, kinds: tuple[ValueKind, ...]) -> Any:
        """A function for such arguments (`Lowered`), made when it is asked for first."""
        if (python, kinds) not in self._functions:
            name = f"{python.__name__}.{len(self._functions)}"
            self._functions[python, kinds] = self._lower(self, python, any_order, kinds, name)
        return self._functions[python, kinds]

    def entry(
        self, python: FunctionType, any_order: bool, kinds: tuple[ValueKind, ...]
    ) -> tuple[ValueKind, ...]:
        """Add `run(arguments, results, memory)` of the function; returns the results' kinds.

        Arguments are a row of numbers and addresses of NumPy's arrays, eight bytes each. Results are such a
        row, with the address of the first element and the shape for an array. Memory is the head of a list.
        """
        lowered = self.function(python, any_order, kinds)
        row = INTEGER.as_pointer()
        signature = ir.FunctionType(ir.VoidType(), [row, row, POINTER.as_pointer()])
        run = ir.Function(self.module, signature, "run")
        build: Any = ir.IRBuilder(run.append_basic_block())
        parts = []
        for k, kind in enumerate(kinds):
            if not kind.dimensions:
                parts.append(loaded(build, run.args[0], k, kind.registers[0]))
                continue
            # The structure PyArrayObject_fields: an object, then data, number of dimensions, shape.
            array = build.bitcast(loaded(build, run.args[0], k, POINTER), row)
            data, shape = object.__basicsize__ // 8, loaded(build, array, object.__basicsize__ // 8 + 2, row)
            parts.append(loaded(build, array, data, kind.registers[0]))
            parts += [loaded(build, shape, i, INTEGER) for i in range(kind.dimensions)]
        build.call(lowered.function, [run.args[2], run.args[1], *parts])
        build.ret_void()
        return lowered.results

    def named(self, name: str, result: ir.Type, *arguments: ir.Type) -> ir.Function:
        """A function of the C library, or an intrinsic one."""
        if name not in self.module.globals:
            return ir.Function(self.module, ir.FunctionType(result, arguments), name)
        return self.module.globals[name]

    def _allocate(self) -> ir.Function:
        """Memory, at the head of a list in which each piece begins with the address of the next one."""
        allocate = ir.Function(
            self.module, ir.FunctionType(POINTER, [POINTER.as_pointer(), INTEGER]), "allocate"
        )
        allocate.linkage = "internal"
        memory, size = allocate.args
        build: Any = ir.IRBuilder(allocate.append_basic_block())
        piece = build.call(self.named("malloc", POINTER, INTEGER), [build.add(size, INTEGER(16))])
        build.store(build.load(memory), build.bitcast(piece, POINTER.as_pointer()))
        build.store(piece, memory)
        build.ret(build.gep(piece, [INTEGER(16)]))
        return allocate

    def _release(self) -> ir.Function:
        """Frees what was allocated since the list's head was `mark`."""
        kind = ir.FunctionType(ir.VoidType(), [POINTER.as_pointer(), POINTER])
        release = ir.Function(self.module, kind, "release")  # also called from outside
        memory, mark = release.args
        names = "begin", "test", "free", "end"
        begin, test, free, end = (release.append_basic_block(name) for name in names)
        ir.IRBuilder(begin).branch(test)
        build: Any = ir.IRBuilder(test)
        head = build.load(memory)
        build.cbranch(build.icmp_unsigned("==", head, mark), end, free)
        build.position_at_end(free)
        build.store(build.load(build.bitcast(head, POINTER.as_pointer())), memory)
        build.call(self.named("free", ir.VoidType(), POINTER), [head])
        build.branch(test)
        ir.IRBuilder(end).ret_void()
        return release
