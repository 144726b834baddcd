"""Newton-Euler against Pinocchio, against Lagrange, and against itself for one and many states."""

import dataclasses

import casadi as cs
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.published.arms import arm_names, load_arm
from ocptip.robots.dynamics import evaluate_dynamics, inverse_dynamics
from ocptip.robots.kinematics import link_frames
from ocptip.robots.model import ArmModel
from ocptip.robots.urdf.arm import arm_from_pinocchio
from tests.quick import examples
from tests.robots.pinocchio_twin import dynamics, twin
from tests.robots.sample_arms import random_arm

TOLERANCE = 1e-10


def worst_difference(model: ArmModel, robot: pin.Model, seed: int, states: int = 20) -> float:
    """Largest difference of torques and base wrench, relative to the largest value of the state."""
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.uniform(-3, 3, (3, states, model.n))
    gravity, about = rng.normal(size=(2, 3)) * 5
    force, moment = rng.normal(size=(2, states, 3)) * 20
    ours = evaluate_dynamics(model, q, qd, qdd, gravity=gravity, force=force, moment=moment, about=about)
    worst = 0.0
    for k in range(states):
        torque, wrench = dynamics(robot, q[k], qd[k], qdd[k], gravity, force[k], moment[k], about)
        theirs = np.concatenate([torque, wrench])
        mine = np.concatenate([ours.torque[k], ours.wrench[k]])
        worst = max(worst, np.abs(mine - theirs).max() / np.abs(theirs).max())
    return worst


@pytest.mark.parametrize("name", arm_names())
def test_modular_arms_agree_with_pinocchio_negative_inertias_included(name):
    model = load_arm(name).mounted([0.03, -0.01, 0.1])
    assert min(np.linalg.eigvalsh(inertia).min() for inertia in model.inertias) < 0
    assert worst_difference(model, twin(model), seed=1) < TOLERANCE


def test_negative_inertias_by_an_equivalent_of_positive_ones():
    # Torques and wrench are linear in the inertias: what a positive surplus adds can be taken off again.
    model = load_arm("FSFS")
    surplus = np.tile(0.05 * np.eye(3), (6, 1, 1))
    assert min(np.linalg.eigvalsh(i).min() for i in model.inertias + surplus) > 0
    full = twin(model, inertias=model.inertias + surplus)
    only = twin(model, inertias=surplus, masses=np.zeros(6))
    rng = np.random.default_rng(2)
    for q, qd, qdd in rng.uniform(-2, 2, (10, 3, 6)):
        still = ((0, 0, -9.81), np.zeros(3), np.zeros(3), np.zeros(3))
        more, less = dynamics(full, q, qd, qdd, *still), dynamics(only, q, qd, qdd, *still)
        ours = evaluate_dynamics(model, q, qd, qdd)
        np.testing.assert_allclose(ours.torque, more[0] - less[0], atol=1e-11)
        np.testing.assert_allclose(ours.wrench, more[1] - less[1], atol=1e-10)


@examples(15)
@given(seed=st.integers(0, 2**32 - 1), joints=st.integers(1, 8))
def test_random_arms_agree_with_pinocchio(seed, joints):
    model = random_arm(seed, joints)
    assert worst_difference(model, twin(model), seed, states=3) < TOLERANCE


def test_pinocchio_sample_arm():
    robot = pin.buildSampleModelManipulator()
    model = arm_from_pinocchio(robot, base_link="universe", tool_frame="effector_body")
    robot.addFrame(
        pin.Frame("G", 6, robot.frames[robot.getFrameId("effector_body")].placement, pin.FrameType.OP_FRAME)
    )
    assert worst_difference(model, robot, seed=3) < TOLERANCE


def energies(model: ArmModel, q: np.ndarray, qd: np.ndarray) -> tuple[float, float]:
    """Kinetic and potential energy from forward kinematics and finite differences of it alone."""
    step = 1e-5

    def centres_and_axes(angles):
        frames = link_frames(model, angles)
        R, o = frames.rotations[:-1], frames.origins[:-1]
        return o + np.einsum("ijk,ik->ij", R, model.centres), R

    forth, R1 = centres_and_axes(q + step * qd)
    back, R0 = centres_and_axes(q - step * qd)
    here, R = centres_and_axes(q)
    velocity = (forth - back) / (2 * step)
    spin = (R1 - R0) / (2 * step) @ R.transpose(0, 2, 1)
    omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    inertia = R @ model.inertias @ R.transpose(0, 2, 1)
    kinetic = 0.5 * model.masses @ (velocity**2).sum(axis=1)
    kinetic += 0.5 * np.einsum("ij,ijk,ik->", omega, inertia, omega) + 0.5 * model.armature @ qd**2
    return kinetic, 9.81 * model.masses @ here[:, 2]


@pytest.mark.parametrize("name", arm_names())
def test_torques_are_the_lagrange_derivatives_of_the_energy(name):
    model = load_arm(name)
    rng = np.random.default_rng(4)
    q, qd, qdd = rng.uniform(-1, 1, (3, 6))
    h = 1e-3

    def momentum(t):  # dT/dqd along the motion, by central differences (exact: T is quadratic in qd)
        at, speed = q + t * qd + 0.5 * t**2 * qdd, qd + t * qdd
        unit = 0.5 * np.eye(6)
        return np.array([energies(model, at, speed + u)[0] - energies(model, at, speed - u)[0] for u in unit])

    rate = (8 * (momentum(h) - momentum(-h)) - (momentum(2 * h) - momentum(-2 * h))) / (12 * h)

    def lagrangian(at):
        kinetic, potential = energies(model, at, qd)
        return kinetic - potential

    gradient = np.array([(lagrangian(q + e) - lagrangian(q - e)) / (2 * h) for e in h * np.eye(6)])
    torque = evaluate_dynamics(model, q, qd, qdd).torque
    np.testing.assert_allclose(torque, rate - gradient, atol=2e-5 * np.abs(torque).max())


def test_base_wrench_at_rest_is_the_weight_at_the_centre_of_mass():
    model = load_arm("W1P1P2W2").mounted([0.1, 0.2, 0.3])
    q = np.array([0.3, -0.4, 0.5, 0.2, 0.1, 0.0])
    about = np.array([0.05, 0.0, -0.1])
    wrench = evaluate_dynamics(model, q, np.zeros(6), np.zeros(6), about=about).wrench
    frames = link_frames(model, q)
    centres = frames.origins[:-1] + np.einsum("ijk,ik->ij", frames.rotations[:-1], model.centres)
    weight = model.masses[:, None] * [0.0, 0.0, -9.81]
    np.testing.assert_allclose(wrench[:3], weight.sum(axis=0), atol=1e-12)
    np.testing.assert_allclose(wrench[3:], np.cross(centres - about, weight).sum(axis=0), atol=1e-12)


def test_armature_adds_torque_and_no_wrench():
    model = load_arm("FSFS")
    with_rotors = dataclasses.replace(model, armature=np.arange(6) / 10)
    q, qd, qdd = np.random.default_rng(5).normal(size=(3, 6))
    plain, heavy = evaluate_dynamics(model, q, qd, qdd), evaluate_dynamics(with_rotors, q, qd, qdd)
    np.testing.assert_allclose(heavy.torque - plain.torque, np.arange(6) / 10 * qdd, atol=1e-12)
    np.testing.assert_array_equal(heavy.wrench, plain.wrench)


@pytest.mark.parametrize("count", [1, 3, 16, 64, 65, 200])
def test_many_states_equal_one_by_one(count):
    model = load_arm("FP1W2F")
    q, qd, qdd = np.random.default_rng(6).normal(size=(3, count, 6))
    many = evaluate_dynamics(model, q, qd, qdd)
    single = [evaluate_dynamics(model, *state) for state in zip(q, qd, qdd, strict=True)]
    np.testing.assert_array_equal(many.torque, [s.torque for s in single])
    np.testing.assert_array_equal(many.wrench, [s.wrench for s in single])


def test_function_is_cached_and_differentiable():
    model = load_arm("FSFS")
    f = inverse_dynamics(model)
    assert f is inverse_dynamics(model)
    q = cs.SX.sym("q", 6)
    torque, wrench = f(q, 0.1, 0.2, cs.DM([0, 0, -9.81]), 0, 0, 0)
    slope = cs.Function("slope", [q], [cs.jacobian(cs.vertcat(torque, wrench), q)])
    point = np.linspace(-1, 1, 6)
    value = cs.Function("value", [q], [cs.vertcat(torque, wrench)])
    step = 1e-6
    for joint in range(6):
        e = step * np.eye(6)[joint]
        numeric = (value(point + e) - value(point - e)) / (2 * step)
        np.testing.assert_allclose(np.array(slope(point))[:, joint], np.array(numeric)[:, 0], atol=1e-7)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"q": np.zeros(5)}, "q: expected shape 6, got 5"),
        ({"q": np.full(6, np.nan)}, "q: contains NaN"),
        ({"qd": np.zeros((2, 6))}, "qd: expected 1 states"),
        ({"gravity": [0, 0]}, "gravity: expected shape 3"),
        ({"force": np.zeros((3, 3))}, "force: expected shape 1 x 3"),
    ],
)
def test_bad_input_is_refused(change, message):
    arguments = {"q": np.zeros(6), "qd": np.zeros(6), "qdd": np.zeros(6)} | change
    with pytest.raises(InputError, match=message):
        evaluate_dynamics(load_arm("FSFS"), **arguments)


def test_speed(benchmark):
    model = load_arm("FP1W2F")
    q, qd, qdd = np.random.default_rng(7).normal(size=(3, 1000, 6))
    benchmark(evaluate_dynamics, model, q, qd, qdd)
