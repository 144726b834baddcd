"""Candidates to start from: a sample of the terrain with all branches of the inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from ocptip.placement.evaluate import Evaluator
from ocptip.placement.limits.judged import smallest_margin
from ocptip.placement.problem import CRITERIA
from ocptip.robots.inverse.closed_form import branches_within_limits, closed_form_family
from ocptip.robots.inverse.pose_search import search

_ENOUGH = 600  # standing places from which all tasks can be reached
_ROUNDS = 3
_SEARCHES = 6  # starts per pose where there is no closed form
_SEARCH_COSTS = 8  # times as much as closed forms
_ROLLS = 3  # turns about the tool axis tried where it is free
_CLOSE = 1e-7
_PARALLEL = 1e-9
_NEAREST = 1e-3
_BRANCHES = 8  # kept per sampled place
_EXACT = 1000  # candidates whose contacts are solved
_BROKEN = 300  # how many of these break constraints at most, unless too few keep them
_SHARE_BROKEN = 0.3  # the same, as a share of the candidates to improve
_PRICE = 1.0  # objective per violation in comparable units


@dataclass(eq=False)
class Candidates:
    """Sampled placements on all patches with their best branches, the best ones first.

    Attributes:
        patches: (N,) number of the patch.
        parameters: N arrays (k,).
        angles: (N, tasks, n), rad.
        totals: (N,) objective; NaN if not known.
        margins: (N,) smallest margin of all constraints; negative: broken.
        sampled: placements looked at.
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
                rotation = rotation @ Rotation.from_rotvec(roll[:, None] * wanted.tool_axis).as_matrix()
            elif wanted.orientation == "free":
                rotation = Rotation.random(N, rng).as_matrix()
            rounds.append(branches_within_limits(arm, *evaluator.targets(task, origin, base, rotation)))
        return np.concatenate(rounds, axis=1)
    position, rotation = evaluator.targets(task, origin, base)
    low = np.maximum(arm.limits.angle_min, -np.pi)
    high = np.minimum(arm.limits.angle_max, np.pi)
    found = []
    for _ in range(_SEARCHES):
        first = low + rng.random((N, arm.n)) * (high - low)
        q, error = search(arm, first, position, rotation, wanted.orientation, wanted.tool_axis)
        if not approach:
            q[error > _CLOSE] = np.nan
        found.append(q)
    return np.stack(found, axis=1)


def sample(evaluator: Evaluator, rng: np.random.Generator, count: int) -> Candidates:
    """Sampled candidates, sorted: those that keep all constraints by their objective, then by violation.

    Args:
        count: placements per round and terrain; rounds go on until enough of them reach all tasks.
    """
    problem, kept, blocked, sampled, reached, clear = evaluator.problem, [], [], 0, 0, 0
    if closed_form_family(evaluator.arm) is None:
        count //= _SEARCH_COSTS
    shares = np.full(len(problem.terrain), max(count // len(problem.terrain), 32))
    for _ in range(_ROUNDS):
        for patch in range(len(problem.terrain)):
            parameters = _draw(evaluator, patch, rng, int(shares[patch]))
            sampled += len(parameters)
            ground = smallest_margin(evaluator.ground(patch, parameters), len(parameters))
            free = parameters[ground >= 0]
            clear += len(free)
            kept.append(best_branches(evaluator, patch, free, rng))
            blocked.append((patch, parameters[ground < 0]))
            reached += kept[-1].reached
        if reached >= _ENOUGH:
            break
    if not reached:
        kept = [best_branches(evaluator, *those, rng) for those in blocked]
    found = joined(kept, sampled, reached)
    found = ranked(evaluator, found) if len(found) else _nearest_misses(evaluator, rng, count, sampled)
    return replace(found, clear=clear)


def best_branches(
    evaluator: Evaluator, patch: int, parameters: np.ndarray, rng: np.random.Generator
) -> Candidates:
    """For each placement from which all tasks can be reached, the best few branches of every task.

    The best one keeps all constraints looked at here (all but the contact solver's) with the least objective,
    else it has the least violation. The next candidate at a placement has the next branch of every task,
    as far as there is one: in clutter another one may do after a small move.
    """
    problem, n = evaluator.problem, evaluator.arm.n
    alive = np.arange(len(parameters))
    chosen = np.empty((len(parameters), _BRANCHES, 0, n))
    total, margin = np.zeros((len(parameters), _BRANCHES)), np.full((len(parameters), _BRANCHES), np.inf)
    further = np.zeros(total.shape, dtype=bool)
    further[:, 0] = True
    for t in range(len(problem.tasks)):
        if not len(alive):
            break
        q = solutions(evaluator, t, patch, parameters[alive], rng)
        who, which = np.nonzero(np.isfinite(q).all(axis=2))
        reached, first, counts = np.unique(who, return_index=True, return_counts=True)
        alive, chosen = alive[reached], chosen[reached]
        total, margin, further = total[reached], margin[reached], further[reached]
        if not len(alive):
            break
        score, room = rough_scores(
            evaluator, t, patch, parameters[alive[np.searchsorted(reached, who)]], q[who, which]
        )
        order = np.lexsort((np.where(room >= 0, score, 1e6 - room), who))
        ranks = np.arange(_BRANCHES)
        best = order[first[:, None] + np.minimum(ranks, counts[:, None] - 1)]
        further |= ranks < counts[:, None]
        chosen = np.concatenate([chosen, q[who, which][best][:, :, None]], axis=2)
        total, margin = total + score[best], np.minimum(margin, room[best])
    if chosen.shape[2] < len(problem.tasks):
        chosen, further = np.empty((0, _BRANCHES, len(problem.tasks), n)), further[:0]
    places, ranks = np.nonzero(further)
    return Candidates(
        np.full(len(places), patch),
        list(parameters[alive[places]]),
        chosen[places, ranks],
        total[places, ranks],
        margin[places, ranks],
        len(parameters),
        len(chosen),
    )


def rough_scores(
    evaluator: Evaluator, task: int, patch: int, parameters: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Objective without the slip reserve and smallest margin, (N,) each, of one task; contacts not solved."""
    found = evaluator.task(task, patch, parameters, q, contacts=False)
    criteria = evaluator.criteria([found])
    criteria[:, CRITERIA.index("GT")] = 0.0
    return evaluator.totals(criteria), found.margin()


def ranked(evaluator: Evaluator, candidates: Candidates) -> Candidates:
    """The most promising candidates with their contacts solved, the best first."""
    rank = _rank(candidates.totals, candidates.margins)
    order = np.argsort(rank, kind="stable")
    kept = int(np.sum(candidates.margins >= 0))
    broken = min(len(order) - kept, _BROKEN)
    best = np.concatenate([order[: min(kept, _EXACT - broken)], order[kept : kept + broken]])
    totals, margins = np.full(len(best), np.nan), np.full(len(best), -np.inf)
    for patch in np.unique(candidates.patches[best]):
        own = np.flatnonzero(candidates.patches[best] == patch)
        parameters = np.array([candidates.parameters[i] for i in best[own]])
        totals[own], margins[own] = exact_scores(
            evaluator, patch, parameters, candidates.angles[best[own]], fast=True
        )
    order = np.argsort(_rank(totals, margins), kind="stable")
    result = candidates.select(best[order])
    result.totals, result.margins = totals[order], margins[order]
    return result


def _rank(totals: np.ndarray, margins: np.ndarray) -> np.ndarray:
    """Numbers by which candidates are sorted: those that keep all constraints first, by their objective."""
    broken = np.minimum(-np.nan_to_num(margins, nan=-np.inf), 1e5)
    return np.where(margins >= 0, totals, 1e6 + np.nan_to_num(totals, nan=1e3, posinf=1e3) + _PRICE * broken)


def exact_scores(
    evaluator: Evaluator, patch: int, parameters: np.ndarray, angles: np.ndarray, fast: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Objective and smallest margin of all constraints, (N,) each; angles (N, tasks, n)."""
    found = [evaluator.task(t, patch, parameters, angles[:, t], fast=fast) for t in range(angles.shape[1])]
    margin = smallest_margin(evaluator.ground(patch, parameters), len(parameters))
    for own in found:
        margin = np.minimum(margin, own.margin())
    return evaluator.totals(evaluator.criteria(found)), margin


def promising(evaluator: Evaluator, candidates: Candidates, count: int, apart: float) -> list[int]:
    """Numbers of up to `count` candidates of different posture: the best, and some that break constraints."""
    broken = candidates.margins < 0
    others = min(int(_SHARE_BROKEN * count), int(broken.sum()))
    result = []
    for own, number in ((~broken, count - others), (broken, others)):
        at = np.flatnonzero(own)
        chosen = spread(evaluator, candidates.select(at), number, apart, postures=True)
        result += at[chosen].tolist()
    return result


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
        own = np.flatnonzero(candidates.patches == patch)
        numbers[own] = np.arange(len(own))
        if not len(own):
            continue
        parameters = np.array([candidates.parameters[i] for i in own])
        origin, base = evaluator.place(patch, parameters)
        q = candidates.angles[own].reshape(len(own), -1)
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
        own = np.flatnonzero(candidates.patches == patch)
        away = np.max(np.abs(places[patch] - places[patch][numbers[i]]), axis=1)
        near[own] = np.minimum(near[own], away)
        near[i] = -np.inf
    return chosen


def turns_beneath(evaluator: Evaluator, patch: int) -> bool:
    """Whether the first joint can make up for a turn of the base about the ground's normal."""
    terrain, arm = evaluator.problem.terrain[patch], evaluator.arm
    axis = (arm.mount_rotation @ arm.rotations[0])[:, 2] @ evaluator.problem.ground_frame[1][:, 2]
    return terrain.horizontal is not None and sum(terrain.angular) == 1 and abs(abs(axis) - 1) < _PARALLEL


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
    unit = qmc.Halton(problem.terrain[patch].size, rng=rng).random(count)
    return low + unit * (high - low)


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
            found = evaluator.task(
                t, patch, np.repeat(parameters, q.shape[1], axis=0), flat, contacts=False, clearances=False
            )
            missed = -np.sum(found.rows[0].margins, axis=1).reshape(q.shape[:2])
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
    found = joined(parts, sampled, 0)
    order = np.argsort(-found.margins, kind="stable")
    return replace(found.select(order), posed=False)
