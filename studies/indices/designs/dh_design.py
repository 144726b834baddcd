"""Design of a 6R arm for a tool: Denavit-Hartenberg parameters with an isotropic pose in the joint range.

[Naw07] 3.4.1 asks for this order: first the operation sphere or ellipsoid of the tool, then the parameters
such that 1/CDN_OE = 1 in a pose of the workspace. Here least squares of Z = c identity from random starts:
zero means an isotropic pose. This is a local search. Where it ends above zero, nothing is proved, and the end
is not the maximum of 1/CDN_OE; `best_arm_pose` searches that over the poses of one arm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from ocptip.basics.errors import InputError, finite_array, whole_number
from ocptip.basics.write import Record
from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.operation import operation_indices
from ocptip.indices.metric import OperationEllipsoid
from ocptip.numerics.threads import one_thread
from ocptip.robots.dh import DHRow, arm_from_dh
from ocptip.robots.model import ArmModel, JointLimits

_ISOTROPY_DEFECT = 1e-9
_SAMPLES = 2000


@dataclass(frozen=True, eq=False)
class DHDesign(Record):
    """The best arm of some starts, and its pose.

    Attributes:
        rows: (6, 3), m, rad, m: a, alpha, d of the standard convention.
        q: (6,), rad, the pose within the joint range.
        inv_cdn_oe: 1/CDN_OE of the tool there; 1 in an isotropic pose.
        starts: optimisations that were run.
        seed: of their random starts.
    """

    rows: np.ndarray
    q: np.ndarray
    inv_cdn_oe: float
    starts: int
    seed: int


@one_thread
def design_arm(
    tool: OperationEllipsoid,
    lower: ArrayLike,
    upper: ArrayLike,
    joint_range: ArrayLike,
    *,
    starts: int = 32,
    seed: int = 0,
) -> DHDesign:
    """Search the parameters and a pose in which an arm is isotropic with respect to its tool.

    Args:
        tool: ellipsoid in frame 6.
        lower, upper: (6, 3), m, rad, m: bounds of a, alpha, d; equal ones are fixed.
        joint_range: (6, 2), rad, smallest and largest angles.
        starts: optimisations at most, from the best of 2000 random arms and poses within the bounds;
            an isotropic pose ends the search.
        seed: of these.

    Raises:
        InputError: bounds of another shape, not finite or in the wrong order.
    """
    angles = finite_array("joint_range", joint_range, (6, 2))
    low = np.append(finite_array("lower", lower, (6, 3)), angles[:, 0])
    high = np.append(finite_array("upper", upper, (6, 3)), angles[:, 1])
    if (low > high).any():
        raise InputError("lower, joint_range: a lower bound is above its upper bound")
    free = low < high
    residual, slope = _isotropy(tool)

    def full(x: np.ndarray) -> np.ndarray:
        values = low.copy()
        values[free] = x
        return values

    found = []
    samples = np.random.default_rng(seed).uniform(low, high, (_SAMPLES, 24))
    costs = np.square(np.array(residual(samples.T))).sum(axis=0)
    best = np.argsort(costs)[: whole_number("starts", starts, 1)]
    for start in samples[best][:, free]:
        x = least_squares(
            lambda x: np.array(residual(full(x))).ravel(),
            start,
            jac=lambda x: np.array(slope(full(x)))[:, free],
            bounds=(low[free], high[free]),
            xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=100,
        ).x  # fmt: skip
        rows, q = full(x)[:18].reshape(6, 3), full(x)[18:]
        pose = arm_pose(designed_arm(rows, angles), q)
        indices = operation_indices(pose.jacobian, tool, pose.rotation, pose.position)
        found.append((float(indices.inv_cdn_oe), rows, q))
        if 1.0 - indices.inv_cdn_oe < _ISOTROPY_DEFECT:
            break
    value, rows, q = max(found, key=lambda entry: entry[0])
    return DHDesign(rows, q, value, len(found), seed)


def designed_arm(rows: np.ndarray, joint_range: np.ndarray) -> ArmModel:
    """The arm of a, alpha, d (6, 3) with this range (6, 2), rad, of its joint angles."""
    arm = arm_from_dh("designed", [DHRow(*map(float, row)) for row in rows])
    limits = replace(JointLimits.unlimited(6), angle_min=joint_range[:, 0], angle_max=joint_range[:, 1])
    return replace(arm, limits=limits)


def _isotropy(tool: OperationEllipsoid) -> tuple[cs.Function, cs.Function]:
    """Z / c - identity of (a, alpha, d of all rows, q), 21 entries, and its derivatives."""
    x = cs.SX.sym("x", 24)
    R, p, spears = cs.SX.eye(3), cs.SX.zeros(3), []
    for k in range(5, -1, -1):  # from frame 6 back to the axes, all in frame 6
        a, alpha, d = x[3 * k], x[3 * k + 1], x[3 * k + 2]
        c, s, ca, sa = cs.cos(x[18 + k]), cs.sin(x[18 + k]), cs.cos(alpha), cs.sin(alpha)
        turn = cs.vertcat(
            cs.horzcat(c, -s * ca, s * sa), cs.horzcat(s, c * ca, -c * sa), cs.horzcat(0, sa, ca)
        )
        R = R @ turn.T
        p = p - R @ cs.vertcat(a * c, a * s, d)
        spears.append(cs.vertcat(R[:, 2], cs.cross(p, R[:, 2])))
    factor = tool.factor()
    # The directions are unit vectors, trace(J J') over them is 6: this fixes c in Z = c identity.
    constant = 6.0 / np.trace(np.linalg.inv(factor.T @ factor)[:3, :3])
    velocities = factor @ cs.horzcat(*spears)
    error = velocities @ velocities.T / constant - cs.DM.eye(6)
    entries = cs.vertcat(*[error[i, j] for i in range(6) for j in range(i, 6)])
    residual = cs.Function("isotropy", [x], [entries])
    return residual, cs.Function("slope", [x], [cs.densify(cs.jacobian(entries, x))])
