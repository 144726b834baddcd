"""Forward dynamics as machine code, for robots whose legs have closed forms: microseconds per call."""

from __future__ import annotations

import math

import casadi as cs
import numpy as np

from ocptip.basics.errors import SolverError
from ocptip.numerics.native import LANES
from ocptip.numerics.tape import Tape
from ocptip.parallel.code.leg_plans import choose_plans
from ocptip.parallel.minimal_form import joints_of_branch, require_closed_form
from ocptip.parallel.robot import ParallelRobot
from ocptip.parallel.symbolic.block_solver import solve_dense
from ocptip.parallel.symbolic.projection import Arguments, Projection
from ocptip.parallel.symbolic.spatial_sx import dot, plus
from ocptip.parallel.symbolic.symbols import (
    geometry_symbols,
    inertia_layout,
    inertia_values,
    joint_term_values,
)

_SINGULAR, _OPEN, _DEFINITE = 1e-8, 1e-6, 1e-12


class CompiledDynamics:
    """Equations of motion in platform coordinates alone; joints stay in the branches they have at a start.

    Args:
        robot: its legs have closed forms and no dry friction.
        start: (m,) coordinates.

    Attributes:
        closure: largest closure error of the joint positions so far, m.

    Raises:
        InputError: the robot is not of this kind; says why.
    """

    def __init__(self, robot: ParallelRobot, start: np.ndarray) -> None:
        require_closed_form(robot)
        m, motors = robot.m, cs.SX.sym("motors", len(robot.description.actuated))
        z, s, sd = (cs.SX.sym(name, m) for name in ("z", "s", "sd"))
        geometry = geometry_symbols(robot.description, numeric=True)
        q, measures, self._names = joints_of_branch(robot, z, start, geometry)
        projection = _projection(robot, z, s, sd, q)
        force = projection.generalized_force()
        mass = cs.densify(cs.jacobian(force, sd))
        right = projection.jacobian().T @ motors - cs.substitute(force, sd, cs.SX.zeros(m))
        pivots, upper, order = cs.ldl(mass, False)
        found = cs.ldl_solve(right, pivots, upper, order)
        energy = cs.vertcat(cs.dot(s, mass @ s) / 2, _potential(projection))
        gap = cs.norm_inf(cs.vec(projection.closures()))
        outputs = cs.cse(
            [
                _rates(projection, s),
                found,
                energy,
                gap,
                cs.mmin(pivots / cs.fabs(cs.diag(mass))),
                cs.mmin(cs.vertcat(1, *measures)),
                cs.vertcat(*measures),
            ]
        )
        function = cs.Function("forward", [z, s, motors], [cs.vertcat(*map(cs.densify, outputs))])
        self._tape, self._m, self._motors = Tape(function), m, motors.numel()
        self._inputs = np.empty((2 * m + motors.numel(), LANES))  # one state in all lanes of the machine code
        self._last: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self.closure = 0.0

    def slope(self, z: np.ndarray, s: np.ndarray, motors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """z' and s'' (m,) under motor forces (n_a,).

        Raises:
            SolverError: a leg is in a singular pose or out of reach, or the mass matrix is not positive
                definite.
        """
        result = self._evaluate(z, s, motors)
        self._last = z, s, result
        return result[: self._m], result[self._m : 2 * self._m]

    def energy(self, z: np.ndarray, s: np.ndarray) -> tuple[float, float]:
        """Kinetic and potential energy, J."""
        last = self._last  # the arrays of a state are those of its slope: no second evaluation
        known = last is not None and last[0] is z and last[1] is s
        result = last[2] if known else self._evaluate(z, s, np.zeros(self._motors))
        kinetic, potential = result[2 * self._m : 2 * self._m + 2]
        return float(kinetic), float(potential)

    def _evaluate(self, z: np.ndarray, s: np.ndarray, motors: np.ndarray) -> np.ndarray:
        m = self._m
        self._inputs[:m, :], self._inputs[m : 2 * m, :] = z[:, None], s[:, None]
        self._inputs[2 * m :, :] = motors[:, None]
        result = self._tape(self._inputs)[:, 0]
        gap, pivot, smallest = result[2 * m + 2 : 2 * m + 5]
        if smallest > _SINGULAR and not pivot > _DEFINITE:
            raise SolverError(
                f"forward dynamics: at z = {z.tolist()} the mass matrix is not positive definite (smallest "
                f"relative pivot {pivot:.2g}): bodies have too little inertia, or one that no real body has"
            )
        if not (gap < _OPEN and smallest > _SINGULAR and math.isfinite(result.sum())):
            measures = result[2 * m + 5 :]
            where = self._names[int(np.argmin(measures))] if measures.size else "a leg"
            raise SolverError(
                f"forward dynamics: at z = {z.tolist()} the robot is singular or out of reach ({where})"
            )
        self.closure = max(self.closure, float(gap))
        return result


def _projection(robot: ParallelRobot, z: cs.SX, s: cs.SX, sd: cs.SX, q: cs.SX) -> Projection:
    description = robot.description
    layout = inertia_layout(description)
    plans = choose_plans(description, layout, [True] * layout.size, "tau_s")
    arguments = Arguments(
        pose=z,
        rates=s,
        accelerations=sd,
        q=q,
        geometry=geometry_symbols(description, numeric=True),
        inertia=cs.SX(cs.sparsify(cs.DM(inertia_values(description)))),
        gravity=cs.SX(cs.DM(description.gravity)),
        wrench=cs.SX.zeros(6),
        joint_terms=cs.SX(cs.DM(joint_term_values(description))),
        quasi=True,
    )
    return Projection(description, layout, plans, arguments)


def _rates(projection: Projection, s: cs.SX) -> cs.SX:
    """z' from s'."""
    mask = projection.mask
    if not all(mask[3:]):
        return s
    free = sum(mask[:3])
    axes = projection.platform.euler
    rows = [[axis[k] for axis in axes] for k in range(3)]
    return cs.vertcat(s[:free], *solve_dense(rows, cs.vertsplit(s[free:])))


def _potential(projection: Projection) -> cs.SX:
    """Potential energy in gravity, J."""
    platform, inertia = projection.platform, cs.vertsplit(projection.arguments.inertia)
    own = inertia[projection.layout.platform_slice]
    moments = [plus(platform.arm(own[6:9]), [own[9] * x for x in platform.position])]
    for leg in projection.legs:
        point = leg.origin
        for body, values in enumerate(leg.inertia):
            to_world = leg.rotation(0, body + 1)
            moments.append(plus(to_world(values[6:9]), [values[9] * x for x in point]))
            point = plus(point, to_world(leg.segments[body]))
    return -dot(projection.gravity, plus(*moments))
