"""A parallel robot on a base that only stands: its platform coordinates move in velocity ramps.

The joints are eliminated (`ocptip.parallel.minimal_form`): motor forces, motor speeds, base wrench and the
distance from singular poses are functions of the coordinates and their derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ocptip.basics.errors import InputError, finite_array, positive_number, rotation_matrix
from ocptip.contact.support import Support
from ocptip.numerics.batch import BatchFunction
from ocptip.parallel.base_wrench import moving_mass
from ocptip.parallel.description.robot_description import PRISMATIC
from ocptip.parallel.minimal_form import minimal_form
from ocptip.parallel.robot import ParallelRobot
from ocptip.reserves.slip import Redistribution
from ocptip.robots.model import JointLimits
from ocptip.robots.motors import Motors
from ocptip.standing.mechanism import FurtherLimits, StandingMechanism
from ocptip.trajectories.arm_motion import gauss_legendre
from ocptip.trajectories.sampled import Motion

MOTOR_SPEED, SINGULARITY = "motor_speed", "singularity"
_LOOKS = 16  # instants per interval between events at which a motor's change of direction is looked for
_BISECTIONS = 40


@dataclass(frozen=True, eq=False)
class PlatformLimits:
    """What the coordinates (m and rad, (m,) each, or one number for all) and the motors may do.

    Attributes:
        lower, upper: box of the coordinates; it should lie within the workspace.
        speed, acceleration: of the coordinates, both directions.
        motor_force: N or N m, both directions.
        motor_speed: m/s or rad/s, both directions.
        singularity: least distance from singular poses of both types, 0 to 1; see `minimal_form`.
    """

    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    motor_force: np.ndarray
    motor_speed: np.ndarray | float = np.inf
    singularity: float = 0.05

    def joint_limits(self, m: int) -> JointLimits:
        """Those of coordinates and motor forces, for m of them.

        Raises:
            InputError: wrong shape, NaN, not positive, or lower not below upper.
        """
        values = {
            name: _per_coordinate(name, getattr(self, name), m, signed=name in ("lower", "upper"))
            for name in ("lower", "upper", "speed", "acceleration", "motor_force")
        }
        lower, upper = values["lower"], values["upper"]
        if (lower >= upper).any():
            raise InputError(f"lower: must be below upper, got {lower.tolist()} and {upper.tolist()}")
        return JointLimits(*values.values())


class StandingParallelRobot(StandingMechanism):
    """A parallel robot mounted on a base that stands on a support.

    Args:
        robot: its legs of the types with closed-form inverse kinematics, as many motors as coordinates.
        support: the base with its contacts; its mass and centre of mass without the robot.
        motors: drives, of the forces or torques and the speeds of the motors.
        limits: of coordinates and motors.
        position: (3,), m, base axes: origin of the robot's world frame.
        rotation: (3, 3) the robot's world axes to base axes; default none.
        reference_moment, redistribution: see `StandingMechanism`.

    Attributes:
        robot: as given.
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
        rotation: object | None = None,
        reference_moment: float | None = None,
        redistribution: Redistribution | None = None,
    ) -> None:
        if support.dimension != 3:
            raise InputError("support: a parallel robot needs a spatial support, got a planar one")
        self.robot, self.platform_limits = robot, limits
        self.position = finite_array("position", position, (3,))
        self.rotation = np.eye(3) if rotation is None else rotation_matrix("rotation", rotation)
        self._made_with = (reference_moment, redistribution)
        form = minimal_form(robot, self.rotation.T @ support.gravity)
        m = robot.m
        _require_motors(motors, m)
        super().__init__(
            support,
            motors,
            limits.joint_limits(m),
            _NoCollisions(m),
            moving_mass(robot),
            reference_moment,
            redistribution,
        )
        self.further_limits = _further_limits(limits, form.measure_names, m)
        force, moment = (cs.DM(self.rotation) @ part for part in cs.vertsplit(form.wrench, 3))
        moment = moment + cs.cross(cs.DM(self.position - support.center_of_mass), force)
        wrench = cs.vertcat(force, moment) + support.weight
        state = [form.z, form.zd, form.zdd]
        self._loads = BatchFunction(cs.Function("loads", state, [form.motor_forces, wrench]))
        further = cs.vertcat(form.measures, form.motor_speeds)
        self._further = BatchFunction(cs.Function("further", state[:2], [further]))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return self.robot.description.platform.coordinates

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the coordinates."""
        return tuple("rad" if name.startswith("phi") else "m" for name in self.names)

    @property
    def motor_units(self) -> tuple[str, ...]:
        """Units of the motors' forces."""
        description = self.robot.description
        rows = [description.legs[leg].rows[joint] for leg, joint in description.actuated]
        return tuple("N" if row.sigma == PRISMATIC else "N m" for row in rows)

    def loads(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Motor forces (N, n), N or N m, and the total wrench (N, 6) on the base about its centre of mass."""
        forces, wrenches = self._loads(q, qd, qdd)
        return forces, wrenches

    def load_expressions(self, q: cs.SX, qd: cs.SX, qdd: cs.SX) -> tuple[cs.SX, cs.SX]:
        """The same as CasADi columns."""
        return self._loads.function(q, qd, qdd)

    def motor_speeds(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """(N, n), rad/s or m/s."""
        return self._further(q, qd)[0][:, -self.n :]

    def further(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Distances from singular poses and motor speeds, (N, k)."""
        return self._further(q, qd)[0]

    def further_expressions(self, q: cs.SX, qd: cs.SX) -> cs.SX:
        """The same as CasADi column."""
        return self._further.function(q, qd)

    def quadrature(self, motion: Motion, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Nodes and weights between events and changes of the motors' directions, where friction jumps."""
        intervals = motion.intervals
        if not len(intervals):
            return motion.quadrature(order)
        shares = np.linspace(0.0, 1.0, _LOOKS + 1)
        times = intervals[:, :1] + shares * np.diff(intervals)
        left, right = times[:, :-1].ravel(), times[:, 1:].ravel()
        at_left, at_right = self._speeds_at(motion, left), self._speeds_at(motion, right)
        piece, motor = np.nonzero(at_left * at_right < 0)
        low, high, sign = left[piece], right[piece], np.sign(at_left[piece, motor])
        for _ in range(_BISECTIONS if len(piece) else 0):
            middle = 0.5 * (low + high)
            before = self._speeds_at(motion, middle)[np.arange(len(piece)), motor] * sign > 0
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        edges = np.unique(np.concatenate([intervals.ravel(), low]))
        return gauss_legendre(np.column_stack([edges[:-1], edges[1:]]), order)

    def _speeds_at(self, motion: Motion, times: np.ndarray) -> np.ndarray:
        q, qd, _ = motion.states(times)
        return self.motor_speeds(q, qd)

    def __reduce__(self) -> tuple:
        """Pickle by what it was made of: CasADi's functions are built anew on the other side."""
        made_of = (self.robot, self.support, self.motors, self.platform_limits)
        return _restored, (made_of, self.position, self.rotation, self._made_with)


class _NoCollisions:
    """Nothing that a platform could hit: the box of its coordinates keeps it away."""

    labels = ()

    def __init__(self, n: int) -> None:
        self.function = cs.Function("gaps", [cs.SX.sym("q", n)], [cs.SX(0, 1)], ["q"], ["gaps"])

    def gaps(self, q: np.ndarray) -> np.ndarray:
        return np.empty((len(q), 0))

    def worst(self, _: np.ndarray) -> tuple[float, None, int]:
        return np.inf, None, 0


def _require_motors(motors: Motors, m: int) -> None:
    """Raise InputError unless the motors are those of m drives."""
    try:
        motors.power(np.zeros((1, m)), np.zeros((1, m)))
    except InputError as error:
        raise InputError(f"motors: the robot has {m}: {error}") from None


def _further_limits(limits: PlatformLimits, measures: Sequence[str], m: int) -> FurtherLimits:
    speed = _per_coordinate("motor_speed", limits.motor_speed, m)
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


def _per_coordinate(name: str, value: object, m: int, *, signed: bool = False) -> np.ndarray:
    values = np.broadcast_to(np.asarray(value, dtype=float), (m,)) if np.ndim(value) == 0 else value
    array = np.array(values, dtype=float)
    if array.shape != (m,) or np.isnan(array).any():
        raise InputError(f"{name}: expected one number or {m}, got {value!r}")
    if not signed and (array <= 0).any():
        raise InputError(f"{name}: must be > 0, got {value!r}")
    return array


def _restored(
    made_of: tuple, position: np.ndarray, rotation: np.ndarray, made_with: tuple
) -> StandingParallelRobot:
    return StandingParallelRobot(
        *made_of,
        position=position,
        rotation=rotation,
        reference_moment=made_with[0],
        redistribution=made_with[1],
    )
