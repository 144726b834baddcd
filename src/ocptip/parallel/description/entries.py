"""Entries of a robot's tables: numbers, or named parameters; and rotations made of them.

A number is part of the structure (0 and multiples of pi/2 are exact), a named :class:`Parameter` stays a
symbol in generated code.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, number_from
from ocptip.basics.frozen import settle

_QUARTER = math.pi / 2
_EXACT = 1e-12


@dataclass(frozen=True)
class Parameter:
    """A named number of the geometry, m or rad.

    Attributes:
        name: a Python identifier; equal names mean the same parameter.
        value: of this robot.
    """

    name: str
    value: float

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise InputError(f"parameter: the name must be an identifier, got {self.name!r}")
        settle(self, value=number_from(f"parameter {self.name}", self.value))


Entry = float | Parameter


def value_of(entry: Entry) -> float:
    """The number behind an entry."""
    return entry.value if isinstance(entry, Parameter) else float(entry)


def right_angles(entry: Entry) -> int | None:
    """k in 0..3 if the entry is a number that equals k pi/2 (modulo 2 pi), else None."""
    if isinstance(entry, Parameter):
        return None
    turns = entry / _QUARTER
    return round(turns) % 4 if abs(turns - round(turns)) < _EXACT * max(1.0, abs(turns)) else None


def exact_cos_sin(entry: Entry) -> tuple[float, float]:
    """Cosine and sine; exactly 0, 1 or -1 at multiples of pi/2 that are not named parameters."""
    k = right_angles(entry)
    if k is None:
        return math.cos(value_of(entry)), math.sin(value_of(entry))
    return (1.0, 0.0, -1.0, 0.0)[k], (0.0, 1.0, 0.0, -1.0)[k]


def elementary_rotation(axis: str, entry: Entry) -> np.ndarray:
    """(3, 3) rotation about a coordinate axis ("x", "y", "z") by an angle, exact at multiples of pi/2."""
    return np.array(turn_about(axis, *exact_cos_sin(entry)))


def turn_about(axis: str, c: Any, s: Any) -> list[list[Any]]:
    """Rows (3, 3) of the rotation about a coordinate axis by the angle with this cosine and sine, scalars."""
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    matrix = [[0.0] * 3 for _ in range(3)]
    matrix[i][i] = 1.0
    matrix[j][j] = matrix[k][k] = c
    matrix[k][j], matrix[j][k] = s, -s
    return matrix


def product_of(rotations: Sequence[tuple[str, Entry]]) -> np.ndarray:
    """(3, 3) product of elementary rotations, the first one on the left."""
    matrix = np.eye(3)
    for axis, angle in rotations:
        matrix = matrix @ elementary_rotation(axis, angle)
    return matrix


def elementary_rotations(name: str, value: Sequence[tuple[str, Entry]]) -> tuple[tuple[str, Entry], ...]:
    """Check a sequence of (axis letter, angle)."""
    result = []
    for number, pair in enumerate(value, start=1):
        try:
            axis, angle = pair
        except (TypeError, ValueError):
            raise InputError(f"{name}[{number}]: expected (axis, angle), got {pair!r}") from None
        if axis not in ("x", "y", "z"):
            raise InputError(f"{name}[{number}]: the axis must be x, y or z, got {axis!r}")
        result.append((axis, check_entry(f"{name}[{number}]", angle)))
    return tuple(result)


def check_entry(name: str, value: Entry) -> Entry:
    """Check a number or parameter."""
    return value if isinstance(value, Parameter) else number_from(name, value)


def check_entries(name: str, values: Sequence[Entry]) -> tuple[Entry, ...]:
    """Check three entries."""
    values = tuple(values)
    if len(values) != 3:
        raise InputError(f"{name}: expected 3 entries, got {len(values)}")
    return tuple(check_entry(f"{name}[{number}]", v) for number, v in enumerate(values, start=1))
