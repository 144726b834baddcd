"""Fixtures shared by the tests."""

from __future__ import annotations

import gc
import os
import pickle
import warnings
from copy import deepcopy
from functools import partial
from inspect import isroutine
from pathlib import Path

import numpy  # noqa: F401  (its libraries must be there before their threads are limited)
import pytest
import scipy.linalg  # noqa: F401
from hypothesis import settings
from threadpoolctl import threadpool_limits

from ocptip.certificate import checks
from ocptip.motion import tolerated
from ocptip.standing.at_rest.load_cases import tilt_by_direction
from ocptip.standing.tolerance import NONE
from ocptip.task_files import cycle
from tests import places
from tests.quick import examples

# Small matrices run on one thread, as in the workers of the planner; the tests have all cores anyway.
threadpool_limits(1)

# In CI the examples are the same in every run: no change fails because of an example that is new. How long
# one takes is never a matter of these tests.
settings.register_profile("ci", examples(50, derandomize=True, deadline=None))
settings.register_profile("by hand", examples(50, deadline=None))
settings.load_profile("ci" if os.environ.get("CI") else "by hand")


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return places.ROOT


COMPILE_LITTLE = ("indices", "parallel", "basics")
"""Folders whose tests need little of the machine code of the library."""


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """With `--dist worksteal` the second of two workers begins in the middle.

    There are tests that compile little: meanwhile the first worker compiles what both need, and keeps it on
    disk. Otherwise both would compile everything.
    """
    light = [item for item in items if item.nodeid.split("/")[1] in COMPILE_LITTLE]
    others = [item for item in items if item.nodeid.split("/")[1] not in COMPILE_LITTLE]
    middle = len(items) // 2
    items[:] = [*others[:middle], *light, *others[middle:]]


def pytest_collection_finish():
    """Thousands of collected tests are not looked through again whenever memory is tidied up."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


@pytest.fixture(scope="session", autouse=True)
def computed_once():
    """Commands compute the robustness and the proof of equal robots and motions once."""

    def once(compute):
        known = {}

        def remembered(*arguments):
            key = pickle.dumps([one for one in arguments if not isroutine(one)])  # no listeners
            if key not in known:
                known[key] = compute(*arguments)
            return deepcopy(known[key])

        return remembered

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tolerated, "tolerated", once(tolerated.tolerated))
        patch.setattr(checks, "certify", once(checks.certify))
        yield


@pytest.fixture(scope="session", autouse=True)
def files_once():
    """Commands read equal task files once, with all that robots build when they are first asked."""
    known = {}

    def once(read):
        def remembered(path, otherwise=NONE):
            folder = Path(path).absolute().parent
            others = [(file, file.stat()) for file in sorted(folder.rglob("*")) if file.is_file()]
            stamps = [(str(file), stat.st_size, stat.st_mtime_ns) for file, stat in others]
            key = (read.__name__, str(path), Path(path).read_bytes(), pickle.dumps((otherwise, stamps)))
            if key not in known:
                with warnings.catch_warnings(record=True) as doubts:
                    task = read(path, otherwise)
                for doubt in doubts:
                    warnings.warn_explicit(doubt.message, doubt.category, doubt.filename, doubt.lineno)
                if doubts:
                    return task
                known[key] = task
            return known[key]

        return remembered

    with pytest.MonkeyPatch.context() as patch:
        for read in (cycle.load_task, cycle.load_cycle):
            patch.setattr(cycle, read.__name__, once(read))
        yield


@pytest.fixture
def without_robustness(monkeypatch):
    """Commands look for no deviations that lose a contact: of tests of other answers."""
    monkeypatch.setattr(tolerated, "tolerated", lambda *_: ())


@pytest.fixture
def few_tilts(monkeypatch):
    """Reports tilt the floor towards 8 directions instead of 72, and draw few postures for the load chart."""
    few = partial(tilt_by_direction, count=8)
    monkeypatch.setattr("ocptip.api.report.CHART_POSTURES", 50)
    monkeypatch.setattr("ocptip.api.report.tilt_by_direction", few)


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The directory of the example scenes."""
    return places.EXAMPLES / "scenes"
