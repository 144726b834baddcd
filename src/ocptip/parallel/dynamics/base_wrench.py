"""Wrench of a parallel robot on what it is mounted on, from gravity and the motion of all bodies.

It does not depend on how motors and legs share the forces. The spin of motor rotors is neglected, as for
serial arms.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import finite_array
from ocptip.numerics.vectors import cross
from ocptip.parallel.dynamics.terms import platform_terms
from ocptip.parallel.robot import ParallelRobot


def base_wrench(
    robot: ParallelRobot,
    z: ArrayLike,
    zd: ArrayLike,
    zdd: ArrayLike,
    *,
    gravity: ArrayLike | None = None,
    load: ArrayLike | None = None,
    q: Sequence[np.ndarray] | None = None,
) -> np.ndarray:
    """Wrench (6,) of the robot on what it is mounted on, about its world origin, world axes.

    Newton and Euler for all bodies together: what the base gives is what moves and carries them.

    Args:
        robot: the robot.
        z, zd, zdd: (m,).
        gravity: (3,), m/s^2, world axes; default the robot's.
        load: (6,) external force and moment on the platform about its origin.
        q: joint positions per leg.
    """
    kinematics = robot.kinematics
    check = kinematics.coordinates
    z, zd, zdd = check("z", z), check("zd", zd), check("zdd", zdd)
    g = robot.description.gravity if gravity is None else finite_array("gravity", gravity, (3,))
    s, sd = kinematics.quasi(z, zd, zdd)
    motion = robot.motion(z, s, q)
    body = robot.description.platform.inertia
    M, c, weight = platform_terms(body, motion.R, motion.t[3:], g)
    at_platform = M @ (motion.T @ sd + motion.T_drift) + c + weight
    if load is not None:
        at_platform = at_platform - finite_array("load", load, (6,))
    needed = _moved(at_platform, motion.r)
    for leg, part in zip(kinematics.legs, motion.legs, strict=True):
        *_, momentum, carried, _ = leg.dynamics(leg.padded(part.q), leg.padded(part.qd), g)
        accelerations = leg.padded(part.Jq @ sd + part.drift)
        needed += _moved(momentum @ accelerations + carried, leg.origin)
    return -needed


def moving_mass(robot: ParallelRobot) -> float:
    """Mass of platform and legs, kg."""
    legs = sum(body.mass for leg in robot.description.legs for body in leg.bodies)
    return robot.description.platform.inertia.mass + legs


def _moved(wrench: np.ndarray, point: np.ndarray) -> np.ndarray:
    """A wrench about `point` as one about the origin."""
    return np.concatenate([wrench[:3], wrench[3:] + cross(point, wrench[:3])])
