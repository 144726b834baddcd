"""The lines that docstrings of the flat API show run, in a folder beside the examples."""

import inspect
import re
import textwrap

import numpy as np
import pytest

import ocptip
from tests.places import EXAMPLES

VERBS = ["place", "rate", "stand"]
"""Those whose example takes seconds; plans have tests of their own."""


def example(function):
    """The code after `Example::` in a docstring."""
    text = inspect.getdoc(function) or ""
    found = re.search(r"Example::\n\n((?: {4}.*\n|\n)+)", text)
    assert found, f"{function.__name__} shows no example"
    return textwrap.dedent(found[1])


@pytest.mark.parametrize("verb", VERBS)
def test_its_example_runs(verb, tmp_path, monkeypatch):
    (tmp_path / "examples").symlink_to(EXAMPLES)
    monkeypatch.chdir(tmp_path)
    exec(example(getattr(ocptip, verb)), {"ocptip": ocptip, "np": np})
