"""Kinematics and dynamics of one leg as compiled CasADi functions: straightforward form, world axes.

A leg is a tree of bodies over MDH rows; a serial leg is an unbranched tree. Dynamics by body Jacobians
(thesis P, (3.19), generalised); the lean form for code generation is a separate module.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as cs

from ocptip.numerics.batch import PointFunction
from ocptip.parallel.description.platform import Entry, exact_cos_sin, turn_about, value_of
from ocptip.parallel.description.robot_description import FIXED, REVOLUTE, MDHRow

_CACHED = 64


@dataclass(frozen=True)
class Topology:
    """The structure of a leg: all that its functions depend on besides base frame and inertias.

    Attributes:
        rows: MDH rows.
        parents: row whose frame each row starts from, -1 for the base frame.
        ends: rows whose frames the closures use.
        bodies: number of rows, from the first one, that carry a body with inertia.
    """

    rows: tuple[MDHRow, ...]
    parents: tuple[int, ...]
    ends: tuple[int, ...]
    bodies: int

    @property
    def joints(self) -> tuple[int | None, ...]:
        """Index of each row's joint variable, None for a fixed row."""
        result: list[int | None] = []
        count = 0
        for row in self.rows:
            result.append(None if row.sigma == FIXED else count)
            count += row.sigma != FIXED
        return tuple(result)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return sum(row.sigma != FIXED for row in self.rows)


@dataclass(frozen=True)
class Frames:
    """Symbolic frames of a leg, world axes, positions from the base frame's origin.

    Attributes:
        rotations: (3, 3) per row.
        origins: (3,) per row.
        jacobians: (6, n) per row: velocity of the origin, angular velocity.
        drifts: (6,) per row: the accelerations at q'' = 0.
        speeds: (3,) per row: angular velocity.
    """

    rotations: list[cs.SX]
    origins: list[cs.SX]
    jacobians: list[cs.SX]
    drifts: list[cs.SX]
    speeds: list[cs.SX]


def mdh_parts(row: MDHRow, joint: cs.SX | float) -> tuple[cs.SX, cs.SX, cs.SX]:
    """Parts of the transformation (2.11) of one row.

    Returns:
        fixed: (3, 3) turn that does not depend on a revolute joint, Rz(gamma) Rx(alpha).
        turn: (3, 3) Rz(theta), with the joint angle.
        offset: (3,) origin of frame j in frame a(j).
    """
    fixed = _turn("z", row.gamma) @ _turn("x", row.alpha)
    angle, slide = row.theta, row.r
    along = value_of(slide) if row.sigma in (REVOLUTE, FIXED) else value_of(slide) + joint
    turn = _joint_turn(angle, joint) if row.sigma == REVOLUTE else _turn("z", angle)
    offset = cs.vertcat(0, 0, value_of(row.b)) + _turn("z", row.gamma) @ cs.vertcat(value_of(row.d), 0, 0)
    return fixed, turn, offset + fixed @ cs.vertcat(0, 0, along)


def frames(topology: Topology, q: cs.SX, qd: cs.SX, base: cs.SX) -> Frames:
    """Frames, Jacobians and drift accelerations of all rows."""
    n = topology.n_joints
    rotations, origins, jacobians, drifts, speeds = [], [], [], [], []
    for row, parent, joint in zip(topology.rows, topology.parents, topology.joints, strict=True):
        if parent < 0:
            R, p, J = base, cs.SX.zeros(3), cs.SX(6, n)
            a, alpha, w = cs.SX.zeros(3), cs.SX.zeros(3), cs.SX.zeros(3)
        else:
            R, p, J = rotations[parent], origins[parent], jacobians[parent]
            a, alpha, w = drifts[parent][:3], drifts[parent][3:], speeds[parent]
        fixed, turn, offset = mdh_parts(row, 0.0 if joint is None else q[joint])
        arm, turned = R @ offset, R @ fixed
        axis = turned[:, 2]
        J = cs.vertcat(J[:3, :] - cs.skew(arm) @ J[3:, :], J[3:, :])
        a = a + cs.cross(alpha, arm) + cs.cross(w, cs.cross(w, arm))
        if joint is not None:
            if row.sigma == REVOLUTE:
                J[3:, joint] = axis
                alpha = alpha + cs.cross(w, axis * qd[joint])
                w = w + axis * qd[joint]
            else:
                J[:3, joint] = axis
                a = a + 2 * cs.cross(w, axis * qd[joint])
        rotations.append(turned @ turn)
        origins.append(p + arm)
        jacobians.append(J)
        drifts.append(cs.vertcat(a, alpha))
        speeds.append(w)
    return Frames(rotations, origins, jacobians, drifts, speeds)


@lru_cache(maxsize=_CACHED)
def leg_kinematics(topology: Topology) -> PointFunction:
    """Frames and end motion of a leg.

    In: `q`, `qd` (n,); `base` (3, 3) leg base axes to world axes. Out: `rotations` (3, 3 k) of all rows side
    by side, `origins` (3, k) from the base frame's origin, `jacobian` (6 e, n) and `drift` (6 e,) of the end
    frames: velocity of the origin, angular velocity; world axes.
    """
    q, qd, base = (
        cs.SX.sym("q", topology.n_joints),
        cs.SX.sym("qd", topology.n_joints),
        cs.SX.sym("base", 3, 3),
    )
    f = frames(topology, q, qd, base)
    outputs = [
        cs.horzcat(*f.rotations),
        cs.horzcat(*f.origins),
        cs.vertcat(*(f.jacobians[e] for e in topology.ends)),
        cs.vertcat(*(f.drifts[e] for e in topology.ends)),
    ]
    names = ["rotations", "origins", "jacobian", "drift"]
    return PointFunction(
        cs.Function("leg_kinematics", [q, qd, base], cs.cse(outputs), ["q", "qd", "base"], names)
    )


@lru_cache(maxsize=_CACHED)
def leg_dynamics(topology: Topology) -> PointFunction:
    """Mass matrix, Coriolis and gravity forces, base wrench and energies of a leg.

    In: `q`, `qd` (n,); `base` (3, 3); `gravity` (3,), world axes; `inertia` (10 bodies,) in DynPar 2 order.
    Out: `mass` (n, n), `coriolis` (n,), `gravity_force` (n,): tau = M q'' + c + g; `momentum` (6, n) and
    `load` (6,): the wrench that moves and carries the leg's bodies is momentum q'' + load, force and moment
    about the base frame's origin, world axes; `energy` (2,): kinetic and potential, J.
    """
    n = topology.n_joints
    q, qd, base, g = cs.SX.sym("q", n), cs.SX.sym("qd", n), cs.SX.sym("base", 3, 3), cs.SX.sym("g", 3)
    p = cs.SX.sym("p", 10 * topology.bodies)
    f = frames(topology, q, qd, base)
    M, c, gravity = cs.SX.zeros(n, n), cs.SX.zeros(n), cs.SX.zeros(n)
    momentum, load, potential = cs.SX.zeros(6, n), cs.SX.zeros(6), cs.SX(0)
    for k in range(topology.bodies):
        J = f.jacobians[k]
        A, inertial, weight, moment = _body_loads(f, k, p, g)
        M += J.T @ A @ J
        c += J.T @ inertial
        gravity -= J.T @ weight
        shift = cs.vertcat(
            cs.horzcat(cs.SX.eye(3), cs.SX(3, 3)), cs.horzcat(cs.skew(f.origins[k]), cs.SX.eye(3))
        )
        momentum += shift @ A @ J
        load += shift @ (inertial - weight)
        potential -= cs.dot(weight[:3], f.origins[k]) + cs.dot(g, moment)
    energy = cs.vertcat(0.5 * cs.dot(qd, M @ qd), potential)
    outputs = [M, c, gravity, momentum, load, energy]
    names = ["mass", "coriolis", "gravity_force", "momentum", "load", "energy"]
    inputs = [q, qd, base, g, p]
    return PointFunction(
        cs.Function("leg_dynamics", inputs, cs.cse(outputs), ["q", "qd", "base", "gravity", "inertia"], names)
    )


@lru_cache(maxsize=_CACHED)
def leg_loads(topology: Topology) -> PointFunction:
    """Wrenches that move and carry the bodies of a leg.

    In: `q`, `qd`, `qdd` (n,); `base` (3, 3); `gravity` (3,), world axes; `inertia` (10 bodies,) in DynPar 2
    order. Out: `loads` (6, bodies): force and moment about the origin of the body's frame, world axes.
    """
    n = topology.n_joints
    q, qd, qdd = (cs.SX.sym(name, n) for name in ("q", "qd", "qdd"))
    base, g, p = cs.SX.sym("base", 3, 3), cs.SX.sym("g", 3), cs.SX.sym("p", 10 * topology.bodies)
    f = frames(topology, q, qd, base)
    loads: list[cs.SX] = []
    for k in range(topology.bodies):
        A, inertial, weight, _ = _body_loads(f, k, p, g)
        loads.append(A @ (f.jacobians[k] @ qdd) + inertial - weight)
    inputs = [q, qd, qdd, base, g, p]
    return PointFunction(cs.Function("leg_loads", inputs, cs.cse([cs.horzcat(*loads)])))


def _body_loads(f: Frames, k: int, p: cs.SX, g: cs.SX) -> tuple[cs.SX, cs.SX, cs.SX, cs.SX]:
    """Spatial inertia (6, 6), wrench at q'' = 0 and weight (6,) of body k, its first moment (3,)."""
    w = f.speeds[k]
    A, mass, s, inertia = spatial_inertia(p[10 * k : 10 * k + 10], f.rotations[k])
    gyro = cs.vertcat(cs.cross(w, cs.cross(w, s)), cs.cross(w, inertia @ w))
    return A, A @ f.drifts[k] + gyro, cs.vertcat(mass * g, cs.cross(s, g)), s


def spatial_inertia(p: cs.SX, R: cs.SX) -> tuple[cs.SX, cs.SX, cs.SX, cs.SX]:
    """Inertia of one body from DynPar 2, about its frame's origin, world axes.

    Returns:
        A: (6, 6), wrench = A acceleration + velocity terms; mass; first moment (3,); inertia (3, 3).
    """
    mass, s, inertia = p[9], R @ p[6:9], R @ about_origin(p) @ R.T
    A = cs.vertcat(cs.horzcat(mass * cs.SX.eye(3), -cs.skew(s)), cs.horzcat(cs.skew(s), inertia))
    return A, mass, s, inertia


def about_origin(p: cs.SX) -> cs.SX:
    """(3, 3) inertia tensor from DynPar 2."""
    return cs.vertcat(p[:3].T, p[[1, 3, 4]].T, p[[2, 4, 5]].T)


def _turn(axis: str, entry: Entry) -> cs.SX:
    return _sparse(turn_about(axis, *exact_cos_sin(entry)))


def _joint_turn(offset: Entry, angle: cs.SX | float) -> cs.SX:
    shifted = value_of(offset) + angle
    return _sparse(turn_about("z", cs.cos(shifted), cs.sin(shifted)))


def _sparse(rows: list[list[cs.SX | float]]) -> cs.SX:
    """A matrix whose zeros are structural."""
    matrix = cs.SX(3, 3)
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            if not (isinstance(value, float) and value == 0.0):
                matrix[i, j] = value
    return matrix
