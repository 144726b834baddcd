"""Inverse kinematics of a leg: closed form where its table allows, damped Newton otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.parallel.description.robot_description import REVOLUTE, LegBase
from ocptip.parallel.kinematics.closed_form import closed_form, leg_type, nearest_branch
from ocptip.parallel.kinematics.closures import LegClosure

STEP_LIMIT = 0.5
"""Largest Newton step of one joint, rad or m."""

CLOSURE_TOLERANCE = 1e-10
"""Largest closure error that counts as closed, m (relative to the leg's length, at least 1 m) and rad."""

_EXACT = 1e-14
_ITERATIONS = 100
_PATIENCE = 5  # steps with less than a percent of progress each
_RESTARTS = 30
_SEED = 20181

_SHORTEST = 2.0**-12
_CURVATURE = 0.2  # of a step: largest part that Newton's method may add to the tangent's prediction

Way = Callable[[float], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Position (3,), m, rotation (3, 3) and values of the locked joints from home (0) to a pose (1)."""

Attempt = tuple[np.ndarray, float, int]
"""Joint positions, largest closure error, Newton steps."""


class LegSolver(LegClosure):
    """A leg that finds its joint positions.

    Attributes:
        home: (n,) joint positions in the home pose, once assembled.
    """

    def __init__(self, number: int, leg: LegBase, locked: Sequence[int] = ()) -> None:
        super().__init__(number, leg, locked)
        self._home: np.ndarray | None = None
        self._branch = leg.branch

    @property
    def home(self) -> np.ndarray:
        """(n,) joint positions in the home pose, rad or m."""
        assert self._home is not None, "assemble the leg first"
        return self._home

    @home.setter
    def home(self, q: np.ndarray) -> None:
        self._home = q

    def assemble(self, r: np.ndarray, R: np.ndarray, locked: np.ndarray) -> None:
        """Solve the home pose, fix an end rotation that follows from it, and remember the joint positions.

        Raises:
            InputError: the leg does not reach the pose.
        """
        given = np.array(self.leg.guess)
        if self.leg.serial and len(given) and not self.locked and leg_type(self.leg):
            start = self.solve_point(r, R, given[: self.point])[0]
            self._branch = nearest_branch(self.leg, self._local_target(r, R), start)
        if not self.leg.serial or self.end_rotations[0] is not None:
            self.home = self.solve(r, R, given if len(given) == self.n else None, locked)[0]
            return
        q = np.zeros(self.n)
        q[: len(given)] = given
        if self.locked:
            q[self.locked] = locked
            q[: self.point] = self._point_with_locked(q[: self.point], r + R @ self.couplings[0])
        else:
            q[: self.point] = self.solve_point(r, R, q[: self.point] if len(given) else None)[0]
        if len(given) < self.n:
            q[self.point :] = self._coupling_home(q)
        self.end_rotations[0] = self.frames(q)[0][-1].T @ R
        self.home = q

    def find(self, way: Way, guess: np.ndarray | None, search: bool = True) -> tuple[Attempt, str]:
        """Joint positions at the end of a path, and where they come from.

        "guess": by Newton's method from the guess. "home": without guess, by the closed form with its signs,
        or without one continued along the path. "search": none of these closed the leg, a search did,
        unless `search` is False.

        Raises:
            InputError: the leg does not reach the pose.
        """
        r, R, locked = way(1.0)
        if guess is not None:
            start = np.array(guess)
            start[self.locked] = locked
            result = self._newton(start, r, R, self.free)
            if result[1] <= CLOSURE_TOLERANCE * self.length:
                return result, "guess"
            if not search:
                raise InputError(f"pose: leg {self.number + 1} is not closed from the guess")
        elif leg_type(self.leg) and not self.locked:
            return self.solve(r, R, None, locked), "home"
        else:
            # in steps so short that the assembly stays
            attempt = continued(self.home, lambda q, share: self.followed(q, *way(share)))
            if attempt is not None:
                return attempt, "home"
        return self.solve(r, R, guess, locked), "search"

    def followed(self, q: np.ndarray, r: np.ndarray, R: np.ndarray, locked: np.ndarray) -> Attempt | None:
        """Joint positions at a pose nearby; None if they do not close the leg, or lie off the tangent."""
        start = q.copy()
        start[self.locked] = locked
        if not self.free:
            return start, 0.0, 0
        return self._closing(r, R, self.free).followed(start)

    def nearest(self, r: np.ndarray, R: np.ndarray) -> Attempt:
        """Joint positions (n,) whose coupling point comes nearest, coupling joints as guessed or at zero, and
        the distance, m; the guess of a branched leg and its closure error."""
        if not self.leg.serial:
            q = self.padded(np.array(self.leg.guess))
            return q, float(np.abs(self.residual(q, r, R)).max()), 0
        target = r + R @ self.couplings[0]
        q, error, used = self._first_closed(
            self._newton_point(start, target, range(self.point)) for start in self._point_starts(None)
        )
        full = self.padded(q)
        if len(self.leg.guess) == self.n:
            full[self.point :] = self.leg.guess[self.point :]
        return full, error, used

    def solve(self, r: np.ndarray, R: np.ndarray, guess: np.ndarray | None, locked: np.ndarray) -> Attempt:
        """Joint positions at a platform pose, all closure rows.

        Args:
            r, R: position (3,), m, and rotation (3, 3) of the platform.
            guess: (n,) or None: closed form, home values, or a seeded search.
            locked: values of the locked joints.

        Returns:
            q (n,), largest closure error, Newton iterations.

        Raises:
            InputError: the leg does not reach the pose.
        """
        staged = self.leg.serial and not self.locked

        def attempts():
            for number, start in enumerate(self._starts(r, R, guess)):
                start[self.locked] = locked
                if staged and (guess is None or number > 0):
                    start = self._newton(start, r, R, list(range(self.point, self.n)))[0]
                yield self._newton(start, r, R, self.free)

        q, error, used = self._first_closed(attempts())
        if error > CLOSURE_TOLERANCE * self.length:
            raise InputError(
                f"pose: leg {self.number + 1} does not reach it: closure error {error:.2g} (m, rad) after "
                f"{used} Newton steps at position {np.round(r, 6).tolist()} m"
            )
        return q, error, used

    def solve_point(self, r: np.ndarray, R: np.ndarray, guess: np.ndarray | None = None) -> Attempt:
        """Positions (point,) of the joints up to the coupling point: closed form, else Newton on three rows.

        Raises:
            InputError: the coupling point is out of reach.
        """
        target = r + R @ self.couplings[0]
        where = np.round(target, 6).tolist()
        refusal = f"pose: leg {self.number + 1} does not reach its coupling point {where}"
        q = closed_form(self.leg, self._local_target(r, R), self._branch) if guess is None else None
        if q is not None:
            error = float(np.abs(self._point_error(q, target)).max())
            if error > CLOSURE_TOLERANCE * self.length:  # closed forms of planar legs do not look across
                raise InputError(
                    f"{refusal}: it lies {error:.2g} m beside the plane in which the joints move it"
                )
            return q, error, 0
        if guess is None and leg_type(self.leg):
            raise InputError(refusal)
        q, error, used = self._first_closed(
            self._newton_point(start, target, range(self.point)) for start in self._point_starts(guess)
        )
        if error > CLOSURE_TOLERANCE * self.length:
            raise InputError(f"{refusal}: error {error:.2g} m after {used} Newton steps")
        return q, error, used

    def _first_closed(self, attempts: Iterator[Attempt]) -> Attempt:
        """The first attempt that closes the leg, or the best one; iterations of all."""
        best, worst, used = np.empty(0), np.inf, 0
        for q, error, iterations in attempts:
            used += iterations
            if error < worst:
                best, worst = q, error
            if worst <= CLOSURE_TOLERANCE * self.length:
                break
        return best, worst, used

    def _coupling_home(self, q: np.ndarray) -> np.ndarray:
        """Angles of the coupling joints in the home pose, see `SerialLeg.end_rotation`."""
        angles = np.zeros(self.n - self.point)
        axes = self.frames(q)[0][:, :, 2]
        if len(angles) == 2:
            turning = [row.sigma == REVOLUTE for row in self.leg.joint_rows]
            angles[0] = _turn_to_parallel(axes[self.point], axes[self.point + 1], axes[turning.index(True)])
        elif len(angles) > 2 and np.linalg.svd(axes[self.point :], compute_uv=False)[2] < 1e-9:
            angles[1] = np.pi / 2
        return angles

    def _point_with_locked(self, start: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Joints up to the coupling point with some of them locked."""
        q, error, steps = self._newton_point(start, target, [j for j in self.free if j < self.point])
        if error > CLOSURE_TOLERANCE * self.length:
            raise InputError(
                f"home: leg {self.number + 1} does not reach its coupling point from its guess: "
                f"error {error:.2g} m after {steps} Newton steps"
            )
        return q

    def _starts(self, r: np.ndarray, R: np.ndarray, guess: np.ndarray | None) -> Iterator[np.ndarray]:
        if guess is not None:
            yield np.array(guess, dtype=float)
        tail = np.zeros(self.n) if self._home is None else self._home
        if len(self.leg.guess) == self.n and self._home is None:
            tail = np.array(self.leg.guess)
        first = tail[: self.point]
        if self.leg.serial and not self.locked:
            first = self.solve_point(r, R)[0]
        yield np.concatenate([first, tail[self.point :]])
        rng = np.random.default_rng(_SEED)
        for _ in range(_RESTARTS):
            start = rng.uniform(-np.pi, np.pi, self.n)
            if self.leg.serial and not self.locked:
                start[: self.point] = first
            yield start

    def _point_starts(self, guess: np.ndarray | None) -> Iterator[np.ndarray]:
        for given in (guess, self.leg.guess or None, self._home):
            if given is not None:
                yield np.array(given, dtype=float)[: self.point]
        rng = np.random.default_rng(_SEED)
        for _ in range(_RESTARTS):
            yield rng.uniform(-np.pi, np.pi, self.point)

    def _newton(self, q: np.ndarray, r: np.ndarray, R: np.ndarray, free: list[int]) -> Attempt:
        return self._closing(r, R, free).solved(q) if free else (q, 0.0, 0)

    def _closing(self, r: np.ndarray, R: np.ndarray, free: list[int]) -> ClosureEquations:
        return ClosureEquations(
            free,
            lambda q: self.residual(q, r, R),
            lambda q: self.jacobian(q)[0][:, free],
            CLOSURE_TOLERANCE * self.length,
        )

    def _local_target(self, r: np.ndarray, R: np.ndarray) -> np.ndarray:
        return self.base.T @ (r + R @ self.couplings[0] - self.origin)

    def _newton_point(self, q: np.ndarray, target: np.ndarray, free: Sequence[int]) -> Attempt:
        return ClosureEquations(
            free,
            lambda q: self._point_error(q, target),
            lambda q: self.point_jacobian(q, (0, 1, 2))[:, free],
        ).solved(q)

    def _point_error(self, q: np.ndarray, target: np.ndarray) -> np.ndarray:
        return self.frames(self.padded(q))[1][self.end_rows[0]] - target


def _turn_to_parallel(about: np.ndarray, axis: np.ndarray, goal: np.ndarray) -> float:
    """Smallest angle about a unit vector that makes another one parallel to a third; 0 if none does."""
    best = np.pi
    for sign in (1.0, -1.0):
        if abs(about @ (axis - sign * goal)) > 1e-9:
            continue
        start, end = np.cross(about, axis), sign * np.cross(about, goal)
        if np.linalg.norm(start) > 1e-9:
            angle = np.arctan2(about @ np.cross(start, end), start @ end)
            best = min(best, float(angle), key=abs)
    return 0.0 if best == np.pi else best


def continued(start: np.ndarray, follow: Callable[[np.ndarray, float], Attempt | None]) -> Attempt | None:
    """From a start (share 0) to share 1 in steps so short that `follow` succeeds; None where it cannot."""
    q, error, used, reached, step = start, 0.0, 0, 0.0, 1.0
    while reached < 1.0:
        end = min(1.0, reached + step)
        result = follow(q, end)
        if result is None:
            step /= 2
            if step < _SHORTEST:
                return None
            continue
        q, error, used, reached, step = result[0], result[1], used + result[2], end, 2 * step
    return q, error, used


@dataclass(frozen=True)
class ClosureEquations:
    """Equations that some joints close by the Gauss-Newton method.

    Attributes:
        free: numbers of the unknowns that move.
        error: closure errors of all unknowns; slope: their derivatives by the free ones.
        tolerance: largest error that counts as closed.
    """

    free: Sequence[int]
    error: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]
    tolerance: float = CLOSURE_TOLERANCE

    def followed(self, start: np.ndarray) -> Attempt | None:
        """A solution nearby by one step along the tangent and Newton's method; None if it is not one to the
        tolerance, or lies off the tangent."""
        first = start.copy()
        step = np.linalg.lstsq(self.slope(start), -self.error(start), rcond=1e-10)[0]
        size = np.abs(step).max(initial=0.0)
        if size > STEP_LIMIT:
            return None
        first[self.free] += step
        q, remaining, used = self.solved(first)
        if remaining > self.tolerance or np.abs(q - first).max() > _CURVATURE * size + CLOSURE_TOLERANCE:
            return None
        return q, remaining, used + 1

    def solved(self, q: np.ndarray) -> Attempt:
        """With a step limit and halving; stops where there is no progress."""
        q = np.array(q, dtype=float)
        h = self.error(q)
        size, slow, iteration = np.linalg.norm(h), 0, 0
        for iteration in range(_ITERATIONS):
            if size < _EXACT:
                return q, float(np.abs(h).max()), iteration
            step = np.linalg.lstsq(self.slope(q), -h, rcond=1e-10)[0]
            step *= min(1.0, STEP_LIMIT / max(np.abs(step).max(), 1e-300))
            for _ in range(12):
                trial = q.copy()
                trial[self.free] += step
                h_trial = self.error(trial)
                size_trial = np.linalg.norm(h_trial)
                if size_trial < size:
                    break
                step = step / 2
            else:
                break
            slow = slow + 1 if size_trial > 0.99 * size else 0
            q, h, size = trial, h_trial, size_trial
            if (slow and size < 1e-9) or slow == _PATIENCE:
                break
        return q, float(np.abs(h).max()), iteration + 1
