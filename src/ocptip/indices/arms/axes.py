"""The axes of a serial arm as spears, its tool and its moving inertias in a pose; arms given by their axes.

Indices see an arm as the spears of its joint axes in the base frame: the columns of the Jacobian that maps
joint rates to the screw of the end-effector (angular part first). The frame of the end-effector is the arm's
gripper frame. Source: [Naw07] 2.1, (2.2), (3.17).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, finite_array
from ocptip.indices.lines import foot_point
from ocptip.numerics.vectors import cross
from ocptip.robots.kinematics import chain, link_frames
from ocptip.robots.model import ArmModel, JointLimits

_SPEAR_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class ArmPose:
    """The quantities of an arm that indices need, in N poses (no leading N for a single pose).

    Attributes:
        jacobian: (N, 6, n), columns are the spears of the axes, base frame; moments in m.
        rotation: (N, 3, 3), gripper axes to base axes.
        position: (N, 3), m, TCP in the base frame.
        inertias: (N, n), kg m^2: moment of inertia about axis i of everything it moves; None for an arm
            without masses.
    """

    jacobian: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    inertias: np.ndarray | None


def require_turning(model: ArmModel) -> None:
    """Raise InputError if a joint slides or follows another: the indices compare rates of single axes."""
    if model.prismatic.any():
        names = ", ".join(np.array(model.joint_names)[model.prismatic])
        raise InputError(f"indices are for arms whose joints turn, but these slide: {names}; lock them")
    if model.coupling is not None:
        raise InputError(f"indices are for arms of independent joints, but {model.coupling.text()}")


def arm_pose(model: ArmModel, q: np.ndarray) -> ArmPose:
    """Axes, tool and inertias of an arm at q (N, n) or (n,), rad.

    The inertias are those of the links about the momentary axes, armature included (3.17).

    Raises:
        InputError: wrong shape or not finite, or a joint slides.
    """
    require_turning(model)
    frames = link_frames(model, q)
    rotations, origins = frames.rotations, frames.origins
    axes, feet = rotations[..., :-1, :, 2], origins[..., :-1, :]
    spears = np.concatenate([axes, cross(feet, axes)], axis=-1)
    inertias = _moving_inertias(model, rotations[..., :-1, :, :], feet) if model.masses.any() else None
    return ArmPose(np.swapaxes(spears, -1, -2), rotations[..., -1, :, :], origins[..., -1, :], inertias)


def _moving_inertias(model: ArmModel, rotations: np.ndarray, origins: np.ndarray) -> np.ndarray:
    """(..., n), kg m^2, of links i..n about axis i."""
    centres = origins + np.einsum("...kij,kj->...ki", rotations, model.centres)
    turned = rotations @ model.inertias @ np.swapaxes(rotations, -1, -2)
    axes = rotations[..., 2]
    about_own = np.einsum("...ia,...kab,...ib->...ik", axes, turned, axes)
    arms = cross(axes[..., :, None, :], centres[..., None, :, :] - origins[..., :, None, :])
    total = about_own + model.masses * np.einsum("...ika,...ika->...ik", arms, arms)
    behind = np.triu(np.ones((model.n, model.n)))
    return np.einsum("...ik,ik->...i", total, behind) + model.armature


def moving_inertias(pose: ArmPose) -> np.ndarray:
    """(N, n) inertias of a pose for the weighted indices.

    Raises:
        InputError: the arm has no masses, or an axis moves no inertia.
    """
    if pose.inertias is None:
        raise InputError("inertias: the arm has no masses; weighted indices need moments of inertia")
    worst = int(np.argmin(pose.inertias.reshape(-1, pose.inertias.shape[-1]).min(axis=0)))
    if not (pose.inertias > 0).all():
        raise InputError(
            f"inertias: axis {worst + 1} moves {pose.inertias[..., worst].min():.3g} kg m^2, must be > 0; "
            "add the mass of a tool or the reflected inertia of the rotor (armature)"
        )
    return pose.inertias


def symbolic_inertias(model: ArmModel, q: cs.SX) -> cs.SX:
    """(n, 1), kg m^2: the moving inertias of `arm_pose` as CasADi expressions."""
    rotations, origins = chain(model, q)
    bodies = []
    for k in range(model.n):
        turn = rotations[k]
        bodies.append((turn @ cs.SX(model.inertias[k]) @ turn.T, origins[k] + turn @ cs.SX(model.centres[k])))
    sums = []
    for i in range(model.n):
        axis = rotations[i][:, 2]
        total = cs.SX(model.armature[i])
        for k in range(i, model.n):
            inertia, centre = bodies[k]
            arm = cs.cross(axis, centre - origins[i])
            total += axis.T @ inertia @ axis + model.masses[k] * cs.sumsqr(arm)
        sums.append(total)
    return cs.vertcat(*sums)


def symbolic_pose(model: ArmModel, q: cs.SX) -> tuple[cs.SX, cs.SX, cs.SX]:
    """CasADi expressions of J (6, n), gripper rotation (3, 3) and position (3,)."""
    require_turning(model)
    rotations, origins = chain(model, q)
    columns = [
        cs.vertcat(rotation[:, 2], cs.cross(origin, rotation[:, 2]))
        for rotation, origin in zip(rotations[:-1], origins[:-1], strict=True)
    ]
    return cs.horzcat(*columns), rotations[-1], origins[-1]


def arm_from_spears(
    name: str,
    spears: object,
    *,
    tool_position: object,
    tool_rotation: object = None,
    limits: JointLimits | None = None,
) -> ArmModel:
    """An arm given by the axes of its reference pose, in which all joint angles are zero.

    Args:
        name: for messages and titles.
        spears: (n, 6), base frame, moments in m; axis 1 is next to the base.
        tool_position: (3,), m: TCP in the reference pose.
        tool_rotation: (3, 3): gripper axes to base axes in the reference pose; default identity.
        limits: joint limits; none by default.

    Returns:
        An arm without masses and collision spheres.

    Raises:
        InputError: a row is no spear (unit direction, moment perpendicular to it), or other bad numbers.
    """
    lines = finite_array("spears", spears, (None, 6))
    position = finite_array("tool_position", tool_position, (3,))
    turn = np.eye(3) if tool_rotation is None else finite_array("tool_rotation", tool_rotation, (3, 3))
    count = len(lines)
    for index, line in enumerate(lines):
        length = np.linalg.norm(line[:3])
        skewness = abs(line[:3] @ line[3:]) / (1.0 + np.linalg.norm(line[3:]))
        if abs(length - 1.0) > _SPEAR_TOLERANCE or skewness > _SPEAR_TOLERANCE:
            raise InputError(
                f"spears[{index}]: no spear: direction of length {length:.9g} (must be 1), not perpendicular "
                f"to its moment by {skewness:.2g} (must be 0)"
            )
    rotations = np.array([_frame_on(line[:3]) for line in lines])
    origins = [foot_point(line) for line in lines]
    for index in range(1, count):
        direction = lines[index, :3]
        origins[index] = origins[index] + direction * (direction @ origins[index - 1])
    steps = np.diff(np.array([*origins, position]), axis=0)
    return ArmModel(
        name=name,
        joint_names=tuple(f"joint {i}" for i in range(1, count + 1)),
        rotations=np.array([rotations[0], *(rotations[i].T @ rotations[i + 1] for i in range(count - 1))]),
        offsets=np.einsum("kji,kj->ki", rotations, steps),
        masses=np.zeros(count),
        centres=np.zeros((count, 3)),
        inertias=np.zeros((count, 3, 3)),
        limits=JointLimits.unlimited(count) if limits is None else limits,
        tool_rotation=rotations[-1].T @ turn,
        mount_position=origins[0],
    )


def _frame_on(axis: np.ndarray) -> np.ndarray:
    """Right-handed frame (3, 3) with the given z axis."""
    across = np.eye(3)[np.argmin(np.abs(axis))]
    x = across - axis * (axis @ across)
    x /= np.linalg.norm(x)
    return np.column_stack([x, cross(axis, x), axis])
