"""Placement tasks from TOML files: where should any arm on any support stand?

A placement file is a scene file (docs/scenes.md: `gravity`, `[base]`, `[[contact]]`; the base without the
arm, base axes) with the tables `[arm]` and `[motors]` of a motion task (docs/motion-planner.md) and those of
docs/placement.md.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import get_args

import numpy as np

from ocptip.basics.toml import DEGREES, Table
from ocptip.placement.cone import FEWEST
from ocptip.placement.power import TorqueCost
from ocptip.placement.problem import (
    CRITERIA,
    GripperTask,
    Orientation,
    PlacementLimits,
    PlacementProblem,
    ProcessLoad,
    Weights,
    sampled_loads,
)
from ocptip.placement.within import searched
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import NONE, Tolerance
from ocptip.task_files.arm import require_geometry
from ocptip.task_files.doubts import doubt_masses, doubt_units, require_base_mass
from ocptip.task_files.kinds import require_kind
from ocptip.task_files.motors import arm_and_motors
from ocptip.task_files.scene import SCENE, read_support
from ocptip.task_files.shapes import read_base_shapes, read_obstacles, stands_on_floor
from ocptip.task_files.terrain import read_terrain
from ocptip.task_files.tolerance import tolerance_of

_OBSTACLES = ("base_obstacle", "obstacle", "keep_out")
_TABLES = ("terrain", "task", "weights", "references", "limits", "energy", "tolerance")
_MOST_DIRECTIONS = 10_000
_VERTICAL = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class PlacementTask:
    """A placement file.

    Attributes:
        name: for titles and files.
        problem: what it asks for; its tolerance is what the search looks at.
        tolerance: all of the file's.
    """

    name: str
    problem: PlacementProblem
    tolerance: Tolerance = NONE

    def within(self, tolerance: Tolerance) -> PlacementTask:
        """The same task with another tolerance."""
        problem = replace(self.problem, tolerance=searched(tolerance))
        return replace(self, problem=problem, tolerance=tolerance)


def load_placement(path: str | os.PathLike[str], otherwise: Tolerance = NONE) -> PlacementTask:
    """Read a placement file, see docs/placement.md.

    Args:
        path: of the file.
        otherwise: the tolerance if the file has none.

    Raises:
        InputError: the file cannot be read or describes no placement problem; one line that names file and
            key. List entries are counted from 1.

    Warns:
        InputWarning: values that are hardly meant, such as lengths in millimetres.
    """
    path = Path(path)
    with Table.read(path) as data:
        require_kind(data, "place")
        if "process" in data:
            raise data.error(
                "of a placement belongs to its poses: [[task]] load = [{ force, moment }]", "process"
            )
        doubt_units(data)
        data.close("name", "unloaded", *SCENE, "arm", "payload", "motors", *_OBSTACLES, *_TABLES)
        tolerance = tolerance_of(data, otherwise)
        task = PlacementTask(data.text("name", path.stem), read_problem(data, searched(tolerance)), tolerance)
        doubt_masses(data, task.problem.robot)
        return task


def read_problem(data: Table, tolerance: Tolerance) -> PlacementProblem:
    """What a file asks for.

    Args:
        data: the file.
        tolerance: what the search looks at.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """
    base, shapes, on_floor = data.table("base"), read_base_shapes(data), stands_on_floor(data)
    ground, accept_mass = base.vector("ground", 3, None), base.flag("accept_mass", False)
    support = read_support(data)
    if support.dimension != 3:
        raise data.error("an arm needs a spatial support; give three numbers", "contact[1].position")
    arm, motors = arm_and_motors(data)
    require_base_mass(data, arm, support.mass, accepted=accept_mass)
    given = {key: data.tables(key) for key in ("base_obstacle", "obstacle")}
    require_geometry(data, arm, given, hint="; obstacles for the base alone are [[keep_out]]")
    table = data.table("limits", optional=True)
    limits, moment = _limits(table)
    deck = read_obstacles(data, "base_obstacle", numbered=True)
    obstacles = read_obstacles(data, "obstacle", numbered=True, world=True)
    robot = Robot(
        arm,
        support,
        motors,
        obstacles=deck,
        shapes=shapes,
        floor=on_floor,
        reference_moment=moment,
    )
    if "clearance" not in table:
        limits = replace(limits, clearance=robot.usual_clearance)
    tasks = [_task(table, f"task {k}") for k, table in enumerate(data.tables("task", required=True), 1)]
    references = data.table("references", optional=True)
    with base.at(None, ground_frame="ground"):
        return PlacementProblem(
            robot,
            tasks,
            read_terrain(data),
            weights=_weights(data),
            limits=limits,
            obstacles=obstacles,
            keep_out=read_obstacles(data, "keep_out", numbered=True, world=True),
            unloaded=data.flag("unloaded", True),
            energy=_energy(data.table("energy", optional=True), arm),
            references=references.make(dict, **references.numbers(*CRITERIA)),
            ground_frame=None if ground is None else (ground, np.eye(3)),
            tolerance=tolerance,
        )


def _task(table: Table, default: str) -> GripperTask:
    orientations = get_args(Orientation)
    loads = [p for k, load in enumerate(table.tables("load"), 1) for p in _loads(load, f"load {k}")]
    return table.make(
        GripperTask,
        table.vector("position", 3),
        table.rotation(default=np.eye(3)),
        loads,
        table.choice("orientation", orientations, "full"),
        table.direction("tool_axis", _VERTICAL),
        table.text("name", default),
    )


def _loads(table: Table, default: str) -> tuple[ProcessLoad, ...]:
    if "magnitude" in table:
        magnitude = table.number("magnitude")
        count = None
        if "directions" in table:
            count = table.whole("directions", least=FEWEST, most=_MOST_DIRECTIONS)
        axis = table.direction("axis", _VERTICAL)
        half_angle = table.number("half_angle_deg", np.pi, scale=DEGREES)
        table.close()
        with table.at(half_angle="half_angle_deg"):
            return sampled_loads(magnitude, count, axis=axis, half_angle=half_angle)
    if "force" not in table and "moment" not in table:
        table.require("force", "a load needs a force, a moment or a magnitude")
    force, moment = (table.vector(key, 3, np.zeros(3)) for key in ("force", "moment"))
    return (table.make(ProcessLoad, force, moment, table.text("name", default)),)


def _weights(data: Table) -> Weights:
    if "weights" not in data:
        return Weights()
    table = data.table("weights")
    given = {name: table.number(name, 0.0) for name in CRITERIA}
    table.close()
    return Weights(**given)


def _limits(table: Table) -> tuple[PlacementLimits, float | None]:
    """Limits, and the reference moment, N m, if given."""
    moment = table.number("reference_moment", None, bound="> 0")
    free = {key: None for key in ("GN", "GT") if table.value(key, None) is False}
    names = [field.name for field in fields(PlacementLimits) if field.name not in {**free, "index": None}]
    index = table.text("index", None)
    return table.make(PlacementLimits, **table.numbers(*names), **free, index=index), moment


def _energy(table: Table, arm: ArmModel) -> TorqueCost | None:
    if table.choice("kind", ("holding", "torque"), "holding") == "holding":
        return None
    return table.make(TorqueCost, table.per_joint("cost", arm.n, bound=">= 0"))
