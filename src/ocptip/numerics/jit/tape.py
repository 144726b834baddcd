"""CasADi's SX functions run for many states at once: every instruction over a block of states.

CasADi's virtual machine takes one state at a time, so that decoding an instruction costs more than its
arithmetic. Here an instruction is decoded once for a block of states and its loop over them uses the
processor's vector units. Tapes that run often become machine code (`native`): six to ten times as fast, with
the same results to the last bit.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from enum import IntEnum

import casadi as cs
import numpy as np

from ocptip.numerics.jit.compiled import compiled
from ocptip.numerics.jit.native import LANES, Instruction, Native, native

BLOCK = 128
"""States per block: the work vectors of a block should stay in the processor's cache."""

# Numbers of our own: compiled code is kept on disk, and CasADi's may change.
_Op = IntEnum(
    "_Op",
    """
    CONST INPUT OUTPUT ASSIGN ADD SUB MUL DIV NEG SQ TWICE SQRT SIN COS TAN ASIN ACOS ATAN ATAN2 EXP LOG FABS
    SIGN FMIN FMAX INV POW CONSTPOW LT LE EQ NE NOT AND OR IF_ELSE_ZERO
    """,
)
SEARCHED, QUICK, WORTH = 3, 60, 2000
"""Blocks after which machine code is searched on disk, is compiled quickly, and is worth more effort."""

_CODES = {getattr(cs, f"OP_{op.name}"): int(op) for op in _Op}
_CONST, _INPUT, _OUTPUT = int(_Op.CONST), int(_Op.INPUT), int(_Op.OUTPUT)  # plain numbers compare faster


def instruction_name(operation: int) -> str:
    """The name here of what an instruction of CasADi does.

    Raises:
        NotImplementedError: it is not known here.
    """
    if operation not in _CODES:
        raise NotImplementedError(f"CasADi operation {operation}")
    return _Op(_CODES[operation]).name


class Tape:
    """The instructions of an SX function of dense arguments and results.

    Args:
        function: the function.

    Raises:
        NotImplementedError: it has an instruction that is not known here, or is no SX function.
    """

    def __init__(self, function: cs.Function) -> None:
        if not function.is_a("SXFunction"):
            raise NotImplementedError(f"{function.name()} is no SX function")
        count = function.n_instructions()
        operations = [function.instruction_id(k) for k in range(count)]
        if unknown := set(operations) - set(_CODES):
            raise NotImplementedError(f"{function.name()}: CasADi operation {min(unknown)}")
        self._code = np.zeros((count, 4), dtype=np.int64)  # operation, two arguments, result
        self._code[:, 0] = codes = [_CODES[operation] for operation in operations]
        self._constants = np.zeros(count)
        inputs = np.cumsum([0, *(function.numel_in(i) for i in range(function.n_in()))]).tolist()
        outputs = np.cumsum([0, *(function.numel_out(i) for i in range(function.n_out()))]).tolist()
        rows = []
        for k, code in enumerate(codes):
            results = function.instruction_output(k)
            if code == _CONST:
                self._constants[k] = function.instruction_constant(k)
                rows.append((0, 0, results[0]))
                continue
            arguments = function.instruction_input(k)
            if code == _INPUT:
                rows.append((inputs[arguments[0]] + arguments[1], 0, results[0]))
            elif code == _OUTPUT:
                rows.append((arguments[0], 0, outputs[results[0]] + results[1]))
            else:
                rows.append((arguments[0], arguments[-1], results[0]))
        self._code[:, 1:] = np.reshape(rows, (count, 3))
        self._work = function.sz_w()
        self._arguments, self._size = int(inputs[-1]), int(outputs[-1])
        self._blocks, self._native, self._lock = 0, None, threading.Lock()

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """All results (results, N) of all arguments (arguments, N)."""
        outputs = np.empty((self._size, inputs.shape[1]))
        inputs = np.ascontiguousarray(inputs)
        if self._blocks < WORTH:
            self._count(-(-inputs.shape[1] // BLOCK))
        if self._native is not None:
            self._native(inputs, self._constants, outputs)
        else:
            _run(self._code, self._constants, inputs, outputs, self._work)
        return outputs

    def _count(self, blocks: int) -> None:
        """Count blocks; machine code if it is time for it."""
        with self._lock:
            before, self._blocks = self._blocks, self._blocks + blocks
            for number, effort in ((SEARCHED, None), (QUICK, 0), (WORTH, 1)):
                if before < number <= self._blocks and (effort or self._native is None):
                    self._native = self.native(effort)

    def native(self, effort: int | None, lanes: int = LANES) -> Native | None:
        """Machine code, see `native`."""
        return native(self._instructions, self._code.tobytes(), effort, lanes)

    def point(self) -> tuple[np.ndarray, np.ndarray, Callable[[], None]]:
        """Machine code for thousands of states one after the other, compiled now.

        Returns:
            Arguments (arguments,), to be filled; results (results,); and what computes these from those.
        """
        code = self.native(1, lanes=1)
        assert code is not None
        inputs, outputs = np.zeros((self._arguments, 1)), np.empty((self._size, 1))
        return inputs[:, 0], outputs[:, 0], code.bound(inputs, self._constants, outputs)

    def _instructions(self) -> list[Instruction]:
        names = [_Op(code).name for code in self._code[:, 0]]
        rows = self._code[:, 1:].tolist()
        return [
            (name, k, 0, row[2]) if name == "CONST" else (name, row[0], row[1], row[2])
            for k, (name, row) in enumerate(zip(names, rows, strict=True))
        ]


@compiled
def _run(code, constants, inputs, outputs, size):
    work = np.empty((size, BLOCK))
    for start in range(0, inputs.shape[1], BLOCK):
        _run_block(code, constants, inputs, outputs, work, start, min(BLOCK, inputs.shape[1] - start))


@compiled
def _run_block(code, constants, inputs, outputs, work, start, n):
    for k in range(len(code)):
        operation = code[k, 0]
        if operation == _Op.OUTPUT:
            for i in range(n):
                outputs[code[k, 3], start + i] = work[code[k, 1], i]
            continue
        z = work[code[k, 3]]
        if operation == _Op.INPUT:
            for i in range(n):
                z[i] = inputs[code[k, 1], start + i]
            continue
        if operation == _Op.CONST:
            for i in range(n):
                z[i] = constants[k]
            continue
        x, y = work[code[k, 1]], work[code[k, 2]]
        if operation == _Op.MUL:
            for i in range(n):
                z[i] = x[i] * y[i]
        elif operation == _Op.ADD:
            for i in range(n):
                z[i] = x[i] + y[i]
        elif operation == _Op.SUB:
            for i in range(n):
                z[i] = x[i] - y[i]
        elif operation == _Op.NEG:
            for i in range(n):
                z[i] = -x[i]
        elif operation == _Op.SQ:
            for i in range(n):
                z[i] = x[i] * x[i]
        else:
            for i in range(n):
                z[i] = _value(operation, x[i], y[i])


@compiled
def _value(operation, x, y):
    """One of the operations that occur too seldom for a separate loop."""
    if operation == _Op.DIV:
        return x / y
    if operation == _Op.TWICE:
        return 2.0 * x
    if operation == _Op.ASSIGN:
        return x
    if operation == _Op.SQRT:
        return np.sqrt(x)
    if operation == _Op.SIN:
        return np.sin(x)
    if operation == _Op.COS:
        return np.cos(x)
    if operation == _Op.TAN:
        return np.tan(x)
    if operation == _Op.ASIN:
        return np.arcsin(x)
    if operation == _Op.ACOS:
        return np.arccos(x)
    if operation == _Op.ATAN:
        return np.arctan(x)
    if operation == _Op.ATAN2:
        return np.arctan2(x, y)
    if operation == _Op.EXP:
        return np.exp(x)
    if operation == _Op.LOG:
        return np.log(x)
    if operation == _Op.FABS:
        return np.abs(x)
    if operation == _Op.SIGN:
        return np.sign(x)
    if operation == _Op.FMIN:
        return np.fmin(x, y)
    if operation == _Op.FMAX:
        return np.fmax(x, y)
    if operation == _Op.INV:
        return 1.0 / x
    if operation == _Op.POW or operation == _Op.CONSTPOW:
        return x**y
    if operation == _Op.LT:
        return 1.0 if x < y else 0.0
    if operation == _Op.LE:
        return 1.0 if x <= y else 0.0
    if operation == _Op.EQ:
        return 1.0 if x == y else 0.0
    if operation == _Op.NE:
        return 1.0 if x != y else 0.0
    if operation == _Op.NOT:
        return 1.0 if x == 0.0 else 0.0
    if operation == _Op.AND:
        return 1.0 if x != 0.0 and y != 0.0 else 0.0
    if operation == _Op.OR:
        return 1.0 if x != 0.0 or y != 0.0 else 0.0
    return y if x != 0.0 else 0.0  # IF_ELSE_ZERO
