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

from ocptip.basics.errors import InputError
from ocptip.basics.values import rotations
from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.unilateral import feet
from ocptip.contact.support import Support
from ocptip.reserves.equal_compliance import equally_compliant
from ocptip.reserves.slip import Redistribution
from ocptip.robots.base_motion import BaseMotion, acceleration_of, inertial_wrench_of
from ocptip.robots.braking import gravity_torques
from ocptip.robots.collision.gaps import GapLabel, usual_clearance
from ocptip.robots.collision.model import collisions_of
from ocptip.robots.collision.shapes import BodyShape
from ocptip.robots.dynamics import Dynamics, dynamics_of_states, inverse_dynamics, small_motions
from ocptip.robots.geometry import Floor, Obstacle
from ocptip.robots.kinematics import PointSpeeds, checked_points, gripper_batch, link_frames
from ocptip.robots.model import ArmModel
from ocptip.robots.motors import DCMotors, Motors
from ocptip.robots.payload import Payload
from ocptip.robots.pinocchio import PinocchioModel
from ocptip.robots.process import ProcessWrench
from ocptip.robots.spring_chain import SpringChain, spring_chain
from ocptip.robots.urdf.arm_source import arm_from, base_of
from ocptip.standing.acting import Acting
from ocptip.standing.further_limits import FurtherLimits
from ocptip.standing.ground import floors_under
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.objects import (
    Object,
    carried_objects,
    loaded,
    objects_note,
    outlines,
)
from ocptip.standing.sensor import WrenchSensor
from ocptip.trajectories.drive_profile import DriveProfile
from ocptip.trajectories.path import JointPath, PathTiming
from ocptip.trajectories.trajectory import Trajectory


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
        obstacles, shapes, objects, drive_profile: as given.
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
        self._arm, self.obstacles, self.shapes = arm, tuple(obstacles), tuple(shapes)
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
    def of(
        cls, robot: StandingMechanism, refusal: str = "only for arms; this robot is a parallel one"
    ) -> Robot:
        """The mechanism as an arm; InputError with the refusal if it is none."""
        if not isinstance(robot, cls):
            raise InputError(refusal)
        return robot

    @property
    def arm(self) -> ArmModel:
        """The serial arm, as given."""
        return self._arm

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
            base_mass: kg, with those links of the URDF that do not move; default: of these alone.
            base_com: (3,), m, base axes; default likewise.
            friction: coefficient of the contacts, where `contacts` are positions.
            base_inertia, gravity: see `Support`.
            base_link, tool_frame, locked_joints: see `ocptip.robots.urdf.arm.arm_from_urdf`.
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
        base_mass, base_com = base_of(source, arm, base_mass, base_com, mount_position, mount_rotation)
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
    def notes(self) -> tuple[str, ...]:
        """The assumptions about the arm, one sentence each, for reports."""
        process = () if self.arm.process is None else (f"process: {self.arm.process}",)
        usual, pair = self._usual_clearance
        near = () if pair is None else (
            f"clearance: {1e3 * usual:.1f} mm unless `[limits]` gives one, for {pair} are never "
            f"farther apart than {2e3 * usual:.1f} mm",
        )  # fmt: skip
        drives = () if self.drive_profile is None else self.drive_profile.notes
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
        process = self.arm.process
        return Acting(process if process and process.varies else None, self.drive_profile)

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
        load = (
            support.weight if base_motion is None else support.weight + base_motion.inertial_wrench(support)
        )
        return dynamics.torque, dynamics.wrench + load

    def pushed(
        self,
        arm: ArmModel,
        q: np.ndarray,
        qd: np.ndarray,
        qdd: np.ndarray,
        process: np.ndarray | None,
        *,
        gravity: np.ndarray,
        about: np.ndarray,
        base_motion: BaseMotion | None = None,
    ) -> Dynamics:
        """See `robots.dynamics.dynamics_of_states`: of an arm with the process, (N, 6) if it varies."""
        arm, load = self.acts.on_gripper(arm, q, process)
        return dynamics_of_states(arm, q, qd, qdd, gravity, about, **load, base_motion=base_motion)

    def driving(self, profile: DriveProfile | None) -> Self:
        """The same robot on a base that drives so; None: it rests."""
        return self._under(self.arm.process, profile)

    @cached_property
    def if_alike(self) -> Self | None:
        """The same robot on equally compliant contacts; None where `equally_compliant` has none."""
        support = equally_compliant(self.support)
        return None if support is None else self.varied(support=support, redistribution=None)

    def resting(self, share: float) -> Self:
        """See `StandingMechanism.resting`."""
        process = self.varying.resting(share) if self.varying else self.arm.process
        return self._under(process, None)

    @property
    def process_at_rest(self) -> np.ndarray:
        """See `StandingMechanism.process_at_rest`."""
        return np.zeros(6) if self.arm.process is None else self.arm.process.wrench

    def during(self, motion: Trajectory) -> Self:
        """See `StandingMechanism.during` and `Acting.during`."""
        self.require_fit(motion.n)
        return self._acted_on(self.acts.during(motion, self.tool))

    def along(self, path: JointPath, timing: PathTiming | None = None) -> Self:
        """See `StandingMechanism.along` and `Acting.along`."""
        self.require_fit(path.joints)
        return self._acted_on(self.acts.along(path, self.tool, timing))

    def at_pace(self, factor: float) -> Self:
        """The same with all times of what acts over time multiplied by a factor > 0."""
        return self._acted_on(self.acts.at_pace(factor))

    def _acted_on(self, acts: Acting) -> Self:
        """The same robot; a constant process stays."""
        return self._under(acts.process or self.arm.process, acts.drive_profile)

    def _under(self, process: ProcessWrench | None, drive_profile: DriveProfile | None) -> Self:
        """The same robot with this process, on a base that drives so; what was built stays."""
        unchanged = process is self.arm.process
        if unchanged and drive_profile is self.drive_profile:
            return self
        arm = self.arm if unchanged else self.arm.with_process(process)
        other, given = object.__new__(type(self)), {"arm": arm, "drive_profile": drive_profile}
        changed = {"_arm": arm, "drive_profile": drive_profile, "_arguments": {**self._arguments, **given}}
        vars(other).update(vars(self) | changed)
        return other

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
        spread = [self.chain.spread(values) for values in (q, qd, qdd)]
        torques, wrenches = self._loads_of(self.chain.arm, spread[0], spread[1], spread[2], acting)
        return np.hstack([wrenches, -torques[:, self.chain.springs]])

    def small_motions(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `StandingMechanism.small_motions`."""
        arm, springs, states = self.arm, (), (q, qd, qdd)
        if self.chain is not None:
            arm, springs = self.chain.arm, tuple(self.chain.springs.tolist())
            states = tuple(map(self.chain.spread, states))
        support, arm = self.support, arm.without_process if self.varying else arm
        result = small_motions(arm, springs)(*states, support.gravity, support.center_of_mass)
        inertia, turning, stiffening = result
        inertia[:, :6, :6] += np.linalg.inv(support.inverse_mass)
        return inertia, turning, stiffening.reshape(len(q), 6 + len(springs), -1)

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
        """One line, from the mount over the joints to the gripper; a closed one around each object."""
        line = np.vstack([self.arm.mount_position, link_frames(self.arm, q).origins])
        return [line, *outlines(self.arm, self.carried, q)]

    def load_expressions(
        self, q: cs.SX, qd: cs.SX, qdd: cs.SX, acting: cs.SX | None = None
    ) -> tuple[cs.SX, cs.SX]:
        """Torques and wrench as CasADi columns; `acting` (k,) are present values, see `Acting`."""
        support, acts = self.support, self.acts
        process, base = acts.expressions(acting)
        arm, load = acts.on_gripper_expressions(self.arm, q, process)
        pull, total = cs.SX(support.gravity), cs.SX(support.weight)
        if base:
            pull = pull - acceleration_of(base, cs.SX(arm.mount_position))
            total = total + inertial_wrench_of(base, support)
        torque, wrench = inverse_dynamics(arm, bool(base))(
            q, qd, qdd, pull, *load, support.center_of_mass, *base[1:]
        )
        return torque, wrench + total
