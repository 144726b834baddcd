"""Ipopt formulation against Nelder-Mead with penalties (appendix D), CMA-ES and SLSQP on the motion problem.

Every method plans the same motions: the cases A to H on the effective base, where the contacts bind, from
the same random starts. Methods:

- ours: `ocptip.motion.search.Search`, smooth and exact programs solved by Ipopt, then proved;
- nelder-mead: the source's method, adapted centroid and bounds, on the penalised cost (5.38);
- nelder-mead-plain: the same without the adapted centroid;
- cma: CMA-ES on the same cost, restarted with twice the population until its time is over: ten times what
  ours took for the same start, if that is known, else --max-seconds;
- slsqp: SLSQP with finite differences on cost and limits without penalty.

All but ours search the parameters of `ocptip.motion.penalty`, whose model of energy, contacts and collisions
is that of the planner; of all points evaluated the one with the least penalised cost is their result. They
see limits at the nodes and at both ends of all intervals; the source's cubic splines (--between spline)
refuse good motions, which would be an unfair handicap. Every result is checked by `prove` on the dense grid;
one that breaks a limit there is slowed down until it keeps all of them, and the energy of that is given, too.
Seconds are of CPU, one thread per run, without start-up and compilation, and without that final check but
for ours, where it is part of the method.

    python studies/compare_nelder_mead.py --out results/compare [--cases A B] [--starts 50] [--jobs 2]

The rows of one case against Nelder-Mead, in less than ten minutes on two cores (CMA-ES is what takes long):

    python studies/compare_nelder_mead.py --out b --cases B --methods ours nelder-mead nelder-mead-plain

Finished runs are kept in runs.jsonl; start again to go on. Methods may have different numbers of starts (run
them one after the other); --summary-only makes table and figures of all runs that are there.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import multiprocessing
import os
import platform
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from ocptip.baselines import nelder_mead
from ocptip.errors import OcptipError
from ocptip.motion import ArmMotion, MotionProof, MotionTask, experiment_task, motion_cases, prove
from ocptip.motion.penalty import WEIGHT, Between, MotionPenalty, PenaltyValue
from ocptip.motion.search import Search

METHODS = ("ours", "nelder-mead", "nelder-mead-plain", "cma", "slsqp")
BASE = "effective"
CMA_SHARE = 10.0  # times the seconds of ours
CMA_SIGMA = 0.2
SIMPLEX_STEP = 0.25  # better than 0.05 in trials with cases A and B
SIMPLEX_TOLERANCE = 1e-6
DIFFERENCE = 1e-6
ENERGY_UNIT = 100.0  # J, of SLSQP's cost
HISTORY_STEP = 0.005  # relative improvement that is worth a point of the history
HISTORY_POINTS = 60
SLOWEST = 8.0  # factor of time up to which a motion is slowed down until it is verified
SLOWING = 1e-3  # resolution of that factor
COLORS = {
    "ours": "#0072b2",
    "nelder-mead": "#d55e00",
    "nelder-mead-plain": "#e69f00",
    "cma": "#009e73",
    "slsqp": "#cc79a7",
}


@dataclass(frozen=True)
class Settings:
    """What a run depends on besides case, start and method.

    Attributes:
        seed: of the random starts.
        max_seconds: CPU time of a search at most.
        weight: S of the penalty.
        between: how maxima in time are found.
    """

    seed: int = 0
    max_seconds: float = 120.0
    weight: float = WEIGHT
    between: Between = "sides"


class TimeIsUpError(Exception):
    """Ends a search whose library has no time limit."""


class Recorder:
    """Evaluates a penalty, keeps the best point, count and history of the best cost; ends when time is up."""

    def __init__(self, penalty: MotionPenalty, max_seconds: float) -> None:
        self.penalty, self.max_seconds = penalty, max_seconds
        self.count, self.best, self.best_p = 0, np.inf, None
        self.began = time.process_time()
        self.history: list[tuple[float, int, float]] = []

    @property
    def over(self) -> bool:
        return self.cpu >= self.max_seconds

    @property
    def cpu(self) -> float:
        """CPU seconds so far."""
        return time.process_time() - self.began

    def evaluate(self, p: np.ndarray) -> PenaltyValue:
        if self.count and self.over:
            raise TimeIsUpError
        value = self.penalty.evaluate(p)
        self.count += 1
        if value.cost < self.best:
            self.best, self.best_p = value.cost, np.clip(p, 0.0, 1.0)
            if not self.history or value.cost < (1 - HISTORY_STEP) * self.history[-1][2]:
                self.history.append((self.cpu, self.count, value.cost))
        return value

    def cost(self, p: np.ndarray) -> float:
        return self.evaluate(p).cost


# --- the methods: each returns a sentence on how it ended; the recorder has the result ----------------------


def search_nelder_mead(recorder: Recorder, p: np.ndarray, seed: int, adapted: bool = True) -> str:
    result = nelder_mead(
        recorder.cost,
        p,
        bounds=recorder.penalty.bounds,
        adapted=adapted,
        initial_step=SIMPLEX_STEP,
        tolerance=SIMPLEX_TOLERANCE,
        maxfev=10**9,
    )
    return result.message


def search_nelder_mead_plain(recorder: Recorder, p: np.ndarray, seed: int) -> str:
    return search_nelder_mead(recorder, p, seed, adapted=False)


def search_cma(recorder: Recorder, p: np.ndarray, seed: int) -> str:
    import cma  # an extra that only this method needs

    restarts, population = 0, None
    while not recorder.over:
        options = {"bounds": [0, 1], "seed": seed + 1 + restarts, "verbose": -9, "verb_log": 0}
        if population:
            options["popsize"] = population
        strategy = cma.CMAEvolutionStrategy(p, CMA_SIGMA, options)
        population = 2 * strategy.popsize
        while not strategy.stop():
            points = strategy.ask()
            strategy.tell(points, [recorder.cost(np.asarray(x)) for x in points])
        restarts += 1
    return f"time is up after {restarts} restarts"


def search_slsqp(recorder: Recorder, p: np.ndarray, seed: int) -> str:
    @lru_cache(maxsize=4)
    def at(key: bytes) -> PenaltyValue:
        return recorder.evaluate(np.clip(np.frombuffer(key), 0.0, 1.0))

    @lru_cache(maxsize=2)
    def slopes(key: bytes) -> np.ndarray:
        """Derivatives of (cost, limits), one column per parameter."""
        x, here = np.frombuffer(key), numbers(at(key))
        columns = []
        for k in range(len(x)):
            step = DIFFERENCE if x[k] + DIFFERENCE <= 1 else -DIFFERENCE
            moved = x.copy()
            moved[k] += step
            columns.append((numbers(recorder.evaluate(moved)) - here) / step)
        return np.column_stack(columns)

    def numbers(value: PenaltyValue) -> np.ndarray:
        return np.append(value.energy / ENERGY_UNIT, -value.limits)

    result = minimize(
        lambda x: numbers(at(x.tobytes()))[0],
        p,
        jac=lambda x: slopes(x.tobytes())[0],
        bounds=recorder.penalty.bounds,
        constraints={
            "type": "ineq",
            "fun": lambda x: numbers(at(x.tobytes()))[1:],
            "jac": lambda x: slopes(x.tobytes())[1:],
        },
        method="SLSQP",
        options={"maxiter": 10_000, "ftol": 1e-7},
    )
    return result.message


SEARCHES: dict[str, Callable[[Recorder, np.ndarray, int], str]] = {
    "nelder-mead": search_nelder_mead,
    "nelder-mead-plain": search_nelder_mead_plain,
    "cma": search_cma,
    "slsqp": search_slsqp,
}


# --- one run ------------------------------------------------------------------------------------------------


@lru_cache(maxsize=2)
def prepared(case: str, settings: Settings) -> tuple[MotionTask, Search, MotionPenalty]:
    """Task, planner and penalty of a case; compiled code is run once, so that no method pays for it."""
    task = experiment_task(case, BASE)
    penalty = MotionPenalty(task, weight=settings.weight, between=settings.between)
    p = penalty.random_start(0, settings.seed)
    prove(task.robot, penalty.motion(p), task.limits)
    penalty(np.full(penalty.size, 0.9))  # too fast: contacts slip and lift off
    return task, Search(task), penalty


def run_one(case: str, start: int, method: str, settings: Settings, seconds: float | None = None) -> dict:
    """One method from one start, as plain data.

    Args:
        case, start, method: see the module.
        settings: of the study.
        seconds: CPU time at most, if it is not that of the settings.
    """
    with threadpool_limits(1):
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
            motion, proof = attempt.motion, attempt.proof
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
            proof = prove(task.robot, motion, task.limits)
            record |= {"status": status, "evaluations": recorder.count, "cost": recorder.best}
            record["history"] = thinned([*recorder.history, (timed[1], recorder.count, recorder.best)])
        record |= {"wall_s": timed[0], "cpu_s": timed[1]}
        return record | (outcome(task, penalty, motion, proof) if motion is not None else NO_MOTION)


NO_MOTION = {
    "energy_J": None, "duration_s": None, "verified": False, "worst": None, "violations": [],
    "slowed": None, "inside_bounds": None, "motion": None,
}  # fmt: skip


def outcome(task: MotionTask, penalty: MotionPenalty, motion: ArmMotion, proof: MotionProof) -> dict:
    """What a result is worth: energy, proof, and energy of the motion slowed down until it is verified."""
    try:
        p = penalty.parameters(motion)
        inside = bool(np.all((p >= -1e-9) & (p <= 1 + 1e-9)))
    except OcptipError:
        inside = None
    return {
        "energy_J": proof.energy,
        "duration_s": proof.duration,
        "verified": proof.verified,
        "worst": {name: proof.worst[name].value for name in ("GN", "GT", "torque_ratio", "clearance_m")},
        "violations": list(proof.violations),
        "slowed": slowed(task, motion, proof),
        "inside_bounds": inside,
        "motion": motion.to_dict(),
    }


def slowed(task: MotionTask, motion: ArmMotion, proof: MotionProof) -> dict | None:
    """Least factor of time (to about `SLOWING`) that makes a motion verified; None if there is none."""
    if proof.verified:
        return {"factor": 1.0, "energy_J": proof.energy}

    def at(factor: float) -> MotionProof:
        return prove(task.robot, motion.time_scaled(factor), task.limits)

    low, high = 1.0, 1.0 + 4 * SLOWING
    while not (found := at(high)).verified:
        low, high = high, 1 + 2 * (high - 1)
        if high > SLOWEST:
            return None
    while high - low > SLOWING * high:
        middle = 0.5 * (low + high)
        if (proved := at(middle)).verified:
            high, found = middle, proved
        else:
            low = middle
    return {"factor": high, "energy_J": found.energy}


def thinned(history: list[tuple[float, int, float]]) -> list[list[float]]:
    """At most `HISTORY_POINTS` of the points, first and last included."""
    chosen = np.unique(np.linspace(0, len(history) - 1, HISTORY_POINTS).round().astype(int))
    return [[round(history[k][0], 4), history[k][1], float(f"{history[k][2]:.7g}")] for k in chosen]


# --- all runs -----------------------------------------------------------------------------------------------

Key = tuple[str, int, str]


class Runs:
    """Finished runs in a file, one line each behind a header with the settings.

    Raises:
        ValueError: the file was written with other settings.
    """

    def __init__(self, path: Path, settings: Settings) -> None:
        self.path, self.records = path, {}
        text = path.read_text() if path.exists() else ""
        lines = text[: text.rfind("\n") + 1].splitlines()  # a line without its end was being written
        if lines:
            old = json.loads(lines[0])["settings"]
            if old != asdict(settings):
                raise ValueError(f"{path}: has runs with other settings ({old}); choose another --out")
        else:
            lines = [json.dumps({"settings": asdict(settings), **environment()})]
        for line in lines[1:]:
            record = json.loads(line)
            self.records[record["case"], record["start"], record["method"]] = record
        write_whole(path, "\n".join(lines) + "\n")
        self.header = json.loads(lines[0])

    def add(self, record: dict) -> None:
        self.records[record["case"], record["start"], record["method"]] = record
        with self.path.open("a") as stream:
            stream.write(json.dumps(record) + "\n")

    def seconds_for(self, key: Key) -> float | None:
        """Time limit of CMA-ES: ten times what ours took for the same start."""
        case, start, method = key
        ours = self.records.get((case, start, "ours"))
        return CMA_SHARE * ours["cpu_s"] if method == "cma" and ours else None


def run_all(runs: Runs, keys: Sequence[Key], settings: Settings, jobs: int) -> None:
    """Run what is missing; ours first, because CMA-ES gets its time from it."""
    missing = [key for key in keys if key not in runs.records]
    done = len(keys) - len(missing)
    show = progress(len(keys))
    show(done)
    phases = [[k for k in missing if k[2] == "ours"], [k for k in missing if k[2] != "ours"]]
    for phase in phases:
        for record in _executed(phase, runs, settings, jobs):
            runs.add(record)
            done += 1
            show(done)


def _executed(keys: Sequence[Key], runs: Runs, settings: Settings, jobs: int) -> Iterator[dict]:
    if jobs == 1 or len(keys) < 2:
        for key in keys:
            yield run_one(*key, settings, runs.seconds_for(key))
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(jobs, len(keys)), mp_context=context, initializer=_ignore_interrupts)
    try:
        futures = [pool.submit(run_one, *key, settings, runs.seconds_for(key)) for key in keys]
        for future in as_completed(futures):
            yield future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def progress(total: int) -> Callable[[int], None]:
    """A bar on a terminal, nothing elsewhere."""

    def show(done: int) -> None:
        if sys.stderr.isatty():
            filled = "#" * (30 * done // max(total, 1))
            end = "\n" if done == total else ""
            print(f"\r\033[K[{filled:<30}] {done}/{total} runs", end=end, file=sys.stderr, flush=True)

    return show


def environment() -> dict:
    """Versions and machine."""
    names = ("numpy", "scipy", "casadi", "numba", "ocptip")
    return {
        "versions": {"python": platform.python_version(), **{name: version(name) for name in names}},
        "machine": {"architecture": platform.machine(), "cores": os.cpu_count()},
    }


def write_whole(path: Path, text: str) -> None:
    """Write a file so that an interruption leaves either the old or the new one."""
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text)
    temporary.replace(path)


# --- summary ------------------------------------------------------------------------------------------------


def time_to(record: dict, cost: float) -> float:
    """Seconds until a search had this cost, infinite if it never had."""
    return next((t for t, _, reached in record["history"] if reached <= cost), math.inf)


def summary(records: dict[Key, dict]) -> list[dict]:
    """One row per case and method, and one for all cases together."""
    cases = sorted({key[0] for key in records})
    groups = [(case, [case]) for case in cases] + ([("all", cases)] if len(cases) > 1 else [])
    rows = []
    for name, members in groups:
        for method in METHODS:
            own = [r for key, r in sorted(records.items()) if key[0] in members and key[2] == method]
            if own:
                row = {"case": name, "method": method, **statistics(own, records)}
                each = [x for case in members if (x := restarted(records, case, method))]
                if each:
                    row["restarted"] = float(np.median([x[0] for x in each]))
                    row["restarts_succeed"] = all(x[1] for x in each)
                rows.append(row)
    return rows


def restarted(records: dict[Key, dict], case: str, method: str) -> tuple[float, int] | None:
    """Seconds that a method needs per success / median seconds of ours, and the number of successes.

    A success is a verified energy (slowed down if need be) within 1 % of the median of ours: what one start
    of ours gives on average. Without any success the time of all runs counts, a lower bound.
    """
    own = [r for key, r in records.items() if key[0] == case and key[2] == method]
    ours = [r for key, r in records.items() if key[0] == case and key[2] == "ours" and r["verified"]]
    if method == "ours" or not own or not ours:
        return None
    goal = 1.01 * np.median([r["energy_J"] for r in ours])
    successes = sum(bool(r["slowed"]) and r["slowed"]["energy_J"] <= goal for r in own)
    seconds = sum(r["cpu_s"] for r in own)
    return seconds / max(successes, 1) / float(np.median([r["cpu_s"] for r in ours])), successes


def statistics(own: list[dict], records: dict[Key, dict]) -> dict:
    """Medians and shares over runs of one method, against ours from the same starts."""
    energies = [math.inf if r["energy_J"] is None else r["energy_J"] for r in own]
    safe = [math.inf if r["slowed"] is None else r["slowed"]["energy_J"] for r in own]
    row = {
        "runs": len(own),
        "energy_J": float(np.median(energies)),
        "verified": float(np.mean([r["verified"] for r in own])),
        "slowed_J": float(np.median(safe)),
        "least_J": min(safe),
        "seconds": float(np.median([r["cpu_s"] for r in own])),
        "evaluations": float(np.median([r["evaluations"] for r in own])),
        "ours_lower": None,
        "ours_lower_slowed": None,
        "times_faster": None,
        "times_faster_total": None,
        "reach_ours": None,
        "times_longer": None,
        "restarted": None,
        "restarts_succeed": True,
    }
    pairs = [(r, records.get((r["case"], r["start"], "ours"))) for r in own if r["method"] != "ours"]
    pairs = [(r, best) for r, best in pairs if best]
    if pairs:
        lower, lower_slowed, faster, faster_total, longer = [], [], [], [], []
        for other, best in pairs:
            mine = best["energy_J"] if best["verified"] else math.inf
            lower.append(mine <= other["energy_J"])
            lower_slowed.append(mine <= (other["slowed"]["energy_J"] if other["slowed"] else math.inf))
            # 0: ours never got to the other's energy
            final = time_to(other, 1.01 * other["history"][-1][2])
            faster.append(final / best["cpu_s"] if lower[-1] else 0.0)
            faster_total.append(other["cpu_s"] / best["cpu_s"] if lower[-1] else 0.0)
            longer.append(time_to(other, 1.01 * mine) / best["cpu_s"])
        row["ours_lower"], row["ours_lower_slowed"] = float(np.mean(lower)), float(np.mean(lower_slowed))
        row["times_faster"], row["times_faster_total"] = map(float, map(np.median, (faster, faster_total)))
        row["reach_ours"] = float(np.mean(np.isfinite(longer)))
        row["times_longer"] = float(np.median(longer))
    return row


COLUMNS: dict[str, Callable[[dict], str]] = {
    "case": lambda r: r["case"],
    "method": lambda r: r["method"],
    "runs": lambda r: str(r["runs"]),
    "energy [J]": lambda r: number(r["energy_J"], 1),
    "verified": lambda r: percent(r["verified"]),
    "slowed [J]": lambda r: number(r["slowed_J"], 1),
    "least [J]": lambda r: number(r["least_J"], 1),
    "seconds": lambda r: number(r["seconds"], 1),
    "evaluations": lambda r: number(r["evaluations"], 0),
    "ours lower": lambda r: percent(r["ours_lower"]),
    "ours lower than slowed": lambda r: percent(r["ours_lower_slowed"]),
    "times faster": lambda r: number(r["times_faster"], 1),
    "times faster, to its end": lambda r: number(r["times_faster_total"], 1),
    "comes to ours": lambda r: percent(r["reach_ours"]),
    "times longer": lambda r: number(r["times_longer"], 1, "never"),
    "restarted": lambda r: ("" if r["restarts_succeed"] else "> ") + number(r["restarted"], 0),
}

NOTES = """\
Medians over the runs. *energy*: of the method's result, *verified*: share of results that keep all limits on
the dense grid, *slowed*: energy after slowing the others down until they do, *least*: of these the least.
*seconds*: CPU. *evaluations*: of cost and limits; for ours Ipopt's iterations. *ours lower*: share of starts
from which our verified energy is not above the other's, verified or not. *times faster*: seconds until the
other method was within 1 % of its final cost (or, *to its end*, until it stopped) / seconds of our whole run;
0 where ours ended above the other's energy. *comes to ours*: share of runs that ever came within 1 % of our
energy from the same start; *times longer*: seconds until then / seconds of our whole run, "never" if at least
half of the runs did not. *restarted*: seconds of all its runs / number of those that end, verified, within
1 % of our median energy / our median seconds: how many times longer it takes from start to start until it is
as good as one of ours; ">" if none was (in the last rows: in some case), then all runs' seconds count."""


def number(value: float | None, digits: int, infinite: str = "none") -> str:
    return "-" if value is None else f"{value:.{digits}f}" if math.isfinite(value) else infinite


def percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.0f} %"


def markdown(rows: list[dict]) -> str:
    """The summary as a Markdown table."""
    lines = [list(COLUMNS), ["---"] * 2 + ["---:"] * (len(COLUMNS) - 2)]
    lines += [[column(row) for column in COLUMNS.values()] for row in rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) + "\n" + NOTES + "\n"


# --- figures ------------------------------------------------------------------------------------------------


def draw_energies(records: dict[Key, dict], path: Path) -> None:
    """Energy of the starts, and of what each method made of them, each sorted; one panel per case."""
    figure, panels = _panels(records, "start, sorted", "energy [J]")
    for case, axis in panels.items():
        starts = sorted(r["start_J"] for r in _one_per_start(records, case))
        axis.plot(range(1, len(starts) + 1), starts, color="#888888", lw=1.4, marker="o", ms=2.5)
        for method in _methods(records):
            own = [r for key, r in records.items() if key[0] == case and key[2] == method and r["slowed"]]
            energies = sorted(r["slowed"]["energy_J"] for r in own)
            axis.plot(range(1, len(own) + 1), energies, color=COLORS[method], lw=1.6, marker="o", ms=2.5)
        axis.set_yscale("log")
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
        _plain_log(axis.yaxis, axis.get_ylim())
    handles = [Line2D([], [], color="#888888", lw=1.6, label="start")]
    _legend(figure, handles, records, ", slowed until verified")
    figure.savefig(path, dpi=110)


def draw_convergence(records: dict[Key, dict], path: Path) -> None:
    """Median over the starts of the best penalised cost after given seconds; ours counts when it is done."""
    figure, panels = _panels(records, "CPU seconds", "median best cost [J]")
    for case, axis in panels.items():
        last = max(r["cpu_s"] for key, r in records.items() if key[0] == case)
        times = np.geomspace(0.05, max(1.2 * last, 0.1), 300)
        for method in _methods(records):
            own = [r for key, r in records.items() if key[0] == case and key[2] == method]
            if own:
                curve = np.median([best_after(r, times) for r in own], axis=0)
                axis.step(times, curve, where="post", color=COLORS[method], lw=1.8)
        axis.set_xscale("log")
        axis.set_yscale("log")
        _plain_log(axis.yaxis, axis.get_ylim())
    _legend(figure, [], records)
    figure.savefig(path, dpi=110)


def best_after(record: dict, times: np.ndarray) -> np.ndarray:
    """Best cost a run had at these CPU seconds; before its first value the start's."""
    history = record["history"]
    if record["method"] == "ours" and record["energy_J"] is not None and record["verified"]:
        history = [*history, [record["cpu_s"], 0, record["energy_J"]]]
    moments, costs = np.array([h[0] for h in history]), np.array([h[2] for h in history])
    index = np.searchsorted(moments, times, side="right") - 1
    return np.where(index < 0, record["start_cost"], costs[np.maximum(index, 0)])


def draw_motions(records: dict[Key, dict], path: Path) -> None:
    """Angles and speeds of the best verified motion of each case."""
    best = {}
    for case in sorted({key[0] for key in records}):
        own = [r for key, r in records.items() if key[0] == case and r["verified"]]
        if own:
            best[case] = min(own, key=lambda r: r["energy_J"])
    if not best:
        return
    columns = min(4, len(best))
    bands = -(-len(best) // columns)
    figure = Figure(figsize=(1.2 + 3.7 * columns, 0.6 + 4.6 * bands), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2 * bands, columns, squeeze=False)
    for k, (case, record) in enumerate(best.items()):
        band, column = divmod(k, columns)
        motion = ArmMotion.from_dict(record["motion"])
        times = np.union1d(np.linspace(0, motion.end, 400), motion.event_times)
        q, v, _ = motion.states(times)
        upper, lower = axes[2 * band, column], axes[2 * band + 1, column]
        for j in range(motion.n):
            look = {"color": f"C{j}", "lw": 1.8 if j < 3 else 1.0, "ls": "-" if j < 3 else "--"}
            upper.plot(times, np.rad2deg(q[:, j]), **look)
            lower.plot(times, np.rad2deg(v[:, j]), **look)
        upper.set_title(f"{case}: {record['energy_J']:.1f} J, {record['duration_s']:.2f} s", fontsize=10)
        lower.set_xlabel("time [s]")
        if column == 0:
            upper.set_ylabel("angle [deg]")
            lower.set_ylabel("speed [deg/s]")
    for axis in axes[2 * (bands - 1) :, len(best) - (bands - 1) * columns :].ravel():
        axis.set_visible(False)
    for axis in axes.ravel():
        _grid(axis)
    joints = [
        Line2D([], [], color=f"C{j}", lw=1.8, ls="-" if j < 3 else "--", label=f"joint {j + 1}")
        for j in range(6)
    ]
    figure.legend(handles=joints, loc="outside upper center", ncols=6 if columns > 1 else 3, fontsize=9)
    figure.savefig(path, dpi=110)


def _panels(records: dict[Key, dict], xlabel: str, ylabel: str) -> tuple[Figure, dict]:
    cases = sorted({key[0] for key in records})
    columns = min(4, len(cases))
    rows = -(-len(cases) // columns)
    figure = Figure(figsize=(max(1.2 + 3.6 * columns, 7.0), 0.9 + 3.0 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[len(cases) :]:
        axis.set_visible(False)
    for k, (case, axis) in enumerate(zip(cases, axes, strict=False)):
        axis.set_title(f"case {case}", fontsize=10)
        axis.set_xlabel(xlabel)
        if k % columns == 0:
            axis.set_ylabel(ylabel)
        _grid(axis)
    return figure, dict(zip(cases, axes, strict=False))


def _grid(axis) -> None:
    axis.grid(color="#e4e4e4", lw=0.6, which="both")
    axis.set_axisbelow(True)
    axis.tick_params(labelsize=8)


def _plain_log(axis, limits: tuple[float, float]) -> None:
    """Ticks of a logarithmic axis as ordinary numbers."""
    steps = [m * 10.0**e for e in range(0, 6) for m in (1, 1.5, 2, 3, 5, 7)]
    axis.set_ticks([s for s in steps if limits[0] <= s <= limits[1]])
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_minor_formatter(lambda *_: "")


def _legend(figure: Figure, handles: list[Line2D], records: dict[Key, dict], note: str = "") -> None:
    handles = handles + [
        Line2D([], [], color=COLORS[m], lw=1.8, label=m + (note if m != "ours" else ""))
        for m in _methods(records)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, fontsize=8.5)


def _methods(records: dict[Key, dict]) -> list[str]:
    return [method for method in METHODS if any(key[2] == method for key in records)]


def _one_per_start(records: dict[Key, dict], case: str) -> list[dict]:
    return list({key[1]: r for key, r in records.items() if key[0] == case}.values())


# --- command line -------------------------------------------------------------------------------------------


def run(out: Path, cases: Sequence[str], starts: int, methods: Sequence[str], settings: Settings, jobs: int):
    """Run what is not there yet, write table and figures of what was asked for, return the table.

    With starts = 0 nothing is run, and what is there of the cases and methods is summarised.
    """
    out.mkdir(parents=True, exist_ok=True)
    runs = Runs(out / "runs.jsonl", settings)
    # case by case, so that processes seldom change theirs
    keys = [(case, start, method) for case in cases for method in methods for start in range(starts)]
    run_all(runs, keys, settings, jobs)
    if not starts:
        keys = sorted(key for key in runs.records if key[0] in cases and key[2] in methods)
    records = {key: runs.records[key] for key in keys}
    rows = summary(records)
    text = markdown(rows)
    plain = [
        {k: None if v == math.inf else v for k, v in row.items()} for row in rows
    ]  # JSON has no infinity
    write_whole(out / "compare_nelder_mead.json", json.dumps({**runs.header, "rows": plain}, indent=1))
    write_whole(out / "compare_nelder_mead.md", text)
    draw_energies(records, out / "compare_energies.png")
    draw_convergence(records, out / "compare_convergence.png")
    draw_motions(records, out / "compare_motions.png")
    return text


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for runs, table and figures")
    parser.add_argument("--cases", nargs="+", choices=list(motion_cases()), default=list(motion_cases()))
    parser.add_argument("--starts", type=int, default=50, help="random starts per case")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--summary-only", action="store_true", help="of all runs that are there")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--seed", type=int, default=Settings.seed, help="of the random starts")
    parser.add_argument("--max-seconds", type=float, default=Settings.max_seconds, help="CPU, per search")
    parser.add_argument("--weight", type=float, default=Settings.weight, help="S of the penalty (5.38)")
    parser.add_argument("--between", choices=("spline", "sides"), default=Settings.between)
    given = parser.parse_args(argv)
    if given.starts < 1 or given.jobs < 1 or not given.max_seconds > 0 or not given.weight > 0:
        parser.error("--starts and --jobs must be at least 1, --max-seconds and --weight above 0")
    settings = Settings(given.seed, given.max_seconds, given.weight, given.between)
    try:
        starts = 0 if given.summary_only else given.starts
        print(run(given.out, given.cases, starts, given.methods, settings, given.jobs), end="")
    except (ValueError, OcptipError) as error:
        print(f"compare_nelder_mead: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nInterrupted; finished runs are kept, start again to go on.", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
