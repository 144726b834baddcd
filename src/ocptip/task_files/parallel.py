"""A parallel robot as a TOML file.

Angles in rad; an entry of the geometry is a number, a multiple of pi such as "pi/2" or "-2*pi/3", or the name
of one of the `[parameters]`. Legs, rows and joints are counted from 1. Every error is one :class:`InputError`
that starts with the file and the key.
"""

from __future__ import annotations

import math
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics import schema
from ocptip.basics.errors import InputError
from ocptip.basics.schema import REQUIRED, Key, Keys
from ocptip.basics.text import of_known
from ocptip.basics.toml import Source, Table
from ocptip.basics.values import number_of
from ocptip.contact.support import Support
from ocptip.parallel.description.branched import BranchedLeg, LegEnd
from ocptip.parallel.description.frames import modified_rows, moved_inertia, standard_frame
from ocptip.parallel.description.platform import (
    COORDINATES,
    BodyInertia,
    Entry,
    Parameter,
    Platform,
    elementary_rotations,
    product_of,
    value_of,
)
from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.description.robot_description import (
    FIXED,
    PRISMATIC,
    REVOLUTE,
    MDHRow,
    RobotDescription,
    SerialLeg,
)
from ocptip.parallel.robot import ParallelRobot
from ocptip.standing.platform import PlatformLimits, StandingParallelRobot
from ocptip.task_files.doubts import require_kind
from ocptip.task_files.tables.motors import dc_motors
from ocptip.task_files.tables.payload import load_table, read_payload, read_process, read_sensor

_JOINTS = {"revolute": REVOLUTE, "prismatic": PRISMATIC, "fixed": FIXED}
_ENTRIES = ("gamma", "b", "alpha", "d", "theta", "r")
_STANDARD = ("theta", "d", "a", "alpha")
_FRICTION = ("drive_inertia", "viscous", "coulomb")
_ENTRY = {"type": ["number", "string"]}
_NUMBERS = "number, multiple of pi, or parameter"


def _entry(meaning: str, unit: str) -> Key:
    return replace(schema.anything(meaning, _NUMBERS, _ENTRY, default=0.0), unit=unit)


def _point(meaning: str) -> Key:
    form = {"type": "array", "items": _ENTRY, "minItems": 3, "maxItems": 3}
    return replace(schema.anything(meaning, "list of 3 entries", form, default=[0.0, 0.0, 0.0]), unit="m")


def _turns(meaning: str, otherwise: str = "") -> Key:
    form = {"type": "array", "items": {"type": "array", "minItems": 2, "maxItems": 2}}
    default = None if otherwise else []
    return schema.anything(
        meaning, "list of pairs of axis and angle", form, default=default, otherwise=otherwise
    )


def _per_row(meaning: str, unit: str) -> Key:
    return schema.vector(meaning, unit, otherwise="0")


_BODY = Keys(
    "body",
    "Mass and inertia of a body.",
    {
        "mass": schema.number("Mass.", "kg", bound=">= 0", default=0.0),
        "center": schema.vector("Centre of mass, frame of the body.", "m", 3, default=[0, 0, 0]),
        "inertia": schema.numbers("Inertia about the centre of mass.", "kg m^2", otherwise="0"),
    },
)
_ROW = Keys(
    "row",
    "A joint and its Denavit-Hartenberg parameters, modified ones unless the table says standard.",
    {
        "joint": schema.choice("The kind of joint.", _JOINTS),
        "after": schema.whole(
            "Row whose frame this one starts from; 0: the base frame.", least=0, otherwise="the row before"
        ),
        **{key: _entry(f"Parameter {key}.", "m" if key in "bdr" else "rad") for key in _ENTRIES},
        "a": _entry("Parameter a of standard rows.", "m"),
        "range": schema.anything(
            "Smallest and largest position of the joint.",
            "list of 2 entries",
            {"type": "array", "items": _ENTRY, "minItems": 2, "maxItems": 2},
            otherwise="free",
        ),
    },
)
_OF_ROWS = {
    "drive_inertia": _per_row("Inertia of the drives.", "kg m^2, kg"),
    "viscous": _per_row("Viscous friction of the joints.", "N m s/rad, N s/m"),
    "coulomb": _per_row("Dry friction of the joints.", "N m, N"),
}
_TABLE = Keys(
    "table of a leg",
    "Joints and bodies of legs.",
    {
        "rows": schema.tables(_ROW, "Joints from base to platform, coupling joints included.", required=True),
        "dh": schema.choice(
            "Standard rows (theta, d, a, alpha) or modified ones.",
            ("standard", "modified"),
            default="modified",
        ),
        "joints_to_coupling": schema.anything(
            "Number of joints up to the coupling point; legs without loops.",
            "whole number",
            {"type": "integer", "minimum": 0},
            otherwise="none, of legs with loops",
        ),
        "bodies": schema.tables(_BODY, "One body for each row."),
        "loops": schema.array("Pairs of rows whose origins coincide.", "", (None, 2), otherwise="none"),
        **_OF_ROWS,
    },
)
_PLATFORM_END = {
    "coupling": _point("Coupling point, platform axes."),
    "end_rotation": _turns("Platform axes to the last frame of the leg.", "as the home pose says"),
}
_LEG = Keys(
    "leg",
    "A leg between base and platform.",
    {
        "table": schema.text("Name of its [table.NAME]."),
        "base_position": _point("Origin of the first frame, base axes."),
        "base_rotation": _turns('Base axes to the first frame: `[["z", "pi/6"]]`.'),
        **_PLATFORM_END,
        "guess": schema.vector("Values of joints near the home pose.", "rad, m", otherwise="0"),
        "branch": schema.vector("Signs of the closed form.", otherwise="by guess"),
        "actuated": schema.wholes("Joints with motors, from 1.", least=1, default=[]),
        "redundant": schema.wholes("Joints that are coordinates, from 1.", least=1, default=[]),
        "idle": schema.whole("Freedoms that neither platform nor motors notice.", least=0, default=0),
        "ends": schema.tables(
            Keys(
                "end of a leg",
                "An end of a leg with loops.",
                {"row": schema.whole("Row whose frame the platform holds.", least=1), **_PLATFORM_END},
            )
        ),
        **_OF_ROWS,
    },
)
_NAMES = {"type": "array", "items": {"enum": list(COORDINATES)}}
PARALLEL = Keys(
    "parallel robot",
    "A parallel robot: `ocptip parallel`.",
    {
        "name": schema.text("Title.", otherwise="name of the file"),
        "gravity": schema.vector("Acceleration of gravity, world axes.", "m/s^2", 3, default=[0, 0, -9.81]),
        "convention": schema.anything(
            "Euler angles of the platform.", "text", {"type": "string"}, default="xyz"
        ),
        "free": replace(
            schema.anything(
                "Free coordinates of the platform, in this order.", ", ".join(COORDINATES), _NAMES
            ),
            default=REQUIRED,
        ),
        "dependent": schema.anything(
            "Coordinates that follow from the free ones, in this order.",
            ", ".join(COORDINATES),
            _NAMES,
            default=[],
        ),
        "home": schema.vector("Free coordinates of a pose where all legs close.", "m, rad"),
        "dependent_home": schema.vector(
            "Dependent coordinates of that pose, nearly.", "m, rad", otherwise="0"
        ),
        "parameters": schema.table(
            Keys(
                "parameters", "Numbers by names.", others=schema.number("Value of the parameter.", "m, rad")
            ),
            default=None,
        ),
        "platform": schema.table(_BODY, "The body of the platform.", default=None),
        "table": schema.table(Keys("tables", "Tables of legs by names.", others=schema.table(_TABLE))),
        "leg": schema.tables(_LEG, required=True),
    },
)
_PI = re.compile(r"([+-]?)(?:(\d+(?:\.\d+)?)\*)?pi(?:/(\d+(?:\.\d+)?))?")


def read_robot(name: str) -> RobotDescription:
    """A ready-made robot by its name (upper or lower case), or the one of a file."""
    by_name = {known.lower(): make for known, make in READY_MADE.items()}
    if name.lower() in by_name:
        return by_name[name.lower()]()
    if not Path(name).suffix:
        raise InputError(f"{name}: expected one of {', '.join(READY_MADE)}, or a robot file NAME.toml")
    return read_parallel_robot(name)


def read_parallel_robot(source: Source, name: str = "robot") -> RobotDescription:
    """Read a robot file.

    Args:
        source: the file, or its content.
        name: put in front of every message about content.

    Raises:
        InputError: the file cannot be read or describes no robot; one line that names file and key.
    """
    with Table.read(source, PARALLEL, name) as data:
        require_kind(data, "parallel")
        data.close(early=True)
        return _Reader(data).robot()


class _Reader:
    def __init__(self, data: Table) -> None:
        self.data = data
        given = data.table("parameters")
        for key in given:
            if _PI.fullmatch(key) or not key.isidentifier():
                raise given.error("not a usable name", key)
        self.parameters = {key: Parameter(key, given[key]) for key in given}
        self.tables = data.table("table")
        self.tables.close(early=True)

    def robot(self) -> RobotDescription:
        data = self.data
        platform = self._platform()
        legs, pairs = [], {"actuated": [], "redundant": []}
        for number, leg in enumerate(data.tables("leg")):
            legs.append(self._leg(leg))
            for key, pair in pairs.items():
                joints = leg.get(key, size=legs[-1].n_joints)
                pair += [(number, joint - 1) for joint in joints]
        name = data.get("name", data.file)
        gravity = data["gravity"]
        homes = {"home": data["home"]}
        if "dependent_home" in data:
            homes["dependent_home"] = data.get("dependent_home", size=len(platform.dependent_coordinates))
        return data.make(RobotDescription, name, legs, platform, **pairs, **homes, gravity=gravity)

    def _platform(self) -> Platform:
        mask, dependent = self._coordinates("free"), self._coordinates("dependent")
        body = _body(self.data.table("platform"))
        convention = self.data["convention"]
        return self.data.make(Platform, mask, convention, body, dependent=dependent)

    def _coordinates(self, key: str) -> tuple[bool, ...]:
        """Which of the platform's coordinates a list of their names holds."""
        names = self.data[key]
        if not isinstance(names, list) or not all(name in COORDINATES for name in names):
            raise self.data.error(f"expected names among {', '.join(COORDINATES)}, got {names!r}", key)
        if len(set(names)) != len(names):
            raise self.data.error(f"a coordinate is listed twice: {names!r}", key)
        ordered = [name for name in COORDINATES if name in names]
        if names != ordered:
            # `home` and all z follow this order: another one would be read as something else.
            raise self.data.error(f"expected the order {ordered}, which z and `home` have, got {names}", key)
        return tuple(name in names for name in COORDINATES)

    def _leg(self, leg: Table) -> SerialLeg | BranchedLeg:
        key = leg["table"]
        if key not in self.tables:
            raise leg.error(f"there is no [table.{key}]{of_known(key, self.tables)}", "table")
        table = self.tables.table(key)
        rows = table.tables("rows")
        make, parts = self._branched(leg, table, rows) if "ends" in leg else self._serial(leg, table, rows)
        parts |= {name: leg.get(name, table.get(name, ())) for name in _FRICTION}
        standard = table["dh"] == "standard"
        pairs = [self._row(row, standard) for row in rows]
        parts |= {
            "rows": tuple(joint for joint, _ in pairs),
            "bodies": tuple(_body(body) for body in table.tables("bodies")),
        }
        if standard:
            self._make_modified(table, parts, [link for _, link in pairs])
        parts |= {
            "base_position": self._point(leg, "base_position"),
            "base_rotation": self._rotations(leg, "base_rotation"),
            "guess": leg.get("guess", ()),
            "idle": leg["idle"],
        }
        leg.close(early=True)
        table.close()
        with leg.at(), table.at(None, n="joints_to_coupling", bodies="bodies"), leg.at(None):
            return make(**parts)

    def _serial(self, leg: Table, table: Table, rows: list[Table]) -> tuple[type, dict[str, Any]]:
        for part, name in ((table, "loops"), *((row, "after") for row in rows)):
            if name in part:
                raise part.error("for branched legs, with `ends`, but this leg has none", name)
        return SerialLeg, {
            "n": table.get("joints_to_coupling", REQUIRED),
            "coupling": self._point(leg, "coupling"),
            "end_rotation": self._end_rotation(leg),
            "branch": leg.get("branch", ()),
        }

    def _branched(self, leg: Table, table: Table, rows: list[Table]) -> tuple[type, dict[str, Any]]:
        for name in ("coupling", "end_rotation", "branch"):
            if name in leg:
                raise leg.error("a leg with ends has none; give it in its ends", name)
        if "joints_to_coupling" in table:
            raise table.error("not for legs with ends, which are branched", "joints_to_coupling")
        return BranchedLeg, {
            "parents": tuple(row.get("after", k, size=k) - 1 for k, row in enumerate(rows)),
            "loops": _loops(table),
            "ends": tuple(self._end(end) for end in leg.tables("ends")),
        }

    def _end(self, end: Table) -> LegEnd:
        row = end["row"]
        return end.make(LegEnd, row - 1, self._point(end, "coupling"), self._end_rotation(end))

    def _end_rotation(self, table: Table) -> np.ndarray | None:
        return product_of(self._rotations(table, "end_rotation")) if "end_rotation" in table else None

    def _make_modified(self, table: Table, parts: dict[str, Any], links: list[tuple[Entry, Entry]]) -> None:
        """Bring a leg with standard rows, whose links have (a, alpha), to modified ones.

        Named lengths stay symbols in the rows; bodies and the last frame are moved by their values.
        """
        if "parents" in parts:
            raise table.error("standard rows are for legs without ends, whose rows are one chain", "dh")
        if links and value_of(links[-1][0]):
            raise table.error("a of the last row must be 0: a leg ends on the axis of its last joint", "rows")
        moved = zip(parts["bodies"], links, strict=False)
        parts["rows"] = modified_rows(parts["rows"], links)
        parts["bodies"] = tuple(moved_inertia(body, standard_frame(*link)) for body, link in moved)
        if parts["end_rotation"] is not None:
            parts["end_rotation"] = standard_frame(*links[-1])[0] @ parts["end_rotation"]

    def _row(self, row: Table, standard: bool) -> tuple[MDHRow, tuple[Entry, Entry]]:
        """A joint, of standard rows without the link behind it, and that link's a and alpha."""
        names = _STANDARD if standard else _ENTRIES
        for name in {*_ENTRIES, *_STANDARD} - {*names}:
            if name in row:
                kind = "standard" if standard else "modified"
                raise row.error(f"{kind} rows have {', '.join(names)} (dh of the table chooses)", name)
        entries: dict[str, Any] = {name: self._entry(row, name, row[name]) for name in names}
        link = (0.0, 0.0)
        if standard:
            link, entries["r"] = (entries.pop("a"), entries.pop("alpha")), entries.pop("d")
        if "range" in row:
            ends = row.value("range")
            if not isinstance(ends, list) or len(ends) != 2:
                raise row.error(f"expected the smallest and the largest position, got {ends!r}", "range")
            values = [value_of(self._entry(row, f"range[{i}]", end)) for i, end in enumerate(ends, 1)]
            entries["range"] = tuple(values)
        row.close(early=True)
        return row.make(MDHRow, _JOINTS[row["joint"]], **entries), link

    def _point(self, table: Table, key: str) -> tuple[Entry, ...]:
        values = table[key]
        if not isinstance(values, list):
            raise table.error(f"expected a list of 3 entries, got {values!r}", key)
        return tuple(self._entry(table, f"{key}[{i}]", value) for i, value in enumerate(values, 1))

    def _rotations(self, table: Table, key: str) -> tuple[tuple[str, Entry], ...]:
        values = table.get(key, [])
        if not isinstance(values, list) or not all(isinstance(v, list) and len(v) == 2 for v in values):
            raise table.error(f'expected pairs of axis and angle, [["z", "pi/2"]], got {values!r}', key)
        turns = [
            (axis, self._entry(table, f"{key}[{i}]", angle)) for i, (axis, angle) in enumerate(values, 1)
        ]
        with table.at():
            return elementary_rotations(key, turns)

    def _entry(self, table: Table, key: str, value: object) -> Entry:
        """The number that stands at a key, or at an element of its list, "base_position[1]"."""
        if isinstance(value, str) and value in self.parameters:
            return self.parameters[value]
        result = _PI.fullmatch(value.replace(" ", "")) if isinstance(value, str) else None
        if result is not None:
            sign, factor, divisor = result.groups()
            if divisor is not None and float(divisor) == 0:
                raise table.error(f"division by zero in {value!r}", key)
            return (-1 if sign == "-" else 1) * float(factor or 1) * math.pi / float(divisor or 1)
        if isinstance(value, str):
            hint = of_known(value, self.parameters)
            raise table.error(f"{value!r} is neither a parameter nor a multiple of pi{hint}", key)
        with table.at(key):
            return number_of(value)


def _body(table: Table) -> BodyInertia:
    return table.make(
        BodyInertia.about_center, table["mass"], table["center"], table.get("inertia", np.zeros(3))
    )


def _loops(table: Table) -> list[tuple[int, int]]:
    """Pairs of rows (from 0) whose origins coincide."""
    pairs = table.get("loops", np.zeros((0, 2)))
    if (pairs % 1 != 0).any():
        raise table.error(f"expected pairs of rows, [[3, 5]], got {pairs.tolist()}", "loops")
    return [(int(a) - 1, int(b) - 1) for a, b in pairs]


def read_platform_robot(
    data: Table, support: Support, moment: float | None, segment: Table | None = None
) -> StandingParallelRobot:
    """The robot of a file on its support.

    Args:
        data: the file.
        support: of its scene.
        moment: reference moment, N m, or None.
        segment: of a cycle.
    """
    table = data.table("robot")
    name, payload = table["parallel"], read_payload(load_table(data, segment))
    mount = {"position": table["mount_position"], "rotation": table.rotation("mount_", np.eye(3))}
    process = read_process(data, segment)
    if process is not None and process.turns_with_tool:
        raise data.error('of a parallel robot has axes = "base" or "world"', "process.axes")
    load = None if process is None else process.seen_from(mount["rotation"].T).wrench
    table.close(early=True)
    with table.at("parallel"):
        made = READY_MADE[name]() if name in READY_MADE else read_parallel_robot(table.named_file("parallel"))
        robot = ParallelRobot(made.with_payload(payload))
    sensor, motors = read_sensor(data, mount["position"]), data.table("motors")
    _ = motors["kind"]  # complains where it is missing
    drives, given = dc_motors(motors, robot.m), table.table("limits")
    bounds = {
        one.name: given.get(one.name, size=robot.m)
        for one in fields(PlatformLimits)
        if one.name != "singularity"
    }
    bounds["motor_speed"] = given.get("motor_speed", np.inf, size=robot.m)
    limits = given.make(PlatformLimits, **bounds, **given.given("singularity"))
    with table.at(), given.at(None):
        return StandingParallelRobot(
            robot, support, drives, limits, **mount, load=load, reference_moment=moment, sensor=sensor
        )
