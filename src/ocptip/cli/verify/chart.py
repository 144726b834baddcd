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
        found = chart(task, uncertainty=given_tolerance(options), **same)
    return ChartReport(found, folder, not options.no_figures, yes=bool(found.held.unloaded.any()))


@dataclass
class ChartReport(FolderReport):
    """The report of `ocptip chart`."""

    found: LoadChart

    def to_text(self) -> str:
        """The side view, the reaches by azimuth, and what limits the payload."""
        found = self.found
        lines = [f"{found.name}   LOAD CHART, {found.scope}.", ""]
        if len(found.q):
            for key, title in (("any_posture", "in any posture"), ("best_posture", "in the best posture")):
                lines += [f"Largest payload [kg] {title}, by height and reach [m]", *self._side(key), ""]
            for key, title in (("any_posture", "in any posture"), ("best_posture", "in the best posture")):
                lines += [f"Largest reach [m] {title}, by azimuth [deg]", *self._reaches(key), ""]
            for key, unit in ((BALLAST, "kg of ballast"), (FOOT_WIDTH, "times the foot width")):
                if any(one.quantity == key for one in found.designs):
                    title = f"Payload [kg] that all postures up to a reach [m] hold, with {unit}"
                    lines += [title, *self._designs(key), ""]
            lines += named(self._notes())
        else:
            lines += ["Every posture drawn collides, or comes nearer than the clearance."]
        return "\n".join([*lines, *(f"wrote {path}" for path in self.written)])

    def _side(self, key: str) -> list[str]:
        """Heights from top to bottom, reaches from left to right."""
        found = self.found
        cells = {(one.height, one.reach): getattr(one, key) for one in found.cells(azimuth=False)}
        reaches, heights = (list(pairwise(edges.tolist())) for edges in found.edges[1:])
        lines = []
        for begin in range(0, len(reaches), _COLUMNS):
            own = reaches[begin : begin + _COLUMNS]
            rows = [["height \\ reach", *(f"to {end:.4g}" for _, end in own)]]
            for low, high in reversed(heights):
                here = [_rounded_down(cells.get(((low, high), reach))) for reach in own]
                rows.append([f"{low + 0.0:.4g} to {high + 0.0:.4g}", *here])
            lines += table(rows, left=(0,))
        return lines

    def _designs(self, quantity: str) -> list[str]:
        found, lines = self.found, list[str]()
        ends = found.edges[1][1:].tolist()
        for begin in range(0, len(ends), _COLUMNS):
            part = slice(begin, begin + _COLUMNS)
            rows = [["", *(f"to {end:.4g}" for end in ends[part])]]
            for one in found.designs:
                if one.quantity == quantity:
                    rows.append([f"{one.value:.4g}", *map(_rounded_down, one.payloads[part])])
            lines += table(rows, left=(0,))
        return lines

    def _reaches(self, key: str) -> list[str]:
        found = self.found
        middles = np.degrees((found.edges[0][:-1] + found.edges[0][1:]) / 2)
        lines = []
        for begin in range(0, len(middles), _COLUMNS):
            part = slice(begin, begin + _COLUMNS)
            rows = [["payload", *(f"{middle:.4g}" for middle in middles[part])]]
            for one in found.reaches:
                rows.append([quantity(one.payload, "kg", 3), *map(_metres, getattr(one, key)[part])])
            lines += table(rows, left=(0,))
        return lines

    def _notes(self) -> list[tuple[str, str]]:
        found, robot = self.found, self.found.robot
        names, counts = np.unique(found.held.limits, return_counts=True)
        order = np.argsort(-counts)
        shares = [f"{100 * counts[k] / len(found.q):.0f} % {found.held.names[names[k]]}" for k in order]
        shares = [share for share in shares if not share.startswith("0 %")]
        limits = [", ".join(shares[k : k + 2]) for k in range(0, len(shares), 2)]
        rows = under("limited by", [*limits, "(per cent of the postures)"])
        if found.broken:
            rows.append(("note", f"{found.broken} postures break a limit without any payload: 0 kg"))
        tolerance = found.limits.tolerance
        rows += under("uncertainty", tolerance.lines() if self.verbose else [])
        rows += [("robot", masses(robot))] if self.verbose else []
        rows.append(("not covered", ", ".join(NOT_COVERED)))
        if found.ignored:
            rows += under("", [f"at rest: {one}" for one in found.ignored])
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
