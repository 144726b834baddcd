"""C code of generated functions: source and header, written completely or not at all.

The code allocates nothing, calls nothing but sin, cos and the like, and has no conditional except for the
sign of Coulomb friction. Where MATLAB_MEX_FILE is defined it also has a gateway for Matlab and Octave.
"""

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
from ocptip.parallel.code.counting import count_operations
from ocptip.parallel.code.lean import LeanFunction

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
