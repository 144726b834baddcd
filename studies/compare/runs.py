"""The runs of the comparison with Nelder-Mead: a method from a start, checked; all runs, kept as lines."""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path

import numpy as np

from ocptip.basics.errors import OcptipError
from ocptip.basics.write import versions
from ocptip.motion.check import MotionCheck, check_motion
from ocptip.motion.planner.one_start import Search
from ocptip.motion.task import MotionTask
from ocptip.motion.violations import sentence
from ocptip.numerics.threads import one_thread
from ocptip.numerics.workers import worker_pool
from ocptip.published.tasks import experiment_task
from ocptip.trajectories.trajectory import Trajectory
from studies.baselines.penalty import MotionPenalty
from studies.common import PLANNING, JsonLines, machine, progress, source_state
from studies.compare.methods import SEARCHES, Recorder, Settings, TimeIsUpError

BASE = "effective"
CMA_SHARE = 10.0  # times the seconds of ours
HISTORY_POINTS = 60
SLOWEST = 8.0  # factor of time up to which a motion is slowed down until it is verified
SLOWING = 1e-3  # resolution of that factor


@lru_cache(maxsize=2)
def prepared(case: str, settings: Settings) -> tuple[MotionTask, Search, MotionPenalty]:
    """Task, planner and penalty of a case; compiled code is run once, so that no method pays for it."""
    task = experiment_task(case, BASE)
    penalty = MotionPenalty(task, weight=settings.weight, between=settings.between)
    p = penalty.random_start(0, settings.seed)
    check_motion(task.robot, penalty.motion(p), task.limits)
    penalty(np.full(penalty.size, 0.9))  # too fast: contacts slip and lift off
    return task, Search(task), penalty


def run_one(case: str, start: int, method: str, settings: Settings, seconds: float | None = None) -> dict:
    """One method from one start, as plain data.

    Args:
        case, start, method: see the module.
        settings: of the study.
        seconds: CPU time at most, if it is not that of the settings.
    """
    with one_thread:
        if method == "cma":
            importlib.import_module("cma")  # takes a second that is not the search's
        task, search, penalty = prepared(case, settings)
        p = penalty.random_start(start, settings.seed)
        first = penalty.evaluate(p)
        limit = settings.max_seconds if seconds is None else seconds
        record = {"case": case, "start": start, "method": method, "limit_s": limit}
        record |= {"start_J": first.energy, "start_cost": first.cost, "start_feasible": first.feasible}
        record["history"] = [[0.0, 1, first.cost]]
        wall, cpu = time.perf_counter(), time.process_time()
        if method == "ours":
            attempt = search.run(start, settings.seed)
            motion, checked = attempt.motion, attempt.check
            record |= {"status": attempt.result.status, "evaluations": attempt.result.iterations}
            timed = time.perf_counter() - wall, time.process_time() - cpu
        else:
            recorder = Recorder(penalty, limit)
            recorder.evaluate(p)
            try:
                status = SEARCHES[method](recorder, p, settings.seed * 1000 + start)
            except TimeIsUpError:
                status = "time is up"
            except OcptipError as error:  # a library asked for a point that is none
                status = f"failed: {error}"
            timed = time.perf_counter() - wall, time.process_time() - cpu
            motion = penalty.motion(recorder.best_p)
            checked = check_motion(task.robot, motion, task.limits)
            record |= {"status": status, "evaluations": recorder.count, "cost": recorder.best}
            record["history"] = thinned([*recorder.history, (timed[1], recorder.count, recorder.best)])
        record |= {"wall_s": timed[0], "cpu_s": timed[1]}
        return record | (outcome(task, penalty, motion, checked) if motion is not None else NO_MOTION)


NO_MOTION = {
    "energy_J": None, "duration_s": None, "verified": False, "worst": None, "violations": [],
    "slowed": None, "inside_bounds": None, "motion": None,
}  # fmt: skip


def outcome(task: MotionTask, penalty: MotionPenalty, motion: Trajectory, checked: MotionCheck) -> dict:
    """What a result is worth: energy, checked, and energy of the motion slowed down until it is verified."""
    try:
        p = penalty.parameters(motion)
        inside = bool(np.all((p >= -1e-9) & (p <= 1 + 1e-9)))
    except OcptipError:
        inside = None
    return {
        "energy_J": checked.energy,
        "duration_s": checked.duration,
        "verified": checked.verified,
        "worst": {name: checked.worst[name].value for name in ("GN", "GT", "torque_ratio", "clearance_m")},
        "violations": [*map(sentence, checked.violations)],
        "slowed": slowed(task, motion, checked),
        "inside_bounds": inside,
        "motion": motion.to_dict(),
    }


def slowed(task: MotionTask, motion: Trajectory, checked: MotionCheck) -> dict | None:
    """Least factor of time (to about `SLOWING`) that makes a motion verified; None if there is none."""
    if checked.verified:
        return {"factor": 1.0, "energy_J": checked.energy}

    def at(factor: float) -> MotionCheck:
        return check_motion(task.robot, motion.time_scaled(factor), task.limits)

    low, high = 1.0, 1.0 + 4 * SLOWING
    while not (found := at(high)).verified:
        low, high = high, 1 + 2 * (high - 1)
        if high > SLOWEST:
            return None
    while high - low > SLOWING * high:
        middle = 0.5 * (low + high)
        if (checked := at(middle)).verified:
            high, found = middle, checked
        else:
            low = middle
    return {"factor": high, "energy_J": found.energy}


def thinned(history: list[tuple[float, int, float]]) -> list[list[float]]:
    """At most `HISTORY_POINTS` of the points, first and last included."""
    chosen = np.unique(np.linspace(0, len(history) - 1, HISTORY_POINTS).round().astype(int))
    return [[round(history[k][0], 4), history[k][1], float(f"{history[k][2]:.7g}")] for k in chosen]


Key = tuple[str, int, str]


class Runs:
    """Finished runs in a file, one line each behind a header with the settings; several processes may add.

    Raises:
        ValueError: the file was written with other settings.
    """

    def __init__(self, path: Path, settings: Settings) -> None:
        self.state = state()
        self.records: dict[Key, dict] = {}
        self._file = JsonLines(path)
        self._file.append({"settings": asdict(settings), **environment()}, first=True)
        self.header, *records = self._file.read()
        if (old := self.header["settings"]) != asdict(settings):
            raise ValueError(f"{path}: has runs with other settings ({old}); choose another --out")
        for record in records:
            self.records[record["case"], record["start"], record["method"]] = record

    def add(self, record: dict) -> None:
        record = {**record, "state": self.state}
        self.records[record["case"], record["start"], record["method"]] = record
        self._file.append(record)

    def seconds_for(self, key: Key) -> float | None:
        """Time limit of CMA-ES: ten times what ours took for the same start."""
        case, start, method = key
        ours = self.records.get((case, start, "ours"))
        return CMA_SHARE * ours["cpu_s"] if method == "cma" and ours else None


def run_all(runs: Runs, keys: Sequence[Key], settings: Settings, jobs: int) -> None:
    """Run what is missing; ours first, because CMA-ES gets its time from it."""
    missing = [key for key in keys if key not in runs.records]
    done = len(keys) - len(missing)
    progress(done, len(keys), "runs")
    phases = [[k for k in missing if k[2] == "ours"], [k for k in missing if k[2] != "ours"]]
    for phase in phases:
        for record in _executed(phase, runs, settings, jobs):
            runs.add(record)
            done += 1
            progress(done, len(keys), "runs")


def _executed(keys: Sequence[Key], runs: Runs, settings: Settings, jobs: int) -> Iterator[dict]:
    if jobs == 1 or len(keys) < 2:
        for key in keys:
            yield run_one(*key, settings, runs.seconds_for(key))
        return
    with worker_pool(None, jobs, len(keys)) as pool:
        futures = [pool.submit(run_one, *key, settings, runs.seconds_for(key)) for key in keys]
        for future in as_completed(futures):
            yield future.result()


def environment() -> dict:
    """Versions and machine."""
    return {"versions": versions(("numpy", "scipy", "casadi", "llvmlite")), "machine": machine()}


def state() -> str:
    """Short digest of the source code of all methods and of all versions."""
    return source_state(*PLANNING)
