"""Generated functions as text: a Matlab file of single assignments, which Octave reads as well."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import MARK
from ocptip.parallel.code.codegen import described
from ocptip.parallel.code.lean import LeanFunction

_TEXTS = {
    cs.OP_ADD: "{} + {}",
    cs.OP_SUB: "{} - {}",
    cs.OP_MUL: "{} * {}",
    cs.OP_DIV: "{} / {}",
    cs.OP_NEG: "-{}",
    cs.OP_TWICE: "2 * {}",
    cs.OP_SQ: "{0} * {0}",
    cs.OP_INV: "1 / {}",
    cs.OP_SIN: "sin({})",
    cs.OP_COS: "cos({})",
    cs.OP_SQRT: "sqrt({})",
    cs.OP_FABS: "abs({})",
    cs.OP_SIGN: "sign({})",
    cs.OP_ATAN2: "atan2({}, {})",
    cs.OP_FMAX: "max({}, {})",
    cs.OP_FMIN: "min({}, {})",
}


def matlab_text(functions: Sequence[LeanFunction | cs.Function], name: str) -> str:
    """A Matlab file whose first argument names the function, as for the MEX file of `write_c`.

    Args:
        functions: built from SX, of different names.
        name: of the file, without .m.

    Raises:
        InputError: a function has an operation that this text has not.
    """
    plain = [one.function if isinstance(one, LeanFunction) else one for one in functions]
    for one in plain:
        if not one.is_a("SXFunction"):
            raise InputError(f"{one.name()}: calls other functions and has no text of single assignments")
    lines = [f"function varargout = {name}(name, varargin)", f"% {MARK}."]
    lines += [f"% {line}" for one in functions for line in described(one)]
    lines.append("switch name")
    for one in plain:
        lines += [
            f"case '{one.name()}'",
            f"  [varargout{{1:max(1, nargout)}}] = {one.name()}(varargin{{:}});",
        ]
    known = ", ".join(one.name() for one in plain)
    lines += ["otherwise", f"  error('there is no %s; there are {known}', name);", "end", "end"]
    return "\n".join([*lines, *(line for one in plain for line in _function(one))]) + "\n"


def _function(function: cs.Function) -> list[str]:
    """The lines of one function; every value has one name."""
    inputs, outputs = function.name_in(), function.name_out()
    shapes = [function.size_out(k) for k in range(len(outputs))]
    lines = ["", f"function [{', '.join(outputs)}] = {function.name()}({', '.join(inputs)})"]
    lines += [
        f"{out} = zeros({rows}, {columns});" for out, (rows, columns) in zip(outputs, shapes, strict=True)
    ]
    values: dict[int, str] = {}
    for k in range(function.n_instructions()):
        code, to, given = (
            function.instruction_id(k), function.instruction_output(k), function.instruction_input(k)
        )  # fmt: skip
        if code == cs.OP_CONST:
            constant = float(function.instruction_constant(k))
            values[to[0]] = repr(constant) if constant >= 0 else f"({constant!r})"
        elif code == cs.OP_INPUT:
            values[to[0]] = f"{inputs[given[0]]}({_place(function.sparsity_in(given[0]), given[1])})"
        elif code == cs.OP_OUTPUT:
            place = _place(function.sparsity_out(to[0]), to[1])
            lines.append(f"{outputs[to[0]]}({place}) = {values[given[0]]};")
        elif code in _TEXTS:
            lines.append(f"t{k} = {_TEXTS[code].format(*(values[j] for j in given))};")
            values[to[0]] = f"t{k}"
        else:
            raise InputError(f"{function.name()}: operation {code} of CasADi has no text")
    return [*lines, "end"]


def _place(sparsity: cs.Sparsity, number: int) -> int:
    """Index from 1, column by column, of an entry that is not always zero."""
    row, column = (np.array(found)[number] for found in sparsity.get_triplet())
    return int(row + column * sparsity.size1()) + 1
