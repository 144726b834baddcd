"""Pinocchio has no wheel for Windows: what reads no URDF does without it, what does says so in one line."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from tests.places import EXAMPLES, RESULTS, UR5
from tests.quick import ONE_START

RUN = """
import sys
sys.modules["pinocchio"] = None  # importing it fails
from ocptip.cli.main import main
if __name__ == "__main__":
    sys.exit(main())
"""
POSE = ["10", "20", "-30", "40", "50", "60"]


@pytest.fixture
def run(tmp_path):
    script = tmp_path / "run.py"
    script.write_text(RUN)

    def command(*arguments):
        command = [sys.executable, str(script), *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=300, check=False)

    return command


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ["check", RESULTS / "plans" / "A-effective" / "plan.json", "--tolerance", "none"],
        *(
            pytest.param(call, marks=pytest.mark.slow)
            for call in (
                ["stand", EXAMPLES / "scenes/rover_on_slope.toml"],
                ["plan", "A", *ONE_START],
                ["place", EXAMPLES / "tasks/place_incline.toml", "--starts", "1", "--no-figures"],
                ["rate", "FP1W2F", *POSE],
                ["parallel", "6UPS"],
            )
        ),
    ],
    ids=lambda arguments: arguments[0],
)
def test_not_needed_without_urdf(run, arguments):
    result = run(*arguments, "--json")
    # On a slow machine a plan may take longer than the time between two lines of progress.
    warnings = [line for line in result.stderr.splitlines() if not line.startswith("ocptip plan: [")]
    assert (result.returncode, warnings) == (0, [])
    assert "versions" in json.loads(result.stdout)


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ["rate", UR5, *POSE, "--base-link", "base_link", "--tool-frame", "tool0"],
        ["plan", EXAMPLES / "tasks/ur5_cart.toml"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_a_urdf_says_what_is_missing(run, arguments):
    result = run(*arguments)
    assert (result.returncode, result.stdout) == (2, "")
    assert "reading a URDF needs the package pin, which has no wheel for Windows" in result.stderr
    assert result.stderr.startswith("ocptip: ")
    assert result.stderr.count("\n") == 1
