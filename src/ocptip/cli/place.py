"""`ocptip place`: finds where a base should stand, says what it found, writes files and figures."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from ocptip.cli.command import (
    MOVES,
    STANDS,
    Progress,
    _print,
    _refuse,
    output_directory,
    require_least,
    say_if_compiling,
    summary,
)

if TYPE_CHECKING:
    from ocptip.placement.result import Margin, NoPlacementError, Placement, PlacementResult
    from ocptip.task_files.placement import PlacementTask

_MEANING = {"GN": "tip-over", "GT": "slip", "GK": "force space", "GE": "power at rest"}
_MOST_VIOLATED = 6
_SAME = 2e-3  # m, rad: bases nearer than this are at the same place


def add_parser(commands: Any) -> None:
    """Add `place` to the commands of the parser. Loads no numerics."""
    place = commands.add_parser(
        "place",
        help="where should the base stand for given gripper poses and process forces?",
        description="Finds the best places for the base of a task file, with all constraints checked.",
        epilog="exit code: 0 found and verified, 1 no placement keeps all constraints, 2 bad input",
    )
    place.add_argument("task", metavar="TASK.toml", help="the task (format: see docs/placement.md)")
    place.add_argument("--out", metavar="DIR", help="where files go (default: ocptip-place-<name>)")
    place.add_argument("--json", action="store_true", help="print JSON instead of the summary")
    place.add_argument("--starts", metavar="N", type=int, default=5, help="starts (default: 5)")
    place.add_argument("--seed", metavar="N", type=int, default=0, help="of the starts (default: 0)")
    place.add_argument("--no-figures", action="store_true", help="write no figures")
    place.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Place, write and print; returns the exit code."""
    from ocptip.basics.errors import InputError, OcptipError
    from ocptip.placement.result import NoPlacementError

    try:
        _check_numbers(options)
        from ocptip.task_files.placement import load_placement

        task = load_placement(options.task)
        directory = output_directory(options, "place", task.name)
        try:
            report: PlaceReport | RefusalReport = PlaceReport(task, _placed(options, task))
        except NoPlacementError as error:
            report = RefusalReport(task, error)
        failure = _written(report, directory, figures=not options.no_figures)
    except InputError as error:
        return _refuse(f"{error}")
    except OcptipError as error:
        return _refuse(f"computation failed: {error}")
    except KeyboardInterrupt:
        _refuse("interrupted before there was a result")
        return MOVES
    _print(report.to_json() if options.json else report.to_text())
    if failure is not None:
        return _refuse(f"{failure.filename or directory}: {failure.strerror or failure}")
    return STANDS if report.found else MOVES


@dataclass
class PlaceReport:
    """What `ocptip place` says of a result.

    Attributes:
        task: the task.
        result: from `place`.
        written: files.
    """

    task: PlacementTask
    result: PlacementResult
    written: list[Path] = field(default_factory=list)
    found: bool = True

    @property
    def placements(self) -> tuple[Placement, ...]:
        """All placements, the best one first."""
        return self.result.placements

    def entries(self) -> dict[str, Any]:
        """Content of placement.json."""
        from ocptip.placement.output import result_to_dict

        return result_to_dict(self.task.name, self.result)

    def to_json(self) -> str:
        """The content of placement.json and the list `written`, as JSON text."""
        return _json(self.entries(), self.written)

    def to_text(self) -> str:
        """Pose, angles, criteria, margins, active constraints, alternatives. ASCII but for names."""
        result, best = self.result, self.result.best
        kept = sum(start.feasible for start in result.starts)
        head = (
            f"{self.task.name}: FOUND, all constraints verified. Total {best.total:.4f}; {kept} of "
            f"{len(result.starts)} starts kept all constraints, {result.seconds:.1f} s, seed {result.seed}."
        )
        lines = [*_pose_lines(best), *_criteria_lines(best), *_margin_lines(best)]
        active = "; ".join(str(m) for m in best.active) or "none: the optimum is inside all limits"
        lines.append(("active", active))
        for number, other in enumerate(result.placements[1:], 2):
            lines.append((f"no. {number}", _alternative(other, result.placements[: number - 1])))
        return summary(head, lines, self.written)


@dataclass
class RefusalReport:
    """What `ocptip place` says where there is no placement.

    Attributes:
        task: the task.
        error: why, with the least-infeasible placement.
        written: files.
    """

    task: PlacementTask
    error: NoPlacementError
    written: list[Path] = field(default_factory=list)
    found: bool = False

    @property
    def placements(self) -> tuple[Placement, ...]:
        """The least-infeasible one."""
        return (self.error.nearest,)

    def entries(self) -> dict[str, Any]:
        """Content of placement.json."""
        from ocptip.placement.output import refusal_to_dict

        return refusal_to_dict(self.task.name, self.error)

    def to_json(self) -> str:
        """The content of placement.json and the list `written`, as JSON text."""
        return _json(self.entries(), self.written)

    def to_text(self) -> str:
        """Which constraints cannot be met, and by how much at the least-infeasible place."""
        nearest = self.error.nearest
        lines = [("nearest", "the least-infeasible placement found:"), *_pose_lines(nearest)]
        violated = nearest.violations
        lines += [("broken", str(margin)) for margin in violated[:_MOST_VIOLATED]]
        if len(violated) > _MOST_VIOLATED:
            lines.append(("", f"and {len(violated) - _MOST_VIOLATED} more, see placement.json"))
        reason = str(self.error)
        head = f"{self.task.name}: NO PLACEMENT. {reason[:1].upper()}{reason[1:]}."
        return summary(head, lines, self.written)


def progress_bar(stream: TextIO) -> Progress:
    """Bar that shows the least total so far."""

    def best(least: float | None) -> str:
        return "no placement yet" if least is None else f"least total {least:.4f}"

    return Progress(stream, "looking for places to start from ...", best)


def _placed(options: argparse.Namespace, task: PlacementTask) -> PlacementResult:
    from ocptip.placement.place import place

    say_if_compiling()
    with progress_bar(sys.stderr) as progress:
        return place(task.problem, starts=options.starts, seed=options.seed, progress=progress)


def _check_numbers(options: argparse.Namespace) -> None:
    require_least(options, starts=1, seed=0)


def _written(report: PlaceReport | RefusalReport, directory: Path, *, figures: bool) -> OSError | None:
    """Write files and figures; an error is returned, not raised, so that the result is still printed."""
    from ocptip.placement.output import write_placement

    try:
        report.written.append(write_placement(directory, report.entries()))
        if figures:
            from ocptip.pictures.placement import draw_placement

            if sys.stderr.isatty():
                print("drawing ...", end="", file=sys.stderr, flush=True)
            report.written += draw_placement(directory, report.task.name, report.placements)
            if sys.stderr.isatty():
                print("\r\x1b[K", end="", file=sys.stderr, flush=True)
    except OSError as error:
        return error
    return None


def _json(entries: dict[str, Any], written: list[Path]) -> str:
    return json.dumps({**entries, "written": [str(path) for path in written]}, indent=2, allow_nan=False)


def _where(placement: Placement) -> str:
    """Parameters as people read them: "x 1.028 m, y 0.228 m, angle 33.6 deg"."""
    import numpy as np

    terrain = placement.problem.terrain[placement.patch]
    parts = [
        f"{name} {np.rad2deg(value):.1f} deg" if angular else f"{name} {value:.3f} m"
        for name, value, angular in zip(
            terrain.parameters, placement.parameters, terrain.angular, strict=True
        )
    ]
    return ", ".join(parts)


def _alternative(placement: Placement, earlier: tuple[Placement, ...]) -> str:
    """Total, place and criteria; for a place that was listed before only its number."""
    import numpy as np

    for number, other in enumerate(earlier, 1):
        apart = np.linalg.norm(placement.base_position - other.base_position)
        if apart < _SAME and np.linalg.norm(placement.base_rotation - other.base_rotation) < _SAME:
            return f"total {placement.total:.4f} at the place of no. {number}, with other joint angles"
    terrain = placement.problem.terrain
    on = f" on {terrain[placement.patch].name}" if len(terrain) > 1 else ""
    values = ", ".join(f"{name} {_value(name, placement)}" for name in placement.criteria)
    return f"total {placement.total:.4f}{on} at {_where(placement)}; {values}"


def _pose_lines(placement: Placement) -> list[tuple[str, str]]:
    import numpy as np
    from scipy.spatial.transform import Rotation

    problem = placement.problem
    x, y, z = placement.base_position + 0.0
    roll, pitch, yaw = Rotation.from_matrix(placement.base_rotation).as_euler("xyz", degrees=True) + 0.0
    lines = [
        ("place", f"{problem.terrain[placement.patch].name}: {_where(placement)}"),
        (
            "base",
            f"origin ({x:.3f}, {y:.3f}, {z:.3f}) m in the world, "
            f"roll {roll:.1f}, pitch {pitch:.1f}, yaw {yaw:.1f} deg",
        ),
    ]
    for task, q in zip(problem.tasks, placement.angles, strict=True):
        angles = " ".join(f"{value:.2f}" for value in np.rad2deg(q) + 0.0)
        lines.append(("joints", f"{angles} deg" + (f"  {task.name}" if len(problem.tasks) > 1 else "")))
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
        unit, scale = "deg", 180 / math.pi
    value, limit, unit = scale * margin.value, scale * margin.limit, f" {unit}" if unit else ""
    sign = "<=" if margin.upper else ">="
    room = abs(limit - value)
    return (
        f"{margin.kind + ':':<15} {value:.4g} {sign} {limit:.4g}{unit}, room {room:.3g}{unit}: {margin.name}"
    )
