"""Fields of frozen data classes, set when they are checked."""

from __future__ import annotations

from typing import Any

import numpy as np


def read_only(array: np.ndarray) -> np.ndarray:
    """Return the array, which nobody can change any more."""
    array.flags.writeable = False
    return array


def settle(record: object, **values: Any) -> None:
    """Set fields of a frozen data class; arrays become read-only."""
    for name, value in values.items():
        object.__setattr__(record, name, read_only(value) if isinstance(value, np.ndarray) else value)
