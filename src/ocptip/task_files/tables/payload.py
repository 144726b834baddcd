"""The tables `[payload]`, `[process]` and `[sensor]`, see docs/motion-planner.md.

Payload and process are one for the file, or one of several by segment of a cycle.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ocptip.basics import schema
from ocptip.basics.errors import InputError
from ocptip.basics.read import read_text
from ocptip.basics.schema import Key, Keys
from ocptip.basics.text import did_you_mean
from ocptip.basics.toml import Table
from ocptip.robots.payload import Payload
from ocptip.robots.process import AXES, PATH, SHARE, TIME, ProcessWrench
from ocptip.standing.sensor import WrenchSensor
from ocptip.task_files.tables.shapes import shape_key
from ocptip.trajectories.read_csv import csv_table

_NONE = "none"
_OVER = {"time_s": TIME, "share": SHARE, "path_m": PATH}
_COLUMNS = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
_PAYLOAD = Keys(
    "payload",
    "What the gripper holds, or the platform carries.",
    {
        "mass": schema.number("Mass; 0: nothing.", "kg", bound=">= 0"),
        "center_of_mass": schema.vector("Centre of mass, gripper axes.", "m", 3, default=[0, 0, 0]),
        "inertia": schema.numbers(
            "About the centre of mass: principal values, xx xy xz yy yz zz, or matrix.",
            "kg m^2",
            otherwise="point mass",
        ),
        "box": schema.vector(
            "Edges of a homogeneous box along the gripper axes.", "m", 3, otherwise="point mass"
        ),
        "shape": shape_key("Solids in the gripper, gripper axes."),
    },
    at_most_one=[("inertia", "box")],
)
_PROCESS = Keys(
    "process",
    "What a process does to the gripper at the TCP.",
    {
        "force": schema.vector("Force.", "N", 3, otherwise="none"),
        "moment": schema.vector("Moment.", "N m", 3, otherwise="none"),
        "file": schema.file(
            "CSV file of forces and moments over time, share or path, instead of both.", otherwise="none"
        ),
        "axes": schema.choice("Axes of both; `tool`: they turn with the gripper.", AXES, default="tool"),
    },
)


def _of_file(keys: Keys) -> Key:
    """A load, or loads by names, of which segments choose."""
    several = Keys(
        f"named {keys.name}", keys.meaning, keys.keys, others=schema.table(keys), at_most_one=keys.at_most_one
    )
    form = {"anyOf": [keys.ref, {"type": "object", "additionalProperties": keys.ref}]}
    words = "table, or tables by name, of which segments choose"
    return replace(schema.table(several, default=None), words=words, schema=form)


def _of_segment(keys: Keys) -> Key:
    """A load, the name of one, or "none"."""
    form = {"anyOf": [{"type": "string"}, keys.ref]}
    key = schema.table(keys, default=None)
    return replace(key, words="`none`, name, or table", schema=form, otherwise="that of the file")


PAYLOAD, PROCESS = _of_file(_PAYLOAD), _of_file(_PROCESS)
OF_SEGMENT = {"payload": _of_segment(_PAYLOAD), "process": _of_segment(_PROCESS)}


def load_table(data: Table, segment: Table | None = None, key: str = "payload") -> Table | None:
    """The table of a load, None if there is none.

    A segment has what its key says: `"none"`, a table, or the name of a table below `[payload]`; by default
    what the file has in `[payload]` itself, if that is no list of names.

    Args:
        data: the file.
        segment: of a cycle.
        key: of the load, "payload" or "process".

    Raises:
        InputError: no such name, or several names and no segments.
    """
    names, reserved = _names(data, key), {"payload": _PAYLOAD, "process": _PROCESS}[key].keys
    if taken := [name for name in names if name in reserved]:
        raise data.error(f"{taken[0]!r} is a key of [{key}]; give the load another name", f"{key}.{taken[0]}")
    if segment is None or key not in segment:
        if segment is None and names:
            raise data.error(f"{', '.join(names)}: only segments can choose between several", key)
        return data.table(key) if key in data and not names else None
    value = segment.value(key)
    if value == _NONE:
        return None
    if isinstance(value, dict):
        return segment.table(key)
    if value in names:
        return data.table(key).table(value)
    known = ", ".join([repr(_NONE), "a table", *map(repr, names)])
    raise segment.error(f"expected one of {known}, got {value!r}{did_you_mean(value, names)}", key)


def _names(data: Table, key: str) -> list[str]:
    """Names of the tables below `[payload]`, if it has nothing else."""
    value = data.value(key)
    tables = (
        isinstance(value, dict)
        and value
        and all(isinstance(value_given, dict) for value_given in value.values())
    )
    return [name for name in value if name != "shape"] if tables and list(value) != ["shape"] else []


def read_payload(table: Table | None) -> Payload | None:
    """The payload; None without one, or without mass."""
    if table is None:
        return None
    mass, center = table["mass"], table["center_of_mass"]
    if mass == 0:  # an empty gripper; what else is said of the load has no effect
        for key in ("inertia", "box", "shape"):
            table.value(key)
        table.close()
        return None
    if table.one_of("inertia") == "box":
        return table.make(Payload.box, mass, table["box"], center)
    return table.make(Payload, mass, center, table.get("inertia", np.zeros((3, 3))))


def read_process(data: Table, segment: Table | None = None) -> ProcessWrench | None:
    """The process wrench on the gripper; None if there is none.

    Args:
        data: the file.
        segment: of a cycle.
    """
    table = load_table(data, segment, "process")
    if table is None:
        return None
    axes = table["axes"]
    if "file" in table:
        path = table["file"]
        table.close()
        with table.at("file"):
            return _varying(read_text(path), axes)
    if "force" not in table and "moment" not in table:
        table.require("force", "a process needs a force or a moment, or a file")
    force, moment = (table.get(key, np.zeros(3)) for key in ("force", "moment"))
    return table.make(ProcessWrench, force, moment, axes)


def _varying(text: str, axes: str) -> ProcessWrench:
    """A process of the columns of a CSV file."""
    header, rows = csv_table(text)
    first = [name for name in header if name in _OVER]
    known = [*_OVER, *_COLUMNS]
    for name in header:
        if name not in known or header.count(name) > 1:
            raise InputError(f"column {name!r}: expected one each of {', '.join(known)}")
    if len(first) != 1 or len(header) < 2:
        raise InputError(f"expected one column of {', '.join(_OVER)} and some of {', '.join(_COLUMNS)}")
    columns = {name: rows[:, k] for k, name in enumerate(header)}
    load = np.stack([columns.get(name, np.zeros(len(rows))) for name in _COLUMNS], axis=1)
    return ProcessWrench(load[:, :3], load[:, 3:], axes, _OVER[first[0]], columns[first[0]])


SENSOR = Keys(
    "sensor",
    "A force-torque sensor in the base, whose readings are columns of motion.csv.",
    {
        "name": schema.text("Begin of the names of its columns.", default="sensor"),
        "position": schema.vector("Origin, base axes.", "m", 3, otherwise="where the robot is mounted"),
        **schema.rotation("Axes of the sensor to those of the base", default="parallel to the base"),
        "mass": schema.number(
            "Mass of what of the base rests on the sensor.",
            "kg",
            bound=">= 0",
            otherwise="0; of a published case its adapter, 0.164",
        ),
        "center_of_mass": schema.vector("Where that mass is, base axes.", "m", 3, otherwise="at the sensor"),
    },
)


def read_sensor(data: Table, mount: np.ndarray, mass: float = 0.0) -> WrenchSensor | None:
    """The sensor of a file, if it has one; by default at `mount`, (3,), m, with `mass`, kg, on it."""
    if "sensor" not in data:
        return None
    table = data.table("sensor")
    return table.make(
        WrenchSensor,
        table.get("position", mount),
        name=table["name"],
        rotation=table.rotation("", np.eye(3)),
        mass=table.get("mass", mass),
        center_of_mass=table["center_of_mass"],
    )
