"""The cheapest timing: bounds, exact energy, limits of time, what viscous friction changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.motion.objective import ENERGY, priced
from ocptip.retiming.drives import QuadraticDrives
from ocptip.retiming.retime import retime
from ocptip.robots.motors import DCMotors
from ocptip.standing.limits import Limits
from tests.quick import some
from tests.retiming.paths import arm_of, cart, random_path, tripod


def robot_with(regeneration: float, standby: float, viscous: float = 1.0):
    task = tripod()
    motors = DCMotors.estimated(arm_of(task.robot).arm, regeneration=regeneration, standby=standby)
    return task, task.robot.varied(motors=replace(motors, viscous=viscous * motors.viscous))


@pytest.mark.parametrize(("regeneration", "standby"), some(1, [(0.4, 2.0), (1.0, 0.0), (0.0, 0.1)]))
def test_cheaper_than_every_slower_and_faster(regeneration, standby):
    task, robot = robot_with(regeneration, standby, viscous=0.0)
    path = random_path(task, 1, 0.1)
    found = retime(robot, path, Limits(), ENERGY, nodes=80)
    assert found.verified
    assert found.cheapest.gap < 1e-6
    energy = robot.energy(found.motion)
    assert energy == pytest.approx(found.cheapest.cost, rel=3e-3)
    fast = retime(robot, path, nodes=80).motion
    for factor in np.linspace(1, 3, 15):
        assert robot.energy(fast.time_scaled(factor)) > energy * (1 - 2e-3)


def test_time_price_and_longest_duration():
    task, robot = robot_with(1.0, 0.0)
    path = random_path(task, 1, 0.1)
    ends = [retime(robot, path, Limits(), goal, nodes=80) for goal in (ENERGY, priced(5.0), priced(500.0))]
    durations = [found.motion.end for found in ends]
    assert durations[0] > durations[1] > durations[2]
    assert durations[2] == pytest.approx(ends[2].fastest, rel=0.05)
    longest = 0.5 * (durations[0] + durations[2])
    bounded = retime(robot, path, Limits(max_duration=longest), ENERGY, nodes=80)
    assert bounded.verified
    assert longest * 0.999 < bounded.motion.end <= longest
    assert robot.energy(bounded.motion) > robot.energy(ends[0].motion)
    with pytest.raises(InputError, match="the fastest timing takes"):
        retime(robot, path, Limits(max_duration=0.1), ENERGY)


def test_viscous_friction_that_outweighs_all_else():
    task, robot = robot_with(1.0, 0.0, viscous=30.0)
    path = random_path(task, 1, 0.1)
    found = retime(robot, path, Limits(), priced(1.0), nodes=60)
    assert found.verified
    assert found.cheapest.gap < 1e-2
    assert found.motion.end > 1.2 * found.fastest
    slower = found.motion.time_scaled(1.05)
    assert robot.energy(slower) + slower.end >= (robot.energy(found.motion) + found.motion.end) * (1 - 2e-3)


@pytest.mark.slow
def test_measured_maps_have_a_lower_bound():
    task = tripod()
    path = random_path(task, 1, 0.1)
    found = retime(task.robot, path, Limits(), ENERGY, nodes=60)
    energy = task.robot.energy(found.motion)
    assert found.verified
    assert energy == pytest.approx(found.cheapest.cost, rel=3e-3)
    assert found.cheapest.lower_bound < energy
    assert found.cheapest.gap < 0.15
    assert energy <= task.robot.energy(retime(task.robot, path, nodes=60).motion) * (1 + 1e-3)


def test_quadratic_drives_are_nowhere_above_measured_ones():
    robot = tripod().robot
    drives = QuadraticDrives.of(robot.motors, robot.limits)
    assert not drives.exact
    rng = np.random.default_rng(0)
    torque = rng.uniform(-1, 1, (4000, 6)) * robot.limits.torque
    speed = rng.uniform(-1, 1, (4000, 6)) * robot.limits.speed
    m = torque + drives.coulomb * np.sign(speed)
    own = drives.loss * m**2 + drives.mechanical * m * speed + drives.rub * np.abs(speed)
    own = np.sum(own + drives.drag * speed**2, axis=1) + drives.standby
    power = np.sum(robot.motors.power(torque, speed), axis=1)
    assert np.all(own <= power)
    assert np.mean(power - own) < 0.25 * np.mean(power)


def test_quadratic_drives_are_dc_motors():
    _, robot = robot_with(1.0, 2.0, viscous=3.0)
    drives, rng = QuadraticDrives.of(robot.motors, robot.limits), np.random.default_rng(0)
    torque, speed = rng.normal(size=(2, 50, 6)) * 10
    m = torque + drives.coulomb * np.sign(speed)
    own = drives.loss * m**2 + drives.mechanical * m * speed + drives.drag * speed**2
    power = robot.motors.power(torque, speed).sum(axis=1)
    assert np.allclose(own.sum(axis=1) + drives.standby, power)


@pytest.mark.slow
def test_four_feet():
    task = cart()
    found = retime(task.robot, random_path(task, 0, 0.1), task.limits, priced(20.0), nodes=60)
    assert found.verified
    assert found.cheapest.gap < 1e-5
