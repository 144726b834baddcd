"""`ocptip rate`: all performance indices of an arm or a platform in a pose, with their meaning."""

from __future__ import annotations

import math
import sys
import textwrap
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from ocptip import pictures
from ocptip.api.rate import (
    URDF_SUFFIXES,
    Kind,
    Rated,
    RatedMotion,
    Rating,
    kind_of,
    rate,
    rate_along,
    rate_workspace,
    rated_robot,
)
from ocptip.basics.errors import InputError, bounded_array, naming
from ocptip.basics.text import table
from ocptip.basics.write import file_target, versions
from ocptip.cli.command import Answer, Report, ResultReport
from ocptip.cli.layout import named
from ocptip.cli.options import naming_options
from ocptip.cli.poses_and_closed_chains.parallel import grid_ranges, size_of_grid, with_ranges
from ocptip.cli.terminal import Progress
from ocptip.indices.meanings import IndexEntry
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.workspace_maps import IndexMaps
from ocptip.parallel.analysis.workspace import LENGTHS
from ocptip.parallel.robot import ParallelRobot
from ocptip.robots.model import ArmModel
from ocptip.robots.payload import Payload
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.robots.urdf.file import read_urdf
from ocptip.task_files.parallel import read_robot

_WIDTH = 110
_URDF_OPTIONS = ("base_link", "tool_frame", "lock")


def run(options: Namespace) -> Report:
    """Rate the arm or the platform in its pose, along a motion, or over a workspace."""
    _refuse_together(options)
    over = bool(options.along or options.workspace)
    kind = kind_of(options.robot, several=over)
    _refuse_others(options, kind, over)
    robot, pose, ellipsoid = _robot_and_pose(options, kind)
    if options.along:
        return along_report(robot, options, ellipsoid)
    if options.workspace:
        return workspace_report(robot, pose, options, ellipsoid)
    if kind == "arm" and options.rates is not None and len(options.rates) != robot.n:
        raise InputError(f"--rates: {robot.name} has {robot.n} joints, got {len(options.rates)} rates")
    return _answer(rate(robot, pose, rates=options.rates, ellipsoid=ellipsoid))


def _refuse_others(options: Namespace, kind: Kind, over: bool) -> None:
    """Refuse options that robots of this kind do not have."""
    tool = () if over else ("ellipsoid", "center")
    names, why = {
        "parallel": (("rates", "payload", *tool, *_URDF_OPTIONS), "not for parallel robots"),
        "platform": (("rates", "payload", "range", *_URDF_OPTIONS), "not for platforms"),
        "arm": (("range",), "not for arms, whose file has the ranges"),
    }[kind]
    _refuse_given(options, names, why)


def _robot_and_pose(
    options: Namespace, kind: Kind
) -> tuple[Any, np.ndarray | None, OperationEllipsoid | None]:
    """The robot with what the options change, its pose, m and rad, and the ellipsoid that is typed."""
    typed, pose = options.pose, None
    asked = not options.along and (typed or kind == "arm")
    if kind == "arm":
        robot = _arm(options).with_payload(_payload(options))
        if asked and len(typed) != robot.n:
            raise InputError(f"POSE: {robot.name} has {robot.n} joints, got {len(typed)} angles (degrees)")
        pose = np.radians(bounded_array("POSE", typed, (robot.n,))) if asked else None
    elif kind == "platform":
        robot = rated_robot(options.robot, kind)
        if asked and len(typed) != 6:
            text = f"a platform needs x y z (m), rotation vector (deg), got {len(typed)} numbers"
            raise InputError(f"POSE: {text}")
        if asked:
            values = bounded_array("POSE", typed, (6,))
            pose = np.append(values[:3], np.radians(values[3:]))
    else:
        description = read_robot(options.robot)
        robot = ParallelRobot(with_ranges(description, options.range) if options.range else description)
        names = robot.description.platform.coordinates
        if asked and len(typed) != len(names):
            raise InputError(f"POSE: expected {', '.join(names)} (m, degrees), got {len(typed)} numbers")
        turns = [one.startswith("phi") for one in names]
        pose = np.where(turns, np.radians(typed), typed) if asked else None
    return robot, pose, _ellipsoid(options)


def _lines(rating: Rating) -> list[tuple[str, str]]:
    """Rows about a pose beside the indices."""
    kind = rating.data["kind"]
    if kind == "parallel":
        return [("singular", ", ".join(rating.source) or "nothing")]
    if kind == "platform":
        screw = _numbers(rating.source.screw, 3)
        least = f"{screw}  (angular, linear velocity at the base origin)"
        return [("minimum control", least), ("legs close to", rating.source.lines)]
    model, rated = rating.source
    worst = _numbers(rated.operation.worst_rates, 3)
    lines = [("worst rates", f"{worst}  (joint rates of the minimum tool motion)")]
    if rated.distance is not None and rated["dm_2"].status == "ok":
        step = _numbers(np.degrees(rated.distance.step_2), 1)
        lines.append(("shortest path", f"{step}  deg of joints 2 to 5 to the singularity (linearised)"))
    half_axes, center = rated.ellipsoid.half_axes, rated.ellipsoid.center
    lines.append(
        ("ellipsoid", f"half-axes {_numbers(half_axes, 4)} m, centre {_numbers(center, 4)} m, gripper frame")
    )
    if outside := rating.data["outside_limits"]:
        lines.append(("note", f"outside of the joint limits: joint {', '.join(map(str, outside))}"))
    if model.payload:
        lines.append(("payload", f"{model.payload.mass:.4g} kg, {model.payload}"))
    return lines


def _arm(options: Namespace) -> ArmModel:
    if Path(options.robot).suffix.lower() not in URDF_SUFFIXES:
        _refuse_given(options, _URDF_OPTIONS, "only for URDF files")
        return cast(ArmModel, rated_robot(options.robot, "arm"))
    wanted, file = [_lock(text) for text in options.lock], read_urdf(options.robot)
    locked: dict[str, float] = {}
    for slides in (False, True):
        try:
            given = {name: value for name, value, way in wanted if way == slides}
            locked |= file.locked(given, slides=slides)
        except InputError as error:
            raise InputError(f"--lock: {error}") from None
    names = {"base_link": options.base_link, "tool_frame": options.tool_frame}
    # Most indices need no masses; those that do say what is missing.
    with naming_options(*names):
        return arm_from_urdf(options.robot, **names, locked_joints=locked, accept_inertia=True)


def _payload(options: Namespace) -> Payload | None:
    if options.payload is None:
        return None
    mass, *place = options.payload
    if len(place) not in (0, 3):
        raise InputError(f"--payload: expected KG or KG X Y Z, got {len(options.payload)} numbers")
    try:
        return Payload(mass, np.array(place or [0.0, 0.0, 0.0]))
    except InputError as error:
        raise InputError(f"--payload: {error}") from None


def _refuse_together(options: Namespace) -> None:
    """Refuse options that need others, or exclude each other."""
    if options.along and options.workspace:
        raise InputError("--workspace: not together with --along")
    for name in ("plot", "index"):
        if getattr(options, name) and not (options.along or options.workspace):
            raise InputError(f"--{name}: needs --along or --workspace")
    for name in ("cells", "range"):
        if getattr(options, name) is not None and not options.workspace:
            raise InputError(f"--{name}: needs --workspace")


def _refuse_given(options: Namespace, names: Sequence[str], why: str) -> None:
    for name in names:
        if getattr(options, name):
            raise InputError(f"--{name.replace('_', '-')}: {why}")


def _lock(text: str) -> tuple[str, float, bool]:
    """Joint and angle ("elbow=30", degrees) in rad, or position ("lift=0.2m") in m; whether it is such."""
    name, _, value = text.partition("=")
    try:
        if not name:
            raise ValueError
        slides = value.endswith("m")
        return name, float(value[:-1]) if slides else math.radians(float(value)), slides
    except ValueError:
        raise InputError(f"--lock: expected JOINT=DEGREES or JOINT=LENGTHm, got {text!r}") from None


def _ellipsoid(options: Namespace) -> OperationEllipsoid | None:
    if options.ellipsoid is None:
        if options.center is not None:
            raise InputError("--center: needs --ellipsoid")
        return None
    center = np.array([0.0, 0.0, 0.0] if options.center is None else options.center)
    with naming("--ellipsoid"):
        return OperationEllipsoid(center=center, half_axes=options.ellipsoid)


def _answer(rating: Rating) -> Report:
    """Every index with its range and meaning, then the named lines."""
    rows = [("index", "value", "range", "meaning"), *map(_row, rating.entries)]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    text = [f"{rating.robot}: {'SINGULAR' if rating.singular else 'regular'} pose.", ""]
    for row in rows:
        head = "  ".join(f"{cell:<{width}}" for cell, width in zip(row[:3], widths, strict=True)) + "  "
        text.append(textwrap.fill(row[3], _WIDTH, initial_indent=head, subsequent_indent=" " * len(head)))
    text = "\n".join([*text, "", *named(_lines(rating))])
    return Answer(text, rating.to_dict(), yes=not rating.singular)


def _row(entry: IndexEntry) -> tuple[str, str, str, str]:
    """Symbol, value, range, meaning."""
    value = "infinite" if math.isinf(entry.value) else f"{entry.value + 0.0:.4g}"
    value = "-" if math.isnan(entry.value) else value if entry.unit == "1" else f"{value} {entry.unit}"
    upper = "inf" if math.isinf(entry.upper) else f"{entry.upper:.3g}"
    meaning = entry.meaning if entry.status == "ok" else f"{entry.meaning} ({entry.status})"
    return entry.symbol, value, f"{entry.lower:.3g} .. {upper}", meaning


def _numbers(values: np.ndarray, decimals: int) -> str:
    return ", ".join(f"{round(x, decimals) + 0.0:.{decimals}f}" for x in values)


@dataclass
class AlongReport(ResultReport):
    """The report of indices along a motion."""

    result: RatedMotion

    def to_dict(self) -> dict[str, Any]:
        """Minimum, mean and maximum values, and the times of the minima."""
        return {**self.result.to_dict(), "written": self.written, "versions": versions()}

    def to_text(self) -> str:
        """A table."""
        result, rows = self.result, [["index", "least", "at [s]", "mean", "largest"]]
        for name, one in result.to_dict()["indices"].items():
            numbers = (one["minimum"], one["at_s"], one["mean"], one["maximum"])
            rows.append([name, *("-" if number is None else f"{number:.4g}" for number in numbers)])
        state = "regular" if self.good else "PASSES A SINGULAR POSE"
        lines = [f"{result.robot}: {len(result.times)} poses, {state}.", "", *table(rows, left=(0,))]
        return "\n".join([*lines, *(f"wrote {path}" for path in self.written)])


def _figure(options: Namespace, *animations: str) -> Path | None:
    """The file of `--plot`, if it can be written."""
    with naming("--plot"):
        return file_target(options.plot, (".png", ".pdf", ".svg", *animations)) if options.plot else None


def along_report(robot: Rated, options: Namespace, ellipsoid: OperationEllipsoid | None) -> AlongReport:
    """Indices of every row of the file `--along`."""
    figure = _figure(options, *pictures.movie.SUFFIXES)
    rated = rate_along(robot, options.along, indices=options.index, ellipsoid=ellipsoid)
    return AlongReport(rated, figure, yes=rated.regular)


@dataclass
class MapsReport(ResultReport):
    """Indices over a workspace."""

    result: IndexMaps

    def write(self) -> Iterator[Path]:
        """The figure."""
        if self.out is not None:
            yield pictures.workspace.save_workspace(self.result, self.out)

    def to_dict(self) -> dict[str, Any]:
        """Minimum, mean and maximum values, and where the maxima are."""
        return {**self.result.to_dict(), "written": self.written, "versions": versions()}

    def to_text(self) -> str:
        """A table."""
        result = self.result
        cells = " x ".join(map(str, result.inside.shape))
        share = f"{100 * result.inside.mean():.1f} % inside"
        lines = [
            f"{result.robot}: {', '.join(result.names)}; {size_of_grid(result.names, result.size)}, {share} "
            f"({cells} cells)."
        ]
        if result.crosses:
            lines.append("SINGULAR: the singularity surface passes between poses inside.")
        units = [f"{name} [{'m' if name in LENGTHS else 'deg'}]" for name in result.names]
        rows = [["index", "unit", "least", "mean", "largest", f"largest at {', '.join(units)}"]]
        for name, one in result.to_dict()["indices"].items() if result.inside.any() else ():
            numbers = [one[key] for key in ("minimum", "mean", "maximum")]
            shown = ["-" if number is None else f"{number:.4g}" for number in numbers]
            rows.append([name, result.meanings[name].unit, *shown, self._place(one["best_at"])])
        lines += ["", *table(rows, left=(0, 1))]
        return "\n".join([*lines, *(f"wrote {path}" for path in self.written)])

    def _place(self, best: list[float] | None) -> str:
        if best is None:
            return "-"
        names = self.result.names
        values = [
            value if name in LENGTHS else np.degrees(value) for name, value in zip(names, best, strict=True)
        ]
        return ", ".join(f"{round(value, 4) + 0.0:.4g}" for value in values)


def workspace_report(
    robot: Rated, pose: np.ndarray | None, options: Namespace, ellipsoid: OperationEllipsoid | None
) -> MapsReport:
    """Indices over the grid that `--workspace` and `--cells` ask for, about a pose."""
    figure = _figure(options)
    with Progress(sys.stderr, "computing the poses ...", what="poses") as progress:
        index_maps = rate_workspace(
            robot,
            grid_ranges(options.workspace),
            pose=pose,
            indices=options.index,
            cells=40 if options.cells is None else options.cells,
            ellipsoid=ellipsoid,
            progress=progress,
        )
    return MapsReport(index_maps, figure, yes=bool(index_maps.inside.any()) and not index_maps.crosses)
