"""Arms from tables of Denavit and Hartenberg's parameters, in both usual conventions.

Standard: frame i lies at the end of link i; Rz(theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i) maps it to frame i - 1,
and joint i moves about, or along, z of frame i - 1. Modified (Craig): frame i lies on the axis of joint i;
Rx(alpha_i) Tx(a_i) Rz(theta_i) Tz(d_i), row i with the a and alpha that other books number i - 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ocptip.numerics.inertia import symmetric_matrix
from ocptip.robots.model import ArmModel, JointLimits

Convention = Literal["standard", "modified"]


@dataclass(frozen=True, eq=False)
class DHRow:
    """One joint and its link.

    Attributes:
        a, d: m.
        alpha, theta: rad; theta (of a sliding joint: d) is the value at joint coordinate zero.
        slides: the joint changes d, not theta.
        mass: of the link, kg.
        center_of_mass: (3,), m, in the row's frame i.
        inertia: about the centre of mass, axes of frame i, kg m^2, in a form of `numerics.inertia`.
        armature: rotor inertia times gear ratio squared, kg m^2 (sliding: kg).
    """

    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    slides: bool = False
    mass: float = 0.0
    center_of_mass: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    armature: float = 0.0


def arm_from_dh(
    name: str, rows: Sequence[DHRow], convention: Convention = "standard", names: Sequence[str] | None = None
) -> ArmModel:
    """The arm of a table; its base frame is frame 0, its gripper frame the last one. No limits.

    Args:
        name: of the arm.
        rows: one per joint.
        convention: of the rows.
        names: of the joints; "joint 1", ... by default.

    Raises:
        InputError: no row, or a value that cannot be used.
    """
    n = len(rows)
    turns = np.array([_about_x(row.alpha) for row in rows]).reshape(n, 3, 3)
    offsets = np.array([[row.a, 0.0, row.d] for row in rows]).reshape(n, 3)
    centres = np.array([row.center_of_mass for row in rows], dtype=float).reshape(n, 3)
    inertias = np.array([symmetric_matrix(row.inertia) for row in rows]).reshape(n, 3, 3)
    starts = np.array([_about_z(row.theta) for row in rows]).reshape(n, 3, 3)
    if convention == "standard":  # the model's frame i turns with joint i; alpha, a and d follow on the link
        rotations = np.concatenate([np.eye(3)[None], turns])[:n] @ starts
        centres = offsets + np.einsum("nij,nj->ni", turns, centres)
        inertias = turns @ inertias @ turns.transpose(0, 2, 1)
        mount, tool = np.zeros(3), turns[-1] if n else np.eye(3)
    else:
        rotations, tool = turns @ starts, np.eye(3)
        levers = offsets * [1.0, 0.0, 0.0] + turns[:, :, 2] * offsets[:, 2:]
        mount, offsets = (levers[0] if n else np.zeros(3)), np.vstack([levers[1:], np.zeros((1, 3))])[:n]
    return ArmModel(
        name=name,
        joint_names=tuple(names or (f"joint {k}" for k in range(1, n + 1))),
        rotations=rotations,
        offsets=offsets,
        masses=np.array([row.mass for row in rows], dtype=float),
        centres=centres,
        inertias=inertias,
        limits=JointLimits.unlimited(n),
        tool_rotation=tool,
        mount_position=mount,
        armature=np.array([row.armature for row in rows], dtype=float),
        prismatic=np.array([row.slides for row in rows], dtype=bool),
    )


def _about_x(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
