"""Paths along which the gripper moves in straight lines, through inverse kinematics along each line.

Orientations turn evenly about one axis from pose to pose. Corners between lines are rounded within a
tolerance of the TCP, or stay; then a motion has to stop there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.errors import InputError
from ocptip.robots.inverse.inverse_kinematics import solve_inverse_kinematics
from ocptip.robots.inverse.pose_search import Orientation, miss_sizes, pose_errors, reached, search
from ocptip.robots.inverse.pose_target import PoseTarget
from ocptip.robots.kinematics import gripper_pose
from ocptip.robots.model import ArmModel
from ocptip.trajectories.path_fit import BACK, FINE, FittedPath, blend_reach, blend_rows, joined
from ocptip.trajectories.path_legs import Leg

ARM_LENGTH = 0.5  # m: a rotation by 1 rad is as long as a way of this
REACHED = 1e-8  # m and rad
NEAR = 0.2
"""rad or m: where joints move by more between neighbouring samples, more samples are taken."""

_FIRST, _MOST, _LEAST = 32, 4096, 513  # samples of a line
_IN_BLEND = 96  # samples of a blend
_FURTHER = 0.01  # m: so far ahead is looked, too, where a line cannot be followed
_CURVE = 2e-5  # rad or m: distance of the path from the solutions of the inverse kinematics


@dataclass(frozen=True, eq=False)
class ToolPath(FittedPath):
    """A path through inverse kinematics.

    Attributes:
        tool: (2,): largest distance of the gripper from its lines and blends, m, and of its orientation, rad.
        blended: m, largest distance of the blends from the corners that they round.
    """

    tool: np.ndarray
    blended: float = 0.0


def tool_lines(
    arm: ArmModel,
    poses: Sequence[PoseTarget],
    starts: np.ndarray,
    tolerance: float = 0.0,
) -> ToolPath:
    """The path on which the gripper moves in straight lines from pose to pose.

    Args:
        arm: the arm.
        poses: at least two. If the first pose lets the gripper turn freely about an axis, it may do so on the
            whole path.
        starts: (k, n), rad (sliding joints: m): postures of the first pose, the best first. The first one
            from which all lines can be followed is taken.
        tolerance: m, by which the TCP may miss corners; 0: it stops there.

    Raises:
        InputError: there are fewer than two poses, two neighbours are the same, or a line cannot be followed:
            where, and why.
    """
    given, poses = len(poses), _distinct(poses)
    lines = _Lines.of(poses, tolerance)
    refusal: InputError | None = None
    for start in starts:
        try:
            result = _followed(arm, lines, start)
        except InputError as error:
            refusal = refusal or error
            continue
        left_out = f", without {given - len(poses)} nearly the same as the one before"
        return replace(result, how=result.how + left_out) if len(poses) < given else result
    assert refusal is not None
    raise refusal


def _distinct(poses: Sequence[PoseTarget]) -> list[PoseTarget]:
    """Poses that differ from the one kept before; a line between others would go where rounding points."""
    kept = list(poses[:1])
    for pose in poses[1:]:
        turned = scipy.spatial.transform.Rotation.from_matrix(kept[-1].rotation.T @ pose.rotation).magnitude()
        if max(np.abs(np.subtract(kept[-1].position, pose.position)).max(), turned) > FINE:
            kept.append(pose)
    return kept if len(kept) < 2 else [*kept[:-1], poses[-1]]


@dataclass(frozen=True, eq=False)
class _Lines:
    """Straight lines between K poses, and blends at some of the corners.

    Attributes:
        points: (K, 3), m.
        turns: (K, 3, 3).
        lengths: (K,), m: up to each pose, turns included.
        directions: (K - 1, 6): how position (base axes) and orientation (gripper axes) change per length.
        reaches: (K,), m: half lengths of the blends, 0 without one.
        how: what of the orientation counts, and the tool axis, see `PoseTarget.how`.
    """

    points: np.ndarray
    turns: np.ndarray
    lengths: np.ndarray
    directions: np.ndarray
    reaches: np.ndarray
    how: tuple[Orientation, np.ndarray]

    @classmethod
    def of(cls, poses: Sequence[PoseTarget], tolerance: float) -> _Lines:
        if len(poses) < 2:
            raise InputError(f"poses: at least two are needed for a path, got {len(poses)} that differ")
        if any(pose.fold for pose in poses):
            raise InputError("fold: not on tool lines; give the orientation that is meant")
        points = np.array([pose.position for pose in poses])
        turns = np.array([pose.rotation for pose in poses])
        turned = scipy.spatial.transform.Rotation.from_matrix(
            turns[:-1].transpose(0, 2, 1) @ turns[1:]
        ).as_rotvec()
        change = np.hstack([np.diff(points, axis=0), turned])
        sizes = np.linalg.norm(change * ([1.0] * 3 + [ARM_LENGTH] * 3), axis=1)
        if np.any(sizes <= REACHED):
            k = int(np.argmax(sizes <= REACHED))
            raise InputError(f"poses: {k + 1} and {k + 2} are the same")
        directions, reaches = change / sizes[:, None], np.zeros(len(poses))
        for k, (before, after) in enumerate(pairwise(directions), 1):
            bend = (after - before) * ([1.0] * 3 + [ARM_LENGTH] * 3)
            if tolerance > 0 and np.linalg.norm(after + before) >= BACK:
                reaches[k] = min(
                    blend_reach(float(np.linalg.norm(bend)), tolerance), 0.5 * sizes[k - 1], 0.5 * sizes[k]
                )
        return cls(points, turns, np.append(0.0, np.cumsum(sizes)), directions, reaches, poses[0].how)

    @property
    def corners(self) -> list[int]:
        """Poses at which a leg begins or ends: the first, the last, and those without a blend."""
        inner = range(1, len(self.points) - 1)
        bent = (np.linalg.norm(self.directions[k] - self.directions[k - 1]) > 1e-9 for k in inner)
        stops = [k for k, bend in zip(inner, bent, strict=True) if bend and not self.reaches[k]]
        return [0, *stops, len(self.points) - 1]

    def at(self, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (N, 3), m, and rotations (N, 3, 3)."""
        k = np.argmin(np.abs(self.lengths - lengths[:, None]), axis=1)
        y, last = lengths - self.lengths[k], len(self.directions) - 1
        before, after = self.directions[np.maximum(k - 1, 0)], self.directions[np.minimum(k, last)]
        ahead = (k == 0) | ((y > 0) & (k <= last))
        moved = y[:, None] * np.where(ahead[:, None], after, before)
        for i in np.flatnonzero(np.abs(y) < self.reaches[k]):
            reach = float(self.reaches[k[i]])
            rows = blend_rows(-reach * before[i], before[i], after[i] - before[i], reach)
            moved[i] = (y[i] + reach) ** np.arange(4, -1, -1.0) @ rows
        return self.points[k] + moved[:, :3], self.turns[k] @ scipy.spatial.transform.Rotation.from_rotvec(
            moved[:, 3:]
        ).as_matrix()

    @property
    def blended(self) -> float:
        """Largest distance of blends from their corners, m."""
        inner = [k for k in range(1, len(self.points) - 1) if self.reaches[k]]
        miss = [
            3 / 16 * self.reaches[k] * np.linalg.norm((self.directions[k] - self.directions[k - 1])[:3])
            for k in inner
        ]
        return float(max(miss, default=0.0))

    def where(self, length: float) -> str:
        """A place in words."""
        k = int(np.clip(np.searchsorted(self.lengths, length, side="right") - 1, 0, len(self.directions) - 1))
        share = (length - self.lengths[k]) / (self.lengths[k + 1] - self.lengths[k])
        point = ", ".join(f"{1e3 * x:.1f}" for x in self.at(np.array([length]))[0][0])
        return f"line from pose {k + 1} to {k + 2}, at {100 * share:.0f} % of it ({point} mm)"


def _followed(arm: ArmModel, lines: _Lines, start: np.ndarray) -> ToolPath:
    """The path that begins in one posture."""
    legs, places, q = [], [], start
    for first, last in pairwise(lines.corners):
        lengths, samples = _solutions(arm, lines, lines.lengths[first], lines.lengths[last], q)
        legs.append(Leg.fitted(samples, np.full(arm.n, _CURVE)))
        places.append(lengths[legs[-1].numbers])
        q = samples[-1]
    freely = {"full": "", "axis": ", turning freely about its axis", "free": ", turning freely"}
    stops = len(lines.corners) - 2
    how = f"straight lines of the gripper between {len(lines.points)} poses{freely[lines.how[0]]}"
    how += f", {stops} corners at which it stops" if stops else ""
    fitted = joined(legs, how)
    points, turns = lines.at(np.concatenate(places))
    q = fitted.path.at(fitted.places)[0]
    tool = miss_sizes(pose_errors(arm, q, points, turns, *lines.how)[0]).max(axis=0)
    return ToolPath(fitted.path, how, fitted.places, fitted.samples, tool, lines.blended)


def _solutions(
    arm: ArmModel, lines: _Lines, begin: float, end: float, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Lengths (M,) and joint positions (M, n) along lines, from the posture `q` on."""
    lengths, solutions, step = [begin], [q], (end - begin) / _FIRST
    least = (end - begin) / _MOST
    while lengths[-1] < end:
        ahead = min(lengths[-1] + step, end)
        near = solutions[-1]
        if len(lengths) > 1:
            near = near + (ahead - lengths[-1]) / (lengths[-1] - lengths[-2]) * (near - solutions[-2])
        solution, there = _solved(arm, lines, near[None], *lines.at(np.array([ahead])))
        if there[0] and np.abs(solution[0] - solutions[-1]).max() <= NEAR:
            lengths.append(ahead)
            solutions.append(solution[0])
            step = min(2 * step, (end - begin) / _FIRST)
        elif step > least:
            step *= 0.5
        else:
            raise _refusal(arm, lines, np.array([ahead, min(ahead + _FURTHER, end)]), solutions[-1])
    return _refined(arm, lines, np.array(lengths), np.array(solutions))


def _refined(
    arm: ArmModel, lines: _Lines, lengths: np.ndarray, result: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solutions between those that are known, until there are enough for a fit."""
    shortest = min((r for r in lines.reaches if r), default=np.inf)
    while len(lengths) < max(_LEAST, _IN_BLEND * (lengths[-1] - lengths[0]) / (2 * shortest)):
        middles = 0.5 * (lengths[1:] + lengths[:-1])
        solution, there = _solved(arm, lines, 0.5 * (result[1:] + result[:-1]), *lines.at(middles))
        if not there.all():
            k = int(np.argmin(there))
            raise _refusal(arm, lines, middles[k : k + 1], result[k])
        order = np.argsort(np.concatenate([lengths, middles]), kind="stable")
        lengths, result = np.concatenate([lengths, middles])[order], np.concatenate([result, solution])[order]
    return lengths, result


def _solved(
    arm: ArmModel, lines: _Lines, near: np.ndarray, points: np.ndarray, turns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Postures (N, n) near given ones, and whether they are postures of the poses, (N,)."""
    q, _ = search(arm, near, points, turns, *lines.how)
    return q, reached(*pose_errors(arm, q, points, turns, *lines.how), REACHED)


def _refusal(arm: ArmModel, lines: _Lines, lengths: np.ndarray, q: np.ndarray) -> InputError:
    """Why the first of some places cannot be gone to; where reach ends, that shows at the last one only."""
    where = lines.where(float(lengths[0]))
    if lines.how[0] != "full":
        ends = [lines.at(lengths[k : k + 1]) for k in (0, -1)]
        miss = max(search(arm, q[None], *end, *lines.how)[1][0] for end in ends)
        return InputError(f"{where}: not reached within the joint limits; missed by {miss:.2g} (m, rad)")
    points, turns = lines.at(lengths)
    try:
        solve_inverse_kinematics(arm, points[-1], turns[-1], near=q)
        other = solve_inverse_kinematics(arm, points[0], turns[0], near=q).nearest(q)
    except InputError as error:
        return InputError(f"{where}: {error.text.removeprefix('pose: ')}")
    joint = int(np.argmax(np.abs(other - q)))
    jump = arm.in_degrees(np.abs(other - q))[joint]
    return InputError(
        f"{where}: cannot be followed further: joint {arm.joint_names[joint]} would have to turn at once by "
        f"{jump:.1f} {arm.file_units[joint]} (an angle limit, or a singular pose)"
    )


def tool_distance(arm: ArmModel, fit: FittedPath) -> float:
    """Largest distance, m, of the TCP on a path from where it is at the samples."""
    on_path, given = (gripper_pose(arm, q)[0] for q in (fit.path.at(fit.places)[0], fit.samples))
    return float(np.linalg.norm(on_path - given, axis=1).max())
