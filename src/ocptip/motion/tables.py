"""Reading the tables of task files: what is missing or cannot be used is named with its place in the file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.errors import InputError, positive_number
from ocptip.robots import DCMotors
from ocptip.scene import _number, _refuse_unknown, _vector

_MOTOR_KEYS = {
    "modular": (),
    "estimated": ("standby", "regeneration"),
    "dc": (
        "motor_constant",
        "resistance",
        "torque_constant",
        "gear_ratio",
        "coulomb",
        "viscous",
        "standby",
        "regeneration",
    ),
}


def _dc_motors(table: dict[str, Any], n: int) -> DCMotors:
    values = {
        key: _number(f"motors.{key}", value)
        if key == "regeneration"
        else _per_joint(f"motors.{key}", value, n, zero_allowed=True)
        for key, value in table.items()
        if key != "kind"
    }
    datasheet = "motor_constant" not in values
    needed = ("resistance", "torque_constant", "gear_ratio") if datasheet else ("motor_constant",)
    for key in (*needed, "coulomb", "viscous", "standby"):
        _given(values, key, "motors")
    _refuse_unknown(values, (*needed, "coulomb", "viscous", "standby", "regeneration"), "motors.")
    return _named("motors", DCMotors.from_datasheet if datasheet else DCMotors, **values)


def _table(data: dict[str, Any], key: str, *, prefix: str = "", optional: bool = False) -> dict[str, Any]:
    if key not in data and not optional:
        raise InputError(f"{prefix}{key}: missing table [{prefix}{key}]")
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise InputError(f"{prefix}{key}: expected a table [{prefix}{key}], got {table!r}")
    return table


def _given(table: dict[str, Any], key: str, where: str) -> Any:
    if key not in table:
        raise InputError(f"{where}.{key}: missing")
    return table[key]


def _per_joint(
    where: str, value: object, n: int, *, signed: bool = False, zero_allowed: bool = False
) -> np.ndarray:
    """One number for all joints, or a list of n."""
    values = _vector(where, value, n) if isinstance(value, list) else np.full(n, _number(where, value))
    if not signed:
        for number in values:
            positive_number(where, float(number), zero_allowed=zero_allowed)
    return values


def _direction(where: str, value: object) -> np.ndarray:
    vector = _vector(where, value, 3)
    if not (length := np.linalg.norm(vector)) > 0:
        raise InputError(f"{where}: must not be zero")
    return vector / length


def _rpy(where: str, value: object) -> np.ndarray:
    return Rotation.from_euler("xyz", _vector(where, value, 3), degrees=True).as_matrix()


def _text(where: str, value: object) -> str:
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{where}: expected a text, got {value!r}")
    return value


def _named(where: str, function: Callable, *arguments: Any, **options: Any) -> Any:
    """Call, with `where` in front of the message of an InputError."""
    try:
        return function(*arguments, **options)
    except InputError as error:
        message = str(error).removeprefix("arm: ").removeprefix("pose: ")  # `where` says it
        raise InputError(f"{where}: {message}") from None


def _how_many(any_given: bool) -> str:
    return "both" if any_given else "none"
