"""Instructions of a tape as machine code: no decoding, eight states at a time or one, kept on disk.

LLVM gets one straight line of vector instructions, without licence to reorder or
contract: results are those of the interpreter to the last bit. Compiling costs about 0.1 ms per instruction,
or a fifth of that for code that takes twice as long. A tape asks for the one where it has run some time, for
the other where it has run often; a later process finds the code on disk.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import partial
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir

from ocptip.numerics.jit.machine import Library, keep_code, kept_code, target

LANES = 8
"""States at a time where there are many."""
_DOUBLE, _INTEGER = ir.DoubleType(), ir.IntType(64)
_DIRECT = {"ADD": "fadd", "SUB": "fsub", "MUL": "fmul", "DIV": "fdiv"}
_INTRINSICS = {
    "SQRT": "sqrt", "SIN": "sin", "COS": "cos", "EXP": "exp", "LOG": "log", "FABS": "fabs", "FMIN": "minnum",
    "FMAX": "maxnum", "POW": "pow", "CONSTPOW": "pow",
}  # fmt: skip
_OF_THE_C_LIBRARY = {"TAN": "tan", "ASIN": "asin", "ACOS": "acos", "ATAN": "atan", "ATAN2": "atan2"}
_COMPARISONS = {"LT": "<", "LE": "<=", "EQ": "=="}

Instruction = tuple[str, int, int, int]
"""Name of the operation, two arguments, result: registers, inputs, outputs, or a constant's number."""


class Native:
    """Machine code of a tape.

    Args:
        code: machine code for this processor, as `machine_code` gives it.
        lanes: states at a time there.
    """

    def __init__(self, code: bytes, lanes: int) -> None:
        self._lanes = lanes
        self._function = Library(code).function("run", *[ctypes.c_void_p] * 3, ctypes.c_int64)

    def __call__(self, inputs: np.ndarray, constants: np.ndarray, outputs: np.ndarray) -> None:
        """Puts results into outputs (results, N) for inputs (arguments, N), both contiguous."""
        count = inputs.shape[1]
        if count == 0:
            return
        if count < self._lanes:
            few, results = (np.empty((len(rows), self._lanes)) for rows in (inputs, outputs))
            few[:, :count], few[:, count:] = inputs, inputs[:, -1:]
            self(few, constants, results)
            outputs[:] = results[:, :count]
            return
        self._function(inputs.ctypes.data, constants.ctypes.data, outputs.ctypes.data, count)

    def bound(self, *arrays: np.ndarray) -> Callable[[], None]:
        """The call with these arrays again and again: microseconds less. At least as many states as lanes."""
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in arrays]  # they keep the arrays
        return partial(self._function, *pointers, ctypes.c_int64(arrays[0].shape[1]))


def native(
    instructions: Callable[[], list[Instruction]], key: bytes, effort: int | None, lanes: int = LANES
) -> Native | None:
    """Machine code from disk, or compiled now and put there.

    Args:
        instructions: of the tape.
        key: what tells it from others.
        effort: 0: compiled five times as fast, and half as fast as with 1; None: only the best from disk.
        lanes: states at a time.

    Returns:
        None if there is none.
    """
    for kept in (1, 0)[: 2 - (effort or 0)]:
        if code := kept_code(bytes([lanes, kept]) + key):
            return Native(code, lanes)
    if effort is None:
        return None
    code = machine_code(instructions(), lanes, effort)
    keep_code(bytes([lanes, effort]) + key, code)
    return Native(code, lanes)


def machine_code(instructions: list[Instruction], lanes: int, effort: int = 1) -> bytes:
    """Machine code of instructions for this processor."""
    return target(effort).emit_object(llvm.parse_assembly(_assembly(instructions, lanes)))


def _assembly(instructions: list[Instruction], lanes: int) -> str:
    """A function (inputs, constants, outputs, N): a loop over blocks of lanes, the last one flush right."""
    module = ir.Module("tape")
    module.triple = llvm.get_process_triple()
    pointer = _DOUBLE.as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [pointer, pointer, pointer, _INTEGER])
    function = ir.Function(module, kind, "run")
    for argument in function.args[:3]:
        argument.add_attribute("noalias")
    begin, loop, end = (function.append_basic_block(name) for name in ("begin", "loop", "end"))
    build = ir.IRBuilder(begin)
    build.branch(loop)
    build.position_at_end(loop)
    lane = build.phi(_INTEGER)
    lane.add_incoming(_INTEGER(0), begin)
    _Line(module, build, function.args, lane, lanes).add(instructions)
    last = build.sub(function.args[3], _INTEGER(lanes))
    ahead = build.add(lane, _INTEGER(lanes))
    following = build.select(build.icmp_signed("<", ahead, last), ahead, last)
    lane.add_incoming(following, loop)
    build.cbranch(build.icmp_signed("<", lane, last), loop, end)
    ir.IRBuilder(end).ret_void()
    return str(module)


class _Line:
    """Builds the straight line of one block of lanes."""

    def __init__(
        self, module: ir.Module, build: ir.IRBuilder, arguments: tuple, lane: ir.Value, lanes: int
    ) -> None:
        self._lanes, self._vector = lanes, ir.VectorType(_DOUBLE, lanes)
        self._module, self._build, self._lane = module, build, lane
        self._inputs, self._constants, self._outputs, self._count = arguments
        self._functions: dict[str, ir.Function] = {}
        self._zero, self._one, self._minus = (
            ir.Constant(self._vector, [v] * lanes) for v in (0.0, 1.0, -1.0)
        )

    def add(self, instructions: list[Instruction]) -> None:
        build, registers = self._build, dict[int, ir.Value]()
        for name, first, second, result in instructions:
            if name == "INPUT":
                registers[result] = build.load(self._at(self._inputs, first), align=8)
            elif name == "OUTPUT":
                build.store(registers[first], self._at(self._outputs, result), align=8)
            elif name == "CONST":
                value = build.load(build.gep(self._constants, [_INTEGER(first)]))
                alone = build.insert_element(
                    ir.Constant(self._vector, ir.Undefined), value, ir.IntType(32)(0)
                )
                everywhere = ir.Constant(ir.VectorType(ir.IntType(32), self._lanes), [0] * self._lanes)
                registers[result] = build.shuffle_vector(alone, alone, everywhere)
            else:
                registers[result] = self._value(name, registers[first], registers[second])

    def _at(self, base: ir.Value, row: int) -> Any:
        build = self._build
        place = build.add(build.mul(self._count, _INTEGER(row)), self._lane)
        return build.bitcast(build.gep(base, [place]), self._vector.as_pointer())

    def _value(self, name: str, x: Any, y: Any) -> Any:
        build, zero, one = self._build, self._zero, self._one
        if name in _DIRECT:
            return getattr(build, _DIRECT[name])(x, y)
        if name in _INTRINSICS:
            both = name in ("FMIN", "FMAX", "POW", "CONSTPOW")
            return build.call(
                self._function(f"llvm.{_INTRINSICS[name]}.v{self._lanes}f64", self._vector, both),
                self._of(x, y, both),
            )
        if name in _OF_THE_C_LIBRARY:
            return self._by_lane(self._function(_OF_THE_C_LIBRARY[name], _DOUBLE, name == "ATAN2"), x, y)
        if name in _COMPARISONS:
            return build.select(build.fcmp_ordered(_COMPARISONS[name], x, y), one, zero)
        above, below = (build.fcmp_ordered(sign, x, zero) for sign in "><")
        set_, other = (build.fcmp_unordered("!=", one_of, zero) for one_of in (x, y))
        made: dict[str, Callable[[], Any]] = {
            "ASSIGN": lambda: x,
            "NEG": lambda: build.fneg(x),
            "SQ": lambda: build.fmul(x, x),
            "TWICE": lambda: build.fadd(x, x),
            "INV": lambda: build.fdiv(one, x),
            "SIGN": lambda: build.select(above, one, build.select(below, self._minus, x)),
            "NE": lambda: build.select(build.fcmp_unordered("!=", x, y), one, zero),
            "NOT": lambda: build.select(set_, zero, one),
            "AND": lambda: build.select(build.and_(set_, other), one, zero),
            "OR": lambda: build.select(build.or_(set_, other), one, zero),
            "IF_ELSE_ZERO": lambda: build.select(set_, y, zero),
        }
        return made[name]()

    @staticmethod
    def _of(x: ir.Value, y: ir.Value, both: bool) -> list[ir.Value]:
        return [x, y] if both else [x]

    def _function(self, name: str, kind: ir.Type, both: bool) -> ir.Function:
        if name not in self._functions:
            kind_of_function = ir.FunctionType(kind, [kind] * (1 + both))
            self._functions[name] = ir.Function(self._module, kind_of_function, name)
        return self._functions[name]

    def _by_lane(self, function: ir.Function, x: Any, y: Any) -> Any:
        build, result = self._build, ir.Constant(self._vector, ir.Undefined)
        for k in range(self._lanes):
            place = ir.IntType(32)(k)
            given = [build.extract_element(v, place) for v in (x, y)[: len(function.args)]]
            result = build.insert_element(result, build.call(function, given), place)
        return result
