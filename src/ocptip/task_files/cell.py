"""Cells from TOML files: where should the base stand for a whole cycle? Format: docs/cell.md.

A cell file is the file of a cycle whose poses and obstacles are in world axes, with the ground of a placement
file. At a place it becomes the file of a cycle in base axes, and is read as such.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics import schema
from ocptip.basics.errors import InputError
from ocptip.basics.schema import Keys
from ocptip.basics.toml import Table
from ocptip.basics.values import ROTATIONS
from ocptip.motion.cycles.task import CycleTask
from ocptip.placement.problem import PlacementLimits, PlacementProblem
from ocptip.placement.result import Placement
from ocptip.placement.within import searched
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.process import ProcessWrench
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.task_files.cycle import CYCLE, cycle_keys, read_cycle
from ocptip.task_files.doubts import doubt_masses, doubt_units, require_kind
from ocptip.task_files.placement import OF_PLACES, PLACE_LIMITS, PLACEMENT, read_problem
from ocptip.task_files.source import task_source
from ocptip.task_files.tables.joints import POSE, given_angles, read_target
from ocptip.task_files.tables.shapes import OBSTACLE
from ocptip.task_files.tables.terrain import TERRAIN
from ocptip.task_files.task_scene import COMMON_LIMITS

CELL = cycle_keys(
    "cell",
    "Where a base should stand for a whole cycle, with poses in world axes: `ocptip cell`.",
    {
        **OF_PLACES,
        "terrain": schema.tables(TERRAIN, required=True),
        "limits": schema.table(
            Keys(
                "limits of a cell", "Limits of the cycle and of the place.", {**COMMON_LIMITS, **PLACE_LIMITS}
            ),
            default=None,
        ),
    },
    "arm",
)
_SCENE = ("gravity", "base", "contact")
_SHARED_LIMITS = ("GN", "GT", "torque_ratio", "clearance", "angle_margin_deg")
_LIMITS = (*(field.name for field in fields(PlacementLimits)), "angle_margin_deg")
_LEVEL = 1e-9  # of gravity
_ALONG = 1e-9  # N and N m


@dataclass(frozen=True, eq=False)
class CellTask:
    """A cell file.

    Attributes:
        name: for titles and files.
        cycle: with its poses in world axes; the postures in it that belong to poses mean nothing.
        problem: where the base may stand: one gripper task per pose of the cycle, its loads what the gripper
            holds as it comes and as it goes, at rest.
        tolerance: of the motions; the problem has the part that the search for places uses.
        data: the file's content.
        path: of the file.
    """

    name: str
    cycle: CycleTask
    problem: PlacementProblem
    tolerance: Uncertainty
    data: dict[str, Any]
    path: Path

    def within(self, tolerance: Uncertainty) -> CellTask:
        """The same cell with another tolerance."""
        problem = replace(self.problem, tolerance=searched(tolerance))
        return replace(self, problem=problem, tolerance=tolerance)

    def placed(self, placement: Placement) -> CycleTask:
        """The cycle in base axes at a place, as a file of it would be read; it knows its source.

        Raises:
            InputError: a pose has no posture there; names it.
        """
        with Table(self.placed_data(placement), self.path.name, CYCLE, folder=self.path.parent) as data:
            task = read_cycle(data, self.path.stem)
            return replace(task, source=task_source(data, task.robot))

    def placed_data(self, placement: Placement) -> dict[str, Any]:
        """The content of that file; its tip-over index has the reference moment of the placement."""
        back, origin = placement.base_rotation.T, placement.base_position
        data = {key: value for key, value in self.data.items() if key not in OF_PLACES}
        limits = {key: v for key, v in data.get("limits", {}).items() if key not in _only_of_places()}
        limits["reference_moment"] = self.problem.robot.tip_over.reference_moment
        obstacles = [_placed_obstacle(obstacle, back, origin) for obstacle in self.data.get("obstacle", [])]
        return {
            **_turned(data, back),
            "gravity": _floats(back @ np.asarray(self.problem.gravity)),
            "tolerance": self.tolerance.to_table() or {"preset": "none"},
            "limits": limits,
            "obstacle": [*self.data.get("base_obstacle", []), *obstacles],
            "motion": _placed_ends(data["motion"], back, origin),
            "segment": [_placed_ends(_turned(obstacle, back), back, origin) for obstacle in data["segment"]],
        }


def load_cell(path: str | os.PathLike[str], otherwise: Uncertainty = NONE) -> CellTask:
    """Read a cell file, see docs/cell.md.

    Args:
        path: of the file.
        otherwise: the tolerance if the file has none.

    Raises:
        InputError: the file cannot be read or describes no cell; one line that names file and key.

    Warns: InputWarning: suspicious values.
    """
    path = Path(path)
    with Table.read(path, CELL) as data:
        for key in ("segment", "terrain"):
            if "motion" in data and key not in data:
                missing = {"segment": "motions of the cycle", "terrain": "ground where the base may stand"}
                raise data.error(f"a cell needs the {missing[key]}; give [[{key}]]", key)
        require_kind(data, "cell")
        doubt_units(data)
        if "robot" in data:
            raise data.error("cells are for arms", "robot")
        data.close(early=True)
        content = dict(data.content)
        cycle = _unplaced(data, content, path)
        problem, tolerance = _problem(data, content, cycle, path, otherwise)
        doubt_masses(data, problem.robot)
        return CellTask(cycle.name, cycle, problem, tolerance, content, path)


def _unplaced(data: Table, content: dict[str, Any], path: Path) -> CycleTask:
    """The cycle with its poses as they are in the file."""
    motions = {key: value for key, value in content.items() if key not in OF_PLACES}
    limits = content.get("limits", {})
    if isinstance(limits, dict):
        motions["limits"] = {key: value for key, value in limits.items() if key not in _only_of_places()}
    table = Table(motions, path.name, CYCLE, folder=path.parent)
    cycle = read_cycle(table, path.stem, _end)
    cycle = replace(cycle, source=task_source(table, cycle.robot))
    objectives = {
        (segment_motion.task.objective.name, segment_motion.task.objective.time_weight)
        for segment_motion in cycle.segments
    }
    if len(objectives) > 1:
        raise data.error("segments of a cell have one objective; give it in [motion]", "segment")
    if cycle.robot.arm is None:
        raise data.error("cells are for arms", "robot")
    gravity = cycle.robot.support.gravity
    if np.linalg.norm(gravity[:2]) > _LEVEL * np.linalg.norm(gravity) or gravity[2] >= 0:
        raise data.error(f"of a cell points along -z of the world, got {gravity.tolist()}", "gravity")
    targets = [target for _, _, target in cycle.ends if target]
    if not targets:
        raise data.error("a cell needs a pose in the world, or any place will do; give goal_pose", "segment")
    for name, _, target in cycle.ends:
        if target and np.any(target.free):
            raise data.error(f"{name}: poses of a cell cannot be free along axes of the base", "segment")
    for segment in cycle.segments:
        _require_placeable(data, segment.task.robot)
    return cycle


def _require_placeable(data: Table, robot: StandingMechanism) -> None:
    """Raise InputError where a process is given in axes that nobody knows before the base has its place."""
    process = robot.arm.process if robot.arm else None
    if process is not None and process.axes == "base":
        raise data.error("of a cell is in axes of the tool or the world, got 'base'", "process.axes")
    if process is not None and process.varies and process.axes == "world":
        raise data.error("of a cell that varies is in axes of the tool, got 'world'", "process.axes")


def _end(
    robot: StandingMechanism, table: Table, key: str, limits: Limits
) -> tuple[np.ndarray, PoseTarget | None]:
    """As `read_end`, without the postures of poses, which depend on the place."""
    if (arm := robot.arm) is None:
        return np.zeros((1, robot.n)), None
    target = read_target(arm, table, key)
    if target is None:
        return given_angles(arm, table, key), None
    return np.clip(np.zeros(robot.n), arm.limits.angle_min, arm.limits.angle_max)[None], target


def _problem(
    data: Table, content: dict[str, Any], cycle: CycleTask, path: Path, otherwise: Uncertainty
) -> tuple[PlacementProblem, Uncertainty]:
    """Where the base may stand, and the whole tolerance."""
    keys = (*_SCENE, "arm", "motors", "obstacle", *OF_PLACES)
    asked: dict[str, Any] = {key: content[key] for key in keys if key in content}
    robot = content.get("limits", {})
    asked["limits"] = {key: robot[key] for key in (*_LIMITS, "reference_moment") if key in robot}
    asked["task"] = list(_gripper_tasks(cycle))
    robots = [segment.task.robot for segment in cycle.segments]
    asked["unloaded"] = any(
        robot.payload is None and _process(robot, share) is None for robot in robots for share in (0, 1)
    )
    tolerance = cycle.limits.tolerance if "tolerance" in content else otherwise
    problem = read_problem(Table(asked, path.name, PLACEMENT, folder=path.parent), searched(tolerance))
    for number, stand in enumerate(problem.stands, 1):
        if stand.conforms:
            raise data.error("cells stand on planes; bumps, waves, grids are not", f"terrain[{number}]")
    return problem, tolerance


def _gripper_tasks(cycle: CycleTask) -> Iterator[dict[str, Any]]:
    """Tables `[[task]]`: the poses, with the weights of what is held there, and the processes."""
    names, segments = ["start", *cycle.titles()], cycle.segments
    ends = cycle.ends[:-1] if cycle.closed else cycle.ends
    gravity = cycle.robot.support.gravity
    for number, (_, _, target) in enumerate(ends):
        if target is None:
            continue
        around = [(number - 1, 1)] if number or cycle.closed else []
        around += [(number, 0)] if number < len(segments) else []
        loads = [_load(segments[k].task.robot, share, target, gravity) for k, share in around]
        acting = dict.fromkeys(load for load in loads if load is not None)
        orientation, axis = target.how
        turning = {"orientation": orientation, "tool_axis": _floats(axis)} if target.turns_freely else {}
        yield {
            "name": names[number],
            "position": _floats(target.position),
            **_turn(target.rotation),
            **turning,
            "load": [
                {"name": f"{name} {k}", "force": list(wrench[:3]), "moment": list(wrench[3:])}
                for k, (name, wrench) in enumerate(acting, 1)
            ],
        }


def _process(robot: StandingMechanism, share: float) -> ProcessWrench | None:
    """The process wrench on the gripper at rest before (0) or after (1) a motion."""
    arm = robot.resting(share).arm
    return arm.process if arm else None


def _load(
    robot: StandingMechanism, share: float, target: PoseTarget, gravity: np.ndarray
) -> tuple[str, tuple[float, ...]] | None:
    """The payload's weight and the process at rest, as one wrench in world axes, with a name.

    Raises:
        InputError: a process whose direction is not known where the gripper turns freely.
    """
    payload, process, rotation = robot.payload, _process(robot, share), target.rotation
    force, moment, names = np.zeros(3), np.zeros(3), []
    if payload is not None:
        force = payload.mass * gravity
        moment, names = np.cross(rotation @ payload.center_of_mass, force), ["payload"]
    if process is not None:
        axis = target.tool_axis if target.orientation == "axis" else None
        wrench, turn = process.wrench.reshape(2, 3), rotation if process.turns_with_tool else np.eye(3)
        if (
            target.turns_freely
            and process.turns_with_tool
            and np.any(np.abs(wrench if axis is None else np.cross(wrench, axis)) > _ALONG)
        ):
            raise InputError(
                "process: turns with a gripper that turns freely at a pose; give it along the axis of that "
                'turn, or in axes "world"'
            )
        force, moment = force + turn @ wrench[0], moment + turn @ wrench[1]
        names.append("process")
    return (" and ".join(names), tuple(_floats(np.concatenate([force, moment])))) if names else None


def _turned(table: dict[str, Any], back: np.ndarray) -> dict[str, Any]:
    """This table with its processes transformed from world axes to base axes."""
    process = table.get("process")
    if not isinstance(process, dict):
        return table
    turned = {name: _turned({"process": value}, back)["process"] for name, value in process.items()}
    if process.get("axes") == "world":
        vectors = {key: _floats(back @ np.array(turned[key])) for key in ("force", "moment") if key in turned}
        turned = {**turned, **vectors, "axes": "base"}
    return {**table, "process": turned}


def _placed_ends(table: dict[str, Any], back: np.ndarray, origin: np.ndarray) -> dict[str, Any]:
    """The same table with its poses in base axes."""
    poses = [key for key in ("start_pose", "goal_pose") if key in table]
    return {**table, **{key: _placed_pose(table[key], back, origin) for key in poses}}


def _placed_pose(table: dict[str, Any], back: np.ndarray, origin: np.ndarray) -> dict[str, Any]:
    """A pose, or the pose of a solid, in base axes."""
    given = Table(table, "", POSE)
    position = given.get("position", np.zeros(3))
    rotation = given.rotation(default=np.eye(3))
    rest = {key: value for key, value in table.items() if key not in ("position", *ROTATIONS)}
    return {**rest, "position": _floats(back @ (position - origin)), **_turn(back @ rotation)}


def _placed_obstacle(table: dict[str, Any], back: np.ndarray, origin: np.ndarray) -> dict[str, Any]:
    """An obstacle of the world in base axes."""
    given = Table(table, "", OBSTACLE)
    if table["kind"] == "wall":
        normal = given["normal"]
        distance = given["distance"] - float(normal @ origin)
        return {**table, "normal": _floats(back @ normal), "distance": distance}
    if table["kind"] == "pillar":
        point = back @ (given["point"] - origin)
        return {**table, "point": _floats(point), "axis": _floats(back @ given["axis"])}
    return _placed_pose(table, back, origin)


def _turn(rotation: np.ndarray) -> dict[str, Any]:
    """The key of a rotation matrix."""
    return {"rotation_vector_deg": _floats(np.degrees(Rotation.from_matrix(rotation).as_rotvec()))}


def _only_of_places() -> set[str]:
    return set(_LIMITS) - set(_SHARED_LIMITS)


def _floats(values: np.ndarray) -> list[float]:
    return [float(value) for value in values]
