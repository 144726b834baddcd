"""Parallel robots on a support in numbers alone: wrenches, samples, refusals, robots without closed form."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from ocptip.basics.errors import InputError, SolverError
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import solve
from ocptip.contact.support import Load, Support
from ocptip.motion.check import check_motion
from ocptip.parallel.description.ready_made import delta, rpr3, ups6
from ocptip.parallel.dynamics.base_wrench import base_wrench
from ocptip.parallel.robot import ParallelRobot
from ocptip.robots.motors import DCMotors
from ocptip.standing.platform import NumericParallelRobot, PlatformLimits, StandingParallelRobot
from ocptip.trajectories.ramps import RampCommand
from ocptip.trajectories.trajectory import Trajectory
from tests.parallel.parallel_examples import five_axes, redundant_leg
from tests.parallel.parallel_twin import rod_delta
from tests.quick import some


def cart(**options):
    feet = [
        UnilateralContact(position=[0.5 * np.cos(a), 0.5 * np.sin(a), 0.0], friction=0.6)
        for a in np.deg2rad([90, 210, 330])
    ]
    return Support(feet, **{"mass": 20.0, "center_of_mass": [0, 0, 0.4], **options})


def ideal_motors(n):
    return DCMotors(np.ones(n), *np.zeros((3, n)))


def numeric(robot, support=None, kind=NumericParallelRobot, **options):
    motors = ideal_motors(len(robot.description.actuated))
    return kind(robot, support or cart(), motors, PlatformLimits(), **options)


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
    mounted = numeric(robot, support, position=position, rotation=turn)
    own = base_wrench(robot, z, zd, zdd, gravity=turn.T @ gravity)
    placed = pin.SE3(turn, position - about).act(pin.Force(own[:3], own[3:]))
    wrench = mounted.loads(z[None], zd[None], zdd[None])[1][0] - support.weight
    np.testing.assert_allclose(wrench, placed.vector, rtol=1e-12, atol=1e-12)


def test_samples_feed_a_support():
    robot, support = ParallelRobot(delta()), cart()
    mounted = numeric(robot, position=[0, 0, 1.0])
    t, z, zd, zdd = swinging(6)
    samples = mounted.samples_of(t, z, zd, zdd)
    assert samples.torques.shape == (6, 3)
    assert samples.further_names[0] == "singularity_platform"
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


def test_samples_are_those_of_the_closed_form():
    robot = ParallelRobot(delta())
    load = np.array([5.0, -3.0, 2.0, 0.0, 0.0, 0.0])
    states = swinging(4)
    for given in (None, load):
        ours, theirs = (
            numeric(robot, kind=kind, position=[0, 0, 1.0], load=given).samples_of(*states)
            for kind in (NumericParallelRobot, StandingParallelRobot)
        )
        np.testing.assert_allclose(ours.torques, theirs.torques, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(ours.wrenches, theirs.wrenches, rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(ours.further[:, 1:], theirs.further[:, -3:], rtol=1e-9, atol=1e-9)


def test_load_on_the_platform_reaches_the_base():
    robot, load = ParallelRobot(ups6()), np.array([30.0, -20.0, 50.0, 4.0, -5.0, 6.0])
    z, still = robot.description.home[None] + 0.03, np.zeros((1, 6))
    for kind in (NumericParallelRobot, StandingParallelRobot):
        with_load, without = (
            numeric(robot, kind=kind, load=given).loads(z, still, still) for given in (load, None)
        )
        difference = (with_load[1] - without[1])[0]
        r = robot.kinematics.pose(z[0])[0] - cart().center_of_mass
        expected = np.concatenate([load[:3], load[3:] + np.cross(r, load[:3])])
        np.testing.assert_allclose(difference, expected, atol=1e-9)
        motors = robot.inverse_dynamics(z[0], still[0], still[0], wrench=load).motors
        np.testing.assert_allclose(with_load[0][0], motors, rtol=1e-9)


def test_bad_motions_are_refused():
    robot = ParallelRobot(delta())
    with pytest.raises(InputError, match="speeds: expected shape"):
        numeric(robot).samples_of([0.0, 1.0], np.zeros((2, 3)), np.zeros((1, 3)), np.zeros((2, 3)))
    with pytest.raises(InputError, match="has 2 joints, the robot has 3"):
        numeric(robot).samples_of([0.0], [[0, 0]], [[0, 0]], [[0, 0]])
    with pytest.raises(InputError, match="rotation: not a rotation"):
        numeric(robot, rotation=np.zeros((3, 3)))
    similar = ParallelRobot(ups6(gap=np.pi / 3), check=False)
    with pytest.raises(SolverError, match="type II"):
        numeric(similar).samples_of([0.0], similar.description.home[None], np.zeros((1, 6)), np.zeros((1, 6)))
    with pytest.raises(InputError, match="in numbers alone"):
        numeric(robot).load_expressions(*[None] * 3)


def test_singular_poses_between_samples_are_refused():
    flat = ParallelRobot(rpr3(twist=0.0))
    path = np.array([[0.01, 0.0, phi] for phi in (-0.3, -0.1, 0.12, 0.3)])
    with pytest.raises(SolverError, match=r"between samples 2 and 3: platform \(type II\)"):
        numeric(flat).samples_of(np.arange(4.0), path, 0 * path, 0 * path)


@pytest.mark.parametrize("make", some(1, [rod_delta, five_axes, redundant_leg]))
def test_general_robots_stand_and_are_checked(make):
    """Inner loops, motors behind the coupling points, redundant joints."""
    robot = ParallelRobot(make())
    standing = numeric(robot, cart(mass=2000.0))
    home = robot.description.home
    assert len(standing.names) == len(standing.units) == robot.m
    commands = [[RampCommand(value + 0.01, 0.1, 1.0)] for value in home]
    motion = Trajectory.from_profiles(home, commands)
    checked = check_motion(standing, motion, step=0.05)
    assert checked.stands
    z, zd, zdd = motion.states(np.array([0.05]))
    forces, wrenches = standing.loads(z, zd, zdd)
    g = standing.support.gravity
    np.testing.assert_allclose(
        forces[0], robot.inverse_dynamics(z[0], zd[0], zdd[0], gravity=g).motors, rtol=1e-9, atol=1e-9
    )
    own = base_wrench(robot, z[0], zd[0], zdd[0], gravity=g)
    np.testing.assert_allclose((wrenches[0] - standing.support.weight)[:3], own[:3], rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_redundant_drives_are_checked():
    """A planar robot with one more motor: the smallest forces, a limit for each."""
    robot = ParallelRobot(rpr3_with_four_motors())
    limits = PlatformLimits(motor_force=[1e3, 1e3, 1e3, 1e-3])
    standing = NumericParallelRobot(robot, cart(mass=500.0), ideal_motors(4), limits)
    home = robot.description.home
    motion = Trajectory.from_profiles(home, [[RampCommand(value + 0.01, 0.1, 1.0)] for value in home])
    samples = standing.samples(motion, np.linspace(0.01, motion.end - 0.01, 3))
    assert samples.torques.shape == samples.powers.shape == (3, 4)
    checked = check_motion(standing, motion, step=0.05)
    assert checked.worst["torque_ratio"].detail == "joint 4"
    assert checked.energy > 0


def rpr3_with_four_motors():
    description = rpr3()
    return replace(description, actuated=(*description.actuated, (0, 0)))
