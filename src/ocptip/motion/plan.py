"""Plans a motion: random starts in parallel, each searched and checked; the best verified one is proved."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import Any

from ocptip.basics.errors import PlanningError, whole_number
from ocptip.motion.check import MotionCheck, Prove
from ocptip.motion.choices import likely_choices
from ocptip.motion.multi_start import MultiStart
from ocptip.motion.planner.attempt import Attempt, StartResult
from ocptip.motion.planner.jobs import LOST, Jobs
from ocptip.motion.planner.one_start import Search, free_ends
from ocptip.motion.task import MotionTask, require_plannable
from ocptip.motion.tolerated import tolerable, too_much
from ocptip.numerics.threads import one_thread
from ocptip.numerics.workers import worker_pool
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.trajectories.trajectory import Trajectory


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

    The stages are those of `ocptip.motion.multi_start`: random starts, changes of the best, rise times where
    the task gives none, and with `prove` the certificate. Where that leaves something open, the motion is
    solved again, a little tighter there, and the proved one wins if it costs at most 0.5 % more. Where the
    task leaves a choice of postures, the most promising pairs of start and goal get one start each and the
    best of them the others, see `ocptip.motion.choices`. The result depends on task, starts and seed only,
    not on where the starts run. An interrupt (Ctrl-C) ends the planning with the best verified plan so far. A
    worker that dies is replaced and its job run again; a start that kills two is left out, see `lost`, and so
    is such a change. (Of an executor that breaks with its worker, such as a ProcessPoolExecutor, the death
    ends the planning like an interrupt, with a RuntimeWarning.)

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
    search = MultiStart(task, range(first, first + starts), seed, progress)
    with one_thread:
        tasks = likely_choices(task)
    interrupted, alone = False, executor is None and jobs == 1
    try:
        with nullcontext() if alone else worker_pool(executor, jobs, starts) as pool, Jobs(pool) as begun:
            search.run(begun, tasks, prove)
    except BrokenExecutor as error:
        ended = sum(start.attempt is not None for start in search.starts)
        died = f"a worker process died after {ended} of {starts} starts ({error}); out of memory? "
        died += "With jobs=1 no workers are needed"
        if search.best is None:
            raise PlanningError(died) from error
        warnings.warn(f"{died}. The plan is the best of those starts", RuntimeWarning, stacklevel=2)
        interrupted = True
    except KeyboardInterrupt:
        if search.best is None:
            raise
        interrupted = True
    attempts = [start.attempt for start in search.starts if start.attempt is not None]
    if (best := search.best) is None:
        raise _why_not(task, attempts)
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
        options={"starts": starts, **choices},
    )


def proved(plan: MotionPlan, prove: Prove) -> MotionPlan:
    """A plan that was made without certificate with it, as `plan_motion` gives it; in this process."""
    at = next(k for k, start in enumerate(plan.starts) if start.number == plan.best)
    before = plan.starts[at]
    attempt = Attempt(before, plan.motion, plan.check)
    with one_thread:
        proof = Search(plan.task).proved(attempt, prove)
    assert proof.motion is not None
    assert proof.check is not None
    starts = [*plan.starts]
    starts[at] = proof.result.after(before, proof.result)
    seconds = plan.seconds + proof.result.seconds
    return replace(plan, motion=proof.motion, check=proof.check, starts=tuple(starts), seconds=seconds)


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
    moving = [(a.result, a.motion, a.check) for a in attempts if a.motion is not None and a.check is not None]
    if not moving:
        first = attempts[0].result.status
        return PlanningError(
            f"none of {len(attempts)} starts gave a motion; the first: {first}; more starts, another seed or "
            "less strict limits may help"
        )
    nearest, _, check = min(moving, key=lambda one: (len(one[2].violations), one[0].energy, one[0].number))
    why = f"start {nearest.number}: {'; '.join(check.violations)}"
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
