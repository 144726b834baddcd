"""Parallel robots on a base that only stands: their platform coordinates move with velocity profiles.

The joints of the legs are eliminated in closed form (`ocptip.parallel.minimal_form`): motor forces, motor
speeds, base wrench and the distance from singular poses are functions of the coordinates and their
derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, positive_number, rotation_matrix
from ocptip.contact.support import Support
from ocptip.numerics.batch import BatchFunction
from ocptip.numerics.bisection import borders
from ocptip.numerics.quadrature import gauss_legendre
from ocptip.parallel.description.robot_description import PRISMATIC
from ocptip.parallel.minimal_form import minimal_form
from ocptip.parallel.robot import ParallelRobot
from ocptip.reserves.slip import Redistribution
from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.collision.gaps import Collisions
from ocptip.robots.model import JointLimits
from ocptip.robots.motors import Motors
from ocptip.robots.payload import Payload
from ocptip.standing.further_limits import FurtherLimits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.sensor import WrenchSensor
from ocptip.trajectories.trajectory import Trajectory

MOTOR_SPEED, SINGULARITY = "motor_speed", "singularity"
_SAMPLES = 16  # instants per interval between events at which a motor's change of direction is looked for
_BISECTIONS = 40


@dataclass(frozen=True, eq=False)
class PlatformLimits:
    """The limits of the coordinates (m and rad, (m,) each, or one number for all) and of the motors.

    Attributes:
        lower, upper: box of the coordinates; it should lie within the workspace.
        speed, acceleration: of the coordinates, both directions.
        motor_force: N or N m, both directions, one per motor or one for all.
        motor_speed: m/s or rad/s, both directions, likewise.
        singularity: minimum distance from singular poses of both types, 0 to 1; see `minimal_form`.
    """

    lower: ArrayLike = -np.inf
    upper: ArrayLike = np.inf
    speed: ArrayLike = np.inf
    acceleration: ArrayLike = np.inf
    motor_force: ArrayLike = np.inf
    motor_speed: ArrayLike = np.inf
    singularity: float = 0.05

    def joint_limits(self, m: int, motors: int) -> JointLimits:
        """Those of m coordinates and of the forces of the motors.

        Raises:
            InputError: wrong shape, NaN, not positive, or lower not below upper.
        """
        values = {
            name: _one_each(name, getattr(self, name), m, signed=name in ("lower", "upper"))
            for name in ("lower", "upper", "speed", "acceleration")
        }
        lower, upper = values["lower"], values["upper"]
        if (lower >= upper).any():
            raise InputError(f"lower: must be below upper, got {lower.tolist()} and {upper.tolist()}")
        force = _one_each("motor_force", self.motor_force, motors)
        return JointLimits(lower, upper, values["speed"], values["acceleration"], force, np.full(m, np.inf))


class StandingParallelRobot(StandingMechanism):
    """A parallel robot mounted on a base that stands on a support, for checks and plans.

    Its legs have closed forms, and it has as many motors as coordinates.

    Args:
        robot: the robot.
        support: the base with its contacts; its mass and centre of mass without the robot.
        motors: drives, of the forces or torques and the speeds of the motors.
        limits: of coordinates and motors.
        position: (3,), m, base axes: origin of the robot's world frame.
        rotation: (3, 3) the robot's world axes to base axes; default none.
        load: (6,) external force and moment on the platform about its origin, N and N m, the robot's world
            axes; default none.
        reference_moment, redistribution: see `StandingMechanism`.
        sensor: see `StandingMechanism`; default: at `position`, in base axes.

    Attributes:
        robot, load: as given.
        platform_limits: as given.

    Raises:
        InputError: the robot is not of this kind, or an argument cannot be used.
    """

    kind = "robot"
    direct_drives = False

    def __init__(
        self,
        robot: ParallelRobot,
        support: Support,
        motors: Motors,
        limits: PlatformLimits,
        *,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        rotation: ArrayLike | None = None,
        load: ArrayLike | None = None,
        reference_moment: float | None = None,
        redistribution: Redistribution | None = None,
        sensor: WrenchSensor | None = None,
    ) -> None:
        self.robot, self.platform_limits = robot, limits
        self.position = finite_array("position", position, (3,))
        self.rotation = np.eye(3) if rotation is None else rotation_matrix("rotation", rotation)
        self.load = None if load is None else finite_array("load", load, (6,))
        self._drives = robot.description.motor_rows
        count = len(self._drives)
        _require_motors(motors, count)
        form = minimal_form(robot, self.rotation.T @ support.gravity, self.load)
        super().__init__(
            support,
            motors,
            limits.joint_limits(robot.m, count),
            Collisions(robot.m),
            robot.description.moving_mass,
            reference_moment,
            redistribution,
            sensor or WrenchSensor(self.position),
        )
        self.further_limits = _further_limits(limits, form.measure_names, count)
        force, moment = (cs.DM(self.rotation) @ part for part in cs.vertsplit(form.wrench, 3))
        moment = moment + cs.cross(cs.DM(self.position - support.center_of_mass), force)
        wrench = cs.vertcat(force, moment) + support.weight
        state = [form.z, form.zd, form.zdd]
        self._loads = BatchFunction(cs.Function("loads", state, [form.motor_forces, wrench]))
        further = cs.vertcat(form.measures, form.motor_speeds)
        self._further = BatchFunction(cs.Function("further", state[:2], [further]))

    @property
    def payload(self) -> Payload | None:
        """The payload of the platform; None without one."""
        return self.robot.description.platform.payload

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        description = self.robot.description
        joints = (f"leg{leg + 1}_q{joint + 1}" for leg, joint in description.redundant)
        return (*description.platform.coordinates, *joints)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the coordinates."""
        description = self.robot.description
        platform = ("rad" if name.startswith("phi") else "m" for name in description.platform.coordinates)
        joints = (description.legs[leg].joint_rows[joint] for leg, joint in description.redundant)
        return (*platform, *("m" if row.sigma == PRISMATIC else "rad" for row in joints))

    @property
    def motor_units(self) -> tuple[str, ...]:
        """Units of the motors' forces."""
        return tuple("N" if row.sigma == PRISMATIC else "N m" for row in self._drives)

    def sticks(self, q: np.ndarray) -> list[np.ndarray]:
        """The bodies of the legs, and the lines between the points at which they hold the platform."""
        lines = self.robot.kinematics.sticks(q)
        return [self.position + line @ self.rotation.T for line in lines]

    def motor_speeds(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """(N, n_a), rad/s or m/s."""
        return self.further(q, qd)[:, -len(self._drives) :]

    def quadrature(self, motion: Trajectory, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Nodes and weights between switching times and changes of motor directions, where friction has
        steps.
        """
        intervals = motion.intervals
        if not len(intervals):
            return motion.quadrature(order)
        shares = np.linspace(0.0, 1.0, _SAMPLES + 1)
        times = intervals[:, :1] + shares * np.diff(intervals)
        left, right = times[:, :-1].ravel(), times[:, 1:].ravel()
        at_left, at_right = self._speeds_at(motion, left), self._speeds_at(motion, right)
        piece, motor = np.nonzero(at_left * at_right < 0)
        sign = np.sign(at_left[piece, motor])

        def before(times: np.ndarray) -> np.ndarray:
            return self._speeds_at(motion, times)[np.arange(len(piece)), motor] * sign > 0

        low, _ = borders(before, left[piece], right[piece], _BISECTIONS)
        edges = np.unique(np.concatenate([intervals.ravel(), low]))
        return gauss_legendre(np.column_stack([edges[:-1], edges[1:]]), order)

    def _speeds_at(self, motion: Trajectory, times: np.ndarray) -> np.ndarray:
        q, qd, _ = motion.states(times)
        return self.motor_speeds(q, qd)

    def loads(
        self,
        q: np.ndarray,
        qd: np.ndarray,
        qdd: np.ndarray,
        acting: np.ndarray | None = None,
        base_motion: BaseMotion | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Motor forces (N, n), N or N m, and the total wrench (N, 6) on the base about its centre of mass."""
        _require_rest(base_motion)
        forces, wrenches = self._loads(q, qd, qdd)
        return forces, wrenches

    def load_expressions(
        self, q: cs.SX, qd: cs.SX, qdd: cs.SX, acting: cs.SX | None = None
    ) -> tuple[cs.SX, cs.SX]:
        """Motor forces and wrench on the base as CasADi columns."""
        forces, wrench = self._loads.function.call([q, qd, qdd])
        return forces, wrench

    def further(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Distances from singular poses and motor speeds, (N, k)."""
        return self._further(q, qd)[0]

    def further_expressions(self, q: cs.SX, qd: cs.SX) -> cs.SX:
        """Distances from singular poses and motor speeds as CasADi column (k,)."""
        return self._further.function(q, qd)


def _require_motors(motors: Motors, m: int) -> None:
    """Raise InputError unless the motors are those of m drives."""
    try:
        motors.power(np.zeros((1, m)), np.zeros((1, m)))
    except InputError as error:
        raise InputError(f"motors: the robot has {m}: {error}") from None


def _require_rest(base_motion: BaseMotion | None) -> None:
    """Raise InputError if the base of a parallel robot moves."""
    if base_motion is not None:
        raise InputError("base_motion: of arms only; the base of a parallel robot has to rest")


def _further_limits(limits: PlatformLimits, measures: Sequence[str], m: int) -> FurtherLimits:
    speed = _one_each("motor_speed", limits.motor_speed, m)
    margin = positive_number("singularity", limits.singularity)
    if margin >= 1:
        raise InputError(f"singularity: must be below 1, got {margin}")
    count = len(measures)
    return FurtherLimits(
        names=(SINGULARITY,) * count + (MOTOR_SPEED,) * m,
        details=(*measures, *(f"motor {k + 1}" for k in range(m))),
        lower=np.concatenate([np.full(count, margin), -speed]),
        upper=np.concatenate([np.full(count, np.inf), speed]),
        units=np.concatenate([np.ones(count), np.where(np.isfinite(speed), speed, 1.0)]),
    )


def _one_each(name: str, value: ArrayLike, m: int, *, signed: bool = False) -> np.ndarray:
    values = np.broadcast_to(np.asarray(value, dtype=float), (m,)) if np.ndim(value) == 0 else value
    array = np.array(values, dtype=float)
    if array.shape != (m,) or np.isnan(array).any():
        raise InputError(f"{name}: expected one number or {m}, got {value!r}")
    if not signed and (array <= 0).any():
        raise InputError(f"{name}: must be > 0, got {value!r}")
    return array
