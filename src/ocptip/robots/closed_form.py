"""Inverse kinematics in closed form for six-axis arms, recognised by how their axes meet.

Three families, each with up to eight branches (appendix C treats one arm of each); all reduce to rotating a
vector about one axis onto another vector, or to a given projection (Paden-Kahan subproblems):

- "spherical wrist": axes 2 and 3 parallel, axes 4, 5, 6 meet in a point (FP1W2F, most industrial arms);
- "three parallel axes": axes 2, 3, 4 parallel, axes 5 and 6 meet (W1P1P2W2, the UR series);
- "spherical shoulder": axes 1, 2, 3 meet in a point and axes 3, 4, 5 in another (FSFS).

Axes are those at zero joint angles, base frame: direction w_i (unit) and point Q_i; rotations R(w, angle) act
about lines, e_i about axis i; the pose is e_1 ... e_6 G_0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from ocptip.robots.kinematics import link_frames
from ocptip.robots.model import ArmModel

SPHERICAL_WRIST = "spherical wrist"
THREE_PARALLEL = "three parallel axes"
SPHERICAL_SHOULDER = "spherical shoulder"

_MEET_TOLERANCE = 1e-9  # relative to the arm's size: how exactly axes must meet or be parallel
_EXCESS_TOLERANCE = 1e-8  # a projection out of reach by less may be rounding, and means a double root
_DEGENERATE = 1e-11  # a vector this close to the axis leaves the angle open, at an error below the tolerance
_TRIES = 72  # values tried for an open angle that the rest of the arm depends on


@dataclass(frozen=True, eq=False)
class _Motion:
    """A rigid motion x -> R x + p."""

    R: np.ndarray
    p: np.ndarray

    def __matmul__(self, other: _Motion) -> _Motion:
        return _Motion(self.R @ other.R, self.R @ other.p + self.p)

    def inverse(self) -> _Motion:
        return _Motion(self.R.T, -self.R.T @ self.p)

    def point(self, x: np.ndarray) -> np.ndarray:
        return self.R @ x + self.p


@dataclass(frozen=True, eq=False)
class _Axes:
    w: np.ndarray  # (6, 3) directions at zero angles, base axes
    Q: np.ndarray  # (6, 3) points on the axes, m, base frame
    zero: _Motion  # gripper pose at zero angles
    size: float

    def turn(self, joint: int, angle: float) -> _Motion:
        """e_joint(angle); joints counted from 1."""
        w, point = self.w[joint - 1], self.Q[joint - 1]
        R = _rotation(w, angle)
        return _Motion(R, point - R @ point)


@lru_cache(maxsize=64)
def closed_form_family(model: ArmModel) -> str | None:
    """The family whose closed form fits this arm, or None."""
    if model.n != 6:
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
    """All branches (k, 6), rad in (-pi, pi], for a gripper pose; joint limits are not looked at.

    Where a branch leaves an angle open (singular pose: two axes in line) one value stands for all: zero, or
    the first of 72 from which the arm reaches the pose.

    Args:
        position: (3,), m, base frame.
        rotation: (3, 3), gripper to base axes.

    Raises:
        ValueError: no closed form for this arm (ask `closed_form_family` first).
    """
    family = closed_form_family(model)
    if family is None:
        raise ValueError(f"no closed form for arm {model.name!r}")
    axes = _axes(model)
    target = _Motion(np.asarray(rotation), np.asarray(position)) @ axes.zero.inverse()
    branches = np.array(list(_SOLVERS[family](axes, target))).reshape(-1, 6)
    return np.arctan2(np.sin(branches), np.cos(branches))


def _spherical_wrist(axes: _Axes, target: _Motion) -> Iterator[tuple[float, ...]]:
    w, Q = axes.w, axes.Q
    wrist = _meeting_point(axes, 4, 5, 6)
    goal = target.point(wrist)
    # e_2, e_3 keep the wrist's component along w_2, so e_1 alone must give it.
    for t1 in _onto_projection(w[0], goal - Q[0], w[1], w[1] @ (wrist - Q[0]), inverse=True):
        e1 = axes.turn(1, t1)
        local = e1.inverse().point(goal)
        for t2, t3 in _two_parallel(axes, wrist, local):
            rest = (e1 @ axes.turn(2, t2) @ axes.turn(3, t3)).R.T @ target.R
            for wrist_angles in _three_turns(w[3], w[4], w[5], rest):
                yield (t1, t2, t3, *wrist_angles)


def _three_parallel(axes: _Axes, target: _Motion) -> Iterator[tuple[float, ...]]:
    w, Q = axes.w, axes.Q
    wrist = _meeting_point(axes, 5, 6)
    goal = target.point(wrist)
    for t1 in _onto_projection(w[0], goal - Q[0], w[1], w[1] @ (wrist - Q[0]), inverse=True):
        e1 = axes.turn(1, t1)
        rest = e1.R.T @ target.R  # e_2 e_3 e_4 e_5 e_6, the first three about w_2
        for t5 in _onto_projection(w[4], w[5], w[1], w[1] @ rest @ w[5]):
            e5 = axes.turn(5, t5)
            across = e5.R.T @ w[1]
            for t6 in _open_turn(w[5], across, rest.T @ w[1]):
                arm = e1.inverse() @ target @ (e5 @ axes.turn(6, t6)).inverse()  # e_2 e_3 e_4
                found = list(_two_parallel(axes, Q[3], arm.point(Q[3])))
                for t2, t3 in found:
                    last = (axes.turn(2, t2) @ axes.turn(3, t3)).R.T @ arm.R
                    side = _perpendicular(w[3])
                    yield t1, t2, t3, _turn_onto(w[3], side, last @ side), t5, t6
                if found:
                    break


def _spherical_shoulder(axes: _Axes, target: _Motion) -> Iterator[tuple[float, ...]]:
    w = axes.w
    shoulder, elbow = _meeting_point(axes, 1, 2, 3), _meeting_point(axes, 3, 4, 5)
    reach = elbow - shoulder
    seen = target.inverse().point(shoulder)  # the shoulder as seen from the gripper side
    base6 = axes.Q[5]
    # e_1 .. e_5 keep the distance from shoulder to elbow, so e_6 alone must give it.
    for t6 in _at_distance(w[5], elbow - base6, seen - base6, np.linalg.norm(reach), inverse=True):
        moved = target.point(axes.turn(6, t6).inverse().point(elbow)) - shoulder
        for t2 in _onto_projection(w[1], reach, w[0], w[0] @ moved):
            t1 = _turn_onto(w[0], axes.turn(2, t2).R @ reach, moved)
            before = (axes.turn(1, t1) @ axes.turn(2, t2)).R
            rest = before.T @ target.R @ axes.turn(6, t6).R.T
            for t3, t4, t5 in _three_turns(w[2], w[3], w[4], rest):
                yield t1, t2, t3, t4, t5, t6


_SOLVERS: dict[str, Callable[[_Axes, _Motion], Iterator[tuple[float, ...]]]] = {
    SPHERICAL_WRIST: _spherical_wrist,
    THREE_PARALLEL: _three_parallel,
    SPHERICAL_SHOULDER: _spherical_shoulder,
}


def _two_parallel(axes: _Axes, start: np.ndarray, goal: np.ndarray) -> Iterator[tuple[float, float]]:
    """Angles (t2, t3) with e_2 e_3 start = goal, for parallel axes 2 and 3."""
    w, Q = axes.w, axes.Q
    flat = np.eye(3) - np.outer(w[1], w[1])  # distances in the plane across the axes
    distance = np.linalg.norm(flat @ (goal - Q[1]))
    for t3 in _at_distance(w[2], flat @ (start - Q[2]), flat @ (Q[1] - Q[2]), distance):
        yield _turn_onto(w[1], axes.turn(3, t3).point(start) - Q[1], goal - Q[1]), t3


def _three_turns(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, R: np.ndarray
) -> Iterator[tuple[float, float, float]]:
    """Angles (ta, tb, tc) with R(a, ta) R(b, tb) R(c, tc) = R."""
    for tb in _onto_projection(b, c, a, a @ R @ c):
        ta = _turn_onto(a, _rotation(b, tb) @ c, R @ c)
        side = _perpendicular(c)
        last = (_rotation(a, ta) @ _rotation(b, tb)).T @ R
        yield ta, tb, _turn_onto(c, side, last @ side)


def _open_turn(w: np.ndarray, start: np.ndarray, goal: np.ndarray) -> list[float]:
    """The angle with R(w, -angle) start = goal; angles to try, zero first, if `start` lies on the axis."""
    if np.linalg.norm(np.cross(w, start)) < _DEGENERATE or np.linalg.norm(np.cross(w, goal)) < _DEGENERATE:
        return [0.0, *np.linspace(-np.pi, np.pi, _TRIES, endpoint=False)]
    return [-_turn_onto(w, start, goal)]


def _turn_onto(w: np.ndarray, start: np.ndarray, goal: np.ndarray) -> float:
    """Angle that turns `start` about w into the half plane of `goal`; 0 if either lies on the axis."""
    across_start, across_goal = start - w * (w @ start), goal - w * (w @ goal)
    if min(np.linalg.norm(across_start), np.linalg.norm(across_goal)) < _DEGENERATE:
        return 0.0
    return float(np.arctan2(w @ np.cross(across_start, across_goal), across_start @ across_goal))


def _onto_projection(
    w: np.ndarray, v: np.ndarray, h: np.ndarray, value: float, *, inverse: bool = False
) -> list[float]:
    """Angles with h . R(w, angle) v = value; with `inverse`, of R(w, -angle) instead. None, one or two."""
    cosine, sine = h @ v - (h @ w) * (w @ v), h @ np.cross(w, v)
    amplitude = np.hypot(cosine, sine)
    rest = value - (h @ w) * (w @ v)
    if amplitude < _DEGENERATE:
        return [0.0] if abs(rest) < _DEGENERATE else []
    if abs(rest) > amplitude + _EXCESS_TOLERANCE:
        return []
    ratio = rest / amplitude
    middle, sign = np.arctan2(sine, cosine), -1.0 if inverse else 1.0
    if abs(ratio) >= 1:
        return [sign * (middle if ratio > 0 else middle + np.pi)]
    spread = np.arctan2(np.sqrt((1 - ratio) * (1 + ratio)), ratio)
    return [sign * (middle + spread), sign * (middle - spread)]


def _at_distance(
    w: np.ndarray, v: np.ndarray, goal: np.ndarray, distance: float, *, inverse: bool = False
) -> list[float]:
    """Angles with |R(w, angle) v - goal| = distance; with `inverse`, of R(w, -angle) instead."""
    return _onto_projection(w, v, goal, (v @ v + goal @ goal - distance**2) / 2, inverse=inverse)


def _rotation(w: np.ndarray, angle: float) -> np.ndarray:
    cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _perpendicular(w: np.ndarray) -> np.ndarray:
    side = np.cross(w, np.eye(3)[np.argmin(np.abs(w))])
    return side / np.linalg.norm(side)


@lru_cache(maxsize=64)
def _axes(model: ArmModel) -> _Axes:
    frames = link_frames(model, np.zeros(model.n))
    size = float(sum(np.linalg.norm(b - a) for a, b in pairwise(frames.origins)))
    zero = _Motion(frames.rotations[-1], frames.origins[-1])
    return _Axes(frames.rotations[:-1, :, 2], frames.origins[:-1], zero, size)


def _parallel(axes: _Axes, *joints: int) -> bool:
    first, second = (axes.w[j - 1] for j in joints)
    return bool(np.linalg.norm(np.cross(first, second)) < _MEET_TOLERANCE)


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
