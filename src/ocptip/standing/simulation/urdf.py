"""An arm on its base as URDF: base, feet as frames, links, rotors that follow their joints, payload.

URDF has no friction, no springs, no inertia of drives and no motion; comments in the file say what is left
out.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.robots.bodies import real_bodies
from ocptip.robots.model import ArmModel
from ocptip.robots.simulators import SOLE, add, text, urdf_joint, urdf_link
from ocptip.standing.arm import Robot
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.simulation.mjcf import BASE, PAYLOAD, remarks_of, require_exportable

_POINT = 1e-9  # kg m^2: moments of a point mass


def to_urdf(robot: StandingMechanism, *, name: str = "ocptip") -> str:
    """The robot on its base; the root link is the base, its frame the base axes.

    Raises:
        InputError: there is no model for a simulator of its links or of a contact, or a process acts on its
            gripper, which a URDF cannot have.
    """
    robot = require_exportable(robot)
    if robot.arm.process is not None:
        raise InputError("process: a URDF cannot have one; --mjcf can, or leave it out of the task")
    arm, support, bodies = robot.arm, robot.support, real_bodies(robot.arm)
    root = ET.Element("robot", name=name)
    for remark in [
        *(r for r in remarks_of(robot) if "simulator" not in r and "springs" not in r),
        *_lost(robot),
    ]:
        root.append(ET.Comment(f" {remark} "))
    urdf_link(root, BASE, (support.mass, support.center_of_mass, support.inertia))
    for k, contact in enumerate(support.contacts, 1):
        foot = urdf_link(root, f"foot{k}")
        collision = add(foot, "collision")
        add(collision, "origin", xyz=text(SOLE * np.array([1.0, 0, 0])))
        add(add(collision, "geometry"), "sphere", radius=text(SOLE))
        urdf_joint(
            root, f"contact{k}", "fixed", BASE, f"foot{k}", np.asarray(contact.position), contact.frame
        )
    parent, place, rotation = BASE, arm.mount_position, arm.mount_rotation @ arm.rotations[0]
    for k, body in enumerate(bodies.links):
        if k:
            place, rotation = arm.offsets[k - 1], arm.rotations[k]
        chain_name = arm.chain_names[k]
        for rotor in bodies.rotors:
            if rotor.joint == k:
                moments = np.diag([rotor.transverse, rotor.transverse, rotor.axial])
                urdf_link(root, f"{chain_name} rotor", (rotor.mass, np.zeros(3), moments))
                joint = urdf_joint(
                    root, f"{chain_name} rotor", "continuous", parent, f"{chain_name} rotor", place, rotation
                )
                add(joint, "axis", xyz="0 0 1")
                add(joint, "mimic", joint=chain_name, multiplier=text(rotor.ratio), offset="0")
        urdf_link(root, f"link{k + 1}", body)
        kind = "prismatic" if arm.slides[k] else "revolute"
        joint = urdf_joint(root, chain_name, kind, parent, f"link{k + 1}", place, rotation)
        add(joint, "axis", xyz="0 0 1")
        _limits(joint, arm, k)
        parent = f"link{k + 1}"
    urdf_link(root, "gripper")
    urdf_joint(root, "gripper", "fixed", parent, "gripper", arm.offsets[-1], arm.tool_rotation)
    if (payload := arm.payload) is not None:
        inertia = payload.inertia if payload.inertia.any() else _POINT * np.eye(3)
        urdf_link(root, PAYLOAD, (payload.mass, payload.center_of_mass, inertia))
        urdf_joint(root, PAYLOAD, "fixed", "gripper", PAYLOAD, np.zeros(3), np.eye(3))
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _lost(robot: Robot) -> list[str]:
    """The data that URDF cannot represent, in words."""
    friction = ", ".join(
        f"{getattr(c, 'friction', None) or getattr(c, 'friction_upper', 0):g}" for c in robot.support.contacts
    )
    results = [f"not in this file: friction of the feet ({friction}), the motion, the ground"]
    if any(hasattr(c, "friction_upper") for c in robot.support.contacts):
        results.append(
            "not in this file: jaws of clamps that press the base onto the ground, and their forces"
        )
    if robot.support.elastic is not None:
        results.append("not in this file: springs and dampers of the feet")
    if robot.arm.has_springs:
        results.append("not in this file: springs beside the drives of joints")
    armature = robot.arm.armature
    if armature is not None and np.any(armature):
        values = ", ".join(f"{value:.6g}" for value in armature)
        results.append(f"not in this file: drive inertias of the joints, {values} kg m^2 (kg)")
    return results


def _limits(joint: ET.Element, arm: ArmModel, k: int) -> None:
    """Limits of a joint; those of one that follows another from the limits of its leader."""
    leader, ratio, offset = k, 1.0, 0.0
    if arm.coupling is not None:
        leader, ratio, offset = int(arm.coupling.leaders[k]), arm.coupling.ratios[k], arm.coupling.offsets[k]
        if k not in arm.coupling.leads:
            lead = arm.coupling.leading[leader]
            add(joint, "mimic", joint=lead, multiplier=text(ratio), offset=text(offset))
    limits = arm.limits
    ends = ratio * np.array([limits.angle_min[leader], limits.angle_max[leader]]) + offset
    values = {
        "lower": min(ends),
        "upper": max(ends),
        "velocity": abs(ratio) * limits.speed[leader],
        "effort": limits.torque[leader],
    }
    finite = {key: text(np.clip(value, -1e9, 1e9)) for key, value in values.items()}
    add(joint, "limit", **finite)
