"""Generated texts, Matlab and LaTeX: the same numbers as the functions that they were made from."""

from __future__ import annotations

import re
import shutil
import subprocess
from importlib.resources import files

import casadi as cs
import numpy as np
import pytest
from matplotlib.mathtext import MathTextParser

from ocptip.basics.errors import InputError
from ocptip.cli.main import main
from ocptip.parallel.code.lean import lean_function
from ocptip.parallel.code.texts import latex_text, matlab_text
from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.minimal_form import joint_functions
from ocptip.parallel.robot import ParallelRobot
from ocptip.task_files.parallel import read_robot
from tests.parallel.parallel_cases import golden
from tests.places import EXAMPLES
from tests.quick import some


def made(kind="3RPR"):
    """Case, function and its arguments."""
    case = golden(kind)
    lean = lean_function(case.robot, ("tau", "J_a"), form="A", dynpar=3, euler=True, name="forces")
    return case, lean, [case.z, case.zd, case.zdd, case.q, lean.geometry, lean.inertia, lean.gravity]


READ_FUNCTIONS = ("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sqrt", "sign")


def run(text, name, given):
    """The outputs of a function of the text: its assignments evaluated in Python."""
    body = re.search(rf"^function \[([^]]*)\] = {name}\(([^)]*)\)\n(.*?)^end", text, re.MULTILINE | re.DOTALL)
    outputs, inputs, lines = body[1].split(", "), body[2].split(", "), body[3].splitlines()
    known = {name: getattr(np, name) for name in (*READ_FUNCTIONS, "abs")}
    known |= {name: getattr(np, f"arc{name[1:]}") for name in ("asin", "acos", "atan", "atan2")}
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


READ = {
    r"\left|": "abs(",
    r"\right|": ")",
    r"\left": "",
    r"\right": "",
    r"\,": "*",
    r"\cdot": "*",
    r"\operatorname{sign}": "sign",
    r"\arc": "arc",
    r"\operatorname{atan2}": "arctan2",
    r"\frac{": "(",
    r"\sqrt{": "sqrt(",
    "}{": ")/(",
    "}": ")",
    "\\": "",
}


def computed(text, given):
    """Values of all names of the equations: LaTeX read as Python."""
    names = re.compile(
        r"(?:\\d*dot\{\w\}|\\tau|\\mathit\{[^}]*\}|(?<![a-zA-Z\\])[a-zA-Z](?![a-zA-Z]))(?:_\{[^}]*\})?"
    )
    values = dict(given)
    body = "".join(re.findall(r"align\*\}\n(.*?)\\end", text, re.DOTALL))
    for line in re.split(r"[,.](?:\\\\)?\n", body.strip() + "\n")[:-1]:
        left, right = line.split(" &= ")
        operands = names.findall(right)
        right = re.sub(r"\^\{(-?\d+)\}", r"**(\1)", names.sub("@", right))
        for latex, python in READ.items():
            right = right.replace(latex, python)
        for operand in operands:
            right = right.replace("@", f"v[{operand!r}]", 1)
        known = {key: getattr(np, key) for key in READ_FUNCTIONS}
        values[left] = eval(right, {"max": max, "min": min, "abs": abs, **known, "v": values})
    return values


def entries(symbol, values):
    """Values by name in LaTeX."""
    return {f"{symbol}_{{{k}}}": value for k, value in enumerate(np.ravel(values).tolist(), 1)}


@pytest.mark.parametrize("kind", ["3RPR", "Delta"])
def test_equations_give_the_numbers_of_the_function(kind):
    _, lean, given = made(kind)
    values = {}
    for symbol, one in zip(["z", r"\dot{z}", r"\ddot{z}"], given[:3], strict=True):
        values |= entries(symbol, one)
    joints = np.array(cs.DM(given[3]))
    values |= {f"q_{{{i + 1},{j + 1}}}": joints[i, j] for i, j in np.ndindex(joints.shape)}
    values |= entries(r"\mathit{gravity}", lean.gravity)
    for names, numbers in ((lean.inertia_names, lean.inertia), (lean.geometry_names, lean.geometry)):
        values |= {
            rf"\mathit{{{name}}}".replace("_", r"\_"): value
            for name, value in zip(names, np.ravel(numbers), strict=True)
        }
    found = computed(latex_text([lean]), values)
    tau, jacobian = (np.array(one) for one in lean.function.call(given))
    np.testing.assert_allclose(
        [found[rf"\tau_{{{k + 1}}}"] for k in range(len(tau))], tau.ravel(), rtol=1e-12
    )
    for i, j in np.ndindex(jacobian.shape):
        np.testing.assert_allclose(found[f"J_{{a,{i + 1},{j + 1}}}"], jacobian[i, j], rtol=1e-12, atol=1e-14)


def test_every_operation_has_its_place_in_equations():
    x = cs.SX.sym("x", 4)
    a, b, c, d = cs.vertsplit(x)
    results = [a - (b + c), (a - b) * (c - d), -(a * b) - c, a / (b / c), 1 / (a + b), (a * b) ** 2]
    results += [cs.sqrt(a + 1.5e-7) ** 2, cs.fabs(a - b) * cs.sign(c), cs.atan2(a - b, c), a * -2.5]
    results += [cs.tan(a) * cs.asin(d), cs.acos(d - a) ** 2, -cs.atan(b + c)]
    results += [cs.fmax(a, b) * cs.fmin(c, d), 2 * (a + b), a + (b - c), cs.cos(a) ** 2, -(a - b) * c]
    function = cs.Function("f", [x], [cs.vertcat(*results)], ["x"], ["y"])
    given = [0.7, 1.9, -1.3, 0.4]
    text = latex_text([function])
    found = computed(text, entries("x", given))
    expected = np.ravel(np.array(function(given)))
    np.testing.assert_allclose(run(matlab_text([function], "robot"), "f", [given])[0], expected, rtol=1e-12)
    np.testing.assert_allclose([found[f"y_{{{k + 1}}}"] for k in range(len(results))], expected, rtol=1e-12)
    parser = MathTextParser("path")
    for line in re.findall("(.*) &= (.*)[,.]", text):
        parser.parse(f"${' = '.join(line)}$")  # what it cannot draw raises an error


def test_functions_that_call_others_are_written_out():
    x = cs.SX.sym("x")
    inner = cs.Function("inner", [x], [cs.sin(x) + 1])
    y = cs.MX.sym("y")
    outer = cs.Function("f", [y], [cs.norm_inf(cs.vertcat(inner(inner(y)), 0.5))], ["x"], ["y"])
    np.testing.assert_allclose(run(matlab_text([outer], "robot"), "f", [[0.3]])[0], [float(outer(0.3))])
    assert computed(latex_text([outer]), {"x": 0.3})["y"] == pytest.approx(float(outer(0.3)), rel=1e-14)


ROBOTS = [*READY_MADE, *sorted(path.name for path in (EXAMPLES / "robots").glob("*.toml"))]
LONG = {"sps6.toml", "exechon.toml", "prs3.toml", "rps3.toml", "tricept.toml"}  # five_bar.toml is quick
REFUSED = {"delta_parallelograms.toml": "leg 1 is branched or has closed loops"}


@pytest.mark.parametrize(
    "name", some(3, [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in ROBOTS])
)
def test_every_ready_made_and_example_robot_has_texts(name):
    robot = ParallelRobot(read_robot(name if name in READY_MADE else str(EXAMPLES / "robots" / name)))
    if name in REFUSED:
        with pytest.raises(InputError, match=REFUSED[name]):
            robot.lean(form="A", dynpar=2)
        return
    joints = joint_functions(robot)
    functions = [robot.lean(form="A", dynpar=2, name="forces"), *joints]
    text = matlab_text(functions, "robot")
    assert latex_text(functions).count(r"\begin{align*}") == len(functions)
    if joints[0].name_in() == ["z", "geometry"]:  # closed form
        given = robot.description.home, functions[0].geometry
        for found, expected in zip(run(text, joints[0].name(), given), joints[0].call(given), strict=True):
            np.testing.assert_allclose(found, np.ravel(np.array(expected), order="F"), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("write", [lambda f: matlab_text(f, "robot"), latex_text])
def test_what_has_no_text_is_refused(write):
    x = cs.SX.sym("x")
    with pytest.raises(InputError, match=r"f: operation .* has no text"):
        write([cs.Function("f", [x], [cs.erf(x)])])


@pytest.mark.slow
def test_the_command_writes_it(tmp_path, capsys):
    target = tmp_path / "robot.m"
    assert main(["parallel", "3RPR", "--matlab", str(target)]) == 0
    assert "robot.m" in capsys.readouterr().out
    text = target.read_text()
    assert text.startswith("function varargout = robot(name, varargin)")
    assert "function [q, distance] = joints(z, geometry)" in text
    five_bar = str(files("ocptip") / "examples/robots/five_bar.toml")
    both = [tmp_path / "robot.tex", tmp_path / "five_bar.m"]
    assert main(["parallel", five_bar, "--latex", str(both[0]), "--matlab", str(both[1])]) == 0
    assert "robot.tex" in capsys.readouterr().out
    assert r"\mathit{leg1\_MX1}" in both[0].read_text()
    assert "function [q, residual] = joints(z, start)" in both[1].read_text()
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
