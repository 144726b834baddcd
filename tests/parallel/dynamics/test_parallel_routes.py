"""Motor forces against three other routes, the golden file, Pinocchio and a published example."""

import numpy as np
import pytest

from ocptip.basics.errors import InputError, SolverError
from ocptip.parallel.description.platform import CONVENTIONS
from ocptip.parallel.description.ready_made import delta
from ocptip.parallel.robot import ParallelRobot
from tests.oracles.parallel_routes.forces import ROUTES, forces_by
from tests.parallel.parallel_cases import KIND_NAMES
from tests.parallel.parallel_examples import extra_leg, five_axes, prr3, published_motion, redundant_leg
from tests.parallel.parallel_twin import Twin, golden_robot, random_robot, relative, rod_delta
from tests.quick import some

GOLDEN, SAME = 1e-9, 1e-10


@pytest.mark.parametrize("kind", some(2, KIND_NAMES))
def test_golden_case_by_every_route(kind):
    robot, case = golden_robot(kind)
    q = [leg.home for leg in robot.kinematics.legs]
    for found, given in zip(q, case.q.T, strict=True):
        np.testing.assert_allclose(np.exp(1j * found[: len(given)]), np.exp(1j * given), atol=1e-9)
    state = case.z, case.zd, case.zdd, q
    for forces in (robot.inverse_dynamics(*state), *(forces_by(route, robot, *state) for route in ROUTES)):
        assert relative(forces.motors, case.expected["tau_a"]) < GOLDEN
        assert relative(forces.generalized, case.expected["tau_s"]) < GOLDEN
    terms = robot.terms(case.z, case.zd, q, form="X")
    for found, name in ((terms.M, "M"), (terms.c, "c"), (terms.g, "g"), (robot.jacobian(case.z, q), "J_a")):
        assert relative(found, case.expected[name]) < GOLDEN, name


@pytest.mark.parametrize("seed", some(1, [0, 1, 2]))
@pytest.mark.parametrize("kind", some(2, KIND_NAMES))
def test_routes_agree_on_random_robots_and_with_pinocchio(kind, seed):
    robot, z, zd, zdd = random_robot(kind, seed)
    q = [leg.home for leg in robot.kinematics.legs]
    wrench = np.random.default_rng(seed).uniform(-20, 20, 6)
    for load in (None, wrench):
        own = robot.inverse_dynamics(z, zd, zdd, q, wrench=load)
        for route in ROUTES:
            other = forces_by(route, robot, z, zd, zdd, q, wrench=load)
            assert relative(other.motors, own.motors) < SAME, route
            assert relative(other.generalized, own.generalized) < SAME, route
            assert other.residual < SAME
    motors, residual, closure_rate = Twin(robot).motor_forces(z, zd, zdd)
    assert residual < SAME
    assert closure_rate < 1e-10
    assert relative(motors, robot.inverse_dynamics(z, zd, zdd, q).motors) < SAME


@pytest.mark.parametrize("convention", some(2, CONVENTIONS))
def test_hexapod_in_every_convention(convention):
    robot, z, zd, zdd = random_robot("6UPS", 11, convention)
    q = [leg.home for leg in robot.kinematics.legs]
    own = robot.inverse_dynamics(z, zd, zdd, q)
    by_constraints = forces_by("constraints", robot, z, zd, zdd, q)
    assert relative(by_constraints.motors, own.motors) < 1e-9
    s, sd = robot.kinematics.quasi(z, zd, zdd)
    quasi = robot.inverse_dynamics(z, s, sd, q, rates="quasi")
    assert relative(quasi.motors, own.motors) < SAME
    assert relative(Twin(robot).motor_forces(z, zd, zdd)[0], own.motors) < 1e-9


@pytest.mark.parametrize("route", [None, *ROUTES])
def test_published_example(route):
    robot = ParallelRobot(prr3())
    expected = {0.0: (-191.8454, 412.1339, -258.4191), 0.25: (68.8301, 152.1779, -57.0091)}
    q = None
    for t in np.linspace(0, 0.25, 26):
        q = robot.ik(published_motion(t)[0], q).q
        if t in expected:
            state = *published_motion(t), q
            forces = robot.inverse_dynamics(*state) if route is None else forces_by(route, robot, *state)
            np.testing.assert_allclose(forces.motors, expected[t], atol=6e-5)


@pytest.mark.slow
def test_parallelogram_delta_is_the_lumped_one():
    lumped, rods = ParallelRobot(delta()), ParallelRobot(rod_delta())
    assert rods.complete_legs
    assert not lumped.complete_legs
    z, zd, zdd = np.array([0.05, -0.04, -0.48]), np.array([1, 0.5, -0.3]), np.array([5, 3, -9.0])
    expected = lumped.inverse_dynamics(z, zd, zdd).motors
    assert relative(rods.inverse_dynamics(z, zd, zdd).motors, expected) < SAME
    for route in ("constraints", "multipliers"):
        assert relative(forces_by(route, rods, z, zd, zdd).motors, expected) < SAME
    assert relative(Twin(rods).motor_forces(z, zd, zdd)[0], expected) < SAME


@pytest.mark.parametrize("coupling_mass", [False, True])
def test_five_joint_legs_with_two_rotations(coupling_mass):
    robot = ParallelRobot(five_axes(coupling_mass=coupling_mass))
    assert robot.complete_legs == coupling_mass
    z = robot.description.home + 0.02
    zd, zdd = np.array([0.3, -0.2, 0.4, 0.5, -0.6]), np.array([1, 2, -1, 3, -2.0])
    own = robot.inverse_dynamics(z, zd, zdd).motors
    for route in ROUTES:
        assert relative(forces_by(route, robot, z, zd, zdd).motors, own) < SAME
    assert relative(Twin(robot).motor_forces(z, zd, zdd)[0], own) < SAME


def test_kinematic_redundancy():
    robot = ParallelRobot(redundant_leg())
    z, zd, zdd = np.array([0.02, 0.03, 0.1, 0.25]), np.array([0.3, -0.2, 0.5, 0.7]), np.array([1, 2, -1, 3.0])
    assert robot.ik(z).q[0][0] == 0.25
    own = robot.inverse_dynamics(z, zd, zdd).motors
    for route in ROUTES:
        assert relative(forces_by(route, robot, z, zd, zdd).motors, own) < SAME, route
    assert relative(Twin(robot).motor_forces(z, zd, zdd)[0], own) < SAME


def test_redundant_actuation_takes_the_smallest_forces():
    robot = ParallelRobot(extra_leg())
    z, zd, zdd = np.array([0.02, 0.03, 0.1]), np.array([0.3, -0.2, 0.5]), np.array([1, 2, -1.0])
    forces = robot.inverse_dynamics(z, zd, zdd)
    assert forces.residual < 1e-12
    other = forces_by("multipliers", robot, z, zd, zdd)
    assert relative(other.generalized, forces.generalized) < SAME
    assert np.linalg.norm(forces.motors) <= np.linalg.norm(other.motors) * (1 + 1e-12)
    null = np.linalg.svd(robot.jacobian(z).T)[2][-1]
    assert abs(null @ forces.motors) < 1e-10 * np.linalg.norm(forces.motors)


@pytest.mark.slow
def test_friction_and_drive_inertia_by_every_route():
    import dataclasses

    from ocptip.parallel.description.ready_made import ups6

    plain = ups6()
    values = {"drive_inertia": (0.1, 0.2, 3.0), "viscous": (0.3, 0.1, 5.0), "coulomb": (0.2, 0.4, 6.0)}
    rough = dataclasses.replace(plain, legs=tuple(dataclasses.replace(leg, **values) for leg in plain.legs))
    everywhere = {name: (*v, 0.02, 0.03, 0.04) for name, v in values.items()}
    full = dataclasses.replace(
        plain, legs=tuple(dataclasses.replace(leg, **everywhere) for leg in plain.legs)
    )
    z, rng = plain.home + 0.05, np.random.default_rng(4)
    zd, zdd = rng.uniform(-1, 1, (2, 6))
    results = []
    for description in (plain, rough, full):
        robot = ParallelRobot(description)
        own = robot.inverse_dynamics(z, zd, zdd).motors
        for route in ROUTES:
            assert relative(forces_by(route, robot, z, zd, zdd).motors, own) < SAME
        results.append(own)
        # Power of friction: motor power beyond that of the smooth robot and the drives' kinetic energy.
        rates = robot.passive(z, zd, zdd)
    assert robot.complete_legs
    power = [
        float(tau @ np.array([rates.qd[leg][joint] for leg, joint in plain.actuated])) for tau in results
    ]
    lost = sum(
        float(
            np.abs(qd[:n]) @ np.array(c)[:n]
            + qd[:n] ** 2 @ np.array(v)[:n]
            + qd[:n] * qdd[:n] @ np.array(d)[:n]
        )
        for qd, qdd in zip(rates.qd, rates.qdd, strict=True)
        for n, c, v, d in [(3, values["coulomb"], values["viscous"], values["drive_inertia"])]
    )
    assert power[1] - power[0] == pytest.approx(lost, rel=1e-9)


def test_too_few_motors_are_reported():
    import dataclasses

    lame = dataclasses.replace(delta(), actuated=((0, 0), (1, 0)))
    with pytest.raises(InputError, match="2 motors cannot hold 3 degrees"):
        ParallelRobot(lame)
    robot = ParallelRobot(lame, check=False)
    with pytest.raises(SolverError, match=r"platform \(type II\)"):
        robot.inverse_dynamics([0.05, 0, -0.45], np.zeros(3), np.zeros(3))
