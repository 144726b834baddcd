"""Motion tasks from TOML files: any arm, or a parallel robot, on any support.

A task file is a scene file (docs/scenes.md: `gravity`, `[base]`, `[[contact]]`; the base without the arm)
plus these tables. SI units; keys in degrees say so. Joints are counted from 1.

    name = "..."                optional, default: the file's name

    [arm]
    name = "FP1W2F"             one of the modular arms, or
    urdf = "arm.urdf"           a file, relative to the task file, with
    base_link, tool_frame       names in it, and optionally
    locked_deg, locked_m        tables joint = angle or way, see `ocptip.robots.urdf.arm_from_urdf`
    armature                    kg m^2, number or list, reflected rotor inertias
    sphere_radius               m, number or list per link (0: none): collision spheres along the links
    excluded_links              list of pairs of links whose spheres are not checked against each other
    mount_position              m: base origin to Q_1 (modular arm) or to the frame of base_link
    mount_rpy_deg               roll, pitch, yaw about the fixed base axes x, y, z; default 0
    [arm.limits]                angle_min_deg, angle_max_deg, speed_deg_s, acceleration_deg_s2, torque_Nm:
                                number or list; replace those of the arm. URDFs have no accelerations.

    [robot]                     instead of [arm]: a parallel robot whose platform coordinates move in ramps
    parallel = "Delta"          one of the ready-made robots, or a file, relative to the task file
    payload                     kg, at the platform's origin; default 0
    mount_position              m: base origin to the origin of the robot's world frame
    mount_rpy_deg               as for arms
    [robot.limits]              lower, upper, speed, acceleration (of the coordinates, m and rad),
                                motor_force, motor_speed (optional): number or list; singularity (optional):
                                see `ocptip.standing.platform.PlatformLimits`

    [motors]                    modular arms: optional, default kind = "modular"
    kind                        "modular" (measured power maps), "estimated" (standby, regeneration) or "dc"
                                (motor_constant or resistance, torque_constant, gear_ratio; coulomb, viscous,
                                standby, regeneration): see `ocptip.robots.motors.DCMotors`

    [[obstacle]]
    kind                        "floor" (height), "wall" (normal into the wall, any length; distance of the
                                plane from the base origin) or "pillar" (point, radius, axis, default
                                vertical); m, base axes; walls and pillars may have a name

    [motion]
    start_deg or start_pose     joint angles, or a gripper pose in the base frame, a table with position
    goal_deg or goal_pose       and rpy_deg or rotation (3 x 3, gripper to base axes)
    start, goal                 for a parallel robot: its coordinates, m and rad
    optimised                   joint names or numbers, default: the first three (robot: all)
    commands                    ramp commands per optimised joint, default 3

    [limits]                    GN, GT, torque_ratio, clearance (m), reference_moment (N m); all optional

Of several branches of a pose that one is taken whose joint way from start to goal, in seconds at full speed
and summed over the joints, is shortest among those that stand at rest within all limits and without
collision (if there is none: among those with the fewest reasons against them, which :func:`refusals` tells).
Angles that limits allow more than once are taken near zero in the start and near the start in the goal.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, is_whole, positive_number
from ocptip.basics.toml import (
    number_at,
    read_toml,
    refuse_unknown,
    required,
    rotation_in,
    subtable,
    subtables,
    text_at,
    vector_at,
    with_place,
)
from ocptip.motion.task import MotionTask, check_commands
from ocptip.robots.geometry import Pillar, Wall
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.inverse.joint_angles import within_limits
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import StandingRobot
from ocptip.standing.limits import MotionLimits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.platform import StandingParallelRobot
from ocptip.standing.rest import posture_refusals
from ocptip.task_files.arm import arm_from_table, motors_from_tables, obstacles_from_tables
from ocptip.task_files.platform import parallel_robot
from ocptip.task_files.scene import scene_from_dict

_SCENE = ("gravity", "base", "contact")
_TABLES = ("name", *_SCENE, "arm", "robot", "motors", "obstacle", "motion", "limits")
_MOTION_KEYS = ("start_deg", "start_pose", "goal_deg", "goal_pose", "optimised", "commands")
_PARALLEL_MOTION_KEYS = ("start", "goal", "optimised", "commands")
_LIMIT_KEYS = ("GN", "GT", "torque_ratio", "clearance")


def load_task(path: str | os.PathLike[str]) -> MotionTask:
    """Read a task file, see the module for its format. Whether it can be planned: :func:`refusals`.

    Raises:
        InputError: the file cannot be read or describes no task, or a pose is out of reach (by how much); one
            line that names file and key.
    """
    path = Path(path)
    data = read_toml(path)
    try:
        refuse_unknown(data, _TABLES, "")
    except InputError as error:
        raise InputError(f"{path.name}: {error}") from None
    scene = scene_from_dict({key: data[key] for key in _SCENE if key in data}, name=path.name)
    try:
        limits, moment = _limits(subtable(data, "limits", optional=True))
        name = text_at("name", data.get("name", path.stem))
        if "robot" in data:
            parallel = parallel_robot(data, scene.support, moment, path.parent)
            return _parallel_task(name, parallel, limits, subtable(data, "motion"))
        arm = arm_from_table(subtable(data, "arm"), path.parent)
        robot = StandingRobot(
            arm,
            scene.support,
            motors_from_tables(data, arm),
            obstacles=_obstacles(data, arm),
            reference_moment=moment,
        )
        return _task(name, robot, limits, subtable(data, "motion"))
    except InputError as error:
        raise InputError(f"{path.name}: {error}") from None


def _task(name: str, robot: StandingRobot, limits: MotionLimits, table: dict[str, Any]) -> MotionTask:
    refuse_unknown(table, _MOTION_KEYS, "motion.")
    starts, goals = (_candidates(robot.arm, table, key) for key in ("start", "goal"))
    start, goal = _shortest(robot, limits, starts, goals)
    return _ramp_task(name, robot, start, goal, limits, table, min(robot.n, 3))


def _ramp_task(
    name: str,
    robot: StandingMechanism,
    start: np.ndarray,
    goal: np.ndarray,
    limits: MotionLimits,
    table: dict[str, Any],
    count: int,
) -> MotionTask:
    """The task with the optimised joints, by default the first `count`, and commands of [motion]."""
    optimised = table.get("optimised", list(range(1, count + 1)))
    if not isinstance(optimised, list):
        raise InputError(f"motion.optimised: expected a list of joints, got {optimised!r}")
    joints = [_joint("motion.optimised", item, robot.names) for item in optimised]
    if not joints or len(set(joints)) != len(joints):
        raise InputError(f"motion.optimised: expected different joints, at least one, got {optimised!r}")
    commands = table.get("commands", 3)
    check_commands("motion.commands", commands)
    return MotionTask(name, robot, start, goal, limits, tuple(sorted(joints)), commands)


def _parallel_task(
    name: str, robot: StandingParallelRobot, limits: MotionLimits, table: dict[str, Any]
) -> MotionTask:
    refuse_unknown(table, _PARALLEL_MOTION_KEYS, "motion.")
    ends = [vector_at(f"motion.{key}", required(table, key, "motion"), robot.n) for key in ("start", "goal")]
    return _ramp_task(name, robot, *ends, limits, table, robot.n)


def _candidates(arm: ArmModel, table: dict[str, Any], key: str) -> np.ndarray:
    """Joint angles (k, n), rad: those given, or all branches of the pose given."""
    angles, pose = f"{key}_deg", f"{key}_pose"
    if (angles in table) == (pose in table):
        many = "both" if angles in table else "none"
        raise InputError(f"motion.{angles}: expected either {angles} or {pose}, got {many}")
    if angles in table:
        return np.deg2rad(vector_at(f"motion.{angles}", table[angles], arm.n))[None]
    where, given = f"motion.{pose}", table[pose]
    if not isinstance(given, dict):
        raise InputError(f"{where}: expected a table with position and rpy_deg or rotation, got {given!r}")
    refuse_unknown(given, ("position", "rpy_deg", "rotation"), f"{where}.")
    rotation = rotation_in(given, where)
    position = vector_at(f"{where}.position", required(given, "position", where), 3)
    return with_place(where, solve_inverse_kinematics, arm, position, rotation).branches


def _shortest(
    robot: StandingRobot, limits: MotionLimits, starts: np.ndarray, goals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Start and goal, (n,), rad, of all pairs, by the rule of the module; ties by order."""
    arm = robot.arm.limits
    if len(starts) == len(goals) == 1:
        return starts[0], goals[0]
    reasons = [[len(posture_refusals(robot, limits, q)) for q in branches] for branches in (starts, goals)]
    weights = 1 / np.where(np.isfinite(arm.speed), arm.speed, 1.0)
    ranked = []
    for s, start in enumerate(starts):
        for g, goal in enumerate(goals):
            # Branches of a pose, unlike the angles of a posture, may be taken whole turns away.
            near = within_limits(robot.arm, goal, start) if len(goals) > 1 else goal
            way = float(np.abs(near - start) @ weights)
            ranked.append((reasons[0][s] + reasons[1][g], way, len(ranked), start, near))
    return min(ranked, key=lambda entry: entry[:3])[3:]


def _obstacles(data: dict[str, Any], arm: ArmModel) -> list[Wall | Pillar]:
    tables = subtables(data, "obstacle")
    if tables and not arm.sphere_sets:
        raise InputError("obstacle: the arm has no collision spheres to check; give arm.sphere_radius")
    return obstacles_from_tables(tables)


def _limits(table: dict[str, Any]) -> tuple[MotionLimits, float | None]:
    """Limits of the motion, and the reference moment, N m, if given."""
    refuse_unknown(table, (*_LIMIT_KEYS, "reference_moment"), "limits.")
    values = {key: number_at(f"limits.{key}", value) for key, value in table.items()}
    moment = values.pop("reference_moment", None)
    if moment is not None:
        moment = positive_number("limits.reference_moment", moment)
    try:
        return MotionLimits(**values), moment
    except InputError as error:
        raise InputError(f"limits.{error}") from None


def _joint(where: str, item: object, names: tuple[str, ...]) -> int:
    """Number of a joint, from 0, given by name or by number from 1."""
    if is_whole(item) and 1 <= item <= len(names):
        return item - 1
    if isinstance(item, str) and item in names:
        return names.index(item)
    raise InputError(f"{where}: no joint {item!r}; there are 1 to {len(names)}: {', '.join(names)}")
