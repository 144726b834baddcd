"""`ocptip place`: finds where a base should stand, says what it found, writes files and figures."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import naming
from ocptip.basics.outputs import remove_figures
from ocptip.cli.command import Report
from ocptip.cli.layout import masses, summary, under
from ocptip.cli.many import Asked, answer_many
from ocptip.cli.options import output_directory, require_least
from ocptip.cli.terminal import Progress, say_if_compiling
from ocptip.motion.check import scope_of
from ocptip.placement.output import refusal_to_dict, result_to_dict, write_placement
from ocptip.placement.place import place
from ocptip.placement.result import Margin, NoPlacementError, Placement, PlacementResult
from ocptip.placement.within import placement_within, searched
from ocptip.standing.tolerance import WORKSHOP, Tolerance
from ocptip.standing.within.rest import WithinAtRest
from ocptip.task_files.placement import load_placement
from ocptip.task_files.tolerance import load_tolerance

_MEANING = {"GN": "tip-over", "GT": "slip", "GK": "force space", "GE": "power at rest"}
_MOST_VIOLATED = 6


def run(options: Namespace) -> Report:
    """Place; where there is no placement, the report says why."""
    require_least(options, starts=1, seed=0, jobs=1)
    if len(options.task) > 1 or options.scheduler:
        return answer_many(options, _asked, placed)
    one = _asked(Namespace(**{**vars(options), "task": options.task[0]}))
    say_if_compiling()
    return placed(one, options)


def _asked(options: Namespace) -> Asked:
    """A task, with what the options change."""
    task = load_placement(options.task, WORKSHOP)
    tolerance = task.tolerance
    if options.tolerance is not None:
        with naming("--tolerance"):
            tolerance = load_tolerance(options.tolerance)
            task = replace(task, problem=replace(task.problem, tolerance=searched(tolerance)))
        task = replace(task, tolerance=tolerance)
    return Asked(task, task.name, output_directory(options, task.name))


def placed(one: Asked, options: Namespace, _: Executor | None = None) -> Report:
    """Place one task; where there is no placement, the report says why."""
    task, tolerance = one.task, one.task.tolerance
    try:
        with progress_bar(sys.stderr) as progress:
            answer = place(task.problem, starts=options.starts, seed=options.seed, progress=progress)
    except NoPlacementError as error:
        answer = error
    except KeyboardInterrupt:
        raise KeyboardInterrupt("before there was a result") from None
    within, dropped = None, 0
    if isinstance(answer, PlacementResult) and searched(tolerance) != tolerance:
        answer, within, dropped = _holding(answer, tolerance)
    return PlaceReport(task.name, answer, one.directory, not options.no_figures, within, dropped)


def _holding(answer: PlacementResult, tolerance: Tolerance) -> tuple[PlacementResult, WithinAtRest, int]:
    """The placements that hold the whole tolerance, the first one's worst, and how many do not; else all."""
    found = [placement_within(placement, tolerance) for placement in answer.placements]
    kept = [k for k, one in enumerate(found) if one.stands]
    if not kept:
        return answer, found[0], len(found)
    placements = tuple(answer.placements[k] for k in kept)
    return replace(answer, placements=placements), found[kept[0]], len(found) - len(kept)


def progress_bar(stream: TextIO) -> Progress:
    """Bar that shows the least total so far."""

    return Progress(stream, "looking for places to start from ...", "no placement yet", "least total {:.4f}")


@dataclass
class PlaceReport(Report):
    """Placements, or why there are none.

    Attributes:
        name: of the task.
        answer: from `place`.
        directory: where files go.
        figures: whether figures are among them.
        within: the best one at the worst of a tolerance of more than its base; None: none was given.
        dropped: placements that do not hold that tolerance.
    """

    early = True
    name: str
    answer: PlacementResult | NoPlacementError
    directory: Path
    figures: bool
    within: WithinAtRest | None = None
    dropped: int = 0

    @property
    def found(self) -> bool:
        """True if all constraints are kept."""
        return isinstance(self.answer, PlacementResult)

    @property
    def good(self) -> bool:
        """True if all constraints are kept, within the whole tolerance where there is one."""
        return self.found and (self.within is None or self.within.stands)

    def entries(self) -> dict[str, Any]:
        """Content of placement.json."""
        to_dict = result_to_dict if self.found else refusal_to_dict
        more = {"within": self.within.to_dict(), "dropped": self.dropped} if self.within else {}
        return {**to_dict(self.name, self.answer), **more, "warnings": self.warnings}

    def to_dict(self) -> dict[str, Any]:
        """The content of placement.json and the list `written`."""
        return {**self.entries(), "written": self.written}

    def write(self) -> Iterator[Path]:
        """Write placement.json and figures."""
        yield write_placement(self.directory, self.entries())
        remove_figures(self.directory, "place")
        if self.figures:
            from ocptip.pictures.placement import draw_placement

            placements = self.answer.places if self.found else (self.answer.nearest,)
            with Progress(sys.stderr, "drawing ..."):
                drawn = draw_placement(self.directory, self.name, placements)
            yield from drawn

    def to_text(self) -> str:
        """The best place, or the least-infeasible one and which constraints it breaks."""
        head, lines = _found(self.answer) if self.found else refusal_lines(self.answer)
        shown = self.answer.best if self.found else self.answer.nearest
        if self.within:
            if not self.within.stands:
                head = f"NO PLACEMENT within the tolerance. As described: {head}"
            lines += under("within", self.within.lines())
            if self.dropped and self.within.stands:
                lines.append(("", f"{self.dropped} better ones or alternatives do not hold it"))
        lines.append(("masses", masses(shown.problem.robot)))
        lines += [("assumed", note) for note in shown.problem.robot.notes]
        return summary(f"{self.name}: {head}", lines, self.written)


def _found(result: PlacementResult) -> tuple[str, list[tuple[str, str]]]:
    """Pose, angles, criteria, margins, active constraints, alternatives."""
    best = result.best
    kept = sum(start.feasible for start in result.starts)
    head = (
        f"FOUND, all constraints verified{_scope(best)}. Total {best.total:.4f}; "
        f"{kept} of {len(result.starts)} starts kept all constraints, "
        f"{result.seconds:.1f} s, seed {result.seed}."
    )
    lines = [*_pose_lines(best), *_criteria_lines(best), *_margin_lines(best)]
    active = "; ".join(str(m) for m in best.active) or "none: the optimum is inside all limits"
    lines.append(("active", active))
    for number, other in enumerate(result.places[1:], 2):
        lines.append((f"no. {number}", _alternative(other)))
    return head, lines


def _scope(placement: Placement) -> str:
    return scope_of(placement.problem.collision)


def refusal_lines(error: NoPlacementError) -> tuple[str, list[tuple[str, str]]]:
    """Which constraints cannot be met, and by how much at the least-infeasible place."""
    lines = [("nearest", "the least-infeasible placement found:"), *_pose_lines(error.nearest)]
    violated = error.nearest.violations
    lines += [("broken", str(margin)) for margin in violated[:_MOST_VIOLATED]]
    if len(violated) > _MOST_VIOLATED:
        lines.append(("", f"and {len(violated) - _MOST_VIOLATED} more, see placement.json"))
    reason = str(error)
    return f"NO PLACEMENT. {reason[:1].upper()}{reason[1:]}.", lines


def where_text(placement: Placement) -> str:
    """Parameters as people read them: "x 1.028 m, y 0.228 m, angle 33.6 deg"."""
    terrain = placement.problem.terrain[placement.patch]
    parts = [
        f"{name} {np.rad2deg(value):.1f} deg" if angular else f"{name} {value:.3f} m"
        for name, value, angular in zip(
            terrain.parameters, placement.parameters, terrain.angular, strict=True
        )
    ]
    return ", ".join(parts)


def _alternative(placement: Placement) -> str:
    """Total, place and criteria."""
    terrain = placement.problem.terrain
    on = f" on {terrain[placement.patch].name}" if len(terrain) > 1 else ""
    values = ", ".join(f"{name} {_value(name, placement)}" for name in placement.criteria)
    return f"total {placement.total:.4f}{on} at {where_text(placement)}; {values}"


def _pose_lines(placement: Placement) -> list[tuple[str, str]]:
    problem = placement.problem
    x, y, z = placement.base_position + 0.0
    roll, pitch, yaw = Rotation.from_matrix(placement.base_rotation).as_euler("xyz", degrees=True) + 0.0
    lines = [
        ("place", f"{problem.terrain[placement.patch].name}: {where_text(placement)}"),
        (
            "base",
            f"origin ({x:.3f}, {y:.3f}, {z:.3f}) m in the world, "
            f"roll {roll:.1f}, pitch {pitch:.1f}, yaw {yaw:.1f} deg",
        ),
    ]
    for task, q in zip(problem.tasks, placement.angles, strict=True):
        arm = problem.robot.arm
        angles = " ".join(
            f"{value:.4f} m" if unit == "m" else f"{value:.2f}"
            for value, unit in zip(arm.in_degrees(q) + 0.0, arm.units, strict=True)
        )
        unit = "" if arm.prismatic.all() else " deg"
        lines.append(("joints", angles + unit + (f"  {task.name}" if len(problem.tasks) > 1 else "")))
    return lines


def _value(name: str, placement: Placement) -> str:
    value = placement.criteria[name]
    unit = placement.problem.energy.unit if name == "GE" else ""
    return f"{value:.1f} {unit}".rstrip() if name == "GE" else f"{value:.3f}"


def _criteria_lines(placement: Placement) -> list[tuple[str, str]]:
    problem, lines = placement.problem, []
    for name, value in placement.criteria.items():
        weight, reference = getattr(problem.weights, name), problem.references[name]
        text = f"{_value(name, placement):<9} {_MEANING[name]}"
        if weight:
            by = f" / {reference:.4g}" if reference != 1 else ""
            text += f": weight {weight:.3g}{by}, share {weight * value / reference:.4f}"
        else:
            text += ": not weighted"
        lines.append((name, text))
    return lines


def _margin_lines(placement: Placement) -> list[tuple[str, str]]:
    """The tightest constraint of each kind; equalities and moments behind GN are in the file."""
    tightest: dict[str, Margin] = {}
    for margin in placement.margins:  # the smallest first
        tightest.setdefault(margin.kind, margin)
    shown = [m for m in tightest.values() if m.kind not in ("reach", "persistence", "tip-over")]
    lines = [("margins", "tightest of each kind; all of them are in placement.json")]
    return [*lines, *(("", _margin(margin)) for margin in shown)]


def _margin(margin: Margin) -> str:
    unit, scale = margin.unit, 1.0
    if unit == "rad":
        unit, scale = "deg", 180 / np.pi
    value, limit, unit = scale * margin.value, scale * margin.limit, f" {unit}" if unit else ""
    sign = "<=" if margin.upper else ">="
    room = abs(limit - value)
    compared = f"{value:.4g} {sign} {limit:.4g}{unit}, room {room:.3g}{unit}"
    return f"{margin.kind + ':':<15} {compared}: {margin.full_name}"
