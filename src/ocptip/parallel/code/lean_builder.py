"""Outputs of generated functions from the projection; arguments that play no part are structural zeros."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

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
        self.z = cs.SX.sym("z", m)
        self.rates = cs.SX.sym(options.rates, m)
        self.accelerations = cs.SX.sym(options.accelerations, m)
        self.q = cs.SX.sym("q", n, count)
        self.geometry = geometry_symbols(description, options.numeric_geometry)
        named = [] if options.numeric_geometry else list(self.geometry.values())
        self.inertia = cs.SX.sym("inertia", sum(kept))
        self.gravity = cs.SX.sym("gravity", 3)
        given = iter(self.inertia[k] for k in range(sum(kept)))
        full = cs.vertcat(*(next(given) if keep else cs.SX(0.0) for keep in kept))
        self.full_inertia = origin_inertia(full) if options.dynpar == 1 else full
        self.inputs = [self.z, self.rates, self.accelerations, self.q]
        self.inputs += [cs.vertcat(*named) if named else cs.SX(0, 1), self.inertia, self.gravity]
        self.input_names = ["z", options.rates, options.accelerations, "q", "geometry", "inertia", "gravity"]
        self.wrench, self.joint_terms = cs.SX.zeros(6), cs.SX.zeros(3, n * count)
        if options.wrench:
            self.wrench = cs.SX.sym("wrench", 6)
            self.inputs.append(self.wrench)
            self.input_names.append("wrench")
        if options.joint_terms:
            self.joint_terms = cs.SX.sym("joint_terms", 3, n * count)
            self.inputs.append(self.joint_terms)
            self.input_names.append("joint_terms")
        self.order = elimination_order(description) if self.form in ("A", "AA") else None
        self._parts: dict[tuple[bool, bool, bool], Projection] = {}

    def output(self, which: str) -> cs.SX:
        """One output of `OUTPUTS`."""
        if which == "J_a":
            return self._projection(True, True, True).jacobian()
        if which in ("qd", "qdd"):
            projection = self._projection(True, True, True)
            return projection.joint_rates() if which == "qd" else projection.joint_accelerations()
        if which == "M":
            return self._mass_matrix()
        if which == "W_joint":
            return cs.jacobian(self._tau(True, True, True), cs.vec(self.joint_terms))
        part = which.removeprefix("W_")
        flags = {"M": (False, True, False), "c": (True, False, False), "g": (False, False, True)}
        tau = self._tau(*flags.get(part, (True, True, True)))
        return cs.jacobian(tau, self.inertia) if which.startswith("W") else tau

    def _projection(self, moving: bool, accelerating: bool, falling: bool) -> Projection:
        key = (moving, accelerating, falling)
        if key not in self._parts:
            m = self.z.numel()
            rates = self.rates if moving else cs.SX.zeros(m)
            accelerations = self.accelerations if accelerating else cs.SX.zeros(m)
            if self.form == "AA":
                accelerations = self._platform_acceleration(rates, accelerations)
            gravity = self.gravity if falling else cs.SX.zeros(3)
            # Of the parts of tau the external wrench belongs to c, together with the friction.
            wrench = self.wrench if moving else cs.SX.zeros(6)
            self._parts[key] = self._project(rates, accelerations, gravity, wrench)
        return self._parts[key]

    def _project(
        self, rates: cs.SX, accelerations: cs.SX, gravity: cs.SX | None = None, wrench: cs.SX | None = None
    ) -> Projection:
        arguments = Arguments(
            pose=self.z,
            rates=rates,
            accelerations=accelerations,
            q=self.q,
            geometry=self.geometry,
            inertia=self.full_inertia,
            gravity=cs.SX.zeros(3) if gravity is None else gravity,
            wrench=cs.SX.zeros(6) if wrench is None else wrench,
            joint_terms=self.joint_terms,
            quasi=self.quasi,
        )
        return Projection(self.description, self.layout, self.plans, arguments)

    def _platform_acceleration(self, rates: cs.SX, driven: cs.SX) -> cs.SX:
        """z'' from q_a'' of the motors: J_z z'' = q_a'' - (q_a'' at z'' = 0)."""
        still = self._project(rates, cs.SX.zeros(rates.numel()))
        probe = cs.SX.sym("probe", rates.numel())
        answer = self._project(cs.SX.zeros(rates.numel()), probe).driven_accelerations()
        jacobian = cs.jacobian(answer, probe)
        if jacobian.size1() != jacobian.size2():
            raise InputError(
                f"{self.description.name}: form AA needs as many motors as free coordinates, got "
                f"{jacobian.size1()} for {jacobian.size2()}"
            )
        size = jacobian.size1()
        system = BlockSystem([[cs.SX(jacobian[i, j]) for j in range(size)] for i in range(size)])
        drift = still.driven_accelerations()
        return cs.vertcat(*system.solve([driven[k] - drift[k] for k in range(size)]))

    def _tau(self, moving: bool, accelerating: bool, falling: bool) -> cs.SX:
        projection = self._projection(moving, accelerating, falling)
        if self.form in ("A", "AA"):
            return projection.motor_forces(self.order)
        return projection.euler_force() if self.form == "Z" else projection.generalized_force()

    def _mass_matrix(self) -> cs.SX:
        matrix = cs.jacobian(self._tau(False, True, False), self.accelerations)
        symmetric = self.form in ("S", "Z", "AA") or (
            self.form == "X" and sum(self.description.platform.mask[3:]) < 3
        )
        return cs.tril2symm(cs.tril(matrix)) if symmetric else matrix
