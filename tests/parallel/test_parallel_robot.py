"""Kinematics, forms of the equations, forward dynamics, power and energy of whole robots."""

import contextlib
import dataclasses
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError, SolverError
from ocptip.parallel.analysis.singularity import characteristic_length
from ocptip.parallel.description.ready_made import READY_MADE, delta, ups6
from ocptip.parallel.robot import ParallelRobot
from ocptip.parallel.simulation import simulate
from tests.oracles.parallel_routes.multipliers import accelerations
from tests.parallel.parallel_cases import KIND_NAMES
from tests.parallel.parallel_examples import extra_leg, five_axes, redundant_leg, spu6
from tests.parallel.parallel_twin import random_robot, relative, rod_delta
from tests.quick import examples, some

ROBOTS = {name: ParallelRobot(make()) for name, make in READY_MADE.items()}


def near_home(robot, seed, size=0.05):
    rng = np.random.default_rng(seed)
    z = robot.description.home + size * rng.uniform(-1, 1, robot.m)
    return z, *rng.uniform(-1, 1, (2, robot.m))


@pytest.mark.parametrize("name", some(2, ROBOTS))
@given(seed=st.integers(0, 10**6))
@examples(8)
def test_inverse_and_forward_kinematics(name, seed):
    robot = ROBOTS[name]
    z, _, _ = near_home(robot, seed)
    found = robot.ik(z)
    assert found.residual < 1e-12
    r, R = robot.kinematics.pose(z)
    for leg, q in zip(robot.kinematics.legs, found.q, strict=True):
        assert np.abs(leg.residual(q, r, R)).max() < 1e-12
    qa = [found.q[leg][joint] for leg, joint in robot.description.actuated]
    pose = robot.fk(qa)
    assert pose.residual < 1e-12
    assert pose.assembly_mode in (1, -1)
    np.testing.assert_allclose(pose.z, z, atol=1e-9)
    assert pose.to_dict()["joints"]["residual"] < 1e-12


@pytest.mark.slow
def test_legs_without_closed_form_stay_in_the_assembly_of_home():
    """Ball joint, slider, universal joint: the mirrored branch with negative length is as near for Newton."""
    robot, twin = ParallelRobot(spu6()), ROBOTS["6UPS"]
    rng = np.random.default_rng(0)
    for reach in np.linspace(0.02, 1.0, 20):
        z = twin.description.home + reach * rng.uniform(-1, 1, 6) * [0.2, 0.2, 0.2, 0.6, 0.6, 0.6]
        found, rest = robot.ik(z), np.zeros(6)
        lengths = [q[2] for q in twin.ik(z).q]
        assert (found.assembly, found.searched) == ("home", ())
        np.testing.assert_allclose([q[3] for q in found.q], lengths, atol=1e-9)
        heavy = np.array([0, 0, -100.0, 0, 0, 0])
        pushed = [
            r.inverse_dynamics(z, rest, rest, wrench=heavy, gravity=[0, 0, 0]).motors for r in (robot, twin)
        ]
        np.testing.assert_allclose(*pushed, rtol=1e-8, atol=1e-8)


def test_rough_guesses_choose_the_home_assembly_only():
    """Found from the guess again at every pose, the legs would jump to their mirrored branches and back."""
    exact = ParallelRobot(spu6())
    rng = np.random.default_rng(2)
    legs = tuple(
        dataclasses.replace(
            leg, guess=leg.guess + rng.uniform(-1, 1, 6), end_rotation=solved.end_rotations[0]
        )
        for leg, solved in zip(exact.description.legs, exact.kinematics.legs, strict=True)
    )
    robot = ParallelRobot(dataclasses.replace(exact.description, legs=legs))
    home = [leg.home for leg in robot.kinematics.legs]
    assert home[0][3] < 0 < home[1][3]
    for _ in range(10):
        z = robot.description.home + rng.uniform(-1, 1, 6) * [0.03, 0.03, 0.03, 0.1, 0.1, 0.1]
        found = robot.ik(z)
        assert found.assembly == "home"
        assert max(np.abs(q - start).max() for q, start in zip(found.q, home, strict=True)) < 1.5


@pytest.mark.slow
def test_poses_beyond_a_singular_one_are_said():
    robot = ParallelRobot(rod_delta())
    rng, z = np.random.default_rng(1), robot.description.home
    for _ in range(20):
        there = z + 0.6 * rng.uniform(-1, 1, 3)
        with contextlib.suppress(InputError):
            found = robot.ik(there)
            if found.assembly == "search":
                break
    assert found.assembly == "search"
    assert found.residual < 1e-10
    assert found.to_dict()["searched"] == [k + 1 for k in found.searched] != []
    with pytest.raises(SolverError, match="cannot be followed on the straight line from home"):
        robot.inverse_dynamics(there, np.zeros(3), np.zeros(3))
    near = robot.ik(z + 0.01)
    again = robot.ik(z + 0.02, near.q)
    assert (near.assembly, again.assembly) == ("home", "guess")


@pytest.mark.parametrize("name", ROBOTS)
def test_warm_start_needs_few_steps(name):
    robot = ROBOTS[name]
    z, _, _ = near_home(robot, 3)
    first = robot.ik(z)
    second = robot.ik(z + 0.005, first.q)
    assert second.residual < 1e-13
    assert second.iterations <= 6 * len(robot.description.legs)


@pytest.mark.parametrize("kind", KIND_NAMES)
def test_joint_rates_are_derivatives_of_the_positions(kind):
    robot, z, zd, zdd = random_robot(kind, 2)
    own = robot.passive(z, zd, zdd)
    h = 1e-4

    def at(t):
        found = robot.ik(z + zd * t + zdd * t**2 / 2, own.q)
        return np.concatenate(found.q)

    minus, middle, plus = at(-h), at(0), at(h)
    speed, acceleration = (plus - minus) / (2 * h), (plus - 2 * middle + minus) / h**2
    qd, qdd = np.concatenate(own.qd), np.concatenate(own.qdd)
    np.testing.assert_allclose(speed, qd, atol=1e-4 * max(1, np.abs(qdd).max()))
    np.testing.assert_allclose(acceleration, qdd, atol=2e-3 * max(1, np.abs(qdd).max()))
    J = robot.jacobian(z, own.q)
    s, _ = robot.kinematics.quasi(z, zd, zdd)
    motors = [own.qd[leg][joint] for leg, joint in robot.description.actuated]
    np.testing.assert_allclose(J @ s, motors, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", KIND_NAMES)
def test_forms_agree(kind):
    robot, z, zd, zdd = random_robot(kind, 4)
    q = [leg.home for leg in robot.kinematics.legs]
    sd = robot.kinematics.quasi(z, zd, zdd)[1]
    forces = robot.inverse_dynamics(z, zd, zdd, q)
    H = robot.kinematics.rate_matrices(z, zd)[0]
    terms = {form: robot.terms(z, zd, q, form=form) for form in ("S", "X", "Z", "A", "AA")}
    J = robot.jacobian(z, q)
    rates = robot.passive(z, zd, zdd, q)
    qadd = np.array([rates.qdd[leg][joint] for leg, joint in robot.description.actuated])
    assert relative(terms["S"].force(sd), forces.generalized) < 1e-10
    assert relative(terms["X"].force(zdd), forces.generalized) < 1e-10
    assert relative(terms["Z"].force(zdd), H.T @ forces.generalized) < 1e-10
    assert relative(terms["A"].force(sd), forces.motors) < 1e-10
    assert relative(terms["AA"].force(qadd), forces.motors) < 1e-10
    assert relative(J.T @ forces.motors, forces.generalized) < 1e-10
    for form in ("S", "Z", "AA"):
        M = terms[form].M
        assert np.abs(M - M.T).max() < 1e-10 * np.abs(M).max()
        assert np.linalg.eigvalsh(M)[0] > 0
    still = robot.terms(z, np.zeros(robot.m), q)
    assert np.abs(still.c).max() < 1e-12
    assert terms["S"].to_dict()["form"] == "S"
    np.testing.assert_allclose(robot.mass_matrix(z, q), terms["S"].M, atol=1e-12)


@pytest.mark.parametrize("kind", KIND_NAMES)
def test_forward_dynamics_inverts(kind):
    robot, z, zd, zdd = random_robot(kind, 6)
    q = [leg.home for leg in robot.kinematics.legs]
    wrench = np.random.default_rng(1).uniform(-5, 5, 6)
    s, sd = robot.kinematics.quasi(z, zd, zdd)
    motors = robot.inverse_dynamics(z, zd, zdd, q, wrench=wrench).motors
    found = robot.forward_dynamics(z, s, motors, q, wrench=wrench)
    np.testing.assert_allclose(found, sd, atol=1e-9 * np.abs(sd).max())
    free = robot.inverse_dynamics(z, zd, zdd, q).motors
    others = accelerations(robot, z, s, free, q)
    assert others.residual < 1e-9
    motion = robot.motion(z, s, q)
    np.testing.assert_allclose(others.twist, motion.T @ sd + motion.T_drift, atol=1e-8 * np.abs(sd).max())


@pytest.mark.parametrize("kind", KIND_NAMES)
def test_power_balance(kind):
    robot, z, zd, zdd = random_robot(kind, 8)
    h = 1e-3

    def energy(t):
        at = z + zd * t + zdd * t**2 / 2
        rate = zd + zdd * t
        s = robot.kinematics.rate_matrices(at, rate)[0] @ rate
        return sum(robot.energy(at, s, robot.ik(at, [leg.home for leg in robot.kinematics.legs]).q))

    slope = (8 * (energy(h) - energy(-h)) - (energy(2 * h) - energy(-2 * h))) / (12 * h)
    q = [leg.home for leg in robot.kinematics.legs]
    forces = robot.inverse_dynamics(z, zd, zdd, q)
    s, _ = robot.kinematics.quasi(z, zd, zdd)
    power = forces.motors @ robot.jacobian(z, q) @ s
    assert power == pytest.approx(forces.generalized @ s, rel=1e-10)
    assert slope == pytest.approx(power, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", some(1, ROBOTS))
def test_free_fall_keeps_the_energy(name):
    robot = ROBOTS[name]
    start = 0.3 * np.random.default_rng(2).uniform(-1, 1, robot.m)
    coarse = simulate(robot, robot.description.home, start, duration=0.04, step=0.004)
    assert coarse.energy_drift < 1e-7
    assert coarse.closure < 1e-12
    assert coarse.times[-1] == 0.04
    assert np.abs(coarse.z[-1] - coarse.z[0]).max() > 1e-3
    if name == "3RRR":  # the drift is the integrator's: it falls with the fourth power of the step
        fine = simulate(robot, robot.description.home, start, duration=0.04, step=0.002)
        assert fine.energy_drift < coarse.energy_drift / 8


def test_simulation_under_motor_forces_gains_their_work():
    robot = ROBOTS["Delta"]
    push = np.array([2.0, -1.0, 0.5])
    path = simulate(robot, robot.description.home, np.zeros(3), duration=0.05, step=0.005, motors=push)
    ends = [robot.ik(z).q for z in (path.z[0], path.z[-1])]
    turned = [ends[1][leg][joint] - ends[0][leg][joint] for leg, joint in robot.description.actuated]
    gained = path.energy[-1].sum() - path.energy[0].sum()
    assert gained == pytest.approx(push @ np.array(turned), rel=1e-6)
    same = simulate(
        robot, robot.description.home, np.zeros(3), duration=0.05, step=0.005, motors=lambda t, z, s: push
    )
    np.testing.assert_array_equal(same.z, path.z)


@pytest.mark.parametrize("make", some(1, [five_axes, redundant_leg, extra_leg]))
def test_energy_of_general_robots(make):
    robot = ParallelRobot(make())
    path = simulate(robot, robot.description.home, np.full(robot.m, 0.2), duration=0.02, step=0.002)
    assert path.energy_drift < 1e-7


def test_quasi_velocities_pass_the_euler_singularity():
    platform = dataclasses.replace(ups6().platform, convention="zxz")
    robot = ParallelRobot(dataclasses.replace(ups6(), platform=platform))
    z, rng = robot.description.home, np.random.default_rng(0)
    s, sd = rng.uniform(-1, 1, (2, 6))
    other = ParallelRobot(ups6()).inverse_dynamics(z, s, sd, rates="quasi").motors
    np.testing.assert_allclose(robot.inverse_dynamics(z, s, sd, rates="quasi").motors, other, rtol=1e-10)
    assert robot.singularity(z).kinds == ("representation",)


def test_bad_input_is_refused():
    robot = ROBOTS["Delta"]
    z, zero = robot.description.home, np.zeros(3)
    cases = [
        (lambda: robot.ik([0, 0, np.nan]), "z: contains NaN"),
        (lambda: robot.ik([0, 0]), "z: expected shape 3"),
        (lambda: robot.inverse_dynamics(z, zero, [1, 2]), "zdd: expected shape 3"),
        (lambda: robot.inverse_dynamics(z, zero, zero, rates="slow"), "rates: must be"),
        (lambda: robot.inverse_dynamics(z, zero, zero, wrench=[1, 2, 3]), "wrench: expected shape 6"),
        (lambda: robot.inverse_dynamics(z, zero, zero, q=[zero]), "q: expected one array per leg"),
        (lambda: robot.inverse_dynamics(z, zero, zero, q=[zero[:2]] * 3), r"q\[1\]: expected 5 or 3 numbers"),
        (lambda: robot.terms(z, zero, form="B"), "form: must be one of"),
        (lambda: robot.forward_dynamics(z, zero, [1.0]), "motors: expected shape 3"),
        (lambda: robot.base_parameters("guess"), "how: must be"),
        (lambda: robot.ik([0.3, 0.9, -0.5]), "leg 1 does not reach"),
        (lambda: ParallelRobot("delta"), "description: expected a RobotDescription"),
        (lambda: ParallelRobot(extra_leg()).terms([0, 0, 0.1], zero, form="A"), "as many motors"),
        (lambda: simulate(robot, z, zero, duration=-1, step=0.1), "duration: must be > 0"),
    ]
    for call, message in cases:
        with pytest.raises(InputError, match=message):
            call()


@pytest.mark.slow
def test_forward_kinematics_reports_failure():
    with pytest.raises(SolverError, match="no pose reached"):
        ROBOTS["3RPR"].fk([5.0, 0.1, 0.1])


def test_characteristic_length_is_the_radius_of_the_platform():
    assert characteristic_length(ROBOTS["Delta"].kinematics) == pytest.approx(0.15)
    home = ROBOTS["Delta"].singularity(delta().home)
    assert home.regular
    assert home.to_dict()["singular"] == []


@pytest.mark.parametrize("kind", some(1, KIND_NAMES))
def test_generated_function_equals_the_reference(kind):
    robot, z, zd, zdd = random_robot(kind, 3)
    q = [leg.home for leg in robot.kinematics.legs]
    s, sd = robot.kinematics.quasi(z, zd, zdd)
    columns = np.array([values[: leg.n] for values, leg in zip(q, robot.description.legs, strict=True)]).T
    generated = robot.lean(("tau", "J_a"), form="A")(z, s, sd, columns)
    own = robot.inverse_dynamics(z, zd, zdd, q)
    assert relative(generated["tau"], own.motors) < 1e-10
    assert relative(generated["J_a"], robot.jacobian(z, q)) < 1e-10


@pytest.mark.slow
def test_counts_and_base_parameters_are_reached_from_the_robot():
    robot = ROBOTS["3RRR"]
    assert robot.lean(form="A", dynpar=3).count.divisions < robot.lean(form="A").count.multiplications
    assert len(robot.base_parameters("leg").names) == 10
    assert robot.base_parameters("numeric").rank == 9


@pytest.mark.parametrize("kind", some(1, KIND_NAMES))
def test_regressor_is_linear_and_equals_the_generated_one(kind):
    robot, z, zd, zdd = random_robot(kind, 5)
    q = [leg.home for leg in robot.kinematics.legs]
    W = robot.regressor(z, zd, zdd, q)
    p = robot.description.inertia_vector
    assert relative(W @ p, robot.inverse_dynamics(z, zd, zdd, q).generalized) < 1e-10
    per_leg = W[:, :-10].reshape(robot.m, len(q), -1).sum(axis=1)  # all legs are equal
    s, sd = robot.kinematics.quasi(z, zd, zdd)
    columns = np.array([values[: leg.n] for values, leg in zip(q, robot.description.legs, strict=True)]).T
    generated = robot.lean(("W",), form="S")(z, s, sd, columns)["W"]
    assert relative(np.hstack([per_leg, W[:, -10:]]), generated) < 1e-10


@pytest.mark.parametrize("make", [five_axes, redundant_leg, extra_leg])
def test_regressor_of_general_robots(make):
    robot = ParallelRobot(make())
    z, zd, zdd = near_home(robot, 1)
    forces = robot.inverse_dynamics(z, zd, zdd)
    assert (
        relative(robot.regressor(z, zd, zdd) @ robot.description.inertia_vector, forces.generalized) < 1e-10
    )


def test_robot_survives_pickling():
    robot = ROBOTS["Delta"]
    copy = pickle.loads(pickle.dumps(robot))
    z, zd, zdd = near_home(robot, 0)
    np.testing.assert_array_equal(
        copy.inverse_dynamics(z, zd, zdd).motors, robot.inverse_dynamics(z, zd, zdd).motors
    )


def test_c_code_is_written(tmp_path):
    files = ROBOTS["3RRR"].codegen(tmp_path / "planar.c", dynpar=3)
    assert files.source.read_text().count("int ") > 1
    assert files.header.exists()
