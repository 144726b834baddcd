"""Arms that brake by themselves: against a fine simulation by Pinocchio, energy, rest, breakaway."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from ocptip.published.arms import load_arm
from ocptip.robots.braking import brake, terms
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.urdf.arm import arm_from_urdf
from tests.places import UR5
from tests.quick import examples, some
from tests.robots.pinocchio_twin import twin
from tests.robots.sample_arms import random_arm

GRAVITY = np.array([0.0, 0.0, -9.81])


@pytest.fixture(scope="module")
def arm():
    return arm_from_urdf(UR5)


def simulated(model, q, qd, torque, step=1e-4):
    """Rest angles and time: Pinocchio's dynamics, and dry friction as a bounded least-squares problem.

    The impulses of the brakes are least in the kinetic energy after the step; their gradient is the speed.
    """
    robot = twin(model)
    robot.gravity.linear = GRAVITY
    data, time = robot.createData(), 0.0
    q, qd = q.copy(), qd.copy()
    while np.abs(qd).max() > 1e-6:
        M = pin.crba(robot, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        free = qd - step * np.linalg.solve(M, pin.nonLinearEffects(robot, data, q, qd))
        L = np.linalg.cholesky(M)
        half = np.linalg.inv(L)  # M^-1 = half' half
        found = lsq_linear(half, -L.T @ free, (-step * torque, step * torque), tol=1e-14)
        new = free + half.T @ (half @ found.x)
        q, qd, time = q + 0.5 * step * (qd + new), new, time + step
    return q, time


@pytest.mark.parametrize("share", some(1, [0.5, 2.0, 1.0]))
def test_rest_is_where_pinocchio_comes_to_rest(arm, share):
    rng = np.random.default_rng(3)
    q, qd = rng.uniform(-1.5, 1.5, 6), rng.uniform(-1, 1, 6) * 2.0
    torque = share * arm.limits.torque
    run = brake(arm, q[None], qd[None], GRAVITY, torque[None])
    angles, time = simulated(arm, q, qd, torque)
    np.testing.assert_allclose(run.angles[-1, 0], angles, atol=0.03 * np.abs(angles - q).max())
    assert run.rests[0] == pytest.approx(time, abs=run.times[1] * 1.5)
    exact = brake(arm, q[None], qd[None], GRAVITY, torque[None], step=1e-4)
    np.testing.assert_allclose(exact.angles[-1, 0], angles, atol=0.005 * np.abs(angles - q).max())


@examples(15)
@given(seed=st.integers(0, 10**6))
def test_brakes_only_take_energy_until_everything_rests(seed):
    arm = arm_from_urdf_once()
    rng = np.random.default_rng(seed)
    q, qd = rng.uniform(-2, 2, (2, 3, 6))
    run = brake(arm, q, qd, GRAVITY, rng.uniform(0.6, 2.0) * arm.limits.torque * np.ones((3, 6)), step=5e-4)
    assert np.all(np.isfinite(run.rests))
    robot = twin(arm)
    robot.gravity.linear = GRAVITY
    data = robot.createData()
    for i in range(3):
        states = zip(run.angles[:, i], run.speeds[:, i], strict=True)
        energy = np.array([pin.computeMechanicalEnergy(robot, data, *state) for state in states])
        assert np.all(np.diff(energy) <= 1e-3 * np.ptp(energy))
        assert not run.speeds[-1, i].any()


def test_terms_are_those_of_the_inverse_dynamics(arm):
    rng = np.random.default_rng(0)
    q, qd, qdd = rng.uniform(-2, 2, (3, 4, 6))
    about = np.array([0.1, 0.2, -0.3])
    found = terms(arm, q, qd, GRAVITY, about)
    ours = evaluate_dynamics(arm, q, qd, qdd, gravity=GRAVITY, about=about)
    torque = np.einsum("sij,sj->si", found.inertia, qdd) + found.bias
    wrench = np.einsum("sij,sj->si", found.per_acceleration, qdd) + found.rest
    np.testing.assert_allclose(torque, ours.torque, atol=2e-6)  # 1e-8 of the largest inertia is added
    np.testing.assert_allclose(wrench, ours.wrench, atol=1e-10)


def test_brakes_that_are_too_weak_do_not_hold_the_arm(arm):
    q, qd = np.zeros((1, 6)), np.zeros((1, 6))
    qd[0, 0] = 0.5
    run = brake(arm, q, qd, GRAVITY, 0.02 * arm.limits.torque[None])
    fallen = run.speeds[len(run.times) // 8 :, 0, 1]
    assert np.any(np.abs(fallen) > 0.1)  # the shoulder breaks loose under the arm's weight


def test_nothing_brakes_before_the_brakes_act(arm):
    q, qd = np.zeros((2, 6)), np.zeros((2, 6))
    qd[:, 0] = 1.0
    run = brake(
        arm, q, qd, 0 * GRAVITY, 1.0 * arm.limits.torque * np.ones((2, 6)), delay=np.array([0.0, 0.05])
    )
    late = run.times < 0.05 - run.times[1]
    np.testing.assert_allclose(run.speeds[late, 1, 0], 1.0, atol=0.05)
    assert run.rests[1] - run.rests[0] == pytest.approx(0.05, abs=0.01)
    assert run.angles[-1, 1, 0] - run.angles[-1, 0, 0] == pytest.approx(0.05, abs=0.01)


def test_links_without_mass_stop_at_once():
    arm = load_arm("FP1W2F")
    qd = np.zeros((1, 6))
    qd[0, 5] = 3.0
    run = brake(arm, np.full((1, 6), 0.3), qd, GRAVITY, arm.limits.torque[None])
    assert run.rests[0] < 1e-3
    assert np.abs(run.angles[-1] - 0.3).max() < 1e-3


@examples(20)
@given(
    inertia=st.floats(0.1, 5.0),
    speed=st.floats(0.2, 3.0),
    braking=st.floats(0.02, 0.5),
    delay=st.floats(0.0, 0.05),
)
def test_one_joint_about_the_vertical_is_the_closed_form(inertia, speed, braking, delay):
    """Free until the brake acts, then a constant deceleration."""
    arm, torque, stop = turntable(inertia), inertia * speed / braking, delay + braking
    way = speed * delay + inertia * speed**2 / (2 * torque)
    q, qd = np.zeros((2, 1)), speed * np.array([[1.0], [-1.0]])
    run = brake(arm, q, qd, GRAVITY, np.array([torque]), delay=delay, step=stop / 200)
    np.testing.assert_allclose(run.rests, stop, rtol=0.03)
    np.testing.assert_allclose(run.angles[-1, :, 0], [way, -way], rtol=2e-3)
    found = terms(arm, q, qd, GRAVITY, np.zeros(3))
    assert found.inertia.shape == (2, 1, 1)
    assert found.per_acceleration.shape == (2, 6, 1)
    np.testing.assert_allclose(found.per_acceleration[:, 5, 0], -inertia, rtol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("seed", some(1, [1, 4]))
def test_one_joint_anyhow_rests_where_pinocchio_rests(seed):
    arm = replace(random_arm(seed, 1), inertias=np.eye(3)[None])
    q, qd = np.array([0.4]), np.array([1.5])
    torque = 3 * np.abs(terms(arm, q[None], 0 * qd[None], GRAVITY, np.zeros(3)).bias[0]) + 5.0
    run = brake(arm, q[None], qd[None], GRAVITY, torque[None], step=1e-4)
    angles, time = simulated(arm, q, qd, torque)
    np.testing.assert_allclose(run.angles[-1, 0], angles, atol=0.005 * np.abs(angles - q).max())
    assert run.rests[0] == pytest.approx(time, abs=2e-3)  # steps grow


def turntable(inertia):
    """One joint about the vertical, its centre of mass on the axis."""
    one = random_arm(0, 1)
    zero, eye = np.zeros(3), np.eye(3)
    return replace(
        one,
        rotations=eye[None],
        offsets=zero[None],
        centres=zero[None],
        inertias=np.diag([1.0, 1.0, inertia])[None],
        mount_position=zero,
        mount_rotation=eye,
        armature=np.zeros(1),
    )


@lru_cache
def arm_from_urdf_once():
    return arm_from_urdf(UR5)
