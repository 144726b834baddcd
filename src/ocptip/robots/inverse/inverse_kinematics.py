"""Inverse kinematics: all IK solutions of a gripper pose, in closed form where the arm has one, else by
search.

The search is a Levenberg-Marquardt iteration from many seeded starts at once, repeated until further starts
find nothing new. A complete method for six turning axes takes about a second. All check every solution by
forward kinematics.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError, finite_array, rotation_matrix
from ocptip.robots.inverse.closed_form import closed_form_branches, closed_form_family
from ocptip.robots.inverse.complete import all_solutions
from ocptip.robots.inverse.joint_angles import nearest_copies, once_around, search_box
from ocptip.robots.inverse.joint_angles import within_limits as copies_within_limits
from ocptip.robots.inverse.pose_search import (
    NEAREST,
    NORMAL_DAMPING,
    levenberg_marquardt,
    miss_sizes,
    pose_errors,
    reached,
)
from ocptip.robots.kinematics import gripper_batch
from ocptip.robots.model import ArmModel, joint_states

RESIDUAL_TOLERANCE = 1e-10  # m and rad
SINGULAR_TOLERANCE = 1e-7  # m and rad, where rounding next to a singular pose leaves no better
_METHODS = ("auto", "closed-form", "search", "complete")
_STARTS_PER_ROUND = 128
_QUIET_ROUNDS = 3  # rounds without a new branch after which the search ends
_MAX_ROUNDS = 12
_MAX_ITERATIONS = 60
_SAME_BRANCH = 1e-5  # rad and m
_MAX_BRANCHES = 64
_LEAST_DAMPING = 1e-24
_ROTATION_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class InverseKinematics:
    """IK solutions of one pose, sorted by joint 1, then 2, and so on.

    Attributes:
        branches: (k, n), rad (sliding joints: m, here and below), within the joint limits unless asked
            otherwise; of the copies an angle has every full turn, the one nearest to `near`.
        residuals: (k,): largest error of position (m) and orientation (rad) after forward kinematics; at most
            1e-10, or 1e-7 next to a singular pose where rounding leaves no better. An arm that lacks an axis
            at the pose may miss it by 0.1 mm and 0.01 degrees; then the solutions are its nearest postures.
        conditioning: (k,): smallest singular value of the Jacobian (lengths in units of the arm's reach);
            near zero the solution is singular: it may be one of a continuum or a double root.
        outside_limits: number of further solutions that violate joint limits.
        method: "closed-form", "search" or "complete".
        family: name of the closed form's family, or None.
        starts, iterations: of the search (0 in closed form); complete: complex solutions that were followed.
        seed: of the search.
        proved: complete: number of solutions, within limits or not, whose existence is proved.
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
    proved: int | None = None

    def nearest(self, q: np.ndarray) -> np.ndarray:
        """The solution (n,), rad, with the smallest sum of squared differences to q (n,), rad."""
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
            "proved": self.proved,
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
        method: "auto" (closed form if the arm has one, else search), "closed-form", "search", or "complete":
            every isolated solution of six turning joints, by continuation.
        near: (n,), rad: which copy of an angle to take where limits leave several; zeros by default.
        within_limits: leave out solutions that violate joint limits.
        seed: of the search's starts.

    Raises:
        InputError: unreachable pose (with the nearest miss, or the limits that prevent it), not a rotation,
            unknown method, no closed form for this arm.
    """
    goal = finite_array("position", position, (3,))
    turn = rotation_matrix("rotation", rotation, tolerance=_ROTATION_TOLERANCE)
    if method not in _METHODS:
        raise InputError(f"method: must be one of {', '.join(_METHODS)}, got {method!r}")
    family = closed_form_family(model)
    if method == "closed-form" and family is None:
        raise InputError(f"method: arm {model.name!r} has no closed form; use 'search'")
    wanted = np.zeros(model.n) if near is None else finite_array("near", near, (model.n,))

    starts, iterations, proved = 0, 0, None
    if method == "complete":
        if model.n != 6 or model.links != 6 or np.any(model.prismatic):
            raise InputError(
                f"method: 'complete' is for six independent joints that turn, not {model.name!r}"
            )
        used = method
        result, proved, starts = all_solutions(model, goal, turn)
        result = _polished(model, result, goal, turn)
    elif method == "search" or family is None:
        used = "search"
        result, starts, iterations = _search(model, goal, turn, seed, _LEAST_DAMPING)
    else:
        used = "closed-form"
        result = _polished(model, closed_form_branches(model, goal, turn), goal, turn)
    if not len(result):
        used = "search"
        result, starts, iterations = _nearest(model, goal, turn, seed)
    copies = copies_within_limits(model, result, wanted)
    inside = np.isfinite(copies).all(axis=1)
    copies = np.where(np.isfinite(copies), copies, nearest_copies(model, result, wanted))
    branches = copies[inside] if within_limits else copies
    if not len(branches):
        raise InputError(_limits_message(model, copies))
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
        proved=proved,
    )


def pose_residuals(model: ArmModel, q: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Largest component of position error (m) and rotation-vector error (rad) at q (N, n), rad; (N,)."""
    states, _ = joint_states("q", q, model.n)
    return np.abs(pose_errors(model, states, position, rotation)[0]).max(axis=1)


def _search(
    model: ArmModel, position: np.ndarray, rotation: np.ndarray, seed: int, damping: float
) -> tuple[np.ndarray, int, int]:
    """Solutions (k, n), angles in (-pi, pi], number of starts and iterations.

    `damping` is the minimum of the iteration. With `NORMAL_DAMPING` nearest postures also count.
    """
    random = np.random.default_rng(seed)
    inside, anywhere = search_box(model), search_box(model, limits=False)
    values = np.empty((0, model.n))
    quiet = starts = iterations = 0
    for turn in range(_MAX_ROUNDS):
        # The first rounds start within the limits; later ones anywhere, to see what lies beyond.
        low, high = inside if turn % 2 == 0 else anywhere
        first = low + random.random((_STARTS_PER_ROUND, model.n)) * (high - low)
        solutions, steps = _solutions(model, first, position, rotation, damping)
        starts += len(first)
        iterations += steps
        known = len(values)
        values = distinct(model, values, solutions)
        quiet = 0 if len(values) > known else quiet + 1
        if quiet >= _QUIET_ROUNDS or len(values) >= _MAX_BRANCHES:
            break
    return values, starts, iterations


def _solutions(
    model: ArmModel, starts: np.ndarray, position: np.ndarray, rotation: np.ndarray, damping: float
) -> tuple[np.ndarray, int]:
    """Solutions (k, n) reached from the starts (N, n) and the number of iterations."""
    q, error, steps = levenberg_marquardt(
        model, starts, position, rotation, iterations=_MAX_ITERATIONS, least_damping=damping
    )
    if damping < NORMAL_DAMPING:
        return q[error <= RESIDUAL_TOLERANCE], steps
    return q[reached(*pose_errors(model, q, position, rotation), RESIDUAL_TOLERANCE)], steps


def _polished(model: ArmModel, q: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Closed-form solutions that pass forward kinematics; double roots get their lost digits back."""
    if not len(q):
        return q
    good = pose_residuals(model, q, position, rotation) <= RESIDUAL_TOLERANCE
    rough, _ = _solutions(model, q[~good], position, rotation, _LEAST_DAMPING)
    branches = np.vstack([q[good], rough])
    if not len(branches):
        # Within 1e-7 rad of a singular pose rounding leaves no better branch than this one, and no direction
        # in which to look for one; its residual says how good it is.
        branches = q[pose_residuals(model, q, position, rotation) <= SINGULAR_TOLERANCE]
    return distinct(model, np.empty((0, model.n)), branches)


def distinct(model: ArmModel, known: np.ndarray, outcome: np.ndarray) -> np.ndarray:
    """`known` (k, n) and after it the new ones of `found` (m, n), angles wrapped to (-pi, pi]."""
    result = list(known)
    for q in once_around(model, outcome):
        if len(result) >= _MAX_BRANCHES:
            break
        if result:
            gap = np.abs(once_around(model, q - np.array(result))).max(axis=1)
            if gap.min() < _SAME_BRANCH:
                continue
        result.append(q)
    return np.array(result).reshape(-1, known.shape[1])


def _conditioning(model: ArmModel, q: np.ndarray) -> np.ndarray:
    jacobian = gripper_batch(model)(q)[2].copy()
    jacobian[:, :3] /= max(model.reach, 1e-12)
    return np.linalg.svd(jacobian, compute_uv=False)[:, -1]


def _nearest(
    model: ArmModel, position: np.ndarray, rotation: np.ndarray, seed: int
) -> tuple[np.ndarray, int, int]:
    """What `_search` gives for the nearest postures of a pose that no posture reaches exactly.

    Raises:
        InputError: they miss it by more than `NEAREST`, or none is the nearest of its neighbourhood.
    """
    low, high = search_box(model, limits=False)
    starts = low + np.random.default_rng(seed).random((_STARTS_PER_ROUND, model.n)) * (high - low)
    q, _, _ = levenberg_marquardt(
        model, starts, position, rotation, iterations=_MAX_ITERATIONS, least_damping=NORMAL_DAMPING
    )
    errors, jacobian = pose_errors(model, q, position, rotation)
    if reached(errors, jacobian, RESIDUAL_TOLERANCE).any():
        return _search(model, position, rotation, seed, NORMAL_DAMPING)
    where = ", ".join(f"{1e3 * x:.1f}" for x in position)
    raise InputError(
        f"pose: arm {model.name!r} cannot reach position ({where}) mm with this orientation; the nearest of "
        f"{_STARTS_PER_ROUND} tries misses by {miss_text(errors)} (an arm that lacks an axis there "
        f"may miss by {1e3 * NEAREST[0]:g} mm and {np.rad2deg(NEAREST[1]):g} degrees); if "
        'part of the orientation does not matter, give orientation = "axis" or "free"'
    )


def miss_text(errors: np.ndarray) -> str:
    """The smallest of some pose errors (N, 6), in mm and degrees."""
    far, turn = miss_sizes(errors[np.argmin(np.linalg.norm(errors, axis=1))][None])[0]
    return f"{_digits(1e3 * far)} mm and {_digits(np.rad2deg(turn))} degrees"


def _digits(value: float) -> str:
    """Two decimals; more where these would be zero, down to rounding."""
    return f"{value:.2f}" if value >= 0.01 or value < 1e-12 else f"{value:.1g}"


def _limits_message(model: ArmModel, branches: np.ndarray) -> str:
    low, high = model.limits.angle_min, model.limits.angle_max
    excess = np.maximum(np.maximum(low - branches, branches - high), 0)
    branch = int(np.argmin(excess.max(axis=1)))
    joint = int(np.argmax(excess[branch]))
    slides = model.prismatic[joint]
    place, least, most = (
        f"{value:.4f}" if slides else f"{np.rad2deg(value):.2f}"
        for value in (branches[branch, joint], low[joint], high[joint])
    )
    return (
        f"pose: reachable only beyond joint limits ({len(branches)} IK solutions); the nearest needs "
        f"{model.joint_names[joint]!r} at {place} {'m' if slides else 'degrees'}, limits {least} to {most}"
    )
