"""Generated inverse dynamics with complete legs: legs of any number of joints, motors anywhere, other legs.

The lean formulation goes through the coupling points and needs legs with as many joints up to there as there
are free translations. Here velocity and angular velocity at the leg's end give the rates of all its joints:
as many of these six equations as the leg has joints are chosen once, where they are most independent near the
home pose, and written in the link frame in which they fall into the smallest blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import casadi as cs
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError
from ocptip.numerics.vectors import cross_terms as cross
from ocptip.parallel.analysis.elimination import elimination_order
from ocptip.parallel.code.lean import LeanFunction
from ocptip.parallel.code.tidy import tidy
from ocptip.parallel.description.robot_description import Leg, RobotDescription
from ocptip.parallel.kinematics.leg_solver import LegSolver
from ocptip.parallel.kinematics.platform import JointPositions, Kinematics
from ocptip.parallel.rates_and_forces import Forces
from ocptip.parallel.symbolic.block_solver import BlockSystem
from ocptip.parallel.symbolic.leg_dynamics import ChainState, chain_drift, chain_motion, leg_efforts
from ocptip.parallel.symbolic.leg_jacobian import LegModel, point_columns
from ocptip.parallel.symbolic.platform_sx import platform_motion, platform_wrench, reduced
from ocptip.parallel.symbolic.spatial_sx import Vector, plus, unit, zero
from ocptip.parallel.symbolic.symbols import (
    JOINT_TERMS,
    coupling_entries,
    geometry_symbols,
    inertia_layout,
    inertia_values,
    leg_model,
)

OUTPUTS = ("tau", "J_a", "qd", "qdd")
_NEAR, _SEED, _AGREES = 0.02, 3, 1e-7


def complete_obstacle(description: RobotDescription) -> str:
    """Why there is no generated code with complete legs; "" if there is."""
    if along := description.platform.dependent_coordinates:
        return f"the platform has dependent coordinates ({', '.join(along)})"
    if description.redundant:
        return "joints are redundant"
    if len(description.actuated) != description.m:
        return f"{len(description.actuated)} motors move {description.m} coordinates"
    for number, leg in enumerate(description.legs, start=1):
        if not isinstance(leg, Leg):
            return f"leg {number} branches or has loops of its own"
        if leg.idle:
            return f"leg {number} has idle freedoms"
        if not all(body.massless for body in leg.bodies[leg.n_joints :]):
            return f"leg {number} has a body with mass on its fixed row: give it to the body before"
    return ""


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
    ) -> Forces: ...


def complete_function(
    robot: NumericRobot, outputs: Sequence[str] = ("tau",), *, name: str = "tau_a", **options: object
) -> LeanFunction:
    """Motor forces (form "A", z' and z'' as inputs) of any robot with serial legs, its geometry as numbers.

    In: z, zd, zdd (m); q (n_1 + n_2 + .., 1) all joints, leg by leg; inertia (DynPar 2 of all bodies,
    :func:`inertia_layout`); gravity. Checked against the numeric robot before it is returned.

    Args:
        robot: legs without branches, as many motors as coordinates.
        outputs: any of "tau", "J_a", and "qd", "qdd" of all joints (like q).
        name: of the function.
        options: of `lean_function`: only form "A" and dynpar 2, which is what this is.

    Raises:
        InputError: not such a robot, unknown outputs or options, or code that is not regular near home.
    """
    description = robot.description
    if reason := complete_obstacle(description):
        raise InputError(f"{description.name}: generated code: {reason}")
    if isinstance(outputs, str) or not outputs or any(which not in OUTPUTS for which in outputs):
        raise InputError(f"outputs: expected names among {', '.join(OUTPUTS)}, got {outputs!r}")
    for option, value in options.items():
        if {"form": "A", "dynpar": 2}.get(option) != value:
            raise InputError(
                f"{description.name}: generated code: {option}: joints behind the coupling points take part; "
                f"only form A with DynPar 2 is there, got {value!r}"
            )
    z, zd, zdd = (cs.SX.sym(which, robot.m) for which in ("z", "zd", "zdd"))
    layout = inertia_layout(description, complete=True)
    q = cs.SX.sym("q", sum(leg.n for leg in robot.kinematics.legs))
    inertia, gravity = cs.SX.sym("inertia", layout.size), cs.SX.sym("gravity", 3)
    equations = _Equations(robot, (z, zd, zdd), q, inertia, gravity)
    results = [cs.densify(equations.output(which)) for which in outputs]
    inputs = [z, zd, zdd, q, cs.SX(0, 1), inertia, gravity]
    names = ["z", "zd", "zdd", "q", "geometry", "inertia", "gravity"]
    function = tidy(cs.Function(name, inputs, results, names, list(outputs)))
    values = inertia_values(description, complete=True)
    empty = np.zeros((3, 0))
    found = LeanFunction(
        function, "A", 2, tuple(layout.names()), values, (), np.zeros(0), np.array(description.gravity), empty
    )
    _check(robot, found, outputs)
    return found


@dataclass(frozen=True)
class _LegEquations:
    """One leg: its model, arm of its end in world axes, frame and rows of its equations, motion."""

    model: LegModel
    arm: Vector
    frame: int
    rows: tuple[int, ...]
    system: BlockSystem
    motion: ChainState

    def wrench(self, efforts: Sequence[cs.SX]) -> tuple[Vector, Vector]:
        """Force and moment at the leg's end, world axes, that joint efforts balance."""
        values: list[cs.SX] = [cs.SX(0.0)] * 6
        for row, value in zip(self.rows, self.system.solve_transposed(efforts), strict=True):
            values[row] = value
        to_world = self.model.rotation(0, self.frame)
        return to_world(values[:3]), to_world(values[3:])


class _Equations:
    def __init__(
        self, robot: NumericRobot, state: Sequence[cs.SX], q: cs.SX, inertia: cs.SX, gravity: cs.SX
    ) -> None:
        description = self.description = robot.description
        self.mask = description.platform.mask
        pose, rates, accelerations = (cs.vertsplit(one) for one in state)
        self.platform = platform_motion(
            self.mask, description.platform.convention, pose, rates, accelerations, quasi=False
        )
        self.gravity = cs.vertsplit(gravity)
        layout = inertia_layout(description, complete=True)
        self.own = cs.vertsplit(inertia[layout.platform_slice])
        at = robot.ik(_near_home(robot)).q
        self.legs, first = [], 0
        for i, leg in enumerate(robot.kinematics.legs):
            joints = q[first : first + leg.n]
            first += leg.n
            parts = (joints, inertia[layout.leg_slice(i)])
            self.legs.append(self._leg(leg, at[i], *parts))

    def _leg(self, leg: LegSolver, at: np.ndarray, q: cs.SX, inertia: cs.SX) -> _LegEquations:
        geometry = geometry_symbols(self.description, numeric=True)
        terms = cs.SX(cs.sparsify(cs.DM([getattr(leg.leg, name)[: leg.n] for name in JOINT_TERMS])))
        model = leg_model(self.description, leg.number, q, geometry, inertia, terms, complete=True)
        frame, rows, system = _chosen(leg, model, at)
        arm = self.platform.arm(coupling_entries(leg.leg, geometry))
        to_frame = model.rotation(frame, 0)
        moving = [*to_frame(self.platform.point_velocity(arm)), *to_frame(self.platform.omega)]
        rates = system.solve([moving[row] for row in rows])
        drift = [x for part in chain_drift(model, rates, frame) for x in part]
        changing = [*to_frame(self.platform.point_acceleration(arm)), *to_frame(self.platform.alpha)]
        accelerations = system.solve([changing[row] - drift[row] for row in rows])
        motion = chain_motion(model, rates, accelerations, self.gravity)
        return _LegEquations(model, arm, frame, rows, system, motion)

    def output(self, which: str) -> cs.SX:
        if which == "J_a":
            return cs.vertcat(*(cs.horzcat(*row) for row in self._rows()))
        if which in ("qd", "qdd"):
            parts = [leg.motion.rates if which == "qd" else leg.motion.accelerations for leg in self.legs]
            return cs.vertcat(*(x for part in parts for x in part))
        return self._motor_forces()

    def _rows(self) -> list[list[cs.SX]]:
        """J_a: rate of every motor per quasi-velocity."""
        rows = []
        for number, joint in self.description.actuated:
            leg = self.legs[number]
            single = [cs.SX(float(k == joint)) for k in range(leg.model.size)]
            rows.append(self._reduced(leg, *leg.wrench(single)))
        return rows

    def _reduced(self, leg: _LegEquations, force: Vector, moment: Vector) -> list[cs.SX]:
        return reduced(self.mask, self.platform.basis, force, plus(moment, cross(leg.arm, force)))

    def _motor_forces(self) -> cs.SX:
        """J_a^T tau_a = tau_s, with the motors' own efforts added after the passive ones are balanced."""
        force, moment = platform_wrench(self.own, self.platform, self.gravity)
        own = {}
        for number, leg in enumerate(self.legs):
            efforts = leg_efforts(leg.model, leg.motion)
            for joint in leg.model.actuated:
                own[number, joint], efforts[joint] = efforts[joint], cs.SX(0.0)
            f, n = leg.wrench(efforts)
            force, moment = plus(force, f), plus(moment, n, cross(leg.arm, f))
        right = reduced(self.mask, self.platform.basis, force, moment)
        rows, order = self._rows(), list(elimination_order(self.description, complete=True))
        system = BlockSystem([[rows[k][c] for k in order] for c in range(len(right))])
        solved = dict(zip(order, system.solve(right), strict=True))
        motors = self.description.actuated
        return cs.vertcat(*(own[motor] + solved[k] for k, motor in enumerate(motors)))


def _chosen(leg: LegSolver, model: LegModel, at: np.ndarray) -> tuple[int, tuple[int, ...], BlockSystem]:
    """Frame and rows of a leg's equations: independent near home, in the smallest blocks, then sparsest."""
    J, turns = leg.jacobian(at)[0], leg.frames(at)[0]
    best: tuple[tuple[int, int], int, tuple[int, ...], BlockSystem] | None = None
    for frame in range(1, model.size + 1):
        turn = turns[model.size - 1 if frame == model.size else frame - 1]
        local = scipy.linalg.block_diag(turn.T, turn.T) @ J
        _, _, pivots = scipy.linalg.qr(local.T, pivoting=True)
        rows = tuple(sorted(int(k) for k in pivots[: model.size]))
        columns = [
            [*linear, *(model.rotation(frame, j)(unit(2)) if model.revolute[j - 1] else zero())]
            for j, linear in enumerate(point_columns(model, frame), start=1)
        ]
        try:
            system = BlockSystem([[column[row] for column in columns] for row in rows])
        except InputError:
            continue
        filled = sum(not entry.is_zero() for row in system.matrix for entry in row)
        cost = (sum(len(block) ** 3 for block, _ in system.blocks), filled)
        if best is None or cost < best[0]:
            best = cost, frame, rows, system
    if best is None:
        raise InputError(f"leg {leg.number + 1}: no choice of its equations determines all its joints")
    return best[1:]


def _near_home(robot: NumericRobot) -> np.ndarray:
    rng = np.random.default_rng(_SEED)
    return robot.description.home + _NEAR * rng.uniform(-1, 1, robot.m)


def _check(robot: NumericRobot, found: LeanFunction, outputs: Sequence[str]) -> None:
    """Refuse code that does not give the numeric robot's forces near home."""
    if "tau" not in outputs:
        return
    z, rates = _near_home(robot), np.linspace(-0.5, 0.5, robot.m)
    q = robot.ik(z).q
    expected = robot.inverse_dynamics(z, rates, rates[::-1], q).motors
    ours = np.array(found.fast()(z, rates, rates[::-1], np.concatenate(q))[0]).ravel()
    off = np.abs(ours - expected).max() / max(np.abs(expected).max(), 1e-300)
    if not off < _AGREES:
        raise InputError(f"{robot.description.name}: generated code is not regular near home ({off:.1g} off)")
