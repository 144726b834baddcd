"""Compiled forward dynamics against the numeric route, and the energy of a hexapod on springs."""

import dataclasses

import numpy as np
import pytest

from ocptip.basics.errors import InputError, SolverError
from ocptip.parallel.description.platform import BodyInertia
from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.robot import ParallelRobot
from ocptip.parallel.simulation import CompiledDynamics, simulate
from tests.parallel.code.test_complete import robot_for
from tests.parallel.parallel_examples import redundant_leg
from tests.parallel.test_dependent_coordinates import MECHANISMS, robot_of
from tests.quick import some


def springs(robot, stiffness):
    """Motor law of springs along a hexapod's legs, without stress at home, and their energy."""
    legs = robot.description.legs
    ends = np.array([leg.coupling_point for leg in legs])
    bases = np.array([leg.origin for leg in legs])

    def lengths(z):
        r, R = robot.kinematics.pose(z)
        return np.sqrt(((r + ends @ R.T - bases) ** 2).sum(axis=1))

    home = lengths(robot.description.home)
    sign = np.sign(
        [robot.ik(robot.description.home).q[leg][joint] for leg, joint in robot.description.actuated]
    )
    return (
        lambda t, z, s: -stiffness * sign * (lengths(z) - home),
        lambda z: 0.5 * stiffness * ((lengths(z) - home) ** 2).sum(),
    )


def drift(duration, step=0.001):
    """Change of energy relative to the largest kinetic energy, and the path."""
    robot = ParallelRobot(READY_MADE["6UPS"]())
    law, stored = springs(robot, 2000.0)
    start = np.array([0.05, -0.03, 0.04, 0.2, -0.1, 0.3])
    path = simulate(robot, robot.description.home, start, duration=duration, step=step, motors=law)
    total = path.energy.sum(axis=1) + np.array([stored(z) for z in path.z])
    return np.abs(total - total[0]).max() / path.energy[:, 0].max(), path


@pytest.mark.parametrize("name", some(1, ["spherical", *READY_MADE, "3T2R", "driven behind", *MECHANISMS]))
def test_compiled_dynamics_are_the_numeric_ones(name):
    robot = ParallelRobot(READY_MADE[name]()) if name in READY_MADE else robot_for(name)
    equations, rng = CompiledDynamics(robot, robot.description.home), np.random.default_rng(1)
    for _ in range(5):
        z = robot.description.home + 0.05 * rng.uniform(-1, 1, robot.m)
        s = rng.uniform(-1, 1, robot.m)
        motors = rng.uniform(-5, 5, len(robot.description.actuated))
        state = np.concatenate([z, s])
        rates, accelerations = np.split(equations.slope(state, motors), 2)
        expected = robot.forward_dynamics(z, s, motors)
        np.testing.assert_allclose(accelerations, expected, atol=1e-10 * np.abs(expected).max())
        np.testing.assert_allclose(robot.kinematics.rate_matrices(z, z)[0] @ rates, s, atol=1e-12)
        np.testing.assert_allclose(equations.energy(state), robot.energy(z, s), rtol=1e-10, atol=1e-10)
    assert equations.closure < 1e-12


@pytest.mark.slow
def test_a_hexapod_on_springs_keeps_its_energy():
    error, path = drift(0.5)
    assert error < 1e-7
    assert path.closure < 1e-12
    assert np.abs(path.z - path.z[0]).max() > 1e-3


@pytest.mark.slow
def test_a_robot_with_a_redundant_joint_moves_as_in_python():
    robot = ParallelRobot(redundant_leg())
    start = robot.description.home, np.full(4, 0.2)
    path = simulate(robot, *start, duration=0.2, step=0.001)
    assert path.energy_drift < 1e-9
    slow = simulate(robot, *start, duration=0.02, step=0.001)
    np.testing.assert_allclose(path.z[:21], slow.z, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", some(1, ["five_bar", "exechon", "prs3"]))
def test_mechanisms_keep_their_energy(name):
    """Without weight and motors, as machine code and in Python."""
    robot = ParallelRobot(dataclasses.replace(robot_of(name).description, gravity=np.zeros(3)))
    start = 0.2 * np.random.default_rng(2).uniform(-1, 1, robot.m)
    home = robot.description.home
    path = simulate(robot, home, start, duration=0.3, step=0.001)
    assert path.energy_drift < 1e-10
    assert path.closure < 1e-11
    slow = simulate(robot, home, start, duration=0.01, step=0.001)
    np.testing.assert_allclose(path.z[10], slow.z[-1], atol=1e-13)
    np.testing.assert_allclose(path.s[10], slow.s[-1], atol=1e-11)


@pytest.mark.slow
def test_carried_joints_out_of_reach_are_refused():
    robot = robot_of("five_bar")
    equations = CompiledDynamics(robot, robot.description.home)
    with pytest.raises(SolverError, match=r"singular or out of reach \(a leg\)"):
        equations.slope(np.array([0.0, 0.7, 0.0, 0.0]), np.zeros(2))
    again = CompiledDynamics(robot, robot.description.home)
    with pytest.raises(SolverError, match="singular or out of reach"):
        again.slope(np.array([0.0, 5.0, 0.0, 0.0]), np.zeros(2))


def test_out_of_reach_is_refused():
    robot = ParallelRobot(READY_MADE["3RRR"]())
    equations = CompiledDynamics(robot, robot.description.home)
    with pytest.raises(SolverError, match=r"singular or out of reach \(leg . elbow\)"):
        equations.slope(np.array([5.0, 0, 0, 0, 0, 0]), np.zeros(3))


def test_a_mass_matrix_that_is_not_positive_definite_is_refused():
    """Grouped parameters may belong to no real body."""
    robot = READY_MADE["3RRR"]()
    platform = dataclasses.replace(robot.platform, inertia=BodyInertia.from_vector([0.0] * 9 + [-200.0]))
    light = ParallelRobot(dataclasses.replace(robot, platform=platform))
    with pytest.raises(SolverError, match="the mass matrix is not positive definite"):
        CompiledDynamics(light, robot.home).slope(np.append(robot.home, np.zeros(3)), np.zeros(3))
    with pytest.raises(SolverError, match="the mass matrix is not positive definite"):
        light.forward_dynamics(robot.home, np.zeros(3), np.zeros(3))


def test_only_robots_without_a_compiled_form_are_simulated_without_it(monkeypatch):
    def broken(*_):
        raise InputError("something else")

    monkeypatch.setattr("ocptip.parallel.simulation.CompiledDynamics", broken)
    robot = ParallelRobot(READY_MADE["3RRR"]())
    with pytest.raises(InputError, match="something else"):
        simulate(robot, robot.description.home, np.zeros(3), duration=0.2, step=0.001)


@pytest.mark.parametrize("duration", [0.01, 0.3])
def test_forces_of_a_motor_law_are_checked(duration):
    robot = ParallelRobot(READY_MADE["3RRR"]())
    for law, expected in (
        (lambda t, z, s: [1.0], r"motors: expected 3 forces at t = 0 s, got shape \(1,\)"),
        (lambda t, z, s: [np.nan, 0.0, 0.0], "motors: contains NaN"),
    ):
        with pytest.raises(InputError, match=expected):
            simulate(robot, robot.description.home, np.zeros(3), duration=duration, step=0.001, motors=law)
