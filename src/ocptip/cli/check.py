"""`ocptip check`: the check of a given motion on a given robot. No optimisation."""

from __future__ import annotations

import math
import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, OcptipError, naming, positive_number
from ocptip.basics.text import quantity, ratio
from ocptip.basics.write import versions
from ocptip.certificate.checks import certified, certified_cycle
from ocptip.cli.command import Report
from ocptip.cli.cycles import require_plain, segment_table, segments_of
from ocptip.cli.given_motion import motion_of, read_options, task_of
from ocptip.cli.layout import (
    check_rows,
    gear_rows,
    masses,
    named,
    rise_rows,
    sensitivities_to_dict,
    table,
    under,
)
from ocptip.cli.options import given_limits, with_limits
from ocptip.cli.stops import (
    cycle_with_path_stops,
    sensitivities_of,
    stop_table,
    stops_of,
    stops_of_cycle,
    stops_to_dict,
    with_path_stops,
)
from ocptip.cli.terminal import Progress, say_if_compiling
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.cycles.check import CycleCheck, check_cycle
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.cycles.tolerated import cycle_tolerances
from ocptip.motion.objective import TIME
from ocptip.motion.stops import Stops
from ocptip.motion.task import REACHED, MotionTask
from ocptip.motion.tolerated import Tolerated, tolerances
from ocptip.retiming.retime import OF_PATH, least_cost
from ocptip.standing.arm import Robot
from ocptip.standing.elastic.drives import with_rise
from ocptip.standing.limits import CLEARANCE_WITHIN, SLIP_WITHIN, TIP_WITHIN, TORQUE_WITHIN
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.sensitivity import Sensitivity
from ocptip.trajectories.path_fit import path_of_motion
from ocptip.trajectories.points import PEAK_TOLERANCE, Fit
from ocptip.trajectories.read import load_motions
from ocptip.trajectories.trajectory import Trajectory

_ROWS = {
    "GN": "tip-over GN",
    "GT": "slip GT",
    "jump_GN": "GN at jumps, overshoot",
    "jump_GT": "GT at jumps, overshoot",
    TIP_WITHIN: "tip-over GN at worst",
    SLIP_WITHIN: "slip GT at worst",
    "GN_stop": "GN in stops on the path",
    "GT_stop": "GT in stops on the path",
    "GN_brakes": "GN in stops by brakes",
    "GT_brakes": "GT in stops by brakes",
    "torque_ratio": "torque / limit",
    TORQUE_WITHIN: "torque / limit at worst",
    "clearance_m": "clearance",
    f"{CLEARANCE_WITHIN}_m": "clearance, joints late",
    "foot_force_N": "force on a foot that gives",
    "jump_foot_force_N": "the same at jumps, overshoot",
    "foot_lift_m": "lift of a foot that gives",
    "GN_gears": "GN while gears ring",
    "GT_gears": "GT while gears ring",
    "speed_ratio": "speed / limit",
    "acceleration_ratio": "acceleration / limit",
    "angle_margin_deg": "angle margin",
    "position_margin_m": "position margin",
    "singularity": "distance from singular poses",
    "motor_speed": "motor speed",
}
_MARGINS = ("angle_margin_deg", "position_margin_m")
_AT_WORST = (TIP_WITHIN, SLIP_WITHIN)
_UNITS = {
    "clearance_m": ("mm", 1e3),
    f"{CLEARANCE_WITHIN}_m": ("mm", 1e3),
    "foot_lift_m": ("mm", 1e3),
    "foot_force_N": ("N", 1.0),
    "jump_foot_force_N": ("N", 1.0),
    "angle_margin_deg": ("deg", 1.0),
    "position_margin_m": ("mm", 1e3),
}
_LEAST = (
    *("clearance_m", f"{CLEARANCE_WITHIN}_m"),
    *("foot_force_N", "jump_foot_force_N"),
    *(*_MARGINS, "singularity"),
)
_NOISY = "the calmest motion within the noise of the samples"
_RETIMED_NODES = 100  # of the timing that a motion is told about: within 1 % of the duration
_WITHIN_NODES = 40  # the same within a tolerance, which takes long
_SCALE = 1e6  # factors of time up to this and down to its inverse
_SAME = {"deg": 0.01, "m": 1e-4}  # offsets up to this are not worth a note


def run(options: Namespace) -> CheckReport:
    """Check the motion, and the same path faster or slower, on the robot that is named."""
    if Path(options.motion).suffix == ".toml":
        raise InputError("is a task or a path, no motion", "", options.motion)
    task, path = task_of(options)
    step = positive_number("--step", options.step)
    for factor in options.time_scale:
        positive_number("--time-scale", factor)
        if not 1 / _SCALE <= factor <= _SCALE:
            raise InputError(f"--time-scale: must be between {1 / _SCALE:g} and {_SCALE:g}, got {factor:g}")
    say_if_compiling()
    name = Path(options.motion).name
    if isinstance(task, CycleTask):
        return _cycle(name, path, task, options, step)
    with Progress(sys.stderr, "reading the motion ...", what="instants") as progress:
        return _single(name, path, with_limits(task, options), options, step, progress)


def _single(
    name: str, path: Path, task: MotionTask, options: Namespace, step: float, progress: Progress
) -> CheckReport:
    """Check a motion that is no cycle."""
    task = with_path_stops(task, options.stops)
    motion = motion_of(path, task, options)
    with naming(name):
        progress.stage("checking the motion ...")
        checked = check_motion(task.robot, motion, task.limits, step=step, progress=progress)
        if motion.fit is None:  # of which the accelerations are an estimate
            progress.stage("proving what was checked ...")
            checked = certified(task.robot, motion, checked, task.limits)
        checked = replace(checked, drives=with_rise(task.robot, motion))
        scaled = [
            (f, check_motion(task.robot, motion.time_scaled(f), task.limits, step=step, progress=progress))
            for f in options.time_scale
        ]
    progress.stage("finding which deviations lose no contact ...")
    deviations = tolerances(task.robot, motion)
    progress.stage("checking stops ...")
    found = stops_of(task, motion, checked, options.stops)
    stops = {"": found} if found else {}
    report = CheckReport(name, task, motion, checked, scaled, _offsets(motion, task), deviations, stops)
    report.retimed = retimed(task, motion, checked)
    if options.sensitivities:
        report.sensitivities = sensitivities_of(task, motion)
    return report


def _cycle(name: str, path: Path, task: CycleTask, options: Namespace, step: float) -> CheckReport:
    """Check the segments of a cycle."""
    require_plain(options, "sensitivities", "rise_time")
    task = cycle_with_path_stops(task.with_limits(given_limits(options)), options.stops)
    found = load_motions(path, task.robot.names, task.robot.units, **read_options(path, task, options))
    with naming(name), Progress(sys.stderr, "checking the cycle ..."):
        motion = segments_of(task, found)
        checked = check_cycle(task, motion, step=step)
        if found.fit is None:  # of which the accelerations are an estimate
            checked = certified_cycle(task, motion, checked)
        scaled = [(f, check_cycle(task, motion.time_scaled(f), step=step).whole) for f in options.time_scale]
    seams = [motion.start, *(own.goal for own in motion.segments)]
    offsets = [_by_unit(task.offset(end, q, _SAME["m"]), task) for end, q in enumerate(seams)]
    ends = {unit: (offsets[0][unit], offsets[-1][unit]) for unit in offsets[0]}
    notes = tuple(
        _off_text(task, end, seams[end], unit, offset)
        for end, own in enumerate(offsets)
        for unit, offset in own.items()
        if offset > _SAME[unit]
    )
    deviations = cycle_tolerances(task, motion)
    stops = stops_of_cycle(task, motion, checked, options.stops)
    return CheckReport(name, task, found, checked.whole, scaled, ends, deviations, stops, (), checked, notes)


def _off_text(task: CycleTask, end: int, q: np.ndarray, unit: str, offset: float) -> str:
    """That a segment does not end (or the first one start) where the task wants it."""
    name, _, target = task.ends[end]
    if target is None:
        return f"the {name} is {offset:.4g} {unit} off the task's"
    return f"the {name} misses its gripper pose by {task.pose_miss(end, q):.2g} (m, rad)"


@dataclass
class CheckReport(Report):
    """What `ocptip check` knows about a motion.

    Attributes:
        name: of the motion's file.
        task: the robot and the limits.
        motion: that was checked.
        check: of the motion as it is.
        scaled: checks of the same path with all times multiplied by a factor, in the order asked for.
        offsets: by unit ("deg" for angles, "m" for lengths, as far as the coordinates have such), the largest
            difference of the motion's start and of its goal from the task's.
        tolerated: deviations that lose no contact; empty if not computed.
        stops: what becomes of the base when the motion is stopped, by segments of a cycle (a single motion:
            ""); empty: not asked for.
        sensitivities: what changes would do; empty if not asked for.
        segments: checks of the segments of a cycle; None for a single motion.
        off: what is to be said of offsets of a cycle.
        retimed: what another timing of the path of a motion that fails would be; empty: not known.
    """

    name: str
    task: MotionTask | CycleTask
    motion: Trajectory
    check: MotionCheck
    scaled: list[tuple[float, MotionCheck]]
    offsets: dict[str, tuple[float, float]]
    tolerated: tuple[Tolerated, ...] = ()
    stops: dict[str, Stops] = field(default_factory=dict)
    sensitivities: tuple[Sensitivity, ...] = ()
    segments: CycleCheck | None = None
    off: tuple[str, ...] = ()
    retimed: str = ""

    @property
    def good(self) -> bool:
        """True if the motion as it is keeps all limits, stops included where they are asked for."""
        return self.check.verified and all(stops.verified for stops in self.stops.values())

    def to_dict(self) -> dict[str, Any]:
        """Verdict, worst values with their times, limits."""
        offsets = {
            f"{place}_offset_{unit}": offset
            for unit, pair in self.offsets.items()
            for place, offset in zip(("start", "goal"), pair, strict=True)
        }
        return {
            "motion": self.name,
            "task": self.task.name,
            **(self.segments or self.check).to_dict(),
            **self.task.robot.masses_to_dict(),
            "limits": self.task.limits.to_dict(),
            "tolerated": [one.to_dict() for one in self.tolerated],
            **stops_to_dict(self.stops),
            **sensitivities_to_dict(self.sensitivities),
            "assumed": [*self.task.robot.notes, *self._assumed],
            "interpolation": self.motion.points.interpolation if self.motion.points else None,
            "fit": self.motion.fit.to_dict() if self.motion.fit else None,
            **offsets,
            "retimed": self.retimed or None,
            "time_scale": [{"factor": factor, **checked.to_dict()} for factor, checked in self.scaled],
            "versions": versions(),
        }

    def to_text(self) -> str:
        """Verdict, worst instants, energy."""
        checked = self.check
        sampled = " (stops at sampled instants)" if self.stops and checked.certified else ""
        noisy = (
            f" ({_NOISY}, see note)" if self.motion.fit is not None and self.motion.fit.noisy.any() else ""
        )
        verdict = (
            f"{checked.headline}{sampled}{noisy}. All limits hold" if self.good else f"NOT VERIFIED{noisy}"
        )
        lines = [f"{self.name} on {self.task.name}: {verdict}."]
        lines += [f"  {violation}" for violation in checked.violations]
        for name, stops in self.stops.items():
            at = f" (segment {name})" if name else ""
            lines += [f"  {violation}{at}" for violation in stops.violations]
        if self.segments and isinstance(self.task, CycleTask):
            lines += ["", *segment_table(self.task, self.segments)]
        lines += ["", *table(worst_rows(checked), left=(0, 4, 5)), ""]
        moving = f"{quantity(checked.energy, 'J')} in {quantity(checked.duration, 's')}"
        rows = [("energy", f"{moving}, checked at {checked.samples} instants")]
        rows += under("retimed", [self.retimed] if self.retimed else ())
        if self.motion.profiles is not None:
            rows += rise_rows(self.motion, checked)
        more = {"sensitivities": self.sensitivities, "stops": self.stops}
        rows += check_rows(checked, self.tolerated, **more)
        if self.segments:
            rows += gear_rows(self.segments)
        else:
            rows.append(("masses", masses(self.task.robot)))
        rows += under("assumed", [*self.task.robot.notes, *self._assumed])
        rows += under("note", self._notes())
        lines += named(rows)
        for name, stops in self.stops.items():
            lines += ["", *([f"segment {name}"] if name else []), *stop_table(stops)]
        if self.scaled:
            lines += ["", *_scale_table(self.scaled)]
        return "\n".join(lines)

    @property
    def _assumed(self) -> list[str]:
        """What the file does not say of the motion."""
        return [*self.motion.assumed, f"the robot rests before 0 s and after {self.motion.end:.4g} s"]

    def _notes(self) -> list[str]:
        """What may be unexpected about the motion."""
        notes = []
        if self.motion.fit is not None:
            notes += fit_notes(self.motion.fit, self.task.robot)
        elif self.motion.points is not None:
            curve = self.motion.points.interpolation
            notes += [f"checked is the curve through the samples, {curve}; where accelerations"]
            notes += ["jump between samples it overshoots, see ocptip.trajectories.points"]
        notes += self.off
        for unit, pair in () if self.segments else self.offsets.items():
            for verb, place, offset in zip(("starts", "ends"), ("start", "goal"), pair, strict=True):
                if offset > _SAME[unit]:
                    notes += [f"the motion {verb} {offset:.4g} {unit} off the task's {place}"]
        return notes


def retimed(task: MotionTask, motion: Trajectory, checked: MotionCheck) -> str:
    """What the fastest timing of the path of a motion that fails is.

    Empty where no timing can help (angles, clearance) or torques within the tolerance, which timings do not
    look at, are too large, and where the path cannot be fitted.
    """
    broken = [name for name, worst in checked.worst.items() if worst.violation]
    if checked.verified or task.robot.varying or not {TORQUE_WITHIN, *OF_PATH}.isdisjoint(broken):
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
    slower = f"{least:.3f} instead of {motion.end:.3f} s{', within the tolerance' if given else ''}"
    return f"on its own path the limits allow {slower} (not checked; ocptip retime finds it)"


def _offsets(motion: Trajectory, task: MotionTask) -> dict[str, tuple[float, float]]:
    """Largest differences of start and goal from the task's (from the nearest of its choices), deg and m.

    Where a gripper pose is asked for, any posture that reaches it is as good.
    """
    ends = np.array([motion.start, motion.goal])
    asked = min(((task.start, task.goal), *task.choices), key=lambda pair: np.abs(ends - pair).max())
    off = np.abs(ends - asked)
    if isinstance(task.robot, Robot):
        arm = task.robot.arm
        for own, posture, target in zip(off, ends, task.targets, strict=True):
            if target is not None and target.reached(arm, posture[None], REACHED)[0]:
                own[:] = 0.0
    start, goal = (_by_unit(own, task) for own in off)
    return {unit: (start[unit], goal[unit]) for unit in start}


def _by_unit(off: np.ndarray, task: MotionTask | CycleTask) -> dict[str, float]:
    """Largest of offsets (n,), rad and m, by unit of files, as far as there are coordinates of it."""
    angular = np.array(task.robot.units) == "rad"
    values = {"deg": np.degrees(off[angular]), "m": off[~angular]}
    return {unit: float(own.max()) for unit, own in values.items() if len(own)}


def fit_notes(fit: Fit, robot: StandingMechanism) -> list[str]:
    """What was made of samples, how far it is from them, and what it cannot know."""
    units = ["deg" if unit == "rad" else unit for unit in robot.units]
    scales = np.where(np.array(robot.units) == "rad", 180 / np.pi, 1.0)
    far = int(np.argmax(fit.distance / fit.tolerance))
    wide = int(np.argmax(fit.tolerance * scales))

    def said(joint: int, values: np.ndarray, per: str = "") -> str:
        return f"{scales[joint] * values[joint]:.2g} {units[joint]}{per} ({robot.names[joint]})"

    notes = [f"checked is the calmest motion that passes {fit.samples} samples within a tolerance, at most"]
    why = "noise of the samples" if fit.noisy[wide] else "rounding of the file"
    notes += [f"{said(wide, fit.tolerance)}, {why}; its largest distance is {said(far, fit.distance)};"]
    notes += [f"speeds and accelerations may exceed limits by {100 * PEAK_TOLERANCE:g} %"]
    with np.errstate(divide="ignore"):
        unseen = np.sqrt(80 * fit.tolerance / robot.limits.acceleration)
    longest = max(float(np.max(unseen)), fit.spacing)
    notes += [f"10 % too much acceleration for less than {1e3 * longest:.2g} ms may not be seen"]
    if fit.speed_distance is not None:
        worst = int(np.argmax(fit.speed_distance * scales))
        notes += [f"its speeds are up to {said(worst, fit.speed_distance, '/s')} from those of the file"]
    return notes


def worst_rows(checked: MotionCheck) -> list[list[str]]:
    """Worst value, limit, time and place of every quantity, below a row of titles."""
    rows = [["quantity", "worst", "limit", "time", "where", ""]]
    for name, title in _ROWS.items():
        if name not in checked.worst:
            continue
        worst = checked.worst[name]
        broken = any(violation.startswith(f"{name} ") for violation in checked.violations)
        time = f"{max(worst.time, 0.0):.3f} s" if math.isfinite(worst.time) else "-"
        sign = ">=" if name in _LEAST else "<="
        limit = f"{sign} {_value(name, worst.limit)}"
        where = "" if name in _AT_WORST else worst.detail
        rows.append([title, _value(name, worst.value), limit, time, where or "-", "BROKEN" if broken else ""])
    return rows


def _scale_table(scaled: Sequence[tuple[float, MotionCheck]]) -> list[str]:
    names = [name for name in _ROWS if name not in _MARGINS and name in scaled[0][1].worst]
    rows = [["times x", "verdict", "duration", "energy", *(_ROWS[name] for name in names)]]
    for factor, checked in scaled:
        verdict = "verified" if checked.verified else "NOT VERIFIED"
        numbers = [_value(name, checked.worst[name].value) for name in names]
        rows.append(
            [f"{factor:g}", verdict, f"{checked.duration:.3f} s", quantity(checked.energy, "J"), *numbers]
        )
    return table(rows, left=(1,))


def _value(name: str, value: float) -> str:
    unit, scale = _UNITS.get(name, ("", 1.0))
    return quantity(scale * value, unit) if unit else ratio(value)
