"""The table `[tolerance]`, and what `--tolerance` may be; format: docs/tolerance.md."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from ocptip.basics import schema
from ocptip.basics.errors import InputError
from ocptip.basics.schema import ANY_FILE, Key, Keys
from ocptip.basics.toml import Table
from ocptip.standing.tolerance import BOXES, IN_FILES, NONE, PRESETS, Uncertainty

_MASSES = ("base_mass", "arm_mass", "payload_mass")


def _share(of: str) -> Key:
    return schema.number(f"Relative uncertainty of {of}; 0.05 is 5 %.", otherwise="of the preset")


def _size(meaning: str, unit: str, bound: str = "") -> Key:
    return schema.number(meaning, unit, bound=bound, otherwise="of the preset")


TOLERANCE = Keys(
    "tolerance",
    "The uncertainty: how far masses, friction, floor and timing may be off.",
    {
        "preset": schema.choice("What the other keys start from.", PRESETS, default="none"),
        "tilt_deg": _size("Largest tilt of floor, base and robot in any direction.", "deg", ">= 0"),
        "masses": _share("all masses, each by itself"),
        "base_mass": schema.numbers(
            "Relative uncertainty of the mass of the base, or its minimum and maximum in kg.",
            words="number, or list of 2 numbers",
            default=None,
            otherwise="`masses`",
        ),
        "arm_mass": _share("the masses of links"),
        "payload_mass": _share("the mass of the payload"),
        "springs": _share("the torques of counterbalance springs"),
        "extra_mass": _size("Largest point mass beside the payload, at the TCP.", "kg"),
        "center_of_mass": schema.vector(
            "Half sides of the box about the centre of mass of the base, base axes.", "m", 3, default=None
        ),
        "payload_center": schema.vector(
            "Half sides of the box about the centre of mass of the payload, gripper axes.",
            "m",
            3,
            default=None,
        ),
        "friction": schema.number(
            "Relative uncertainty of all friction coefficients: 0.2 is up to 20 % less.",
            default=None,
            otherwise="of the preset",
        ),
        "delay_ms": _size("Largest delay of every joint by itself.", "ms", ">= 0"),
        "speed": _share("the speed of the motion"),
        "drive_speed": _share("the speed of the base on its drive profile"),
        "push": _size("Largest force in any direction at the TCP.", "N"),
        "base_push": _size("Largest force in any direction at the centre of mass of the base.", "N"),
        "damping": _size("Damping ratio of feet and structure, with which acceleration steps overshoot.", ""),
    },
)
_WITH_TOLERANCE = replace(ANY_FILE, keys={"tolerance": schema.table(TOLERANCE)})


def tolerance_of(data: Table, otherwise: Uncertainty = NONE) -> Uncertainty:
    """The table `[tolerance]` of a file; `otherwise` if it has none."""
    return read_tolerance(data.table("tolerance")) if "tolerance" in data else otherwise


def read_tolerance(table: Table) -> Uncertainty:
    """A tolerance; what the table does not give is certain, or as in the preset that it names."""
    preset = PRESETS[table["preset"]]
    given: dict[str, Any] = {}
    masses = table["masses"]
    if masses is not None:
        given.update(dict.fromkeys(_MASSES, masses))
    if (mass := table["base_mass"]) is not None:
        given["base_mass"] = mass
    names = {key: name for key, (name, _) in IN_FILES.items()} | dict(zip(BOXES, BOXES, strict=True))
    given |= {names[key]: value for key, value in table.given(*names).items()}
    table.close()
    places = {name: key for key, (name, _) in IN_FILES.items() if name != key}
    if masses is not None:
        places |= {name: "masses" for name in _MASSES if name not in table}
    with table.at(**places):
        return replace(preset, **given)


def load_tolerance(word: Uncertainty | str | os.PathLike[str]) -> Uncertainty:
    """A preset by its name, or the table `[tolerance]` of a TOML file; an uncertainty as it is.

    Raises:
        InputError: neither; or the file has no such table, or one that cannot be used.
    """
    if isinstance(word, Uncertainty):
        return word
    if word in PRESETS:
        return PRESETS[f"{word}"]
    path = Path(word)
    if path.suffix.lower() != ".toml":
        raise InputError(f"expected {', '.join(PRESETS)} or a TOML file, got {word!r}")
    with Table.read(path, _WITH_TOLERANCE) as data:
        data.close(early=True)
        return read_tolerance(data.table("tolerance"))
