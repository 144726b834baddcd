"""Ipopt formulation against Nelder-Mead with penalties (appendix D), CMA-ES and SLSQP on the motion problem.

Every method plans the same motions: the cases A to H on the effective base, where the contacts bind, from
the same random starts. Methods:

- ours: `ocptip.motion.planner.one_start.Search`, smooth and exact programs solved by Ipopt, then checked;
- nelder-mead: the source's method, adapted centroid and bounds, on the penalised cost (5.38);
- nelder-mead-plain: the same without the adapted centroid;
- cma: CMA-ES on the same cost, restarted with twice the population until its time is over: ten times what
  ours took for the same start, if that is known, else --max-seconds;
- slsqp: SLSQP with finite differences on cost and limits without penalty.

All but ours search the parameters of `studies.baselines.penalty`, whose model of energy, contacts, collisions
is that of the planner; of all points evaluated the one with the least penalised cost is their result. They
see limits at the nodes and at both ends of all intervals; the source's cubic splines (--between spline)
refuse good motions, which would be an unfair handicap. Every result is checked on the dense grid;
one that breaks a limit there is slowed down until it keeps all of them, and the energy of that is given, too.
Seconds are of CPU, one thread per run, without start-up and compilation, and without that final check but
for ours, where it is part of the method.

    python -m studies.compare.run --out results/compare [--cases A B] [--starts 50] [--jobs 2]

The rows of one case against Nelder-Mead, in less than ten minutes on two cores (CMA-ES is what takes long):

    python -m studies.compare.run --out b --cases B --methods ours nelder-mead nelder-mead-plain

Finished runs are kept in runs.jsonl with the state of the source that made them; start again to go on.
Methods may have different numbers of starts (run them one after the other); --summary-only makes table and
figures of all runs that are there.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from ocptip.basics.write import write_json, write_text
from ocptip.published.cases import case_names
from studies.common import ended, state_notes
from studies.compare.figures import draw_convergence, draw_energies, draw_motions
from studies.compare.methods import METHODS, Settings
from studies.compare.runs import Runs, run_all
from studies.compare.summary import markdown, summary


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
    text = markdown(rows, state_notes([r.get("state") for r in records.values()], runs.state, "runs"))
    write_json(out / "compare_nelder_mead.json", {**runs.header, "rows": rows}, indent=1)
    write_text(out / "compare_nelder_mead.md", text)
    draw_energies(records, out / "compare_energies.png")
    draw_convergence(records, out / "compare_convergence.png")
    draw_motions(records, out / "compare_motions.png")
    return text


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for runs, table and figures")
    parser.add_argument("--cases", nargs="+", choices=case_names(), default=case_names())
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
    starts = 0 if given.summary_only else given.starts
    return ended(
        "compare_nelder_mead",
        lambda: run(given.out, given.cases, starts, given.methods, settings, given.jobs),
        "finished runs are kept, start again to go on.",
    )


if __name__ == "__main__":
    sys.exit(main())
