"""`ocptip drive`: how hard a mobile base may accelerate, brake and turn, as text, files and a figure."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ocptip.api.drive import STOW, drive
from ocptip.api.results.drive import ASSUMED, DriveEnvelope
from ocptip.basics.text import joint_words, quantity, table
from ocptip.cli.command import FolderReport
from ocptip.cli.layout import files_lines, fitted, masses, under
from ocptip.cli.options import given_tolerance, naming_options, output_directory, require_least, taken
from ocptip.cli.verify.stand_posture import posture_of
from ocptip.standing.at_rest.drive_envelope import LargestManoeuvres, Manoeuvre
from ocptip.task_files.plan_folder import is_plan_folder

_NOISE, _NOT = 1e-9, "not limited"


def run(options: Namespace) -> DriveReport:
    """Compute the envelope of one posture."""
    stow, moves = options.posture == STOW, not options.posture and is_plan_folder(options.task)
    posture = (
        options.task if moves else posture_of(options.task, "start" if stow else options.posture or "start")
    )
    folder = output_directory(options, Path(options.task).name if moves else posture.scene.name)
    require_least(options, samples=1, seed=0)
    names = "directions speed turning deceleration payload slope"
    with naming_options(*names.split()):
        given = taken(options, f"{names} holonomic samples seed")
        given["slope"] = np.radians(given["slope"])
        found = drive(posture, STOW if stow else None, uncertainty=given_tolerance(options), **given)
        _ = found.worst  # refusals name options
    return DriveReport(found, folder, not options.no_figures, yes=found.worst_direction[0] > 0)


@dataclass
class DriveReport(FolderReport):
    """The report of `ocptip drive`."""

    found: DriveEnvelope

    def to_text(self) -> str:
        """The manoeuvres with what limits them, and parameters for navigation."""
        found = self.found
        value, held = found.worst_direction[0], found.robot.payload
        head = f"{found.name}   DRIVE ENVELOPE, {found.scope}."
        rows = envelope_rows(found)
        lines = [
            self._arm(),
            *([("note", found.choice)] if found.choice else []),
            *([("payload", f"{quantity(held.mass, 'kg')} ({held})")] if held else []),
            ("worst direction", f"{_down(value)} m/s^2 {found.worst_direction_words}"),
            *([("first contact", found.first_lift)] if found.first_lift else []),
            ("locked wheels", self._locked()),
            *under("turns", found.stops),
            *([("steps", f"{found.steps}: counted in the worst case")] if found.steps else []),
            *under("together", [*self._together(), found.together, found.reverse, found.ground]),
            ("assumed", ASSUMED),
            *([("robot", masses(found.robot))] if self.verbose else []),
            *under("uncertainty", found.tolerance.lines() if self.verbose else []),
            ("not covered", ", ".join(found.not_covered)),
        ]
        text = [
            head,
            "",
            *table(rows, left=(0, 1, *range(4 if found.within else 3, len(rows[0])))),
            "",
            *fitted(lines),
        ]
        return "\n".join([*text, *files_lines(self.written)])

    def _arm(self) -> tuple[str, str]:
        """The posture, or the motion with the instant of the worst direction."""
        found = self.found
        if found.motion is None or found.worst.times is None:
            return "posture", joint_words(found.robot.names, found.robot.units, found.q)
        k = int(np.argmin(found.worst.largest[: len(found.angles)]))
        return "motion", f"{found.motion.end:.4g} s; worst direction at {found.worst.times[k]:.3f} s"

    def _locked(self) -> str:
        found = self.found
        when = "in some direction" if found.given.holonomic else "when it brakes straight"
        if found.locked_wheels_tip:
            return f"tip the base {when} on level ground, before they slide"
        when = "in any direction" if found.given.holonomic else when
        return f"slide before the base tips {when} on level ground, with the given friction"

    def _together(self) -> list[str]:
        names = {"max_velocity": ("m/s", "rad/s"), "max_accel": ("m/s^2", "rad/s^2")}
        names["max_decel"] = names["max_accel"]
        found = []
        for name, (straight, turning) in names.items():
            x, y, w = self.found.navigation[name]
            side = f", {_down(y)} {straight} sideways" if y else ""
            found.append(f"{name} {_down(x)} {straight}{side}, {_down(w)} {turning}")
        return found


def envelope_rows(found: DriveEnvelope) -> list[list[str]]:
    """Titles, then a row per manoeuvre: its largest values, nominal and worst case, and what limits it."""
    within = ["worst case", "limits the worst case"] if found.within else ["limited by"]
    rows = [["", "", "nominal", *within, *(["objects"] if found.objects else [])]]
    for at, one in enumerate(found.manoeuvres, len(found.angles)):
        cells = [_limit(own, at, one) for own in (found.nominal, found.within) if own is not None]
        rows.append([one.text, one.unit, *cells, _what(found.worst, at, one), *_objects(found, at, one)])
    return rows


def _objects(found: DriveEnvelope, at: int, one: Manoeuvre) -> list[str]:
    """The limit of the critical object, and its name; nothing without objects."""
    if not (objects := found.objects):
        return []
    name = min(objects, key=lambda own: float(objects[own].worst.largest[at]))
    worst = objects[name].worst
    by = "slides" if worst.slip[at] < worst.tip[at] else "tips"
    value = _limit(worst, at, one)
    return [value if value == _NOT else f"{value} ({name} {by})"]


def _down(value: float) -> str:
    """A limit rounded towards zero: an envelope must not promise more than there is."""
    return f"{np.trunc(1e3 * value + _NOISE) / 1e3 + 0.0:.4g}"


def _limit(own: LargestManoeuvres, k: int, one: Manoeuvre) -> str:
    value = one.value(float(own.largest[k]))
    return _NOT if value is None else _down(value)


def _what(own: LargestManoeuvres, k: int, one: Manoeuvre) -> str:
    tips = one.value(float(own.tip[k]))
    when = "" if own.times is None else f" @{own.times[k]:.3f}s"
    if own.slip[k] < own.tip[k]:
        return f"friction{when}" if when or tips is None else f"friction (tips at {_down(tips)})"
    if not own.contacts[k].any():
        return ""
    return f"tips about contacts {own.contacts[k][0]}, {own.contacts[k][1]}{when}"
