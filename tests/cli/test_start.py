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
codes = []
with contextlib.redirect_stdout(io.StringIO()):
    for arguments in json.loads(sys.argv[1]):
        try:
            codes.append(main(arguments))
        except SystemExit as end:
            codes.append(end.code)
print(json.dumps([max(codes), sorted(sys.modules)]))
"""


def loaded(*calls: list[str]) -> tuple[int, set[str]]:
    """The largest exit code of calls, one after the other in a process, and the modules loaded then."""
    found = subprocess.run(
        [sys.executable, "-c", LOADED, json.dumps(calls)], capture_output=True, text=True, check=True
    )
    code, modules = json.loads(found.stdout)
    return code, set(modules)


def test_help_and_version_load_no_numerics():
    """All in one process: what one of them loads stays there."""
    asked = [["--help"], ["--version"], *([command.name, "--help"] for command in COMMANDS)]
    code, modules = loaded(*asked)
    assert code == 0
    assert "ocptip.cli.commands" in modules
    assert not modules & {"numpy", "scipy", "casadi", "llvmlite", "matplotlib", "pinocchio", "clarabel"}


def test_stand_loads_what_it_needs():
    code, modules = loaded(["stand", str(EXAMPLES / "scenes" / "rover_on_slope.toml")])
    assert code == 0
    assert modules >= {"numpy", "clarabel"}
    assert not modules & {"casadi", "matplotlib", "pinocchio", "scipy.optimize", "scipy.sparse"}
    assert not any(name.startswith(("ocptip.motion", "ocptip.robots")) for name in modules)


@pytest.mark.slow
def test_plan_and_check_begin_without_what_only_some_tasks_need():
    code, modules = loaded(["plan", "missing.toml", "--jobs", "1"], ["check", "missing.csv"])
    assert code == 2
    assert modules >= {"ocptip.motion.plan", "casadi", "llvmlite"}
    heavy = ("interpolate", "optimize", "sparse", "spatial", "stats")
    assert not modules & {f"scipy.{name}" for name in heavy}
    assert not any(name.startswith("ocptip.parallel") for name in modules)


def test_as_a_module():
    found = subprocess.run([sys.executable, "-m", "ocptip", "--version"], capture_output=True, text=True)
    assert (found.returncode, found.stdout.split()[0]) == (0, "ocptip")
    wrong = subprocess.run([sys.executable, "-m", "ocptip", "stnad"], capture_output=True, text=True)
    assert wrong.returncode == 2
