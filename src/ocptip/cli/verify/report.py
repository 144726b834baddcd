"""`ocptip report`: what a plan or a cycle was checked for, as one document for the safety file."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.api.report import SPEEDS, Stability, Stage, report
from ocptip.api.results.chart import NOT_COVERED
from ocptip.api.results.drive import ASSUMED
from ocptip.basics.errors import naming
from ocptip.basics.outputs import SUMS, read_sums, require_replaceable_file
from ocptip.basics.read import only_inside, read_bytes
from ocptip.basics.text import percent, quantity, ratio
from ocptip.basics.write import file_target, versions, write_bytes
from ocptip.cli.command import Report
from ocptip.cli.layout import (
    files_lines,
    headlines,
    joint_numbers,
    masses,
    tolerated_lines,
    within_rows,
)
from ocptip.cli.motion_summary import notes
from ocptip.cli.options import taken
from ocptip.cli.terminal import Progress
from ocptip.cli.verify.check import worst_rows
from ocptip.cli.verify.drive import envelope_rows
from ocptip.motion.check import MotionCheck
from ocptip.motion.stops.cancels import rounded_down
from ocptip.motion.summary import margin_rows, margin_table, motion_line, segment_rows
from ocptip.motion.violations import broken_words
from ocptip.pictures.animation import still_figure
from ocptip.pictures.document import (
    blank,
    grid,
    heading,
    image,
    items,
    page,
    paragraph,
    pdf,
    picture,
    verdict,
)  # fmt: skip
from ocptip.pictures.load_chart import payload_figure, speed_figure, tilt_figure
from ocptip.reserves.equal_compliance import equal_normal_map
from ocptip.standing.at_rest.load_cases import MOST_TILT, LoadCase

ENDINGS = (".html", ".pdf")
_OVERVIEWS = {
    "motion.png": "What the robot does, as planned.",
    "ground.png": "What the ground feels.",
    "drives.png": "What the drives do.",
}
_TITLES = (
    "pose", "payload", "tilt", "push", "stable", "tipping margin", "friction used", "min foot force",
    "worst direction", "GN", "GT",
)  # fmt: skip
_FORCE = _TITLES.index("min foot force")
_MACHINE = (
    "{}. Shaded: support polygon; green: contact forces; red: nearest tipping axis; "
    "magenta: zero-moment point."
)
_BASE_ALONE = (
    "Objects count in the margins of the motion, its limits and its stops. Margins at rest, by speed and of "
    "load cases are of the base alone, with objects as loads."
)
_NOT = (
    "This document lists what was computed, from what, and how. It claims no conformity with any standard, "
    "and no test of the real machine is replaced by it."
)
_ABSENT = "not in this document"
_TESTS = (
    (
        "tilt table (how far may the floor be tilted)",
        "Tilt by direction; Load cases; Robustness, one at a time",
    ),
    ("push or pull test at the TCP", "Load cases; Robustness, one at a time"),
    ("overload test", "Load cases; Largest payload; Robustness, one at a time"),
    ("stop test (controlled stop at any instant)", "Stops; Cancels"),
    ("driving, braking and turning with the arm at rest", "Drive envelope"),
    ("test run at higher speed", "Margins by speed; Robustness, one at a time"),
    ("slope and friction of the floor", "Tilt by direction; Robustness, one at a time"),
)


def run(options: Namespace) -> DocumentReport:
    """Compute everything again, from the folder or the task alone."""
    path = Path(options.plan)
    with naming("--out"):
        out = file_target(options.out or f"ocptip-report-{path.resolve().stem}.html", ENDINGS)
        require_replaceable_file(out, overwrite=options.overwrite)
    with Progress(sys.stderr, "reading the plan ...") as progress:
        about = report(path, cases=options.cases, stage=progress.stage)
    return DocumentReport(about, out, yes=about.stands, **taken(options, "cases serial author"))


def _with_names(stage: Stage, lines: Iterable[str]) -> list[str]:
    """Lines, with the segment's name before them."""
    return [f"{stage.name}: {line}" if stage.name else line for line in lines]


@dataclass
class DocumentReport(Report):
    """The pages about the stability of a plan.

    Attributes:
        about: what was computed.
        out: the file.
        cases: file that was named for the load cases.
        serial, author: of the title block; None: lines to write on.
    """

    about: Stability
    out: Path
    cases: str | None = None
    serial: str | None = None
    author: str | None = None

    def parts(self) -> Iterator[str]:
        """All sections."""
        about = self.about
        yield heading(f"Stability of {about.task.name}", 1)
        yield grid(
            ("machine", "serial number", "author", "date"),
            [(about.task.name, blank(self.serial or ""), blank(self.author or ""), date.today().isoformat())],
        )
        yield verdict(f"{about.headline}.", about.stands)
        shown, k = about.critical
        yield picture(
            still_figure(shown, k), _MACHINE.format(f"{shown.name} at {shown.text(k)}"), beside=True
        )
        if about.checked is not None:
            yield from self._margins(about.checked)
        yield from self._summary()
        yield paragraph(_NOT)
        yield from self._machine()
        yield from self._assumed()
        results = [*self._motion(about.checked)] if about.checked is not None else []
        results += [*self._driving(), *self._rest()]
        yield from results
        names = {name for _, sections in _TESTS for name in sections.split("; ")}
        yield from self._tests({name for name in names if heading(name) in results})
        yield from self._again()

    def _margins(self, checked: MotionCheck) -> Iterator[str]:
        """The summary that commands print first: duration and energy, margins, notes."""
        yield paragraph(f"{motion_line(checked)}.")
        titles, *rows = margin_rows(self.about.task.robot, checked)
        yield grid(titles, rows)
        yield items([*broken_words(self.about.task.robot, checked.violations), *notes(checked)])

    def _summary(self) -> Iterator[str]:
        """What the sections below say, one line each."""
        about = self.about
        fallen = [case for case in about.cases if not case.stands]
        rows = []
        if about.motion is not None and (tolerated := about.motion.robustness):
            rows.append(("Robust to (one at a time)", "; ".join(one.short for one in tolerated)))
        rows += [("Stops", text) for s in about.stages if s.stops for text in _with_names(s, s.stops.summary)]
        rows += [
            ("Cancels", f"{name}: {cancel.text}" if name else cancel.text)
            for name, cancel in about.cancels.items()
        ]
        if about.envelope is not None:
            worst, words = about.envelope.worst_direction[0], about.envelope.worst_direction_words
            text = f"{rounded_down(worst):g} m/s^2 {words}, arm at rest at the goal"
            rows.append(("Drive envelope", text))
        first = f"; not stable: {' '.join(_case_row(_by_margin(fallen)[0])[:4])} and others" if fallen else ""
        decides = "" if about.given_cases else "; these usual cases do not decide the verdict"
        counted = f"{len(about.cases) - len(fallen)} of {len(about.cases)} stable"
        rows.append(("Load cases", f"{counted}{first}{decides}"))
        for chart in (one for one in about.charts if one.raised.name == "payload"):
            rows.append(("Load chart", f"{chart.summary}; {chart.scope}"))
        if about.folder is not None:
            name, digest = next(iter(read_sums(about.folder.path).items()))
            rows.append((f"SHA-256 of {name}", digest))
        yield grid(("", ""), rows)

    def _machine(self) -> Iterator[str]:
        robot, support = self.about.task.robot, self.about.task.robot.support
        yield heading("Machine")
        held = [
            (f"masses, {s.name}" if s.name else "masses", masses(s.task.robot)) for s in self.about.stages
        ]
        rows = [
            *held,
            ("centre of mass of the base", f"{_vector(support.center_of_mass)} m"),
            ("joints", joint_numbers(robot)),
        ]
        yield grid(("", ""), rows)
        feet = [
            (k, c.kind, _vector(c.position), _vector(c.normal), f"{getattr(c, 'friction', '-')}",
             getattr(c, "stiffness", None) or "rigid")
            for k, c in enumerate(support.contacts, 1)
        ]  # fmt: skip
        titles = ("contact", "kind", "position [m]", "normal", "friction", "stiffness [N/m]")
        yield grid(titles, feet)
        on = [(interface.name, interface.support) for interface in robot.interfaces[1:]]
        if rows := [(name, f"{s.mass:g} kg", f"{len(s.contacts)} {s.contacts[0].kind}") for name, s in on]:
            yield grid(("object", "mass with what stands on it", "contacts"), rows)
            yield paragraph(_BASE_ALONE)

    def _assumed(self) -> Iterator[str]:
        yield heading("Assumed, and not checked")
        texts = [
            "Base and links are rigid; contacts obey Coulomb's law with the friction given above.",
            "The ground bears every foot; it is level unless a tilt is named.",
            "Contacts hold as given: wheels only while drives or brakes hold them.",
            "Masses and centres of mass are those of task and robot description; weigh the base.",
            *dict.fromkeys(note for stage in self.about.stages for note in stage.task.robot.notes),
        ]
        if self.about.checked is not None:
            texts += [f"Collision: {self.about.checked.collision_text}."]
            texts += [*self.about.checked.feet_lines, *self.about.checked.drive_lines]
            texts += dict.fromkeys(text for s in self.about.stages if s.stops for text in s.stops.assumed)
        yield items(texts)

    def _motion(self, checked: MotionCheck) -> Iterator[str]:
        yield heading("Motion")
        moving = self.about.motion
        assert moving is not None
        if self.about.task.is_cycle:
            titles, *rows = segment_rows(self.about.task, moving.checked)
            yield grid(titles, rows)
        yield items([f"Proof {checked.certificate}"] if checked.certificate else [])
        for stage in self.about.stages:
            yield items(_with_names(stage, map(_labelled, within_rows(stage.checked or checked))))
        yield items(checked.contacts.lines())
        yield paragraph("All limits, with the published indices GN of tip-over and GT of friction:")
        titles, *rows = worst_rows(checked)
        yield grid(titles, rows)
        folder = self.about.folder
        for name, caption in _OVERVIEWS.items() if folder is not None else ():
            if folder is not None and (path := folder.path / name).is_file():
                with only_inside(folder.path):
                    yield image(read_bytes(path), caption)
        yield heading("Robustness, one at a time")
        yield paragraph("Under each of these deviations, all else nominal, the motion loses no contact:")
        yield items(tolerated_lines(moving.robustness))
        if timed := [(stage.name, stage.speeds) for stage in self.about.stages if stage.speeds]:
            yield heading("Margins by speed")
            yield paragraph("Of the motion with all times scaled, in the nominal model, at sampled instants.")
            for name, speeds in timed:
                caption = f"Margins of {name or 'the motion'} over its speed; grey: as planned."
                yield picture(speed_figure(SPEEDS, *speeds), caption)
        if any(stage.stops for stage in self.about.stages):
            yield heading("Stops")
            if self.about.task.is_cycle:
                yield paragraph("Times are those of the segment.")
            for stage in self.about.stages:
                if stops := stage.stops:
                    yield items(_with_names(stage, stops.summary))
        if moving.stops:
            yield heading("Stops that the task asks for")
            for name, stops in moving.stops.items():
                for text in (*stops.summary, *stops.assumed):
                    yield paragraph(f"{name}: {text}" if name else text)
        if self.about.cancels:
            yield heading("Cancels")
            yield paragraph(
                "Stops at any instant, by a controller whose motion is cancelled. To determine both ends to "
                f"half a percent: ocptip check {self.about.name} --stops cancel."
            )
            for name, cancel in self.about.cancels.items():
                yield paragraph(f"{name}: {cancel.text}" if name else cancel.text)
                if cancel.yaml:
                    units = " and ".join(f"{unit}/s^2" for unit in dict.fromkeys(cancel.robot.units))
                    yield paragraph(f"For the controller ({units}): {cancel.yaml}")

    def _driving(self) -> Iterator[str]:
        """How the base drives meanwhile, and how hard it may."""
        if (profile := self.about.task.robot.acts.drive_profile) is not None:
            yield heading("Drive profile")
            yield paragraph(f"The base drives while the arm moves: {profile}. Margins include that.")
            yield items(profile.notes)
        if (envelope := self.about.envelope) is None:
            return
        yield heading("Drive envelope")
        yield paragraph(f"At the goal of the motion, {envelope.scope}. More by 'ocptip drive'.")
        titles, *rows = envelope_rows(envelope)
        yield grid(titles, rows)
        yield items([ASSUMED, f"not covered: {', '.join(envelope.not_covered)}"])

    def _rest(self) -> Iterator[str]:
        yield heading("Load cases")
        yield paragraph(
            "In the nominal model, at rest in each pose, with more payload at the TCP, the floor tilted "
            "and the TCP pushed in the worst directions together. Directions in degrees from the base's "
            "x axis towards y. GN, "
            "GT: published indices; 1: a contact is lost."
        )
        support = self.about.task.robot.support
        equal = equal_normal_map(support) is not None
        if equal:
            yield paragraph(
                "Minimum forces are those of equally compliant feet: rigid ground leaves open how these "
                "contacts share a load. GN and GT do not depend on it."
            )
        shared = self.about.task.robot.slip.redistribution == "full" and not equal
        if shared:
            yield paragraph(
                "Minimum forces are left out: rigid ground leaves open how these contacts share a load. GN "
                "and GT do not depend on it."
            )
        rows = [_TITLES, *map(_case_row, _by_margin(self.about.cases))]
        titles, *rows = ([*row[:_FORCE], *row[_FORCE + 1 :]] for row in rows) if shared else rows
        yield grid(titles, rows)
        yield heading("Tilt by direction")
        for stage in self.about.stages:
            least = ", ".join(f"{name} {_tilt(tilts)}" for name, (_, tilts) in stage.tilts.items())
            yield paragraph(f"At rest, all else nominal; minimum: {least}.")
            caption = "Largest tilt of the floor by direction, seen from above."
            yield picture(tilt_figure(stage.tilts), caption)
        if payloads := [stage.payloads for stage in self.about.stages if stage.payloads is not None]:
            times, held = map(np.concatenate, zip(*payloads, strict=True))
            yield heading("Largest payload")
            least = f"{quantity(float(held.min()), 'kg')} more at the TCP at {times[held.argmin()]:.3f} s"
            robust = self.about.motion.robustness if self.about.motion else ()
            drives = [one.drives for one in robust if one.drives is not None]
            moved = "Drives not checked"
            if drives:
                moved = f"The drives move {quantity(min(drives), 'kg', 3)} more"
            yield paragraph(
                "Contacts alone, in the nominal model, at rest in the postures of the motion, up to the mass "
                f"of the robot; minimum: {least}. {moved}."
            )
            lightest = min(drives) if drives else None
            yield picture(payload_figure(times, held, lightest), "What the gripper may hold, at rest.")
        if self.about.charts or self.about.not_charted:
            yield heading("Load, tilt and push charts")
            yield paragraph(f"Not covered: {', '.join(NOT_COVERED)}. More by 'ocptip chart'.")
        for chart in self.about.charts:
            title = chart.raised.title
            yield image(chart.picture(), f"{title[0].upper()}{title[1:]}: {chart.scope}.")
        yield from (paragraph(f"Missing {why}.") for why in dict.fromkeys(self.about.not_charted))

    def _tests(self, written: Collection[str]) -> Iterator[str]:
        """Tests with those of their sections that are written."""
        yield heading("Which table answers which test")
        rows = [
            (test, "; ".join(name for name in names.split("; ") if name in written) or _ABSENT)
            for test, names in _TESTS
        ]
        if self.about.envelope is None:
            drive = f"ocptip drive {self.about.name} --posture {self.about.stages[-1].name or 'goal'}"
            k = [names for _, names in _TESTS].index("Drive envelope")
            rows[k] = (rows[k][0], f"no contact is declared a wheel; if the base drives: {drive}")
        yield grid(("common test", "see"), rows)

    def _again(self) -> Iterator[str]:
        yield heading("To compute this again")
        name, cases = self.about.name, f" --cases {self.cases}" if self.cases else ""
        yield paragraph(f"In the folder that holds {name}: `ocptip report {name}{cases}` (all of it)")
        if self.about.folder is not None:
            seed = f"planned with seed {self.about.folder.data.get('seed')}"
            yield paragraph(f"`ocptip check {self.about.name}` (the motion; {seed})")
            alone = " --tolerance none" if self.about.task.limits.tolerance.given else ""
            yield paragraph(f"`ocptip check {self.about.name} --stops path{alone}` (stops)")
            sums = read_sums(self.about.folder.path)
            yield grid((f"file ({SUMS})", "SHA-256"), sums.items())
        yield grid(("program", "version"), versions().items())

    def to_dict(self) -> dict[str, Any]:
        """The document as data."""
        return {**self.about.to_dict(), "written": [str(path) for path in self.written]}

    def to_text(self) -> str:
        """The headline, the load cases that do not stand, and the file."""
        cases = self.about.cases
        fallen = [case for case in cases if not case.stands]
        count = f"{len(cases) - len(fallen)} of {len(cases)}"
        usual = "" if self.about.given_cases else " (the usual ones do not decide)"
        lines = headlines(f"{self.about.headline}. {count} load cases are stable{usual}.")
        if self.about.checked is not None:
            robot = self.about.task.robot
            lines += ["", *margin_table(robot, self.about.checked), ""]
        lines += [f"  not stable: {' '.join(_case_row(case)[:4])}" for case in fallen]
        lines += files_lines(self.written)
        return "\n".join(lines)

    def write(self) -> Iterator[Path]:
        """The page."""
        make = pdf if self.out.suffix == ".pdf" else page
        write_bytes(self.out, make(self.about.headline, self.parts()))
        yield self.out


def _by_margin(cases: Iterable[LoadCase]) -> list[LoadCase]:
    """The worst first."""

    def used(case: LoadCase) -> float:
        return max(np.inf if np.isnan(index) else index for index in (case.GN, case.GT))

    return sorted(cases, key=lambda case: (case.stands, -used(case)))


def _labelled(row: tuple[str, str]) -> str:
    """A row of a command's output as a sentence."""
    label, text = row
    return f"{label} {text}" if label else text


def _case_row(case: LoadCase) -> tuple[str, ...]:
    named = (("downhill", case.downhill), ("push", case.towards))
    words = [f"{word} {_direction(np.array(side))}" for word, side in named if any(side)]
    return (
        case.pose, f"+{case.payload:g} kg", f"{np.degrees(case.tilt):g} deg", f"{case.push:g} N",
        "yes" if case.stands else "NO", _margin(case), percent(case.GT) if case.GT < 1 else "slips",
        f"{case.least_force:.1f} N", ", ".join(words) or "-", ratio(case.GN), ratio(case.GT),
    )  # fmt: skip


def _margin(case: LoadCase) -> str:
    if case.tipping_margin is None:
        return "cannot tip"
    return quantity(case.tipping_margin, "N m", 3) if case.GN < 1 else "tips"


def _vector(values: Any) -> str:
    return "({})".format(", ".join(f"{x:.3g}" for x in np.round(np.asarray(values), 3) + 0.0))


def _direction(side: np.ndarray) -> str:
    """In degrees from the base's x axis towards y, and above or below the horizontal."""
    level = float(np.hypot(*side[:2]))
    rise = int(np.degrees(np.arctan2(side[2], level)).round())
    height = f"{abs(rise)}° {'up' if rise > 0 else 'down'}" if rise else ""
    turn = f"at {round(np.degrees(np.arctan2(side[1], side[0])) % 360) % 360}°" if level > 1e-9 else ""
    return ", ".join(part for part in (turn, height) if part)


def _tilt(tilts: np.ndarray) -> str:
    more = " and more" if tilts.min() >= MOST_TILT else ""
    return f"{np.degrees(tilts.min()):.2f} deg{more}"
