"""Platform of a parallel robot in symbols: twist, points and Newton-Euler wrench, (3.38) to (3.47)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from ocptip.numerics.vectors import cross_terms as cross
from ocptip.parallel.symbolic.leg_dynamics import LegModel
from ocptip.parallel.symbolic.spatial_sx import (
    Rotation,
    Vector,
    acceleration_matrix,
    dot,
    minus,
    plus,
    scaled,
    solve_dense,
    spin_moment,
    times,
    turn,
    unit,
    vector,
    zero,
)


@dataclass(frozen=True)
class PlatformState:
    """Motion of the platform in world axes.

    Attributes:
        rotation: entries of R_P.
        euler: axes of the free rotations in world axes: E of the convention, restricted to the mask.
        basis: axes to which the moment of tau_s belongs: world axes if all rotations are free, else `euler`.
        position, velocity, acceleration: of the platform's origin.
        omega, alpha: angular velocity and acceleration.
        matrix: Om = skew(alpha) + skew(omega)^2.
    """

    rotation: list[Vector]
    euler: list[Vector]
    basis: list[Vector]
    position: Vector
    velocity: Vector
    acceleration: Vector
    omega: Vector
    alpha: Vector
    matrix: list[Vector]

    def arm(self, point: Vector) -> Vector:
        """k = R_P kappa in world axes."""
        return times(self.rotation, point)

    def point_velocity(self, arm: Vector) -> Vector:
        """Velocity of the point at an arm from the origin, (3.44)."""
        return plus(self.velocity, cross(self.omega, arm))

    def point_acceleration(self, arm: Vector) -> Vector:
        """Acceleration of the point at an arm from the origin, (3.44)."""
        return plus(self.acceleration, times(self.matrix, arm))


def platform_motion(
    mask: Sequence[bool],
    convention: str,
    pose: Sequence[cs.SX],
    rates: Sequence[cs.SX],
    accelerations: Sequence[cs.SX],
    quasi: bool,
) -> PlatformState:
    """Motion of the platform from its free coordinates.

    Args:
        mask: which of x, y, z, phi1, phi2, phi3 are free; the others are zero.
        convention: letters of the three intrinsic rotations.
        pose: free coordinates.
        rates, accelerations: their derivatives, or for `quasi` r', omega and derivatives if all three
            rotations are free (with fewer there is no difference).
        quasi: see `rates`.
    """
    position, speed, change = (_spread(mask, values) for values in (pose, rates, accelerations))
    axes = ["xyz".index(letter) for letter in convention]
    turns = [turn(axis, angle) for axis, angle in zip(axes, position[3:], strict=True)]
    rotation = Rotation(turns).matrix()
    directions = [Rotation(turns[:k])(unit(axis)) for k, axis in enumerate(axes)]
    omega, alpha = zero(), zero()
    euler = [directions[k] for k in range(3) if mask[3 + k]]
    basis = [unit(k) for k in range(3)] if all(mask[3:]) else euler
    if quasi and all(mask[3:]):
        omega, alpha = speed[3:], change[3:]
    else:
        for k, direction in enumerate(directions):
            # E' phi' without differentiation: each axis is turned by the rotations before it.
            alpha = plus(
                alpha, scaled(change[3 + k], direction), scaled(speed[3 + k], cross(omega, direction))
            )
            omega = plus(omega, scaled(speed[3 + k], direction))
    matrix = acceleration_matrix(omega, alpha)
    return PlatformState(rotation, euler, basis, position[:3], speed[:3], change[:3], omega, alpha, matrix)


def platform_wrench(
    inertia: Sequence[cs.SX], motion: PlatformState, gravity: Vector
) -> tuple[Vector, Vector]:
    """Force and moment about the platform's origin, world axes, that move the platform, (3.47).

    Args:
        inertia: XX, XY, XZ, YY, YZ, ZZ, MX, MY, MZ, M about the origin, platform axes.
        motion: of the platform.
        gravity: acceleration of gravity, world axes.
    """
    first = times(motion.rotation, vector(inertia[6:9]))
    fall = minus(motion.acceleration, gravity)
    force = plus(scaled(inertia[9], fall), times(motion.matrix, first))
    back = [list(column) for column in zip(*motion.rotation, strict=True)]
    omega, alpha = times(back, motion.omega), times(back, motion.alpha)
    spin = spin_moment(inertia, omega, alpha, acceleration_matrix(omega, alpha))
    return force, plus(times(motion.rotation, spin), cross(first, fall))


def reduced(mask: Sequence[bool], basis: Sequence[Vector], force: Vector, moment: Vector) -> list[cs.SX]:
    """Generalised force of the free coordinates: free components of the force, moment along the free axes."""
    return [force[k] for k in range(3) if mask[k]] + [dot(axis, moment) for axis in basis]


def potential_energy(
    motion: PlatformState, inertia: Sequence[cs.SX], legs: Sequence[LegModel], gravity: Vector
) -> cs.SX:
    """Potential energy of all bodies in gravity, J; arguments as of :func:`platform_wrench`."""
    moments = [plus(motion.arm(vector(inertia[6:9])), [inertia[9] * x for x in motion.position])]
    for leg in legs:
        point = leg.origin
        for body, values in enumerate(leg.inertia):
            to_world = leg.rotation(0, body + 1)
            moments.append(plus(to_world(values[6:9]), [values[9] * x for x in point]))
            point = plus(point, to_world(leg.segments[body]))
    return -dot(gravity, plus(*moments))


def euler_rates(motion: PlatformState, rates: Sequence[cs.SX]) -> list[cs.SX]:
    """z' from s'."""
    if len(motion.euler) < 3:
        return list(rates)
    rows = [[axis[k] for axis in motion.euler] for k in range(3)]
    return [*rates[:-3], *solve_dense(rows, rates[-3:])]


def _spread(mask: Sequence[bool], values: Sequence[cs.SX]) -> list[cs.SX]:
    given = iter(values)
    return [next(given) if free else cs.SX(0.0) for free in mask]
