"""Parallel robots on a support: wrenches, samples, refusals."""

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve
from ocptip.contact.support import Load, Support
from ocptip.parallel.description.ready_made import delta, ups6
from ocptip.parallel.robot import ParallelRobot, base_wrench
from ocptip.robots.motors import DCMotors
from ocptip.standing.platform import PlatformLimits, StandingParallelRobot
from tests.oracles.numeric_platform import numeric_loads


def cart(**options):
    feet = [
        UnilateralContact(position=[0.5 * np.cos(a), 0.5 * np.sin(a), 0.0], friction=0.6)
        for a in np.deg2rad([90, 210, 330])
    ]
    return Support(feet, **{"mass": 20.0, "center_of_mass": [0, 0, 0.4], **options})


def ideal_motors(n):
    return DCMotors(np.ones(n), *np.zeros((3, n)))


def mounted_robot(robot, support=None, **options):
    motors = ideal_motors(len(robot.description.actuated))
    return StandingParallelRobot(robot, support or cart(), motors, PlatformLimits(), **options)


def swinging(count):
    """Times and states of a Delta that swings along x."""
    t = np.linspace(0, 0.5, count)
    z = np.column_stack([0.1 * np.sin(4 * t), 0 * t, -0.45 + 0 * t])
    zd = np.column_stack([0.4 * np.cos(4 * t), 0 * t, 0 * t])
    zdd = np.column_stack([-1.6 * np.sin(4 * t), 0 * t, 0 * t])
    return t, z, zd, zdd


def test_mounting_turns_and_shifts():
    robot = ParallelRobot(ups6())
    z, rng = robot.description.home, np.random.default_rng(2)
    zd, zdd = rng.uniform(-1, 1, (2, 6))
    turn = pin.exp3(np.array([0.3, -0.2, 0.9]))
    position, about = np.array([0.1, 0.2, 0.7]), np.array([0.0, 0.1, 0.2])
    gravity = np.array([0.4, 0.1, -9.7])
    support = cart(center_of_mass=about, gravity=gravity)
    mounted = mounted_robot(robot, support, position=position, rotation=turn)
    own = base_wrench(robot, z, zd, zdd, gravity=turn.T @ gravity)
    placed = pin.SE3(turn, position - about).act(pin.Force(own[:3], own[3:]))
    wrench = mounted.loads(z[None], zd[None], zdd[None])[1][0] - support.weight
    np.testing.assert_allclose(wrench, placed.vector, rtol=1e-12, atol=1e-12)


def test_samples_feed_a_support():
    robot, support = ParallelRobot(delta()), cart()
    mounted = mounted_robot(robot, position=[0, 0, 1.0])
    t, z, zd, zdd = swinging(6)
    samples = mounted.samples_of(t, z, zd, zdd)
    assert samples.torques.shape == (6, 3)
    assert "singularity_platform" in samples.further_names
    assert np.all(samples.further[:, 0] > 0.1)
    own = robot.inverse_dynamics(z[2], zd[2], zdd[2]).motors
    np.testing.assert_allclose(samples.torques[2], own, rtol=1e-9)
    assert samples.states[2].persistent
    # The same wrench as a load of the scene: force at the robot's origin and moment.
    at_origin = base_wrench(robot, z[2], zd[2], zdd[2])
    as_load = support.wrench([Load(force=at_origin[:3], moment=at_origin[3:], point=[0, 0, 1.0])])
    np.testing.assert_allclose(as_load, samples.wrenches[2], atol=1e-9)
    pushed = solve(support, support.wrench([Load(force=[400, 0, 0], point=[0, 0, 1.0])]))
    assert not pushed.persistent


@pytest.mark.slow
def test_loads_are_those_of_searched_joints():
    robot, load = ParallelRobot(delta()), np.array([5.0, -3.0, 2.0, 0.0, 0.0, 0.0])
    _, *states = swinging(4)
    for given in (None, load):
        mounted = mounted_robot(robot, position=[0, 0, 1.0], load=given)
        for ours, theirs in zip(mounted.loads(*states), numeric_loads(mounted, *states), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-8)


@pytest.mark.slow
def test_load_on_the_platform_reaches_the_base():
    robot, load = ParallelRobot(ups6()), np.array([30.0, -20.0, 50.0, 4.0, -5.0, 6.0])
    z, still = robot.description.home[None] + 0.03, np.zeros((1, 6))
    with_load, without = (mounted_robot(robot, load=given).loads(z, still, still) for given in (load, None))
    r = robot.kinematics.pose(z[0])[0] - cart().center_of_mass
    expected = np.concatenate([load[:3], load[3:] + np.cross(r, load[:3])])
    np.testing.assert_allclose((with_load[1] - without[1])[0], expected, atol=1e-9)
    motors = robot.inverse_dynamics(z[0], still[0], still[0], wrench=load).motors
    np.testing.assert_allclose(with_load[0][0], motors, rtol=1e-9)


@pytest.mark.slow
def test_bad_motions_are_refused():
    robot = ParallelRobot(delta())
    with pytest.raises(InputError, match="speeds: expected shape"):
        mounted_robot(robot).samples_of([0.0, 1.0], np.zeros((2, 3)), np.zeros((1, 3)), np.zeros((2, 3)))
    with pytest.raises(InputError, match="has 2 joints, the robot has 3"):
        mounted_robot(robot).samples_of([0.0], [[0, 0]], [[0, 0]], [[0, 0]])
    with pytest.raises(InputError, match="rotation: not a rotation"):
        mounted_robot(robot, rotation=np.zeros((3, 3)))
