"""C code: written completely or not at all, and equal to the virtual machine when compiled."""

from __future__ import annotations

import re
import shutil
import subprocess

import casadi as cs
import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.parallel.code import codegen
from ocptip.parallel.code.codegen import write_c
from ocptip.parallel.code.lean import lean_function
from tests.parallel.parallel_cases import KIND_NAMES, error, golden
from tests.quick import some

COMPILER = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)


def arguments(lean, case):
    return [case.z, case.zd, case.zdd, case.q, lean.geometry, lean.inertia, lean.gravity]


@pytest.mark.skipif(COMPILER is None, reason="no C compiler on this machine")
@pytest.mark.parametrize("kind", some(1, KIND_NAMES))
def test_compiled_code_equals_the_virtual_machine(kind, tmp_path):
    case = golden(kind)
    lean = lean_function(case.robot, ("tau", "J_a"), form="A", dynpar=3, euler=True)
    files = write_c(lean, tmp_path / "robot.c")
    library = files.source.with_suffix(".so")
    subprocess.run([COMPILER, "-O1", "-shared", "-fPIC", files.source, "-o", library, "-lm"], check=True)
    compiled = cs.external(files.function, str(library))
    inputs = arguments(lean, case)
    for ours, theirs in zip(compiled.call(inputs), lean.function.call(inputs), strict=True):
        assert error(np.array(ours), np.array(theirs)) < 1e-12
    assert error(np.array(compiled.call(inputs)[0]).ravel(), case.expected["tau_a"]) < 1e-9


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("mkoctfile") is None, reason="no Octave on this machine")
def test_octave_compiles_and_calls_the_gateway(tmp_path):
    case = golden("3RPR")
    lean = lean_function(case.robot, ("tau", "J_a"), form="A", dynpar=3, euler=True, name="forces")
    other = lean_function(case.robot, ("J_a",), form="S", name="jacobian")
    files = write_c([lean, other], tmp_path / "robot.c")
    gateway = ["mkoctfile", "--mex", "-DMATLAB_MEX_FILE", files.source.name]
    subprocess.run(gateway, cwd=tmp_path, check=True)
    given = ", ".join(str(np.array(cs.DM(x)).tolist()).replace("], [", "; ") for x in arguments(lean, case))
    script = f"[tau, J] = robot('forces', {given.replace('[[', '[').replace(']]', ']')}); "
    script += "printf('%.17g\\n', tau, J);"
    told = subprocess.run(
        ["octave-cli", "--norc", "--eval", script], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    expected = [np.ravel(np.array(one), order="F") for one in lean.function.call(arguments(lean, case))]
    np.testing.assert_allclose(np.fromstring(told.stdout, sep="\n"), np.concatenate(expected), rtol=1e-12)


@pytest.mark.slow
def test_source_names_its_arguments_and_allocates_nothing(tmp_path):
    lean = lean_function(golden("3RPR").robot, form="A", dynpar=3, name="forces")
    other = lean_function(golden("3RPR").robot, ("J_a",), form="S", name="jacobian")
    files = write_c([lean, other], tmp_path / "robot.c", main=True)
    text = files.source.read_text()
    assert "ZZ1, MX1, MY1, MX2, MZ2, M2, ZZP, MXP, MYP, MP" in text
    assert "res[0]: J_a, 3 x 3" in text
    own = [[float(v) for v in line.split(",")] for line in re.findall(r"of this robot: \{(.*)\}", text)]
    for found, expected in zip(own[:3], (lean.geometry, lean.inertia, lean.gravity), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert len(own) == 6
    assert f"{lean.count.multiplications} multiplications" in text
    assert "int main(" in text
    assert "malloc" not in text.split("int main(")[0]
    assert "void mexFunction(" in text  # for Matlab and Octave
    assert "int forces(const" in files.header.read_text()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["robot.c", "robot.h"]


def test_nothing_is_left_behind_when_writing_fails(tmp_path, monkeypatch):
    target = tmp_path / "robot.c"
    target.write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(codegen.os, "replace", full)
    with pytest.raises(OSError, match="No space"):
        write_c(lean_function(golden("3RPR").robot), target)
    assert [p.name for p in tmp_path.iterdir()] == ["robot.c"]
    assert target.read_text() == "old"


def test_bad_targets(tmp_path):
    lean = lean_function(golden("3RPR").robot)
    for name in ("robot.cpp", "my-robot.c", "robot"):
        with pytest.raises(InputError, match=r"expected a file NAME\.c"):
            write_c(lean, tmp_path / name)
    with pytest.raises(InputError, match="does not exist"):
        write_c(lean, tmp_path / "nowhere" / "robot.c")
    with pytest.raises(InputError, match="different names"):
        write_c([lean, lean], tmp_path / "robot.c")
