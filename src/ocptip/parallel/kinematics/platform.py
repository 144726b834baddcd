"""Inverse and forward kinematics of a parallel robot, all joints included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, SolverError, finite_array
from ocptip.basics.write import Record
from ocptip.numerics.vectors import nearest_turn
from ocptip.parallel.description.frames import PlatformCoordinates
from ocptip.parallel.description.robot_description import REVOLUTE, RobotDescription
from ocptip.parallel.kinematics.closed_form import leg_type
from ocptip.parallel.kinematics.closures import LegMotion, PlatformMotion
from ocptip.parallel.kinematics.dependent import DependentCoordinates
from ocptip.parallel.kinematics.leg_solver import CLOSURE_TOLERANCE, STEP_LIMIT, LegSolver, Way

_ITERATIONS = 100


@dataclass(frozen=True, eq=False)
class JointPositions(Record):
    """All joint positions at a pose, with the evidence.

    Attributes:
        q: per leg (n_f,), rad or m.
        residual: largest closure error, m or rad.
        iterations: Newton steps, all legs.
        assembly: "home": that of the home pose, legs with closed forms with their signs, others connected to
            home by the straight line in the coordinates; "guess": by Newton's method from the guess;
            "search": some leg, see `searched`, was closed by a search, in whatever assembly.
        searched: legs from 0 that were: the straight line from home leads them through a singular pose or out
            of reach, or the guess does not lead there.
    """

    q: tuple[np.ndarray, ...]
    residual: float
    iterations: int
    assembly: str = "home"
    searched: tuple[int, ...] = ()

    def to_dict(self) -> dict[str, object]:
        """Plain data; legs from 1."""
        return {**super().to_dict(), "searched": [leg + 1 for leg in self.searched]}


@dataclass(frozen=True, eq=False)
class ForwardPose(Record):
    """Solution of the forward kinematics.

    Attributes:
        z: (m,) free platform coordinates, then redundant joints.
        joints: all joint positions there.
        residual: largest error of the motor positions, rad or m.
        iterations: Newton steps.
        assembly_mode: sign of det J_a (1, -1; 0 if J_a is not square): solutions with different signs belong
            to different assembly modes.
    """

    z: np.ndarray
    joints: JointPositions
    residual: float
    iterations: int
    assembly_mode: int


@dataclass(frozen=True, eq=False)
class RobotMotion(PlatformMotion):
    """Position and rates of everything at one instant; `legs`: motion of every leg."""

    legs: tuple[LegMotion, ...]


@dataclass(frozen=True, eq=False)
class JointRates:
    """Positions, speeds and accelerations of all joints, coupling joints included.

    Attributes:
        q, qd, qdd: per leg (n_f,).
        residual: largest closure error of the positions, m or rad.
    """

    q: tuple[np.ndarray, ...]
    qd: tuple[np.ndarray, ...]
    qdd: tuple[np.ndarray, ...]
    residual: float


class Kinematics:
    """Kinematics of a robot; assembles it once in its home pose.

    Args:
        description: of the robot.

    Attributes:
        along: finds the platform's dependent coordinates; None if it has none.

    Raises:
        InputError: a leg does not reach the home pose.
    """

    def __init__(self, description: RobotDescription) -> None:
        self.description = description
        self.platform = PlatformCoordinates(description.platform)
        locked: list[list[int]] = [[] for _ in description.legs]
        self._rho: list[list[int]] = [[] for _ in description.legs]
        for k, (leg, joint) in enumerate(description.redundant):
            locked[leg].append(joint)
            self._rho[leg].append(self.platform.m + k)
        self.legs = [
            LegSolver(i, leg, joints)
            for i, (leg, joints) in enumerate(zip(description.legs, locked, strict=True))
        ]
        self.along: DependentCoordinates | None = None
        if self.platform.dependent:
            self.along = DependentCoordinates(description, self.platform, self.legs)
            return
        r, R = self.pose(description.home)
        for leg, rho in zip(self.legs, self._rho, strict=True):
            leg.assemble(r, R, description.home[rho])

    @property
    def m(self) -> int:
        """Number of coordinates."""
        return self.description.m

    def coordinates(self, name: str, value: ArrayLike) -> np.ndarray:
        """Check m numbers."""
        return finite_array(name, value, (self.m,))

    def pose(self, z: np.ndarray, q: Sequence[np.ndarray] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,), m, and rotation (3, 3) of the platform.

        Args:
            z: (m,).
            q: all joint positions per leg, used where coordinates depend on z; None: of the home assembly.
        """
        return self.platform.pose(self.moving(z, q))

    def sticks(self, z: np.ndarray, q: Sequence[np.ndarray] | None = None) -> list[np.ndarray]:
        """Lines (k, 3), m, robot axes: the bodies of the legs, and the platform between its couplings.

        Joint positions q per leg are those of the home assembly where not given.
        """
        lines, held, q = [], [], self.joints(z).q if q is None else q
        r, turn = self.pose(z, q)
        for leg, values in zip(self.legs, q, strict=True):
            points = np.vstack([leg.origin, leg.frames(values)[1]])
            lines += [points[[parent + 1, k]] for k, parent in enumerate(leg.topology.parents, 1)]
            held += [r + turn @ point for point in leg.couplings]
        return [*lines, np.array([*held, held[0]])] if held else lines

    def moving(self, z: np.ndarray, q: Sequence[np.ndarray] | None = None) -> np.ndarray:
        """All coordinates of the platform that move: the free ones, then the dependent ones."""
        if self.along is None:
            return z[: self.platform.m]
        return self.along.at(z, self.joints(z).q if q is None else q)

    def joints(
        self, z: ArrayLike, guess: Sequence[np.ndarray] | None = None, *, search: bool = True
    ) -> JointPositions:
        """All joint positions at a pose, coupling joints included.

        Args:
            z: (m,).
            guess: per leg (n_f,), e.g. of the pose before; None: closed form, or from home on along the
                straight line in the coordinates.
            search: for joint positions in any assembly where the guess does not lead to some.

        Raises:
            InputError: a leg does not reach the pose.
        """
        z = self.coordinates("z", z)
        if guess is not None:
            guess = [finite_array(f"guess[{i + 1}]", guess[i], (leg.n,)) for i, leg in enumerate(self.legs)]
        if self.along is not None:
            (u, error, used), origin = self.along.solve(z, guess, search)
            searched = tuple(range(len(self.legs))) if origin == "search" else ()
            return JointPositions(self.along.split(u)[0], error, used, origin, searched)
        way, results, origins = self._paths(z), [], []
        for i, leg in enumerate(self.legs):
            start = None if guess is None else guess[i]
            attempt, origin = leg.find(way[i], start, search)
            results.append(attempt)
            origins.append(origin)
        return _joint_positions(results, origins)

    def joints_nearby(self, z: np.ndarray, q: Sequence[np.ndarray]) -> Sequence[np.ndarray] | None:
        """Joint positions at a pose in the assembly of others, by one step along the legs' tangents and
        Newton's method.

        Args:
            z: (m,).
            q: per leg (n_f,), in a pose nearby.

        Returns:
            None where a leg does not close so.
        """
        if self.along is not None:
            return None
        results = []
        for way, leg, start in zip(self._paths(z), self.legs, q, strict=True):
            if (attempt := leg.followed(start, *way(1.0))) is None:
                return None
            results.append(attempt[0])
        return results

    def point_joints(self, z: ArrayLike, guess: Sequence[np.ndarray] | None = None) -> JointPositions:
        """Joint positions up to the coupling points only.

        Raises:
            InputError: a coupling point is out of reach, or the legs are not serial.
        """
        z = self.coordinates("z", z)
        r, R = self.pose(z)
        way, results, origins = self._paths(z), [], []
        for i, leg in enumerate(self.legs):
            if not leg.leg.serial or leg.locked:
                raise InputError(f"leg {i + 1}: is branched or has redundant joints; use the complete leg")
            start = None if guess is None else finite_array(f"guess[{i + 1}]", guess[i], (leg.point,))
            if start is None and not leg_type(leg.leg):
                (q, error, used), origin = leg.find(way[i], None)
                results.append((q[: leg.point], error, used))
            else:
                origin = "home" if start is None else "guess"
                results.append(leg.solve_point(r, R, start))
            origins.append(origin)
        return _joint_positions(results, origins)

    def _paths(self, z: np.ndarray) -> list[Way]:
        """Per leg the straight line from home to z."""
        home = self.description.home

        def way(rho: list[int]) -> Way:
            def at(share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
                there = z if share == 1.0 else home + share * (z - home)
                return (*self.pose(there), there[rho])

            return at

        return [way(rho) for rho in self._rho]

    def motion(self, z: np.ndarray, s: np.ndarray, q: Sequence[np.ndarray], *, complete: bool) -> RobotMotion:
        """Rates at given joint positions.

        Args:
            z, s: (m,) coordinates and quasi-velocities.
            q: per leg, (n_f,) or, if not `complete`, (n,).
            complete: all joints by least squares, else joints up to the coupling point by J_B^-1.
        """
        free = self.platform.m
        moving = self.moving(z, q)
        r, R = self.platform.pose(moving)
        if self.along is None:
            T = self.platform.selection(moving)
            drift = self.platform.selection_drift(moving, s[:free])
        else:
            T, drift = self.along.twist(moving, s, q, R)
        T = np.hstack([T, np.zeros((6, self.m - free))])
        platform, legs, rows = PlatformMotion(z, s, r, R, T, drift, T @ s), [], self.description.position_rows
        for leg, joints, rho in zip(self.legs, q, self._rho, strict=True):
            if complete:
                legs.append(leg.motion(joints, platform, rho))
            else:
                legs.append(leg.point_motion(joints[: leg.point], platform, rows))
        return RobotMotion(**vars(platform), legs=tuple(legs))

    def quasi(self, z: np.ndarray, zd: np.ndarray, zdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """s' = H z' and s'' = H z'' + H' z' (3.41)."""
        H, D = self.rate_matrices(z, zd)
        return H @ zd, H @ zdd + D @ zd

    def rate_matrices(self, z: np.ndarray, zd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H and H', (m, m); ones for redundant joints."""
        free = self.platform.m
        H, D = np.eye(self.m), np.zeros((self.m, self.m))
        H[:free, :free] = self.platform.rates(z[:free])
        D[:free, :free] = self.platform.rates_derivative(z[:free], zd[:free])
        return H, D

    def actuated_jacobian(self, motion: RobotMotion) -> np.ndarray:
        """J_a (n_a, m): q_a' = J_a s' (3.45, 3.46)."""
        return np.array([motion.legs[leg].Jq[joint] for leg, joint in self.description.actuated])

    def forward(
        self, qa: ArrayLike, guess: ArrayLike | None = None, joints: Sequence[np.ndarray] | None = None
    ) -> ForwardPose:
        """Platform pose from motor positions, Newton with J_a.

        Args:
            qa: (n_a,) motor positions, rad or m.
            guess: (m,) pose to start from; default home. It decides which of several solutions results.
            joints: joint positions at the guess, per leg.

        Raises:
            SolverError: no convergence; the message names the residual.
            InputError: wrong shapes, or the guess is out of reach.
        """
        description = self.description
        qa = finite_array("qa", qa, (len(description.actuated),))
        start = self.coordinates("guess", description.home if guess is None else guess)
        z, state = start, self.joints(start, joints)
        before = size = np.inf
        for iteration in range(_ITERATIONS):
            error = _wrapped(self._motors(state.q) - qa, description)
            size = float(np.abs(error).max())
            # The last steps of Newton's method bring nothing but cost nothing: stop where rounding does.
            if size == 0.0 or (size < CLOSURE_TOLERANCE and size > 0.1 * before):
                Ja = self._motor_jacobian(z, state.q)
                sign = int(np.sign(np.linalg.det(Ja))) if Ja.shape[0] == Ja.shape[1] else 0
                return ForwardPose(z, state, size, iteration, sign)
            before = size
            Ja = self._motor_jacobian(z, state.q) @ self.rate_matrices(z, np.zeros(self.m))[0]
            step = np.linalg.lstsq(Ja, -error, rcond=1e-12)[0]
            step *= min(1.0, STEP_LIMIT / max(np.abs(step).max(), 1e-300))
            z, state = self._walk(z, step, state, size, qa)
        raise SolverError(
            f"forward kinematics: no pose reached in {_ITERATIONS} steps from guess {start.tolist()}; motor "
            f"positions still differ by {size:.2g}"
        )

    def _walk(
        self, z: np.ndarray, step: np.ndarray, state: JointPositions, size: float, qa: np.ndarray
    ) -> tuple[np.ndarray, JointPositions]:
        """Longest of the halved steps that stays reachable and comes nearer; else the shortest."""
        best = z, state
        for _ in range(12):
            try:
                trial = self.joints(z + step, state.q)
            except InputError:
                step = step / 2
                continue
            best = z + step, trial
            error = np.abs(_wrapped(self._motors(trial.q) - qa, self.description)).max()
            if error < size:
                return best
            step = step / 2
        return best

    def _motors(self, q: Sequence[np.ndarray]) -> np.ndarray:
        return np.array([q[leg][joint] for leg, joint in self.description.actuated])

    def _motor_jacobian(self, z: np.ndarray, q: Sequence[np.ndarray]) -> np.ndarray:
        return self.actuated_jacobian(self.motion(z, np.zeros(self.m), q, complete=True))


def _joint_positions(
    result: Sequence[tuple[np.ndarray, float, int]], origins: Sequence[str]
) -> JointPositions:
    searched = tuple(i for i, origin in enumerate(origins) if origin == "search")
    return JointPositions(
        tuple(q for q, _, _ in result),
        max(error for _, error, _ in result),
        sum(used for _, _, used in result),
        "search" if searched else origins[0],
        searched,
    )


def _wrapped(error: np.ndarray, description: RobotDescription) -> np.ndarray:
    """Differences of revolute motors to within half a turn."""
    turns = [row.sigma == REVOLUTE for row in description.motor_rows]
    return np.where(turns, nearest_turn(error), error)
