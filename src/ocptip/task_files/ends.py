"""Start and goal of a motion, and waypoints: values of joints or a pose of the gripper."""

from __future__ import annotations

from typing import get_args

import numpy as np

from ocptip.basics import schema
from ocptip.basics.errors import doubt
from ocptip.basics.schema import REQUIRED, Key, Keys
from ocptip.basics.toml import Table
from ocptip.motion.postures import postures_of
from ocptip.motion.task import REACHED
from ocptip.robots.inverse.pose_search import Orientation
from ocptip.robots.inverse.pose_target import AXES, PoseTarget
from ocptip.robots.joint_limits import values_of_state
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.task_files.joints import joint_values

_FREE = Keys(
    "free",
    "Ranges of the TCP about the position, base axes; each contains 0.",
    {axis: schema.vector(f"Range along {axis}.", "m", 2, default=[0, 0]) for axis in AXES},
)
POSE = Keys(
    "pose",
    "A pose of the gripper.",
    {
        "position": schema.vector("Position of the TCP, base axes.", "m", 3),
        **schema.rotation("Axes of the gripper to those of the base", default="required"),
        "symmetric_about": schema.text("Axis of the gripper about which it may turn.", otherwise="none"),
        "fold": schema.anything(
            "How many turns about that axis look the same; 0: any turn.",
            "whole number",
            {"type": "integer", "minimum": 0},
            default=0,
        ),
        "orientation": schema.choice(
            "What of the orientation counts; `axis`: the direction of `tool_axis`.",
            get_args(Orientation),
            default="full",
        ),
        "tool_axis": schema.direction("Direction that counts, gripper axes.", default=[0, 0, 1]),
        "free": schema.table(_FREE, default=None),
    },
)


def end_keys(end: str, name: str) -> dict[str, Key]:
    """Keys of a start, a goal or a waypoint of an arm."""
    other = f"the other keys of the {name}"
    return {
        f"{end}_deg": schema.by_joint(
            f"Values of turning joints at the {name}.", "deg", single=False, otherwise=other
        ),
        f"{end}_m": schema.by_joint(
            f"Values of sliding joints at the {name}.", "m", single=False, otherwise=other
        ),
        f"{end}_pose": schema.table(POSE, f"Pose of the gripper at the {name}, base axes.", default=None),
        end: schema.text(f"State of the SRDF that is the {name}.", otherwise=other),
    }


def read_end(
    robot: StandingMechanism, table: Table, key: str, limits: Limits
) -> tuple[np.ndarray, PoseTarget | None]:
    """Postures (k, n) of a start or a goal, and the pose they are postures of, if it is one."""
    if not isinstance(robot, Robot):
        return table.get(key, REQUIRED, size=robot.n)[None], None
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


def given_angles(arm: ArmModel, table: Table, key: str) -> np.ndarray:
    """Joint angles (1, n), rad (sliding joints: m), that are given."""
    if isinstance(table.value(key), str):
        table.one_of(*_angle_keys(arm, key), f"{key}_pose", key)
        name = table[key]
        with table.at(key):
            return values_of_state(arm, arm.states, name)[None]
    q = np.full(arm.n, np.nan)
    for own, slides in _angle_keys(arm, key).items():
        joints = arm.prismatic == slides
        if own not in table:
            table.one_of(own, f"{key}_pose")  # complains
        q[joints] = joint_values(table, own, arm, slides=slides)
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
    table.one_of(*_angle_keys(arm, key), pose, *([key] if isinstance(table.value(key), str) else []))
    with table.table(pose) as given:
        position, rotation = given["position"], given.rotation()
        axis, fold = given.get("symmetric_about", ""), given["fold"]
        orientation, tool_axis = given["orientation"], given["tool_axis"]
        ranges = given.table("free")
        free = np.array([ranges[own] for own in AXES])
        ranges.close()
        with given.at():
            return PoseTarget(position, rotation, axis, fold, orientation, tool_axis, free)
