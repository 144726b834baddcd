"""One leg between base and platform: frames, closure equations, joint rates and dynamics in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.numerics.vectors import cross, skew
from ocptip.parallel.description.frames import rotation_vector
from ocptip.parallel.description.robot_description import LegBase
from ocptip.parallel.kinematics.chain import (
    Topology,
    leg_dynamics,
    leg_kinematics,
    leg_loads,
)


@dataclass(frozen=True, eq=False)
class LegMotion:
    """Joint rates of a leg as functions of the robot's quasi-velocities.

    Attributes:
        q: (n,) joint positions.
        Jq: (n, m): q' = Jq s'.
        drift: (n,): q'' = Jq s'' + drift.
        qd: (n,).
        mismatch: largest part of the platform's motion, relative, that the joints cannot follow.
    """

    q: np.ndarray
    Jq: np.ndarray
    drift: np.ndarray
    qd: np.ndarray
    mismatch: float


@dataclass(frozen=True, eq=False)
class PlatformMotion:
    """Position and rates of the platform at one instant.

    Attributes:
        z: (m,) coordinates; s: (m,) quasi-velocities.
        r, R: position (3,), m, and rotation (3, 3) of the platform.
        T: (6, m) twist t = T s'; T_drift: (6,) t' = T s'' + T_drift. Redundant joints have zero columns.
        t: (6,) twist of the platform, world axes.
    """

    z: np.ndarray
    s: np.ndarray
    r: np.ndarray
    R: np.ndarray
    T: np.ndarray
    T_drift: np.ndarray
    t: np.ndarray


class LegClosure:
    """A leg with its base frame in numbers.

    Closure rows: per end of the leg the position of the coupling point and the orientation, world axes; then
    the inner loops of a branched leg.

    Attributes:
        n: number of joints, coupling joints included.
        point: number of joints up to the coupling point; n for branched legs.
        locked: joints that are additional coordinates (kinematic redundancy).
        drives: (3, n) drive inertia, viscous and Coulomb friction.
        end_rotations: (3, 3) platform axes to end frame, per end, or None where the orientation is free.
        idle: number of freedoms that neither platform nor motors notice.
    """

    def __init__(self, number: int, leg: LegBase, locked: Sequence[int] = ()) -> None:
        self.number, self.leg = number, leg
        self.base, self.origin = leg.base_matrix, leg.origin
        self.topology = Topology(leg.rows, *leg.tree, len(leg.bodies))
        self.couplings = [point for point, _ in leg.couplings]
        self.end_rotations = [turn for _, turn in leg.couplings]
        self.loops, self.point = len(leg.loops), leg.point_joints
        self.n, self.idle = self.topology.n_joints, leg.idle
        self.locked = list(locked)
        self.free = [j for j in range(self.n) if j not in self.locked]
        self.drives = np.array([leg.drive_inertia, leg.viscous, leg.coulomb])[:, : self.n]
        self.inertia = np.concatenate([body.vector for body in leg.bodies])
        self._kinematics, self._dynamics = leg_kinematics(self.topology), leg_dynamics(self.topology)
        arms = np.abs(self._kinematics(np.zeros(self.n), np.zeros(self.n), self.base)[1])
        self.length = max(1.0, float(arms.max()), float(np.abs(self.origin).max()))

    def frames(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (k, 3, 3) and origins (k, 3), m, of all rows, world axes."""
        rotations, origins, _, _ = self._kinematics(q, np.zeros(self.n), self.base)
        return rotations.reshape(3, -1, 3).transpose(1, 0, 2), origins.T + self.origin

    def residual(self, q: np.ndarray, r: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Closure errors h(q, pose) of all rows, m and rad, world axes."""
        rotations, origins = self.frames(q)
        parts = []
        for end, kappa, turn in zip(self.end_rows, self.couplings, self.end_rotations, strict=True):
            parts.append(origins[end] - r - R @ kappa)
            if turn is not None:
                target = R @ turn.T
                parts.append(rotation_vector(rotations[end] @ target.T))
        for a, b in self.loop_rows:
            parts.append(origins[a] - origins[b])
        return np.concatenate(parts)

    def jacobian(self, q: np.ndarray, qd: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """J_c (rows, n) and J_c' q' (rows,) of the closure rows."""
        rates = np.zeros(self.n) if qd is None else qd
        _, _, J, drift = self._kinematics(q, rates, self.base)
        both = np.column_stack([J, drift])
        parts = []
        for e, turn in enumerate(self.end_rotations):
            parts.append(both[6 * e : 6 * e + (3 if turn is None else 6)])
        first = len(self.end_rotations)
        for k in range(first, first + 2 * self.loops, 2):
            parts.append(both[6 * k : 6 * k + 3] - both[6 * k + 6 : 6 * k + 9])
        stacked = np.vstack(parts)
        return stacked[:, :-1], stacked[:, -1]

    def platform_side(self, R: np.ndarray) -> np.ndarray:
        """C (rows, 6): the platform's twist t = (r', omega) moves the closure rows by C t."""
        parts = []
        for kappa, turn in zip(self.couplings, self.end_rotations, strict=True):
            parts.append(np.hstack([np.eye(3), -skew(R @ kappa)]))
            if turn is not None:
                parts.append(np.hstack([np.zeros((3, 3)), np.eye(3)]))
        parts.append(np.zeros((3 * self.loops, 6)))
        return np.vstack(parts)

    def platform_drift(self, R: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """C' t (rows,)."""
        parts = []
        for kappa, turn in zip(self.couplings, self.end_rotations, strict=True):
            parts.append(cross(omega, cross(omega, R @ kappa)))
            if turn is not None:
                parts.append(np.zeros(3))
        parts.append(np.zeros(3 * self.loops))
        return np.concatenate(parts)

    def dynamics(self, q: np.ndarray, qd: np.ndarray, gravity: np.ndarray) -> list[np.ndarray]:
        """Outputs of `kinematics.chain.leg_dynamics`; drive inertia and friction included."""
        M, c, g, *rest = self.body_dynamics(q, qd, gravity, self.inertia)
        drive, viscous, coulomb = self.drives
        return [M + np.diag(drive), c + viscous * qd + coulomb * np.sign(qd), g, *rest]

    def body_dynamics(
        self, q: np.ndarray, qd: np.ndarray, gravity: np.ndarray, inertia: np.ndarray
    ) -> list[np.ndarray]:
        """The same for given inertia parameters (10 bodies,), without drive inertia and friction."""
        return self._dynamics(q, qd, self.base, gravity, inertia)

    def body_loads(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """(rows, 6) wrenches that move and carry the bodies, world axes, about their frames' origins."""
        loads = np.zeros((len(self.topology.rows), 6))
        leg_load = leg_loads(self.topology)(q, qd, qdd, self.base, gravity, self.inertia)[0]
        loads[: self.topology.bodies] = leg_load.reshape(6, -1).T
        return loads

    def motion(self, q: np.ndarray, platform: PlatformMotion, rho: list[int]) -> LegMotion:
        """Rates of all joints (n,) of the complete leg; rho: columns of s of this leg's locked joints."""
        J, _ = self.jacobian(q)
        right = self.platform_side(platform.R) @ platform.T
        right[:, rho] -= J[:, self.locked]
        inverse = np.linalg.pinv(J[:, self.free], rcond=1e-11)
        Jq = np.zeros((self.n, right.shape[1]))
        Jq[self.free] = inverse @ right
        Jq -= self.idling(q, Jq)
        Jq[self.locked, rho] = 1.0
        mismatch = np.abs(J[:, self.free] @ Jq[self.free] - right).max() / max(1.0, np.abs(right).max())
        qd = Jq @ platform.s
        bias = np.zeros(self.n)
        bias[self.free] = inverse @ self.drift(q, qd, platform.R, platform.T_drift, platform.t)
        return LegMotion(q, Jq, bias - self.idling(q, bias, qd), qd, float(mismatch))

    def idle_motions(self, q: np.ndarray) -> np.ndarray:
        """(n, idle) orthonormal joint rates that leave the platform at rest."""
        motions = np.zeros((self.n, self.idle))
        if self.idle:
            motions[self.free] = np.linalg.svd(self.jacobian(q)[0][:, self.free])[2][-self.idle :].T
        return motions

    def idling(self, q: np.ndarray, rates: np.ndarray, speeds: np.ndarray | None = None) -> np.ndarray:
        """The part of rates (n, ...) along the idle motions that costs kinetic energy for nothing.

        Without it the bodies carry no momentum along the idle motions, and no forces there: what the platform
        feels of the leg is the same whatever the idle accelerations are. Of accelerations at given speeds
        (n,): the part that idle bodies without weight and friction would not make.
        """
        if not self.idle:
            return np.zeros_like(rates)
        motions = self.idle_motions(q)
        M = self.dynamics(q, np.zeros(self.n), np.zeros(3))[0]
        least = 1e-12 * max(float(np.trace(M)), 1e-300)
        values, axes = np.linalg.eigh(motions.T @ M @ motions)
        heavy = motions @ axes[:, values > least]
        forces = M @ rates
        if speeds is not None:
            forces = forces + self.body_dynamics(q, speeds, np.zeros(3), self.inertia)[1]
        return heavy @ np.linalg.solve(heavy.T @ M @ heavy, heavy.T @ forces)

    def point_motion(self, q: np.ndarray, platform: PlatformMotion, rows: Sequence[int]) -> LegMotion:
        """Rates of the joints up to the coupling point (3.42); J_B is square there."""
        J, rows = self.point_jacobian(q, rows), list(rows)
        U = self.platform_side(platform.R)[rows] @ platform.T
        try:
            Jq = np.linalg.solve(J, U)
        except np.linalg.LinAlgError:
            Jq = np.full(U.shape, np.inf)
        qd = Jq @ platform.s
        at = self.padded(q), self.padded(qd), platform.R, platform.T_drift, platform.t
        return LegMotion(q, Jq, np.linalg.solve(J, self.drift(*at)[rows]), qd, 0.0)

    def point_jacobian(self, q: np.ndarray, rows: Sequence[int]) -> np.ndarray:
        """J_B (rows, point): velocity of the coupling point per joint rate, world axes."""
        return self.jacobian(self.padded(q[: self.point]))[0][list(rows), : self.point]

    def drift(
        self, q: np.ndarray, qd: np.ndarray, R: np.ndarray, T_drift: np.ndarray, t: np.ndarray
    ) -> np.ndarray:
        """C T_drift + C' t - J_c' q' (rows,): what joint accelerations make up for at s'' = 0."""
        return self.platform_side(R) @ T_drift + self.platform_drift(R, t[3:]) - self.jacobian(q, qd)[1]

    def padded(self, values: np.ndarray) -> np.ndarray:
        """Values of the joints up to the coupling point, zeros for those behind it."""
        full = np.zeros(self.n)
        full[: len(values)] = values
        return full

    def row_scale(self, length: float) -> np.ndarray:
        """(rows,) factors that make all closure rows lengths: `length`, m, for those of orientations."""
        ends = [[1.0] * 3 + [length] * (0 if turn is None else 3) for turn in self.end_rotations]
        return np.array([*np.concatenate(ends), *[1.0] * 3 * self.loops])

    @property
    def whole_rows(self) -> np.ndarray:
        """Closure rows that hold before the leg is assembled: positions, orientations that are given."""
        serial = self.leg.serial and self.end_rotations[0] is None
        return np.arange(3 if serial else len(self.row_scale(1.0)))

    @property
    def end_rows(self) -> tuple[int, ...]:
        """Rows whose frames are fixed on the platform."""
        return self.topology.ends[: len(self.end_rotations)]

    @property
    def loop_rows(self) -> list[tuple[int, int]]:
        """Pairs of rows whose origins coincide."""
        rows = self.topology.ends[len(self.end_rotations) :]
        return list(zip(rows[::2], rows[1::2], strict=True))
