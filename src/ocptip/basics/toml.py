"""Reading TOML files of users: what is missing or cannot be used is named with its place in the file.

Every function raises one-line :class:`InputError` that starts with `where`, the key's place.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, finite_array, positive_number, refuse_huge

TOP_KEYS = ("gravity", "base", "contact", "load")
"""Keys of scenes that are often put below a table by mistake, where TOML takes them for the table's."""


def read_text(path: Path) -> str:
    """Return the content of a text file.

    Raises:
        InputError: it cannot be read; one line that names it.
    """
    try:
        return path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file in UTF-8 (byte {error.start})") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises:
        InputError: it cannot be read, or is no TOML; one line that names it.
    """
    try:
        return tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path.name}: broken TOML: {error}") from None
    except RecursionError:
        raise InputError(f"{path.name}: broken TOML: nested too deeply") from None


def subtable(data: dict[str, Any], key: str, *, prefix: str = "", optional: bool = False) -> dict[str, Any]:
    """The table under a key, an empty one if it is optional and missing."""
    if key not in data and not optional:
        raise InputError(f"{prefix}{key}: missing table [{prefix}{key}]")
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise InputError(f"{prefix}{key}: expected a table [{prefix}{key}], got {table!r}")
    return table


def subtables(data: dict[str, Any], key: str) -> list[dict[str, Any]]:
    """Tables in double brackets under a key, none by default."""
    value = data.get(key, [])
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        raise InputError(f"{key}: expected tables in double brackets, [[{key}]]")
    return value


def required(table: dict[str, Any], key: str, where: str) -> Any:
    """The value of a key that has to be there."""
    if key not in table:
        raise InputError(f"{where}.{key}: missing")
    return table[key]


def number_at(where: str, value: object) -> float:
    """A finite number."""
    if isinstance(value, list | dict):
        raise InputError(f"{where}: expected a single number, got {value!r}")
    refuse_non_numbers(where, value)
    return float(value)  # type: ignore[arg-type]


def vector_at(where: str, value: object, size: int) -> np.ndarray:
    """(size,) finite numbers."""
    if not isinstance(value, list):
        raise InputError(f"{where}: expected a list of {size} numbers, got {value!r}")
    if len(value) != size:
        raise InputError(f"{where}: expected {size} numbers, got {len(value)}")
    return np.array([number_at(where, item) for item in value])


def per_joint_at(
    where: str, value: object, n: int, *, signed: bool = False, zero_allowed: bool = False
) -> np.ndarray:
    """One number for all joints, or a list of n."""
    values = vector_at(where, value, n) if isinstance(value, list) else np.full(n, number_at(where, value))
    if not signed:
        for number in values:
            positive_number(where, float(number), zero_allowed=zero_allowed)
    return values


def direction_at(where: str, value: object) -> np.ndarray:
    """(3,) unit vector."""
    vector = vector_at(where, value, 3)
    if not (length := np.linalg.norm(vector)) > 0:
        raise InputError(f"{where}: must not be zero")
    return vector / length


def rpy_at(where: str, value: object) -> np.ndarray:
    """(3, 3) rotation from roll, pitch, yaw in degrees."""
    return Rotation.from_euler("xyz", vector_at(where, value, 3), degrees=True).as_matrix()


def rotation_in(table: dict[str, Any], where: str, *, optional: bool = False) -> np.ndarray:
    """(3, 3) of a table's `rpy_deg` or `rotation`; identity if they are optional and both missing."""
    given = [key for key in ("rpy_deg", "rotation") if key in table]
    if len(given) == 2 or not (given or optional):
        many = "both" if given else "none"
        raise InputError(f"{where}.rpy_deg: expected either rpy_deg or rotation, got {many}")
    if "rpy_deg" in given:
        return rpy_at(f"{where}.rpy_deg", table["rpy_deg"])
    if "rotation" in given:
        refuse_non_numbers(f"{where}.rotation", table["rotation"])
        return finite_array(f"{where}.rotation", table["rotation"], (3, 3))
    return np.eye(3)


def text_at(where: str, value: object) -> str:
    """A text that is not blank."""
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{where}: expected a text, got {value!r}")
    return value


def with_place(where: str, function: Callable, *arguments: Any, **options: Any) -> Any:
    """Call, with `where` in front of the message of an InputError."""
    try:
        return function(*arguments, **options)
    except InputError as error:
        message = str(error).removeprefix("arm: ").removeprefix("pose: ")  # `where` says it
        raise InputError(f"{where}: {message}") from None


def refuse_unknown(table: Iterable[str], known: Iterable[str], prefix: str, also: Sequence[str] = ()) -> None:
    """Raise at the first key that is not known, with the nearest one that is."""
    names = [*also, *known]
    for key in table:
        if key not in names:
            if prefix and key in TOP_KEYS:
                raise InputError(f"{prefix}{key}: unknown key; {key!r} belongs above the first table")
            raise InputError(f"{prefix}{key}: unknown key{suggestion(key, names)}")


def refuse_non_numbers(where: str, value: object) -> None:
    """Raise unless `value` is a finite number, not huge, or lists of such (true and "1" are none)."""
    if isinstance(value, list):
        for item in value:
            refuse_non_numbers(where, item)
        return
    if isinstance(value, bool) or not isinstance(value, int | float):
        shown = str(value).lower() if isinstance(value, bool) else repr(value)
        raise InputError(f"{where}: expected a number, got {shown}")
    if isinstance(value, int) and abs(value) > 10**300:
        raise InputError(f"{where}: number too large")
    if not np.isfinite(float(value)):
        raise InputError(f"{where}: must be finite, got {value}")
    refuse_huge(where, float(value))


def suggestion(word: object, known: Sequence[str]) -> str:
    """What a wrong word may have meant, and all that is known."""
    near = difflib.get_close_matches(str(word), known, n=1)
    guess = f"; did you mean {near[0]!r}?" if near else ";"
    return f"{guess} known: {', '.join(known)}"
