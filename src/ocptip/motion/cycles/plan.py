"""Plans a cycle: segment after segment, the postures between them chosen with all segments in view."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ocptip.basics.errors import PlanningError, whole_number
from ocptip.motion.check import Prove
from ocptip.motion.cycles.check import CycleCheck, cycle_check
from ocptip.motion.cycles.choices import Way, best_ways, layers_of, likely_ways, rest_cost
from ocptip.motion.cycles.free_poses import moved_ways
from ocptip.motion.cycles.task import CycleTask, require_way_plannable
from ocptip.motion.plan import MotionPlan, plan_motion, proved
from ocptip.numerics.threads import one_thread
from ocptip.numerics.workers import worker_pool
from ocptip.trajectories.trajectory import Trajectory

FIRST = 2  # starts that every segment of every promising way gets; the others go to the best way
Leg = tuple[int, int, int]
"""Numbers of a segment and of the postures before and after it."""


@dataclass(frozen=True, eq=False)
class CyclePlan:
    """A planned cycle.

    Attributes:
        task: what was asked for.
        parts: plans of the segments; of the first ones only if the planning was interrupted before.
        check: of these, and of the whole.
        seed: of the starts.
        seconds: wall time of the planning.
        interrupted: some starts had not finished.
        options: what else was asked for; `choices`: postures per layer and ways that were planned, if poses
            left a choice.
    """

    task: CycleTask
    parts: tuple[MotionPlan, ...]
    check: CycleCheck
    seed: int
    seconds: float
    interrupted: bool
    options: dict[str, Any]

    @property
    def complete(self) -> bool:
        """All segments are planned."""
        return len(self.parts) == len(self.task.segments)

    @property
    def finished(self) -> CycleTask:
        """The task of the segments that have a plan."""
        task = self.task
        return (
            task if self.complete else replace(task, segments=task.segments[: len(self.parts)], closed=False)
        )

    @property
    def motion(self) -> Trajectory:
        """The exact ramp motions and the rests between them."""
        return sequence_of(self.task, self.parts)

    @property
    def energy(self) -> float:
        """Electric energy, that of the rests included, J."""
        return self.check.whole.energy

    @property
    def duration(self) -> float:
        """With all rests, s."""
        return self.check.whole.duration

    @property
    def verified(self) -> bool:
        """All segments are planned, and every limit holds in each."""
        return self.complete and self.check.whole.verified


Planned = MotionPlan | CyclePlan
"""What the search finds."""


def sequence_of(task: CycleTask, parts: Sequence[MotionPlan]) -> Trajectory:
    """The motions of the planned segments with the task's rests."""
    rests = tuple(segment.rest for segment in task.segments[: len(parts)])
    return Trajectory.from_segments([part.motion for part in parts], rests)


def plan_cycle(
    task: CycleTask,
    *,
    starts: int = 8,
    seed: int = 0,
    executor: Executor | None = None,
    jobs: int | None = None,
    progress: Callable[[int, int, float | None], None] | None = None,
    prove: Prove | None = None,
) -> CyclePlan:
    """Plan the ramp motions of least cost of all segments of a cycle.

    Where poses leave a choice of postures, the most promising ways through them get two starts per segment;
    the best way, by the cost of its verified plans, gets the others. An interrupt (Ctrl-C) ends the planning
    with what is finished: all segments, with fewer starts, or the first ones.

    Args:
        task, starts, seed, executor, jobs: see `ocptip.motion.plan.plan_motion`; starts are per segment.
        progress: called as progress(done, starts, cost of the best way so far or None).
        prove: gives its motions their certificates, see `plan_motion`; `proved_cycle` gives them later.

    Raises:
        InputError: a segment cannot be planned (all reasons with their numbers), or a bad number.
        PlanningError: no start of a segment gave a verified plan; names it.
    """
    for name, value, least in (
        ("starts", starts, 1),
        ("jobs", 1 if jobs is None else jobs, 1),
        ("seed", seed, 0),
    ):
        whole_number(name, value, least)
    began = time.perf_counter()
    with one_thread:
        layers = layers_of(task)
        ways = likely_ways(task, layers)
        choices = {"choices": {"postures": [len(layer) for layer in layers]}}
        require_way_plannable(task, _postures(layers, ways[0]))
        layers, ways = moved_ways(task, layers, ways)
        choices["choices"]["ways"] = len(ways)
    legs = _Legs(task, layers, ways, starts, seed, progress)
    interrupted, alone = False, executor is None and jobs == 1
    try:
        with nullcontext() if alone else worker_pool(executor, jobs, starts) as pool:
            legs.run(pool)
    except KeyboardInterrupt:
        interrupted = True
    parts = legs.parts()
    if not parts:
        raise KeyboardInterrupt
    planned = replace(task, segments=task.segments[: len(parts)], closed=False)
    plan = CyclePlan(
        task=task,
        parts=tuple(parts),
        check=cycle_check(planned, sequence_of(task, parts), [part.check for part in parts]),
        seed=seed,
        seconds=time.perf_counter() - began,
        interrupted=interrupted,
        options={"starts": starts, **(choices if any(len(layer) > 1 for layer in layers) else {})},
    )
    return plan if prove is None or interrupted else proved_cycle(plan, prove)


def proved_cycle(plan: CyclePlan, prove: Prove) -> CyclePlan:
    """A plan with the certificates of its motions, in this process; an interrupt leaves out the others."""
    began, parts, interrupted = time.perf_counter(), [*plan.parts], plan.interrupted
    try:
        for k, part in enumerate(parts):
            parts[k] = proved(part, prove)
    except KeyboardInterrupt:
        interrupted = True
    checks = [part.check for part in parts]
    check = cycle_check(plan.finished, sequence_of(plan.task, parts), checks)
    seconds = plan.seconds + time.perf_counter() - began
    return replace(plan, parts=tuple(parts), check=check, seconds=seconds, interrupted=interrupted)


class _Legs:
    """The segments between the postures of some ways, and their plans so far."""

    def __init__(
        self,
        task: CycleTask,
        layers: Sequence[np.ndarray],
        ways: Sequence[Way],
        starts: int,
        seed: int,
        progress: Callable[[int, int, float | None], None] | None,
    ) -> None:
        self._task, self._layers, self._ways = task, layers, ways
        self._seed, self._progress, self._starts = seed, progress, starts
        self._plans: dict[Leg, MotionPlan] = {}
        self._errors: dict[Leg, PlanningError] = {}
        self._done = 0

    def run(self, pool: Executor | None) -> None:
        """All starts: two of every leg, the others of the best way.

        Raises:
            PlanningError: a segment has no verified plan.
            KeyboardInterrupt: it was interrupted; what is finished is kept.
        """
        legs = list(dict.fromkeys(leg for way in self._ways for leg in _legs(way)))
        first = min(FIRST, self._starts)
        total = len(legs) * first + len(self._task.segments) * (self._starts - first)
        for leg in legs:
            self._plan(leg, 0, first, total, pool)
        for leg in _legs(self._best()):
            if self._starts > first:
                self._plan(leg, first, self._starts - first, total, pool)
            if leg not in self._plans:
                raise PlanningError(f"{self._task.titles()[leg[0]]}: {self._errors[leg]}")

    def parts(self) -> list[MotionPlan]:
        """Plans of the best way, up to the first segment that has none."""
        parts = []
        for leg in _legs(self._best()):
            if leg not in self._plans:
                break
            parts.append(self._plans[leg])
        return parts

    def _best(self) -> Way:
        """The way of least cost over legs with plans; one without all of them: the most promising."""

        def cost(k: int, i: int, j: int) -> float:
            plan = self._plans.get((k, i, j))
            if plan is None:
                return np.inf
            segment = self._task.segments[k]
            own = segment.task.objective.cost(plan.energy, plan.duration)
            return (own + rest_cost(segment, plan.motion.goal)) / segment.task.objective.size

        sizes = [len(layer) for layer in self._layers]
        found = best_ways(sizes, cost, self._task.closed, 1)
        return found[0][1] if found else self._ways[0]

    def _plan(self, leg: Leg, first: int, count: int, total: int, pool: Executor | None) -> None:
        """Run starts of one leg; an interrupt is passed on after its plan is kept."""
        number, i, j = leg
        task = self._task.segments[number].between(self._layers[number][i], self._layers[number + 1][j])
        task = replace(task, rise_times=())

        def progress(done: int, steps: int, best: float | None) -> None:
            if self._progress:
                self._progress(self._done + count * done // steps, total, best)

        try:
            plan = plan_motion(
                task,
                starts=count,
                first=first,
                seed=self._seed,
                executor=pool,
                jobs=1 if pool is None else None,
                progress=progress,
            )
        except PlanningError as error:
            self._errors[leg] = error
        else:
            self._plans[leg] = _both(self._plans.get(leg), plan)
            if plan.interrupted:
                raise KeyboardInterrupt
        self._done += count


def _both(one: MotionPlan | None, other: MotionPlan) -> MotionPlan:
    """The better of two plans of the same task, with the starts of both."""
    if one is None:
        return other
    cost = one.task.objective.cost
    better = min(one, other, key=lambda plan: cost(plan.energy, plan.duration))
    starts = tuple(sorted((*one.starts, *other.starts), key=lambda start: start.number))
    options = {"starts": one.options["starts"] + other.options["starts"]}
    seconds = one.seconds + other.seconds
    return replace(better, starts=starts, seconds=seconds, interrupted=other.interrupted, options=options)


def _legs(way: Way) -> list[Leg]:
    return [(k, i, j) for k, (i, j) in enumerate(pairwise(way))]


def _postures(layers: Sequence[np.ndarray], way: Way) -> list[np.ndarray]:
    return [layer[i] for layer, i in zip(layers, way, strict=True)]
