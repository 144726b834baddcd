"""Modified Denavit-Hartenberg rows from joint axes in space.

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

from ocptip.numerics.vectors import cross
from ocptip.parallel.description.frames import Frame, compose, row_frame, snapped_angle, snapped_length
from ocptip.parallel.description.robot_description import REVOLUTE, MDHRow

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
                d=snapped_length(spread * float((feet[j] - origins[j - 1]) @ x[j - 1]), snap),
                theta=snapped_angle(_angle(x[j - 1], x[j], z[j]), snap),
                r=snapped_length(spread * float((origins[j] - feet[j]) @ z[j]), snap),
            )
        )
    frames = [base]
    for row in rows[1:]:
        frames.append(compose(frames[-1], row_frame(row)))
    return MDHChain(base, tuple(rows), tuple(frames))


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
