"""The lines that docstrings of the flat API show run, in a folder beside the examples."""

import inspect
import re
import textwrap

import numpy as np
import pytest

import ocptip
from ocptip.motion.files.plan_files import write_plan
from ocptip.published.tasks import experiment_task
from ocptip.robots.payload import Payload
from tests.cli.machine.test_compare import write
from tests.measured.machines import predictor, recorded
from tests.pictures.plan_stand_in import plan_of
from tests.places import EXAMPLES, ROOT
from tests.standing.simulation.test_replay import plan_of as committed

VERBS = ["Trajectory", "chart", "compare", "export", "identify", "place", "rate", "simulate", "stand", "view"]
"""Those whose example takes seconds; plans have tests of their own."""

LONG = {"chart", "compare", "place"}
"""Those whose example takes longer than other tests of them."""


def example(function):
    """The code after `Example::` in a docstring."""
    text = inspect.getdoc(function) or ""
    found = re.search(r"Example::\n\n((?: {4}.*\n|\n)+)", text)
    assert found, f"{function.__name__} shows no example"
    return textwrap.dedent(found[1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where users are: beside the examples, a plan of A and a recording of it with a payload."""
    path = tmp_path_factory.mktemp("user")
    (path / "examples").symlink_to(EXAMPLES)
    write_plan(path / "ocptip-plan-A", plan_of(experiment_task("A"), committed("A-effective")[1]))
    robot = predictor().robot
    held = robot.varied(arm=robot.arm.with_payload(Payload(2.0)))
    write(path / "recording.csv", recorded(0, robot=held))
    return path


@pytest.mark.parametrize(
    "verb", [pytest.param(verb, marks=pytest.mark.slow) if verb in LONG else verb for verb in VERBS]
)
def test_its_example_runs(verb, folder, monkeypatch):
    monkeypatch.chdir(folder)
    exec(example(getattr(ocptip, verb)), {"ocptip": ocptip, "np": np})


def test_the_page_about_python_runs(folder, monkeypatch):
    monkeypatch.chdir(folder)
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    assert len(blocks) == 3
    assert len(blocks[0].strip().splitlines()) <= 10
    names: dict[str, object] = {}
    for block in blocks:  # a placement takes seconds, and the example of `place` is the same
        exec(re.sub(r"^.*\bplaced\b.*$", "", block, flags=re.MULTILINE), names)


def test_the_page_about_python_names_all_that_there_is():
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    names = {name for name in ocptip.__all__ if not name.startswith("_")}
    assert [name for name in sorted(names) if not re.search(rf"\b{name}\b", page)] == []
    assert all(hasattr(ocptip, name) for name in names)
