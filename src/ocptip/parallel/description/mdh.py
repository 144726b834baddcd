"""Frames of modified Denavit-Hartenberg rows, and the row of a frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ocptip.numerics.vectors import skew
from ocptip.parallel.description.entries import Entry, elementary_rotation, value_of
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.description.robot_description import FIXED, PRISMATIC, REVOLUTE, MDHRow

Frame = tuple[np.ndarray, np.ndarray]
"""Rotation (3, 3), frame axes to outer axes, and origin (3,), m, outer axes."""


def compose(a: Frame, b: Frame) -> Frame:
    """Frame b, given in frame a, in a's outer axes."""
    return a[0] @ b[0], a[1] + a[0] @ b[1]


def inverse(a: Frame) -> Frame:
    """The outer frame in frame a."""
    return a[0].T, -a[0].T @ a[1]


def moved_inertia(body: BodyInertia, frame: Frame) -> BodyInertia:
    """Inertia about another frame, in its axes.

    Args:
        body: about the origin of its frame, in its axes.
        frame: the frame of the body, given in the other one.
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


def standard_frame(a: Entry, alpha: Entry) -> Frame:
    """Frame i of a standard row, at the end of its link, in frame i of modified rows, on the joint's axis."""
    return elementary_rotation("x", alpha), np.array([value_of(a), 0.0, 0.0])


def modified_rows(rows: Sequence[MDHRow], links: Sequence[tuple[Entry, Entry]]) -> tuple[MDHRow, ...]:
    """Modified rows of a chain that is given by standard Denavit-Hartenberg rows.

    A standard row is Rz(theta) Tz(d) Tx(a) Rx(alpha): its a and alpha stand in the modified row after it.

    Args:
        rows: joints with theta and r (the standard d), nothing else.
        links: (a, alpha) of each, m and rad.
    """
    before = [(0.0, 0.0), *links[:-1]]
    return tuple(replace(row, d=a, alpha=alpha) for row, (a, alpha) in zip(rows, before, strict=True))


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
    lengths = (snapped_length(float(value), snap) for value in (b, d, r))
    (gamma, alpha, theta), (b, d, r) = angles, lengths
    return MDHRow(FIXED, gamma=gamma, b=b, alpha=alpha, d=d, theta=theta, r=r)


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


def snapped_length(length: float, snap: float) -> float:
    return 0.0 if abs(length) <= max(snap, 1e-15) else length
