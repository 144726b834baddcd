"""Variables and expressions of a kernel in LLVM's intermediate representation."""

from __future__ import annotations

import ast
import builtins
import itertools
from collections.abc import Sequence
from types import FunctionType
from typing import Any

import numpy as np
from llvmlite import ir

from ocptip.numerics.jit.module import Module
from ocptip.numerics.jit.values import (
    BIT,
    BOOL,
    BYTE,
    BYTES,
    DOUBLE,
    FLOAT,
    INT,
    INTEGER,
    POINTER,
    STORED,
    WORD,
    Value,
    ValueKind,
    Values,
    constant,
    flat,
    loaded,
)

_ANY_ORDER = ("reassoc", "nsz", "contract")
_COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_FUNCTIONS = {
    np.sqrt: "llvm.sqrt.f64", np.exp: "llvm.exp.f64", np.log: "llvm.log.f64", np.sin: "llvm.sin.f64",
    np.cos: "llvm.cos.f64", abs: "llvm.fabs.f64", np.abs: "llvm.fabs.f64", np.fmin: "llvm.minnum.f64",
    np.fmax: "llvm.maxnum.f64", np.tan: "tan", np.arcsin: "asin", np.arccos: "acos", np.arctan: "atan",
    np.arctan2: "atan2",
}  # fmt: skip
_KINDS = {np.float64: FLOAT, np.int64: INT, np.uint64: WORD, np.bool_: BOOL, int: INT, float: FLOAT}


class Expressions:
    """Writes expressions of a Python function, block by block, into a function of a module.

    Args:
        module: of the function.
        python: the function.
        any_order: whether sums may be taken in any order.
        function: what is written.
    """

    def __init__(self, module: Module, python: FunctionType, any_order: bool, function: ir.Function) -> None:
        self._module, self._python, self.function = module, python, function
        self._flags = _ANY_ORDER if any_order else ()
        self._begin, self._exit, body = self._blocks("begin", "exit", "body")
        self._build: Any = ir.IRBuilder(body)
        self._variables: dict[str, tuple[ValueKind, list[ir.Value]]] = {}
        self._holds = False  # memory until it returns

    def _blocks(self, *names: str) -> list[ir.Block]:
        return [self.function.append_basic_block(name) for name in names]

    def _go(self, block: ir.Block) -> None:
        if not self._build.block.is_terminated:
            self._build.branch(block)

    def _slot(self, register: ir.Type) -> ir.Value:
        return ir.IRBuilder(self._begin).alloca(register)

    def _put(self, target: Any, values: Values) -> None:
        if isinstance(target, ast.Tuple):
            assert isinstance(values, tuple)
            for one, value in zip(target.elts, values, strict=True):
                self._put(one, value)
            return
        if isinstance(values, tuple):  # a variable for each, see `_values`
            for k, value in enumerate(values):
                self._put(ast.arg(f"{target.id}.{k}"), value)
            return
        value = values
        if isinstance(target, ast.Subscript):
            array = self._value(target.value)
            place = self._address(array, self._indices(target.slice, array))
            number = self._converted(value, ValueKind(array.kind.of)).parts[0]
            self._build.store(self._build.zext(number, BYTE) if number.type == BIT else number, place)
            return
        name = target.arg if isinstance(target, ast.arg) else target.id
        if name not in self._variables:
            self._variables[name] = value.kind, [self._slot(register) for register in value.kind.registers]
        kind, slots = self._variables[name]
        for part, slot in zip(self._converted(value, kind).parts, slots, strict=True):
            self._build.store(part, slot)

    def _indices(self, node: ast.expr, array: Value) -> list[ir.Value]:
        """Numbers from the front; those that are written as negative count from the end."""
        nodes, indices = node.elts if isinstance(node, ast.Tuple) else [node], []
        for one, size in zip(nodes, array.parts[1:], strict=False):
            index = self._index(one)
            if isinstance(index, ir.Constant) and index.constant < 0:
                index = self._build.add(size, index)
            indices.append(index)
        return indices

    def _address(self, array: Value, indices: Sequence[ir.Value]) -> ir.Value:
        """Of an element, or of the first one of a part that leaves the last dimensions."""
        pointer, *shape = array.parts
        address = indices[0]
        for index, size in zip([*indices[1:], *[None] * (len(shape) - len(indices))], shape[1:], strict=True):
            address = self._build.mul(address, size)
            address = address if index is None else self._build.add(address, index)
        return self._build.gep(pointer, [address])

    def _element(self, array: Value, indices: Sequence[ir.Value]) -> Value:
        place, left = self._address(array, indices), array.parts[1 + len(indices) :]
        if left:
            return Value(ValueKind(array.kind.of, len(left)), (place, *left))
        number = self._build.load(place)
        if array.kind.of == BOOL:
            number = self._build.icmp_unsigned("!=", number, BYTE(0))
        return Value(ValueKind(array.kind.of), (number,))

    def _allocated(self, of: str, shape: Sequence[ir.Value], zero: bool) -> Value:
        self._holds, build = True, self._build
        size = INTEGER(BYTES[of])
        for one in shape:
            size = build.mul(size, one)
        memory = build.call(self._module.allocate, [self.function.args[0], size])
        if zero:
            fill = self._module.named("llvm.memset.p0.i64", ir.VoidType(), POINTER, BYTE, INTEGER, BIT)
            build.call(fill, [memory, BYTE(0), size, BIT(0)])
        return Value(ValueKind(of, len(shape)), (build.bitcast(memory, STORED[of].as_pointer()), *shape))

    def _value(self, node: ast.expr) -> Value:
        value = self._values(node)
        assert isinstance(value, Value), "one value is needed here"
        return value

    def _index(self, node: ast.expr) -> ir.Value:
        return self._converted(self._value(node), ValueKind(INT)).parts[0]

    def _values(self, node: ast.expr) -> Values:
        match node:
            case ast.Tuple():
                return tuple(self._values(one) for one in node.elts)
            case ast.Name(id=name) if name in self._variables:
                kind, slots = self._variables[name]
                return Value(kind, tuple(self._build.load(slot) for slot in slots))
            case ast.Name(id=name) if f"{name}.0" in self._variables:
                names = itertools.takewhile(
                    self._variables.__contains__, (f"{name}.{k}" for k in itertools.count())
                )
                return tuple(self._value(ast.Name(one)) for one in names)
            case ast.Attribute(attr="shape"):
                return tuple(Value(ValueKind(INT), (size,)) for size in self._value(node.value).parts[1:])
            case ast.Constant() | ast.Name() | ast.Attribute():
                return constant(self._global(node))
            case ast.Subscript():
                return self._subscript(node)
            case ast.BinOp():
                left, right = self._value(node.left), self._value(node.right)
                return self._arithmetic(node.op, left, right)
            case ast.UnaryOp():
                return self._unary(node.op, self._value(node.operand))
            case ast.BoolOp():
                return self._bool(node)
            case ast.Compare():
                return self._compare(node)
            case ast.IfExp():
                return self._choice(node)
            case ast.Call():
                return self._call(node)
        raise TypeError(f"no {type(node).__name__} here")

    def _global(self, node: ast.expr) -> Any:
        """What a name means that is no variable."""
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Attribute):
            return getattr(self._global(node.value), node.attr)
        assert isinstance(node, ast.Name)
        known = self._python.__globals__
        return known[node.id] if node.id in known else getattr(builtins, node.id)

    def _subscript(self, node: ast.Subscript) -> Values:
        base = self._values(node.value)
        if isinstance(base, tuple):
            return base[ast.literal_eval(node.slice)]
        if not isinstance(node.slice, ast.Slice):
            return self._element(base, self._indices(node.slice, base))
        assert base.kind.dimensions == 1, "a part of a row only"
        assert node.slice.step is None, "each element of the part"
        first = INTEGER(0) if node.slice.lower is None else self._index(node.slice.lower)
        last = base.parts[1] if node.slice.upper is None else self._index(node.slice.upper)
        return Value(base.kind, (self._build.gep(base.parts[0], [first]), self._build.sub(last, first)))

    def _converted(self, value: Value, kind: ValueKind) -> Value:
        if value.kind == kind:
            return value
        if value.kind.dimensions or kind.dimensions or kind.of == BOOL:
            raise TypeError(f"{value.kind} where {kind} is needed")
        build, part, of = self._build, value.parts[0], value.kind.of
        if isinstance(part, ir.Constant) and kind.of == FLOAT:
            return Value(kind, (DOUBLE(float(part.constant)),))
        if kind.of == FLOAT:
            part = build.sitofp(part, DOUBLE) if of == INT else build.uitofp(part, DOUBLE)
        elif of == BOOL:
            part = build.zext(part, INTEGER)
        elif of == FLOAT:
            raise TypeError("a float where an integer is needed: write int(...)")
        return Value(kind, (part,))

    def _truth(self, value: Value) -> ir.Value:
        if value.kind.of == BOOL:
            return value.parts[0]
        if value.kind.of == FLOAT:
            return self._build.fcmp_unordered("!=", value.parts[0], DOUBLE(0.0))
        return self._build.icmp_signed("!=", value.parts[0], INTEGER(0))

    def _together(self, *values: Value) -> tuple[str, list[ir.Value]]:
        """Numbers as the widest of their kinds, integers at least."""
        kinds = [value.kind.of for value in values]
        widest = next(kind for kind in (FLOAT, WORD, INT) if kind in (*kinds, INT))
        return widest, [self._converted(value, ValueKind(widest)).parts[0] for value in values]

    def _arithmetic(self, operation: ast.operator, left: Value, right: Value) -> Value:
        build = self._build
        if isinstance(operation, ast.Div):
            left, right = (self._converted(value, ValueKind(FLOAT)) for value in (left, right))
        kind, (x, y) = self._together(left, right)
        if kind == FLOAT:
            return Value(ValueKind(kind), (self._of_floats(operation, x, y),))
        match operation:
            case ast.Add():
                result = build.add(x, y)
            case ast.Sub():
                result = build.sub(x, y)
            case ast.Mult():
                result = build.mul(x, y)
            case ast.RShift():
                result = build.lshr(x, y)
            case ast.FloorDiv():  # of what is not negative
                result = build.sdiv(x, y)
            case ast.Mod():
                result = build.srem(x, y)
            case _:
                raise TypeError("no such operation of integers")
        return Value(ValueKind(kind), (result,))

    def _of_floats(self, operation: ast.operator, x: ir.Value, y: ir.Value) -> ir.Value:
        build, flags = self._build, self._flags
        match operation:
            case ast.Add():
                return build.fadd(x, y, flags=flags)
            case ast.Sub():
                return build.fsub(x, y, flags=flags)
            case ast.Mult():
                return build.fmul(x, y, flags=flags)
            case ast.Div():
                return build.fdiv(x, y, flags=flags)
            case ast.Mod():  # of what is not negative
                return build.frem(x, y)
            case ast.Pow() if isinstance(y, ir.Constant) and y.constant == 2.0:
                return build.fmul(x, x, flags=flags)
            case ast.Pow():
                return build.call(self._module.named("llvm.pow.f64", DOUBLE, DOUBLE, DOUBLE), [x, y])
        raise TypeError("no such operation of floats")

    def _unary(self, operation: ast.unaryop, value: Value) -> Value:
        if isinstance(operation, ast.Not):
            return Value(ValueKind(BOOL), (self._build.not_(self._truth(value)),))
        assert isinstance(operation, ast.USub)
        kind, (part,) = self._together(value)
        if isinstance(part, ir.Constant):
            return Value(ValueKind(kind), (part.type(-part.constant),))
        negative = self._build.fneg(part) if kind == FLOAT else self._build.neg(part)
        return Value(ValueKind(kind), (negative,))

    def _bool(self, node: ast.BoolOp) -> Value:
        (after,), build, known = self._blocks("after"), self._build, isinstance(node.op, ast.Or)
        incoming = []
        for one in node.values[:-1]:
            (more,) = self._blocks("more")
            truth = self._truth(self._value(one))
            incoming.append((BIT(int(known)), build.block))
            build.cbranch(truth, *((after, more) if known else (more, after)))
            build.position_at_end(more)
        incoming.append((self._truth(self._value(node.values[-1])), build.block))
        build.branch(after)
        build.position_at_end(after)
        result = build.phi(BIT)
        for value, block in incoming:
            result.add_incoming(value, block)
        return Value(ValueKind(BOOL), (result,))

    def _compare(self, node: ast.Compare) -> Value:
        values = [self._value(one) for one in (node.left, *node.comparators)]
        result = BIT(1)
        for left, right, operation in zip(values, values[1:], node.ops, strict=False):
            sign = _COMPARISONS[type(operation)]
            kind, (x, y) = self._together(left, right)
            if kind == FLOAT:
                compare = self._build.fcmp_unordered if sign == "!=" else self._build.fcmp_ordered
            else:
                compare = self._build.icmp_signed if kind == INT else self._build.icmp_unsigned
            result = (
                compare(sign, x, y) if len(values) == 2 else self._build.and_(result, compare(sign, x, y))
            )
        return Value(ValueKind(BOOL), (result,))

    def _choice(self, node: ast.IfExp) -> Values:
        then, other, after = self._blocks("then", "else", "after")
        self._build.cbranch(self._truth(self._value(node.test)), then, other)
        self._build.position_at_end(then)
        first = self._values(node.body)
        ends = [self._build.block]
        self._build.position_at_end(other)
        second = self._values(node.orelse)
        ends.append(self._build.block)
        kinds = [
            one.kind if one.kind == two.kind else ValueKind(FLOAT)
            for one, two in zip(flat(first), flat(second), strict=True)
        ]
        branches = []
        for block, values in zip(ends, (first, second), strict=True):
            self._build.position_at_end(block)
            branches.append([self._converted(v, k).parts for v, k in zip(flat(values), kinds, strict=True)])
            self._build.branch(after)
        self._build.position_at_end(after)
        chosen = []
        for kind, one, two in zip(kinds, *branches, strict=True):
            parts = []
            for x, y in zip(one, two, strict=True):
                phi = self._build.phi(x.type)
                phi.add_incoming(x, ends[0])
                phi.add_incoming(y, ends[1])
                parts.append(phi)
            chosen.append(Value(kind, tuple(parts)))
        return tuple(chosen) if isinstance(first, tuple) else chosen[0]

    def _call(self, node: ast.Call) -> Values:
        if isinstance(node.func, ast.Attribute) and node.func.attr in ("reshape", "copy"):
            return self._method(node.func, node.args)
        function = self._global(node.func)
        if (callee := self._module.callee(function)) is not None:
            return self._kernel(*callee, [self._value(one) for one in node.args])
        if function in (np.empty, np.zeros, np.ones):
            kinds = [self._global(one) for one in (*node.args[1:], *(k.value for k in node.keywords))]
            shape = [value.parts[0] for value in flat(self._values(node.args[0]))]
            return self._filled(function, _KINDS[kinds[0]] if kinds else FLOAT, shape)
        values = [self._value(one) for one in node.args]
        if function is len:
            return Value(ValueKind(INT), (values[0].parts[1],))
        if function in (min, max):
            return self._extreme("<" if function is min else ">", values)
        if function in _KINDS:
            return self._number(values[0], _KINDS[function])
        if function is abs and values[0].kind.of == INT:
            zero = Value(ValueKind(INT), (INTEGER(0),))
            return self._extreme(">", [values[0], self._arithmetic(ast.Sub(), zero, values[0])])
        numbers = [self._converted(value, ValueKind(FLOAT)).parts[0] for value in values]
        if function is np.sign:
            above, below = (self._build.fcmp_ordered(sign, numbers[0], DOUBLE(0.0)) for sign in "><")
            less = self._build.select(below, DOUBLE(-1.0), numbers[0])
            return Value(ValueKind(FLOAT), (self._build.select(above, DOUBLE(1.0), less),))
        name = self._module.named(_FUNCTIONS[function], DOUBLE, *[DOUBLE] * len(numbers))
        return Value(ValueKind(FLOAT), (self._build.call(name, numbers),))

    def _kernel(self, python: FunctionType, any_order: bool, values: list[Value]) -> Values:
        build = self._build
        callee = self._module.function(python, any_order, tuple(value.kind for value in values))
        registers = [register for kind in callee.results for register in kind.registers]
        with build.goto_entry_block():
            row = build.alloca(INTEGER, len(registers) or 1)
        parts = [part for value in values for part in value.parts]
        build.call(callee.function, [self.function.args[0], row, *parts])
        self._holds |= any(kind.dimensions for kind in callee.results)
        results, index = [], 0
        for kind in callee.results:
            count = len(kind.registers)
            parts = [loaded(build, row, index + i, register) for i, register in enumerate(kind.registers)]
            results.append(Value(kind, tuple(parts)))
            index += count
        return results[0] if len(results) == 1 else tuple(results)

    def _method(self, function: ast.Attribute, arguments: Sequence[ast.expr]) -> Value:
        array = self._value(function.value)
        if function.attr == "reshape":
            shape = [self._index(one) for one in _elements(arguments)]
            return Value(ValueKind(array.kind.of, len(shape)), (array.parts[0], *shape))
        copy = self._allocated(array.kind.of, array.parts[1:], False)
        size = INTEGER(BYTES[array.kind.of])
        for one in array.parts[1:]:
            size = self._build.mul(size, one)
        move = self._module.named("llvm.memcpy.p0.p0.i64", ir.VoidType(), POINTER, POINTER, INTEGER, BIT)
        both = [self._build.bitcast(one.parts[0], POINTER) for one in (copy, array)]
        self._build.call(move, [*both, size, BIT(0)])
        return copy

    def _filled(self, function: Any, of: str, shape: Sequence[ir.Value]) -> Value:
        array = self._allocated(of, shape, function is np.zeros)
        if function is np.ones:
            assert [getattr(size, "constant", None) for size in shape] == [1]
            one = self._converted(Value(ValueKind(INT), (INTEGER(1),)), ValueKind(of)).parts[0]
            self._build.store(one, array.parts[0])
        return array

    def _extreme(self, sign: str, values: Sequence[Value]) -> Value:
        """As Python does it: the first one, unless a later one is beyond."""
        kind, (best, *others) = self._together(*values)
        compare = self._build.fcmp_ordered if kind == FLOAT else self._build.icmp_signed
        for other in others:
            best = self._build.select(compare(sign, other, best), other, best)
        return Value(ValueKind(kind), (best,))

    def _number(self, value: Value, of: str) -> Value:
        if value.kind.of == FLOAT and of == INT:
            return Value(ValueKind(INT), (self._build.fptosi(value.parts[0], INTEGER),))
        if of == WORD and value.kind.of == INT:
            return Value(ValueKind(WORD), value.parts)
        return self._converted(value, ValueKind(of))


def _elements(nodes: Sequence[ast.expr]) -> Sequence[ast.expr]:
    return nodes[0].elts if len(nodes) == 1 and isinstance(nodes[0], ast.Tuple) else nodes
