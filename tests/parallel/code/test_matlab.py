"""Generated Matlab text: the same numbers as the function that it was made from."""

from __future__ import annotations

import math
import re
import shutil
import subprocess

import casadi as cs
import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.parallel.code.codegen import matlab_text
from ocptip.parallel.code.lean import lean_function
from tests.parallel.parallel_cases import golden


def made(kind="3RPR"):
    """Case, function and its arguments."""
    case = golden(kind)
    lean = lean_function(case.robot, ("tau", "J_a"), form="A", dynpar=3, euler=True, name="forces")
    return case, lean, [case.z, case.zd, case.zdd, case.q, lean.geometry, lean.inertia, lean.gravity]


def run(text, name, given):
    """The outputs of a function of the text: its assignments evaluated in Python."""
    body = re.search(rf"^function \[(.*)\] = {name}\((.*)\)\n(.*?)^end", text, re.MULTILINE | re.DOTALL)
    outputs, inputs, lines = body[1].split(", "), body[2].split(", "), body[3].splitlines()
    known = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt, "abs": abs, "atan2": math.atan2}
    known |= {key: np.ravel(np.array(cs.DM(x)), order="F") for key, x in zip(inputs, given, strict=True)}
    known["zeros"] = lambda rows, columns: np.zeros(rows * columns)
    index = re.compile(rf"\b({'|'.join(inputs + outputs)})\((\d+)\)")
    for line in lines:
        exec(index.sub(lambda m: f"{m[1]}[{int(m[2]) - 1}]", line.rstrip(";")), {}, known)
    return [known[out] for out in outputs]


@pytest.mark.parametrize("kind", ["3RPR", "Delta"])
def test_text_gives_the_numbers_of_the_function(kind):
    _, lean, given = made(kind)
    found = run(matlab_text([lean], "robot"), "forces", given)
    for one, other in zip(found, lean.function.call(given), strict=True):
        np.testing.assert_allclose(one, np.ravel(np.array(other), order="F"), rtol=1e-12, atol=1e-12)


def test_entries_that_are_always_zero_are_counted_through():
    x = cs.SX.sym("x", 2)
    y = cs.SX(2, 2)
    y[0, 1], y[1, 1] = x[0] / x[1], cs.fabs(x[1]) - 3
    text = matlab_text([cs.Function("f", [x], [y], ["x"], ["y"])], "robot")
    np.testing.assert_allclose(run(text, "f", [[3.0, -2.0]])[0], [0.0, 0.0, -1.5, -1.0])


def test_what_has_no_text_is_refused():
    x = cs.SX.sym("x")
    with pytest.raises(InputError, match=r"f: operation .* has no text"):
        matlab_text([cs.Function("f", [x], [cs.erf(x)])], "robot")
    y = cs.MX.sym("y")
    with pytest.raises(InputError, match="g: calls other functions"):
        matlab_text([cs.Function("g", [y], [y])], "robot")


def test_the_command_writes_it(tmp_path, capsys):
    target = tmp_path / "robot.m"
    assert main(["parallel", "3RPR", "--matlab", str(target)]) == 0
    assert "robot.m" in capsys.readouterr().out
    text = target.read_text()
    assert text.startswith("function varargout = robot(name, varargin)")
    assert "function [q, distance] = joints(z, geometry)" in text
    assert main(["parallel", "3RPR", "--matlab", str(tmp_path / "1.m")]) == 2
    assert "--matlab: expected a file NAME.m" in capsys.readouterr().err
    assert main(["parallel", "FP1W2F", "--matlab", str(target)]) == 2
    assert "--matlab: not for serial arms" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="no Octave on this machine")
def test_octave_runs_it(tmp_path):
    _, lean, given = made()
    (tmp_path / "robot.m").write_text(matlab_text([lean], "robot"))
    words = [str(np.array(cs.DM(x)).tolist()).replace("], [", "; ")[1:-1] for x in given]
    script = f"[tau, J] = robot('forces', {', '.join(words)}); printf('%.17g\\n', tau, J);"
    command = ["octave-cli", "--norc", "--eval", script]
    told = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
    expected = [np.ravel(np.array(one), order="F") for one in lean.function.call(given)]
    np.testing.assert_allclose([float(x) for x in told.stdout.split()], np.concatenate(expected), rtol=1e-12)
