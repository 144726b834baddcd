"""What rests of a robot in a URDF while its arm moves: where joints stand, mass and centre of mass."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ocptip.numerics.inertia import RigidBody, union
from ocptip.robots.model import ArmModel
from ocptip.robots.pinocchio import PinocchioModel, load_pinocchio
from ocptip.robots.urdf.file import UrdfFile
from ocptip.robots.urdf.parser import pinocchio_model


def resting_configuration(robot: PinocchioModel, arm: ArmModel) -> np.ndarray:
    """The neutral configuration (nq,) with joints that rest, and followers of the arm's joints, in place.

    Args:
        robot: all of the URDF.
        arm: read from it by `arm_from_urdf`.
    """
    coupling, q = arm.coupling, load_pinocchio().neutral(robot)
    followers = {} if coupling is None else dict(zip(coupling.names, coupling.offsets, strict=True))
    for name, value in {**arm.resting, **followers}.items():
        joint = robot.joints[robot.getJointId(name)]
        angle = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        q[joint.idx_q : joint.idx_q + joint.nq] = angle
    return q


def resting_links(file: UrdfFile, arm: ArmModel) -> list[str]:
    """Links that do not move with the arm's joints."""
    moving = {*arm.chain_names}
    return [link for link in file.links if moving.isdisjoint(joint.name for joint in file.way(link))]


def resting_body(urdf: str | os.PathLike[str], arm: ArmModel) -> RigidBody:
    """All links that rest as one body, in the frame of the arm's base link; zeros if they have no mass."""
    pin = load_pinocchio()
    robot = pinocchio_model(Path(urdf))
    data, moving = robot.createData(), {robot.getJointId(name) for name in arm.chain_names}
    pin.framesForwardKinematics(robot, data, resting_configuration(robot, arm))
    to_base = data.oMf[robot.getFrameId(arm.base_link, pin.FrameType.BODY)].inverse()
    whole = 0.0, np.zeros(3), np.zeros((3, 3))
    for joint in range(robot.njoints):  # joint 0 is the universe, to which the root link is fixed
        if moving.isdisjoint(robot.supports[joint]) and robot.inertias[joint].mass > 0:
            body = robot.inertias[joint].se3Action(to_base * data.oMi[joint])
            whole = union(whole, (body.mass, body.lever, body.inertia))
    return whole
