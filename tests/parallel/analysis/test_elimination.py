"""Elimination order of many coupled motors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ocptip.parallel.analysis.singularity import elimination_order
from ocptip.parallel.code.lean import lean_function
from ocptip.parallel.description.platform import Parameter
from ocptip.parallel.description.ready_made import READY_MADE, prrr4, ups6
from ocptip.parallel.robot import ParallelRobot
from tests.parallel.parallel_cases import error, golden
from tests.quick import some


def test_order_is_a_permutation():
    for make in READY_MADE.values():
        robot = make()
        order = elimination_order(robot)
        assert sorted(order) == list(range(len(robot.actuated)))
        if robot.m <= 3:
            assert order == tuple(range(robot.m))


@pytest.mark.slow
def test_every_order_gives_the_same_forces():
    case = golden("6UPS")
    motors = case.robot.actuated
    for shift in (2,):
        robot = dataclasses.replace(case.robot, actuated=motors[shift:] + motors[:shift])
        found = lean_function(robot, form="A", euler=True)(case.z, case.zd, case.zdd, case.q)["tau"]
        assert error(np.roll(found, shift), case.expected["tau_a"]) < 1e-9


def test_first_three_force_lines_are_far_from_a_plane_at_home():
    """The first pivot of the generated solution is their determinant."""
    robot = ups6()
    home = ParallelRobot(robot)
    lines = home.jacobian(robot.home)[:, :3]
    order = elimination_order(robot)
    assert abs(np.linalg.det(lines[list(order[:3])])) > 0.01


def test_home_out_of_reach_falls_back_to_the_natural_order():
    robot = prrr4()
    far = tuple(
        dataclasses.replace(leg, base_position=(Parameter(f"far{i}", 50.0), 0.0, 0.0))
        for i, leg in enumerate(robot.legs)
    )
    assert elimination_order(dataclasses.replace(robot, legs=far)) == (0, 1, 2, 3)


@pytest.mark.slow
@pytest.mark.parametrize("name", some(1, ["4PRRR", "6UPS"]))
def test_forces_at_home(name):
    robot = READY_MADE[name]()
    full = ParallelRobot(robot)
    s, sd = np.full((2, robot.m), 0.3)
    q = full.kinematics.point_joints(robot.home).q
    found = lean_function(robot, form="A")(robot.home, s, sd, np.column_stack(q))["tau"]
    expected = full.inverse_dynamics(robot.home, s, sd, q, rates="quasi").motors
    assert error(found, expected) < 1e-10
