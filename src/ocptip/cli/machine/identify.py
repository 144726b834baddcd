"""`ocptip identify`: parameters of a machine out of recordings, as tables of a task file."""

from __future__ import annotations

import math
from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ocptip.api.identify import (
    ExcitingMotion,
    Identification,
    beyond_samples,
    identify,
    motion_for_identification,
)
from ocptip.basics.errors import InputError
from ocptip.basics.text import percent, some, with_error
from ocptip.cli.command import Report, ResultReport
from ocptip.cli.layout import named, under
from ocptip.cli.options import naming_options, taken
from ocptip.measured.bodies import IdentifiedBody
from ocptip.measured.estimate import Estimate
from ocptip.measured.links import Identified
from ocptip.measured.power_maps import PowerMap
from ocptip.measured.recording import FOOT, Recording
from ocptip.motion.summary import motion_line
from ocptip.task_files.option_files import read_columns

_TWO_SIDED = 1.96

Rows = list[tuple[str, str]]


def run(options: Namespace) -> Report:
    """Read what was measured, and identify what is asked for."""
    ending = ".csv" if options.what == "motion" else ".toml"
    if options.out is not None and Path(options.out).suffix.lower() != ending:
        raise InputError(f"--out: expected a {ending} file, got {options.out!r}")
    if options.what == "motion":
        return ExcitationReport(motion_for_identification(options.recording, seed=options.seed), options.out)
    with naming_options("bandwidth"):
        same = taken(options, "recording plan what task unit topics tared sigmas bandwidth")
        identification = identify(**same, columns=read_columns(options.columns))
    return IdentifyReport(identification, options.out)


def _lines(identification: Identification) -> Rows:
    """Values with their intervals."""
    if identification.what == "power":
        return _of_power(identification)
    return _of_links(identification) if identification.what == "arm" else _of_bodies(identification)


def _of_power(identification: Identification) -> Rows:
    """Maps of all drives; with a plan, whether its motion goes beyond what was measured."""
    lines = [
        row
        for j, power_map in enumerate(identification.source, 1)
        for row in under(f"joint {j}", _map_lines(power_map))
    ]
    if identification.predictor is not None:
        shares = enumerate(beyond_samples(identification.source, identification.predictor), 1)
        beyond = [
            f"joint {j}: {percent(x)} of the plan's motion is beyond the samples" for j, x in shares if x
        ]
        lines += under("extrapolated", beyond or ["the plan's motion stays within the samples"])
    return lines


def _map_lines(power: PowerMap) -> list[str]:
    (low, high), (slow, fast) = power.torque, np.degrees(power.speed)
    inside = power.error(power.hull[:, 0], power.hull[:, 1])
    return [
        f"{power.count} samples, {low:.3g} to {high:.3g} N m (torque of the drive, speed taken as positive), "
        f"{slow:.3g} to {fast:.3g} deg/s, {percent(power.covered)} of that rectangle",
        f"left over {power.noise:.3g} W rms, {power.largest:.3g} W at most; error of the map at most "
        f"{_TWO_SIDED * inside.max():.2g} W (95 %) at the corners of what was measured",
    ]


def _of_bodies(identified: Identification) -> Rows:
    source = identified.source
    lines = [row for body in source.bodies for row in under(body.name, _body_lines(body))]
    what = "normal forces of the contacts" if source.source == FOOT else "force-torque sensor"
    late = 1e3 * source.estimate.delays[source.source]
    left = source.estimate.residuals[source.source]
    lines.append(("from", f"{what}, {late:.2g} ms after the joints; rms of what is left {left:.3g}"))
    lines += _filters(source.estimate)
    return [*lines, ("tolerance", f"+-{identified.sigmas:g} standard errors on both sides")]


def _of_links(identified: Identification) -> Rows:
    source, recording, predictor = identified.source, identified.recording, identified.predictor
    assert recording is not None
    assert predictor is not None
    fit, robot, p = source.estimate, predictor.robot, len(source.names)
    unseen = [name for name, seen in zip(source.names, fit.seen, strict=False) if not seen]
    changed = [
        f"{name}: {with_error(value, half, _unit(name))}, described {described:.4g}"
        for name, value, half, described in zip(
            source.names, fit.values, fit.half, source.described, strict=False
        )
        if abs(value - described) > half
    ]
    friction = []
    for j, (name, unit) in enumerate(zip(robot.names, robot.motor_units, strict=True)):
        parts = [
            f"{word} {with_error(fit.values[k], fit.half[k], unit + per)}"
            for word, k, per in (("dry", p + j, ""), ("viscous", p + robot.n + j, f" s/{robot.units[j]}"))
            if fit.seen[k]
        ]
        friction.append(f"{name}: {', '.join(parts) or 'not seen'}")
    masses = zip(source.arm.chain_names, source.arm.masses, robot.arm.masses, strict=True)
    lines = [
        ("base parameters", f"{fit.seen[:p].sum()} of {p} identified (condition {source.condition:.0f})"),
        *under("changed", changed or ["none by more than its 95 % interval"]),
        *under("not seen", unseen),
        *under("friction", friction),
        ("links", ", ".join(f"{name} {new:.4g} kg (described {old:.4g})" for name, new, old in masses)),
        ("", f"next to what was described; base parameters moved by {source.moved:.2g} standard errors"),
        *under("rms left", _left(source, recording)),
        *_filters(fit),
    ]  # fmt: skip
    text = "none: torques do not tell the wrench on the base"
    if "tolerance" in identified.tables:
        share = 100 * identified.tables["tolerance"]["arm_mass"]
        covers = "standard errors about every tipping axis, at all instants of this motion"
        text = f"masses of links +-{share:.3g} %: covers {identified.sigmas:g} {covers}"
    return [*lines, ("tolerance", text)]


def _filters(estimate: Estimate) -> Rows:
    """The low-pass filters that were identified."""
    low_passes = estimate.low_passes.items()
    return [
        ("filter", f"{kind}: {low_pass}; compared up to {low_pass.band:.3g} Hz")
        for kind, low_pass in low_passes
    ]


def _left(identified: Identified, recording: Recording) -> list[str]:
    """The residual of each signal, rms, and that of plain least squares."""
    return [
        f"{recording.of(kind)[number].name} {rms:.3g} (plain least squares {plain:.3g})"
        for kind, number, rms, plain in identified.estimate.signals
    ]


def _unit(parameter: str) -> str:
    """Unit of a mass m1, a first moment mx1, an entry of an inertia Ixx1, or a rotor."""
    return "kg m^2" if parameter.startswith(("I", "rotor")) else "kg m" if parameter[1] in "xyz" else "kg"


def _body_lines(body: IdentifiedBody) -> list[str]:
    half = body.quantile * body.errors
    lines = [f"mass {with_error(body.mass, half[0], 'kg')} (95 %)"]
    coordinates = [
        f"{axis} {with_error(1e3 * x, 1e3 * h, 'mm') if math.isfinite(h) else 'not seen, nominal'}"
        for axis, x, h in zip("xyz", body.center, half[1:], strict=True)
    ]
    return [*lines, f"centre {', '.join(coordinates)}"]


@dataclass
class ExcitationReport(ResultReport):
    """The report of a motion for identification."""

    result: ExcitingMotion

    def to_text(self) -> str:
        """The motion and its condition number in words."""
        result = self.result.excitation
        least = f"{result.condition:.0f} of the regressor of base parameters and friction"
        rows = [
            ("condition", f"{least} (median of random motions that keep the limits: {result.random:.0f})"),
            ("made", f"{result.slower:g} times slower and {result.smaller:g} as large, as the check demands"),
            *under("written", self.written),
        ]
        title = f"{self.result.name}   {result.check.headline}"
        return "\n".join([title, motion_line(result.check), *named(rows)])


@dataclass
class IdentifyReport(ResultReport):
    """The report of an identification."""

    result: Identification

    def to_text(self) -> str:
        """Values with their intervals."""
        rows, result = [*_lines(self.result), *under("written", self.written)], self.result
        return "\n".join([f"{result.what}: identified. Tables: {some(list(result.tables))}.", *named(rows)])
