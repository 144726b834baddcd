"""The table `[arm]` of task files; format: docs/motion-planner.md, docs/collision.md."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import get_args

import numpy as np

from ocptip.basics.text import did_you_mean
from ocptip.basics.toml import DEGREES, Table
from ocptip.numerics.inertia import ROUNDED, RigidBody, symmetric_matrix, union, why_impossible
from ocptip.published.arms import load_arm
from ocptip.robots.collision.model import geometry_of_spheres
from ocptip.robots.collision.shapes import BodyShape
from ocptip.robots.collision.urdf import collision_meshes, geometry_from_urdf
from ocptip.robots.dh import Convention, DHRow, arm_from_dh
from ocptip.robots.geometry import FLOOR, never_part, spheres_along_links
from ocptip.robots.model import ArmModel
from ocptip.robots.urdf import arm_from_urdf
from ocptip.robots.urdf_file import UrdfFile, read_urdf
from ocptip.task_files.joint_values import joint_values

_LIMITS = {  # key: limit, whether it is one of sliding joints, scale
    "angle_min_deg": ("angle_min", False, DEGREES),
    "angle_max_deg": ("angle_max", False, DEGREES),
    "speed_deg_s": ("speed", False, DEGREES),
    "acceleration_deg_s2": ("acceleration", False, DEGREES),
    "torque_Nm": ("torque", False, 1.0),
    "position_min_m": ("angle_min", True, 1.0),
    "position_max_m": ("angle_max", True, 1.0),
    "speed_m_s": ("speed", True, 1.0),
    "acceleration_m_s2": ("acceleration", True, 1.0),
    "force_N": ("torque", True, 1.0),
}
LOCKED = {"locked_deg": (False, DEGREES), "locked_m": (True, 1.0)}  # key: of sliding joints, scale
_MOST_PARTS = 64


def arm_of_file(path: str | os.PathLike[str]) -> ArmModel:
    """The arm of the table `[arm]` of a TOML file, wherever it is mounted.

    Raises:
        InputError: there is none, or it cannot be used.
    """
    with Table.read(Path(path)) as data:
        data.close(*data)  # a task file has other tables
        return replace(read_arm(data.table("arm"), alone=True), name=Path(path).stem)


def read_arm(table: Table, gripper: Table | None = None, *, alone: bool = False) -> ArmModel:
    """The arm of `[arm]`, in the base frame.

    Args:
        table: `[arm]`.
        gripper: a further table with locked joints, which win over those of `[arm]`.
        alone: it need not say where it is mounted, and a table of joints no masses.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    kind = table.one_of("name", "urdf", "dh")
    position = table.vector("mount_position", 3, *([np.zeros(3)] if alone else []))
    rotation = table.rotation("mount_", np.eye(3))
    if kind == "urdf":
        arm = _arm_from_urdf(table, gripper)
    elif kind == "dh":
        arm = _arm_from_dh(table, alone)
    else:
        name = table.text("name")
        table.close("limits", "links")
        for key in (key for key in LOCKED if gripper is not None and key in gripper):
            raise gripper.error("only joints of a URDF can be locked", key)
        with table.at(arm="name"):
            arm = load_arm(name)
    arm = _with_links(arm, table.table("links", optional=True))
    with table.at():
        return _with_limits(arm, table.table("limits", optional=True)).mounted(position, rotation)


def _with_links(arm: ArmModel, table: Table) -> ArmModel:
    """The arm with masses, centres and inertias of `[arm.links."JOINT"]` instead of its own."""
    masses, centres, inertias = arm.masses.copy(), arm.centres.copy(), arm.inertias.copy()
    armature = np.array(arm.armature)
    for name in table:
        if name not in arm.chain_names:
            known = ", ".join(arm.chain_names)
            raise table.error(
                f"no joint {name!r}; there are {known}{did_you_mean(name, arm.chain_names)}", name
            )
        k, own = arm.chain_names.index(name), table.table(name)
        if parts := own.tables("part"):
            for key in (key for key in ("mass", "center_of_mass", "inertia") if key in own):
                raise own.error("follows from the parts; give either", key)
            masses[k], centres[k], inertias[k] = reduce(union, map(_part, parts))
        masses[k] = own.number("mass", masses[k], bound="> 0")
        centres[k] = own.vector("center_of_mass", 3, centres[k])
        if "inertia" in own:
            inertia = own.raw_numbers("inertia")
            with own.at("inertia"):
                inertias[k] = symmetric_matrix(inertia)
        if arm.coupling is None:
            armature[k] = own.number("armature", armature[k], bound=">= 0")
        own.close()
    table.close()
    return replace(arm, masses=masses, centres=centres, inertias=inertias, armature=armature)


def _part(table: Table) -> RigidBody:
    """A part of a link, in the link's frame: its mass, and the rest in axes of its own at `position`."""
    mass, position = table.number("mass", bound="> 0"), table.vector("position", 3, np.zeros(3))
    turn, centre = table.rotation("", np.eye(3)), table.vector("center_of_mass", 3, np.zeros(3))
    inertia = table.make(symmetric_matrix, table.raw_numbers("inertia", np.zeros(3)))
    if reason := why_impossible(inertia, ROUNDED * np.abs(inertia).max()):
        raise table.error(reason, "inertia")
    table.close()
    return mass, position + turn @ centre, turn @ inertia @ turn.T


def _with_limits(arm: ArmModel, table: Table) -> ArmModel:
    """The arm with the limits of `[arm.limits]`, and with accelerations where nobody gives any."""
    values: dict[str, np.ndarray] = {}
    for key, (name, slides, scale) in _LIMITS.items():
        bound = "" if name.startswith("angle") else "> 0"
        given = joint_values(table, key, arm, slides=slides, scale=scale, bound=bound)
        if given is not None:
            values.setdefault(name, getattr(arm.limits, name).copy())
            own = np.flatnonzero(arm.prismatic == slides)[np.isfinite(given)]
            values[name][own] = given[np.isfinite(given)]
    table.close()
    return arm.with_limits(**values).with_usual_accelerations("the file")


def _arm_from_urdf(table: Table, gripper: Table | None) -> ArmModel:
    with table.at("urdf"):
        file = read_urdf(table.path_of("urdf"))
    names = {key: table.text(key, None) for key in ("base_link", "tool_frame")}
    locked = {}
    for source in (table, gripper) if gripper is not None else (table,):
        for key, (slides, scale) in LOCKED.items():
            joints = source.table(key, optional=True)
            wanted = {joint: joints.number(joint, scale=scale) for joint in joints}
            if wanted:
                with source.at(key):
                    locked |= file.locked(wanted, slides=slides)
    accepted, ranges = _accepted_links(table), _ranges(table, file, locked)
    geometry = table.flag("collision", True)
    folders, srdf = table.folders("package_dirs"), table.path_of("srdf", None)
    parts = table.whole("mesh_parts", least=1, most=_MOST_PARTS) if "mesh_parts" in table else None
    table.close("armature", "sphere_radius", "excluded_links", "limits", "links")
    with table.at("urdf", base_link="base_link", tool_frame="tool_frame"):
        given = {"locked_joints": locked, "joint_ranges": ranges, "accept_inertia": accepted}
        arm = arm_from_urdf(file.path, **names, **given)
    armature = table.per_joint("armature", arm.n, arm.armature, bound=">= 0")
    links = [file.joints[name].child for name in arm.chain_names]
    arm = _with_spheres(replace(arm, armature=armature), table, links)
    if geometry and not arm.sphere_sets:
        with table.at("urdf", package_dirs="package_dirs", srdf="srdf"):
            given = {"package_dirs": folders, "srdf": srdf, "mesh_parts": parts}
            found = geometry_from_urdf(file.path, arm, **given)
            meshes = collision_meshes(file.path, folders) or {}
            table.note_parts(file.path, {name: mesh for name, mesh in meshes.items() if mesh})
        arm = replace(arm, geometry=found)
    return _without_excluded(arm, table)


def _ranges(table: Table, file: UrdfFile, locked: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Both limits, rad and m, of joints that `[arm.limits]` names; they free a joint that the URDF holds."""
    limits, found = table.value("limits", {}), dict[str, tuple[float, float]]()  # read by `_with_limits`
    for keys in (("angle_min_deg", "angle_max_deg"), ("position_min_m", "position_max_m")):
        ends = [limits.get(key) for key in keys] if isinstance(limits, dict) else []
        if not all(isinstance(end, dict) for end in ends):
            continue
        for name in set(file.joints).intersection(*ends) - set(locked):
            values = [end[name] for end in ends]
            if all(isinstance(value, int | float) for value in values):
                if not values[0] < values[1]:
                    text = f"{keys[0]} {values[0]:g} must be below {keys[1]} {values[1]:g}"
                    raise table.error(f"{name}: {text}", "limits")
                scale = _LIMITS[keys[0]][2]
                found[name] = scale * values[0], scale * values[1]
    return found


def _arm_from_dh(table: Table, alone: bool) -> ArmModel:
    """The arm of the rows `[[arm.joint]]`."""
    convention = table.choice("dh", get_args(Convention))
    rows, names, links = [], [], table.value("links", {})  # as tables they are read by `_with_links`
    accepted = _accepted_links(table)
    for number, joint in enumerate(table.tables("joint", required=True), 1):
        names.append(joint.text("name", f"joint {number}"))
        values = joint.numbers("a", "d")
        values |= {key: joint.number(f"{key}_deg", 0.0, scale=DEGREES) for key in ("alpha", "theta")}
        link = links.get(names[-1]) if isinstance(links, dict) else None
        free = alone or (isinstance(link, dict) and "part" in link)
        free = free or accepted is True or (isinstance(accepted, list) and names[-1] in accepted)
        mass = joint.number("mass", *([0.0] if free else []), bound=">= 0")
        if not (free or mass):
            raise joint.error(
                f'must be > 0, got 0; if that is meant: accept_inertia = ["{names[-1]}"]', "mass"
            )
        values |= {"mass": mass, "armature": joint.number("armature", 0.0, bound=">= 0")}
        values["center_of_mass"] = joint.vector("center_of_mass", 3, np.zeros(3))
        inertia, slides = joint.raw_numbers("inertia", np.zeros(3)), joint.flag("slides", False)
        inertia = joint.make(symmetric_matrix, inertia)
        rows.append(DHRow(**values, inertia=inertia, slides=slides))
    table.close("sphere_radius", "excluded_links", "limits", "links")
    for name in [] if isinstance(accepted, bool) else accepted:
        if name not in names:
            raise table.error(
                f"no joint {name!r}; there are {', '.join(names)}{did_you_mean(name, names)}",
                "accept_inertia",
            )
    with table.at():
        arm = arm_from_dh("arm", rows, convention, names)
    return _with_spheres(arm, table, names)


def _accepted_links(table: Table) -> bool | list[str]:
    key = "accept_inertia"
    value = table.value(key, False)
    if isinstance(value, bool) or (isinstance(value, list) and all(isinstance(item, str) for item in value)):
        return value
    raise table.error(f"expected true or a list of links, got {value!r}", key)


def _without_excluded(arm: ArmModel, table: Table) -> ArmModel:
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
    own = arm.geometry or geometry_of_spheres(arm)
    tool = arm.tool_rotation, arm.offsets[-1]
    held = [replace(s, body=arm.links, shape=s.shape.placed(*tool)) for s in shapes]
    return replace(arm, geometry=replace(own, shapes=(*own.shapes, *held)))


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


def _with_spheres(arm: ArmModel, table: Table, link_names: Sequence[str]) -> ArmModel:
    """The arm with spheres along its links, (n,) names; `excluded_links` may name links without spheres."""
    where, excluded = "excluded_links", table.value("excluded_links", [])
    radii = table.per_joint("sphere_radius", arm.links, None, bound=">= 0")
    if radii is None:
        return arm
    lengths = np.linalg.norm(arm.offsets, axis=1)
    links = [i + 1 for i in np.flatnonzero((radii > 0) & (lengths > 0))]
    with table.at(radius="sphere_radius"):
        sets = [
            replace(spheres, name=link_names[i - 1])
            for i in links
            for spheres in spheres_along_links(arm, radii[i - 1], links=[i])
        ]
    names = {spheres.link: spheres.name for spheres in sets}
    if not isinstance(excluded, list):
        raise table.error(f"expected pairs of links, got {excluded!r}", where)
    for pair in excluded:
        if not isinstance(pair, list) or len(pair) != 2 or not all(i in list(names) for i in pair):
            raise table.error(f"expected two of the links {', '.join(map(str, names))}, got {pair!r}", where)
    given = [(names[a], names[b]) for a, b in excluded]
    arm = arm.with_spheres(sets, excluded_pairs=given)
    return arm.with_spheres(sets, excluded_pairs=[*given, *never_part(arm)])
