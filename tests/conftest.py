"""Fixtures shared by the tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

from tests import places

# In CI the examples are the same in every run: no change fails because of an example that is new.
settings.register_profile("ci", derandomize=True, deadline=None)
if os.environ.get("CI"):
    settings.load_profile("ci")


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return places.ROOT


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The directory of the example scenes."""
    return places.EXAMPLES / "scenes"
