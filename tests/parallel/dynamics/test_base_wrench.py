"""Wrench of a robot on its base against the change of its momentum."""

import numpy as np
import pytest

from ocptip.parallel.description.ready_made import delta
from ocptip.parallel.robot import ParallelRobot, base_wrench
from ocptip.robots.payload import Payload
from tests.parallel.parallel_cases import KIND_NAMES
from tests.parallel.parallel_examples import five_axes, redundant_leg
from tests.parallel.parallel_twin import Twin, random_robot, relative, rod_delta


@pytest.mark.parametrize("kind", KIND_NAMES)
def test_base_wrench_is_the_rate_of_momentum(kind):
    robot, z, zd, zdd = random_robot(kind, 9)
    q = [leg.home for leg in robot.kinematics.legs]
    expected = Twin(robot).base_wrench(z, zd, zdd)
    assert relative(base_wrench(robot, z, zd, zdd, q=q), expected) < 1e-11
    load = np.random.default_rng(0).uniform(-9, 9, 6)
    r, _ = robot.kinematics.pose(z)
    carried = np.concatenate([load[:3], load[3:] + np.cross(r, load[:3])])
    assert relative(base_wrench(robot, z, zd, zdd, q=q, load=load), expected + carried) < 1e-11


@pytest.mark.parametrize("make", [rod_delta, five_axes, redundant_leg])
def test_base_wrench_of_general_robots(make):
    robot = ParallelRobot(make())
    z = robot.description.home + 0.01
    zd, zdd = np.random.default_rng(1).uniform(-1, 1, (2, robot.m))
    assert relative(base_wrench(robot, z, zd, zdd), Twin(robot).base_wrench(z, zd, zdd)) < 1e-11


def test_at_rest_the_base_carries_the_weight():
    robot = ParallelRobot(delta().with_payload(Payload(0.5)))
    z = [0.1, 0.0, -0.45]
    wrench = base_wrench(robot, z, np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(wrench[:3], [0, 0, -9.81 * robot.description.moving_mass], atol=1e-12)
    assert robot.description.moving_mass == pytest.approx(1.0 + 3 * (0.8 + 0.2))
    assert wrench[4] > 0  # the load sits on the +x side: it turns the base from z to x
