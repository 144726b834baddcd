"""Plans of the eight cases from many random starts: energies against the printed motions, robustness, times.

Three sets of limits:

- printed: printed base data, GN <= 0.9 and GT <= 0.9;
- effective: effective base data, the same limits;
- reference: printed base data, GN and GT nowhere worse than in the printed motion of the case itself.

Every start is a random motion, searched and proved as by `ocptip plan`; nothing of the printed motions but
these limits enters. Every finished start is a line of OUT/plan_cases.jsonl at once: start again to go on.
OUT/plans holds the best verified motion of each case and set, proved anew. Energies depend on the seed only;
seconds are CPU times of single starts, each in one thread. Building and evaluation of the programs are timed
in fresh processes after all starts.

    python studies/plan_cases.py --out results [--starts 50] [--cases A B] [--sets printed] [--jobs 2]
    python studies/plan_cases.py --out results --summary-only
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import multiprocessing
import os
import pickle
import platform
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from contact_robustness import table, write_whole
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import ocptip
from ocptip.errors import InputError, OcptipError
from ocptip.motion.cases import motion_cases
from ocptip.motion.output import plain, versions, write_plan
from ocptip.motion.passive import ArmMotion
from ocptip.motion.plan import MotionPlan, _cores, _leave_interrupts_to_parent, _pool, _run
from ocptip.motion.program import MotionProgram
from ocptip.motion.proof import MotionLimits, MotionProof, prove
from ocptip.motion.refine import Refiner
from ocptip.motion.search import COARSE_ROWS, WIDTHS, Attempt, Search, StartResult
from ocptip.motion.starts import random_start
from ocptip.motion.task import MotionTask, experiment_task

NEAR = 0.02  # a start is near the best if its energy is at most this share above it
STAGES = ("start", "coarse", "fine", "exact", "proof")
PARTS = ("values", "gradient", "Jacobian", "Hessian")
CALLS, BUILDINGS = 50, 3
LARGEST_RATIO, NEAR_SHARE = 0.98, 0.90  # targets
START_SECONDS, BUILDING_SECONDS, EVALUATION_SECONDS = 2.0, 5.0, 0.012  # targets
COLORS = ("#0072b2", "#d55e00", "#009e73")  # of the sets

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
    worst = reference_proof(set_name, case).worst
    return replace(task, limits=MotionLimits(GN=worst["GN"].value, GT=worst["GT"].value))


@cache
def reference_proof(set_name: str, case: str) -> MotionProof:
    """The printed motion of a case on the base of a set."""
    task = experiment_task(case, SETS[set_name].base)
    return prove(task.robot, task.reference)


@cache
def state() -> str:
    """Short digest of the planner's source code and of all versions: which planner made a result."""
    digest = hashlib.sha256(json.dumps(versions(), sort_keys=True).encode())
    root = Path(ocptip.__file__).parent
    for package in ("contact", "motion", "reserves", "robots"):
        for path in sorted((root / package).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


# --- starts: run, kept as lines, read again -----------------------------------------------------------------


class Journal:
    """The finished starts: a file of JSON lines that only grows.

    Args:
        path: of the file; made by the first line.
        seed: of the starts of interest.
    """

    def __init__(self, path: Path, seed: int) -> None:
        self.path, self.seed = path, seed
        self.lines: dict[Key, dict] = {}
        text = path.read_bytes() if path.exists() else b""
        self._whole = text.rfind(b"\n") + 1  # what follows was being written when the process was killed
        for number, line in enumerate(text[: self._whole].splitlines(), 1):
            try:
                self._take(json.loads(line))
            except (ValueError, TypeError, KeyError):
                raise InputError(
                    f"{path}: line {number} is broken; delete it to run that start again"
                ) from None

    def _take(self, line: dict) -> None:
        key = line["set"], line["case"], line["number"]
        if line["seed"] == self.seed and key[0] in SETS and line["limits"] == limits_of(*key[:2]):
            self.lines[key] = line

    def add(self, line: dict) -> None:
        """Write a line to the disk."""
        line = plain(line)
        with self.path.open("ab") as stream:
            stream.truncate(self._whole)
            stream.write(json.dumps(line, allow_nan=False).encode() + b"\n")
        self._whole = self.path.stat().st_size
        self._take(line)

    def done(self, key: Key) -> bool:
        """Whether that start needs not be run; one that ended in an unforeseen error is tried again."""
        return key in self.lines and not self.lines[key]["error"]

    def of(self, set_name: str, case: str, starts: int) -> list[dict]:
        """The lines of a pair, by number, of the first `starts` starts."""
        numbers = range(starts)
        return [self.lines[key] for n in numbers if (key := (set_name, case, n)) in self.lines]


def limits_of(set_name: str, case: str) -> dict[str, float]:
    """The limits of a pair as they are written: rounded, since last digits differ between machines."""
    return {name: round(value, 9) for name, value in asdict(task_of(set_name, case).limits).items()}


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


def _attempts(todo: list[Key], options: Options) -> Iterator[tuple[Key, Attempt | None, str]]:
    """Start, outcome and error text, in the order in which they end."""
    if not todo:
        return
    payloads = {pair: pickle.dumps(task_of(*pair)) for pair in {key[:2] for key in todo}}
    if options.jobs == 1:
        for key in todo:
            yield key, *_outcome(_run, payloads[key[:2]], key[2], options.seed)
        return
    with _pool(None, options.jobs, len(todo)) as pool:
        futures = {pool.submit(_run, payloads[key[:2]], key[2], options.seed): key for key in todo}
        for future in as_completed(futures):
            yield futures.pop(future), *_outcome(future.result)


def _outcome(call: Callable[..., Attempt], *arguments: object) -> tuple[Attempt | None, str]:
    try:
        return call(*arguments), ""
    except (ArithmeticError, LookupError, RuntimeError, TypeError, ValueError, OcptipError) as error:
        return None, f"{type(error).__name__}: {error}"  # counted as a failed start, not the end of the study


# --- times of building and of one evaluation ----------------------------------------------------------------


def time_case(task: MotionTask, motion: ArmMotion) -> dict:
    """Seconds for building the programs of a task and for evaluating the exact one at its solution.

    Building: `Search`, a random start, its coarse program, cost, rows and all derivatives for
    the first time. Evaluation: cost, rows and all derivatives of the exact program that has `motion` as its
    solution, cache cleared.
    """
    with threadpool_limits(1):
        building = [_building_seconds(task) for _ in range(BUILDINGS)]
        search = Search(task)
        exact = Refiner(search.formulation, search.inner).first(
            search.formulation.variables(motion), merge=WIDTHS[-1]
        )
        program, solution = exact.program, exact.solution
        calls = np.array([evaluate(program, solution.x, solution.multipliers) for _ in range(CALLS)])
    return {
        "nodes": program.n_nodes,
        "variables": len(solution.x),
        "rows": len(solution.multipliers),
        "building_first_s": building[0],
        "building_s": float(np.median(building)),
        "evaluation_s": float(np.median(calls.sum(axis=1))),
        "parts_s": dict(zip(PARTS, np.median(calls, axis=0).tolist(), strict=True)),
    }


def _building_seconds(task: MotionTask) -> float:
    task = pickle.loads(pickle.dumps(task))  # without functions that its robot keeps
    rng = np.random.default_rng(0)
    began = time.perf_counter()
    formulation = Search(task).formulation
    start = random_start(task.robot, task.start, task.goal, task.optimised, task.commands, task.limits, rng)
    x = formulation.variables(start)
    end = x[formulation.layout.end] = max(x[formulation.layout.end], formulation.earliest)
    program = formulation.coarse_program(task.limits, end)
    program.rows = program.near_rows(x, COARSE_ROWS)
    evaluate(program, x, np.ones(len(program.bounds()[0])))
    return time.perf_counter() - began


def evaluate(program: MotionProgram, x: np.ndarray, multipliers: np.ndarray) -> list[float]:
    """Seconds for objective and rows, gradient, Jacobian, Hessian, one after the other."""
    program._last = None  # what the parts share is computed again, and counted with the first
    calls = (
        lambda: program.values(x),
        lambda: program.gradient(x),
        lambda: program.jacobian(x),
        lambda: program.hessian(x, 1.0, multipliers),
    )
    times = [time.perf_counter()]
    for call in calls:
        call()
        times.append(time.perf_counter())
    return np.diff(times).tolist()


def measure_times(path: Path, journal: Journal, options: Options, say: Callable[[str], None]) -> None:
    """Time each case with a plan in a process of its own, unless done with this state of the planner."""
    timed = read_times(path)
    for case in options.cases:
        plans = (best_plan(journal, name, case, options) for name in options.sets)
        plan = next((plan for plan in plans if plan), None)
        if plan is None or timed.get(case, {}).get("state") == state():
            continue
        say(f"times of case {case}")
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, mp_context=spawn, initializer=_leave_interrupts_to_parent) as pool:
            timed[case] = {"state": state(), **pool.submit(time_case, plan.task, plan.motion).result()}
        write_whole(path, json.dumps(timed, indent=1))


def read_times(path: Path) -> dict[str, dict]:
    """By case; empty if nothing was timed."""
    return json.loads(path.read_text()) if path.exists() else {}


# --- summary ------------------------------------------------------------------------------------------------


def best_plan(journal: Journal, set_name: str, case: str, options: Options) -> MotionPlan | None:
    """The motion of least energy among the verified ones of a pair, proved anew; None if there is none."""
    lines = journal.of(set_name, case, options.starts)
    task = task_of(set_name, case)
    for line in sorted((x for x in lines if x["verified"]), key=lambda x: (x["energy_J"], x["number"])):
        motion = ArmMotion.from_dict(line["motion"])
        proof = prove(task.robot, motion, task.limits)
        if proof.verified:
            return MotionPlan(
                task=task,
                motion=motion,
                proof=proof,
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


def row_of(set_name: str, case: str, lines: list[dict], plan: MotionPlan | None) -> dict:
    """Everything about one pair."""
    reference, limits = reference_proof(set_name, case), task_of(set_name, case).limits
    energies = np.array([x["energy_J"] if x["verified"] else np.nan for x in lines], dtype=float)
    ended = [x for x in lines if not x["error"]]
    seconds = [x["cpu_seconds"] for x in ended]

    def median(values: Sequence[float]) -> float | None:
        return float(np.median(values)) if len(values) else None

    def worst(proof: MotionProof) -> dict[str, float]:
        return {name: proof.worst[name].value for name in ("GN", "GT", "torque_ratio", "clearance_m")}

    return plain({
        "set": set_name,
        "case": case,
        "limits": asdict(limits),
        "reference": {"energy_J": reference.energy, "duration_s": reference.duration, **worst(reference)},
        "plan": plan and {"energy_J": plan.energy, "duration_s": plan.duration, **worst(plan.proof)},
        "ratio": plan and plan.energy / reference.energy,
        "best": plan and plan.best,
        "starts": len(lines),
        "verified": np.count_nonzero(np.isfinite(energies)),
        "near": np.count_nonzero(energies <= (1 + NEAR) * plan.energy) if plan else 0,
        "median_s": median(seconds),
        "ninety_percent_s": float(np.quantile(seconds, 0.9)) if seconds else None,
        "median_iterations": median([x["iterations"] for x in ended]),
        "median_solves": median([x["solves"] for x in ended]),
        "stages_s": {stage: median([x["stages"].get(stage, 0.0) for x in ended]) for stage in STAGES},
        "energies_J": energies,
        "cpu_seconds": [x["cpu_seconds"] for x in lines],
        "failures": {x["number"]: x["status"] for x in lines if not x["verified"]},
        "states": sorted({x["state"] for x in lines}),
    })  # fmt: skip


def summary(out: Path, journal: Journal, options: Options, say: Callable[[str], None]) -> dict:
    """Write the best plans and return everything found."""
    rows = []
    for set_name, case in options.pairs:
        lines = journal.of(set_name, case, options.starts)
        if not lines:
            continue
        say(f"summary of {case}, {set_name}")
        plan = best_plan(journal, set_name, case, options)
        if plan:
            (out / "plans").mkdir(exist_ok=True)
            write_plan(out / "plans" / f"{case}-{set_name}", plan, extra={"limit_set": set_name})
        rows.append(row_of(set_name, case, lines, plan))
    times = {case: x for case, x in read_times(times_path(out)).items() if case in options.cases}
    return {
        "versions": versions(),
        "machine": {"architecture": platform.machine(), "cores": os.cpu_count()},
        "options": plain(asdict(options)),
        "targets": {
            "average_ratio": {name: SETS[name].target for name in options.sets},
            "largest_ratio": LARGEST_RATIO,
            "near_share": NEAR_SHARE,
            "start_s": START_SECONDS,
            "building_s": BUILDING_SECONDS,
            "evaluation_s": EVALUATION_SECONDS,
        },
        "rows": rows,
        "times": times,
    }


def times_path(out: Path) -> Path:
    """Where the times of building and evaluation are kept."""
    return out / "plan_cases_times.json"


# --- tables -------------------------------------------------------------------------------------------------


def markdown(data: dict) -> str:
    """All tables."""
    options, rows = data["options"], data["rows"]
    groups = {name: [r for r in rows if r["set"] == name] for name in options["sets"]}
    groups = {name: group for name, group in groups.items() if group}
    lines = [
        f"Seed {options['seed']}, {options['starts']} random starts per case and set.",
        "",
        *targets_table(groups, data["times"]),
    ]
    for name, group in groups.items():
        lines += ["", f"## {SETS[name].title}", "", *energy_table(group), "", *starts_table(group)]
    lines += ["", "## Where the time goes", "", *stages_table(groups)]
    if data["times"]:
        lines += ["", *times_table(data["times"])]
    lines += ["", NOTES, "", *remarks(data)]
    return "\n".join(lines).rstrip() + "\n"


NOTES = f"""\
- *reference*: the printed motion of the case in the same model; *ratio*: energy of our best verified motion
  to that of the reference; *torque*: largest share of a joint's torque limit.
- *verified*: starts that end with a motion that keeps all limits; *near*: those of them at most
  {100 * NEAR:.0f} % above the best of their case and set; shares of all starts.
- *s per start*: wall time of single starts in one thread, building included where a process meets a case for
  the first time. The shares of stages are of the sum of the medians above them.
- *building*: `Search(task)`, the coarse program of a random start and its first evaluation with all
  derivatives: in a fresh process, and the median of {BUILDINGS} in that process, imports left out.
- *evaluation*: objective, rows, gradient, Jacobian, Hessian of the exact program at its solution, median of
  {CALLS} calls; what the parts share is counted with the values."""


def remarks(data: dict) -> list[str]:
    """What keeps a summary from being complete or uniform, and the versions."""
    options, rows = data["options"], data["rows"]
    found = []
    asked = options["starts"] * len(options["cases"]) * len(options["sets"])
    if (have := sum(r["starts"] for r in rows)) < asked:
        found.append(f"- Not complete: {have} of {asked} starts have ended.")
    if failed := sum(r["starts"] - r["verified"] for r in rows):
        found.append(f"- Starts without a verified motion: {failed}; why, by number, in plan_cases.json.")
    if len(states := {one for r in rows for one in r["states"]}) > 1:
        found.append(f"- The starts come from {len(states)} states of the planner's source code or packages.")
    named = ", ".join(f"{name} {number}" for name, number in data["versions"].items())
    return [*found, f"- Versions: {named}."]


def number(value: float | None, digits: int = 3) -> str:
    """Fixed digits, or a dash."""
    return "-" if value is None else f"{value:.{digits}f}"


def percent(share: float | None) -> str:
    """Whole per cent, or a dash."""
    return "-" if share is None else f"{100 * share:.0f} %"


def average(values: Sequence[float | None]) -> float | None:
    """Mean of those there are."""
    values = [x for x in values if x is not None]
    return sum(values) / len(values) if values else None


def targets_table(groups: dict[str, list[dict]], times: dict[str, dict]) -> list[str]:
    """What is to be reached beside what is."""

    def verdict(value: float | None, met: Callable[[float], bool], text: Callable[[float], str]) -> str:
        return "-" if value is None else f"{text(value)} ({'met' if met(value) else 'missed'})"

    def most(values: Sequence[float | None]) -> float | None:
        return max((x for x in values if x is not None), default=None)

    rows = []
    targets = " / ".join(number(SETS[name].target, 2) for name in groups)
    measures = [
        (
            f"average ratio of energies, {most([len(g) for g in groups.values()])} cases",
            f"<= {targets}",
            lambda name, g: verdict(
                average([r["ratio"] for r in g]), lambda x: x <= SETS[name].target, number
            ),
        ),
        (
            "largest ratio of a case",
            f"< {LARGEST_RATIO}",
            lambda _, g: verdict(most([r["ratio"] for r in g]), lambda x: x < LARGEST_RATIO, number),
        ),
        (
            "cases with a plan",
            "all",
            lambda _, g: f"{sum(r['ratio'] is not None for r in g)} of {len(g)}",
        ),
        (
            f"starts within {100 * NEAR:.0f} % of the best, least of a case",
            f">= {percent(NEAR_SHARE)}",
            lambda _, g: verdict(min(r["near"] / r["starts"] for r in g), lambda x: x >= NEAR_SHARE, percent),
        ),
        (
            "median CPU s per start, largest of a case",
            f"<= {START_SECONDS:.0f}",
            lambda _, g: verdict(
                most([r["median_s"] for r in g]), lambda x: x <= START_SECONDS, lambda x: number(x, 2)
            ),
        ),
    ]
    for measure, target, cell in measures:
        rows.append([measure, target, *(cell(name, group) for name, group in groups.items())])
    for measure, target, limit, key, scale, digits in (
        (
            "building in a fresh process [s], largest of a case",
            "<= 5",
            BUILDING_SECONDS,
            "building_first_s",
            1,
            2,
        ),
        ("evaluation [ms], largest of a case", "<= 12", EVALUATION_SECONDS, "evaluation_s", 1e3, 1),
    ):
        value = most([x[key] for x in times.values()])
        text = verdict(value, lambda x: x <= limit, lambda x: number(scale * x, digits))  # noqa: B023
        rows.append([measure, target, text, *[""] * (len(groups) - 1)])
    return table(["measure", "target", *groups], rows)


def energy_table(group: list[dict]) -> list[str]:
    """Energies, durations and reserves of one set."""

    def both(r: dict, key: str, digits: int, scale: float = 1.0) -> str:
        return " / ".join(number(one and scale * one[key], digits) for one in (r["reference"], r["plan"]))

    head = [
        "case",
        "reference [J]",
        "ours [J]",
        "ratio",
        "duration [s]",
        "GN",
        "GT",
        "torque",
        "clearance [mm]",
    ]
    head[4:] = [f"{name}, reference / ours" for name in head[4:]]
    rows = [
        [
            r["case"],
            number(r["reference"]["energy_J"], 1),
            number(r["plan"] and r["plan"]["energy_J"], 1),
            number(r["ratio"]),
            both(r, "duration_s", 3),
            both(r, "GN", 3),
            both(r, "GT", 3),
            both(r, "torque_ratio", 2),
            both(r, "clearance_m", 1, 1e3),
        ]
        for r in group
    ]
    ratios = [r["ratio"] for r in group]
    there = [r for r in group if r["plan"]]
    energies = [average([r[who]["energy_J"] for r in there]) for who in ("reference", "plan")]
    rows.append(
        [f"average of {len(there)}", *(number(x, 1) for x in energies), number(average(ratios)), *[""] * 5]
    )
    return table(head, rows)


def starts_table(group: list[dict]) -> list[str]:
    """How the starts of one set ended and what they took."""
    head = [
        "case",
        "starts",
        "verified",
        "near",
        "median CPU s per start",
        "90 % s",
        "median iterations",
        "solves",
    ]
    rows = [
        [
            r["case"],
            str(r["starts"]),
            percent(r["verified"] / r["starts"]),
            percent(r["near"] / r["starts"]),
            number(r["median_s"], 2),
            number(r["ninety_percent_s"], 2),
            number(r["median_iterations"], 0),
            number(r["median_solves"], 0),
        ]
        for r in group
    ]
    shares = [average([r[key] / r["starts"] for r in group]) for key in ("verified", "near")]
    seconds = [average([r[key] for r in group]) for key in ("median_s", "ninety_percent_s")]
    counts = [average([r[key] for r in group]) for key in ("median_iterations", "median_solves")]
    rows.append(
        [
            "average",
            "",
            *map(percent, shares),
            *(number(x, 2) for x in seconds),
            *(number(x, 0) for x in counts),
        ]
    )
    return table(head, rows)


def stages_table(groups: dict[str, list[dict]]) -> list[str]:
    """Median seconds by stage."""
    rows = []
    for name, group in groups.items():
        for r in group:
            rows.append([name, r["case"], *(number(r["stages_s"][stage], 2) for stage in STAGES)])
        means = [average([r["stages_s"][stage] for r in group]) for stage in STAGES]
        total = sum(x or 0.0 for x in means)
        rows.append(
            [name, "share of all", *(percent(x / total if x is not None and total else None) for x in means)]
        )
    return table(["set", "case", *(f"{stage} [s]" for stage in STAGES)], rows)


def times_table(times: dict[str, dict]) -> list[str]:
    """Sizes of the exact programs, times of building and of one evaluation."""
    head = [
        "case",
        "nodes",
        "variables",
        "rows",
        "building, fresh [s]",
        "building, median [s]",
        "evaluation [ms]",
    ]
    head += [f"{part} [ms]" for part in PARTS]
    rows = [
        [
            case,
            *(str(x[key]) for key in ("nodes", "variables", "rows")),
            number(x["building_first_s"], 2),
            number(x["building_s"], 2),
            number(1e3 * x["evaluation_s"], 1),
            *(number(1e3 * x["parts_s"][part], 1) for part in PARTS),
        ]
        for case, x in times.items()
    ]
    return table(head, rows)


# --- figures ------------------------------------------------------------------------------------------------


def draw_starts(group: list[dict], path: Path) -> None:
    """Energies of all starts of a set, sorted, above the best of their case; one panel per case."""
    columns = min(4, len(group))
    lines = -(-len(group) // columns)
    figure = Figure(figsize=(0.6 + 2.9 * columns, 0.7 + 2.5 * lines), layout="constrained")
    FigureCanvasAgg(figure)
    figure.get_layout_engine().set(wspace=0.04)
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True).ravel()
    above = [_above(r) for r in group]
    top = max([20.0, *(1.3 * x.max() for x in above if len(x))])
    for axis, r, excess in zip(axes, group, above, strict=False):
        axis.axhspan(0, 100 * NEAR, color="#e3f1ea", lw=0)
        if len(excess):
            share = 100 * (np.arange(len(excess)) + 0.5) / r["starts"]
            axis.plot(share, excess, "o", ms=4, mew=0, color=COLORS[0], clip_on=False, zorder=3)
        note = f"{r['near']} of {r['starts']} within {100 * NEAR:.0f} %"
        if missing := r["starts"] - len(excess):
            axis.axvspan(100 * len(excess) / r["starts"], 100, color="#dddddd", lw=0)
            note += f"\n{missing} without a verified motion"
        axis.text(0.03, 0.96, note, transform=axis.transAxes, va="top", fontsize=8.5)
        best = "no plan" if r["plan"] is None else f"best {r['plan']['energy_J']:.1f} J"
        axis.set_title(f"case {r['case']}, {best}", fontsize=10)
        axis.set_yscale("symlog", linthresh=100 * NEAR, linscale=1.0)
        axis.set_ylim(0, top)
        axis.set_xlim(0, 100)
        ticks = [t for t in (0, 1, 2, 5, 10, 20, 50, 100, 200, 500) if t <= top]
        axis.set_yticks(ticks, [str(t) for t in ticks])
        axis.set_yticks([], minor=True)
        axis.grid(color="#e4e4e4", lw=0.6)
        axis.set_axisbelow(True)
    for axis in axes[len(group) :]:
        axis.set_visible(False)
    figure.suptitle(SETS[group[0]["set"]].title, fontsize=11)
    figure.supxlabel("starts, sorted by energy [%]", fontsize=10)
    figure.supylabel("energy above the best [%]", fontsize=10)
    figure.savefig(path, dpi=110)


def _above(r: dict) -> np.ndarray:
    """Energies of the verified starts above the best, per cent, sorted."""
    energies = np.sort([x for x in r["energies_J"] if x is not None])
    return 100 * np.maximum(energies / energies[0] - 1, 0) if len(energies) else energies


def draw_ratios(groups: dict[str, list[dict]], cases: Sequence[str], path: Path) -> None:
    """Energy of our best to that of the printed motion, per case and set."""
    figure = Figure(figsize=(max(7.0, 2.6 + 0.75 * len(cases)), 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    axis = figure.subplots()
    width = 0.8 / len(SETS)
    for k, (name, one) in enumerate(SETS.items()):
        group = [r for r in groups.get(name, []) if r["ratio"] is not None]
        if not group:
            continue
        places = [cases.index(r["case"]) + (k - 1) * width for r in group]
        mean = average([r["ratio"] for r in group])
        label = f"{one.title}: average {mean:.3f} (target {one.target:.2f})"
        bars = axis.bar(places, [r["ratio"] for r in group], 0.92 * width, color=COLORS[k], label=label)
        axis.bar_label(bars, fmt="%.2f", rotation=90, padding=-26, fontsize=8, color="white")
    axis.axhline(1, color="black", lw=0.9)
    axis.axhline(LARGEST_RATIO, color="#8b0000", lw=1.1, ls=(0, (6, 2)))
    place = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points", "xytext": (4, 0)}
    for y, text, color in (
        (1, "printed motion", "black"),
        (LARGEST_RATIO, f"target {LARGEST_RATIO}", "#8b0000"),
    ):
        axis.annotate(text, (1, y), va="bottom" if y == 1 else "top", color=color, fontsize=8, **place)
    axis.set_xticks(range(len(cases)), [f"case {case}" for case in cases])
    axis.set_xlim(-0.6, len(cases) - 0.4)
    axis.set_ylim(0, 1.05 * max([1.0, *(r["ratio"] or 0.0 for group in groups.values() for r in group)]))
    axis.set_ylabel("energy / energy of the printed motion")
    axis.grid(axis="y", color="#e4e4e4", lw=0.6)
    axis.set_axisbelow(True)
    if axis.containers:
        figure.legend(loc="outside lower center", fontsize=8.5, frameon=False)
    figure.savefig(path, dpi=110)


# --- command line -------------------------------------------------------------------------------------------


def say(text: str) -> None:
    """One line on a terminal, nothing elsewhere."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)


def write_all(out: Path, data: dict) -> str:
    """Write results, table and figures; return the Markdown text."""
    text = markdown(data)
    head = json.dumps({**data, "rows": []}, indent=1, allow_nan=False)
    compact = json.dumps(data["rows"], separators=(",", ":"), allow_nan=False).replace("},{", "},\n{")
    write_whole(out / "plan_cases.json", head.replace('"rows": []', f'"rows": {compact}'))
    write_whole(out / "plan_cases.md", text)
    names = data["options"]["sets"]
    groups = {name: [r for r in data["rows"] if r["set"] == name] for name in names}
    for name, group in groups.items():
        if group:
            draw_starts(group, out / f"plan_cases_{name}.png")
    draw_ratios(groups, data["options"]["cases"], out / "plan_cases_ratios.png")
    return text


def main(argv: Sequence[str] | None = None) -> int:
    names = list(motion_cases())
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for starts, plans, tables and figures"
    )
    parser.add_argument("--cases", nargs="+", choices=names, default=names)
    parser.add_argument("--sets", nargs="+", choices=list(SETS), default=list(SETS), help="sets of limits")
    parser.add_argument("--starts", type=int, default=Options.starts, help="random starts per case and set")
    parser.add_argument("--jobs", type=int, default=_cores(), help="processes (default: one per core)")
    parser.add_argument("--seed", type=int, default=Options.seed)
    parser.add_argument("--no-times", action="store_true", help="do not time building and evaluation")
    parser.add_argument("--summary-only", action="store_true", help="run nothing, sum up what there is")
    given = parser.parse_args(argv)
    if given.starts < 1 or given.jobs < 1 or given.seed < 0:
        parser.error("--starts and --jobs must be at least 1, --seed at least 0")
    cases, sets = (
        tuple(x for x in known if x in asked) for known, asked in ((names, given.cases), (SETS, given.sets))
    )
    options = Options(cases, sets, given.starts, given.seed, given.jobs)
    given.out.mkdir(parents=True, exist_ok=True)
    interrupted = False
    try:
        journal = Journal(given.out / "plan_cases.jsonl", options.seed)
        try:
            if not given.summary_only:
                run_starts(journal, options, say)
                if not given.no_times:
                    measure_times(times_path(given.out), journal, options, say)
        except KeyboardInterrupt:
            interrupted = True
        data = summary(given.out, journal, options, say)
    except OcptipError as error:
        print(f"plan_cases: {error}", file=sys.stderr)
        return 1
    say("")
    if data["rows"]:
        print(write_all(given.out, data), end="")
    else:
        print(f"plan_cases: no finished starts in {journal.path}", file=sys.stderr)
    if interrupted:
        print("\nInterrupted; finished starts are kept, start again to go on.", file=sys.stderr)
        return 130
    return 0 if data["rows"] else 1


if __name__ == "__main__":
    sys.exit(main())
