"""The C source as a block of Simulink, against a stand-in of simstruc.h: Simulink itself is not here."""

from __future__ import annotations

import subprocess

import casadi as cs
import numpy as np
import pytest

from ocptip.parallel.code.codegen import write_c
from ocptip.parallel.code.lean import lean_function
from tests.parallel.code.test_codegen import COMPILER, arguments
from tests.parallel.parallel_cases import golden

# Names and meanings of the macros are those of MathWorks' documentation of level-2 S-functions.
SIMSTRUC = r"""
#include <string.h>
typedef double real_T;
typedef int int_T;
typedef struct {
  const char *parameter, *error;
  int_T parameters, given, inputs, outputs, rows[2][16], columns[2][16], contiguous[16], through[16], times;
  double *in[16], *out[16];
} SimStruct;
#define ssSetNumSFcnParams(S, n) ((S)->parameters = (n))
#define ssGetNumSFcnParams(S) ((S)->parameters)
#define ssGetSFcnParamsCount(S) ((S)->given)
#define ssSetSFcnParamTunable(S, k, yes) ((void) (yes))
#define ssGetSFcnParam(S, k) ((S)->parameter)
#define mxGetString(text, to, size) (strlen(text) >= (size) || !strcpy(to, text))
#define ssSetErrorStatus(S, text) ((S)->error = (text))
#define ssSetNumContStates(S, n) ((void) (n))
#define ssSetNumDiscStates(S, n) ((void) (n))
#define ssSetNumInputPorts(S, n) ((S)->inputs = (n), (n) <= 16)
#define ssSetNumOutputPorts(S, n) ((S)->outputs = (n), (n) <= 16)
#define ssSetInputPortWidth(S, k, n) ((S)->rows[0][k] = (n), (S)->columns[0][k] = 1)
#define ssSetOutputPortWidth(S, k, n) ((S)->rows[1][k] = (n), (S)->columns[1][k] = 1)
#define ssSetInputPortMatrixDimensions(S, k, m, n) ((S)->rows[0][k] = (m), (S)->columns[0][k] = (n))
#define ssSetOutputPortMatrixDimensions(S, k, m, n) ((S)->rows[1][k] = (m), (S)->columns[1][k] = (n))
#define ssSetInputPortRequiredContiguous(S, k, yes) ((S)->contiguous[k] = (yes))
#define ssSetInputPortDirectFeedThrough(S, k, yes) ((S)->through[k] = (yes))
#define ssSetNumSampleTimes(S, n) ((S)->times = (n))
#define ssSetSampleTime(S, k, t) ((void) (t))
#define ssSetOffsetTime(S, k, t) ((void) (t))
#define ssSetOptions(S, options) ((void) (options))
#define ssGetInputPortSignal(S, k) ((const void*) (S)->in[k])
#define ssGetOutputPortSignal(S, k) ((void*) (S)->out[k])
#define INHERITED_SAMPLE_TIME (-1.0)
#define SS_OPTION_EXCEPTION_FREE_CODE 1
"""

SIMULATION = r"""
#include <stdio.h>
#include <stdlib.h>
int main(int count, char **words) {
  SimStruct S = {0};
  int k, j, size;
  S.parameter = words[1];
  S.given = count - 1;
  mdlInitializeSizes(&S);
  if (S.error) { printf("%s", S.error); return 1; }
  mdlInitializeSampleTimes(&S);
  for (k = 0; k < S.inputs; ++k) {
    size = S.rows[0][k] * S.columns[0][k];
    if (!S.contiguous[k] || !S.through[k]) return 2;
    S.in[k] = malloc(size * sizeof(double));
    for (j = 0; j < size; ++j) if (scanf("%lf", S.in[k] + j) != 1) return 3;
  }
  if (scanf("%*f") != EOF) return 4;
  for (k = 0; k < S.outputs; ++k) S.out[k] = malloc(S.rows[1][k] * S.columns[1][k] * sizeof(double));
  mdlOutputs(&S, 0);
  for (k = 0; k < S.outputs; ++k)
    for (j = 0; j < S.rows[1][k] * S.columns[1][k]; ++j) printf("%.17g\n", S.out[k][j]);
  mdlTerminate(&S);
  return S.error != 0 || S.times != 1;
}
"""

pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler on this machine")


def compiled(functions, folder):
    """A program that is the block in a simulation of one step."""
    source = write_c(functions, folder / "robot.c").source
    (folder / "simstruc.h").write_text(SIMSTRUC)
    (folder / "simulink.c").write_text(SIMULATION)
    flags = [
        "-O0",
        "-Wall",
        "-Werror",
        "-Wno-unused",
        "-DS_FUNCTION_NAME=robot",
        "-DMATLAB_MEX_FILE",
    ]
    program = folder / "block"
    subprocess.run([COMPILER, *flags, f"-I{folder}", source, "-o", program, "-lm"], check=True)
    return program


def step(program, name, given):
    """What the block answers to matrices."""
    words = "\n".join(repr(float(x)) for one in given for x in np.ravel(np.array(cs.DM(one)), order="F"))
    return subprocess.run([program, name], input=words, capture_output=True, text=True)


def test_blocks_give_the_numbers_of_the_functions(tmp_path):
    case = golden("3RPR")
    lean = lean_function(case.robot, ("tau", "J_a"), form="A", dynpar=3, euler=True, name="forces")
    x, y = cs.SX.sym("x", 2), cs.SX.sym("y", 0)
    entries = cs.SX(3, 2)
    entries[1, 0], entries[0, 1], entries[2, 1] = x[0], x[1], x[0] * x[1]
    other = cs.Function("with_zeros", [y, x], [entries, x[0] - x[1]], ["y", "x"], ["entries", "difference"])
    program = compiled([lean, other], tmp_path)
    given = arguments(lean, case)
    answer = step(program, "forces", given)
    assert answer.returncode == 0
    expected = np.concatenate([np.ravel(np.array(one), order="F") for one in lean.function.call(given)])
    np.testing.assert_allclose([float(v) for v in answer.stdout.split()], expected, rtol=1e-12)
    answer = step(program, "with_zeros", [[2.0, 3.0]])  # an argument without entries has no port
    assert [float(v) for v in answer.stdout.split()] == [0, 2, 0, 3, 0, 6, -1]
    answer = step(program, "torques", [])
    assert (answer.returncode, answer.stdout) == (
        1,
        "The parameter is no name of a function; there are forces, with_zeros",
    )
