"""Text of generated functions: C source and header, written completely or not at all; and Matlab."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import MARK, file_target
from ocptip.parallel.code.lean import LeanFunction
from ocptip.parallel.code.leg_plans import count_operations

_OWN = ("geometry", "inertia", "gravity", "joint_terms")  # arguments whose values a robot has


@dataclass(frozen=True)
class CFiles:
    """The files of generated C code.

    Attributes:
        source, header: the files.
        function: name of the C function, `int name(const double** arg, double** res, ...)`.
    """

    source: Path
    header: Path
    function: str


def write_c(
    functions: LeanFunction | cs.Function | Sequence[LeanFunction | cs.Function],
    path: str | os.PathLike[str],
    *,
    main: bool = False,
) -> CFiles:
    """Write functions as C source with a header beside it.

    Matrices are stored column by column and densely. The comment at the top of the C file lists all inputs
    and outputs in order, with the names of the parameters and their values for the robot.

    Args:
        functions: one or several, of different names.
        path: of the C file, ending in .c; the header gets the same name with .h.
        main: add a `main` that evaluates a function from the command line.

    Raises:
        InputError: path does not end in .c, its name is not an identifier, or functions share a name.
        OSError: the folder cannot be written.
    """
    target = file_target(path, (".c",))
    if not target.stem.isidentifier():
        raise InputError(f"path: expected a file NAME.c with NAME an identifier, got {str(path)!r}")
    listed = [functions] if isinstance(functions, LeanFunction | cs.Function) else list(functions)
    plain = [one.function if isinstance(one, LeanFunction) else one for one in listed]
    names = [one.name() for one in plain]
    if not plain or len(set(names)) != len(names):
        raise InputError(f"functions: expected at least one, with different names, got {names}")
    generator = cs.CodeGenerator(target.name, {"with_header": True, "main": main, "mex": True})
    for one in plain:
        generator.add(one)
    header = target.with_suffix(".h")
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=f".{target.stem}-") as folder:
        generator.generate(folder + os.sep)
        made = Path(folder) / target.name
        comment = "\n".join("/* {}\n */".format("\n * ".join(described(one))) for one in listed)
        for written, about in ((made, comment), (made.with_suffix(".h"), f"/* {MARK}. */")):
            written.write_bytes(f"{about}\n".encode() + written.read_bytes())
        os.replace(made.with_suffix(".h"), header)
        os.replace(made, target)
    return CFiles(target, header, names[0])


def described(given: LeanFunction | cs.Function) -> list[str]:
    """Lines on a function: operations, inputs and outputs in order, and the values of its robot."""
    function = given.function if isinstance(given, LeanFunction) else given
    lines = [f"{function.name()}: {MARK} with CasADi {cs.CasadiMeta.version()}."]
    if function.is_a("SXFunction"):
        count = count_operations(function)
        lines.append(
            f"{count.additions} additions, {count.multiplications} multiplications, {count.divisions} "
            f"divisions, {count.trigonometric} sines and cosines."
        )
    for kind, names, size in (
        ("arg", function.name_in(), function.size_in),
        ("res", function.name_out(), function.size_out),
    ):
        for k, name in enumerate(names):
            rows, columns = size(k)
            lines.append(f"{kind}[{k}]: {name}, {rows} x {columns}{_entries(given, name)}")
            if kind == "arg" and isinstance(given, LeanFunction) and rows * columns and name in _OWN:
                own = np.ravel(getattr(given, name), order="F").tolist()
                lines.append(f"  of this robot: {{{', '.join(map(repr, own))}}}")
    return lines


def _entries(given: LeanFunction | cs.Function, name: str) -> str:
    if not isinstance(given, LeanFunction):
        return ""
    names = {"inertia": given.inertia_names, "geometry": given.geometry_names}.get(name, ())
    return f": {', '.join(names)}" if names else ""


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
