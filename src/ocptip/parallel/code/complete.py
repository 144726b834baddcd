"""Generated code with complete legs: legs of any number of joints, motors anywhere, dependent coordinates.

The lean formulation goes through the coupling points and needs legs with as many joints up to there as there
are free translations. Here all joints of the legs take part, see
:mod:`ocptip.parallel.symbolic.complete_legs`; equations are chosen near the home pose. Joints without closed
form follow from given ones by Newton's method.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError
from ocptip.parallel.code.lean import LeanFunction
from ocptip.parallel.code.tidy import tidy
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.dynamics.base_parameters import NumericBaseParameters
from ocptip.parallel.dynamics.terms import InverseDynamics
from ocptip.parallel.kinematics.platform import JointPositions, Kinematics
from ocptip.parallel.symbolic.complete_legs import (
    CompleteEquations,
    complete_obstacle,
    unknown_count,
)
from ocptip.parallel.symbolic.projection import Arguments, robot_arguments
from ocptip.parallel.symbolic.symbols import inertia_layout, inertia_values

OUTPUTS = ("tau", "J_a", "qd", "qdd", "W")
STEPS = 4
"""Newton steps of generated code."""

_NEAR, _SEED, _AGREES = 0.02, 3, 1e-7


class NumericRobot(Protocol):
    """What the code is made from and checked against: :class:`ocptip.parallel.robot.ParallelRobot`."""

    @property
    def m(self) -> int: ...
    @property
    def description(self) -> RobotDescription: ...
    @property
    def kinematics(self) -> Kinematics: ...
    def ik(self, z: ArrayLike, /) -> JointPositions: ...
    def inverse_dynamics(
        self, z: ArrayLike, zd: ArrayLike, zdd: ArrayLike, q: Sequence[np.ndarray] | None, /
    ) -> InverseDynamics: ...


def complete_function(
    robot: NumericRobot,
    outputs: Sequence[str] = ("tau",),
    *,
    name: str = "tau_a",
    base: NumericBaseParameters | None = None,
    **options: Any,
) -> LeanFunction:
    """Motor forces (form "A", z' and z'' as inputs) of any robot with serial legs, its geometry as numbers.

    In: z, zd, zdd (m); q (n, 1) as :func:`complete_joints` has them; inertia (DynPar 2 of all bodies,
    :func:`inertia_layout`, or with `base` DynPar 3); gravity. Checked against the numeric robot before it is
    returned.

    Args:
        robot: with serial legs, as many motors as coordinates.
        outputs: any of "tau", "J_a", "qd" and "qdd" of all joints, leg by leg, and "W", derivative of "tau"
            with respect to inertia.
        name: of the function.
        base: base parameters of this robot as its inertia, with dynpar 3.
        options: of `lean_function`: only form "A", and dynpar 2, or 3 with `base`.

    Raises:
        InputError: not such a robot, unknown outputs or options, or code that is not regular near home.
    """
    description = robot.description
    _require(description, outputs, options, 2 if base is None else 3)
    z, zd, zdd = (cs.SX.sym(which, robot.m) for which in ("z", "zd", "zdd"))
    q = cs.SX.sym("q", unknown_count(robot.kinematics))
    layout = inertia_layout(description, complete=True)
    values, kept = inertia_values(description, complete=True), list(range(layout.size))
    parameter_names = layout.names()
    if base is not None:
        if base.size != layout.size:
            raise InputError(f"base: expected the base parameters of {description.name}")
        values, kept, parameter_names = base.values(values), list(base.independent), list(base.names)
    inertia, gravity = cs.SX.sym("inertia", len(kept)), cs.SX.sym("gravity", 3)
    whole = cs.SX(layout.size, 1)  # what is grouped into others stays a structural zero
    whole[kept] = inertia
    arguments = Arguments(z, zd, zdd, q, whole, gravity, quasi=False)
    equations = CompleteEquations(robot.kinematics, arguments, _near_home(robot.description))
    equations.move()
    results = [cs.densify(_output(equations, which, inertia)) for which in outputs]
    inputs = [z, zd, zdd, q, cs.SX(0, 1), inertia, gravity]
    names = ["z", "zd", "zdd", "q", "geometry", "inertia", "gravity"]
    function = tidy(cs.Function(name, inputs, results, names, list(outputs)))
    numbers = tuple(parameter_names), values
    gravity_there = np.array(description.gravity)
    lean_function = LeanFunction(function, "A", 2 if base is None else 3, *numbers, gravity=gravity_there)
    _check(robot, lean_function, outputs)
    return lean_function


def complete_joints(kinematics: Kinematics, z: ArrayLike, q: Sequence[np.ndarray]) -> np.ndarray:
    """(n,) all joints leg by leg, then the dependent coordinates of the platform: `q` of generated code.

    Args:
        kinematics: of the robot.
        z: (m,) coordinates.
        q: joint positions there, per leg.
    """
    moving = kinematics.moving(kinematics.coordinates("z", z), q)
    return np.concatenate([*q, moving[kinematics.platform.m :]])


def newton_function(
    kinematics: Kinematics, steps: int = STEPS, *, near: np.ndarray | None = None
) -> cs.Function:
    """All joints from z by Newton's method: `joints`, whose C code is a loop over its steps.

    In: `z` (m,), `start` (n,) joints nearby, such as those of the instant before; without a guess those at
    home (:func:`complete_joints`). Out: `q` (n,), and `residual`, the largest closure error there, m or rad:
    where it is not small call it again with `q` as start, or the pose cannot be reached from there.

    Args:
        kinematics: of a robot with serial legs.
        steps: at every call.
        near: (m,) pose near which equations are chosen; default near home.

    Raises:
        InputError: not such a robot; says why.
    """
    description, m = kinematics.description, kinematics.m
    if reason := complete_obstacle(description):
        raise InputError(f"{description.name}: generated code: {reason}")
    z, start = cs.SX.sym("z", m), cs.SX.sym("start", unknown_count(kinematics))
    nothing = cs.SX.zeros(m)
    arguments = robot_arguments(description, (z, nothing, nothing), start, complete=True)
    equations = CompleteEquations(kinematics, arguments, _near_home(description) if near is None else near)
    step = tidy(cs.Function("newton_step", [z, start], [cs.densify(equations.newton())]))
    errors = tidy(cs.Function("closure_errors", [z, start], [cs.densify(equations.closure_errors())]))
    coordinates, q = cs.MX.sym("z", m), cs.MX.sym("start", start.numel())
    inputs = [coordinates, q]
    for _ in range(steps):
        q = step(coordinates, q)
    return cs.Function(
        "joints", inputs, [q, cs.norm_inf(errors(coordinates, q))], ["z", "start"], ["q", "residual"]
    )


def point_function(kinematics: Kinematics) -> cs.Function:
    """All joints up to the coupling points as :func:`newton_function` finds them, for lean functions.

    Out: `q` (n, N) as theirs, `all` to start from next time, and `residual`.
    """
    find, legs = newton_function(kinematics), kinematics.description.legs
    firsts = np.cumsum([0, *(leg.n for leg in kinematics.legs)])
    coordinates, start = cs.MX.sym("z", kinematics.m), cs.MX.sym("start", find.numel_in(1))
    q, residual = find(coordinates, start)
    columns = [q[int(first) : int(first) + leg.n] for first, leg in zip(firsts, legs, strict=False)]
    outputs = [cs.horzcat(*columns), q, residual]
    return cs.Function("joints", [coordinates, start], outputs, ["z", "start"], ["q", "all", "residual"])


def home_function(kinematics: Kinematics) -> cs.Function:
    """Where Newton's method may start: `home_joints`, without arguments."""
    home = kinematics.description.home
    values = complete_joints(kinematics, home, kinematics.joints(home).q)
    return cs.Function("home_joints", [], [cs.DM(values)], [], ["start"])


def _require(
    description: RobotDescription, outputs: Sequence[str], options: dict[str, object], dynpar: int
) -> None:
    if reason := complete_obstacle(description):
        raise InputError(f"{description.name}: generated code: {reason}")
    if isinstance(outputs, str) or not outputs or any(which not in OUTPUTS for which in outputs):
        raise InputError(f"outputs: expected names among {', '.join(OUTPUTS)}, got {outputs!r}")
    motors = len(description.actuated)
    if motors != description.m and {"tau", "W"} & set(outputs):
        raise InputError(
            f"{description.name}: generated code: {motors} motors move {description.m} coordinates"
        )
    for option, value in options.items():
        if {"form": "A", "dynpar": dynpar}.get(option) != value:
            raise InputError(
                f"{description.name}: generated code: joints behind the coupling points take part; only "
                f"form A with DynPar 2 or the whole robot's base parameters is there, not {option} {value}"
            )


def _output(equations: CompleteEquations, which: str, inertia: cs.SX) -> cs.SX:
    if which == "J_a":
        return cs.vertcat(*(cs.horzcat(*row) for row in equations.rows()))
    if which in ("qd", "qdd"):
        return equations.joint_rates() if which == "qd" else equations.joint_accelerations()
    tau = equations.motor_forces()
    return tau if which == "tau" else cs.jacobian(tau, inertia)


def _near_home(description: RobotDescription) -> np.ndarray:
    rng = np.random.default_rng(_SEED)
    return description.home + _NEAR * rng.uniform(-1, 1, description.m)


def _check(robot: NumericRobot, lean_function: LeanFunction, outputs: Sequence[str]) -> None:
    """Refuse code that does not give the numeric robot's forces near home."""
    if "tau" not in outputs:
        return
    z, rates = _near_home(robot.description), np.linspace(-0.5, 0.5, robot.m)
    q = robot.ik(z).q
    expected = robot.inverse_dynamics(z, rates, rates[::-1], q).motors
    all_joints = complete_joints(robot.kinematics, z, q)
    generated = np.array(
        lean_function.fast()(z, rates, rates[::-1], all_joints)[list(outputs).index("tau")]
    ).ravel()
    off = np.abs(generated - expected).max() / max(np.abs(expected).max(), 1e-300)
    if not off < _AGREES:
        raise InputError(f"{robot.description.name}: generated code is not regular near home ({off:.1g} off)")
