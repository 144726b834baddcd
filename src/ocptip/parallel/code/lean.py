"""Lean symbolic functions of a parallel robot: inverse dynamics, its parts, Jacobians and regressors.

One function holds any of these outputs, in one of five forms (section 6 of the method):

    form  accelerations         forces
    "S"   s'' = (r'', omega')   tau_s, dual to s'
    "X"   z'' (Euler)           tau_s
    "Z"   z''                   tau_z = H^T tau_s
    "A"   s''                   tau_a, motors
    "AA"  q_a'' of the motors   tau_a

Rates are s' for "S" and "A", z' else; "A" takes z' and z'' if asked to. With fewer than three free rotations
s' is z'. The operations are those of
:mod:`ocptip.parallel.symbolic.projection`, written leg by leg after the plan with the fewest operations and
then tidied.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, SolverError, finite_array
from ocptip.numerics.batch import PointFunction
from ocptip.parallel.analysis.singularity import elimination_order
from ocptip.parallel.code.leg_plans import OperationCount, choose_plans, count_operations
from ocptip.parallel.code.tidy import tidy
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.dynamics.base_parameters import NumericBaseParameters, leg_base_parameters
from ocptip.parallel.dynamics.terms import FORMS
from ocptip.parallel.symbolic.projection import Arguments, Plans, Projection
from ocptip.parallel.symbolic.spatial_sx import BlockSystem
from ocptip.parallel.symbolic.symbols import (
    CENTRAL,
    InertiaLayout,
    geometry_symbols,
    inertia_layout,
    inertia_values,
    joint_term_values,
    origin_inertia,
)

OUTPUTS = ("tau", "M", "c", "g", "J_a", "qd", "qdd", "W", "W_M", "W_c", "W_g", "W_joint")


@dataclass(frozen=True, eq=False)
class LeanFunction:
    """A generated function and the numbers of the robot for it.

    Attributes:
        function: CasADi function with named inputs and outputs.
        form: "S", "X", "Z", "A" or "AA".
        dynpar: form of the inertia parameters, 1, 2 or 3.
        inertia_names, inertia: names and values of the inertia parameters.
        geometry_names, geometry: the same for the named parameters of the geometry (empty if they are
            numbers).
        gravity: (3,), m/s^2, world axes.
        joint_terms: (3, n N) drive inertia, viscous and Coulomb friction of all joints, leg by leg.
    """

    function: cs.Function
    form: str = ""
    dynpar: int = 0
    inertia_names: tuple[str, ...] = ()
    inertia: np.ndarray = field(default_factory=lambda: np.zeros(0))
    geometry_names: tuple[str, ...] = ()
    geometry: np.ndarray = field(default_factory=lambda: np.zeros(0))
    gravity: np.ndarray = field(default_factory=lambda: np.zeros(0))
    joint_terms: np.ndarray = field(default_factory=lambda: np.zeros((3, 0)))

    @classmethod
    def of(cls, given: LeanFunction | cs.Function) -> LeanFunction:
        """A function as it is, or one of CasADi without numbers of a robot."""
        return given if isinstance(given, LeanFunction) else cls(given)

    @property
    def entries(self) -> dict[str, tuple[str, ...]]:
        """Names of the entries of inputs that have some."""
        return {"inertia": self.inertia_names, "geometry": self.geometry_names}

    @property
    def count(self) -> OperationCount:
        """Operations by the rule of :mod:`ocptip.parallel.code.leg_plans`."""
        return count_operations(self.function)

    def __call__(
        self,
        z: ArrayLike,
        rates: ArrayLike,
        accelerations: ArrayLike,
        q: ArrayLike,
        *,
        inertia: ArrayLike | None = None,
        geometry: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        wrench: ArrayLike | None = None,
        joint_terms: ArrayLike | None = None,
    ) -> dict[str, np.ndarray]:
        """Evaluate.

        Args:
            z: (m,) platform coordinates, m and rad.
            rates, accelerations: (m,) as the form wants them.
            q: (n, N) joint variables up to the coupling points, one column per leg.
            inertia, geometry, gravity, joint_terms: instead of those of the robot.
            wrench: (6,) external force (N) and moment (N m) about the platform's origin, world axes; default
                0.

        Returns:
            Every output by its name; column vectors as (k,) arrays.

        Raises:
            InputError: wrong shape, not finite, or an input this function does not have.
            SolverError: the result is not finite: a singular pose.
        """
        given = {
            "z": z,
            self.function.name_in(1): rates,
            self.function.name_in(2): accelerations,
            "q": q,
            "inertia": self.inertia if inertia is None else inertia,
            "geometry": self.geometry if geometry is None else geometry,
            "gravity": self.gravity if gravity is None else gravity,
        }
        names = self.function.name_in()
        for name, value, default in (
            ("wrench", wrench, np.zeros(6)),
            ("joint_terms", joint_terms, self.joint_terms),
        ):
            if name in names:
                given[name] = default if value is None else value
            elif value is not None:
                raise InputError(f"{name}: this function was generated without it")
        arguments = []
        for name in names:
            rows, columns = self.function.size_in(name)
            shape = (rows,) if columns == 1 and name != "q" else (rows, columns)
            arguments.append(finite_array(name, given[name], shape))
        results = self.function.call(arguments)
        outputs = {}
        for name, result in zip(self.function.name_out(), results, strict=True):
            array = np.array(result)
            if not np.all(np.isfinite(array)):
                raise SolverError(
                    f"{name}: not finite at z = {np.asarray(z).tolist()}: a leg or the platform is singular"
                )
            outputs[name] = array[:, 0] if name in _VECTORS else array
        return outputs

    def fast(self) -> Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], list[np.ndarray]]:
        """A callable without checks for inner loops: some microseconds instead of hundreds.

        Returns:
            Function of (z, rates, accelerations, q) with the parameters of the robot that gives the outputs
            in order.
        """
        evaluate = PointFunction(self.function)
        arguments = {"inertia": self.inertia, "geometry": self.geometry, "gravity": self.gravity}
        arguments |= {"wrench": np.zeros(6), "joint_terms": self.joint_terms}
        rest = [arguments[name] for name in self.function.name_in()[4:]]
        return lambda z, rates, accelerations, q: evaluate(z, rates, accelerations, q, *rest)


_VECTORS = ("tau", "c", "g")


def lean_function(
    description: RobotDescription,
    outputs: Sequence[str] = ("tau",),
    *,
    form: str = "X",
    dynpar: int = 2,
    euler: bool = False,
    wrench: bool = False,
    joint_terms: bool | None = None,
    numeric_geometry: bool = False,
    base: NumericBaseParameters | None = None,
    name: str = "dynamics",
) -> LeanFunction:
    """Generate a function of the robot.

    Inputs, by name: z (m), zd or sd (m), zdd, sdd or qadd (m), q (n x N), geometry, inertia, gravity (3) and,
    if asked for, wrench (6) and joint_terms (3 x n N). q is not checked for closure.

    Motor forces of four and more coupled coordinates are eliminated in a fixed order, chosen at the home
    pose. Where the force lines of its first three motors become parallel to a plane the code divides by
    zero although the robot is regular; near such poses take form "S" with "J_a" and
    :func:`ocptip.parallel.dynamics.terms.motor_forces`.

    Args:
        description: a robot whose legs have as many joints up to the coupling point as there are free
            translations.
        outputs: any of "tau", its parts "M", "c", "g" (tau = M a + c + g), "J_a", all joint rates "qd" and
            accelerations "qdd" (n x N), the regressor "W" of tau and of its parts "W_M", "W_c", "W_g" with
            respect to the inertia parameters, and "W_joint" with respect to joint_terms (column by column).
        form: see above.
        dynpar: inertia parameters about the centres of mass (1), about the frames' origins (2), or the
            leg-wise base parameters (3).
        euler: form "A" with z' and z'' as inputs.
        wrench: external platform wrench as input; it adds -wrench to tau_s.
        joint_terms: drive inertia and friction of all joints as input; default: if the robot has any.
        numeric_geometry: write the numbers of this robot instead of named parameters.
        base: with DynPar 3 the base parameters of the whole robot instead of the leg-wise ones: fewer, but
            only for this robot's numbers; see `ParallelRobot.base_parameters`.
        name: of the function.

    Raises:
        InputError: unknown name or form, a robot the formulation does not cover, a regressor of DynPar 1, or
            motor forces where the number of motors is not that of the free coordinates.
    """
    if joint_terms is None:
        joint_terms = bool(joint_term_values(description).any()) if description.coupling_form else False
    _check_options(outputs, form, dynpar, euler, joint_terms)
    layout = inertia_layout(description)
    if base is not None and (dynpar != 3 or base.size != layout.size):
        raise InputError(f"base: expected the base parameters of {description.name}, and dynpar 3")
    kept, names, values = _inertia_choice(description, layout, dynpar, base)
    purpose = "motors" if form in ("A", "AA") else "tau_s"
    plans = choose_plans(description, layout, kept, "rows" if set(outputs) == {"J_a"} else purpose)
    builder = Builder(description, layout, plans, kept, form, form in ("S", "A") and not euler)
    builder.take(dynpar, wrench, joint_terms, numeric_geometry)
    results = [cs.densify(builder.output(which)) for which in outputs]
    inputs = builder.inputs
    function = cs.Function(name, list(inputs.values()), results, list(inputs), list(outputs))
    parameters = {} if numeric_geometry else description.parameters
    return LeanFunction(
        function=tidy(function),
        form=form,
        dynpar=dynpar,
        inertia_names=tuple(names),
        inertia=values,
        geometry_names=tuple(parameters),
        geometry=np.array(list(parameters.values()), dtype=float),
        gravity=np.array(description.gravity),
        joint_terms=joint_term_values(description),
    )


def _check_options(outputs: Sequence[str], form: str, dynpar: int, euler: bool, joint_terms: bool) -> None:
    if isinstance(outputs, str) or not outputs or any(which not in OUTPUTS for which in outputs):
        raise InputError(f"outputs: expected names among {', '.join(OUTPUTS)}, got {outputs!r}")
    if len(set(outputs)) != len(outputs):
        raise InputError(f"outputs: a name occurs twice in {outputs!r}")
    if form not in FORMS:
        raise InputError(f"form: must be one of {', '.join(FORMS)}, got {form!r}")
    if dynpar not in (1, 2, 3):
        raise InputError(f"dynpar: must be 1, 2 or 3, got {dynpar!r}")
    linear = [which for which in outputs if which in ("W", "W_M", "W_c", "W_g")]
    if dynpar == 1 and linear:
        raise InputError(f"outputs: {linear[0]} needs dynpar 2 or 3; the forces are not linear in DynPar 1")
    if euler and form != "A":
        raise InputError(f"euler: only form A has the choice, got form {form}")
    if "W_joint" in outputs and not joint_terms:
        raise InputError("outputs: W_joint needs joint_terms=True")


def _inertia_choice(
    description: RobotDescription,
    layout: InertiaLayout,
    dynpar: int,
    base: NumericBaseParameters | None,
) -> tuple[list[bool], list[str], np.ndarray]:
    """Which parameters the function has, their names and values."""
    if dynpar == 1:
        return [True] * layout.size, layout.names(CENTRAL), inertia_values(description, 1)
    if dynpar == 2:
        return [True] * layout.size, layout.names(), inertia_values(description)
    if base is not None:
        kept = [k in base.independent for k in range(layout.size)]
        return kept, list(base.names), base.values(inertia_values(description))
    by_leg = leg_base_parameters(description)
    return list(by_leg.kept), list(by_leg.names), by_leg.values


class Builder:
    """Symbols of a function and its outputs; see :func:`ocptip.parallel.code.lean.lean_function`.

    Attributes:
        inputs: of the function by name, in order.
    """

    def __init__(
        self,
        description: RobotDescription,
        layout: InertiaLayout,
        plans: Plans,
        kept: Sequence[bool],
        form: str,
        quasi: bool,
    ) -> None:
        m, n, count = description.platform.m, layout.bodies, len(description.legs)
        self.description, self.layout, self.plans, self.kept = description, layout, plans, kept
        self.form, self.quasi = form, quasi
        rates = "sd" if quasi else "zd"
        accelerations = "qadd" if form == "AA" else rates + "d"
        self.z, self.rates, self.accelerations = (cs.SX.sym(k, m) for k in ("z", rates, accelerations))
        self.q = cs.SX.sym("q", n, count)
        self.inertia, self.gravity = cs.SX.sym("inertia", sum(kept)), cs.SX.sym("gravity", 3)
        self.inputs = {"z": self.z, rates: self.rates, accelerations: self.accelerations, "q": self.q}
        self.wrench, self.joint_terms = cs.SX.zeros(6), cs.SX.zeros(3, n * count)
        self.order = elimination_order(description) if form in ("A", "AA") else None
        self._parts: dict[tuple[bool, bool, bool], Projection] = {}

    def take(self, dynpar: int, wrench: bool, joint_terms: bool, numeric_geometry: bool) -> None:
        """Add the inputs that are not the state."""
        self.geometry = geometry_symbols(self.description, numeric_geometry)
        named = [] if numeric_geometry else list(self.geometry.values())
        given = iter(cs.vertsplit(self.inertia))
        full = cs.vertcat(*(next(given) if keep else cs.SX(0.0) for keep in self.kept))
        self.full_inertia = origin_inertia(full) if dynpar == 1 else full
        self.inputs["geometry"] = cs.vertcat(*named) if named else cs.SX(0, 1)
        self.inputs |= {"inertia": self.inertia, "gravity": self.gravity}
        if wrench:
            self.wrench = self.inputs["wrench"] = cs.SX.sym("wrench", 6)
        if joint_terms:
            self.joint_terms = self.inputs["joint_terms"] = cs.SX.sym("joint_terms", *self.joint_terms.shape)

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
        gravity = cs.SX.zeros(3) if gravity is None else gravity
        given = self.z, rates, accelerations, self.q, self.full_inertia, gravity, self.quasi, self.geometry
        arguments = Arguments(*given, cs.SX.zeros(6) if wrench is None else wrench, self.joint_terms)
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
