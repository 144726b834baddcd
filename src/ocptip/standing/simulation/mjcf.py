"""An arm on its base as a MuJoCo model (MJCF): free base, feet on the ground, arm, rotors, payload, motion.

World axes are the base axes at the start. All masses are the model's, see `bodies`; a compliant foot is a
small body on springs, whose mass is taken from the base. What presses a clamp with a constant force is a body
that slides along the normal, pushed by a spring of almost constant force.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.contact.support import Support
from ocptip.numerics.inertia import RigidBody, parallel_axis
from ocptip.robots.bodies import ArmBodies, exists, real_bodies
from ocptip.robots.model import ArmModel
from ocptip.robots.payload import Payload
from ocptip.robots.simulators import (
    RIGID,
    SENSOR,
    SOLE,
    STEP,
    add,
    inertial,
    quaternion,
    text,
    upright,
)
from ocptip.standing.arm import Robot
from ocptip.standing.elastic.steps import Modes
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.objects import GRIPPER
from ocptip.standing.parts import Part
from ocptip.standing.simulation.objects import OBJECT_BODY, add_objects, object_states
from ocptip.standing.simulation.world import jaws_of, sliding_jaws
from ocptip.trajectories.trajectory import Trajectory

BASE, PAYLOAD, PROCESS = "base", "payload", "process"
_COMPONENTS = tuple(f"{PROCESS} {what} {axis}" for what in ("force", "moment") for axis in "xyz")
_AXES = "base axes"  # at the start: those of the world
FOOT_BODY = "foot"  # begins the name of a compliant foot
FOOT = 0.03  # mass of a compliant foot over that of the base, from which it is taken
JAW_BODY = "jaw"  # begins the name of what presses a clamp
JAW = 0.03  # its mass over that of the base; gravity does not act on it
_KEYS = 0.02  # s between keyframes
_SERVO = 2 * np.pi * 20.0  # rad/s: natural frequency of the actuators
_POINT = 1e-9  # kg m^2: moments of a point mass
_CONSTANT = 1e-9  # 1/rad, 1/m: relative stiffness of a spring of almost constant torque
_LEVER = {"solref": "0.0005 1", "solimp": "0.99 0.99 0.001 0.5 2"}  # stiffer than soles, or jaws ring
NO_SLIP = 5  # iterations with objects: soft friction creeps by 0.2 mm in a motion of two seconds
ON_SPRINGS = {"solref": [2 * STEP, 1.0], "solimp": [0.97, 0.97, 1e-3, 0.5, 2.0]}
"""Contact of a sole on springs, which is lighter."""


def require_exportable(robot: StandingMechanism) -> Robot:
    """The robot as an arm that a simulator can have.

    Raises:
        InputError: it is a parallel robot, its base drives, or a contact has no model.
    """
    robot = Robot.of(
        robot, f"only arms are exported with their base, not a {robot.kind} (see ocptip parallel --mjcf)"
    )
    if robot.drive_profile is not None:
        raise InputError("drive_profile: simulations are of a base that rests, not of one that drives")
    if robot.objects and robot.support.elastic is not None:
        raise InputError("object: simulations with objects are of stiff feet, not of compliant ones")
    for number, contact in enumerate(robot.support.contacts):
        jaws_of(contact, number)
    return robot


def to_mjcf(
    robot: StandingMechanism, motion: Trajectory | None = None, *, name: str = "ocptip", begin: float = 0.0
) -> str:
    """The robot on its base, and its motion as keyframes, whose controls are the actuators' references.

    Args:
        robot: an arm on feet, which may give, or in clamps, rigid or with one jaw of constant force.
        motion: of it; None: the model alone, at joint values 0.
        name: of the model.
        begin: s, time of the first keyframe.

    Raises:
        InputError: there is no model for a simulator of its links or of a contact.
    """
    loaded = require_exportable(robot if motion is None else robot.during(motion))
    robot = loaded.without_objects()
    start = motion.start if motion else np.zeros(robot.n)
    root = ET.Element("mujoco", model=name)
    root.append(ET.Comment(f" {'; '.join(remarks_of(loaded))} "))
    _settings(root, loaded)
    world = add(root, "worldbody")
    add(world, "site", name=_AXES)
    add(world, "light", pos="1 -1 3", dir="-0.3 0.3 -1", directional="true")
    base = _base(world, robot.support)
    contact, sensors, equality = (ET.Element(name) for name in ("contact", "sensor", "equality"))
    _feet(world, base, contact, sensors, equality, robot, start)
    bodies = real_bodies(robot.arm)
    link = _arm(base, robot, bodies)
    add_objects(root, {BASE: base, GRIPPER: link}, contact, sensors, loaded, start)
    root.append(contact)
    _drives(root, equality, robot, bodies, start)
    root.append(sensors)
    _keyframes(root, loaded, bodies, motion, begin)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def remarks(parts: Sequence[Part]) -> list[str]:
    """The differences between the models and the robot's data, in sentences without full stops."""
    result = dict.fromkeys(remark for part in parts for remark in remarks_of(part.robot))
    segments = (
        "a model per segment, with what it holds; joints and states are the same, so each goes on with the "
        "state in which the one before ended: what the gripper takes or leaves comes and goes at once"
    )
    return [*result, *([segments] if len(parts) > 1 else [])]


def remarks_of(robot: Robot) -> list[str]:
    """The differences between one model and the robot's data, one sentence each."""
    remarks = [
        "written by ocptip from the robot's data, SI units and radians, world axes are base axes at the start"
    ]
    remarks.append("solref, solimp, the sole's radius and the actuators' gains are numbers for the simulator")
    if robot.support.elastic is not None:
        remarks.append(f"compliant feet are bodies with {FOOT:g} of the base's mass each, taken from it")
    if jaws := sliding_jaws(robot.support):
        numbers = ", ".join(dict.fromkeys(jaw.name.partition("_")[0] for jaw in jaws))
        remarks.append(
            f"jaws that press contact {numbers} are bodies for the simulator; each slides along the normal "
            f"without weight, has {JAW:g} of the base's mass, and a spring or a lever pushes it; springs "
            "without a stiffness have an almost constant force"
        )
    if robot.objects:
        remarks.append(
            f"objects are free bodies {OBJECT_BODY + robot.objects[0].name!r} ... on small spheres; each "
            "touches only what carries it, on 60 x 60 mm around each contact; tendons pull cups"
        )
    if rotors := real_bodies(robot.arm).rotors:
        joints = ", ".join(f"{rotor.joint + 1}" for rotor in rotors)
        remarks.append(
            f"drives of joints {joints} have separate rotors: without them no body has the inertias of these "
            "links; the load on the base is the same, the torque of these joints also moves the rotor"
        )
    if robot.chain is not None:
        remarks.append("gears do not give here")
    if robot.arm.process is not None:
        one = f"the process is actuator {PROCESS!r}, with its nominal load at control 1 (all keyframes)"
        six = f"the process varies: controls of {', '.join(_COMPONENTS)} are what it is; keyframes have it"
        remarks.append(one if robot.varying is None else six)
    if not np.all(robot.arm.with_payload(None).masses):
        remarks.append("a link without mass got 1 percent of the mass before it, on their common axis")
    return remarks


def _settings(root: ET.Element, robot: Robot) -> None:
    add(root, "compiler", angle="radian", autolimits="false", inertiafromgeom="false")
    option = {"timestep": text(STEP), "integrator": "implicitfast", "solver": "Newton", "cone": "elliptic"}
    if robot.objects:
        option["noslip_iterations"] = f"{NO_SLIP}"
    add(root, "option", gravity=text(robot.support.gravity), impratio="10", tolerance="1e-12", **option)
    defaults = add(root, "default")
    add(defaults, "geom", contype="0", conaffinity="0", mass="0", rgba="0.4 0.5 0.6 1")
    numbers = RIGID if robot.support.elastic is None else ON_SPRINGS
    add(defaults, "pair", condim="3", **{key: text(value) for key, value in numbers.items()})


def _base(world: ET.Element, support: Support) -> ET.Element:
    """The base; compliant feet have a part of its mass."""
    mass, inertia = support.mass, np.array(support.inertia)
    if support.elastic is not None:
        for arm in support.arms:
            inertia = inertia - parallel_axis(FOOT * support.mass, arm)
        moved = -FOOT * support.arms.sum(axis=0) / (1 - FOOT * len(support.arms))
        mass = (1 - FOOT * len(support.arms)) * support.mass
        inertia = inertia - parallel_axis(mass, moved)
    else:
        moved = np.zeros(3)
    if not exists((mass, moved, inertia)):
        values = ", ".join(f"{value:.3g}" for value in np.linalg.eigvalsh(inertia))
        raise InputError(f"base: no body has its mass {mass:.4g} kg and principal moments {values} kg m^2")
    base = add(world, "body", name=BASE, pos=text(support.center_of_mass))
    add(base, "freejoint", name=BASE)
    inertial(base, (mass, moved, inertia))
    for arm in support.arms:
        _stick(base, np.zeros(3), arm)
    return base


def springs_of(support: Support) -> np.ndarray:
    """(n, 3) True for the contact axes along which a foot is a joint on a spring.

    Nothing holds a caster's foot across its normal: there it moves with the base, or it would drift away.
    """
    if support.elastic is None:
        return np.zeros((len(support.contacts), 3), dtype=bool)
    return support.elastic.stiffness > 0


def _feet(
    world: ET.Element,
    base: ET.Element,
    contact: ET.Element,
    sensors: ET.Element,
    equality: ET.Element,
    robot: Robot,
    start: np.ndarray,
) -> None:
    """Soles, the ground below each, and what is measured there."""
    support, elastic = robot.support, robot.support.elastic
    delays = np.zeros(len(support.contacts))
    if elastic is not None:
        still = start[None]
        delays = Modes.of(elastic, robot.inertia(still, 0 * still)[0][0]).delays
    for k, binding in enumerate(support.contacts):
        body, place = base, support.arms[k]
        if elastic is not None:
            body = add(base, "body", name=f"{FOOT_BODY}{k + 1}", pos=text(place))
            mass = FOOT * support.mass
            inertial(body, (mass, np.zeros(3), 0.4 * mass * SOLE**2 * np.eye(3)))
            for c in np.flatnonzero(springs_of(support)[k]):
                stiffness = elastic.stiffness[k, c]
                add(
                    body, "joint", name=f"{FOOT_BODY}{k + 1}_{'nst'[c]}", type="slide",
                    axis=text(support.frames[k][:, c]), stiffness=text(stiffness),
                    damping=text(delays[k] * stiffness),
                )  # fmt: skip
            place = np.zeros(3)
        for jaw in jaws_of(binding, k):
            foot, floor = f"{FOOT_BODY}{jaw.name}", f"ground{jaw.name}"
            placing = {"pos": text(binding.position), "quat": text(upright(jaw.normal))}
            grey = {"rgba": "0.8 0.8 0.8 1"}
            if jaw.slides:
                jaw_name = f"{JAW_BODY}{jaw.name}"
                slider = add(world, "body", name=jaw_name, gravcomp="1", **placing)
                joint = add(slider, "joint", name=jaw_name, type="slide", axis="0 0 1")
                _spring(joint, jaw.force, jaw.stiffness)
                if jaw.lever:
                    ends = {"joint1": jaw_name, "joint2": f"{JAW_BODY}{k + 1}"}
                    ratio = text([0.0, jaw.lever, 0.0, 0.0, 0.0])
                    add(equality, "joint", name=jaw_name, **ends, polycoef=ratio, **_LEVER)
                mass = JAW * support.mass
                inertial(slider, (mass, np.zeros(3), 0.4 * mass * SOLE**2 * np.eye(3)))
                # A plane must not move; the face of this box is where the plane would be.
                add(slider, "geom", name=floor, type="box", size="0.03 0.03 0.01", pos="0 0 -0.01", **grey)
            else:
                add(world, "geom", name=floor, type="plane", size="0.1 0.1 0.01", **grey, **placing)
            centre = text(place + SOLE * jaw.normal)
            add(body, "geom", name=foot, type="sphere", size=text(SOLE), pos=centre)
            sliding = text([max(jaw.friction, 1e-5)] * 2 + [1e-3, 1e-5, 1e-5])
            add(contact, "pair", geom1=foot, geom2=floor, friction=sliding)
            seen = text(place - SENSOR * jaw.normal)
            add(body, "site", name=foot, type="sphere", size=text(SOLE), pos=seen, rgba="1 0.6 0 0.5")
            add(sensors, "touch", name=f"{foot}_force", site=foot)
            add(sensors, "framepos", name=f"{foot}_place", objtype="site", objname=foot)


def _arm(base: ET.Element, robot: Robot, bodies: ArmBodies) -> ET.Element:
    """Links, rotors and payload; returns the last link."""
    arm = robot.arm
    armatures = np.zeros(arm.links)
    leads = np.arange(arm.n) if arm.coupling is None else arm.coupling.leads
    armatures[leads] = arm.armature
    parent, place = base, arm.mount_position - robot.support.center_of_mass
    rotation = arm.mount_rotation @ arm.rotations[0]
    for k, link in enumerate(bodies.links):
        _stick(parent, np.zeros(3) if k else place, place)
        if k:
            rotation = arm.rotations[k]
        placing = {"pos": text(place), "quat": text(quaternion(rotation))}
        for rotor in bodies.rotors:
            if rotor.joint == k:
                _rotor(
                    parent,
                    arm.chain_names[k],
                    rotor.mass,
                    rotor.axial,
                    rotor.transverse,
                    placing,
                    rotor.ratio,
                )
        parent = add(parent, "body", name=_link(arm, k), **placing)
        kind = "slide" if arm.slides[k] else "hinge"
        joint = add(
            parent, "joint", name=arm.chain_names[k], type=kind, axis="0 0 1", armature=text(armatures[k])
        )
        if k in leads and arm.has_springs:
            lead = np.flatnonzero(leads == k)[0]
            _spring(joint, float(arm.spring_torque[lead]), float(arm.spring_stiffness[lead]))
        inertial(parent, link)
        place = arm.offsets[k]
    _stick(parent, np.zeros(3), place)
    add(parent, "site", name="gripper", pos=text(place), quat=text(quaternion(arm.tool_rotation)))
    if arm.payload is not None:
        held = add(parent, "body", name=PAYLOAD)
        body = held_body(arm, arm.payload)
        inertial(held, body)
        add(held, "geom", type="sphere", size="0.03", pos=text(body[1]), rgba="0.8 0.4 0.2 1")
    return parent


def _spring(joint: ET.Element, torque: float, stiffness: float) -> None:
    """A spring beside the drive; a constant torque is one of a stiffness that is negligible."""
    stiffness = max(stiffness, _CONSTANT * abs(torque))
    if stiffness:
        joint.set("stiffness", text(stiffness))
        joint.set("springref", text(torque / stiffness))


def held_body(arm: ArmModel, payload: Payload) -> RigidBody:
    """A payload as a body in the frame of an arm's last link; a point gets an inertia, tiny."""
    mass, centre, inertia = payload.seen_from(arm.tool_rotation, arm.offsets[-1])
    return mass, centre, inertia if inertia.any() else _POINT * np.eye(3)


def _rotor(
    parent: ET.Element,
    joint: str,
    mass: float,
    axial: float,
    transverse: float,
    placing: dict[str, str],
    ratio: float,
) -> None:
    body = add(parent, "body", name=f"{joint} rotor", **placing)
    body.append(ET.Comment(f" turns {ratio:.6g} times as fast as {joint} "))
    add(body, "joint", name=f"{joint} rotor", type="hinge", axis="0 0 1")
    inertial(body, (mass, np.zeros(3), np.diag([transverse, transverse, axial])))


def _drives(
    root: ET.Element, equality: ET.Element, robot: Robot, bodies: ArmBodies, start: np.ndarray
) -> None:
    """Gears between joints, and a position servo per joint that leads."""
    arm = robot.arm
    for rotor in bodies.rotors:
        joint = arm.chain_names[rotor.joint]
        gear = text([0.0, rotor.ratio, 0.0, 0.0, 0.0])
        add(equality, "joint", joint1=f"{joint} rotor", joint2=joint, polycoef=gear)
    if (coupling := arm.coupling) is not None:
        for k, joint in enumerate(coupling.names):
            if k not in coupling.leads:
                gear = text([coupling.offsets[k], coupling.ratios[k], 0.0, 0.0, 0.0])
                lead = coupling.leading[coupling.leaders[k]]
                add(equality, "joint", joint1=joint, joint2=lead, polycoef=gear)
    if len(equality):
        root.append(equality)
    still = np.zeros((1, arm.n))
    nothing = np.zeros((1, 6))  # acts, if it varies
    bias = robot.loads(start[None], still, still, nothing)[0][0]
    moving = [robot.loads(start[None], still, row[None], nothing)[0][0] for row in np.eye(arm.n)]
    inertias = np.maximum(np.diag(np.array(moving) - bias), 1e-4)
    inertias = inertias + sum(
        (r.axial * r.ratio**2 * (np.arange(arm.n) == r.joint) for r in bodies.rotors), np.zeros(arm.n)
    )
    actuator = add(root, "actuator")
    for joint, inertia in zip(arm.joint_names, inertias, strict=True):
        gains = {"kp": text(inertia * _SERVO**2), "kv": text(2 * inertia * _SERVO)}
        add(actuator, "position", name=joint, joint=joint, **gains)
    if (process := arm.process) is not None:
        axes = {} if process.turns_with_tool else {"refsite": _AXES}
        gears = zip(_COMPONENTS, np.eye(6), strict=True) if process.varies else [(PROCESS, process.wrench)]
        for name, gear in gears:
            add(actuator, "general", name=name, site="gripper", gear=text(gear), **axes)


def joint_order(robot: Robot, bodies: ArmBodies, values: np.ndarray) -> np.ndarray:
    """Joint values or speeds (..., n) as all joints of the model have them: feet, rotors and links, jaws.

    Offsets of joints that follow others are those of values.
    """
    arm, results = robot.arm, []
    joint_values = values
    if arm.coupling is not None:
        joint_values = values @ arm.coupling.matrix.T
    feet = np.count_nonzero(springs_of(robot.support))
    for k in range(arm.links):
        results += [rotor.ratio * joint_values[..., k] for rotor in bodies.rotors if rotor.joint == k]
        results.append(joint_values[..., k])
    before, after = (np.zeros((*values.shape[:-1], n)) for n in (feet, len(sliding_jaws(robot.support))))
    return np.concatenate([before, np.stack(results, axis=-1), after], axis=-1)


def joint_offsets(robot: Robot, bodies: ArmBodies) -> np.ndarray:
    """The constant part of the joint values beside `joint_order`: offsets of joints that follow others."""
    result = joint_order(robot, bodies, np.zeros(robot.n))
    if (coupling := robot.arm.coupling) is not None:
        index = np.count_nonzero(springs_of(robot.support))
        for k in range(robot.arm.links):
            index += sum(rotor.joint == k for rotor in bodies.rotors)
            result[index] = coupling.offsets[k]
            index += 1
    return result


def _keyframes(
    root: ET.Element, robot: Robot, bodies: ArmBodies, motion: Trajectory | None, begin: float
) -> None:
    frames = add(root, "keyframe")
    times = np.zeros(1)
    q, qd = np.zeros((1, robot.n)), np.zeros((1, robot.n))
    if motion is not None:
        times = np.unique(np.append(np.arange(0.0, motion.end, _KEYS), [*motion.event_times, motion.end]))
        q, qd, _ = motion.states(times)
    rest = [*robot.without_objects().support.center_of_mass, 1, 0, 0, 0]
    places, velocities = object_states(robot, q, qd)
    offsets, process = joint_offsets(robot, bodies), np.ones((len(times), int(robot.arm.process is not None)))
    if robot.varying is not None:
        process = robot.resting(0).process_at_rest[None] if motion is None else robot.acting(times)
    for k, (time, position, speed, acts) in enumerate(zip(times, q, qd, process, strict=True)):
        add(
            frames, "key", name=f"key {k}" if k else "start", time=text(begin + time),
            qpos=text([*rest, *(joint_order(robot, bodies, position) + offsets), *places[k]]),
            qvel=text([*np.zeros(6), *joint_order(robot, bodies, speed), *velocities[k]]),
            ctrl=text([*position, *acts]),
        )  # fmt: skip


def _link(arm: ArmModel, k: int) -> str:
    return f"link {k + 1}"


def _stick(element: ET.Element, start: np.ndarray, end: np.ndarray) -> None:
    """A sketch without mass that touches nothing."""
    if np.linalg.norm(end - start) > 1e-6:
        add(element, "geom", type="capsule", size="0.012", fromto=text([*start, *end]))
