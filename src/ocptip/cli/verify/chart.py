"""`ocptip chart`: load charts of a robot at rest, as text, files and a figure."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ocptip.api.chart import NOT_COVERED, LoadChart, chart
from ocptip.api.tasks import load_task
from ocptip.basics.text import quantity, table
from ocptip.cli.command import FolderReport
from ocptip.cli.layout import masses, named, under
from ocptip.cli.options import given_tolerance, naming_options, output_directory, require_least, taken
from ocptip.standing.within.design import BALLAST, FOOT_WIDTH

_COLUMNS = 8  # of a table of 80 characters
_MANY = 100.0  # kg: payloads from here on are shown without decimals
_NOISE = 1e-9


def run(options: Namespace) -> ChartReport:
    """Compute the charts of one task."""
    require_least(options, samples=1, seed=0, sectors=1)
    task = load_task(options.task)
    folder = output_directory(options, task.name)
    with naming_options("payloads", "cell", "most", "ballast", "foot_width"):
        same = taken(options, "samples seed payloads sectors cell most ballast foot_width")
        load_chart = chart(task, uncertainty=given_tolerance(options), **same)
    return ChartReport(load_chart, folder, not options.no_figures, yes=bool(load_chart.held.unloaded.any()))


@dataclass
class ChartReport(FolderReport):
    """The report of `ocptip chart`."""

    result: LoadChart

    def to_text(self) -> str:
        """The side view, the reaches by azimuth, and what limits the payload."""
        result = self.result
        lines = [f"{result.name}   LOAD CHART, {result.scope}.", ""]
        if len(result.q):
            for key, title in (("any_posture", "in any posture"), ("best_posture", "in the best posture")):
                lines += [f"Largest payload [kg] {title}, by height and reach [m]", *self._side(key), ""]
            for key, title in (("any_posture", "in any posture"), ("best_posture", "in the best posture")):
                lines += [f"Largest reach [m] {title}, by azimuth [deg]", *self._reaches(key), ""]
            for key, unit in ((BALLAST, "kg of ballast"), (FOOT_WIDTH, "times the foot width")):
                if any(one.quantity == key for one in result.designs):
                    title = f"Payload [kg] that all postures up to a reach [m] hold, with {unit}"
                    lines += [title, *self._designs(key), ""]
            lines += named(self._notes())
        else:
            lines += ["Every posture drawn collides, or comes nearer than the clearance."]
        return "\n".join([*lines, *(f"wrote {path}" for path in self.written)])

    def _side(self, key: str) -> list[str]:
        """Heights from top to bottom, reaches from left to right."""
        result = self.result
        cells = {(one.height, one.reach): getattr(one, key) for one in result.cells(azimuth=False)}
        reaches, heights = (list(pairwise(edges.tolist())) for edges in result.edges[1:])
        lines = []
        for begin in range(0, len(reaches), _COLUMNS):
            shown = reaches[begin : begin + _COLUMNS]
            rows = [["height \\ reach", *(f"to {end:.4g}" for _, end in shown)]]
            for low, high in reversed(heights):
                here = [_rounded_down(cells.get(((low, high), reach))) for reach in shown]
                rows.append([f"{low + 0.0:.4g} to {high + 0.0:.4g}", *here])
            lines += table(rows, left=(0,))
        return lines

    def _designs(self, quantity: str) -> list[str]:
        result, lines = self.result, list[str]()
        ends = result.edges[1][1:].tolist()
        for begin in range(0, len(ends), _COLUMNS):
            part = slice(begin, begin + _COLUMNS)
            rows = [["", *(f"to {end:.4g}" for end in ends[part])]]
            for one in result.designs:
                if one.quantity == quantity:
                    rows.append([f"{one.value:.4g}", *map(_rounded_down, one.payloads[part])])
            lines += table(rows, left=(0,))
        return lines

    def _reaches(self, key: str) -> list[str]:
        result = self.result
        middles = np.degrees((result.edges[0][:-1] + result.edges[0][1:]) / 2)
        lines = []
        for begin in range(0, len(middles), _COLUMNS):
            part = slice(begin, begin + _COLUMNS)
            rows = [["payload", *(f"{middle:.4g}" for middle in middles[part])]]
            for one in result.reaches:
                rows.append([quantity(one.payload, "kg", 3), *map(_metres, getattr(one, key)[part])])
            lines += table(rows, left=(0,))
        return lines

    def _notes(self) -> list[tuple[str, str]]:
        result, robot = self.result, self.result.robot
        names, counts = np.unique(result.held.limits, return_counts=True)
        order = np.argsort(-counts)
        shares = [f"{100 * counts[k] / len(result.q):.0f} % {result.held.names[names[k]]}" for k in order]
        shares = [share for share in shares if not share.startswith("0 %")]
        limits = [", ".join(shares[k : k + 2]) for k in range(0, len(shares), 2)]
        rows = under("limited by", [*limits, "(per cent of the postures)"])
        if result.broken:
            rows.append(("note", f"{result.broken} postures break a limit without any payload: 0 kg"))
        tolerance = result.limits.tolerance
        rows += under("uncertainty", tolerance.lines() if self.verbose else [])
        rows += [("robot", masses(robot))] if self.verbose else []
        rows.append(("not covered", ", ".join(NOT_COVERED)))
        if result.ignored:
            rows += under("", [f"at rest: {one}" for one in result.ignored])
        return rows


def _rounded_down(mass: float | None) -> str:
    """A payload, kg: a load chart must not promise more than there is; a dot: no posture."""
    if mass is None:
        return "."
    digits = 1 if mass < _MANY else 0
    return f"{np.floor(mass * 10**digits + _NOISE) / 10**digits:.{digits}f}"


def _metres(reach: float | None) -> str:
    """A reach, m, rounded down; a dot: no posture, or none that holds the payload."""
    return "." if reach is None else f"{np.floor(100 * reach + _NOISE) / 100:.2f}"
