"""Motion tasks from TOML files: any arm, or a parallel robot, on any support.

Format: docs/motion-planner.md. Of several branches of a pose the task holds all pairs of start and goal that
stand at rest within all limits, and as its own start and goal those with the shortest joint way.
"""

from __future__ import annotations

import os
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import get_args

import numpy as np

from ocptip.basics.doubts import doubt
from ocptip.basics.errors import InputError, is_whole
from ocptip.basics.toml import DEGREES, Table
from ocptip.contact.support import Support
from ocptip.motion.objective import objective_of
from ocptip.motion.postures import posture_pairs, postures_of
from ocptip.motion.source import LIMITS
from ocptip.motion.task import FIRST_SEVEN, REACHED, MotionTask, check_commands
from ocptip.published.cases import case_names
from ocptip.published.tasks import BASES, experiment_task
from ocptip.robots.inverse.pose_search import Orientation
from ocptip.robots.inverse.pose_target import AXES, PoseTarget
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import Robot
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import NONE, Tolerance
from ocptip.task_files.arm import LOCKED, read_arm, require_geometry
from ocptip.task_files.doubts import doubt_masses, doubt_units, doubt_way, require_base_mass
from ocptip.task_files.joint_values import joint_values
from ocptip.task_files.kinds import require_kind
from ocptip.task_files.motors import arm_and_motors, gear_damping_ratio, read_gears
from ocptip.task_files.payload import read_process
from ocptip.task_files.scene import SCENE, read_support
from ocptip.task_files.sensor import read_sensor
from ocptip.task_files.shapes import read_base_shapes, read_obstacles, stands_on_floor
from ocptip.task_files.source import task_source
from ocptip.task_files.stops import with_stops
from ocptip.task_files.tolerance import tolerance_of
from ocptip.trajectories.arm_motion import checked_rise_times

_RISES = ("rise_time", "jerk")
_OF_CASES = ("sensor", "process", "motors")
"""Tables of a printed case."""

_OF_ROBOT = ("arm", "robot", "payload", "process", "motors", "sensor", "obstacle")
TABLES = ("name", *SCENE, *_OF_ROBOT, "motion", "limits", "tolerance")


def load_task(path: str | os.PathLike[str], otherwise: Tolerance = NONE) -> MotionTask:
    """Read a task file, format: docs/motion-planner.md. Whether it can be planned: :func:`refusals`.

    Args:
        path: of the file.
        otherwise: the tolerance of an arm if the file has none.

    Raises:
        InputError: the file cannot be read or describes no task, or a pose is out of reach (by how much); one
            line that names file and key.

    Warns:
        InputWarning: values that are hardly meant, such as angles in radians.
    """
    path = Path(path)
    with Table.read(path) as data:
        require_kind(data, "plan")
        if "case" in data:
            return _published(data, otherwise)
        doubt_units(data)
        if "segment" in data:
            raise data.error("several motions are a cycle: ocptip.task_files.cycle.read_task", "segment")
        data.close(*TABLES, "stops")
        task = with_stops(data, _task(data, path, otherwise))
        rises = _rise_times(data.table("limits", optional=True), task.robot)
        task = replace(task, source=task_source(data, task.robot), rise_times=rises)
        doubt_masses(data, task.robot)
        doubt_way(data, task.start, task.goal)
        return task


def _published(data: Table, otherwise: Tolerance) -> MotionTask:
    """A printed case, with limits, objective and duration of the file."""
    name, base = data.choice("case", case_names()), data.choice("base", BASES, "effective")
    motion, table = data.table("motion", optional=True), data.table("limits", optional=True)
    task = _published_task(data, name, base)
    numbers = _numbers(table, task.robot.support, data.table("motors", optional=True))
    table.one_of(*_RISES, optional=True)
    limits = table.make(replace, task.limits, **numbers, **_durations(motion))
    limits = replace(limits, tolerance=tolerance_of(data, otherwise))
    wanted = motion.text("objective", None), motion.number("price_per_second", None)
    objective = motion.make(objective_of, *wanted)
    rises = _rise_times(table, task.robot)
    return with_stops(data, replace(task, limits=limits, objective=objective, rise_times=rises))


def _published_task(data: Table, name: str, base: str) -> MotionTask:
    """A printed case with the sensor, the process and the gears of the file."""
    task = experiment_task(name, base)
    robot = task.robot
    if not any(key in data for key in _OF_CASES) or not isinstance(robot, Robot):
        return task
    arm, sensor = robot.arm.with_process(read_process(data)), read_sensor(data, robot.sensor.position)
    with data.table("motors", optional=True) as motors:
        arm = arm.with_gears(read_gears(motors, arm))
    robot = robot.varied(arm=arm, sensor=sensor)
    source = task_source(data, robot)
    own = {key: value for key, value in source.data.items() if key in _OF_CASES}
    return replace(task, robot=robot, source=replace(source, data={"case": name, "base": base, **own}))


def _task(data: Table, path: Path, otherwise: Tolerance) -> MotionTask:
    scene = TaskScene(data, otherwise)
    name, robot, motion = data.text("name", path.stem), scene.robot(), data.table("motion")
    ends = [read_end(robot, motion, key, scene.limits) for key in ("start", "goal")]
    starts, goals = (postures for postures, _ in ends)
    if not isinstance(robot, Robot):
        return ramp_task(name, robot, starts[0], goals[0], scene.limits, motion)
    given = [own[0] for own, pose in ends if pose is None]
    robot = robot.with_finer_solids(np.reshape(given, (-1, robot.n)), scene.limits.clearance)
    pairs = posture_pairs(robot, scene.limits, starts, goals)
    task = ramp_task(name, robot, *pairs[0], scene.limits, motion)
    targets = ends[0][1], ends[1][1]
    return replace(task, targets=targets, choices=tuple(pairs) if len(pairs) > 1 else ())


class TaskScene:
    """What all motions of a file have in common: where the robot stands, what stands around it, limits.

    Args:
        data: the file.
        otherwise: the tolerance of an arm if the file has none.

    Attributes:
        limits: of `[limits]`.

    Raises:
        InputError: a value is missing, unknown or cannot be used; names its place.
    """

    def __init__(self, data: Table, otherwise: Tolerance = NONE) -> None:
        self._data, self._arms = data, dict[str, ArmModel]()
        self._shapes, self._floor = read_base_shapes(data), stands_on_floor(data)
        self._accept_mass = data.table("base").flag("accept_mass", False)
        self._support = read_support(data)
        table = data.table("limits", optional=True)
        self._moment = table.number("reference_moment", None, bound="> 0")
        margin = table.number("angle_margin_deg", 0.0, scale=DEGREES, bound=">= 0")
        self._usual_clearance = "clearance" not in table
        numbers = _numbers(table, self._support, data.table("motors", optional=True))
        if "segment" not in data:  # segments of cycles are planned as ramps
            table.one_of(*_RISES, optional=True)
        limits = table.make(MotionLimits, angle_margin=margin, **numbers)
        parallel = "robot" in data
        tolerance = tolerance_of(data, NONE if parallel else otherwise)
        if parallel and tolerance.given == ("damping",):
            self.limits = replace(
                limits, damping=tolerance.damping
            )  # nothing else is looked at: no worst case
        else:
            self.limits = replace(limits, tolerance=tolerance)

    def robot(self, segment: Table | None = None) -> StandingMechanism:
        """The robot on its support, with what it holds in a segment of a cycle."""
        data = self._data
        if "robot" in data:
            from ocptip.task_files.platform import read_platform_robot  # loads for 0.1 s

            return read_platform_robot(data, self._support, self._moment, segment)
        gripper = "" if segment is None else repr([segment.value(key, None) for key in LOCKED])
        if gripper not in self._arms:
            self._arms[gripper] = read_arm(data.table("arm"), segment)
        arm, motors = arm_and_motors(data, segment, self._arms[gripper])
        require_base_mass(data, arm, self._support.mass, accepted=self._accept_mass)
        require_geometry(data, arm, {"base.shape": self._shapes, "obstacle": data.tables("obstacle")})
        obstacles = read_obstacles(data, "obstacle")
        robot = Robot(
            arm,
            self._support,
            motors,
            obstacles=obstacles,
            shapes=self._shapes,
            floor=self._floor,
            reference_moment=self._moment,
            sensor=read_sensor(data, arm.mount_position),
        )
        if self._usual_clearance:  # of a cycle the smallest of all segments
            self.limits = replace(self.limits, clearance=min(self.limits.clearance, robot.usual_clearance))
        return robot


def read_end(
    robot: StandingMechanism, table: Table, key: str, limits: MotionLimits
) -> tuple[np.ndarray, PoseTarget | None]:
    """Postures (k, n) of a start or a goal, and the pose they are postures of, if it is one."""
    if not isinstance(robot, Robot):
        return table.vector(key, robot.n)[None], None
    target = read_target(robot.arm, table, key)
    if target is None:
        return given_angles(robot.arm, table, key), None
    with table.table(f"{key}_pose").at(pose=""):
        postures = postures_of(robot.arm, target, limits)
    far, turn = target.misses(robot.arm, postures).max(axis=0)
    if max(far, turn) > REACHED:
        where, miss = table.place(f"{key}_pose"), f"{1e3 * far:.2g} mm and {np.rad2deg(turn):.2g} degrees"
        doubt(
            f"{table.file}: {where}: {robot.arm.name} lacks an axis there; its nearest postures are taken, "
            f"which miss the pose by {miss}"
        )
    return postures, target


def ramp_task(
    name: str,
    robot: StandingMechanism,
    start: np.ndarray,
    goal: np.ndarray,
    limits: MotionLimits,
    table: Table,
) -> MotionTask:
    """The task with the optimised joints, commands, objective and durations of [motion]."""
    key, commands = "optimised", table.value("commands", 3)
    limits = replace(limits, **_durations(table))
    wanted = table.text("objective", None), table.number("price_per_second", None)
    optimised = table.value(key, [j + 1 for j in FIRST_SEVEN[: robot.n]])
    table.close()
    if not isinstance(optimised, list):
        raise table.error(f"expected a list of joints, got {optimised!r}", key)
    with table.at(key):
        joints = [joint for item in optimised for joint in _joints(item, robot.names)]
    if not joints or len(set(joints)) != len(joints):
        raise table.error(f"expected different joints, at least one, got {optimised!r}", key)
    with table.at():
        check_commands(commands)
        objective = objective_of(*wanted)
    return MotionTask(name, robot, start, goal, limits, tuple(sorted(joints)), commands, objective)


def _durations(table: Table) -> dict[str, float]:
    """Least and greatest duration, of [motion]."""
    key = table.one_of("duration", "max_duration", optional=True)
    if key is None:
        return {}
    seconds = table.number(key, bound="> 0")
    return {"min_duration": seconds if key == "duration" else 0.0, "max_duration": seconds}


def _numbers(table: Table, support: Support, motors: Table) -> dict[str, float]:
    """Of [limits]; jumps count with the least damping ratio of feet and gears that give."""
    ratios = [spring.ratio for spring in support.elastic.springs] if support.elastic else []
    if "gear_stiffness" in motors:
        ratios += [0.0 if "gear_damping" in motors else gear_damping_ratio(motors)]
    return {"damping": min(ratios, default=1.0), **limit_numbers(table)}


def limit_numbers(table: Table) -> dict[str, float]:
    """Numbers of a table [limits] as they are."""
    if "damping" in table:
        raise table.error("is now damping in [tolerance], for all robots", "damping")
    return table.numbers(*LIMITS)


def _rise_times(table: Table, robot: StandingMechanism) -> tuple[float, ...] | None:
    """Of the accelerations, of [limits]: as they are, or those with which no jerk can be exceeded.

    Within a rise time an acceleration changes by no more than from its limit to the opposite one.
    """
    key = table.one_of(*_RISES, optional=True)
    if key is None:
        return None
    if key == "rise_time":
        found = table.per_joint(key, robot.n, bound=">= 0")
    else:
        found = 2 * robot.limits.acceleration / table.per_joint(key, robot.n, bound="> 0")
    with table.at(rise_time=key):
        return checked_rise_times(found, robot.n)


def given_angles(arm: ArmModel, table: Table, key: str) -> np.ndarray:
    """Joint angles (1, n), rad (sliding joints: m), that are given."""
    q = np.full(arm.n, np.nan)
    for own, slides in _angle_keys(arm, key).items():
        joints, scale = arm.prismatic == slides, 1.0 if slides else DEGREES
        if own not in table:
            table.one_of(own, f"{key}_pose")  # complains
        q[joints] = joint_values(table, own, arm, slides=slides, scale=scale, together=False)
        if lacking := [arm.joint_names[j] for j in np.flatnonzero(joints & np.isnan(q))]:
            raise table.error(f"no value for {', '.join(lacking)}", own)
    return q[None]


def _angle_keys(arm: ArmModel, key: str) -> dict[str, bool]:
    """Keys of the values of start or goal, as far as there are such joints; whether the joints slide."""
    keys = {f"{key}_deg": False, f"{key}_m": True}
    return {own: slides for own, slides in keys.items() if (arm.prismatic == slides).any()}


def read_target(arm: ArmModel, table: Table, key: str) -> PoseTarget | None:
    """The gripper pose of start or goal, if there is one."""
    pose = f"{key}_pose"
    if pose not in table:
        return None
    table.one_of(*_angle_keys(arm, key), pose)
    with table.table(pose) as given:
        position, rotation = given.vector("position", 3), given.rotation()
        axis, fold = given.text("symmetric_about", ""), given.value("fold", 0)
        orientation = given.choice("orientation", get_args(Orientation), "full")
        tool_axis = given.direction("tool_axis", np.array([0.0, 0.0, 1.0]))
        ranges = given.table("free", optional=True)
        free = np.array([ranges.vector(own, 2, [0.0, 0.0]) for own in AXES])
        ranges.close()
        with given.at():
            return PoseTarget(position, rotation, axis, fold, orientation, tool_axis, free)


def _joints(item: object, names: tuple[str, ...]) -> list[int]:
    """Numbers of joints, from 0, given by name, by pattern ("joint_*") or by number from 1."""
    if is_whole(item) and 1 <= item <= len(names):
        return [item - 1]
    if isinstance(item, str):
        fitting = [j for j, name in enumerate(names) if name == item or fnmatchcase(name, item)]
        if fitting:
            return fitting
    raise InputError(f"no joint {item!r}; there are 1 to {len(names)}: {', '.join(names)}")
