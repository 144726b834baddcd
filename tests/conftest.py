"""Fixtures shared by the tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import places


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return places.ROOT


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The directory of the example scenes."""
    return places.EXAMPLES / "scenes"
