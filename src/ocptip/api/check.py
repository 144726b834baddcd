"""`ocptip.check`: whether a given motion keeps all limits, and what else is known about it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ocptip.api.inputs.given import MotionLike, ProfileLike, given_motion
from ocptip.api.inputs.motion_requirements import motion_outcomes
from ocptip.api.inputs.requirements import Outcome
from ocptip.api.results.plan import sensitivities_of
from ocptip.api.tasks import Base, TaskLike
from ocptip.basics.errors import InputError, OcptipError, naming, positive_number
from ocptip.basics.text import silent
from ocptip.basics.write import versions
from ocptip.certificate.checks import certified_cycle
from ocptip.motion.check import OF_PATH, MotionCheck
from ocptip.motion.cycles.check import check_cycle, segments_of, with_rises
from ocptip.motion.cycles.task import CycleTask, Task, refuse_driving, refuse_objects
from ocptip.motion.design import motion_design
from ocptip.motion.files.plan_files import samples_joined, save_bag, task_samples
from ocptip.motion.objective import TIME
from ocptip.motion.stops.check import stops_by_segment, stops_to_dict
from ocptip.motion.stops.rules import SCENARIOS, Kinds
from ocptip.motion.summary import CheckedMotion, brief
from ocptip.motion.task import REACHED, MotionTask
from ocptip.motion.tolerated import robustness
from ocptip.pictures.frame import save_figure
from ocptip.pictures.plan import ground_figure
from ocptip.pictures.plan_curves import seen_plan
from ocptip.retiming.retime import least_cost
from ocptip.standing.limits import TORQUE_WITHIN
from ocptip.standing.within.design import Design
from ocptip.trajectories.path_fit import path_of_motion
from ocptip.trajectories.trajectory import Trajectory

_NOT_DRIVING = (
    "while the base drives these are not checked: {}, torques of wheels, obstacles at rest in the world, and "
    "sway of elastic contacts at acceleration steps"
)
_NO_STOPS = "stops of the arm, also those that the task asks for (cancels: --stops cancel, at samples)"
STEPS = (
    "acceleration steps overshoot: of base and joints in all combinations, with delayed joints, on rigid "
    "contacts"
)
SAME = {"deg": 0.01, "m": 1e-4}
"""Offsets of start and goal up to this are not worth a note."""
_RETIMED_NODES = 100  # of the timing that a motion is told about: within 1 % of the duration
_WITHIN_NODES = 40  # the same within a tolerance, which takes long
_SCALE = 1e6  # factors of time up to this and down to its inverse


@dataclass(frozen=True, eq=False, repr=False)
class Check(CheckedMotion):
    """The result of checking a given motion or cycle.

    Attributes:
        name: of the motion's file.
        motion: that was checked, as it was given.
        time_scale: factors with the checks of the same path with all times multiplied by each.
        offsets: the largest differences of the motion's start and goal from the task's. Keys are units: "deg"
            for angles, "m" for lengths, as far as the coordinates have such.
        misses: where segments of a cycle do not end where the task wants it, one sentence each.
        retimed: what another timing of the path of a motion that fails would be; empty: not known.
        design: the smallest base on which limits of tip-over and slip are kept; None: not asked for.
    """

    name: str
    motion: Trajectory
    time_scale: tuple[tuple[float, MotionCheck], ...] = ()
    offsets: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    misses: tuple[str, ...] = ()
    retimed: str = ""
    design: Design | None = None

    @property
    def assumed(self) -> list[str]:
        """The assumptions about the motion where its file gives nothing, one sentence each."""
        rests = f"the robot rests before 0 s and after {self.motion.end:.4g} s"
        if not self.task.robot.acts.end:
            return [*self.motion.assumed, rests]
        within = self.check.within
        steps = [STEPS] if within is not None and within.tolerance.overshoot else []
        left = "stops along the path and by brakes" if self.stops else _NO_STOPS
        return [*self.motion.assumed, rests, *steps, _NOT_DRIVING.format(left)]

    @property
    def unproved(self) -> str:
        """What a proof lacks; of fitted samples none is possible."""
        if self.motion.fit is None or not self.check.verified:
            return self.check.unproved
        return (
            "a proof: the samples do not give accelerations exactly; ocptip certify proves the commanded "
            "trajectory, with its velocities and accelerations"
        )

    def require(self, text: str) -> tuple[Outcome, ...]:
        """Return which requirements the motion meets.

        Example::

            all(one.met for one in found.require("tilt >= 5 deg, push >= 20 N"))

        Margins are those of the worst case where the limits have an uncertainty.

        Args:
            text: requirements with commas between them; `ocptip.api.inputs.requirements.UNITS` names the
                quantities.

        Raises:
            InputError: one of them cannot be understood, or is not of a motion.
        """
        return motion_outcomes(self, text)

    def save_bag(self, path: str | os.PathLike[str]) -> None:
        """Write trajectory, joint states and the columns of `motion.csv` over time as a bag of ROS 2 (MCAP).

        Angles are in rad. Accelerations that step have two messages at the same time. See
        `ocptip.trajectories.bags.write_bag` for the topics.

        Args:
            path: of the folder, which must not exist.

        Raises:
            InputError: it exists, cannot be written, or `rosbags` is missing.
        """
        save_bag(self.task, self.motion, path)

    def save_plot(self, path: str | os.PathLike[str]) -> Path:
        """Draw tipping margin, friction used and forces of the contacts over time; returns the file's path.

        Args:
            path: of a .png, .pdf or .svg file.
        """
        samples = samples_joined(task_samples(self.task, self.motion))
        return save_figure(ground_figure(seen_plan(self.task, self.motion, self.checked), samples), path, 150)

    def __repr__(self) -> str:
        """Verdict, duration and energy, margins, robustness."""
        return brief(f"{self.name} on {self.task.name}", self)

    def to_dict(self) -> dict[str, Any]:
        """Verdict, worst values with their times, limits: plain data for JSON."""
        offsets = {
            f"{place}_offset_{unit}": offset
            for unit, pair in self.offsets.items()
            for place, offset in zip(("start", "goal"), pair, strict=True)
        }
        changes = [one.to_dict() for one in self.sensitivities]
        return {
            "motion": self.name,
            "task": self.task.name,
            **self.checked.to_dict(),
            **self.task.robot.masses_to_dict(),
            "limits": self.task.limits.to_dict(),
            "margins": [one.to_dict() for one in self.margins],
            "tolerated": [one.to_dict() for one in self.robustness],
            **stops_to_dict(self.task, self.stops),
            **({"sensitivities": changes} if changes else {}),
            **({"design": self.design.to_dict()} if self.design else {}),
            "assumed": [*self.task.robot.notes, *self.assumed],
            "interpolation": self.motion.points.interpolation if self.motion.points else None,
            "fit": self.motion.fit.to_dict() if self.motion.fit else None,
            **offsets,
            "retimed": self.retimed or None,
            "time_scale": [{"factor": factor, **checked.to_dict()} for factor, checked in self.time_scale],
            "versions": versions(),
        }


def check(
    task: TaskLike | None,
    motion: MotionLike | ArrayLike | None = None,
    *,
    base: Base | None = None,
    drive_profile: ProfileLike | None = None,
    step: float = 0.01,
    time_scale: Sequence[float] = (),
    stops: Kinds | None = None,
    sensitivities: bool = False,
    design: bool = False,
    rise_time: float | None = None,
    unit: str | None = None,
    rate: float | None = None,
    columns: Mapping[str, str | int] | None = None,
    topic: str | None = None,
    stage: Callable[[str], None] | None = None,
    progress: Callable[[int, int, None], None] | None = None,
) -> Check:
    """Check whether a motion keeps all limits of a task at every instant. No optimisation.

    A case, or a task file that states no uncertainty, has the default one, as in :func:`ocptip.load_task`.

    Example::

        found = ocptip.check("task.toml", "trajectory.json")
        found = ocptip.check("plan-A")  # the folder of a plan
        found = ocptip.check("cart.toml", "start", drive_profile="2 m, 0.8 m/s, 1 m/s^2")

    Args:
        task: robot and limits, what :func:`ocptip.load_task` takes; or, alone, the folder of a plan or a file
            that names its case.
        motion: a motion, such as `plan.motion`, or the path of a file: profile commands, a joint trajectory
            (JSON, YAML), samples (CSV). None: that of `task`. Where the base drives also a posture of an arm
            that is held: (n,), rad (prismatic joints: m), or a name in the task.
        base: of a case, if it is not that of the file.
        drive_profile: how the base drives meanwhile, instead of as in the task: what
            :func:`ocptip.load_drive_profile` gives or takes.
        step: s, first distance of the instants.
        time_scale: factors; the check is repeated with all times multiplied by each.
        stops: what if the motion is stopped at any instant: along the path, by brakes, both, by a controller
            that is cancelled, or all; while the base drives only cancels.
        sensitivities: say what changes of masses and contacts would do.
        design: say how narrow the feet and how light the base may be.
        rise_time: s, of profile commands; default: that of the file, or of the task.
        unit, rate, columns, topic: of files, see `ocptip.trajectories.read.load_motion`.
        stage: called with what is done next.
        progress: called with the numbers of instants that are checked and that are to be checked.

    Raises:
        InputError: the motion cannot be read, or does not fit the robot; names file and key.
    """
    step = positive_number("step", step)
    for factor in time_scale:
        positive_number("time_scale", factor)
        if not 1 / _SCALE <= factor <= _SCALE:
            raise InputError(f"time_scale: must be between {1 / _SCALE:g} and {_SCALE:g}, got {factor:g}")
    say = stage or silent
    if motion is None:
        if not isinstance(task, str | os.PathLike):
            raise InputError("motion: missing; the task alone is no motion")
        motion, task = task, None
    reading = {"rise_time": rise_time, "unit": unit, "rate": rate, "columns": columns, "topic": topic}
    name, task, given = given_motion(motion, task, base=base, drive_profile=drive_profile, **reading)
    if task.is_cycle and sensitivities:
        raise InputError("sensitivities: not for cycles")
    asked = {"sensitivities": sensitivities, "design": design}
    refuse_objects(task, *(name for name, wanted in asked.items() if wanted))
    drives, cancels = bool(task.robot.acts.end), stops is not None and "cancel" in SCENARIOS[stops]
    if drives and stops in (None, "cancel"):
        task = task.each(lambda one_task: replace(one_task, limits=one_task.limits.without_stops))
    refuse_driving(
        task, *[f"stops {stops}"] * (stops not in (None, "cancel")), *["sensitivities"] * sensitivities
    )
    if stops is not None and "path" in SCENARIOS[stops]:
        task = task.each(lambda one_task: replace(one_task, limits=one_task.stops.asked(one_task.limits)))
    how = {"step": step, "progress": progress}
    with naming(name):
        say("checking the motion ...")
        sequence = segments_of(task, given)
        checked = check_cycle(task, sequence, **how)
        if given.fit is None:  # of which the accelerations are an estimate
            say("proving what was checked ...")
            checked = certified_cycle(task, sequence, checked, cancels=cancels and not drives, say=say)
        checked = with_rises(task, sequence, checked)
        scaled = [(f, check_cycle(task, sequence.time_scaled(f), **how).whole) for f in time_scale]
    say("finding which deviations lose no contact ...")
    robust = robustness(task, sequence)
    smallest = None
    if design:
        say("searching the smallest base ...")
        smallest = motion_design(task, sequence)
    if stops is not None:
        say("checking stops ...")
    stopped = stops_by_segment(task, sequence, checked, stops)
    alone = None if task.is_cycle else task.segments[0].task
    changes = ()
    if sensitivities and alone:
        say("finding what would help ...")
        changes = sensitivities_of(alone, given)
    if alone is None:
        offsets, misses = _offsets_of_cycle(cast(CycleTask, task), sequence)
    else:
        offsets, misses = offsets_of(given, alone), ()
    return Check(
        name,
        given,
        tuple(scaled),
        offsets,
        misses,
        "" if alone is None else retimed(alone, given, checked.whole),
        smallest,
        task=task,
        checked=checked,
        robustness=robust,
        stops=stopped,
        sensitivities=changes,
    )


def retimed(task: MotionTask, motion: Trajectory, checked: MotionCheck) -> str:
    """The fastest timing of the path of a motion that fails, as a sentence.

    Empty where no timing can help (angles, clearance) and where the path cannot be fitted. Also empty where
    jerks, or torques within the uncertainty, are too large: these timings ignore both. Empty with objects.
    """
    broken = [name for name, worst in checked.worst.items() if worst.broken]
    beyond = {TORQUE_WITHIN, "jerk_ratio", *OF_PATH}
    waived = checked.verified or checked.objects or task.robot.acts.size
    if waived or not beyond.isdisjoint(broken):
        return ""
    try:
        path = path_of_motion(motion).path
    except (OcptipError, ValueError, ArithmeticError):
        return ""
    given = task.limits.tolerance.given
    try:
        least = least_cost(task.robot, path, task.limits, TIME, _WITHIN_NODES if given else _RETIMED_NODES)
    except InputError as error:
        return f"no timing of its path from rest to rest keeps the limits: {error}"
    except (OcptipError, ValueError, ArithmeticError):
        return ""
    slower = f"{least:.3g} instead of {motion.end:.3f} s{', within the uncertainty' if given else ''}"
    return f"along this path the limits allow about {slower} (coarse grid; ocptip retime is exact to 0.1 %)"


def offsets_of(motion: Trajectory, task: MotionTask) -> dict[str, tuple[float, float]]:
    """Largest differences of start and goal from the task's (from the nearest of its choices), deg and m.

    Where a gripper pose is asked for, any posture that reaches it is as good.
    """
    ends = np.array([motion.start, motion.goal])
    asked = min(((task.start, task.goal), *task.choices), key=lambda pair: np.abs(ends - pair).max())
    off = np.abs(ends - asked)
    if (arm := task.robot.arm) is not None:
        for end_offsets, posture, target in zip(off, ends, task.targets, strict=True):
            if target is not None and target.reached(arm, posture[None], REACHED)[0]:
                end_offsets[:] = 0.0
    start, goal = (_by_unit(end_offsets, task) for end_offsets in off)
    return {unit: (start[unit], goal[unit]) for unit in start}


def _by_unit(off: np.ndarray, task: Task) -> dict[str, float]:
    """Largest of offsets (n,), rad and m, by unit of files, as far as there are coordinates of it."""
    angular = np.array(task.robot.units) == "rad"
    values = {"deg": np.degrees(off[angular]), "m": off[~angular]}
    return {unit: float(value.max()) for unit, value in values.items() if len(value)}


def _offsets_of_cycle(
    task: CycleTask, motion: Trajectory
) -> tuple[dict[str, tuple[float, float]], tuple[str, ...]]:
    """The offsets of a cycle's segment ends from the task, and messages about goals that are missed."""
    seams = [motion.start, *(part.goal for part in motion.segments)]
    offsets = [_by_unit(task.offset(end, q, SAME["m"]), task) for end, q in enumerate(seams)]
    misses = tuple(
        _off_text(task, end, seams[end], unit, offset)
        for end, part in enumerate(offsets)
        for unit, offset in part.items()
        if offset > SAME[unit]
    )
    return {unit: (offsets[0][unit], offsets[-1][unit]) for unit in offsets[0]}, misses


def _off_text(task: CycleTask, end: int, q: np.ndarray, unit: str, offset: float) -> str:
    """That a segment does not end (or the first one start) where the task wants it."""
    name, _, target = task.ends[end]
    if target is None:
        return f"the {name} is {offset:.4g} {unit} off the task's"
    return f"the {name} misses its gripper pose by {task.pose_miss(end, q):.2g} (m, rad)"
