"""The block interpreter against CasADi's own virtual machine."""

from __future__ import annotations

import casadi as cs
import numpy as np
import pytest

from ocptip.numerics.batch import BatchFunction
from ocptip.numerics.jit import machine
from ocptip.numerics.jit.native import LANES
from ocptip.numerics.jit.tape import BLOCK, QUICK, SEARCHED, WORTH, Tape
from tests.quick import some

UNARY = {
    "neg": lambda x: -x,
    "square": lambda x: x**2,
    "twice": lambda x: x + x,
    "root": lambda x: cs.sqrt(cs.fabs(x)),
    "sin": cs.sin,
    "cos": cs.cos,
    "tan": cs.tan,
    "asin": lambda x: cs.asin(x / 10),
    "acos": lambda x: cs.acos(x / 10),
    "atan": cs.atan,
    "exp": cs.exp,
    "log": lambda x: cs.log(1 + x**2),
    "sign": cs.sign,
    "inverse": lambda x: 1 / (x + 20),
    "cube": lambda x: x**3,
    "fraction": lambda x: cs.fabs(x) ** 1.7,
}
BINARY = {
    "difference": lambda x, y: x - y,
    "quotient": lambda x, y: x / (y + 20),
    "power": lambda x, y: cs.fabs(x) ** y,
    "atan2": cs.atan2,
    "least": cs.fmin,
    "largest": cs.fmax,
    "less": lambda x, y: x < y,
    "at most": lambda x, y: x <= y,
    "equal": lambda x, y: cs.eq(x, y),
    "unequal": lambda x, y: cs.ne(x, y),
    "choice": lambda x, y: cs.if_else(cs.logic_and(x > 0, cs.logic_or(y > 0, cs.logic_not(x < 1))), x, y),
}


@pytest.mark.parametrize("count", [1, 7, BLOCK, 2 * BLOCK + 3])
@pytest.mark.parametrize("name", [*UNARY, *BINARY])
def test_every_operation_is_casadis(name, count):
    x, y = cs.SX.sym("x", 3), cs.SX.sym("y", 3)
    result = UNARY[name](x) if name in UNARY else BINARY[name](x, y)
    function = cs.Function("f", [x, y], [result, cs.dot(x, result) + 2])
    rng = np.random.default_rng(0)
    at, other = rng.uniform(-3, 3, (2, count, 3))
    other[0, 0] = at[0, 0]
    first, second = BatchFunction(function)(at, other)
    for k in range(0, count, max(1, count // 5)):
        expected = [np.array(value) for value in function(at[k], other[k])]
        np.testing.assert_allclose(first[k], expected[0].ravel(), rtol=1e-14, atol=1e-300)
        np.testing.assert_allclose(second[k], expected[1].ravel(), rtol=1e-14)


def test_matrices_shared_arguments_and_sparse_results():
    x, p = cs.SX.sym("x", 2), cs.SX.sym("p", 1)
    matrix = cs.SX(3, 2)
    matrix[0, 1], matrix[2, 0] = x[0] * p, x[1]
    batch = BatchFunction(cs.Function("f", [x, p], [matrix]))
    at = np.arange(8.0).reshape(4, 2)
    result = batch(at, np.array([2.0]))[0]
    assert result.shape == (4, 3, 2)
    np.testing.assert_array_equal(result[:, 0, 1], 2 * at[:, 0])
    np.testing.assert_array_equal(result[:, 2, 0], at[:, 1])
    assert np.count_nonzero(result[0]) == 1  # x = (0, 1)


def test_an_mx_function_is_expanded():
    x = cs.MX.sym("x", 2)
    batch = BatchFunction(cs.Function("f", [x], [cs.sum1(x) ** 2]))
    np.testing.assert_allclose(batch(np.array([[1.0, 2.0], [3.0, 4.0]]))[0][:, 0], [9.0, 49.0])


def test_an_unknown_operation_is_named():
    x = cs.SX.sym("x")
    with pytest.raises(NotImplementedError, match="CasADi operation"):
        Tape(cs.Function("f", [x], [cs.erf(x)]))


@pytest.mark.parametrize("count", [0, 1, 5])
def test_unknown_operations_are_left_to_casadi(count):
    x, M = cs.SX.sym("x", 2), cs.SX.sym("M", 2, 2)
    function = cs.Function("f", [x, M], [M @ cs.erf(x), cs.erf(M)])
    at, matrix = np.linspace(-1, 1, 2 * count).reshape(count, 2), np.array([1.0, 2.0, 3.0, 4.0])
    first, second = BatchFunction(function)(at, np.tile(matrix, (count, 1)))
    assert (first.shape, second.shape) == ((count, 2), (count, 2, 2))
    for k in range(count):
        expected = [np.array(one) for one in function(at[k], matrix.reshape(2, 2, order="F"))]
        np.testing.assert_array_equal(first[k], expected[0].ravel())
        np.testing.assert_array_equal(second[k], expected[1])


@pytest.mark.parametrize("name", some(9, [*BINARY, *UNARY]))
def test_machine_code_gives_the_same_bits(name, monkeypatch, tmp_path):
    monkeypatch.setattr(machine, "_path", lambda key: tmp_path / "code")
    x, y = cs.SX.sym("x", 3), cs.SX.sym("y", 3)
    result = UNARY[name](x) if name in UNARY else BINARY[name](x, y)
    tape = Tape(cs.Function("f", [x, y], [result, cs.dot(x, result) + 2]))
    for lanes, effort in ((LANES, 0), (LANES, 1), (1, 1)):
        made, from_disk = tape.native(effort, lanes), tape.native(None, lanes)
        for count in (1, 7, 8, 13, BLOCK + 3):
            inputs = np.random.default_rng(count).uniform(-3, 3, (6, count))
            inputs[:, 0], inputs[3:, -1] = 0.0, inputs[:3, -1]
            for code in (made, from_disk):
                code(inputs, tape._constants, found := np.full((4, count), np.nan))
                np.testing.assert_array_equal(found, tape(inputs))
        (tmp_path / "code").unlink()
    arguments, results, compute = tape.point()
    for column in inputs.T:
        arguments[:] = column
        compute()
        np.testing.assert_array_equal(results, tape(column[:, None])[:, 0])


@pytest.mark.slow
def test_tapes_that_run_often_become_machine_code(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("OCPTIP_CACHE_DIR", "")
    x = cs.SX.sym("x", 2)
    tape, inputs = Tape(cs.Function("f", [x], [cs.sin(x) * 3])), np.array([[0.5, 1.0], [2.0, 3.0]])
    kept = set(tmp_path.rglob("*.code"))
    for _ in range(WORTH + 1):
        np.testing.assert_array_equal(tape(inputs), np.sin(inputs) * 3)
        expected = (tape._blocks >= QUICK) + (tape._blocks >= WORTH)
        assert len(list(tmp_path.rglob("*.code"))) - len(kept) == expected
    *quick, file = sorted(set(tmp_path.rglob("*.code")) - kept, key=lambda one: one.stat().st_mtime_ns)
    other = Tape(cs.Function("f", [x], [cs.sin(x) * 4]))  # another constant: the same code
    assert other.native(None) is not None
    np.testing.assert_array_equal([other(inputs) for _ in range(SEARCHED + 1)][-1], np.sin(inputs) * 4)
    file.write_bytes(file.read_bytes()[:-1])
    assert other.native(None) is not None  # a torn file is no code, but there is the quick one
    quick[0].unlink()
    assert other.native(None) is None
    assert other.native(1) is not None
    machine.keep_code(b"in use", b"code")
    for k in range(machine.KEPT + 5):
        machine.keep_code(bytes(k), b"code")
        assert machine.kept_code(b"in use") == b"code"
    assert len(list(file.parent.iterdir())) == machine.KEPT


def test_a_run_of_many_states_counts_as_many_blocks(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("OCPTIP_CACHE_DIR", "")
    x = cs.SX.sym("x", 2)
    tape, inputs = Tape(cs.Function("f", [x], [cs.sin(x) * 3])), np.ones((2, QUICK * BLOCK // 2))
    np.testing.assert_array_equal(tape(inputs), np.sin(inputs) * 3)
    assert tape._native is None
    np.testing.assert_array_equal(tape(inputs), np.sin(inputs) * 3)
    assert tape._native is not None


def test_without_a_folder_to_write_into_code_is_made_anew(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setenv("OCPTIP_CACHE_DIR", "")
    (tmp_path / "file").write_text("no folder")
    x = cs.SX.sym("x", 2)
    tape = Tape(cs.Function("f", [x], [x + 1]))
    assert tape.native(None) is None
    outputs = np.zeros((2, 1))
    tape.native(1)(np.ones((2, 1)), tape._constants, outputs)
    assert np.all(outputs == 2)
