"""Indices of serial arms as constraints of a nonlinear program: the exact conditions.

All depend on the joint angles only: the pose of the base drops out. Manipulability and the distances carry
the sign of det J: an optimiser must stay in one aspect, so take the sign from the start.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.indices.arms.axes import arm_pose
from ocptip.indices.arms.distance import singularity_distance
from ocptip.indices.arms.symbolic import SymbolicArm, checked_sign
from ocptip.indices.metric import OperationEllipsoid
from studies.indices.designs.encodings import (
    ConstraintBlock,
    Method,
    inequality,
    psd_constraint,
    ratio_constraint,
)

_POSES = 200
_SMALLEST_GRADIENT = 1e-6


@dataclass(frozen=True, eq=False)
class DesignArm(SymbolicArm):
    """An arm at symbolic joint angles, whose pose a program chooses."""

    @cached_property
    def volume(self) -> float:
        """m^3: root mean square of det J over random poses, which brings determinants to the size of 1.

        Without it an optimiser's tolerance is a large share of the square of a determinant in m^3.
        """
        poses = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSES, self.model.n))
        determinants = np.linalg.det(arm_pose(self.model, poses).jacobian)
        return float(np.sqrt(np.mean(determinants**2)))

    def values(self, expression: cs.SX) -> Callable[[np.ndarray], np.ndarray]:
        """NumPy function of q for an expression in the joint angles."""
        function = cs.Function("value", [self.q], [cs.densify(expression)])
        return lambda q: np.array(function(q))

    def sign_at(self, q: np.ndarray) -> int:
        """Sign of det J at q (n,), rad: the aspect an optimiser has to stay in.

        Raises:
            InputError: bad q, or a singular pose.
        """
        sign = int(np.sign(singularity_distance(arm_pose(self.model, q).jacobian).determinant))
        if sign == 0:
            raise InputError(f"q: singular pose, det J = 0, at {np.asarray(q).tolist()}")
        return sign


def manipulability_constraint(arm: DesignArm, least: float, *, sign: int) -> ConstraintBlock:
    """MPB >= `least`, m^3, in the aspect of the given sign of det J."""
    margin = checked_sign(sign) * arm.determinant - positive_number("least", least)
    return inequality(margin / arm.volume)


def dm_2_constraint(arm: DesignArm, least: float, *, sign: int) -> ConstraintBlock:
    """DM_2 >= `least`, rad, as `sign * det J >= least * |g|` with |g| slightly enlarged.

    The enlargement keeps the root smooth and shuts out singularities of higher order (det J = 0, g = 0),
    which would count as far away. The squared form takes more iterations and fails more often.

    Args:
        arm: the arm. `least`: bound, rad.
        sign: of det J in the aspect, see `DesignArm.sign_at`.
    """
    det, gradient = checked_sign(sign) * arm.determinant / arm.volume, arm.gradient / arm.volume
    length = cs.sqrt(cs.sumsqr(gradient) + _SMALLEST_GRADIENT**2)
    return inequality(det - positive_number("least", least) * length)


def dm_inf_constraint(arm: DesignArm, least: float, *, sign: int, name: str = "dm_inf") -> ConstraintBlock:
    """DM_inf >= `least`, rad, with four auxiliary variables that bound |g_i|; arguments as for DM_2.

    `guess(q)` gives their start values.
    """
    slack = cs.SX.sym(name, 4)
    det, gradient = checked_sign(sign) * arm.determinant / arm.volume, arm.gradient / arm.volume
    total = cs.sum1(slack) + _SMALLEST_GRADIENT
    rows = cs.vertcat(det - positive_number("least", least) * total, slack - gradient, slack + gradient)
    block = inequality(rows)
    start = arm.values(cs.fabs(gradient))
    return dataclasses.replace(block, variables=slack, guess=lambda q: start(q).ravel())


def heading_constraint(arm: DesignArm, rates: cs.SX, steepest: float, *, sign: int) -> ConstraintBlock:
    """Sigma >= -steepest: limits how directly a motion may head for a singularity.

    Args:
        arm: the arm.
        rates: (6, 1) joint rates, an expression.
        steepest: angle, rad, in (0, pi/2); near 0: only parallel to the singularity or away from it.
        sign: of det J in the aspect.

    Raises:
        InputError: steepest out of range, wrong sign.
    """
    angle = positive_number("steepest", steepest)
    if angle >= np.pi / 2:
        raise InputError(f"steepest: must be below pi/2 (where it limits nothing), got {angle:.6g}")
    inner, gradient = rates[1:5], arm.gradient / arm.volume
    length = cs.sqrt(cs.sumsqr(gradient) * cs.sumsqr(inner) + np.finfo(float).tiny)
    return inequality(checked_sign(sign) * cs.dot(gradient, inner) + np.sin(angle) * length)


def pi_oe_constraint(
    arm: DesignArm,
    ellipsoid: OperationEllipsoid,
    least: float,
    *,
    method: Method = "ldl",
    p: int = 8,
) -> ConstraintBlock:
    """PI_OE >= `least`: `Z - least^2 DC identity` is positive semidefinite.

    Args:
        arm: the arm, six axes.
        ellipsoid: operation ellipsoid in the gripper frame. `least`: bound, `0 < least <= 1`.
        method, p: see `psd_constraint`; "ldl" took the fewest iterations in our tests, "lifted" is the most
            robust.

    Returns:
        The block; `guess(q)` gives start values of the auxiliary variables.

    Raises:
        InputError: bound out of range, unknown method, not six axes.
    """
    floor = _checked_share(least) ** 2 * arm.design_constant(ellipsoid)
    velocities = arm.velocities(ellipsoid)
    matrix, scale = velocities.T @ velocities, cs.sumsqr(velocities) / 6.0
    if method == "trace":
        return psd_constraint(matrix / scale, floor=floor / scale, method=method, p=p)
    shifted = (matrix - floor * _unit()) / scale
    block = psd_constraint(shifted, method=method, name="pi_oe")
    start = arm.values(shifted)
    return dataclasses.replace(block, guess=lambda q: block.guess(start(q)))


def inv_cdn_oe_constraint(
    arm: DesignArm,
    ellipsoid: OperationEllipsoid,
    least: float,
    *,
    method: Method = "lifted",
    p: int = 8,
) -> ConstraintBlock:
    """1/CDN_OE >= `least`; arguments, result and errors as for :func:`pi_oe_constraint`, but n >= 6 axes."""
    velocities = arm.velocities(ellipsoid)
    # The side of the end-effector: a third of the iterations that Z = V' V took.
    scaled = velocities @ velocities.T / (cs.sumsqr(velocities) / 6.0)
    block = ratio_constraint(_unit(), scaled, _checked_share(least), method=method, p=p, name="inv_cdn_oe")
    start = arm.values(scaled)
    return dataclasses.replace(block, guess=lambda q: block.guess(np.eye(6), start(q)))


def _unit() -> cs.SX:
    return cs.SX(cs.DM.eye(6))


def _checked_share(least: float) -> float:
    if positive_number("least", least) > 1.0:
        raise InputError(f"the index is at most 1, got {least!r}")
    return float(least)
