"""A robot that rests in a posture, as the scene of its base."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.text import did_you_mean, quantity, towards
from ocptip.contact.support import Load, Support
from ocptip.motion.cycles.task import CycleTask, Task
from ocptip.numerics.bisection import border
from ocptip.reserves.equal_compliance import normal_map_of
from ocptip.robots.base_motion import BaseMotion
from ocptip.robots.process import ProcessWrench
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.alike_friction import AlikeFriction
from ocptip.standing.at_rest.directions import Directions, pushes, slopes
from ocptip.standing.at_rest.largest_level import largest_levels_kept
from ocptip.standing.at_rest.levels import largest_tried
from ocptip.standing.at_rest.load_cases import RestLoads
from ocptip.standing.at_rest.loss_search import LargestLevel, LossSearch, pushed
from ocptip.standing.at_rest.raised import RaisedPayload
from ocptip.standing.at_rest.refusals import own_refusals
from ocptip.standing.at_rest.sensitivity import (
    Reserves,
    Sensitivity,
    motion_sensitivities,
    payload_torques,
    reserves_at_rest,
)
from ocptip.standing.at_rest.slope import FloorSlope, largest_slope
from ocptip.standing.instants import Instants
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import DEFAULT, Uncertainty
from ocptip.standing.within.design import Design, smallest_design
from ocptip.standing.within.posture import posture_case, posture_within
from ocptip.standing.within.rest import CaseWithin, WithinAtRest, object_within
from ocptip.standing.within.tolerable import AT_REST
from ocptip.task_files.cycle import read_task
from ocptip.task_files.plan_folder import is_plan_folder, read_plan_folder
from ocptip.task_files.scene import Scene

_CLOSE = 5e-3  # share of a process that is possible
_NO_LIMIT = 1e9  # torque / torque limit: what the contacts alone hold is asked for

Rests = dict[str, tuple[StandingMechanism, np.ndarray, Limits]]
"""Robot, joint values and limits of postures at rest, by name."""


@dataclass(frozen=True)
class LargestPayload:
    """The largest payload in a posture, in all, with the centre of mass of the robot's payload.

    Attributes:
        mass_kg: that keeps all limits at rest; without a payload of the robot it is at the TCP.
        limit: which decides; the largest payload that is tried is none.
        contacts_kg: that keeps the limits of the contacts, whatever the drives hold.
        contacts_limit: which of these decides.
    """

    mass_kg: float
    limit: str
    contacts_kg: float
    contacts_limit: str

    def __str__(self) -> str:
        drives = _mass_text(self.mass_kg, self.limit)
        if self.limit == self.contacts_limit:
            return drives
        return f"{drives}; contacts alone {_mass_text(self.contacts_kg, self.contacts_limit)}"


@dataclass(frozen=True)
class FirstLift:
    """The smallest horizontal push at the TCP under which a contact lifts, if friction holds.

    Attributes:
        contact: which, counted from 1.
        force: of the push, N.
        towards: (3,) its direction, base axes.
    """

    contact: int
    force: float
    towards: tuple[float, ...]


@dataclass(frozen=True)
class PossibleProcess:
    """Shares, 0 to 1, of what acts on the gripper with which no contact is lost.

    Attributes:
        equally_compliant: with equally compliant contacts; None where they slide no earlier than others.
        best_sharing: with the sharing of the load that holds best, or that of declared springs.
    """

    equally_compliant: float | None
    best_sharing: float

    def __str__(self) -> str:
        best = f"{np.floor(100 * self.best_sharing):.0f} %"
        if self.equally_compliant is None:
            return f"{best} of it keep all contacts"
        equal = f"{np.floor(100 * self.equally_compliant):.0f} % of it keep all contacts"
        return f"{equal} with equally compliant feet, {best} with the best sharing of the load"


def _mass_text(mass: float, limit: str) -> str:
    text = quantity(mass, "kg", 3)
    return (
        f">= {text}, more is not tried" if limit == largest_tried("payload") else f"{text} ({limit} decides)"
    )


@dataclass(frozen=True, eq=False)
class RestingPosture:
    """A robot at rest.

    Attributes:
        name: "start", "goal", the name of a segment whose goal it is, or "given".
        robot: on its support, with what it holds and what acts on its gripper at rest.
        q: (n,), rad (straight coordinates: m).
        limits: of the task.
        scene: the support, with what the robot does to it as the only load; inertia of a base that drives is
            part of it.
        base_motion: of a base that drives; None: it rests.
        choice: that the posture is one of several of its pose, one sentence; else empty.
    """

    name: str
    robot: StandingMechanism
    q: np.ndarray
    limits: Limits
    scene: Scene
    base_motion: BaseMotion | None = None
    choice: str = ""

    @cached_property
    def objects(self) -> tuple[Scene, ...]:
        """Each object as a scene, in axes of the gripper or the base, its acceleration a part of gravity."""
        scenes = []
        for interface in self.instant.interfaces[1:]:
            support, wrench = interface.footing.support, interface.wrenches[0]
            support = support.varied(gravity=wrench[:3] / support.mass)
            scenes.append(_scene_of(interface.footing.name, support, wrench))
        return tuple(scenes)

    def object_within(self, name: str, tolerance: Uncertainty) -> WithinAtRest | None:
        """The worst of an object at rest within an uncertainty; None without, and on a base that drives."""
        if not tolerance.given or self.base_motion is not None:
            return None
        scene = next(scene for scene in self.objects if scene.name == name)
        match = next(match for match in self.robot.carried if match.object.name == name)
        return object_within(match.footing, match.bodies, scene.support.gravity, tolerance)

    @classmethod
    def of(
        cls, task: str, name: str, robot: StandingMechanism, q: np.ndarray, limits: Limits
    ) -> RestingPosture:
        """The posture with its scene."""
        where = "in the given posture" if name == "given" else f"at {name}"
        return cls(name, robot, q, limits, _scene(f"{task} {where}", robot, q, limits))

    def driving(self, base_motion: BaseMotion) -> RestingPosture:
        """The same posture on a base that moves so, at one instant."""
        scene = _scene(self.scene.name, self.robot, self.q, self.limits, base_motion)
        return replace(self, scene=scene, base_motion=base_motion)

    @cached_property
    def instant(self) -> Instants:
        """The robot at rest in the posture, on its base."""
        still = np.zeros((1, self.robot.n))
        return Instants.of_states(self.robot, self.q[None], still, still, base_motion=self.base_motion)

    @property
    def refusals(self) -> list[str]:
        """Why the robot itself cannot be there: angles, clearance, torques."""
        return own_refusals(self.robot, self.limits, self.instant)

    @cached_property
    def largest_slope(self) -> FloorSlope | None:
        """The largest slope that loses no contact; None with objects, no arm, or a base that drives."""
        if self.base_motion is not None or self.robot.arm is None or self.objects:
            return None
        loads, gravity = RestLoads(Robot.of(self.robot), self.q[None]), self.robot.support.gravity
        return largest_slope(self.robot, gravity, lambda tilted: loads.wrenches(tilted)[0])

    @cached_property
    def largest_push(self) -> LargestLevel | None:
        """The largest push at the TCP, N, in its worst direction, that loses no contact; None as a slope."""
        return self._largest_push(pushes)

    @cached_property
    def largest_horizontal_push(self) -> LargestLevel | None:
        """The same of pushes along level ground."""
        return self._largest_push(slopes)

    def _largest_push(self, directions: Callable[[np.ndarray], Directions]) -> LargestLevel | None:
        if self.largest_slope is None:
            return None
        robot, gravity = Robot.of(self.robot), self.robot.support.gravity
        loads = RestLoads(robot, self.q[None])
        nominal, most = loads.wrenches(gravity), robot.mass * float(np.linalg.norm(gravity))
        search = LossSearch(robot, AlikeFriction.if_held(robot, nominal))
        return search.largest(most, pushed(nominal, loads.at_tool, towards), directions(gravity))

    @cached_property
    def first_lift(self) -> FirstLift | None:
        """The first contact that a horizontal push lifts, with declared springs or equally compliant feet.

        None as a slope, where the sharing of the load is unique or not known, and where one lifts already.
        """
        normal_map, gravity = normal_map_of(self.robot.support), self.robot.support.gravity
        if normal_map is None or self.largest_slope is None:
            return None
        loads, down = RestLoads(Robot.of(self.robot), self.q[None]), gravity / np.linalg.norm(gravity)
        springs = self.robot.support.elastic  # clamps let go below zero, rigid ones never
        forces = normal_map @ loads.wrenches(gravity)[0] - (springs.lowest if springs else 0.0)
        per_newton = normal_map @ np.column_stack([loads.at_tool(axis)[0] for axis in np.eye(3)])
        level = per_newton - np.outer(per_newton @ down, down)
        sizes = np.linalg.norm(level, axis=1)
        pushes_to_lift = np.divide(forces, sizes, out=np.full(len(sizes), np.inf), where=sizes > 0)
        k = int(np.argmin(pushes_to_lift))
        if not 0 < pushes_to_lift[k] < np.inf:
            return None
        return FirstLift(k + 1, float(pushes_to_lift[k]), tuple((-level[k] / sizes[k]).tolist()))

    @cached_property
    def held_by_drives(self) -> float:
        """kg: the largest point mass at the TCP, beyond what is held, that the drives hold at rest.

        Infinite where it needs no torque, and for mechanisms that are no arm.
        """
        if self.robot.arm is None:
            return np.inf
        per_kilogram = payload_torques(Robot.of(self.robot), self.q[None])[0]
        torques, limit = self.instant.torques[0], self.limits.torque_ratio * self.robot.limits.torque
        unused = np.where(per_kilogram > 0, limit - torques, limit + torques)
        with np.errstate(divide="ignore", invalid="ignore"):
            masses = np.where(per_kilogram != 0, unused / np.abs(per_kilogram), np.inf)
        return max(float(np.min(masses, initial=np.inf)), 0.0)

    def largest_payload(self, tolerance: Uncertainty) -> LargestPayload | None:
        """The largest payload that keeps the limits within an uncertainty.

        None on a base that drives, where nothing resists a rotation, with objects, and without an arm.
        """
        if self.base_motion is not None or self.robot.arm is None or self.robot.objects:
            return None
        robot = Robot.of(self.robot)
        if robot.tip_over.free_rotation:
            return None
        limits = replace(self.limits, tolerance=tolerance)
        no_drives = replace(limits, torque_ratio=_NO_LIMIT)
        results = []
        for limit_set in (limits, no_drives):
            largest = largest_levels_kept(RaisedPayload(robot), limit_set, self.q[None], robot.mass)
            results += [float(largest.levels[0]), largest.names[largest.limits[0]]]
        return LargestPayload(*results)

    @property
    def process(self) -> ProcessWrench | None:
        """The force and moment that act on the gripper at rest, if any."""
        return self.robot.arm.process if self.robot.arm else None

    def possible_process(self, tolerance: Uncertainty) -> PossibleProcess | None:
        """How much of what acts on the gripper loses no contact within an uncertainty.

        None where nothing acts, on a base that drives, and for mechanisms that are no arm.
        """
        process, counts = self.process, self._counting(tolerance)
        if self.base_motion is not None or process is None:
            return None

        def largest(robot: Robot) -> float:
            def kept(share: float) -> bool:
                less = ProcessWrench(share * process.wrench[:3], share * process.wrench[3:], process.axes)
                other = robot.varied(arm=robot.arm.with_process(less))
                case = posture_case(other, self.q, counts)(counts)
                return case.tip()[0] < 1 and case.slip()[0] < 1

            if kept(1.0):
                return 1.0
            if not kept(0.0):
                return 0.0
            return border(kept, 0.0, 1.0, lambda low, high: high - low <= _CLOSE)[0]

        alike = (robot := Robot.of(self.robot)).if_alike
        return PossibleProcess(None if alike is None else largest(alike), largest(robot))

    def sensitivities(self, tolerance: Uncertainty) -> tuple[Sensitivity, ...]:
        """What changes of the robot and its base would do at rest in this posture, within an uncertainty.

        Raises:
            InputError: the base drives.
        """
        if self.base_motion is not None:
            raise InputError("sensitivities: not on a base that drives")
        self.robot.require_no_objects("sensitivities")
        still, counts = np.zeros((1, self.robot.n)), self._counting(tolerance)

        def worst(robot: Robot, _: float) -> Reserves:
            within = counts.heavier(robot.support.mass - self.robot.support.mass)
            moment = robot.tip_over.reference_moment
            return reserves_at_rest(posture_case(robot, self.q, within)(within), moment)

        known = worst if counts.given and self.robot.arm else None
        changes = motion_sensitivities(self.robot, self.q[None], still, still, known)
        return tuple(one for one in changes if one.quantity != "speed")

    def _counting(self, tolerance: Uncertainty) -> Uncertainty:
        """The part of an uncertainty that counts at rest."""
        counts = tolerance.of(self.robot.payload)
        return counts.only(*(name for name in AT_REST if name in counts.given))

    def design(self, tolerance: Uncertainty) -> Design | None:
        """The smallest base for this posture within an uncertainty; None without an arm."""
        if self.robot.arm is None:
            return None
        robot = Robot.of(self.robot)
        robot.require_no_objects("design")
        counts = self._counting(tolerance)

        def case(support: Support) -> CaseWithin:
            return posture_case(robot.varied(support=support), self.q, counts, self.base_motion)(counts)

        return smallest_design(robot.support, case)

    def within(self, tolerance: Uncertainty) -> WithinAtRest | None:
        """The worst within an uncertainty; None without one, and for parallel robots, which have none."""
        if not tolerance.given or self.robot.arm is None:
            return None
        return posture_within(Robot.of(self.robot), self.q, tolerance, self.base_motion)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; joint values in rad and m."""
        driving = {"base_motion": self.base_motion.to_dict()} if self.base_motion else {}
        return {
            **driving,
            **({"choice": self.choice} if self.choice else {}),
            "name": self.name,
            "joints": dict(zip(self.robot.names, self.q.tolist(), strict=True)),
            "units": list(self.robot.units),
            "torques": self.instant.torques[0].tolist(),
            "broken": self.refusals,
            "largest_push": self.largest_push and vars(self.largest_push),
            "largest_horizontal_push": self.largest_horizontal_push and vars(self.largest_horizontal_push),
            "first_lift": self.first_lift and vars(self.first_lift),
        }


def _scene(
    name: str, robot: StandingMechanism, q: np.ndarray, limits: Limits, base_motion: BaseMotion | None = None
) -> Scene:
    """The base under the load of a robot at rest on it, and under inertial forces if it drives."""
    still, support = np.zeros((1, robot.n)), robot.support
    wrench = robot.loads(q[None], still, still, base_motion=base_motion)[1][0]
    return replace(_scene_of(name, support, wrench), tolerance=limits.tolerance)


def _scene_of(name: str, support: Support, wrench: np.ndarray) -> Scene:
    """A body on its contacts under a wrench (6,); what is not its weight is a single load."""
    arm_wrench = wrench - support.weight
    return Scene(name, support, (Load(arm_wrench[:3], arm_wrench[3:], support.center_of_mass),), wrench)


def resting_posture(
    what: Task | StandingMechanism | RestingPosture | str | os.PathLike[str], q: ArrayLike | str | None
) -> RestingPosture:
    """The posture of a robot, or of that of a task or its file; see :func:`ocptip.stand`."""
    if isinstance(what, RestingPosture):
        return what
    if isinstance(what, StandingMechanism):
        if q is None or isinstance(q, str):
            raise InputError(f"q: expected {what.n} joint values of the robot, got {q!r}")
        values = finite_array("q", q, (what.n,))
        return RestingPosture.of("robot", "given", what, values, Limits())
    task = task_at_rest(what)
    rests = rests_of(task)
    if isinstance(q, str):
        if q not in rests:
            raise InputError(f"q: expected one of {', '.join(rests)}, got {q!r}{did_you_mean(q, rests)}")
        return replace(RestingPosture.of(task.name, q, *rests[q]), choice=_choice(task, q))
    if q is None:
        return resting_posture(task, "start")
    robot, _, limits = rests["start"]
    return RestingPosture.of(task.name, "given", robot, finite_array("q", q, (robot.n,)), limits)


def task_at_rest(what: Task | str | os.PathLike[str]) -> Task:
    """The task, or that of a file; of the folder of a plan between the postures of its motion."""
    if not isinstance(what, str | os.PathLike):
        return what
    return read_plan_folder(what).task_of_motion if is_plan_folder(what) else read_task(what, DEFAULT)


def _choice(task: Task, name: str) -> str:
    """That a named posture is one of several of its pose, and which; else empty."""
    which = "the pair of start and goal with the shortest joint travel"
    if isinstance(task, CycleTask):
        ends = {"start": task.starts, **{segment.name: segment.goals for segment in task.segments}}
        count, which = len(ends[name]), "the first solution"
    else:
        angles = np.array([pair[name == "goal"] for pair in task.choices]).reshape(-1, task.robot.n)
        turns = np.hstack([np.cos(angles), np.sin(angles)])  # equal for postures whole turns apart
        count = len(np.unique(np.round(turns, 6), axis=0))
    if count < 2:
        return ""
    text = f"{name}: posture 1 of {count} of its pose ({which})"
    return f"{text}; a plan may take another: ocptip stand or drive PLAN --posture {name}"


def rests_of(task: Task) -> Rests:
    """Postures at rest that a task names: start, goal, goals of segments."""
    first = task.segments[0].task
    rests = {"start": (first.robot.resting(0), first.start, first.limits)}
    for segment in task.segments:
        segment_task = segment.task
        rests[segment.name or "goal"] = segment_task.robot.resting(1), segment_task.goal, segment_task.limits
    return rests
