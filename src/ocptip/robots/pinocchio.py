"""Pinocchio, which reads URDF files and is needed for nothing else, loaded where it is used."""

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
        raise InputError(
            "reading a URDF needs the package pin, which has no wheel for Windows (there: conda-forge, "
            f"pinocchio): {error}"
        ) from None
    return pinocchio
