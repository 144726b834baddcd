"""Joints in task files: their values, and which of a URDF do not move, follow others, or are opened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from typing import get_args

import numpy as np

from ocptip.basics import schema
from ocptip.basics.errors import doubt
from ocptip.basics.schema import DEGREES, REQUIRED, Key, Keys
from ocptip.basics.text import did_you_mean
from ocptip.basics.toml import Table
from ocptip.motion.choices import postures_of
from ocptip.motion.task import REACHED
from ocptip.robots.inverse.pose_search import Orientation
from ocptip.robots.inverse.pose_target import AXES, PoseTarget
from ocptip.robots.model import ArmModel
from ocptip.robots.urdf.file import UrdfFile
from ocptip.robots.urdf.joint_limits import values_of_state
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism


def joint_values(table: Table, key: str, arm: ArmModel, *, slides: bool) -> np.ndarray | None:
    """Values of the turning or of the sliding joints, in their order.

    Args:
        table: that may hold the key.
        key: of a number, a list or a table; a name in it goes before a pattern.
        arm: whose joints.
        slides: of the sliding joints; else of the turning ones.

    Returns:
        (k,), NaN for joints that a table does not name; None if there is no such key.

    Raises:
        InputError: no such joint, a wrong number of them, or a value that cannot be used.
    """
    names = [
        name
        for name, slides_here in zip(arm.joint_names, arm.prismatic, strict=True)
        if slides_here == slides
    ]
    value = table.value(key)
    if value is None:
        return None
    if not names:
        raise table.error(f"no joint of the arm {'slides' if slides else 'turns'}", key)
    if isinstance(value, dict):
        return _by_name(table.table(key), names)
    if isinstance(value, list) and len(value) != len(names) < arm.n:
        raise table.error(f"expected {len(names)} numbers ({', '.join(names)}), got {len(value)}", key)
    return table.get(key, size=len(names))


def _by_name(table: Table, names: Sequence[str]) -> np.ndarray:
    scalars = np.full(len(names), np.nan)
    for pattern in sorted(table, key=lambda joint_name: joint_name in names):
        value = table[pattern]
        fitting = [index for index, name in enumerate(names) if fnmatchcase(name, pattern)]
        if not fitting:
            raise table.error(
                f"no such joint; there are {', '.join(names)}{did_you_mean(pattern, names)}", pattern
            )
        scalars[fitting] = value
    return scalars


LOCKED = {"locked_deg": False, "locked_m": True}
"""Keys of joints that do not move: whether these are sliding joints."""


def _locked(unit: str, which: str) -> schema.Key:
    return schema.table(
        Keys(
            f"locked in {unit}",
            f"Values of {which} joints that do not move, by names or patterns such as `finger_*`.",
            others=schema.number("Value of these joints.", unit),
        ),
        default=None,
    )


_COUPLING = Keys(
    "coupling",
    "The joint that a joint follows, whose drive moves both.",
    {
        "joint": schema.text("The joint that leads."),
        "ratio": schema.number("Value of the joint per value of the leading one.", default=1.0),
        "offset_deg": schema.number("Value of a turning joint, leading one at 0.", "deg", default=0.0),
        "offset_m": schema.number("Value of a sliding joint, leading one at 0.", "m", default=0.0),
    },
    at_most_one=[("offset_deg", "offset_m")],
)
FOLLOWS = schema.table(
    Keys(
        "couplings",
        "Joints that follow others, as `mimic` in the URDF: telescopes, belts.",
        others=schema.table(_COUPLING),
    ),
    default=None,
)
LOCKED_KEYS = {"locked_deg": _locked("deg", "turning"), "locked_m": _locked("m", "sliding")}


def followers_of(table: Table, file: UrdfFile) -> dict[str, tuple[str, float, float]]:
    """Joints that follow others: by name the leading one, ratio and offset, rad or m."""
    couplings, result = table.table("follows"), dict[str, tuple[str, float, float]]()
    for name in couplings:
        follower = couplings.table(name)
        for joint, key in ((name, None), (follower["joint"], "joint")):
            if joint not in file.joints or file.joints[joint].kind == "fixed":
                known = [one.name for one in file.joints.values() if one.kind != "fixed"]
                raise (couplings if key is None else follower).error(
                    f"no joint {joint!r} that moves{did_you_mean(joint, known)}", key or name
                )
        key = "offset_m" if file.joints[name].slides else "offset_deg"
        if wrong := [other for other in ("offset_m", "offset_deg") if other in follower and other != key]:
            raise follower.error(
                f"{name!r} {'slides' if key == 'offset_m' else 'turns'}, its key is {key}", wrong[0]
            )
        result[name] = follower["joint"], follower["ratio"], follower[key]
        if not result[name][1]:
            raise follower.error("must not be 0; lock the joint instead (locked_deg, locked_m)", "ratio")
        follower.close()
    couplings.close()
    return result


def ranges_of(table: Table, file: UrdfFile, locked: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Both limits, rad and m, of joints that `[arm.limits]` names; they free a joint that the URDF holds."""
    limits, result = table.value("limits", {}), dict[str, tuple[float, float]]()  # read by `_with_limits`
    for keys in (("angle_min_deg", "angle_max_deg"), ("position_min_m", "position_max_m")):
        ends = [limits.get(key) for key in keys] if isinstance(limits, dict) else []
        ends = [end for end in ends if isinstance(end, dict)]
        if len(ends) < len(keys):
            continue
        for name in set(file.joints).intersection(*ends) - set(locked):
            values = [end[name] for end in ends]
            if all(isinstance(value, int | float) for value in values):
                if not values[0] < values[1]:
                    text = f"{keys[0]} {values[0]:g} must be below {keys[1]} {values[1]:g}"
                    raise table.error(f"{name}: {text}", "limits")
                scale = DEGREES if keys[0].endswith("deg") else 1.0
                result[name] = scale * values[0], scale * values[1]
    return result


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
    if (arm := robot.arm) is None:
        return table.get(key, REQUIRED, size=robot.n)[None], None
    target = read_target(arm, table, key)
    if target is None:
        return given_angles(arm, table, key), None
    with table.table(f"{key}_pose").at(pose=""):
        postures = postures_of(arm, target, limits)
    far, turn = target.misses(arm, postures).max(axis=0)
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
    for key_given, slides in _angle_keys(arm, key).items():
        joints = arm.prismatic == slides
        if key_given not in table:
            table.one_of(key_given, f"{key}_pose")  # complains
        q[joints] = joint_values(table, key_given, arm, slides=slides)
        if lacking := [arm.joint_names[j] for j in np.flatnonzero(joints & np.isnan(q))]:
            raise table.error(f"no value for {', '.join(lacking)}", key_given)
    return q[None]


def _angle_keys(arm: ArmModel, key: str) -> dict[str, bool]:
    """Keys of the values of start or goal, as far as there are such joints; whether the joints slide."""
    keys = {f"{key}_deg": False, f"{key}_m": True}
    return {key_given: slides for key_given, slides in keys.items() if (arm.prismatic == slides).any()}


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
        free = np.array([ranges[axis_name] for axis_name in AXES])
        ranges.close()
        with given.at():
            return PoseTarget(position, rotation, axis, fold, orientation, tool_axis, free)
