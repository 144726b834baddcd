"""The tables `[arm]`, `[motors]` and `[[obstacle]]` of task files; for their keys see `task_file`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.basics.toml import (
    direction_at,
    number_at,
    per_joint_at,
    refuse_unknown,
    required,
    rpy_at,
    subtable,
    text_at,
    vector_at,
    with_place,
)
from ocptip.published.arms import load_arm, modular_motors
from ocptip.robots.geometry import Pillar, Wall, floor, spheres_along_links
from ocptip.robots.model import ArmModel
from ocptip.robots.motors import DCMotors, Motors
from ocptip.robots.urdf import arm_from_urdf
from ocptip.task_files.motors import MOTOR_KEYS, dc_motors

_URDF_KEYS = (
    "base_link",
    "tool_frame",
    "locked_deg",
    "locked_m",
    "armature",
    "sphere_radius",
    "excluded_links",
)
_ARM_LIMITS = {
    "angle_min_deg": ("angle_min", np.pi / 180),
    "angle_max_deg": ("angle_max", np.pi / 180),
    "speed_deg_s": ("speed", np.pi / 180),
    "acceleration_deg_s2": ("acceleration", np.pi / 180),
    "torque_Nm": ("torque", 1.0),
}
_OBSTACLE_KEYS = {
    "floor": ("height",),
    "wall": ("normal", "distance", "name"),
    "pillar": ("point", "radius", "axis", "name"),
}


def arm_from_table(table: dict[str, Any], folder: Path) -> ArmModel:
    """The arm of `[arm]`, in the base frame.

    Args:
        table: `[arm]`.
        folder: of the file.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    kinds = [key for key in ("name", "urdf") if key in table]
    if len(kinds) != 1:
        raise InputError(f"arm.urdf: expected either name or urdf, got {'both' if kinds else 'none'}")
    common = (*kinds, "mount_position", "mount_rpy_deg", "limits")
    if kinds == ["name"]:
        refuse_unknown(table, common, "arm.")
        arm = with_place("arm.name", load_arm, text_at("arm.name", table["name"]))
    else:
        refuse_unknown(table, (*common, *_URDF_KEYS), "arm.")
        arm = _arm_from_urdf(table, folder)
    if "limits" in table:
        arm = _with_limits(arm, subtable(table, "limits", prefix="arm."))
    position = vector_at("arm.mount_position", required(table, "mount_position", "arm"), 3)
    rotation = rpy_at("arm.mount_rpy_deg", table.get("mount_rpy_deg", [0, 0, 0]))
    return arm.mounted(position, rotation)


def _arm_from_urdf(table: dict[str, Any], folder: Path) -> ArmModel:
    file = folder / text_at("arm.urdf", table["urdf"])
    names = {key: text_at(f"arm.{key}", required(table, key, "arm")) for key in ("base_link", "tool_frame")}
    locked = {}
    for key, scale in (("locked_deg", np.pi / 180), ("locked_m", 1.0)):
        for joint, value in subtable(table, key, prefix="arm.", optional=True).items():
            locked[joint] = scale * number_at(f"arm.{key}.{joint}", value)
    try:
        arm = arm_from_urdf(file, **names, locked_joints=locked)
    except InputError as error:
        inner = str(error).split(":")[0].split("[")[0] in (*names, "locked_joints")
        message = str(error).replace("locked_joints", "locked_deg or locked_m")
        raise InputError(f"arm.{'' if inner else 'urdf: '}{message}") from None
    if "armature" in table:
        arm = replace(arm, armature=per_joint_at("arm.armature", table["armature"], arm.n, zero_allowed=True))
    return _with_spheres(arm, table)


def _with_spheres(arm: ArmModel, table: dict[str, Any]) -> ArmModel:
    """The arm with spheres along its links; `excluded_links` may name links without spheres."""
    where = "arm.excluded_links"
    excluded = table.get("excluded_links", [])
    if "sphere_radius" not in table:
        if excluded:
            raise InputError(f"{where}: without arm.sphere_radius there are no spheres to exclude")
        return arm
    radii = per_joint_at("arm.sphere_radius", table["sphere_radius"], arm.n, zero_allowed=True)
    lengths = np.linalg.norm(arm.offsets, axis=1)
    links = [i + 1 for i in np.flatnonzero((radii > 0) & (lengths > 0))]
    sets = [spheres for i in links for spheres in spheres_along_links(arm, radii[i - 1], links=[i])]
    names = {spheres.link: spheres.name for spheres in sets}
    if not isinstance(excluded, list):
        raise InputError(f"{where}: expected pairs of links, got {excluded!r}")
    pairs = []
    for pair in excluded:
        if not isinstance(pair, list) or len(pair) != 2 or not all(i in names for i in pair):
            raise InputError(f"{where}: expected two of the links {', '.join(map(str, names))}, got {pair!r}")
        pairs.append((names[pair[0]], names[pair[1]]))
    return arm.with_spheres(sets, excluded_pairs=pairs)


def _with_limits(arm: ArmModel, table: dict[str, Any]) -> ArmModel:
    refuse_unknown(table, _ARM_LIMITS, "arm.limits.")
    limits = {}
    for key, value in table.items():
        name, scale = _ARM_LIMITS[key]
        signed = name.startswith("angle")
        limits[name] = scale * per_joint_at(f"arm.limits.{key}", value, arm.n, signed=signed)
    try:
        return arm.with_limits(**limits)
    except InputError as error:
        raise InputError(f"arm.{error}") from None


def motors_from_tables(data: dict[str, Any], arm: ArmModel) -> Motors:
    """The motors of `[motors]`, which modular arms may leave out.

    Args:
        data: the file's tables.
        arm: of its `[arm]`.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    modular = "name" in data["arm"]
    if "motors" not in data and not modular:
        raise InputError(
            'motors: missing table [motors]; give kind = "dc" with motor data, or kind = "estimated"'
        )
    table = subtable(data, "motors", optional=modular)
    kind = table.get("kind", "modular" if modular else None)
    if kind not in MOTOR_KEYS:
        raise InputError(f"motors.kind: expected one of {', '.join(MOTOR_KEYS)}, got {kind!r}")
    refuse_unknown(table, MOTOR_KEYS[kind], "motors.", also=("kind",))
    if kind == "modular":
        if not modular:
            raise InputError("motors.kind: the power maps 'modular' are for the modular arms only")
        return modular_motors()
    if kind == "estimated":
        values = {key: number_at(f"motors.{key}", value) for key, value in table.items() if key != "kind"}
        return with_place("motors", DCMotors.estimated, arm, **values)
    return dc_motors(table, arm.n)


def obstacles_from_tables(tables: list[dict[str, Any]]) -> list[Wall | Pillar]:
    """The obstacles of `[[obstacle]]`; messages name `obstacle[1]` and so on.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    found: list[Wall | Pillar] = []
    for number, table in enumerate(tables, 1):
        where = f"obstacle[{number}]"
        kind = table.get("kind")
        if kind not in _OBSTACLE_KEYS:
            raise InputError(f"{where}.kind: expected one of {', '.join(_OBSTACLE_KEYS)}, got {kind!r}")
        refuse_unknown(table, _OBSTACLE_KEYS[kind], f"{where}.", also=("kind",))
        name = text_at(f"{where}.name", table.get("name", kind))
        if kind == "floor":
            found.append(floor(number_at(f"{where}.height", required(table, "height", where))))
        elif kind == "wall":
            normal = direction_at(f"{where}.normal", required(table, "normal", where))
            found.append(
                Wall(normal, number_at(f"{where}.distance", required(table, "distance", where)), name)
            )
        else:
            point = vector_at(f"{where}.point", required(table, "point", where), 3)
            radius = number_at(f"{where}.radius", required(table, "radius", where))
            axis = direction_at(f"{where}.axis", table.get("axis", [0, 0, 1]))
            found.append(Pillar(point, positive_number(f"{where}.radius", radius), axis, name))
    return found
