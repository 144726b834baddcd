"""Inverse kinematics of many gripper poses at once: closed forms over arrays, else a damped Newton search.

The closed forms are those of `ocptip.robots.closed_form` (where they are explained), written for arrays of
poses: branches that do not exist are NaN. Every branch is checked by forward kinematics.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.robots import ArmModel, closed_form_family, link_frames
from ocptip.robots.closed_form import SPHERICAL_SHOULDER, SPHERICAL_WRIST, THREE_PARALLEL
from ocptip.robots.kinematics import gripper_batch

CHECK_TOLERANCE = 1e-7  # m and rad
_EXCESS_TOLERANCE = 1e-8
_DEGENERATE = 1e-11
_ITERATIONS = 40
_LIMIT_SLACK = 1e-9  # rad


def has_closed_form(model: ArmModel) -> bool:
    """Whether :func:`branches` works for this arm."""
    return closed_form_family(model) is not None


def branches(model: ArmModel, positions: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """All branches of many poses in closed form.

    Args:
        model: an arm with a closed form.
        positions: (N, 3), m, of G in the base frame.
        rotations: (N, 3, 3), gripper to base axes.

    Returns:
        (N, 8, 6), rad: within the joint limits, of the copies an angle has every full turn the one nearest
        to zero; NaN where a branch does not exist or breaks the limits.
    """
    axes = _Axes(model)
    solver = {
        SPHERICAL_WRIST: _spherical_wrist,
        THREE_PARALLEL: _three_parallel,
        SPHERICAL_SHOULDER: _spherical_shoulder,
    }[closed_form_family(model)]
    R = rotations @ axes.zero_rotation.T
    p = positions - R @ axes.zero_position
    with np.errstate(invalid="ignore"):
        found = solver(axes, R, p)
    found = found.reshape(len(positions), -1, 6)
    found = within_limits(model, np.arctan2(np.sin(found), np.cos(found)))
    n, which = np.nonzero(np.isfinite(found).all(axis=2))
    at, turned, _ = gripper_batch(model)(found[n, which])
    error = np.maximum(np.abs(at - positions[n]).max(axis=1), np.abs(turned - rotations[n]).max(axis=(1, 2)))
    wrong = error > CHECK_TOLERANCE
    found[n[wrong], which[wrong]] = np.nan
    missing = ~np.isfinite(found).all(axis=2)
    found[missing] = np.nan
    return found


def within_limits(model: ArmModel, angles: np.ndarray) -> np.ndarray:
    """Copies (..., n) of angles, rad, whole turns away, nearest to zero within the limits; NaN if none."""
    low, high = model.limits.angle_min - _LIMIT_SLACK, model.limits.angle_max + _LIMIT_SLACK
    lowest, highest = np.ceil((low - angles) / (2 * np.pi)), np.floor((high - angles) / (2 * np.pi))
    turns = np.clip(np.round(-angles / (2 * np.pi)), lowest, np.maximum(lowest, highest))
    return np.where(lowest <= highest, angles + 2 * np.pi * turns, np.nan)


def search(
    model: ArmModel,
    starts: np.ndarray,
    positions: np.ndarray,
    rotations: np.ndarray,
    orientation: str = "full",
    tool_axis: np.ndarray = (0.0, 0.0, 1.0),
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest approach to many poses by damped Newton steps, each from its own start, within joint limits.

    Args:
        model: any arm.
        starts: (N, n), rad.
        positions, rotations: (N, 3), m, and (N, 3, 3): the poses in the base frame.
        orientation: "full", "axis" or "free", see `GripperTask`.
        tool_axis: (3,), gripper axes.

    Returns:
        Angles (N, n), rad, and the largest remaining error (N,), m and rad.
    """
    q = np.clip(starts, model.limits.angle_min, model.limits.angle_max)
    error, jacobian = _errors(model, q, positions, rotations, orientation, np.asarray(tool_axis))
    damping = np.full(len(q), 1e-2)
    for _ in range(_ITERATIONS):
        active = np.flatnonzero((np.abs(error).max(axis=1) > 1e-12) & (damping < 1e6))
        if not len(active):
            break
        e, J = error[active], jacobian[active]
        normal = J.transpose(0, 2, 1) @ J + damping[active, None, None] * np.eye(model.n)
        step = np.linalg.solve(normal, J.transpose(0, 2, 1) @ e[:, :, None])[:, :, 0]
        step /= np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True))
        trial = np.clip(q[active] + step, model.limits.angle_min, model.limits.angle_max)
        new, new_jacobian = _errors(
            model, trial, positions[active], rotations[active], orientation, np.asarray(tool_axis)
        )
        better = (new**2).sum(axis=1) < (e**2).sum(axis=1)
        taken = active[better]
        q[taken], error[taken], jacobian[taken] = trial[better], new[better], new_jacobian[better]
        damping[active] *= np.where(better, 0.1, 5.0)
        damping[active] = np.maximum(damping[active], 1e-10)
    return q, np.abs(error).max(axis=1)


def _errors(
    model: ArmModel,
    q: np.ndarray,
    positions: np.ndarray,
    rotations: np.ndarray,
    orientation: str,
    tool_axis: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (N, 3 or 6), base axes, and the Jacobian (N, 3 or 6, n) of the pose."""
    at, turned, jacobian = gripper_batch(model)(q)
    if orientation == "free":
        return positions - at, jacobian[:, :3].copy()
    if orientation == "full":
        turn = Rotation.from_matrix(rotations @ turned.transpose(0, 2, 1)).as_rotvec()
        return np.hstack([positions - at, turn]), jacobian.copy()
    have, want = turned @ tool_axis, rotations @ tool_axis
    cross = np.cross(have, want)
    sine, cosine = np.linalg.norm(cross, axis=1), np.sum(have * want, axis=1)
    side = np.cross(have, np.eye(3)[np.argmin(np.abs(have), axis=1)])
    direction = np.where(sine[:, None] > 1e-9, cross / np.maximum(sine, 1e-9)[:, None], side)
    turn = np.arctan2(sine, cosine)[:, None] * np.where((sine > 1e-9) | (cosine < 0), 1.0, 0.0)[:, None]
    result = jacobian.copy()
    result[:, 3:] -= have[:, :, None] * np.einsum("ni,nij->nj", have, result[:, 3:])[:, None]
    return np.hstack([positions - at, turn * direction]), result


class _Axes:
    """Axes at zero angles, base frame: directions w (6, 3), points Q (6, 3), gripper pose."""

    def __init__(self, model: ArmModel) -> None:
        frames = link_frames(model, np.zeros(model.n))
        self.w, self.Q = frames.rotations[:-1, :, 2], frames.origins[:-1]
        self.zero_rotation, self.zero_position = frames.rotations[-1], frames.origins[-1]

    def meeting_point(self, *joints: int) -> np.ndarray:
        """The common point of axes (counted from 1)."""
        across = [np.eye(3) - np.outer(self.w[j - 1], self.w[j - 1]) for j in joints]
        right = np.concatenate([P @ self.Q[j - 1] for P, j in zip(across, joints, strict=True)])
        return np.linalg.lstsq(np.vstack(across), right, rcond=None)[0]

    def turn(self, joint: int, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (..., 3, 3) and shifts (..., 3) of e_joint(angles)."""
        R = _rotation(self.w[joint - 1], angles)
        return R, self.Q[joint - 1] - R @ self.Q[joint - 1]


def _spherical_wrist(axes: _Axes, R: np.ndarray, p: np.ndarray) -> np.ndarray:
    w, Q = axes.w, axes.Q
    wrist = axes.meeting_point(4, 5, 6)
    goal = R @ wrist + p
    t1 = _onto_projection(w[0], goal - Q[0], w[1], w[1] @ (wrist - Q[0]), inverse=True)  # (N, 2)
    R1, p1 = axes.turn(1, t1)
    local = _transposed(R1, goal[:, None] - p1)  # (N, 2, 3)
    t2, t3 = _two_parallel(axes, wrist, local)  # (N, 2, 2)
    before = R1[:, :, None] @ axes.turn(2, t2)[0] @ axes.turn(3, t3)[0]
    rest = np.swapaxes(before, -1, -2) @ R[:, None, None]
    t4, t5, t6 = _three_turns(w[3], w[4], w[5], rest)  # (N, 2, 2, 2)
    return _stacked(t1[:, :, None, None], t2[..., None], t3[..., None], t4, t5, t6)


def _three_parallel(axes: _Axes, R: np.ndarray, p: np.ndarray) -> np.ndarray:
    w, Q = axes.w, axes.Q
    wrist = axes.meeting_point(5, 6)
    goal = R @ wrist + p
    t1 = _onto_projection(w[0], goal - Q[0], w[1], w[1] @ (wrist - Q[0]), inverse=True)  # (N, 2)
    R1, p1 = axes.turn(1, t1)
    rest = np.swapaxes(R1, -1, -2) @ R[:, None]
    t5 = _onto_projection(w[4], w[5], w[1], rest @ w[5] @ w[1])  # (N, 2, 2)
    R5, p5 = axes.turn(5, t5)
    across = np.swapaxes(R5, -1, -2) @ w[1]
    t6 = -_turn_onto(w[5], across, (np.swapaxes(rest, -1, -2) @ w[1])[:, :, None])
    R6, p6 = axes.turn(6, t6)
    # e_2 e_3 e_4 = e_1^-1 target (e_5 e_6)^-1
    R56, p56 = R5 @ R6, (R5 @ p6[..., None])[..., 0] + p5
    back, back_p = np.swapaxes(R56, -1, -2), -_transposed(R56, p56)
    target_p = _transposed(R1, p[:, None] - p1)
    arm = rest[:, :, None] @ back
    arm_p = (rest[:, :, None] @ back_p[..., None])[..., 0] + target_p[:, :, None]
    t2, t3 = _two_parallel(axes, Q[3], arm @ Q[3] + arm_p)  # (N, 2, 2, 2)
    last = np.swapaxes(axes.turn(2, t2)[0] @ axes.turn(3, t3)[0], -1, -2) @ arm[:, :, :, None]
    side = _perpendicular(w[3])
    t4 = _turn_onto(w[3], side, last @ side)
    return _stacked(t1[:, :, None, None], t2, t3, t4, t5[..., None], t6[..., None])


def _spherical_shoulder(axes: _Axes, R: np.ndarray, p: np.ndarray) -> np.ndarray:
    w = axes.w
    shoulder, elbow = axes.meeting_point(1, 2, 3), axes.meeting_point(3, 4, 5)
    reach, base6 = elbow - shoulder, axes.Q[5]
    seen = _transposed(R, shoulder - p)
    t6 = _at_distance(w[5], elbow - base6, seen - base6, np.linalg.norm(reach), inverse=True)  # (N, 2)
    R6, p6 = axes.turn(6, t6)
    inside = _transposed(R6, elbow - p6)
    moved = (R[:, None] @ inside[..., None])[..., 0] + p[:, None] - shoulder  # (N, 2, 3)
    t2 = _onto_projection(w[1], reach, w[0], moved @ w[0])  # (N, 2, 2)
    R2 = axes.turn(2, t2)[0]
    t1 = _turn_onto(w[0], R2 @ reach, moved[:, :, None])
    before = axes.turn(1, t1)[0] @ R2
    rest = np.swapaxes(before, -1, -2) @ (R[:, None] @ np.swapaxes(R6, -1, -2))[:, :, None]
    t3, t4, t5 = _three_turns(w[2], w[3], w[4], rest)  # (N, 2, 2, 2)
    return _stacked(t1[..., None], t2[..., None], t3, t4, t5, t6[:, :, None, None])


def _two_parallel(axes: _Axes, start: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles (..., 2) of e_2 e_3 start = goal, for parallel axes 2 and 3 and goals (..., 3)."""
    w, Q = axes.w, axes.Q
    flat = np.eye(3) - np.outer(w[1], w[1])
    distance = np.linalg.norm((goal - Q[1]) @ flat, axis=-1)
    t3 = _at_distance(w[2], flat @ (start - Q[2]), flat @ (Q[1] - Q[2]), distance)
    R3, p3 = axes.turn(3, t3)
    return _turn_onto(w[1], R3 @ start + p3 - Q[1], (goal - Q[1])[..., None, :]), t3


def _three_turns(a: np.ndarray, b: np.ndarray, c: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, ...]:
    """Angles (..., 2) with R(a, ta) R(b, tb) R(c, tc) = R, for R (..., 3, 3)."""
    tb = _onto_projection(b, c, a, R @ c @ a)
    Rb = _rotation(b, tb)
    ta = _turn_onto(a, Rb @ c, (R @ c)[..., None, :])
    side = _perpendicular(c)
    last = np.swapaxes(_rotation(a, ta) @ Rb, -1, -2) @ R[..., None, :, :]
    return ta, tb, _turn_onto(c, side, last @ side)


def _onto_projection(
    w: np.ndarray, v: np.ndarray, h: np.ndarray, value: np.ndarray, *, inverse: bool = False
) -> np.ndarray:
    """Angles (..., 2) with h . R(w, angle) v = value; with `inverse`, of R(w, -angle) instead; NaN: none."""
    along = np.sum(h * w, axis=-1)
    cosine = np.sum(h * v, axis=-1) - along * np.sum(v * w, axis=-1)
    sine = np.sum(h * np.cross(w, v), axis=-1)
    amplitude = np.hypot(cosine, sine)
    rest = value - along * np.sum(v * w, axis=-1)
    ratio = rest / np.maximum(amplitude, _DEGENERATE)
    sign = -1.0 if inverse else 1.0
    middle = np.arctan2(sine, cosine)
    spread = np.arctan2(np.sqrt(np.maximum((1 - ratio) * (1 + ratio), 0)), ratio)
    double = np.abs(ratio) >= 1
    out = (np.abs(rest) > amplitude + _EXCESS_TOLERANCE) | ~np.isfinite(rest + middle)
    first = np.where(out, np.nan, middle + spread)
    second = np.where(out | double, np.nan, middle - spread)
    open_angle = (amplitude < _DEGENERATE) & (np.abs(rest) < _DEGENERATE)
    first = np.where(open_angle, 0.0, first)
    second = np.where(open_angle, np.nan, second)
    return sign * np.stack([first, second], axis=-1)


def _at_distance(
    w: np.ndarray, v: np.ndarray, goal: np.ndarray, distance: np.ndarray, *, inverse: bool = False
) -> np.ndarray:
    """Angles (..., 2) with |R(w, angle) v - goal| = distance; with `inverse`, of R(w, -angle) instead."""
    squares = np.sum(v * v, axis=-1) + np.sum(goal * goal, axis=-1)
    return _onto_projection(w, v, goal, (squares - distance**2) / 2, inverse=inverse)


def _turn_onto(w: np.ndarray, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Angles that turn `start` about w into the half plane of `goal`; 0 where either lies on the axis."""
    a = start - w * np.sum(start * w, axis=-1)[..., None]
    b = goal - w * np.sum(goal * w, axis=-1)[..., None]
    angle = np.arctan2(np.sum(w * np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))
    short = np.minimum(np.linalg.norm(a, axis=-1), np.linalg.norm(b, axis=-1)) < _DEGENERATE
    return np.where(short, 0.0, angle)


def _rotation(w: np.ndarray, angles: np.ndarray) -> np.ndarray:
    K = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    angles = np.asarray(angles)[..., None, None]
    return np.eye(3) + np.sin(angles) * K + (1 - np.cos(angles)) * (K @ K)


def _transposed(R: np.ndarray, x: np.ndarray) -> np.ndarray:
    """R' x for R (..., 3, 3) and x (..., 3)."""
    return np.einsum("...ij,...i->...j", R, x)


def _perpendicular(w: np.ndarray) -> np.ndarray:
    side = np.cross(w, np.eye(3)[np.argmin(np.abs(w))])
    return side / np.linalg.norm(side)


def _stacked(*angles: np.ndarray) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*angles), axis=-1)
