"""The starts of the eight cases: what is planned, run, kept as lines and read again."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

from ocptip.basics.errors import OcptipError
from ocptip.basics.write import plain
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.planner.attempt import Attempt, StartResult
from ocptip.motion.planner.jobs import call
from ocptip.motion.planner.one_start import Search
from ocptip.motion.task import MotionTask
from ocptip.numerics.workers import worker_pool
from ocptip.published.tasks import experiment_task
from ocptip.standing.limits import Limits
from ocptip.trajectories.trajectory import Trajectory
from studies.common import PLANNING, JsonLines, broken_line, source_state

Key = tuple[str, str, int]  # set, case, number of the start


@dataclass(frozen=True)
class LimitSet:
    """One set of limits.

    Attributes:
        name: for options and folders.
        title: for tables.
        base: base data, see `experiment_robot`.
        own_reserves: GN and GT are limited to the worst of the printed motion, otherwise to 0.9.
        target: for the average ratio of energies, ours to the printed motion's.
    """

    name: str
    title: str
    base: str
    own_reserves: bool
    target: float


SETS = {
    one.name: one
    for one in (
        LimitSet("printed", "printed base, GN <= 0.9, GT <= 0.9", "printed", False, 0.77),
        LimitSet("effective", "effective base, GN <= 0.9, GT <= 0.9", "effective", False, 0.80),
        LimitSet("reference", "printed base, reserves of the printed motion", "printed", True, 0.84),
    )
}


@dataclass(frozen=True)
class Options:
    """What is asked for.

    Attributes:
        cases, sets: names.
        starts: per case and set.
        seed: of the random motions.
        jobs: processes.
    """

    cases: tuple[str, ...]
    sets: tuple[str, ...]
    starts: int = 50
    seed: int = 0
    jobs: int = 1

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Set and case of all that is planned."""
        return [(name, case) for name in self.sets for case in self.cases]


@cache
def task_of(set_name: str, case: str) -> MotionTask:
    """The task of a case with the limits of a set."""
    one = SETS[set_name]
    task = experiment_task(case, one.base)
    if not one.own_reserves:
        return task
    worst = reference_check(set_name, case).worst
    return replace(task, limits=Limits(GN=worst["GN"].value, GT=worst["GT"].value))


@cache
def reference_check(set_name: str, case: str) -> MotionCheck:
    """The printed motion of a case on the base of a set."""
    task = experiment_task(case, SETS[set_name].base)
    return check_motion(task.robot, task.reference)


def state() -> str:
    """Short digest of the planner's source code and of all versions: which planner made a result."""
    return source_state(*PLANNING)


class Journal:
    """The finished starts: a file of JSON lines that only grows, also when several processes add to it.

    Args:
        path: of the file; made by the first line.
        seed: of the starts of interest.
    """

    def __init__(self, path: Path, seed: int) -> None:
        self.path, self.seed = path, seed
        self.lines: dict[Key, dict] = {}
        self._file = JsonLines(path)
        for count, line in enumerate(self._file.read(), 1):
            try:
                self._take(line)
            except (TypeError, KeyError):
                raise broken_line(path, count) from None

    def _take(self, line: dict) -> None:
        key = line["set"], line["case"], line["number"]
        if line["seed"] == self.seed and key[0] in SETS and line["limits"] == limits_of(*key[:2]):
            self.lines[key] = line

    def add(self, line: dict) -> None:
        """Write a line to the disk."""
        line = plain(line)
        self._file.append(line)
        self._take(line)

    def done(self, key: Key) -> bool:
        """Whether that start needs not be run; one that ended in an unforeseen error is tried again."""
        return key in self.lines and not self.lines[key]["error"]

    def of(self, set_name: str, case: str, starts: int) -> list[dict]:
        """The lines of a pair, by number, of the first `starts` starts."""
        numbers = range(starts)
        return [self.lines[key] for n in numbers if (key := (set_name, case, n)) in self.lines]


def limits_of(set_name: str, case: str) -> dict[str, float]:
    """The limits of a pair as they are written: rounded, since last digits differ between machines.

    All others are as they are by default: durations are free, jumps do not count, nothing is uncertain.
    """
    limits = task_of(set_name, case).limits
    return {name: round(getattr(limits, name), 9) for name in ("GN", "GT", "torque_ratio", "clearance")}


def line_of(key: Key, seed: int, attempt: Attempt | None, error: str = "") -> dict:
    """A finished start as plain data; `attempt` is None after an unforeseen error."""
    set_name, case, number = key
    result = (
        attempt.result
        if attempt
        else StartResult(number, f"error: {error}", math.nan, False, 0, 0.0, 0.0, 0, {})
    )
    return {
        "set": set_name,
        "case": case,
        "number": number,
        "seed": seed,
        "limits": limits_of(set_name, case),
        "state": state(),
        "error": attempt is None,
        "status": result.status,
        "energy_J": result.energy,
        "verified": result.verified,
        "iterations": result.iterations,
        "solves": result.solves,
        "seconds": result.seconds,
        "cpu_seconds": result.cpu_seconds,
        "stages": result.stages,
        "motion": attempt.motion.to_dict() if attempt and attempt.motion else None,
    }


def result_of(line: dict) -> StartResult:
    """The inverse of `line_of`, without the motion."""
    energy = math.nan if line["energy_J"] is None else line["energy_J"]
    names = ("number", "status", "verified", "iterations", "seconds", "cpu_seconds", "solves", "stages")
    return StartResult(energy=energy, **{name: line[name] for name in names})


def run_starts(journal: Journal, options: Options, say: Callable[[str], None]) -> int:
    """Run the starts that are not there yet; returns how many."""
    todo = [(*pair, n) for pair in options.pairs for n in range(options.starts)]
    todo = [key for key in todo if not journal.done(key)]
    for done, (key, attempt, error) in enumerate(_attempts(todo, options), 1):
        journal.add(line_of(key, options.seed, attempt, error))
        say(f"{done}/{len(todo)} starts, last: {key[1]}, {key[0]}")
    return len(todo)


def run_start(payload: bytes, number: int, seed: int) -> Attempt:
    """The start of that number, of a pickled task."""
    return call(Search.run, payload, number, seed)


def _attempts(todo: list[Key], options: Options) -> Iterator[tuple[Key, Attempt | None, str]]:
    """Start, outcome and error text, in the order in which they end."""
    if not todo:
        return
    payloads = {pair: pickle.dumps(task_of(*pair)) for pair in {key[:2] for key in todo}}
    if options.jobs == 1:
        for key in todo:
            yield key, *_outcome(run_start, payloads[key[:2]], key[2], options.seed)
        return
    with worker_pool(None, options.jobs, len(todo)) as pool:
        futures = {pool.submit(run_start, payloads[key[:2]], key[2], options.seed): key for key in todo}
        for future in as_completed(futures):
            yield futures.pop(future), *_outcome(future.result)


def _outcome(call: Callable[..., Attempt], *arguments: object) -> tuple[Attempt | None, str]:
    try:
        return call(*arguments), ""
    except (ArithmeticError, LookupError, RuntimeError, TypeError, ValueError, OcptipError) as error:
        return None, f"{type(error).__name__}: {error}"  # counted as a failed start, not the end of the study


def best_plan(journal: Journal, set_name: str, case: str, options: Options) -> MotionPlan | None:
    """The motion of least energy among the verified ones of a pair, checked anew; None if there is none."""
    lines = journal.of(set_name, case, options.starts)
    task = task_of(set_name, case)
    for line in sorted((x for x in lines if x["verified"]), key=lambda x: (x["energy_J"], x["number"])):
        motion = Trajectory.from_dict(line["motion"])
        checked = check_motion(task.robot, motion, task.limits)
        if checked.verified:
            return MotionPlan(
                task=task,
                motion=motion,
                check=checked,
                starts=tuple(map(result_of, lines)),
                best=line["number"],
                seed=options.seed,
                seconds=sum(x["seconds"] for x in lines),
                interrupted=len(lines) < options.starts,
                options={
                    "starts": options.starts,
                    "base": SETS[set_name].base,
                    "limits": asdict(task.limits),
                },
            )
    return None
