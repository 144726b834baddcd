"""Improves candidates by a random local search before the nonlinear programs start.

Around each candidate further ones are drawn, all at once; the arm follows by Newton steps from the angles it
has, so that it keeps its IK solution. A few rounds bring a candidate near its local optimum, and candidates
that share one together, for a fraction of the cost of a program.
"""

from __future__ import annotations

import numpy as np

from ocptip.placement.evaluate import Evaluator
from ocptip.placement.search.starts import Candidates, exact_scores, joined, rough_scores, turns_beneath
from ocptip.robots.inverse.joint_angles import within_limits
from ocptip.robots.inverse.pose_search import search

_ROUNDS = 10
_FIRST_ROUNDS = 3  # then only the better candidates go on
_GO_ON = 0.4
_DRAWS = 12  # per candidate and round
_FINER = np.logspace(0.0, -1.5, _DRAWS)[None, :, None]  # shares of the radius, one per draw
_RADIUS = 0.1  # of the parameters' scales and, in rad, of joint angles: standard deviation of the first round
_TURN = 4.0  # the same for the base's angle, relative to the others
_SHRINK = 0.6
_CLOSE = 1e-7
_TURNS = 24  # angles of the base tried at each candidate
_PENALTY = 10.0  # objective per violation in comparable units
_TOGETHER = 0.03  # of the scales, rad


def improved(evaluator: Evaluator, candidates: Candidates, rng: np.random.Generator) -> Candidates:
    """The candidates after a local search, the best first, without those that ended at the same place."""
    parts = []
    for patch in np.unique(candidates.patches):
        indices = np.flatnonzero(candidates.patches == patch)
        parameters = np.array([candidates.parameters[i] for i in indices])
        parts.append((patch, *_improved_on(evaluator, patch, parameters, candidates.angles[indices], rng)))
    patches = np.concatenate([np.full(len(part[1]), part[0]) for part in parts])
    parameters = [p for part in parts for p in part[1]]
    angles, scores, totals, margins = (np.concatenate([part[i] for part in parts]) for i in (2, 3, 4, 5))
    scales = [evaluator.problem.scales(patch) for patch in range(len(evaluator.problem.terrain))]
    kept: list[int] = []
    for i in np.argsort(scores, kind="stable"):
        if not any(
            patches[i] == patches[j]
            and np.max(np.abs(parameters[i] - parameters[j]) / scales[patches[i]]) < _TOGETHER
            and np.max(np.abs(angles[i] - angles[j])) < 2 * _TOGETHER
            for j in kept
        ):
            kept.append(int(i))
    result = Candidates(patches, parameters, angles, totals, margins, candidates.sampled, candidates.reached)
    return result.select(kept)


def around(
    evaluator: Evaluator,
    places: list[tuple[int, np.ndarray, np.ndarray]],
    copies: int,
    afar: float,
    rng: np.random.Generator,
) -> Candidates:
    """Candidates that a local search finds from points around given places, the best first.

    Args:
        places: patch, parameters (k,) and angles (tasks, n) of each.
        copies: points drawn around each.
        afar: how far from it: standard deviation, in the parameters' scales and, doubled, in rad.
    """
    problem, patches, parameters, angles = evaluator.problem, [], [], []
    for patch, p, q in places:
        terrain = problem.terrain[patch]
        steps = afar * rng.normal(size=(copies, len(p))) * _units(evaluator, patch)
        drawn = np.clip(p + steps, terrain.lower, terrain.upper)
        first = q + 2 * afar * rng.normal(size=(copies, *q.shape))
        reached, exact = followed(evaluator, patch, drawn, first)
        patches += [patch] * int(exact.sum())
        parameters += list(drawn[exact])
        angles += list(reached[exact])
    unknown = np.full(len(patches), np.nan)
    drawn = Candidates(np.array(patches, dtype=int), parameters, np.array(angles), unknown, unknown, 0, 0)
    return improved(evaluator, drawn, rng) if len(patches) else drawn


def turned(evaluator: Evaluator, candidates: Candidates) -> Candidates:
    """The candidates with the base turned beneath the arm to the best angle, where that is possible.

    On a plane, where the first joint turns about the ground's normal, it can make up for a turn of the base,
    and the arm stays where it is. Tip-over and slip depend on the base's angle with several minima.
    """
    problem, arm = evaluator.problem, evaluator.arm
    parts, which = [candidates], [np.arange(len(candidates))]
    for patch in np.unique(candidates.patches):
        if not turns_beneath(evaluator, patch):
            continue
        terrain = problem.terrain[patch]
        axis = (arm.mount_rotation @ arm.rotations[0])[:, 2] @ problem.ground_frame[1][:, 2]
        indices = np.flatnonzero(candidates.patches == patch)
        turns = np.repeat(2 * np.pi * np.arange(1, _TURNS) / _TURNS, len(indices))
        p = np.tile(np.array([candidates.parameters[i] for i in indices]), (_TURNS - 1, 1))
        q = np.tile(candidates.angles[indices], (_TURNS - 1, 1, 1))
        before = _mounts(evaluator, patch, p)
        p[:, terrain.angular.index(True)] += turns
        q[:, :, 0] -= np.sign(axis) * turns[:, None]
        q[:, :, 0] = within_limits(arm, q)[:, :, 0]
        p[:, terrain.horizontal] += (before - _mounts(evaluator, patch, p))[:, :2]
        p = terrain.wrapped(p)
        kept = np.isfinite(q[:, :, 0]).all(axis=1)
        kept &= ((p >= terrain.lower) & (p <= terrain.upper)).all(axis=1)
        kept = np.flatnonzero(kept)
        q, exact = followed(evaluator, patch, p[kept], q[kept])
        kept, q = kept[exact], q[exact]
        if len(kept):
            total, margin = exact_scores(evaluator, patch, p[kept], q, fast=True)
            parts.append(Candidates(np.full(len(kept), patch), list(p[kept]), q, total, margin, 0, 0))
            which.append(np.tile(indices, _TURNS - 1)[kept])
    result, of = joined(parts, candidates.sampled, candidates.reached), np.concatenate(which)
    rank = np.where(result.margins >= 0, result.totals, 1e6 - np.maximum(result.margins, -1e5))
    order = np.argsort(np.nan_to_num(rank, nan=1e9), kind="stable")
    first = np.sort(np.unique(of[order], return_index=True)[1])
    return result.select(order[first])


def _mounts(evaluator: Evaluator, patch: int, parameters: np.ndarray) -> np.ndarray:
    """World positions (N, 3), m, of the arm's first joint."""
    origin, base = evaluator.place(patch, parameters)
    return origin + base @ evaluator.arm.mount_position


def _units(evaluator: Evaluator, patch: int) -> np.ndarray:
    """How far the parameters (k,) of a patch are moved at a time, relative to each other."""
    return evaluator.problem.scales(patch) * np.where(evaluator.problem.terrain[patch].angular, _TURN, 1.0)


def _improved_on(
    evaluator: Evaluator, patch: int, parameters: np.ndarray, angles: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, ...]:
    """Parameters (N, k), angles (N, tasks, n), scores, objectives and margins (N,) on one patch."""
    terrain = evaluator.problem.terrain[patch]
    best_p, best_q = parameters.copy(), angles.copy()
    score, total, margin = _scores(evaluator, patch, best_p, best_q)
    unit = _units(evaluator, patch)
    radius = np.full(len(best_p), _RADIUS)
    for turn in range(_ROUNDS):
        if turn == _FIRST_ROUNDS:
            kept = np.argsort(score, kind="stable")[: max(round(_GO_ON * len(score)), 1)]
            best_p, best_q, radius = best_p[kept], best_q[kept], radius[kept]
            score, total, margin = score[kept], total[kept], margin[kept]
        N, k = best_p.shape
        # Wide draws alone leave narrow basins: what breaks a constraint by a little jumps to a worse place.
        spread = radius[:, None, None] * _FINER
        steps = rng.normal(size=(N, _DRAWS, k)) * spread * unit
        p = np.clip(best_p[:, None] + steps, terrain.lower, terrain.upper).reshape(-1, k)
        first = np.repeat(best_q, _DRAWS, axis=0)
        first = first + rng.normal(size=first.shape) * spread.reshape(-1, 1, 1)
        q, exact = followed(evaluator, patch, p, first)
        value, goal, smallest = (np.full(len(p), np.inf) for _ in range(3))
        if exact.any():
            indices, below = np.flatnonzero(exact), np.repeat(score, _DRAWS)[exact]
            kept = indices[_score(*rough_scores(evaluator, patch, p[indices], q[indices])) < below]
            if len(kept):
                value[kept], goal[kept], smallest[kept] = _scores(evaluator, patch, p[kept], q[kept])
        leader = np.argmin(value.reshape(N, _DRAWS), axis=1) + _DRAWS * np.arange(N)
        better = value[leader] < score
        indices = leader[better]
        best_p[better], best_q[better] = p[indices], q[indices]
        score[better], total[better], margin[better] = value[indices], goal[indices], smallest[indices]
        radius *= np.where(better, 1.0, _SHRINK)
    return best_p, best_q, score, total, margin


def followed(
    evaluator: Evaluator, patch: int, parameters: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Angles (N, tasks, n) that do the tasks from parameters (N, k), near given ones, and where they do."""
    origin, base = evaluator.place(patch, parameters)
    result, exact = angles.copy(), np.arange(len(angles))
    for t, task in enumerate(evaluator.problem.tasks):
        position, rotation = evaluator.targets(t, origin[exact], base[exact])
        result[exact, t], error = search(
            evaluator.arm, angles[exact, t], position, rotation, task.orientation, task.tool_axis
        )
        exact = exact[error < _CLOSE]
    return result, np.isin(np.arange(len(angles)), exact)


def _scores(
    evaluator: Evaluator, patch: int, parameters: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    total, margin = exact_scores(evaluator, patch, parameters, angles, fast=True)
    return _score(total, margin), total, margin


def _score(total: np.ndarray, margin: np.ndarray) -> np.ndarray:
    """Objective plus the penalty of violations."""
    broken = np.maximum(-margin, 0)
    return np.nan_to_num(total, nan=1e3) + _PENALTY * np.minimum(broken, 1e3)
