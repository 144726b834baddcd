"""A plan replayed by MuJoCo from its exported models: free base, joints that do what was commanded.

Joints follow their commands exactly: each gets an inertia so large that nothing else moves it, and the
torque that this inertia needs, which is no business of the base. All else is MuJoCo's: rigid bodies,
contacts, friction. Its contacts are never quite rigid: what the replay says of stiff feet depends a little on
the step and on the numbers for contacts, which the report names.

Of a cycle each segment has a model with what it holds, and goes on with the state in which the one before
ended: what the gripper takes or leaves comes and goes within a step, as fast as it moves then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, OcptipError
from ocptip.contact.bindings.clamps import ForceConstantTwoSidedClamp, RigidClamp
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.numerics.vectors import skew
from ocptip.robots.bodies import real_bodies
from ocptip.robots.payload import Payload
from ocptip.robots.simulators import RIGID, SENSOR, STEP, principal
from ocptip.standing.arm import Robot
from ocptip.standing.elastic.feet import on_its_feet
from ocptip.standing.parts import Part, owners
from ocptip.standing.simulation.mjcf import (
    BASE,
    FOOT,
    FOOT_BODY,
    JAW_BODY,
    NO_SLIP,
    ON_SPRINGS,
    PAYLOAD,
    PROCESS,
    held_body,
    joint_offsets,
    joint_order,
    require_exportable,
    springs_of,
    to_mjcf,
)
from ocptip.standing.simulation.objects import OBJECT_BODY, Moved, moved_objects, shift_centres
from ocptip.standing.simulation.world import World, with_more
from ocptip.trajectories.trajectory import Trajectory

FALLEN = 0.02  # m: a foot so high
BEFORE, AFTER = 0.05, 0.2  # s of rest before and after the motion
_SETTLED = 0.03  # s of rest before the motion that are not checked
_PRESCRIBED = 1e8  # kg m^2 of every joint
_EVENT = 2.0  # steps around an event in which forces are means of before and after


@dataclass(frozen=True, eq=False)
class Replay:
    """The result of a simulation: contact forces, distances and slides over time.

    Attributes:
        world: the scenario that was simulated.
        times: (T,), s, in the middle of steps.
        forces: (T, n), N, normal forces of the contacts.
        heights: (T, n), m, of the soles above the ground; of rigid clamps zero.
        slides: (n,), m, the farthest that a pressing sole was from its start; NaN: it has no friction.
        end: of the motion, s.
        falls: the base fell over, or the simulation broke off.
        quiet: (T,) True outside of steps with a switching time, in which forces are means.
        objects: how each object moved on what carries it, by name.
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
    objects: dict[str, Moved] = field(default_factory=dict)
    step: float = STEP

    @property
    def lift(self) -> float:
        """Maximum height of a sole, m."""
        return float(self.heights.max())

    @property
    def slide(self) -> float:
        """Longest slide, m."""
        return float(np.nanmax(self.slides, initial=0.0))

    @property
    def stands(self) -> bool:
        """No lift above `LIFTED`, no slide above `SLID`, no fall, of the base and of all objects."""
        moved = Moved(self.lift, self.slide), *self.objects.values()
        return not self.falls and all(body.stays for body in moved)


def simulator_numbers(robot: Robot, step: float) -> str:
    """The parameters of the simulator that influence a replay, in words."""
    elastic = robot.support.elastic is not None
    numbers = ON_SPRINGS if elastic else RIGID
    time, damping = max(numbers["solref"][0], 2 * step), numbers["solref"][1]
    soles = (
        f"soles that give within {1e3 * time:.2g} ms, damping {damping:g}, impedance {numbers['solimp'][0]:g}"
    )
    springs = f", on springs with {100 * FOOT:g} % of the base's mass each" if elastic else ""
    no_slip = f", {NO_SLIP} iterations against creep" if robot.objects else ""
    return f"MuJoCo {library_mujoco().__version__}, step {1e3 * step:.3g} ms, {soles}{springs}{no_slip}"


def library_mujoco() -> Any:
    """MuJoCo; InputError says how to get it."""
    try:
        import mujoco.rollout
    except ImportError:
        raise InputError("MuJoCo is not installed (pip install 'ocptip[simulate]')") from None
    return mujoco


class Simulator:
    """Replays a motion, or a cycle, in different scenarios.

    Args:
        parts: an arm's motions on its base, one after the other.
        step: s.

    Raises:
        InputError: it cannot be exported, or MuJoCo is not there.
    """

    def __init__(self, parts: Sequence[Part], *, step: float = STEP) -> None:
        self.mujoco = library_mujoco()
        self.parts = tuple(replace(part, robot=part.robot.during(part.motion)) for part in parts)
        self.step = step
        for part in self.parts:
            require_exportable(part.robot)
        self._models: dict[tuple, PrescribedModel] = {}

    def run(self, world: World | None = None) -> Replay:
        """Replay all parts in a scenario.

        Raises:
            InputError: the scenario cannot be simulated.
        """
        return self.run_many([world or World()])[0]

    def run_many(self, worlds: Sequence[World]) -> list[Replay]:
        """Replay all parts in several scenarios, one after the other."""
        return [self._run(world) for world in worlds]

    def _run(self, world: World) -> Replay:
        mujoco = self.mujoco
        models = [self._model(number, world) for number in range(len(self.parts))]
        parts = world.parts(self.parts)
        robot = parts[0].robot.without_objects()
        bodies = real_bodies(robot.arm)
        late = np.array(world.late) if world.late else np.zeros(robot.n)
        count = int(np.ceil((BEFORE + parts[-1].end + late.max() + AFTER) / self.step))
        times = self.step * np.arange(count + 1) - BEFORE
        speeds = sum(_speeds(part.motion, times - part.begin, late) for part in parts)
        speeds = joint_order(robot, bodies, np.asarray(speeds))
        feet = np.count_nonzero(springs_of(robot.support))
        driven = slice(feet, feet + robot.arm.links + len(bodies.rotors))
        controls = np.diff(speeds[:, driven], axis=0) / self.step
        data = mujoco.MjData(models[0])
        data.qpos[:3], data.qpos[3:7] = robot.support.center_of_mass, [1, 0, 0, 0]
        joints = joint_order(robot, bodies, parts[0].motion.start) + joint_offsets(robot, bodies)
        data.qpos[7 : 7 + len(joints)] = joints  # objects begin in their places
        if robot.support.elastic is not None:
            _rest(mujoco, models[0], data, robot)
        state = np.empty(mujoco.mj_stateSize(models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(models[0], data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        runs, unstable = [], False
        for number, part, instants in owners(parts, times[:-1] + 0.5 * self.step):
            control = controls[instants]
            if part.robot.arm.process is not None:
                acts = part.robot.acting(times[instants] + 0.5 * self.step - part.begin)
                control = np.hstack([acts if acts.size else np.ones((len(control), 1)), control])
            if len(control):
                state, seen, broken = _rolled(mujoco, models[number], state, control)
                runs.append(seen)
                unstable = unstable or broken
        first = round(_SETTLED / self.step)
        return self._seen(world, parts, times[first:], late, np.vstack(runs)[first:], unstable)

    def _model(self, number: int, world: World) -> Any:
        """Model of a part in a scenario; one serves all with such feet and, if need be, more payload."""
        part, key = self.parts[number], (number, world.stiffness, world.damping, world.payload > 0)
        if key not in self._models:
            like = World(stiffness=world.stiffness, damping=world.damping, payload=world.payload)
            self._models[key] = PrescribedModel(like.robot(part.robot), part.motion, self.step)
        held = part.robot.without_objects().arm.payload
        return self._models[key].compiled(world, with_more(held, world.payload) if world.payload else held)

    def _seen(
        self,
        world: World,
        parts: Sequence[Part],
        times: np.ndarray,
        late: np.ndarray,
        sensed: np.ndarray,
        unstable: bool,
    ) -> Replay:
        contacts = parts[0].robot.support.contacts
        count = len(contacts)
        (forces, heights), slides = np.zeros((2, len(sensed), count)), np.zeros(count)
        index = 0
        for k, contact in enumerate(contacts):
            signs = (1,) if isinstance(contact, UnilateralContact) else (1, -1)
            place, held = sensed[:, index + 1 : index + 4], np.zeros(len(sensed), dtype=bool)
            for sign in signs:
                forces[:, k] += sign * sensed[:, index]
                held |= sensed[:, index] > 0
                index += 4
            away = place - place[0]
            height = (place - np.asarray(contact.position)) @ contact.normal + SENSOR
            if not isinstance(contact, RigidClamp):
                yields = isinstance(contact, ForceConstantTwoSidedClamp)  # also downwards
                heights[:, k] = np.abs(height) if yields else np.maximum(height, 0.0)
            across = np.linalg.norm(away - (away @ contact.normal)[:, None] * contact.normal, axis=1)
            smooth = isinstance(contact, UnilateralContact) and not contact.friction
            slides[k] = np.nan if smooth else np.max(across, where=held, initial=0.0)
        middle = times[:-1] + 0.5 * self.step
        events = [part.begin + np.append(part.motion.event_times, part.end - part.begin) for part in parts]
        events = (np.concatenate(events)[:, None] + late[None]).ravel()
        quiet = np.abs(middle[:, None] - events[None]).min(axis=1) > _EVENT * self.step
        broken = unstable or not np.isfinite(sensed).all()
        heights, forces = np.nan_to_num(heights, nan=np.inf), np.nan_to_num(forces)
        return Replay(
            world, middle, forces, heights, slides, parts[-1].end + float(late.max()),
            broken or bool(heights.max() > FALLEN), quiet, moved_objects(parts[0].robot, sensed[:, index:]),
            self.step,
        )  # fmt: skip


def _rolled(
    mujoco: Any, model: Any, state: np.ndarray, controls: np.ndarray
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Last state, what the sensors saw, (T, s), and whether it broke off, of controls (T, n)."""
    data, before = mujoco.MjData(model), mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)  # else it writes a log file where the user stands
    try:
        states, sensed = mujoco.rollout.rollout(model, [data], state[None], controls[None])
    finally:
        mujoco.set_mju_user_warning(before)
    broken = any(data.warning[kind].number for kind in _unstable(mujoco))
    return states[0, -1], sensed[0], broken


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
        if not what.name.startswith((PROCESS, JAW_BODY)):
            spec.delete(what)
    spec.option.timestep = step
    for joint in spec.joints:
        if joint.parent.name == BASE or joint.parent.name.startswith((FOOT_BODY, JAW_BODY, OBJECT_BODY)):
            continue
        joint.armature = _PRESCRIBED
        motor = spec.add_actuator(name=joint.name, target=joint.name)
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.gear[0] = _PRESCRIBED
    return spec


class PrescribedModel:
    """An exported model with joints that do what is commanded, for different scenarios.

    The feet's damping is that of the payload with which it is made.

    Args:
        robot: in one scenario: its feet, and whether it holds anything, are those of all scenarios.
        motion: that is exported with it.
        step: s.

    Raises:
        OcptipError: MuJoCo does not take it.
    """

    def __init__(self, robot: Robot, motion: Trajectory, step: float) -> None:
        self.robot = robot
        spec = prescribed(to_mjcf(robot, motion), step)
        self._spec = spec
        self._payload = next((body for body in spec.bodies if body.name == PAYLOAD), None)
        self._bodies = [[(one, one.mass, np.array(one.inertia)) for one in part] for part in _parts(spec)]
        self._pairs = [(pair, np.array(pair.friction)) for pair in spec.pairs]

    def compiled(self, world: World, payload: Payload | None) -> Any:
        """The model of a scenario; its feet are not checked.

        Args:
            world: the scenario.
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
        shift_centres(self._spec, self.robot, world.shifts)
        try:
            return self._spec.compile()
        except ValueError as error:
            raise OcptipError(f"MuJoCo: {error}") from error


def _parts(spec: Any) -> list[list[Any]]:
    """Bodies of the base, of each link with the rotors on it, of the payload, and of each object."""
    parts: list[list[Any]] = [[]]
    for body in spec.bodies:
        if body.name == BASE or body.name.startswith(FOOT_BODY):
            parts[0].append(body)
        elif body.name.startswith(("link", OBJECT_BODY)) or body.name == PAYLOAD:
            parts.append([body])
    for body in spec.bodies:
        if body.name.endswith(" rotor"):
            members = [part for part in parts if part[0].name == body.parent.name]
            members[0].append(body)
    return parts


def _speeds(motion: Trajectory, times: np.ndarray, late: np.ndarray) -> np.ndarray:
    """(T, n) joint speeds, each joint with its delay."""
    values = np.empty((len(times), len(late)))
    for delay in np.unique(late):
        delayed_times = np.clip(times - delay, 0.0, motion.end)
        speeds = motion.states(delayed_times)[1]
        speeds[(times - delay <= 0) | (times - delay >= motion.end)] = 0.0
        values[:, late == delay] = speeds[:, late == delay]
    return values


def _rest(mujoco: Any, model: Any, data: Any, robot: Robot) -> None:
    """Put the base where its springs hold it at rest, the soles where they stood without load."""
    support, elastic = robot.support, robot.support.elastic
    assert elastic is not None
    mujoco.mj_forward(model, data)
    load = -np.array(data.qfrc_bias[:6])
    K = np.zeros((6, 6))
    for k, arm in enumerate(support.arms):
        jacobian = np.hstack([np.eye(3), -skew(arm)])
        frame = support.frames[k]
        K += jacobian.T @ (frame * elastic.stiffness[k]) @ frame.T @ jacobian
    moved = np.linalg.solve(K, load)
    turn = Rotation.from_rotvec(moved[3:])
    data.qpos[:3] += moved[:3]
    data.qpos[3:7] = np.roll(turn.as_quat(), 1)
    springs = springs_of(support)
    away = turn.inv().apply(moved[:3] + turn.apply(support.arms) - support.arms)
    bent = -np.einsum("kac,ka->kc", support.frames, away)
    data.qpos[7 : 7 + np.count_nonzero(springs)] = bent[springs]


@dataclass(frozen=True, eq=False)
class Compared:
    """A replay beside the library's results for the same scenario.

    Attributes:
        least: (n,), N, minimum normal forces of the library.
        when: (n,), s.
        rms_least: N, root mean square over time of the difference of the minimum foot force.
        rms: N, of all normal forces.
        stands: the library says that no contact is lost.
    """

    least: np.ndarray
    when: np.ndarray
    rms_least: float
    rms: float
    stands: bool


def compared(parts: Sequence[Part], replay: Replay) -> Compared | None:
    """The library's normal forces at the instants of a replay, rests and steps with switching times left out.

    None where it knows none: of rigid feet, more than three, one sharing of several is no prediction.
    """
    times, expected, theirs, stands = [], [], [], True
    for _, part, index in owners(replay.world.parts(parts), replay.times):
        local = replay.times[index] - part.begin
        inside = (local > 0) & (local < part.motion.end) & replay.quiet[index]
        predicted = _predicted(part, local[inside])
        if predicted is None:
            return None
        forces, moved = predicted
        kept = index[inside][: len(forces)]
        times.append(replay.times[kept])
        theirs.append(replay.forces[kept])
        expected.append(forces)
        stands = stands and moved
    when, expected, theirs = np.concatenate(times), np.vstack(expected), np.vstack(theirs)
    index = np.argmin(expected, axis=0)
    return Compared(
        expected[index, np.arange(expected.shape[1])],
        when[index],
        _rms(theirs.min(axis=1) - expected.min(axis=1)),
        _rms(theirs - expected),
        stands,
    )


def _predicted(part: Part, times: np.ndarray) -> tuple[np.ndarray, bool] | None:
    """Normal forces (k, n), N, at the first k of these times (T,), s, and whether no contact is lost."""
    robot, motion = part.robot, part.motion
    if robot.support.elastic is not None:
        feet = on_its_feet(robot, motion)
        if feet is None:
            return None
        course = feet.course
        kept = times[times < course.times[-1]]
        expected = np.stack([np.interp(kept, course.times, f) for f in course.forces[:, :, 0].T], axis=1)
        return expected, not feet.lifts and not feet.falls
    if robot.support.n_contacts != 3 or np.linalg.matrix_rank(robot.support.arms) != 3:
        return None
    states = robot.contact_states(robot.loads(*motion.states(times), robot.during(motion).acting(times))[1])
    return states.contact_forces[:, :, 0], bool(np.all(states.persistent))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
