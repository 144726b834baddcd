"""Maps: performance indices over a grid of poses of an arm, a platform or a parallel robot.

Over one to three coordinates, the others as in a given pose: constant-orientation workspaces (over x, y, z),
orientation workspaces (over angles), or anything between. Every pose is evaluated by itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError, finite_array
from ocptip.basics.write import Record
from ocptip.indices.arms.values import ARM_INDICES, index_values, six_or_more
from ocptip.indices.meanings import ARM, PARALLEL, PLATFORM, Meaning
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import control_numbers
from ocptip.indices.platforms.parallel_robots import ParallelIndices
from ocptip.indices.platforms.platform import MINIMUM_LEGS, PlatformPose, StewartPlatform, legs_exist
from ocptip.indices.platforms.reviewed import PlacedPlatform
from ocptip.numerics.threads import one_thread
from ocptip.parallel.analysis.workspace import Watcher, grid_of_poses, workspace
from ocptip.parallel.robot import ParallelRobot
from ocptip.robots.inverse.closed_form import branches_within_limits, closed_form_family
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.model import ArmModel

POSE_COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
"""Coordinates of arms and platforms: position, m, base frame; rotation vector of the pose, rad, base axes."""

USUAL_OF_ARMS = ("dm_2", "dm_inf", "pi_oe", "inv_cdn_oe", "manipulability")
USUAL_OF_PLATFORMS = ("ctn", "inv_cdn_oe", "manipulability", "sigma_r", "sigma_s")
_BLOCK = 20_000


@dataclass(frozen=True, eq=False)
class IndexMaps(Record):
    """Indices over a grid of poses.

    Attributes:
        robot: its name.
        names: of the coordinates that vary: those of a parallel robot, otherwise some of `POSE_COORDINATES`.
        values: per coordinate, m or rad: the middles of the cells.
        at: (m,) the pose whose other coordinates hold everywhere.
        solutions: (n1, n2, ...) how many solutions of the inverse kinematics keep the joints' ranges; of
            parallel robots at most 1 (the legs keep the IK solutions of the home pose), of platforms 1, or 0
            where a leg has length 0.
        maps: index -> (n1, n2, ...): the best of all solutions, each index by itself; NaN out of reach.
        meanings: symbol, unit and bounds of each index.
        signed: (n1, n2, ...) changes its sign on the singularity surface; of platforms the determinant of the
            Jacobian, of parallel robots the dexterity, NaN where that is unknown: out of reach, platforms of
            more than six legs, arms (their solutions meet in singular poses, and none goes beyond).
        size: area, volume, length or angle inside, in products of m and rad.
    """

    robot: str
    names: tuple[str, ...]
    values: tuple[np.ndarray, ...]
    at: np.ndarray
    solutions: np.ndarray
    maps: dict[str, np.ndarray]
    meanings: dict[str, Meaning]
    signed: np.ndarray
    size: float

    @property
    def inside(self) -> np.ndarray:
        """(n1, n2, ...) True where a solution keeps the ranges."""
        return self.solutions > 0

    @property
    def crosses(self) -> bool:
        """True if the singularity surface passes through the poses inside, or one of them is on it."""
        signed = self.signed[self.inside]
        return bool(np.any(signed <= 0) and np.any(signed >= 0))

    def to_dict(self) -> dict[str, Any]:
        """Plain data: minimum, mean and maximum values and where these are, without the single poses."""
        return {
            "robot": self.robot,
            "coordinates": list(self.names),
            "ranges": [[float(v[0]), float(v[-1])] for v in self.values],
            "cells": list(self.inside.shape),
            "at": self.at.tolist(),
            "inside": float(self.inside.mean()),
            "size": self.size,
            "singularity_surface_inside": self.crosses,
            "indices": {name: self._extremes(index_map) for name, index_map in self.maps.items()},
        }

    def _extremes(self, values: np.ndarray) -> dict[str, object]:
        known = values[np.isfinite(values)]
        if not known.size:
            return {"minimum": None, "mean": None, "maximum": None, "best_at": None}
        best = np.unravel_index(np.argmax(np.where(np.isfinite(values), values, -np.inf)), values.shape)
        return {
            "minimum": float(known.min()),
            "mean": float(known.mean()),
            "maximum": float(known.max()),
            "best_at": [float(v[k]) for v, k in zip(self.values, best, strict=True)],
        }


@one_thread
def index_maps(
    robot: ArmModel | ParallelRobot | PlacedPlatform,
    ranges: Mapping[str, tuple[float, float]],
    *,
    pose: ArrayLike | None = None,
    names: Iterable[str] | None = None,
    cells: int | Sequence[int] = 40,
    ellipsoid: OperationEllipsoid | None = None,
    progress: Watcher | None = None,
) -> IndexMaps:
    """Rate the poses of a grid.

    Arms with closed-form inverse kinematics take about 0.1 ms per pose; for others a search finds solutions
    (tens of milliseconds per pose, and of the endless ones of redundant arms 64 at most). Parallel robots
    take milliseconds per pose inside, platforms 0.1 ms per index.

    Args:
        robot: arm of six axes or more, platform, or parallel robot with as many motors as coordinates.
        ranges: coordinate -> lower and upper end, m or rad; one to three of them.
        pose: of an arm its joint angles (n,), rad, which place the gripper; of a parallel robot its
            coordinates (m,), default home; of platforms None: home.
        names: of the indices; default: the usual ones.
        cells: per coordinate.
        ellipsoid: operation ellipsoid; default as in `index_values`, of platforms as their file says.
        progress: of parallel robots, as in `workspace`.

    Raises:
        InputError: unknown coordinates, indices that this robot lacks, empty ranges, wrong shapes.
    """
    if isinstance(robot, ArmModel):
        return _of_arm(robot, ranges, pose, names, cells, ellipsoid)
    if isinstance(robot, ParallelRobot):
        return _of_parallel(robot, ranges, pose, names, cells, ellipsoid, progress)
    return _of_platform(robot, ranges, names, cells, ellipsoid)


def chosen_indices(
    names: Iterable[str] | None, usual: Sequence[str], known: Sequence[str]
) -> tuple[str, ...]:
    """The indices asked for, or the usual ones; InputError if one is not known."""
    if names is None:
        return tuple(usual)
    chosen = tuple(dict.fromkeys(names))
    for name in chosen:
        if name not in known:
            raise InputError(f"index: no index {name!r} of this robot; there are {', '.join(known)}")
    return chosen


def platform_indices(names: Iterable[str] | None, ellipsoid: OperationEllipsoid | None) -> tuple[str, ...]:
    """Indices of platforms: those asked for, or the usual ones; InputError if there is no such."""
    without = () if ellipsoid else ("inv_cdn_oe", "inv_cdn_cl")
    known = [name for name in PLATFORM if name not in without]
    return chosen_indices(names, [name for name in USUAL_OF_PLATFORMS if name in known], known)


def _of_arm(
    model: ArmModel,
    ranges: Mapping[str, tuple[float, float]],
    pose: ArrayLike | None,
    names: Iterable[str] | None,
    cells: int | Sequence[int],
    ellipsoid: OperationEllipsoid | None,
) -> IndexMaps:
    six_or_more(model)
    if pose is None:
        raise InputError("pose: an arm needs joint angles, which place its gripper")
    q = finite_array("pose", pose, (model.n,))
    wanted = chosen_indices(names, USUAL_OF_ARMS, [name for name in ARM_INDICES if name != "sigma"])
    position, rotation = gripper_pose(model, q)
    central_pose = np.concatenate([position, np.zeros(3)])
    middles, poses, width = grid_of_poses(POSE_COORDINATES, central_pose, ranges, cells)
    shape = tuple(map(len, middles))
    solutions = np.zeros(len(poses), dtype=int)
    maps = {name: np.full(len(poses), np.nan) for name in wanted}
    for start in range(0, len(poses), _BLOCK):
        block = poses[start : start + _BLOCK]
        turns = Rotation.from_rotvec(block[:, 3:]).as_matrix() @ rotation
        numbers, q = joint_solutions(model, block[:, :3], turns)
        if not len(q):
            continue
        solutions[start : start + len(block)] = np.bincount(numbers, minlength=len(block))
        for name, value in index_values(model, q, ellipsoid=ellipsoid, names=wanted).items():
            np.fmax.at(maps[name], start + numbers, value)
    for name in wanted:
        if solutions.any() and np.isnan(maps[name][solutions > 0]).all():
            raise InputError(f"index: {name} is not defined for {model.name}; rating one pose says why")
    return IndexMaps(
        model.name,
        tuple(ranges),
        middles,
        central_pose,
        solutions.reshape(shape),
        {name: index_map.reshape(shape) for name, index_map in maps.items()},
        {name: ARM[name] for name in wanted},
        np.full(shape, np.nan),
        float(np.count_nonzero(solutions) * width),
    )


def joint_solutions(
    model: ArmModel, positions: np.ndarray, rotations: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """All joint angles within the limits that bring the gripper to poses.

    Args:
        model: the arm; without a closed form its solutions are searched.
        positions: (N, 3), m.
        rotations: (N, 3, 3).

    Returns:
        Number (k,) of the pose and joint angles (k, n), rad, of each solution.
    """
    if closed_form_family(model) is not None:
        result = branches_within_limits(model, positions, rotations)
        exists = np.isfinite(result).all(axis=2)
        return np.nonzero(exists)[0], result[exists]
    numbers, solutions = [], []
    for k, (position, rotation) in enumerate(zip(positions, rotations, strict=True)):
        try:
            branches = solve_inverse_kinematics(model, position, rotation).branches
        except InputError:
            continue
        numbers += [k] * len(branches)
        solutions += list(branches)
    return np.array(numbers, dtype=int), np.array(solutions).reshape(-1, model.n)


def _of_parallel(
    robot: ParallelRobot,
    ranges: Mapping[str, tuple[float, float]],
    pose: ArrayLike | None,
    names: Iterable[str] | None,
    cells: int | Sequence[int],
    ellipsoid: OperationEllipsoid | None,
    progress: Watcher | None,
) -> IndexMaps:
    indices = ParallelIndices(robot, ellipsoid)
    wanted = chosen_indices(names, indices.usual, indices.names)
    space = workspace(robot, ranges, at=pose, cells=cells, progress=progress)
    coordinates = robot.description.platform.coordinates
    _, poses, _ = grid_of_poses(coordinates, space.at, ranges, list(space.inside.shape))
    maps = {name: np.full(space.inside.shape, np.nan) for name in wanted}
    slow = [name for name in wanted if name != "dexterity"]
    if "dexterity" in wanted:
        maps["dexterity"] = np.where(space.inside, np.abs(space.dexterity), np.nan)
    inside = np.flatnonzero(space.inside) if slow else ()
    for done, k in enumerate(inside):
        if progress is not None and done % 16 == 0:
            progress(done, len(inside), None)
        for name, value in indices.values(poses[k], slow).items():
            maps[name].flat[k] = value
    meanings = {name: {**PLATFORM, **PARALLEL}[name] for name in wanted}
    return IndexMaps(
        robot.description.name,
        space.names,
        space.values,
        space.at,
        space.inside.astype(int),
        maps,
        meanings,
        space.dexterity,
        space.size,
    )


def _of_platform(
    file: PlacedPlatform,
    ranges: Mapping[str, tuple[float, float]],
    names: Iterable[str] | None,
    cells: int | Sequence[int],
    ellipsoid: OperationEllipsoid | None,
) -> IndexMaps:
    file = file.moved(ellipsoid=ellipsoid)
    wanted = platform_indices(names, file.ellipsoid)
    central_pose = np.concatenate([file.position, np.zeros(3)])
    middles, poses, width = grid_of_poses(POSE_COORDINATES, central_pose, ranges, cells)
    shape = tuple(map(len, middles))
    turns = Rotation.from_rotvec(poses[:, 3:]).as_matrix() @ file.rotation
    maps = {name: np.full(len(poses), np.nan) for name in wanted}
    if "ctn" in wanted:
        maps["ctn"] = control_numbers(file.platform, poses[:, :3], turns)
    signed, exists = _determinants(file.platform, poses[:, :3], turns)
    single = [name for name in wanted if name != "ctn"]
    for k in np.flatnonzero(exists) if single else ():
        placed = replace(file, position=poses[k, :3], rotation=turns[k])
        for name, value in placed.values(single).items():
            maps[name][k] = value
    if file.platform.n_legs != MINIMUM_LEGS:
        signed[:] = np.nan
    return IndexMaps(
        file.platform.name,
        tuple(ranges),
        middles,
        central_pose,
        exists.astype(int).reshape(shape),
        {name: index_map.reshape(shape) for name, index_map in maps.items()},
        {name: PLATFORM[name] for name in wanted},
        signed.reshape(shape),
        float(exists.sum() * width),
    )


def _determinants(
    platform: StewartPlatform, positions: np.ndarray, rotations: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Determinants (N,) of the Jacobians of the first six legs, and where all legs have a length."""
    base, moved = platform.anchors(positions, rotations)
    exists, determinants = legs_exist(base, moved), np.full(len(moved), np.nan)
    poses = PlatformPose.of_many(base[exists], moved[exists])
    determinants[exists] = np.linalg.det(poses.jacobian[:, :MINIMUM_LEGS])
    return determinants, exists
