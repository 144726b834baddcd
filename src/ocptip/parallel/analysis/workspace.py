"""Workspaces: which poses of a grid a robot reaches within the ranges of all its joints.

A grid over one to three platform coordinates, the others fixed: a constant-orientation workspace (over x, y,
z), an orientation workspace (over angles), or anything between. Every pose is checked by itself, with the IK
solutions of the legs in the home pose. `ChainPosture` is one pose with joints, motors and singularities.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike

from ocptip.basics.errors import InputError, SolverError, finite_array
from ocptip.basics.text import quantity
from ocptip.basics.write import Record
from ocptip.numerics.batch import BatchFunction
from ocptip.numerics.vectors import nearest_turn
from ocptip.parallel.analysis.singularity import Singularity, characteristic_length
from ocptip.parallel.description.robot_description import REVOLUTE
from ocptip.parallel.minimal_form import joint_obstacle, minimal_form, minimal_obstacle
from ocptip.parallel.robot import ParallelRobot

OUT_OF_REACH = "out of reach"
LENGTHS = ("x", "y", "z")  # coordinates in m; the others are angles
_BLOCK, _REPORTED = 20_000, 16

Watcher = Callable[[int, int, None], None]


@dataclass(frozen=True, eq=False)
class Workspace(Record):
    """Poses of a grid.

    Attributes:
        names: of the coordinates that vary.
        values: per coordinate, m or rad: the middles of the cells.
        at: (m,) the other coordinates, those that vary at home.
        inside: (n1, n2, ...) True where all joints are within their ranges.
        dexterity: (n1, n2, ...) volume that the unit rows of J_a span, angles counted as lengths (by the
            mean distance of the coupling points from the platform's origin): 1 where the motors act at right
            angles, 0 at type II singularities, negative beyond them as seen from home; NaN out of reach.
        cause: (n1, n2, ...) number in `causes` of the first limit that fails, -1 inside.
        causes: "out of reach", "leg 1 joint 3", ...
        size: area, volume, length or angle inside, in products of m and rad.
    """

    names: tuple[str, ...]
    values: tuple[np.ndarray, ...]
    at: np.ndarray
    inside: np.ndarray
    dexterity: np.ndarray
    cause: np.ndarray
    causes: tuple[str, ...]
    size: float

    @property
    def shares(self) -> dict[str, float]:
        """Shares of the poses, by cause, and of those inside beyond a singularity."""
        table = {name: float(np.mean(self.cause == k)) for k, name in enumerate(self.causes)}
        beyond = float(np.mean(self.inside & (self.dexterity < 0)))
        return {"inside": float(self.inside.mean()), "beyond a singularity": beyond, **table}

    def to_dict(self) -> dict[str, object]:
        """Plain data without the single poses."""
        inside = self.dexterity[self.inside]
        return {
            "coordinates": list(self.names),
            "ranges": [[float(v[0]), float(v[-1])] for v in self.values],
            "cells": list(self.inside.shape),
            "at": self.at.tolist(),
            "size": self.size,
            "shares": self.shares,
            "dexterity": [float(inside.min()), float(inside.max())] if inside.size else None,
        }


def workspace(
    robot: ParallelRobot,
    ranges: Mapping[str, tuple[float, float]],
    *,
    at: ArrayLike | None = None,
    cells: int | Sequence[int] = 40,
    progress: Watcher | None = None,
) -> Workspace:
    """Examine a grid of poses.

    Robots whose legs have closed forms take microseconds per pose (joints at the platform with ranges: only
    for poses that are inside otherwise), others milliseconds.

    Args:
        robot: with as many motors as coordinates; its joints' ranges are in the rows of its legs.
        ranges: coordinate name -> lower and upper end, m or rad; one to three of them.
        at: (m,) values of the other coordinates; default home.
        cells: per coordinate.
        progress: called with the numbers of poses done and of all poses, where each is checked by itself.

    Raises:
        InputError: unknown coordinates, empty ranges, or another number of motors.
    """
    description = robot.description
    at = robot.kinematics.coordinates("at", description.home if at is None else at)
    known = description.platform.coordinates
    if len(description.actuated) != robot.m or description.redundant:
        raise InputError("workspace: needs as many motors as coordinates, and no redundant joints")
    middles, poses, width = grid_of_poses(known, at, ranges, cells)
    find = _one_by_one if minimal_obstacle(robot) else _at_once
    causes = (OUT_OF_REACH, *(name for name, _, _, _ in _limits(robot)))
    cause, dexterity = find(robot, poses, progress)
    cause = cause.reshape([len(middle) for middle in middles])
    inside = cause < 0
    size = float(inside.sum() * width)
    return Workspace(tuple(ranges), middles, at, inside, dexterity.reshape(cause.shape), cause, causes, size)


def grid_of_poses(
    known: Sequence[str],
    at: np.ndarray,
    ranges: Mapping[str, tuple[float, float]],
    cells: int | Sequence[int],
) -> tuple[tuple[np.ndarray, ...], np.ndarray, float]:
    """Poses over one to three coordinates.

    Args:
        known: names of all coordinates.
        at: (m,) values of those that do not vary.
        ranges: coordinate name -> lower and upper end.
        cells: per coordinate.

    Returns:
        Middles of the cells of each coordinate that varies, poses (N, m) with the last of these running
        fastest, and the size of a cell.

    Raises:
        InputError: unknown coordinates or empty ranges.
    """
    if not 1 <= len(ranges) <= 3 or any(name not in known for name in ranges):
        raise InputError(f"workspace: expected one to three of {', '.join(known)}, got {', '.join(ranges)}")
    counts = [cells] * len(ranges) if isinstance(cells, int) else list(cells)
    if len(counts) != len(ranges) or min(counts) < 2:
        raise InputError(f"workspace: expected 2 or more cells for each of {len(ranges)} coordinates")
    middles, width = [], 1.0
    for (name, ends), count in zip(ranges.items(), counts, strict=True):
        low, high = finite_array(f"workspace: {name}", ends, (2,))
        if not low < high:
            raise InputError(f"workspace: {name}: expected a lower and a higher end, got {low:g}, {high:g}")
        middles.append(low + (high - low) * (np.arange(count) + 0.5) / count)
        width *= (high - low) / count
    poses = np.tile(at, (int(np.prod(counts)), 1))
    mesh = np.meshgrid(*middles, indexing="ij")
    for name, grid in zip(ranges, mesh, strict=True):
        poses[:, known.index(name)] = grid.ravel()
    return tuple(middles), poses, width


def _limits(robot: ParallelRobot) -> list[tuple[str, int, int, tuple[float, float]]]:
    """Name, leg, joint and range of every joint that has one."""
    limits = []
    for k, leg in enumerate(robot.description.legs):
        for j, row in enumerate(leg.joint_rows):
            if np.isfinite(row.range).any():
                limits.append((f"leg {k + 1} joint {j + 1}", k, j, row.range))
    return limits


def _beyond(q: np.ndarray, low: float, high: float, revolute: bool) -> np.ndarray:
    """Whether positions are outside of a range, revolute ones whatever their full turns."""
    if revolute and np.isfinite(low) and np.isfinite(high):
        q = nearest_turn(q - (low + high) / 2) + (low + high) / 2
    return (q < low) | (q > high)


def _at_once(
    robot: ParallelRobot, poses: np.ndarray, progress: Watcher | None
) -> tuple[np.ndarray, np.ndarray]:
    """Causes (N,) and dexterity (N,) of robots whose legs have closed forms."""
    form = minimal_form(robot)
    function = BatchFunction(cs.Function("workspace", [form.z], [cs.vec(form.q), form.measures]))
    blocks = [function(poses[k : k + _BLOCK]) for k in range(0, len(poses), _BLOCK)]
    q, measures = (np.concatenate([block[i] for block in blocks]) for i in range(2))
    n, legs = form.q.shape
    q = q.reshape(len(poses), legs, n)
    reached = np.all(measures[:, :-1] > 0, axis=1)
    cause = np.where(reached, -1, 0)
    behind = []
    for number, (_, leg, joint, (low, high)) in enumerate(_limits(robot), start=1):
        if joint >= n:
            behind.append(number)
            continue
        revolute = robot.description.legs[leg].joint_rows[joint].sigma == REVOLUTE
        out = _beyond(q[:, leg, joint], low, high, revolute)
        cause[(cause < 0) & out] = number
    if behind:
        left = np.flatnonzero(cause < 0)
        cause[left] = _one_by_one(robot, poses[left], progress, only=behind)[0]
    return cause, np.where(reached, measures[:, -1], np.nan)


def _one_by_one(
    robot: ParallelRobot, poses: np.ndarray, progress: Watcher | None, only: Sequence[int] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Causes (N,) and dexterity (N,) of any robot; with `only` some of the limits, and no dexterity."""
    limits = list(enumerate(_limits(robot), start=1))
    cause, dexterity = np.full(len(poses), -1), np.full(len(poses), np.nan)
    home = 0.0 if only is not None else motor_volume(robot, robot.description.home, None)
    nearby = _Nearby(robot)
    for k, z in enumerate(poses):
        if progress is not None and k % _REPORTED == 0:
            progress(k, len(poses), None)
        if (q := nearby.joints(z)) is None:
            cause[k] = 0
            continue
        for number, (_, leg, joint, (low, high)) in limits:
            revolute = robot.description.legs[leg].joint_rows[joint].sigma == REVOLUTE
            wanted = only is None or number in only
            if wanted and _beyond(np.asarray(q[leg][joint]), low, high, revolute):
                cause[k] = number
                break
        if only is None:
            dexterity[k] = np.copysign(1.0, home) * motor_volume(robot, z, q)
    return cause, dexterity


class _Nearby:
    """Joints of pose after pose in the assembly of home, each from the nearest of those before."""

    def __init__(self, robot: ParallelRobot) -> None:
        self._robot, self._poses, self._q = robot, np.empty((0, robot.m)), []
        self._closed = not joint_obstacle(robot.description)

    def joints(self, z: np.ndarray) -> Sequence[np.ndarray] | None:
        """Per leg; None out of reach."""
        q = None
        if self._q:
            nearest = int(np.argmin(np.sum((self._poses[: len(self._q)] - z) ** 2, axis=1)))
            q = self._robot.kinematics.joints_nearby(z, self._q[nearest])
        if q is None:
            try:
                joint_positions = self._robot.ik(z)
            except InputError:
                return None
            q = joint_positions.q
            if (
                self._closed or joint_positions.assembly != "home"
            ):  # fast as it is, or perhaps another assembly
                return q
        if len(self._q) == len(self._poses):
            self._poses = np.vstack([self._poses, np.empty((max(64, len(self._q)), len(z)))])
        self._poses[len(self._q)] = z
        self._q.append(q)
        return q


def motor_volume(robot: ParallelRobot, z: np.ndarray, q: Sequence[np.ndarray] | None) -> float:
    """Volume that the unit rows of J_a span, angles counted as lengths; NaN at type I singularities."""
    length = characteristic_length(robot.kinematics)
    names = robot.description.platform.coordinates
    weights = np.array([1.0 if name in LENGTHS else length for name in names])
    try:
        rows = robot.jacobian(z, q) / weights
    except (SolverError, np.linalg.LinAlgError):
        return float("nan")
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    regular = np.isfinite(sizes).all() and sizes.min() > 0
    return float(np.linalg.det(rows / sizes)) if regular else float("nan")


@dataclass(frozen=True)
class JointInRange:
    """A joint with a range.

    Attributes:
        leg, joint: numbers from 0.
        value, low, high: rad or m; of a turning joint the turn nearest to the middle of its range.
        unit: "rad" or "m".
    """

    leg: int
    joint: int
    value: float
    low: float
    high: float
    unit: str

    @property
    def left(self) -> float:
        """Distance to the nearer end over half the range; negative beyond; one end: rad or m."""
        distance = min(self.value - self.low, self.high - self.value)
        half = (self.high - self.low) / 2
        return distance / half if np.isfinite(half) else distance

    def __str__(self) -> str:
        """The joint, its value and its range."""
        scale, unit = (180 / np.pi, "deg") if self.unit == "rad" else (1.0, "m")
        ends = f"{scale * self.low:.4g} to {scale * self.high:.4g} {unit}"
        return f"leg {self.leg + 1} joint {self.joint + 1}: {scale * self.value:.4g} in {ends}"


class ChainPosture:
    """A parallel robot in one pose.

    Args:
        robot: the robot.
        z: (m,) coordinates, m and rad.

    Attributes:
        z: as given.
        found: positions of all joints; its `assembly` names their assembly mode.
        motors: (n_a,) positions of the motors, rad or m.

    Raises:
        InputError: the pose is out of reach.
    """

    def __init__(self, robot: ParallelRobot, z: ArrayLike) -> None:
        self.z = robot.kinematics.coordinates("z", z)
        self._robot, self.found = robot, robot.ik(self.z)
        self.motors = np.array([self.found.q[leg][joint] for leg, joint in robot.description.actuated])

    @cached_property
    def singularity(self) -> Singularity:
        """The distance from singular poses."""
        return self._robot.singularity(self.z, self.found.q)

    @cached_property
    def joints(self) -> tuple[JointInRange, ...]:
        """Joints that have a range, those nearest to its ends first."""
        return tuple(sorted(self._in_ranges(), key=lambda joint: joint.left))

    def _in_ranges(self) -> Iterator[JointInRange]:
        legs = zip(self._robot.description.legs, self.found.q, strict=True)
        for leg, (described, values) in enumerate(legs):
            for joint, (row, value) in enumerate(zip(described.joint_rows, values, strict=True)):
                low, high = row.range
                if np.isfinite(row.range).any():
                    turns, both = row.sigma == REVOLUTE, np.isfinite(row.range).all()
                    place = nearest_turn(value, (low + high) / 2) if turns and both else value
                    yield JointInRange(leg, joint, float(place), low, high, "rad" if turns else "m")

    @property
    def beyond(self) -> list[str]:
        """What makes the pose unusable: joints beyond their range, singular poses, another assembly."""
        joints = [str(joint) for joint in self.joints if joint.left < 0]
        kinds = [f"singular: {', '.join(self.singularity.kinds)}"] if self.singularity.kinds else []
        legs = ", ".join(str(leg + 1) for leg in self.found.searched)
        lost = [f"leg {legs}: a singular pose or the end of its reach lies before home"] if legs else []
        return [*joints, *kinds, *lost]

    @property
    def lines(self) -> list[tuple[str, str]]:
        """Names and values."""
        rows, found = self._robot.description.motor_rows, self.singularity
        motors = ", ".join(
            f"{np.degrees(value):.1f} deg" if row.sigma == REVOLUTE else quantity(float(value), "m", 4)
            for row, value in zip(rows, self.motors, strict=True)
        )
        nearest = [("nearest end of a range", str(self.joints[0]))] if self.joints else []
        return [
            ("smallest singular value, platform", f"{found.platform:.3g}"),
            ("smallest singular value, legs", f"{found.legs.min():.3g} (leg {found.legs.argmin() + 1})"),
            ("conditioning of the motors", f"{found.conditioning:.3g}"),
            ("motors", motors),
            *nearest,
        ]

    def __repr__(self) -> str:
        """What makes it unusable, and the values."""
        values = "; ".join(f"{name} {value}" for name, value in self.lines)
        return f"<ChainPosture {'; '.join(self.beyond) or 'usable'}: {values}>"
