"""Indices of serial arms as CasADi expressions of the joint angles: for placement and motion programs.

They give one smooth number per pose; for PI_OE and CDN_OE it is a lower bound of the index, usually within a
few per cent. All depend on the joint angles only: the pose of the base drops out. Manipulability and DM_2
carry the sign of det J: an optimiser must stay in one aspect, so take the sign from the start.

Indices are ratios of extremal eigenvalues, which have no derivative where eigenvalues meet: exactly in the
best poses of symmetric designs. The stand-ins for them take SX or MX matrices; scale these to entries near
one.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.indices.arms.axes import arm_pose, moving_inertias, symbolic_inertias, symbolic_pose
from ocptip.indices.arms.operation import operation_indices
from ocptip.indices.metric import OperationEllipsoid
from ocptip.robots.model import ArmModel

if TYPE_CHECKING:
    Symbolic = Any  # CasADi's stubs have no operators between values that are SX or MX
else:
    Symbolic = cs.SX | cs.MX


def isotropy_surrogate(A: Symbolic, B: Symbolic, p: int = 8) -> Symbolic:
    """Smooth stand-in CI_p for c = sqrt(lambda_min / lambda_max) of B x = lambda A x.

    CI_p = (m^2 / (tr M^p tr M^-p))^(1/2p), M = A^-1 B: in [0, 1], one only where all eigenvalues are equal,
    and c <= CI_p <= m^(1/p) c.

    Args:
        A, B: (m, m) symmetric positive definite expressions.
        p: a power of two; 4 or 8 is good.

    Raises:
        InputError: shapes differ or p is no power of two.
    """
    m = same_order(A, B)
    forward = _power_trace(_solve(A, B), p)
    backward = _power_trace(_solve(B, A), p)
    return (m * m / (forward * backward)) ** (1.0 / (2 * p))


def soft_smallest_eigenvalue(A: Symbolic, p: int = 8) -> Symbolic:
    """(tr A^-p)^(-1/p): between m^(-1/p) and 1 times the smallest eigenvalue of a positive definite A."""
    m = order("A", A)
    return _power_trace(_solve(A, type(A)(cs.DM.eye(m))), p) ** (-1.0 / p)


def _solve(A: Symbolic, B: Symbolic) -> Symbolic:
    """A^-1 B by L D L' without permutation: right for positive definite A."""
    return by_scalars(lambda a, b: cs.ldl_solve(b, *cs.ldl(a, False)), A, B)


def by_scalars(compute: Callable[..., cs.SX], *matrices: Symbolic) -> Symbolic:
    """What CasADi computes of SX matrices alone, of SX or MX matrices."""
    if isinstance(matrices[0], cs.SX):
        return compute(*matrices)
    symbols = [cs.SX.sym("entries", *matrix.shape) for matrix in matrices]
    return cs.Function("by_scalars", symbols, [compute(*symbols)])(*matrices)


def _power_trace(M: Symbolic, p: int) -> Symbolic:
    """tr M^p by repeated squaring."""
    if isinstance(p, bool) or not isinstance(p, int) or p < 1 or p & (p - 1):
        raise InputError(f"p: expected a power of two, got {p!r}")
    while p > 2:
        M, p = M @ M, p // 2
    return cs.trace(M) if p == 1 else cs.sum1(cs.sum2(M * M.T))


def order(name: str, A: Symbolic) -> int:
    """Number of rows of a square matrix; InputError with its name otherwise."""
    if not isinstance(A, cs.SX | cs.MX) or A.shape[0] != A.shape[1]:
        raise InputError(f"{name}: expected a square SX or MX matrix, got {type(A).__name__}")
    return A.shape[0]


def same_order(A: Symbolic, B: Symbolic) -> int:
    """Number of rows of two square matrices A and B of one kind; InputError otherwise."""
    if order("A", A) != order("B", B) or type(A) is not type(B):
        raise InputError(f"B: expected the same kind and shape as A, got {B.shape} for {A.shape}")
    return A.shape[0]


EXPRESSIONS = ("manipulability", "dm_2", "pi_oe", "inv_cdn_oe")
"""Names for :func:`index_expression`."""


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
        sign: of det J in the aspect that the program stays in.
        p: a power of two; larger is nearer to the index and harder for the optimiser.

    Raises:
        InputError: unknown name, no ellipsoid, wrong sign, not six axes.
    """
    if name in ("manipulability", "dm_2"):
        value = checked_sign(sign) * arm.determinant
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


def _unit() -> cs.SX:
    return cs.SX(cs.DM.eye(6))


def checked_sign(sign: int) -> int:
    """The sign of det J; InputError if it is none."""
    if sign not in (1, -1):
        raise InputError(f"sign: must be 1 or -1, the sign of det J, got {sign!r}")
    return int(sign)
