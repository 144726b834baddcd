"""Candidates to start from: a sample of the terrain with all IK solutions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # subpackages load on first use

from ocptip.basics.values import rotations
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.limits.limit import smallest_margin
from ocptip.robots.inverse.closed_form import branches_within_limits, closed_form_family
from ocptip.robots.inverse.joint_angles import search_box
from ocptip.robots.inverse.pose_search import search

_ENOUGH = 600  # standing places from which all tasks can be reached
_ROUNDS = 3
_SEARCHES = 6  # starts per pose where there is no closed form
_SEARCH_COSTS = 8  # times as much as closed forms
_ROLLS = 3  # turns about the tool axis tried where it is free
_CLOSE = 1e-7
_PARALLEL = 1e-9
_NEAREST = 1e-3
_SLIGHTLY = 0.5  # in 0.1 m: the base may violate its limits that much at first
_AWAY = (0.1, 0.05, 0.025)  # of the scales: standard deviations of draws near the best places
_LEADERS = 100  # number of these
_BESIDE = 4  # times fewer draws than in a round
_APART = 0.2
_BRANCHES = 12  # combinations of branches kept per sampled place
_EXACT = 1000  # candidates whose contacts are solved
_PRICE = 0.3  # objective per violation in comparable units


@dataclass(eq=False)
class Candidates:
    """Sampled placements on all patches with their best IK solutions, the best ones first.

    Attributes:
        patches: (N,) number of the patch.
        parameters: N arrays (k,).
        angles: (N, tasks, n), rad.
        totals: (N,) objective; NaN if not known.
        margins: (N,) smallest margin of all constraints; negative: broken.
        sampled: number of evaluated placements.
        reached: of these, how many reach all tasks, among those that keep the limits of the base alone.
        clear: how many keep the limits of the base alone.
        posed: the tasks are reached; False: as nearly as possible.
    """

    patches: np.ndarray
    parameters: list[np.ndarray]
    angles: np.ndarray
    totals: np.ndarray
    margins: np.ndarray
    sampled: int
    reached: int
    clear: int = 0
    posed: bool = True

    def __len__(self) -> int:
        return len(self.patches)

    def __getitem__(self, i: int) -> tuple[int, np.ndarray, np.ndarray]:
        """Patch, parameters (k,) and angles (tasks, n) of one."""
        return int(self.patches[i]), self.parameters[i], self.angles[i]

    def select(self, numbers: list[int] | np.ndarray) -> Candidates:
        """Those with the given numbers."""
        return replace(
            self,
            patches=self.patches[numbers],
            parameters=[self.parameters[i] for i in numbers],
            angles=self.angles[numbers],
            totals=self.totals[numbers],
            margins=self.margins[numbers],
        )


def solutions(
    evaluator: Evaluator,
    task: int,
    patch: int,
    parameters: np.ndarray,
    rng: np.random.Generator,
    approach: bool = False,
) -> np.ndarray:
    """Joint angles (N, B, n) with which a task is done from parameters (N, k); NaN where there are none.

    Where part of the orientation is free, or there is no closed form, they are a random choice.

    Args:
        approach: where the pose is out of reach give the angles that come nearest.
    """
    problem = evaluator.problem
    wanted, arm = problem.tasks[task], evaluator.arm
    origin, base = evaluator.place(patch, parameters)
    N = len(origin)
    if closed_form_family(arm) is not None and not approach:
        rounds = []
        for _ in range(1 if wanted.orientation == "full" else _ROLLS):
            rotation = wanted.rotation
            if wanted.orientation == "axis":
                roll = rng.uniform(-np.pi, np.pi, N)
                rotation = rotation @ rotations().from_rotvec(roll[:, None] * wanted.tool_axis).as_matrix()
            elif wanted.orientation == "free":
                rotation = rotations().random(N, rng).as_matrix()
            rounds.append(branches_within_limits(arm, *evaluator.targets(task, origin, base, rotation)))
        return np.concatenate(rounds, axis=1)
    position, rotation = evaluator.targets(task, origin, base)
    low, high = search_box(arm)
    results = []
    for _ in range(_SEARCHES):
        first = low + rng.random((N, arm.n)) * (high - low)
        q, error = search(arm, first, position, rotation, wanted.orientation, wanted.tool_axis)
        if not approach:
            q[error > _CLOSE] = np.nan
        results.append(q)
    return np.stack(results, axis=1)


def sample(evaluator: Evaluator, rng: np.random.Generator, count: int) -> Candidates:
    """Sampled candidates, sorted by objective and a penalty of violations.

    After the rounds over the whole terrain come some near the most promising places so far, ever nearer: in
    clutter the best basins may be too narrow for an even sample.

    Args:
        count: placements per round; rounds go on until enough of them reach all tasks.
    """
    patches, kept, blocked, sampled, clear = range(len(evaluator.problem.terrain)), [], [], 0, 0
    if closed_form_family(evaluator.arm) is None:
        count //= _SEARCH_COSTS
    share = max(count // len(patches), 32)

    def evaluate(patch: int, parameters: np.ndarray) -> None:
        nonlocal sampled, clear
        ground = smallest_margin(evaluator.ground(patch, parameters), len(parameters))
        near = ground >= -_SLIGHTLY
        sampled, clear = sampled + len(parameters), clear + int(np.sum(ground >= 0))
        kept.append(best_branches(evaluator, patch, parameters[near], ground[near], rng))
        blocked.append((patch, parameters[~near], ground[~near]))

    def reached() -> int:
        return sum(part.reached for part in kept)

    for _ in range(_ROUNDS):
        for patch in patches:
            evaluate(patch, _draw(evaluator, patch, rng, share))
        if reached() >= _ENOUGH:
            break
    for away in _AWAY:
        best = _best_of(kept)
        best = best.select(spread(evaluator, best, _LEADERS, _APART, postures=True))
        for patch in np.unique(best.patches):
            indices = best.select(np.flatnonzero(best.patches == patch))
            evaluate(patch, _beside(evaluator, indices, rng, max(share // _BESIDE, 32), away))
    if not reached():
        kept += [best_branches(evaluator, patch, p, ground, rng) for patch, p, ground in blocked]
    candidates = _best_of(kept)
    candidates = (
        ranked(evaluator, candidates) if len(candidates) else _nearest_misses(evaluator, rng, count, sampled)
    )
    return replace(candidates, sampled=sampled, reached=reached(), clear=clear)


def best_branches(
    evaluator: Evaluator, patch: int, parameters: np.ndarray, ground: np.ndarray, rng: np.random.Generator
) -> Candidates:
    """For each placement from which all tasks can be reached, the best combinations of IK solutions of the
    tasks.

    The best one keeps all constraints checked here (all except those of the contact solver) with the minimum
    objective, else it has the minimum violation. Others are also kept: in clutter they may do after a small
    move.

    Args:
        ground: (N,) smallest margin of the limits of the base alone at parameters (N, k).
    """
    n, tasks = evaluator.arm.n, range(len(evaluator.problem.tasks))
    alive, results = np.arange(len(parameters)), []
    for t in tasks if len(alive) else ():
        q = solutions(evaluator, t, patch, parameters[alive], rng)
        reached = np.any(np.isfinite(q).all(axis=2), axis=1)
        alive = alive[reached]
        results = [joints_of_task[reached] for joints_of_task in [*results, q]]
        if not len(alive):
            break
    places = parameters[alive]
    chosen = np.empty((len(alive), 1, 0, n))
    criteria, margin = np.zeros((len(alive), 1, 4)), ground[alive][:, None]
    share = [sum(case.counts for case in cases) for cases in evaluator.cases]
    for t in tasks if len(alive) else ():
        joints_of_task = _branches(evaluator, t, patch, places, results[t])
        joints_of_task[1][:, :, -1] *= share[t] / sum(share)
        chosen, criteria, margin = _combined(evaluator, (chosen, criteria, margin), joints_of_task)
    if not len(alive):
        chosen = np.empty((0, 1, len(tasks), n))
    who, rank = np.nonzero(np.isfinite(criteria[:, :, 0]))
    return Candidates(
        np.full(len(who), patch),
        list(places[who]),
        chosen[who, rank],
        evaluator.totals(criteria[who, rank]),
        margin[who, rank],
        len(parameters),
        int(np.sum(ground[alive] >= 0)),
    )


def _branches(
    evaluator: Evaluator, task: int, patch: int, parameters: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles (N, B, 1, n) of a task, lower bounds of its criteria (N, B, 4), infinite where there is no IK
    solution, and margins (N, B).
    """
    criteria, margin = np.full((*q.shape[:2], 4), np.inf), np.full(q.shape[:2], -np.inf)
    indices = np.nonzero(np.isfinite(q).all(axis=2))
    evaluation = evaluator.task(task, patch, parameters[indices[0]], q[indices], contacts=False)
    criteria[indices], margin[indices] = evaluator.least_criteria([evaluation]), evaluation.margin()
    return q[:, :, None], criteria, margin


def _combined(evaluator: Evaluator, first: tuple, second: tuple) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The best combinations of IK solutions of some tasks with those of one more."""
    both = np.maximum(first[1][:, :, None], second[1][:, None])
    both[..., -1] = first[1][:, :, None, -1] + second[1][:, None, :, -1]
    margin = np.minimum(first[2][:, :, None], second[2][:, None])
    N, K, B = margin.shape
    both, margin = both.reshape(N, K * B, 4), margin.reshape(N, K * B)
    totals = np.where(
        np.isfinite(both[:, :, 0]), evaluator.totals(both.reshape(-1, 4)).reshape(N, -1), np.inf
    )
    rank = np.where(margin >= 0, totals, 1e3 + totals - _PRICE * np.maximum(margin, -1e5))
    best = np.argsort(rank, axis=1, kind="stable")[:, :_BRANCHES]
    rows = np.arange(N)[:, None]
    angles = np.concatenate([first[0][rows, best // B], second[0][rows, best % B]], axis=2)
    return angles, both[rows, best], margin[rows, best]


def rough_scores(
    evaluator: Evaluator, patch: int, parameters: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Lower bound of the objective and smallest margin known without solving contacts, (N,) each.

    Args:
        angles: (N, tasks, n), rad.
    """
    results = [
        evaluator.task(t, patch, parameters, angles[:, t], contacts=False) for t in range(angles.shape[1])
    ]
    margin = np.min([evaluation.margin() for evaluation in results], axis=0)
    return evaluator.totals(evaluator.least_criteria(results)), margin


def _best_of(parts: list[Candidates]) -> Candidates:
    """The most promising candidates of every part, so that many near one place leave room for others."""
    share, chosen = -(-_EXACT // len(parts)), []
    for part in parts:
        order = np.argsort(_rank(part.totals, part.margins), kind="stable")
        chosen.append(part.select(order[:share]))
    return _sorted(joined(chosen, 0, 0))


def ranked(evaluator: Evaluator, candidates: Candidates) -> Candidates:
    """The candidates with their contacts solved, the best first."""
    totals, margins = np.full(len(candidates), np.nan), np.full(len(candidates), -np.inf)
    for patch in np.unique(candidates.patches):
        indices = np.flatnonzero(candidates.patches == patch)
        parameters = np.array([candidates.parameters[i] for i in indices])
        totals[indices], margins[indices] = exact_scores(
            evaluator, patch, parameters, candidates.angles[indices], fast=True
        )
    return _sorted(replace(candidates, totals=totals, margins=margins))


def _sorted(candidates: Candidates) -> Candidates:
    """The same, the best first."""
    return candidates.select(np.argsort(_rank(candidates.totals, candidates.margins), kind="stable"))


def _rank(totals: np.ndarray, margins: np.ndarray) -> np.ndarray:
    """Numbers by which candidates are sorted: the objective, and a penalty of violations that is so low that
    candidates which may become good by a small move are among the first.
    """
    broken = np.clip(-np.nan_to_num(margins, nan=-np.inf), 0, 1e5)
    return np.nan_to_num(totals, nan=1e3, posinf=1e6) + _PRICE * broken


def exact_scores(
    evaluator: Evaluator, patch: int, parameters: np.ndarray, angles: np.ndarray, fast: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Objective and smallest margin of all constraints, (N,) each; angles (N, tasks, n)."""
    results = [evaluator.task(t, patch, parameters, angles[:, t], fast=fast) for t in range(angles.shape[1])]
    margin = smallest_margin(evaluator.ground(patch, parameters), len(parameters))
    for evaluation in results:
        margin = np.minimum(margin, evaluation.margin())
    return evaluator.totals(evaluator.criteria(results)), margin


def spread(
    evaluator: Evaluator, candidates: Candidates, count: int, apart: float = 0.1, postures: bool = False
) -> list[int]:
    """Numbers of up to `count` candidates, the best ones, that differ by more than `apart`.

    Args:
        apart: in the parameters' scales, and half of that in rad of joint angles; halved until there are
            enough.
        postures: turns of the base beneath the arm make no difference.
    """
    problem, n = evaluator.problem, evaluator.arm.n
    places = [np.zeros((0, 0))] * len(problem.terrain)
    numbers = np.zeros(len(candidates), dtype=int)
    for patch in range(len(problem.terrain)):
        indices = np.flatnonzero(candidates.patches == patch)
        numbers[indices] = np.arange(len(indices))
        if not len(indices):
            continue
        parameters = np.array([candidates.parameters[i] for i in indices])
        origin, base = evaluator.place(patch, parameters)
        q = candidates.angles[indices].reshape(len(indices), -1)
        turns = np.hstack([np.cos(q), np.sin(q)])
        where = parameters / problem.scales(patch)
        if postures and turns_beneath(evaluator, patch):
            mount = origin + base @ evaluator.arm.mount_position
            first = np.arange(q.shape[1]) % n == 0
            turns, where = turns[:, ~np.tile(first, 2)], mount[:, :2] / problem.reach
        places[patch] = np.hstack([where, turns / 2])
    chosen: list[int] = []
    near = np.full(len(candidates), np.inf)
    while len(chosen) < min(count, len(candidates)):
        free = np.flatnonzero(near > apart)
        if not len(free):
            apart = apart / 2 if apart > _NEAREST else -1.0
            continue
        i = int(free[0])
        chosen.append(i)
        patch = candidates.patches[i]
        indices = np.flatnonzero(candidates.patches == patch)
        away = np.max(np.abs(places[patch] - places[patch][numbers[i]]), axis=1)
        near[indices] = np.minimum(near[indices], away)
        near[i] = -np.inf
    return chosen


def turns_beneath(evaluator: Evaluator, patch: int) -> bool:
    """Whether the first joint can make up for a turn of the base about the ground's normal."""
    terrain, arm = evaluator.problem.terrain[patch], evaluator.arm
    axis = (arm.mount_rotation @ arm.rotations[0])[:, 2] @ evaluator.problem.ground_frame[1][:, 2]
    leads = arm.joint_names[0] == arm.chain_names[0]
    turns = leads and arm.periodic[0] and abs(abs(axis) - 1) < _PARALLEL
    return turns and terrain.horizontal is not None and sum(terrain.angular) == 1


def joined(parts: list[Candidates], sampled: int, reached: int) -> Candidates:
    """Several sets of candidates as one."""
    return Candidates(
        np.concatenate([part.patches for part in parts]),
        [p for part in parts for p in part.parameters],
        np.concatenate([part.angles for part in parts]),
        np.concatenate([part.totals for part in parts]),
        np.concatenate([part.margins for part in parts]),
        sampled,
        reached,
    )


def _draw(evaluator: Evaluator, patch: int, rng: np.random.Generator, count: int) -> np.ndarray:
    """Quasi-random parameters (count, k) within bounds and reach of the first task."""
    problem = evaluator.problem
    low, high = _box(evaluator, patch)
    unit = scipy.stats.qmc.Halton(problem.terrain[patch].size, rng=rng).random(count)
    return low + unit * (high - low)


def _beside(
    evaluator: Evaluator, candidates: Candidates, rng: np.random.Generator, count: int, away: float
) -> np.ndarray:
    """Parameters (count, k) near those of candidates of one patch."""
    patch = candidates.patches[0]
    terrain = evaluator.problem.terrain[patch]
    near = np.array(candidates.parameters)[rng.integers(len(candidates), size=count)]
    near += away * evaluator.problem.scales(patch) * rng.normal(size=near.shape)
    return np.clip(terrain.wrapped(near), terrain.lower, terrain.upper)


def _box(evaluator: Evaluator, patch: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds from which every task may be in reach; those of the first task if there are none."""
    problem = evaluator.problem
    boxes = [problem.terrain[patch].box(task.position, problem.reach) for task in problem.tasks]
    low, high = np.max([b[0] for b in boxes], axis=0), np.min([b[1] for b in boxes], axis=0)
    return boxes[0] if np.any(low > high) else (low, high)


def _nearest_misses(evaluator: Evaluator, rng: np.random.Generator, count: int, sampled: int) -> Candidates:
    """Where no task pose can be reached: the placements that come nearest."""
    problem, parts = evaluator.problem, []
    for patch in range(len(problem.terrain)):
        parameters = _draw(evaluator, patch, rng, min(count, 200))
        chosen, error = [], np.zeros(len(parameters))
        for t in range(len(problem.tasks)):
            q = solutions(evaluator, t, patch, parameters, rng, approach=True)
            flat = q.reshape(-1, q.shape[2])
            evaluation = evaluator.task(
                t, patch, np.repeat(parameters, q.shape[1], axis=0), flat, contacts=False, clearances=False
            )
            missed = -np.sum(evaluation.rows[0].margins, axis=1).reshape(q.shape[:2])
            best = np.argmin(missed, axis=1)
            chosen.append(q[np.arange(len(q)), best])
            error = np.maximum(error, missed.min(axis=1))
        parts.append(
            Candidates(
                np.full(len(parameters), patch),
                list(parameters),
                np.stack(chosen, axis=1),
                np.full(len(parameters), np.nan),
                -error,
                len(parameters),
                0,
            )
        )
    evaluation = joined(parts, sampled, 0)
    order = np.argsort(-evaluation.margins, kind="stable")
    return replace(evaluation.select(order), posed=False)
