"""An arm on a base that only stands, and the arm of the printed experiments on its base."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Self

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, rotation_matrix, too_light
from ocptip.basics.values import rotations
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.unilateral import feet
from ocptip.contact.support import Support
from ocptip.numerics.quadrature import gauss_legendre
from ocptip.reserves.slip import Redistribution
from ocptip.robots.arm_source import arm_from, resting_base
from ocptip.robots.base_motion import BaseMotion, acceleration_of, inertial_wrench_of
from ocptip.robots.braking import gravity_torques
from ocptip.robots.collision.gaps import GapLabel, usual_clearance
from ocptip.robots.collision.model import collisions_of
from ocptip.robots.collision.shapes import BodyShape
from ocptip.robots.dynamics import Dynamics, evaluate_dynamics, inverse_dynamics, small_motions
from ocptip.robots.geometry import Floor, Obstacle
from ocptip.robots.kinematics import PointSpeeds, chain, checked_points, gripper_batch, link_frames
from ocptip.robots.model import ArmModel
from ocptip.robots.motors import DCMotors, Motors
from ocptip.robots.payload import Payload
from ocptip.robots.pinocchio import PinocchioModel
from ocptip.robots.process import PATH, SHARE, TIME, ProcessWrench
from ocptip.robots.spring_chain import SpringChain, spring_chain
from ocptip.standing.acting import Acting
from ocptip.standing.footing import Footing
from ocptip.standing.further_limits import FurtherLimits
from ocptip.standing.ground import floors_under
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.objects import (
    Object,
    carried_objects,
    carrier_expressions,
    carrier_motions,
    loaded,
    objects_note,
)
from ocptip.standing.sensor import WrenchSensor
from ocptip.trajectories.drive_profile import DriveProfile
from ocptip.trajectories.path import JointPath
from ocptip.trajectories.pieces import MERGE
from ocptip.trajectories.trajectory import Trajectory

_STEP = 0.005  # s: between instants at which the gripper's way is looked at
_STEPS = 2000  # of a path, likewise


class Robot(StandingMechanism):
    """An arm mounted on a base that stands on a support.

    Args:
        arm: its mount (`mount_position`, `mount_rotation`) in the base axes of the support.
        support: the base with its contacts; its mass and centre of mass without the arm.
        motors: drives of the joints.
        obstacles: floor, walls, pillars, solids in base axes, against which the arm is checked.
        shapes: of the base, in base axes.
        floor: what the contacts stand on is also an obstacle, unless `obstacles` has a floor.
        speed_limits: m/s, by name of a point: "tcp", or a joint, where its link begins.
        objects: that only contacts hold; `arm` and `support` hold their masses, see `carrying`.
        reference_moment, redistribution: see `StandingMechanism`.
        sensor: see `StandingMechanism`; default: where the arm is mounted, in base axes.
        drive_profile: how the base drives while the arm moves; default: it rests.

    Attributes:
        arm, obstacles, shapes, objects, drive_profile: as given.
        carried: the objects in the axes of what carries them.
        around: the obstacles and, where it counts, the floor that the base stands on.

    Raises:
        InputError: a planar support, or no gravity and no reference moment.
    """

    knows_inertia = True

    def __init__(
        self,
        arm: ArmModel,
        support: Support,
        motors: Motors,
        *,
        obstacles: Sequence[Obstacle] = (),
        shapes: Sequence[BodyShape] = (),
        floor: bool = True,
        speed_limits: Mapping[str, float] | None = None,
        objects: Sequence[Object] = (),
        reference_moment: float | None = None,
        redistribution: Redistribution | None = None,
        sensor: WrenchSensor | None = None,
        drive_profile: DriveProfile | None = None,
    ) -> None:
        self.drive_profile = drive_profile
        self.speed_limits = checked_points(arm, speed_limits)
        self._points = PointSpeeds(arm, self.speed_limits)
        self.further_limits = FurtherLimits.of_points(self.speed_limits)
        self.arm, self.obstacles, self.shapes = arm, tuple(obstacles), tuple(shapes)
        self.objects, self.carried = tuple(objects), carried_objects(objects, support.gravity)
        derived = floor and support.dimension == 3 and not any(isinstance(o, Floor) for o in self.obstacles)
        self.around = (*self.obstacles, *(floors_under(support) if derived else ()))
        super().__init__(
            support,
            motors,
            arm.limits,
            collisions_of(arm, self.around, self.shapes),
            float(np.sum(arm.masses)),
            reference_moment,
            redistribution,
            sensor or WrenchSensor(arm.mount_position),
        )

    @classmethod
    def from_urdf(
        cls,
        source: str | os.PathLike[str] | PinocchioModel,
        *,
        contacts: Sequence[Binding] | ArrayLike,
        base_mass: float | None = None,
        base_com: ArrayLike | None = None,
        friction: float | None = None,
        base_inertia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        base_link: str | None = None,
        tool_frame: str | None = None,
        mount_position: Sequence[float] = (0.0, 0.0, 0.0),
        mount_rotation: np.ndarray | None = None,
        payload: Payload | float | None = None,
        motors: Motors | None = None,
        locked_joints: Mapping[str, float] | None = None,
        collision: bool = True,
        package_dirs: Sequence[str | os.PathLike[str]] = (),
        **others: Any,
    ) -> Self:
        """A robot from the path of a URDF, its text, or a Pinocchio model, and from how its base stands.

        Args:
            source: path, text (it begins with <), or `pinocchio.Model`, which needs `tool_frame`.
            contacts: positions (n, 3), m, base axes, of ordinary contacts with a vertical normal; or contacts
                of any kind.
            base_mass: kg, without the arm; default: of those links of the URDF that do not move.
            base_com: (3,), m, base axes; default likewise.
            friction: coefficient of the contacts, where `contacts` are positions.
            base_inertia, gravity: see `Support`.
            base_link, tool_frame, locked_joints: see `ocptip.robots.urdf.arm_from_urdf`.
            mount_position: (3,), m: base origin to the origin of `base_link`; by default they are the same.
            mount_rotation: (3, 3): axes of `base_link` to base axes; default none.
            payload: what the gripper holds; kg: a point mass at the tool frame.
            motors: default: estimated from limits of torque and speed.
            collision, package_dirs: whether collision geometry is read, and folders of its ROS packages.
            others: obstacles, shapes, floor, reference_moment, redistribution, sensor: see `Robot`.

        Raises:
            InputError: an argument cannot be used; names it.
        """
        arm = arm_from(
            source,
            base_link=base_link,
            tool_frame=tool_frame,
            locked_joints=locked_joints,
            collision=collision,
            package_dirs=package_dirs,
        )
        if base_mass is None or base_com is None:
            mass, centre, _ = resting_base(source, arm)
            if not mass:
                name = "base_mass" if base_mass is None else "base_com"
                raise InputError(f"{name}: missing; the links of the arm's file that rest have no mass")
            turn = np.eye(3) if mount_rotation is None else rotation_matrix("mount_rotation", mount_rotation)
            base_mass = mass if base_mass is None else base_mass
            base_com = np.add(mount_position, turn @ centre) if base_com is None else base_com
        if reason := too_light(base_mass, arm.base_mass):
            raise InputError(f"base_mass: {reason}")
        support = Support(
            feet(contacts, friction),
            mass=base_mass,
            center_of_mass=base_com,
            inertia=base_inertia,
            gravity=gravity,
        )
        arm = arm.mounted(mount_position, mount_rotation)
        arm = arm.with_payload(Payload(payload) if isinstance(payload, float | int) else payload)
        if motors is None:
            motors, note = DCMotors.estimated(arm), "motors: estimated from torque and speed limits"
            arm = arm.with_notes(note)
        return cls(arm, support, motors, **others)

    def __repr__(self) -> str:
        """Joints with units, masses, contacts and payload."""
        kinds = Counter(contact.kind for contact in self.support.contacts)
        contacts = " and ".join(f"{count} {kind}" for kind, count in kinds.items())
        joints = ", ".join(f"{name} ({unit})" for name, unit in zip(self.names, self.units, strict=True))
        masses = ", ".join(f"{name} {mass:.4g} kg" for name, mass in self.masses.items())
        return f"<Robot {self.arm.name}: joints {joints}; {masses}; contacts {contacts}>"

    @property
    def payload(self) -> Payload | None:
        """The payload of the gripper; None without one."""
        return self.arm.payload

    def carrying(self, objects: Sequence[Object]) -> Self:
        """The robot with objects that only contacts hold; they also load its gripper and its base.

        Raises:
            InputError: it carries objects already, a name occurs twice, or an object stands on nothing.
        """
        if self.objects:
            raise InputError("objects: the robot carries some already; give all at once")
        arm, support = loaded(self.arm, self.support, objects)
        return self.varied(arm=arm, support=support, objects=tuple(objects))

    def without_objects(self) -> Self:
        """The robot without its objects and their loads."""
        if not self.objects:
            return self
        arm, support = loaded(self.arm, self.support, self.objects, -1)
        return self.varied(arm=arm, support=support, objects=())

    @property
    def interfaces(self) -> tuple[Footing, ...]:
        """See `StandingMechanism.interfaces`."""
        return (self, *(own.footing for own in self.carried))

    def object_wrenches(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, base_motion: BaseMotion | None = None
    ) -> tuple[np.ndarray, ...]:
        """See `StandingMechanism.object_wrenches`."""
        if not self.carried:
            return ()
        motions = carrier_motions(self.arm, self.support.gravity, q, qd, qdd, base_motion)
        return tuple(motions[own.carrier].inertial_wrench(own.footing.support) for own in self.carried)

    def object_expressions(
        self, q: cs.SX, qd: cs.SX, qdd: cs.SX, acting: cs.SX | None = None
    ) -> tuple[cs.SX, ...]:
        """See `StandingMechanism.object_expressions`."""
        if not self.carried:
            return ()
        base = self.acts.expressions(acting)[1]
        motions = carrier_expressions(self.arm, self.support.gravity, q, qd, qdd, base)
        return tuple(inertial_wrench_of(motions[own.carrier], own.footing.support) for own in self.carried)

    def joint_label(self, joint: int) -> str:
        """Name of a joint, counted from 0."""
        return self.names[joint]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(self.arm.joint_names)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the joints, "rad" or "m"."""
        return self.arm.units

    @property
    def motor_units(self) -> tuple[str, ...]:
        """Units of the drives' torques or forces, "N m" or "N"."""
        return tuple("N" if unit == "m" else "N m" for unit in self.units)

    @property
    def notes(self) -> tuple[str, ...]:
        """The assumptions about the arm, one sentence each, for reports."""
        process = () if self.arm.process is None else (f"process: {self.arm.process}",)
        usual, pair = self._usual_clearance
        near = () if pair is None else (
            f"clearance: {1e3 * usual:.1f} mm where none is given, for {pair} are never "
            f"farther apart than {2e3 * usual:.1f} mm",
        )  # fmt: skip
        drives = () if self.drive_profile is None else (
            f"the base drives: {self.drive_profile}; the arm has its clock, obstacles go along with it",
        )  # fmt: skip
        return self.arm.notes + objects_note(self.objects) + process + near + drives + super().notes

    @property
    def usual_clearance(self) -> float:
        """The default, or half the distance of a pair that is nearer in all random postures."""
        return self._usual_clearance[0]

    @cached_property
    def _usual_clearance(self) -> tuple[float, GapLabel | None]:
        return usual_clearance(self.arm, self.collision)

    def loads(
        self,
        q: np.ndarray,
        qd: np.ndarray,
        qdd: np.ndarray,
        acting: np.ndarray | None = None,
        base_motion: BaseMotion | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Joint torques (N, n), N m, or forces, N, and the total wrench (N, 6) on the base.

        Its moment is about the base's centre of mass.

        Raises:
            InputError: the process varies, and its values are not given.
        """
        return self._loads_of(self.arm, q, qd, qdd, acting, base_motion)

    @property
    def acts(self) -> Acting:
        """See `StandingMechanism.acts`."""
        return Acting(self.varying, self.drive_profile)

    def _loads_of(
        self,
        arm: ArmModel,
        q: np.ndarray,
        qd: np.ndarray,
        qdd: np.ndarray,
        acting: np.ndarray | None,
        base_motion: BaseMotion | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Torques and wrench on the base, see `loads`, with this arm instead."""
        support, (process, driving) = self.support, self.acts.split(acting)
        base_motion = base_motion or driving
        given = {"gravity": support.gravity, "about": support.center_of_mass, "base_motion": base_motion}
        dynamics = self.pushed(arm, q, qd, qdd, process, **given)
        own = support.weight if base_motion is None else support.weight + base_motion.inertial_wrench(support)
        return dynamics.torque, dynamics.wrench + own

    def pushed(
        self,
        arm: ArmModel,
        q: np.ndarray,
        qd: np.ndarray,
        qdd: np.ndarray,
        process: np.ndarray | None,
        *,
        gravity: ArrayLike,
        about: ArrayLike,
        base_motion: BaseMotion | None = None,
    ) -> Dynamics:
        """See `robots.dynamics.evaluate_dynamics`: of an arm with the process, (N, 6) if it varies."""
        load = {}
        if process is not None and self.varying is not None:
            arm, load = arm.without_process, {"force": process[:, :3], "moment": process[:, 3:]}
            if self.varying.turns_with_tool:
                turn = gripper_batch(arm)(q)[1]
                load = {name: np.einsum("kij,kj->ki", turn, rows) for name, rows in load.items()}
        given = {"gravity": gravity, "about": about, "base_motion": base_motion, **load}
        return evaluate_dynamics(arm, q, qd, qdd, **given)

    @property
    def varying(self) -> ProcessWrench | None:
        """The process, if it varies."""
        return self.arm.process if self.arm.process is not None and self.arm.process.varies else None

    def driving(self, profile: DriveProfile | None) -> Self:
        """The same robot on a base that drives so; None: it rests."""
        return self._changed(drive_profile=profile)

    def resting(self, share: float) -> Self:
        """See `StandingMechanism.resting`."""
        if self.drive_profile is not None:
            return self.driving(None).resting(share)
        process = self.varying
        if process is None:
            return self
        if share and process.over != SHARE:
            return self.varied(arm=self.arm.without_process)
        force, moment = process.at(np.array([share]))
        return self.varied(arm=self.arm.with_process(ProcessWrench(force[0], moment[0], process.axes)))

    @property
    def process_at_rest(self) -> np.ndarray:
        """See `StandingMechanism.process_at_rest`."""
        return np.zeros(6) if self.arm.process is None else self.arm.process.wrench

    def during(self, motion: Trajectory) -> Self:
        """The same robot with a process that varies over the time of a motion, if it varies.

        If it varies over the path of the TCP, this path is taken to be straight over 5 ms.
        """
        process = self.arm.process
        if process is None or process.over in ("", TIME):
            return self
        self.require_fit(motion.n)
        times, values = np.array([0.0, motion.end]), np.array([0.0, 1.0])
        if process.over == PATH:
            times = np.linspace(0.0, motion.end, 1 + max(1, int(np.ceil(motion.end / _STEP))))
            values = self._way(motion.states(times)[0])
        return self._changed(arm=self.arm.with_process(process.over_time(times, values)))

    def along(self, path: JointPath) -> Self:
        """The same robot with a process that varies over the path of the TCP, if it varies.

        Raises:
            InputError: it varies over time, which a path has not yet.
        """
        process = self.arm.process
        if self.drive_profile is not None:
            raise InputError("drive_profile: drives over time, which a path does not know before it is timed")
        if process is None or not process.varies:
            return self
        if process.over != PATH:
            raise InputError(
                f"process: varies over {process.over}, which a path does not know before it is timed; "
                "give it over path_m"
            )
        self.require_fit(path.joints)
        first, last = path.breakpoints[[0, -1]]
        places = np.union1d(np.linspace(first, last, _STEPS + 1), path.breakpoints)
        own = process.over_time(places, self._way(path.at(places)[0]))
        return self._changed(arm=self.arm.with_process(own))

    def at_pace(self, factor: float) -> Self:
        """The same with all times of what acts over time multiplied by a factor > 0."""
        acts = self.acts.at_pace(factor)
        arm = self.arm if acts.process is None else self.arm.with_process(acts.process)
        return self._changed(arm=arm, drive_profile=acts.drive_profile)

    def _changed(self, **arguments: Any) -> Self:
        """The same robot with another process, or on a base that drives otherwise; what was built stays."""
        other = object.__new__(type(self))
        vars(other).update(vars(self) | arguments | {"_arguments": {**self._arguments, **arguments}})
        return other

    def _way(self, q: np.ndarray) -> np.ndarray:
        """(N,), m: distance covered by the TCP on straight lines between postures (N, n)."""
        steps = np.linalg.norm(np.diff(self.tool(q), axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def pieces(self, motion: Trajectory) -> np.ndarray:
        """Intervals (S, 2), s, between switching times of the motion and knots of what acts."""
        knots = self.acts.knots
        if not len(knots) or not len(motion.intervals):
            return motion.intervals
        begins, ends = motion.intervals.T
        inside = [knots[(knots > a + MERGE) & (knots < b - MERGE)] for a, b in motion.intervals]
        begins = [np.concatenate([[a], own]) for a, own in zip(begins, inside, strict=True)]
        ends = [np.concatenate([own, [b]]) for b, own in zip(ends, inside, strict=True)]
        return np.column_stack([np.concatenate(begins), np.concatenate(ends)])

    def quadrature(self, motion: Trajectory, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Nodes and weights, s, between switching times of the motion and knots of what acts."""
        return gauss_legendre(self.pieces(motion), order) if self.acts.size else motion.quadrature(order)

    def _small_motions(
        self, arm: ArmModel, springs: tuple[int, ...], q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """With the base."""
        support, arm = self.support, arm.without_process if self.varying else arm
        found = small_motions(arm, springs)(q, qd, qdd, support.gravity, support.center_of_mass)
        inertia, turning, stiffening = found
        inertia[:, :6, :6] += np.linalg.inv(support.inverse_mass)
        return inertia, turning, stiffening.reshape(len(q), 6 + len(springs), -1)

    @property
    def chain(self) -> SpringChain | None:
        """The arm with springs in its gears; None: they do not give.

        Raises:
            InputError: that is not possible with this arm.
        """
        return None if self.arm.gears is None else spring_chain(self.arm)

    def swing_loads(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, acting: np.ndarray | None = None
    ) -> np.ndarray:
        """See `StandingMechanism.swing_loads`."""
        if self.chain is None:
            return self.loads(q, qd, qdd, acting)[1]
        own = [self.chain.spread(values) for values in (q, qd, qdd)]
        torques, wrenches = self._loads_of(self.chain.arm, own[0], own[1], own[2], acting)
        return np.hstack([wrenches, -torques[:, self.chain.springs]])

    def small_motions(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `StandingMechanism.small_motions`."""
        if self.chain is None:
            return self._small_motions(self.arm, (), q, qd, qdd)
        own = tuple(self.chain.springs.tolist())
        return self._small_motions(self.chain.arm, own, *map(self.chain.spread, (q, qd, qdd)))

    def gravity_torques(self) -> np.ndarray:
        """See `StandingMechanism.gravity_torques`."""
        return gravity_torques(self.arm, self.support.gravity)

    def tool(self, q: np.ndarray, springs: np.ndarray | None = None) -> np.ndarray:
        """Positions (N, 3), m, of the gripper."""
        if springs is not None and self.chain is not None:
            return gripper_batch(self.chain.arm)(self.chain.spread(q, springs))[0]
        return gripper_batch(self.arm)(q)[0]

    def further(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Speeds of the points in `speed_limits`, (N, k), m/s."""
        return self._points(q, qd)

    def further_expressions(self, q: cs.SX, qd: cs.SX) -> cs.SX:
        """Speeds of the points in `speed_limits` as CasADi column (k,), m/s."""
        return self._points.expressions(q, qd)

    def gripper(self, q: np.ndarray) -> np.ndarray:
        """Poses (N, 7) of the gripper, see `MotionSamples`."""
        position, rotation, _ = gripper_batch(self.arm)(q)
        return np.hstack([position, rotations().from_matrix(rotation).as_quat()])

    def sticks(self, q: np.ndarray) -> list[np.ndarray]:
        """One line, from the mount over the joints to the gripper."""
        return [np.vstack([self.arm.mount_position, link_frames(self.arm, q).origins])]

    def load_expressions(
        self, q: cs.SX, qd: cs.SX, qdd: cs.SX, acting: cs.SX | None = None
    ) -> tuple[cs.SX, cs.SX]:
        """Torques and wrench as CasADi columns; `acting` (k,) are present values, see `Acting`."""
        support, arm, force, moment = self.support, self.arm, cs.SX.zeros(3), cs.SX.zeros(3)
        process, base = self.acts.expressions(acting)
        if process is not None and self.varying:
            arm, turns = self.arm.without_process, self.varying.turns_with_tool
            turn = chain(arm, q)[0][-1] if turns else cs.SX.eye(3)
            force, moment = (turn @ part for part in cs.vertsplit(process, 3))
        pull, own = cs.SX(support.gravity), cs.SX(support.weight)
        if base:
            pull = pull - acceleration_of(base, cs.SX(arm.mount_position))
            own = own + inertial_wrench_of(base, support)
        torque, wrench = inverse_dynamics(arm, bool(base))(
            q, qd, qdd, pull, force, moment, support.center_of_mass, *base[1:]
        )
        return torque, wrench + own
