"""Wrench of a robot on its base against the change of its momentum, and on a support."""

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError, SolverError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve
from ocptip.contact.support import Load, Support
from ocptip.parallel.base_wrench import MountedRobot, PlatformMotion, base_wrench, moving_mass
from ocptip.parallel.description.ready_made import delta, ups6
from ocptip.parallel.robot import ParallelRobot
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
    robot = ParallelRobot(delta(payload=0.5))
    z = [0.1, 0.0, -0.45]
    wrench = base_wrench(robot, z, np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(wrench[:3], [0, 0, -9.81 * moving_mass(robot)], atol=1e-12)
    assert moving_mass(robot) == pytest.approx(1.0 + 3 * (0.8 + 0.2))
    assert wrench[4] > 0  # the load sits on the +x side: it turns the base from z to x


def test_mounting_turns_and_shifts():
    robot = ParallelRobot(ups6())
    z, rng = robot.description.home, np.random.default_rng(2)
    zd, zdd = rng.uniform(-1, 1, (2, 6))
    turn = pin.exp3(np.array([0.3, -0.2, 0.9]))
    position, about = np.array([0.1, 0.2, 0.7]), np.array([0.0, 0.1, 0.2])
    gravity = np.array([0.4, 0.1, -9.7])
    mounted = MountedRobot(robot, position=position, rotation=turn, about=about, gravity=gravity)
    own = base_wrench(robot, z, zd, zdd, gravity=turn.T @ gravity)
    placed = pin.SE3(turn, position - about).act(pin.Force(own[:3], own[3:]))
    np.testing.assert_allclose(mounted.wrench(z, zd, zdd), placed.vector, rtol=1e-12)
    np.testing.assert_allclose(MountedRobot(robot, rotation=turn).gravity, turn @ robot.description.gravity)


def test_samples_feed_a_support():
    robot = ParallelRobot(delta())
    feet = [
        UnilateralContact(position=[0.5 * np.cos(a), 0.5 * np.sin(a), 0.0], friction=0.6)
        for a in np.deg2rad([90, 210, 330])
    ]
    support = Support(feet, mass=20.0, center_of_mass=[0, 0, 0.4])
    mounted = MountedRobot(robot, position=[0, 0, 1.0], about=support.center_of_mass, gravity=support.gravity)
    t = np.linspace(0, 0.5, 6)
    z = np.column_stack([0.1 * np.sin(4 * t), 0 * t, -0.45 + 0 * t])
    zd = np.column_stack([0.4 * np.cos(4 * t), 0 * t, 0 * t])
    zdd = np.column_stack([-1.6 * np.sin(4 * t), 0 * t, 0 * t])
    samples = mounted.samples(PlatformMotion(t, z, zd, zdd))
    assert samples.motors.shape == (6, 3)
    assert np.all(samples.platform_measure > 0.1)
    own = robot.inverse_dynamics(z[2], zd[2], zdd[2]).motors
    np.testing.assert_allclose(samples.motors[2], own, rtol=1e-9)
    state = solve(support, samples.wrenches[2] + support.weight)
    assert state.persistent
    # The same wrench as a load of the scene: force at the robot's origin and moment.
    at_origin = base_wrench(robot, z[2], zd[2], zdd[2])
    as_load = support.wrench([Load(force=at_origin[:3], moment=at_origin[3:], point=[0, 0, 1.0])])
    np.testing.assert_allclose(as_load, samples.wrenches[2] + support.weight, atol=1e-9)
    pushed = solve(support, support.wrench([Load(force=[400, 0, 0], point=[0, 0, 1.0])]))
    assert not pushed.persistent


def test_bad_motions_are_refused():
    robot = ParallelRobot(delta())
    with pytest.raises(InputError, match="zd: expected shape"):
        PlatformMotion([0.0, 1.0], np.zeros((2, 3)), np.zeros((1, 3)), np.zeros((2, 3)))
    with pytest.raises(InputError, match="has 2 coordinates, the robot has 3"):
        MountedRobot(robot).samples(PlatformMotion([0.0], [[0, 0]], [[0, 0]], [[0, 0]]))
    with pytest.raises(InputError, match="rotation: not a rotation"):
        MountedRobot(robot, rotation=np.zeros((3, 3)))
    similar = ParallelRobot(ups6(gap=np.pi / 3))
    still = PlatformMotion([0.0], similar.description.home[None], np.zeros((1, 6)), np.zeros((1, 6)))
    with pytest.raises(SolverError, match="type II"):
        MountedRobot(similar).samples(still)
