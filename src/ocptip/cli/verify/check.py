"""`ocptip check`: the check of a given motion on a given robot. No optimisation."""

from __future__ import annotations

import math
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.api.check import SAME, Check, check
from ocptip.api.inputs.given import NO_MOTION, task_of_motion
from ocptip.api.tasks import load_task
from ocptip.basics.errors import InputError, naming
from ocptip.basics.text import quantity, ratio, table, wrapped
from ocptip.cli.layout import check_rows, gear_rows, masses, narrowed
from ocptip.cli.motion_summary import motion_text, required_lines, rise_rows
from ocptip.cli.options import (
    GatedReport,
    gate_of,
    given_limits,
    naming_options,
    read_gate,
    taken,
    typed,
    with_cancel,
)
from ocptip.cli.terminal import Progress
from ocptip.cli.verify.stand import check_plot_target
from ocptip.motion.check import MotionCheck
from ocptip.motion.stops.rules import SCENARIOS
from ocptip.motion.summary import motion_line
from ocptip.motion.violations import RESULT_TITLES, result_title, result_unit
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN
from ocptip.standing.mechanism import StandingMechanism
from ocptip.task_files.option_files import read_columns
from ocptip.task_files.path import refuse_early
from ocptip.trajectories.bags import require_new
from ocptip.trajectories.points import PEAK_TOLERANCE, Fit

_MARGINS = ("angle_margin_deg", "position_margin_m")
_AT_WORST = (TIP_WITHIN, SLIP_WITHIN)
_COARSE = 0.05  # deg: a file that rounds so much has whole degrees, or tenths
_NOISY = "the calmest motion within the noise of the samples"


def run(options: Namespace) -> CheckReport:
    """Check the motion, and the same path faster or slower, on the robot that is named."""
    if Path(options.motion).suffix == ".toml":
        raise InputError(NO_MOTION.format(options.motion), "", options.motion)
    read_gate(options)
    refuse_early(options.motion, read_columns(options.columns))
    if options.bag:
        with naming("--bag"):
            require_new(options.bag)
    if options.plot:
        check_plot_target(options.plot)
    with naming_options(
        "base", "step", "time_scale", "rate", "rise_time", "sensitivities", "design", "topic", "drive_profile"
    ):
        task, _ = task_of_motion(options.motion, options.case or options.task, options.base)
        task = load_task(task, **given_limits(options))
        asked = options.stops is not None and "cancel" in SCENARIOS[options.stops]
        if not asked and not any(segment.task.limits.cancel for segment in task.segments):
            for name in typed(options, "deceleration", "reaction", "base_deceleration"):
                raise InputError("is of cancels; add --stops cancel", f"--{name.replace('_', '-')}")
        task = with_cancel(task, options)
        with Progress(sys.stderr, "reading the motion ...", what="instants") as progress:
            same = "drive_profile step time_scale stops sensitivities design rise_time unit rate topic"
            how = {"columns": read_columns(options.columns), "stage": progress.stage, "progress": progress}
            result = check(task, options.motion, **taken(options, same), **how)
            if options.bag:
                progress.stage("writing the bag ...")
                result.save_bag(options.bag)
    return CheckReport(result, options.bag, options.plot, **gate_of(options, result))


@dataclass
class CheckReport(GatedReport):
    """The report of `ocptip check` on a motion.

    Attributes:
        check: of the motion.
        bag: folder that it was written to; None: not asked for.
        plot: file of its picture, likewise.
    """

    check: Check
    bag: str | None = None
    plot: str | None = None

    @property
    def kept(self) -> bool:
        """True if the motion as it is keeps all limits, stops included where they are asked for."""
        return self.check.verified

    @property
    def broken(self) -> Sequence[str]:
        """The broken limits, stops included."""
        return self.check.broken

    def to_dict(self) -> dict[str, Any]:
        """The check as data."""
        return {**self.check.to_dict(), **self.gate_to_dict()}

    def write(self) -> Iterator[Path]:
        """Draw the picture and write the report for pipelines, if they are wanted."""
        if self.plot is not None:
            yield self.check.save_plot(self.plot)
        yield from super().write()

    def to_text(self) -> str:
        """Verdict, margins, robustness; with -v all quantities."""
        result, checked = self.check, self.check.check
        details, tables = [], []
        if self.verbose:
            details = [("instants", f"{checked.samples} checked")]
            if result.motion.profiles is not None:
                details += rise_rows(result.motion, checked)
            details += check_rows(result.task.robot, checked, result.robustness)
            if result.task.is_cycle:
                details += gear_rows(result.checked)
            else:
                details.append(("masses", masses(result.task.robot)))
            tables = [table(narrowed(worst_rows(checked), 4), left=(0, 4, 5))]
            tables += [_scale_table(result.time_scale)] if result.time_scale else []
        if result.design:
            tables.append(wrapped("Design", result.design.lines(result.task.robot.support)))
        head = [self.headline, motion_line(checked)]
        more = {"scaled": result.time_scale, "more": self._notes(), "assumed": result.assumed}
        required = required_lines(self.outcomes)
        return motion_text(result, head, **more, details=details, tables=tables, required=required)

    @property
    def headline(self) -> str:
        """Names of motion and task; the verdict in capital letters, and what it is about."""
        result = self.check
        verdict = f"{result.name} on {result.task.name}   {result.headline}"
        noisy = result.motion.fit is not None and result.motion.fit.noisy.any()
        return f"{verdict} ({_NOISY}, see note)" if noisy else verdict

    def _notes(self) -> list[str]:
        """Remarks on what a user may not expect of the motion."""
        motion = self.check.motion
        moves = bool(np.any(motion.speed_peaks))  # a posture that is held has no curve and no start
        notes = [self.check.retimed] if self.check.retimed else []
        lost = any(broken.name.startswith(("GN", "GT")) for broken in self.check.check.violations)
        given = self.check.sensitivities or self.check.check.objects  # which these options do not take
        if lost and not (given or self.check.task.is_cycle):
            notes += [
                "a contact is lost: --sensitivities says what one change of base, load or speed helps, "
                "--design how wide or heavy the base must be"
            ]
        notes += [f"trajectory and margins over time are in the bag {self.bag}"] if self.bag else []
        if motion.fit is not None:
            notes += fit_notes(motion.fit, self.check.task.robot)
        elif motion.points is not None and moves:
            curve = motion.points.interpolation
            notes += [
                f"checked is the curve through the samples, {curve}; where accelerations step between "
                "samples, it overshoots"
            ]
        notes += self.check.misses
        for unit, pair in self.check.offsets.items() if moves and not self.check.task.is_cycle else ():
            for verb, place, offset in zip(("starts", "ends"), ("start", "goal"), pair, strict=True):
                if offset > SAME[unit]:
                    notes += [f"the motion {verb} {offset:.4g} {unit} off the task's {place}"]
        return notes


def fit_notes(fit: Fit, robot: StandingMechanism) -> list[str]:
    """Remarks on a fit to samples: its curve, its distance from them, and its limitations."""
    units = ["deg" if unit == "rad" else unit for unit in robot.units]
    scales = np.where(np.array(robot.units) == "rad", 180 / np.pi, 1.0)
    far = int(np.argmax(fit.distance / fit.tolerance))
    wide = int(np.argmax(fit.tolerance * scales))

    def with_unit(joint: int, values: np.ndarray, per: str = "") -> str:
        return f"{scales[joint] * values[joint]:.2g} {units[joint]}{per} ({robot.names[joint]})"

    why = "noise of the samples" if fit.noisy[wide] else "rounding of the file"
    if not fit.noisy[wide] and robot.units[wide] == "rad" and fit.tolerance[wide] * scales[wide] > _COARSE:
        why += " (exact values need more digits: 60.000 instead of 60)"
    notes = [
        f"checked is the calmest motion that passes {fit.samples} samples within at most "
        f"{with_unit(wide, fit.tolerance)}, {why}; its maximum distance is {with_unit(far, fit.distance)}; "
        f"speeds and accelerations may exceed limits by {100 * PEAK_TOLERANCE:g} %"
    ]
    with np.errstate(divide="ignore"):
        unseen = np.sqrt(80 * fit.tolerance / robot.limits.acceleration)
    longest = max(float(np.max(unseen)), fit.spacing)
    notes += [f"10 % too much acceleration for less than {longest:.2g} s may not be seen"]
    if fit.speed_distance is not None:
        worst = int(np.argmax(fit.speed_distance * scales))
        notes += [f"its speeds are up to {with_unit(worst, fit.speed_distance, '/s')} from those of the file"]
    return notes


def worst_rows(checked: MotionCheck) -> list[list[str]]:
    """Worst value, limit, time and place of every quantity, below a row of titles."""
    rows = [["quantity", "worst", "limit", "time", "where", ""]]
    known = [name for name in RESULT_TITLES if name in checked.worst]
    for name in (*known, *(name for name in checked.worst if name not in RESULT_TITLES)):
        worst = checked.worst[name]
        broken = any(violation.name == name for violation in checked.violations)
        time = f"{max(worst.time, 0.0):.3f} s" if math.isfinite(worst.time) else "-"
        sign = ">=" if worst.least else "<="
        limit = f"{sign} {_value(name, worst.limit)}"
        where = "" if name in _AT_WORST else worst.detail
        rows.append(
            [result_title(name), _value(name, worst.value), limit, time, where or "-", "BROKEN" * broken]
        )
    return rows


def _scale_table(scaled: Sequence[tuple[float, MotionCheck]]) -> list[str]:
    names = [name for name in RESULT_TITLES if name not in _MARGINS and name in scaled[0][1].worst]
    rows = [["times x", "verdict", "duration", "energy", *map(result_title, names)]]
    for factor, checked in scaled:
        verdict = checked.headline if not checked.verified else "CHECKED"
        numbers = [_value(name, checked.worst[name].value) for name in names]
        rows.append(
            [f"{factor:g}", verdict, f"{checked.duration:.3f} s", quantity(checked.energy, "J"), *numbers]
        )
    return table(rows, left=(1,))


def _value(name: str, value: float) -> str:
    unit, scale = result_unit(name)
    return quantity(scale * value, unit) if unit else ratio(value)
