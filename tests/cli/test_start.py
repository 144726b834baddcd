"""What a command loads: what it does not need costs every call its time."""

import json
import subprocess
import sys

import pytest

from ocptip.cli.commands import COMMANDS
from studies.common import EXAMPLES

LOADED = """
import contextlib, io, json, sys
from ocptip.cli.main import main
with contextlib.redirect_stdout(io.StringIO()):
    try:
        code = main(sys.argv[1:])
    except SystemExit as end:
        code = end.code
print(json.dumps([code, sorted(sys.modules)]))
"""


def loaded(*arguments: str) -> tuple[int, set[str]]:
    found = subprocess.run(
        [sys.executable, "-c", LOADED, *arguments], capture_output=True, text=True, check=True
    )
    code, modules = json.loads(found.stdout)
    return code, set(modules)


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], *([c.name, "--help"] for c in COMMANDS)])
def test_help_loads_no_numerics(arguments):
    code, modules = loaded(*arguments)
    assert code == 0
    assert not modules & {"numpy", "scipy", "casadi", "numba", "matplotlib", "pinocchio", "clarabel"}


def test_stand_loads_what_it_needs():
    code, modules = loaded("stand", str(EXAMPLES / "scenes" / "rover_on_slope.toml"))
    assert code == 0
    assert modules >= {"numpy", "clarabel"}
    assert not modules & {"casadi", "numba", "matplotlib", "pinocchio", "scipy.optimize", "scipy.sparse"}
    assert not any(name.startswith(("ocptip.motion", "ocptip.robots")) for name in modules)


def test_plan_begins_without_what_only_some_tasks_need():
    code, modules = loaded("plan", "missing.toml", "--jobs", "1")
    assert code == 2
    assert modules >= {"ocptip.motion.plan", "casadi", "numba"}
    assert not modules & {f"scipy.{name}" for name in ("interpolate", "optimize", "sparse", "spatial")}
    assert not any(name.startswith("ocptip.parallel") for name in modules)


def test_as_a_module():
    found = subprocess.run([sys.executable, "-m", "ocptip", "--version"], capture_output=True, text=True)
    assert (found.returncode, found.stdout.split()[0]) == (0, "ocptip")
    wrong = subprocess.run([sys.executable, "-m", "ocptip", "stnad"], capture_output=True, text=True)
    assert wrong.returncode == 2
