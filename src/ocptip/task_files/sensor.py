"""The table `[sensor]` of a task file; format: docs/motion-planner.md."""

from __future__ import annotations

import numpy as np

from ocptip.basics import schema
from ocptip.basics.schema import Keys
from ocptip.basics.toml import Table
from ocptip.standing.sensor import WrenchSensor

SENSOR = Keys(
    "sensor",
    "A force-torque sensor in the base, whose readings are columns of motion.csv.",
    {
        "name": schema.text("Begin of the names of its columns.", default="sensor"),
        "position": schema.vector("Origin, base axes.", "m", 3, otherwise="where the robot is mounted"),
        **schema.rotation("Axes of the sensor to those of the base", default="parallel to the base"),
        "mass": schema.number(
            "Mass of what of the base rests on the sensor.", "kg", bound=">= 0", default=0.0
        ),
        "center_of_mass": schema.vector("Where that mass is, base axes.", "m", 3, otherwise="at the sensor"),
    },
)


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
        table.get("position", mount),
        name=table["name"],
        rotation=table.rotation("", np.eye(3)),
        mass=table["mass"],
        center_of_mass=table["center_of_mass"],
    )
