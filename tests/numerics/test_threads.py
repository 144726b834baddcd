"""Small matrices run on one thread, whatever the environment says; afterwards all is as before."""

import os
import subprocess
import sys

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from ocptip.cli.main import main
from ocptip.cli.verify import stand
from ocptip.motion.tolerated import tolerated
from ocptip.numerics.threads import one_thread
from ocptip.published.tasks import experiment_task
from ocptip.standing.elastic import springs

SCRIPT = """
import importlib, sys
import numpy as np
from threadpoolctl import threadpool_info
from ocptip.certificate.checks import certified
from ocptip.motion.check import check_motion
from ocptip.placement.maps import scan
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits
from ocptip.task_files.placement import load_placement

def threads():
    return [own["num_threads"] for own in threadpool_info()]

seen = []
def watch(module, name):
    module = importlib.import_module(module)
    inner = getattr(module, name)
    def outer(*arguments, **named):
        seen.append((name, threads()))
        return inner(*arguments, **named)
    setattr(module, name, outer)

watch("ocptip.motion.check", "evaluate_limits")
watch("ocptip.certificate.find", "_missing")
watch("ocptip.placement.maps", "worst")
task, limits, before = experiment_task("A"), Limits(GN=1.0, GT=1.0), threads()
checked = check_motion(task.robot, task.reference, limits)
assert certified(task.robot, task.reference, checked, limits).certificate is not None
problem = load_placement("src/ocptip/examples/tasks/place_incline.toml").problem
scan(problem, np.zeros((1, problem.terrain[0].size)))
assert {name for name, _ in seen} == {"evaluate_limits", "_missing", "worst"}, seen
assert all(set(own) == {1} for _, own in seen), seen
assert threads() == before and len(before) > 0, (before, threads())
"""


IPOPT = """
import numpy as np
from threadpoolctl import threadpool_info
from ocptip.numerics.ipopt import solve
from ocptip.numerics.threads import one_thread
from tests.numerics.test_ipopt import FREE, Parabola

def threads():
    return {own["prefix"]: own["num_threads"] for own in threadpool_info()}

before = threads()
with one_thread:
    solve(Parabola(np.ones(1)), np.zeros(1), FREE, FREE)
    inside = threads()
after = threads()
assert set(inside.values()) == {1}, inside
assert "libcasadi-tp-openblas" in set(inside) - set(before), (before, inside)
assert before.items() <= after.items() and set(after.values()) == {2}, (before, after)
"""


def test_the_linear_algebra_that_ipopt_loads_runs_on_one_thread(root):
    own = os.environ | {"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
    done = subprocess.run(
        [sys.executable, "-c", IPOPT], cwd=root, env=own, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
def test_checks_certificates_and_scans_limit_threads_themselves(root):
    own = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=root, env=own, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def numbers():
    return {own["num_threads"] for own in threadpool_info()}


def test_nested_limits_end_with_the_outermost():
    with threadpool_limits(2):
        before = numbers()
        with one_thread:
            with one_thread:
                assert numbers() == {1}
            assert numbers() == {1}
        assert numbers() == before
        with pytest.raises(KeyError), one_thread:
            raise KeyError
        assert numbers() == before


@pytest.mark.slow
def test_commands_and_what_is_tolerated_run_on_one_thread(root, monkeypatch, capsys):
    """A matrix exponential of 30 rows on four threads of a busy machine takes a hundred times as long."""
    seen = []

    def watched(module, name):
        inner = getattr(module, name)

        def outer(*arguments, **named):
            seen.append((name, numbers()))
            return inner(*arguments, **named)

        monkeypatch.setattr(module, name, outer)

    watched(springs, "exponentials")
    watched(stand, "run")
    task = experiment_task("A")
    scene = root / "src/ocptip/examples/scenes/rover_on_slope.toml"
    with threadpool_limits(2):
        before = numbers()
        tolerated(task.robot, task.reference)
        assert main(["stand", str(scene)]) == 0
        assert numbers() == before
    assert {name for name, _ in seen} == {"exponentials", "run"}
    assert all(threads == {1} for _, threads in seen), seen
