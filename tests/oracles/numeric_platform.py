"""Loads of a parallel robot on a support in numbers: joints are searched, no expression is built."""

from __future__ import annotations

import numpy as np

from ocptip.parallel.robot import base_wrench
from ocptip.standing.platform import StandingParallelRobot


def numeric_loads(
    standing: StandingParallelRobot, z: np.ndarray, zd: np.ndarray, zdd: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """As `StandingParallelRobot.loads`: motor forces and the wrench on the base about its centre of mass.

    Consecutive states should be near each other: the joints of one are searched from those of the one before.
    """
    robot, support, joints = standing.robot, standing.support, None
    options = {"gravity": standing.rotation.T @ support.gravity}
    forces, wrenches = [], []
    for state in zip(z, zd, zdd, strict=True):
        joints = robot.ik(state[0], joints).q
        forces.append(robot.inverse_dynamics(*state, joints, wrench=standing.load, **options).motors)
        wrenches.append(base_wrench(robot, *state, load=standing.load, q=joints, **options))
    force, moment = (np.array(wrenches)[:, part] @ standing.rotation.T for part in (slice(3), slice(3, 6)))
    moment = moment + np.cross(standing.position - support.center_of_mass, force)
    return np.array(forces), np.hstack([force, moment]) + support.weight
