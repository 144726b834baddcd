"""Plans a motion: random starts in parallel, each searched and checked; the best verified one is proved."""

from __future__ import annotations

import pickle
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

from ocptip.basics.errors import PlanningError, whole_number
from ocptip.motion.check import MotionCheck, Prove
from ocptip.motion.choices import likely_choices, rounds
from ocptip.motion.planner.attempt import Attempt, Rough, StartResult
from ocptip.motion.planner.one_start import Search, free_ends
from ocptip.motion.rise_times import others, with_rise_time
from ocptip.motion.task import MotionTask, require_plannable
from ocptip.motion.tolerated import tolerable, too_much
from ocptip.numerics.threads import one_thread
from ocptip.numerics.workers import WorkerDiedError, worker_pool
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.trajectories.trajectory import Trajectory

LOST = "lost: "
"""Status of a start begins so if it killed its worker process again and again."""

_TASKS_IN_MEMORY = 4  # per worker
FINISHED = 3  # of the starts, the most promising ones; more only if none is verified
HOPS = 4  # random changes of the best motion that are tried at once
EARLY = 2  # of them begin as soon as so many of the most promising starts are finished


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """A planned motion.

    Attributes:
        task: what was asked for, with the start and goal that were chosen.
        motion: the exact ramp motion.
        check: of all limits, on the dense grid, with a certificate if it is proved and no interrupt came.
        starts: what became of each start that finished, by number.
        best: number of the start the motion comes from.
        seed: of the starts.
        seconds: wall time of the planning.
        interrupted: some starts had not finished.
        options: what else was asked for.
    """

    task: MotionTask
    motion: Trajectory
    check: MotionCheck
    starts: tuple[StartResult, ...]
    best: int
    seed: int
    seconds: float
    interrupted: bool
    options: dict[str, Any]

    @property
    def energy(self) -> float:
        """Electric energy, J."""
        return self.check.energy

    @property
    def duration(self) -> float:
        """Duration, s."""
        return self.check.duration

    @property
    def parts(self) -> tuple[MotionPlan, ...]:
        """This plan: a motion has one segment."""
        return (self,)

    @property
    def finished(self) -> MotionTask:
        """The task, all of which is planned."""
        return self.task

    @property
    def complete(self) -> bool:
        """True: there is no further segment."""
        return True

    @property
    def lost(self) -> tuple[StartResult, ...]:
        """Starts without a result, because they killed their workers."""
        return tuple(start for start in self.starts if start.status.startswith(LOST))

    @property
    def verified(self) -> bool:
        """Every limit holds on the dense grid."""
        return self.check.verified


def plan_motion(
    task: MotionTask,
    *,
    starts: int = 8,
    first: int = 0,
    seed: int = 0,
    executor: Executor | None = None,
    jobs: int | None = None,
    progress: Callable[[int, int, float | None], None] | None = None,
    prove: Prove | None = None,
) -> MotionPlan:
    """Plan the ramp motion of least cost that keeps all limits of a task.

    Every start is a random motion, improved by Ipopt and checked on a dense time grid. Where the task leaves
    a choice of postures, the most promising pairs of start and goal get one start each and the best of them
    the others, see `ocptip.motion.choices`. Only the starts that promise the least cost after their first
    program are finished. The best motion is half as many times as there are starts changed at random and
    solved anew (basin hopping), but not within a tolerance. With `prove`, the best gets its certificate;
    where that leaves something open, the motion is solved again, a little tighter there, and the proved one
    wins if it costs at most 0.5 % more. The result depends on task, starts and seed only, not on where the
    starts run. An interrupt (Ctrl-C) ends the planning with the best verified plan so far. A worker that dies
    is replaced and its start run again; a start that kills two is left out, see `lost`, and so is such a
    change. (Of an
    executor that breaks with its worker, such as a ProcessPoolExecutor, the death ends the planning like an
    interrupt, with a RuntimeWarning.)

    Args:
        task: made by hand, or one of `ocptip.published.tasks` or `ocptip.task_files.motion`.
        starts: number of random starts.
        first: number of the first of them: with `first=2` those follow that `starts=2` has run.
        seed: of the random motions.
        executor: runs the starts: any `concurrent.futures` executor, such as `dask_client.get_executor()`.
            Default is a process pool of its own; as always with process pools, a script needs its `if
            __name__ == "__main__":` then.
        jobs: number of processes of the default pool, one per core by default; 1 runs in this process.
        progress: called as progress(done, steps, least cost of a verified plan so far or None); a start is
            one step until its promise is known, and one until it is finished or left out.
        prove: gives the best its certificate, as `ocptip.certificate.checks.certified` does; `proved` gives
            it later.

    Raises:
        InputError: the task cannot be planned (all reasons with their numbers), or starts, jobs or seed
            are no such numbers.
        PlanningError: no start gave a verified plan; the message names the nearest one's violations.
    """
    _require_numbers(starts, jobs, seed)
    require_plannable(task)
    began = time.perf_counter()
    attempts: dict[int, Attempt] = {}
    best: Attempt | None = None
    interrupted = False
    costs, tasks_of = dict[int, float](), dict[int, MotionTask]()
    steps = 2 * starts + (0 if task.limits.tolerance.given else _hops_of(starts))
    if progress:
        progress(0, steps, None)
    own = executor is None and jobs == 1
    try:
        with one_thread:
            tasks = likely_choices(task)
        with nullcontext() if own else worker_pool(executor, jobs, starts) as pool:
            work = partial(_in_process, {}) if own else partial(_in_pool, pool)
            for own_tasks in _families(tasks):
                numbers = range(first, first + starts)
                found = _turns(work, own_tasks, numbers, seed, costs, attempts, tasks_of)
                for done, attempt in enumerate(found, 1):
                    if isinstance(attempt, Attempt):
                        attempts[attempt.result.number] = attempt
                        if attempt.result.verified:
                            costs[attempt.result.number] = _cost(task, attempt)
                            best = attempts[min((cost, k) for k, cost in costs.items())[1]]
                    if progress:
                        progress(done, steps, min(costs.values(), default=None))
                if best is not None:
                    break
            if best is not None and task.rise_times is None:
                best = attempts[best.result.number] = _with_best_rise_time(work, best, tasks_of)
            if best is not None and prove is not None:
                own = tasks_of[best.result.number]
                proof = next(work("proved", [(own, (best, prove))]))
                best = attempts[best.result.number] = proof.after(best, proof)
    except BrokenExecutor as error:
        died = f"a worker process died after {len(attempts)} of {starts} starts ({error}); out of memory? "
        died += "With jobs=1 no workers are needed"
        if best is None:
            raise PlanningError(died) from error
        warnings.warn(f"{died}. The plan is the best of those starts", RuntimeWarning, stacklevel=2)
        interrupted = True
    except KeyboardInterrupt:
        if best is None:
            raise
        interrupted = True
    if best is None:
        raise _why_not(task, list(attempts.values()))
    chosen = tasks_of[best.result.number]
    if free_ends(chosen):
        chosen = replace(chosen, start=best.motion.start, goal=best.motion.goal)
    choices = {"choices": {"pairs": len(task.choices), "planned": len(tasks)}} if task.choices else {}
    return MotionPlan(
        task=chosen,
        motion=best.motion,
        check=best.check,
        starts=tuple(sorted((a.result for a in attempts.values()), key=lambda r: r.number)),
        best=best.result.number,
        seed=seed,
        seconds=time.perf_counter() - began,
        interrupted=interrupted,
        options={"starts": starts, **choices},
    )


def proved(plan: MotionPlan, prove: Prove) -> MotionPlan:
    """A plan that was made without certificate with it, as `plan_motion` gives it; in this process."""
    at = next(k for k, start in enumerate(plan.starts) if start.number == plan.best)
    before = plan.starts[at]
    attempt = Attempt(before, plan.motion, plan.check)
    [found] = _in_process({}, "proved", [(plan.task, (attempt, prove))])
    starts = [*plan.starts]
    starts[at] = found.result.after(before, found.result)
    seconds = plan.seconds + found.result.seconds
    return replace(plan, motion=found.motion, check=found.check, starts=tuple(starts), seconds=seconds)


def _require_numbers(starts: int, jobs: int | None, seed: int) -> None:
    for name, value in (("starts", starts), ("jobs", 1 if jobs is None else jobs)):
        whole_number(name, value, 1)
    whole_number("seed", seed, 0)


class ToleranceError(PlanningError):
    """No motion within a tolerance was found, though motions were.

    Attributes:
        too_much: the quantity that alone was too much for the best motion found, else everything.
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


def _why_not(task: MotionTask, attempts: list[Attempt]) -> PlanningError:
    """Says how the starts ended, what the nearest one lacks, and how much of a tolerance there can be."""
    moving = [a for a in attempts if a.check is not None]
    if not moving:
        first = attempts[0].result.status
        return PlanningError(
            f"none of {len(attempts)} starts gave a motion; the first: {first}; more starts, another seed or "
            "less strict limits may help"
        )
    nearest = min(moving, key=lambda a: (len(a.check.violations), a.result.energy, a.result.number))
    violations = "; ".join(nearest.check.violations)
    found = f"none of {len(attempts)} starts gave a verified motion"
    if task.limits.tolerance.given:
        shares = [tolerable(task.robot, a.motion, task.limits) for a in moving]
        most = max(shares)
        if most == 1:  # then what is broken has nothing to do with the tolerance
            return PlanningError(
                f"{found}; the tolerance is not what they lack, one of them keeps it; start "
                f"{nearest.result.number}: {violations}"
            )
        best = moving[shares.index(most)]
        alone, factor, why = too_much(task.robot, best.motion, task.limits)
        share = f"{int(100 * most)} % of it"  # rounded down: 100 % would contradict the refusal
        found += f" within the uncertainty; the best of them keeps its limits with {share} ({why})"
        error = ToleranceError(f"{found}; start {nearest.result.number}: {violations}")
        error.too_much, error.factor = alone, factor
        return error
    return PlanningError(f"{found}; start {nearest.result.number}: {violations}")


def _turns(
    work: Callable[[str, list[_Job]], Iterator[Any]],
    tasks: list[MotionTask],
    numbers: range,
    seed: int,
    costs: dict[int, float],
    attempts: dict[int, Attempt],
    tasks_of: dict[int, MotionTask],
) -> Iterator[Attempt | Rough]:
    """Random starts, then random changes of the best; the caller fills costs and attempts meanwhile.

    Each start comes twice, as what it promises and as what it has come to; then what was changed, with each
    change. The first changes are of the better of the most promising starts, if these are verified, while
    another one is still under way; the next ones of the best start, and the others each of the best that was
    known `HOPS` changes before. So that many can be under way at once, and what comes out does not depend on
    which of them ends first.

    Args:
        work: yields what a method of `Search` finds for each task with its arguments, in any order.
        tasks: one, or one for each pair of postures.
        numbers: of the starts.
        seed: of the starts.
        costs, attempts: of the starts that are verified, and of all that ended, by number.
        tasks_of: is told which start is of which task.
    """
    count = 0 if tasks[0].limits.tolerance.given else _hops_of(len(numbers))
    chosen, under_way = list[int](), deque[tuple[Attempt, Iterator[Attempt]]]()

    def begin(hop: int, among: Iterable[int]) -> None:
        number = min((costs[k], k) for k in among)[1]
        base = attempts[number]
        under_way.append((base, work("hopped", [(tasks_of[number], (base, (seed, number, hop)))])))

    for found in _most_promising(work, tasks, numbers, seed, tasks_of, chosen):
        yield found
        first = chosen[:EARLY]
        if not under_way and len(first) == EARLY and all(number in costs for number in first):
            for hop in range(min(EARLY, count)):
                begin(hop, first)
    for hop in range(len(under_way), count + HOPS if costs else 0):
        if hop >= HOPS and under_way:
            base, hopped = under_way.popleft()
            if (found := next(hopped)) is not base:  # else it was lost
                known = attempts[found.result.number]
                yield min(known, found, key=partial(_cost, tasks[0])).after(known, found)
        if hop < count:
            begin(hop, costs)


def _hops_of(starts: int) -> int:
    """How often the best of so many starts is changed."""
    return starts // 2


def _most_promising(
    work: Callable[[str, list[_Job]], Iterator[Any]],
    tasks: list[MotionTask],
    numbers: range,
    seed: int,
    tasks_of: dict[int, MotionTask],
    chosen: list[int],
) -> Iterator[Attempt | Rough]:
    """Starts, of which only those that promise the least cost are finished; more only if none is verified.

    One that promises so little that no other can displace it is finished before the others have said theirs.
    When these are known, `chosen` holds their numbers, the most promising first.
    """
    rough, promised = list[Rough](), dict[int, float]()
    silent, begun, under_way = len(numbers), set[int](), list[Iterator[Attempt]]()

    def finish(most: int) -> None:
        rough.sort(key=lambda one: (one.cost, one.number))
        for one in rough[: max(most, 0)]:
            if one.number not in begun:
                begun.add(one.number)
                under_way.append(work("run", [(tasks_of[one.number], (one.number, seed, one))]))

    for batch in rounds(tasks, numbers, promised):
        tasks_of.update((number, task) for task, number in batch)
        for one in work("rough", [(task, (number, seed)) for task, number in batch]):
            silent -= 1
            if isinstance(one, Rough):  # else it is lost
                rough.append(one)
                promised[one.number] = one.cost
            yield one
            finish(FINISHED - silent)
    chosen += [one.number for one in rough[:FINISHED]]
    verified = False
    while rough and not verified:
        finish(FINISHED)
        for ended in under_way:
            for attempt in ended:
                verified |= attempt.result.verified
                yield attempt
        under_way.clear()
        rough = [one for one in rough if one.number not in begun]
    yield from (one.left_out for one in rough)


def _families(tasks: list[MotionTask]) -> list[list[MotionTask]]:
    """Tasks with the rise times that are tried first, and, where these lead nowhere, as ramps."""
    risen = [with_rise_time(task) for task in tasks]
    return [tasks] if risen == tasks else [risen, tasks]


def _with_best_rise_time(
    work: Callable[[str, list[_Job]], Iterator[Any]], best: Attempt, tasks_of: dict[int, MotionTask]
) -> Attempt:
    """The best start with the rise time with which it costs least; `tasks_of` is told."""
    number = best.result.number
    tried = {tasks_of[number].rise_times}
    while candidates := [one for one in others(tasks_of[number]) if one.rise_times not in tried]:
        tried |= {one.rise_times for one in candidates}
        found = list(work("changed", [(one, (best,)) for one in candidates]))
        better = min(found, key=lambda one: _cost(tasks_of[number], one))
        if not _cost(tasks_of[number], better) < _cost(tasks_of[number], best):
            return best.after(best, *found)
        best = better.after(best, *found)
        own = best.motion.rise_times
        tasks_of[number] = next(one for one in candidates if one.rise_times == own)
    return best


def _cost(task: MotionTask, attempt: Attempt) -> float:
    assert attempt.check is not None
    return task.objective.cost(attempt.check.energy, attempt.check.duration)


_Job = tuple[MotionTask, tuple]


def _in_process(searches: dict[int, Search], what: str, jobs: list[_Job]) -> Iterator[Any]:
    for task, arguments in jobs:
        with one_thread:
            search = searches.get(id(task)) or searches.setdefault(id(task), Search(task))
            found = getattr(search, what)(*arguments)
        yield found


def _in_pool(pool: Executor, what: str, jobs: list[_Job]) -> Iterator[Any]:
    """They begin at once, not when the first result is asked for, and end when nobody asks for more."""
    payloads = {id(task): pickle.dumps(replace(task, source=None)) for task, _ in jobs}
    futures: list[Future] = [
        pool.submit(_run, payloads[id(task)], what, arguments) for task, arguments in jobs
    ]
    found = _as_they_come(futures, jobs)
    next(found)
    return found


def _as_they_come(futures: list[Future], jobs: list[_Job]) -> Iterator[Any]:
    try:
        yield  # from here on its end cancels what has not begun
        for future in as_completed(futures):
            try:
                yield future.result()
            except WorkerDiedError as error:
                yield _lost(jobs[futures.index(future)][1][0], error)
    finally:
        for future in futures:
            future.cancel()


def _lost(begun: int | Attempt, error: WorkerDiedError) -> Attempt:
    """What is said of the start of a number that nobody could run to its end; one gone on with stays."""
    if isinstance(begun, Attempt):
        return begun
    result = StartResult(begun, f"{LOST}{error}", float("nan"), False, 0, 0.0, 0.0, 0, {})
    return Attempt(result, None, None)


def run_start(payload: bytes, number: int, seed: int) -> Attempt:
    """The start of that number, of a pickled task."""
    return _run(payload, "run", (number, seed))


def _run(payload: bytes, what: str, arguments: tuple) -> Any:
    """What that method of `Search` finds; what a worker runs."""
    with one_thread:
        return getattr(_search(payload), what)(*arguments)


@lru_cache(maxsize=_TASKS_IN_MEMORY)
def _search(payload: bytes) -> Search:
    """One search per task and worker process, so that its functions are built once."""
    return Search(pickle.loads(payload))
