"""Tables `[[object]]` of task files: what stands on a tray in the gripper, on the base, or on each other."""

from __future__ import annotations

import numpy as np

from ocptip.basics import schema
from ocptip.basics.schema import Keys
from ocptip.basics.toml import Table
from ocptip.contact.bindings.clamps import ForceConstantHalfRigidClamp
from ocptip.standing.arm import Robot
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.objects import ROUND, Object, cup

_SEVERAL = 4  # contacts on the rim of each of several cups

CUP = Keys(
    "cup",
    "A suction cup or round magnet that holds the object, instead of contacts that only press.",
    {
        "position": schema.vector("Middle of the rim, object axes.", "m", 3, default=[0, 0, 0]),
        "radius": schema.number("Radius of the rim.", "m", bound="> 0"),
        "force": schema.number("Holding force.", "N", bound="> 0", otherwise="vacuum times area"),
        "vacuum": schema.number("Pressure below that around it.", "Pa", bound="> 0", otherwise="`force`"),
        "area": schema.number("Effective area.", "m^2", bound="> 0", otherwise="of the rim"),
    },
    one_of=[("force", "vacuum")],
)
OBJECT = Keys(
    "object",
    "A rigid object that only contacts hold; z of its frame points away from what it stands on.",
    {
        "name": schema.text("Name in messages and results: letters, digits, `_` and `-`."),
        "mass": schema.number("Mass.", "kg", bound="> 0"),
        "friction": schema.number("Coefficient of its contacts.", bound=">= 0"),
        "on": schema.text("`gripper`, `base`, or the name of the object below.", default="gripper"),
        "box": schema.vector("Edges of a box.", "m", 3, otherwise="none"),
        "cylinder": schema.vector("Radius and height of an upright cylinder.", "m", 2, otherwise="none"),
        "center_of_mass": schema.vector(
            "Centre of mass, object axes.", "m", 3, otherwise="middle of the shape"
        ),
        "inertia": schema.numbers(
            "About the centre of mass: principal values, xx xy xz yy yz zz, or matrix.",
            "kg m^2",
            otherwise="of the homogeneous shape",
        ),
        "contacts": schema.numbers(
            "Points that it stands on, object axes.",
            "m",
            words="list of positions",
            otherwise="edge of the shape",
        ),
        "cup": schema.tables(CUP, "Suction cups or magnets with the object's friction."),
        "position": schema.vector(
            "Middle of the bottom, gripper or base axes; on an object from its middle top.",
            "m",
            3,
            default=[0, 0, 0],
        ),
        **schema.rotation("Axes of the object to these axes", default="parallel"),
    },
    at_most_one=[("box", "cylinder"), ("contacts", "cup")],
)


def with_objects(data: Table, robot: StandingMechanism) -> StandingMechanism:
    """The robot with the objects of a file."""
    if "object" not in data:  # which only files of arms may have
        return robot
    objects = [_object(table) for table in data.tables("object")]
    with data.at("object"):
        return Robot.of(robot).carrying(objects)


def _object(table: Table) -> Object:
    given = {key: table[key] for key in ("name", "mass", "friction", "on", "position")}
    given["rotation"] = table.rotation("", np.eye(3))
    shape = table.one_of("box")
    size = table[shape] if shape else np.zeros(0)
    if not shape:
        for key in ("inertia", *(() if "cup" in table else ("contacts",))):
            table.require(key, "an object without box or cylinder needs it")
    given |= table.given("center_of_mass", "inertia", "contacts")
    if table.one_of("contacts") == "cup":
        cups = table.tables("cup")
        points = ROUND if len(cups) == 1 else _SEVERAL
        held = [_cup(cups_held, given["friction"], points) for cups_held in cups]
        given |= {"contacts": [contact for rim in held for contact in rim], "friction": None}
    table.close()
    with table.at(size=shape or ""):
        if not shape:
            return Object(**given)
        make = {"box": Object.box, "cylinder": Object.cylinder}[shape]
        return make(size=size, **given)


def _cup(table: Table, friction: float, points: int) -> list[ForceConstantHalfRigidClamp]:
    radius, area = table["radius"], table["area"]
    if table.one_of("force") == "force":
        force = table["force"]
    else:
        force = table["vacuum"] * (np.pi * radius**2 if area is None else area)
    return table.make(cup, table["position"], radius, force, friction, points)
