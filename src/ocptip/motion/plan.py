"""Plans a motion, or a cycle segment after segment, with the postures between chosen for all of them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, cast

import numpy as np

from ocptip.basics.errors import PlanningError, whole_number
from ocptip.basics.interrupts import TimeIsUpError
from ocptip.motion.check import Prove
from ocptip.motion.cycles.choices import Way, best_sequences, layers_of, leg_cost, likely_sequences, rest_cost
from ocptip.motion.cycles.free_poses import moved_sequences
from ocptip.motion.cycles.task import CycleTask, Task, require_way_plannable
from ocptip.motion.motion_plan import TIME_IS_UP, MotionPlan
from ocptip.motion.multi_start import MaybeWorkers, Progress, plan_segment
from ocptip.motion.planner.attempt import Attempt
from ocptip.motion.planner.one_start import Search
from ocptip.motion.provable import slower_to_prove
from ocptip.motion.task import MotionTask
from ocptip.numerics.threads import one_thread
from ocptip.numerics.time_limit import TimeBudget, interrupted_after
from ocptip.numerics.workers import worker_pool

FIRST = 2  # starts that every segment of every promising way gets; the others go to the best way
SPARED = 0.9
"""Factor of the smallest cost of a planned segment relative to its default cost. Sequences that would cost
more than the best with this share of the default cost are planned no further.
"""
Leg = tuple[int, int, int]
"""Numbers of a segment and of the postures before and after it."""
SegmentSearch = Callable[[MotionTask, Callable[..., MotionPlan], TimeBudget, bool], MotionPlan]
"""Gives the plan of a segment of a cycle in its time: by the direct search that it gets, or otherwise. That
is called with the cost `known` of a motion that is verified already, if there is one. The last argument is
whether the cycle needs this segment; else there are others that may do.
"""


def plan_motion(
    task: Task,
    *,
    starts: int = 8,
    seed: int = 0,
    executor: Executor | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
    prove: Prove | None = None,
    stage: Callable[[str], None] | None = None,
    segment: SegmentSearch | None = None,
    budget: TimeBudget | None = None,
    known: float = math.inf,
) -> MotionPlan:
    """Plan the motion of minimum cost that keeps all limits of a task; of a cycle those of all segments.

    The stages are those of `ocptip.motion.multi_start`: random starts, changes of the best, rise times where
    the task gives none, and with `prove` the certificate. Where that leaves something open, the motion is
    made a little slower, or solved again, tighter there, and the proved one wins if it costs at most 2 %
    more. Where the task leaves a choice of postures, the most promising pairs of start and goal get one
    start each. The best of them gets the others, see `ocptip.motion.choices`. The result depends on task,
    starts and seed only, not on where the starts run. An interrupt (Ctrl-C) ends the planning with the best
    verified plan so far. A worker that dies is replaced and its job run again; a start that kills two is left
    out, see `lost`, and so is such a change. Some executors, such as a ProcessPoolExecutor, break with their
    worker. Then the death ends the planning like an interrupt, with a RuntimeWarning.

    Where the poses of a cycle leave a choice of postures, the most promising sequences get two starts per
    segment; the best one, by the cost of its verified plans, gets the others. An interrupt leaves all
    segments, with fewer starts, or the first ones.

    Args:
        task: made by hand, or one of `ocptip.published.tasks` or `ocptip.task_files.motion`.
        starts: number of random starts, of a cycle per segment.
        seed: of the random motions.
        executor: runs the starts: any `concurrent.futures` executor, such as `dask_client.get_executor()`.
            Default is a new process pool; as always with process pools, a script needs its `if __name__ ==
            "__main__":` then.
        jobs: number of processes of the default pool, one per core by default; 1 runs in this process.
        progress: called as progress(done, steps, minimum cost of a verified plan so far or None); a start is
            one step until its promise is known, and one until it is finished or left out. Of a cycle steps
            are starts, and the cost is that of the segment.
        prove: gives the best its certificate, as `ocptip.certificate.checks.certified` does; `proved` gives
            it later.
        stage: called with what is computed after the starts.
        segment: searches segments of a cycle; default: the direct search by random starts.
        budget: of the time of a cycle. Every segment gets one start before a segment gets more, and each of
            them an equal share of the time that is left.
        known: cost of another verified motion, for `progress`; of a single motion.

    Raises:
        InputError: the task cannot be planned (all reasons with their numbers), or starts, jobs or seed
            are no such numbers.
        PlanningError: no start gave a verified plan; the message names the nearest one's violations, of a
            cycle the segment.
    """
    for name, value, least in (
        ("starts", starts, 1),
        ("jobs", 1 if jobs is None else jobs, 1),
        ("seed", seed, 0),
    ):
        whole_number(name, value, least)

    def workers() -> MaybeWorkers:
        return nullcontext() if executor is None and jobs == 1 else worker_pool(executor, jobs, starts)

    how = {"starts": starts, "seed": seed, "progress": progress}
    if not task.is_cycle:
        plan = plan_segment(cast(MotionTask, task), **how, workers=workers(), known=known)
    else:
        how |= {"segment": segment or _direct, "budget": budget or TimeBudget(None)}
        plan = _planned_cycle(cast(CycleTask, task), **how, workers=workers)
    return plan if prove is None or plan.interrupted else proved(plan, prove, stage)


def _planned_cycle(
    task: CycleTask,
    *,
    starts: int,
    seed: int,
    workers: Callable[[], MaybeWorkers],
    progress: Progress | None,
    segment: SegmentSearch,
    budget: TimeBudget,
) -> MotionPlan:
    began = time.perf_counter()
    with one_thread, _comparing(budget):
        layers = layers_of(task)
        sequences = likely_sequences(task, layers)
        choices: dict[str, Any] = {"postures": [len(layer) for layer in layers]}
        require_way_plannable(task, _postures(layers, sequences[0]))
        layers, sequences = moved_sequences(task, layers, sequences)
        choices["ways"] = len(sequences)
    legs, interrupted = _Legs(task, layers, sequences, starts, seed, progress, segment, budget), False
    time_is_up = {}
    try:
        if (
            budget.given
        ):  # a pool per search: workers do not end what the time ended, other segments would wait
            legs.run(workers)
        else:
            with workers() as pool:
                legs.run(partial(nullcontext, pool))
    except KeyboardInterrupt:
        interrupted = True
    except PlanningError as error:
        if not budget.given or not legs.parts():
            raise
        time_is_up = {TIME_IS_UP: f"{error}"}
    if not (segments := legs.parts()):
        raise KeyboardInterrupt
    if not interrupted and any(TIME_IS_UP in one.options for one in segments):
        time_is_up = {TIME_IS_UP: ""} | time_is_up
    chosen = any(len(layer) > 1 for layer in layers)
    return MotionPlan.of_cycle(
        task,
        segments,
        seed=seed,
        seconds=time.perf_counter() - began,
        interrupted=interrupted or bool(time_is_up),
        options={"starts": starts, **({"choices": choices} if chosen else {}), **time_is_up},
    )


@contextmanager
def _comparing(budget: TimeBudget) -> Iterator[None]:
    """Turn the end of the time in this block into the reason why there is no plan."""
    try:
        with interrupted_after(budget.left):
            yield
    except TimeIsUpError:
        raise PlanningError("the time was up while postures were compared; give more seconds") from None


def _direct(_: MotionTask, search: Callable[..., MotionPlan], budget: TimeBudget, __: bool) -> MotionPlan:
    try:
        with interrupted_after(budget.left):
            return search()
    except TimeIsUpError as stop:
        raise PlanningError(f"{stop}") from None


def proved(plan: MotionPlan, prove: Prove, stage: Callable[[str], None] | None = None) -> MotionPlan:
    """A plan that was made without certificates with them, as `plan_motion` gives it; in this process.

    An interrupt leaves out those of the other segments of a cycle. `stage` is called with what is proved.
    """
    began, parts, interrupted = time.perf_counter(), [*plan.parts], False
    try:
        for k, part in enumerate(parts):
            if stage and part.starts:
                stage(f"proving {f'segment {k + 1} of {len(parts)}' if plan.segments else 'the motion'} ...")
            parts[k] = proved_part(part, prove)
    except KeyboardInterrupt:
        interrupted = True
    seconds = plan.seconds + time.perf_counter() - began
    return replace(plan.with_parts(parts), seconds=seconds, interrupted=plan.interrupted or interrupted)


@one_thread
def proved_part(plan: MotionPlan, prove: Prove) -> MotionPlan:
    """The plan of one motion with its certificate; slower, or solved again, tighter, where something is not
    proved and time is left.

    Of motions along paths what runs them is proved, which differs.
    """
    if plan.motion.timing is not None or not plan.check.verified or plan.check.certificate is not None:
        return plan
    task, began = cast(MotionTask, plan.task), time.perf_counter()
    plan = replace(plan, check=prove(task.robot, plan.motion, plan.check, task.limits))
    with suppress(TimeIsUpError):  # else the proof so far stays
        plan = plan if plan.check.certified else _made_provable(plan, task, prove)
    return replace(plan, seconds=plan.seconds + time.perf_counter() - began)


def _made_provable(plan: MotionPlan, task: MotionTask, prove: Prove) -> MotionPlan:
    """The plan near this one with a complete proof, else the same."""
    if not plan.starts:  # a slow motion of all joints in step
        slower = slower_to_prove(task.robot, plan.motion, plan.check, task.limits, prove)
        return replace(plan, **slower._asdict()) if slower else plan
    position = next(k for k, start in enumerate(plan.starts) if start.number == plan.best)
    before = plan.starts[position]
    proof = Search(task).proved(Attempt(before, plan.motion, plan.check), prove)
    assert proof.motion is not None
    assert proof.check is not None
    starts = [*plan.starts]
    starts[position] = proof.result.after(before, proof.result)
    known = {"motion": proof.motion, "check": proof.check, "slower": proof.slower}
    return replace(plan, **known, starts=tuple(starts))


class _Legs:
    """The segments between the postures of some sequences, and their plans so far."""

    def __init__(
        self,
        task: CycleTask,
        layers: Sequence[np.ndarray],
        sequences: Sequence[Way],
        starts: int,
        seed: int,
        progress: Progress | None,
        segment: SegmentSearch,
        budget: TimeBudget,
    ) -> None:
        self._search, self._budget = segment, budget
        self._task, self._layers, self._sequences = task, layers, sequences
        self._seed, self._progress, self._starts = seed, progress, starts
        self._plans: dict[Leg, MotionPlan] = {}
        self._errors: dict[Leg, PlanningError] = {}
        self._seconds: dict[Leg, float] = {}
        self._defaults: dict[Leg, float] = {}
        self._done = 0

    def run(self, workers: Callable[[], MaybeWorkers]) -> None:
        """All starts: two of every leg, the others of the best sequence.

        Where time is limited, one of each segment of the most promising sequence, then one of the other legs.
        What has no plan then gets the time that is left before others get more starts.

        Raises:
            PlanningError: a segment has no verified plan.
            KeyboardInterrupt: it was interrupted; what is finished is kept.
        """
        legs = list(dict.fromkeys(leg for way in self._sequences for leg in _legs(way)))
        limited, only = self._budget.given, len(self._sequences) == 1
        first = 1 if limited else min(FIRST, self._starts)
        total = len(legs) * first + len(self._task.segments) * (self._starts - first)
        promising = len(self._task.segments) if limited else len(legs)
        for k, leg in enumerate(legs):
            sharing = promising - k if k < promising else len(legs) - k
            if only or self._useful(leg):
                self._plan(leg, 0, first, total, workers, sharing, needed=only)
            else:
                self._done += first
            if only and not limited:
                self._require(leg)
        best = _legs(self._best())
        missing = sum(leg not in self._plans for leg in best)
        for k, leg in enumerate(sorted(best, key=self._plans.__contains__)):
            sharing = missing - k if k < missing else len(best) - k
            searched = leg not in self._plans or bool(self._plans[leg].starts)  # else more are in vain
            longer = not limited or self._budget.left / sharing > self._seconds.get(leg, 0.0)
            before = 0 if k < missing and longer else first  # the first search may have ended early
            if self._starts > before and searched and self._budget.left:
                self._plan(leg, before, self._starts - before, total, workers, sharing)
            self._require(leg)

    def _useful(self, leg: Leg) -> bool:
        """Whether a sequence with this leg may be the best: no leg of it has failed, and with what the others
        promise it may cost less than any that is planned.
        """
        sequences = [_legs(sequence) for sequence in self._sequences]
        cheapest = min((sum(map(self._cost, legs)) for legs in sequences), default=np.inf)
        if cheapest == np.inf:
            return any(leg in legs and not self._errors.keys() & legs for legs in sequences)
        share = SPARED * min(self._cost(one) / self._default(one) for one in self._plans)

        def lowest(one: Leg) -> float:
            known = one in self._plans or one in self._errors
            return self._cost(one) if known else share * self._default(one)

        return any(leg in legs and not sum(map(lowest, legs)) >= cheapest for legs in sequences)

    def _cost(self, leg: Leg) -> float:
        """Of the plan of a leg and the rest after it, in units of the objective's size; infinite without."""
        if (plan := self._plans.get(leg)) is None:
            return np.inf
        segment = self._task.segments[leg[0]]
        cost = segment.task.objective.cost(plan.energy, plan.duration)
        return (cost + rest_cost(segment, plan.motion.goal)) / segment.task.objective.size

    def _default(self, leg: Leg) -> float:
        """The same of the synchronised default motion."""
        number, i, j = leg
        if leg not in self._defaults:
            ends = self._layers[number][i], self._layers[number + 1][j]
            self._defaults[leg] = leg_cost(self._task.segments[number], *ends)
        return self._defaults[leg]

    def _require(self, leg: Leg) -> None:
        if leg not in self._plans:
            raise PlanningError(f"{self._task.titles()[leg[0]]}: {self._errors[leg]}")

    def parts(self) -> list[MotionPlan]:
        """Plans of the best sequence, up to the first segment that has none."""
        parts = []
        for leg in _legs(self._best()):
            if leg not in self._plans:
                break
            parts.append(self._plans[leg])
        return parts

    def _best(self) -> Way:
        """The sequence of minimum cost over legs with plans; one without all of them: the most promising."""

        sizes = [len(layer) for layer in self._layers]
        result = best_sequences(sizes, lambda *leg: self._cost(leg), self._task.closed, 1)
        return result[0][1] if result else self._sequences[0]

    def _plan(
        self,
        leg: Leg,
        first: int,
        count: int,
        total: int,
        workers: Callable[[], MaybeWorkers],
        sharing: int,
        needed: bool = True,
    ) -> None:
        """Run starts of one leg; an interrupt is passed on after its plan is kept.

        `sharing` legs, this one included, share the time that is left; `needed` is as of `SegmentSearch`.
        """
        number, i, j = leg
        task = self._task.segments[number].between(self._layers[number][i], self._layers[number + 1][j])
        task = replace(task, rise_times=task.rise_times or ())

        def progress(done: int, steps: int, best: float | None) -> None:
            if self._progress:
                self._progress(min(self._done + count * done // steps, total), total, best)

        seconds = self._budget.left / sharing
        try:
            how = {"starts": count, "first": first, "seed": self._seed, "progress": progress}
            budget = TimeBudget(seconds if self._budget.given else None)
            plan = self._search(task, partial(plan_segment, task, workers=workers(), **how), budget, needed)
        except PlanningError as error:
            if seconds >= self._seconds.get(leg, 0.0):  # a longer search says more
                self._errors[leg], self._seconds[leg] = error, seconds
        else:
            self._plans[leg] = _both(self._plans.get(leg), plan)
            if plan.stopped:
                raise KeyboardInterrupt
        self._done += count


def _both(one: MotionPlan | None, other: MotionPlan) -> MotionPlan:
    """The better of two plans of the same task, with the starts of both."""
    if one is None:
        return other
    cost = one.task.objective.cost
    better = min(one, other, key=lambda plan: cost(plan.energy, plan.duration))
    starts = tuple(sorted((*one.starts, *other.starts), key=lambda start: start.number))
    options = {name: value for name, value in better.options.items() if name != TIME_IS_UP}
    options["starts"] = sum(plan.options.get("starts", 0) for plan in (one, other))
    options |= {TIME_IS_UP: ""} if TIME_IS_UP in other.options else {}
    seconds = one.seconds + other.seconds
    return replace(better, starts=starts, seconds=seconds, interrupted=other.interrupted, options=options)


def _legs(way: Way) -> list[Leg]:
    return [(k, i, j) for k, (i, j) in enumerate(pairwise(way))]


def _postures(layers: Sequence[np.ndarray], way: Way) -> list[np.ndarray]:
    return [layer[i] for layer, i in zip(layers, way, strict=True)]
