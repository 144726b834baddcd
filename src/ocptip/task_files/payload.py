"""What the robot holds: `[payload]`, or one of several, by segment of a cycle; see docs/motion-planner.md."""

from __future__ import annotations

import numpy as np

from ocptip.basics.text import did_you_mean
from ocptip.basics.toml import Table
from ocptip.robots.payload import Payload

_NONE = "none"


def payload_table(data: Table, segment: Table | None = None) -> Table | None:
    """The table of what is held, None if nothing is.

    A segment holds what its key `payload` says: `"none"`, a table, or the name of a table below `[payload]`;
    by default what the file has in `[payload]` itself, if that is no list of names.

    Args:
        data: the file.
        segment: of a cycle.

    Raises:
        InputError: no such name, or several names and no segments.
    """
    names = _names(data)
    if segment is None or "payload" not in segment:
        if segment is None and names:
            raise data.error(f"{', '.join(names)}: only segments can choose between several", "payload")
        return data.table("payload") if "payload" in data and not names else None
    value = segment.value("payload")
    if value == _NONE:
        return None
    if isinstance(value, dict):
        return segment.table("payload")
    if value in names:
        return data.table("payload").table(value)
    known = ", ".join([repr(_NONE), "a table", *map(repr, names)])
    raise segment.error(f"expected one of {known}, got {value!r}{did_you_mean(value, names)}", "payload")


def _names(data: Table) -> list[str]:
    """Of the tables below `[payload]`, where there is nothing else in it."""
    value = data.value("payload", None)
    tables = isinstance(value, dict) and value and all(isinstance(own, dict) for own in value.values())
    return [name for name in value if name != "shape"] if tables and list(value) != ["shape"] else []


def read_payload(table: Table | None) -> Payload | None:
    """What is held, None if nothing is.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    if table is None:
        return None
    mass, center = table.number("mass", bound="> 0"), table.vector("center_of_mass", 3, np.zeros(3))
    if table.one_of("inertia", "box", optional=True) == "box":
        return table.make(Payload.box, mass, table.vector("box", 3), center)
    return table.make(Payload, mass, center, table.raw_numbers("inertia", np.zeros((3, 3))))
