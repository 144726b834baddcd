"""`ocptip rate --along MOTION.csv`: indices along a motion, their minima and where they are."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocptip.api.rate import Rated, RatedMotion, rate_along
from ocptip.basics.errors import naming
from ocptip.basics.text import table
from ocptip.basics.write import file_target, versions
from ocptip.cli.command import Report
from ocptip.indices.metric import OperationEllipsoid


@dataclass
class AlongReport(Report):
    """The report of indices along a motion.

    Attributes:
        found: the indices.
        figure: where their picture goes.
    """

    found: RatedMotion
    figure: Path | None

    @property
    def good(self) -> bool:
        """True if no pose is singular."""
        return self.found.regular

    def write(self) -> Iterator[Path]:
        """The figure."""
        if self.figure:
            yield self.found.save(self.figure)

    def to_dict(self) -> dict[str, Any]:
        """Minimum, mean and maximum values, and the times of the minima."""
        return {**self.found.to_dict(), "written": self.written, "versions": versions()}

    def to_text(self) -> str:
        """A table."""
        found, rows = self.found, [["index", "least", "at [s]", "mean", "largest"]]
        for name, one in found.to_dict()["indices"].items():
            numbers = (one["minimum"], one["at_s"], one["mean"], one["maximum"])
            rows.append([name, *("-" if number is None else f"{number:.4g}" for number in numbers)])
        state = "regular" if self.good else "PASSES A SINGULAR POSE"
        lines = [f"{found.robot}: {len(found.times)} poses, {state}.", "", *table(rows, left=(0,))]
        return "\n".join([*lines, *(f"wrote {path}" for path in self.written)])


def along_report(robot: Rated, options: Namespace, ellipsoid: OperationEllipsoid | None) -> AlongReport:
    """Indices of every row of the file `--along`."""
    figure = None
    if options.plot:
        with naming("--plot"):
            figure = file_target(options.plot, (".png", ".pdf", ".svg"))
    return AlongReport(rate_along(robot, options.along, indices=options.index, ellipsoid=ellipsoid), figure)
