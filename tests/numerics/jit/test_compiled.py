"""Machine code kept on disk is that of the source."""

import importlib
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
