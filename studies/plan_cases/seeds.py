"""How often a call of the planner with default options ends near the best known plan, over many seeds.

One call is `plan_motion` of a case, with its eight starts in one process. Energies count as near within 1 %
of the least of 50 random starts (`plan_cases.run`), and of the least that either study has found. Calls that
are done are kept: started again with the same folder the study goes on. How many starts would do in 99 of 100
calls is estimated from these calls, as if each start came near by itself.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ocptip.basics.errors import PlanningError
from ocptip.certificate.checks import certified
from ocptip.motion.plan import plan_motion
from ocptip.published.tasks import experiment_task
from studies.common import (
    PLANNING,
    RESULTS,
    JsonLines,
    ended,
    leave_interrupts_to_parent,
    number,
    percent,
    progress,
    source_state,
    table,
)

NEAR = 1.01  # of the least energy
BASES = ("effective", "printed")


@dataclass(frozen=True)
class Call:
    """One call of the planner."""

    base: str
    case: str
    seed: int


def run_call(call: Call, starts: int) -> dict:
    """Plan; energy None where no plan is verified."""
    line = {"base": call.base, "case": call.case, "seed": call.seed, "starts": starts}
    line["state"] = source_state(*PLANNING)
    try:
        plan = plan_motion(
            experiment_task(call.case, call.base), starts=starts, seed=call.seed, jobs=1, prove=certified
        )
    except PlanningError as error:
        return {**line, "energy_J": None, "status": str(error)}
    return {
        **line,
        "energy_J": plan.energy,
        "status": "verified",
        "seconds": plan.seconds,
        "cpu_seconds": sum(start.cpu_seconds for start in plan.starts),
        "iterations": sum(start.iterations for start in plan.starts),
        "starts_verified": sum(start.verified for start in plan.starts),
    }


def run_calls(journal: JsonLines, calls: list[Call], starts: int, workers: int) -> list[dict]:
    """All lines of these calls with the present state of the planner, those that were missing now run."""
    state, found = source_state(*PLANNING), dict[Call, dict]()
    for line in journal.read():
        if line["state"] == state and line["starts"] == starts:
            found[Call(line["base"], line["case"], line["seed"])] = line
    todo = [call for call in calls if call not in found]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, leave_interrupts_to_parent) as pool:
        futures = {pool.submit(run_call, call, starts): call for call in todo}
        for done, future in enumerate(as_completed(futures), 1):
            found[futures[future]] = line = future.result()
            journal.append(line)
            progress(done, len(todo), f"calls, last: {line['case']}, {line['base']}")
    return [found[call] for call in calls]


def best_known() -> dict[tuple[str, str], float]:
    """Least energies, J, by base and case, of the study of 50 starts."""
    rows = json.loads((RESULTS / "plan_cases.json").read_text())["rows"]
    return {(row["set"], row["case"]): row["plan"]["energy_J"] for row in rows if row["set"] in BASES}


def summary(lines: list[dict]) -> str:
    """The table."""
    known, rows = best_known(), []
    for pair in sorted({(line["base"], line["case"]) for line in lines}):
        own = [line for line in lines if (line["base"], line["case"]) == pair]
        energies = np.array([np.inf if line["energy_J"] is None else line["energy_J"] for line in own])
        planned = [line for line in own if line["energy_J"] is not None]
        of_starts = known.get(pair, np.inf)
        best = min(of_starts, energies.min())
        cpu, iterations = (
            np.median([line[name] for line in planned]) if planned else np.nan
            for name in ("cpu_seconds", "iterations")
        )
        near, worst = np.mean(energies <= NEAR * best), energies.max() / best
        enough = own[0]["starts"] * np.log(0.01) / np.log(1 - near) if 0 < near < 1 else np.nan
        rows.append(
            [
                *(*pair, str(len(own)), number(of_starts, 1)),
                percent(float(np.mean(energies <= NEAR * of_starts))),
                *(number(best, 1), percent(float(near)), number(worst)),
                *(number(cpu, 1), number(iterations, 0), number(enough, 0)),
            ]
        )
    head = [
        "base",
        "case",
        "calls",
        "50 starts [J]",
        "within 1 %",
        "best known [J]",
        "within 1 %",
        "worst / best",
        "median CPU s",
        "iterations",
        "starts for 99 %",
    ]
    seeds = sorted({line["seed"] for line in lines})
    title = f"{len(lines)} calls of {lines[0]['starts']} starts, seeds {seeds[0]} to {seeds[-1]}."
    return "\n".join([title, "", *table(head, rows, left=2), ""])


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder of seeds.jsonl, seeds.md"
    )
    parser.add_argument("--seeds", default="0:100", help="first and behind the last, FIRST:END")
    parser.add_argument("--cases", default="A,B,C,D,E,F,G,H")
    parser.add_argument("--bases", default=",".join(BASES))
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()

    def study() -> str:
        first, end = map(int, options.seeds.split(":"))
        bases, cases = options.bases.split(","), options.cases.split(",")
        calls = [Call(base, case, seed) for seed in range(first, end) for base in bases for case in cases]
        options.out.mkdir(parents=True, exist_ok=True)
        journal = JsonLines(options.out / "seeds.jsonl")
        text = summary(run_calls(journal, calls, options.starts, options.workers))
        (options.out / "seeds.md").write_text(text)
        return text

    return ended("seeds", study, kept="started again it goes on.")


if __name__ == "__main__":
    sys.exit(main())
