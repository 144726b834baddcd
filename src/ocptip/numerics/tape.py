"""CasADi's SX functions run for many states at once: every instruction over a block of states.

CasADi's own virtual machine takes one state at a time, so that decoding an instruction costs more than its
arithmetic. Here an instruction is decoded once for a block of states and its loop over them uses the
processor's vector units.
"""

from __future__ import annotations

import casadi as cs
import numpy as np

from ocptip.numerics.compiled import compiled

BLOCK = 128
"""States per block: the work vectors of a block should stay in the processor's cache."""

_NAMES = """
    CONST INPUT OUTPUT ASSIGN ADD SUB MUL DIV NEG SQ TWICE SQRT SIN COS TAN ASIN ACOS ATAN ATAN2 EXP LOG FABS
    SIGN FMIN FMAX INV POW CONSTPOW LT LE EQ NE NOT AND OR IF_ELSE_ZERO
""".split()  # noqa: SIM905
(
    _CONST,
    _INPUT,
    _OUTPUT,
    _ASSIGN,
    _ADD,
    _SUB,
    _MUL,
    _DIV,
    _NEG,
    _SQ,
    _TWICE,
    _SQRT,
    _SIN,
    _COS,
    _TAN,
    _ASIN,
    _ACOS,
    _ATAN,
    _ATAN2,
    _EXP,
    _LOG,
    _FABS,
    _SIGN,
    _FMIN,
    _FMAX,
    _INV,
    _POW,
    _CONSTPOW,
    _LT,
    _LE,
    _EQ,
    _NE,
    _NOT,
    _AND,
    _OR,
    _IF_ELSE_ZERO,
) = range(len(_NAMES))
_CODES = {getattr(cs, f"OP_{name}"): code for code, name in enumerate(_NAMES)}


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
        self._code = np.zeros((count, 4), dtype=np.int32)  # operation, two arguments, result
        self._constants = np.zeros(count)
        inputs = np.cumsum([0, *(function.numel_in(i) for i in range(function.n_in()))])
        outputs = np.cumsum([0, *(function.numel_out(i) for i in range(function.n_out()))])
        for k in range(count):
            operation = function.instruction_id(k)
            if operation not in _CODES:
                raise NotImplementedError(f"{function.name()}: CasADi operation {operation}")
            code = _CODES[operation]
            arguments, results = function.instruction_input(k), function.instruction_output(k)
            if code == _CONST:
                self._constants[k] = function.instruction_constant(k)
                row = 0, 0, results[0]
            elif code == _INPUT:
                row = inputs[arguments[0]] + arguments[1], 0, results[0]
            elif code == _OUTPUT:
                row = arguments[0], 0, outputs[results[0]] + results[1]
            else:
                row = arguments[0], arguments[-1], results[0]
            self._code[k] = code, *row
        self._work = function.sz_w()
        self._size = int(outputs[-1])

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """All results (results, N) of all arguments (arguments, N)."""
        outputs = np.zeros((self._size, inputs.shape[1]))
        _run(self._code, self._constants, np.ascontiguousarray(inputs), outputs, self._work)
        return outputs


@compiled
def _run(code, constants, inputs, outputs, size):
    work = np.empty((size, BLOCK))
    for start in range(0, inputs.shape[1], BLOCK):
        _run_block(code, constants, inputs, outputs, work, start, min(BLOCK, inputs.shape[1] - start))


@compiled
def _run_block(code, constants, inputs, outputs, work, start, n):
    for k in range(len(code)):
        operation = code[k, 0]
        if operation == _OUTPUT:
            outputs[code[k, 3], start : start + n] = work[code[k, 1], :n]
            continue
        z = work[code[k, 3]]
        if operation == _INPUT:
            z[:n] = inputs[code[k, 1], start : start + n]
            continue
        if operation == _CONST:
            z[:n] = constants[k]
            continue
        x, y = work[code[k, 1]], work[code[k, 2]]
        if operation == _MUL:
            for i in range(n):
                z[i] = x[i] * y[i]
        elif operation == _ADD:
            for i in range(n):
                z[i] = x[i] + y[i]
        elif operation == _SUB:
            for i in range(n):
                z[i] = x[i] - y[i]
        else:
            _seldom(operation, x, y, z, n)


@compiled
def _seldom(operation, x, y, z, n):
    if operation == _ASSIGN:
        for i in range(n):
            z[i] = x[i]
    elif operation == _DIV:
        for i in range(n):
            z[i] = x[i] / y[i]
    elif operation == _NEG:
        for i in range(n):
            z[i] = -x[i]
    elif operation == _SQ:
        for i in range(n):
            z[i] = x[i] * x[i]
    elif operation == _TWICE:
        for i in range(n):
            z[i] = 2.0 * x[i]
    elif operation == _SQRT:
        for i in range(n):
            z[i] = np.sqrt(x[i])
    elif operation == _SIN:
        for i in range(n):
            z[i] = np.sin(x[i])
    elif operation == _COS:
        for i in range(n):
            z[i] = np.cos(x[i])
    elif operation == _TAN:
        for i in range(n):
            z[i] = np.tan(x[i])
    elif operation == _ASIN:
        for i in range(n):
            z[i] = np.arcsin(x[i])
    elif operation == _ACOS:
        for i in range(n):
            z[i] = np.arccos(x[i])
    elif operation == _ATAN:
        for i in range(n):
            z[i] = np.arctan(x[i])
    elif operation == _ATAN2:
        for i in range(n):
            z[i] = np.arctan2(x[i], y[i])
    elif operation == _EXP:
        for i in range(n):
            z[i] = np.exp(x[i])
    elif operation == _LOG:
        for i in range(n):
            z[i] = np.log(x[i])
    elif operation == _FABS:
        for i in range(n):
            z[i] = abs(x[i])
    elif operation == _SIGN:
        for i in range(n):
            z[i] = np.sign(x[i])
    elif operation == _FMIN:
        for i in range(n):
            z[i] = np.fmin(x[i], y[i])
    elif operation == _FMAX:
        for i in range(n):
            z[i] = np.fmax(x[i], y[i])
    elif operation == _INV:
        for i in range(n):
            z[i] = 1.0 / x[i]
    elif operation in (_POW, _CONSTPOW):
        for i in range(n):
            z[i] = x[i] ** y[i]
    elif operation == _LT:
        for i in range(n):
            z[i] = 1.0 if x[i] < y[i] else 0.0
    elif operation == _LE:
        for i in range(n):
            z[i] = 1.0 if x[i] <= y[i] else 0.0
    elif operation == _EQ:
        for i in range(n):
            z[i] = 1.0 if x[i] == y[i] else 0.0
    elif operation == _NE:
        for i in range(n):
            z[i] = 1.0 if x[i] != y[i] else 0.0
    elif operation == _NOT:
        for i in range(n):
            z[i] = 1.0 if x[i] == 0.0 else 0.0
    elif operation == _AND:
        for i in range(n):
            z[i] = 1.0 if x[i] != 0.0 and y[i] != 0.0 else 0.0
    elif operation == _OR:
        for i in range(n):
            z[i] = 1.0 if x[i] != 0.0 or y[i] != 0.0 else 0.0
    else:  # _IF_ELSE_ZERO
        for i in range(n):
            z[i] = y[i] if x[i] != 0.0 else 0.0
