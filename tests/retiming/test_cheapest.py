"""The cheapest timing: bounds, exact energy, limits of time, what viscous friction changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ocptip.basics.errors import InputError
from ocptip.motion.objective import ENERGY, priced
from ocptip.retiming.retime import retime
from ocptip.robots.motors import DCMotors
from ocptip.standing.limits import MotionLimits
from tests.retiming.paths import arm_of, cart, random_path, tripod


def robot_with(regeneration: float, standby: float, viscous: float = 1.0):
    task = tripod()
    motors = DCMotors.estimated(arm_of(task.robot).arm, regeneration=regeneration, standby=standby)
    return task, task.robot.with_motors(replace(motors, viscous=viscous * motors.viscous))


@pytest.mark.parametrize(("regeneration", "standby"), [(1.0, 0.0), (0.0, 0.1), (0.4, 2.0)])
def test_cheaper_than_every_slower_and_faster(regeneration, standby):
    task, robot = robot_with(regeneration, standby, viscous=0.0)
    path = random_path(task, 1, 0.1)
    found = retime(robot, path, MotionLimits(), ENERGY, nodes=80)
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
    ends = [
        retime(robot, path, MotionLimits(), goal, nodes=80) for goal in (ENERGY, priced(5.0), priced(500.0))
    ]
    durations = [found.motion.end for found in ends]
    assert durations[0] > durations[1] > durations[2]
    assert durations[2] == pytest.approx(ends[2].fastest, rel=0.05)
    longest = 0.5 * (durations[0] + durations[2])
    bounded = retime(robot, path, MotionLimits(max_duration=longest), ENERGY, nodes=80)
    assert bounded.verified
    assert longest * 0.999 < bounded.motion.end <= longest
    assert robot.energy(bounded.motion) > robot.energy(ends[0].motion)
    with pytest.raises(InputError, match="the fastest timing takes"):
        retime(robot, path, MotionLimits(max_duration=0.1), ENERGY)


def test_viscous_friction_that_outweighs_all_else():
    task, robot = robot_with(1.0, 0.0, viscous=30.0)
    path = random_path(task, 1, 0.1)
    found = retime(robot, path, MotionLimits(), priced(1.0), nodes=60)
    assert found.verified
    assert found.cheapest.gap < 1e-2
    assert found.motion.end > 1.2 * found.fastest
    slower = found.motion.time_scaled(1.05)
    assert robot.energy(slower) + slower.end >= (robot.energy(found.motion) + found.motion.end) * (1 - 2e-3)


def test_measured_maps_are_refused():
    task = tripod()
    with pytest.raises(InputError, match="DC motors"):
        retime(task.robot, random_path(task, 0), MotionLimits(), ENERGY)


def test_four_feet():
    task = cart()
    found = retime(task.robot, random_path(task, 0, 0.1), task.limits, priced(20.0), nodes=60)
    assert found.verified
    assert found.cheapest.gap < 1e-5
