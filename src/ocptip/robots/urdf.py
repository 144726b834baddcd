"""An arm out of any URDF, read by Pinocchio: from a base link to a tool frame, other joints locked."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ocptip.basics.errors import InputError, finite_array, number_from
from ocptip.basics.text import did_you_mean
from ocptip.robots.model import ArmModel, JointLimits
from ocptip.robots.pinocchio import load_pinocchio
from ocptip.robots.sanity import doubt_arm, refuse_impossible_links

if TYPE_CHECKING:
    import pinocchio as pin

_NO_LIMIT = 1e30  # Pinocchio writes the largest float where a URDF gives no limit


def arm_from_urdf(
    path: str | os.PathLike[str],
    *,
    base_link: str,
    tool_frame: str,
    locked_joints: Mapping[str, float] | None = None,
    armature: np.ndarray | None = None,
    acceleration: np.ndarray | None = None,
    accept_inertia: bool | Iterable[str] = (),
) -> ArmModel:
    """Read an arm from a URDF file.

    The arm is everything behind the first free joint on the way from `base_link` to `tool_frame`; the base
    frame is the frame of `base_link`. What hangs on `base_link`, on its other branches (wheels, head) or on
    joints locked before the first free one (a torso) is not part of the arm: its mass belongs to the base.

    Args:
        path: the URDF file; meshes are not read.
        base_link: link that rests.
        tool_frame: any link or frame behind it; its origin is G, its axes are the gripper axes.
        locked_joints: joint name to angle, rad (m for sliding joints). Every joint of the arm that is not on
            the way to `tool_frame` (fingers) must be among them, and so must sliding joints on that way.
        armature: (n,), kg m^2, reflected rotor inertias (rotor inertia times gear ratio squared), which URDF
            cannot hold; zero by default, which underestimates torques at high accelerations. See
            `ArmModel.armature`.
        acceleration: (n,), rad/s^2, limits, which URDF cannot hold; infinite by default.
        accept_inertia: links that move without mass, or with an inertia that no body has, and are meant so;
            True: all.

    Returns:
        The arm; angle, speed and torque limits are the file's (a speed or torque limit of zero counts as
        none).

    Raises:
        InputError: the file cannot be read, or a name is not in it (the message lists those that are), or a
            joint is neither revolute nor continuous nor locked, or a link that moves has no inertia, or one
            that no body has.

    Warns:
        InputWarning: masses or lengths that no arm has.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError(f"{file}: no such file")
    pin = load_pinocchio()
    try:
        robot = pin.buildModelFromUrdf(str(file))
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{file}: not a readable URDF: {error}") from None
    arm = arm_from_pinocchio(
        robot,
        base_link=base_link,
        tool_frame=tool_frame,
        locked_joints=locked_joints,
        armature=armature,
        acceleration=acceleration,
        accept_inertia=accept_inertia,
    )
    doubt_arm(arm)
    return arm


def arm_from_pinocchio(
    robot: pin.Model,
    *,
    base_link: str,
    tool_frame: str,
    locked_joints: Mapping[str, float] | None = None,
    armature: np.ndarray | None = None,
    acceleration: np.ndarray | None = None,
    accept_inertia: bool | Iterable[str] = (),
) -> ArmModel:
    """The same for a Pinocchio model, whose armature is the default; `base_link` may be "universe"."""
    locked = dict(locked_joints or {})
    base = _frame(robot, "base_link", base_link)
    tool = _frame(robot, "tool_frame", tool_frame)
    for name in locked:
        _require_name("locked_joints", name, list(robot.names)[1:])
    path = list(robot.supports[robot.frames[tool].parentJoint])
    root = robot.frames[base].parentJoint
    if root not in path:
        raise InputError(f"tool_frame: {tool_frame!r} is not behind base_link {base_link!r}")
    ahead = path[path.index(root) + 1 :]
    moving = [joint for joint in ahead if robot.names[joint] not in locked]
    if not moving:
        raise InputError(f"tool_frame: no free joint between {base_link!r} and {tool_frame!r}")
    for joint in moving:
        if not _is_revolute(robot, joint):
            raise InputError(
                f"joint {robot.names[joint]!r} is a {robot.joints[joint].shortname()}; only revolute and "
                f"continuous joints can move, lock it by locked_joints={{{robot.names[joint]!r}: ...}}"
            )
    behind = [joint for joint in robot.subtrees[moving[0]] if joint not in ahead]
    loose = [robot.names[joint] for joint in behind if robot.names[joint] not in locked]
    if loose:
        raise InputError(
            f"locked_joints: not on the way from {base_link!r} to {tool_frame!r}, so lock them: "
            f"{', '.join(loose)}"
        )
    reduced = _lock(robot, locked, moving)
    arm = _arm(reduced, base_link, tool_frame, armature, acceleration)
    refuse_impossible_links(arm, _links(reduced), accept_inertia)
    return arm


def _links(robot: pin.Model) -> list[list[str]]:
    """Names of the links that move with each joint, the one behind the joint first."""
    bodies = [f for f in robot.frames if f.type == load_pinocchio().FrameType.BODY]
    return [
        [f.name for f in bodies if f.parentJoint == joint] or [robot.names[joint]]
        for joint in range(1, robot.njoints)
    ]


def _lock(robot: pin.Model, locked: Mapping[str, float], moving: list[int]) -> pin.Model:
    """Lock all joints but `moving`; where no angle is given (ahead of the base) it does not matter."""
    pin = load_pinocchio()
    configuration = pin.neutral(robot)
    for name, value in locked.items():
        angle = number_from(f"locked_joints[{name!r}]", value)
        joint = robot.joints[robot.getJointId(name)]
        if joint.nq == 1:
            configuration[joint.idx_q] = angle
        elif joint.nq == 2 and joint.nv == 1:  # continuous: cosine and sine
            configuration[joint.idx_q : joint.idx_q + 2] = np.cos(angle), np.sin(angle)
        else:
            raise InputError(f"locked_joints: {name!r} has {joint.nv} degrees of freedom, not one")
    others = [joint for joint in range(1, robot.njoints) if joint not in moving]
    return pin.buildReducedModel(robot, others, configuration)


def _arm(
    robot: pin.Model,
    base_link: str,
    tool_frame: str,
    armature: np.ndarray | None,
    acceleration: np.ndarray | None,
) -> ArmModel:
    """Convert a model whose joints form one chain; frames are turned so that joint axes become z."""
    n = robot.njoints - 1
    base = robot.frames[robot.getFrameId(base_link)].placement
    tool = robot.frames[robot.getFrameId(tool_frame)].placement
    joints = list(robot.joints)[1:]
    turns = [_z_onto(_axis(robot, index)) for index in range(1, n + 1)]
    placements = [robot.jointPlacements[index] for index in range(1, n + 1)]
    placements[0] = base.inverse() * placements[0]

    rotations = [placements[0].rotation @ turns[0]]
    offsets, centres, inertias = [], [], []
    for index in range(n):
        back = turns[index].T
        following = placements[index + 1] if index + 1 < n else tool
        offsets.append(back @ following.translation)
        if index + 1 < n:
            rotations.append(back @ following.rotation @ turns[index + 1])
        body = robot.inertias[index + 1]
        centres.append(back @ body.lever)
        inertias.append(back @ body.inertia @ back.T)
    chosen = np.array([robot.armature[j.idx_v] for j in joints]) if armature is None else armature
    return ArmModel(
        name=robot.name,
        joint_names=tuple(robot.names)[1:],
        rotations=np.array(rotations),
        offsets=np.array(offsets),
        masses=np.array([robot.inertias[index].mass for index in range(1, n + 1)]),
        centres=np.array(centres),
        inertias=np.array(inertias),
        limits=_limits(robot, acceleration),
        tool_rotation=turns[-1].T @ tool.rotation,
        mount_position=placements[0].translation,
        armature=finite_array("armature", chosen, (n,)),
    )


def _limits(robot: pin.Model, acceleration: np.ndarray | None) -> JointLimits:
    joints = list(robot.joints)[1:]
    n = len(joints)
    low, high = np.full(n, -np.inf), np.full(n, np.inf)
    for index, joint in enumerate(joints):
        if joint.nq == 1:
            low[index], high[index] = (
                robot.lowerPositionLimit[joint.idx_q],
                robot.upperPositionLimit[joint.idx_q],
            )
    low[low < -_NO_LIMIT], high[high > _NO_LIMIT] = -np.inf, np.inf
    order = [joint.idx_v for joint in joints]
    speed, torque = (
        np.where((value <= 0) | (value > _NO_LIMIT), np.inf, value)
        for value in (robot.upperVelocityLimit[order], robot.upperEffortLimit[order])
    )
    limit = np.full(n, np.inf) if acceleration is None else finite_array("acceleration", acceleration, (n,))
    return JointLimits(low, high, speed, limit, torque)


def _is_revolute(robot: pin.Model, index: int) -> bool:
    joint = robot.joints[index]
    if joint.nv != 1:
        return False
    subspace = joint.createData().S
    return bool(np.allclose(np.ravel(subspace)[:3], 0) and np.linalg.norm(np.ravel(subspace)[3:]) > 0.5)


def _axis(robot: pin.Model, index: int) -> np.ndarray:
    """Joint axis (3,) in the joint's frame."""
    axis = np.ravel(robot.joints[index].createData().S)[3:]
    return axis / np.linalg.norm(axis)


def _z_onto(axis: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) that turns z onto `axis`; by a permutation where `axis` is a coordinate axis."""
    x = np.roll(np.eye(3)[np.argmax(np.abs(axis))], 1)
    x = x - axis * (axis @ x)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def _frame(robot: pin.Model, argument: str, name: str) -> int:
    pin = load_pinocchio()
    bodies = [f.name for f in robot.frames if f.type == pin.FrameType.BODY]
    if argument == "base_link":
        known: Iterable[str] = [*bodies, "universe"]
    else:
        known = [f.name for f in robot.frames if f.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME)]
    if name in [f.name for f in robot.frames]:
        return robot.getFrameId(name)
    _require_name(argument, name, list(dict.fromkeys(known)))
    return robot.getFrameId(name)


def _require_name(argument: str, name: str, known: list[str]) -> None:
    if name not in known:
        raise InputError(f"{argument}: no {name!r}; there are {', '.join(known)}{did_you_mean(name, known)}")
