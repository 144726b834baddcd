"""Placement for a cycle: good placements at rest, ranked by what the cycle planned on them costs."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, PlanningError, whole_number
from ocptip.certificate.checks import certified
from ocptip.motion.cycles.task import CycleTask
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.plan import SegmentSearch, plan_motion, proved
from ocptip.motion.violations import sentence
from ocptip.numerics.threads import one_thread
from ocptip.placement.evaluate import Evaluator
from ocptip.placement.place import place
from ocptip.placement.problem import PlacementProblem
from ocptip.placement.result import (
    NoPlacementError,
    Placement,
    PlacementResult,
    evaluate_placement,
)
from ocptip.placement.search import starts as sampling

_SAMPLES = 2000
_SAMPLED = 6  # sampled placements per place that is missing


@dataclass(frozen=True, eq=False)
class CyclePlacement:
    """One place with the cycle that was planned on it.

    Attributes:
        placement: with all poses of the cycle at rest.
        sampled: no optimum at rest, but a sampled place that keeps all limits there.
        plan: None where there is none.
        refusal: why; else empty.
    """

    placement: Placement
    sampled: bool
    plan: MotionPlan | None
    refusal: str = ""

    @property
    def verified(self) -> bool:
        """There is a verified plan of all segments."""
        return self.plan is not None and self.plan.verified

    @property
    def cost(self) -> float:
        """Cost of the plan, in the unit of the cycle's objective; infinite where there is no verified one."""
        if self.plan is None or not self.plan.verified:
            return np.inf
        return self.plan.task.objective.cost(self.plan.energy, self.plan.duration)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        result = self.plan is not None and self.verified
        return {
            "verified": self.verified,
            "energy_J": self.plan.energy if self.plan and result else None,
            "duration_s": self.plan.duration if self.plan and result else None,
            "cost": self.cost if result else None,
            "refusal": self.refusal,
            "sampled": self.sampled,
            "placement": self.placement.to_dict(),
        }


@dataclass(frozen=True, eq=False)
class CyclePlacements:
    """Places ranked by the cost of the cycle there.

    Attributes:
        ranked: the minimum cost first; those without verified plan last.
        static: result of the placement at rest.
    """

    ranked: tuple[CyclePlacement, ...]
    static: PlacementResult

    @property
    def best(self) -> CyclePlacement:
        """The place with the minimum cost; check whether it is verified."""
        return self.ranked[0]


@one_thread
def place_for_cycle(
    problem: PlacementProblem,
    placed: Callable[[Placement], CycleTask],
    *,
    candidates: int = 3,
    starts: int = 2,
    seed: int = 0,
    executor: Executor | None = None,
    jobs: int | None = None,
    placement_starts: int = 5,
    progress: Callable[[str], None] | None = None,
    segment: SegmentSearch | None = None,
) -> CyclePlacements:
    """Find the place of minimum cost of a cycle.

    Candidates are the distinct optima at rest (all poses, all constraints) and, where these are fewer than
    asked for, the best sampled places apart from them that keep all constraints. On each the cycle is
    planned. The cheapest gets its certificates, and with them motions that may cost up to 2 % more.

    Args:
        problem: with all poses of the cycle as gripper tasks.
        placed: the cycle in base axes at a placement.
        candidates: number of places to plan on, at most.
        starts: of the motion planner, per segment; see `ocptip.motion.plan.plan_motion`.
        seed: of placements and plans.
        executor, jobs, segment: of the motion planner.
        placement_starts: of `place`.
        progress: called with what is about to be done.

    Raises:
        InputError: bad numbers.
        NoPlacementError: no placement serves all poses at rest.
    """
    numbers = {"candidates": candidates, "starts": starts, "placement_starts": placement_starts}
    for name, value in numbers.items():
        whole_number(name, value, 1)
    say = progress or (lambda text: None)
    say("searching for placements ...")
    at_rest: dict[str, Any] = {"starts": placement_starts, "seed": seed, "keep": candidates}
    try:
        static = place(problem.if_alike or problem, **at_rest)
    except NoPlacementError:
        if problem.if_alike is None:
            raise
        static = place(problem, **at_rest)  # another sharing of the load may hold the base
    places = [(placement, False) for placement in static.places[:candidates]]
    places += [(p, True) for p in sampled_places(static.problem, static, candidates - len(places), seed)]
    results = []
    for number, (placement, sampled) in enumerate(places, 1):
        say(f"planning the cycle at place {number} of {len(places)} ...")
        plan, refusal = None, ""
        try:
            how = {"starts": starts, "seed": seed, "executor": executor, "jobs": jobs}
            plan = plan_motion(placed(placement), segment=segment, **how)
            refusal = (
                "" if plan.verified else "; ".join(map(sentence, plan.check.violations)) or "not complete"
            )
        except (PlanningError, InputError) as error:
            refusal = str(error)
        results.append(CyclePlacement(placement, sampled, plan, refusal))
        if plan is not None and plan.interrupted:
            break
    best, *others = sorted(results, key=lambda one: one.cost)
    if best.plan is not None and best.verified and not best.plan.interrupted:
        best = replace(best, plan=proved(best.plan, certified))
    return CyclePlacements((best, *others), static)


def sampled_places(
    problem: PlacementProblem, static: PlacementResult, count: int, seed: int
) -> list[Placement]:
    """Sampled placements that keep all constraints, at distinct places; the best first."""
    if count < 1:
        return []
    evaluator, result = Evaluator(problem), list[Placement]()
    candidates = sampling.sample(evaluator, np.random.default_rng(seed), _SAMPLES)
    if not candidates.reached:
        return []
    for i in sampling.spread(evaluator, candidates, _SAMPLED * count):
        placement = evaluate_placement(evaluator, *candidates[i])
        known = any(placement.shares_place(other) for other in (*static.placements, *result))
        if placement.feasible and not known:
            result.append(placement)
        if len(result) == count:
            break
    return result
