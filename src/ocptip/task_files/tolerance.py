"""The table `[tolerance]`, and what `--tolerance` may be; format: docs/tolerance.md."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from ocptip.basics.errors import InputError
from ocptip.basics.toml import Table
from ocptip.standing.tolerance import BOXES, IN_FILES, NONE, PRESETS, Tolerance

_MASSES = ("base_mass", "arm_mass", "payload_mass")


def tolerance_of(data: Table, otherwise: Tolerance = NONE) -> Tolerance:
    """The table `[tolerance]` of a file; `otherwise` if it has none."""
    return read_tolerance(data.table("tolerance")) if "tolerance" in data else otherwise


def read_tolerance(table: Table) -> Tolerance:
    """A tolerance; what the table does not give is certain, or as in the preset that it names.

    Raises:
        InputError: a value is unknown or cannot be used; names its place.
    """
    preset = PRESETS[table.choice("preset", PRESETS, "none")]
    given: dict[str, Any] = {}
    masses = table.number("masses", None)
    if masses is not None:
        given.update(dict.fromkeys(_MASSES, masses))
    if (mass := table.raw_numbers("base_mass", None)) is not None:
        given["base_mass"] = mass
    for key, (name, scale) in IN_FILES.items():
        bound = ">= 0" if scale != 1 else ""  # else checked with the others, here in the file's unit
        if (number := table.number(key, None, scale=scale, bound=bound)) is not None:
            given[name] = number
    for key in BOXES:
        if (half := table.vector(key, 3, None)) is not None:
            given[key] = half
    table.close()
    places = {name: key for key, (name, _) in IN_FILES.items() if name != key}
    if masses is not None:
        places |= {name: "masses" for name in _MASSES if name not in table}
    with table.at(**places):
        return replace(preset, **given)


def load_tolerance(word: str) -> Tolerance:
    """A preset by its name, or the table `[tolerance]` of a TOML file.

    Raises:
        InputError: neither; or the file has no such table, or one that cannot be used.
    """
    if word in PRESETS:
        return PRESETS[word]
    path = Path(word)
    if path.suffix.lower() != ".toml":
        raise InputError(f"expected {', '.join(PRESETS)} or a TOML file, got {word!r}")
    with Table.read(path) as data:
        data.close(*data)  # a task file has other tables
        return read_tolerance(data.table("tolerance"))
