"""Derivatives of motor forces with respect to geometry and inertia parameters, the platform's motion held
fixed.

    python -m studies.parallel.sensitivities [ROBOT...]

prints the lengths and angles on which the motor forces near home depend most.

A change of geometry also changes the joint angles at which the legs reach the platform; that part follows
from the position closures: dq = -(dh/dq)^-1 dh.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.parallel.code.leg_plans import choose_plans
from ocptip.parallel.code.tidy import tidy
from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.description.robot_description import RobotDescription
from ocptip.parallel.kinematics.platform import Kinematics
from ocptip.parallel.symbolic.projection import Arguments, Projection
from ocptip.parallel.symbolic.spatial_sx import BlockSystem
from ocptip.parallel.symbolic.symbols import (
    geometry_symbols,
    inertia_layout,
    inertia_values,
    joint_term_values,
)


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Derivatives at one state.

    Attributes:
        forces: (k,) motor forces tau_a, or tau_s.
        geometry: (k, number of named parameters) total derivatives.
        inertia: (k, number of inertia parameters, DynPar 2).
        joints: (n N, number of named parameters) derivatives of the joint variables, leg by leg.
        closure: largest closure error of the given joint variables, m.
        geometry_names, inertia_names: of the columns.
    """

    forces: np.ndarray
    geometry: np.ndarray
    inertia: np.ndarray
    joints: np.ndarray
    closure: float
    geometry_names: tuple[str, ...]
    inertia_names: tuple[str, ...]

    def to_dict(self) -> dict[str, object]:
        """Plain data."""
        return {
            "forces": self.forces.tolist(),
            "geometry": {n: self.geometry[:, k].tolist() for k, n in enumerate(self.geometry_names)},
            "inertia": {n: self.inertia[:, k].tolist() for k, n in enumerate(self.inertia_names)},
            "closure": self.closure,
        }


class ForceSensitivities:
    """Generated derivatives of a robot's forces.

    Args:
        description: the robot; with as many motors as coordinates for motor forces.
        motor_forces: derivatives of tau_a (else of tau_s).

    Raises:
        InputError: a robot without the coupling form, or another number of motors.
    """

    def __init__(self, description: RobotDescription, *, motor_forces: bool = True) -> None:
        layout = inertia_layout(description)
        m, n, legs = description.platform.m, layout.bodies, len(description.legs)
        plans = choose_plans(description, layout, [True] * layout.size, "motors" if motor_forces else "tau_s")
        geometry = geometry_symbols(description)
        arguments = Arguments(
            pose=cs.SX.sym("z", m),
            rates=cs.SX.sym("sd", m),
            accelerations=cs.SX.sym("sdd", m),
            q=cs.SX.sym("q", n, legs),
            geometry=geometry,
            inertia=cs.SX.sym("inertia", layout.size),
            gravity=cs.SX.sym("gravity", 3),
            wrench=cs.SX.zeros(6),
            joint_terms=cs.SX.sym("joint_terms", 3, n * legs),
            quasi=True,
        )
        projection = Projection(description, layout, plans, arguments)
        forces = projection.motor_forces() if motor_forces else projection.generalized_force()
        named = cs.vertcat(*geometry.values()) if geometry else cs.SX(0, 1)
        joints = _joint_derivatives(projection.closures(), arguments.q, named)
        total = cs.jacobian(forces, named) + cs.jacobian(forces, cs.vec(arguments.q)) @ joints
        inputs = [arguments.pose, arguments.rates, arguments.accelerations, arguments.q, named]
        inputs += [arguments.inertia, arguments.gravity, arguments.joint_terms]
        names = ["z", "sd", "sdd", "q", "geometry", "inertia", "gravity", "joint_terms"]
        outputs = [forces, total, cs.jacobian(forces, arguments.inertia), joints, projection.closures()]
        self.function: cs.Function = tidy(
            cs.Function(
                "sensitivities",
                inputs,
                [cs.densify(one) for one in outputs],
                names,
                ["forces", "by_geometry", "by_inertia", "joints_by_geometry", "closure"],
            )
        )
        self._names = tuple(geometry), tuple(layout.names())
        self._own = [list(description.parameters.values()), inertia_values(description), description.gravity]
        self._own.append(joint_term_values(description))

    def __call__(self, z: ArrayLike, sd: ArrayLike, sdd: ArrayLike, q: ArrayLike) -> Sensitivities:
        """Evaluate.

        Args:
            z, sd, sdd: (m,) platform coordinates, quasi-velocities and their derivatives.
            q: (n, N) joint variables up to the coupling points at z.

        Raises:
            InputError: wrong shapes, or joint variables that do not close the legs to 1e-6.
        """
        given = []
        for k, (name, value) in enumerate(zip(("z", "sd", "sdd", "q"), (z, sd, sdd, q), strict=True)):
            rows, columns = self.function.size_in(k)
            given.append(finite_array(name, value, (rows, columns) if name == "q" else (rows,)))
        forces, geometry, inertia, joints, closure = (
            np.array(one) for one in self.function.call([*given, *self._own])
        )
        error = float(np.abs(closure).max())
        if error > 1e-6:
            raise InputError(
                f"q: the legs miss the platform's coupling points by {error:.2g} m; use the "
                "inverse kinematics"
            )
        return Sensitivities(forces[:, 0], geometry, inertia, joints, error, *self._names)


def _joint_derivatives(closures: cs.SX, q: cs.SX, named: cs.SX) -> cs.SX:
    """dq / d(geometry) of all legs, leg by leg."""
    blocks = []
    n, legs = q.shape
    for leg in range(legs):
        by_joints = cs.jacobian(closures[:, leg], q[:, leg])
        by_geometry = cs.jacobian(closures[:, leg], named)
        system = BlockSystem([[cs.SX(by_joints[i, j]) for j in range(n)] for i in range(n)])
        columns = [
            cs.vertcat(*system.solve([-cs.SX(by_geometry[i, k]) for i in range(n)]))
            for k in range(by_geometry.size2())
        ]
        blocks.append(cs.horzcat(*columns))
    return cs.vertcat(*blocks)


def main() -> None:
    """Print the largest derivatives of the named robots."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=list(READY_MADE), metavar="ROBOT")
    for name in parser.parse_args().robots:
        robot = READY_MADE[name]()
        z, rates = robot.home + 0.02, np.full(robot.m, 0.5)
        q = np.column_stack(Kinematics(robot).point_joints(z).q)
        found = ForceSensitivities(robot)(z, rates, 2 * rates, q)
        largest = np.abs(found.geometry).max(axis=0)
        shown = [f"{found.geometry_names[k]} {largest[k]:.3g}" for k in np.argsort(-largest)[:3]]
        print(f"{name}: {', '.join(shown) or 'no named parameters'} (N or N m per m or rad)")


if __name__ == "__main__":
    main()
