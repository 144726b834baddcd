"""Which column of a CSV file is what: positions, speeds and accelerations of joints, by its header.

Known are the numbered columns `q1_deg`, `qd1_deg_s`, `qdd1_deg_s2`, and names of joints, with a word for the
quantity before or after them and a unit at the end or without: `elbow`, `elbow_deg`, `position.elbow`,
`elbow_velocity [rad/s]`, `/joint_states/elbow/position`. All other columns are left out.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.text import some

POSITION, SPEED, ACCELERATION = "position", "velocity", "acceleration"
KINDS = (POSITION, SPEED, ACCELERATION)

_WORDS = {
    **dict.fromkeys(("position", "positions", "pos", "angle", "q"), POSITION),
    **dict.fromkeys(("velocity", "velocities", "vel", "speed", "qd"), SPEED),
    **dict.fromkeys(("acceleration", "accelerations", "acc", "accel", "qdd"), ACCELERATION),
}
_PER = {"": POSITION, "s": SPEED, "s2": ACCELERATION}
_NUMBERED = re.compile(r"(?P<word>q|qd|qdd)(?P<joint>[1-9][0-9]*)")
_UNIT = re.compile(r"[\s_]*[\[(]?(?<![A-Za-z])(?P<unit>deg|rad|m)(?:[_/](?P<per>s|s\^?2))?[\])]?")
_AT_END = re.compile(rf"(?P<body>.*?\w)(?:{_UNIT.pattern})")
_APART = re.compile(r"[./\s_]+")


@dataclass(frozen=True)
class _Column:
    """A column of a joint, counted from 0; the unit is "" where the header says none."""

    number: int
    kind: str
    joint: int
    unit: str


@dataclass(frozen=True)
class CsvColumns:
    """Columns of a header, counted from 0.

    Attributes:
        joints: by quantity (`KINDS`) the column of every joint in the robot's order, or none.
        units: by quantity "deg", "rad" or "m" per joint.
    """

    joints: dict[str, list[int]]
    units: dict[str, list[str]]

    def scales(self, kind: str) -> np.ndarray:
        """(n,): SI unit per unit of the file."""
        return np.array([np.pi / 180 if unit == "deg" else 1.0 for unit in self.units[kind]])


def columns_of(
    header: Sequence[str], names: Sequence[str] | None, units: Sequence[str], unit: str | None
) -> CsvColumns:
    """Understand a header.

    Args:
        header: names of the columns.
        names: of the robot's joints; None: only numbered columns are known.
        units: "rad" or "m" per joint of the robot; empty: unknown.
        unit: "deg" or "rad", of columns of turning joints that say none; None: such columns are refused.

    Raises:
        InputError: a joint without position, a quantity twice, or a missing unit.
    """
    numbered = [c for k, text in enumerate(header) if (c := _numbered(k, text))]
    named = [c for k, text in enumerate(header) if (c := _named(k, text, names))]
    if any(column.kind == POSITION for column in named) or not numbered:
        found, n, titles = named, len(names or ()), list(names or ())
    else:
        found, n = numbered, max(column.joint for column in numbered) + 1
        titles = [f"q{joint + 1}" for joint in range(n)]
    joints: dict[str, list[int]] = {}
    own_units: dict[str, list[str]] = {}
    for kind in KINDS:
        of_joint: dict[int, _Column] = {}
        for column in found:
            if column.kind == kind and (other := of_joint.setdefault(column.joint, column)) is not column:
                texts = header[other.number], header[column.number]
                raise InputError(f"header: {texts[0]} and {texts[1]} are the same quantity")
        missing = [titles[joint] for joint in range(n) if joint not in of_joint]
        if not n or (missing and (kind == POSITION or of_joint)):
            raise InputError(_missing(kind, missing, numbered, names))
        ordered = [of_joint[joint] for joint in sorted(of_joint)]
        joints[kind] = [column.number for column in ordered]
        own_units[kind] = [_unit(header, column, units, unit) for column in ordered]
    return CsvColumns(joints, own_units)


def _numbered(number: int, text: str) -> _Column | None:
    """Column of q1_deg, qd1_deg_s, qdd1_deg_s2, with unit or without."""
    match = _NUMBERED.match(text)
    if match is None:
        return None
    rest, kind = text[match.end() :], _WORDS[match["word"]]
    unit = _UNIT.fullmatch(rest) if rest else None
    if rest and (unit is None or _PER[(unit["per"] or "").replace("^", "")] != kind):
        return None
    return _Column(number, kind, int(match["joint"]) - 1, unit["unit"] if unit else "")


def _named(number: int, text: str, names: Sequence[str] | None) -> _Column | None:
    """Column of a joint's name with a word for the quantity, or alone."""
    for joint, name in enumerate(names or ()):
        for body, unit in _bodies(text):
            match = re.fullmatch(rf"(?:(.*)[./\s_])?{re.escape(name)}(?:[./\s_](.*))?", body)
            if match is None:
                continue
            before, after = (_APART.split(part.strip("./ _")) if part else [] for part in match.groups())
            words = [w.lower() for w in (*before[-1:], *after) if w.lower() in _WORDS]
            topic = text.startswith("/") and not after
            if len(words) == 1 and len(after) <= 1 and (not after or after[0].lower() in _WORDS):
                return _Column(number, _WORDS[words[0]], joint, unit)
            if not words and not after and (not before or topic):
                return _Column(number, POSITION, joint, unit)
    return None


def _bodies(text: str) -> list[tuple[str, str]]:
    """The text as it is, and without the unit at its end."""
    match = _AT_END.fullmatch(text)
    return [(text, "")] + ([(match["body"].rstrip(" _"), match["unit"])] if match else [])


def _missing(
    kind: str, missing: Sequence[str], numbered: Sequence[_Column], names: Sequence[str] | None
) -> str:
    if numbered or not names:
        word, per = {POSITION: ("q", ""), SPEED: ("qd", "_s"), ACCELERATION: ("qdd", "_s2")}[kind]
        joint = missing[0].removeprefix("q") if missing else "1"
        hint = "" if names else ", and no joints are known by name"
        return f"header: {word}{joint}_deg{per} is missing{'' if numbered else hint}"
    return f"header: no {kind} of {some(list(missing))}; joints are known by name, or as q1_deg, q2_deg, ..."


def _unit(header: Sequence[str], column: _Column, units: Sequence[str], unit: str | None) -> str:
    """Unit of a column: that of its title, else m for joints that slide, else that of the user."""
    if column.unit:
        return column.unit
    if column.joint < len(units) and units[column.joint] == "m":
        return "m"
    if unit is None:
        raise InputError(
            f"header: {header[column.number]} says neither degrees nor radians; give --unit deg or "
            f"--unit rad, or call it {header[column.number]}_deg"
        )
    return unit
