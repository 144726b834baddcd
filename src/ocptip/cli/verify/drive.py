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
from ocptip.cli.layout import brief_notes, files_lines, fitted, headlines, masses, under
from ocptip.cli.options import given_tolerance, naming_options, output_directory, require_least, taken
from ocptip.cli.verify.stand_posture import posture_of
from ocptip.standing.at_rest.drive_envelope import LargestManoeuvres
from ocptip.standing.at_rest.manoeuvres import Manoeuvre
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
        drive_envelope = drive(posture, STOW if stow else None, uncertainty=given_tolerance(options), **given)
        _ = drive_envelope.worst  # refusals name options
    yes = drive_envelope.stands and not drive_envelope.broken
    return DriveReport(drive_envelope, folder, not options.no_figures, yes=yes)


@dataclass
class DriveReport(FolderReport):
    """The report of `ocptip drive`."""

    result: DriveEnvelope

    def to_text(self) -> str:
        """The manoeuvres with what limits them, and parameters for navigation."""
        result = self.result
        value, held = result.worst_direction[0], result.robot.payload
        verdict = "DRIVE ENVELOPE" if result.stands else "NOT STABLE AT REST, THE BASE MUST NOT DRIVE"
        if result.broken:
            verdict += f", {'BUT' if result.stands else 'AND'} THE ARM CANNOT REST THERE"
        head = f"{result.name}   {verdict}, {result.scope}."
        rows, count = envelope_rows(result), 5 if result.within else 4  # columns of the base
        lines = [
            self._arm(),
            *under("broken", result.broken),
            *([("note", result.choice)] if result.choice else []),
            *([("payload", f"{quantity(held.mass, 'kg')} ({held})")] if held else []),
            ("worst direction", f"{_down(value)} m/s^2 {result.worst_direction_words}"),
            *([("first contact", result.first_lift)] if result.first_lift and result.stands else []),
            *([("locked wheels", self._locked())] if result.stands else []),
            *under("stops", result.stops if result.stands else []),
            *([("steps", f"{result.steps}: counted in the worst case")] if result.steps else []),
            *(under("nav2.yaml", self._navigation()) if result.stands else []),
            *([("wheels", result.sharing)] if result.sharing else []),
            *under("assumed", [ASSUMED, *brief_notes(result.robot.notes, self.verbose)]),
            *([("robot", masses(result.robot))] if self.verbose else []),
            *under("uncertainty", result.tolerance.lines() if self.verbose else []),
            ("not covered", ", ".join(result.not_covered)),
        ]
        text = [
            *headlines(head),
            "",
            *table([row[:count] for row in rows], left=(0, 1, count - 1)),
            *([""] if result.objects else []),
            *(table([[*row[:2], *row[count:]] for row in rows], left=(0, 1, 2)) if result.objects else []),
            "",
            *fitted(lines),
        ]
        return "\n".join([*text, *files_lines(self.written)])

    def _arm(self) -> tuple[str, str]:
        """The posture, or the motion with the instant of the worst direction."""
        result = self.result
        if result.motion is None or result.worst.times is None:
            return "posture", joint_words(result.robot.names, result.robot.units, result.q)
        k = int(np.argmin(result.worst.largest[: len(result.angles)]))
        return "motion", f"{result.motion.end:.4g} s; worst direction at {result.worst.times[k]:.3f} s"

    def _locked(self) -> str:
        result = self.result
        when = "in some direction" if result.given.holonomic else "when it brakes straight"
        if result.locked_wheels_tip:
            return f"tip the base {when} on level ground, before they slide"
        when = "in any direction" if result.given.holonomic else when
        return f"slide before the base tips {when} on level ground, with the given friction"

    def _navigation(self) -> list[str]:
        return [*self._together(), self.result.together, self.result.smoother.reverse, self.result.ground]

    def _together(self) -> list[str]:
        names = {"max_velocity": ("m/s", "rad/s"), "max_accel": ("m/s^2", "rad/s^2")}
        names["max_decel"] = names["max_accel"]
        results = []
        for name, (straight, turning) in names.items():
            x, y, w = self.result.navigation[name]
            side = f", {_down(y)} {straight} sideways" if y else ""
            results.append(f"{name} {_down(x)} {straight}{side}, {_down(w)} {turning}")
        return results


def envelope_rows(drive_envelope: DriveEnvelope) -> list[list[str]]:
    """Titles, then a row per manoeuvre: its largest values, nominal and worst case, and what limits it."""
    within = ["worst case", "limits the worst case"] if drive_envelope.within else ["limited by"]
    objects = f"objects, {'worst case' if drive_envelope.within else 'nominal'}"
    rows = [["", "", "nominal", *within, *([objects] if drive_envelope.objects else [])]]
    for index, one in enumerate(drive_envelope.manoeuvres, len(drive_envelope.angles)):
        cells = [
            _limit(value_given, index, one)
            for value_given in (drive_envelope.nominal, drive_envelope.within)
            if value_given is not None
        ]
        rows.append(
            [
                one.text,
                one.unit,
                *cells,
                _what(drive_envelope.worst, index, one),
                *_objects(drive_envelope, index, one),
            ]
        )
    return rows


def _objects(drive_envelope: DriveEnvelope, number: int, one: Manoeuvre) -> list[str]:
    """The limit of the critical object, and its name; nothing without objects."""
    if not (objects := drive_envelope.objects):
        return []
    name = min(objects, key=lambda object_name: float(objects[object_name].worst.largest[number]))
    worst = objects[name].worst
    by = "slides" if worst.slip[number] < worst.tip[number] else "tips"
    value = _limit(worst, number, one)
    return [value if value == _NOT else f"{value} ({name} {by})"]


def _down(value: float) -> str:
    """A limit rounded towards zero: an envelope must not promise more than there is."""
    return f"{np.trunc(1e3 * value + _NOISE) / 1e3 + 0.0:.4g}"


def _limit(largest_manoeuvres: LargestManoeuvres, k: int, one: Manoeuvre) -> str:
    value = one.value(float(largest_manoeuvres.largest[k]))
    return _NOT if value is None else _down(value)


def _what(largest_manoeuvres: LargestManoeuvres, k: int, one: Manoeuvre) -> str:
    tips = one.value(float(largest_manoeuvres.tip[k]))
    when = "" if largest_manoeuvres.times is None else f" @{largest_manoeuvres.times[k]:.3f}s"
    ideal = float(largest_manoeuvres.slip[k])
    if largest_manoeuvres.alike[k] < min(ideal, largest_manoeuvres.tip[k]):
        return f"friction{when or f' (ideal {_down(ideal)})'}"
    if ideal < largest_manoeuvres.tip[k]:
        return f"friction{when}" if when or tips is None else f"friction (tips at {_down(tips)})"
    if not largest_manoeuvres.contacts[k].any():
        return ""
    return (
        f"tips about contacts {largest_manoeuvres.contacts[k][0]}, {largest_manoeuvres.contacts[k][1]}{when}"
    )
