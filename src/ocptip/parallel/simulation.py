"""Simulation of a parallel robot under motor forces: Runge-Kutta on (z, s'), joints by inverse kinematics."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, SolverError, finite_array, positive_number
from ocptip.numerics.jit.tape import Tape
from ocptip.parallel.code.complete import complete_joints, newton_function
from ocptip.parallel.code.leg_plans import robot_projection
from ocptip.parallel.minimal_form import joints_of_branch, minimal_obstacle
from ocptip.parallel.robot import ParallelRobot
from ocptip.parallel.symbolic.complete_legs import (
    CompleteEquations,
    complete_obstacle,
    unknown_count,
)
from ocptip.parallel.symbolic.projection import (
    euler_rates,
    robot_arguments,
)
from ocptip.parallel.symbolic.symbols import geometry_symbols

_LONG = 200  # steps: fewer are done before machine code is made
_WEIGHTS = np.array([1, 2, 2, 1]) / 6

MotorLaw = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class SimulatedMotion:
    """A simulated motion.

    Attributes:
        times: (N,), s.
        z: (N, m) coordinates.
        s: (N, m) quasi-velocities.
        energy: (N, 2), J: kinetic and potential.
        closure: largest closure error of the joint positions, m or rad.
    """

    times: np.ndarray
    z: np.ndarray
    s: np.ndarray
    energy: np.ndarray
    closure: float

    @property
    def energy_drift(self) -> float:
        """Largest change of the total energy, relative to the largest kinetic energy; of free motions only
        this is an error."""
        total = self.energy.sum(axis=1)
        return float(np.abs(total - total[0]).max() / max(self.energy[:, 0].max(), 1e-300))


def simulate(
    robot: ParallelRobot,
    z: ArrayLike,
    s: ArrayLike,
    *,
    duration: float,
    step: float,
    motors: MotorLaw | Sequence[float] | None = None,
) -> SimulatedMotion:
    """Integrate the equations of motion with the classic Runge-Kutta method.

    Long motions (200 steps and more) run as machine code, except those of robots with branched legs or legs
    with inner loops.

    Args:
        robot: its Euler angles must stay away from their singularity.
        z, s: (m,) start: coordinates and quasi-velocities.
        duration, step: s; the last step is shortened to end at `duration`.
        motors: forces (n_a,), or a function of time, z and s; None: none.

    Raises:
        SolverError: the motion reaches a singular pose.
        InputError: wrong shapes, or a pose out of reach.
    """
    duration, step = positive_number("duration", duration), positive_number("step", step)
    z, s = robot.kinematics.coordinates("z", z), robot.kinematics.coordinates("s", s)
    shape = (len(robot.description.actuated),)
    law = _law(motors, shape)
    count = int(np.ceil(duration / step - 1e-9))
    times = np.append(step * np.arange(count), duration)
    equations = _equations(robot, z, count)
    m, states, energies = robot.m, np.empty((count + 1, 2 * robot.m)), np.empty((count + 1, 2))
    stages = np.empty((4, 2 * m))
    states[0, :m], states[0, m:] = z, s

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        forces = np.asarray(law(time, state[:m], state[m:]), dtype=float)
        if forces.shape != shape:
            raise InputError(
                f"motors: expected {shape[0]} forces at t = {time:.6g} s, got shape {forces.shape}"
            )
        return equations.slope(state, forces)

    state = states[0].copy()
    for k, (t, h) in enumerate(zip(times[:-1].tolist(), np.diff(times).tolist(), strict=True)):
        stages[0] = slope(t, state)
        energies[k] = equations.energy(state)
        stages[1] = slope(t + h / 2, state + h / 2 * stages[0])
        stages[2] = slope(t + h / 2, state + h / 2 * stages[1])
        stages[3] = slope(t + h, state + h * stages[2])
        state = state + h * (_WEIGHTS @ stages)
        states[k + 1] = state
    energies[count] = equations.energy(state)
    return SimulatedMotion(times, states[:, :m], states[:, m:], energies, equations.closure)


def _equations(robot: ParallelRobot, z: np.ndarray, count: int) -> _Searched | CompiledDynamics:
    """The equations of motion; compiled where that is possible and worth it."""
    if count >= _LONG and not compiled_obstacle(robot):
        return CompiledDynamics(robot, z)
    return _Searched(robot)


class _Searched:
    """Equations of motion of any robot: joint positions along a motion, each from the one before."""

    def __init__(self, robot: ParallelRobot) -> None:
        self._robot, kinematics = robot, robot.kinematics
        self._solve = kinematics.joints if robot.complete_legs else kinematics.point_joints
        self._last: tuple[np.ndarray, ...] | None = None
        self.closure = 0.0

    def slope(self, state: np.ndarray, motors: np.ndarray) -> np.ndarray:
        """(z', s'') of a state (z, s)."""
        z, s = np.split(state, 2)
        sd = self._robot.forward_dynamics(z, s, motors, self._at(z))
        rates = np.linalg.solve(self._robot.kinematics.rate_matrices(z, np.zeros_like(z))[0], s)
        return np.concatenate([rates, sd])

    def energy(self, state: np.ndarray) -> tuple[float, float]:
        """Kinetic and potential energy, J."""
        z, s = np.split(state, 2)
        return self._robot.energy(z, s, self._at(z))

    def _at(self, z: np.ndarray) -> tuple[np.ndarray, ...]:
        result = self._solve(z, self._last)
        self._last = result.q
        self.closure = max(self.closure, result.residual)
        return result.q


def _law(motors: MotorLaw | Sequence[float] | None, shape: tuple[int]) -> MotorLaw:
    if callable(motors):
        return motors
    fixed = np.zeros(shape) if motors is None else finite_array("motors", motors, shape)
    return lambda time, z, s: fixed


_SINGULAR, _OPEN, _DEFINITE = 1e-8, 1e-6, 1e-12
_CLOSED, _STEPS, _CALLS = 1e-12, 2, 10


def compiled_obstacle(robot: ParallelRobot) -> str:
    """Why a robot's forward dynamics cannot be compiled; "" if they can."""
    return complete_obstacle(robot.description) if minimal_obstacle(robot) else ""


class CompiledDynamics:
    """Equations of motion; the joints keep the IK solutions of a start.

    Args:
        robot: its legs are serial.
        start: (m,) coordinates.

    Attributes:
        closure: largest closure error of the joint positions so far, m or rad.

    Raises:
        InputError: the robot is not of this kind; says why.
    """

    def __init__(self, robot: ParallelRobot, start: np.ndarray) -> None:
        if reason := compiled_obstacle(robot):
            raise InputError(f"{robot.description.name}: {reason}")
        carried = bool(minimal_obstacle(robot))
        function, self._names = (_carried if carried else _closed_form)(robot, start)
        inputs, self._results, self._compute = Tape(function).point()
        m, motors = robot.m, len(robot.description.actuated)
        self._state, self._motors, self._joints = np.split(inputs, np.cumsum([2 * m, motors]))
        ends = np.cumsum([2 * m, 2, 4])
        self._slope, self._energies, self._ends, self._others = np.split(self._results, ends)
        if carried:
            self._joints[:] = complete_joints(robot.kinematics, start, robot.ik(start).q)
        self._m, self._last = m, np.empty(0)
        self.closure = 0.0

    def slope(self, state: np.ndarray, motors: np.ndarray) -> np.ndarray:
        """(z', s'') (2m,) of a state (z, s) under motor forces (n_a,).

        Raises:
            SolverError: a leg is in a singular pose or out of reach, or the mass matrix is not positive
                definite.
        """
        self._state[:], self._motors[:] = state, motors
        self._last = state
        carried = self._joints.size
        total = gap = pivot = smallest = np.nan
        for _ in range(_CALLS):
            self._compute()
            total, gap, pivot, smallest = self._ends.tolist()
            if not carried or not math.isfinite(gap):
                break
            self._joints[:] = self._others
            if gap < _CLOSED:
                break
        else:
            smallest = smallest if gap < _OPEN else 0.0
        self._require(state, total, gap, pivot, smallest)
        self.closure = max(self.closure, gap)
        return self._slope.copy()

    def energy(self, state: np.ndarray) -> np.ndarray:
        """Kinetic and potential energy (2,), J."""
        if self._last is not state:  # the energies of a state come with its slope
            self.slope(state, self._motors)
        return self._energies.copy()

    def _require(self, state: np.ndarray, total: float, gap: float, pivot: float, smallest: float) -> None:
        reached = smallest > _SINGULAR and gap < _OPEN
        if reached and pivot > _DEFINITE and math.isfinite(total):
            return
        self._last, z = np.empty(0), state[: self._m].tolist()
        finite_array("motors", self._motors, self._motors.shape)
        finite_array("state", state, state.shape)
        if reached and not pivot > _DEFINITE:
            raise SolverError(
                f"forward dynamics: at z = {z} the mass matrix is not positive definite (smallest "
                f"relative pivot {pivot:.2g}): bodies have too little inertia, or one that no real body has"
            )
        where = self._names[int(np.argmin(self._others))] if self._names else "a leg"
        raise SolverError(f"forward dynamics: at z = {z} the robot is singular or out of reach ({where})")


def _closed_form(robot: ParallelRobot, start: np.ndarray) -> tuple[cs.Function, list[str]]:
    """z', s'', energies, sum of all, closure error, smallest pivot, smallest measure, the measures; and their
    names."""
    description, symbols = robot.description, _symbols(robot, 0)
    z, s, sd = symbols[:3]
    q, measures, names = joints_of_branch(robot, z, start, geometry_symbols(description, numeric=True))
    projection = robot_projection(description, "tau_s", (z, s, sd), q)
    rates = cs.vertcat(*euler_rates(projection.platform, cs.vertsplit(s)))
    gap = cs.norm_inf(cs.vec(projection.closures()))
    ends = [gap, cs.mmin(cs.vertcat(1, *measures)), cs.vertcat(*measures)]
    force, jacobian = projection.generalized_force(), projection.jacobian()
    return _forward(symbols, force, jacobian, rates, projection.potential(), ends), names


def _carried(robot: ParallelRobot, start: np.ndarray) -> tuple[cs.Function, list[str]]:
    """The same from joints and dependent coordinates nearby. Instead of measures the new ones; the smallest
    measure is 1: where the robot is singular these do not close."""
    symbols = _symbols(robot, unknown_count(robot.kinematics))
    z, s, sd, motors, q = symbols
    arguments = robot_arguments(robot.description, (z, s, sd), q, complete=True)
    equations = CompleteEquations(robot.kinematics, arguments, start)
    equations.move()
    force = cs.vertcat(*equations.force()[0])
    jacobian = cs.vertcat(*(cs.horzcat(*row) for row in equations.rows()))
    rates = cs.vertcat(*equations.coordinate_rates())
    ends = [cs.norm_inf(equations.closure_errors()), cs.SX(1), q]
    forward = _forward(symbols, force, jacobian, rates, equations.potential(), ends)
    joints = newton_function(robot.kinematics, _STEPS, near=start).expand()
    result = forward(z, s, motors, joints(z, q)[0])
    return cs.Function("forward", [z, s, motors, q], cs.cse([result])), []


def _symbols(robot: ParallelRobot, carried: int) -> list[cs.SX]:
    """z, s', s'', motor forces, joints."""
    sizes = {"z": robot.m, "s": robot.m, "sd": robot.m, "motors": len(robot.description.actuated)}
    return [cs.SX.sym(name, size) for name, size in {**sizes, "q": carried}.items()]


def _forward(
    symbols: Sequence[cs.SX],
    force: cs.SX,
    jacobian: cs.SX,
    rates: cs.SX,
    potential: cs.SX,
    ends: Sequence[cs.SX],
) -> cs.Function:
    """All results in one column; force: tau_s, jacobian: J_a, ends: closure error, smallest measure, more."""
    z, s, sd, motors, q = symbols
    mass = cs.densify(cs.jacobian(force, sd))
    right = jacobian.T @ motors - cs.substitute(force, sd, cs.SX.zeros(sd.numel()))
    pivots, upper, order = cs.ldl(mass, False)
    result = cs.ldl_solve(right, pivots, upper, order)
    energy = cs.vertcat(cs.dot(s, mass @ s) / 2, potential)
    gap, *others = ends
    pivot = cs.mmin(pivots / cs.fabs(cs.diag(mass)))
    results = list(map(cs.densify, [rates, result, energy, gap, pivot, *others]))
    results.insert(3, cs.sum1(cs.vertcat(*results)))  # finite only if all are
    return cs.Function("forward", [z, s, motors, q], [cs.vertcat(*cs.cse(results))])
