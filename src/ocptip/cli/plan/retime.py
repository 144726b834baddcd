"""`ocptip retime`: retimes a given path, reports the result, writes files and figures."""

from __future__ import annotations

import sys
from argparse import Namespace
from typing import cast

import numpy as np

from ocptip.api.inputs.given import task_of_motion
from ocptip.api.retime import SLOWEST, RetimedPlan, Timing, retime
from ocptip.api.tasks import load_task
from ocptip.basics.text import quantity, wrapped
from ocptip.cli.command import Report
from ocptip.cli.options import (
    gate_of,
    given_limits,
    naming_options,
    output_directory,
    read_gate,
    taken,
    typed,
)
from ocptip.cli.plan.plan_report import PlanReport
from ocptip.cli.terminal import Progress
from ocptip.motion.violations import broken_words
from ocptip.task_files.option_files import read_columns
from ocptip.task_files.path import refuse_early

_WORDS = {"time": "fastest", "energy": "minimum energy", "both": "minimum cost"}
_WORTH_SAYING = 1.02  # factor of all times: less is left to the details
_ROUNDING = 1e-9  # rad or m: a path that is no farther off passes through its points


def run(options: Namespace) -> Report:
    """Time the path; one that cannot be timed is bad input, and the message says where and why."""
    read_gate(options)
    refuse_early(options.motion, read_columns(options.columns))
    names = "seconds base drive_profile base_limits controller rate jerk max_duration"
    with naming_options(*typed(options, *names.split())):
        asked = options.case or options.task
        task, path = task_of_motion(options.motion, asked, options.base)
        task = load_task(task, **given_limits(options))
        directory = output_directory(options, task.name, task.source)
        with Progress(sys.stderr, "reading the path ...") as progress:
            same = "drive_profile base_limits objective price_per_second max_duration jerk path_tolerance "
            same += "controller rate seconds unit topic"
            columns = read_columns(options.columns)
            plan = retime(task, path, **taken(options, same), columns=columns, stage=progress.stage)
    digest = "" if task.is_cycle else None
    gate = gate_of(options, plan)
    return RetimeReport(plan, directory, not options.no_figures, options.effort, digest, **gate)


class RetimeReport(PlanReport):
    """A path with its timing, or those of a cycle."""

    @property
    def timings(self) -> tuple[Timing, ...]:
        """Those of the segments."""
        return cast(RetimedPlan, self.plan).timings

    def head(self) -> list[str]:
        """Name and verdict; duration beside that of the given motion, energy."""
        timings, checked = self.timings, self.plan.check
        before = [timing.before.duration for timing in timings if timing.before]
        given = f", as given {sum(before):.3f} s" if len(before) == len(timings) else ""
        kind = _WORDS[timings[0].task.objective.name]
        # Both slowdowns: of the timing by its check, and of what a controller makes of it.
        run = sum(one.plan.check.duration for one in timings)
        slower = run / sum(one.timed.motion.end / one.timed.slower for one in timings)
        if slower >= _WORTH_SAYING:
            kind += f", then {100 * (slower - 1):.1f} % slower, so that all limits hold"
        smooth = all(one.timed.jerk is not None and one.timed.verified for one in timings)
        steps = "timed without acceleration steps" if smooth else "accelerations step"
        energy = quantity(checked.energy, "J")
        motion = f"Motion  {checked.duration:.3f} s ({kind}{given})   {energy}   {steps}"
        paths = wrapped("Path", [text for title, text in self.details() if title == "path"])
        slowed = wrapped("Slowed", [text for timing in timings if (text := slowed_text(timing))])
        return [self.headline, motion, *paths, *slowed]

    def details(self) -> list[tuple[str, str]]:
        """The path of each segment, what it was, and what decides its timing."""
        pairs = zip(self.plan.task.segments, self.timings, strict=True)
        of = {s.name: f" (segment {s.name})" if self.plan.task.is_cycle else "" for s, _ in pairs}
        pairs = zip(of.values(), self.timings, strict=True)
        return [(title, f"{text}{name}") for name, item in pairs for title, text in _rows(item)]


def slowed_text(timing: Timing) -> str:
    """By which factor the check has slowed the timing down, or that it could not; empty: nothing to say."""
    timed = timing.timed
    steps = timing.task.limits.tolerance.overshoot and timed.jerk is None
    if any(one.name == "jerk_ratio" for one in timed.check.violations):
        return ""  # a note says why no timing keeps it
    if not timed.check.timed_well:
        text = f"the check finds broken limits also up to {SLOWEST:g} times slower, as far as allowed"
        return f"{text}: try another path{' or --jerk' if steps else ''}"
    if timed.slower < _WORTH_SAYING:
        return ""
    text = f"all times of the timing multiplied by {timed.slower:.4g}, so that all limits hold in the check"
    return f"{text}; --jerk, without acceleration steps that overshoot, may be faster" if steps else text


def _rows(timing: Timing) -> list[tuple[str, str]]:
    """The path, what it was, and what decides its timing."""
    rows = [("path", _path_text(timing)), ("timing", _timing_text(timing))]
    if timing.before is not None:
        verdict = (
            f"; {'; '.join(broken_words(timing.task.robot, timing.before.violations))}"
            if timing.before.violations
            else ""
        )
        rows.append(("as given", f"{timing.before.duration:.3f} s, {timing.before.headline}{verdict}"))
    if timing.task.reference is not None:
        rows += [("assumed", text) for text in timing.task.reference.assumed]
    if timing.timed.later:
        rows.append(("only checked", f"{', '.join(timing.timed.later)}: the timing does not know them"))
    return rows


def _path_text(timing: Timing) -> str:
    """What the path is, how far from its samples, and a spline from the lines between its points."""
    fit, text = timing.fit, timing.fit.how
    units = np.array(timing.task.robot.units)
    if off := _off(units, fit.distance, timing.tool_distance):
        text += f", at most {off} off"
    if fit.keeps_to_lines and (off := _off(units, *timing.beside_lines)):
        keeps = f"({fit.keeps_to_lines} keeps to them)"
        text += f"; between them at most {off} off the straight lines {keeps}"
    corners = len(fit.path.corners)
    return f"{text}; stops at {corners} corner{'s' * (corners > 1)}" if corners else text


def _off(units: np.ndarray, joints: np.ndarray, tool: np.ndarray) -> str:
    """Distances in words, rounded up to 0.01 deg and 0.1 mm; empty: none but rounding."""
    if max(joints.max(), tool.max(initial=0.0)) <= _ROUNDING:
        return ""
    groups = (
        (joints[units == "rad"], 180 / np.pi, 0.01, "deg"),
        (joints[units == "m"], 1e3, 0.1, "mm"),
        (tool, 1e3, 0.1, "mm of the gripper"),
    )
    values = [
        (max(scale * offsets.max(), least), unit) for offsets, scale, least, unit in groups if offsets.size
    ]
    return ", ".join(f"{value:{'.2g' if value < 99 else '.0f'}} {unit}" for value, unit in values)


def _timing_text(timing: Timing) -> str:
    timed = timing.timed
    if timed.cheapest is not None:
        cheapest = timed.cheapest
        unit = timing.task.objective.unit
        seconds = f"{timed.seconds:.2f} s to solve and check"
        if timing.task.objective.name == "time":
            words = f"at least {cheapest.lower_bound:.4g} s on these nodes"
            return f"{words}, {timed.fastest:.4g} s if no joint were delayed; {seconds}"
        words = f"cost {cheapest.cost:.4g} {unit}, at least {cheapest.lower_bound:.4g} {unit} on these nodes"
        return f"{words}; the fastest takes {timed.fastest:.3f} s; {seconds}"
    counts = {name: timed.active.count(name) for name in dict.fromkeys(timed.active) if name}
    shares = sorted(counts.items(), key=lambda item: -item[1])
    text = ", ".join(f"{name} ({100 * n / len(timed.active):.0f} %)" for name, n in shares)
    return f"decided by {text} of {len(timed.active)} intervals; {timed.seconds:.2f} s to solve and check"
