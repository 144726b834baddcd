"""Pinocchio, which reads URDF files and brings coal, which knows distances, loaded where it is used."""

from __future__ import annotations

from types import ModuleType

from ocptip.basics.errors import InputError


def load_pinocchio() -> ModuleType:
    """Return the module.

    Raises:
        InputError: it is not installed; says what for and where it is to be had.
    """
    try:
        import pinocchio
    except ImportError as error:
        raise InputError(_without("reading a URDF", error)) from None
    return pinocchio


def load_coal() -> ModuleType:
    """Return the module coal, which comes with Pinocchio.

    Raises:
        InputError: it is not installed; says what for and where it is to be had.
    """
    try:
        import coal
    except ImportError as error:
        raise InputError(_without("the distance of solids other than spheres", error)) from None
    return coal


def _without(what: str, error: ImportError) -> str:
    where = "which has no wheel for Windows (there: conda-forge, pinocchio)"
    return f"{what} needs the package pin, {where}: {error}"
