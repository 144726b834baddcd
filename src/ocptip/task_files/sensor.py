"""The table `[sensor]` of a task file; format: docs/motion-planner.md."""

from __future__ import annotations

import numpy as np

from ocptip.basics.toml import Table
from ocptip.standing.sensor import WrenchSensor


def read_sensor(data: Table, mount: np.ndarray) -> WrenchSensor | None:
    """The sensor of a file, if it has one; by default where the mechanism is mounted, (3,), m.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    if "sensor" not in data:
        return None
    table = data.table("sensor")
    return table.make(
        WrenchSensor,
        table.vector("position", 3, mount),
        name=table.text("name", "sensor"),
        rotation=table.rotation("", np.eye(3)),
        mass=table.number("mass", 0.0, bound=">= 0"),
        center_of_mass=table.vector("center_of_mass", 3, None),
    )
