"""A serial arm of turning and sliding joints as plain numbers: geometry, masses, limits, collision spheres.

Frames. Link i (1..n) carries frame i with origin Q_i on the axis of joint i and z along that axis;
`A_{i-1,i} = A0[i-1] Rz(phi_i)` maps vectors from frame i to frame i-1. A sliding (prismatic) joint does not
turn its link, `A_{i-1,i} = A0[i-1]`, but moves Q_i by phi_i, then m, along z_i. Frame 0, the mount, has its
origin in Q_1 (of a sliding joint 1: in its zero position) and rests in the base; the base frame is the
caller's (usually the base's centre of mass). The gripper frame G sits on link n. SI units and radians
throughout.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array, rotation_matrix
from ocptip.basics.frozen import settle
from ocptip.numerics.inertia import RigidBody, union
from ocptip.robots.collision.shapes import ArmGeometry
from ocptip.robots.coupling import Coupling
from ocptip.robots.gears import Gears
from ocptip.robots.payload import Payload
from ocptip.robots.process import ProcessWrench

FULL_SPEED = 0.5
"""s in which a joint reaches its full speed, where no acceleration is given."""


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of n joints; infinite where there is none.

    Attributes:
        angle_min, angle_max: (n,), rad (sliding joints: m).
        speed: (n,), rad/s (m/s), both directions.
        acceleration: (n,), rad/s^2 (m/s^2), both directions.
        torque: (n,), N m (N), both directions.
        jerk: (n,), rad/s^3 (m/s^3), both directions; by default there is none. Plans keep it by S-curves.
    """

    angle_min: np.ndarray
    angle_max: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray
    jerk: np.ndarray = None  # pyright: ignore[reportAssignmentType] # infinite

    def __post_init__(self) -> None:
        if self.jerk is None:
            settle(self, jerk=np.full(len(self.speed), np.inf))
        for name in ("angle_min", "angle_max", "speed", "acceleration", "torque", "jerk"):
            value = np.array(getattr(self, name), dtype=float)
            if value.ndim != 1 or np.isnan(value).any():
                raise InputError(
                    f"limits.{name}: expected n numbers (infinite where there is none), got {value}"
                )
            settle(self, **{name: value})
        lengths = {f.name: len(getattr(self, f.name)) for f in dataclasses.fields(self)}
        if len(set(lengths.values())) != 1:
            raise InputError(f"limits: all must have the same length, got {lengths}")
        for joint in np.flatnonzero(self.angle_min >= self.angle_max):
            raise InputError(
                f"limits: joint {joint + 1}: angle_min {self.angle_min[joint]} must be below angle_max "
                f"{self.angle_max[joint]} (rad, sliding joints m)"
            )
        for name in ("speed", "acceleration", "torque", "jerk"):
            if (getattr(self, name) <= 0).any():
                raise InputError(f"limits.{name}: must be > 0, got {getattr(self, name)}")

    @classmethod
    def unlimited(cls, joints: int) -> JointLimits:
        """Limits of `joints` joints that limit nothing."""
        none = np.full(joints, np.inf)
        return cls(-none, none, none, none, none)


@dataclass(frozen=True, eq=False)
class SphereSet:
    """Spheres fixed on one link that cover a part of it.

    Attributes:
        name: unique in its model.
        link: 1..L, or 0 for the resting mount.
        centres: (k, 3), m, frame `link` (for link 0: the mount frame, origin Q_1).
        radii: (k,), m.
    """

    name: str
    link: int
    centres: np.ndarray
    radii: np.ndarray

    def __post_init__(self) -> None:
        centres = finite_array(f"spheres {self.name!r}: centres", self.centres, (None, 3))
        radii = finite_array(f"spheres {self.name!r}: radii", self.radii, (len(centres),))
        if not len(radii) or (radii <= 0).any():
            raise InputError(f"spheres {self.name!r}: radii must be > 0 and at least one, got {radii}")
        settle(self, centres=centres, radii=radii)


@dataclass(frozen=True, eq=False)
class ArmModel:
    """A serial arm of n turning or sliding joints on a base that rests.

    Where joints follow others (`coupling`), n is the number of those that lead: joint values, speeds, torques
    and limits are theirs. There are more links then, L of them, each behind another joint; else L = n.

    Link inertias may be indefinite: a fast rotor behind a gear, split between two links, leaves a negative
    axial moment on one of them (6.11). Compared and hashed by identity, so functions can be cached per model.

    Attributes:
        name: for messages and titles.
        joint_names: n names.
        rotations: (L, 3, 3), A0: constant part of A_{i-1,i} = A0[i-1] Rz(phi_i).
        offsets: (L, 3), m: Q_i to Q_{i+1}, of a sliding joint i+1 in its zero position (last: to the TCP, G),
            in frame i.
        masses: (L,), kg.
        centres: (L, 3), m: Q_i to the link's centre of mass in frame i.
        inertias: (L, 3, 3), kg m^2, about the link's centre of mass, axes of frame i.
        limits: joint limits, (n,) each.
        tool_rotation: (3, 3), gripper axes to frame n.
        mount_position: (3,), m: base origin to Q_1 (of a sliding joint 1 in its zero position), base axes.
        mount_rotation: (3, 3), frame 0 to base axes.
        armature: (n,), kg m^2: rotor inertia times gear ratio squared. Adds armature * qdd to the joint
            torque and nothing to the base wrench, as in Pinocchio; zero for arms whose link inertias hold the
            rotors. Sliding joints: kg.
        spring_torque, spring_stiffness: (n,), N m and N m/rad (sliding joints: N, N/m): a spring beside the
            drive exerts spring_torque - spring_stiffness * q on the link, and the opposite on the link before
            it. The drive needs that much less; the base feels nothing of it. Zero by default.
        prismatic: (n,) True for sliding joints; by default none slides.
        notes: what was assumed when the arm was made, one sentence each, for reports.
        sphere_sets: collision spheres.
        collision_pairs: names of sphere sets checked against each other.
        floor_sets: names of sphere sets checked against the floor.
        obstacle_sets: names of sphere sets checked against walls and pillars.
        payload: what the gripper holds; it is in those of the last link.
        bare_link: the last link without payload, where there is one.
        process: what acts on the gripper while the arm moves; None: nothing. Part of all its dynamics.
        geometry: convex solids, which replace the spheres.
        base_link, resting: of an arm from a URDF: link of its base frame, and where joints of that file stand
            that do not move, rad or m by name.
        base_mass: kg, of that file's links that do not move and therefore belong to the base.
        states: named joint values of its SRDF, rad or m by name.
        coupling: joints that follow others; None: none does.
        gears: springs between drives and links; None: gears are rigid. Joint values of an arm are those of
            its links; only checks let them swing about that.
    """

    name: str
    joint_names: tuple[str, ...]
    rotations: np.ndarray
    offsets: np.ndarray
    masses: np.ndarray
    centres: np.ndarray
    inertias: np.ndarray
    limits: JointLimits
    tool_rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    mount_position: np.ndarray = field(default_factory=lambda: np.zeros(3))
    mount_rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    armature: np.ndarray = None  # pyright: ignore[reportAssignmentType] # zeros
    spring_torque: np.ndarray = None  # pyright: ignore[reportAssignmentType] # zeros
    spring_stiffness: np.ndarray = None  # pyright: ignore[reportAssignmentType] # zeros
    prismatic: np.ndarray = None  # pyright: ignore[reportAssignmentType] # none slides
    notes: tuple[str, ...] = ()
    sphere_sets: tuple[SphereSet, ...] = ()
    collision_pairs: tuple[tuple[str, str], ...] = ()
    floor_sets: tuple[str, ...] = ()
    obstacle_sets: tuple[str, ...] = ()
    payload: Payload | None = None
    bare_link: RigidBody | None = None
    process: ProcessWrench | None = None
    geometry: ArmGeometry | None = None
    base_link: str = ""
    resting: Mapping[str, float] = field(default_factory=dict)
    base_mass: float = 0.0
    states: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    coupling: Coupling | None = None
    gears: Gears | None = None

    def __post_init__(self) -> None:
        n = len(self.joint_names)
        if n == 0:
            raise InputError("joint_names: an arm needs at least one joint")
        for name in ("armature", "spring_torque", "spring_stiffness"):
            if getattr(self, name) is None:
                settle(self, **{name: np.zeros(n)})
        kinds = np.zeros(n, dtype=bool) if self.prismatic is None else np.array(self.prismatic)
        if kinds.shape != (n,) or kinds.dtype != bool:
            raise InputError(f"prismatic: expected {n} times true or false, got {self.prismatic!r}")
        settle(self, prismatic=kinds)
        links = n if self.coupling is None else len(self.coupling.names)
        shapes = {
            "rotations": (links, 3, 3),
            "offsets": (links, 3),
            "masses": (links,),
            "centres": (links, 3),
            "inertias": (links, 3, 3),
            "tool_rotation": (3, 3),
            "mount_position": (3,),
            "mount_rotation": (3, 3),
            "armature": (n,),
            "spring_torque": (n,),
            "spring_stiffness": (n,),
        }
        for name, shape in shapes.items():
            settle(self, **{name: finite_array(name, getattr(self, name), shape)})
        if len(self.limits.speed) != n:
            raise InputError(f"limits: expected {n} joints, got {len(self.limits.speed)}")
        for index, matrix in enumerate(self.rotations):
            rotation_matrix(f"rotations[{index}]", matrix)
        rotation_matrix("tool_rotation", self.tool_rotation)
        rotation_matrix("mount_rotation", self.mount_rotation)
        for name in ("masses", "armature", "spring_stiffness"):
            if (getattr(self, name) < 0).any():
                raise InputError(f"{name}: must be >= 0, got {getattr(self, name)}")
        skew = np.abs(self.inertias - self.inertias.transpose(0, 2, 1)).max(axis=(1, 2))
        if (skew > 1e-9 * (1e-6 + np.abs(self.inertias).max())).any():
            raise InputError(f"inertias: must be symmetric, link {int(np.argmax(skew)) + 1} is not")
        self._check_coupling()
        if self.gears is not None and len(self.gears.stiffness) != n:
            raise InputError(f"gear_stiffness: expected {n} joints, got {len(self.gears.stiffness)}")
        self._check_spheres(links)

    def _check_coupling(self) -> None:
        if self.coupling is not None and not (
            self.coupling.leading == self.joint_names
            and np.array_equal(self.coupling.slides[self.coupling.leads], self.prismatic)
        ):
            raise InputError(f"coupling: its leading joints must be {', '.join(self.joint_names)}")

    def _check_spheres(self, n: int) -> None:
        names = [s.name for s in self.sphere_sets]
        if len(set(names)) != len(names):
            raise InputError(f"sphere_sets: names must differ, got {names}")
        for spheres in self.sphere_sets:
            if not 0 <= spheres.link <= n:
                raise InputError(f"spheres {spheres.name!r}: link must be 0..{n}, got {spheres.link}")
        used = {name for pair in self.collision_pairs for name in pair}
        for name in sorted(used | set(self.floor_sets) | set(self.obstacle_sets)):
            if name not in names:
                raise InputError(f"no sphere set {name!r}; there are {', '.join(map(repr, names)) or 'none'}")

    @property
    def n(self) -> int:
        """Number of joints, without those that follow others."""
        return len(self.joint_names)

    @property
    def has_springs(self) -> bool:
        """Whether springs beside the drives hold some joints."""
        return bool(self.spring_torque.any() or self.spring_stiffness.any())

    @property
    def links(self) -> int:
        """Number of links L."""
        return len(self.masses)

    @property
    def chain_names(self) -> tuple[str, ...]:
        """Names of the joints of all links, (L,)."""
        return self.joint_names if self.coupling is None else self.coupling.names

    @property
    def slides(self) -> np.ndarray:
        """(L,) True where the joint of a link slides."""
        return self.prismatic if self.coupling is None else self.coupling.slides

    @property
    def periodic(self) -> np.ndarray:
        """(n,) True for joints that are where they were after a whole turn."""
        return ~self.prismatic if self.coupling is None else ~self.prismatic & self.coupling.alone

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the joints, "rad" or "m"."""
        return tuple("m" if slides else "rad" for slides in self.prismatic)

    def angle_range(self, margin: float) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest angles (n,), rad, with a margin; of sliding joints their limits, m."""
        less = np.where(self.prismatic, 0.0, margin)
        return self.limits.angle_min + less, self.limits.angle_max - less

    @property
    def file_units(self) -> tuple[str, ...]:
        """Units of the joints in files and figures, "deg" or "m"."""
        return tuple("m" if slides else "deg" for slides in self.prismatic)

    def in_degrees(self, q: np.ndarray) -> np.ndarray:
        """Joint values (..., n), rad, in `file_units`."""
        return np.where(self.prismatic, q, np.rad2deg(q))

    @property
    def reach(self) -> float:
        """Upper bound, m, of the distance from Q_1 to the TCP; endless slides do not count."""
        lengths = np.maximum(np.abs(self.limits.angle_min), np.abs(self.limits.angle_max))
        if self.coupling is not None:
            lengths = np.abs(self.coupling.ratios) * lengths[self.coupling.leaders] + np.abs(
                self.coupling.offsets
            )
        lengths = lengths[self.slides]
        return float(np.linalg.norm(self.offsets, axis=1).sum() + lengths[np.isfinite(lengths)].sum())

    @property
    def may_collide(self) -> bool:
        """Whether it is known where the arm is: by solids or spheres."""
        return self.geometry is not None or bool(self.sphere_sets)

    def mounted(self, position: Sequence[float], rotation: np.ndarray | None = None) -> ArmModel:
        """The same arm in another base frame, in which the present one sits at `position` and `rotation`.

        Args:
            position: (3,), m: new base origin to the present one, axes of the new base frame.
            rotation: (3, 3): present to new base axes; identity by default.
        """
        turn = np.eye(3) if rotation is None else finite_array("rotation", rotation, (3, 3))
        shift = finite_array("position", position, (3,))
        return dataclasses.replace(
            self,
            mount_position=shift + turn @ self.mount_position,
            mount_rotation=turn @ self.mount_rotation,
            process=self.process and self.process.seen_from(turn),
        )

    def with_payload(self, payload: Payload | None) -> ArmModel:
        """This arm with another payload in its gripper; None: without payload, to the last bit.

        The payload becomes a part of the last link: its mass and its parallel-axis terms are added exactly.
        """
        bare = self.bare_link or (float(self.masses[-1]), self.centres[-1], self.inertias[-1])
        whole = bare
        if payload is not None:
            whole = union(bare, payload.seen_from(self.tool_rotation, self.offsets[-1]))
        links = zip((self.masses, self.centres, self.inertias), whole, strict=True)
        masses, centres, inertias = (np.array([*values[:-1], value]) for values, value in links)
        return dataclasses.replace(
            self,
            masses=masses,
            centres=centres,
            inertias=inertias,
            payload=payload,
            bare_link=None if payload is None else bare,
        )

    def with_process(self, process: ProcessWrench | None) -> ArmModel:
        """This arm with another process on its gripper."""
        bare = self.without_process
        if process is None:
            return bare
        other = dataclasses.replace(bare, process=process)
        vars(other)["without_process"] = bare  # what was built for it serves again
        return other

    @cached_property
    def without_process(self) -> ArmModel:
        """This arm without a process on its gripper."""
        return self if self.process is None else dataclasses.replace(self, process=None)

    def with_gears(self, gears: Gears | None) -> ArmModel:
        """The same arm with elastic joints."""
        return dataclasses.replace(self, gears=gears)

    def with_limits(self, **limits: object) -> ArmModel:
        """The same arm with some limits replaced, e.g. `with_limits(acceleration=np.full(6, 5.0))`."""
        known = [f.name for f in dataclasses.fields(JointLimits)]
        for name in limits:
            if name not in known:
                raise InputError(f"limits: no {name!r}; there are {', '.join(known)}")
        return dataclasses.replace(self, limits=dataclasses.replace(self.limits, **limits))

    def with_notes(self, *notes: str) -> ArmModel:
        """The arm with further assumptions for reports, one sentence each."""
        return dataclasses.replace(self, notes=(*self.notes, *notes))

    def with_usual_accelerations(self, source: str) -> ArmModel:
        """The same arm whose joints reach full speed in `FULL_SPEED`, where no acceleration limit is known.

        Args:
            source: what does not give them, for the note: "the file".
        """
        speed, acceleration = self.limits.speed, self.limits.acceleration
        unknown = np.isfinite(speed) & ~np.isfinite(acceleration)
        if not unknown.any():
            return self
        joints = f"of joints {', '.join(self.joint_names[j] for j in np.flatnonzero(unknown))}"
        note = f"acceleration limits {joints}: full speed in {FULL_SPEED:g} s, for {source} gives none"
        arm = self.with_limits(acceleration=np.where(unknown, speed / FULL_SPEED, acceleration))
        return arm.with_notes(note)

    def with_spheres(
        self, sphere_sets: Iterable[SphereSet], *, excluded_pairs: Iterable[tuple[str, str]] = ()
    ) -> ArmModel:
        """The same arm with other collision spheres.

        All sets on links that are not neighbours are checked against each other except `excluded_pairs`; all
        sets on moving links are checked against floor and obstacles.

        Raises:
            InputError: an excluded pair names a set that does not exist.
        """
        sets = tuple(sphere_sets)
        names = [s.name for s in sets]
        excluded = {frozenset(pair) for pair in excluded_pairs}
        for name in sorted(set().union(*excluded) - set(names)):
            raise InputError(
                f"excluded_pairs: no sphere set {name!r}; there are {', '.join(map(repr, names))}"
            )
        pairs = tuple(
            (first.name, second.name)
            for index, first in enumerate(sets)
            for second in sets[index + 1 :]
            if abs(first.link - second.link) > 1 and frozenset((first.name, second.name)) not in excluded
        )
        moving = tuple(s.name for s in sets if s.link > 0)
        return dataclasses.replace(
            self, sphere_sets=sets, collision_pairs=pairs, floor_sets=moving, obstacle_sets=moving
        )


def joint_states(name: str, value: ArrayLike, joints: int) -> tuple[np.ndarray, bool]:
    """Return `value`, (n,) or (N, n), as (N, n) and whether it was a single state; NaN is refused.

    Raises:
        InputError: wrong shape or not finite.
    """
    single = np.ndim(value) == 1
    array = finite_array(name, value, (joints,) if single else (None, joints))
    return array[None] if single else array, single
