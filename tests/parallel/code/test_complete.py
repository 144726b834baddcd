"""Generated code with complete legs against the numeric robot, and of serial arms against their recursion."""

import dataclasses
import subprocess

import casadi as cs
import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.parallel.code.codegen import write_c
from ocptip.parallel.code.complete import complete_function, complete_joints, newton_function
from ocptip.parallel.code.lean_arm import lean_arm
from ocptip.parallel.code.leg_plans import count_operations
from ocptip.parallel.description.platform import BodyInertia, Platform
from ocptip.parallel.description.ready_made import READY_MADE, ups6
from ocptip.parallel.description.robot_description import MDHRow, RobotDescription, SerialLeg
from ocptip.parallel.robot import ParallelRobot
from ocptip.published.arms import arm_names, load_arm
from ocptip.robots.dynamics import inverse_dynamics
from tests.oracles.parallel_routes.forces import forces_by
from tests.parallel.code.test_codegen import COMPILER
from tests.parallel.parallel_examples import QUARTER, five_axes, prr3, redundant_leg, spu6
from tests.parallel.test_dependent_coordinates import MECHANISMS, robot_of, state_of
from tests.quick import some


def spherical() -> RobotDescription:
    """Three legs of three joints whose axes all meet in one point: the platform only turns."""
    rows = (MDHRow(), MDHRow(alpha=QUARTER), MDHRow(alpha=QUARTER))
    bodies = tuple(
        BodyInertia.about_center(0.3 + 0.1 * k, (0.05, 0.02 * k, 0.1), (2e-3, 3e-3, 4e-3)) for k in range(2)
    )
    turns = ((("y", QUARTER),), (("x", -QUARTER),), ())
    legs = tuple(
        SerialLeg(rows, 1, bodies, base_rotation=turn, guess=(0.3, 0.9, 0.5 + 0.2 * k))
        for k, turn in enumerate(turns)
    )
    platform = Platform(
        (0, 0, 0, 1, 1, 1), "xyz", BodyInertia.about_center(1.0, (0, 0.1, 0.2), (0.02, 0.03, 0.01))
    )
    return RobotDescription("spherical", legs, platform, ((0, 0), (1, 0), (2, 0)), np.zeros(3))


def driven_behind() -> RobotDescription:
    """3RPR with a motor behind the coupling point and friction there."""
    robot = READY_MADE["3RPR"]()
    legs = [
        dataclasses.replace(leg, viscous=(0.1, 0.2, 0.3), drive_inertia=(0.0, 0.4, 0.1)) for leg in robot.legs
    ]
    return dataclasses.replace(robot, legs=tuple(legs), actuated=((0, 1), (1, 1), (2, 2)))


ROBOTS = {
    "3T2R": lambda: five_axes(coupling_mass=True),
    "6SPU": spu6,
    "3PRR": prr3,
    "6UPS": ups6,
    "spherical": spherical,
    "driven behind": driven_behind,
    "redundant": redundant_leg,
}


def robot_for(name: str) -> ParallelRobot:
    return ParallelRobot(ROBOTS[name]()) if name in ROBOTS else robot_of(name)


@pytest.mark.parametrize("name", some(1, [*ROBOTS, *MECHANISMS]))
def test_complete_code_is_the_numeric_robot(name):
    robot, rng = robot_for(name), np.random.default_rng(2)
    function = complete_function(robot, ("tau", "J_a", "qd", "qdd"))
    joints = newton_function(robot.kinematics)
    home = robot.description.home
    start = complete_joints(robot.kinematics, home, robot.ik(home).q)
    for _ in range(3):
        z = robot.description.home + 0.05 * rng.uniform(-1, 1, robot.m)
        zd, zdd = rng.uniform(-1, 1, (2, robot.m))
        rates = robot.passive(z, zd, zdd)
        q = complete_joints(robot.kinematics, z, rates.q)
        by_newton, residual = joints(z, start)
        np.testing.assert_allclose(np.array(by_newton).ravel(), q, atol=1e-9)
        assert float(residual) < 1e-11
        found = function(z, zd, zdd, q[:, None])
        expected = forces_by("multipliers", robot, z, zd, zdd, rates.q).motors
        np.testing.assert_allclose(found["tau"], expected, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_allclose(found["J_a"], robot.jacobian(z, rates.q), atol=1e-9)
        np.testing.assert_allclose(found["qd"].ravel(), np.concatenate(rates.qd), atol=1e-8)
        np.testing.assert_allclose(found["qdd"].ravel(), np.concatenate(rates.qdd), atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", some(1, sorted(set(MECHANISMS) - {"sps6"}))
)  # spins keep their places, not speeds
def test_rates_of_code_are_differences_of_its_joints(name):
    robot = robot_of(name)
    function, joints = complete_function(robot, ("qd", "qdd")), newton_function(robot.kinematics)
    home, h = robot.description.home, 1e-4
    zd, zdd = np.random.default_rng(4).uniform(-1, 1, (2, robot.m))
    middle = np.array(joints(home, complete_joints(robot.kinematics, home, robot.ik(home).q))[0]).ravel()
    found = function(home, zd, zdd, middle[:, None])
    after, before = (np.array(joints(home + t * zd + t * t / 2 * zdd, middle)[0]).ravel() for t in (h, -h))
    n = len(found["qd"])
    np.testing.assert_allclose(found["qd"].ravel(), ((after - before) / (2 * h))[:n], atol=1e-6)
    bends = ((after - 2 * middle + before) / h**2)[:n]
    np.testing.assert_allclose(found["qdd"].ravel(), bends, atol=1e-6 * max(1, np.abs(bends).max()))


@pytest.mark.skipif(COMPILER is None, reason="no C compiler on this machine")
@pytest.mark.parametrize("name", some(1, ["five_bar", "tricept", "sps6"]))
def test_compiled_joints_and_forces_are_those_of_python(name, tmp_path):
    """Nothing but z, z' and z'' comes from outside."""
    robot = robot_of(name)
    forces, joints = complete_function(robot), newton_function(robot.kinematics)
    files = write_c([joints, forces], tmp_path / "robot.c")
    assert "malloc" not in files.source.read_text()
    library = files.source.with_suffix(".so")
    subprocess.run([COMPILER, "-O1", "-shared", "-fPIC", files.source, "-o", library, "-lm"], check=True)
    c_joints, c_forces = (cs.external(one, str(library)) for one in ("joints", "tau_a"))
    home = robot.description.home
    q = complete_joints(robot.kinematics, home, robot.ik(home).q)
    for z, zd, zdd in (state_of(robot, seed) for seed in range(3)):
        q, residual = c_joints(z, q)
        assert float(residual) < 1e-11
        tau = np.array(c_forces(z, zd, zdd, q, np.zeros((0, 1)), forces.inertia, forces.gravity)).ravel()
        expected = robot.inverse_dynamics(z, zd, zdd).motors
        np.testing.assert_allclose(tau, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_a_residual_tells_that_a_pose_is_out_of_reach():
    robot = robot_of("five_bar")
    joints, home = newton_function(robot.kinematics), robot.description.home
    q = complete_joints(robot.kinematics, home, robot.ik(home).q)
    assert float(joints([0.0, 0.7], q)[1]) > 0.01


@pytest.mark.slow
def test_a_robot_generates_complete_code_by_itself(tmp_path):
    """Where joints behind the coupling points take part; forms that this code lacks are refused."""
    robot = ParallelRobot(driven_behind())
    assert robot.complete_legs
    assert robot.lean(form="A").count == complete_function(robot).count
    assert robot.codegen(tmp_path / "code.c", ("tau",)).source.exists()
    assert robot.lean(dynpar=3).dynpar == 3
    for option in ({"form": "S"}, {"dynpar": 1}, {"euler": True}):
        with pytest.raises(
            InputError, match=f"joints behind the coupling points .* not {next(iter(option))}"
        ):
            robot.lean(**option)


@pytest.mark.slow
@pytest.mark.parametrize("name", some(1, ["five_bar", "exechon", "sps6"]))
def test_base_parameters_of_the_whole_robot_have_the_same_forces(name):
    """DynPar 3: fewer parameters and operations, the same forces; W is their regressor."""
    robot = robot_of(name)
    base = robot.base_parameters("numeric")
    assert base.gap > 8
    function, full = complete_function(robot, ("tau", "W"), base=base, dynpar=3), complete_function(robot)
    for seed in range(2):
        z, zd, zdd = state_of(robot, seed)
        q = complete_joints(robot.kinematics, z, robot.ik(z).q)[:, None]
        found, expected = function(z, zd, zdd, q), full(z, zd, zdd, q)["tau"]
        np.testing.assert_allclose(found["tau"], expected, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_allclose(
            found["W"] @ function.inertia, expected, atol=1e-9 * np.abs(expected).max()
        )


def more_motors() -> ParallelRobot:
    robot = driven_behind()
    return ParallelRobot(dataclasses.replace(robot, actuated=(*robot.actuated, (0, 2))))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: robot_of("delta_parallelograms"), "leg 1 is branched or has closed loops"),
        (more_motors, "4 motors move 3 coordinates"),
    ],
)
def test_what_has_no_code_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        complete_function(make())


@pytest.mark.parametrize("name", [*arm_names(), "slides"])
def test_lean_arm_is_the_recursion(name):
    """Torques and wrench on the base of published arms, in another base frame, with fewer operations."""
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    arm = load_arm("FSFS" if name == "slides" else name).mounted((0.1, -0.2, 0.3), turn)
    if name == "slides":
        sliding = np.arange(arm.n) % 3 == 0
        arm = dataclasses.replace(arm, prismatic=sliding, armature=np.linspace(0.1, 0.2, arm.n))
    function, rng = lean_arm(arm), np.random.default_rng(5)
    q, qd, qdd = rng.uniform(-2, 2, (3, arm.n))
    gravity = np.array([0.3, -0.4, -9.7])
    reference = inverse_dynamics(arm)
    torque, wrench = reference(q, qd, qdd, gravity, np.zeros(3), np.zeros(3), np.zeros(3))
    ours = function(q, qd, qdd, gravity)
    for found, expected in zip(ours, (torque, wrench), strict=True):
        expected = np.array(expected)
        np.testing.assert_allclose(np.array(found), expected, atol=1e-11 * np.abs(expected).max())
    plain = cs.Function(
        "plain",
        [*(symbols := [cs.SX.sym(f"x{k}", arm.n) for k in range(3)]), g := cs.SX.sym("g", 3)],
        cs.cse(list(reference(*symbols, g, cs.SX.zeros(3), cs.SX.zeros(3), cs.SX.zeros(3)))),
    )
    assert count_operations(function).weighted < 0.9 * count_operations(plain).weighted
