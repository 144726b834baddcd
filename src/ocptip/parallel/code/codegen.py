"""C source and header of generated functions, also for Matlab and Simulink; all is written, or nothing."""

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
    and outputs in order, with the names of the parameters and their values for the robot. The C file is also
    a MEX function (`-DMATLAB_MEX_FILE`) and a level-2 S-function of Simulink (`-DS_FUNCTION_NAME=...`).

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
    plain = [LeanFunction.of(one).function for one in listed]
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
        made.write_text(_with_block(made.read_text(encoding="utf-8"), plain), encoding="utf-8")
        os.replace(made.with_suffix(".h"), header)
        os.replace(made, target)
    return CFiles(target, header, names[0])


def described(given: LeanFunction | cs.Function) -> list[str]:
    """Lines on a function: operations, inputs and outputs in order, and the values of its robot."""
    lean = LeanFunction.of(given)
    function = lean.function
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
            entries = lean.entries.get(name, ())
            named = f": {', '.join(entries)}" if entries else ""
            lines.append(f"{kind}[{k}]: {name}, {rows} x {columns}{named}")
            values = np.ravel(getattr(lean, name), order="F").tolist() if name in _OWN else []
            if kind == "arg" and values:
                lines.append(f"  of this robot: {{{', '.join(map(repr, values))}}}")
    return lines


# Simulink's own gateway (simulink.c) and that of CasADi both define mexFunction: the latter is left out.
_BEFORE_BLOCK = """\
#ifdef S_FUNCTION_NAME
#define S_FUNCTION_LEVEL 2
#include "simstruc.h"
#ifdef MATLAB_MEX_FILE
#undef MATLAB_MEX_FILE
#define BLOCK_IS_MEX
#endif
#endif
"""
_BLOCK = """
#ifdef S_FUNCTION_NAME
#ifdef BLOCK_IS_MEX
#define MATLAB_MEX_FILE
#endif
/* The parameter of the block is the name of a function. Its ports are the arguments that are not empty. */
typedef struct {
  const char *name;
  int (*call)(const casadi_real**, casadi_real**, casadi_int*, casadi_real*, int);
  casadi_int n_in, n_out;
  const casadi_int *(*in)(casadi_int), *(*out)(casadi_int);
} block_function;
static const block_function block_functions[] = {
%(rows)s
};
static const block_function* block_chosen(SimStruct *S) {
  char name[128];
  size_t k;
  if (mxGetString(ssGetSFcnParam(S, 0), name, sizeof(name))) return 0;
  for (k = 0; k < sizeof(block_functions) / sizeof(block_functions[0]); ++k)
    if (!strcmp(name, block_functions[k].name)) return block_functions + k;
  return 0;
}
static casadi_int block_nonzeros(const casadi_int *sp) { return sp[2] == 1 ? sp[0] * sp[1] : sp[2 + sp[1]]; }
/* Index in a dense matrix of a nonzero of one. */
static casadi_int block_place(const casadi_int *sp, casadi_int k) {
  casadi_int column = 0;
  if (sp[2] == 1) return k;
  while (sp[3 + column] <= k) ++column;
  return sp[3 + sp[1] + k] + column * sp[0];
}
static void mdlInitializeSizes(SimStruct *S) {
  const block_function *f;
  const casadi_int *sp;
  casadi_int i;
  int_T port = 0, ports = 0;
  ssSetNumSFcnParams(S, 1);
  if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) return;
  ssSetSFcnParamTunable(S, 0, 0);
  f = block_chosen(S);
  if (!f) {
    ssSetErrorStatus(S, "The parameter is no name of a function; there are %(names)s");
    return;
  }
  ssSetNumContStates(S, 0);
  ssSetNumDiscStates(S, 0);
  for (i = 0; i < f->n_in; ++i) ports += f->in(i)[0] * f->in(i)[1] > 0;
  if (!ssSetNumInputPorts(S, ports)) return;
  for (i = 0; i < f->n_in; ++i) {
    sp = f->in(i);
    if (sp[0] * sp[1] == 0) continue;
    if (sp[1] == 1) ssSetInputPortWidth(S, port, (int_T) sp[0]);
    else ssSetInputPortMatrixDimensions(S, port, (int_T) sp[0], (int_T) sp[1]);
    ssSetInputPortRequiredContiguous(S, port, 1);
    ssSetInputPortDirectFeedThrough(S, port, 1);
    ++port;
  }
  if (!ssSetNumOutputPorts(S, (int_T) f->n_out)) return;
  for (i = 0; i < f->n_out; ++i) {
    sp = f->out(i);
    if (sp[1] == 1) ssSetOutputPortWidth(S, (int_T) i, (int_T) sp[0]);
    else ssSetOutputPortMatrixDimensions(S, (int_T) i, (int_T) sp[0], (int_T) sp[1]);
  }
  ssSetNumSampleTimes(S, 1);
  ssSetOptions(S, SS_OPTION_EXCEPTION_FREE_CODE);
}
static void mdlInitializeSampleTimes(SimStruct *S) {
  ssSetSampleTime(S, 0, INHERITED_SAMPLE_TIME);
  ssSetOffsetTime(S, 0, 0.0);
}
static void mdlOutputs(SimStruct *S, int_T tid) {
  const block_function *f = block_chosen(S);
  const casadi_real *arg[%(arg)d] = {0};
  casadi_real *res[%(res)d] = {0};
  casadi_int iw[%(iw)d], i, k;
  casadi_real w[%(w)d], *free_w = w;
  int_T port = 0;
  (void) tid;
  for (i = 0; i < f->n_in; ++i) {
    const casadi_int *sp = f->in(i);
    const real_T *u;
    if (sp[0] * sp[1] == 0) continue;
    u = (const real_T*) ssGetInputPortSignal(S, port++);
    arg[i] = free_w;
    for (k = 0; k < block_nonzeros(sp); ++k) *free_w++ = u[block_place(sp, k)];
  }
  for (i = 0; i < f->n_out; ++i) {
    res[i] = free_w;
    free_w += block_nonzeros(f->out(i));
  }
  if (f->call(arg, res, iw, free_w, 0)) {
    ssSetErrorStatus(S, "The function cannot be evaluated");
    return;
  }
  for (i = 0; i < f->n_out; ++i) {
    const casadi_int *sp = f->out(i);
    real_T *y = (real_T*) ssGetOutputPortSignal(S, (int_T) i);
    for (k = 0; k < sp[0] * sp[1]; ++k) y[k] = 0;
    for (k = 0; k < block_nonzeros(sp); ++k) y[block_place(sp, k)] = res[i][k];
  }
}
static void mdlTerminate(SimStruct *S) { (void) S; }
#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
#endif
"""


def _with_block(source: str, functions: Sequence[cs.Function]) -> str:
    """C source that is a block of Simulink as well; that of CasADi takes all signals as contiguous."""
    rows = [
        f'  {{"{name}", {name}, {one.n_in()}, {one.n_out()}, {name}_sparsity_in, {name}_sparsity_out}}'
        for one in functions
        for name in [one.name()]
    ]
    packed = max(
        sum(map(one.nnz_in, range(one.n_in()))) + sum(map(one.nnz_out, range(one.n_out()))) + one.sz_w()
        for one in functions
    )
    sizes = {
        "arg": max(one.sz_arg() for one in functions),
        "res": max(one.sz_res() for one in functions),
        "iw": max(one.sz_iw() for one in functions),
        "w": packed,
    }
    sizes = {key: max(1, size) for key, size in sizes.items()}
    names = ", ".join(one.name() for one in functions)
    return _BEFORE_BLOCK + source + _BLOCK % {"rows": ",\n".join(rows), "names": names, **sizes}
