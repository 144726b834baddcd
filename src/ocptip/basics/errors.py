"""Exceptions of the package, which all derive from :class:`OcptipError`, and its warning."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

LARGEST = 1e12
"""Largest magnitude of input, SI units: beyond it rounding and overflow would decide, not mechanics."""

_PATH = re.compile(r"[A-Za-z_]\w*(\[\d+\])*(\.\w+(\[\d+\])*)*")


class OcptipError(Exception):
    """Root of all errors raised on purpose by ocptip."""


class InputError(OcptipError, ValueError):
    """Input that cannot be used. The message names the quantity, its value and what would be right.

    Args:
        message: what is wrong; without `path` it may begin with one: `InputError("mass: must be > 0")`.
        path: of the value, such as "contact[2].friction"; "": it has none.
        file: that holds it, if it stands in one.

    Attributes:
        file, path, text: of these three the message consists, those that are not empty.
    """

    def __init__(self, message: str = "", path: str | None = None, file: str = "") -> None:
        head, _, rest = message.partition(": ")
        if path is None and rest and _PATH.fullmatch(head):
            path, message = head, rest
        self.file, self.path, self.text = file, path or "", message
        super().__init__(": ".join(part for part in (self.file, self.path, self.text) if part))


class InputWarning(UserWarning):
    """Input that can be used, but is suspicious. The message names the quantity and what may be meant."""


@contextmanager
def naming(place: str) -> Iterator[None]:
    """Put a place, such as "joint 3", in front of every InputError of the block, but no file twice."""
    try:
        yield
    except InputError as error:
        if error.file and Path(error.file).name == Path(place).name:
            raise
        raise InputError(f"{place}: {error}") from None


class BindingDefinitionError(OcptipError):
    """The mode list of a contact model is not closed, or does not fit its columns: an error in its class."""


class SolverError(OcptipError):
    """A numerical method failed where a result was demanded; the message carries status and residual."""


class PlanningError(OcptipError):
    """The search ended without a verified motion; the message says how near it came."""


def finite_array(name: str, value: object, shape: tuple[int | EllipsisType | None, ...]) -> np.ndarray:
    """Return `value` as a float array of the given shape, or raise InputError.

    Within the shape None is any length; an ellipsis at its begin, any leading dimensions.
    """
    try:
        given = np.array(value)
    except ValueError:
        raise InputError(f"{name}: expected numbers, got {value!r}") from None
    if given.dtype.kind not in "iuf" and given.size:
        raise InputError(f"{name}: expected numbers, got {value!r}")
    array = given.astype(float, copy=False)  # a copy already
    tail = shape[1:] if shape[:1] == (...,) else shape
    have = array.shape[max(0, array.ndim - len(tail)) :] if tail is not shape else array.shape
    if have != tail and (
        len(have) != len(tail) or any(want not in (None, got) for want, got in zip(tail, have, strict=True))
    ):
        words = {None: "n", ...: "..."}
        wanted = " x ".join(words.get(want, str(want)) for want in shape) or "a single number"
        got = " x ".join(map(str, array.shape)) or "a single number"
        raise InputError(f"{name}: expected shape {wanted}, got {got}")
    if not np.isfinite(array).all():
        raise InputError(f"{name}: contains NaN or infinity: {value!r}")
    return array


def bounded_array(
    name: str, value: ArrayLike, shape: tuple[int | None, ...], *, largest: float = LARGEST
) -> np.ndarray:
    """As `finite_array`, but magnitudes above `largest` also raise InputError."""
    array = finite_array(name, value, shape)
    refuse_huge(name, array, largest)
    return array


def refuse_huge(name: str, value: float | np.ndarray, largest: float = LARGEST) -> None:
    """Raise InputError naming the largest number if its magnitude is above `largest`."""
    values = np.ravel(value)
    if values.size and np.max(np.abs(values)) > largest:
        worst = values[np.argmax(np.abs(values))]
        raise InputError(f"{name}: magnitudes above {largest:g} (SI units) are refused, got {worst:g}")


def rotation_matrix(name: str, value: object, *, tolerance: float = 1e-9) -> np.ndarray:
    """Return `value` as a rotation matrix (3, 3), orthonormal up to the tolerance, or raise InputError."""
    matrix = finite_array(name, value, (3, 3))
    error, determinant = float(np.abs(matrix @ matrix.T - np.eye(3)).max()), np.linalg.det(matrix)
    if error > tolerance or determinant < 0:
        raise InputError(f"{name}: not a rotation matrix (orthonormal to {error:.1e}, det {determinant:.3g})")
    return matrix


def positive_number(name: str, value: Any, *, zero_allowed: bool = False) -> float:
    """Return `value` as a positive finite float, or raise InputError naming it."""
    number = number_from(name, value)
    if number < 0 or (number == 0 and not zero_allowed):
        raise InputError(f"{name}: must be {'>= 0' if zero_allowed else '> 0'}, got {value!r}")
    return number


def share_of_one(name: str, value: Any) -> float:
    """Return `value` as a float above 0 and at most 1, or raise InputError naming it."""
    number = number_from(name, value)
    if not 0 < number <= 1:
        raise InputError(f"{name}: must be above 0 and at most 1, got {value!r}")
    return number


def is_whole(value: Any) -> bool:
    """Whether a value is an integer, not a bool."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def whole_number(name: str, value: Any, least: int, most: int | None = None) -> int:
    """Return `value` as an int of at least `least` (and at most `most`), or raise InputError naming it."""
    if not is_whole(value) or value < least or (most is not None and value > most):
        upper = "" if most is None else f" and <= {most}"
        raise InputError(f"{name}: must be a whole number >= {least}{upper}, got {value!r}")
    return int(value)


def number_from(name: str, value: Any) -> float:
    """Return `value` as a finite float, or raise InputError naming it."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise InputError(f"{name}: expected a number, got {value!r}")
    try:
        number = float(value)
    except OverflowError:
        raise InputError(f"{name}: number too large") from None
    if not isfinite(number):
        raise InputError(f"{name}: must be finite, got {value!r}")
    return number


FARTHEST = 50.0
"""Lengths of a robot and its base above this, m, may be millimetres."""
_ROUNDED = 0.99  # of the mass in a URDF: less than that is no rounding of two digits


def doubt(message: str) -> None:
    """Warn with an InputWarning."""
    warnings.warn(message, InputWarning, stacklevel=3)


def doubt_degrees(where: str, angles: Any) -> None:
    """Warn if angles that should be degrees, not all zero, are all within a turn in radians."""
    largest = np.abs(np.asarray(angles, dtype=float)).max(initial=0.0)
    if 0 < largest < 2 * np.pi:
        doubt(f"{where}: no angle is above {largest:.4g} degrees; are they radians?")


def doubt_metres(where: str, lengths: Any) -> None:
    """Warn if one of some lengths, m, is above `FARTHEST`."""
    largest = np.abs(np.asarray(lengths, dtype=float)).max(initial=0.0)
    if largest > FARTHEST:
        doubt(f"{where}: {largest:.4g} m is far for a robot; are these millimetres?")


def too_light(mass: float, resting: float) -> str:
    """Why a base of this mass, kg, cannot hold the resting links of a URDF, kg; empty if it can."""
    if mass >= _ROUNDED * resting:
        return ""
    return (
        f"{mass:.4g} kg is less than the {resting:.4g} kg of those links of the URDF that do not move and "
        "are part of the base; give the mass of the whole base"
    )
