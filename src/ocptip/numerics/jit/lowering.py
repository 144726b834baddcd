"""Python functions of plain loops as LLVM's intermediate representation.

The language is what inner loops need: numbers, C-contiguous arrays, `range`, calls of other kernels. The type
of a variable is that of its first value, and types of arguments are those of a call. So there is no inference
of types, and compilation takes a sixth of the time that Numba (0.68) needs: 6 instead of 39 s of CPU for the
kernels of a plan. Without `any_order` Python runs the same functions with the same results to the last bit.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Sequence
from types import FunctionType
from typing import Any

from llvmlite import ir

from ocptip.numerics.jit.expressions import Expressions
from ocptip.numerics.jit.module import Module
from ocptip.numerics.jit.values import BIT, INT, INTEGER, POINTER, Value, ValueKind, flat


class UnsupportedError(TypeError):
    """A function of which no machine code can be made, with the line."""


class Lowered(Expressions):
    """A Python function for arguments of given kinds, in a module.

    Args:
        module: where it is added.
        python: the function.
        any_order: whether sums may be taken in any order.
        kinds: of the arguments.
        name: that no other function of the module has.

    Attributes:
        function: of the list of allocated memory, a row for results, and the parts of all arguments.
        results: kinds of the results.
    """

    def __init__(
        self, module: Module, python: FunctionType, any_order: bool, kinds: tuple[ValueKind, ...], name: str
    ) -> None:
        tree = ast.parse(textwrap.dedent(inspect.getsource(python))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        registers = [register for kind in kinds for register in kind.registers]
        signature = [POINTER.as_pointer(), INTEGER.as_pointer(), *registers]
        function = ir.Function(module.module, ir.FunctionType(ir.VoidType(), signature), name)
        function.linkage = "internal"
        super().__init__(module, python, any_order, function)
        self.results: tuple[ValueKind, ...] = ()
        self._returned, self._loops = False, list[tuple[ir.Block, ir.Block]]()
        parts = list(self.function.args[2:])
        for argument, kind in zip(tree.args.args, kinds, strict=True):
            count = len(kind.registers)
            self._put(argument, Value(kind, tuple(parts[:count])))
            del parts[:count]
        body = tree.body[isinstance(tree.body[0], ast.Expr) and ast.get_docstring(tree) is not None :]
        self._statements(body)
        self._go(self._exit)
        begin: Any = ir.IRBuilder(self._begin)
        end: Any = ir.IRBuilder(self._exit)
        if self._holds and not any(kind.dimensions for kind in self.results):
            mark = begin.load(function.args[0])
            end.call(module.release, [function.args[0], mark])
        begin.branch(function.blocks[2])
        end.ret_void()

    def _statements(self, body: Sequence[ast.stmt]) -> None:
        for statement in body:
            if self._build.block.is_terminated:
                return
            try:
                getattr(self, f"_{type(statement).__name__.lower()}")(statement)
            except UnsupportedError:
                raise
            except Exception as error:
                line = self._python.__code__.co_firstlineno + statement.lineno - 1
                where = f"{self._python.__code__.co_filename}:{line}"
                raise UnsupportedError(f"{where}: {ast.unparse(statement)[:80]}: {error!r}") from error

    def _assign(self, statement: ast.Assign) -> None:
        values = self._values(statement.value)
        for target in statement.targets:
            self._put(target, values)

    def _augassign(self, statement: ast.AugAssign) -> None:
        before, change = self._value(statement.target), self._value(statement.value)
        self._put(statement.target, self._arithmetic(statement.op, before, change))

    def _expr(self, statement: ast.Expr) -> None:
        self._values(statement.value)

    def _return(self, statement: ast.Return) -> None:
        values = [] if statement.value is None else flat(self._values(statement.value))
        if not self._returned:
            self.results, self._returned = tuple(value.kind for value in values), True
        index, build = 0, self._build
        for value, kind in zip(values, self.results, strict=True):
            for part in self._converted(value, kind).parts:
                place = build.gep(self.function.args[1], [INTEGER(index)])
                stored = build.zext(part, INTEGER) if part.type == BIT else part
                build.store(stored, build.bitcast(place, stored.type.as_pointer()))
                index += 1
        build.branch(self._exit)

    def _if(self, statement: ast.If) -> None:
        then, other, after = self._blocks("then", "else", "after")
        self._build.cbranch(self._truth(self._value(statement.test)), then, other)
        for block, body in ((then, statement.body), (other, statement.orelse)):
            self._build.position_at_end(block)
            self._statements(body)
            self._go(after)
        self._build.position_at_end(after)

    def _while(self, statement: ast.While) -> None:
        test, body, after = self._blocks("test", "body", "after")
        self._go(test)
        self._build.position_at_end(test)
        self._build.cbranch(self._truth(self._value(statement.test)), body, after)
        self._build.position_at_end(body)
        self._repeated(statement.body, test, after)
        self._build.position_at_end(after)

    def _repeated(self, body: Sequence[ast.stmt], again: ir.Block, after: ir.Block) -> None:
        self._loops.append((again, after))
        self._statements(body)
        self._loops.pop()
        self._go(again)

    def _for(self, statement: ast.For) -> None:
        over, build, array = statement.iter, self._build, None
        if isinstance(over, ast.Tuple):
            for item in over.elts:
                self._put(statement.target, self._values(item))
                self._statements(statement.body)
            return
        if isinstance(over, ast.Call) and ast.unparse(over.func) == "range":
            numbers = [self._index(one) for one in over.args]
            first, last = (INTEGER(0), numbers[0]) if len(numbers) == 1 else numbers[:2]
            step: Any = numbers[2] if len(numbers) == 3 else INTEGER(1)
        else:
            array = self._value(over)
            first, last, step = INTEGER(0), array.parts[1], INTEGER(1)
        test, body, again, after = self._blocks("test", "body", "again", "after")
        counter = self._slot(INTEGER)
        build.store(first, counter)
        build.branch(test)
        build.position_at_end(test)
        now = build.load(counter)
        build.cbranch(build.icmp_signed("<" if step.constant > 0 else ">", now, last), body, after)
        build.position_at_end(body)
        item = Value(ValueKind(INT), (now,))
        self._put(statement.target, item if array is None else self._element(array, [now]))
        self._repeated(statement.body, again, after)
        build.position_at_end(again)
        build.store(build.add(now, step), counter)
        build.branch(test)
        build.position_at_end(after)

    def _break(self, _: ast.Break) -> None:
        self._build.branch(self._loops[-1][1])

    def _continue(self, _: ast.Continue) -> None:
        self._build.branch(self._loops[-1][0])
