"""A mechanism on a base that only stands: everything that happens while it moves, at any instant.

Here mechanisms and `contact` meet: the mechanism's base wrench plus the base's weight is the wrench under
which the support has to stand. n coordinates move with velocity profiles: the joints of an arm, or the
platform coordinates of a parallel robot. Plans need as many motors as coordinates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Literal, Self

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, positive_number
from ocptip.basics.frozen import MadeOf
from ocptip.contact.support import Support
from ocptip.numerics.quadrature import gauss_legendre
from ocptip.reserves.classical import ClassicalMeasures
from ocptip.reserves.slip import Redistribution
from ocptip.reserves.tipping import TipOver
from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.collision.gaps import CLEARANCE, Collisions
from ocptip.robots.model import JointLimits, joint_states
from ocptip.robots.motors import Motors
from ocptip.robots.payload import Payload
from ocptip.robots.process import ProcessWrench
from ocptip.robots.spring_chain import SpringChain
from ocptip.standing.carrying import Carrier
from ocptip.standing.footing import center_by_weights
from ocptip.standing.further_limits import FurtherLimits
from ocptip.standing.margins import Margins
from ocptip.standing.samples import MotionSamples
from ocptip.standing.sensor import WrenchSensor
from ocptip.trajectories.drive_profile import DriveProfile
from ocptip.trajectories.path import JointPath, PathTiming
from ocptip.trajectories.trajectory import Trajectory


class StandingMechanism(MadeOf, Carrier, ABC):
    """A mechanism mounted on a base that stands on a support; what checks and programs know of it.

    Args:
        support: the base with its contacts; its mass and centre of mass without the mechanism.
        motors: the drives.
        limits: of the coordinates, (n,) each, and of the motors' torques or forces.
        collision: signed distances.
        mass: of the mechanism and what it holds, kg.
        reference_moment: M0 of the tip-over index, N m; default: a tenth of the best moment margin of the
            base loaded with the weight of base, mechanism and payload.
        redistribution: of friction utilisation, see `reserves.slip.Slip`.
        sensor: force-torque sensor in the base.

    Attributes:
        kind: word for messages.
        knows_inertia: :meth:`small_motions` are known.
        direct_drives: every motor moves one coordinate, at that coordinate's speed.
        further_limits: of what :meth:`further` gives.
        mass: of base, mechanism and payload, kg.
        sensor: as given.

    Raises:
        InputError: a planar support, or no gravity and no reference moment.
    """

    kind = "arm"
    knows_inertia = False
    direct_drives = True
    further_limits = FurtherLimits()
    shapes: tuple[Any, ...] = ()
    obstacles: tuple[Any, ...] = ()
    drive_profile: DriveProfile | None = None

    def __init__(
        self,
        support: Support,
        motors: Motors,
        limits: JointLimits,
        collision: Collisions,
        mass: float,
        reference_moment: float | None,
        redistribution: Redistribution | None,
        sensor: WrenchSensor,
    ) -> None:
        if support.dimension != 3:
            raise InputError(
                "support: a mechanism needs a spatial support, got a planar one; give each contact twice, "
                "far apart across the plane, and the other positions three numbers"
            )
        self.motors, self.limits, self.collision = motors, limits, collision
        self.mass, self.sensor = support.mass + mass, sensor
        if reference_moment is None:
            moment = TipOver(support).reference_moment
            reference_moment = None if moment is None else moment * self.mass / support.mass
        else:
            reference_moment = positive_number("reference_moment", reference_moment)
        super().__init__(support, reference_moment, redistribution)

    # --- what a mechanism provides --------------------------------------------------------------------

    @property
    @abstractmethod
    def payload(self) -> Payload | None:
        """The payload, which is part of `mass` and of all loads; None without one."""

    def joint_label(self, joint: int) -> str:
        """Name of a driven joint, counted from 0, in messages."""
        return f"joint {joint + 1}"

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the coordinates, "rad" or "m"."""
        return ("rad",) * self.n

    @property
    def motor_units(self) -> tuple[str, ...]:
        """Units of the motors' torques or forces, "N m" or "N"."""
        return tuple("N" if unit == "m" else "N m" for unit in self.units)

    @property
    def usual_clearance(self) -> float:
        """Smallest distance, m, of what may collide where none is asked for."""
        return CLEARANCE

    @property
    def notes(self) -> tuple[str, ...]:
        """The assumptions about the mechanism, one sentence each, for reports."""
        if self.support.elastic is None or self.swings:
            return ()
        return (f"how the base swings on compliant feet is not computed for this {self.kind}",)

    @abstractmethod
    def loads(
        self,
        q: np.ndarray,
        qd: np.ndarray,
        qdd: np.ndarray,
        acting: np.ndarray | None = None,
        base_motion: BaseMotion | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Torques (N, n), N m, and the total wrench (N, 6) on the base about its centre of mass.

        A process that varies needs its values, see `acting`. Without a base motion, or one in `acting`, the
        base rests; with one the inertia of the base is part of the wrench.
        """

    def acting(self, times: np.ndarray) -> np.ndarray:
        """(N, k): what acts at instants (N,), s, see `acts`.

        A process has to vary over time, see `during`, or over the place on a path, see `along`.
        """
        return self.acts.at(times)

    @abstractmethod
    def load_expressions(
        self, q: cs.SX, qd: cs.SX, qdd: cs.SX, acting: cs.SX | None = None
    ) -> tuple[cs.SX, cs.SX]:
        """Torques and wrench on the base as CasADi columns (n,) and (6,).

        Where something `acts` its present values (k,) are asked for.
        """

    def swing_loads(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, acting: np.ndarray | None = None
    ) -> np.ndarray:
        """(N, d), N, N m: what moves base and springs of gears that stay as they are, where `knows_inertia`.

        That is the wrench on the base, see :meth:`loads`, then what each of m springs has to give, d = 6 + m.
        """
        raise NotImplementedError(f"{self.kind}: inertia as seen from the base")

    def small_motions(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The inertia of small motions of base and springs beside the motion, where `knows_inertia`.

        Inertia (N, d, d), per acceleration of the base's centre of mass, its angular acceleration, those of
        the springs; (N, d, 3 + m): per angular velocity of the base and speed of the springs; (N, d, m): per
        motion of the springs. SI, base axes, to first order; without the turning of the weight with the base.
        """
        raise NotImplementedError(f"{self.kind}: inertia as seen from the base")

    def inertia(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The inertia of the base alone: (N, 6, 6) and (N, 6, 3) of :meth:`small_motions`."""
        inertia, turning, _ = self.small_motions(q, qd, 0 * q)
        return inertia[:, :6, :6], turning[:, :6, :3]

    @property
    def chain(self) -> SpringChain | None:
        """The moving bodies with springs in their gears; None if the gears are rigid."""
        return None

    @property
    def swings(self) -> bool:
        """Whether it stands on compliant feet, and how it swings on them can be computed."""
        elastic = self.support.elastic
        return self.knows_inertia and elastic is not None and elastic.holds

    def gravity_torques(self) -> np.ndarray:
        """(n,) N m (sliding joints: N): the maximum that gravity asks within joint limits; 0: not known."""
        return np.zeros(self.n)

    def tool(self, q: np.ndarray, springs: np.ndarray | None = None) -> np.ndarray:
        """Positions (N, 3), m, base frame, of the point whose place matters; default: the centre of mass.

        Springs in gears (N, m), rad, bend it.
        """
        return np.broadcast_to(self.support.center_of_mass, (len(q), 3))

    def gripper(self, q: np.ndarray) -> np.ndarray:
        """Poses (N, 7) of the gripper, as in `MotionSamples`; (N, 0) where there is none."""
        return np.empty((len(q), 0))

    @abstractmethod
    def sticks(self, q: np.ndarray) -> list[np.ndarray]:
        """Lines through points (k, 3), m, base frame, that sketch the posture q (n,), from joint to joint."""

    @property
    def varying(self) -> ProcessWrench | None:
        """The process, if it varies."""
        return self.acts.process

    def resting(self, share: float) -> Self:
        """The same mechanism as it rests before (0) or after (1) a motion that is not known.

        Of what acts on it then, that is left out which depends on how long or how far the motion is.
        """
        return self

    @property
    def process_at_rest(self) -> np.ndarray:
        """(6,): force and moment of a constant process in its axes; 0 without one."""
        return np.zeros(6)

    def during(self, motion: Trajectory) -> Self:
        """The same mechanism with what acts on it as a function of the time of a motion."""
        return self

    def along(self, path: JointPath, timing: PathTiming | None = None) -> Self:
        """The same mechanism, with places s on a path as the times of what acts on it, or with its timing."""
        return self

    def motor_speeds(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """(N, n), rad/s or m/s."""
        return qd

    def further(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Quantities of `further_limits`, (N, k)."""
        return np.empty((len(q), 0))

    def further_expressions(self, q: cs.SX, qd: cs.SX) -> cs.SX:
        """`further_limits` as CasADi column (k,); without direct drives the last n are motor speeds."""
        return cs.SX(0, 1)

    # --- what follows from it ---------------------------------------------------------------------------

    @property
    def masses(self) -> dict[str, float]:
        """kg, by name: base, mechanism, payload if there is one; together `mass`."""
        payload = {"payload": self.payload.mass} if self.payload else {}
        base_mass = self.mass - self.support.mass - sum(payload.values())
        return {"base": self.support.mass, self.kind: base_mass, **payload}

    def masses_to_dict(self) -> dict[str, Any]:
        """Plain data: `masses_kg` by name and in `total`; `payload`, None if there is none."""
        payload = self.payload.to_dict() if self.payload else None
        return {"masses_kg": {**self.masses, "total": self.mass}, "payload": payload}

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.limits.speed)

    def samples(
        self, motion: Trajectory, times: np.ndarray, *, side: Literal["left", "right"] = "right"
    ) -> MotionSamples:
        """Everything that happens at the given instants ((N,), s) of a motion.

        Args:
            motion: of as many joints as the arm has.
            times: s.
            side: at acceleration steps, the limit from this side.

        Raises:
            InputError: the motion has another number of joints.
        """
        times = np.asarray(times, dtype=float)
        return self.during(motion).samples_of(times, *motion.states(times, side=side))

    def samples_of(
        self, times: ArrayLike, angles: ArrayLike, speeds: ArrayLike, accelerations: ArrayLike
    ) -> MotionSamples:
        """The same at instants (N,), s, at which the states, (N, n) each, are given themselves.

        Raises:
            InputError: shapes do not fit.
        """
        times = finite_array("times", times, (None,))
        q = finite_array("angles", angles, (len(times), None))
        self.require_fit(q.shape[1])
        qd, qdd = (
            finite_array(name, value, q.shape)
            for name, value in (("speeds", speeds), ("accelerations", accelerations))
        )
        torques, wrenches = self.loads(q, qd, qdd, self.acting(times))
        states = self.contact_states(wrenches)
        return MotionSamples(
            times=times,
            angles=q,
            speeds=qd,
            accelerations=qdd,
            torques=torques,
            powers=self.motors.power(torques, self.motor_speeds(q, qd)),
            wrenches=wrenches,
            states=states,
            tip=self.tip_over.evaluate(states),
            slip=self.slip.evaluate(states, derivatives=False),
            clearances=self.collision.least(q),
            further=self.further(q, qd),
            units=self.units,
            motor_units=self.motor_units,
            further_names=self.further_limits.labels,
            gripper=self.gripper(q),
            sensor=self.sensor.reads(self.support, wrenches),
            sensor_name=self.sensor.name,
            steady_power=self.support.power,
        )

    def margins(
        self,
        q: ArrayLike,
        qd: ArrayLike | None = None,
        qdd: ArrayLike | None = None,
        *,
        base_motion: BaseMotion | None = None,
    ) -> Margins:
        """All margins of the contacts in one state, (n,), or in many, (N, n).

        Args:
            q: rad (sliding joints, straight coordinates: m).
            qd: rad/s (m/s); default: at rest.
            qdd: rad/s^2 (m/s^2); default: none.
            base_motion: of a base that drives, constant or one of each state; default: it rests.

        Raises:
            InputError: shapes do not fit, what acts on the gripper varies with time or place, or a parallel
                robot drives.
        """
        wrenches, single = self._wrenches(q, qd, qdd, base_motion)
        margins = Margins.under(wrenches, self.tip_over, self.slip)
        return margins[0] if single else margins

    def classical(
        self, q: ArrayLike, qd: ArrayLike | None = None, qdd: ArrayLike | None = None
    ) -> ClassicalMeasures:
        """Classical measures of tip-over stability in one state or in many, to compare with :meth:`margins`.

        Args:
            q, qd, qdd: see :meth:`margins`.

        Raises:
            InputError: the same; or contacts are not ordinary ones on one plane.
        """
        wrenches, single = self._wrenches(q, qd, qdd)
        forces = Margins.under(wrenches, self.tip_over, self.slip).normal_forces
        centers = self.center_of_mass(joint_states("q", q, self.n)[0])
        measures = ClassicalMeasures.under(wrenches, self.tip_over, forces, centers)
        return measures[0] if single else measures

    def center_of_mass(self, q: np.ndarray) -> np.ndarray:
        """Centre of mass of base, mechanism and payload, (N, 3), m, base axes, at joint values (N, n)."""
        still = np.zeros_like(q)
        return center_by_weights(
            self.support, lambda support: self.varied(support=support).loads(q, still, still)[1]
        )

    def _wrenches(
        self,
        q: ArrayLike,
        qd: ArrayLike | None,
        qdd: ArrayLike | None,
        base_motion: BaseMotion | None = None,
    ) -> tuple[np.ndarray, bool]:
        """Wrenches (N, 6) on the base in states, and whether a single state was given."""
        angles, single = joint_states("q", q, self.n)
        speeds, accelerations = (
            np.zeros_like(angles) if value is None else joint_states(name, value, self.n)[0]
            for name, value in (("qd", qd), ("qdd", qdd))
        )
        if not len(angles) == len(speeds) == len(accelerations):
            counts = f"{len(angles)}, {len(speeds)} and {len(accelerations)}"
            raise InputError(f"q, qd, qdd: expected as many states of each, got {counts}")
        return self.loads(angles, speeds, accelerations, base_motion=base_motion)[1], single

    def require_fit(self, joints: int) -> None:
        """Raise InputError unless a motion has as many joints."""
        if joints != self.n:
            raise InputError(f"motion: has {joints} joints, the {self.kind} has {self.n}")

    def energy(self, motion: Trajectory, *, order: int = 4) -> float:
        """Electric energy, J, clamps included: Gauss-Legendre quadrature between switching times (5.25)."""
        robot = self.during(motion)
        times, weights = robot.quadrature(motion, order)
        if len(times) == 0:
            return 0.0
        q, qd, qdd = motion.states(times)
        power = self.motors.power(robot.loads(q, qd, qdd, robot.acting(times))[0], self.motor_speeds(q, qd))
        return float(weights @ np.sum(power, axis=1)) + self.support.power * motion.end

    def quadrature(self, motion: Trajectory, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Gauss-Legendre nodes and weights, s, in intervals in which the electric power is smooth."""
        return gauss_legendre(self.acts.pieces(motion), order)
