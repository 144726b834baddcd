"""The table `[payload]` of task files: what the robot holds; format: docs/motion-planner.md."""

from __future__ import annotations

import numpy as np

from ocptip.basics.toml import Table
from ocptip.robots.payload import Payload


def read_payload(data: Table) -> Payload | None:
    """What the robot of a file holds, None if the file has no such table.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    if "payload" not in data:
        return None
    table = data.table("payload")
    mass, center = table.number("mass", bound="> 0"), table.vector("center_of_mass", 3, np.zeros(3))
    if table.one_of("inertia", "box", optional=True) == "box":
        return table.make(Payload.box, mass, table.vector("box", 3), center)
    return table.make(Payload, mass, center, table.raw_numbers("inertia", np.zeros((3, 3))))
