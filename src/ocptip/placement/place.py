"""Finds where the base should stand: sampled starts, a nonlinear program from each, checked results."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from ocptip.basics.errors import InputError, whole_number
from ocptip.numerics.ipopt import Solution, solve
from ocptip.numerics.threads import one_thread
from ocptip.numerics.vectors import nearest_turn
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.limits.arm import POSE_TOLERANCE
from ocptip.placement.limits.kinds import KINDS
from ocptip.placement.problem import PlacementProblem
from ocptip.placement.result import (
    ONE_PLACE,
    NoPlacementError,
    Placement,
    PlacementResult,
    StartReport,
    evaluate_placement,
)
from ocptip.placement.search import starts as sampling
from ocptip.placement.search.physics import PatchPhysics, held_cases, near_gaps, pieces, worst_cases
from ocptip.placement.search.program import ElasticProgram, PlacementProgram
from ocptip.placement.search.refine import around, improved, turned
from ocptip.robots.inverse.joint_angles import nearest_copies
from ocptip.robots.inverse.pose_search import search

_TOLERANCE = 1e-8
_KEPT = 1e-5  # violation of a program's rows up to which its result is used
_ITERATIONS = 100
_START_MU = 1e-4
_BOX, _BOX_ANGLE = 0.06, 0.3  # of the parameters' scales, rad: how far one program may go
_NEAR = 0.5  # in 0.1 m: gaps up to this take part in a program
_HELD = 0.5  # share of the slip limit from which a load case takes part that is no criterion
_ROUNDS = 12
_PROGRESS = 1e-6  # of the objective, from one box to the next
_IMPROVED_PER_START = 16
_AROUND, _COPIES, _AFAR = 3, 10, 0.2  # results looked around in the end, draws at each, of the scales
_AGAIN = 3  # starts per program started once more from there
_POSTURES_APART = 0.4  # of the scales, and of half the unit vectors of joint angles
_ELASTIC_STARTS = 4
_MOST_STATED = 4


def place(
    problem: PlacementProblem,
    *,
    starts: int = 5,
    seed: int = 0,
    samples: int = 4000,
    keep: int = 5,
    progress: Callable[[int, int, float | None], None] | None = None,
) -> PlacementResult:
    """Find the best placements of a problem (4.38).

    The terrain is sampled, with all IK solutions, and once more around the best places, among them such that
    break constraints a little. The most promising candidates are improved by a local search and start
    nonlinear programs (Ipopt, exact derivatives). Around the best results the local search selects starts for
    further optima, a third as many programs again. Every result is checked again before it counts. The result
    depends on problem, numbers and seed only.

    Args:
        problem: task, terrain, limits, weights.
        starts: number of programs solved first.
        seed: of the sample.
        samples: placements sampled per round.
        keep: number of distinct placements returned at most.
        progress: called as progress(done, starts, minimum objective so far or None).

    Raises:
        InputError: numbers that are no numbers, or a task that no terrain can serve because of a coordinate
            that nothing changes.
        NoPlacementError: no placement keeps all constraints; names those that fail and by how much they are
            missed at the place of minimum violation.
    """
    for name, value in (("starts", starts), ("samples", samples), ("keep", keep)):
        whole_number(name, value, 1)
    whole_number("seed", seed, 0)
    began = time.perf_counter()
    with one_thread:
        return _place(problem, starts, seed, samples, keep, progress, began)


def _place(
    problem: PlacementProblem,
    starts: int,
    seed: int,
    samples: int,
    keep: int,
    progress: Callable[[int, int, float | None], None] | None,
    began: float,
) -> PlacementResult:
    work, rng = _PatchPrograms(problem), np.random.default_rng(seed)
    more = -(-starts // _AGAIN)
    candidates = sampling.sample(work.evaluator, rng, samples)
    chosen = candidates
    if candidates.reached:
        count = _IMPROVED_PER_START * starts
        first = sampling.spread(work.evaluator, candidates, count, _POSTURES_APART, postures=True)
        chosen = turned(work.evaluator, candidates.select(first))
        chosen = improved(work.evaluator, chosen, rng)
        chosen = chosen.select(sampling.spread(work.evaluator, chosen, starts, postures=True))
    placements: list[Placement] = []
    tried: list[Placement] = []
    reports = []

    def solve_from(those: sampling.Candidates) -> None:
        for i in range(len(those)):
            placement, report = work.run(len(reports), *those[i])
            reports.append(report)
            tried.append(placement)
            if placement.feasible:
                placements.append(placement)
            if progress:
                progress(len(reports), len(chosen) + more, min((p.total for p in placements), default=None))

    if candidates.reached:
        solve_from(chosen)
    if placements:
        best = [(p.patch, p.parameters, p.angles) for p in _distinct(placements)[:_AROUND]]
        near = around(work.evaluator, best, _COPIES, _AFAR, rng)
        solve_from(near.select(np.arange(min(more, len(near)))))
    if not placements:
        nearest = work.nearest(chosen, tried)
        if not nearest.feasible:
            raise NoPlacementError(_refusal(nearest, candidates), nearest, tuple(reports))
        placement, report = work.run(len(reports), nearest.patch, nearest.parameters, nearest.angles)
        reports.append(report)
        placements = [placement if placement.feasible else nearest]
    return PlacementResult(
        problem=problem,
        placements=_several(_distinct(placements), keep),
        starts=tuple(reports),
        sampled=candidates.sampled,
        reached=candidates.reached,
        seed=seed,
        seconds=time.perf_counter() - began,
    )


class _PatchPrograms:
    """Programs of one problem on all its patches."""

    def __init__(self, problem: PlacementProblem) -> None:
        self.problem, self.evaluator = problem, Evaluator(problem)
        self._physics: dict[int, PatchPhysics] = {}

    def physics(self, patch: int) -> PatchPhysics:
        """Functions of a patch, built when they are needed."""
        if patch not in self._physics:
            made = PatchPhysics(self.evaluator, patch)
            for task, missed in zip(self.problem.tasks, made.dropped, strict=True):
                if missed > POSE_TOLERANCE:
                    raise InputError(
                        f"{task.name}: a coordinate of the pose that nothing on terrain "
                        f"{self.problem.terrain[patch].name!r} can change is off by {0.1 * missed:.4g} m"
                    )
            self._physics[patch] = made
        return self._physics[patch]

    def run(self, number: int, patch: int, p: np.ndarray, q: np.ndarray) -> tuple[Placement, StartReport]:
        """One start: programs until neither the box nor a row that took no part limits the result.

        The better one of start and result counts, both checked.
        """
        began, iterations, status = time.perf_counter(), 0, ""
        best = evaluate_placement(self.evaluator, patch, p, self._exact(patch, p, q), number)
        near, held, low = None, None, np.inf
        for _ in range(_ROUNDS):
            solution, near, held, elsewhere = self._program(patch, p, q, near, held)
            iterations, status = iterations + solution.iterations, solution.status
            if solution.violation > _KEPT:
                break
            p, q = solution.x[: len(p)], solution.x[len(p) : len(p) + q.size].reshape(q.shape)
            placement = evaluate_placement(self.evaluator, patch, p, self._exact(patch, p, q), number)
            if placement.feasible and (not best.feasible or placement.total < best.total):
                best = placement
            if not elsewhere and (placement.feasible or not self._wider(patch, p, q, near, held)):
                break
            if elsewhere and solution.objective > low - _PROGRESS:
                break
            low = solution.objective
        return best, StartReport(
            number=number,
            status=status,
            iterations=iterations,
            seconds=time.perf_counter() - began,
            total=best.total if best.feasible else float("nan"),
            feasible=best.feasible,
            worst="" if best.feasible else str(best.margins[0]),
        )

    def _program(
        self,
        patch: int,
        p: np.ndarray,
        q: np.ndarray,
        near: list[np.ndarray] | None,
        held: list[int] | None,
    ) -> tuple[Solution, list[np.ndarray], list[int], bool]:
        """Solve inside a box around p, q, with the rows near there and those given.

        Ipopt's first steps ignore how strongly the kinematics bend; the box keeps them short. The last result
        says whether the solution lies at the box's edge, or on other pieces of the force sets.
        """
        physics = self.physics(patch)
        now = near_gaps(physics, p, q, _NEAR)
        near = now if near is None else [a | b for a, b in zip(near, now, strict=True)]
        held = sorted({*held_cases(physics, p, q, _HELD), *(held or ())})
        force_pieces = pieces(physics, p, q, held)
        program = PlacementProgram(physics, near, held, force_pieces)
        x = program.start(p, q)
        low, high = (bound.copy() for bound in program.x_bounds)
        box = np.full(len(p) + q.size, _BOX_ANGLE)
        box[: len(p)] = np.where(physics.terrain.angular, _BOX_ANGLE, _BOX * self.problem.scales(patch))
        inside = slice(0, len(box))
        low[inside], high[inside] = (
            np.maximum(low[inside], x[inside] - box),
            np.minimum(high[inside], x[inside] + box),
        )
        solution = solve(
            program,
            x,
            (low, high),
            program.bounds,
            tolerance=_TOLERANCE,
            max_iterations=_ITERATIONS,
            start_mu=_START_MU,
            pattern=program.pattern,
        )
        elsewhere = bool(np.any(np.abs(solution.x[inside] - x[inside]) > 0.99 * box))
        if force_pieces and not elsewhere and solution.violation < _KEPT:
            elsewhere = pieces(physics, *program.split(solution.x), held) != force_pieces
        return solution, near, held, elsewhere

    def _wider(
        self, patch: int, p: np.ndarray, q: np.ndarray, near: list[np.ndarray], held: list[int]
    ) -> bool:
        """Whether rows are broken that took no part."""
        physics = self.physics(patch)
        broken = near_gaps(physics, p, q, 0.0)
        return any(np.any(b & ~n) for b, n in zip(broken, near, strict=True)) or bool(
            set(held_cases(physics, p, q, 1.0)) - set(held)
        )

    def nearest(self, candidates: sampling.Candidates, tried: list[Placement]) -> Placement:
        """The placement of minimum violation."""
        best, least = None, np.inf
        starts = [(t.patch, t.parameters, t.angles) for t in sorted(tried, key=_violation)[:2]]
        starts += [candidates[i] for i in sampling.spread(self.evaluator, candidates, _ELASTIC_STARTS)]
        for patch, p, q in starts:
            physics = self.physics(patch)
            near = near_gaps(physics, p, q, _NEAR)
            for _ in range(_ROUNDS):
                held = worst_cases(physics, p, q)
                force_pieces = pieces(physics, p, q, held)
                program = PlacementProgram(physics, near, held, force_pieces, criteria=False)
                elastic = ElasticProgram(program, reachable=candidates.posed)
                x = elastic.start(program.start(p, q))
                solution = solve(
                    elastic,
                    x,
                    elastic.x_bounds,
                    elastic.bounds,
                    tolerance=_TOLERANCE,
                    max_iterations=_ITERATIONS,
                    pattern=elastic.pattern,
                )
                p, q = program.split(solution.x[: program.size])
                wider = [a | b for a, b in zip(near, near_gaps(physics, p, q, 0.0), strict=True)]
                if all(np.array_equal(a, b) for a, b in zip(near, wider, strict=True)):
                    break
                near = wider
            placement = evaluate_placement(self.evaluator, patch, p, self._exact(patch, p, q))
            if _violation(placement) < least:
                best, least = placement, _violation(placement)
            if placement.feasible:
                break
        assert best is not None  # there is a start, and its violation is finite
        return best

    def _exact(self, patch: int, p: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Angles with the pose exact to rounding, where the program's are nearly so; else unchanged."""
        result = q.copy()
        origin, base = self.evaluator.place(patch, p)
        for t, task in enumerate(self.problem.tasks):
            position, rotation = self.evaluator.targets(t, origin, base)
            arm = self.evaluator.arm
            polished, error = search(arm, q[t : t + 1], position, rotation, task.orientation, task.tool_axis)
            if error[0] < POSE_TOLERANCE and np.max(np.abs(polished[0] - q[t])) < 1e-4:
                result[t] = polished[0]
        return result


def _violation(placement: Placement) -> float:
    """Sum of violations, one per kind and name of constraint."""
    worst: dict[tuple, float] = {}
    for m in placement.violations:
        limit = KINDS[m.kind]
        if limit.by_solver and np.isinf(m.relative):
            continue
        key = m.kind, m.task, "" if limit.counted_once else m.name
        worst[key] = max(worst.get(key, 0.0), min(-m.relative, 1e6))
    return sum(worst.values())


def _distinct(placements: list[Placement]) -> list[Placement]:
    """The best of each group of placements that are the same, by objective."""
    kept: list[Placement] = []
    for placement in sorted(placements, key=lambda p: p.total):
        if not any(_same(placement, other) for other in kept):
            kept.append(placement)
    return kept


def _several(distinct: list[Placement], keep: int) -> tuple[Placement, ...]:
    """Those to return, by objective: different places before different postures at one place."""
    places: list[Placement] = []
    postures: list[Placement] = []
    for placement in distinct:
        known = any(_same_place(placement, other) for other in places)
        (postures if known else places).append(placement)
    return tuple(sorted((places + postures)[:keep], key=lambda p: p.total))


def _same(a: Placement, b: Placement) -> bool:
    turn = nearest_copies(a.problem.robot.arm, a.angles - b.angles)
    return _same_place(a, b) and bool(np.max(np.abs(turn)) < 4 * ONE_PLACE)


def _same_place(a: Placement, b: Placement) -> bool:
    if a.patch != b.patch:
        return False
    terrain = a.problem.terrain[a.patch]
    apart = a.parameters - b.parameters
    apart = np.where(terrain.angular, nearest_turn(apart), apart)
    return bool(np.max(np.abs(apart) / a.problem.scales(a.patch)) < ONE_PLACE)


def _refusal(nearest: Placement, candidates: sampling.Candidates) -> str:
    """Which limits fail and by how much."""
    problem = nearest.problem
    terrain = problem.terrain[nearest.patch]
    where = ", ".join(
        f"{name} {np.rad2deg(v):.1f} degrees" if angular else f"{name} {v:.3f}"
        for name, v, angular in zip(terrain.parameters, nearest.parameters, terrain.angular, strict=True)
    )
    stated = "; ".join(str(m) for m in nearest.violations[:_MOST_STATED])
    more = len(nearest.violations) - _MOST_STATED
    if candidates.clear:
        reach = f"{candidates.reached} of {candidates.clear} sampled placements"
        if candidates.clear < candidates.sampled:
            reach += " where the base alone can stand"
        reach += " reach the gripper pose" + ("s" if len(problem.tasks) > 1 else "")
    else:
        reach = f"the base alone can stand at none of {candidates.sampled} sampled placements"
    return (
        f"no placement keeps all constraints ({reach}); at the one of minimum violation, on "
        f"{terrain.name!r} at {where}: {stated}" + (f"; and {more} more" if more > 0 else "")
    )
