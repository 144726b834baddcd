"""The table `[arm]` of task files; format: docs/motion-planner.md, docs/collision.md."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import get_args

import numpy as np

from ocptip.basics import schema
from ocptip.basics.errors import too_light
from ocptip.basics.schema import ANY_FILE, REQUIRED, Keys
from ocptip.basics.text import did_you_mean
from ocptip.basics.toml import Table
from ocptip.numerics.inertia import ROUNDED, RigidBody, symmetric_matrix, union, why_impossible
from ocptip.published.arms import load_arm
from ocptip.robots.dh import Convention, DHRow, arm_from_dh
from ocptip.robots.model import FULL_SPEED, ArmModel
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.robots.urdf.collision import collision_meshes, geometry_from_urdf
from ocptip.robots.urdf.file import read_urdf
from ocptip.robots.urdf.joint_limits import named_states, with_joint_limits
from ocptip.robots.urdf.resting import resting_body
from ocptip.robots.urdf.sanity import doubt_speeds
from ocptip.task_files.tables.joints import (
    FOLLOWS,
    LOCKED,
    LOCKED_KEYS,
    followers_of,
    joint_values,
    ranges_of,
)
from ocptip.task_files.tables.shapes import SPHERES, with_spheres, without_excluded

_LIMITS = {  # key: limit, whether it is one of sliding joints, meaning, unit
    "angle_min_deg": ("angle_min", False, "Lower limit", "deg"),
    "angle_max_deg": ("angle_max", False, "Upper limit", "deg"),
    "speed_deg_s": ("speed", False, "Speed limit", "deg/s"),
    "acceleration_deg_s2": ("acceleration", False, "Acceleration limit", "deg/s^2"),
    "torque_Nm": ("torque", False, "Torque limit", "N m"),
    "position_min_m": ("angle_min", True, "Lower limit", "m"),
    "position_max_m": ("angle_max", True, "Upper limit", "m"),
    "speed_m_s": ("speed", True, "Speed limit", "m/s"),
    "acceleration_m_s2": ("acceleration", True, "Acceleration limit", "m/s^2"),
    "force_N": ("torque", True, "Force limit", "N"),
}
_MOST_PARTS = 64

_OF_ARM = "of the arm"
_USUAL = {"acceleration": f"full speed in {FULL_SPEED} s"}
ARM_LIMITS = Keys(
    "arm limits",
    "Limits of the joints, which replace those of the arm.",
    {
        key: schema.by_joint(
            f"{meaning} of {'sliding' if slides else 'turning'} joints.",
            unit,
            bound="" if limit.startswith("angle") else "> 0",
            otherwise=_USUAL.get(limit, _OF_ARM),
        )
        for key, (limit, slides, meaning, unit) in _LIMITS.items()
    },
)
_PART = Keys(
    "part of a link",
    "A part of a link; parts replace mass, centre and inertia of the link.",
    {
        "mass": schema.number("Mass.", "kg", bound="> 0"),
        "position": schema.vector(
            "Origin of the axes of the part: joint axis along z, origin on it.", "m", 3, default=[0, 0, 0]
        ),
        **schema.rotation("Axes of the part to those of the link", default="parallel to the link"),
        "center_of_mass": schema.vector("Centre of mass, axes of the part.", "m", 3, default=[0, 0, 0]),
        "inertia": schema.numbers(
            "Inertia about the centre of mass, axes of the part.", "kg m^2", otherwise="point mass"
        ),
    },
)
LINK = Keys(
    "link",
    "Values of the link behind a joint that replace those of the arm.",
    {
        "mass": schema.number("Mass.", "kg", bound="> 0", otherwise=_OF_ARM),
        "center_of_mass": schema.vector("Centre of mass, frame of the link.", "m", 3, otherwise=_OF_ARM),
        "inertia": schema.numbers("Inertia about the centre of mass.", "kg m^2", otherwise=_OF_ARM),
        "armature": schema.number(
            "Inertia of the rotor, as the joint feels it; sliding joints: kg.",
            "kg m^2",
            bound=">= 0",
            otherwise=_OF_ARM,
        ),
        "part": schema.tables(_PART),
        "added": schema.tables(_PART, "Parts besides the link, such as cables and tools."),
    },
)
_SPRING = Keys(
    "spring",
    "A spring beside the drive: `torque - stiffness * value` of the joint, on the link behind it.",
    {
        "torque": schema.number("Torque at value 0; sliding joints: force, N.", "N m", default=0.0),
        "stiffness": schema.number("Stiffness; sliding joints: N/m.", "N m/rad", bound=">= 0", default=0.0),
    },
)
_JOINT = Keys(
    "joint of a table",
    "A row of Denavit-Hartenberg parameters and the link behind the joint.",
    {
        "name": schema.text("Name.", otherwise="joint and its number"),
        "a": schema.number("Length of the link.", "m", otherwise="0"),
        "d": schema.number("Offset of the link.", "m", otherwise="0"),
        "alpha_deg": schema.number("Twist of the link.", "deg", default=0.0),
        "theta_deg": schema.number("Angle at coordinate zero.", "deg", default=0.0),
        "slides": schema.flag("The joint changes d.", default=False),
        "mass": schema.number("Mass of the link.", "kg", bound=">= 0", otherwise="the mass of its parts"),
        "center_of_mass": schema.vector("Centre of mass of the link in frame i.", "m", 3, default=[0, 0, 0]),
        "inertia": schema.numbers("Inertia about the centre of mass, frame i.", "kg m^2", otherwise="0"),
        "armature": schema.number(
            "Inertia of the rotor, as the joint feels it; sliding joints: kg.",
            "kg m^2",
            bound=">= 0",
            default=0.0,
        ),
    },
)


_ACCEPT_INERTIA = schema.anything(
    "Links that may move without mass, or with an inertia that no body has.",
    "true, or list of links",
    {"anyOf": [{"type": "boolean"}, {"type": "array", "items": {"type": "string"}}]},
    default=False,
)
MOUNT = {
    "mount_position": schema.vector("Origin of the base to that of the robot, base axes.", "m", 3),
    **schema.rotation("Axes of the robot to those of the base", "mount_", default="parallel to the base"),
}
ARM = Keys(
    "arm",
    "The arm: a URDF, a table of joints, or an arm of the modular kit.",
    {
        **MOUNT,
        "limits": schema.table(ARM_LIMITS, default=None),
        "links": schema.table(
            Keys("links", "Masses of links by the joint before them.", others=schema.table(LINK)),
            default=None,
        ),
        "springs": schema.table(
            Keys("springs", "Springs that counterbalance joints, by joint.", others=schema.table(_SPRING)),
            default=None,
        ),
    },
    one_of=[("name", "urdf", "dh")],
    by=("name", "urdf", "dh"),
    variants={
        "name": Keys(
            "modular arm",
            "An arm of the modular kit.",
            {"name": schema.text("Sequence of four connections out of F, S, P1, P2, W1, W2.")},
        ),
        "urdf": Keys(
            "arm of a URDF",
            "An arm of a URDF.",
            {
                "urdf": schema.file("URDF, relative to this file."),
                "base_link": schema.text("Link that rests.", otherwise="the root"),
                "tool_frame": schema.text(
                    "Link whose origin is the TCP.", otherwise="`tool0`, or the only end"
                ),
                **LOCKED_KEYS,
                "follows": FOLLOWS,
                "accept_inertia": _ACCEPT_INERTIA,
                "armature": schema.per_joint(
                    "Inertia of rotors, as their joints feel it; sliding joints: kg.",
                    "kg m^2",
                    bound=">= 0",
                    otherwise="of the URDF",
                ),
                "collision": schema.flag("The collision geometry of the URDF is read.", default=True),
                "package_dirs": schema.folders("Folders with packages, for `package://` names."),
                "srdf": schema.file(
                    "SRDF: pairs that may touch (`disable_collisions`), states by name.", otherwise="none"
                ),
                "joint_limits": schema.file(
                    "`joint_limits.yaml` of MoveIt, whose limits replace those of the URDF.", otherwise="none"
                ),
                "mesh_parts": schema.whole(
                    "Number of convex solids for each mesh that is not convex.",
                    least=1,
                    most=_MOST_PARTS,
                    otherwise="its convex hull",
                ),
                **SPHERES,
            },
        ),
        "dh": Keys(
            "arm of a table",
            "An arm of Denavit-Hartenberg parameters.",
            {
                "dh": schema.choice(
                    "Standard: frame i at the end of link i; modified: frame i on axis i.",
                    get_args(Convention),
                ),
                "joint": schema.tables(_JOINT, required=True),
                "accept_inertia": _ACCEPT_INERTIA,
                **SPHERES,
            },
        ),
    },
)
_WITH_ARM = replace(ANY_FILE, keys={"arm": schema.table(ARM)})


def arm_of_file(path: str | os.PathLike[str]) -> ArmModel:
    """The arm of the table `[arm]` of a TOML file, wherever it is mounted.

    Raises:
        InputError: there is none, or it cannot be used.
    """
    with Table.read(Path(path), _WITH_ARM) as data:
        data.close(early=True)
        return replace(read_arm(data.table("arm"), alone=True), name=Path(path).stem)


def read_arm(table: Table, gripper: Table | None = None, *, alone: bool = False) -> ArmModel:
    """The arm of `[arm]`, in the base frame.

    Args:
        table: `[arm]`.
        gripper: a further table with locked joints, which win over those of `[arm]`.
        alone: it need not say where it is mounted, and a table of joints no masses.
    """
    kind = table.one_of("name")
    position = table.get("mount_position", np.zeros(3)) if alone else table["mount_position"]
    rotation = table.rotation("mount_", np.eye(3))
    if kind == "urdf":
        arm = _arm_from_urdf(table, gripper)
    elif kind == "dh":
        arm = _arm_from_dh(table, alone)
    else:
        name = table["name"]
        table.close(early=True)
        if gripper is not None and (given := [key for key in LOCKED if key in gripper]):
            raise gripper.error("only joints of a URDF can be locked", given[0])
        with table.at(arm="name"):
            arm = load_arm(name)
    arm = _with_springs(_with_links(arm, table.table("links")), table.table("springs"))
    with table.at():
        return _with_limits(arm, table.table("limits")).mounted(position, rotation)


def require_base_mass(data: Table, arm: ArmModel, mass: float, *, accepted: bool) -> None:
    """Refuse a base that is lighter than those links of the arm's file that are part of it.

    Args:
        data: the file.
        arm: its arm.
        mass: kg, of the base.
        accepted: `accept_mass` of `[base]` says that this is meant.

    Raises:
        InputError: it is lighter, and that is not accepted.
    """
    if not accepted and (reason := too_light(mass, arm.base_mass)):
        table = data.table("arm")  # of a URDF: no other kind has such links
        links, centre, inertia = resting_body(table["urdf"], arm)
        turn = table.rotation("mount_", np.eye(3))
        centre, inertia = table["mount_position"] + turn @ centre, turn @ inertia @ turn.T
        lists = (centre, inertia[np.triu_indices(3)])
        middle, moments = (f"[{', '.join(f'{value:.5g}' for value in values)}]" for values in lists)
        alone = f"mass = {links:.6g}, center_of_mass = {middle}, inertia = {moments}"
        raise data.error(f"{reason}, or accept_mass = true; these links alone have {alone}", "base.mass")


def _joint(table: Table, name: str, names: Sequence[str], key: str = "") -> int:
    """The number of the joint that a table names, by a key or as a value of the key `key`."""
    if name not in names:
        known = f"{', '.join(names)}{did_you_mean(name, names)}"
        raise table.error(f"no joint {name!r}; there are {known}", key or name)
    return names.index(name)


def _with_links(arm: ArmModel, table: Table) -> ArmModel:
    """The arm with masses, centres and inertias replaced by those of `[arm.links."JOINT"]`."""
    masses, centres, inertias = arm.masses.copy(), arm.centres.copy(), arm.inertias.copy()
    armature = np.array(arm.armature)
    for name in table:
        k, link = _joint(table, name, arm.chain_names), table.table(name)
        if parts := link.tables("part"):
            for key in (key for key in ("mass", "center_of_mass", "inertia") if key in link):
                raise link.error("follows from the parts; give either", key)
            masses[k], centres[k], inertias[k] = reduce(union, map(_part, parts))
        masses[k] = link.get("mass", masses[k])
        centres[k] = link.get("center_of_mass", centres[k])
        if "inertia" in link:
            inertia = link["inertia"]
            with link.at("inertia"):
                inertias[k] = symmetric_matrix(inertia)
        masses[k], centres[k], inertias[k] = reduce(
            union, map(_part, link.tables("added")), (masses[k], centres[k], inertias[k])
        )
        if arm.coupling is None:
            armature[k] = link.get("armature", armature[k])
        link.close()
    table.close()
    return replace(arm, masses=masses, centres=centres, inertias=inertias, armature=armature)


def _with_springs(arm: ArmModel, table: Table) -> ArmModel:
    """The arm with the springs of `[arm.springs."JOINT"]`."""
    torque, stiffness = arm.spring_torque.copy(), arm.spring_stiffness.copy()
    for name in table:
        j, spring = _joint(table, name, arm.joint_names), table.table(name)
        torque[j], stiffness[j] = spring["torque"], spring["stiffness"]
        spring.close()
    table.close()
    return replace(arm, spring_torque=torque, spring_stiffness=stiffness)


def _part(table: Table) -> RigidBody:
    """A part of a link, in the link's frame: its mass, and the rest in the axes of the part at `position`."""
    mass, position = table["mass"], table["position"]
    turn, centre = table.rotation("", np.eye(3)), table["center_of_mass"]
    inertia = table.make(symmetric_matrix, table.get("inertia", np.zeros(3)))
    if reason := why_impossible(inertia, ROUNDED * np.abs(inertia).max()):
        raise table.error(reason, "inertia")
    table.close()
    return mass, position + turn @ centre, turn @ inertia @ turn.T


def _with_limits(arm: ArmModel, table: Table) -> ArmModel:
    """The arm with the limits of `[arm.limits]`, and with accelerations where nobody gives any."""
    values: dict[str, np.ndarray] = {}
    for key, (name, slides, _, _) in _LIMITS.items():
        given = joint_values(table, key, arm, slides=slides)
        if given is not None:
            values.setdefault(name, getattr(arm.limits, name).copy())
            indices = np.flatnonzero(arm.prismatic == slides)[np.isfinite(given)]
            values[name][indices] = given[np.isfinite(given)]
    table.close()
    arm = arm.with_limits(**values).with_usual_accelerations("the file")
    doubt_speeds(arm)
    return arm


def _arm_from_urdf(table: Table, gripper: Table | None) -> ArmModel:
    with table.at("urdf"):
        file = read_urdf(table["urdf"])
    names = {key: table[key] for key in ("base_link", "tool_frame")}
    locked = {}
    for source in (table, gripper) if gripper is not None else (table,):
        for key, slides in LOCKED.items():
            joints = source.table(key)
            wanted = {joint: joints[joint] for joint in joints}
            if wanted:
                with source.at(key):
                    locked |= file.locked(wanted, slides=slides)
    follows = followers_of(table, file)
    accepted, ranges = _accepted_links(table), ranges_of(table, file, locked)
    geometry, folders = table["collision"], table["package_dirs"]
    srdf, parts, further = table["srdf"], table["mesh_parts"], table["joint_limits"]
    table.close(early=True)
    with table.at("urdf", base_link="base_link", tool_frame="tool_frame"):
        given = {"locked_joints": locked, "joint_ranges": ranges, "accept_inertia": accepted}
        given["follows"] = follows
        arm = arm_from_urdf(file.path, **names, **given)
    with table.at("joint_limits"):
        arm = arm if further is None else with_joint_limits(arm, further)
    with table.at("srdf"):
        arm = replace(arm, states={} if srdf is None else named_states(srdf))
    armature = table.get("armature", arm.armature, size=arm.n)
    links = [file.joints[name].child for name in arm.chain_names]
    arm = with_spheres(replace(arm, armature=armature), table, links)
    if geometry and not arm.sphere_sets:
        with table.at("urdf", package_dirs="package_dirs", srdf="srdf"):
            given = {"package_dirs": folders, "srdf": srdf, "mesh_parts": parts}
            arm_geometry = geometry_from_urdf(file.path, arm, **given)
            meshes = collision_meshes(file.path, folders) or {}
            table.note_parts(file.path, {name: mesh for name, mesh in meshes.items() if mesh})
        arm = replace(arm, geometry=arm_geometry)
    return without_excluded(arm, table)


def _arm_from_dh(table: Table, alone: bool) -> ArmModel:
    """The arm of the rows `[[arm.joint]]`."""
    convention = table["dh"]
    rows, names, links = [], [], table.value("links", {})  # as tables they are read by `_with_links`
    accepted = _accepted_links(table)
    for number, joint in enumerate(table.tables("joint"), 1):
        names.append(joint.get("name", f"joint {number}"))
        values = joint.given("a", "d")
        values |= {key: joint[f"{key}_deg"] for key in ("alpha", "theta")}
        link = links.get(names[-1]) if isinstance(links, dict) else None
        free = alone or (isinstance(link, dict) and "part" in link)
        free = free or accepted is True or (isinstance(accepted, list) and names[-1] in accepted)
        mass = joint.get("mass", 0.0 if free else REQUIRED)
        if not (free or mass):
            raise joint.error(
                f'must be > 0, got 0; if that is meant: accept_inertia = ["{names[-1]}"]', "mass"
            )
        values |= {"mass": mass, "armature": joint["armature"]}
        values["center_of_mass"] = joint["center_of_mass"]
        inertia, slides = joint.get("inertia", np.zeros(3)), joint["slides"]
        inertia = joint.make(symmetric_matrix, inertia)
        rows.append(DHRow(**values, inertia=inertia, slides=slides))
    table.close(early=True)
    for name in [] if isinstance(accepted, bool) else accepted:
        _joint(table, name, names, "accept_inertia")
    with table.at():
        arm = arm_from_dh("arm", rows, convention, names)
    return with_spheres(arm, table, names)


def _accepted_links(table: Table) -> bool | list[str]:
    key = "accept_inertia"
    value = table.value(key, False)
    if isinstance(value, bool) or (isinstance(value, list) and all(isinstance(item, str) for item in value)):
        return value
    raise table.error(f"expected true or a list of links, got {value!r}", key)
