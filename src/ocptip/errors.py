"""Exceptions of the package; every one derives from :class:`OcptipError`."""

from __future__ import annotations

import numpy as np


class OcptipError(Exception):
    """Root of all errors raised on purpose by ocptip."""


class InputError(OcptipError, ValueError):
    """Input that cannot be used. The message names the quantity, its value and what would be right."""


class BindingDefinitionError(OcptipError):
    """A binding's mode list is not closed, or its columns do not fit it: an error in the binding's class."""


class SolverError(OcptipError):
    """A numerical method failed where a result was demanded; the message carries status and residual."""


class PlanningError(OcptipError):
    """No verified motion was found; the message says how near the search came."""


def finite_array(name: str, value: object, shape: tuple[int | None, ...]) -> np.ndarray:
    """Return `value` as a float array of the given shape (None: any length), or raise InputError."""
    try:
        given = np.array(value)
    except ValueError:
        raise InputError(f"{name}: expected numbers, got {value!r}") from None
    if given.dtype.kind not in "iuf" and given.size:
        raise InputError(f"{name}: expected numbers, got {value!r}")
    array = given.astype(float)
    fits = array.ndim == len(shape) and all(
        want is None or want == have for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = " x ".join("n" if want is None else str(want) for want in shape) or "a single number"
        got = " x ".join(map(str, array.shape)) or "a single number"
        raise InputError(f"{name}: expected shape {wanted}, got {got}")
    if not np.all(np.isfinite(array)):
        raise InputError(f"{name}: contains NaN or infinity: {value!r}")
    return array


def positive_number(name: str, value: object, *, zero_allowed: bool = False) -> float:
    """Return `value` as a positive finite float, or raise InputError naming it."""
    number = number_from(name, value)
    if number < 0 or (number == 0 and not zero_allowed):
        raise InputError(f"{name}: must be {'>= 0' if zero_allowed else '> 0'}, got {value!r}")
    return number


def number_from(name: str, value: object) -> float:
    """Return `value` as a finite float, or raise InputError naming it."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise InputError(f"{name}: expected a number, got {value!r}")
    number = float(value)
    if not np.isfinite(number):
        raise InputError(f"{name}: must be finite, got {value!r}")
    return number
