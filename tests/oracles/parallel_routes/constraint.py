"""Equations of motion from closure constraints by automatic differentiation (ParaDyn, (3.12) to (3.36)).

h(z, q) = 0, A = dh/dz, B = dh/dq, q' = -B^-1 A z' = J z', J' = -B^-1 (A' + B' J). Legs and platform follow
from their energies (Lagrange), the platform in its Euler coordinates. Nothing here uses a geometric Jacobian,
so that this route checks the library. Redundant joints are coordinates in z, too: one closure more each says
that the joint has this position.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as cs
import numpy as np
import scipy.linalg

from ocptip.numerics.batch import PointFunction
from ocptip.parallel.description.frames import PlatformCoordinates
from ocptip.parallel.dynamics.terms import DynamicTerms
from ocptip.parallel.kinematics.chain import Topology, about_origin, frames
from ocptip.parallel.kinematics.closures import LegClosure
from ocptip.parallel.kinematics.platform import Kinematics

_RANK, _NULL = 1e-11, 1e-8


class ConstraintRoute:
    """Equations of motion in the form Z by closure constraints.

    Args:
        kinematics: of the robot.
        complete: all joints with position and orientation closures, else the joints up to the coupling point
            with position closures only.
    """

    def __init__(self, kinematics: Kinematics, *, complete: bool) -> None:
        self._kinematics, self._complete = kinematics, complete
        self._platform = _platform_function(kinematics)
        self._closures = [_closure_function(kinematics, leg, complete) for leg in kinematics.legs]

    def terms(
        self, z: np.ndarray, zd: np.ndarray, q: Sequence[np.ndarray], gravity: np.ndarray
    ) -> tuple[DynamicTerms, np.ndarray]:
        """Form Z and J_z (n_a, m): q_a' = J_z z'.

        Args:
            z, zd: (m,).
            q: joint positions per leg.
            gravity: (3,), m/s^2, world axes.
        """
        w = np.concatenate([self._kinematics.moving(z, q), z[self._kinematics.platform.m :]])
        wd, follow, lag = self._rates(w, zd, q)
        M, c, g = self._platform(w, wd, gravity)
        M, c, g = M.reshape(len(w), len(w)), np.ravel(c), np.ravel(g)
        c = c + M @ lag
        M, c, g = follow.T @ M @ follow, follow.T @ c, follow.T @ g
        rows = {}
        for i, leg in enumerate(self._kinematics.legs):
            n = leg.n if self._complete else leg.point
            A, B = self._slopes(i, w, q[i])
            inverse = np.linalg.pinv(B, rcond=_RANK)
            J = -inverse @ A @ follow
            J = J - leg.idling(q[i], J)
            qd = J @ zd
            drift = -inverse @ (A @ lag + np.ravel(self._closures[i][1](w, q[i][:n], wd, qd)[0]))
            M_i, c_i, g_i = lagrange_leg(leg.topology, n)(q[i][:n], qd, leg.base, gravity, leg.inertia)
            drive, viscous, coulomb = leg.drives[:, :n]
            M_i = M_i.reshape(n, n) + np.diag(drive)
            M = M + J.T @ M_i @ J
            c = c + J.T @ (M_i @ drift + c_i + viscous * qd + coulomb * np.sign(qd))
            g = g + J.T @ g_i
            rows[i] = J
        motors = np.array([rows[leg][joint] for leg, joint in self._kinematics.description.actuated])
        return DynamicTerms("Z", M, c, g), motors

    def _slopes(self, i: int, w: np.ndarray, q: np.ndarray) -> list[np.ndarray]:
        """dh/dw and dh/dq of a leg."""
        leg = self._kinematics.legs[i]
        n = leg.n if self._complete else leg.point
        sizes = (len(w), n)
        return [part.reshape(-1, k) for part, k in zip(self._closures[i][0](w, q[:n]), sizes, strict=True)]

    def _rates(
        self, w: np.ndarray, zd: np.ndarray, q: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """w', and F and l of w' = F z', w'' = F z'' + l, for all moving coordinates of the platform."""
        m = len(zd)
        if len(w) == m:
            return zd, np.eye(m), np.zeros(m)
        slopes = [self._slopes(i, w, joints) for i, joints in enumerate(q)]
        null = [scipy.linalg.null_space(B.T, rcond=_NULL) for _, B in slopes]
        G = np.vstack([N.T @ A for N, (A, _) in zip(null, slopes, strict=True)])
        inverse = np.linalg.pinv(G[:, m:], rcond=_NULL)
        follow = np.vstack([np.eye(m), -inverse @ G[:, :m]])
        wd = follow @ zd
        lags = []
        for joints, (A, B), N, closure in zip(q, slopes, null, self._closures, strict=True):
            qd = -np.linalg.pinv(B, rcond=_RANK) @ A @ wd
            lags.append(N.T @ np.ravel(closure[1](w, joints, wd, qd)[0]))
        return wd, follow, np.concatenate([np.zeros(m), -inverse @ np.concatenate(lags)])


@lru_cache(maxsize=64)
def lagrange_leg(topology: Topology, n: int) -> PointFunction:
    """M, c, g of a leg's first n joints from its energies (3.19 to 3.21); inputs as `chain.leg_dynamics`."""
    q, qd = cs.SX.sym("q", n), cs.SX.sym("qd", n)
    base, gravity = cs.SX.sym("base", 3, 3), cs.SX.sym("gravity", 3)
    p = cs.SX.sym("p", 10 * topology.bodies)
    kinetic, potential = cs.SX(0), cs.SX(0)
    rotations, origins = _frames(topology, cs.vertcat(q, cs.SX.zeros(topology.n_joints - n)), base)
    for k in range(topology.bodies):
        T, U = _energies(rotations[k], origins[k], q, qd, p[10 * k : 10 * k + 10], gravity)
        kinetic, potential = kinetic + T, potential + U
    return PointFunction(_lagrange("lagrange_leg", kinetic, potential, q, qd, [q, qd, base, gravity, p]))


def _platform_function(kinematics: Kinematics) -> PointFunction:
    m = _size(kinematics)
    z, zd, gravity = cs.SX.sym("z", m), cs.SX.sym("zd", m), cs.SX.sym("gravity", 3)
    r, R = _symbolic_pose(kinematics.platform, z)
    p = cs.SX(kinematics.description.platform.inertia.vector)
    T, U = _energies(R, r, z, zd, p, gravity)
    return PointFunction(_lagrange("lagrange_platform", T, U, z, zd, [z, zd, gravity]))


def _size(kinematics: Kinematics) -> int:
    """Number of coordinates of the platform, dependent ones and redundant joints included."""
    return len(kinematics.platform.order) + len(kinematics.description.redundant)


def _closure_function(
    kinematics: Kinematics, leg: LegClosure, complete: bool
) -> tuple[PointFunction, PointFunction]:
    """(A, B) of (z, q), and A' z' + B' q' of (z, q, z', q')."""
    m, n = _size(kinematics), leg.n if complete else leg.point
    z, q, zd, qd = (cs.SX.sym(name, size) for name, size in (("z", m), ("q", n), ("zd", m), ("qd", n)))
    r, R = _symbolic_pose(kinematics.platform, z)
    padded = cs.vertcat(q, cs.SX.zeros(leg.n - n))
    rotations, origins = _frames(leg.topology, padded, cs.SX(leg.base))
    h = []
    for end, kappa, turn in zip(leg.end_rows, leg.couplings, leg.end_rotations, strict=True):
        h.append(cs.SX(leg.origin) + origins[end] - r - R @ cs.SX(kappa))
        if complete and turn is not None:
            h.append(cs.vec(rotations[end] @ cs.SX(turn) - R))
    for a, b in leg.loop_rows:
        h.append(origins[a] - origins[b])
    closure = cs.vertcat(*h)
    if not complete and leg.leg.serial:
        closure = closure[list(kinematics.description.position_rows)]
    for k, (number, joint) in enumerate(kinematics.description.redundant, len(kinematics.platform.order)):
        if number == leg.number:
            closure = cs.vertcat(closure, q[joint] - z[k])
    A, B = cs.jacobian(closure, z), cs.jacobian(closure, q)
    rate = A @ zd + B @ qd
    drift = cs.jtimes(rate, z, zd) + cs.jtimes(rate, q, qd)
    first = cs.Function("closure", [z, q], cs.cse([A, B]))
    return PointFunction(first), PointFunction(cs.Function("closure_drift", [z, q, zd, qd], cs.cse([drift])))


def _frames(topology: Topology, q: cs.SX, base: cs.SX) -> tuple[list[cs.SX], list[cs.SX]]:
    """Rotations and origins of all rows, world axes, from the base frame's origin."""
    found = frames(topology, q, cs.SX(topology.n_joints, 1), base)
    return found.rotations, found.origins


def _energies(R: cs.SX, r: cs.SX, q: cs.SX, qd: cs.SX, p: cs.SX, gravity: cs.SX) -> tuple[cs.SX, cs.SX]:
    """Kinetic and potential energy of a body; its velocity by differentiating the pose."""
    v = cs.jtimes(r, q, qd)
    spin = R.T @ cs.reshape(cs.jtimes(cs.vec(R), q, qd), 3, 3)
    w = cs.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])
    s, mass, inertia = p[6:9], p[9], about_origin(p)
    T = 0.5 * mass * cs.dot(v, v) + cs.dot(R.T @ v, cs.cross(w, s)) + 0.5 * cs.dot(w, inertia @ w)
    return T, -cs.dot(gravity, mass * r + R @ s)


def _lagrange(name: str, T: cs.SX, U: cs.SX, q: cs.SX, qd: cs.SX, inputs: list[cs.SX]) -> cs.Function:
    momentum = cs.gradient(T, qd)
    M = cs.jacobian(momentum, qd)
    c = cs.jtimes(momentum, q, qd) - cs.gradient(T, q)
    return cs.Function(name, inputs, cs.cse([M, c, cs.gradient(U, q)]))


def _symbolic_pose(platform: PlatformCoordinates, z: cs.SX) -> tuple[cs.SX, cs.SX]:
    r, R = platform.pose([z[i] for i in range(len(platform.order))])
    return cs.SX(r), cs.SX(R)
