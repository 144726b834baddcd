"""`ocptip cell`: finds where a base should stand for a cycle, and plans the cycle there."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

from ocptip import pictures
from ocptip.api.methods import of_segments
from ocptip.api.results.plan import Plan
from ocptip.api.tasks import load_task
from ocptip.basics.errors import naming
from ocptip.basics.outputs import OUTPUTS, remove_figures, require_replaceable
from ocptip.basics.text import quantity, table
from ocptip.basics.write import versions, write_json
from ocptip.cli.command import Answer, Report
from ocptip.cli.layout import summary, under
from ocptip.cli.many import digest_of
from ocptip.cli.options import given_tolerance, output_directory, require_least, taken
from ocptip.cli.place.place import refusal_lines, where_text
from ocptip.cli.plan.plan_report import PlanReport
from ocptip.motion.cycles.task import CycleTask
from ocptip.placement.for_cycle import CyclePlacement, CyclePlacements, place_for_cycle
from ocptip.placement.output import refusal_to_dict
from ocptip.placement.result import NoPlacementError
from ocptip.standing.tolerance import DEFAULT
from ocptip.task_files.cell import CellTask, load_cell

PLAN_FOLDER = "plan"


def run(options: Namespace) -> Report:
    """Place and plan; where there is no place or no plan, the report says why."""
    require_least(options, starts=1, seed=0, jobs=1, places=1)
    least = taken(options, "objective price_per_second")
    cell = load_cell(options.task, DEFAULT)
    if tolerance := given_tolerance(options):
        cell = cell.within(tolerance)
    load_task(cell.cycle, **least)  # complains before anything is computed
    directory = output_directory(options, cell.name)
    source = cell.cycle.source
    with naming("--out"):
        further = source.places if source else ()
        require_replaceable(directory / PLAN_FOLDER, "plan", further, overwrite=options.overwrite)
    say = partial(print, file=sys.stderr)
    try:
        cycle_placements = place_for_cycle(
            cell.problem,
            lambda placement: cast(CycleTask, load_task(cell.placed(placement), **least)),
            candidates=options.places,
            **taken(options, "starts seed jobs"),
            progress=say,
            segment=of_segments(None, options.seed, say),
        )
    except NoPlacementError as error:
        head, lines = refusal_lines(error)
        return Answer(
            summary(f"{cell.name}: {head}", lines, []), refusal_to_dict(cell.name, error), yes=False
        )
    except KeyboardInterrupt:
        raise KeyboardInterrupt("before there was a result") from None
    best = None
    if cycle_placements.best.plan is not None and cycle_placements.best.verified:
        plan, folder = cycle_placements.best.plan, directory / PLAN_FOLDER
        digest = digest_of(plan.task.source, options)
        best = PlanReport(Plan.of(plan), folder, not options.no_figures, digest=digest)
    return CellReport(cell, cycle_placements, best, directory, not options.no_figures)


@dataclass
class CellReport(Report):
    """Ranked places, and the plan at the best one.

    Attributes:
        cell: the task.
        found: from `place_for_cycle`.
        best: what `plan` says at the best place; None: no place has a verified plan.
        directory: where files go.
        figures: whether figures are among them.
    """

    early = True
    cell: CellTask
    result: CyclePlacements
    best: PlanReport | None
    directory: Path
    figures: bool = True

    @property
    def good(self) -> bool:
        """True if the best place has a verified plan."""
        return self.best is not None and self.best.good

    def entries(self) -> dict[str, Any]:
        """Content of cell.json."""
        return {
            "task": self.cell.name,
            "verified": self.good,
            "objective": self.cell.cycle.objective.to_dict(),
            "tolerance": self.cell.tolerance.to_table(),
            "places": [one.to_dict() for one in self.result.ranked],
            "ranked_for_best_sharing": self.result.static.problem.if_alike is not None,
            "plan": f"{PLAN_FOLDER}/plan.json" if self.best else None,
            "seed": self.result.static.seed,
            "seconds_static": self.result.static.seconds,
            "warnings": self.warnings,
            "versions": versions(),
        }

    def to_dict(self) -> dict[str, Any]:
        """The content of cell.json and the list `written`."""
        return {**self.entries(), "written": self.written}

    def write(self) -> Iterator[Path]:
        """Write cell.json, the figure of the places, and the folder of the plan."""
        self.directory.mkdir(exist_ok=True)
        path = self.directory / OUTPUTS["cell"][0]
        write_json(path, self.entries())
        yield path
        remove_figures(self.directory, "cell")
        if self.figures:
            yield from pictures.placement.draw_places(
                self.directory, self._title(), [p.placement for p in self.result.ranked]
            )
        if self.best:
            yield from self.best.write()

    def _title(self) -> str:
        best = self.result.best
        if best.plan is None or self.best is None:
            return f"{self.cell.name}: no verified cycle"
        return f"{self.cell.name}: {best.plan.energy:.1f} J in {best.plan.duration:.3f} s at the best place"

    def to_text(self) -> str:
        """The ranked places, then what `plan` says of the best one."""
        head = "\n".join([self._title(), "", *_table(self.result.ranked), ""])
        lines = under(
            "refused", [f"place {k}: {p.refusal}" for k, p in enumerate(self.result.ranked, 1) if p.refusal]
        )
        lines.append(("tolerance", str(self.cell.tolerance)))
        if self.cell.problem.tolerance.given:
            lines.append(("", f"of it at rest, in the search for places: {self.cell.problem.tolerance}"))
        else:
            lines.append(("", "none of it in the search for places"))
        if self.result.static.problem.if_alike is not None:
            lines.append(("at rest", "equally compliant feet slip everywhere; this is the best sharing"))
        if self.best is None:
            return summary(head, lines, self.written)
        self.best.written, self.best.verbose = self.written, self.verbose
        return "\n".join([summary(head, lines, []), "", self.best.to_text()])


def _table(ranked: tuple[CyclePlacement, ...]) -> list[str]:
    """One row per place."""
    rows = [["", "place", "total at rest", "energy", "time", "rest postures", ""]]
    for number, one in enumerate(ranked, 1):
        placement, plan = one.placement, one.plan if one.verified else None
        name = placement.problem.terrain[placement.patch].name
        rows.append(
            [
                f"{number}",
                f"{name}: {where_text(placement)}",
                f"{placement.total:.4f}",
                quantity(plan.energy, "J") if plan else "-",
                f"{plan.duration:.3f} s" if plan else "-",
                "sampled" if one.sampled else "optimum",
                "" if plan else "NO VERIFIED PLAN",
            ]
        )
    return table(rows, left=(0, 1))
