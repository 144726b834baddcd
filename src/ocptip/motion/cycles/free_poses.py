"""Poses of a cycle that leave a continuum of postures: these are moved to the minimum cost of the cycle.

Such poses are free within a range, or the arm has more joints than they have conditions. A sequence of
postures of the cycle is ranked as in `cycles.choices`, by the synchronised default motions of its segments
and the rests; its postures are moved one after the other, along the ranges and the redundancy, by steps that
become smaller.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ocptip.motion.cycles.choices import WORSE, Way, leg_cost
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.planner.free_ends import FOUND_MARGIN
from ocptip.motion.task import end_refusals
from ocptip.robots.inverse.pose_search import pose_errors, search
from ocptip.robots.inverse.pose_target import REACHED, PoseTarget
from ocptip.robots.model import ArmModel
from ocptip.standing.arm import Robot

STEPS = (0.5, 0.25, 0.125, 0.0625)
"""Steps as shares of a range of the TCP, or of `TURN` along a redundancy."""
TURN = 0.8  # rad (sliding joints: m), of the joint that moves most
SPARED = 1e-4  # share of the cost that a step has to spare
_SAME = 1e-6  # rad, m
_DEPENDENT = 1e-6  # smaller singular values, relative to the largest, are zero


def moved_sequences(
    task: CycleTask, layers: Sequence[np.ndarray], sequences: Sequence[Way]
) -> tuple[list[np.ndarray], list[Way]]:
    """The layers with the postures of moved sequences, and these sequences, best first; then the best unmoved
    one.

    All as they are where no pose leaves a continuum.

    Args:
        task: the cycle.
        layers: postures at start and goals, (k, n) each.
        sequences: through them, best first.
    """
    if not (free := free_ends(task)):
        return list(layers), list(sequences)
    moved = [
        MovedWay(task, free, [layer[i] for layer, i in zip(layers, way, strict=True)]) for way in sequences
    ]
    for row in moved:
        row.descend()
    moved.sort(key=lambda row: row.cost)
    kept = [row for row in moved if row.cost <= WORSE * moved[0].cost]
    rows, results = [list(layer) for layer in layers], []
    for row in kept:
        way = [_index(layer, q) for layer, q in zip(rows, row.postures, strict=True)]
        results.append((*way[:-1], way[0] if task.closed else way[-1]))
    if task.closed:
        rows[-1] = rows[0]
    return [np.array(row) for row in rows], list(dict.fromkeys([*results, sequences[0]]))


def free_ends(task: CycleTask) -> dict[int, PoseTarget]:
    """Poses that leave a continuum of postures, by their number among `CycleTask.ends`."""
    if (arm := task.robot.arm) is None or (task.closed and len(task.segments) == 1):
        return {}
    ends = task.ends[:-1] if task.closed else task.ends
    poses = {k: target for k, (_, _, target) in enumerate(ends) if target is not None}
    n = task.robot.n
    return {k: target for k, target in poses.items() if target.free.any() or n > target.independent(arm)}


def _index(layer: list[np.ndarray], q: np.ndarray) -> int:
    """Where a posture is in a layer; it is added if it is not there."""
    for k, other in enumerate(layer):
        if np.abs(other - q).max() < _SAME:
            return k
    layer.append(q)
    return len(layer) - 1


class MovedWay:
    """Postures at start and goals that are moved, and what the segments between them cost.

    Args:
        task: the cycle.
        free: of `free_ends`.
        postures: to begin with, (n,) each, rad (sliding joints: m).
    """

    def __init__(self, task: CycleTask, free: dict[int, PoseTarget], postures: Sequence[np.ndarray]) -> None:
        self._task, self._arm, self.postures = task, Robot.of(task.robot).arm, list(postures)
        self._free = {k: target.nearest(self._arm, self.postures[k]) for k, target in free.items()}
        self._costs = [self._leg(k, self.postures) for k in range(len(task.segments))]
        limits, margin = self._arm.limits, np.where(self._arm.prismatic, 0.0, FOUND_MARGIN)
        self._low = np.minimum(limits.angle_min + margin, np.min(postures, axis=0))
        self._high = np.maximum(limits.angle_max - margin, np.max(postures, axis=0))

    @property
    def cost(self) -> float:
        """Cost of all segments, in units of the objective's size."""
        return float(np.sum(self._costs))

    def _leg(self, k: int, postures: Sequence[np.ndarray]) -> float:
        return leg_cost(self._task.segments[k], postures[k], postures[k + 1])

    def _around(self, end: int) -> list[int]:
        """Numbers of the segments that meet at an end."""
        count = len(self._task.segments)
        before = end - 1 if end or not self._task.closed else count - 1
        return [k for k in (before, end) if 0 <= k < count]

    def descend(self) -> None:
        """Move the postures while the cost falls."""
        for step in STEPS:
            for end, target in self._free.items():
                for direction in range(len(self._directions(target, self.postures[end]))):
                    for way in (step, -step):
                        while self._moved(end, target, direction, way):
                            pass

    def _directions(self, target: PoseTarget, q: np.ndarray) -> list[np.ndarray]:
        """Where a posture may move: the widths (3,) of ranges, m, then joint angles (n,), rad."""
        widths = np.diag(np.ptp(target.free, axis=1))
        return [*widths[widths.any(axis=1)], *_redundancy(self._arm, target, q)]

    def _moved(self, end: int, target: PoseTarget, direction: int, step: float) -> bool:
        """Whether a step along a direction spares cost; then it is taken."""
        q, arm = self.postures[end], self._arm
        offset = target.offsets(arm, q[None])[0]
        along = self._directions(target, q)[direction : direction + 1]
        if not along:
            return False
        begin, wanted = q, offset
        if len(along[0]) == len(offset) and direction < np.count_nonzero(np.ptp(target.free, axis=1)):
            wanted = np.clip(offset + step * along[0], *target.free.T)
            if np.abs(wanted - offset).max() < _SAME:
                return False
        else:
            begin = q + step * along[0]
        result, there = posture_near(arm, target.at(wanted), begin)
        inside = np.all((result >= self._low) & (result <= self._high))
        if not there or not inside or np.abs(result - q).max() < _SAME or self._refused(end, result):
            return False
        postures, around = list(self.postures), self._around(end)
        postures[end] = result
        if self._task.closed:
            postures[-1] = postures[0]
        costs = [self._leg(k, postures) for k in around]
        if not sum(costs) < (1 - SPARED) * sum(self._costs[k] for k in around):
            return False
        self.postures = postures
        for k, cost in zip(around, costs, strict=True):
            self._costs[k] = cost
        return True

    def _refused(self, end: int, q: np.ndarray) -> bool:
        """Whether a robot that gets or leaves there does not rest there within its limits."""
        meeting = self._around(end)
        return any(end_refusals(self._task.segments[k].task, int(k != end), q) for k in meeting)


def posture_near(arm: ArmModel, target: PoseTarget, q: np.ndarray) -> tuple[np.ndarray, bool]:
    """The posture (n,) at which an iteration from q (n,), rad, ends, and whether it is one of the pose."""
    result, _ = search(arm, q[None], target.position[None], target.rotation[None], *target.how)
    return result[0], bool(target.reached(arm, result, REACHED)[0])


def _redundancy(arm: ArmModel, target: PoseTarget, q: np.ndarray) -> list[np.ndarray]:
    """Moves (n,) that leave the pose as it is, to first order; the joint that moves most moves by `TURN`."""
    jacobian = pose_errors(arm, q[None], target.position, target.rotation, *target.how)[1][0]
    _, sizes, rows = np.linalg.svd(jacobian)
    rank = min(int(np.sum(sizes > _DEPENDENT * sizes[0])), target.conditions)
    moves = []
    for row in rows[rank:]:
        most = row[np.argmax(np.abs(row))]
        moves.append(TURN * row / most)
    return moves
