"""A parallel robot in its platform coordinates alone, as CasADi expressions: what an optimiser needs of it.

The joints are eliminated by their closed-form inverse kinematics. So motor forces, motor speeds, base wrench
and the measures of singular poses are functions of z, z' and z'', with exact derivatives of any order.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError
from ocptip.numerics.vectors import cross_terms as cross
from ocptip.parallel.analysis.singularity import characteristic_length, elimination_order
from ocptip.parallel.code.complete import home_function, newton_function, point_function
from ocptip.parallel.code.leg_plans import robot_projection
from ocptip.parallel.description.robot_description import PRISMATIC, RobotDescription, SerialLeg
from ocptip.parallel.kinematics.closed_form import leg_solution, leg_type, nearest_branch
from ocptip.parallel.robot import ParallelRobot
from ocptip.parallel.symbolic.leg_dynamics import body_wrench
from ocptip.parallel.symbolic.projection import Projection
from ocptip.parallel.symbolic.spatial_sx import (
    minus,
    plus,
    zero,
)
from ocptip.parallel.symbolic.symbols import (
    coupling_entries,
    geometry_symbols,
    leg_base,
    symbol_of,
)


@dataclass(frozen=True, eq=False)
class MinimalForm:
    """Expressions of platform coordinates z and their derivatives zd, zdd, (m,) each.

    Attributes:
        z, zd, zdd: the symbols.
        q: (n, N) joint positions up to the coupling points, one column per leg.
        motor_forces: (m,), N or N m.
        motor_speeds: (m,), m/s or rad/s.
        wrench: (6,), N and N m: of the robot on its base, about the robot's world origin, world axes; see
            :func:`ocptip.parallel.robot.base_wrench`.
        measures: (k,) distances from singular poses, at most 1, 0 in such a pose; see `measure_names`.
        measure_names: "leg 2 elbow" (type I), "platform" (type II).
    """

    z: cs.SX
    zd: cs.SX
    zdd: cs.SX
    q: cs.SX
    motor_forces: cs.SX
    motor_speeds: cs.SX
    wrench: cs.SX
    measures: cs.SX
    measure_names: tuple[str, ...]


def minimal_form(
    robot: ParallelRobot, gravity: ArrayLike | None = None, load: ArrayLike | None = None
) -> MinimalForm:
    """Eliminate the joints of a robot whose legs have closed forms.

    The legs keep the IK solutions of home. The measure of a leg is the squared sine of an angle between its
    links (`LegSolution.measures`), or for a prismatic leg without such the squared ratio of its length to
    that at home, at most 1; out of reach it is negative. The measure of the platform is the volume that the
    unit vectors along the rows of J_a span, angles counted as lengths by the characteristic length: 1 if the
    motors act at right angles, positive at home and on all poses that are reached from there without passing
    a type II singularity.

    Args:
        robot: with as many motors as coordinates, no dry friction in its joints.
        gravity: (3,), m/s^2, world axes; default the robot's.
        load: (6,) external force and moment on the platform about its origin, world axes; default none.

    Raises:
        InputError: the robot is not of this kind; says why.
    """
    description = robot.description
    require_closed_form(robot)
    if len(description.actuated) != robot.m:
        raise InputError(
            f"{description.name}: {len(description.actuated)} motors for {robot.m} coordinates; motor forces "
            "are functions of the motion only with as many motors as coordinates"
        )
    m = robot.m
    z, zd, zdd = (cs.SX.sym(name, m) for name in ("z", "zd", "zdd"))
    geometry = geometry_symbols(description, numeric=True)
    q, measures, names = joints_of_branch(robot, z, description.home, geometry)
    how = {"quasi": False, "gravity": gravity, "load": load}
    projection = robot_projection(description, "motors", (z, zd, zdd), q, **how)
    order = elimination_order(description)
    rates = projection.joint_rates()
    outputs = [
        q,
        projection.motor_forces(order),
        cs.vertcat(*(rates[joint, leg] for leg, joint in description.actuated)),
        -_carried(projection),
        cs.vertcat(*measures, _platform_measure(robot, projection.jacobian(), z)),
    ]
    q, forces, speeds, wrench, near = map(cs.densify, cs.cse(outputs))
    return MinimalForm(z, zd, zdd, q, forces, speeds, wrench, near, (*names, "platform"))


def joint_functions(robot: ParallelRobot) -> tuple[cs.Function, ...]:
    """What gives generated functions their joints from z.

    `joints` in closed form (:func:`joint_function`), or by Newton's method from joints nearby
    (:func:`ocptip.parallel.code.complete.newton_function`), with `home_joints` to begin with.

    Raises:
        InputError: neither is there; says why.
    """
    if not robot.complete_legs and not joint_obstacle(robot.description):
        return (joint_function(robot),)
    make = newton_function if robot.complete_legs else point_function
    return make(robot.kinematics), home_function(robot.kinematics)


def joint_function(robot: ParallelRobot) -> cs.Function:
    """The joints that generated functions want, for a caller who knows z only: `joints`.

    In: `z` (m,), `geometry` as theirs. Out: `q` (n, N) up to the coupling points with the IK solutions of the
    home pose, and `distance` from singular poses of the legs, at most 1, negative out of reach. As C code:
    :func:`ocptip.parallel.code.codegen.write_c`.

    Raises:
        InputError: a leg has no closed-form inverse kinematics; names it.
    """
    if reason := joint_obstacle(robot.description):
        raise InputError(f"{robot.description.name}: {reason}")
    z, geometry = cs.SX.sym("z", robot.m), geometry_symbols(robot.description)
    q, measures, _ = joints_of_branch(robot, z, robot.description.home, geometry)
    outputs = cs.cse([q, cs.mmin(cs.vertcat(1, *measures))])
    named = cs.vertcat(*geometry.values()) if geometry else cs.SX(0, 1)
    return cs.Function(
        "joints", [z, named], list(map(cs.densify, outputs)), ["z", "geometry"], ["q", "distance"]
    )


def joints_of_branch(
    robot: ParallelRobot, z: cs.SX, start: np.ndarray, geometry: dict[str, cs.SX]
) -> tuple[cs.SX, list[cs.SX], list[str]]:
    """Joints up to the coupling points (n, N) as functions of z, with the IK solutions of a start (m,).

    Args:
        robot: with legs that have closed forms.
        z, start: (m,).
        geometry: symbols of the named parameters, or their numbers.

    Returns:
        The joints, the legs' distances from singular poses, and the names of these; see `minimal_form`.
    """
    position, rotation = robot.kinematics.platform.pose(cs.vertsplit(z))
    columns, measures, names = [], [], []
    at_start = robot.kinematics.point_joints(start).q
    start_position, start_rotation = robot.kinematics.platform.pose(start)
    for number, leg in enumerate(robot.description.legs):
        point = cs.SX(position) + cs.SX(rotation) @ cs.vertcat(*coupling_entries(leg, geometry))
        origin, base = leg_base(leg, geometry)
        target = base.inverse(minus(cs.vertsplit(point), origin))
        point_start = start_position + start_rotation @ leg.coupling_point - leg.origin
        branch = nearest_branch(leg, leg.base_matrix.T @ point_start, at_start[number])
        result = leg_solution(leg, target, branch, lambda entry: symbol_of(entry, geometry))
        columns.append(cs.vertcat(*result.q))
        stretch = [(length / _length(leg, at_start[number])) ** 2 for length in result.lengths]
        measures += [*result.measures.values(), *(cs.fmin(value, 1) for value in stretch)]
        names += [f"leg {number + 1} {name}" for name in (*result.measures, *["length"] * len(stretch))]
    return cs.horzcat(*columns), measures, names


def joint_obstacle(description: RobotDescription) -> str:
    """Why the joints are no functions of z in closed form; "" if they are."""
    if obstacle := description.coupling_obstacle:
        return obstacle
    for number, leg in enumerate(description.legs, start=1):
        if leg_type(leg) is None:
            known = "RRR, RPR, PRRR, RUU and UPS have"
            return f"leg {number} has no closed-form inverse kinematics (types {known})"
    return ""


def minimal_obstacle(robot: ParallelRobot) -> str:
    """Why the equations of motion are no smooth functions of z in closed form; "" if they are."""
    if obstacle := joint_obstacle(robot.description):
        return obstacle
    if robot.complete_legs:
        return "joints behind the coupling points have friction, drives or bodies with mass"
    for number, leg in enumerate(robot.description.legs, start=1):
        if any(leg.coulomb):
            return (
                f"leg {number} has dry friction, which changes its sign with the direction of motion; "
                "leave it to the model of the motors"
            )
    return ""


def require_closed_form(robot: ParallelRobot) -> None:
    """Refuse (InputError) a robot whose equations of motion are no smooth functions of z in closed form."""
    if obstacle := minimal_obstacle(robot):
        raise InputError(f"{robot.description.name}: {obstacle}")


def _length(leg: SerialLeg, q: np.ndarray) -> float:
    return float(next(abs(v) for v, row in zip(q, leg.rows, strict=False) if row.sigma == PRISMATIC))


def _platform_measure(robot: ParallelRobot, jacobian: cs.SX, z: cs.SX) -> cs.SX:
    """Volume spanned by the unit rows of J_a, positive at home."""
    platform, length = robot.description.platform, characteristic_length(robot.kinematics)
    shifts = sum(platform.mask[:3])
    weights = [1.0] * shifts + [1.0 / length] * (robot.m - shifts)
    rows = jacobian @ cs.diag(cs.DM(weights))
    unit = cs.vertcat(*(row / cs.norm_2(row) for row in cs.vertsplit(rows)))
    volume = cs.det(unit)
    home = float(cs.Function("home", [z], [volume])(robot.description.home))
    return volume if home >= 0 else -volume


def _carried(projection: Projection) -> cs.SX:
    """Force and moment about the world origin that move and carry all bodies, (6,), world axes."""
    wrenches = [(*projection.platform_load(), projection.platform.position)]
    for one in projection.legs:
        leg = one.model
        point = leg.origin
        for body in range(leg.size):
            to_world = leg.rotation(0, body + 1)
            force, moment = body_wrench(leg.inertia[body], one.motion, body)
            wrenches.append((to_world(force), to_world(moment), point))
            point = plus(point, to_world(leg.segments[body]))
    total_force, total_moment = zero(), zero()
    for force, moment, point in wrenches:
        total_force = plus(total_force, force)
        total_moment = plus(total_moment, moment, cross(point, force))
    return cs.vertcat(*total_force, *total_moment)
