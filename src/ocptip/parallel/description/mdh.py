"""Modified Denavit-Hartenberg rows from joint axes in space, and back to transformations.

Axes are lines at zero joint positions. Frames are put where the rows get simplest: each x axis along the
common normal to the next axis, so that gamma = b = 0; the leg's base frame is its first joint's frame at
zero. Joint positions keep their zeros and their directions: offsets are the rows' theta and r.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.numerics.vectors import cross, skew
from ocptip.parallel.description.body_inertia import BodyInertia
from ocptip.parallel.description.entries import elementary_rotation, value_of
from ocptip.parallel.description.robot_description import FIXED, PRISMATIC, REVOLUTE, MDHRow

Frame = tuple[np.ndarray, np.ndarray]
"""Rotation (3, 3), frame axes to outer axes, and origin (3,), m, outer axes."""

_LONGEST_COUPLING = 3


@dataclass(frozen=True, eq=False)
class JointAxis:
    """A joint's axis at zero joint positions, world axes.

    Attributes:
        sigma: 0 revolute, 1 prismatic.
        point: (3,), m, anywhere on the axis.
        direction: (3,), unit vector.
    """

    sigma: int
    point: np.ndarray
    direction: np.ndarray


@dataclass(frozen=True, eq=False)
class MDHChain:
    """Rows of a chain of joints.

    Attributes:
        base: frame the first row starts from, world axes.
        rows: one per joint.
        frames: of all rows at zero joint positions, world axes, as the rows place them.
    """

    base: Frame
    rows: tuple[MDHRow, ...]
    frames: tuple[Frame, ...]


def compose(a: Frame, b: Frame) -> Frame:
    """Frame b, given in frame a, in a's outer axes."""
    return a[0] @ b[0], a[1] + a[0] @ b[1]


def inverse(a: Frame) -> Frame:
    """The outer frame in frame a."""
    return a[0].T, -a[0].T @ a[1]


def moved_inertia(body: BodyInertia, frame: Frame) -> BodyInertia:
    """Inertia about another frame, in its axes.

    Args:
        body: about its own frame.
        frame: the body's own frame, given in the other one.
    """
    R, d = frame
    s, inertia, mass = R @ body.first_moment, R @ body.inertia @ R.T, body.mass
    # Inertia about another point: I + skew terms of the first moment and of the mass.
    shifted = inertia - skew(d) @ skew(s) - skew(s) @ skew(d) - mass * skew(d) @ skew(d)
    return BodyInertia(mass, s + mass * d, 0.5 * (shifted + shifted.T), grouped=body.grouped)


def central_inertia(body: BodyInertia) -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass (3,), m, and inertia about it (3, 3), kg m^2, body axes; the origin without mass."""
    center = body.first_moment / body.mass if body.mass else np.zeros(3)
    return center, body.central


def row_frame(row: MDHRow, joint: float = 0.0) -> Frame:
    """Frame j in frame a(j) (2.11); no joint value counts for a fixed row."""
    gamma, alpha = elementary_rotation("z", row.gamma), elementary_rotation("x", row.alpha)
    r = value_of(row.r) + (joint if row.sigma == PRISMATIC else 0.0)
    before = gamma @ alpha
    arm = np.array([0.0, 0.0, value_of(row.b)]) + gamma @ [value_of(row.d), 0.0, 0.0] + before @ [0.0, 0.0, r]
    if row.sigma == REVOLUTE:
        c, s = math.cos(value_of(row.theta) + joint), math.sin(value_of(row.theta) + joint)
        return before @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), arm
    return before @ elementary_rotation("z", row.theta), arm


def mdh_chain(axes: Sequence[JointAxis], snap: float = 0.0, coupling: int | None = None) -> MDHChain:
    """Rows whose frames have their z axes on the given axes.

    Args:
        axes: of the joints, from the base on, world axes, at zero joint positions.
        snap: angles this near (rad) to a multiple of pi/2, and offsets this near (m) to zero, are exactly so;
            axes this parallel are parallel.
        coupling: joint (from 0) from which on all axes pass through one point, see
            :func:`joints_to_coupling`.
    """
    x, origins, feet = _frames_on(axes, max(snap, 1e-12))
    z = [axis.direction for axis in axes]
    base = np.column_stack([x[0], cross(z[0], x[0]), z[0]]), origins[0]
    rows = [MDHRow(axes[0].sigma)]
    for j in range(1, len(axes)):
        spread = 0.0 if coupling is not None and j > coupling else 1.0
        rows.append(
            MDHRow(
                axes[j].sigma,
                alpha=snapped_angle(_angle(z[j - 1], z[j], x[j - 1]), snap),
                d=_snapped(spread * float((feet[j] - origins[j - 1]) @ x[j - 1]), snap),
                theta=snapped_angle(_angle(x[j - 1], x[j], z[j]), snap),
                r=_snapped(spread * float((origins[j] - feet[j]) @ z[j]), snap),
            )
        )
    frames = [base]
    for row in rows[1:]:
        frames.append(compose(frames[-1], row_frame(row)))
    return MDHChain(base, tuple(rows), tuple(frames))


def fixed_row(frame: Frame, snap: float = 0.0) -> MDHRow:
    """The row without a joint that leads to a frame, given in the frame before: any frame has one."""
    R, p = frame
    sine = math.hypot(R[0, 2], R[1, 2])
    alpha = math.atan2(sine, R[2, 2])
    if sine <= max(snap, 1e-12):
        gamma = math.atan2(p[1], p[0]) if math.hypot(p[0], p[1]) > snap else 0.0
        # z axes parallel: only gamma + theta counts, or gamma - theta if they point against each other.
        turn = math.atan2(R[1, 0], R[0, 0])
        theta = turn - gamma if R[2, 2] > 0 else gamma - turn
        b, d, r = p[2], math.hypot(p[0], p[1]), 0.0
    else:
        gamma, theta = math.atan2(R[0, 2], -R[1, 2]), math.atan2(R[2, 0], R[2, 1])
        along = np.column_stack([[0.0, 0.0, 1.0], [math.cos(gamma), math.sin(gamma), 0.0], R[:, 2]])
        b, d, r = np.linalg.solve(along, p)
    angles = (snapped_angle(value, snap) for value in (gamma, alpha, theta))
    lengths = (_snapped(float(value), snap) for value in (b, d, r))
    (gamma, alpha, theta), (b, d, r) = angles, lengths
    return MDHRow(FIXED, gamma=gamma, b=b, alpha=alpha, d=d, theta=theta, r=r)


def joints_to_coupling(axes: Sequence[JointAxis], wanted: int | None, snap: float) -> int:
    """Number of joints before those that turn about one point at the chain's end.

    Args:
        axes: of the chain, coupling joints included.
        wanted: number to take if it is possible; else the coupling joints are as many as there can be.
        snap: axes this near to a point (m) pass through it.

    Returns:
        n; n = len(axes) if no joint turns about the chain's end.
    """
    count = len(axes)
    if axes[-1].sigma != REVOLUTE or count == 1:
        return count
    tolerance = max(snap, 1e-9)
    run, point = 1, None
    for axis, following in zip(axes[-2:0:-1], axes[:1:-1], strict=True):
        u, v = axis.direction, following.direction
        normal = cross(u, v)
        sine = np.linalg.norm(normal)
        if run == _LONGEST_COUPLING or axis.sigma != REVOLUTE or sine <= tolerance:
            break
        if point is None:
            between = following.point - axis.point
            if abs(between @ normal) / sine > tolerance:
                break
            point = axis.point + u * float(cross(between, v) @ normal) / sine**2
        elif np.linalg.norm(cross(u, point - axis.point)) > tolerance:
            break
        run += 1
    if wanted is not None and count - run <= wanted < count:
        return wanted
    return count - run


def rotation_angles(R: np.ndarray, snap: float = 0.0) -> tuple[tuple[str, float], ...]:
    """Elementary rotations whose product is R (3, 3): about z, x and z; those by zero are left out."""
    row = fixed_row((R, np.zeros(3)), snap)
    alpha = value_of(row.alpha)
    if alpha == 0.0:
        turns = (("z", snapped_angle(value_of(row.gamma) + value_of(row.theta), snap)),)
    else:
        turns = (("z", value_of(row.gamma)), ("x", alpha), ("z", value_of(row.theta)))
    return tuple((axis, angle) for axis, angle in turns if angle != 0.0)


def snapped_angle(angle: float, snap: float) -> float:
    """The angle, or the multiple of pi/2 that is nearer than `snap` (at least 1e-12), rad."""
    turns = round(angle / (math.pi / 2))
    exact = turns * (math.pi / 2)
    return exact if abs(angle - exact) <= max(snap, 1e-12) else angle


def _snapped(length: float, snap: float) -> float:
    return 0.0 if abs(length) <= max(snap, 1e-15) else length


def _angle(start: np.ndarray, end: np.ndarray, about: np.ndarray) -> float:
    """Angle from one unit vector to another about a third one, orthogonal to both."""
    return math.atan2(float(about @ cross(start, end)), float(start @ end))


def _frames_on(
    axes: Sequence[JointAxis], tolerance: float
) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """x axes and origins of all frames, and the foot on each axis of the normal from the one before."""
    feet = [axes[0].point]
    x, origins = [], []
    before: np.ndarray | None = None
    for axis, following in itertools.pairwise(axes):
        direction, start, end = _common_normal(axis, following, feet[-1], before, tolerance)
        x.append(direction)
        origins.append(start)
        feet.append(end)
        before = direction
    x.append(_perpendicular(axes[0].direction) if before is None else before)
    origins.append(feet[-1])
    return _filled(x, axes), origins, feet


def _filled(x: list[np.ndarray | None], axes: Sequence[JointAxis]) -> list[np.ndarray]:
    """The x axes; those at the start that are free, on axes that coincide, as the first one that is not."""
    known = next(direction for direction in [*x, _perpendicular(axes[0].direction)] if direction is not None)
    return [known if direction is None else direction for direction in x]


def _common_normal(
    axis: JointAxis, following: JointAxis, foot: np.ndarray, before: np.ndarray | None, tolerance: float
) -> tuple[np.ndarray | None, np.ndarray, np.ndarray]:
    """Direction of the normal from one axis to the next, and its points on both.

    Args:
        axis, following: the axes.
        foot: (3,) point on the first one to start from if they are parallel.
        before: (3,) x axis before: where the normal's direction is free it stays near it; None: none yet.
        tolerance: sine (and length, m) that counts as zero.

    Returns:
        Direction (None: free), point on the first axis, point on the second one.
    """
    u, v = axis.direction, following.direction
    normal, between = cross(u, v), following.point - foot
    sine = np.linalg.norm(normal)
    if sine <= tolerance:
        across = between - u * (u @ between)
        distance = np.linalg.norm(across)
        x = across / distance if distance > tolerance else before
        return x, foot, foot + across
    x = normal / sine
    start = foot + u * float(cross(between, v) @ normal) / sine**2
    end = following.point + v * float(cross(between, u) @ normal) / sine**2
    distance = between @ x
    turned = before is not None and before @ x < -1e-9
    if distance < -tolerance or (abs(distance) <= tolerance and turned):
        x = -x
    return x, start, end


def _perpendicular(z: np.ndarray) -> np.ndarray:
    """A unit vector orthogonal to z, a coordinate axis where z is one."""
    x = np.roll(np.eye(3)[int(np.argmax(np.abs(z)))], 1)
    x = x - z * (z @ x)
    return x / np.linalg.norm(x)
