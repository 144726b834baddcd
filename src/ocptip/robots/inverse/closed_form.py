"""Inverse kinematics in closed form for six-axis arms, recognised by how their axes meet.

Three families, each with up to eight IK solutions (appendix C treats one arm of each); all reduce to rotating
a vector about one axis onto another vector, or to a given projection (Paden-Kahan subproblems):

- "spherical wrist": axes 2 and 3 parallel, axes 4, 5, 6 meet in a point (FP1W2F, most industrial arms);
- "three parallel axes": axes 2, 3, 4 parallel, axes 5 and 6 meet (W1P1P2W2, the UR series);
- "spherical shoulder": axes 1, 2, 3 meet in a point and axes 3, 4, 5 in another (FSFS).

Axes are those at zero joint angles, base frame: direction w_i (unit) and point Q_i; rotations R(w, angle) act
about lines, e_i about axis i; the pose is e_1 ... e_6 G_0.

Everything works on arrays of poses: each subproblem adds an axis of length 2 for its two solutions, and NaN
stands for a solution that does not exist.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from ocptip.numerics.vectors import cross, perpendicular, skew, wrapped
from ocptip.robots.inverse.joint_angles import within_limits
from ocptip.robots.kinematics import gripper_batch, link_frames
from ocptip.robots.model import ArmModel

SPHERICAL_WRIST = "spherical wrist"
THREE_PARALLEL = "three parallel axes"
SPHERICAL_SHOULDER = "spherical shoulder"

CHECK_TOLERANCE = 1e-7  # m and rad
_MEET_TOLERANCE = 1e-9  # relative to the arm's size: how exactly axes must meet or be parallel
_EXCESS_TOLERANCE = 1e-8  # a projection out of reach by less may be rounding, and means a double root
_DEGENERATE = 1e-11  # a vector this close to the axis leaves the angle open, at an error below the tolerance
_TRIES = 72  # values tried for an open angle that the rest of the arm depends on


@dataclass(frozen=True, eq=False)
class _Axes:
    w: np.ndarray  # (6, 3) directions at zero angles, base axes
    Q: np.ndarray  # (6, 3) points on the axes, m, base frame
    zero_rotation: np.ndarray  # gripper to base axes at zero angles
    zero_position: np.ndarray  # m, of the gripper at zero angles, base frame
    size: float

    def turn(self, joint: int, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (..., 3, 3) and shifts (..., 3) of e_joint(angles); joints counted from 1."""
        R = _rotation(self.w[joint - 1], angles)
        return R, self.Q[joint - 1] - R @ self.Q[joint - 1]


@lru_cache(maxsize=64)
def closed_form_family(model: ArmModel) -> str | None:
    """The family whose closed form fits this arm, or None."""
    if model.n != 6 or not model.periodic.all():
        return None
    axes = _axes(model)
    parallel23 = _parallel(axes, 2, 3)
    if parallel23 and _meeting_point(axes, 4, 5, 6) is not None:
        return SPHERICAL_WRIST
    if parallel23 and _parallel(axes, 3, 4) and _meeting_point(axes, 5, 6) is not None:
        return THREE_PARALLEL
    if _meeting_point(axes, 1, 2, 3) is not None and _meeting_point(axes, 3, 4, 5) is not None:
        return SPHERICAL_SHOULDER
    return None


def closed_form_branches(model: ArmModel, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """All IK solutions (k, 6), rad in (-pi, pi], for a gripper pose; joint limits are not checked.

    Where a solution leaves an angle open (singular pose: two axes in line) one value stands for all: zero, or
    the first of 72 from which the arm reaches the pose.

    Args:
        position: (3,), m, base frame.
        rotation: (3, 3), gripper to base axes.

    Raises:
        ValueError: no closed form for this arm (ask `closed_form_family` first).
    """
    result = _all_branches(model, np.asarray(position)[None], np.asarray(rotation)[None])[0]
    return result[np.isfinite(result).all(axis=1)]


def branches_within_limits(model: ArmModel, positions: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """All IK solutions of many poses that keep the joint limits, checked by forward kinematics.

    Args:
        model: an arm with a closed form.
        positions: (N, 3), m, of G in the base frame.
        rotations: (N, 3, 3), gripper to base axes.

    Returns:
        (N, 8, 6), rad: of the copies an angle has every full turn the one nearest to zero; NaN where a
        solution does not exist or breaks the limits.

    Raises:
        ValueError: no closed form for this arm (ask `closed_form_family` first).
    """
    result = within_limits(model, _all_branches(model, positions, rotations))
    n, which = np.nonzero(np.isfinite(result).all(axis=2))
    position, turned, _ = gripper_batch(model)(result[n, which])
    error = np.maximum(
        np.abs(position - positions[n]).max(axis=1), np.abs(turned - rotations[n]).max(axis=(1, 2))
    )
    wrong = error > CHECK_TOLERANCE
    result[n[wrong], which[wrong]] = np.nan
    result[~np.isfinite(result).all(axis=2)] = np.nan
    return result


def _all_branches(model: ArmModel, positions: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """IK solutions (N, 8, 6), rad in (-pi, pi], whatever the limits; an angle NaN: no such solution."""
    family = closed_form_family(model)
    if family is None:
        raise ValueError(f"no closed form for arm {model.name!r}")
    axes = _axes(model)
    R = rotations @ axes.zero_rotation.T
    p = positions - R @ axes.zero_position
    with np.errstate(invalid="ignore"):
        values = np.stack(np.broadcast_arrays(*_SOLVERS[family](axes, R, p)), axis=-1).reshape(len(p), -1, 6)
        return wrapped(values)


def _spherical_wrist(axes: _Axes, R: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, ...]:
    w, Q = axes.w, axes.Q
    wrist = _meeting_point(axes, 4, 5, 6)
    assert wrist is not None  # of this family
    goal = R @ wrist + p
    # e_2, e_3 keep the wrist's component along w_2, so e_1 alone must give it.
    t1 = _onto_projection(w[0], goal - Q[0], w[1], w[1] @ (wrist - Q[0]), inverse=True)  # (N, 2)
    R1, p1 = axes.turn(1, t1)
    t2, t3 = _two_parallel(axes, wrist, _transposed(R1, goal[:, None] - p1))  # (N, 2, 2)
    before = R1[:, :, None] @ axes.turn(2, t2)[0] @ axes.turn(3, t3)[0]
    rest = np.swapaxes(before, -1, -2) @ R[:, None, None]
    t4, t5, t6 = _three_turns(w[3], w[4], w[5], rest)  # (N, 2, 2, 2)
    return t1[:, :, None, None], t2[..., None], t3[..., None], t4, t5, t6


def _three_parallel(axes: _Axes, R: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, ...]:
    w, Q = axes.w, axes.Q
    wrist = _meeting_point(axes, 5, 6)
    goal = R @ wrist + p
    t1 = _onto_projection(w[0], goal - Q[0], w[1], w[1] @ (wrist - Q[0]), inverse=True)  # (N, 2)
    R1, p1 = axes.turn(1, t1)
    # e_2 e_3 e_4 e_5 e_6, the first three about w_2
    rest = (np.swapaxes(R1, -1, -2) @ R[:, None])[:, :, None]
    rest_p = _transposed(R1, p[:, None] - p1)[:, :, None]
    t5 = _onto_projection(w[4], w[5], w[1], (rest @ w[5] @ w[1])[..., 0])  # (N, 2, 2)
    across = np.swapaxes(_rotation(w[4], t5), -1, -2) @ w[1]
    onto = np.swapaxes(rest, -1, -2) @ w[1]
    t6 = -_turn_onto(w[5], across, onto)
    t2, t3, t4 = _parallel_axes(axes, rest, rest_p, t5, t6)  # (N, 2, 2, 2)
    # Axis 6 in line with the parallel ones leaves its angle open, but not every angle is within reach.
    beyond = _on_axis(w[5], across, onto) & ~np.isfinite(t3).any(axis=-1)
    if beyond.any():
        n, i, j = np.nonzero(beyond)
        tries = np.linspace(-np.pi, np.pi, _TRIES, endpoint=False)
        result = _parallel_axes(axes, rest[n, i], rest_p[n, i], t5[n, i, j, None], tries)  # (M, tries, 2)
        first = np.argmax(np.isfinite(result[1]).any(axis=-1), axis=1)
        t6[n, i, j] = tries[first]
        for theta, tried in zip((t2, t3, t4), result, strict=True):
            theta[n, i, j] = tried[np.arange(len(n)), first]
    return t1[:, :, None, None], t2, t3, t4, t5[..., None], t6[..., None]


def _parallel_axes(
    axes: _Axes, rest: np.ndarray, rest_p: np.ndarray, t5: np.ndarray, t6: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles t2, t3, t4 (..., 2) of e_2 e_3 e_4 e_5 e_6 = the motion (rest, rest_p), for parallel axes."""
    R5, p5 = axes.turn(5, t5)
    R6, p6 = axes.turn(6, t6)
    R56, p56 = R5 @ R6, (R5 @ p6[..., None])[..., 0] + p5
    back, back_p = np.swapaxes(R56, -1, -2), -_transposed(R56, p56)
    arm = rest @ back
    arm_p = (rest @ back_p[..., None])[..., 0] + rest_p
    t2, t3 = _two_parallel(axes, axes.Q[3], arm @ axes.Q[3] + arm_p)
    last = np.swapaxes(axes.turn(2, t2)[0] @ axes.turn(3, t3)[0], -1, -2) @ arm[..., None, :, :]
    side = perpendicular(axes.w[3])
    return t2, t3, _turn_onto(axes.w[3], side, last @ side)


def _spherical_shoulder(axes: _Axes, R: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, ...]:
    w = axes.w
    shoulder, elbow = _meeting_point(axes, 1, 2, 3), _meeting_point(axes, 3, 4, 5)
    assert shoulder is not None
    assert elbow is not None  # of this family
    reach, base6 = elbow - shoulder, axes.Q[5]
    seen = _transposed(R, shoulder - p)  # the shoulder as seen from the gripper side
    # e_1 .. e_5 keep the distance from shoulder to elbow, so e_6 alone must give it.
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
    return t1[..., None], t2[..., None], t3, t4, t5, t6[:, :, None, None]


_SOLVERS: dict[str, Callable[[_Axes, np.ndarray, np.ndarray], tuple[np.ndarray, ...]]] = {
    SPHERICAL_WRIST: _spherical_wrist,
    THREE_PARALLEL: _three_parallel,
    SPHERICAL_SHOULDER: _spherical_shoulder,
}


def _two_parallel(axes: _Axes, start: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles (..., 2) of e_2 e_3 start = goal, for parallel axes 2 and 3 and goals (..., 3)."""
    w, Q = axes.w, axes.Q
    flat = np.eye(3) - np.outer(w[1], w[1])  # distances in the plane across the axes
    distance = np.linalg.norm((goal - Q[1]) @ flat, axis=-1)
    t3 = _at_distance(w[2], flat @ (start - Q[2]), flat @ (Q[1] - Q[2]), distance)
    R3, p3 = axes.turn(3, t3)
    return _turn_onto(w[1], R3 @ start + p3 - Q[1], (goal - Q[1])[..., None, :]), t3


def _three_turns(a: np.ndarray, b: np.ndarray, c: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, ...]:
    """Angles (..., 2) with R(a, ta) R(b, tb) R(c, tc) = R, for R (..., 3, 3)."""
    tb = _onto_projection(b, c, a, R @ c @ a)
    Rb = _rotation(b, tb)
    ta = _turn_onto(a, Rb @ c, (R @ c)[..., None, :])
    side = perpendicular(c)
    last = np.swapaxes(_rotation(a, ta) @ Rb, -1, -2) @ R[..., None, :, :]
    return ta, tb, _turn_onto(c, side, last @ side)


def _onto_projection(
    w: np.ndarray, v: np.ndarray, h: np.ndarray, value: np.ndarray, *, inverse: bool = False
) -> np.ndarray:
    """Angles (..., 2) with h . R(w, angle) v = value; with `inverse`, of R(w, -angle) instead; NaN: none.

    A double root comes first and once, an open angle (any will do) as zero.
    """
    along = np.sum(h * w, axis=-1)
    cosine = np.sum(h * v, axis=-1) - along * np.sum(v * w, axis=-1)
    sine = np.sum(h * cross(w, v), axis=-1)
    amplitude = np.hypot(cosine, sine)
    rest = value - along * np.sum(v * w, axis=-1)
    degenerate = amplitude < _DEGENERATE
    ratio = rest / np.where(degenerate, 1.0, amplitude)
    middle = np.arctan2(sine, cosine)
    spread = np.arctan2(np.sqrt(np.maximum((1 - ratio) * (1 + ratio), 0)), ratio)
    out = degenerate | (np.abs(rest) > amplitude + _EXCESS_TOLERANCE)
    first = np.where(out, np.nan, middle + spread)
    second = np.where(out | (np.abs(ratio) >= 1), np.nan, middle - spread)
    first = np.where(degenerate & (np.abs(rest) < _DEGENERATE), 0.0, first)
    return (-1.0 if inverse else 1.0) * np.stack([first, second], axis=-1)


def _at_distance(
    w: np.ndarray,
    v: np.ndarray,
    goal: np.ndarray,
    distance: np.ndarray | np.floating,
    *,
    inverse: bool = False,
) -> np.ndarray:
    """Angles (..., 2) with |R(w, angle) v - goal| = distance; with `inverse`, of R(w, -angle) instead."""
    squares = np.sum(v * v, axis=-1) + np.sum(goal * goal, axis=-1)
    return _onto_projection(w, v, goal, (squares - distance**2) / 2, inverse=inverse)


def _turn_onto(w: np.ndarray, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Angles that turn `start` about w into the half plane of `goal`; 0 where either lies on the axis."""
    a, b = _across(w, start), _across(w, goal)
    angle = np.arctan2(np.sum(w * cross(a, b), axis=-1), np.sum(a * b, axis=-1))
    return np.where(_short(a) | _short(b), 0.0, angle)


def _on_axis(w: np.ndarray, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Whether `start` or `goal` lies on the axis, so that `_turn_onto` may give any angle."""
    return _short(_across(w, start)) | _short(_across(w, goal))


def _across(w: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The part of v (..., 3) perpendicular to the axis."""
    return v - w * np.sum(v * w, axis=-1)[..., None]


def _short(v: np.ndarray) -> np.ndarray:
    return np.linalg.norm(v, axis=-1) < _DEGENERATE


def _rotation(w: np.ndarray, angles: np.ndarray) -> np.ndarray:
    K = skew(w)
    angles = np.asarray(angles)[..., None, None]
    return np.eye(3) + np.sin(angles) * K + (1 - np.cos(angles)) * (K @ K)


def _transposed(R: np.ndarray, x: np.ndarray) -> np.ndarray:
    """R' x for R (..., 3, 3) and x (..., 3)."""
    return np.einsum("...ij,...i->...j", R, x)


@lru_cache(maxsize=64)
def _axes(model: ArmModel) -> _Axes:
    frames = link_frames(model, np.zeros(model.n))
    size = float(sum(np.linalg.norm(b - a) for a, b in pairwise(frames.origins)))
    rotations, origins = frames.rotations, frames.origins
    return _Axes(rotations[:-1, :, 2], origins[:-1], rotations[-1], origins[-1], size)


def _parallel(axes: _Axes, *joints: int) -> bool:
    first, second = (axes.w[j - 1] for j in joints)
    return bool(np.linalg.norm(np.cross(first, second)) < _MEET_TOLERANCE)


@lru_cache(maxsize=256)
def _meeting_point(axes: _Axes, *joints: int) -> np.ndarray | None:
    """The point in which the axes meet at any joint angles between the first and the last, or None.

    Consecutive axes that meet pairwise in one and the same point at zero angles do so at all angles.
    """
    across = [np.eye(3) - np.outer(axes.w[j - 1], axes.w[j - 1]) for j in joints]
    matrix = np.vstack(across)
    if np.linalg.svd(matrix, compute_uv=False)[-1] < 1e-6:
        return None  # parallel axes
    right = np.concatenate([P @ axes.Q[j - 1] for P, j in zip(across, joints, strict=True)])
    point = np.linalg.lstsq(matrix, right, rcond=None)[0]
    missed = np.abs(matrix @ point - right).max()
    return point if missed < _MEET_TOLERANCE * axes.size else None
