"""A parallel robot as a TOML file.

Angles in rad; an entry of the geometry is a number, a multiple of pi such as "pi/2" or "-2*pi/3", or the name
of one of the `[parameters]`. Legs, rows and joints are counted from 1. Every error is one :class:`InputError`
that starts with the file and the key.
"""

from __future__ import annotations

import difflib
import math
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, bounded_array, number_from, refuse_huge
from ocptip.basics.toml import read_toml
from ocptip.parallel.description.branched import BranchedLeg, LegEnd
from ocptip.parallel.description.entries import Entry, Parameter, elementary_rotations, product_of
from ocptip.parallel.description.robot_description import (
    COORDINATES,
    FIXED,
    PRISMATIC,
    REVOLUTE,
    BodyInertia,
    Leg,
    MDHRow,
    Platform,
    RobotDescription,
)

_TOP = ("name", "gravity", "convention", "free", "home", "parameters", "platform", "table", "leg")
_JOINTS = {"revolute": REVOLUTE, "prismatic": PRISMATIC, "fixed": FIXED}
_ENTRIES = ("gamma", "b", "alpha", "d", "theta", "r")
_BODY = ("mass", "center", "inertia")
_FRICTION = ("drive_inertia", "viscous", "coulomb")
_TABLE = ("joints_to_coupling", "rows", "bodies", "loops", *_FRICTION)
_SERIAL = ("coupling", "end_rotation", "branch")
_END = ("row", "coupling", "end_rotation")
_LEG = (
    "table",
    "base_position",
    "base_rotation",
    "coupling",
    "end_rotation",
    "ends",
    "branch",
    "guess",
    "actuated",
    "redundant",
    *_FRICTION,
)
_PI = re.compile(r"([+-]?)(?:(\d+(?:\.\d+)?)\*)?pi(?:/(\d+(?:\.\d+)?))?")


def read_parallel_robot(path: str | os.PathLike[str]) -> RobotDescription:
    """Read a robot file.

    Raises:
        InputError: the file cannot be read or describes no robot; one line that names file and key.
    """
    path = Path(path)
    return robot_from_dict(read_toml(path), name=path.name)


def robot_from_dict(data: dict[str, Any], *, name: str = "robot") -> RobotDescription:
    """Build a description from the content of a robot file.

    Args:
        data: nested dictionaries and lists as `tomllib` returns them.
        name: put in front of every message; the robot's name if the file gives none.

    Raises:
        InputError: one line that names the key.
    """
    try:
        return _Reader(data).robot(name)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


class _Reader:
    def __init__(self, data: dict[str, Any]) -> None:
        _refuse_unknown(data, _TOP, "")
        self.data = data
        given = _table(data, "parameters") if "parameters" in data else {}
        self.parameters = {}
        for key, value in given.items():
            if _PI.fullmatch(key) or not key.isidentifier():
                raise InputError(f"parameters.{key}: not a usable name")
            self.parameters[key] = Parameter(key, _number(f"parameters.{key}", value))

    def robot(self, default_name: str) -> RobotDescription:
        data = self.data
        platform = self._platform()
        tables = _table(data, "table")
        legs, actuated, redundant = [], [], []
        given = data.get("leg")
        if not isinstance(given, list) or not given or not all(isinstance(leg, dict) for leg in given):
            raise InputError("leg: a robot needs legs, tables in double brackets [[leg]]")
        for number, leg in enumerate(given, start=1):
            where = f"leg[{number}]"
            _refuse_unknown(leg, _LEG, f"{where}.")
            legs.append(_named(where, self._leg, leg, tables, where))
            joints = legs[-1].n_joints
            actuated += [(number - 1, joint) for joint in _joint_list(leg, "actuated", where, joints)]
            redundant += [(number - 1, joint) for joint in _joint_list(leg, "redundant", where, joints)]
        name = data.get("name", default_name)
        if not isinstance(name, str):
            raise InputError(f"name: expected a text, got {name!r}")
        if "home" not in data:
            raise InputError("home: missing, the free coordinates of a pose in the workspace")
        gravity = bounded_array("gravity", data.get("gravity", [0.0, 0.0, -9.81]), (3,))
        home = bounded_array("home", data["home"], (None,))
        return RobotDescription(name, tuple(legs), platform, tuple(actuated), home, gravity, tuple(redundant))

    def _platform(self) -> Platform:
        free = self.data.get("free")
        if not isinstance(free, list) or not all(name in COORDINATES for name in free):
            raise InputError(f"free: expected names among {', '.join(COORDINATES)}, got {free!r}")
        convention = self.data.get("convention", "xyz")
        body = self.data.get("platform", {})
        if not isinstance(body, dict):
            raise InputError(f"platform: expected a table [platform], got {body!r}")
        mask = tuple(name in free for name in COORDINATES)
        return Platform(mask, convention, _body(body, "platform"))

    def _leg(self, leg: dict[str, Any], tables: dict[str, Any], where: str) -> Leg | BranchedLeg:
        key = leg.get("table")
        if not isinstance(key, str) or key not in tables:
            raise InputError(f"table: there is no [table.{key}]; there are {', '.join(tables)}")
        table = tables[key]
        if not isinstance(table, dict):
            raise InputError(f"table.{key}: expected a table, got {table!r}")
        _refuse_unknown(table, _TABLE, f"table.{key}.")
        rows = _dictionaries(table, "rows", f"table.{key}.")
        bodies = _dictionaries(table, "bodies", f"table.{key}.")
        friction = {name: _list(leg if name in leg else table, name) for name in _FRICTION}
        common = {
            "base_position": self._point(leg, "base_position"),
            "base_rotation": self._rotations(leg, "base_rotation"),
            "guess": _list(leg, "guess"),
            **friction,
        }
        made = tuple(self._row(row, f"table.{key}.rows[{i}]") for i, row in enumerate(rows, start=1))
        inertias = tuple(_body(body, f"table.{key}.bodies[{i}]") for i, body in enumerate(bodies, start=1))
        if "ends" in leg:
            return self._branched(leg, table, key, made, inertias, common)
        _refuse_branches(table, key)
        return Leg(
            made,
            table.get("joints_to_coupling"),
            inertias,
            coupling=self._point(leg, "coupling"),
            end_rotation=self._end_rotation(leg),
            branch=_list(leg, "branch"),
            **common,
        )

    def _branched(
        self,
        leg: dict[str, Any],
        table: dict[str, Any],
        key: str,
        rows: tuple[MDHRow, ...],
        bodies: tuple[BodyInertia, ...],
        common: dict[str, Any],
    ) -> BranchedLeg:
        for name in _SERIAL:
            if name in leg:
                raise InputError(f"{name}: a leg with ends has none of its own; give it in its ends")
        if "joints_to_coupling" in table:
            raise InputError(f"table.{key}.joints_to_coupling: not for legs with ends, whose rows branch")
        ends = _dictionaries(leg, "ends", "")
        return BranchedLeg(
            rows,
            _parents(table["rows"], f"table.{key}"),
            tuple(_named(f"ends[{i}]", self._end, end) for i, end in enumerate(ends, start=1)),
            bodies,
            loops=_loops(table, f"table.{key}", len(rows)),
            **common,
        )

    def _end(self, end: dict[str, Any]) -> LegEnd:
        _refuse_unknown(end, _END, "")
        row = end.get("row")
        if isinstance(row, bool) or not isinstance(row, int):
            raise InputError(f"row: expected the number of a row, from 1, got {row!r}")
        return LegEnd(row - 1, self._point(end, "coupling"), self._end_rotation(end))

    def _end_rotation(self, table: dict[str, Any]) -> np.ndarray | None:
        return product_of(self._rotations(table, "end_rotation")) if "end_rotation" in table else None

    def _row(self, row: dict[str, Any], where: str) -> MDHRow:
        _refuse_unknown(row, ("joint", "after", *_ENTRIES), f"{where}.")
        joint = row.get("joint")
        if joint not in _JOINTS:
            raise InputError(f"{where}.joint: expected one of {', '.join(_JOINTS)}, got {joint!r}")
        entries = {name: self._entry(f"{where}.{name}", row.get(name, 0.0)) for name in _ENTRIES}
        return MDHRow(_JOINTS[joint], **entries)

    def _point(self, leg: dict[str, Any], name: str) -> tuple[Entry, ...]:
        values = leg.get(name, [0.0, 0.0, 0.0])
        if not isinstance(values, list):
            raise InputError(f"{name}: expected a list of 3 entries, got {values!r}")
        return tuple(self._entry(f"{name}[{i}]", v) for i, v in enumerate(values, start=1))

    def _rotations(self, leg: dict[str, Any], name: str) -> tuple[tuple[str, Entry], ...]:
        values = leg.get(name, [])
        if not isinstance(values, list) or not all(isinstance(v, list) and len(v) == 2 for v in values):
            raise InputError(f'{name}: expected pairs of axis and angle, [["z", "pi/2"]], got {values!r}')
        turns = [
            (axis, self._entry(f"{name}[{i}]", angle)) for i, (axis, angle) in enumerate(values, start=1)
        ]
        return elementary_rotations(name, turns)

    def _entry(self, where: str, value: object) -> Entry:
        if not isinstance(value, str):
            return _number(where, value)
        if value in self.parameters:
            return self.parameters[value]
        found = _PI.fullmatch(value.replace(" ", ""))
        if found is None:
            raise InputError(
                f"{where}: {value!r} is neither a parameter nor a multiple of pi"
                f"{_suggestion(value, list(self.parameters))}"
            )
        sign, factor, divisor = found.groups()
        if divisor is not None and float(divisor) == 0:
            raise InputError(f"{where}: division by zero in {value!r}")
        return (-1 if sign == "-" else 1) * float(factor or 1) * math.pi / float(divisor or 1)


def _number(where: str, value: object) -> float:
    """A finite number that is not huge."""
    number = number_from(where, value)
    refuse_huge(where, number)
    return number


def _body(table: dict[str, Any], where: str) -> BodyInertia:
    _refuse_unknown(table, _BODY, f"{where}.")
    return _named(
        where,
        BodyInertia.about_center,
        table.get("mass", 0.0),
        table.get("center", [0.0, 0.0, 0.0]),
        table.get("inertia", [0.0, 0.0, 0.0]),
    )


def _refuse_branches(table: dict[str, Any], key: str) -> None:
    """Raise if a table can only belong to a leg with ends."""
    rows = enumerate(table.get("rows", []), start=1)
    branching = ["loops"] if "loops" in table else [f"rows[{i}].after" for i, row in rows if "after" in row]
    if branching:
        raise InputError(
            f"table.{key}.{branching[0]}: for legs that branch; those say in `ends` where they hold the "
            "platform, but this leg has none"
        )


def _parents(rows: list[dict[str, Any]], where: str) -> tuple[int, ...]:
    """Row (from 0) that each row starts from, -1 the base frame; by default the row before."""
    parents = []
    for number, row in enumerate(rows, start=1):
        after = row.get("after", number - 1)
        if isinstance(after, bool) or not isinstance(after, int) or not 0 <= after < number:
            raise InputError(
                f"{where}.rows[{number}].after: expected the number of an earlier row, or 0 for the base "
                f"frame, got {after!r}"
            )
        parents.append(after - 1)
    return tuple(parents)


def _loops(table: dict[str, Any], where: str, count: int) -> tuple[tuple[int, int], ...]:
    """Pairs of rows (from 0) whose origins coincide."""
    given = table.get("loops", [])
    if not isinstance(given, list):
        raise InputError(f"{where}.loops: expected pairs of rows, [[3, 5]], got {given!r}")
    for number, pair in enumerate(given, start=1):
        numbers = isinstance(pair, list) and all(type(row) is int for row in pair)
        if not numbers or len(pair) != 2 or not all(1 <= row <= count for row in pair):
            raise InputError(
                f"{where}.loops[{number}]: expected two rows out of 1 to {count} whose origins coincide, "
                f"got {pair!r}"
            )
    return tuple((a - 1, b - 1) for a, b in given)


def _named(where: str, make: Any, *arguments: Any) -> Any:
    """Call with the place in front of messages that do not name one yet."""
    try:
        return make(*arguments)
    except InputError as error:
        message = str(error)
        raise InputError(message if message.startswith("table.") else f"{where}.{message}") from None


def _joint_list(leg: dict[str, Any], key: str, where: str, joints: int) -> list[int]:
    """Joints (from 0) of a leg with so many."""
    values = leg.get(key, [])
    if not isinstance(values, list) or any(isinstance(v, bool) or not isinstance(v, int) for v in values):
        raise InputError(f"{where}.{key}: expected a list of joint numbers from 1, got {values!r}")
    if any(v < 1 for v in values):
        raise InputError(f"{where}.{key}: joints are counted from 1, got {values!r}")
    if any(v > joints for v in values):
        raise InputError(f"{where}.{key}: the leg has {joints} joints, got {values!r}")
    return [v - 1 for v in values]


def _list(table: dict[str, Any], key: str) -> tuple[Any, ...]:
    values = table.get(key, [])
    if not isinstance(values, list):
        raise InputError(f"{key}: expected a list of numbers, got {values!r}")
    return tuple(values)


def _dictionaries(table: dict[str, Any], key: str, prefix: str) -> list[dict[str, Any]]:
    values = table.get(key, [])
    if not isinstance(values, list) or not all(isinstance(v, dict) for v in values):
        raise InputError(f"{prefix}{key}: expected a list of tables, got {values!r}")
    return values


def _table(data: dict[str, Any], key: str) -> dict[str, Any]:
    value = data.get(key)
    if not isinstance(value, dict) or not value:
        raise InputError(f"{key}: expected a table [{key}...], got {value!r}")
    return value


def _refuse_unknown(table: Iterable[str], known: tuple[str, ...], prefix: str) -> None:
    for key in table:
        if key not in known:
            raise InputError(f"{prefix}{key}: unknown key{_suggestion(key, known)}")


def _suggestion(word: str, known: Iterable[str]) -> str:
    known = list(known)
    near = difflib.get_close_matches(word, known, n=1)
    guess = f"; did you mean {near[0]!r}?" if near else ""
    return f"{guess} (known: {', '.join(known) or 'none'})"


def describe(description: RobotDescription) -> dict[str, object]:
    """A robot as plain data: name, coordinates, motors (from 1), parameters, gravity, home."""
    return {
        "name": description.name,
        "legs": len(description.legs),
        "coordinates": list(description.platform.coordinates),
        "convention": description.platform.convention,
        "actuated": [[leg + 1, joint + 1] for leg, joint in description.actuated],
        "redundant": [[leg + 1, joint + 1] for leg, joint in description.redundant],
        "parameters": description.parameters,
        "gravity": np.asarray(description.gravity).tolist(),
        "home": np.asarray(description.home).tolist(),
    }
