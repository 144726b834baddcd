"""Maximum torques of the drives of an arm within an uncertainty, all joints on time (sliding joints: forces).

A torque is a sum over bodies: the weight of a body times what it asks of the joint, which is linear in
gravity and in the square of the speed factor, and of springs beside the drive. CasADi's derivatives of the
arm's equations of motion give these parts. Their maximum over weights, speed factors, tilts of gravity,
pushes at the TCP and springs has a closed form. Products of deviations are bounded, so that the maximum
is an upper bound.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import casadi as cs
import numpy as np

from ocptip.numerics.batch import BatchFunction
from ocptip.robots.dynamics import newton_euler
from ocptip.robots.kinematics import chain
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import Robot
from ocptip.standing.tolerance import Uncertainty


def maximum_torques(
    robot: Robot,
    tolerance: Uncertainty,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    acting: np.ndarray,
    payload: float | np.ndarray = 1.0,
    tilt: float | np.ndarray = 0.0,
) -> np.ndarray:
    """(N, n): upper bounds of the absolute values of the torques, N m or N.

    Args:
        robot: on its base.
        tolerance: of it.
        q, qd, qdd: (N, n) states.
        acting: (N, k) what acts; see `StandingMechanism.acting`.
        payload: factor of the payload's mass, or one per state, (N,).
        tilt: rad, by which the floor may be tilted besides, or one per state, (N, 1).
    """
    uncertainty_of_payload, arm = tolerance.of(robot.payload), robot.arm.without_process
    pressed, base = robot.acts.split(acting)
    parts, still, none = _parts(arm, base is not None), np.zeros(q.shape), np.zeros(3)
    rests = [none] * (2 * (base is not None))
    pace, push, swing, side, axes = parts(q, qd, qdd, none, *rests)
    pulls = np.stack([parts(q, still, still, axis, *rests)[0] for axis in np.eye(3)])  # (3, N, n, bodies)
    about = robot.support.center_of_mass
    process = robot.pushed(robot.arm, q, still, still, pressed, gravity=none, about=about).torque
    loose = uncertainty_of_payload.springs * np.abs(arm.spring_torque - arm.spring_stiffness * q)
    low, high = _weights(arm, uncertainty_of_payload, np.asarray(payload, dtype=float)[..., None])
    # One column, so that weights of single states multiply like those of all.
    mean, half = 0.5 * (low + high)[..., None], 0.5 * (high - low)[..., None]
    gravity = robot.support.gravity
    size, paces = (
        np.linalg.norm(gravity),
        ((1 - uncertainty_of_payload.speed) ** 2, (1 + uncertainty_of_payload.speed) ** 2),
    )
    motions = [(factor, factor * pace) for factor in paces]
    if base is not None:  # the speeds of arm and base meet in Coriolis forces
        rows, motions = base.rows(len(q)), []
        for factor, rush in product(
            paces,
            {(1 - uncertainty_of_payload.drive_speed) ** 2, (1 + uncertainty_of_payload.drive_speed) ** 2},
        ):
            pull = -rush * base.acceleration_at(arm.mount_position)
            spin = np.sqrt(rush) * rows[:, 3:6], rush * rows[:, 6:]
            motions.append((factor, parts(q, np.sqrt(factor) * qd, factor * qdd, pull, *spin)[0]))

    level, pull = np.tensordot(gravity, pulls, axes=1), np.moveaxis((pulls @ mean)[..., 0], 0, -1)
    along, reach = pull @ gravity, size * np.linalg.norm(pull, axis=2)
    across = np.linalg.norm(np.cross(pull, gravity), axis=2)
    tilt = tilt + uncertainty_of_payload.tilt
    spread = size * tilt * (np.linalg.norm(pulls, axis=0) @ half)[..., 0]
    spread += uncertainty_of_payload.push * np.linalg.norm(push, axis=2) + loose
    values = np.zeros(q.shape)
    for factor, moving in motions:
        nominal = (moving @ mean)[..., 0] + factor * arm.armature * qdd + process
        more = spread + (np.abs(moving + level) @ half)[..., 0]
        for sign in (1.0, -1.0):
            tilted = np.maximum(np.arctan2(across, sign * along) - tilt, 0.0)
            values = np.maximum(values, sign * nominal + reach * np.cos(tilted) + more)
    if arm.payload is not None and any(uncertainty_of_payload.payload_center):
        box = np.asarray(uncertainty_of_payload.payload_center)
        most = (1 + uncertainty_of_payload.payload_mass) * np.outer(box, box)  # products of two shifts
        moments = np.abs(np.cross(side[:, :, :, None], swing[:, :, None, :], axis=1))  # (N, 3, 3, 3)
        axes = axes.reshape(len(q), 3, -1)  # of a single link they come without their last axis
        turning = np.einsum("nwl,nwij,ij->nl", np.abs(axes), moments, most)
        ratios = np.eye(arm.n) if arm.coupling is None else arm.coupling.matrix
        values += paces[1] * np.asarray(payload)[..., None] * (turning @ np.abs(ratios))
    return values


def _weights(arm: ArmModel, uncertainty: Uncertainty, payload: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Minimum and maximum of the weights of `_parts`, with factors (..., 1) of the payload's mass."""
    links, extra = np.full(len(arm.masses), uncertainty.arm_mass), np.full(1, uncertainty.extra_mass)
    held, box = (
        uncertainty.payload_mass,
        (1 + uncertainty.payload_mass) * np.asarray(uncertainty.payload_center),
    )
    weights = []
    for sign, more in ((-1, 0 * extra), (1, extra)):
        carried = payload * np.array([1 + sign * held, *(sign * box)])[: None if arm.payload else 0]
        parts = [np.broadcast_to(part, (*payload.shape[:-1], len(part))) for part in (1 + sign * links, more)]
        weights.append(np.concatenate([parts[0], carried, parts[1]], axis=-1))
    return weights[0], weights[1]


@lru_cache(maxsize=64)
def _parts(arm: ArmModel, turning: bool) -> BatchFunction:
    """A function of the state: torques of the drives per weight of each body, and the payload's factors.

    Weights are factors of links and payload, shifts of the payload's centre of mass along gripper axes, m,
    and the mass of a point at the TCP, kg.

    In: `q`, `qd`, `qdd` (n,), `gravity` (3,), and, of a base that is `turning`, its spin. Out:
    torques per weight (n, bodies) and per force at the TCP (n, 3); force that the payload needs per shift
    (3, 3), and gripper axes (3, 3), both in base axes;
    axes of the links' joints (3, L), zero if they slide.
    """
    q, qd, qdd = (cs.SX.sym(name, arm.n) for name in ("q", "qd", "qdd"))
    gravity, force, none = cs.SX.sym("gravity", 3), cs.SX.sym("force", 3), cs.SX.zeros(3)
    links, extra, shift = cs.SX.sym("links", len(arm.masses)), cs.SX.sym("extra"), cs.SX.zeros(3)
    weights, shifts, carried = [links], [np.ones(len(arm.masses))], []
    if (payload := arm.payload) is not None:
        factor, shift = cs.SX.sym("payload"), cs.SX.sym("shift", 3)
        mass, centre, inertia = payload.seen_from(arm.tool_rotation, arm.offsets[-1])
        carried.append((factor * mass, cs.SX(centre) + arm.tool_rotation @ shift, factor * cs.SX(inertia)))
        weights, shifts = [*weights, factor, shift], [*shifts, np.ones(1), np.zeros(3)]
    carried.append((extra, cs.SX(arm.offsets[-1]), np.zeros((3, 3))))
    spin = {name: cs.SX.sym(name, 3) for name in ("spin", "spin_change")[: 2 * turning]}
    torque, wrench = newton_euler(
        arm.with_payload(None), q, qd, qdd, gravity, force, none, none, scales=links, carried=carried, **spin
    )
    every, values = cs.vertcat(*weights, extra, force), np.concatenate([*shifts, np.zeros(4)])
    slopes = cs.substitute(cs.jacobian(torque, every), every, values)
    swing = cs.substitute(-cs.jacobian(wrench[:3], shift), every, values) if payload else cs.SX.zeros(3, 3)
    frames = chain(arm, q)[0]
    axes = [none if slides else R[:, 2] for R, slides in zip(frames[:-1], arm.slides, strict=True)]
    outputs = [slopes[:, :-3], slopes[:, -3:], swing, frames[-1], cs.horzcat(*axes)]
    inputs = [q, qd, qdd, gravity, *spin.values()]
    return BatchFunction(cs.Function("torques_by_body", inputs, outputs))
