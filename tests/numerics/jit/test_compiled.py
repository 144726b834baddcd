"""Machine code of kernels does what Python does, and that on disk is that of the source."""

import importlib
import sys

import numpy as np
import pytest

from ocptip.numerics.jit import compiled as module
from ocptip.numerics.jit.compiled import compiled, interpreted
from ocptip.numerics.jit.lowering import UnsupportedError

CALLER = """
from {callee} import step
from ocptip.numerics.jit.compiled import compiled

@compiled
def twice(x):
    return step(step(x))
"""
CALLEE = """
from ocptip.numerics.jit.compiled import compiled

@compiled
def step(x):
    return x + {size}
"""
LARGEST = 3


@compiled
def _smallest(row, first):
    least, at = row[first], first
    for i in range(first + 1, len(row)):
        if row[i] < least:
            least, at = row[i], i
    return least, at


@compiled
def _sorted(values):
    """A copy, sorted; the number of exchanges."""
    row, exchanges = values.copy(), 0
    for i in range(row.shape[0]):
        least, at = _smallest(row, i)
        if at == i:
            continue
        row[i], row[at] = least, row[i]
        exchanges += 1
    return row, exchanges


@compiled
def _mixed(matrix, numbers, factor, wanted):
    n, m = matrix.shape
    total, found = np.zeros((n, m)), np.empty(n, np.bool_)
    for i in range(n - 1, -1, -1):
        row = matrix[i]
        for k in range(m):
            total[i, k] += row[k] ** 2 / factor if row[k] > 0.0 or (wanted and k == 0) else -row[k] % 1.5
        found[i] = not (0 < numbers[i] <= LARGEST)
    part, end, last = numbers[1:3], 0, matrix[-1, -1]
    while True:
        end += part[end % 2]
        if end > 10:
            break
    for sign, by in ((1.0, 2), (-1.0, end)):
        last = max(last, sign * by, np.sqrt(abs(last)))
    return total, found, end // 2, last, min(n, m) * np.inf, _first(found)


@compiled
def _first(found):
    for k in range(len(found)):
        if found[k]:
            return k
    return -1


@pytest.mark.parametrize("wanted", [True, False])
def test_machine_code_gives_the_same_bits_as_python(wanted):
    rng = np.random.default_rng(0)
    matrix, numbers = rng.normal(size=(4, 3)), np.array([0, 2, 3, 4])
    calls = [(_mixed, (matrix, numbers, 0.7, wanted)), (_sorted, (rng.normal(size=9),))]
    for kernel, arguments in calls:
        results = kernel(*arguments)
        with interpreted():
            expected = kernel(*arguments)
        for one, other in zip(results, expected, strict=True):
            assert type(one) is type(other) or np.isscalar(other)
            np.testing.assert_array_equal(one, other)


def test_machine_code_frees_what_it_allocates():
    """As many calls as would need 4 GiB."""
    values = np.arange(4096.0)
    for _ in range(2):
        assert _many(values, 1 << 16) == 4096.0 * (1 << 16)


@compiled
def _many(values, times):
    total = 0
    for _ in range(times):
        total += _length(values)
    return float(total)


@compiled
def _length(values):
    copy = values.copy()
    return len(copy)


@compiled
def _of_a_list(values):
    return [values[0]]


def test_what_has_no_machine_code_is_refused_with_its_line():
    with pytest.raises(UnsupportedError, match=r"test_compiled\.py:\d+: return \[values\[0\]\]"):
        _of_a_list(np.zeros(2))
    with pytest.raises(TypeError, match="_sorted: no machine code for argument 1"):
        _sorted(np.zeros(2, dtype=np.float32))


@compiled
def _fill(target, values):
    for i in range(len(target)):
        target[i] = values[i]


def test_arrays_with_gaps_are_read_and_written():
    matrix, values = np.zeros((4, 2)), np.arange(8.0).reshape(4, 2)
    _fill(matrix[:, 1], values[:, 0])
    np.testing.assert_array_equal(matrix, [[0, 0], [0, 2], [0, 4], [0, 6]])


def test_a_change_of_a_called_function_is_seen(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    names, made, make = ("kept_callee", "kept_caller"), [], module.Kernel._make
    monkeypatch.setattr(module.Kernel, "_make", lambda *a: made.append(a) or make(*a))
    monkeypatch.setenv("OCPTIP_CACHE_DIR", str(tmp_path / "cache"))

    def result(size):
        module._digest.cache_clear()
        (tmp_path / f"{names[0]}.py").write_text(CALLEE.format(size=size))
        importlib.invalidate_caches()
        for name in names:
            sys.modules.pop(name, None)
        twice = importlib.import_module(names[1]).twice
        made.clear()
        return twice(0.0), len(made)

    (tmp_path / f"{names[1]}.py").write_text(CALLER.format(callee=names[0]))
    assert result(1.0) == (2.0, 1)
    assert result(1.0) == (2.0, 0)  # kept
    assert result(10.0) == (20.0, 1)
    for name in names:
        sys.modules.pop(name)


def test_a_change_of_an_imported_constant_is_seen(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("OCPTIP_CACHE_DIR", str(tmp_path / "cache"))
    names = "kept_constant", "kept_reader"
    (tmp_path / f"{names[1]}.py").write_text(
        "from kept_constant import SIZE\nfrom ocptip.numerics.jit.compiled import compiled\n\n\n"
        "@compiled\ndef sized(x):\n    return x + SIZE\n"
    )
    for size in (1.0, 10.0):
        (tmp_path / f"{names[0]}.py").write_text(f"SIZE = {size}  # {'.' * int(size)}\n")
        importlib.invalidate_caches()
        for name in names:
            sys.modules.pop(name, None)
        assert importlib.import_module(names[1]).sized(0.0) == size
    for name in names:
        sys.modules.pop(name)
