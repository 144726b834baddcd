"""Legs as chains against Pinocchio, and closed forms against the chain."""

import itertools

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError
from ocptip.numerics.batch import PointFunction
from ocptip.parallel.description.platform import Parameter, elementary_rotation
from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.description.robot_description import FIXED, PRISMATIC, MDHRow, SerialLeg
from ocptip.parallel.kinematics.chain import Topology, leg_dynamics, leg_kinematics
from ocptip.parallel.kinematics.closed_form import SIGNS, closed_form, leg_type, nearest_branch
from ocptip.parallel.robot import ParallelRobot
from tests.oracles.parallel_routes.constraint import lagrange_leg
from tests.oracles.parallel_routes.tree import leg_newton_euler
from tests.parallel.parallel_cases import KIND_NAMES, chain_end, random_body, random_state
from tests.parallel.parallel_twin import Twin, random_robot, rod_delta
from tests.quick import some


def serial_topology(rows: tuple[MDHRow, ...], bodies: int) -> Topology:
    return Topology(rows, tuple(range(-1, len(rows) - 1)), (len(rows) - 1,), bodies)


def general_rows(rng: np.random.Generator) -> tuple[MDHRow, ...]:
    """A leg with all entries of the table at work."""
    rows = [
        MDHRow(
            sigma,
            gamma=rng.uniform(-1, 1),
            b=rng.uniform(-0.3, 0.3),
            alpha=rng.uniform(-2, 2),
            d=Parameter(f"d{k}", rng.uniform(-0.5, 0.5)),
            theta=rng.uniform(-1, 1),
            r=rng.uniform(-0.3, 0.3),
        )
        for k, sigma in enumerate((0, PRISMATIC, 0, 0))
    ]
    return (*rows, MDHRow(0, gamma=0.2, alpha=0.5, theta=-0.3))


@pytest.mark.parametrize("seed", some(1, [0, 1, 2]))
def test_three_ways_to_the_dynamics_of_a_leg(seed):
    rng = np.random.default_rng(seed)
    rows = general_rows(rng)
    bodies = [random_body(rng) for _ in rows]
    topology = serial_topology(rows, len(bodies))
    base = elementary_rotation("x", 0.4) @ elementary_rotation("z", -0.9)
    q, qd, qdd = rng.uniform(-1, 1, (3, len(rows)))
    gravity = rng.uniform(-10, 10, 3)
    inertia = np.concatenate([body.vector for body in bodies])
    M, c, g, momentum, load, energy = leg_dynamics(topology)(q, qd, base, gravity, inertia)
    by_energy = lagrange_leg(topology, len(rows))(q, qd, base, gravity, inertia)
    for own, other in zip((M, c, g), by_energy, strict=True):
        np.testing.assert_allclose(own, other, atol=1e-12 * np.abs(own).max())
    assert energy[0] == pytest.approx(0.5 * qd @ M @ qd, rel=1e-12)

    model, data = pinocchio_leg(rows, bodies, base, gravity)
    tau = pin.rnea(model, data, q, qd, qdd)
    np.testing.assert_allclose(M @ qdd + c + g, tau, atol=1e-12 * np.abs(tau).max())
    assert energy[1] == pytest.approx(pin.computePotentialEnergy(model, data, q), rel=1e-12, abs=1e-12)
    pin.computeCentroidalMomentumTimeVariation(model, data, q, qd, qdd)
    force = data.dhg.linear - pin.computeTotalMass(model) * gravity
    moment = data.dhg.angular + np.cross(data.com[0], force)
    np.testing.assert_allclose(momentum @ qdd + load, [*force, *moment], atol=1e-10)

    _, origins, J, drift = leg_kinematics(topology)(q, qd, base)
    pin.forwardKinematics(model, data, q, qd, np.zeros_like(q))
    last, at = len(rows), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    np.testing.assert_allclose(origins[:, -1], data.oMi[last].translation, atol=1e-14)
    np.testing.assert_allclose(J @ qd, pin.getVelocity(model, data, last, at).vector, atol=1e-13)
    acceleration = pin.getClassicalAcceleration(model, data, last, at).vector
    np.testing.assert_allclose(drift, acceleration, atol=1e-12)
    np.testing.assert_allclose(base @ chain_end(rows, q), origins[:, -1], atol=1e-14)


def pinocchio_leg(rows, bodies, base, gravity):
    model = pin.Model()
    model.gravity.linear = gravity
    parent, before = 0, pin.SE3(base, np.zeros(3))
    for k, (row, body) in enumerate(zip(rows, bodies, strict=True)):
        turn = elementary_rotation("z", row.gamma)
        d = row.d.value if isinstance(row.d, Parameter) else row.d
        step = pin.SE3(turn @ elementary_rotation("x", row.alpha), turn @ [d, 0, 0] + [0, 0, row.b])
        screw = pin.SE3(elementary_rotation("z", row.theta), np.array([0, 0, row.r]))
        joint = pin.JointModelPZ() if row.sigma == PRISMATIC else pin.JointModelRZ()
        parent = model.addJoint(parent, joint, before * step * screw, f"j{k}")
        before = pin.SE3.Identity()
        center = body.first_moment / body.mass
        about = body.inertia - body.mass * (center @ center * np.eye(3) - np.outer(center, center))
        model.appendBodyToJoint(parent, pin.Inertia(body.mass, center, about), pin.SE3.Identity())
    return model, model.createData()


@pytest.mark.parametrize("kind", KIND_NAMES)
def test_recursion_equals_body_jacobians(kind):
    robot, z, zd, zdd = random_robot(kind, 5)
    rates = robot.passive(z, zd, zdd)
    g = robot.description.gravity
    for leg, q, qd, qdd in zip(robot.kinematics.legs, rates.q, rates.qd, rates.qdd, strict=True):
        M, c, weight, *_ = leg.dynamics(q, qd, g)
        expected = M @ qdd + c + weight
        np.testing.assert_allclose(
            leg_newton_euler(leg, q, qd, qdd, g), expected, atol=1e-12 * np.abs(expected).max()
        )


def test_branched_leg_equals_pinocchio():
    robot = ParallelRobot(rod_delta())
    twin, leg = Twin(robot), robot.kinematics.legs[0]
    rng = np.random.default_rng(3)
    q, qd, qdd = rng.uniform(-1, 1, (3, leg.n))
    n = leg.n
    full = pin.neutral(twin.model)
    full[:n] = q
    v, a = np.zeros((2, twin.model.nv))
    v[:n], a[:n] = qd, qdd
    expected = pin.rnea(twin.model, twin.data, full, v, a)[:n]
    M, c, g, *_ = leg.dynamics(q, qd, robot.description.gravity)
    np.testing.assert_allclose(M @ qdd + c + g, expected, atol=1e-12)
    np.testing.assert_allclose(
        leg_newton_euler(leg, q, qd, qdd, robot.description.gravity), expected, atol=1e-12
    )


@pytest.mark.parametrize("kind", KIND_NAMES)
def test_closed_forms_reach_the_point_in_every_branch(kind):
    state = random_state(kind, 7)
    for leg, q in zip(state.robot.legs, state.q.T, strict=True):
        target = chain_end(leg.rows[: leg.n + 1], q)
        name = leg_type(leg)
        found = set()
        for signs in itertools.product((1, -1), repeat=SIGNS[name]):
            solution = closed_form(leg, target, signs)
            np.testing.assert_allclose(chain_end(leg.rows[: leg.n + 1], solution), target, atol=1e-13)
            found.add(tuple(np.round(np.exp(1j * solution), 6)))
        assert len(found) == 2 ** SIGNS[name]
        branch = nearest_branch(leg, target, q)
        np.testing.assert_allclose(np.exp(1j * closed_form(leg, target, branch)), np.exp(1j * q), atol=1e-9)
        with pytest.raises(InputError, match="branch: a leg of type"):
            closed_form(leg, target, (1,) * (SIGNS[name] + 1))


def test_closed_forms_only_where_the_table_allows():
    types = {name: leg_type(make().legs[0]) for name, make in READY_MADE.items()}
    assert types == {"3RRR": "RRR", "3RPR": "RPR", "Delta": "RUU", "4PRRR": "PRRR", "6UPS": "UPS"}
    leg = READY_MADE["3RRR"]().legs[0]
    twisted = SerialLeg((leg.rows[0], MDHRow(d=0.6, theta=0.1), leg.rows[2]), 2, leg.bodies)
    assert leg_type(twisted) is None
    assert closed_form(twisted, np.array([0.5, 0.5, 0.0])) is None
    assert closed_form(leg, np.array([1.3, 0.0, 0.0])) is None
    assert closed_form(leg, np.array([1.2, 0.0, 0.0])) is not None


def test_rigid_coupling_row():
    rows = (MDHRow(), MDHRow(PRISMATIC, alpha=np.pi / 2), MDHRow(FIXED))
    topology = serial_topology(rows, 2)
    assert topology.n_joints == 2
    assert topology.joints == (0, 1, None)
    evaluator = leg_kinematics(topology)
    assert isinstance(evaluator, PointFunction)
    _, origins, J, _ = evaluator(np.array([0.3, 0.5]), np.zeros(2), np.eye(3))
    np.testing.assert_allclose(origins[:, 2], 0.5 * np.array([np.sin(0.3), -np.cos(0.3), 0]), atol=1e-15)
    assert J.shape == (6, 2)
