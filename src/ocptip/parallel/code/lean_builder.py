"""Outputs of generated functions from the projection; arguments that play no part are structural zeros."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from ocptip.basics.errors import InputError
from ocptip.parallel.analysis.elimination import elimination_order
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.symbolic.block_solver import BlockSystem
from ocptip.parallel.symbolic.projection import Arguments, Plans, Projection
from ocptip.parallel.symbolic.symbols import InertiaLayout, geometry_symbols, origin_inertia


@dataclass(frozen=True)
class Options:
    """What a generated function takes; see :func:`ocptip.parallel.code.lean.lean_function`."""

    form: str
    dynpar: int
    quasi: bool
    wrench: bool
    joint_terms: bool
    numeric_geometry: bool

    @property
    def rates(self) -> str:
        """Name of the input."""
        return "sd" if self.quasi else "zd"

    @property
    def accelerations(self) -> str:
        """Name of the input."""
        return "qadd" if self.form == "AA" else self.rates + "d"


class Builder:
    """Symbols of a function and its outputs.

    Attributes:
        inputs, input_names: of the function, in order.
    """

    def __init__(
        self,
        description: RobotDescription,
        layout: InertiaLayout,
        plans: Plans,
        kept: Sequence[bool],
        options: Options,
    ) -> None:
        m, n, count = description.platform.m, layout.bodies, len(description.legs)
        self.description, self.layout, self.plans = description, layout, plans
        self.form, self.quasi = options.form, options.quasi
        self.z = ca.SX.sym("z", m)
        self.rates = ca.SX.sym(options.rates, m)
        self.accelerations = ca.SX.sym(options.accelerations, m)
        self.q = ca.SX.sym("q", n, count)
        self.geometry = geometry_symbols(description, options.numeric_geometry)
        named = [] if options.numeric_geometry else list(self.geometry.values())
        self.inertia = ca.SX.sym("inertia", sum(kept))
        self.gravity = ca.SX.sym("gravity", 3)
        given = iter(self.inertia[k] for k in range(sum(kept)))
        full = ca.vertcat(*(next(given) if keep else ca.SX(0.0) for keep in kept))
        self.full_inertia = origin_inertia(full) if options.dynpar == 1 else full
        self.inputs = [self.z, self.rates, self.accelerations, self.q]
        self.inputs += [ca.vertcat(*named) if named else ca.SX(0, 1), self.inertia, self.gravity]
        self.input_names = ["z", options.rates, options.accelerations, "q", "geometry", "inertia", "gravity"]
        self.wrench, self.joint_terms = ca.SX.zeros(6), ca.SX.zeros(3, n * count)
        if options.wrench:
            self.wrench = ca.SX.sym("wrench", 6)
            self.inputs.append(self.wrench)
            self.input_names.append("wrench")
        if options.joint_terms:
            self.joint_terms = ca.SX.sym("joint_terms", 3, n * count)
            self.inputs.append(self.joint_terms)
            self.input_names.append("joint_terms")
        self.order = elimination_order(description) if self.form in ("A", "AA") else None
        self._parts: dict[tuple[bool, bool, bool], Projection] = {}

    def output(self, which: str) -> ca.SX:
        """One output of `OUTPUTS`."""
        if which == "J_a":
            return self._projection(True, True, True).jacobian()
        if which in ("qd", "qdd"):
            projection = self._projection(True, True, True)
            return projection.joint_rates() if which == "qd" else projection.joint_accelerations()
        if which == "M":
            return self._mass_matrix()
        if which == "W_joint":
            return ca.jacobian(self._tau(True, True, True), ca.vec(self.joint_terms))
        part = which.removeprefix("W_")
        flags = {"M": (False, True, False), "c": (True, False, False), "g": (False, False, True)}
        tau = self._tau(*flags.get(part, (True, True, True)))
        return ca.jacobian(tau, self.inertia) if which.startswith("W") else tau

    def _projection(self, moving: bool, accelerating: bool, falling: bool) -> Projection:
        key = (moving, accelerating, falling)
        if key not in self._parts:
            m = self.z.numel()
            rates = self.rates if moving else ca.SX.zeros(m)
            accelerations = self.accelerations if accelerating else ca.SX.zeros(m)
            if self.form == "AA":
                accelerations = self._platform_acceleration(rates, accelerations)
            gravity = self.gravity if falling else ca.SX.zeros(3)
            # Of the parts of tau the external wrench belongs to c, together with the friction.
            wrench = self.wrench if moving else ca.SX.zeros(6)
            self._parts[key] = self._project(rates, accelerations, gravity, wrench)
        return self._parts[key]

    def _project(
        self, rates: ca.SX, accelerations: ca.SX, gravity: ca.SX | None = None, wrench: ca.SX | None = None
    ) -> Projection:
        arguments = Arguments(
            pose=self.z,
            rates=rates,
            accelerations=accelerations,
            q=self.q,
            geometry=self.geometry,
            inertia=self.full_inertia,
            gravity=ca.SX.zeros(3) if gravity is None else gravity,
            wrench=ca.SX.zeros(6) if wrench is None else wrench,
            joint_terms=self.joint_terms,
            quasi=self.quasi,
        )
        return Projection(self.description, self.layout, self.plans, arguments)

    def _platform_acceleration(self, rates: ca.SX, driven: ca.SX) -> ca.SX:
        """z'' from q_a'' of the motors: J_z z'' = q_a'' - (q_a'' at z'' = 0)."""
        still = self._project(rates, ca.SX.zeros(rates.numel()))
        probe = ca.SX.sym("probe", rates.numel())
        answer = self._project(ca.SX.zeros(rates.numel()), probe).driven_accelerations()
        jacobian = ca.jacobian(answer, probe)
        if jacobian.size1() != jacobian.size2():
            raise InputError(
                f"{self.description.name}: form AA needs as many motors as free coordinates, got "
                f"{jacobian.size1()} for {jacobian.size2()}"
            )
        size = jacobian.size1()
        system = BlockSystem([[ca.SX(jacobian[i, j]) for j in range(size)] for i in range(size)])
        drift = still.driven_accelerations()
        return ca.vertcat(*system.solve([driven[k] - drift[k] for k in range(size)]))

    def _tau(self, moving: bool, accelerating: bool, falling: bool) -> ca.SX:
        projection = self._projection(moving, accelerating, falling)
        if self.form in ("A", "AA"):
            return projection.motor_forces(self.order)
        return projection.euler_force() if self.form == "Z" else projection.generalized_force()

    def _mass_matrix(self) -> ca.SX:
        matrix = ca.jacobian(self._tau(False, True, False), self.accelerations)
        symmetric = self.form in ("S", "Z", "AA") or (
            self.form == "X" and sum(self.description.platform.mask[3:]) < 3
        )
        return ca.tril2symm(ca.tril(matrix)) if symmetric else matrix
