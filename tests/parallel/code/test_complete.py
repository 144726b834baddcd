"""Generated code with complete legs against the numeric robot, and of serial arms against their recursion."""

import dataclasses

import casadi as cs
import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.parallel.code.complete import complete_function
from ocptip.parallel.code.counting import count_operations
from ocptip.parallel.code.lean_arm import lean_arm
from ocptip.parallel.description.body_inertia import BodyInertia
from ocptip.parallel.description.ready_made import READY_MADE, ups6
from ocptip.parallel.description.robot_description import Leg, MDHRow, Platform, RobotDescription
from ocptip.parallel.robot import ParallelRobot
from ocptip.published.arms import arm_names, load_arm
from ocptip.robots.dynamics import inverse_dynamics
from tests.parallel.parallel_examples import QUARTER, five_axes, prr3, redundant_leg, spu6
from tests.parallel.test_dependent_coordinates import robot_of


def spherical() -> RobotDescription:
    """Three legs of three joints whose axes all meet in one point: the platform only turns."""
    rows = (MDHRow(), MDHRow(alpha=QUARTER), MDHRow(alpha=QUARTER))
    bodies = tuple(
        BodyInertia.about_center(0.3 + 0.1 * k, (0.05, 0.02 * k, 0.1), (2e-3, 3e-3, 4e-3)) for k in range(2)
    )
    turns = ((("y", QUARTER),), (("x", -QUARTER),), ())
    legs = tuple(
        Leg(rows, 1, bodies, base_rotation=turn, guess=(0.3, 0.9, 0.5 + 0.2 * k))
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
}


@pytest.mark.parametrize("name", ROBOTS)
def test_complete_code_is_the_numeric_robot(name):
    robot, rng = ParallelRobot(ROBOTS[name]()), np.random.default_rng(2)
    function = complete_function(robot, ("tau", "J_a", "qd", "qdd"))
    for _ in range(3):
        z = robot.description.home + 0.05 * rng.uniform(-1, 1, robot.m)
        zd, zdd = rng.uniform(-1, 1, (2, robot.m))
        rates = robot.passive(z, zd, zdd)
        found = function(z, zd, zdd, np.concatenate(rates.q)[:, None])
        expected = robot.inverse_dynamics(z, zd, zdd, rates.q, projection="kkt").motors
        np.testing.assert_allclose(found["tau"], expected, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_allclose(found["J_a"], robot.jacobian(z, rates.q), atol=1e-9)
        np.testing.assert_allclose(found["qd"].ravel(), np.concatenate(rates.qd), atol=1e-8)
        np.testing.assert_allclose(found["qdd"].ravel(), np.concatenate(rates.qdd), atol=1e-7)


def test_a_robot_generates_complete_code_by_itself(tmp_path):
    """Where joints behind the coupling points take part; forms that this code lacks are refused."""
    robot = ParallelRobot(driven_behind())
    assert robot.complete_legs
    assert robot.op_count() == complete_function(robot).count
    assert robot.codegen(tmp_path / "code.c", ("tau",)).source.exists()
    for option in ({"form": "S"}, {"dynpar": 3}, {"euler": True}):
        with pytest.raises(InputError, match=f"{next(iter(option))}: joints behind the coupling points"):
            robot.lean(**option)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: robot_of("rps3"), r"dependent coordinates \(x, y, phi3\)"),
        (lambda: robot_of("sps6"), "leg 1 has idle freedoms"),
        (lambda: ParallelRobot(redundant_leg()), "joints are redundant"),
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
