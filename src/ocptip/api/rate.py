"""`ocptip.rate`: how good poses of arms, platforms and parallel robots are, one by one and over workspaces.

Poses of an arm are joint angles (rad, sliding joints m), those of a parallel robot its coordinates (m, rad).
A platform has a position (m) and a rotation vector (rad).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from ocptip import pictures
from ocptip.basics.errors import InputError, finite_array, naming
from ocptip.basics.read import read_text
from ocptip.basics.schema import ANY_FILE
from ocptip.basics.toml import Table
from ocptip.basics.write import versions, write_json
from ocptip.indices.arms.values import ARM_INDICES, index_values, rate_arm
from ocptip.indices.meanings import IndexEntry
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import singular_motion
from ocptip.indices.platforms.parallel_robots import ParallelIndices, platform_of_robot, rate_parallel
from ocptip.indices.platforms.reviewed import PlacedPlatform, rate_platform
from ocptip.indices.workspace_maps import (
    USUAL_OF_ARMS,
    IndexMaps,
    chosen_indices,
    index_maps,
    platform_indices,
)
from ocptip.parallel.analysis.workspace import LENGTHS
from ocptip.parallel.description.ready_made import READY_MADE, ups6
from ocptip.parallel.robot import ParallelRobot
from ocptip.published.arms import arm_by_name
from ocptip.robots.kinematics import link_frames
from ocptip.robots.model import ArmModel
from ocptip.robots.urdf.arm import arm_from_urdf
from ocptip.standing.arm import Robot
from ocptip.task_files.parallel import read_robot
from ocptip.task_files.platform_points import read_platform
from ocptip.task_files.tables.arm import arm_of_file
from ocptip.trajectories.read_csv import csv_table

Kind = Literal["arm", "platform", "parallel"]
Rated = Robot | ArmModel | ParallelRobot | PlacedPlatform | str | os.PathLike[str]
"""A robot: an object, the name of a ready-made one, a URDF, or a TOML file with a robot or a task."""

URDF_SUFFIXES = (".urdf", ".xml")
HEXAPOD = "6UPS"
"""Rated as a platform in one pose, as a parallel robot over several."""

_SINGULAR = 1e-3
_UNITS = {"deg": np.pi / 180.0, "rad": 1.0, "m": 1.0}


def rate(
    robot: Rated,
    pose: ArrayLike | None = None,
    *,
    rates: ArrayLike | None = None,
    ellipsoid: OperationEllipsoid | None = None,
) -> Rating:
    """Return all performance indices of a robot in a pose, with their meaning.

    Example::

        rating = ocptip.rate("FP1W2F", [0, 0.7, -1.05, 0.2, 0.9, 0.3])
        rating["dm_2"].value

    Args:
        robot: an object, the name of a published arm or of a ready-made parallel robot, a URDF, or a TOML
            file. What a gripper holds is part of an `ArmModel`.
        pose: (n,) rad and m; of arms required, of others the home pose by default.
        rates: (n,) joint rates of an arm for the index sigma.
        ellipsoid: operation ellipsoid; default as in `index_values`, of platforms as their file says.

    Raises:
        InputError: no such robot, or an argument does not fit it.
    """
    result = rated_robot(robot, kind_of(robot, several=False))
    if isinstance(result, ArmModel):
        if pose is None:
            raise InputError(f"pose: missing; {result.name} has {result.n} joints")
        q = finite_array("pose", pose, (result.n,))
        rating = rate_arm(result, q, ellipsoid=ellipsoid, rates=cast(Any, rates))
        limits = result.limits
        outside = (np.flatnonzero((q < limits.angle_min) | (q > limits.angle_max)) + 1).tolist()
        payload = result.payload.to_dict() if result.payload else None
        data = {**rating.to_dict(), "outside_limits": outside, "payload": payload}
        return Rating(result.name, rating.singular, rating.entries, data, (result, rating))
    if rates is not None:
        raise InputError("rates: of the joints of an arm only")
    if isinstance(result, ParallelRobot):
        return _rate_parallel(result, pose)
    return _rate_platform(result, pose, ellipsoid)


def _rate_parallel(robot: ParallelRobot, pose: ArrayLike | None) -> Rating:
    description = robot.description
    count = len(description.platform.coordinates)
    z = description.home if pose is None else finite_array("pose", pose, (count,))
    entries, kinds = rate_parallel(robot, z)
    data = {
        "robot": description.name,
        "kind": "parallel",
        "z": z.tolist(),
        "singular": bool(kinds),
        "kinds": list(kinds),
        "indices": [entry.to_dict() for entry in entries],
    }
    return Rating(description.name, bool(kinds), tuple(entries), data, kinds)


def _rate_platform(
    platform: PlacedPlatform, pose: ArrayLike | None, ellipsoid: OperationEllipsoid | None
) -> Rating:
    placed = platform.moved(None if pose is None else finite_array("pose", pose, (6,)), ellipsoid)
    entries = rate_platform(placed.platform, placed.position, placed.rotation, placed.ellipsoid)
    name, singular, motion = placed.platform.name, placed.pose.singular, singular_motion(placed.pose)
    data = {
        "robot": name,
        "kind": "platform",
        "position": placed.position.tolist(),
        "rotation": placed.rotation.tolist(),
        "singular": singular,
        "ellipsoid": None if placed.ellipsoid is None else placed.ellipsoid.to_dict(),
        "indices": [entry.to_dict() for entry in entries],
        "singular_motion": motion.to_dict(),
    }
    return Rating(name, singular, tuple(entries), data, motion)


@dataclass(frozen=True, eq=False, repr=False)
class Rating:
    """All indices of a robot in one pose.

    Attributes:
        robot: its name.
        singular: whether the pose is singular.
        entries: one per index: value, range, unit, meaning.
        data: content of `to_dict` but for the versions.
        source: arm and `ArmRating`, `SingularMotion` of a platform, kinds of singularity of a parallel robot.
    """

    robot: str
    singular: bool
    entries: tuple[IndexEntry, ...]
    data: Mapping[str, Any]
    source: Any

    def __getitem__(self, name: str) -> IndexEntry:
        """The index of that name; InputError if there is none."""
        for entry in self.entries:
            if entry.name == name:
                return entry
        raise InputError(f"index: no {name!r} here; there are {', '.join(e.name for e in self.entries)}")

    def __repr__(self) -> str:
        """Regular or singular, and the values."""
        values = ", ".join(
            f"{e.name} {e.value:.4g}{'' if e.unit == '1' else ' ' + e.unit}" for e in self.entries
        )
        return f"<Rating {self.robot}: {'singular' if self.singular else 'regular'} pose; {values}>"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**self.data, "versions": versions()}

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the data as JSON into a file; returns its path."""
        write_json(Path(path), self.to_dict())
        return Path(path)


def rate_along(
    robot: Rated,
    motion: str | os.PathLike[str],
    *,
    indices: Iterable[str] | None = None,
    ellipsoid: OperationEllipsoid | None = None,
) -> RatedMotion:
    """Return indices along a motion: its poses are the rows of a CSV file as plans write it.

    Args:
        robot: see `rate`.
        motion: file with columns q1_deg, q2_m, ... (or q1_rad) and perhaps time_s; for sigma of an arm also
            qd1_deg_s, ... (or qd1_rad_s).
        indices: names; default: the usual ones.
        ellipsoid: see `rate`.

    Raises:
        InputError: the file lacks a column of positions, or a pose is out of reach; names the row.
    """
    result, file = rated_robot(robot, kind_of(robot, several=True)), os.fspath(motion)
    if isinstance(result, ArmModel):
        turns = [not slides for slides in result.prismatic]
        names = chosen_indices(indices, USUAL_OF_ARMS, ARM_INDICES)
        regular = "dm_2" if result.n == 6 else "inv_cdn_oe"
        times, poses = _columns(file, turns)
        rates = _columns(file, turns, rates=True)[1] if "sigma" in names else None
        values = index_values(result, poses, ellipsoid=ellipsoid, rates=rates, names=(*names, regular))
        chosen = {name: values[name] for name in names}

        def chain() -> list[list[np.ndarray]]:
            return [[line] for line in link_frames(result, poses).origins]

        return RatedMotion(result.name, times, chosen, values[regular], chain)
    rate_pose: Callable[[np.ndarray, Iterable[str]], Mapping[str, float]]
    if isinstance(result, ParallelRobot):
        name, of_robot = result.description.name, ParallelIndices(result, ellipsoid)
        turns = [name not in LENGTHS for name in result.description.platform.coordinates]
        names, regular = chosen_indices(indices, of_robot.usual, of_robot.names), ("platform", "legs")
        rate_pose = of_robot.values
    else:
        placed = result.moved(ellipsoid=ellipsoid)
        name, turns = placed.platform.name, [False] * 3 + [True] * 3
        names, regular = platform_indices(indices, placed.ellipsoid), ("ctn",)

        def of_platform(pose: np.ndarray, names: Iterable[str]) -> Mapping[str, float]:
            return placed.moved(pose).values(names)

        rate_pose = of_platform
    times, poses = _columns(file, turns)
    rows = []
    for row, pose in enumerate(poses, start=1):
        with naming(f"{file}: row {row}"):
            rows.append(rate_pose(pose, (*names, *regular)))
    values = {key: np.array([one[key] for one in rows]) for key in (*names, *regular)}
    least = np.min([values[key] for key in regular], axis=0)
    rated = {key: values[key] for key in names}
    if not isinstance(result, ParallelRobot):
        return RatedMotion(name, times, rated, least)
    return RatedMotion(name, times, rated, least, lambda: [result.kinematics.sticks(z) for z in poses])


def _columns(file: str, turns: Sequence[bool], *, rates: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Times (N,) and positions (N, n), rad and m, of the columns q1_deg, q2_m, ..., as plans write them.

    With `rates`: speeds of the columns qd1_deg_s, qd2_m_s, ... instead, rad/s and m/s.
    """
    text = read_text(Path(file))
    begin, end = ("qd", "_s") if rates else ("q", "")
    with naming(file):
        header, cells = csv_table(text)
        columns = []
        for number, turn in enumerate(turns, start=1):
            units = {f"{begin}{number}_{unit}{end}": unit for unit in (("deg", "rad") if turn else ("m",))}
            here = [name for name in units if name in header]
            if not here:
                what = "sigma needs a column" if rates else "expected a column"
                raise InputError(f"{what} {' or '.join(units)}, there are {', '.join(header[:8])}")
            columns.append(_UNITS[units[here[0]]] * cells[:, header.index(here[0])])
    times = cells[:, header.index("time_s")] if "time_s" in header else np.arange(len(cells), dtype=float)
    return times, np.column_stack(columns)


@dataclass(frozen=True, eq=False)
class RatedMotion:
    """Indices (N,) over times (N,), s.

    Attributes:
        robot: its name.
        times: s; of a file without times, row numbers from 0.
        values: by name.
        regularity: (N,) how far the poses are from singular ones: 0 there.
        bodies: returns the lines (k, 3), m, that show the poses, one list of them per row; None where the
            description has no bodies.
    """

    robot: str
    times: np.ndarray
    values: Mapping[str, np.ndarray]
    regularity: np.ndarray = field(repr=False)
    bodies: Callable[[], list[list[np.ndarray]]] | None = field(default=None, repr=False)

    @property
    def regular(self) -> bool:
        """True if no pose is singular."""
        return bool(np.all(self.regularity > _SINGULAR))

    def to_dict(self) -> dict[str, Any]:
        """Minimum, mean and maximum values, and the times of the minima."""
        return {
            "robot": self.robot,
            "poses": len(self.times),
            "indices": {name: self._extremes(v) for name, v in self.values.items()},
        }

    def _extremes(self, values: np.ndarray) -> dict[str, float | None]:
        """Minimum, its time, mean and maximum; None where the index is not defined anywhere."""
        if np.isnan(values).all():
            return dict.fromkeys(("minimum", "at_s", "mean", "maximum"))
        return {
            "minimum": float(np.nanmin(values)),
            "at_s": float(self.times[np.nanargmin(values)]),
            "mean": float(np.nanmean(values)),
            "maximum": float(np.nanmax(values)),
        }

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write a figure (.png, .pdf, .svg) or an animation (.gif, .html, .mp4); returns its path.

        Raises:
            InputError: an animation of a platform, whose legs are not described.
        """
        if Path(path).suffix.lower() not in pictures.movie.SUFFIXES:
            return pictures.workspace.save_indices(self.robot, self.times, dict(self.values), Path(path))
        if self.bodies is None:
            raise InputError("has no legs to animate; describe a parallel robot", "", self.robot)
        shown = pictures.animation.Moving(self.robot, self.times, self.bodies(), self.values)
        return pictures.animation.save_animation([shown], path)


def rate_workspace(
    robot: Rated,
    ranges: Mapping[str, tuple[float, float]],
    *,
    pose: ArrayLike | None = None,
    indices: Iterable[str] | None = None,
    cells: int | Sequence[int] = 40,
    ellipsoid: OperationEllipsoid | None = None,
    progress: Any = None,
) -> IndexMaps:
    """Return indices over a grid of poses; see `ocptip.indices.workspace_maps.index_maps`.

    Args:
        robot: see `rate`.
        ranges: coordinate to lower and upper end, m or rad; one to three of them.
        pose: the pose whose other coordinates hold everywhere.
        indices, ellipsoid: see `rate_along`.
        cells: per coordinate.
        progress: of parallel robots: called as progress(done, total, None).
    """
    rated = rated_robot(robot, kind_of(robot, several=True))
    if isinstance(rated, PlacedPlatform) and pose is not None:
        rated, pose = rated.moved(finite_array("pose", pose, (6,))), None
    how = {"names": indices, "cells": cells, "progress": progress}
    return index_maps(rated, ranges, pose=pose, ellipsoid=ellipsoid, **how)


def kind_of(robot: Rated, *, several: bool) -> Kind:
    """The kind that a robot is rated as; with `several` poses a hexapod counts as a parallel robot."""
    if isinstance(robot, ParallelRobot):
        return "parallel"
    if isinstance(robot, PlacedPlatform):
        return "platform"
    if isinstance(robot, ArmModel | Robot):
        return "arm"
    path = Path(robot)
    is_file = path.suffix.lower() == ".toml"
    keys = Table.read(path, ANY_FILE) if is_file else {}
    name, hexapod = os.fspath(robot).lower(), os.fspath(robot).upper() == HEXAPOD
    if "leg" in keys or (name in map(str.lower, READY_MADE) and (several or not hexapod)):
        return "parallel"
    return "platform" if hexapod or (is_file and "arm" not in keys) else "arm"


def rated_robot(robot: Rated, kind: Kind) -> ArmModel | ParallelRobot | PlacedPlatform:
    """The robot of this kind, read from its file where it is one; most indices need no masses."""
    if isinstance(robot, Robot):
        return robot.arm
    if not isinstance(robot, str | os.PathLike):
        return robot
    name = os.fspath(robot)
    if kind == "parallel":
        return ParallelRobot(read_robot(name))
    if kind == "platform":
        return platform_of_robot(ups6()) if name.upper() == HEXAPOD else read_platform(name)
    suffix = Path(name).suffix.lower()
    if suffix in URDF_SUFFIXES:
        return arm_from_urdf(name, accept_inertia=True)
    return arm_of_file(name) if suffix == ".toml" else arm_by_name(name)
