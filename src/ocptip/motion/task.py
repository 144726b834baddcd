"""A motion task: robot on its support, start, goal, limits; what speaks against planning it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from ocptip.basics.errors import InputError, finite_array, is_whole, positive_number
from ocptip.basics.frozen import settle
from ocptip.motion.files.source import TaskSource
from ocptip.motion.objective import ENERGY, Objective
from ocptip.motion.stops.rules import StopRules
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.process import PATH
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.largest_level import largest_levels_kept
from ocptip.standing.at_rest.raised import RaisedPayload
from ocptip.standing.at_rest.refusals import own_refusals, posture_refusals
from ocptip.standing.instants import Instants
from ocptip.standing.limit_kinds.clearance import ClearanceLimit
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.stops.by_brakes import BrakeCheck
from ocptip.trajectories.trajectory import Trajectory
from ocptip.trajectories.velocity_profiles import checked_rise_times, earliest_end

MOST_COMMANDS = 12
_ROUNDED = 1e-6  # s: times in files are
LONGEST = 30.0  # s, of a motion that is planned
MOST_JOINTS = 8  # whose directions are all looked at
REACHED = 1e-6  # m and rad: how near to its pose a posture is as good as any other
FIRST_SEVEN = tuple(range(7))
"""Joints that are optimised if nothing else is asked for, as far as they exist."""


@dataclass(frozen=True, eq=False)
class MotionTask:
    """The task of a motion: to be planned, or to check a motion against.

    Attributes:
        name: for messages and titles.
        robot: the arm, or the parallel robot, on its support.
        start, goal: joint angles, (n,), rad (sliding joints: m), or the platform's coordinates, m and rad.
        limits: GN, GT, torques, clearance.
        optimised: joints whose velocity profiles are optimised, counted from 0, increasing. Default: all
            joints up to the seventh.
        commands: profile commands per optimised joint, at most 12.
        objective: what is minimised.
        reference: a motion to compare with.
        choices: pairs of start and goal, (n,) each, of which the planner may take any instead.
        source: the file that it was read from; None: made in Python.
        targets: the gripper poses that start and goal are postures of; None where the angles are given. The
            planner chooses the posture where enough joints are optimised (`planner.free_ends`).
        stops: how the robot is stopped, for checks of stops; a plan includes them where `limits.stops` does.
        rise_times: s, within which the joints' accelerations rise and fall (S-curves): one for all, or (n,);
            0 or none: trapezoidal profiles. None: the planner chooses, see `ocptip.motion.multi_start`.
    """

    is_cycle: ClassVar[bool] = False
    name: str
    robot: StandingMechanism
    start: np.ndarray
    goal: np.ndarray
    limits: Limits = field(default_factory=Limits)
    optimised: tuple[int, ...] = FIRST_SEVEN
    commands: int = 3
    objective: Objective = ENERGY
    reference: Trajectory | None = None
    choices: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    source: TaskSource | None = None
    targets: tuple[PoseTarget | None, PoseTarget | None] = (None, None)
    stops: StopRules = field(default_factory=StopRules)
    rise_times: float | tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Raise InputError if shapes or numbers of joints do not fit, or there is nothing to optimise."""
        n = self.robot.n
        for name in ("start", "goal"):
            settle(self, **{name: finite_array(name, getattr(self, name), (n,))})
        if not isinstance(self.limits, Limits):
            raise InputError(f"limits: expected Limits, got {self.limits!r}")
        for pair in self.choices:
            for name, angles in zip(("start", "goal"), pair, strict=True):
                finite_array(f"choices: {name}", angles, (n,))
        self._check_targets()
        joints = tuple(self.optimised)
        if joints == FIRST_SEVEN:
            joints = joints[:n]
        if not joints or not all(is_whole(j) and 0 <= j < n for j in joints):
            raise InputError(f"optimised: expected joints of 0 to {n - 1}, at least one, got {joints}")
        if any(b <= a for a, b in pairwise(joints)):
            raise InputError(f"optimised: joints must increase, got {joints}")
        settle(self, optimised=tuple(map(int, joints)))
        check_commands(self.commands)
        if self.robot.support.elastic is None:
            for name in ("foot_lift", "foot_force", "jump_foot_force"):
                if getattr(self.limits, name):
                    raise InputError(f"limits.{name}: is about compliant feet; these have no stiffness")
        if self.rise_times is not None:
            settle(self, rise_times=checked_rise_times(self.rise_times, n))
        if not isinstance(self.objective, Objective):
            raise InputError(f"objective: expected ENERGY, TIME or priced(...), got {self.objective!r}")
        if self.reference is not None and self.reference.n != n:
            raise InputError(f"reference: has {self.reference.n} joints, the {self.robot.kind} has {n}")

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The motion itself, as the only segment, without a name."""
        return (Segment("", self),)

    def each(self, change: Callable[[MotionTask], MotionTask]) -> MotionTask:
        """The task after a change; a cycle changes the task of every segment."""
        return change(self)

    def _check_targets(self) -> None:
        """Raise InputError if start or goal is no posture of its gripper pose."""
        for name, target in zip(("start", "goal"), self.targets, strict=True):
            if target is None:
                continue
            if target.free.any():
                raise InputError(f"{name}_pose.free: is for poses of cycles, in a [[segment]]")
            if (arm := self.robot.arm) is None:
                raise InputError(f"targets: the {self.robot.kind} has no gripper poses")
            q = getattr(self, name)[None]
            if not target.reached(arm, q, REACHED)[0]:
                miss = float(target.residuals(arm, q)[0])
                raise InputError(f"targets: {name} misses its gripper pose by {miss:.2g} (m, rad)")


@dataclass(frozen=True, eq=False)
class Segment:
    """One motion of a cycle.

    Attributes:
        name: for messages.
        task: robot with what it holds, limits, objective; its goal is the first of `goals`.
        goals: postures of which the segment may end in any, (k, n), rad (sliding joints: m).
        dwell: s, standstill at the goal that is asked for, with what this segment holds.
        target: the gripper pose that the goals are postures of; None where the angles are given.
    """

    name: str
    task: MotionTask
    goals: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    dwell: float = 0.0
    target: PoseTarget | None = None

    def __post_init__(self) -> None:
        n = self.task.robot.n
        goals = finite_array("goals", self.goals if len(self.goals) else self.task.goal[None], (None, n))
        settle(self, goals=goals, dwell=positive_number("dwell", self.dwell, zero_allowed=True))

    @property
    def rest(self) -> float:
        """s, standstill at the goal: at least until delayed joints have arrived."""
        late = self.task.limits.tolerance.late
        return max(self.dwell, late + _ROUNDED if late else 0.0)

    def between(self, start: np.ndarray, goal: np.ndarray) -> MotionTask:
        """The task from one posture to another, (n,) each."""
        return replace(self.task, start=start, goal=goal, choices=())

    def standby(self, q: np.ndarray) -> float:
        """Electric power at rest in posture q, (n,), W."""
        robot, still = self.task.robot.resting(1), np.zeros((1, self.task.robot.n))
        torques, _ = robot.loads(q[None], still, still)
        drawn = robot.motors.power(torques, robot.motor_speeds(q[None], still))
        return float(np.sum(drawn)) + robot.support.power


def refusals(task: MotionTask, *, at_rest: bool = True) -> tuple[str, ...]:
    """Why no plan can succeed, one sentence with numbers per reason; empty if nothing speaks against trying.

    Start and goal have to keep the joints' limits, the clearance, and at rest the limits of GN, GT and
    torques; every joint needs limits of speed and acceleration. Stops by brakes have to keep theirs when the
    motion has just begun, with all joints moving that have to. Without `at_rest` start and goal are not
    checked.
    """
    limits, results = task.robot.limits, []
    if task.robot.varying is not None and task.robot.varying.over == PATH:
        results.append(
            "process: varies over path, which is not known before there is a motion; plans follow it over "
            "time_s or share, ocptip retime over path_m"
        )
    for name, values in (("speed", limits.speed), ("acceleration", limits.acceleration)):
        if numbers := [str(j + 1) for j in np.flatnonzero(~np.isfinite(values))]:
            results.append(f"joints without {name} limit: {', '.join(numbers)}; every joint needs one")
    if not results:
        ends = earliest_end(task.goal - task.start, limits.speed, limits.acceleration)
        ends = ends + np.array(task.rise_times or 0.0)
        least, most = float(np.max(ends)), min(task.limits.max_duration, LONGEST)
        allowed = "are allowed" if most < LONGEST else "is the longest motion that is planned"
        if least > most:
            results.append(
                f"max_duration: joint {int(np.argmax(ends)) + 1} needs {least:.4g} s at its limits, "
                f"{most:.4g} s {allowed}"
            )
        elif task.limits.min_duration > most:
            results.append(f"duration: is {task.limits.min_duration:.4g} s, {most:.4g} s {allowed}")
    postures = (("start", task.start, 0), ("goal", task.goal, 1)) if at_rest else ()
    for where, angles, share in postures:
        results += [f"{where}: {reason}" for reason in end_refusals(task, share, angles)]
    return (*results, *_brake_refusals(task))


def _brake_refusals(task: MotionTask) -> list[str]:
    """Why every motion breaks the limits of stops by brakes as soon as it has begun, when all joints move.

    Not checked with delayed brakes, with many joints, and where postures may be chosen.
    """
    brakes, robot = task.limits.brakes, task.robot
    must = task.start != task.goal
    if brakes is None or robot.arm is None or not must.any():
        return []
    chosen = bool(task.choices) or any(target is not None for target in task.targets)
    if chosen or brakes.delay[1] > 0 or robot.n > MOST_JOINTS:
        return []
    GN, GT, directions = BrakeCheck(Robot.of(robot), brakes).gentlest(task.start, must)
    broken = [
        f"{name} is {value:.4g}, must be <= {most:.4g}"
        for name, value, most in (("GN", GN, brakes.GN), ("GT", GT, brakes.GT))
        if value > most
    ]
    if not broken:
        return []
    turns = ", ".join(f"{'+' if way > 0 else '-'}{j + 1}" for j, way in enumerate(directions) if way)
    left = "what is left are weaker brakes or a heavier base"
    if task.stops.guessed:
        left = "brake torques are a guess, give brake_torque_min_Nm, _max_Nm in [stops]; else " + left
    return [
        "stops by brakes: as soon as the motion has begun, in either direction of the joints, "
        f"{', '.join(broken)} at best (joints {turns}); {left}"
    ]


def end_refusals(task: MotionTask, share: float, q: np.ndarray) -> list[str]:
    """Why the robot cannot rest at q, (n,), before (share 0) or after (1) the motion."""
    return posture_refusals(task.robot.resting(share), task.limits, q)


def require_plannable(task: MotionTask) -> None:
    """Raise InputError with all reasons of :func:`refusals` if there are any.

    Start and goal that are in collision, or too near, are refused first, before contacts are solved.
    """
    if not (reasons := _collisions(task)) and (reasons := [*refusals(task)]):
        reasons += filter(None, [_possible_payload(task)])
    if reasons:
        raise InputError(f"{task.name}: cannot be planned: {'; '.join(reasons)}")


def _collisions(task: MotionTask) -> list[str]:
    """All pairs that are too near at start and goal in one reason, then those of joints."""
    limits = task.limits
    if not ClearanceLimit.wanted(task.robot, limits):
        return []
    ends = {"start: ": (task.robot.resting(0), task.start), "goal: ": (task.robot.resting(1), task.goal)}
    if not (reason := ClearanceLimit(task.robot, limits, ()).too_near(ends)):
        return []
    reasons = [reason]
    for where, (robot, q) in ends.items():
        others = own_refusals(robot, limits, Instants.at_rest(robot, q[None]), but=ClearanceLimit.name)
        reasons += [f"{where}{reason}" for reason in others]
    return reasons


def _possible_payload(task: MotionTask) -> str:
    """The largest payload that start and goal can have, if it is smaller than the task's; else empty."""
    robot = task.robot
    if robot.arm is None or (held := robot.payload) is None or robot.tip_over.free_rotation:
        return ""
    robot, results = Robot.of(robot), []
    for place, q, share in (("start", task.start, 0), ("goal", task.goal, 1)):
        largest = largest_levels_kept(RaisedPayload(robot.resting(share)), task.limits, q[None], robot.mass)
        results.append((float(largest.levels[0]), place, largest.names[largest.limits[0]]))
    mass, place, limit = min(results)
    if mass >= held.mass:
        return ""
    return f"possible is a payload of {mass:.3g} kg instead of {held.mass:.4g} kg ({limit} at {place})"


def check_commands(commands: Any) -> None:
    """Raise InputError if this cannot be a number of profile commands; more than a dozen gain nothing."""
    if not is_whole(commands) or not 1 <= commands <= MOST_COMMANDS:
        raise InputError(f"commands: must be a whole number >= 1 and <= {MOST_COMMANDS}, got {commands!r}")
