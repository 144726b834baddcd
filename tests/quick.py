"""What keeps tests quick: arguments of `ocptip plan`, and cases of which some run with slow tests only."""

from collections.abc import Iterable

import pytest

ONE_START = ("--starts", "1", "--jobs", "1", "--tolerance", "none", "--no-figures")
"""One start in this process, as described: no tolerance."""


def some(count: int, cases: Iterable) -> list:
    """The first cases, and the others marked slow."""
    cases = list(cases)
    marked = [case if isinstance(case, tuple) else (case,) for case in cases[count:]]
    return [*cases[:count], *(pytest.param(*case, marks=pytest.mark.slow) for case in marked)]
