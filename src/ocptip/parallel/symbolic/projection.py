"""Inverse dynamics of a parallel robot in minimal coordinates by coupling points, in symbols (3.37)-(3.54).

tau_s = tau_P + sum U_i^T J_Bi^-T tau_i is summed directly, without mass matrices. Motor forces come from the
platform's equilibrium with the unactuated joints already free of moments, so that no leg Jacobian is inverted
for them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.numerics.vectors import cross_terms as cross
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.symbolic.leg_dynamics import (
    LegModel,
    LegPlan,
    LegState,
    actuator_row,
    coupling_force,
    driven_force,
    leg_motion,
)
from ocptip.parallel.symbolic.platform_sx import PlatformState, platform_motion, platform_wrench, reduced
from ocptip.parallel.symbolic.spatial_sx import BlockSystem, Vector, minus, plus
from ocptip.parallel.symbolic.symbols import (
    InertiaLayout,
    coupling_entries,
    geometry_symbols,
    inertia_values,
    joint_term_values,
    leg_model,
)


@dataclass(frozen=True)
class Arguments:
    """Symbols (or structural zeros) of one evaluation.

    Attributes:
        pose, rates, accelerations: (m,) platform coordinates and derivatives; see `quasi`.
        q: (n, N) joint variables up to the coupling points.
        geometry: named parameters.
        inertia: parameters about the frames' origins in the order of the layout.
        gravity: (3,), world axes.
        wrench: (6,) external force and moment about the platform's origin, world axes.
        joint_terms: (3, n N) drive inertia, viscous and Coulomb friction.
        quasi: True if rates and accelerations are quasi-velocities r', omega and their derivatives.
    """

    pose: cs.SX
    rates: cs.SX
    accelerations: cs.SX
    q: cs.SX
    geometry: dict[str, cs.SX]
    inertia: cs.SX
    gravity: cs.SX
    wrench: cs.SX
    joint_terms: cs.SX
    quasi: bool


def projection_arguments(
    description: RobotDescription,
    state: Sequence[cs.SX],
    q: cs.SX,
    *,
    quasi: bool,
    gravity: ArrayLike | None = None,
    load: ArrayLike | None = None,
) -> Arguments:
    """With the numbers of the robot: pose, rates and accelerations, then the joints.

    Args:
        gravity: (3,), m/s^2, world axes; default the robot's.
        load: (6,) external force and moment on the platform about its origin, world axes; default none.
    """
    pose, rates, accelerations = state
    return Arguments(
        pose=pose,
        rates=rates,
        accelerations=accelerations,
        q=q,
        geometry=geometry_symbols(description, numeric=True),
        inertia=cs.SX(cs.sparsify(cs.DM(inertia_values(description)))),
        gravity=cs.SX(cs.DM(description.gravity if gravity is None else np.asarray(gravity, dtype=float))),
        wrench=cs.SX.zeros(6) if load is None else cs.SX(cs.DM(finite_array("load", load, (6,)))),
        joint_terms=cs.SX(cs.DM(joint_term_values(description))),
        quasi=quasi,
    )


Plans = Sequence[LegPlan]


class Projection:
    """The robot's equations for one set of arguments.

    Attributes:
        platform: motion of the platform.
        legs, motions: models and motions of the legs.
        arms: k_i in world axes.
    """

    def __init__(
        self, description: RobotDescription, layout: InertiaLayout, plans: Plans, arguments: Arguments
    ) -> None:
        self.description = description
        self.arguments = arguments
        self.plans = plans
        self.mask = description.platform.mask
        entries = (arguments.pose, arguments.rates, arguments.accelerations)
        pose, rates, accelerations = ([one[k] for k in range(one.numel())] for one in entries)
        self.platform: PlatformState = platform_motion(
            self.mask, description.platform.convention, pose, rates, accelerations, arguments.quasi
        )
        self.gravity = [arguments.gravity[k] for k in range(3)]
        self.layout = layout
        self.legs: list[LegModel] = []
        self.motions: list[LegState] = []
        self.arms: list[Vector] = []
        n = layout.bodies
        for i, leg in enumerate(description.legs):
            model = leg_model(
                description,
                i,
                arguments.q[:, i],
                arguments.geometry,
                arguments.inertia[layout.leg_slice(i)],
                arguments.joint_terms[:, n * i : n * (i + 1)],
            )
            arm = self.platform.arm(coupling_entries(leg, arguments.geometry))
            velocity = self.platform.point_velocity(arm)
            acceleration = self.platform.point_acceleration(arm)
            self.legs.append(model)
            self.arms.append(arm)
            self.motions.append(leg_motion(model, velocity, acceleration, self.gravity, plans[i]))

    def _reduced(self, force: Vector, moment: Vector) -> list[cs.SX]:
        return reduced(self.mask, self.platform.basis, force, moment)

    def _total(self, forces: Sequence[Vector]) -> list[cs.SX]:
        """Platform wrench minus external wrench plus coupling forces, on the free coordinates."""
        parameters = self.arguments.inertia[self.layout.platform_slice]
        force, moment = platform_wrench([parameters[k] for k in range(10)], self.platform, self.gravity)
        external = [self.arguments.wrench[k] for k in range(6)]
        force, moment = minus(force, external[:3]), minus(moment, external[3:])
        force = plus(force, *forces)
        moment = plus(moment, *(cross(arm, f) for arm, f in zip(self.arms, forces, strict=True)))
        return self._reduced(force, moment)

    def _each(self, function: Callable[..., object]) -> list:
        return [function(*one) for one in zip(self.legs, self.motions, self.plans, strict=True)]

    def generalized_force(self) -> cs.SX:
        """tau_s (3.48), dual to the free components of (r', omega)."""
        return cs.vertcat(*self._total(self._each(coupling_force)))

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
        rows = []
        for leg, joint in self.description.actuated:
            row = actuator_row(self.legs[leg], self.motions[leg], self.plans[leg], joint)
            rows.append(cs.horzcat(*self._reduced(row, cross(self.arms[leg], row))))
        return cs.vertcat(*rows)

    def closures(self) -> cs.SX:
        """(n, N) legs' coupling points minus the platform's, zero if closed."""
        columns = []
        for leg, arm in zip(self.legs, self.arms, strict=True):
            end = leg.origin
            for j, segment in enumerate(leg.segments, start=1):
                end = plus(end, leg.rotation(0, j)(segment))
            gap = minus(end, plus(self.platform.position, arm))
            columns.append(cs.vertcat(*(gap[axis] for axis in leg.axes)))
        return cs.horzcat(*columns)

    def joint_rates(self) -> cs.SX:
        """(n, N) rates of all joints up to the coupling points, (3.42)."""
        return cs.horzcat(*(cs.vertcat(*motion.rates) for motion in self.motions))

    def joint_accelerations(self) -> cs.SX:
        """(n, N) accelerations of the same joints."""
        return cs.horzcat(*(cs.vertcat(*motion.accelerations) for motion in self.motions))

    def driven_accelerations(self) -> cs.SX:
        """(n_a,) accelerations of the driven joints."""
        return cs.vertcat(
            *(self.motions[leg].accelerations[joint] for leg, joint in self.description.actuated)
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
                "not determined by the equations alone (see ocptip.parallel.dynamics.actuation)"
            )
        forces: list[Vector] = []
        of_motor: dict[tuple[int, int], tuple[cs.SX, cs.SX, list[cs.SX]]] = {}
        for i, (leg, motion, plan) in enumerate(zip(self.legs, self.motions, self.plans, strict=True)):
            if len(leg.actuated) != 1:
                forces.append(coupling_force(leg, motion, plan))
                for joint in leg.actuated:
                    row = actuator_row(leg, motion, plan, joint)
                    of_motor[i, joint] = cs.SX(0.0), cs.SX(1.0), self._reduced(row, cross(self.arms[i], row))
                continue
            driven = driven_force(leg, motion, plan)
            forces.append(driven.force)
            column = self._reduced(driven.direction, cross(self.arms[i], driven.direction))
            of_motor[i, leg.actuated[0]] = driven.effort, driven.lever, column
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
