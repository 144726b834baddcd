"""A motion replayed by MuJoCo from its exported model: free base, joints that do what was commanded.

Joints follow their commands exactly: each gets an inertia so large that nothing else moves it, and the
torque that this inertia needs, which is no business of the base. All else is MuJoCo's: rigid bodies,
contacts, friction. Its contacts are never quite rigid: what the replay says of stiff feet depends a little on
the step and on the numbers for contacts, which the report names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, OcptipError
from ocptip.contact.bindings.unilateral import DAMPING_RATIO, UnilateralContact
from ocptip.numerics.inertia import union
from ocptip.robots.payload import Payload
from ocptip.standing.arm import StandingRobot
from ocptip.standing.on_feet import on_its_feet
from ocptip.standing.simulation.bodies import real_bodies
from ocptip.standing.simulation.mjcf import (
    BASE,
    FOOT,
    ON_SPRINGS,
    PAYLOAD,
    PROCESS,
    RIGID,
    SENSOR,
    STEP,
    held_body,
    joint_offsets,
    joint_order,
    principal,
    require_exportable,
    to_mjcf,
)
from ocptip.trajectories.sampled import Motion

LIFTED, SLID = 0.05e-3, 0.5e-3  # m: more than that is a lift, a slide
FALLEN = 0.02  # m: a foot so high
BEFORE, AFTER = 0.05, 0.2  # s of rest before and after the motion
_SETTLED = 0.03  # s of rest before the motion that are not looked at
_PRESCRIBED = 1e8  # kg m^2 of every joint
_EVENT = 2.0  # steps around an event in which forces are means of before and after


@dataclass(frozen=True)
class World:
    """How the replayed world differs from the one that was planned for.

    Attributes:
        stiffness: of all feet, N/m, with damping; None: as described.
        damping: ratio of the lowest mode, for `stiffness`.
        tilt: of floor, base and robot, rad.
        downhill: rad, direction of the tilt from the base's x axis to its y axis.
        payload: kg more at the gripper point.
        friction: factor on all coefficients.
        speed: factor.
        masses: factors on the masses of base, links and payload, in this order; those left out: 1.
        late: s, by which each joint is late; empty: none is.
    """

    stiffness: float | None = None
    damping: float = DAMPING_RATIO
    tilt: float = 0.0
    downhill: float = 0.0
    payload: float = 0.0
    friction: float = 1.0
    speed: float = 1.0
    masses: tuple[float, ...] = ()
    late: tuple[float, ...] = ()

    def text(self) -> str:
        """In words; empty where nothing differs."""
        parts = []
        if self.stiffness is not None:
            parts.append(f"feet of {self.stiffness:.3g} N/m, {100 * self.damping:.3g} % damping")
        if self.tilt:
            toward = np.array([np.cos(self.downhill), np.sin(self.downhill)])
            x, y = np.round(toward, 2) + 0.0
            parts.append(
                f"floor tilted by {np.degrees(self.tilt):.3g} deg, downhill towards ({x:g}, {y:g}, 0)"
            )
        if self.payload:
            parts.append(f"{self.payload:.3g} kg more at the gripper")
        if self.friction != 1:
            parts.append(f"friction x {self.friction:.3g}")
        if self.speed != 1:
            parts.append(f"speed x {self.speed:.4g}")
        return ", ".join(parts)

    def robot(self, robot: StandingRobot) -> StandingRobot:
        """The robot there, but for the factors on masses."""
        arm, own = robot.arm, robot.support
        if self.payload:
            arm = arm.with_payload(_with_more(arm.payload, self.payload))
        contacts = []
        for k, contact in enumerate(own.contacts):
            changes: dict[str, Any] = {
                key: self.friction * value
                for key, value in vars(contact).items()
                if key.startswith("friction")
            }
            if self.stiffness is not None:
                if not isinstance(contact, UnilateralContact):
                    raise InputError(f"stiffness: contact {k + 1} is a {contact.kind}, which does not give")
                none = {"tangential_stiffness": None, "damping": None}
                changes |= {"stiffness": self.stiffness, "damping_ratio": self.damping, **none}
            contacts.append(replace(contact, **changes))
        support = own.varied(contacts, gravity=self.gravity(own.gravity))
        return robot.varied(arm=arm, support=support, reference_moment=robot.tip_over.reference_moment)

    def gravity(self, gravity: np.ndarray) -> np.ndarray:
        """(3,) in base axes."""
        if not self.tilt:
            return gravity
        down = gravity / np.linalg.norm(gravity)
        side = np.array([np.cos(self.downhill), np.sin(self.downhill), 0.0])
        side = side - (side @ down) * down
        size = np.linalg.norm(gravity)
        return size * (np.cos(self.tilt) * down + np.sin(self.tilt) * side / np.linalg.norm(side))


def _with_more(payload: Payload | None, mass: float) -> Payload:
    """A payload and a point mass at the gripper point."""
    if payload is None:
        return Payload(mass)
    both = union(
        (payload.mass, payload.center_of_mass, payload.inertia), (mass, np.zeros(3), np.zeros((3, 3)))
    )
    return Payload(*both)


@dataclass(frozen=True, eq=False)
class Replay:
    """What a simulator saw.

    Attributes:
        world: that was simulated.
        times: (T,), s, in the middle of steps.
        forces: (T, n), N, normal forces of the contacts.
        heights: (T, n), m, of the soles above the ground; of rigid clamps zero.
        slides: (n,), m, the farthest that a sole that pressed was from where it stood at the start.
        end: of the motion, s.
        falls: the base fell over, or the simulation broke off.
        quiet: (T,) True outside of steps with an event, in which forces are means.
        step: s.
    """

    world: World
    times: np.ndarray
    forces: np.ndarray
    heights: np.ndarray
    slides: np.ndarray
    end: float
    falls: bool
    quiet: np.ndarray = field(repr=False)
    step: float = STEP

    @property
    def lift(self) -> float:
        """Greatest height of a sole, m."""
        return float(self.heights.max())

    @property
    def slide(self) -> float:
        """Longest slide, m."""
        return float(self.slides.max())

    @property
    def stands(self) -> bool:
        """No lift above `LIFTED`, no slide above `SLID`, no fall."""
        return not self.falls and self.lift <= LIFTED and self.slide <= SLID

    @property
    def least(self) -> tuple[float, float, int]:
        """Least normal force, N, when, s, and at which contact, from 1."""
        at, k = np.unravel_index(np.argmin(self.forces), self.forces.shape)
        return float(self.forces[at, k]), float(self.times[at]), int(k) + 1


def simulator_numbers(robot: StandingRobot, step: float) -> str:
    """What of a replay belongs to the simulator, in words."""
    elastic = robot.support.elastic is not None
    numbers = ON_SPRINGS if elastic else RIGID
    time, damping = max(numbers["solref"][0], 2 * step), numbers["solref"][1]
    soles = (
        f"soles that give within {1e3 * time:.2g} ms, damping {damping:g}, impedance {numbers['solimp'][0]:g}"
    )
    springs = f", on springs with {100 * FOOT:g} % of the base's mass each" if elastic else ""
    return f"MuJoCo {library_mujoco().__version__}, step {1e3 * step:.3g} ms, {soles}{springs}"


def library_mujoco() -> Any:
    """MuJoCo; InputError says how to get it."""
    try:
        import mujoco
        import mujoco.rollout
    except ImportError:
        raise InputError("MuJoCo is not installed (pip install 'ocptip[simulate]')") from None
    return mujoco


class Simulator:
    """Replays a motion in worlds that differ.

    Args:
        robot: an arm on its base.
        motion: of it.
        step: s.

    Raises:
        InputError: it cannot be exported, or MuJoCo is not there.
    """

    def __init__(self, robot: StandingRobot, motion: Motion, *, step: float = STEP) -> None:
        self.mujoco = library_mujoco()
        self.robot, self.motion, self.step = require_exportable(robot), motion, step
        self._models: dict[tuple, PrescribedModel] = {}

    def run(self, world: World | None = None) -> Replay:
        """Replay the motion in a world.

        Raises:
            InputError: the world cannot be simulated.
        """
        return self.run_many([world or World()])[0]

    def run_many(self, worlds: Sequence[World]) -> list[Replay]:
        """The same in several worlds, one after the other."""
        return [self._run(world) for world in worlds]

    def _run(self, world: World) -> Replay:
        mujoco = self.mujoco
        prescribed = self._model_of(world)
        held = self.robot.arm.payload
        model = prescribed.compiled(world, _with_more(held, world.payload) if world.payload else held)
        robot = prescribed.robot
        motion = self.motion if world.speed == 1 else self.motion.time_scaled(1 / world.speed)
        bodies = real_bodies(robot.arm)
        late = np.array(world.late) if world.late else np.zeros(robot.n)
        count = int(np.ceil((BEFORE + motion.end + late.max() + AFTER) / self.step))
        times = self.step * np.arange(count + 1) - BEFORE
        speeds = joint_order(robot, bodies, _speeds(motion, times, late))
        feet = speeds.shape[1] - robot.arm.links - len(bodies.rotors)
        controls = np.diff(speeds[:, feet:], axis=0) / self.step
        if robot.arm.process is not None:
            controls = np.hstack([np.ones((len(controls), 1)), controls])
        data = mujoco.MjData(model)
        data.qpos[:3], data.qpos[3:7] = robot.support.center_of_mass, [1, 0, 0, 0]
        data.qpos[7:] = joint_order(robot, bodies, motion.start) + joint_offsets(robot, bodies)
        if robot.support.elastic is not None:
            _rest(mujoco, model, data, robot)
        state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        before = mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(lambda _: None)  # else it writes a log file where the user stands
        try:
            _, sensed = mujoco.rollout.rollout(model, [data], state[None], controls[None])
        finally:
            mujoco.set_mju_user_warning(before)
        unstable = any(data.warning[kind].number for kind in _unstable(mujoco))
        first = round(_SETTLED / self.step)
        return self._seen(world, robot, motion, times[first:], late, sensed[0, first:], unstable)

    def _model_of(self, world: World) -> PrescribedModel:
        """The model of all worlds with such feet and, if this one has it, with more payload."""
        key = world.stiffness, world.damping, world.payload > 0
        if key not in self._models:
            like = World(stiffness=world.stiffness, damping=world.damping, payload=world.payload)
            self._models[key] = PrescribedModel(like.robot(self.robot), self.motion, self.step)
        return self._models[key]

    def _seen(
        self,
        world: World,
        robot: StandingRobot,
        motion: Motion,
        times: np.ndarray,
        late: np.ndarray,
        sensed: np.ndarray,
        unstable: bool,
    ) -> Replay:
        count = len(robot.support.contacts)
        forces, heights, slides = (
            np.zeros((len(sensed), count)),
            np.zeros((len(sensed), count)),
            np.zeros(count),
        )
        at = 0
        for k, contact in enumerate(robot.support.contacts):
            jaws = 1 if isinstance(contact, UnilateralContact) else 2
            place = sensed[:, at + 1 : at + 4]
            for sign in (1, -1)[:jaws]:
                forces[:, k] += sign * sensed[:, at]
                at += 4
            away = place - place[0]
            height = (place - np.asarray(contact.position)) @ contact.normal + SENSOR
            if jaws == 1:
                heights[:, k] = np.maximum(height, 0.0)
            across = np.linalg.norm(away - (away @ contact.normal)[:, None] * contact.normal, axis=1)
            slides[k] = np.max(across, where=forces[:, k] > 0, initial=0.0)
        middle = times[:-1] + 0.5 * self.step
        events = (motion.event_times[:, None] + late[None]).ravel()
        quiet = np.abs(middle[:, None] - events[None]).min(axis=1) > _EVENT * self.step
        broken = unstable or not np.isfinite(sensed).all()
        heights, forces = np.nan_to_num(heights, nan=np.inf), np.nan_to_num(forces)
        return Replay(
            world, middle, forces, heights, slides, motion.end + float(late.max()),
            broken or bool(heights.max() > FALLEN), quiet, self.step,
        )  # fmt: skip


def _unstable(mujoco: Any) -> tuple[int, ...]:
    """Warnings after which a simulation means nothing."""
    kinds = mujoco.mjtWarning
    return tuple(int(k) for k in (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC))


def prescribed(text: str, step: float) -> Any:
    """The MjSpec of an exported model with joints that do what is commanded.

    Raises:
        OcptipError: MuJoCo does not take it.
    """
    mujoco = library_mujoco()
    try:
        spec = mujoco.MjSpec.from_string(text)
    except ValueError as error:
        raise OcptipError(f"MuJoCo: {error}") from error
    for what in (*spec.actuators, *spec.equalities, *spec.keys):
        if what.name != PROCESS:
            spec.delete(what)
    spec.option.timestep = step
    for joint in spec.joints:
        if joint.name == BASE or joint.stiffness[0] > 0:
            continue
        joint.armature = _PRESCRIBED
        motor = spec.add_actuator(name=joint.name, target=joint.name)
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.gear[0] = _PRESCRIBED
    return spec


class PrescribedModel:
    """An exported model with joints that do what is commanded, for worlds that differ.

    The feet's damping is that of the payload with which it is made.

    Args:
        robot: in one of the worlds: its feet, and whether it holds anything, are those of all.
        motion: that is exported with it.
        step: s.

    Raises:
        OcptipError: MuJoCo does not take it.
    """

    def __init__(self, robot: StandingRobot, motion: Motion, step: float) -> None:
        self.robot = robot
        spec = prescribed(to_mjcf(robot, motion), step)
        self._spec = spec
        self._payload = next((body for body in spec.bodies if body.name == PAYLOAD), None)
        self._bodies = [[(one, one.mass, np.array(one.inertia)) for one in part] for part in _parts(spec)]
        self._pairs = [(pair, np.array(pair.friction)) for pair in spec.pairs]

    def compiled(self, world: World, payload: Payload | None) -> Any:
        """The model of a world; its feet are not looked at.

        Args:
            world: that it is.
            payload: that the robot holds there.

        Raises:
            OcptipError: MuJoCo does not take it.
        """
        self._spec.option.gravity = world.gravity(self.robot.support.gravity)
        for pair, friction in self._pairs:
            pair.friction = [*(world.friction * friction[:2]), *friction[2:]]
        for part, factor in zip(self._bodies, [*world.masses, *(1.0 for _ in self._bodies)], strict=False):
            for one, mass, inertia in part:
                one.mass, one.inertia = factor * mass, factor * inertia
                if one is self._payload and payload is not None:
                    mass, one.ipos, inertia, one.iquat = principal(held_body(self.robot.arm, payload))
                    one.mass, one.inertia = factor * mass, factor * inertia
        try:
            return self._spec.compile()
        except ValueError as error:
            raise OcptipError(f"MuJoCo: {error}") from error


def _parts(spec: Any) -> list[list[Any]]:
    """Bodies of the base, of each link with the rotors on it, and of the payload."""
    parts: list[list[Any]] = [[]]
    for body in spec.bodies:
        if body.name == BASE or body.name.startswith("foot"):
            parts[0].append(body)
        elif body.name.startswith("link") or body.name == PAYLOAD:
            parts.append([body])
    for body in spec.bodies:
        if body.name.endswith(" rotor"):
            own = [part for part in parts if part[0].name == body.parent.name]
            own[0].append(body)
    return parts


def _speeds(motion: Motion, times: np.ndarray, late: np.ndarray) -> np.ndarray:
    """(T, n) joint speeds, each joint late by its time."""
    found = np.empty((len(times), len(late)))
    for delay in np.unique(late):
        own = np.clip(times - delay, 0.0, motion.end)
        speeds = motion.states(own)[1]
        speeds[(times - delay <= 0) | (times - delay >= motion.end)] = 0.0
        found[:, late == delay] = speeds[:, late == delay]
    return found


def _rest(mujoco: Any, model: Any, data: Any, robot: StandingRobot) -> None:
    """Put the base where its springs hold it at rest, the soles where they stood without load."""
    support, elastic = robot.support, robot.support.elastic
    assert elastic is not None
    mujoco.mj_forward(model, data)
    load = -np.array(data.qfrc_bias[:6])
    K = np.zeros((6, 6))
    for k, arm in enumerate(support.arms):
        jacobian = np.hstack([np.eye(3), -_cross(arm)])
        frame = support.frames[k]
        K += jacobian.T @ (frame * elastic.stiffness[k]) @ frame.T @ jacobian
    moved = np.linalg.solve(K, load)
    turn = Rotation.from_rotvec(moved[3:])
    data.qpos[:3] += moved[:3]
    data.qpos[3:7] = np.roll(turn.as_quat(), 1)
    for k, arm in enumerate(support.arms):
        away = moved[:3] + turn.apply(arm) - arm
        data.qpos[7 + 3 * k : 10 + 3 * k] = -support.frames[k].T @ turn.inv().apply(away)


def _cross(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


@dataclass(frozen=True, eq=False)
class Compared:
    """A replay beside what the library says of the same world.

    Attributes:
        least: (n,), N, least normal forces of the library.
        when: (n,), s.
        rms_least: N, root mean square over time of the difference of the least foot force.
        rms: N, of all normal forces.
        stands: the library says that no contact is lost.
    """

    least: np.ndarray
    when: np.ndarray
    rms_least: float
    rms: float
    stands: bool


def compared(robot: StandingRobot, motion: Motion, replay: Replay) -> Compared | None:
    """The library's normal forces at the instants of a replay, steps with events left out.

    None where it knows none: of rigid feet, more than three, one sharing of several is no prediction.
    """
    world = replay.world
    robot = world.robot(robot)
    motion = motion if world.speed == 1 else motion.time_scaled(1 / world.speed)
    inside = (replay.times > 0) & (replay.times < motion.end) & replay.quiet
    times, theirs = replay.times[inside], replay.forces[inside]
    if robot.support.elastic is not None:
        feet = on_its_feet(robot, motion)
        if feet is None:
            return None
        course = feet.course
        kept = times < course.times[-1]
        times, theirs, stands = times[kept], theirs[kept], not feet.lifts and not feet.falls
        ours = np.stack([np.interp(times, course.times, f) for f in course.forces[:, :, 0].T], axis=1)
    elif robot.support.n_contacts == 3 and np.linalg.matrix_rank(robot.support.arms) == 3:
        states = robot.contact_states(robot.loads(*motion.states(times))[1])
        ours, stands = states.contact_forces[:, :, 0], bool(np.all(states.persistent))
    else:
        return None
    at = np.argmin(ours, axis=0)
    away = theirs - ours
    return Compared(
        ours[at, np.arange(ours.shape[1])],
        times[at],
        _rms(theirs.min(axis=1) - ours.min(axis=1)),
        _rms(away),
        stands,
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
