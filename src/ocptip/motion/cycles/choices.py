"""Which postures a cycle goes through: poses leave several, and the cheapest one depends on all segments.

Every segment between two postures is ranked by the cost of its synchronised default motion, as in
`motion.choices`, and of the rest after it. The postures of all poses are chosen together: the cheapest paths
through the layers of postures, closed if the cycle is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from ocptip.motion.choices import NEARLY, line_overlap, plainest_cost
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.task import MotionTask, Segment, end_refusals
from ocptip.robots.inverse.joint_angles import within_limits

CANDIDATES = 12  # postures per pose, at most: those through which the shortest ways lead
COMPARED = 32
"""Pairs of postures per segment: those with the shortest joint paths, and the shortest of each posture."""
PLANNED, WORSE = 4, 1.15
"""Maximum number of sequences of postures, and their maximum default cost relative to the best."""
DETOUR = 1.5
"""Cost of a segment whose straight line overlaps far, relative to that line: a path around is longer."""
NEVER = 1e6  # cost, in units of the objective's size, of a segment whose plainest motion never stands
_SAME = 1e-6  # rad, m

Way = tuple[int, ...]
"""Numbers of the postures in the layers."""
Cost = Callable[[int, int, int], float]
"""Cost of a segment between two postures: numbers of segment and postures; infinite where there is none."""


def layers_of(task: CycleTask) -> list[np.ndarray]:
    """Postures at the start and at the end of each segment, (k, n) each; those that rest within limits.

    Angles that limits allow more than once are taken near zero and near those of the start. The last layer of
    a closed cycle is the first.
    """
    layers, segments = [task.starts], task.segments
    for number, segment in enumerate(segments):
        if task.closed and number == len(segments) - 1:
            layers.append(layers[0])
        else:
            layers.append(_copies(segment, task.starts))
    for number in range(len(segments) + (not task.closed)):
        ends = [(segments[k].task, number - k) for k in (number - 1, number) if 0 <= k < len(segments)]
        if task.closed and number == 0:
            ends.append((segments[-1].task, 1))
        layers[number] = _standing(ends, layers[number])
    if task.closed:
        layers[-1] = layers[0]
    return _promising(task, layers)


def _promising(task: CycleTask, layers: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The postures of each layer through which the shortest paths lead."""
    lengths = [
        np.sum(np.abs(after[None] - before[:, None]) / _speeds(task.segments[0]), axis=2)
        for before, after in pairwise(layers)
    ]
    to = [np.zeros(len(layers[0]))]
    for length in lengths:
        to.append(np.min(to[-1][:, None] + length, axis=0))
    onward = [np.zeros(len(layers[-1]))]
    for length in reversed(lengths):
        onward.insert(0, np.min(length + onward[0], axis=1))
    through = [a + b for a, b in zip(to, onward, strict=True)]
    if task.closed:
        through[0] = through[-1] = np.minimum(through[0], through[-1])
    best = [np.sort(np.argsort(costs, kind="stable")[:CANDIDATES]) for costs in through]
    return [layer[costs] for layer, costs in zip(layers, best, strict=True)]


def _speeds(segment: Segment) -> np.ndarray:
    """Speed limits (n,), 1 where there is none."""
    speed = segment.task.robot.limits.speed
    return np.where(np.isfinite(speed), speed, 1.0)


def likely_sequences(task: CycleTask, layers: Sequence[np.ndarray]) -> list[Way]:
    """The most promising paths through the layers, best first; the only one if there is no choice."""
    if all(len(layer) == 1 for layer in layers):
        return [(0,) * len(layers)]
    costs = [
        _costs(segment, before, after)
        for segment, before, after in zip(task.segments, layers[:-1], layers[1:], strict=True)
    ]
    result = best_sequences(
        [len(layer) for layer in layers], lambda k, i, j: costs[k][i, j], task.closed, PLANNED
    )
    least = result[0][0]
    return [way for cost, way in result if cost <= WORSE * least]


def best_sequences(sizes: Sequence[int], cost: Cost, closed: bool, count: int) -> list[tuple[float, Way]]:
    """The cheapest paths through layers of postures, with their costs, best first; exact.

    Args:
        sizes: number of postures per layer.
        cost: of a segment between postures of neighbouring layers.
        closed: only paths that end in the posture of the first layer that they start from.
        count: maximum number of paths.
    """
    results: list[tuple[float, Way]] = []
    for group in [[i] for i in range(sizes[0])] if closed else [range(sizes[0])]:
        best: dict[int, list[tuple[float, Way]]] = {i: [(0.0, (i,))] for i in group}
        for k, size in enumerate(sizes[1:]):
            ends = group if closed and k == len(sizes) - 2 else range(size)
            best = {
                j: sorted(
                    (spent + step, (*way, j))
                    for i, entries in best.items()
                    if np.isfinite(step := cost(k, i, j))
                    for spent, way in entries
                )[:count]
                for j in ends
            }
        results += [entry for entries in best.values() for entry in entries]
    return sorted(results)[:count]


def rest_cost(segment: Segment, goal: np.ndarray) -> float:
    """Cost of the standstill after a segment that ends in posture `goal`, (n,), in units of the objective."""
    return segment.task.objective.cost(segment.standby(goal) * segment.rest, segment.rest)


def leg_cost(segment: Segment, start: np.ndarray, goal: np.ndarray) -> float:
    """Cost of the synchronised default motion between postures (n,) and the rest after it, in units of the
    objective's size.

    Infinite if it never stands. Where it collides, a path around is estimated.
    """
    task = segment.between(start, goal)
    cost = plainest_cost(task)
    if task.robot.collision.labels and line_overlap(task)[0] > NEARLY:
        cost *= DETOUR
    return (cost + rest_cost(segment, goal)) / segment.task.objective.size


def _costs(segment: Segment, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(k, l) of the synchronised default motions, in units of the objective's size; infinite where not
    checked.
    """
    lengths = np.sum(np.abs(after[None] - before[:, None]) / _speeds(segment), axis=2)
    shortest = np.full(lengths.shape, False)
    shortest.ravel()[np.argsort(lengths, axis=None, kind="stable")[:COMPARED]] = True
    shortest[np.arange(len(before)), np.argmin(lengths, axis=1)] = True
    shortest[np.argmin(lengths, axis=0), np.arange(len(after))] = True
    costs = np.full(lengths.shape, np.inf)
    for i, j in zip(*np.nonzero(shortest), strict=True):
        cost = leg_cost(segment, before[i], after[j])
        costs[i, j] = cost if np.isfinite(cost) else NEVER + lengths[i, j]
    return costs


def _copies(segment: Segment, starts: np.ndarray) -> np.ndarray:
    """The segment's goals, angles of several IK solutions also near those of the starts; each once."""
    arm, goals = segment.task.robot.arm, segment.goals
    if len(goals) == 1 or arm is None:
        return goals
    copies = [within_limits(arm, goal, near) for near in starts for goal in goals]
    kept: list[np.ndarray] = []
    for q in (*goals, *copies):
        if np.isfinite(q).all() and not any(np.abs(q - other).max() < _SAME for other in kept):
            kept.append(q)
    return np.array(kept)


def _standing(ends: Sequence[tuple[MotionTask, int]], postures: np.ndarray) -> np.ndarray:
    """Those of the postures (k, n) in which all robots stand at rest; else the one with fewest reasons.

    `ends` are motions that begin (0) or end (1) there.
    """
    if len(postures) == 1:
        return postures
    reasons = np.array([sum(len(end_refusals(*end, q)) for end in ends) for q in postures])
    return postures[reasons == 0] if (reasons == 0).any() else postures[[int(np.argmin(reasons))]]
