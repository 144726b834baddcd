"""Numerical inverse kinematics: a Levenberg-Marquardt iteration for many starts or poses at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ocptip.basics.values import rotations
from ocptip.numerics.vectors import cross
from ocptip.robots.kinematics import gripper_batch
from ocptip.robots.model import ArmModel

Orientation = Literal["full", "axis", "free"]
"""What of an orientation must agree: all, the direction of one tool axis, or nothing."""

NEAREST = (1e-4, float(np.deg2rad(0.01)))
"""m and rad, by which the nearest pose of an arm that lacks an axis there may miss the wanted one."""

_FLAT = 1e-3  # slope of the miss relative to the miss, m per rad and rad per rad, below which it is least
_LOST = 1e-4  # m or rad per rad: what a whole radian moves by less than `NEAREST` is no axis
_PROBES = 8  # postures at which the axes are counted
_TOLERANCE = 1e-12  # m and rad, at which an iteration ends
_FIRST_DAMPING = 1e-2
_HOPELESS_DAMPING = 1e6
NORMAL_DAMPING = 1e-10  # with less, the normal equations lose all digits next to singular poses
_SEARCH_ITERATIONS = 40


def search(
    model: ArmModel,
    starts: np.ndarray,
    positions: np.ndarray,
    rotations: np.ndarray,
    orientation: Orientation = "full",
    tool_axis: np.ndarray | Sequence[float] = (0.0, 0.0, 1.0),
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest approach to many poses by damped Newton steps, each from another start, within joint limits.

    Args:
        model: any arm.
        starts: (N, n), rad.
        positions, rotations: (N, 3), m, and (N, 3, 3): the poses in the base frame.
        orientation: what must agree: "full", "axis" (the direction of `tool_axis` only) or "free" (nothing).
        tool_axis: (3,), gripper axes.

    Returns:
        Angles (N, n), rad, and the largest remaining error (N,), m and rad.
    """
    q, error, _ = levenberg_marquardt(
        model,
        starts,
        positions,
        rotations,
        orientation=orientation,
        tool_axis=tool_axis,
        bounds=(model.limits.angle_min, model.limits.angle_max),
        iterations=_SEARCH_ITERATIONS,
        least_damping=NORMAL_DAMPING,
    )
    return q, error


def levenberg_marquardt(
    model: ArmModel,
    starts: np.ndarray,
    positions: np.ndarray,
    rotations: np.ndarray,
    *,
    orientation: Orientation = "full",
    tool_axis: np.ndarray | Sequence[float] = (0.0, 0.0, 1.0),
    bounds: tuple[np.ndarray, np.ndarray] | None = None,
    iterations: int,
    least_damping: float,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Approach poses from many starts at once, at most 1 rad (sliding joints: 1 m) per joint and step.

    Args:
        model: any arm.
        starts: (N, n), rad.
        positions, rotations: (N, 3), m, and (N, 3, 3), or one pose for all: (3,) and (3, 3).
        orientation, tool_axis: see `search`.
        bounds: (n,) each, rad, at which angles are clipped.
        iterations: at most.
        least_damping: damping fades to this close to the goal; below 1e-10 steps take longer, and converge at
            singular poses.

    Returns:
        Angles (N, n), rad, the largest remaining error (N,), m and rad, and the number of iterations.
    """
    N, axis = len(starts), np.asarray(tool_axis)
    positions, rotations = np.broadcast_to(positions, (N, 3)), np.broadcast_to(rotations, (N, 3, 3))
    q = starts.copy() if bounds is None else np.clip(starts, *bounds)
    error, jacobian = pose_errors(model, q, positions, rotations, orientation, axis)
    jacobian = jacobian.copy()
    damping = np.full(N, _FIRST_DAMPING)
    steps = 0
    while steps < iterations:
        active = np.flatnonzero((np.abs(error).max(axis=1) > _TOLERANCE) & (damping < _HOPELESS_DAMPING))
        if not len(active):
            break
        steps += 1
        e, lam = error[active], damping[active]
        step = _damped_step(jacobian[active], e, lam)
        # Linearisation holds for small turns only: no joint moves by more than 1 rad (1 m) in a step.
        step /= np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True))
        trial = q[active] + step
        if bounds is not None:
            trial = np.clip(trial, *bounds)
        new, new_jacobian = pose_errors(model, trial, positions[active], rotations[active], orientation, axis)
        better = (new**2).sum(axis=1) < (e**2).sum(axis=1)
        taken = active[better]
        q[taken], error[taken], jacobian[taken] = trial[better], new[better], new_jacobian[better]
        # Damping falls towards Newton's method while steps help, and grows towards the gradient after a
        # failure.
        damping[active] = np.where(better, np.maximum(lam * 0.1, least_damping), lam * 5.0)
    return q, np.abs(error).max(axis=1), steps


def _damped_step(J: np.ndarray, e: np.ndarray, damping: np.ndarray) -> np.ndarray:
    """Minimisers (N, n) of |J s - e|^2 + damping |s|^2."""
    if damping.min() >= NORMAL_DAMPING:
        normal = J.transpose(0, 2, 1) @ J + damping[:, None, None] * np.eye(J.shape[2])
        return np.linalg.solve(normal, J.transpose(0, 2, 1) @ e[:, :, None])[:, :, 0]
    # Normal equations square the condition number; with little damping the singular values keep the digits.
    u, s, vt = np.linalg.svd(J, full_matrices=False)
    along = (e[:, None, :] @ u)[:, 0] * s / (s**2 + damping[:, None])
    return (along[:, None, :] @ vt)[:, 0]


def pose_errors(
    model: ArmModel,
    q: np.ndarray,
    position: np.ndarray,
    rotation: np.ndarray,
    orientation: Orientation = "full",
    tool_axis: np.ndarray | Sequence[float] = (0.0, 0.0, 1.0),
) -> tuple[np.ndarray, np.ndarray]:
    """Pose errors (N, 3 or 6), m then rotation vector in rad, base axes, and the Jacobian (N, 3 or 6, n).

    Args:
        q: (N, n), rad.
        position, rotation: (N, 3), m, and (N, 3, 3), or one pose for all.
        orientation, tool_axis: see `search`.
    """
    tcp_position, turned, jacobian = gripper_batch(model)(q)
    if orientation == "free":
        return position - tcp_position, jacobian[:, :3]
    if orientation == "full":
        turn = rotations().from_matrix(rotation @ turned.transpose(0, 2, 1)).as_rotvec()
        return np.hstack([position - tcp_position, turn]), jacobian
    have, want = np.broadcast_arrays(turned @ tool_axis, rotation @ tool_axis)
    across = cross(have, want)
    sine, cosine = np.linalg.norm(across, axis=1), np.sum(have * want, axis=1)
    # Opposite axes have no common normal: any direction across them is a shortest turn.
    side = cross(have, np.eye(3)[np.argmin(np.abs(have), axis=1)])
    direction = np.where(sine[:, None] > 1e-9, across / np.maximum(sine, 1e-9)[:, None], side)
    turn = np.arctan2(sine, cosine)[:, None] * np.where((sine > 1e-9) | (cosine < 0), 1.0, 0.0)[:, None]
    result = jacobian.copy()
    result[:, 3:] -= have[:, :, None] * np.einsum("ni,nij->nj", have, result[:, 3:])[:, None]
    return np.hstack([position - tcp_position, turn * direction]), result


def reached(error: np.ndarray, jacobian: np.ndarray, exactly: float) -> np.ndarray:
    """Which postures count as postures of a pose, (N,).

    Those that miss it by at most `exactly`. Besides, where the Jacobian lacks rank: those that miss it by at
    most `NEAREST` while no joint can reduce the miss, to first order. Where the rank is full, only an exact
    posture has no such joint, so nothing is accepted there that could be better.

    Args:
        error, jacobian: of `pose_errors`.
        exactly: m and rad.
    """
    slope = np.linalg.norm((error[:, None, :] @ jacobian)[:, 0], axis=1)
    size, (far, turn) = np.linalg.norm(error, axis=1), miss_sizes(error).T
    nearest = (far <= NEAREST[0]) & (turn <= NEAREST[1]) & (slope <= _FLAT * size)
    return (np.abs(error).max(axis=1) <= exactly) | nearest


def miss_sizes(error: np.ndarray) -> np.ndarray:
    """(N, 2), m and rad: lengths of the position error and of the rotation vector, of `pose_errors`."""
    return np.column_stack([np.linalg.norm(part, axis=1) for part in (error[:, :3], error[:, 3:])])


def effective_axes(
    model: ArmModel,
    orientation: Orientation = "full",
    tool_axis: np.ndarray | Sequence[float] = (0.0, 0.0, 1.0),
) -> int:
    """Number of the conditions of a pose that an arm can fulfil independently, at most 6, 5 or 3.

    It is the largest rank of the Jacobian at a few random postures.
    """
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (_PROBES, model.n))
    jacobian = pose_errors(model, q, np.zeros(3), np.eye(3), orientation, np.asarray(tool_axis))[1]
    return int(np.sum(np.linalg.svd(jacobian, compute_uv=False) > _LOST, axis=1).max())
