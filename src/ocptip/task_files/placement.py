"""Placement tasks from TOML files: where should any arm on any support stand?

A placement file is a scene file (docs/scenes.md: `gravity`, `[base]`, `[[contact]]`; the base without the
arm, base axes) with the tables `[arm]` and `[motors]` of a motion task (docs/motion-planner.md) and those of
docs/placement.md.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from ocptip.basics import schema
from ocptip.basics.schema import Key, Keys
from ocptip.basics.toml import Table
from ocptip.placement.cone import FEWEST
from ocptip.placement.power import TorqueCost
from ocptip.placement.problem import (
    CRITERIA,
    INDICES,
    GripperTask,
    Orientation,
    PlacementLimits,
    PlacementProblem,
    ProcessLoad,
    Weights,
    sampled_loads,
)
from ocptip.placement.within import searched
from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.task_files.doubts import doubt_masses, doubt_units, require_kind
from ocptip.task_files.scene import SCENE, read_support
from ocptip.task_files.tables.arm import ARM, require_base_mass
from ocptip.task_files.tables.motors import MOTORS, arm_and_motors
from ocptip.task_files.tables.payload import PAYLOAD
from ocptip.task_files.tables.shapes import OBSTACLE, read_base_shapes, read_obstacles, require_geometry
from ocptip.task_files.tables.terrain import TERRAIN, read_terrain
from ocptip.task_files.tables.tolerance import tolerance_of
from ocptip.task_files.task_scene import COMMON_LIMITS, ROBOT_BASE

_MOST_DIRECTIONS = 10_000

_ONE_LOAD = Keys(
    "load of a pose",
    "A process load on the gripper, world axes; several act one at a time.",
    {
        "name": schema.text("Title.", otherwise="load and its number"),
        "force": schema.vector("Force.", "N", 3, otherwise="none"),
        "moment": schema.vector("Moment.", "N m", 3, otherwise="none"),
    },
)
_CONE = Keys(
    "cone of loads",
    "All forces of one magnitude in a cone.",
    {
        "magnitude": schema.number("Magnitude of the forces.", "N"),
        "directions": schema.whole(
            "Number of directions.", least=FEWEST, most=_MOST_DIRECTIONS, otherwise="enough"
        ),
        "axis": schema.direction("Axis of the cone, world axes.", default=[0, 0, 1]),
        "half_angle_deg": schema.number("Half the opening angle.", "deg", default=180),
    },
)
_LOAD = Keys(
    "loads of a pose",
    "Process loads on the gripper.",
    by=("magnitude",),
    variants={"magnitude": _CONE, "": _ONE_LOAD},
)
_TASK = Keys(
    "pose of a placement",
    "A pose of the gripper that has to be reached.",
    {
        "name": schema.text("Title.", otherwise="task and its number"),
        "position": schema.vector("Position of the TCP, world.", "m", 3),
        **schema.rotation("Axes of the gripper to those of the world", default="parallel to the world"),
        "orientation": schema.choice(
            "What of the orientation counts; `axis`: the direction of `tool_axis`.",
            get_args(Orientation),
            default="full",
        ),
        "tool_axis": schema.direction("Direction that counts, gripper axes.", default=[0, 0, 1]),
        "load": schema.tables(_LOAD),
    },
)


def _criteria(name: str, meaning: str, each: str, otherwise: str) -> Keys:
    return Keys(
        name, meaning, {key: schema.number(f"{each} of {key}.", otherwise=otherwise) for key in CRITERIA}
    )


def _index_limit(meaning: str) -> Key:
    form = {"anyOf": [{"type": "number"}, {"const": False}]}
    key = schema.number(meaning, otherwise="0.9")
    return replace(key, words="number, or false", schema=form)


def _limit(meaning: str, unit: str = "", otherwise: str = "none") -> Key:
    return schema.number(meaning, unit, otherwise=otherwise)


PLACE_LIMITS = {
    "base_clearance": _limit("Minimum distance of contacts and solids of the base from obstacles.", "m", "0"),
    "condition": _limit("Largest condition number of the Jacobian."),
    "singular_ratio": _limit("Largest ratio of the extreme singular values of the Jacobian."),
    "jacobian_length": _limit("Length by which translational rows of the Jacobian are divided.", "m", "1"),
    "index": schema.text(f"Index of the pose: {', '.join(INDICES)}.", otherwise="none"),
    "index_min": _limit("Smallest value of that index."),
    "tool_radius": _limit("Radius of the ball about the TCP for that index.", "m", "0.1"),
}
_LIMITS = Keys(
    "limits of a placement",
    "Limits of a placement.",
    {
        "GN": _index_limit("Largest tip-over index; false: contacts are maintained."),
        "GT": _index_limit("Largest share of the friction in use; false: contacts are maintained."),
        "torque_ratio": _limit("Largest torque over its limit, of any joint.", "", "1"),
        "clearance": _limit(
            "Minimum distance of what must not touch.", "m", "0.01, or less if links are nearer"
        ),
        **PLACE_LIMITS,
        **{key: COMMON_LIMITS[key] for key in ("reference_moment", "angle_margin_deg")},
    },
)
_ENERGY = Keys(
    "energy",
    "What the criterion GE is.",
    {"kind": schema.choice("The cost.", ("holding", "torque"), default="holding")},
    by="kind",
    variants={
        "holding": Keys("holding power", "Electric power at standstill.", {}),
        "torque": Keys(
            "torque cost",
            "Weighted sum of torques.",
            {"cost": schema.per_joint("Cost of a torque.", "1/(N m)", bound=">= 0")},
        ),
    },
    usual="holding",
)
OF_PLACES = {
    "base_obstacle": schema.tables(OBSTACLE, "Obstacles fixed to the base, base axes."),
    "keep_out": schema.tables(OBSTACLE, "Obstacles for the base alone, world axes."),
    "terrain": schema.tables(TERRAIN),
    "weights": schema.table(
        _criteria(
            "weights", "Weights of the criteria, scaled to the sum 1.", "Weight", "0; without [weights] all 1"
        ),
        default=None,
    ),
    "references": schema.table(
        _criteria(
            "references",
            "Values by which the criteria are divided.",
            "Reference value",
            "1; GE: at full torque",
        ),
        default=None,
    ),
    "energy": schema.table(_ENERGY, default=None),
}
PLACEMENT = Keys(
    "placement",
    "Where a base should stand for poses of the gripper: `ocptip place`.",
    {
        "name": SCENE.keys["name"],
        "unloaded": schema.flag("Constraints also hold without process loads.", default=True),
        "gravity": SCENE.keys["gravity"],
        "base": schema.table(
            Keys(
                "base of a placement",
                ROBOT_BASE.meaning,
                {
                    **ROBOT_BASE.keys,
                    "ground": schema.vector(
                        "Point put on the ground, base axes.",
                        "m",
                        3,
                        otherwise="on the z axis, between the contacts",
                    ),
                },
            )
        ),
        "contact": SCENE.keys["contact"],
        "arm": schema.table(ARM),
        "payload": PAYLOAD,
        "motors": schema.table(MOTORS, default=None),
        "obstacle": schema.tables(OBSTACLE, "Obstacles, world axes."),
        **OF_PLACES,
        "task": schema.tables(_TASK, required=True),
        "limits": schema.table(_LIMITS, default=None),
        "tolerance": SCENE.keys["tolerance"],
    },
)


@dataclass(frozen=True, eq=False)
class PlacementTask:
    """A placement file.

    Attributes:
        name: for titles and files.
        problem: what it asks for; its tolerance is what the search uses.
        tolerance: all of the file's.
    """

    name: str
    problem: PlacementProblem
    tolerance: Uncertainty = NONE

    def within(self, tolerance: Uncertainty) -> PlacementTask:
        """The same task with another tolerance."""
        problem = replace(self.problem, tolerance=searched(tolerance))
        return replace(self, problem=problem, tolerance=tolerance)


def load_placement(path: str | os.PathLike[str], otherwise: Uncertainty = NONE) -> PlacementTask:
    """Read a placement file, see docs/placement.md.

    Args:
        path: of the file.
        otherwise: the tolerance if the file has none.

    Raises:
        InputError: the file cannot be read or describes no placement problem; one line that names file and
            key. List entries are counted from 1.

    Warns: InputWarning: suspicious values, such as lengths in millimetres.
    """
    path = Path(path)
    with Table.read(path, PLACEMENT) as data:
        require_kind(data, "place")
        if "process" in data:
            raise data.error(
                "of a placement belongs to its poses: [[task]] load = [{ force, moment }]", "process"
            )
        doubt_units(data)
        data.close(early=True)
        tolerance = tolerance_of(data, otherwise)
        task = PlacementTask(data.get("name", path.stem), read_problem(data, searched(tolerance)), tolerance)
        doubt_masses(data, task.problem.robot)
        return task


def read_problem(data: Table, tolerance: Uncertainty) -> PlacementProblem:
    """The placement problem of a file.

    Args:
        data: the file.
        tolerance: what the search uses.
    """
    base, shapes = data.table("base"), read_base_shapes(data)
    ground, accept_mass, on_floor = base["ground"], base["accept_mass"], base["floor"]
    support = read_support(data)
    if support.dimension != 3:
        raise data.error("an arm needs a spatial support; give three numbers", "contact[1].position")
    arm, motors = arm_and_motors(data)
    require_base_mass(data, arm, support.mass, accepted=accept_mass)
    given = {key: data.tables(key) for key in ("base_obstacle", "obstacle")}
    require_geometry(data, arm, given, hint="; obstacles for the base alone are [[keep_out]]")
    table = data.table("limits")
    limits, moment = _limits(table)
    deck = read_obstacles(data, "base_obstacle", numbered=True)
    obstacles = read_obstacles(data, "obstacle", numbered=True, world=True)
    robot = Robot(
        arm, support, motors, obstacles=deck, shapes=shapes, floor=on_floor, reference_moment=moment
    )
    if "clearance" not in table:
        limits = replace(limits, clearance=robot.usual_clearance)
    tasks = [_task(table, f"task {k}") for k, table in enumerate(data.tables("task"), 1)]
    references = data.table("references")
    given: dict[str, Any] = {} if ground is None else {"ground_frame": (ground, np.eye(3))}
    if (energy := data.table("energy"))["kind"] != "holding":
        given["energy"] = energy.make(TorqueCost, energy.get("cost", size=arm.n))
    with base.at(None, ground_frame="ground"):
        return PlacementProblem(
            robot,
            tasks,
            read_terrain(data),
            weights=_weights(data),
            limits=limits,
            obstacles=obstacles,
            keep_out=read_obstacles(data, "keep_out", numbered=True, world=True),
            unloaded=data["unloaded"],
            references=references.make(dict, **references.given(*CRITERIA)),
            tolerance=tolerance,
            **given,
        )


def _task(table: Table, default: str) -> GripperTask:
    loads = [p for k, load in enumerate(table.tables("load"), 1) for p in _loads(load, f"load {k}")]
    return table.make(
        GripperTask,
        table["position"],
        table.rotation(default=np.eye(3)),
        loads,
        table["orientation"],
        table["tool_axis"],
        table.get("name", default),
    )


def _loads(table: Table, default: str) -> tuple[ProcessLoad, ...]:
    if "magnitude" in table:
        magnitude, count = table["magnitude"], table["directions"]
        axis, half_angle = table["axis"], table["half_angle_deg"]
        table.close()
        with table.at(half_angle="half_angle_deg"):
            return sampled_loads(magnitude, count, axis=axis, half_angle=half_angle)
    if "force" not in table and "moment" not in table:
        table.require("force", "a load needs a force, a moment or a magnitude")
    force, moment = (table.get(key, np.zeros(3)) for key in ("force", "moment"))
    return (table.make(ProcessLoad, force, moment, table.get("name", default)),)


def _weights(data: Table) -> Weights:
    if "weights" not in data:
        return Weights()
    table = data.table("weights")
    given = {name: table.get(name, 0.0) for name in CRITERIA}
    table.close()
    return Weights(**given)


def _limits(table: Table) -> tuple[PlacementLimits, float | None]:
    """Limits, and the reference moment, N m, if given."""
    moment = table["reference_moment"]
    free = {key: None for key in ("GN", "GT") if table.value(key) is False}
    otherwise = {**free, "index": table["index"], "angle_margin": table["angle_margin_deg"]}
    names = [field.name for field in fields(PlacementLimits) if field.name not in otherwise]
    return table.make(PlacementLimits, **table.given(*names), **otherwise), moment
