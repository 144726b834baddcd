"""`ocptip rate --workspace NAME=LOW:HIGH ...`: indices over a grid of poses."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.api.rate import Rated, rate_workspace
from ocptip.basics.errors import naming
from ocptip.basics.text import table
from ocptip.basics.write import file_target, versions
from ocptip.cli.command import Report
from ocptip.cli.parallel import grid_ranges, size_of_grid
from ocptip.cli.terminal import Progress
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.workspace_maps import IndexMaps
from ocptip.parallel.analysis.workspace import LENGTHS


@dataclass
class MapsReport(Report):
    """Indices over a workspace.

    Attributes:
        found: the maps.
        figure: where their picture goes.
    """

    found: IndexMaps
    figure: Path | None

    @property
    def good(self) -> bool:
        """True if poses are inside, and no singularity surface passes between them."""
        return bool(self.found.inside.any()) and not self.found.crosses

    def write(self) -> Iterator[Path]:
        """The figure."""
        if self.figure:
            from ocptip.pictures.workspace import save_workspace

            yield save_workspace(self.found, self.figure)

    def to_dict(self) -> dict[str, Any]:
        """Minimum, mean and maximum values, and where the maxima are."""
        return {**self.found.to_dict(), "written": self.written, "versions": versions()}

    def to_text(self) -> str:
        """A table."""
        found = self.found
        cells = " x ".join(map(str, found.inside.shape))
        share = f"{100 * found.inside.mean():.1f} % inside"
        lines = [
            f"{found.robot}: {', '.join(found.names)}; {size_of_grid(found.names, found.size)}, {share} "
            f"({cells} cells)."
        ]
        if found.crosses:
            lines.append("SINGULAR: the singularity surface passes between poses inside.")
        units = [f"{name} [{'m' if name in LENGTHS else 'deg'}]" for name in found.names]
        rows = [["index", "unit", "least", "mean", "largest", f"largest at {', '.join(units)}"]]
        for name, one in found.to_dict()["indices"].items() if found.inside.any() else ():
            numbers = [one[key] for key in ("minimum", "mean", "maximum")]
            shown = ["-" if number is None else f"{number:.4g}" for number in numbers]
            rows.append([name, found.meanings[name].unit, *shown, self._place(one["best_at"])])
        lines += ["", *table(rows, left=(0, 1))]
        return "\n".join([*lines, *(f"wrote {path}" for path in self.written)])

    def _place(self, best: list[float] | None) -> str:
        if best is None:
            return "-"
        names = self.found.names
        values = [
            value if name in LENGTHS else np.degrees(value) for name, value in zip(names, best, strict=True)
        ]
        return ", ".join(f"{round(value, 4) + 0.0:.4g}" for value in values)


def workspace_report(
    robot: Rated, pose: np.ndarray | None, options: Namespace, ellipsoid: OperationEllipsoid | None
) -> MapsReport:
    """Indices over the grid that `--workspace` and `--cells` ask for, about a pose."""
    figure = None
    if options.plot:
        with naming("--plot"):
            figure = file_target(options.plot, (".png", ".pdf", ".svg"))
    with Progress(sys.stderr, "computing the poses ...", what="poses") as progress:
        found = rate_workspace(
            robot,
            grid_ranges(options.workspace),
            pose=pose,
            indices=options.index,
            cells=40 if options.cells is None else options.cells,
            ellipsoid=ellipsoid,
            progress=progress,
        )
    return MapsReport(found, figure)
