"""Platform and inverse dynamics of a parallel robot by coupling points, in symbols (3.37)-(3.54).

tau_s = tau_P + sum U_i^T J_Bi^-T tau_i is summed directly, without mass matrices. Motor forces come from the
platform's equilibrium with the unactuated joints already free of moments, so that no leg Jacobian is inverted
for them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.numerics.vectors import cross_terms as cross
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.symbolic.leg_dynamics import CouplingLeg, LegModel, LegPlan
from ocptip.parallel.symbolic.spatial_sx import (
    BlockSystem,
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
from ocptip.parallel.symbolic.symbols import (
    InertiaLayout,
    coupling_entries,
    geometry_symbols,
    inertia_values,
    joint_term_values,
    leg_model,
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


@dataclass(frozen=True)
class Arguments:
    """Symbols, numbers or structural zeros of one evaluation.

    Attributes:
        pose, rates, accelerations: (m,) coordinates and derivatives; see `quasi`.
        q: (n, N) joint variables up to the coupling points; of complete legs (n,) those of all joints leg by
            leg, then the dependent coordinates.
        inertia: parameters about the frames' origins in the order of the layout.
        gravity: (3,), world axes.
        quasi: True if rates and accelerations are quasi-velocities r', omega and their derivatives.
        geometry: named parameters; those of complete legs are always numbers.
        wrench: (6,) external force and moment about the platform's origin, world axes.
        joint_terms: (3, n N) drive inertia, viscous and Coulomb friction; those of complete legs are always
            numbers.
    """

    pose: cs.SX
    rates: cs.SX
    accelerations: cs.SX
    q: cs.SX
    inertia: cs.SX
    gravity: cs.SX
    quasi: bool = True
    geometry: dict[str, cs.SX] = field(default_factory=dict)
    wrench: cs.SX = field(default_factory=lambda: cs.SX.zeros(6))
    joint_terms: cs.SX = field(default_factory=cs.SX)


def robot_arguments(
    description: RobotDescription,
    state: Sequence[cs.SX],
    q: cs.SX,
    *,
    quasi: bool = True,
    complete: bool = False,
    gravity: ArrayLike | None = None,
    load: ArrayLike | None = None,
) -> Arguments:
    """With the numbers of the robot: pose, rates and accelerations, then the joints.

    Args:
        complete: of complete legs.
        gravity: (3,), m/s^2, world axes; default the robot's.
        load: (6,) external force and moment on the platform about its origin, world axes; default none.
    """
    pose, rates, accelerations = state
    inertia = cs.SX(cs.sparsify(cs.DM(inertia_values(description, complete=complete))))
    fall = cs.SX(cs.DM(description.gravity if gravity is None else np.asarray(gravity, dtype=float)))
    wrench = cs.SX.zeros(6) if load is None else cs.SX(cs.DM(finite_array("load", load, (6,))))
    terms = cs.SX() if complete else cs.SX(cs.DM(joint_term_values(description)))
    geometry = geometry_symbols(description, numeric=True)
    return Arguments(pose, rates, accelerations, q, inertia, fall, quasi, geometry, wrench, terms)


Plans = Sequence[LegPlan]


class Projection:
    """The robot's equations for one set of arguments.

    Attributes:
        platform: motion of the platform.
        legs: of the robot, moved.
        gravity, body: entries of gravity and of the platform's inertia.
    """

    def __init__(
        self, description: RobotDescription, layout: InertiaLayout, plans: Plans, arguments: Arguments
    ) -> None:
        self.description = description
        self.arguments = arguments
        self.mask = description.platform.mask
        entries = (arguments.pose, arguments.rates, arguments.accelerations)
        pose, rates, accelerations = ([one[k] for k in range(one.numel())] for one in entries)
        self.platform: PlatformState = platform_motion(
            self.mask, description.platform.convention, pose, rates, accelerations, arguments.quasi
        )
        self.gravity = [arguments.gravity[k] for k in range(3)]
        self.body = cs.vertsplit(arguments.inertia[layout.platform_slice])
        n = layout.bodies
        terms = (
            arguments.joint_terms if arguments.joint_terms.numel() else cs.SX.zeros(3, arguments.q.numel())
        )
        self.legs: list[CouplingLeg] = []
        for i, (leg, plan) in enumerate(zip(description.legs, plans, strict=True)):
            q, inertia = arguments.q[:, i], arguments.inertia[layout.leg_slice(i)]
            of_leg = terms[:, n * i : n * (i + 1)]
            model = leg_model(description, i, q, arguments.geometry, inertia, of_leg)
            arm = self.platform.arm(coupling_entries(leg, arguments.geometry))
            one = CouplingLeg(model, plan, arm)
            one.move(self.platform.point_velocity(arm), self.platform.point_acceleration(arm), self.gravity)
            self.legs.append(one)

    def _reduced(self, force: Vector, moment: Vector) -> list[cs.SX]:
        return reduced(self.mask, self.platform.basis, force, moment)

    def _at(self, leg: CouplingLeg, force: Vector) -> list[cs.SX]:
        """A force at a leg's coupling point on the free coordinates."""
        return self._reduced(force, cross(leg.arm, force))

    def _total(self, forces: Sequence[Vector]) -> list[cs.SX]:
        """Platform wrench minus external wrench plus coupling forces, on the free coordinates."""
        force, moment = self.platform_load()
        force = plus(force, *forces)
        moment = plus(moment, *(cross(leg.arm, f) for leg, f in zip(self.legs, forces, strict=True)))
        return self._reduced(force, moment)

    def platform_load(self) -> tuple[Vector, Vector]:
        """Platform wrench minus external wrench, world axes, moment about the platform's origin."""
        force, moment = platform_wrench(self.body, self.platform, self.gravity)
        external = [self.arguments.wrench[k] for k in range(6)]
        return minus(force, external[:3]), minus(moment, external[3:])

    def generalized_force(self) -> cs.SX:
        """tau_s (3.48), dual to the free components of (r', omega)."""
        return cs.vertcat(*self._total([leg.force() for leg in self.legs]))

    def euler_force(self) -> cs.SX:
        """tau_z = H^T tau_s, dual to the derivatives of the free coordinates."""
        force = self.generalized_force()
        if not all(self.mask[3:]):
            return force
        free = sum(self.mask[:3])
        moment = [force[free + k] for k in range(3)]
        turned = [
            sum((a * b for a, b in zip(axis, moment, strict=True)), cs.SX(0.0))
            for axis in self.platform.euler
        ]
        return cs.vertcat(*[force[k] for k in range(free)], *turned)

    def jacobian(self) -> cs.SX:
        """J_a (3.45)-(3.46), n_a x m: rates of the driven joints from s'."""
        motors = [(self.legs[leg], joint) for leg, joint in self.description.actuated]
        return cs.vertcat(*(cs.horzcat(*self._at(leg, leg.row(joint))) for leg, joint in motors))

    def closures(self) -> cs.SX:
        """(n, N) legs' coupling points minus the platform's, zero if closed."""
        columns = []
        for leg in self.legs:
            gap = minus(leg.model.end, plus(self.platform.position, leg.arm))
            columns.append(cs.vertcat(*(gap[axis] for axis in leg.model.axes)))
        return cs.horzcat(*columns)

    def potential(self) -> cs.SX:
        """Potential energy in gravity, J."""
        return potential_energy(self.platform, self.body, [leg.model for leg in self.legs], self.gravity)

    def joint_rates(self) -> cs.SX:
        """(n, N) rates of all joints up to the coupling points, (3.42)."""
        return cs.horzcat(*(cs.vertcat(*leg.motion.rates) for leg in self.legs))

    def joint_accelerations(self) -> cs.SX:
        """(n, N) accelerations of the same joints."""
        return cs.horzcat(*(cs.vertcat(*leg.motion.accelerations) for leg in self.legs))

    def driven_accelerations(self) -> cs.SX:
        """(n_a,) accelerations of the driven joints."""
        return cs.vertcat(
            *(self.legs[leg].motion.accelerations[joint] for leg, joint in self.description.actuated)
        )

    def motor_forces(self, order: Sequence[int] | None = None) -> cs.SX:
        """tau_a of J_a^T tau_a = tau_s, (3.53), for as many motors as free coordinates.

        Args:
            order: in which the motors' columns are eliminated; matters only for four and more coupled ones.
        """
        m, motors = sum(self.mask), self.description.actuated
        if len(motors) != m:
            raise InputError(
                f"{self.description.name}: {len(motors)} motors for {m} free coordinates; motor forces are "
                "not determined by the equations alone (see ocptip.parallel.dynamics.terms)"
            )
        forces: list[Vector] = []
        of_motor: dict[tuple[int, int], tuple[cs.SX, cs.SX, list[cs.SX]]] = {}
        for i, leg in enumerate(self.legs):
            if len(leg.model.actuated) == 1:
                driven = leg.driven()
                forces.append(driven.force)
                column = self._at(leg, driven.direction)
                of_motor[i, leg.model.actuated[0]] = driven.effort, driven.lever, column
            else:
                forces.append(leg.force())
                for joint in leg.model.actuated:
                    of_motor[i, joint] = cs.SX(0.0), cs.SX(1.0), self._at(leg, leg.row(joint))
        columns = [of_motor[motor][2] for motor in motors]
        order = range(m) if order is None else order
        system = BlockSystem([[columns[k][row] for k in order] for row in range(m)])
        solved = system.solve(self._total(forces))
        pulls = [solved[list(order).index(k)] for k in range(m)]
        return cs.vertcat(
            *(
                of_motor[motor][0] + of_motor[motor][1] * pull
                for motor, pull in zip(motors, pulls, strict=True)
            )
        )
