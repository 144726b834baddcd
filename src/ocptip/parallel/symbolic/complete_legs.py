"""Equations of a robot with complete legs, in symbols: any number of joints, dependent platform coordinates.

The twist at a leg's end has six components. As many of them as the leg has joints are chosen once, where they
are most independent near a pose, in the link frame in which they fall into the smallest blocks; they give the
joint rates. Each of the others is a wrench N that does no work along the joints, so that N C T_w w' = 0 holds
for the platform's coordinates w = (z, d); as many of these as there are dependent coordinates d give d'.
"""

from __future__ import annotations

from typing import cast

import casadi as cs
import numpy as np
import scipy.linalg

from ocptip.numerics.vectors import cross_terms as cross
from ocptip.parallel.analysis.singularity import elimination_order
from ocptip.parallel.description.robot_description import RobotDescription, SerialLeg
from ocptip.parallel.kinematics.leg_solver import LegSolver
from ocptip.parallel.kinematics.platform import Kinematics
from ocptip.parallel.symbolic.complete_leg import CompleteLeg, Scalars, chosen_equations, idle_inertia
from ocptip.parallel.symbolic.leg_dynamics import LegModel, chain_motion, leg_efforts
from ocptip.parallel.symbolic.projection import (
    Arguments,
    PlatformState,
    euler_rates,
    platform_motion,
    platform_wrench,
    potential_energy,
    reduced,
)
from ocptip.parallel.symbolic.spatial_sx import BlockSystem, Vector, dot, minus, plus, unit, vector
from ocptip.parallel.symbolic.symbols import (
    JOINT_TERMS,
    coupling_entries,
    geometry_symbols,
    inertia_layout,
    leg_model,
)


def complete_obstacle(description: RobotDescription) -> str:
    """Why there are no such equations; "" if there are."""
    for number, leg in enumerate(description.legs, start=1):
        if not leg.serial:
            return f"leg {number} is branched or has closed loops"
        if leg.idle > 1:
            return f"leg {number} has {leg.idle} idle freedoms, code knows one"
        if not all(body.massless for body in leg.bodies[leg.n_joints :]):
            return f"leg {number} has a body with mass on its fixed row: give it to the body before"
    return ""


def unknown_count(kinematics: Kinematics) -> int:
    """Number of joints of all legs and dependent coordinates."""
    return sum(leg.n for leg in kinematics.legs) + len(kinematics.platform.dependent)


class CompleteEquations:
    """The robot's equations for one set of arguments.

    Args:
        kinematics: of a robot without `complete_obstacle`.
        arguments: symbols.
        near: (m,) pose near which equations are chosen.

    Raises:
        InputError: no choice of equations determines the joints of a leg.
    """

    def __init__(self, kinematics: Kinematics, arguments: Arguments, near: np.ndarray) -> None:
        self.description, self.arguments = kinematics.description, arguments
        self._kinematics, self._near = kinematics, near
        coordinates = kinematics.platform
        self._m, self._order = coordinates.m, coordinates.order
        self._k = len(coordinates.dependent)
        self._pose = [
            *cs.vertsplit(arguments.pose)[: self._m],
            *cs.vertsplit(arguments.q)[-self._k or arguments.q.numel() :],
        ]
        self._at = kinematics.joints(near).q
        self.gravity = cs.vertsplit(arguments.gravity)
        still = [cs.SX(0.0)] * len(self._pose)
        self._still = self._platform(still, still)
        layout = inertia_layout(self.description, complete=True)
        self._own = cs.vertsplit(arguments.inertia[layout.platform_slice])
        self.legs, first = [], 0
        for leg, joints in zip(kinematics.legs, self._at, strict=True):
            q = arguments.q[first : first + leg.n]
            first += leg.n
            self.legs.append(self._leg(leg, joints, q, arguments.inertia[layout.leg_slice(leg.number)]))
        if self._k:
            self._restrain()

    def move(self) -> None:
        """Find the motion of all bodies: what forces and rates need."""
        rates, accelerations = cs.vertsplit(self.arguments.rates), cs.vertsplit(self.arguments.accelerations)
        speeds, turned = self._by_leg(rates[self._m :]), self._by_leg(accelerations[self._m :])
        rates, accelerations = rates[: self._m], accelerations[: self._m]
        if self._k:
            rates = [*rates, *self._system.solve([-dot(row, rates) for row in self._G_z])]
            moving = self._platform(rates, [*accelerations, *[cs.SX(0.0)] * self._k])
            joints = [leg.followed(moving.point_velocity(leg.arm), moving.omega, []) for leg in self.legs]
            lags = []
            for number, which in self._chosen:
                leg = self.legs[number]
                force, moment = leg.held[which]
                drift, turning = leg.drift(joints[number])
                lags.append(
                    -dot(force, minus(moving.point_acceleration(leg.arm), drift))
                    - dot(moment, minus(moving.alpha, turning))
                )
            accelerations = [*accelerations, *self._system.solve(lags)]
        self.platform = self._platform(rates, accelerations)
        for leg, speed, turn in zip(self.legs, speeds, turned, strict=True):
            rates = leg.followed(self.platform.point_velocity(leg.arm), self.platform.omega, speed)
            changing = self.platform.point_acceleration(leg.arm)
            result = leg.accelerated(rates, changing, self.platform.alpha, turn)
            leg.motion = chain_motion(leg.model, rates, result, self.gravity)

    def rows(self) -> list[Scalars]:
        """J_a (n_a, m): rate of every motor per quasi-velocity."""
        rows = []
        for number, joint in self.description.actuated:
            leg = self.legs[number]
            single = [cs.SX(float(k == joint)) for k in range(leg.model.size)]
            force, moment, left = leg.wrench(single)
            forces = {number: left}
            rows.append([*self._projected(self._reduced(leg, force, moment)), *self._coordinates(forces)])
        return rows

    def force(self, *, motors_too: bool = True) -> tuple[Scalars, dict[tuple[int, int], cs.SX]]:
        """tau_s (m,), and efforts of the motor joints: parts of it, or left out of it."""
        force, moment = platform_wrench(self._own, self.platform, self.gravity)
        forces, left = {}, {}
        for number, leg in enumerate(self.legs):
            efforts = leg_efforts(leg.model, leg.motion)
            for joint in leg.model.actuated:
                forces[number, joint] = efforts[joint]
                efforts[joint] = efforts[joint] if motors_too else cs.SX(0.0)
            f, n, left[number] = leg.wrench(efforts)
            force, moment = plus(force, f), plus(moment, n, cross(leg.arm, f))
        return [*self._projected(self._generalized(force, moment)), *self._coordinates(left)], forces

    def motor_forces(self) -> cs.SX:
        """J_a^T tau_a = tau_s, with the efforts of the motor joints added after the unactuated ones are
        balanced.
        """
        right, leg_forces = self.force(motors_too=False)
        rows, order = self.rows(), list(elimination_order(self.description, complete=True))
        system = BlockSystem([[rows[k][c] for k in order] for c in range(len(right))])
        solved = dict(zip(order, system.solve(right), strict=True))
        motors = self.description.actuated
        return cs.vertcat(*(leg_forces[motor] + solved[k] for k, motor in enumerate(motors)))

    def joint_rates(self) -> cs.SX:
        """(n,) of all joints, leg by leg."""
        return cs.vertcat(*(rate for leg in self.legs for rate in leg.motion.rates))

    def joint_accelerations(self) -> cs.SX:
        """(n,) of all joints, leg by leg."""
        return cs.vertcat(*(value for leg in self.legs for value in leg.motion.accelerations))

    def coordinate_rates(self) -> list[cs.SX]:
        """z' (m,) from the given s'."""
        rates = cs.vertsplit(self.arguments.rates)
        return rates if self._k else [*euler_rates(self.platform, rates[: self._m]), *rates[self._m :]]

    def closure_errors(self) -> cs.SX:
        """(6 legs + redundant joints,) closure errors, m or rad."""
        closed = [x for gap, turned in self.closures() for x in (*gap, *turned)]
        return cs.vertcat(*closed, *(step for entry in self._steps() for step in entry))

    def potential(self) -> cs.SX:
        """Potential energy in gravity, J."""
        return potential_energy(self._still, self._own, [leg.model for leg in self.legs], self.gravity)

    def closures(self) -> list[tuple[Vector, Vector]]:
        """Per leg the place of its end minus where the platform holds it, m and rad, world axes."""
        gaps = []
        for leg, solver, place in zip(self.legs, self._kinematics.legs, self._at, strict=True):
            model = leg.model
            gap = minus(model.end, plus(self._still.position, leg.arm))
            frames, held = solver.frames(place)[0], solver.end_rotations[0]
            assert held is not None
            # of the last joint's frame in the platform; a fixed row may follow it
            fixed = _right_angles(held.T @ frames[-1].T @ frames[model.size - 1])
            turned = [model.rotation(0, model.size)(unit(k)) for k in range(3)]
            meant = [self._still.arm(vector(fixed[:, k])) for k in range(3)]
            twists = [cross(a, b) for a, b in zip(meant, turned, strict=True)]
            gaps.append((gap, [component / 2 for component in plus(*twists)]))
        return gaps

    def newton(self) -> cs.SX:
        """(n,) joints and dependent coordinates after one step of Newton's method on the closures."""
        gaps, along = self.closures(), []
        if self._k:
            right = []
            for number, which in self._chosen:
                (force, moment), (gap, turned) = self.legs[number].held[which], gaps[number]
                right.append(dot(force, gap) + dot(moment, turned))
            along = self._system.solve(right)
        shift = self._platform([*[cs.SX(0.0)] * self._m, *along], [cs.SX(0.0)] * len(self._pose))
        steps = []
        for leg, (gap, turned), given in zip(self.legs, gaps, self._steps(), strict=True):
            moving = minus(shift.point_velocity(leg.arm), gap), minus(shift.omega, turned)
            steps += leg.nearest(*moving, given)
        return self.arguments.q + cs.vertcat(*steps, *along)

    def _by_leg(self, values: Scalars) -> list[Scalars]:
        """Values of the redundant joints, leg by leg."""
        of_joint = zip(self.description.redundant, values, strict=True)
        results: list[Scalars] = [[] for _ in self.description.legs]
        for (leg, _), value in of_joint:
            results[leg].append(value)
        return results

    def _coordinates(self, left: dict[int, Scalars]) -> Scalars:
        """Values of the redundant joints in the order of the coordinates; 0 of legs that are not there."""
        ends = {number: list(values) for number, values in left.items()}
        return [ends[leg].pop(0) if leg in ends else cs.SX(0.0) for leg, _ in self.description.redundant]

    def _steps(self) -> list[Scalars]:
        """By how much redundant joints are off their coordinates, leg by leg."""
        meant = self._by_leg(cs.vertsplit(self.arguments.pose)[self._m :])
        return [
            [z - leg.model.q[joint] for joint, z in zip(leg.redundant, step, strict=True)]
            for leg, step in zip(self.legs, meant, strict=True)
        ]

    def _platform(self, rates: Scalars, accelerations: Scalars) -> PlatformState:
        """Motion of the platform from those of its coordinates (z, d)."""
        mask = [i in self._order for i in range(6)]
        pose, rates, accelerations = map(self._sorted, (self._pose, rates, accelerations))
        quasi = self.arguments.quasi and not self._k
        return platform_motion(mask, self.description.platform.convention, pose, rates, accelerations, quasi)

    def _sorted(self, values: Scalars) -> Scalars:
        """From (z, d) to x, y, z, phi1, phi2, phi3."""
        return [values[self._order.index(i)] for i in sorted(self._order)]

    def _leg(self, solver: LegSolver, place: np.ndarray, q: cs.SX, inertia: cs.SX) -> CompleteLeg:
        geometry = geometry_symbols(self.description, numeric=True)
        drives = np.array([getattr(solver.leg, name)[: solver.n] for name in JOINT_TERMS])

        def model_of(inertia: cs.SX, drives: np.ndarray) -> LegModel:
            terms = cs.SX(cs.sparsify(cs.DM(drives)))
            return leg_model(self.description, solver.number, q, geometry, inertia, terms, complete=True)

        model, free = model_of(inertia, drives), None
        if idle_inertia(solver, place):
            inertia_matrix = cs.SX(cs.sparsify(cs.DM(solver.inertia)))
            free = model_of(inertia_matrix, drives * np.array([[1.0], [0.0], [0.0]]))
        arm = self._still.arm(coupling_entries(cast(SerialLeg, solver.leg), geometry))
        redundant = tuple(joint for leg, joint in self.description.redundant if leg == solver.number)
        frame, rows, columns, entries = chosen_equations(solver, model, place, redundant)
        others = tuple(k for k in range(6) if k not in rows)
        system = BlockSystem([[entries[row][c] for c in columns] for row in rows])
        return CompleteLeg(model, arm, frame, rows, others, columns, entries, system, free, redundant)

    def _restrain(self) -> None:
        """Choose the held wrenches that determine the dependent coordinates best."""
        candidates = [(i, k) for i, leg in enumerate(self.legs) for k in range(len(leg.others))]
        G = [self._reduced(self.legs[i], *self.legs[i].held[k]) for i, k in candidates]
        inputs = [self.arguments.pose, self.arguments.q]
        entries = cs.vertcat(*(cs.horzcat(*row) for row in G))
        moving = self._kinematics.moving(self._near, self._at)
        values = np.concatenate([*self._at, moving[self._m :]])
        numbers = np.array(cs.Function("G", inputs, [entries])(self._near, values))
        pivots = np.asarray(scipy.linalg.qr(numbers[:, self._m :].T, pivoting=True)[-1])
        picked = sorted(int(k) for k in pivots[: self._k])
        self._chosen = [candidates[k] for k in picked]
        self._G_z = [G[k][: self._m] for k in picked]
        self._system = BlockSystem([G[k][self._m :] for k in picked])

    def _reduced(self, leg: CompleteLeg, force: Vector, moment: Vector) -> Scalars:
        return self._generalized(force, plus(moment, cross(leg.arm, force)))

    def _generalized(self, force: Vector, moment: Vector) -> Scalars:
        """Dual to w' = (z', d'), or to s' where there are no dependent coordinates."""
        state = self._still
        basis = state.euler if self._k else state.basis
        mask = [i in self._order for i in range(6)]
        values = dict(zip(sorted(self._order), reduced(mask, basis, force, moment), strict=True))
        return [values[i] for i in self._order]

    def _projected(self, values: Scalars) -> Scalars:
        """Dual to z' from dual to (z', d')."""
        if not self._k:
            return values
        held = self._system.solve_transposed(values[self._m :])
        return [value - dot([row[c] for row in self._G_z], held) for c, value in enumerate(values[: self._m])]


def _right_angles(R: np.ndarray) -> np.ndarray:
    """Entries that should be 0, 1 or -1 made exact."""
    return np.where(np.abs(R - np.round(R)) < 1e-14, np.round(R), R)
