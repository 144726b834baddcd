"""`ocptip rate --along MOTION.csv`: indices along a motion, their least values and where they are."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, naming
from ocptip.basics.read import read_text
from ocptip.basics.write import file_target, versions
from ocptip.cli.command import Report
from ocptip.cli.layout import table
from ocptip.indices.arms.values import index_values
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.parallel_robots import ParallelIndices
from ocptip.indices.platforms.platform import PlatformFile
from ocptip.indices.platforms.rate import RatedPose
from ocptip.indices.workspace_maps import arm_indices, chosen_indices, platform_indices
from ocptip.parallel.analysis.workspace import LENGTHS
from ocptip.parallel.robot import ParallelRobot
from ocptip.robots.model import ArmModel
from ocptip.trajectories.read_csv import csv_table

_SINGULAR = 1e-3
_UNITS = {"deg": np.pi / 180.0, "rad": 1.0, "m": 1.0}


@dataclass
class AlongReport(Report):
    """Indices (N,) over times (N,), s.

    Attributes:
        robot: its name.
        times: s; of a file without times, row numbers from 0.
        values: by name.
        regularity: (N,) how far the poses are from singular ones: 0 there.
        figure: where its picture goes.
    """

    robot: str
    times: np.ndarray
    values: dict[str, np.ndarray]
    regularity: np.ndarray
    figure: Path | None

    @property
    def good(self) -> bool:
        """True if no pose is singular."""
        return bool(np.all(self.regularity > _SINGULAR))

    def write(self) -> Iterator[Path]:
        """The figure."""
        if self.figure:
            from ocptip.pictures.workspace import save_indices

            yield save_indices(self.robot, self.times, self.values, self.figure)

    def to_dict(self) -> dict[str, Any]:
        """Least, mean and largest values, and when the least ones are."""
        return {
            "robot": self.robot,
            "poses": len(self.times),
            "indices": {
                name: {
                    "minimum": float(np.nanmin(v)),
                    "at_s": float(self.times[np.nanargmin(v)]),
                    "mean": float(np.nanmean(v)),
                    "maximum": float(np.nanmax(v)),
                }
                for name, v in self.values.items()
            },
            "written": self.written,
            "versions": versions(),
        }

    def to_text(self) -> str:
        """A table."""
        rows = [["index", "least", "at [s]", "mean", "largest"]]
        for name, one in self.to_dict()["indices"].items():
            numbers = (one["minimum"], one["at_s"], one["mean"], one["maximum"])
            rows.append([name, *(f"{number:.4g}" for number in numbers)])
        state = "regular" if self.good else "PASSES A SINGULAR POSE"
        lines = [f"{self.robot}: {len(self.times)} poses, {state}.", "", *table(rows, left=(0,))]
        return "\n".join([*lines, *(f"wrote {path}" for path in self.written)])


def rate_along(
    robot: ArmModel | ParallelRobot | PlatformFile, options: Namespace, ellipsoid: OperationEllipsoid | None
) -> AlongReport:
    """Indices of every row of the file `--along`.

    Raises:
        InputError: the file lacks a column of positions, or a pose is out of reach; names the row.
    """
    figure = None
    if options.plot:
        with naming("--plot"):
            figure = file_target(options.plot, (".png", ".pdf", ".svg"))
    if isinstance(robot, ArmModel):
        return _along_arm(robot, options, ellipsoid, figure)
    if isinstance(robot, ParallelRobot):
        name, indices = robot.description.name, ParallelIndices(robot, ellipsoid)
        turns = [name not in LENGTHS for name in robot.description.platform.coordinates]
        names, regular = chosen_indices(options.index, indices.usual, indices.names), ("platform", "legs")
        rate = indices.values
    else:
        name, turns, tool = robot.platform.name, [False] * 3 + [True] * 3, ellipsoid or robot.ellipsoid
        names = platform_indices(options.index, tool)
        regular, rate = ("ctn",), partial(_rate_platform, robot, tool)
    times, poses = _poses(options.along, turns)
    found = []
    for row, pose in enumerate(poses, start=1):
        with naming(f"{options.along}: row {row}"):
            found.append(rate(pose, (*names, *regular)))
    values = {key: np.array([one[key] for one in found]) for key in (*names, *regular)}
    least = np.min([values[key] for key in regular], axis=0)
    return AlongReport(name, times, {key: values[key] for key in names}, least, figure)


def _rate_platform(
    file: PlatformFile, ellipsoid: OperationEllipsoid | None, pose: np.ndarray, names: Iterable[str]
) -> dict[str, float]:
    turn = Rotation.from_rotvec(pose[3:]).as_matrix()
    return RatedPose(file.platform, pose[:3], turn, ellipsoid).values(names)


def _along_arm(
    model: ArmModel, options: Namespace, ellipsoid: OperationEllipsoid | None, figure: Path | None
) -> AlongReport:
    times, poses = _poses(options.along, [not slides for slides in model.prismatic])
    names, regular = arm_indices(options.index), "dm_2" if model.n == 6 else "inv_cdn_oe"
    values = index_values(model, poses, ellipsoid=ellipsoid, names=(*names, regular))
    return AlongReport(model.name, times, {name: values[name] for name in names}, values[regular], figure)


def _poses(file: str, turns: Sequence[bool]) -> tuple[np.ndarray, np.ndarray]:
    """Times (N,) and positions (N, n), rad and m, of the columns q1_deg, q2_m, ..., as plans write them."""
    text = read_text(Path(file))
    with naming(file):
        header, cells = csv_table(text)
        columns = []
        for number, turn in enumerate(turns, start=1):
            units = ("deg", "rad") if turn else ("m",)
            names = [f"q{number}_{unit}" for unit in units]
            here = [name for name in names if name in header]
            if not here:
                raise InputError(f"expected a column {' or '.join(names)}, there are {', '.join(header[:8])}")
            scale = _UNITS[here[0].rpartition("_")[2]]
            columns.append(scale * cells[:, header.index(here[0])])
    times = cells[:, header.index("time_s")] if "time_s" in header else np.arange(len(cells), dtype=float)
    return times, np.column_stack(columns)
