"""What keeps tests quick: arguments of `ocptip plan`, fewer random examples, cases that are slow tests."""

import os
from collections.abc import Iterable

import pytest
from hypothesis import settings

ONE_START = ("--starts", "1", "--jobs", "1", "--tolerance", "none", "--no-figures")
"""One start in this process, as described: no tolerance."""


def some(count: int, cases: Iterable) -> list:
    """The first cases, and the others marked slow."""
    cases = list(cases)
    return [*cases[:count], *map(_slow, cases[count:])]


def _slow(case):
    """A case, which may be a value, a tuple of them or a `pytest.param`, marked slow."""
    if hasattr(case, "marks"):
        return case._replace(marks=(*case.marks, pytest.mark.slow))
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)


THOROUGH = bool(os.environ.get("OCPTIP_THOROUGH"))
"""All random examples run. Without it a fifth of them does, which finds what breaks a rule everywhere."""


def examples(count: int, **more) -> settings:
    """The settings of a test by random examples: `count` of them in a thorough run."""
    return settings(max_examples=count if THOROUGH else max(3, count // 5), **more)
