"""`ocptip check`: the check of a given motion on a given robot, as a table or as JSON. No optimisation."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, positive_number, share_of_one
from ocptip.basics.text import quantity, ratio
from ocptip.basics.write import plain, versions
from ocptip.cli.stand import _aligned
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.task import MotionTask
from ocptip.published.cases import motion_cases
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import MotionLimits
from ocptip.task_files.motion import load_task
from ocptip.trajectories.read import motion_origin
from ocptip.trajectories.sampled import Motion, SampledMotion

_ROWS = {
    "GN": "tip-over GN",
    "GT": "slip GT",
    "torque_ratio": "torque / limit",
    "clearance_m": "clearance",
    "speed_ratio": "speed / limit",
    "acceleration_ratio": "acceleration / limit",
    "angle_margin_deg": "angle margin",
    "coordinate_margin": "coordinate margin",
    "singularity": "distance from singular poses",
    "motor_speed": "motor speed",
}
_UNITS = {"clearance_m": ("mm", 1e3), "angle_margin_deg": ("deg", 1.0)}
_LEAST = (*_UNITS, "coordinate_margin", "singularity")
_MARGINS = ("angle_margin_deg", "coordinate_margin")
_SCALE = 1e6  # factors of time up to this and down to its inverse
_SAME = {"deg": 0.01, "m": 1e-4}  # offsets up to this are not worth a note


@dataclass(frozen=True)
class CheckReport:
    """What `ocptip check` knows about a motion.

    Attributes:
        motion: name of the motion's file.
        task: the robot and the limits.
        check: of the motion as it is.
        scaled: checks of the same path with all times multiplied by a factor, in the order asked for.
        offsets: by unit ("deg" for angles, "m" for lengths, as far as the coordinates have such), the largest
            difference of the motion's start and of its goal from the task's.
        interpolation: what was checked between samples; None for ramp commands.
    """

    motion: str
    task: MotionTask
    check: MotionCheck
    scaled: tuple[tuple[float, MotionCheck], ...]
    offsets: dict[str, tuple[float, float]]
    interpolation: str | None

    @property
    def verified(self) -> bool:
        """True if the motion as it is keeps all limits."""
        return self.check.verified

    def to_dict(self) -> dict[str, Any]:
        """Plain data; what is not finite becomes None."""
        offsets = {
            f"{place}_offset_{unit}": offset
            for unit, pair in self.offsets.items()
            for place, offset in zip(("start", "goal"), pair, strict=True)
        }
        return plain(
            {
                "motion": self.motion,
                "task": self.task.name,
                **self.check.to_dict(),
                "limits": dataclasses.asdict(self.task.limits),
                "interpolation": self.interpolation,
                **offsets,
                "time_scale": [{"factor": factor, **checked.to_dict()} for factor, checked in self.scaled],
                "versions": versions(),
            }
        )

    def to_json(self) -> str:
        """The same as JSON text."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False)

    def to_text(self) -> str:
        """The table for people: verdict, worst instants, energy. ASCII only, but for names."""
        checked = self.check
        verdict = "VERIFIED. All limits hold" if checked.verified else "NOT VERIFIED"
        lines = [f"{self.motion} on {self.task.name}: {verdict}."]
        lines += [f"  {violation}" for violation in checked.violations]
        lines += ["", *_worst_table(checked), ""]
        lines += [f"energy {quantity(checked.energy, 'J')}, duration {quantity(checked.duration, 's')}"]
        lines += [f"checked at {checked.samples} instants"]
        if self.interpolation:
            lines += [
                f"note: checked is the curve through the samples, {self.interpolation}; where accelerations"
            ]
            lines += ["      jump between samples it overshoots, see ocptip.trajectories.sampled"]
        for unit, pair in self.offsets.items():
            for verb, place, offset in zip(("starts", "ends"), ("start", "goal"), pair, strict=True):
                if offset > _SAME[unit]:
                    lines += [f"note: the motion {verb} {offset:.4g} {unit} off the task's {place}"]
        if self.scaled:
            lines += ["", *_scale_table(self.scaled)]
        return "\n".join(lines)


def check(
    name: str,
    motion: Motion,
    task: MotionTask,
    *,
    factors: Sequence[float] = (),
    step: float = 0.01,
) -> CheckReport:
    """Check a motion, and the same path faster or slower.

    Args:
        name: of the motion, for the table.
        motion: to be checked.
        task: its robot and limits; start and goal are only compared.
        factors: > 0, by which all times are multiplied.
        step: first spacing of the grid, s.

    Raises:
        InputError: the motion does not fit the arm, is too long for the step, or a factor or the step is not
            positive.
    """
    step = positive_number("--step", step)
    for factor in factors:
        positive_number("--time-scale", factor)
        if not 1 / _SCALE <= factor <= _SCALE:
            raise InputError(f"--time-scale: must be between {1 / _SCALE:g} and {_SCALE:g}, got {factor:g}")
    try:
        checked = check_motion(task.robot, motion, task.limits, step=step)
        scaled = [
            (f, check_motion(task.robot, motion.time_scaled(f), task.limits, step=step)) for f in factors
        ]
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    curve = motion.interpolation if isinstance(motion, SampledMotion) else None
    return CheckReport(name, task, checked, tuple(scaled), _offsets(motion, task), curve)


def _offsets(motion: Motion, task: MotionTask) -> dict[str, tuple[float, float]]:
    """Largest differences of start and goal from the task's, angles in degrees and lengths in m."""
    angular = np.array([unit == "rad" for unit in task.robot.units])
    off = np.abs([motion.start - task.start, motion.goal - task.goal])
    found = {}
    for unit, factor, which in (("deg", 180 / np.pi, angular), ("m", 1.0, ~angular)):
        if which.any():
            start, goal = factor * off[:, which].max(axis=1)
            found[unit] = float(start), float(goal)
    return found


def with_limits(
    task: MotionTask,
    *,
    gn: float | None = None,
    gt: float | None = None,
    torque_ratio: float | None = None,
    clearance: float | None = None,
) -> MotionTask:
    """The same task with those limits replaced that are given.

    Raises:
        InputError: a limit that cannot be; names the option.
    """
    reserves = {"GN": ("--gn", gn), "GT": ("--gt", gt)}
    others = {"torque_ratio": ("--torque-ratio", torque_ratio), "clearance": ("--clearance", clearance)}
    values = {name: share_of_one(*one) for name, one in reserves.items() if one[1] is not None}
    for name, (option, value) in others.items():
        if value is not None:
            values[name] = positive_number(option, value, zero_allowed=name == "clearance")
    limits: MotionLimits = dataclasses.replace(task.limits, **values)
    return dataclasses.replace(task, limits=limits)


def choose_task(
    motion_file: str, case: str | None = None, base: str | None = None, task_file: str | None = None
) -> MotionTask:
    """The task named on the command line, or the case that the motion's file names.

    Args:
        motion_file: read for its `case` and `base` only.
        case, base: of a printed case; the default base is the file's if the case is the file's, else
            "effective".
        task_file: a task file instead.

    Raises:
        InputError: none or unknown, or a base together with a task file.
    """
    if task_file is not None:
        if base is not None:
            raise InputError("--base: only for --case; a task file has its own base")
        return load_task(task_file)
    origin = motion_origin(motion_file)
    known = origin.get("case") in motion_cases()
    if case is None and "case" in origin and not known:
        raise InputError(
            f"{motion_file}: is for {origin['case']!r}, which is no printed case "
            f"({', '.join(motion_cases())}); say which robot by --task TASK.toml or --case A..H"
        )
    if case is None and not known:
        raise InputError(f"{motion_file}: names no case; say which robot by --case A..H or --task TASK.toml")
    if base is None:
        own = known and case in (None, origin["case"])
        base = origin.get("base", "effective") if own else "effective"
    return experiment_task(case or origin["case"], base)


def _worst_table(checked: MotionCheck) -> list[str]:
    rows = [["quantity", "worst", "limit", "time", "where", ""]]
    for name, title in _ROWS.items():
        if name not in checked.worst:
            continue
        worst = checked.worst[name]
        broken = any(violation.startswith(f"{name} ") for violation in checked.violations)
        time = f"{worst.time:.3f} s" if math.isfinite(worst.time) else "-"
        sign = ">=" if name in _LEAST else "<="
        limit = f"{sign} {_value(name, worst.limit)}"
        rows.append(
            [title, _value(name, worst.value), limit, time, worst.detail or "-", "BROKEN" if broken else ""]
        )
    return _aligned(rows, left=(0, 4, 5))


def _scale_table(scaled: Sequence[tuple[float, MotionCheck]]) -> list[str]:
    names = [name for name in _ROWS if name not in _MARGINS and name in scaled[0][1].worst]
    rows = [["times x", "verdict", "duration", "energy", *(_ROWS[name] for name in names)]]
    for factor, checked in scaled:
        verdict = "verified" if checked.verified else "NOT VERIFIED"
        numbers = [_value(name, checked.worst[name].value) for name in names]
        rows.append(
            [f"{factor:g}", verdict, f"{checked.duration:.3f} s", quantity(checked.energy, "J"), *numbers]
        )
    return _aligned(rows, left=(1,))


def _value(name: str, value: float) -> str:
    unit, scale = _UNITS.get(name, ("", 1.0))
    return quantity(scale * value, unit) if unit else ratio(value)
