"""`ocptip chart`: load, tilt and push charts of a robot, as text, files and a figure."""

from __future__ import annotations

import sys
from argparse import Namespace
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ocptip.api.chart import chart
from ocptip.api.results.chart import LoadChart
from ocptip.api.tasks import load_task
from ocptip.basics.text import quantity, table
from ocptip.cli.command import FolderReport
from ocptip.cli.layout import brief_notes, fitted, headlines, masses, under
from ocptip.cli.options import given_tolerance, naming_options, output_directory, require_least, taken
from ocptip.cli.terminal import Progress
from ocptip.standing.within.design import BALLAST, FOOT_WIDTH, SPEED

_COLUMNS = 8  # of a table of 80 characters
_MANY = 100.0  # levels from here on are shown without decimals
_NOISE = 1e-9
_DESIGNS = {
    BALLAST: "by ballast [kg]",
    FOOT_WIDTH: "by foot width / present width",
    SPEED: "by speed override",
}


def run(options: Namespace) -> ChartReport:
    """Compute the charts of one task."""
    require_least(options, samples=1, seed=0, sectors=1)
    task = load_task(options.task)
    folder = output_directory(options, task.name + f"-{options.of}" * (options.of != "payload"))
    same = "of push_height joint_speed joint_acceleration levels cell most ballast foot_width speed_override"
    with naming_options(*same.split()):
        given = taken(options, f"samples seed sectors {same}")
        with Progress(sys.stderr, "drawing postures ...", what="postures") as progress:
            load_chart = chart(task, uncertainty=given_tolerance(options), progress=progress, **given)
    return ChartReport(
        load_chart, folder, not options.no_figures, yes=bool(load_chart.largest.kept_at_zero.any())
    )


@dataclass
class ChartReport(FolderReport):
    """The report of `ocptip chart`."""

    result: LoadChart

    def to_text(self) -> str:
        """The side view, the reaches by azimuth, and what limits the level."""
        result = self.result
        title, unit = result.raised.title, result.raised.unit
        head = "LOAD" if result.raised.name == "payload" else result.raised.name.upper()
        lines = [*headlines(f"{result.name}   {head} CHART, {result.scope}."), ""]
        if len(result.q):
            for key, posture in (("any_posture", "in any posture"), ("best_posture", "in the best posture")):
                lines += [
                    f"{title[0].upper()}{title[1:]} [{unit}],",
                    f"{posture}, by height and reach [m]",
                    *self._side(key),
                    "",
                ]
            for key, posture in (("any_posture", "in any posture"), ("best_posture", "in the best posture")):
                lines += [f"Largest reach [m] {posture}, by azimuth [deg]", *self._reaches(key), ""]
            for key, words in _DESIGNS.items():
                if any(one.quantity == key for one in result.designs):
                    name = result.raised.name.capitalize()
                    title = f"{name} [{unit}] that all postures up to a reach [m] keep, {words}"
                    lines += [title, *self._designs(key), ""]
            lines += fitted(self._notes())
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
                    rows.append([f"{one.value:.4g}", *map(_rounded_down, one.levels[part])])
            lines += table(rows, left=(0,))
        return lines

    def _reaches(self, key: str) -> list[str]:
        result = self.result
        middles = np.degrees((result.edges[0][:-1] + result.edges[0][1:]) / 2)
        lines = []
        for begin in range(0, len(middles), _COLUMNS):
            part = slice(begin, begin + _COLUMNS)
            rows = [[result.raised.name, *(f"{middle:.4g}" for middle in middles[part])]]
            for one in result.reaches:
                rows.append(
                    [quantity(one.level, result.raised.unit, 3), *map(_metres, getattr(one, key)[part])]
                )
            lines += table(rows, left=(0,))
        return lines

    def _notes(self) -> list[tuple[str, str]]:
        result, robot = self.result, self.result.robot
        names, counts = np.unique(result.largest.limits, return_counts=True)
        order = np.argsort(-counts)
        shares = [f"{100 * counts[k] / len(result.q):.0f} % {result.largest.names[names[k]]}" for k in order]
        shares = [share for share in shares if not share.startswith("0 %")]
        rows = under("limited by", [*shares, "(per cent of the postures)"])
        if result.equally_compliant:
            rows.append(("note", "contacts differ in friction: its use is that of equally compliant ones"))
        if result.broken:
            rows.append(("note", f"{result.broken} postures break a limit without any {result.raised.name}"))
        tolerance = result.limits.tolerance
        rows += under("uncertainty", tolerance.lines() if self.verbose else [])
        rows += [("robot", masses(robot))] if self.verbose else []
        rows += under("assumed", brief_notes(robot.notes, self.verbose))
        rows.append(("not covered", ", ".join(result.not_covered)))
        if result.ignored:
            rows += under("", result.ignored)
        return rows


def _rounded_down(level: float | None) -> str:
    """A level: a chart must not promise more than there is; a dot: no posture."""
    if level is None:
        return "."
    digits = 1 if level < _MANY else 0
    return f"{np.floor(level * 10**digits + _NOISE) / 10**digits:.{digits}f}"


def _metres(reach: float | None) -> str:
    """A reach, m, rounded down; a dot: no posture, or none that holds the payload."""
    return "." if reach is None else f"{np.floor(100 * reach + _NOISE) / 100:.2f}"
