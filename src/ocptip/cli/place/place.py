"""`ocptip place`: finds where a base should stand, reports it, writes files and figures."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.api.place import Placed, place
from ocptip.basics.text import quantity, table, wrapped
from ocptip.cli.command import FolderReport, Report
from ocptip.cli.layout import brief_notes, files_lines, fitted, headlines, masses, under
from ocptip.cli.many import Asked, answer_many
from ocptip.cli.options import given_tolerance, output_directory, require_least
from ocptip.cli.terminal import Progress
from ocptip.motion.check import scope_of
from ocptip.placement.limits.arm import Clearance, JointAngles
from ocptip.placement.limits.base import BaseClearance
from ocptip.placement.result import NoPlacementError, Placement, PlacementMargin, PlacementResult
from ocptip.reserves.tipping import moment_at
from ocptip.standing.tolerance import DEFAULT
from ocptip.task_files.placement import load_placement

_MEANING = {"GN": "tipping margin", "GT": "friction used", "GK": "process force", "GE": "power at rest"}
_LIMITED = {"GN": "tipping margin", "GT": "friction used", "bounds": "place"}
_MOST_VIOLATED = 6
_DECIMALS = 6  # of per cent: less is rounding


def run(options: Namespace) -> Report:
    """Place; where there is no placement, the report says why."""
    require_least(options, starts=1, seed=0, jobs=1)
    if len(options.task) > 1 or options.scheduler:
        return answer_many(options, _asked, placed)
    one = _asked(Namespace(**{**vars(options), "task": options.task[0]}))
    return placed(one, options)


def _asked(options: Namespace) -> Asked:
    """A task, with what the options change."""
    task = load_placement(options.task, DEFAULT)
    if tolerance := given_tolerance(options):
        task = task.within(tolerance)
    return Asked(task, task.name, output_directory(options, task.name))


def placed(one: Asked, options: Namespace, _: Executor | None = None) -> Report:
    """Place one task; where there is no placement, the report says why."""
    try:
        with progress_bar(sys.stderr) as progress:
            result = place(one.task, starts=options.starts, seed=options.seed, progress=progress)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("before there was a result") from None
    return PlaceReport(result, one.directory, not options.no_figures, yes=result.verified)


def progress_bar(stream: TextIO) -> Progress:
    """Bar that shows the minimum total so far."""

    return Progress(
        stream, "searching for placements to start from ...", "no placement yet", "minimum total {:.4f}"
    )


@dataclass
class PlaceReport(FolderReport):
    """The report of `ocptip place` on placements, or the reason why there are none."""

    early = True
    result: Placed

    def write(self) -> Iterator[Path]:
        """Write placement.json and figures."""
        with Progress(sys.stderr, "drawing ...") if self.figures else nullcontext():
            yield from super().write()

    def to_text(self) -> str:
        """The best place, or the one of minimum violation and which constraints it breaks."""
        answer, shown, within = self.result.answer, self.result.best, self.result.within
        head, lines = _found(answer) if isinstance(answer, PlacementResult) else refusal_lines(answer)
        if alike := self.result.alike:
            but = "" if alike.stands else ", BUT equally compliant feet slip"
            head = head.replace("verified", f"verified{but}", 1)
            lines.append(
                (
                    "sharing",
                    f"friction used is for the best; equally compliant feet use {alike.friction_used}",
                )
            )
        elif shown.problem.alike:
            lines.append(
                ("sharing", "contacts differ in friction: its use is that of equally compliant feet")
            )
        if within:
            if not within.stands:
                head = f"NO PLACEMENT for {within.scope}. In the nominal model: {head}"
            else:
                head = head.replace("PLACED", f"PLACED for {within.scope}", 1)
            lines += under("uncertainty", within.lines(shown.problem.robot.tip_over.reference_moment))
            if self.result.dropped and within.stands:
                lines.append(("", f"{self.result.dropped} better ones or alternatives are not robust enough"))
        lines.append(("masses", masses(shown.problem.robot)))
        lines += under("assumed", brief_notes(shown.problem.robot.notes, self.verbose))
        tables = [] if isinstance(answer, NoPlacementError) else [*_criteria(shown), "", *_limits(shown), ""]
        head = headlines(f"{self.result.name}   {head}")
        pose = fitted([*_pose_lines(shown)]) if tables else []
        return "\n".join([*head, *pose, "", *tables, *fitted(lines), *files_lines(self.written)])


def _found(result: PlacementResult) -> tuple[str, list[tuple[str, str]]]:
    """The verdict, what is at its limit, alternatives, the search."""
    best = result.best
    kept = sum(start.feasible for start in result.starts)
    lines = []
    if best.active:
        names = [f"{_LIMITED.get(m.kind, m.kind)} {m.full_name}" for m in best.active]
        lines.append(("at limit", "; ".join(dict.fromkeys(names))))  # a pair in several tasks
    limited = any(margin.kind == JointAngles.kind for margin in best.active)
    if limited and not result.problem.limits.angle_margin:
        lines.append(("", "angle_margin_deg in [limits] keeps turning joints away from their limits"))
    lines += near_base(best)
    for number, other in enumerate(result.places[1:], 2):
        lines.append((f"no. {number}", _alternative(other)))
    tried = f"{kept} of {len(result.starts)} starts kept all constraints"
    lines.append(("search", f"{tried}, {result.seconds:.1f} s, seed {result.seed}"))
    return f"PLACED, all constraints verified{scope_of(best.problem.collision)}", lines


def near_base(placement: Placement) -> list[tuple[str, str]]:
    """A base that comes nearer to something than the arm may, where no limit of the base is given."""
    limits = placement.problem.limits
    gaps = [m for m in placement.margins if m.kind in (Clearance.kind, BaseClearance.kind)]
    near = [m for m in gaps if not limits.base_clearance and m.limit == 0 and m.value < limits.clearance]
    if not near:
        return []
    nearest = min(near, key=lambda margin: margin.value)
    gap, asked = (quantity(1e3 * value, "mm", 2).strip() for value in (nearest.value, limits.clearance))
    text = f"{nearest.name} are only {gap} apart: base_clearance in [limits] is 0, that of the arm {asked}"
    return [("clearance", text)]


def refusal_lines(error: NoPlacementError) -> tuple[str, list[tuple[str, str]]]:
    """Which constraints cannot be met, and by how much at the place of minimum violation."""
    lines = [("nearest", "the placement of minimum violation:"), *_pose_lines(error.nearest)]
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
    values = ", ".join(f"{_MEANING[name]} {_value(name, placement)}" for name in _shown(placement))
    return f"objective {placement.total:.4f}{on} at {where_text(placement)}; {values}"


def _shown(placement: Placement) -> list[str]:
    """The criteria that say something: without process loads there is no share of a force."""
    loads = any(case.load >= 0 for case in placement.problem.cases)
    return [name for name in placement.criteria if name != "GK" or loads]


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
    arm, postures = problem.robot.arm, []
    for task, q in zip(problem.tasks, placement.angles, strict=True):
        angles = [
            f"{name} {value:.4f} m" if unit == "m" else f"{name} {value:.2f} deg"
            for name, value, unit in zip(arm.joint_names, arm.in_degrees(q) + 0.0, arm.units, strict=True)
        ]
        posture = f"{task.name}: " if len(problem.tasks) > 1 else ""
        postures.append(f"{posture}{', '.join(angles)}")
    return [*lines, *under("joints", postures)]


def _value(name: str, placement: Placement) -> str:
    value, reference = placement.criteria[name], placement.problem.robot.tip_over.reference_moment
    if name == "GN" and reference and 0 < value < 1:
        return quantity(moment_at(value, reference), "N m", 3)
    if name == "GT" and value <= 1:
        return quantity(round(100 * value, _DECIMALS), "%", 3)
    if name == "GK":
        return f"{quantity(100 * value, '%', 3)} of the maximum"
    unit = placement.problem.energy.unit if name == "GE" else ""
    return f"{value:.1f} {unit}".rstrip() if name == "GE" else f"{value:.3f}"


def _criteria(placement: Placement) -> list[str]:
    """The criteria, their weights, and what they add to the objective."""
    problem, rows = placement.problem, [["", "", "weight", "objective"]]
    for name in _shown(placement):
        weight, reference = getattr(problem.weights, name), problem.references[name]
        share = weight * placement.criteria[name] / reference
        by = f"{weight:.3g}{f' / {reference:.4g}' if reference != 1 else ''}"
        title = _MEANING[name] + (f" ({name})" if name != "GE" else "")
        rows.append([title, _value(name, placement), *([by, f"{share:.4f}"] if weight else ["-", "-"])])
    return table([*rows, ["sum", "", "", f"{placement.total:.4f}"]], left=(0, 1))


def _limits(placement: Placement) -> list[str]:
    """The tightest constraint of each kind; equalities and moments behind GN are in the file."""
    tightest: dict[str, PlacementMargin] = {}
    for margin in placement.margins:  # the smallest first
        tightest.setdefault(margin.kind, margin)
    shown = [m for m in tightest.values() if m.kind not in ("reach", "persistence", "tip-over")]
    moment = placement.problem.robot.tip_over.reference_moment
    numbers = table([_limit_cells(margin, moment) for margin in shown], left=(0,))
    where = zip(numbers, shown, strict=True)
    rows = [line for cells, m in where for line in wrapped(cells, [m.full_name], len(cells) + 2)]
    return ["the nearest limit of each kind; placement.json has all", *rows]


def _limit_cells(margin: PlacementMargin, moment: float | None) -> list[str]:
    """Kind, value and limit; of indices in N m and per cent."""
    value, limit, unit = margin.in_degrees
    sign = "<=" if margin.upper else ">="
    if margin.kind == "GN" and moment and 0 < value < 1:
        value, limit, unit, sign = moment_at(value, moment), moment_at(limit, moment), "N m", ">="
    if margin.kind == "GT" and value <= 1:
        value, limit, unit = round(100 * value, _DECIMALS), 100 * limit, "%"
    shown, bound = quantity(value, unit, 4).rstrip(), f"{sign} {limit:.4g}"
    return [_LIMITED.get(margin.kind, margin.kind), shown, "at limit" if margin.active else bound]
