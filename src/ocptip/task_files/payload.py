"""What the robot holds, `[payload]`, and what acts on its gripper, `[process]`: see docs/motion-planner.md.

Each is one for the file, or one of several by segment of a cycle.
"""

from __future__ import annotations

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.read import read_text
from ocptip.basics.text import did_you_mean
from ocptip.basics.toml import Table
from ocptip.robots.payload import Payload
from ocptip.robots.process import AXES, PATH, SHARE, TIME, ProcessWrench
from ocptip.trajectories.read_csv import csv_table

_NONE = "none"
_OVER = {"time_s": TIME, "share": SHARE, "path_m": PATH}
_COLUMNS = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")


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
    names = _names(data, key)
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
    """Of the tables below `[payload]`, where there is nothing else in it."""
    value = data.value(key, None)
    tables = isinstance(value, dict) and value and all(isinstance(own, dict) for own in value.values())
    return [name for name in value if name != "shape"] if tables and list(value) != ["shape"] else []


def read_payload(table: Table | None) -> Payload | None:
    """What is held, None if nothing is, or nothing that weighs.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    if table is None:
        return None
    mass, center = table.number("mass", bound=">= 0"), table.vector("center_of_mass", 3, np.zeros(3))
    if mass == 0:  # an empty gripper; what else is said of the load has no effect
        table.close("inertia", "box", "shape")
        return None
    if table.one_of("inertia", "box", optional=True) == "box":
        return table.make(Payload.box, mass, table.vector("box", 3), center)
    return table.make(Payload, mass, center, table.raw_numbers("inertia", np.zeros((3, 3))))


def read_process(data: Table, segment: Table | None = None) -> ProcessWrench | None:
    """What acts on the gripper, None if nothing does.

    Args:
        data: the file.
        segment: of a cycle.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    table = load_table(data, segment, "process")
    if table is None:
        return None
    axes = table.choice("axes", AXES, "tool")
    if "file" in table:
        path = table.path_of("file")
        table.close()
        with table.at("file"):
            return _varying(read_text(path), axes)
    if "force" not in table and "moment" not in table:
        table.require("force", "a process needs a force or a moment, or a file")
    force, moment = (table.vector(key, 3, np.zeros(3)) for key in ("force", "moment"))
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
    own = {name: rows[:, k] for k, name in enumerate(header)}
    load = np.stack([own.get(name, np.zeros(len(rows))) for name in _COLUMNS], axis=1)
    return ProcessWrench(load[:, :3], load[:, 3:], axes, _OVER[first[0]], own[first[0]])
