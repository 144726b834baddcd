"""Pinocchio, which reads URDF files and brings coal, which knows distances, loaded where it is used."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any, TypeAlias

from ocptip.basics.errors import InputError

PinocchioModel: TypeAlias = Any
"""A `pinocchio.Model`; its package has no types."""


def load_pinocchio() -> ModuleType:
    """Return the module.

    Raises:
        InputError: it is not installed; says what for and where it is to be had.
    """
    return _load("pinocchio", "reading a URDF")


def load_coal() -> ModuleType:
    """Return the module coal, which comes with Pinocchio; errors likewise."""
    return _load("coal", "the distance of solids other than spheres")


def _load(module: str, what: str) -> ModuleType:
    try:
        return import_module(module)
    except ImportError as error:
        where = "which has no wheel for Windows (there: conda-forge, pinocchio)"
        raise InputError(f"{what} needs the package pin, {where}: {error}") from None
