"""Robots and paths that tests of retiming share."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from ocptip.published.tasks import experiment_task
from ocptip.standing.arm import Robot
from ocptip.standing.mechanism import StandingMechanism
from ocptip.task_files.motion import load_task
from ocptip.trajectories.path import JointPath
from tests.places import EXAMPLES


@cache
def cart():
    """The task of a UR5 on a cart with four feet."""
    return load_task(EXAMPLES / "tasks" / "ur5_cart.toml")


@cache
def delta():
    """A Delta robot on a light base."""
    return load_task(EXAMPLES / "tasks" / "delta_cart.toml")


@cache
def tripod():
    """A modular arm of the published cases on three feet."""
    return experiment_task("A")


def random_path(task, seed: int, wobble: float = 0.2) -> JointPath:
    """A spline from start to goal through three random postures beside the straight line."""
    rng, ends = np.random.default_rng(seed), np.linspace(0, 1, 5)
    postures = task.start + ends[:, None] * (task.goal - task.start)
    postures[1:-1] += rng.normal(size=(3, task.robot.n)) * wobble * np.abs(task.goal - task.start).max()
    return JointPath(ends, CubicSpline(ends, postures).c)


def arm_of(robot: StandingMechanism) -> Robot:
    """The robot as an arm."""
    assert isinstance(robot, Robot)
    return robot
