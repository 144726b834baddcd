"""Figures of scenes, plans and placements; the only part that imports matplotlib.

A module is loaded when it is asked for, as `pictures.scene`: most runs draw nothing.
"""

import importlib
from typing import Any


def __getattr__(name: str) -> Any:
    try:
        return importlib.import_module(f"ocptip.pictures.{name}")
    except ModuleNotFoundError:
        raise AttributeError(f"module 'ocptip.pictures' has no attribute {name!r}") from None
