"""Values of kernels while LLVM's intermediate representation of them is written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import ir

DOUBLE, INTEGER, BIT, BYTE = ir.DoubleType(), ir.IntType(64), ir.IntType(1), ir.IntType(8)
POINTER = BYTE.as_pointer()
FLOAT, INT, WORD, BOOL = "float64", "int64", "uint64", "bool"
"""Kinds of numbers, and of the elements of arrays."""
_REGISTERS = {FLOAT: DOUBLE, INT: INTEGER, WORD: INTEGER, BOOL: BIT}
STORED = {**_REGISTERS, BOOL: BYTE}
BYTES = {FLOAT: 8, INT: 8, WORD: 8, BOOL: 1}


@dataclass(frozen=True)
class ValueKind:
    """Of a value: a number, or an array of numbers.

    Attributes:
        of: kind of the number, or of the elements.
        dimensions: of the array; 0 for a number.
    """

    of: str
    dimensions: int = 0

    @property
    def registers(self) -> list[ir.Type]:
        """What holds a value: the number, or the address and the shape of the array."""
        if not self.dimensions:
            return [_REGISTERS[self.of]]
        return [STORED[self.of].as_pointer()] + [INTEGER] * self.dimensions


@dataclass(frozen=True)
class Value:
    """A value while a function runs."""

    kind: ValueKind
    parts: tuple[Any, ...]


Values = Value | tuple["Values", ...]


def loaded(build: Any, row: ir.Value, position: int, register: ir.Type) -> ir.Value:
    place = build.gep(row, [INTEGER(position)])
    if register == BIT:
        return build.icmp_signed("!=", build.load(place), INTEGER(0))
    return build.load(build.bitcast(place, register.as_pointer()))


def flat(values: Values) -> list[Value]:
    return [values] if isinstance(values, Value) else [one for value in values for one in flat(value)]


def constant(value: Any) -> Value:
    if isinstance(value, bool | np.bool_):
        return Value(ValueKind(BOOL), (BIT(int(value)),))
    if isinstance(value, int):
        return Value(ValueKind(INT), (INTEGER(int(value)),))
    return Value(ValueKind(FLOAT), (DOUBLE(float(value)),))
