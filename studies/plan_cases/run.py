"""Plans of the eight cases from many random starts: energies against the printed motions, robustness, times.

Three sets of limits:

- printed: printed base data, GN <= 0.9 and GT <= 0.9;
- effective: effective base data, the same limits;
- reference: printed base data, GN and GT nowhere worse than in the printed motion of the case itself.

Every start is a random motion, searched and checked as by `ocptip plan`; nothing of the printed motions but
these limits enters. Every finished start is a line of OUT/plan_cases.jsonl at once: start again to go on;
several processes may work on one OUT. OUT/plans holds the best verified motion of each case and set, checked
anew. Energies depend on the seed only; seconds are CPU times of single starts, each in one thread. Building
and evaluation of the programs are timed in fresh processes after all starts.

    python -m studies.plan_cases.run --out results [--starts 50] [--cases A B] [--sets printed] [--jobs 2]
    python -m studies.plan_cases.run --out results --summary-only
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ocptip.basics.errors import OcptipError
from ocptip.basics.write import plain, versions, write_text
from ocptip.motion.check import MotionCheck
from ocptip.motion.files.plan_files import write_plan
from ocptip.motion.motion_plan import MotionPlan
from ocptip.numerics.fork_server import cores
from ocptip.published.cases import motion_cases
from studies.common import json_text, machine, say
from studies.plan_cases.figures import draw_ratios, draw_starts
from studies.plan_cases.journal import SETS, Journal, Options, best_plan, reference_check, run_starts, task_of
from studies.plan_cases.tables import (
    BUILDING_SECONDS,
    EVALUATION_SECONDS,
    LARGEST_RATIO,
    NEAR,
    NEAR_SHARE,
    STAGES,
    START_SECONDS,
    markdown,
)
from studies.plan_cases.times import measure_times, read_times, times_path


def row_of(set_name: str, case: str, lines: list[dict], plan: MotionPlan | None) -> dict:
    """Everything about one pair."""
    reference, limits = reference_check(set_name, case), task_of(set_name, case).limits
    energies = np.array([x["energy_J"] if x["verified"] else np.nan for x in lines], dtype=float)
    ended = [x for x in lines if not x["error"]]
    seconds = [x["cpu_seconds"] for x in ended]

    def median(values: Sequence[float]) -> float | None:
        return float(np.median(values)) if len(values) else None

    def worst(checked: MotionCheck) -> dict[str, float]:
        return {name: checked.worst[name].value for name in ("GN", "GT", "torque_ratio", "clearance_m")}

    return plain({
        "set": set_name,
        "case": case,
        "limits": asdict(limits),
        "reference": {"energy_J": reference.energy, "duration_s": reference.duration, **worst(reference)},
        "plan": plan and {"energy_J": plan.energy, "duration_s": plan.duration, **worst(plan.check)},
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
        "machine": machine(),
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


def write_all(out: Path, data: dict) -> str:
    """Write results, table and figures; return the Markdown text."""
    text = markdown(data)
    write_text(out / "plan_cases.json", json_text(data))
    write_text(out / "plan_cases.md", text)
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
    parser.add_argument("--jobs", type=int, default=cores(), help="processes (default: one per core)")
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
