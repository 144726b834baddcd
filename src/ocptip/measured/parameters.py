"""Loads of an arm on its base, linear in the inertial parameters of its bodies, by Pinocchio's regressors.

A body has ten parameters in which all loads are linear: mass m; first moments m c (3,), kg m; and moments of
inertia about the origin of its frame, xx, xy, yy, xz, yz, zz, kg m^2. Body 0 is the base, in base axes;
body i is link i, in frame i of the arm.
"""

from __future__ import annotations

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.numerics.inertia import RigidBody, parallel_axis, pseudo_inertia
from ocptip.numerics.vectors import skew
from ocptip.robots.model import ArmModel
from ocptip.robots.pinocchio import load_pinocchio
from ocptip.standing.arm import Robot
from ocptip.standing.sensor import WrenchSensor

PER_BODY = 10
_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Names of the parameters of a body."""


def parameters_of(body: RigidBody) -> np.ndarray:
    """(10,) of a body by its mass, centre and inertia about that."""
    mass, centre, inertia = body
    about = inertia + parallel_axis(mass, np.asarray(centre))
    return np.concatenate([[mass], mass * np.asarray(centre), [about[place] for place in _PLACES]])


def body_of(parameters: np.ndarray) -> RigidBody:
    """The body of parameters (10,) with a mass."""
    mass = float(parameters[0])
    centre = parameters[1:4] / mass
    return mass, centre, _about_origin(parameters) - parallel_axis(mass, centre)


def _about_origin(parameters: np.ndarray) -> np.ndarray:
    """(3, 3) the inertia among parameters (10,)."""
    about = np.empty((3, 3))
    for place, value in zip(_PLACES, parameters[4:], strict=True):
        about[place] = about[place[::-1]] = value
    return about


def link_parameters(arm: ArmModel) -> np.ndarray:
    """(10 L,) of all links, with what is held."""
    bodies = zip(arm.masses, arm.centres, arm.inertias, strict=True)
    return np.concatenate([parameters_of((float(m), c, tensor)) for m, c, tensor in bodies])


def regressors(
    arm: ArmModel, gravity: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The regressors of torques and of the wrench on the base, which rests, per parameter.

    Args:
        arm: without joints that follow others.
        gravity: (3,), m/s^2, base axes.
        q, qd, qdd: (N, n) joint values, speeds and accelerations.

    Returns:
        (N, n, 10 L) of the torques without rotors (`ArmModel.armature`), and (N, 6, 10 (L + 1)) of force and
        moment, about the base's origin, by base and arm on what is below, base axes.

    Raises:
        InputError: joints follow others, or Pinocchio is missing.
    """
    if arm.coupling is not None:
        raise InputError("parameters of arms with joints that follow others are not identified")
    pin = load_pinocchio()
    model = pin.Model()
    model.gravity.linear = np.array(gravity, dtype=float)
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    place = pin.SE3(arm.mount_rotation @ arm.rotations[0], np.array(arm.mount_position))
    for k in range(arm.links):
        if k:
            place = pin.SE3(np.array(arm.rotations[k]), np.array(arm.offsets[k - 1]))
        kind = pin.JointModelPZ() if arm.slides[k] else pin.JointModelRZ()
        joint = model.addJoint(joint, kind, place, f"joint {k + 1}")
    data, still = model.createData(), np.zeros(6)
    first = pin.neutral(model)[:7]
    values = np.empty((len(q), 6 + arm.n, PER_BODY * (arm.links + 1)))
    for k, (angles, speeds, changes) in enumerate(zip(q, qd, qdd, strict=True)):
        values[k] = pin.computeJointTorqueRegressor(
            model, data, np.concatenate([first, angles]), np.concatenate([still, speeds]),
            np.concatenate([still, changes]),
        )  # fmt: skip
    return values[:, 6:, PER_BODY:], -values[:, :6]


def process_loads(robot: Robot, q: np.ndarray, process: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torques (N, n) and wrench on the base (N, 6, 1), as of `regressors`, of what acts on the gripper.

    `process` is what it is, (N, 6), if it varies.
    """
    still, none = np.zeros_like(q), np.zeros(3)
    dynamics = robot.pushed(robot.arm, q, still, still, process, gravity=none, about=none)
    return dynamics.torque, dynamics.wrench[:, :, None]


def on_sensor(sensor: WrenchSensor, wrenches: np.ndarray) -> np.ndarray:
    """(N, 6, K) in sensor axes about its position, of wrenches about the base's origin in base axes."""
    move = np.block([[np.eye(3), np.zeros((3, 3))], [-skew(sensor.position), np.eye(3)]])
    return np.kron(np.eye(2), sensor.rotation.T) @ move @ wrenches


def pseudo_of(parameters: np.ndarray) -> np.ndarray:
    """(4, 4) the pseudo-inertia of parameters (10,)."""
    return pseudo_inertia(float(parameters[0]), parameters[1:4], _about_origin(parameters))


def of_pseudo_inertia(pseudo: np.ndarray) -> np.ndarray:
    """(10,) parameters of a pseudo-inertia (4, 4): the inverse of `pseudo_of`."""
    about = np.trace(pseudo[:3, :3]) * np.eye(3) - pseudo[:3, :3]
    return np.concatenate([[pseudo[3, 3]], pseudo[:3, 3], [about[place] for place in _PLACES]])


def moved_parameters(rotation: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """(10, 10): parameters of a body in a frame in which the frame of the body has this rotation and origin,
    m.
    """
    move = np.eye(4)
    move[:3, :3], move[:3, 3] = rotation, origin
    return np.array([of_pseudo_inertia(move @ pseudo_of(unit) @ move.T) for unit in np.eye(PER_BODY)]).T
