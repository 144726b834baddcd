"""Power, torques and base wrench at nodes: values of the checked robot model, two derivatives."""

import dataclasses

import numpy as np
import pytest

from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.planner.node_physics import NodePhysics
from ocptip.published.arms import load_arm
from ocptip.published.cases import motion_case
from ocptip.published.tasks import experiment_robot
from ocptip.robots.motors import DCMotors
from ocptip.standing.arm import Robot
from tests.motion.planner.node_derivatives import all_slopes, bends
from tests.quick import some


def dc_motors(n, regeneration):
    k = np.arange(1, n + 1)
    return DCMotors(
        motor_constant=5.0 + k,
        coulomb=0.4 * k,
        viscous=0.2 + 0.1 * k,
        standby=np.full(n, 3.0),
        regeneration=regeneration,
    )


@pytest.fixture(scope="module")
def modular():
    """Clamped case on the base of the experiments, drives by measured power maps."""
    return experiment_robot(motion_case("A"), "effective")


@pytest.fixture(scope="module")
def geared():
    """An arm with DC motors on four feet, off the centre, on a slope."""
    places = [[0.3, 0.2, 0.0], [0.3, -0.2, 0.0], [-0.3, -0.2, 0.0], [-0.3, 0.2, 0.0]]
    support = Support(
        [UnilateralContact(position=p, friction=0.6) for p in places],
        mass=20.0,
        center_of_mass=[0.05, -0.02, 0.2],
        gravity=[1.0, -0.5, -9.7],
    )
    arm = dataclasses.replace(load_arm("FSFS"), mount_position=np.array([0.1, 0.0, 0.4]))
    return Robot(arm, support, dc_motors(arm.n, 1.0))


@pytest.fixture(scope="module", params=["modular", "geared"])
def robot(request):
    return request.getfixturevalue(request.param)


def random_states(n, count, seed=0):
    """s (count, 3 n) with speeds that are not near zero."""
    rng = np.random.default_rng(seed)
    speeds = rng.uniform(0.15, 1.5, (count, n)) * rng.choice([-1, 1], (count, n))
    return np.hstack([rng.uniform(-2, 2, (count, n)), speeds, rng.uniform(-4, 4, (count, n))])


def split(s):
    return np.split(s, 3, axis=1)


@pytest.mark.parametrize("count", [1, 5, 37])
def test_values_are_those_of_the_robot(robot, count):
    n = robot.arm.n
    s = random_states(n, count)
    q, qd, qdd = split(s)
    torque, wrench = robot.loads(q, qd, qdd)
    y = NodePhysics(robot).values(s.T, np.sign(qd).T)
    np.testing.assert_allclose(y[:, 1 : 1 + n], torque, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(y[:, 1 + n :], wrench, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(y[:, 0], robot.motors.power(torque, qd).sum(axis=1), rtol=1e-10)


def test_direction_decides_the_side_of_the_jump_at_rest(robot):
    n = robot.arm.n
    s = random_states(n, 8)
    s[:, n : 2 * n] = 0.0
    physics = NodePhysics(robot)
    torque, _ = robot.loads(*split(s))
    for sign in (1.0, -1.0):
        direction = np.full((8, n), sign)
        expected = robot.motors.power(torque, np.zeros((8, n)), direction).sum(axis=1)
        np.testing.assert_allclose(physics.values(s.T, direction.T)[:, 0], expected, rtol=1e-10)
    forward, backward = (physics.values(s.T, np.full((n, 8), sign))[:, 0] for sign in (1.0, -1.0))
    assert np.min(np.abs(forward - backward)) > 1e-3


def test_rounded_kink_of_burnt_power_costs_at_most_its_bound():
    motors = dc_motors(6, 0.3)
    places = [[0.3, 0.0, 0.0], [-0.2, 0.2, 0.0], [-0.2, -0.2, 0.0]]
    support = Support([UnilateralContact(position=p, friction=0.6) for p in places], mass=20.0)
    robot = Robot(load_arm("FSFS"), support, motors)
    s = random_states(6, 60)
    q, qd, qdd = split(s)
    exact = motors.power(robot.loads(q, qd, qdd)[0], qd).sum(axis=1)
    more = NodePhysics(robot).values(s.T, np.sign(qd).T)[:, 0] - exact
    assert np.all(more >= -1e-9)
    assert np.max(more) > 1e-6
    assert np.max(more) <= 6 * (1 - motors.regeneration) * motors.smoothing / 2


def test_smooth_form_is_exact_except_at_slow_speeds(robot):
    """Beyond 2 r the power of the motion's own direction, below a mean of both sides that turns steadily."""
    n, r = robot.arm.n, 0.05
    physics = NodePhysics(robot, smooth=True)
    s = random_states(n, 40)
    q, qd, qdd = split(s)
    assert np.min(np.abs(qd)) > 2 * r
    torque, wrench = robot.loads(q, qd, qdd)
    y = physics.values(s.T, np.full((n, 40), r))
    np.testing.assert_allclose(y[:, 0], robot.motors.power(torque, qd).sum(axis=1), rtol=1e-10)
    np.testing.assert_allclose(y[:, 1 + n :], wrench, rtol=1e-10, atol=1e-9)
    shares = []
    for speed in np.linspace(-2 * r, 2 * r, 21):
        s[:, n : 2 * n] = speed
        torque, _ = robot.loads(*split(s))
        forward, backward = (
            robot.motors.power(torque, s[:, n : 2 * n], np.full(n, e)).sum(axis=1) for e in (1.0, -1.0)
        )
        share = (physics.values(s.T, np.full((n, 40), r))[:, 0] - backward) / (forward - backward)
        np.testing.assert_allclose(share, share[0], atol=1e-6)
        shares.append(share[0])
    assert shares[0] == pytest.approx(0, abs=1e-9)
    assert shares[-1] == pytest.approx(1, abs=1e-9)
    assert np.all(np.diff(shares) > -1e-9)
    assert np.max(np.diff(shares)) < 0.45  # spread over several steps, not a jump


def spread(robot, smooth):
    """Nodes, directions: in the smooth form half of the speeds within the spread jump."""
    n = robot.arm.n
    s = random_states(n, 20, seed=4)
    if smooth:
        s[10:, n : 2 * n] = np.random.default_rng(5).uniform(-0.19, 0.09, (10, n))
        return s, np.full((20, n), 0.1)
    return s, np.sign(s[:, n : 2 * n])


def differences(function, s, step):
    """Central differences with respect to the entries of s, as last axis."""
    parts = []
    for i in range(s.shape[1]):
        shift = np.zeros(s.shape[1])
        shift[i] = step
        parts.append((function(s + shift) - function(s - shift)) / (2 * step))
    return np.stack(parts, axis=-1)


@pytest.mark.parametrize("smooth", [False, True], ids=["hard", "smooth"])
def test_first_derivatives(robot, smooth):
    physics = NodePhysics(robot, smooth)
    s, direction = spread(robot, smooth)
    at = physics.jacobian(s.T, direction.T)
    np.testing.assert_allclose(at.y, physics.values(s.T, direction.T), rtol=1e-12)
    reference = differences(lambda z: physics.values(z.T, direction.T), s, 1e-5)
    scale = np.max(np.abs(reference), axis=(0, 2))[None, :, None]
    assert np.max(np.abs(all_slopes(at) - reference) / np.maximum(scale, 1e-3)) < 1e-6


@pytest.mark.parametrize("smooth", some(2, [False, True]), ids=["hard", "smooth"])
def test_second_derivatives(robot, smooth):
    physics = NodePhysics(robot, smooth)
    s, direction = spread(robot, smooth)
    weights = np.random.default_rng(6).normal(size=(20, 7 + robot.arm.n))
    weights[:, 0] *= 5
    at = physics.jacobian(s.T, direction.T)
    hessian = physics.hessian(at, weights)
    reference = differences(
        lambda z: np.einsum("ny,nys->ns", weights, all_slopes(physics.jacobian(z.T, direction.T))), s, 1e-5
    )
    scale = np.max(np.abs(reference), axis=(1, 2))[:, None, None]
    assert np.max(np.abs(bends(hessian) - reference) / scale) < 1e-6
    first = np.einsum("ny,nys->ns", weights, all_slopes(at))
    np.testing.assert_allclose(hessian.slopes.T, first, atol=1e-11 * np.max(np.abs(first)))


@pytest.mark.parametrize("smooth", [False, True], ids=["hard", "smooth"])
def test_second_derivatives_that_are_added(robot, smooth):
    """Over the first states, and over quantities by way of their slopes."""
    physics = NodePhysics(robot, smooth)
    s, direction = spread(robot, smooth)
    at = physics.jacobian(s.T, direction.T)
    hessian = physics.hessian(at, np.zeros(at.y.shape))
    rng, nodes = np.random.default_rng(1), np.array([3, 3, 7])
    own, of_wrench = rng.normal(size=(3, 4, 4)), rng.normal(size=(3, 6, 6))
    own, of_wrench = own + own.transpose(0, 2, 1), of_wrench + of_wrench.transpose(0, 2, 1)
    hessian.add(nodes, own)
    hessian.add_over_quantities(nodes, physics.columns.wrench.start, of_wrench)
    S = all_slopes(at)[nodes, physics.columns.wrench]
    expected = np.zeros((20, s.shape[1], s.shape[1]))
    np.add.at(expected[:, :4, :4], nodes, own)
    np.add.at(expected, nodes, np.einsum("rws,rwv,rvt->rst", S, of_wrench, S))
    np.testing.assert_allclose(bends(hessian), expected, atol=1e-12 * np.max(np.abs(expected)))


def test_weights_are_left_as_they_were(modular):
    physics = NodePhysics(modular)
    s, direction = spread(modular, False)
    weights = np.ones((20, 13))
    physics.hessian(physics.jacobian(s.T, direction.T), weights)
    np.testing.assert_array_equal(weights, 1.0)
