"""Machine code kept on disk is that of the source."""

import importlib
import os
import subprocess
import sys

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


def test_a_change_of_a_called_function_is_seen(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    names = "kept_callee", "kept_caller"

    def result(size):
        (tmp_path / f"{names[0]}.py").write_text(CALLEE.format(size=size))
        importlib.invalidate_caches()
        for name in names:
            sys.modules.pop(name, None)
        twice = importlib.import_module(names[1]).twice
        return twice(0), sum(twice.machine_code.stats.cache_hits.values())

    (tmp_path / f"{names[1]}.py").write_text(CALLER.format(callee=names[0]))
    assert result(1.0) == (2.0, 0)
    assert result(1.0) == (2.0, 1)  # kept
    assert result(10.0) == (20.0, 0)
    for name in names:
        sys.modules.pop(name)


def test_of_two_processes_one_compiles_and_the_other_loads(tmp_path):
    """Both begin at once; a kernel that calls another one of its file, whose lock it holds."""
    (tmp_path / "kernels.py").write_text(
        "from ocptip.numerics.jit.compiled import compiled\n"
        "@compiled\ndef inner(x):\n    return 36 * x\n"
        "@compiled\ndef outer(x):\n    return 2 * inner(x)\n"
    )
    code = (
        "import sys, numba; from kernels import outer; made = outer.machine_code; print(flush=True)\n"
        "sys.stdin.readline(); assert outer(1.0) == 72.0\n"
        "print(sum(made.stats.cache_misses.values()), sum(made.stats.cache_hits.values()))"
    )
    place = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    how = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "cwd": tmp_path, "env": place}
    both = [subprocess.Popen([sys.executable, "-c", code], **how) for _ in range(2)]
    for process in both:
        process.stdout.readline()
    for process in both:
        process.stdin.write("\n")
        process.stdin.flush()
    assert sorted(process.communicate()[0].split() for process in both) == [["0", "1"], ["1", "0"]]
