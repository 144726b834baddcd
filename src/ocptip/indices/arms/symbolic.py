"""Indices of serial arms as CasADi expressions of the joint angles: for placement and motion programs.

Two forms. :func:`index_expression` and :func:`index_function` give one smooth number per pose; for PI_OE and
CDN_OE it is a lower bound of the index, usually within a few per cent. The `*_constraint` functions give the
exact conditions, with auxiliary variables where needed. All depend on the joint angles only: the pose of the
base drops out. Manipulability and the distances carry the sign of det J: an optimiser must stay in one
aspect, so take the sign from the start.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.indices.arms.axes import arm_pose, moving_inertias, symbolic_inertias, symbolic_pose
from ocptip.indices.arms.distance import singularity_distance
from ocptip.indices.arms.operation import operation_indices
from ocptip.indices.encodings import (
    ConstraintBlock,
    Method,
    inequality,
    isotropy_surrogate,
    psd_constraint,
    ratio_constraint,
    soft_smallest_eigenvalue,
)
from ocptip.indices.metric import OperationEllipsoid
from ocptip.robots.model import ArmModel

EXPRESSIONS = ("manipulability", "dm_2", "pi_oe", "inv_cdn_oe")
"""Names for :func:`index_expression`."""

_POSES = 200
_SMALLEST_GRADIENT = 1e-6


@dataclass(frozen=True, eq=False)
class SymbolicArm:
    """An arm at symbolic joint angles.

    Attributes:
        model: the arm.
        q: (n, 1) joint angles, rad.
        weighted: joint rates are weighted by the moving moments of inertia (PI_OE, CDN_OE).
    """

    model: ArmModel
    q: cs.SX
    weighted: bool = False

    @classmethod
    def of(cls, model: ArmModel, *, weighted: bool = False) -> SymbolicArm:
        """The arm at new symbols q."""
        return cls(model, cs.SX.sym("q", model.n), weighted)

    @cached_property
    def _pose(self) -> tuple[cs.SX, cs.SX, cs.SX]:
        return symbolic_pose(self.model, self.q)

    @property
    def jacobian(self) -> cs.SX:
        """(6, n), columns are the spears of the axes, base frame."""
        return self._pose[0]

    @cached_property
    def determinant(self) -> cs.SX:
        """det J, m^3; six axes."""
        return laplace_determinant(self.jacobian)

    @cached_property
    def gradient(self) -> cs.SX:
        """(4, 1) its derivatives by the angles of joints 2 to 5, m^3/rad."""
        return cs.gradient(self.determinant, self.q)[1:5]

    @cached_property
    def volume(self) -> float:
        """m^3: root mean square of det J over random poses, which brings determinants to the size of 1.

        Without it an optimiser's tolerance is a large share of the square of a determinant in m^3.
        """
        poses = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSES, self.model.n))
        determinants = np.linalg.det(arm_pose(self.model, poses).jacobian)
        return float(np.sqrt(np.mean(determinants**2)))

    def velocities(self, ellipsoid: OperationEllipsoid, speeds: cs.SX | None = None) -> cs.SX:
        """V = F J (6, n) with W = F' F, m; weighted: F J G^-1/2, m/s per square root of a joule.

        V' V is Z = J' W J (weighted: G^-1/2 Z G^-1/2). V V' has the same eigenvalues for six axes, and for
        more those that are not always zero.

        Args:
            ellipsoid: operation ellipsoid in the gripper frame.
            speeds: (6,) instead of the `principal_speeds` of the ellipsoid: an ellipsoid of variable size.
        """
        jacobian, rotation, position = self._pose
        axes = rotation @ cs.SX(ellipsoid.axes)
        center = rotation @ cs.SX(ellipsoid.center) + position
        speeds = cs.SX(ellipsoid.principal_speeds) if speeds is None else speeds
        angular, moment = jacobian[:3, :], jacobian[3:, :]
        velocities = cs.vertcat(
            cs.diag(speeds[:3]) @ axes.T @ angular, speeds[3] * (moment - cs.skew(center) @ angular)
        )
        if self.weighted:
            return velocities @ cs.diag(cs.sqrt(2.0 / symbolic_inertias(self.model, self.q)))
        return velocities

    def design_constant(self, ellipsoid: OperationEllipsoid) -> float:
        """DC, m^2 (weighted: m^2/s^2/J): value of zeta when axis 6 turns alone; the same in all poses.

        Raises:
            InputError: not six axes, or weighted and axis 6 moves no inertia.
        """
        if self.model.n != 6:
            raise InputError(f"arm: PI_OE is defined for six axes, got {self.model.n}")
        pose = arm_pose(self.model, np.zeros(6))
        result = operation_indices(
            pose.jacobian,
            ellipsoid,
            pose.rotation,
            pose.position,
            inertias=moving_inertias(pose) if self.weighted else None,
        )
        return float(result.design_constant)

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


def laplace_determinant(matrix: cs.SX) -> cs.SX:
    """det of a 6 x 6 expression by complementary 3 x 3 minors: polynomial, no division, few operations.

    Raises:
        InputError: not 6 x 6.
    """
    if matrix.shape != (6, 6):
        raise InputError(f"matrix: expected shape 6 x 6 (an arm of six axes), got {matrix.shape}")
    total = cs.SX(0)
    for upper in itertools.combinations(range(6), 3):
        lower = [k for k in range(6) if k not in upper]
        sign = (-1) ** (sum(upper) + 3)
        total += sign * _minor(matrix[:3, list(upper)]) * _minor(matrix[3:, lower])
    return total


def _minor(m: cs.SX) -> cs.SX:
    return cs.dot(m[:, 0], cs.cross(m[:, 1], m[:, 2]))


def index_expression(
    arm: SymbolicArm,
    name: str,
    *,
    ellipsoid: OperationEllipsoid | None = None,
    sign: int = 1,
    p: int = 8,
) -> cs.SX:
    """One index as a smooth expression of the joint angles.

    Args:
        arm: the arm.
        name: "manipulability": sign * det J, m^3; "dm_2": sign * det J / |g|, rad, not defined where the
            manipulability is stationary; "pi_oe": between 6^(-1/2p) PI_OE and PI_OE; "inv_cdn_oe": between
            6^(-1/p)/CDN_OE and 1/CDN_OE. The last two need regular poses.
        ellipsoid: operation ellipsoid in the gripper frame, for the last two.
        sign: of det J in the aspect that the program stays in, see `SymbolicArm.sign_at`.
        p: a power of two; larger is nearer to the index and harder for the optimiser.

    Raises:
        InputError: unknown name, no ellipsoid, wrong sign, not six axes.
    """
    if name in ("manipulability", "dm_2"):
        value = _checked_sign(sign) * arm.determinant
        return value if name == "manipulability" else value / cs.norm_2(arm.gradient)
    if name not in EXPRESSIONS:
        raise InputError(f"name: no expression {name!r}; there are {', '.join(EXPRESSIONS)}")
    if ellipsoid is None:
        raise InputError(f"ellipsoid: {name} needs an operation ellipsoid")
    velocities = arm.velocities(ellipsoid)
    scale = cs.sumsqr(velocities) / 6.0
    if name == "pi_oe":
        constant = arm.design_constant(ellipsoid)
        return cs.sqrt(soft_smallest_eigenvalue(velocities.T @ velocities / scale, p) * scale / constant)
    return 6.0 ** (-1.0 / p) * isotropy_surrogate(_unit(), velocities @ velocities.T / scale, p)


def index_function(model: ArmModel, name: str, *, weighted: bool = False, **options: Any) -> cs.Function:
    """An index as CasADi function: in q (n,), rad, out value; options of :func:`index_expression`."""
    arm = SymbolicArm.of(model, weighted=weighted)
    return cs.Function(name, [arm.q], [index_expression(arm, name, **options)], ["q"], [name])


def manipulability_constraint(arm: SymbolicArm, least: float, *, sign: int) -> ConstraintBlock:
    """MPB >= `least`, m^3, in the aspect of the given sign of det J."""
    margin = _checked_sign(sign) * arm.determinant - positive_number("least", least)
    return inequality(margin / arm.volume)


def dm_2_constraint(arm: SymbolicArm, least: float, *, sign: int) -> ConstraintBlock:
    """DM_2 >= `least`, rad, as `sign * det J >= least * |g|` with |g| slightly enlarged.

    The enlargement keeps the root smooth and shuts out singularities of higher order (det J = 0, g = 0),
    which would count as far away. The squared form takes more iterations and fails more often.

    Args:
        arm: the arm. `least`: bound, rad.
        sign: of det J in the aspect, see `SymbolicArm.sign_at`.
    """
    det, gradient = _checked_sign(sign) * arm.determinant / arm.volume, arm.gradient / arm.volume
    length = cs.sqrt(cs.sumsqr(gradient) + _SMALLEST_GRADIENT**2)
    return inequality(det - positive_number("least", least) * length)


def dm_inf_constraint(arm: SymbolicArm, least: float, *, sign: int, name: str = "dm_inf") -> ConstraintBlock:
    """DM_inf >= `least`, rad, with four auxiliary variables that bound |g_i|; arguments as for DM_2.

    `guess(q)` gives their start values.
    """
    slack = cs.SX.sym(name, 4)
    det, gradient = _checked_sign(sign) * arm.determinant / arm.volume, arm.gradient / arm.volume
    total = cs.sum1(slack) + _SMALLEST_GRADIENT
    rows = cs.vertcat(det - positive_number("least", least) * total, slack - gradient, slack + gradient)
    block = inequality(rows)
    start = arm.values(cs.fabs(gradient))
    return dataclasses.replace(block, variables=slack, guess=lambda q: start(q).ravel())


def heading_constraint(arm: SymbolicArm, rates: cs.SX, steepest: float, *, sign: int) -> ConstraintBlock:
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
    return inequality(_checked_sign(sign) * cs.dot(gradient, inner) + np.sin(angle) * length)


def pi_oe_constraint(
    arm: SymbolicArm,
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
    arm: SymbolicArm,
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


def _checked_sign(sign: int) -> int:
    if sign not in (1, -1):
        raise InputError(f"sign: must be 1 or -1, the sign of det J, got {sign!r}")
    return int(sign)


def _checked_share(least: float) -> float:
    if positive_number("least", least) > 1.0:
        raise InputError(f"the index is at most 1, got {least!r}")
    return float(least)
