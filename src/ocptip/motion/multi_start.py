"""The search for the cheapest motion of a task: many starts, then random changes and rise times.

The programs are not convex: Ipopt finds a local optimum near where it begins. The stages are:

1. Rough programs: random starts spread over the local optima; smooth programs rank them.
2. Finishing: the best ranks are solved exactly and checked; others follow if none of these is verified.
3. Basin hopping: changes of the best motion; none within an uncertainty.
4. Rise times: they are no variables of the programs, so their neighbours are tried one after the other.
   Within an uncertainty with overshoot the first one is about SHORTEST over the share of the margin that is
   left at rest; twice, half and trapezoidal profiles follow while they cost less.

Jobs end in any order, but what begins depends on their results only. So the plan is the same for any number
of workers.
"""

from __future__ import annotations

import math
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import BrokenExecutor, Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from ocptip.basics.errors import PlanningError
from ocptip.basics.interrupts import TimeIsUpError
from ocptip.motion.choices import first_round, likely_choices, second_round
from ocptip.motion.motion_plan import TIME_IS_UP, MotionPlan
from ocptip.motion.planner.attempt import Attempt, Rough
from ocptip.motion.planner.jobs import Job, Jobs
from ocptip.motion.planner.one_start import Search, free_ends
from ocptip.motion.task import MotionTask, refusals, require_plannable
from ocptip.motion.tolerated import SPACING
from ocptip.motion.violations import broken_words
from ocptip.numerics.threads import one_thread
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limit_kinds.worst_case import left_at_rest
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.standing.within.in_motion import worst_of_cases
from ocptip.standing.within.tolerable import IN_MOTION, UNDESCRIBED, culprit, culprit_words, largest
from ocptip.standing.within.worst_case import worst_cases_of
from ocptip.trajectories.trajectory import Trajectory

_ROUGHLY = 0.02  # share: how closely the factor of an uncertainty is known that a motion can have
SHORTEST = 0.05
"""Minimum rise time that is chosen, s: about a period of elastic parts; shorter ones let them ring as steps
do.
"""
LONGEST = 0.4  # s


def with_rise_time(task: MotionTask) -> MotionTask:
    """The task with the rise time that is tried first; as it is where one is given, or none pays."""
    if task.rise_times is not None or not _pays(task):
        return task
    left = left_at_rest(task.robot, task.limits.tolerance, np.array([task.start, task.goal]))
    doublings = np.round(np.log2(1 / np.clip(left, SHORTEST / LONGEST, 1.0)))
    return _possible(task, SHORTEST * 2**doublings) or task


def families(tasks: list[MotionTask]) -> list[list[MotionTask]]:
    """Tasks with the rise times that are tried first; and, where these lead nowhere, as they are."""
    risen = [with_rise_time(task) for task in tasks]
    return [tasks] if risen == tasks else [risen, tasks]


def others(chosen: MotionTask) -> list[MotionTask]:
    """The task with the rise times next to the present one: twice, half, and none."""
    rise = max(cast(tuple[float, ...], chosen.rise_times or (0.0,)))
    results = [other for other in (2 * rise, 0.5 * rise) if SHORTEST <= other <= LONGEST]
    tasks = [_possible(chosen, other) for other in (*results, 0.0)] if rise else []
    return [one for one in tasks if one is not None]


def _pays(task: MotionTask) -> bool:
    limits = task.limits
    return bool(limits.tolerance.overshoot) and task.robot.arm is not None and not limits.stoppable


def _possible(task: MotionTask, rise: float) -> MotionTask | None:
    risen = replace(task, rise_times=float(rise))
    return None if refusals(risen, at_rest=False) else risen


FINISHED = 3  # of the starts, the most promising ones; more only if none is verified
HOPS = 4  # random changes of the best motion that are tried at once
EARLY = 2  # of them begin as soon as so many of the most promising starts are finished
Progress = Callable[[int, int, float | None], None]
MaybeWorkers = AbstractContextManager[Executor | None]


@dataclass(eq=False)
class Start:
    """A random start: its number, one of the pairs of postures, and what is known; None: not yet."""

    number: int
    task: MotionTask
    rough: Rough | None = None
    finishing: Job[Attempt] | None = None
    attempt: Attempt | None = None

    @property
    def rank(self) -> tuple[float, int]:
        """Cost of its motion, which is infinite unless it is verified, and number."""
        return self.attempt.cost(self.task.objective) if self.attempt else np.inf, self.number

    @property
    def verified(self) -> bool:
        """Its motion keeps all limits."""
        return self.rank[0] < np.inf


class MultiStart:
    """The state of a search: its starts, and the running changes of the best.

    Args:
        task: what is to be planned.
        numbers, seed: of the starts; they decide the random motions.
        progress: called as progress(done, steps, minimum cost so far or None). A start is two steps: until
            its promise is known, and until it has ended. A change is one; changes of rise times add steps.
        known: cost of a verified motion that is there before the search; infinite: there is none.
    """

    def __init__(
        self,
        task: MotionTask,
        numbers: range,
        seed: int,
        progress: Progress | None,
        known: float = math.inf,
    ) -> None:
        self._task, self._numbers, self._seed = task, numbers, seed
        self._hops = 0 if task.limits.tolerance.given else len(numbers) // 2
        self._hops_begun, self._hopping = 0, deque[tuple[Start, Job[Attempt]]]()
        self._changes = 0  # of rise times, begun
        self._progress, self._done, self._known = progress, -1, known
        self.starts: list[Start] = []
        self._step()

    @property
    def best(self) -> Start | None:
        """The start whose verified motion has the minimum cost; of equals, the first one."""
        return min((one for one in self.starts if one.verified), key=lambda one: one.rank, default=None)

    def run(self, jobs: Jobs, tasks: list[MotionTask]) -> None:
        """All stages, for the most promising pairs of postures; after an interrupt, what is known stays."""
        for family in families(tasks):
            self.starts, self._done = [], 0
            self._solve_roughly(jobs, first_round(family, self._numbers))
            promised = {start.number: start.rough.cost for start in self.starts if start.rough}
            self._solve_roughly(jobs, second_round(family, self._numbers, promised))
            self._finish(jobs)
            self._hop(jobs)
            if self.best is not None:
                break
        if self.best is not None and self._task.rise_times is None:
            self._change_rise_time(jobs, self.best)

    def _solve_roughly(self, jobs: Jobs, dealt: list[tuple[MotionTask, int]]) -> None:
        """Know what starts promise; begin to finish those that are certain to be among the most promising."""
        starts = [Start(number, task) for task, number in dealt]
        self.starts += starts
        begun = {jobs.begin(Search.rough, one.task, one.number, self._seed): one for one in starts}
        for job in jobs.as_they_end(begun):
            start = begun[job]
            start.rough = job.result() or Rough.failed(start.number, job.lost)
            if start.rough.x is None:
                start.attempt = start.rough.left_out
            self._step()
            unknown = len(self._numbers) - sum(one.rough is not None for one in self.starts)
            self._begin_to_finish(jobs, self._ranked()[: max(FINISHED - unknown, 0)])

    def _ranked(self) -> list[Start]:
        """Starts with a rough motion, the most promising first."""
        ranked = [(s.rough.cost, s.number, s) for s in self.starts if s.rough and s.rough.x is not None]
        return [start for *_, start in sorted(ranked, key=lambda one: one[:2])]

    def _begin_to_finish(self, jobs: Jobs, starts: list[Start]) -> None:
        for one in starts:
            arguments = one.task, one.number, self._seed, one.rough
            one.finishing = one.finishing or jobs.begin(Search.run, *arguments)

    def _finish(self, jobs: Jobs) -> None:
        """Solve the most promising starts exactly, and the next ones as long as none is verified.

        The first changes are of the better of the two most promising ones; they do not wait for the third.
        """
        ranked = self._ranked()
        for first in range(0, len(ranked), FINISHED):
            batch = ranked[first : first + FINISHED]
            self._begin_to_finish(jobs, batch)
            finishing = {one.finishing: one for one in batch if one.finishing}
            for job in jobs.as_they_end(finishing):
                start = finishing[job]
                start.attempt = job.result() or Rough.failed(start.number, job.lost).left_out
                self._step()
                if all(one.verified for one in ranked[:EARLY]):
                    self._begin_hops(jobs, EARLY, ranked[:EARLY])
            if any(start.verified for start in batch) or self._task.limits.cancel is not None:
                break  # for cancels each takes minutes, and where the most promising ones fail, others do
        for start in self.starts:
            if start.finishing is None and start.rough is not None:
                start.attempt = start.rough.left_out
                self._step()

    def _begin_hops(self, jobs: Jobs, until: int, among: Iterable[Start]) -> None:
        """Begin changes of the best up to that number, which is the last part of the seed of each."""
        best = min(among, key=lambda one: one.rank)
        for hop in range(self._hops_begun, min(until, self._hops) if best.verified else 0):
            draw = self._seed, best.number, hop
            self._hopping.append((best, jobs.begin(Search.hopped, best.task, best.attempt, draw)))
            self._hops_begun += 1

    def _hop(self, jobs: Jobs) -> None:
        """Change the best at random, `HOPS` at once: each begins from the best before the running ones."""
        self._begin_hops(jobs, HOPS, self.starts)
        while self._hopping:
            start, job = self._hopping.popleft()
            if hopped := job.result():
                start.attempt = self._better(start, hopped)
                self._step()
            self._begin_hops(jobs, self._hops_begun + 1, self.starts)

    def _change_rise_time(self, jobs: Jobs, best: Start) -> None:
        """Solve the best again with the rise times next to the present one, as long as one of them costs
        less.
        """
        tried = {best.task.rise_times}
        while candidates := [task for task in others(best.task) if task.rise_times not in tried]:
            tried |= {task.rise_times for task in candidates}
            begun = [jobs.begin(Search.changed, task, best.attempt) for task in candidates]
            self._changes += len(begun)
            self._tell()
            attempts = list[Attempt]()
            for job in begun:
                attempts += [attempt] if (attempt := job.result()) else []
                self._step()
            best.attempt = self._better(best, *attempts)
            assert best.attempt.motion is not None
            rises = best.attempt.motion.rise_times
            if rises not in (task.rise_times for task in candidates):
                break
            best.task = next(task for task in candidates if task.rise_times == rises)

    def _better(self, start: Start, *tried: Attempt) -> Attempt:
        """The cheapest of what a start has come to and what was tried from there, with what all that took."""
        assert start.attempt is not None
        cheapest = min((start.attempt, *tried), key=lambda one: one.cost(self._task.objective))
        return cheapest.after(start.attempt, *tried)

    def _step(self) -> None:
        """Tell that one more step is done."""
        self._done += 1
        self._tell()

    def _tell(self) -> None:
        if self._progress:
            steps = 2 * len(self._numbers) + self._hops + self._changes
            cost = min(self._known, self.best.rank[0] if self.best else math.inf)
            self._progress(self._done, steps, cost if cost < math.inf else None)


def plan_segment(
    task: MotionTask,
    *,
    starts: int,
    seed: int,
    first: int = 0,
    workers: MaybeWorkers,
    progress: Progress | None = None,
    known: float = math.inf,
) -> MotionPlan:
    """Plan one motion; see `ocptip.motion.plan.plan_motion`.

    Args:
        task, starts, seed, progress: see there.
        first: number of the first start: with `first=2` those follow that `starts=2` has run.
        known: cost of another verified motion, for `progress`.
        workers: run the jobs, and end with an interrupt; None: this process does.
    """
    require_plannable(task)
    began = time.perf_counter()
    search = MultiStart(task, range(first, first + starts), seed, progress, known)
    with one_thread:
        tasks = likely_choices(task)
    interrupted, ended = False, dict[str, str]()
    try:
        with workers as pool, Jobs(pool) as jobs:
            search.run(jobs, tasks)
    except BrokenExecutor as error:
        finished = sum(start.attempt is not None for start in search.starts)
        died = f"a worker process died after {finished} of {starts} starts ({error}); out of memory? "
        died += "With jobs=1 no workers are needed"
        if search.best is None:
            raise PlanningError(died) from error
        warnings.warn(f"{died}. The plan is the best of those starts", RuntimeWarning, stacklevel=3)
        interrupted = True
    except KeyboardInterrupt as stop:
        if search.best is None and isinstance(stop, TimeIsUpError):
            raise TimeIsUpError(_unfinished(task, search)) from None
        if search.best is None:
            raise
        interrupted, ended = True, {TIME_IS_UP: ""} if isinstance(stop, TimeIsUpError) else {}
    attempts = [start.attempt for start in search.starts if start.attempt is not None]
    if (best := search.best) is None:
        raise _refusal(task, attempts)
    assert best.attempt is not None
    motion, check = best.attempt.motion, best.attempt.check
    assert motion is not None
    assert check is not None
    chosen = best.task
    if free_ends(chosen):
        chosen = replace(chosen, start=motion.start, goal=motion.goal)
    choices = {"choices": {"pairs": len(task.choices), "planned": len(tasks)}} if task.choices else {}
    return MotionPlan(
        task=chosen,
        motion=motion,
        check=check,
        starts=tuple(attempt.result for attempt in attempts),
        best=best.number,
        seed=seed,
        seconds=time.perf_counter() - began,
        interrupted=interrupted,
        options={"starts": starts, **choices, **ended},
    )


class ToleranceError(PlanningError):
    """The search ended without a motion within the uncertainty, but with nominal motions.

    Attributes:
        too_much: the quantity that alone was too much for the best motion, else everything.
        factor: of it that this motion can have, 0 to 1.
        at_rest: of it that start and goal can have at rest, 0 to 1: no motion can have more.
    """

    too_much: Uncertainty = NONE
    factor: float = 0.0
    at_rest: float = 1.0

    @property
    def alone(self) -> bool:
        """One quantity is too much by itself."""
        return len(self.too_much.given) == 1


def _unfinished(task: MotionTask, search: MultiStart) -> str:
    """Says how far a search without a verified motion came, and what its nearest motion lacks."""
    starts = search.starts
    ended = [s.attempt for s in starts if s.attempt is not None]
    rough = sum(start.rough is not None for start in starts)
    text = f"{len(ended)} of {len(starts)} starts had ended, {rough - len(ended)} had only a rough motion"
    moving = [(len(a.check.violations), a.result.number, a.check) for a in ended if a.check is not None]
    if not moving:
        return f"{text}; give more seconds"
    number, check = min(moving, key=lambda one: one[:2])[1:]
    why = f"start {number}: {'; '.join(broken_words(task.robot, check.violations))}"
    return f"{text}; {why}; give more seconds"


def _refusal(task: MotionTask, attempts: list[Attempt]) -> PlanningError:
    """Says how the starts ended, what the nearest one lacks, and how much of an uncertainty there can be."""
    moving = [(a.result, a.motion, a.check) for a in attempts if a.motion is not None and a.check is not None]
    if not moving:
        first = attempts[0].result.status
        return PlanningError(
            f"none of {len(attempts)} starts gave a motion; the first: {first}; more starts, another seed or "
            "less strict limits may help"
        )
    nearest, _, check = min(moving, key=lambda one: (len(one[2].violations), one[0].energy, one[0].number))
    why = f"start {nearest.number}: {'; '.join(broken_words(task.robot, check.violations))}"
    ending = f"none of {len(attempts)} starts gave a verified motion"
    if not task.limits.tolerance.given:
        return PlanningError(f"{ending}; {why}")
    shares = [tolerable(task.robot, motion, task.limits) for _, motion, _ in moving]
    most = max(shares)
    if most == 1:  # then what is broken has nothing to do with the tolerance
        return PlanningError(f"{ending}; the tolerance is not what they lack, one of them keeps it; {why}")
    alone, factor, broken = too_much(task.robot, moving[shares.index(most)][1], task.limits)
    share = f"{int(100 * most)} % of it"  # rounded down: 100 % would contradict the refusal
    within = f"within the uncertainty; the best of them keeps its limits with {share} ({broken})"
    error = ToleranceError(f"{ending} {within}; {why}")
    error.too_much, error.factor = alone, factor
    return error


def tolerable(robot: StandingMechanism, motion: Trajectory, limits: Limits) -> float:
    """The largest factor on a whole uncertainty with which a motion keeps its limits, 0 to 1."""
    return largest(limits.tolerance, _keeper(robot, motion, limits), _ROUGHLY)


def too_much(robot: StandingMechanism, motion: Trajectory, limits: Limits) -> tuple[Uncertainty, float, str]:
    """The quantity that alone is too much for a motion, else everything; the factor that is not; in words."""
    kept = _keeper(robot, motion, limits)
    result = culprit(limits.tolerance, IN_MOTION, kept)
    return *result, culprit_words(*result) if kept(Uncertainty()) else UNDESCRIBED


def _keeper(robot: StandingMechanism, motion: Trajectory, limits: Limits) -> Callable[[Uncertainty], bool]:
    """Whether a motion keeps its contacts within an uncertainty."""
    cases = worst_cases_of(robot, limits.tolerance)
    kinds = limits_of(robot, limits)
    times = motion.both_sides(SPACING)

    def kept(tolerance: Uncertainty) -> bool:
        within_tolerance = worst_of_cases([case.within(tolerance) for case in cases], motion, times)
        return all(worst.excess <= 0 for limit in kinds for worst in limit.within(within_tolerance))

    return kept
