"""Platform coordinates that follow from the others: all legs are closed together.

The legs of a 3-RPS leave its platform three freedoms, and none of them is a pure coordinate: x, y and the
rotation about z move along. With w = (z, d) the free and the dependent coordinates, and N_i the forces on the
platform that leg i does no work against (left null space of its Jacobian), the legs allow the rates with
G w' = 0, G = [N_i' C_i T_w]; so d' = K z', K = -G_d^+ G_z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.parallel.description.frames import PlatformCoordinates
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.kinematics.leg_solver import (
    CLOSURE_TOLERANCE,
    Attempt,
    ClosureEquations,
    LegSolver,
    continued,
)

Rows = Sequence[np.ndarray]
"""Per leg the closure rows that count."""

_RANK = 1e-8
_RESTARTS = 4
_SPREAD = 0.3
_SEED = 7


@dataclass(frozen=True, eq=False)
class Restraint:
    """What the legs together demand of the rates w' = (z', d') of the platform's coordinates: G w' = 0.

    Angles count as lengths by the length it was made with, forces are unit vectors: entries have no unit.

    Attributes:
        G: (rows, m + k).
        m: number of free coordinates.
    """

    G: np.ndarray
    m: int

    @property
    def held(self) -> float:
        """Smallest of the k singular values of G that count: 0 where the legs hold fewer motions than they
        should, a constraint singularity."""
        k = self.G.shape[1] - self.m
        values = np.linalg.svd(self.G, compute_uv=False)
        return float(values[k - 1]) if len(values) >= k else 0.0

    @property
    def determined(self) -> float:
        """Smallest singular value of G_d: 0 where the free coordinates do not fix the dependent ones."""
        k = self.G.shape[1] - self.m
        values = np.linalg.svd(self.G[:, self.m :], compute_uv=False)
        return float(values[k - 1]) if len(values) >= k else 0.0


class DependentCoordinates:
    """Dependent coordinates d (k,) of a robot and the joint positions that belong to them.

    Args:
        description: of the robot.
        platform: its coordinates.
        legs: they are assembled in the home pose here.

    Raises:
        InputError: the legs do not reach the home pose with any dependent coordinates near those given.
    """

    def __init__(
        self, description: RobotDescription, platform: PlatformCoordinates, legs: Sequence[LegSolver]
    ) -> None:
        self._name, self._platform, self._legs = description.name, platform, list(legs)
        self._names = ", ".join(description.platform.dependent_coordinates)
        self._starts = np.concatenate([[0], np.cumsum([leg.n for leg in legs])]).astype(int)
        self._k = len(platform.dependent)
        self._scale = max(leg.length for leg in legs)
        self._home_z = description.home
        self.home = self._assembled(description.dependent_home)

    def solve(
        self, z: np.ndarray, guess: Sequence[np.ndarray] | None, search: bool = True
    ) -> tuple[Attempt, str]:
        """Joints of all legs, one after the other, and d at z; and where they come from: "guess", "home"
        (continued along the straight line) or "search".

        Raises:
            InputError: no leg positions and dependent coordinates close at z.
        """
        if guess is not None:
            near = self._from_joints(z, guess)[0]
            result = self._closing(z).solved(np.concatenate([*guess, near]))
            if self._closed(result):
                return result, "guess"
            if not search:
                raise InputError("pose: the legs are not closed from the guess")
        else:
            way = continued(self._home_u, lambda u, share: self._closing(self._way(z, share)).followed(u))
            if way is not None:
                return way, "home"
        rng = np.random.default_rng(_SEED)
        error = np.inf
        for number in range(_RESTARTS):
            start = self._home_u + (_SPREAD * rng.uniform(-1, 1, len(self._home_u)) if number else 0.0)
            result = self._closing(z).solved(start)
            if self._closed(result):
                return result, "search"
            error = min(error, result[1])
        raise InputError(
            f"pose: the legs do not close at z = {np.round(z, 6).tolist()} with any searched {self._names}: "
            f"closure error {error:.2g} (m, rad)"
        )

    def split(self, u: np.ndarray) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
        """Joint positions per leg, and d."""
        ends = zip(self._starts[:-1], self._starts[1:], strict=True)
        return tuple(u[a:b] for a, b in ends), u[self._starts[-1] :]

    def at(self, z: np.ndarray, q: Sequence[np.ndarray]) -> np.ndarray:
        """(m + k,) all moving coordinates (z, d) where the legs stand at q.

        Raises:
            InputError: the joint positions do not belong to z.
        """
        d, error, _ = self._from_joints(z, q)
        if error > 1e3 * CLOSURE_TOLERANCE * self._scale:
            raise InputError(
                f"q: the joint positions do not close at z = {np.round(z, 6).tolist()}: error {error:.2g} "
                "(m, rad)"
            )
        return np.concatenate([z, d])

    def twist(
        self, w: np.ndarray, s: np.ndarray, q: Sequence[np.ndarray], R: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """T (6, m) and T_drift (6,) of t = T s', t' = T s'' + T_drift, with s' = z'.

        Args:
            w: (m + k,); s: (m,); q: per leg; R: of the platform.
        """
        m, T_w = len(s), self._platform.selection(w)
        forces = [_held_forces(leg, joints) for leg, joints in zip(self._legs, q, strict=True)]
        G = np.vstack([N.T @ leg.platform_side(R) @ T_w for leg, N in zip(self._legs, forces, strict=True)])
        inverse = np.linalg.pinv(G[:, m:], rcond=_RANK)
        follow = np.vstack([np.eye(m), -inverse @ G[:, :m]])
        T = T_w @ follow
        T_drift = self._platform.selection_drift(w, follow @ s)
        t = T @ s
        lags = []
        for leg, joints, N in zip(self._legs, q, forces, strict=True):
            J = leg.jacobian(joints)[0]
            qd = np.linalg.pinv(J, rcond=_RANK) @ (leg.platform_side(R) @ t)
            lags.append(N.T @ leg.drift(joints, qd, R, T_drift, t))
        return T, T_drift - T_w[:, m:] @ inverse @ np.concatenate(lags)

    def restraint(self, w: np.ndarray, q: Sequence[np.ndarray], R: np.ndarray, length: float) -> Restraint:
        """What the legs demand of the platform's rates, angles counted as `length` (m) times angle."""
        T = self._platform.selection(w) / np.where(np.array(self._platform.order) >= 3, length, 1.0)
        rows = []
        for leg, joints in zip(self._legs, q, strict=True):
            scale = leg.row_scale(length)
            N = _held_forces(leg, joints, scale)
            rows.append(N.T @ (scale[:, None] * leg.platform_side(R)) @ T)
        return Restraint(np.vstack(rows), self._platform.m)

    def _assembled(self, given: np.ndarray) -> np.ndarray:
        """d in the home pose; fixes the legs' home positions and end rotations.

        The coupling points come first, since legs without `end_rotation` take theirs from the home pose.
        """
        d = self._points_closed(np.array(given))
        r, R = self._platform.pose(np.concatenate([self._home_z, d]))
        for leg in self._legs:
            leg.assemble(r, R, np.zeros(0))
        u = np.concatenate([*(leg.home for leg in self._legs), d])
        result = self._closing(self._home_z).solved(u)
        if not self._closed(result):
            raise InputError(
                f"home: the legs do not close: error {result[1]:.2g} (m, rad) with {self._names} near "
                f"{np.round(given, 6).tolist()}"
            )
        self._home_u = result[0]
        for leg, joints in zip(self._legs, self.split(result[0])[0], strict=True):
            leg.home = joints
        return result[0][self._starts[-1] :]

    def _points_closed(self, d: np.ndarray) -> np.ndarray:
        """d near the given one with which all coupling points can be reached, the smallest change."""
        r, R = self._platform.pose(np.concatenate([self._home_z, d]))
        starts = [leg.nearest(r, R) for leg in self._legs]
        if max(error for _, error, _ in starts) <= CLOSURE_TOLERANCE:
            return d
        rows = [leg.whole_rows for leg in self._legs]

        u = np.concatenate([*(start for start, _, _ in starts), d])
        attempt = self._closing(self._home_z, rows).solved(u)
        if not self._closed(attempt):
            raise InputError(
                f"home: the legs do not reach their coupling points: error {attempt[1]:.2g} m with "
                f"{self._names} near {np.round(d, 6).tolist()}"
            )
        return attempt[0][self._starts[-1] :]

    def _from_joints(self, z: np.ndarray, q: Sequence[np.ndarray]) -> Attempt:
        """d from joint positions."""
        joints, first = np.concatenate(q), self._starts[-1]
        return ClosureEquations(
            range(self._k),
            lambda d: self._error(np.concatenate([joints, d]), z),
            lambda d: self._slope(np.concatenate([joints, d]), z)[:, first:],
        ).solved(self.home)

    def _way(self, z: np.ndarray, share: float) -> np.ndarray:
        return z if share == 1.0 else self._home_z + share * (z - self._home_z)

    def _closed(self, attempt: Attempt) -> bool:
        return attempt[1] <= CLOSURE_TOLERANCE * self._scale

    def _closing(self, z: np.ndarray, rows: Rows | None = None) -> ClosureEquations:
        """The closures of all legs, or some of their rows."""
        return ClosureEquations(
            range(self._starts[-1] + self._k),
            lambda u: self._error(u, z, rows),
            lambda u: self._slope(u, z, rows),
            CLOSURE_TOLERANCE * self._scale,
        )

    def _error(self, u: np.ndarray, z: np.ndarray, rows: Rows | None = None) -> np.ndarray:
        q, d = self.split(u)
        r, R = self._platform.pose(np.concatenate([z, d]))
        errors = [leg.residual(joints, r, R) for leg, joints in zip(self._legs, q, strict=True)]
        return np.concatenate(errors if rows is None else [e[k] for e, k in zip(errors, rows, strict=True)])

    def _slope(self, u: np.ndarray, z: np.ndarray, rows: Rows | None = None) -> np.ndarray:
        q, d = self.split(u)
        w = np.concatenate([z, d])
        _, R = self._platform.pose(w)
        T = self._platform.selection(w)[:, len(z) :]
        blocks = []
        for i, (leg, joints) in enumerate(zip(self._legs, q, strict=True)):
            J = leg.jacobian(joints)[0]
            block = np.zeros((len(J), len(u)))
            block[:, self._starts[i] : self._starts[i + 1]] = J
            block[:, self._starts[-1] :] = -leg.platform_side(R) @ T
            blocks.append(block if rows is None else block[rows[i]])
        return np.vstack(blocks)


def _held_forces(leg: LegSolver, q: np.ndarray, scale: np.ndarray | None = None) -> np.ndarray:
    """(rows, c) orthonormal: combinations of the closure rows that the joints do not move."""
    J = leg.jacobian(q)[0]
    if scale is not None:
        J = scale[:, None] * J
    left, values, _ = np.linalg.svd(J)
    rank = int(np.sum(values > _RANK * values[0]))
    return left[:, rank:]
