"""`ocptip.report`: what a plan, a cycle or a robot at rest was checked for, as data for the safety file."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from ocptip.api.chart import KINDS, chart
from ocptip.api.drive import drive
from ocptip.api.results.chart import LoadChart
from ocptip.api.results.drive import DriveEnvelope
from ocptip.api.tasks import load_task
from ocptip.basics.errors import InputError
from ocptip.basics.text import silent
from ocptip.basics.write import versions
from ocptip.certificate.checks import certified_cycle
from ocptip.contact.bindings.wheel import DrivenWheel
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.cycles.check import check_cycle
from ocptip.motion.cycles.task import CycleTask, Task
from ocptip.motion.stops.cancels import SafeDecelerations
from ocptip.motion.stops.check import (
    Stops,
    cancels_by_segment,
    cancels_to_dict,
    stops_by_segment,
    stops_of,
    stops_to_dict,
)
from ocptip.motion.summary import CheckedMotion
from ocptip.motion.task import MotionTask
from ocptip.motion.tolerated import robustness
from ocptip.pictures.animation import Moving, plan_times
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.load_cases import (
    LoadCase,
    LoadCaseGrid,
    largest_payload,
    load_cases,
    tilt_by_direction,
)
from ocptip.standing.margins import Margins
from ocptip.standing.parts import Part
from ocptip.standing.tolerance import NONE
from ocptip.task_files.option_files import load_asked
from ocptip.task_files.plan_folder import PlanFolder, arms_of, read_plan_folder
from ocptip.trajectories.trajectory import INSIDE, Trajectory

CHART_POSTURES = 4000  # of the load chart
SPEEDS = np.linspace(0.5, 1.6, 12)  # of a motion, over the planned one
INSTANTS = 150  # of a motion at each of them, besides both sides of its switching times
POSTURES = 60  # of a motion, for the largest payload
_SAME = 1e-3  # s: postures no farther apart are one


def report(
    what: str | os.PathLike[str], *, cases: str | None = None, stage: Callable[[str], None] = silent
) -> Stability:
    """Return the load cases, tilts, stops and robustness of a plan, or of a robot at rest.

    Example::

        print(ocptip.report("ocptip-plan-A").stands)

    Args:
        what: the folder of a plan, or a task file, whose robot is at rest.
        cases: a TOML file with the load cases; None: the usual ones.
        stage: called with what is done next.

    Raises:
        InputError: there is no such folder or file, or the robot is no arm.
    """
    path = Path(what)
    folder = read_plan_folder(path) if path.is_dir() else None
    task = folder.task if folder else load_task(path)
    # At rest the verdict is of the base alone; that of a motion includes objects.
    robots = arms_of(task, "report is about", path, objects=folder is not None)
    if folder is not None:
        stages = [
            Stage(*one)
            for one in zip(_tasks(task), folder.parts("report is about", objects=True), strict=True)
        ]
    else:
        names = [segment.name for segment in task.segments]
        stages = [Stage(stage_task, None, name) for stage_task, name in zip(_tasks(task), names, strict=True)]
    stability = Stability(path.name, task, folder, stages, cases is not None)
    if folder is not None:
        stability.moves(stage)
    stability.drives()
    stage("evaluating load cases ...")
    for part, robot in zip(stages, robots, strict=True):
        part.rests(robot, cases)
    if not any(robot.carried for robot in robots):  # charts are of payloads that the gripper holds
        for kind in KINDS:
            stage(f"making the {kind} chart ...")
            try:
                stability.charts.append(chart(task, of=kind, samples=CHART_POSTURES))
            except InputError as error:  # of contacts whose friction has no half spaces
                stability.not_charted.append(f"{error}")
    return stability


def _tasks(task: Task) -> list[MotionTask]:
    """That of the motion; of a cycle one per segment, from and to the first posture of those it may take."""
    if not task.is_cycle:
        return [cast(MotionTask, task)]
    cycle = cast(CycleTask, task)
    starts = [cycle.starts[0], *(segment.goals[0] for segment in cycle.segments[:-1])]
    pairs = zip(cycle.segments, starts, strict=True)
    return [segment.between(start, segment.goals[0]) for segment, start in pairs]


class Stage:
    """A motion, or a segment of a cycle, with its part of the report.

    Args:
        task: with the robot as it is then.
        part: what it does; None: not planned.
        name: of the segment; of a single motion empty.
    """

    def __init__(self, task: MotionTask, part: Part | None, name: str = "") -> None:
        self.task, self.part, self.name = task, part, part.name if part else name
        self.checked: MotionCheck | None = None
        self.stops: Stops | None = None
        self.payloads: tuple[np.ndarray, np.ndarray] | None = None
        self.speeds: tuple[np.ndarray, np.ndarray] | None = None
        self.cases: list[LoadCase] = []
        self.tilts: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def moves(self, checked: MotionCheck) -> None:
        """Evaluate the motion; its check is known."""
        assert self.part is not None
        self.checked, robot, motion = checked, self.part.robot, self.part.motion
        if not robot.acts.end:  # while the base drives, stops of the arm are not computed
            nominal = replace(self.task.limits, tolerance=NONE)
            stopped = check_motion(robot, motion, self.task.stops.asked(nominal))
            self.stops = stops_of(self.task, motion, stopped, "path")
            self.speeds = margins_by_speed(robot, motion)
        times = np.linspace(0.0, motion.end, POSTURES)
        acting = robot.driving(None).during(motion).acting(times)
        self.payloads = self.part.begin + times, largest_payload(robot, motion.states(times)[0], acting)

    def rests(self, robot: Robot, cases_file: str | None) -> None:
        """Evaluate postures at rest."""
        poses, acting = {"start": self.task.start, "goal": self.task.goal}, {}
        if self.part is not None:
            motion, times = self.part.motion, self._poses()
            known = robot.during(motion).acting(np.array(list(times.values())))
            poses = dict(zip(times, motion.states(np.array(list(times.values())))[0], strict=True))
            acting = dict(zip(times, known, strict=True))
        asked = LoadCaseGrid(poses) if cases_file is None else load_asked(cases_file, robot.arm, poses)
        before = f"{self.name}: " if self.name else ""
        asked = replace(
            asked,
            poses={before + pose: q for pose, q in asked.poses.items()},
            acting={
                before + pose: process for pose, process in acting.items() if asked.poses[pose] is poses[pose]
            },
        )
        self.cases = load_cases(robot, asked)
        self.tilts = {
            name: tilt_by_direction(robot, q, acting=asked.acting.get(name))
            for name, q in asked.poses.items()
        }

    def _poses(self) -> dict[str, float]:
        """Times, s, of postures: both ends, and where GN and GT are largest, if that is between."""
        assert self.part is not None
        assert self.checked is not None
        poses = {"start": 0.0, "goal": self.part.motion.end}
        for name, word in (("GN", "min margin"), ("GT", "max friction")):
            time = self.checked.worst[name].time
            if min(abs(time - other) for other in poses.values()) > _SAME:
                poses[f"{word} ({self.part.begin + time:.3f} s)"] = time
        return poses


def margins_by_speed(robot: Robot, motion: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Minimum tipping margin, N m, and maximum friction used of a motion at all `SPEEDS`, nominal.

    Of what cannot tip the margin is infinite; where a contact is lost it is 0, and the friction infinite.
    """
    edges = motion.intervals.ravel()
    times = np.unique([*np.linspace(0.0, motion.end, INSTANTS), *(edges - INSIDE), *(edges + INSIDE)])
    q, qd, qdd = motion.states(times[(times >= 0) & (times <= motion.end)])
    results = [
        Margins.under(robot.loads(q, speed * qd, speed**2 * qdd)[1], robot.tip_over, robot.slip)
        for speed in SPEEDS
    ]
    moments = [np.maximum(np.nan_to_num(one.tipping_moment, nan=0.0, posinf=np.inf), 0.0) for one in results]
    shares = [np.nan_to_num(one.GT, nan=np.inf, posinf=np.inf) for one in results]
    return np.min(moments, axis=1), np.max(shares, axis=1)


class Stability:
    """The stability of a robot at rest and during its motion, and the forces of its contacts.

    Args:
        name: of the plan's folder, or of the task's file.
        task: with the robot.
        folder: of the plan, if there is one.
        stages: of the motion, or of the segments of a cycle.
        given_cases: the load cases were named; all of them have to stand.

    Attributes:
        motion: the check of the motion, its robustness, the stops that the task asks for; None: no motion.
        cancels: safe decelerations of a cancelled controller, by segment.
        envelope: how hard the base may accelerate with the arm at the goal; None: it has no wheels.
        charts: load, tilt and push charts; empty: not made.
        not_charted: why others of these are missing.
    """

    def __init__(
        self,
        name: str,
        task: Task,
        folder: PlanFolder | None,
        stages: Sequence[Stage],
        given_cases: bool = False,
    ) -> None:
        self.name, self.task, self.folder, self.stages = name, task, folder, stages
        self.given_cases = given_cases
        self.motion: CheckedMotion | None = None
        self.cancels: Mapping[str, SafeDecelerations] = {}
        self.envelope: DriveEnvelope | None = None
        self.charts: list[LoadChart] = []
        self.not_charted: list[str] = []

    def moves(self, say: Callable[[str], None]) -> None:
        """Check the motions of the folder."""
        say("checking the motion ...")
        assert self.folder is not None
        task, motion = self.task, self.folder.motion
        checked = certified_cycle(task, motion, check_cycle(task, motion), say=say)
        say("checking stops, robustness and speeds ...")
        stops = {} if task.robot.acts.end else stops_by_segment(task, motion, checked)
        self.motion = CheckedMotion(
            task=task, checked=checked, robustness=robustness(task, motion), stops=stops
        )
        known = {name: stop.decelerations for name, stop in stops.items() if stop.decelerations}
        self.cancels = known or cancels_by_segment(task, motion)
        for stage, stop in zip(self.stages, checked.segments, strict=True):
            stage.moves(stop)

    def drives(self) -> None:
        """Determine how hard the base may accelerate, if it has wheels, with the arm at rest at the goal."""
        stage = self.stages[-1]
        robot = Robot.of(stage.task.robot)
        contacts = robot.support.contacts
        wheels = any(c.kind == DrivenWheel.kind or getattr(c, "friction", 1.0) == 0 for c in contacts)
        if wheels or robot.acts.end:
            goal = stage.task.goal if stage.part is None else stage.part.motion.goal
            limits = self.task.limits.tolerance.of(robot.payload)
            self.envelope = drive(robot.driving(None), goal, uncertainty=limits)

    @property
    def checked(self) -> MotionCheck | None:
        """The check of the motion; of a cycle the worst of all segments; None without a motion."""
        return None if self.motion is None else self.motion.check

    @property
    def cases(self) -> list[LoadCase]:
        """Load cases of all stages."""
        return [case for stage in self.stages for case in stage.cases]

    @property
    def stands(self) -> bool:
        """The motion is verified, stops included where they are asked for, and all given load cases stand.

        Without a motion all postures stand on level ground. The usual load cases do not decide.
        """
        if self.given_cases and not all(case.stands for case in self.cases):
            return False
        if self.motion is not None:
            return self.motion.verified
        return all(case.stands for case in self.cases if not (case.tilt or case.push or case.payload))

    @property
    def critical(self) -> tuple[Moving, int]:
        """What the robot does, or the pose at rest, and the instant with the minimum margin."""
        name, checked = self.task.name, self.checked
        parts = tuple(stage.part for stage in self.stages if stage.part is not None)
        if checked is None or not parts:
            robot, q, none = self.stages[0].task.robot.resting(0), self.stages[0].task.start, np.zeros(1)
            seen = robot.samples_of(none, q[None], 0 * q[None], 0 * q[None])
            return Moving.of_samples(f"{name}, start", robot, none, seen), 0
        time = max(next(checked.worst[key].time for key in ("GN", "GT") if key in checked.worst), 0.0)
        times = np.union1d(plan_times(parts), time)
        return Moving.of_plan(name, parts, times), int(np.searchsorted(times, time))

    @property
    def headline(self) -> str:
        """One line."""
        level = all(case.stands for case in self.cases if not (case.tilt or case.push or case.payload))
        summary = (
            f"{'STABLE' if level else 'NOT STABLE'} at rest" if self.motion is None else self.motion.headline
        )
        fallen = sum(not case.stands for case in self.cases) if self.given_cases else 0
        more = f"; {fallen} of {len(self.cases)} load cases NOT STABLE" if fallen else ""
        return f"{self.task.name}: {summary}{more}"

    def __repr__(self) -> str:
        """The verdict, and how many load cases stand."""
        standing = sum(case.stands for case in self.cases)
        return f"{self.headline}\n  {standing} of {len(self.cases)} load cases stand"

    def to_dict(self) -> dict[str, Any]:
        """The report as plain data for JSON."""
        worst = {} if self.motion is None else {"check": self.motion.checked.to_dict()}
        stops = [{"segment": s.name, **s.stops.to_dict()} for s in self.stages if s.stops]
        held = [float(s.payloads[1].min()) for s in self.stages if s.payloads is not None]
        return {
            "name": self.task.name,
            "headline": self.headline,
            "stable": self.stands,
            **worst,
            **({} if self.motion is None else {"stops_asked": stops_to_dict(self.task, self.motion.stops)}),
            **cancels_to_dict(self.task, self.cancels),
            **({} if self.envelope is None else {"drive": self.envelope.to_dict()}),
            **({"stops": stops if self.task.is_cycle else stops[0]} if stops else {}),
            **({"least_more_payload_kg": min(held)} if held else {}),
            **({"margins_by_speed": self._speeds()} if any(s.speeds for s in self.stages) else {}),
            "tolerated": [one.to_dict() for one in (self.motion.robustness if self.motion else ())],
            "load_cases": [case.to_dict() for case in self.cases],
            "least_tilt_deg": {
                name: float(np.degrees(tilts.min()))
                for stage in self.stages
                for name, (_, tilts) in stage.tilts.items()
            },
            **({"not_charted": self.not_charted} if self.not_charted else {}),
            "assumed": list(self.task.robot.notes),
            "versions": versions(),
        }

    def _speeds(self) -> list[dict[str, Any]]:
        """Rows by segment and speed; None: nothing tips, or no friction holds."""
        names = "speed", "tipping_margin_Nm", "friction_used"
        return [
            {"segment": stage.name}
            | {name: value if np.isfinite(value) else None for name, value in zip(names, row, strict=True)}
            for stage in self.stages
            if stage.speeds
            for row in zip(SPEEDS.tolist(), *(speed.tolist() for speed in stage.speeds), strict=True)
        ]
