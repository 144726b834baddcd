"""Values of users' files: what a number, a list, a text, an orientation may be; all else is refused.

Messages have no path: who reads the file says where the value stands.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError, number_from, refuse_huge, rotation_matrix

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


def number_of(value: Any, bound: str = "") -> float:
    """A number as TOML has it, finite and not huge (true and "1" are none), or an InputError without path."""
    if isinstance(value, list):
        raise InputError(f"expected a single number, got {value!r}", "")
    if isinstance(value, bool):
        raise InputError(f"expected a number, got {str(value).lower()}", "")
    if isinstance(value, int) and abs(value) > 10**300:
        raise InputError("number too large", "")
    number = number_from("value", value)
    refuse_huge("value", number)
    if (bound == "> 0" and number <= 0) or (bound == ">= 0" and number < 0):
        raise InputError(f"must be {bound}, got {value!r}", "")
    return number


def numbers_of(value: Any) -> Any:
    """The value, if it is a number or lists of numbers, those side by side of one length."""
    if not isinstance(value, list):
        number_of(value)
    elif len({np.shape(numbers_of(item)) for item in value}) > 1:
        raise InputError(f"expected lists of the same length, got {value!r}", "")
    return value


def vector_of(value: Any, size: int | None, bound: str = "") -> np.ndarray:
    """A list of numbers, of this size if one is given."""
    if not isinstance(value, list):
        raise InputError(f"expected a list of {f'{size} ' if size else ''}numbers, got {value!r}", "")
    if size is not None and len(value) != size:
        raise InputError(f"expected {size} numbers, got {len(value)}", "")
    return np.array([number_of(item, bound) for item in value])


def direction_of(value: Any) -> np.ndarray:
    """A unit vector along three numbers that are not all zero."""
    vector = vector_of(value, 3)
    if not (length := np.linalg.norm(vector)) > 0:
        raise InputError("must not be zero", "")
    return vector / length


def _quaternion(value: Any) -> np.ndarray:
    quaternion = vector_of(value, 4)
    if not abs(np.linalg.norm(quaternion) - 1) < 1e-3:  # people round
        raise InputError(f"must have length 1 (x, y, z, w), got {value!r}", "")
    return rotations().from_quat(quaternion).as_matrix()


def rotations() -> type[Rotation]:
    """SciPy's rotations, which load for 0.3 s; most files and tasks need none."""
    return scipy.spatial.transform.Rotation


def text_of(value: Any) -> str:
    """A text that is not blank."""
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"expected a text, got {value!r}", "")
    return value


def flag_of(value: Any) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise InputError(f"expected true or false, got {value!r}", "")
    return value


def folders_of(value: Any, _: int | None) -> list[str]:
    """A name, or a list of names."""
    names = value if isinstance(value, list) else [value]
    if not all(isinstance(item, str) for item in names):
        raise InputError(f"expected folders, got {value!r}", "")
    return names


ROTATIONS: dict[str, Callable[[Any, int | None], np.ndarray]] = {
    "rpy_deg": lambda value, _: rotations().from_euler("xyz", vector_of(value, 3), degrees=True).as_matrix(),
    "quaternion": lambda value, _: _quaternion(value),
    "rotation_vector_deg": lambda value, _: (
        rotations().from_rotvec(np.radians(vector_of(value, 3))).as_matrix()
    ),
    "rotation": lambda value, _: rotation_matrix("value", numbers_of(value), tolerance=1e-8),
}
"""Forms of an orientation in files, by key. Roll, pitch, yaw turn about fixed axes."""
