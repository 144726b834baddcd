"""Placement tasks from TOML files: where should any arm on any support stand?

A placement file is a scene file (docs/scenes.md: `gravity`, `[base]`, `[[contact]]`; the base without the
arm, base axes) with the tables `[arm]` and `[motors]` of a motion task (see `ocptip.task_files.motion`) and
these. SI units; keys in degrees say so. World axes have z up; everything in the world is so marked.

    name = "..."            optional, default: the file's name
    unloaded = true         optional: all constraints hold without the process loads, too

    [base]                  further keys, both optional
    spheres                 list of [x, y, z, radius], m, base axes: what of the base must not touch
                            obstacles; default: the contacts as points
    ground                  [x, y, z], m, base axes: the point that is put on the ground; default: on the
                            base's z axis in the plane of the contacts

    [[base_obstacle]]       optional: floor, wall or pillar in base axes (a deck, the ground under the wheels)
    [[obstacle]]            optional: wall or pillar in the world, for the arm and for the base
    [[keep_out]]            optional: wall or pillar in the world, for the base only

    [[terrain]]             planes the base can stand on, default: the horizontal floor
    slope                   [along x, along y] of z = height + slope . (X, Y), default 0; or
    incline_deg, uphill_deg inclination, and direction of the steepest way up, from the world's x axis
    height                  m, at the world's origin
    x, y                    [from, to], m, world: bounds of the ground point; default: none
    angle_deg               [from, to]: bounds of the angle about the normal
    contacts_inside         true: the bounds hold for every contact
    name

    [[task]]                one placement serves all tasks
    position                m, gripper point in the world
    rpy_deg or rotation     gripper to world axes: roll, pitch, yaw about the fixed world axes, or 3 x 3;
                            default: the world's axes
    orientation             "full", "axis" (only the direction of tool_axis counts) or "free"
    tool_axis               gripper axes, any length, default [0, 0, 1]
    name
    [[task.load]]           process loads on the gripper, one at a time; none: the arm only holds itself
    force, moment           N, N m, world axes; or
    magnitude, directions   N, and how many directions, spread over a cone about
    axis, half_angle_deg    world axes; default: all directions
    name                    (not with magnitude)

    [weights]               GN, GT, GK, GE; those not named are 0; without the table all are the same
    [references]            values by which criteria are divided, see `PlacementProblem`
    [limits]                GN, GT (false: no limit, but no contact is lost), torque_ratio, clearance (m),
                            base_clearance (m), condition, singular_ratio, jacobian_length (m),
                            index, index_min, tool_radius (m) (see `PlacementLimits`), reference_moment (N m);
                            all optional
    [energy]                kind = "holding" (default: power of the motors at rest, W) or "torque" with cost,
                            per N m and joint
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, finite_array, is_whole
from ocptip.basics.toml import (
    direction_at,
    number_at,
    per_joint_at,
    read_toml,
    refuse_non_numbers,
    refuse_unknown,
    required,
    rotation_in,
    subtable,
    subtables,
    text_at,
    vector_at,
    with_place,
)
from ocptip.placement.power import TorqueCost
from ocptip.placement.problem import (
    CRITERIA,
    GripperTask,
    PlacementLimits,
    PlacementProblem,
    ProcessLoad,
    Weights,
    sampled_loads,
)
from ocptip.placement.terrain import Patch, plane
from ocptip.robots.geometry import Pillar, Wall
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import StandingRobot
from ocptip.task_files.arm import arm_from_table, motors_from_tables, obstacles_from_tables
from ocptip.task_files.scene import scene_from_dict

_SCENE = ("gravity", "base", "contact")
_TABLES = (
    "name",
    "unloaded",
    *_SCENE,
    "arm",
    "motors",
    "base_obstacle",
    "obstacle",
    "keep_out",
    "terrain",
    "task",
    "weights",
    "references",
    "limits",
    "energy",
)
_BASE_KEYS = ("spheres", "ground")
_TERRAIN_KEYS = (
    "name",
    "slope",
    "incline_deg",
    "uphill_deg",
    "height",
    "x",
    "y",
    "angle_deg",
    "contacts_inside",
)
_TASK_KEYS = ("name", "position", "rpy_deg", "rotation", "orientation", "tool_axis", "load")
_LOAD_KEYS = ("name", "force", "moment")
_SAMPLE_KEYS = ("magnitude", "directions", "axis", "half_angle_deg")
_STEEPEST = 80.0  # degrees


@dataclass(frozen=True, eq=False)
class PlacementTask:
    """A placement file.

    Attributes:
        name: for titles and files.
        problem: what it asks for.
    """

    name: str
    problem: PlacementProblem


def load_placement(path: str | os.PathLike[str]) -> PlacementTask:
    """Read a placement file, see the module for its format.

    Raises:
        InputError: the file cannot be read or describes no placement problem; one line that names file and
            key. List entries are counted from 1.
    """
    path = Path(path)
    data = read_toml(path)
    try:
        return _placement(data, path)
    except InputError as error:
        message = str(error).removeprefix(f"{path.name}: ")
        raise InputError(f"{path.name}: {message}") from None


def _placement(data: dict[str, Any], path: Path) -> PlacementTask:
    refuse_unknown(data, _TABLES, "")
    base = dict(subtable(data, "base"))
    own = {key: base.pop(key) for key in _BASE_KEYS if key in base}
    support = scene_from_dict(
        {**{key: data[key] for key in _SCENE if key in data}, "base": base}, name=path.name
    ).support
    if support.dimension != 3:
        raise InputError("contact[1].position: an arm needs a spatial support; give three numbers")
    arm = arm_from_table(subtable(data, "arm"), path.parent)
    limits, moment = _limits(subtable(data, "limits", optional=True))
    robot = StandingRobot(
        arm,
        support,
        motors_from_tables(data, arm),
        obstacles=_shapes(data, "base_obstacle", arm),
        reference_moment=moment,
    )
    options: dict[str, Any] = {}
    if "spheres" in own:
        refuse_non_numbers("base.spheres", own["spheres"])
        options["base_spheres"] = finite_array("base.spheres", own["spheres"], (None, 4))
    if "ground" in own:
        options["ground_frame"] = (vector_at("base.ground", own["ground"], 3), np.eye(3))
    tasks = [_task(table, f"task[{k}]", f"task {k}") for k, table in enumerate(subtables(data, "task"), 1)]
    if not tasks:
        raise InputError("task: a placement needs at least one [[task]]")
    problem = PlacementProblem(
        robot,
        tasks,
        _terrain(data),
        weights=_weights(data),
        limits=limits,
        obstacles=_shapes(data, "obstacle", arm, world=True),
        keep_out=_shapes(data, "keep_out", arm, world=True, base_only=True),
        unloaded=_flag("unloaded", data.get("unloaded", True)),
        energy=_energy(subtable(data, "energy", optional=True), arm),
        references=_numbers(subtable(data, "references", optional=True), "references", CRITERIA),
        **options,
    )
    return PlacementTask(text_at("name", data.get("name", path.stem)), problem)


def _shapes(
    data: dict[str, Any], key: str, arm: ArmModel, *, world: bool = False, base_only: bool = False
) -> list[Wall | Pillar]:
    """Obstacles of one kind; messages name `key`."""
    tables = subtables(data, key)
    if tables and not arm.sphere_sets and not base_only:
        hint = "; obstacles for the base alone are [[keep_out]]" if world else ""
        raise InputError(f"{key}: the arm has no collision spheres to check; give arm.sphere_radius{hint}")
    found: list[Wall | Pillar] = []
    for number, table in enumerate(tables, 1):
        kind = table.get("kind")
        if world and kind == "floor":
            raise InputError(
                f"{key}[{number}].kind: a floor belongs to the base: give it as [[base_obstacle]], or a "
                "wall with its normal"
            )
        if len(tables) > 1 and kind != "floor":
            table = {"name": f"{kind} {number}", **table}
        try:
            found += obstacles_from_tables([table])
        except InputError as error:
            raise InputError(str(error).replace("obstacle[1]", f"{key}[{number}]", 1)) from None
    return found


def _terrain(data: dict[str, Any]) -> list[Patch]:
    tables = subtables(data, "terrain") or [{}]
    return [
        _plane(table, f"terrain[{number}]", len(tables), number) for number, table in enumerate(tables, 1)
    ]


def _plane(table: dict[str, Any], where: str, count: int, number: int) -> Patch:
    refuse_unknown(table, _TERRAIN_KEYS, f"{where}.")
    if "slope" in table and "incline_deg" in table:
        raise InputError(f"{where}.incline_deg: expected either slope or incline_deg, got both")
    if "uphill_deg" in table and "incline_deg" not in table:
        raise InputError(f"{where}.uphill_deg: belongs to incline_deg, which is missing")
    slope = vector_at(f"{where}.slope", table.get("slope", [0, 0]), 2)
    if "incline_deg" in table:
        incline = number_at(f"{where}.incline_deg", table["incline_deg"])
        if not 0 <= incline <= _STEEPEST:
            raise InputError(f"{where}.incline_deg: must be between 0 and {_STEEPEST:g}, got {incline:g}")
        uphill = np.deg2rad(number_at(f"{where}.uphill_deg", table.get("uphill_deg", 0)))
        slope = np.tan(np.deg2rad(incline)) * np.array([np.cos(uphill), np.sin(uphill)])
    bounds = {}
    for key, name, scale in (("x", "x", 1.0), ("y", "y", 1.0), ("angle_deg", "angle", np.pi / 180)):
        if key in table:
            low, high = vector_at(f"{where}.{key}", table[key], 2)
            if low > high:
                raise InputError(
                    f"{where}.{key}: the first bound must not be above the second, got {table[key]}"
                )
            bounds[name] = (scale * low, scale * high)
    default = "floor" if count == 1 else f"plane {number}"
    return with_place(
        where,
        plane,
        slope,
        number_at(f"{where}.height", table.get("height", 0)),
        contacts_inside=_flag(f"{where}.contacts_inside", table.get("contacts_inside", False)),
        name=text_at(f"{where}.name", table.get("name", default)),
        **bounds,
    )


def _task(table: dict[str, Any], where: str, default: str) -> GripperTask:
    refuse_unknown(table, _TASK_KEYS, f"{where}.")
    rotation = rotation_in(table, where, optional=True)
    name = text_at(f"{where}.name", table.get("name", default))
    loads: list[ProcessLoad] = []
    for number, load in enumerate(_nested(table, where), 1):
        loads += _loads(load, f"{where}.load[{number}]", number)
    return _without(
        f"{name}: ",
        where,
        GripperTask,
        vector_at(f"{where}.position", required(table, "position", where), 3),
        rotation,
        loads,
        text_at(f"{where}.orientation", table.get("orientation", "full")),
        direction_at(f"{where}.tool_axis", table.get("tool_axis", [0, 0, 1])),
        name,
    )


def _nested(table: dict[str, Any], where: str) -> list[dict[str, Any]]:
    loads = table.get("load", [])
    if not isinstance(loads, list) or not all(isinstance(item, dict) for item in loads):
        raise InputError(f"{where}.load: expected tables in double brackets, [[task.load]]")
    return loads


def _loads(table: dict[str, Any], where: str, number: int) -> tuple[ProcessLoad, ...]:
    if "magnitude" in table:
        refuse_unknown(table, _SAMPLE_KEYS, f"{where}.")
        directions = required(table, "directions", where)
        if not is_whole(directions) or directions < 1:
            raise InputError(f"{where}.directions: must be a whole number >= 1, got {directions!r}")
        half_angle = number_at(f"{where}.half_angle_deg", table.get("half_angle_deg", 180))
        return with_place(
            where,
            sampled_loads,
            number_at(f"{where}.magnitude", table["magnitude"]),
            directions,
            axis=direction_at(f"{where}.axis", table.get("axis", [0, 0, 1])),
            half_angle=np.deg2rad(half_angle),
        )
    refuse_unknown(table, (*_LOAD_KEYS, *_SAMPLE_KEYS[:1]), f"{where}.")
    if "force" not in table and "moment" not in table:
        raise InputError(f"{where}.force: missing (a load needs a force, a moment or a magnitude)")
    values = {key: vector_at(f"{where}.{key}", table[key], 3) for key in ("force", "moment") if key in table}
    return (ProcessLoad(**values, name=text_at(f"{where}.name", table.get("name", f"load {number}"))),)


def _weights(data: dict[str, Any]) -> Weights:
    if "weights" not in data:
        return Weights()
    given = _numbers(subtable(data, "weights"), "weights", CRITERIA)
    return Weights(**{name: given.get(name, 0.0) for name in CRITERIA})


def _limits(table: dict[str, Any]) -> tuple[PlacementLimits, float | None]:
    """Limits, and the reference moment, N m, if given."""
    names = tuple(f.name for f in fields(PlacementLimits))
    free = {key: None for key in ("GN", "GT") if table.get(key) is False}
    index = {"index": text_at("limits.index", table["index"])} if "index" in table else {}
    values = _numbers(
        {key: value for key, value in table.items() if key not in {**free, **index}},
        "limits",
        (*names, "reference_moment"),
    )
    moment = values.pop("reference_moment", None)
    if moment is not None and not moment > 0:
        raise InputError(f"limits.reference_moment: must be > 0, got {moment:g}")
    try:
        return PlacementLimits(**values, **free, **index), moment
    except InputError as error:
        raise InputError(f"limits.{error}") from None


def _energy(table: dict[str, Any], arm: ArmModel) -> TorqueCost | None:
    kind = table.get("kind", "holding")
    if kind not in ("holding", "torque"):
        raise InputError(f"energy.kind: expected holding or torque, got {kind!r}")
    refuse_unknown(table, ("cost",) if kind == "torque" else (), "energy.", also=("kind",))
    if kind == "holding":
        return None
    return TorqueCost(
        per_joint_at("energy.cost", required(table, "cost", "energy"), arm.n, zero_allowed=True)
    )


def _numbers(table: dict[str, Any], where: str, known: tuple[str, ...]) -> dict[str, float]:
    refuse_unknown(table, known, f"{where}.")
    return {key: number_at(f"{where}.{key}", value) for key, value in table.items()}


def _flag(where: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise InputError(f"{where}: expected true or false, got {value!r}")
    return value


def _without(prefix: str, where: str, function: Callable, *arguments: Any) -> Any:
    """Call, with `where` in place of `prefix` in the message of an InputError."""
    try:
        return function(*arguments)
    except InputError as error:
        raise InputError(f"{where}.{str(error).removeprefix(prefix)}") from None
