"""Inverse kinematics: all branches of a gripper pose, in closed form where the arm has one, else by search.

The search is a Levenberg-Marquardt iteration from many seeded starts at once, repeated until further starts
find nothing new. Either way every branch returned has been put through the forward kinematics again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.errors import InputError, finite_array
from ocptip.robots.closed_form import closed_form_branches, closed_form_family
from ocptip.robots.kinematics import gripper_batch
from ocptip.robots.model import ArmModel, joint_states

RESIDUAL_TOLERANCE = 1e-10  # m and rad
SINGULAR_TOLERANCE = 1e-7  # m and rad, where rounding next to a singular pose leaves no better
_METHODS = ("auto", "closed-form", "search")
_STARTS_PER_ROUND = 128
_QUIET_ROUNDS = 3  # rounds without a new branch after which the search ends
_MAX_ROUNDS = 12
_MAX_ITERATIONS = 60
_SAME_BRANCH = 1e-5  # rad
_MAX_BRANCHES = 64
_LIMIT_SLACK = 1e-9  # rad


@dataclass(frozen=True, eq=False)
class InverseKinematics:
    """Branches of one pose, sorted by joint 1, then 2, and so on.

    Attributes:
        branches: (k, n), rad, within the joint limits unless asked otherwise; of the copies an angle has
            every full turn, the one nearest to `near`.
        residuals: (k,): largest error of position (m) and orientation (rad) after forward kinematics; at most
            1e-10, or 1e-7 next to a singular pose where rounding leaves no better.
        conditioning: (k,): smallest singular value of the Jacobian (lengths in units of the arm's reach);
            near zero the branch is singular: it may be one of a continuum or a double root.
        outside_limits: number of further branches that violate joint limits.
        method: "closed-form" or "search".
        family: name of the closed form's family, or None.
        starts, iterations: of the search (0 in closed form).
        seed: of the search.
    """

    branches: np.ndarray
    residuals: np.ndarray
    conditioning: np.ndarray
    outside_limits: int
    method: str
    family: str | None
    starts: int
    iterations: int
    seed: int

    def nearest(self, q: np.ndarray) -> np.ndarray:
        """The branch (n,), rad, with the smallest sum of squared differences to q (n,), rad."""
        wanted = finite_array("q", q, (self.branches.shape[1],))
        return self.branches[np.argmin(((self.branches - wanted) ** 2).sum(axis=1))]

    def to_dict(self) -> dict[str, object]:
        """Plain lists and numbers for JSON; angles in rad."""
        return {
            "branches_rad": self.branches.tolist(),
            "residuals": self.residuals.tolist(),
            "conditioning": self.conditioning.tolist(),
            "outside_limits": self.outside_limits,
            "method": self.method,
            "family": self.family,
            "starts": self.starts,
            "iterations": self.iterations,
            "seed": self.seed,
        }


def solve_inverse_kinematics(
    model: ArmModel,
    position: np.ndarray,
    rotation: np.ndarray,
    *,
    method: str = "auto",
    near: np.ndarray | None = None,
    within_limits: bool = True,
    seed: int = 0,
) -> InverseKinematics:
    """All joint angles that bring the gripper to a pose.

    Args:
        model: the arm, any number of joints. With more than six the solutions form a continuum and the search
            returns up to 64 points of it; with fewer most poses are out of reach.
        position: (3,), m, of G in the base frame.
        rotation: (3, 3), gripper to base axes.
        method: "auto" (closed form if the arm has one), "closed-form" or "search".
        near: (n,), rad: which copy of an angle to take where limits leave several; zeros by default.
        within_limits: leave out branches that violate joint limits.
        seed: of the search's starts.

    Raises:
        InputError: unreachable pose (with the nearest miss, or the limits in the way), not a rotation,
            unknown method, no closed form for this arm.
    """
    goal = finite_array("position", position, (3,))
    turn = finite_array("rotation", rotation, (3, 3))
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-8 or np.linalg.det(turn) < 0:
        raise InputError(f"rotation: not a rotation matrix: {turn.tolist()}")
    if method not in _METHODS:
        raise InputError(f"method: must be one of {', '.join(_METHODS)}, got {method!r}")
    family = closed_form_family(model)
    if method == "closed-form" and family is None:
        raise InputError(f"method: arm {model.name!r} has no closed form; use 'search'")
    wanted = np.zeros(model.n) if near is None else finite_array("near", near, (model.n,))

    starts = iterations = 0
    if method == "search" or family is None:
        used = "search"
        found, starts, iterations = _search(model, goal, turn, seed)
    else:
        used = "closed-form"
        found = _polished(model, closed_form_branches(model, goal, turn), goal, turn)
    if not len(found):
        raise InputError(_miss_message(model, goal, turn, seed))
    inside, found_in_limits = _copies_within_limits(model, found, wanted)
    branches = found_in_limits[inside] if within_limits else found_in_limits
    if not len(branches):
        raise InputError(_limits_message(model, found_in_limits))
    branches = branches[np.lexsort(np.round(branches, 7).T[::-1])]
    return InverseKinematics(
        branches=branches,
        residuals=pose_residuals(model, branches, goal, turn),
        conditioning=_conditioning(model, branches),
        outside_limits=int((~inside).sum()),
        method=used,
        family=family,
        starts=starts,
        iterations=iterations,
        seed=seed,
    )


def pose_residuals(model: ArmModel, q: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Largest component of position error (m) and rotation-vector error (rad) at q (N, n), rad; (N,)."""
    states, _ = joint_states("q", q, model.n)
    return np.abs(_errors(model, states, position, rotation)[0]).max(axis=1)


def _search(
    model: ArmModel, position: np.ndarray, rotation: np.ndarray, seed: int
) -> tuple[np.ndarray, int, int]:
    """Branches (k, n) in (-pi, pi], number of starts and iterations."""
    random = np.random.default_rng(seed)
    low = np.maximum(model.limits.angle_min, -np.pi)
    high = np.minimum(model.limits.angle_max, np.pi)
    found = np.empty((0, model.n))
    quiet = starts = iterations = 0
    for turn in range(_MAX_ROUNDS):
        # The first rounds start within the limits; later ones anywhere, to see what lies beyond.
        unit = random.random((_STARTS_PER_ROUND, model.n))
        first = low + unit * (high - low) if turn % 2 == 0 else np.pi * (2 * unit - 1)
        solutions, steps = _levenberg_marquardt(model, first, position, rotation)
        starts += len(first)
        iterations += steps
        known = len(found)
        found = _distinct(found, solutions)
        quiet = 0 if len(found) > known else quiet + 1
        if quiet >= _QUIET_ROUNDS or len(found) >= _MAX_BRANCHES:
            break
    return found, starts, iterations


def _levenberg_marquardt(
    model: ArmModel, first: np.ndarray, position: np.ndarray, rotation: np.ndarray
) -> tuple[np.ndarray, int]:
    """Solutions (k, n) reached from the starts (N, n) and the number of iterations, all starts at once."""
    q = first.copy()
    error, jacobian = _errors(model, q, position, rotation)
    damping = np.full(len(q), 1e-2)
    steps = 0
    while steps < _MAX_ITERATIONS:
        active = np.abs(error).max(axis=1) > RESIDUAL_TOLERANCE / 100
        active &= damping < 1e6
        if not active.any():
            break
        steps += 1
        e, J, lam = error[active], jacobian[active], damping[active]
        step = _damped_step(J, e, lam)
        step /= np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True))  # at most 1 rad per joint
        trial = q[active] + step
        trial_error, trial_jacobian = _errors(model, trial, position, rotation)
        better = (trial_error**2).sum(axis=1) < (e**2).sum(axis=1)
        index = np.flatnonzero(active)
        accepted = index[better]
        q[accepted], error[accepted], jacobian[accepted] = (
            trial[better],
            trial_error[better],
            trial_jacobian[better],
        )
        damping[index] = np.where(better, np.maximum(lam * 0.1, 1e-24), lam * 5)
    good = np.abs(error).max(axis=1) <= RESIDUAL_TOLERANCE
    return q[good], steps


def _damped_step(J: np.ndarray, e: np.ndarray, damping: np.ndarray) -> np.ndarray:
    """Minimisers (N, n) of |J s - e|^2 + damping |s|^2."""
    if damping.min() > 1e-10:
        normal = J.transpose(0, 2, 1) @ J + damping[:, None, None] * np.eye(J.shape[2])
        return np.linalg.solve(normal, J.transpose(0, 2, 1) @ e[:, :, None])[:, :, 0]
    # Close to the goal damping fades; next to singular poses the normal equations then lose all digits.
    u, s, vt = np.linalg.svd(J, full_matrices=False)
    along = (e[:, None, :] @ u)[:, 0] * s / (s**2 + damping[:, None])
    return (along[:, None, :] @ vt)[:, 0]


def _errors(
    model: ArmModel, q: np.ndarray, position: np.ndarray, rotation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pose errors (N, 6), m then rotation vector in rad, base axes, and the Jacobian (N, 6, n)."""
    at, turned, jacobian = gripper_batch(model)(q)
    turn = Rotation.from_matrix(rotation @ turned.transpose(0, 2, 1)).as_rotvec()
    return np.hstack([position - at, turn]), jacobian


def _polished(model: ArmModel, q: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Closed-form branches that pass forward kinematics; double roots get their lost digits back."""
    if not len(q):
        return q
    good = pose_residuals(model, q, position, rotation) <= RESIDUAL_TOLERANCE
    rough, _ = _levenberg_marquardt(model, q[~good], position, rotation)
    branches = np.vstack([q[good], rough])
    if not len(branches):
        # Within 1e-7 rad of a singular pose rounding leaves no better branch than this one, and no direction
        # in which to look for one; its residual says how good it is.
        branches = q[pose_residuals(model, q, position, rotation) <= SINGULAR_TOLERANCE]
    return _distinct(np.empty((0, model.n)), branches)


def _distinct(known: np.ndarray, found: np.ndarray) -> np.ndarray:
    """`known` (k, n) and after it the new ones of `found` (m, n), wrapped to (-pi, pi]."""
    result = list(known)
    for q in np.arctan2(np.sin(found), np.cos(found)):
        if len(result) >= _MAX_BRANCHES:
            break
        if result:
            gap = q - np.array(result)
            gap = np.abs(np.arctan2(np.sin(gap), np.cos(gap))).max(axis=1)
            if gap.min() < _SAME_BRANCH:
                continue
        result.append(q)
    return np.array(result).reshape(-1, known.shape[1])


def _copies_within_limits(
    model: ArmModel, found: np.ndarray, near: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whether each branch (k, n) fits the limits (k,), and its copy (k, n) nearest to `near` within them."""
    low = model.limits.angle_min - _LIMIT_SLACK
    high = model.limits.angle_max + _LIMIT_SLACK
    turns = np.round((near - found) / (2 * np.pi))
    # Whole turns that keep an angle inside; where none does, the window is empty and `turns` stays.
    lowest, highest = np.ceil((low - found) / (2 * np.pi)), np.floor((high - found) / (2 * np.pi))
    fits = lowest <= highest
    turns = np.where(fits, np.clip(turns, lowest, np.maximum(lowest, highest)), turns)
    copies = found + 2 * np.pi * turns
    return fits.all(axis=1), copies


def _conditioning(model: ArmModel, q: np.ndarray) -> np.ndarray:
    jacobian = gripper_batch(model)(q)[2].copy()
    jacobian[:, :3] /= max(float(np.linalg.norm(model.offsets, axis=1).sum()), 1e-12)
    return np.linalg.svd(jacobian, compute_uv=False)[:, -1]


def _miss_message(model: ArmModel, position: np.ndarray, rotation: np.ndarray, seed: int) -> str:
    q = np.pi * (2 * np.random.default_rng(seed).random((_STARTS_PER_ROUND, model.n)) - 1)
    for _ in range(_MAX_ITERATIONS):
        error, J = _errors(model, q, position, rotation)
        normal = J.transpose(0, 2, 1) @ J + 1e-3 * np.eye(model.n)
        q = q + np.linalg.solve(normal, J.transpose(0, 2, 1) @ error[:, :, None])[:, :, 0]
    best = min(_errors(model, q, position, rotation)[0], key=lambda e: float(e @ e))
    where = ", ".join(f"{1e3 * x:.1f}" for x in position)
    return (
        f"pose: arm {model.name!r} cannot reach position ({where}) mm with this orientation; the nearest of "
        f"{_STARTS_PER_ROUND} tries misses by {1e3 * np.linalg.norm(best[:3]):.2f} mm and "
        f"{np.rad2deg(np.linalg.norm(best[3:])):.2f} degrees"
    )


def _limits_message(model: ArmModel, branches: np.ndarray) -> str:
    low, high = model.limits.angle_min, model.limits.angle_max
    excess = np.maximum(np.maximum(low - branches, branches - high), 0)
    branch = int(np.argmin(excess.max(axis=1)))
    joint = int(np.argmax(excess[branch]))
    return (
        f"pose: reachable only beyond joint limits ({len(branches)} branches); the nearest needs "
        f"{model.joint_names[joint]!r} at {np.rad2deg(branches[branch, joint]):.2f} degrees, limits "
        f"{np.rad2deg(low[joint]):.2f} to {np.rad2deg(high[joint]):.2f}"
    )
