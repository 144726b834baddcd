"""`ocptip report`: what a plan or a cycle was checked for, as one document for the safety file."""

from __future__ import annotations

import os
from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import naming
from ocptip.basics.outputs import require_replaceable_file
from ocptip.basics.read import only_inside, read_bytes
from ocptip.basics.sums import SUMS, read_sums
from ocptip.basics.text import quantity, ratio
from ocptip.basics.write import file_target, versions, write_bytes
from ocptip.certificate.checks import certified_cycle
from ocptip.cli import report_page as html
from ocptip.cli.check import worst_rows
from ocptip.cli.command import Report
from ocptip.cli.layout import certificate_rows, masses, segment_rows, tolerated_lines, within_rows
from ocptip.cli.terminal import say_if_compiling
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.cycles.check import CycleCheck, check_cycle
from ocptip.motion.cycles.task import Task
from ocptip.motion.load_cases import (
    MOST_TILT,
    Asked,
    LoadCase,
    largest_payload,
    load_cases,
    tilt_by_direction,
)
from ocptip.motion.stops import Stops, stops_of
from ocptip.motion.task import MotionTask
from ocptip.motion.tolerated import Tolerated, robustness
from ocptip.reserves.equal_compliance import equal_normal_map
from ocptip.standing.arm import Robot
from ocptip.standing.parts import Part
from ocptip.standing.tolerance import NONE
from ocptip.task_files.cycle import read_task
from ocptip.task_files.option_files import load_asked
from ocptip.task_files.plan_folder import PlanFolder, arms_of, read_plan_folder
from ocptip.trajectories.trajectory import Trajectory

ENDINGS = (".html", ".pdf")
OVERVIEW = "plan.png"
POSTURES = 60  # of a motion, for the largest payload
_SAME = 1e-3  # s: postures no farther apart are one
_TITLES = ("pose", "payload", "tilt", "push", "stands", "GN", "GT", "least force", "worst direction")
_NOT = (
    "This document lists what was computed, from what, and how. It claims no conformity with any standard, "
    "and no test of the real machine is replaced by it."
)
_TESTS = (
    ("tilt table (how far may the floor be tilted)", "Tilt by direction; Load cases; Tolerated alone"),
    ("push or pull test at the gripper", "Load cases; Tolerated alone"),
    ("overload test", "Load cases; Largest payload; Tolerated alone"),
    ("stop test (controlled stop at any instant)", "Stops"),
    ("test run at higher speed", "Tolerated alone"),
    ("slope and friction of the floor", "Tilt by direction; Tolerated alone"),
)


def run(options: Namespace) -> DocumentReport:
    """Compute everything anew, from the folder or the task alone."""
    path = Path(options.plan)
    with naming("--out"):
        out = file_target(options.out or f"ocptip-report-{path.resolve().stem}.html", ENDINGS)
        require_replaceable_file(out, overwrite=options.overwrite)
    folder = read_plan_folder(path) if path.is_dir() else None
    task = folder.task if folder else read_task(path)
    robots = arms_of(task, "report is about", path)
    say_if_compiling()
    if folder is not None:
        stages = [Stage(*one) for one in zip(_tasks(task), folder.parts("report is about"), strict=True)]
    else:
        names = [segment.name for segment in task.segments]
        stages = [Stage(own, None, name) for own, name in zip(_tasks(task), names, strict=True)]
    found = Document(path.name, task, folder, options.cases, stages)
    if folder is not None:
        found.moves(folder.motion)
    for stage, robot in zip(stages, robots, strict=True):
        stage.rests(robot, options.cases)
    return DocumentReport(found, out)


def _tasks(task: Task) -> list[MotionTask]:
    """That of the motion; of a cycle one per segment, from and to the first posture of those it may take."""
    if not task.is_cycle:
        return [task]
    starts = [task.starts[0], *(segment.goals[0] for segment in task.segments[:-1])]
    pairs = zip(task.segments, starts, strict=True)
    return [segment.between(start, segment.goals[0]) for segment, start in pairs]


class Stage:
    """A motion, or a segment of a cycle: what is said of it alone.

    Args:
        task: with the robot as it is then.
        part: what it does; None: not planned.
        name: of the segment; of a single motion empty.
    """

    def __init__(self, task: MotionTask, part: Part | None, name: str = "") -> None:
        self.task, self.part, self.name = task, part, part.name if part else name
        self.checked: MotionCheck | None = None
        self.stops: Stops | None = None
        self.payloads: tuple[np.ndarray, np.ndarray] | None = None
        self.cases: list[LoadCase] = []
        self.tilts: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def moves(self, checked: MotionCheck) -> None:
        """Look at the motion; its check is known."""
        assert self.part is not None
        self.checked, robot, motion = checked, self.part.robot, self.part.motion
        as_described = replace(self.task.limits, tolerance=NONE)  # stops are looked at without one
        stopped = check_motion(robot, motion, self.task.stops.asked(as_described))
        self.stops = stops_of(self.task, motion, stopped, "path")
        times = np.linspace(0.0, motion.end, POSTURES)
        acting = robot.during(motion).acting(times)
        self.payloads = self.part.begin + times, largest_payload(robot, motion.states(times)[0], acting)

    def rests(self, robot: Robot, cases_file: str | None) -> None:
        """Look at postures at rest."""
        poses, acting = {"start": self.task.start, "goal": self.task.goal}, {}
        if self.part is not None:
            motion, times = self.part.motion, self._poses()
            known = robot.during(motion).acting(np.array(list(times.values())))
            poses = dict(zip(times, motion.states(np.array(list(times.values())))[0], strict=True))
            acting = dict(zip(times, known, strict=True))
        asked = Asked(poses) if cases_file is None else load_asked(cases_file, robot.arm, poses)
        before = f"{self.name}: " if self.name else ""
        asked = replace(
            asked,
            poses={before + pose: q for pose, q in asked.poses.items()},
            acting={before + pose: own for pose, own in acting.items() if asked.poses[pose] is poses[pose]},
        )
        self.cases = load_cases(robot, asked)
        self.tilts = {
            name: tilt_by_direction(robot, q, acting=asked.acting.get(name))
            for name, q in asked.poses.items()
        }

    def _poses(self) -> dict[str, float]:
        """Times, s, of postures: both ends, and where the reserves are used most, if that is between."""
        assert self.part is not None
        assert self.checked is not None
        found = {"start": 0.0, "goal": self.part.motion.end}
        for name in ("GN", "GT"):
            time = self.checked.worst[name].time
            if min(abs(time - other) for other in found.values()) > _SAME:
                found[f"worst {name} ({self.part.begin + time:.3f} s)"] = time
        return found

    def said(self, lines: Iterable[str]) -> list[str]:
        """Lines, with the segment's name before them."""
        return [f"{self.name}: {line}" if self.name else line for line in lines]


class Document:
    """Everything that is said.

    Args:
        name: of the plan's folder, or of the task's file.
        task: with the robot.
        folder: of the plan, if there is one.
        cases_file: that was named for the load cases.
        stages: of the motion, or of the segments of a cycle.
    """

    def __init__(
        self,
        name: str,
        task: Task,
        folder: PlanFolder | None,
        cases_file: str | None,
        stages: Sequence[Stage],
    ) -> None:
        self.name, self.task, self.folder, self.cases_file = name, task, folder, cases_file
        self.stages = stages
        self.checked: MotionCheck | None = None
        self.segments: CycleCheck | None = None
        self.tolerated: tuple[Tolerated, ...] = ()

    def moves(self, sequence: Trajectory) -> None:
        """Look at the motions."""
        self.segments = certified_cycle(self.task, sequence, check_cycle(self.task, sequence))
        self.checked = self.segments.whole
        self.tolerated = robustness(self.task, sequence)
        for stage, checked in zip(self.stages, self.segments.segments, strict=True):
            stage.moves(checked)

    @property
    def cases(self) -> list[LoadCase]:
        """Of all stages."""
        return [case for stage in self.stages for case in stage.cases]

    @property
    def stands(self) -> bool:
        """The motion is verified; without a motion: all postures stand on level ground."""
        if self.checked is not None:
            return self.checked.verified  # what becomes of it in stops is a table of its own
        return all(case.stands for case in self.cases if not (case.tilt or case.push or case.payload))

    @property
    def headline(self) -> str:
        """One line."""
        if self.checked is not None:
            return f"{self.task.name}: {self.checked.headline}"
        return f"{self.task.name}: {'STABLE' if self.stands else 'NOT STABLE'} at rest"

    # --- parts of the page --------------------------------------------------------------------------------

    def parts(self) -> Iterator[str]:
        """All sections."""
        yield html.heading(f"Stability of {self.task.name}", 1)
        yield html.paragraph(f"{self.headline}.")
        yield html.paragraph(_NOT)
        yield from self._machine()
        yield from self._assumed()
        if self.checked is not None:
            yield from self._motion(self.checked)
        yield from self._rest()
        yield from self._tests()
        yield from self._again()

    def _machine(self) -> Iterator[str]:
        robot, support = self.task.robot, self.task.robot.support
        yield html.heading("Machine")
        held = [(f"masses, {s.name}" if s.name else "masses", masses(s.task.robot)) for s in self.stages]
        rows = [
            *held,
            ("centre of mass of the base", f"{_vector(support.center_of_mass)} m"),
            ("joints", ", ".join(robot.names)),
        ]
        yield html.grid(("", ""), rows)
        feet = [
            (k, c.kind, _vector(c.position), _vector(c.normal), f"{getattr(c, 'friction', '-')}",
             getattr(c, "stiffness", None) or "rigid")
            for k, c in enumerate(support.contacts, 1)
        ]  # fmt: skip
        titles = ("contact", "kind", "position [m]", "normal", "friction", "stiffness [N/m]")
        yield html.grid(titles, feet)

    def _assumed(self) -> Iterator[str]:
        yield html.heading("Assumed, and not checked")
        texts = [
            "Base and links are rigid; contacts obey Coulomb's law with the friction given above.",
            "The ground bears every foot; it is level unless a tilt is named.",
            *dict.fromkeys(note for stage in self.stages for note in stage.task.robot.notes),
        ]
        if self.checked is not None:
            texts += [f"Collision: {self.checked.collision_text}."]
            texts += [*self.checked.feet_lines, *self.checked.drive_lines]
            texts += dict.fromkeys(text for s in self.stages if s.stops for text in s.stops.assumed)
        yield html.items(texts)

    def _motion(self, checked: MotionCheck) -> Iterator[str]:
        yield html.heading("Motion")
        energy = f"{quantity(checked.energy, 'J')} in {quantity(checked.duration, 's')}"
        yield html.paragraph(f"{energy}; looked at {checked.samples} instants.")
        if self.segments is not None and self.task.is_cycle:
            titles, *rows = segment_rows(self.task, self.segments)
            yield html.grid(titles, rows)
        yield html.items(map(_labelled, certificate_rows(checked)))
        for stage in self.stages:
            yield html.items(stage.said(map(_labelled, within_rows(stage.checked or checked))))
        titles, *rows = worst_rows(checked)
        yield html.grid(titles, rows)
        yield html.items(checked.contacts.lines())
        if self.folder is not None and (image := self.folder.path / OVERVIEW).is_file():
            with only_inside(self.folder.path):
                yield html.image(read_bytes(image), "The motion, as planned.")
        yield html.heading("Tolerated alone")
        yield html.paragraph("Each of these, all else as described, loses no contact in the motion:")
        yield html.items(tolerated_lines(self.tolerated))
        if any(stage.stops for stage in self.stages):
            yield html.heading("Stops")
            if self.task.is_cycle:
                yield html.paragraph("Times are those of the segment.")
            for stage in self.stages:
                if stops := stage.stops:
                    yield html.items(stage.said(stops.found))

    def _rest(self) -> Iterator[str]:
        from ocptip.pictures.load_cases import payload_figure, tilt_figure

        yield html.heading("Load cases")
        yield html.paragraph(
            "At rest in each pose, with more payload at the gripper, the floor tilted and the gripper pushed "
            "in the worst directions together. GN: use of the reserve against tipping, GT: of the friction; "
            "1: lost. Directions in degrees from the base's x axis towards y."
        )
        support = self.task.robot.support
        equal = equal_normal_map(support) is not None
        if equal:
            yield html.paragraph(
                "Least forces are those of equally compliant feet: rigid ground leaves open how so many "
                "contacts share a load. GN and GT do not depend on it."
            )
        shared = self.task.robot.slip.redistribution == "full" and not equal
        if shared:
            yield html.paragraph(
                "Least forces are left out: rigid ground leaves open how so many contacts share a load. GN "
                "and GT do not depend on it."
            )
        rows = [_TITLES, *map(_case_row, self.cases)]
        titles, *rows = ([*row[:-2], row[-1]] for row in rows) if shared else rows
        yield html.grid(titles, rows)
        yield html.heading("Tilt by direction")
        for stage in self.stages:
            least = ", ".join(f"{name} {_tilt(tilts)}" for name, (_, tilts) in stage.tilts.items())
            yield html.paragraph(f"At rest, as described else; least: {least}.")
            caption = "Largest tilt of the floor by direction, seen from above."
            yield html.picture(tilt_figure(stage.tilts), caption)
        if payloads := [stage.payloads for stage in self.stages if stage.payloads is not None]:
            times, held = map(np.concatenate, zip(*payloads, strict=True))
            yield html.heading("Largest payload")
            least = f"{quantity(float(held.min()), 'kg')} more at the gripper at {times[held.argmin()]:.3f} s"
            yield html.paragraph(
                f"At rest in the postures of the motion, up to the robot's own mass; least: {least}. Drives "
                "not looked at."
            )
            yield html.picture(payload_figure(times, held), "What the gripper may hold, at rest.")

    def _tests(self) -> Iterator[str]:
        yield html.heading("Which table answers which test")
        yield html.grid(("common test", "see"), _TESTS)

    def _again(self) -> Iterator[str]:
        yield html.heading("To compute this again")
        cases = f" --cases {self.cases_file}" if self.cases_file else ""
        yield html.paragraph(
            f"In the folder that holds {self.name}: `ocptip report {self.name}{cases}` (all of it)"
        )
        if self.folder is not None:
            seed = f"planned with seed {self.folder.data.get('seed')}"
            yield html.paragraph(f"`ocptip check {self.name}` (the motion; {seed})")
            alone = " --tolerance none" if self.task.limits.tolerance.given else ""
            yield html.paragraph(f"`ocptip check {self.name} --stops path{alone}` (stops)")
            sums = read_sums(self.folder.path)
            yield html.grid((f"file ({SUMS})", "SHA-256"), sums.items())
        yield html.grid(("program", "version"), versions().items())

    def to_dict(self) -> dict[str, Any]:
        """The same as data."""
        worst = {} if self.segments is None else {"check": self.segments.to_dict()}
        stops = [{"segment": s.name, **s.stops.to_dict()} for s in self.stages if s.stops]
        held = [float(s.payloads[1].min()) for s in self.stages if s.payloads is not None]
        return {
            "name": self.task.name,
            **worst,
            **({"stops": stops if self.task.is_cycle else stops[0]} if stops else {}),
            **({"least_more_payload_kg": min(held)} if held else {}),
            "tolerated": [one.to_dict() for one in self.tolerated],
            "load_cases": [case.to_dict() for case in self.cases],
            "least_tilt_deg": {
                name: float(np.degrees(tilts.min()))
                for stage in self.stages
                for name, (_, tilts) in stage.tilts.items()
            },
            "assumed": list(self.task.robot.notes),
            "versions": versions(),
        }


@dataclass
class DocumentReport(Report):
    """The document, and where it goes."""

    document: Document
    out: Path

    @property
    def good(self) -> bool:
        """Whether it stands."""
        return self.document.stands

    def to_dict(self) -> dict[str, Any]:
        """The document as data."""
        return {**self.document.to_dict(), "written": [str(path) for path in self.written]}

    def to_text(self) -> str:
        """The headline, the load cases that do not stand, and the file."""
        cases = self.document.cases
        fallen = [case for case in cases if not case.stands]
        lines = [f"{self.document.headline}. {len(cases) - len(fallen)} of {len(cases)} load cases stand."]
        lines += [f"  does not stand: {' '.join(_case_row(case)[:4])}" for case in fallen]
        lines += [f"written    {os.fspath(path)}" for path in self.written]
        return "\n".join(lines)

    def write(self) -> Iterator[Path]:
        """The page."""
        make = html.pdf if self.out.suffix == ".pdf" else html.page
        write_bytes(self.out, make(self.document.headline, self.document.parts()))
        yield self.out


def _labelled(row: tuple[str, str]) -> str:
    """A row of a command's output as a sentence of its own."""
    label, text = row
    return f"{label} {text}" if label else text


def _case_row(case: LoadCase) -> tuple[str, ...]:
    named = (("downhill", case.downhill), ("push", case.towards))
    words = [f"{word} {_direction(np.array(side))}" for word, side in named if any(side)]
    return (
        case.pose, f"+{case.payload:g} kg", f"{np.degrees(case.tilt):g} deg", f"{case.push:g} N",
        "yes" if case.stands else "NO", ratio(case.GN), ratio(case.GT), f"{case.least_force:.1f} N",
        ", ".join(words) or "-",
    )  # fmt: skip


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
