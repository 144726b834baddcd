"""A parallel robot mounted on a base: its motor forces and its wrench on the base along a motion.

The wrench is a force and a moment about a point of the base (its centre of mass, for `ocptip.contact`), base
axes, from gravity and the motion of all bodies. It does not depend on how motors and legs share the forces.
The spin of motor rotors is neglected, as for serial arms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ocptip.basics.errors import InputError, SolverError, finite_array
from ocptip.parallel.description.robot_description import frozen_rotation
from ocptip.parallel.description.rotations import cross
from ocptip.parallel.dynamics.terms import platform_terms
from ocptip.parallel.robot import ParallelRobot


@dataclass(frozen=True, eq=False)
class PlatformMotion:
    """A motion of the platform at N instants.

    Attributes:
        times: (N,), s.
        z, zd, zdd: (N, m) coordinates and their time derivatives.
    """

    times: np.ndarray
    z: np.ndarray
    zd: np.ndarray
    zdd: np.ndarray

    def __post_init__(self) -> None:
        times = finite_array("times", self.times, (None,))
        object.__setattr__(self, "times", times)
        columns = np.shape(self.z)[1] if np.ndim(self.z) == 2 else None
        for name in ("z", "zd", "zdd"):
            array = finite_array(name, getattr(self, name), (len(times), columns))
            object.__setattr__(self, name, array)


@dataclass(frozen=True, eq=False)
class MountedSamples:
    """What the robot needs and does to its base along a motion.

    Attributes:
        motion: the motion.
        motors: (N, n_a), N or N m: motor forces.
        wrenches: (N, 6), N and N m: of the robot on its base, about the given point, base axes.
        platform_measure: (N,) distance from a type II singularity, see `Singularity.platform`.
    """

    motion: PlatformMotion
    motors: np.ndarray
    wrenches: np.ndarray
    platform_measure: np.ndarray


class MountedRobot:
    """A parallel robot on a base that rests.

    With `about=support.center_of_mass` and `gravity=support.gravity` of a `Support` of ocptip, the wrench
    plus `support.weight` is what the support's contacts have to bear.

    Args:
        robot: the robot.
        position: (3,), m, base axes: origin of the robot's world frame.
        rotation: (3, 3) the robot's world axes to base axes; default none.
        about: (3,), m, base axes: reference point of the moment.
        gravity: (3,), m/s^2, base axes; default the robot's own, turned to base axes.

    Raises:
        InputError: wrong shapes, or not a rotation.
    """

    def __init__(
        self,
        robot: ParallelRobot,
        *,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        rotation: object | None = None,
        about: Sequence[float] = (0.0, 0.0, 0.0),
        gravity: Sequence[float] | None = None,
    ) -> None:
        self.robot = robot
        self.position, self.about = (
            finite_array("position", position, (3,)),
            finite_array("about", about, (3,)),
        )
        self.rotation = np.eye(3) if rotation is None else frozen_rotation("rotation", rotation)
        own = self.rotation @ robot.description.gravity
        self.gravity = own if gravity is None else finite_array("gravity", gravity, (3,))

    def wrench(
        self,
        z: object,
        zd: object,
        zdd: object,
        *,
        load: object | None = None,
        q: Sequence[np.ndarray] | None = None,
    ) -> np.ndarray:
        """Wrench (6,) of the robot on its base at one instant.

        Args:
            z, zd, zdd: (m,).
            load: (6,) external force and moment on the platform about its origin, the robot's world axes.
            q: joint positions per leg.
        """
        gravity = self.rotation.T @ self.gravity
        own = base_wrench(self.robot, z, zd, zdd, gravity=gravity, load=load, q=q)
        force, moment = self.rotation @ own[:3], self.rotation @ own[3:]
        return np.concatenate([force, moment + cross(self.position - self.about, force)])

    def samples(self, motion: PlatformMotion, *, load: object | None = None) -> MountedSamples:
        """Motor forces and base wrenches along a motion.

        Raises:
            InputError: the motion does not fit the robot or leaves its workspace.
            SolverError: a singular pose, with its type.
        """
        if motion.z.shape[1] != self.robot.m:
            raise InputError(f"motion: has {motion.z.shape[1]} coordinates, the robot has {self.robot.m}")
        gravity = self.rotation.T @ self.gravity
        self._require_no_crossing(motion)
        guess, wrenches, motors, measures = None, [], [], []
        for z, zd, zdd in zip(motion.z, motion.zd, motion.zdd, strict=True):
            guess = self.robot.ik(z, guess).q
            forces = self.robot.inverse_dynamics(z, zd, zdd, guess, wrench=load, gravity=gravity)
            motors.append(forces.motors)
            wrenches.append(self.wrench(z, zd, zdd, load=load, q=guess))
            measures.append(self.robot.singularity(z, guess).platform)
        return MountedSamples(motion, np.array(motors), np.array(wrenches), np.array(measures))

    def _require_no_crossing(self, motion: PlatformMotion) -> None:
        if not self.robot.description.coupling_form or self.robot.redundant_drives:
            return
        found = self.robot.crossings(motion.z)
        if found:
            first = found[0]
            raise SolverError(
                f"motion: meets a singular pose between samples {first.sample + 1} and {first.sample + 2}: "
                f"{', '.join(first.kinds)} at z = {first.z.round(6).tolist()}"
            )


def base_wrench(
    robot: ParallelRobot,
    z: object,
    zd: object,
    zdd: object,
    *,
    gravity: object | None = None,
    load: object | None = None,
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
        n = len(part.q)
        full, rates, accelerations = np.zeros(leg.n), np.zeros(leg.n), np.zeros(leg.n)
        full[:n], rates[:n], accelerations[:n] = part.q, part.qd, part.Jq @ sd + part.drift
        *_, momentum, carried, _ = leg.dynamics(full, rates, g)
        needed += _moved(momentum @ accelerations + carried, leg.origin)
    return -needed


def moving_mass(robot: ParallelRobot) -> float:
    """Mass of platform and legs, kg."""
    legs = sum(body.mass for leg in robot.description.legs for body in leg.bodies)
    return robot.description.platform.inertia.mass + legs


def _moved(wrench: np.ndarray, point: np.ndarray) -> np.ndarray:
    """A wrench about `point` as one about the origin."""
    return np.concatenate([wrench[:3], wrench[3:] + cross(point, wrench[:3])])
