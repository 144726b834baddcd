"""Solids in task files: obstacles, shapes of base and payload, what may touch; format: docs/collision.md."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ocptip.basics import schema
from ocptip.basics.schema import Key, Keys
from ocptip.basics.toml import Table
from ocptip.robots.collision.model import geometry_of_spheres
from ocptip.robots.collision.shapes import Ball, BodyShape, Box, Cylinder, Shape
from ocptip.robots.geometry import (
    FLOOR,
    Obstacle,
    Pillar,
    Solid,
    Wall,
    floor,
    never_part,
    spheres_along_links,
)
from ocptip.robots.model import ArmModel
from ocptip.robots.urdf.collision import read_mesh

_RADIUS = {"radius": schema.number("Radius.", "m", bound="> 0")}
_NAME = {"name": schema.text("Name in messages and results.", otherwise="the kind")}
_POSE = {
    **_NAME,
    "position": schema.vector("Origin of the solid.", "m", 3, default=[0, 0, 0]),
    **schema.rotation("Axes of the solid to the parent frame", default="parallel"),
}
_SOLIDS = {
    "box": Keys("box", "A box about its centre.", {"size": schema.vector("Edges.", "m", 3)}),
    "cylinder": Keys(
        "cylinder",
        "A cylinder along z about its centre.",
        {**_RADIUS, "length": schema.number("Length.", "m", bound="> 0")},
    ),
    "sphere": Keys("sphere", "A sphere about its centre.", _RADIUS),
    "mesh": Keys(
        "mesh",
        "The convex solids of a mesh.",
        {
            "file": schema.file("STL, OBJ or DAE, relative to this file."),
            "scale": schema.vector("Factors along x, y, z.", "", 3, default=[1, 1, 1]),
        },
    ),
}
_ENDLESS = {
    "floor": Keys("floor", "A horizontal half space.", {"height": schema.number("Height.", "m")}),
    "wall": Keys(
        "wall",
        "A half space.",
        {
            **_NAME,
            "normal": schema.direction("Direction into the wall, of any length."),
            "distance": schema.number("Distance of the plane from the origin, along the normal.", "m"),
        },
    ),
    "pillar": Keys(
        "pillar",
        "An endless cylinder.",
        {
            **_NAME,
            "point": schema.vector("A point on the axis.", "m", 3),
            **_RADIUS,
            "axis": schema.direction("Direction of the axis, of any length.", default=[0, 0, 1]),
        },
    ),
}
SHAPE = Keys(
    "solid",
    "A solid fixed to the base or to the gripper.",
    {"kind": schema.choice("The kind of solid.", _SOLIDS), **_POSE},
    by="kind",
    variants=_SOLIDS,
)
OBSTACLE = Keys(
    "obstacle",
    "A solid or a half space that the robot must not touch.",
    {"kind": schema.choice("The kind of obstacle.", (*_ENDLESS, *_SOLIDS))},
    by="kind",
    variants={
        **_ENDLESS,
        **{kind: replace(own, keys={**_POSE, **own.keys}) for kind, own in _SOLIDS.items()},
    },
)


def shape_key(meaning: str) -> Key:
    """The key `shape`, a table or tables in double brackets."""
    form = {"anyOf": [SHAPE.ref, {"type": "array", "items": SHAPE.ref}]}
    return replace(schema.tables(SHAPE, meaning), words="table or tables", schema=form)


SPHERES = {
    "sphere_radius": schema.per_joint(
        "Radius of spheres along the links, which may not collide; 0: none.",
        "m",
        bound=">= 0",
        otherwise="collision geometry of the URDF",
    ),
    "excluded_links": schema.anything(
        "Pairs of links that may touch, by name, or a link and `floor`.",
        "list of pairs",
        {"type": "array"},
        default=[],
    ),
}


def _mesh(table: Table) -> list[Shape]:
    file, scale = table["file"], table["scale"]
    table.close()
    with table.at("file"):
        return read_mesh(file, scale)


_READERS: dict[str, Callable[[Table], list[Shape]]] = {
    "box": lambda table: [table.make(Box, table["size"])],
    "cylinder": lambda table: [table.make(Cylinder, table["radius"], table["length"])],
    "sphere": lambda table: [table.make(Ball, table["radius"])],
    "mesh": _mesh,
}


def read_shape(table: Table) -> list[Shape]:
    """The solid of a table with its pose; a mesh may be several."""
    kind, position, rotation = table["kind"], table["position"], table.rotation(default=np.eye(3))
    return [shape.placed(rotation, position) for shape in _READERS[kind](table)]


def read_shapes(owner: Table, default: str, *, carried: bool = False) -> list[BodyShape]:
    """The solids of the table or tables `shape` of another one; several are called "... 1" and so on.

    Args:
        owner: such as `[base]`.
        default: name.
        carried: by the gripper.
    """
    single = isinstance(owner.value("shape"), dict)
    tables = [owner.table("shape")] if single else owner.tables("shape")
    results = []
    for number, table in enumerate(tables, 1):
        name = table.get("name", f"{default} {number}" if len(tables) > 1 else default)
        results += [BodyShape(name, 0, shape, carried) for shape in read_shape(table)]
    return results


def read_base_shapes(data: Table) -> list[BodyShape]:
    """The solids `[[base.shape]]` of a file."""
    base = data.table("base")
    if "spheres" in base:
        raise base.error(
            'is now a shape each: shape = [{ kind = "sphere", position = [x, y, z], radius = r }, ...]',
            "spheres",
        )
    return read_shapes(base, "base")


def read_obstacles(data: Table, key: str, *, numbered: bool = False, world: bool = False) -> list[Obstacle]:
    """The obstacles of tables in double brackets.

    Args:
        data: the file.
        key: of the tables.
        numbered: several without names are called "wall 1" and so on.
        world: in world axes, where floors are none of them.
    """
    tables = data.tables(key)
    obstacles: list[Obstacle] = []
    for number, table in enumerate(tables, 1):
        kind = table["kind"]
        name = f"{kind} {number}" if numbered and len(tables) > 1 else kind
        if kind == "floor" and world:
            hint = "give it as [[base_obstacle]], or a wall with its normal"
            raise table.error(f"a floor belongs to the base: {hint}", "kind")
        if kind == "floor":
            obstacles.append(table.make(floor, table["height"]))
        elif kind == "wall":
            normal, distance = table["normal"], table["distance"]
            obstacles.append(table.make(Wall, normal, distance, table.get("name", name)))
        elif kind == "pillar":
            pillar = table["point"], table["radius"], table["axis"]
            obstacles.append(table.make(Pillar, *pillar, table.get("name", name)))
        else:
            name = table.get("name", name)
            obstacles += [Solid(shape, name) for shape in read_shape(table)]
    return obstacles


def without_excluded(arm: ArmModel, table: Table) -> ArmModel:
    """The arm of solids without the pairs of `excluded_links`, which are names of links."""
    key = "excluded_links"
    excluded = table.value(key, [])
    if arm.geometry is None:
        if excluded and not arm.sphere_sets:
            raise table.error("there is nothing to exclude: neither collision geometry nor spheres", key)
        return arm
    known = list(dict.fromkeys(shape.name for shape in arm.geometry.shapes))
    for pair in excluded if isinstance(excluded, list) else [excluded]:
        named = isinstance(pair, list) and len(pair) == 2 and pair.count(FLOOR) < 2
        if not named or not all(name in (*known, FLOOR) for name in pair):
            expected = f"expected two of the links {', '.join(known)}, or one and {FLOOR!r}"
            raise table.error(f"{expected}, got {pair!r}", key)
    apart = {frozenset(pair): "excluded" for pair in excluded} | arm.geometry.apart
    return replace(arm, geometry=replace(arm.geometry, apart=apart))


def carrying(arm: ArmModel, shapes: Sequence[BodyShape]) -> ArmModel:
    """The arm with solids that its gripper holds, given in the axes of the gripper."""
    if not shapes:
        return arm
    geometry = arm.geometry or geometry_of_spheres(arm)
    tool = arm.tool_rotation, arm.offsets[-1]
    held = [replace(s, body=arm.links, shape=s.shape.placed(*tool)) for s in shapes]
    return replace(arm, geometry=replace(geometry, shapes=(*geometry.shapes, *held)))


def require_geometry(data: Table, arm: ArmModel, given: Mapping[str, Sequence], *, hint: str = "") -> None:
    """Refuse what only counts for an arm whose collisions can be checked.

    Args:
        data: the file.
        arm: its arm.
        given: tables by the place where they stand.
        hint: ends the message.

    Raises:
        InputError: the arm has neither collision geometry nor spheres, and one of them is there.
    """
    for place in (place for place, tables in given.items() if tables and not arm.may_collide):
        missing = "the arm has no collision geometry to check"
        raise data.error(f"{missing}; give arm.sphere_radius, or a URDF that has some{hint}", place)


def with_spheres(arm: ArmModel, table: Table, link_names: Sequence[str]) -> ArmModel:
    """The arm with spheres along its links, (n,) names; `excluded_links` may name links without spheres."""
    where, excluded = "excluded_links", table.value("excluded_links", [])
    radii = table.get("sphere_radius", size=arm.links)
    if radii is None:
        return arm
    lengths = np.linalg.norm(arm.offsets, axis=1)
    links = [int(i) + 1 for i in np.flatnonzero((radii > 0) & (lengths > 0))]
    with table.at(radius="sphere_radius"):
        sets = [
            replace(spheres, name=link_names[i - 1])
            for i in links
            for spheres in spheres_along_links(arm, radii[i - 1], links=[i])
        ]
    numbers = {known: spheres.link for spheres in sets for known in (spheres.link, spheres.name)}
    if not isinstance(excluded, list):
        raise table.error(f"expected pairs of links, got {excluded!r}", where)
    for pair in excluded:
        if not isinstance(pair, list) or len(pair) != 2 or not all(one in list(numbers) for one in pair):
            known = ", ".join(dict.fromkeys(spheres.name for spheres in sets))
            raise table.error(f"expected two of the links {known}, or their numbers, got {pair!r}", where)
    names = {spheres.link: spheres.name for spheres in sets}
    given = [(names[numbers[a]], names[numbers[b]]) for a, b in excluded]
    arm = arm.with_spheres(sets, excluded_pairs=given)
    return arm.with_spheres(sets, excluded_pairs=[*given, *never_part(arm)])
