"""Motion tasks from TOML files: any arm, or a parallel robot, on any support.

A task file is a scene file (docs/scenes.md: `gravity`, `[base]`, `[[contact]]`; the base without the arm)
plus these tables. SI units; keys in degrees say so. Joints are counted from 1.

    name = "..."                optional, default: the file's name

    [arm]
    name = "FP1W2F"             one of the modular arms, or
    urdf = "arm.urdf"           a file, relative to the task file, with
    base_link, tool_frame       names in it, and optionally
    locked_deg, locked_m        tables joint = angle or way, see `ocptip.robots.arm_from_urdf`
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
                                see `ocptip.motion.PlatformLimits`

    [motors]                    modular arms: optional, default kind = "modular"
    kind                        "modular" (measured power maps), "estimated" (standby, regeneration) or "dc"
                                (motor_constant or resistance, torque_constant, gear_ratio; coulomb, viscous,
                                standby, regeneration): see `ocptip.robots.DCMotors`

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
collision (if there is none: the shortest; :func:`refusals` then says what is wrong). Angles that limits allow
more than once are taken near zero in the start and near the start in the goal.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.errors import InputError, finite_array, positive_number
from ocptip.motion.motor_table import MOTOR_KEYS, dc_motors
from ocptip.motion.parallel_robot import StandingParallelRobot
from ocptip.motion.parallel_table import parallel_robot
from ocptip.motion.proof import MotionLimits
from ocptip.motion.robot import StandingRobot
from ocptip.motion.standing import StandingMechanism
from ocptip.motion.task import MotionTask, is_whole, posture_refusals
from ocptip.robots import (
    ArmModel,
    DCMotors,
    Motors,
    Pillar,
    PowerMaps,
    Wall,
    arm_from_urdf,
    floor,
    load_arm,
    solve_inverse_kinematics,
    spheres_along_links,
)
from ocptip.scene import scene_from_dict
from ocptip.tables import (
    direction_at,
    number_at,
    per_joint_at,
    read_toml,
    refuse_non_numbers,
    refuse_unknown,
    required,
    rpy_at,
    subtable,
    subtables,
    text_at,
    vector_at,
    with_place,
)

_SCENE = ("gravity", "base", "contact")
_TABLES = ("name", *_SCENE, "arm", "robot", "motors", "obstacle", "motion", "limits")
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
        arm = _arm(subtable(data, "arm"), path.parent)
        robot = StandingRobot(
            arm,
            scene.support,
            _motors(data, arm),
            obstacles=_obstacles(subtables(data, "obstacle"), arm),
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
    if not is_whole(commands) or commands < 1:
        raise InputError(f"motion.commands: must be a whole number >= 1, got {commands!r}")
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
        raise InputError(
            f"motion.{angles}: expected either {angles} or {pose}, got {_how_many(angles in table)}"
        )
    if angles in table:
        return np.deg2rad(vector_at(f"motion.{angles}", table[angles], arm.n))[None]
    where, given = f"motion.{pose}", table[pose]
    if not isinstance(given, dict):
        raise InputError(f"{where}: expected a table with position and rpy_deg or rotation, got {given!r}")
    refuse_unknown(given, ("position", "rpy_deg", "rotation"), f"{where}.")
    if ("rpy_deg" in given) == ("rotation" in given):
        both = _how_many("rotation" in given)
        raise InputError(f"{where}.rpy_deg: expected either rpy_deg or rotation, got {both}")
    position = vector_at(f"{where}.position", required(given, "position", where), 3)
    if "rpy_deg" in given:
        rotation = rpy_at(f"{where}.rpy_deg", given["rpy_deg"])
    else:
        refuse_non_numbers(f"{where}.rotation", given["rotation"])
        rotation = finite_array(f"{where}.rotation", given["rotation"], (3, 3))
    return with_place(where, solve_inverse_kinematics, arm, position, rotation).branches


def _shortest(
    robot: StandingRobot, limits: MotionLimits, starts: np.ndarray, goals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Start and goal, (n,), rad, of all pairs, by the rule of the module; ties by order."""
    arm = robot.arm.limits
    if len(starts) == len(goals) == 1:
        return starts[0], goals[0]
    usable = [[not posture_refusals(robot, limits, q) for q in candidates] for candidates in (starts, goals)]
    weights = 1 / np.where(np.isfinite(arm.speed), arm.speed, 1.0)
    ranked = []
    for s, start in enumerate(starts):
        for g, goal in enumerate(goals):
            near = goal
            if len(goals) > 1:  # a pose: angles may be whole turns away
                turned = goal + 2 * np.pi * np.round((start - goal) / (2 * np.pi))
                near = np.where((turned >= arm.angle_min) & (turned <= arm.angle_max), turned, goal)
            way = float(np.abs(near - start) @ weights)
            ranked.append((not (usable[0][s] and usable[1][g]), way, len(ranked), start, near))
    return min(ranked, key=lambda entry: entry[:3])[3:]


def _arm(table: dict[str, Any], folder: Path) -> ArmModel:
    kinds = [key for key in ("name", "urdf") if key in table]
    if len(kinds) != 1:
        raise InputError(f"arm.urdf: expected either name or urdf, got {_how_many(bool(kinds))}")
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


def _motors(data: dict[str, Any], arm: ArmModel) -> Motors:
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
        return PowerMaps.modular()
    if kind == "estimated":
        values = {key: number_at(f"motors.{key}", value) for key, value in table.items() if key != "kind"}
        return with_place("motors", DCMotors.estimated, arm, **values)
    return dc_motors(table, arm.n)


def _obstacles(tables: list[dict[str, Any]], arm: ArmModel) -> list[Wall | Pillar]:
    if tables and not arm.sphere_sets:
        raise InputError("obstacle: the arm has no collision spheres to check; give arm.sphere_radius")
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


def _how_many(any_given: bool) -> str:
    return "both" if any_given else "none"
