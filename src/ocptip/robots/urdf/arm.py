"""An arm out of any URDF, read by Pinocchio: from a base link to a tool frame, other joints locked."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, finite_array, number_from
from ocptip.basics.text import did_you_mean
from ocptip.robots.coupling import Coupling
from ocptip.robots.model import ArmModel, JointLimits
from ocptip.robots.pinocchio import PinocchioModel, load_pinocchio
from ocptip.robots.urdf.file import UrdfFile, read_urdf
from ocptip.robots.urdf.parser import pinocchio_model
from ocptip.robots.urdf.sanity import doubt_arm, refuse_impossible_links

_NO_LIMIT = 1e30  # Pinocchio writes the largest float where a URDF gives no limit


def arm_from_urdf(
    path: str | os.PathLike[str],
    *,
    base_link: str | None = None,
    tool_frame: str | None = None,
    locked_joints: Mapping[str, float] | None = None,
    joint_ranges: Mapping[str, tuple[float, float]] | None = None,
    armature: np.ndarray | None = None,
    acceleration: np.ndarray | None = None,
    accept_inertia: bool | Iterable[str] = (),
    follows: Mapping[str, tuple[str, float, float]] | None = None,
) -> ArmModel:
    """Read an arm from a URDF file.

    The arm is everything behind the first free joint of the chain from `base_link` to `tool_frame`; the base
    frame is the frame of `base_link`. What hangs on `base_link`, on its other chains (wheels, head) or on
    joints locked before the first free one (a torso) is not part of the arm: its mass belongs to the base.

    Joints of the arm that are not on the way to `tool_frame` (fingers) do not move. A joint that mimics one
    that does not move stands where that one puts it. On the way to `tool_frame` joints may mimic one that
    moves: that one has the drive (`ArmModel.coupling`).

    Args:
        path: the URDF file; meshes are not read.
        base_link: link that rests; by default `UrdfFile.standing`.
        tool_frame: link behind it; its origin is G, its axes are the gripper axes. By default the link called
            like a tool (`urdf.file.TOOLS`), or the only one at an end.
        locked_joints: joint name to angle, rad (m for sliding joints), of joints that do not move. Those that
            are not in the chain to `tool_frame` are at zero by default, or at the limit next to it.
        joint_ranges: joint name to minimum and maximum angle, rad (m for sliding joints), instead of the
            file's limits. A joint without range, as many files write for one that is out of use, is free with
            others.
        armature: (n,), kg m^2, reflected rotor inertias (rotor inertia times gear ratio squared), which URDF
            cannot hold, of joints that follow no other; zero by default, which underestimates torques at high
            accelerations. See `ArmModel.armature`.
        acceleration: (n,), rad/s^2, limits; by default those of URDF 1.2, infinite where it gives none.
        accept_inertia: links that move without mass, or with an inertia that no body has, and are meant so;
            True: all.
        follows: further joints that mimic others: name to leading joint, ratio and offset, rad or m.

    Returns:
        The arm; angle, speed and torque limits are the file's (a speed or torque limit of zero counts as
        none). Its `notes` say which names and angles were chosen here.

    Raises:
        InputError: the file cannot be read, or a name is not in it (the message lists candidates), or a joint
            of the chain neither turns nor slides nor is locked; or one beside it mimics one that moves; or a
            link that moves has no inertia, or one that no body has.

    Warns:
        InputWarning: masses or lengths that no arm has.
    """
    file = read_urdf(path).with_followers(follows or {})
    base = file.base_link(base_link)
    tool = file.tool_frame(tool_frame, base)
    robot = pinocchio_model(file.path)
    locked = dict(locked_joints or {})
    _require_joints(robot, locked)
    _open(robot, joint_ranges or {})
    ahead = {joint.name for joint in file.way(base)}
    way = [joint.name for joint in file.way(tool) if joint.name not in ahead]
    mimics = _mimics(file, robot, locked, way)
    arm = arm_from_pinocchio(
        robot,
        base_link=base,
        tool_frame=tool,
        locked_joints=locked,
        armature=armature,
        acceleration=acceleration,
        accept_inertia=accept_inertia,
        mimics=mimics,
    )
    changes = {key: _of_chain(file, arm, key) for key in ("acceleration", "jerk")}
    arm = arm.with_limits(**(changes if acceleration is None else {"jerk": changes["jerk"]}))
    doubt_arm(arm)
    chosen = {"base_link": (base_link, base), "tool_frame": (tool_frame, tool)}
    names = [f"{key} {name!r}" for key, (given, name) in chosen.items() if given is None]
    notes = (f"{' and '.join(names)}, not given in the file",) if names else ()
    resting = max(0.0, file.mass - float(np.sum(arm.masses)))
    return dataclasses.replace(arm, notes=(*notes, *arm.notes), base_mass=resting)


def _of_chain(file: UrdfFile, arm: ArmModel, key: str) -> np.ndarray:
    """(n,) limits of the file's joints, which joints that follow others keep as well."""
    values = np.array([getattr(file.joints[name], key) for name in arm.chain_names])
    if arm.coupling is None:
        return values
    scalars = np.full(arm.n, np.inf)
    np.minimum.at(scalars, arm.coupling.leaders, values / np.abs(arm.coupling.ratios))
    return scalars


def arm_from_pinocchio(
    robot: PinocchioModel,
    *,
    base_link: str,
    tool_frame: str,
    locked_joints: Mapping[str, float] | None = None,
    armature: np.ndarray | None = None,
    acceleration: np.ndarray | None = None,
    accept_inertia: bool | Iterable[str] = (),
    mimics: Mimics | None = None,
) -> ArmModel:
    """The arm of a Pinocchio model, whose armature is the default; `base_link` may be "universe".

    Joints that are neither locked nor mimic others nor are in the chain rest near zero.
    """
    _require_joints(robot, locked_joints or {})
    mimics = mimics or Mimics()
    locked = {**(locked_joints or {}), **mimics.locked}
    base = _frame(robot, "base_link", base_link)
    tool = _frame(robot, "tool_frame", tool_frame)
    path = list(robot.supports[robot.frames[tool].parentJoint])
    root = robot.frames[base].parentJoint
    if root not in path:
        raise InputError(f"tool_frame: {tool_frame!r} is not behind base_link {base_link!r}")
    ahead = path[path.index(root) + 1 :]
    free = [j for j in ahead if robot.names[j] not in locked]
    moving = [j for j in free if robot.names[j] in mimics.coupled or not _stuck(robot, j)]
    stuck = {robot.names[j]: _nearest_to_zero(robot, j) for j in free if j not in moving}
    if not moving:
        why = f" (limits leave no way to {', '.join(stuck)})" if stuck else ""
        raise InputError(f"tool_frame: no free joint between {base_link!r} and {tool_frame!r}{why}")
    for joint in moving:
        if robot.joints[joint].nv != 1 or np.linalg.norm(_screw(robot, joint), axis=1).min() > 0.5:
            raise InputError(
                f"joint {robot.names[joint]!r} is a {robot.joints[joint].shortname()}; only joints that turn "
                "or slide can move; take a base_link behind it"
            )
    loose = [j for j in robot.subtrees[moving[0]] if j not in free and robot.names[j] not in locked]
    at_rest = {robot.names[j]: mimics.resting.get(robot.names[j], _nearest_to_zero(robot, j)) for j in loose}
    reduced, (base_at, tool_at) = _reduced(robot, {**stuck, **at_rest, **locked}, moving, (base, tool))
    arm = _arm(reduced, base_at, tool_at, mimics.coupled, armature, acceleration)
    refuse_impossible_links(arm, _links(reduced), accept_inertia)
    reasons = {
        "their limits leave no range (others in [arm.limits], by name, free them)": stuck,
        "not in the chain to the tool": at_rest,
    }
    notes = [_locked_note(why, values) for why, values in reasons.items() if values]
    if arm.coupling is not None:
        notes.append(f"coupled: {arm.coupling.text()}")
    rest = {**stuck, **at_rest, **locked}
    return dataclasses.replace(arm, notes=tuple(notes), base_link=base_link, resting=rest)


@dataclass(frozen=True)
class Mimics:
    """Joints that mimic others: those that rest, and where, on the way to the tool or not; and those that
    follow a joint that moves: its name, ratio and offset."""

    locked: dict[str, float] = field(default_factory=dict)
    resting: dict[str, float] = field(default_factory=dict)
    coupled: dict[str, tuple[str, float, float]] = field(default_factory=dict)


def _mimics(file: UrdfFile, robot: PinocchioModel, locked: Mapping[str, float], way: Sequence[str]) -> Mimics:
    """What becomes of all joints that mimic others and are not locked; `way`: between base and tool."""
    mimics = Mimics()
    for joint in file.joints.values():
        if not joint.mimics or joint.name in locked:
            continue
        leader, ratio, offset = file.leader(joint, locked)
        if leader is None:
            if joint.name in way:
                name = joint.mimics[0]
                raise InputError(
                    f"joint {joint.name!r} mimics {name!r}, which is missing or mimics it as well"
                )
            continue
        number = robot.getJointId(leader.name)
        fixed = leader.kind == "fixed"
        if ratio and not fixed and leader.name in {*way} - {*locked} and not _stuck(robot, number):
            if joint.name not in way:
                raise InputError(
                    f"joint {joint.name!r}, beside the chain to the tool, mimics {leader.name!r}, which "
                    "moves; only couplings within the chain are modelled: lock one of the two (locked_deg, "
                    f"locked_m), or take a tool_frame before it, such as {file.joints[leader.name].parent!r}"
                )
            mimics.coupled[joint.name] = leader.name, ratio, offset
            continue
        position = locked.get(leader.name, 0.0 if fixed else _nearest_to_zero(robot, number))
        (mimics.locked if joint.name in way else mimics.resting)[joint.name] = offset + ratio * position
    return mimics


def _links(robot: PinocchioModel) -> list[list[str]]:
    """Names of the links that move with each joint, the one behind the joint first."""
    bodies = [f for f in robot.frames if f.type == load_pinocchio().FrameType.BODY]
    return [
        [f.name for f in bodies if f.parentJoint == joint] or [robot.names[joint]]
        for joint in range(1, robot.njoints)
    ]


def _locked_note(why: str, values: Mapping[str, float]) -> str:
    by_value: dict[str, list[str]] = {}
    for name, value in values.items():
        by_value.setdefault(f"{value:.4g}", []).append(name)
    groups = [f"{', '.join(names)} at {value}" for value, names in by_value.items()]
    return f"locked, {why}: {'; '.join(groups)} (rad, sliding joints m)"


def _open(robot: PinocchioModel, ranges: Mapping[str, tuple[float, float]]) -> None:
    """Give joints other limits."""
    _require_joints(robot, ranges)
    for name, (low, high) in ranges.items():
        if not low < high:
            raise InputError(f"joint_ranges: {name!r}: {low:.4g} must be below {high:.4g} (rad, m)")
        joint = robot.joints[robot.getJointId(name)]
        if joint.nq == 1:
            robot.lowerPositionLimit[joint.idx_q], robot.upperPositionLimit[joint.idx_q] = low, high


def _stuck(robot: PinocchioModel, index: int) -> bool:
    """Whether a joint's limits leave it no range."""
    joint = robot.joints[index]
    return joint.nq == 1 and robot.lowerPositionLimit[joint.idx_q] == robot.upperPositionLimit[joint.idx_q]


def _nearest_to_zero(robot: PinocchioModel, index: int) -> float:
    """Zero, or the limit next to it."""
    joint = robot.joints[index]
    if joint.nq != 1:
        return 0.0
    low, high = robot.lowerPositionLimit[joint.idx_q], robot.upperPositionLimit[joint.idx_q]
    return float(np.clip(0.0, low, high))


def _reduced(
    robot: PinocchioModel, locked: Mapping[str, float], moving: list[int], wanted: Sequence[int]
) -> tuple[PinocchioModel, list[Any]]:
    """Lock all joints but `moving`; where no angle is given (ahead of the base) it does not matter.

    Returns:
        The model, and where some frames of the whole model lie on its joints.
    """
    pin, robot = load_pinocchio(), robot.copy()
    configuration = pin.neutral(robot)
    for name, value in locked.items():
        angle = number_from(f"locked_joints[{name!r}]", value)
        joint = robot.joints[robot.getJointId(name)]
        if joint.nq == 1:
            configuration[joint.idx_q] = angle
        elif joint.nq == 2 and joint.nv == 1:  # continuous: cosine and sine
            configuration[joint.idx_q : joint.idx_q + 2] = np.cos(angle), np.sin(angle)
        elif angle != 0:
            raise InputError(f"locked_joints: {name!r} has {joint.nv} degrees of freedom, not one")
    others = [joint for joint in range(1, robot.njoints) if joint not in moving]
    # Pinocchio's reduction cannot tell a link from a joint of the same name.
    for number, frame in enumerate(robot.frames):
        if number and frame.type != pin.FrameType.JOINT:  # frame 0 is the universe
            frame.name = f"{number} {frame.name}"
    names = [robot.frames[index].name for index in wanted]
    reduced = pin.buildReducedModel(robot, others, configuration)
    placements = [reduced.frames[reduced.getFrameId(name)].placement for name in names]
    for frame in reduced.frames:
        number, _, name = frame.name.partition(" ")
        frame.name = name if number.isdigit() and name else frame.name
    return reduced, placements


def _arm(
    robot: PinocchioModel,
    base: Any,
    tool: Any,
    coupled: Mapping[str, tuple[str, float, float]],
    armature: np.ndarray | None,
    acceleration: np.ndarray | None,
) -> ArmModel:
    """Convert a model whose joints form one chain; frames are turned so that joint axes become z."""
    n = robot.njoints - 1
    names, slides = tuple(robot.names)[1:], np.array([_slides(robot, index) for index in range(1, n + 1)])
    coupling = Coupling.of(names, slides, coupled) if coupled else None
    leads = np.arange(n) if coupling is None else coupling.leads
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
    rotors = np.array([robot.armature[joint.idx_v] for joint in list(robot.joints)[1:]])
    if coupling is not None:
        rotors = rotors @ coupling.matrix**2
    return ArmModel(
        name=robot.name,
        joint_names=tuple(names[k] for k in leads),
        rotations=np.array(rotations),
        offsets=np.array(offsets),
        masses=np.array([robot.inertias[index].mass for index in range(1, n + 1)]),
        centres=np.array(centres),
        inertias=np.array(inertias),
        limits=_limits(robot, coupling, acceleration),
        tool_rotation=turns[-1].T @ tool.rotation,
        mount_position=placements[0].translation,
        armature=finite_array("armature", rotors if armature is None else armature, (len(leads),)),
        prismatic=slides[leads],
        coupling=coupling,
    )


def _limits(robot: PinocchioModel, coupling: Coupling | None, acceleration: np.ndarray | None) -> JointLimits:
    """Limits of the joints; of those that lead, so that joints that follow keep theirs, but for torques."""
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
    if coupling is not None:
        low, high, speed = coupling.limits(low, high, speed)
        torque, n = torque[coupling.leads], len(coupling.leads)
    limit = np.full(n, np.inf) if acceleration is None else finite_array("acceleration", acceleration, (n,))
    return JointLimits(low, high, speed, limit, torque)


def _screw(robot: PinocchioModel, index: int) -> np.ndarray:
    """(2, 3): along which a joint of one degree of freedom slides, and about which it turns; joint frame."""
    return np.ravel(robot.joints[index].createData().S).reshape(2, 3)


def _slides(robot: PinocchioModel, index: int) -> bool:
    return bool(np.linalg.norm(_screw(robot, index)[0]) > 0.5)


def _axis(robot: PinocchioModel, index: int) -> np.ndarray:
    """Joint axis (3,) in the joint's frame."""
    axis = _screw(robot, index).sum(axis=0)  # one of the two is zero
    return axis / np.linalg.norm(axis)


def _z_onto(axis: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) that turns z onto `axis`; by a permutation where `axis` is a coordinate axis."""
    x = np.roll(np.eye(3)[np.argmax(np.abs(axis))], 1)
    x = x - axis * (axis @ x)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def _frame(robot: PinocchioModel, argument: str, name: str) -> int:
    """Number of a frame; a link goes before the joint, sensor or operational frame of the same name."""
    pin = load_pinocchio()
    kinds = pin.FrameType
    for kind in (kinds.BODY, kinds.OP_FRAME, kinds.FIXED_JOINT, kinds.JOINT):
        for index, frame in enumerate(robot.frames):
            if frame.name == name and frame.type == kind:
                return index
    known = [frame.name for frame in robot.frames if frame.type in (kinds.BODY, kinds.OP_FRAME)]
    raise InputError(f"{argument}: no {name!r}; there are {', '.join(known)}{did_you_mean(name, known)}")


def _require_joints(robot: PinocchioModel, names: Iterable[str]) -> None:
    known = list(robot.names)[1:]
    for name in names:
        if name not in known:
            listed = f"{', '.join(known)}{did_you_mean(name, known)}"
            raise InputError(f"locked_joints: no {name!r}; there are {listed}")
