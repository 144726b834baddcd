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
        found = identify(**same, columns=read_columns(options.columns))
    return IdentifyReport(found, options.out)


def _lines(found: Identification) -> Rows:
    """Values with their intervals."""
    if found.what == "power":
        return _of_power(found)
    return _of_links(found) if found.what == "arm" else _of_bodies(found)


def _of_power(found: Identification) -> Rows:
    """Maps of all drives; with a plan, whether its motion goes beyond what was measured."""
    lines = [row for j, own in enumerate(found.source, 1) for row in under(f"joint {j}", _map_lines(own))]
    if found.predictor is not None:
        shares = enumerate(beyond_samples(found.source, found.predictor), 1)
        beyond = [
            f"joint {j}: {percent(x)} of the plan's motion is beyond the samples" for j, x in shares if x
        ]
        lines += under("extrapolated", beyond or ["the plan's motion stays within the samples"])
    return lines


def _map_lines(own: PowerMap) -> list[str]:
    (low, high), (slow, fast) = own.torque, np.degrees(own.speed)
    inside = own.error(own.hull[:, 0], own.hull[:, 1])
    return [
        f"{own.count} samples, {low:.3g} to {high:.3g} N m (torque of the drive, speed taken as positive), "
        f"{slow:.3g} to {fast:.3g} deg/s, {percent(own.covered)} of that rectangle",
        f"left over {own.noise:.3g} W rms, {own.largest:.3g} W at most; error of the map at most "
        f"{_TWO_SIDED * inside.max():.2g} W (95 %) at the corners of what was measured",
    ]


def _of_bodies(identified: Identification) -> Rows:
    found = identified.source
    lines = [row for body in found.bodies for row in under(body.name, _body_lines(body))]
    what = "normal forces of the contacts" if found.source == FOOT else "force-torque sensor"
    late = 1e3 * found.estimate.delays[found.source]
    left = found.estimate.residuals[found.source]
    lines.append(("from", f"{what}, {late:.2g} ms after the joints; rms of what is left {left:.3g}"))
    lines += _filters(found.estimate)
    return [*lines, ("tolerance", f"+-{identified.sigmas:g} standard errors on both sides")]


def _of_links(identified: Identification) -> Rows:
    found, recording, predictor = identified.source, identified.recording, identified.predictor
    assert recording is not None
    assert predictor is not None
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
    masses = zip(found.arm.chain_names, found.arm.masses, robot.arm.masses, strict=True)
    lines = [
        ("base parameters", f"{int(own.seen[:p].sum())} of {p} identified (condition {found.condition:.0f})"),
        *under("changed", changed or ["none by more than its 95 % interval"]),
        *under("not seen", unseen),
        *under("friction", friction),
        ("links", ", ".join(f"{name} {new:.4g} kg (described {old:.4g})" for name, new, old in masses)),
        ("", f"next to what was described; base parameters moved by {found.moved:.2g} standard errors"),
        *under("rms left", _left(found, recording)),
        *_filters(own),
    ]  # fmt: skip
    text = "none: torques do not tell the wrench on the base"
    if "tolerance" in identified.tables:
        share = 100 * identified.tables["tolerance"]["arm_mass"]
        covers = "standard errors about every tipping axis, at all instants of this motion"
        text = f"masses of links +-{share:.3g} %: covers {identified.sigmas:g} {covers}"
    return [*lines, ("tolerance", text)]


def _filters(found: Estimate) -> Rows:
    """The low-pass filters that were identified."""
    low_passes = found.low_passes.items()
    return [("filter", f"{kind}: {own}; compared up to {own.band:.3g} Hz") for kind, own in low_passes]


def _left(found: Identified, recording: Recording) -> list[str]:
    """The residual of each signal, rms, and that of plain least squares."""
    return [
        f"{recording.of(kind)[number].name} {rms:.3g} (plain least squares {plain:.3g})"
        for kind, number, rms, plain in found.estimate.signals
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

    found: ExcitingMotion

    def to_text(self) -> str:
        """The motion and its condition number in words."""
        found = self.found.found
        least = f"{found.condition:.0f} of the regressor of base parameters and friction"
        rows = [
            ("condition", f"{least} (median of random motions that keep the limits: {found.random:.0f})"),
            ("made", f"{found.slower:g} times slower and {found.smaller:g} as large, as the check demands"),
            *under("written", self.written),
        ]
        title = f"{self.found.name}   {found.check.headline}"
        return "\n".join([title, motion_line(found.check), *named(rows)])


@dataclass
class IdentifyReport(ResultReport):
    """The report of an identification."""

    found: Identification

    def to_text(self) -> str:
        """Values with their intervals."""
        rows, found = [*_lines(self.found), *under("written", self.written)], self.found
        return "\n".join([f"{found.what}: identified. Tables: {some(list(found.tables))}.", *named(rows)])
