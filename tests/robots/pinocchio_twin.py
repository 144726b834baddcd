"""The same arm as a Pinocchio model, and its dynamics: the independent second opinion of the tests."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ocptip.robots.model import ArmModel


def twin(
    model: ArmModel, *, inertias: np.ndarray | None = None, masses: np.ndarray | None = None
) -> pin.Model:
    """Pinocchio model of an arm. Indefinite inertias pass the setter, not the constructor."""
    inertias = model.inertias if inertias is None else inertias
    masses = model.masses if masses is None else masses
    robot = pin.Model()
    parent = 0
    for i in range(model.n):
        if i == 0:
            placement = pin.SE3(model.mount_rotation @ model.rotations[0], model.mount_position.copy())
        else:
            placement = pin.SE3(model.rotations[i].copy(), model.offsets[i - 1].copy())
        kind = pin.JointModelPZ if model.prismatic[i] else pin.JointModelRZ
        parent = robot.addJoint(parent, kind(), placement, model.joint_names[i])
        body = pin.Inertia(float(masses[i]), model.centres[i].copy(), np.eye(3))
        body.inertia = inertias[i].copy()
        robot.appendBodyToJoint(parent, body, pin.SE3.Identity())
    tool = pin.SE3(model.tool_rotation.copy(), model.offsets[-1].copy())
    robot.addFrame(pin.Frame("G", parent, tool, pin.FrameType.OP_FRAME))
    robot.armature = model.armature.copy()
    return robot


def dynamics(robot, q, qd, qdd, gravity, force, moment, about) -> tuple[np.ndarray, np.ndarray]:
    """Joint torques (n,) and base wrench (6,) of one state, arguments as in `evaluate_dynamics`."""
    data = robot.createData()
    robot.gravity.linear = np.asarray(gravity, dtype=float)
    pin.framesForwardKinematics(robot, data, q)
    tip = data.oMf[robot.getFrameId("G")].translation
    world = pin.Force(np.asarray(force, float), np.asarray(moment, float) + np.cross(tip, force))
    external = pin.StdVec_Force()
    for i in range(robot.njoints):
        external.append(data.oMi[i].actInv(world) if i == robot.njoints - 1 else pin.Force.Zero())
    torque = pin.rnea(robot, data, q, qd, qdd, external).copy()
    on_base = data.oMi[1].act(data.f[1])
    f, m = -on_base.linear, -on_base.angular
    return torque, np.concatenate([f, m - np.cross(about, f)])
