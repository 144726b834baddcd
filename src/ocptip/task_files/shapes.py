"""Solids in task files: obstacles, shapes of the base and of the payload; format: docs/collision.md."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ocptip.basics.toml import Table
from ocptip.robots.collision.shapes import Ball, BodyShape, Box, Cylinder, Shape
from ocptip.robots.collision.urdf import read_mesh
from ocptip.robots.geometry import Obstacle, Pillar, Solid, Wall, floor


def _box(table: Table) -> list[Shape]:
    return [table.make(Box, table.vector("size", 3))]


def _cylinder(table: Table) -> list[Shape]:
    return [table.make(Cylinder, table.number("radius", bound="> 0"), table.number("length", bound="> 0"))]


def _sphere(table: Table) -> list[Shape]:
    return [table.make(Ball, table.number("radius", bound="> 0"))]


def _mesh(table: Table) -> list[Shape]:
    file, scale = table.path_of("file"), table.vector("scale", 3, np.ones(3))
    table.close()
    with table.at("file"):
        return read_mesh(file, scale)


SOLIDS: dict[str, Callable[[Table], list[Shape]]] = {
    "box": _box,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "mesh": _mesh,
}


def read_shape(table: Table) -> list[Shape]:
    """The solid of a table with its pose; a mesh may be several.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    kind = table.choice("kind", SOLIDS)
    position, rotation = table.vector("position", 3, np.zeros(3)), table.rotation(default=np.eye(3))
    return [shape.placed(rotation, position) for shape in SOLIDS[kind](table)]


def read_shapes(owner: Table, default: str, *, carried: bool = False) -> list[BodyShape]:
    """The solids of the table or tables `shape` of another one; several are called "... 1" and so on.

    Args:
        owner: such as `[base]`.
        default: name.
        carried: by the gripper.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    single = isinstance(owner.value("shape", None), dict)
    tables = [owner.table("shape")] if single else owner.tables("shape")
    found = []
    for number, table in enumerate(tables, 1):
        name = table.text("name", f"{default} {number}" if len(tables) > 1 else default)
        found += [BodyShape(name, 0, shape, carried) for shape in read_shape(table)]
    return found


def read_base_shapes(data: Table) -> list[BodyShape]:
    """The solids `[[base.shape]]` of a file.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    base = data.table("base")
    if "spheres" in base:
        raise base.error(
            'is now a shape each: shape = [{ kind = "sphere", position = [x, y, z], radius = r }, ...]',
            "spheres",
        )
    return read_shapes(base, "base")


def stands_on_floor(data: Table) -> bool:
    """Whether what the contacts of `[base]` stand on is an obstacle."""
    return data.table("base").flag("floor", True)


def read_obstacles(data: Table, key: str, *, numbered: bool = False, world: bool = False) -> list[Obstacle]:
    """The obstacles of tables in double brackets.

    Args:
        data: the file.
        key: of the tables.
        numbered: several without names are called "wall 1" and so on.
        world: in world axes, where floors are none of them.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    tables = data.tables(key)
    found: list[Obstacle] = []
    for number, table in enumerate(tables, 1):
        kind = table.choice("kind", ("floor", "wall", "pillar", *SOLIDS))
        name = f"{kind} {number}" if numbered and len(tables) > 1 else kind
        if kind == "floor" and world:
            hint = "give it as [[base_obstacle]], or a wall with its normal"
            raise table.error(f"a floor belongs to the base: {hint}", "kind")
        if kind == "floor":
            found.append(table.make(floor, table.number("height")))
        elif kind == "wall":
            normal, distance = table.direction("normal"), table.number("distance")
            found.append(table.make(Wall, normal, distance, table.text("name", name)))
        elif kind == "pillar":
            point, radius = table.vector("point", 3), table.number("radius", bound="> 0")
            axis = table.direction("axis", np.array([0.0, 0.0, 1.0]))
            found.append(table.make(Pillar, point, radius, axis, table.text("name", name)))
        else:
            name = table.text("name", name)
            found += [Solid(shape, name) for shape in read_shape(table)]
    return found
