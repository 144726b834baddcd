"""`ocptip identify`: parameters of a machine out of recordings, as tables of a task file."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.doubts import doubt
from ocptip.basics.errors import InputError, naming, positive_number
from ocptip.basics.read import read_text
from ocptip.basics.text import percent, some, with_error
from ocptip.basics.toml_text import toml_text
from ocptip.basics.write import MARK, versions, write_text
from ocptip.cli.command import Report
from ocptip.cli.layout import named, under, use_of_reserves
from ocptip.cli.options import given_columns
from ocptip.measured.bodies import BASE, PAYLOAD, Body, identify_bodies, tables
from ocptip.measured.excitation import Excitation, excite
from ocptip.measured.links import Identified, identify_links, mass_tolerance
from ocptip.measured.power_maps import PowerMap, fit_power_map, motors_table, samples_by_joint
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import FOOT, Recording, doubt_turns, read_recording
from ocptip.measured.signals import gaps
from ocptip.motion.cycles.task import CycleTask
from ocptip.standing.tolerance import WORKSHOP
from ocptip.task_files.cycle import read_task
from ocptip.task_files.plan_folder import arm_of, read_plan_folder
from ocptip.trajectories.read import load_motions
from ocptip.trajectories.read_csv import csv_table
from ocptip.trajectories.sequence import MotionSequence

_BODIES = {"payload": (PAYLOAD,), "base": (BASE,), "bodies": (PAYLOAD, BASE)}
_SIGMAS = 3.0
_TWO_SIDED = 1.96
_INSTANTS = 1000
_FAR, _WORSE = 5.0, 1.2  # standard errors, and rms over that of plain least squares, that are a contradiction


def run(options: Namespace) -> IdentifyReport:
    """Read what was measured, and identify what is asked for."""
    ending = ".csv" if options.what == "motion" else ".toml"
    if options.out is not None and Path(options.out).suffix.lower() != ending:
        raise InputError(f"--out: expected a {ending} file, got {options.out!r}")
    if options.what == "motion":
        return _excited(options)
    if options.what == "power":
        return _of_power(options)
    recording, predictor = _recorded(options)
    with naming(Path(options.recording).name):
        if options.what == "arm":
            return _of_links(recording, predictor, options)
        return _of_bodies(recording, predictor, options)


def _recorded(options: Namespace) -> tuple[Recording, Predictor]:
    if options.plan is None:
        raise InputError(f"identify {options.what}: needs PLAN_DIR, the folder of the plan that was run")
    predictor = _predictor(options.plan, options.task)
    recording = read_recording(
        options.recording, predictor.robot, unit=options.unit, columns=given_columns(options)
    )
    doubt_turns(recording, predictor.robot, predictor.motion)
    for gap in gaps(recording):
        doubt(f"{gap.name}: {gap.text}")
    return recording, predictor


def _predictor(plan: str, task: str | None) -> Predictor:
    """Of the folder of a plan, or of a motion file and a task."""
    if task is None:
        robot, motion = read_plan_folder(plan).of_arm("identify takes")
    else:
        given = read_task(task)
        robot = arm_of(given, "identify takes", Path(task))
        motion = load_motions(plan, robot.names, robot.units, start=given.start)
        if isinstance(motion, MotionSequence):
            raise InputError("is a cycle; identify takes single motions", "", plan)
    with naming(plan):
        return Predictor(robot, motion)


def _excited(options: Namespace) -> Report:
    """A motion for identification, of the task."""
    path = Path(options.recording)
    task = read_task(path, WORKSHOP)
    if isinstance(task, CycleTask):
        raise InputError("is a cycle; motions for identification start at one pose", "", str(path))
    with naming(path.name):
        found = excite(task, seed=options.seed)
    return ExcitationReport(task.name, found, options.out)


def _of_power(options: Namespace) -> IdentifyReport:
    """Maps of all drives; with a plan, whether its motion goes beyond what was measured."""
    path = Path(options.recording)
    predictor = None if options.plan is None else _predictor(options.plan, options.task)
    with naming(path.name):
        samples = samples_by_joint(*csv_table(read_text(path)))
        if list(samples) != list(range(1, len(samples) + 1)):
            raise InputError(
                f"column joint: expected 1 to {max(samples)}, got {', '.join(map(str, samples))}"
            )
        maps = []
        for joint, own in samples.items():
            with naming(f"joint {joint}"):
                maps.append(fit_power_map(*own))
        if predictor is not None and predictor.robot.n != len(maps):
            raise InputError(f"maps of {len(maps)} joints, the plan's robot has {predictor.robot.n}")
    lines = [row for j, own in enumerate(maps, 1) for row in under(f"joint {j}", _told_map(own))]
    if predictor is not None:
        lines += under("extrapolated", _extrapolated(predictor, maps))
    data = {"maps": [own.to_dict() for own in maps]}
    return IdentifyReport("power", {"motors": motors_table(maps)}, lines, data, options.out)


def _told_map(own: PowerMap) -> list[str]:
    (low, high), (slow, fast) = own.torque, np.degrees(own.speed)
    inside = own.error(own.hull[:, 0], own.hull[:, 1])
    return [
        f"{own.count} samples, {low:.3g} to {high:.3g} N m (torque of the drive, speed taken as positive), "
        f"{slow:.3g} to {fast:.3g} deg/s, {percent(own.covered)} of that rectangle",
        f"left over {own.noise:.3g} W rms, {own.largest:.3g} W at most; error of the map at most "
        f"{_TWO_SIDED * inside.max():.2g} W (95 %) at the corners of what was measured",
    ]


def _extrapolated(predictor: Predictor, maps: Sequence[PowerMap]) -> list[str]:
    """Where the plan's motion is beyond the samples."""
    times = np.linspace(0.0, predictor.motion.end, _INSTANTS)
    state = predictor.state(times, np.zeros(len(maps)), np.zeros(4 * predictor.robot.arm.links + 1))
    found = []
    for j, own in enumerate(maps):
        out = own.outside(state.torques[:, j], state.qd[:, j])
        if out.any():
            found.append(f"joint {j + 1}: {percent(out.mean())} of the plan's motion is beyond the samples")
    return found or ["the plan's motion stays within the samples"]


def _of_bodies(recording: Recording, predictor: Predictor, options: Namespace) -> IdentifyReport:
    found = identify_bodies(recording, predictor, _BODIES[options.what], tared=options.tared)
    sigmas = _SIGMAS if options.sigmas is None else options.sigmas
    lines = [row for body in found.bodies for row in under(body.name, _told(body))]
    what = "normal forces of the contacts" if found.source == FOOT else "force-torque sensor"
    late = 1e3 * found.estimate.delays[found.source]
    left = found.estimate.residuals[found.source]
    lines.append(("from", f"{what}, {late:.2g} ms after the joints; rms of what is left {left:.3g}"))
    text = f"+-{sigmas:g} standard errors on both sides"
    return IdentifyReport(
        options.what, tables(found, sigmas), [*lines, ("tolerance", text)], found.to_dict(), options.out
    )


def _of_links(recording: Recording, predictor: Predictor, options: Namespace) -> IdentifyReport:
    bandwidth = options.bandwidth
    if bandwidth is not None and bandwidth != math.inf:
        positive_number("--bandwidth", bandwidth)
    found = identify_links(recording, predictor, bandwidth=bandwidth)
    _doubt_plain(found, recording)
    own, robot, p = found.estimate, predictor.robot, len(found.names)
    unseen = [name for name, seen in zip(found.names, own.seen, strict=False) if not seen]
    changed = [
        f"{name}: {with_error(value, half, _unit(name))}, described {described:.4g}"
        for name, value, half, described in zip(
            found.names, own.values, own.half, found.described, strict=False
        )
        if abs(value - described) > half
    ]
    friction = []
    for j, (name, unit) in enumerate(zip(robot.names, robot.motor_units, strict=True)):
        parts = [
            f"{word} {with_error(own.values[k], own.half[k], unit + per)}"
            for word, k, per in (("dry", p + j, ""), ("viscous", p + robot.n + j, f" s/{robot.units[j]}"))
            if own.seen[k]
        ]
        friction.append(f"{name}: {', '.join(parts) or 'not seen'}")
    low_passes = own.low_passes.items()
    masses = zip(found.arm.chain_names, found.arm.masses, robot.arm.masses, strict=True)
    lines = [
        ("base parameters", f"{int(own.seen[:p].sum())} of {p} are told (condition {found.condition:.0f})"),
        *under("changed", changed or ["none by more than its 95 % interval"]),
        *under("not told", unseen),
        *under("friction", friction),
        ("links", ", ".join(f"{name} {new:.4g} kg (described {old:.4g})" for name, new, old in masses)),
        ("", f"next to what was described; base parameters moved by {found.moved:.2g} standard errors"),
        *under("rms left", _left(found, recording)),
        *(("filter", f"{kind}: {own}; compared up to {own.band:.3g} Hz") for kind, own in low_passes),
    ]  # fmt: skip
    sigmas = _SIGMAS if options.sigmas is None else options.sigmas
    tolerance, text = _of_masses(found, predictor, sigmas)
    tables = {**found.to_tables(robot.motors), **tolerance}
    return IdentifyReport("arm", tables, [*lines, ("tolerance", text)], found.to_dict(), options.out)


def _left(found: Identified, recording: Recording) -> list[str]:
    """What is left of each signal, and by plain least squares."""
    return [
        f"{recording.of(kind)[number].name} {rms:.3g} (plain least squares {plain:.3g})"
        for kind, number, rms, plain in found.estimate.signals
    ]


def _doubt_plain(found: Identified, recording: Recording) -> None:
    """Warn where plain least squares says something else: then the model of the recording does not hold."""
    own = found.estimate
    names = [*found.names]
    names += [f"{word} friction {j + 1}" for word in ("dry", "viscous") for j in range(len(found.coulomb))]
    far = int(np.argmax(own.away))
    worse = [
        f"{recording.of(kind)[number].name} {rms:.3g} instead of {plain:.3g}"
        for kind, number, rms, plain in own.signals
        if rms > _WORSE * plain
    ]
    if own.away[far] > _FAR or worse:
        left = f"; it leaves more over: {', '.join(worse)}" if worse else ""
        doubt(
            f"arm: plain least squares contradicts the estimate, most in {names[far]} ({own.away[far]:.1f} "
            f"standard errors){left}; something is not in the model, such as a filter of the torques "
            "(--bandwidth), elastic joints, or friction that depends on load"
        )


def _unit(parameter: str) -> str:
    """Of a mass m1, a first moment mx1, an entry of an inertia Ixx1, or a rotor."""
    return "kg m^2" if parameter.startswith(("I", "rotor")) else "kg m" if parameter[1] in "xyz" else "kg"


def _of_masses(found: Identified, predictor: Predictor, sigmas: float) -> tuple[dict[str, Any], str]:
    """Table `[tolerance]`, if there is one, and in words what it covers, or why there is none."""
    share = mass_tolerance(found, predictor, sigmas)
    if share is None:
        return {}, "none: torques do not tell the wrench on the base"
    covers = f"covers {sigmas:g} standard errors about every tipping axis, at all instants of this motion"
    return {"tolerance": {"arm_mass": share}}, f"masses of links +-{100 * share:.3g} %: {covers}"


def _told(body: Body) -> list[str]:
    half = body.quantile * body.errors
    lines = [f"mass {with_error(body.mass, half[0], 'kg')} (95 %)"]
    told = [
        f"{axis} {with_error(1e3 * x, 1e3 * h, 'mm') if math.isfinite(h) else 'not seen, as described'}"
        for axis, x, h in zip("xyz", body.center, half[1:], strict=True)
    ]
    return [*lines, f"centre {', '.join(told)}"]


@dataclass
class ExcitationReport(Report):
    """A motion for identification.

    Attributes:
        name: of the task.
        found: the motion.
        out: .csv file for it, or None.
    """

    name: str
    found: Excitation
    out: str | None

    good = True

    def to_dict(self) -> dict[str, Any]:
        """What is known of it."""
        found = self.found
        return {
            "task": self.name,
            "duration_s": found.motion.end,
            "condition": found.condition,
            "random_condition": found.random,
            "slower": found.slower,
            "smaller": found.smaller,
            "check": found.check.to_dict(),
            "versions": versions(),
        }

    def to_text(self) -> str:
        """The same in words."""
        found = self.found
        least = f"{found.condition:.0f} of the regressor of base parameters and friction"
        rows = [
            ("condition", f"{least} (median of random motions that keep the limits: {found.random:.0f})"),
            (
                "made",
                f"{found.slower:g} times slower and {found.smaller:g} as large, as the check demands",
            ),
            ("check", use_of_reserves(found.check)),
            *under("written", self.written),
        ]
        title = f"{self.name}: {found.check.headline}, {found.motion.end:.3g} s."
        return "\n".join([title, *named(rows)])

    def write(self) -> Iterator[Path]:
        """Samples of it."""
        if self.out:
            path, motion = Path(self.out), self.found.motion
            kinds = (
                ("q{}_rad", motion.angles),
                ("qd{}_rad_s", motion.speeds),
                ("qdd{}_rad_s2", motion.accelerations),
            )
            head = ["time_s", *(name.format(k) for name, _ in kinds for k in range(1, motion.n + 1))]
            rows = np.column_stack([motion.times, *(values for _, values in kinds)])
            lines = [",".join(head), *(",".join(map(repr, row)) for row in rows.tolist())]
            write_text(path, "\n".join(lines) + "\n")
            yield path


@dataclass
class IdentifyReport(Report):
    """What was identified.

    Attributes:
        what: was asked for.
        tables: of a task file.
        lines: of the answer.
        data: all numbers.
        out: file for the tables, or None.
    """

    what: str
    tables: Mapping[str, Any]
    lines: Sequence[tuple[str, str]]
    data: Mapping[str, Any]
    out: str | None

    good = True

    def to_dict(self) -> dict[str, Any]:
        """Values, covariances, and the tables."""
        return {"identified": self.what, **self.data, "tables": self.tables, "versions": versions()}

    def to_text(self) -> str:
        """Values with their intervals."""
        rows = [*self.lines, *under("written", self.written)]
        return "\n".join([f"{self.what}: identified. Tables: {some(list(self.tables))}.", *named(rows)])

    def write(self) -> Iterator[Path]:
        """The tables, to be put into a task file."""
        if self.out:
            path = Path(self.out)
            write_text(path, f"# {MARK}: tables of a task file\n{toml_text(self.tables)}")
            yield path
