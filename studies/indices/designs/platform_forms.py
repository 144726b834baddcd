"""Indices of platforms as CasADi expressions and constraints.

The forms N and Z (and W of an operation ellipsoid) of a symbolic pose, and their encodings.
Lengths are measured in units of the platform's extent and screws are taken about the origin of the
platform frame, so that all entries are near one; the indices do not change by that. The constraints CTN,
1/CDN_OE, sigma_R and sigma_S take a method of :mod:`studies.indices.designs.encodings`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.indices.arms.symbolic import Symbolic, isotropy_surrogate
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.platform import MINIMUM_LEGS, StewartPlatform, centroid_and_extent
from ocptip.parallel.description.frames import euler_rotation
from studies.indices.designs.encodings import ConstraintBlock, Method, psd_constraint, ratio_constraint


@dataclass(frozen=True, eq=False)
class SymbolicPlatform:
    """A platform in a symbolic pose.

    Attributes:
        platform: the anchors.
        position: (3, 1) expression, m, origin of the platform frame in the base frame.
        rotation: (3, 3) expression, platform frame to base frame; must be a rotation matrix.

    Raises:
        InputError: expressions of other shapes or of different kinds (SX and MX).
    """

    platform: StewartPlatform
    position: Symbolic
    rotation: Symbolic

    def __post_init__(self) -> None:
        for name, shape in (("position", (3, 1)), ("rotation", (3, 3))):
            value = getattr(self, name)
            if not isinstance(value, cs.SX | cs.MX) or value.shape != shape:
                raise InputError(f"{name}: expected an SX or MX expression of shape {shape}, got {value!r}")
        if type(self.position) is not type(self.rotation):
            raise InputError("rotation: expected the same kind of expression (SX or MX) as position")

    @cached_property
    def extent(self) -> float:
        """Unit of length, m: mean of the extents of the two anchor sets."""
        sets = (self.platform.base, self.platform.platform)
        return sum(centroid_and_extent(points, points)[1] for points in sets) / 2.0

    @cached_property
    def forms(self) -> tuple[Symbolic, Symbolic, Symbolic]:
        """J (n, 6), N and Z (6, 6) in units of the extent, screws about the origin of the platform frame."""
        base = [(cs.DM(b) - self.position) / self.extent for b in self.platform.base]
        moving = [self.rotation @ cs.DM(p) / self.extent for p in self.platform.platform]
        return leg_forms(base, moving)

    @property
    def J(self) -> Symbolic:
        """(n, 6) leg rates per screw, see :attr:`forms`."""
        return self.forms[0]

    @property
    def N(self) -> Symbolic:
        """(6, 6) sum of squared leg rates."""
        return self.forms[1]

    @property
    def Z(self) -> Symbolic:
        """(6, 6) sum of squared rates of the unactuated joints."""
        return self.forms[2]

    def W(self, ellipsoid: OperationEllipsoid) -> Symbolic:
        """(6, 6) metric of an ellipsoid given in the platform frame."""
        unit = OperationEllipsoid(
            ellipsoid.center / self.extent, ellipsoid.axes, ellipsoid.half_axes / self.extent
        )
        turn = cs.diagcat(self.rotation, self.rotation)
        return turn @ cs.DM(unit.W()) @ turn.T

    @property
    def manipulability(self) -> Symbolic:
        """det J with its sign for six legs, sqrt(det J'J) for more, m^3."""
        if self.platform.n_legs == MINIMUM_LEGS:
            return cs.det(self.J) * self.extent**3
        return cs.sqrt(cs.det(self.N)) * self.extent**3

    def control_number(self, bound: float, *, method: Method = "lifted", p: int = 8) -> ConstraintBlock:
        """CTN >= bound; `guess(N, Z)`."""
        return ratio_constraint(self.N, self.Z, bound, method=method, p=p, name="ctn")

    def control_surrogate(self, p: int = 8) -> Symbolic:
        """Smooth objective between CTN and 6^(1/p) CTN."""
        return isotropy_surrogate(self.N, self.Z, p)

    def conditioning(
        self, ellipsoid: OperationEllipsoid, bound: float, *, method: Method = "lifted", p: int = 8
    ) -> ConstraintBlock:
        """1/CDN_OE >= bound; `guess(N, W)`."""
        return ratio_constraint(self.N, self.W(ellipsoid), bound, method=method, p=p, name="cdn")

    def conditioning_surrogate(self, ellipsoid: OperationEllipsoid, p: int = 8) -> Symbolic:
        """Smooth objective between 1/CDN_OE and 6^(1/p) times it."""
        return isotropy_surrogate(self.N, self.W(ellipsoid), p)

    def sigma_r(self, bound: float, *, method: Method = "lifted") -> ConstraintBlock:
        """sigma_R >= bound, m; `guess(N - diag((bound / extent)^2 E, 0))`.

        By the Schur complement: A - F G^-1 F' >= sigma^2 E for G > 0 means N - diag(sigma^2 E, 0) >= 0.

        Raises:
            InputError: the bound is not positive, or method "trace", which does not apply.
        """
        if method == "trace":
            raise InputError("method: sigma_R takes 'ldl' or 'lifted', got 'trace'")
        square = (positive_number("bound", bound) / self.extent) ** 2
        return psd_constraint(
            self.N - cs.diag(cs.DM([square] * 3 + [0.0] * 3)), method=method, name="sigma_r"
        )

    def sigma_s(self, bound: float, *, method: Method = "lifted", p: int = 8) -> ConstraintBlock:
        """sigma_S >= bound; `guess(G)` with G = N[3:, 3:]."""
        floor = positive_number("bound", bound) ** 2
        return psd_constraint(self.N[3:, 3:], floor=floor, method=method, p=p, name="sigma_s")


def leg_forms(base: list[Symbolic | cs.DM], platform: list[Symbolic]) -> tuple[Symbolic, Symbolic, Symbolic]:
    """J, N and Z from anchors, all in one frame; anchors (3, 1), or (2, 1) for the plane.

    In the plane the screws are (rotation, velocity) and the matrices (n, 3) and (3, 3).
    """
    rows, Z = [], 0.0
    for b, p in zip(base, platform, strict=True):
        leg = p - b
        square = cs.sumsqr(leg)
        direction = leg / cs.sqrt(square)
        row = _velocity_map(b).T @ direction
        rows.append(row.T)
        for point in (p, b):
            velocity = _velocity_map(point)
            Z = Z + (velocity.T @ velocity - row @ row.T) / square
    J = cs.vertcat(*rows)
    return J, J.T @ J, Z


def planar_forms(
    base: np.ndarray, platform: np.ndarray, pose: Symbolic
) -> tuple[Symbolic, Symbolic, Symbolic]:
    """J, N and Z of a planar platform in the pose (x, y, angle), for `ratio_constraint(N, Z, bound)`.

    Args:
        base, platform: (n, 2) anchors in the base frame and in the platform frame, m.
        pose: (3, 1) expression: position of the platform frame, m, and angle, rad.
    """
    c, s = cs.cos(pose[2]), cs.sin(pose[2])
    rotation = cs.vertcat(cs.horzcat(c, -s), cs.horzcat(s, c))
    moving = [rotation @ cs.DM(p) for p in np.asarray(platform, dtype=float)]
    fixed = [cs.DM(b) - pose[:2] for b in np.asarray(base, dtype=float)]
    return leg_forms(fixed, moving)


def roll_pitch_yaw(angles: Symbolic) -> Symbolic:
    """(3, 3) rotation Rz(yaw) Ry(pitch) Rx(roll) of (roll, pitch, yaw), rad; smooth everywhere."""
    return euler_rotation("zyx", [angles[2], angles[1], angles[0]])


def _velocity_map(point: Symbolic | cs.DM) -> Symbolic:
    """Velocity of a point per screw: (3, 6) in space, (2, 3) in the plane."""
    if point.shape[0] == 2:
        return cs.horzcat(cs.vertcat(-point[1], point[0]), cs.DM.eye(2))
    return cs.horzcat(-cs.skew(point), cs.DM.eye(3))
