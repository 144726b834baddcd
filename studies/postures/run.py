"""Does the planner find the cheapest pair of postures? All pairs of 40 tasks are planned, for comparison.

    python -m studies.postures.run --out FOLDER [--tasks 40] [--complete 15] [--seed 0]

Three six-axis arms on bases that tip (a UR5 on a cart, two modular arms on three feet) move from a random
posture, every third task from a random gripper pose, to a random gripper pose. Every pair of postures gets
one start of the planner with the same number (after the first 15 tasks all but `tasks.hopeless` ones), those
within 15 % of the cheapest another one. Found is the cheapest if it, or a pair at most 0.5 % dearer, is among
those that `plan_motion` gives its further starts. Goes on where it was interrupted. Writes postures.jsonl and
postures.md.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ocptip.basics.write import versions, write_text
from ocptip.motion.choices import first_round, likely_choices, second_round
from ocptip.motion.planner.one_start import Search
from ocptip.motion.task import MotionTask
from studies.common import JsonLines, number, progress, software, table
from studies.postures.tasks import branch_task, hopeless, plannable_pairs

AGAIN, SAME = 1.15, 1.005


class Watched(Search):
    """A search that remembers the energy of its coarse programs' solution."""

    coarse: float = np.nan

    def _coarse(self, start: Any, limits: Any, clock: Any) -> tuple[np.ndarray, float]:
        x, cost = super()._coarse(start, limits, clock)
        end = x[self.formulation.layout.end]
        self.coarse = self.formulation.coarse_program(self.task.limits, end).energy(x)
        return x, cost


class Runs:
    """Single starts on single pairs, kept in a file."""

    def __init__(self, path: Path, seed: int) -> None:
        self._lines, self._seed = JsonLines(path), seed
        self._known = {self._key(row): row for row in self._lines.read()}

    @staticmethod
    def _key(row: dict[str, Any]) -> tuple[int, int, int, int]:
        return row["seed"], row["task"], row["pair"], row["number"]

    def get(self, task: int, pair: int, number: int, search: Watched | MotionTask) -> dict[str, Any]:
        """The start of that number."""
        key = self._seed, task, pair, number
        if key not in self._known:
            search = search if isinstance(search, Watched) else Watched(search)
            with threadpool_limits(1):
                result = search.run(number, self._seed).result
            row = {"seed": self._seed, "task": task, "pair": pair, "number": number, "coarse": search.coarse}
            row |= {"energy": result.energy, "verified": result.verified, "cpu": result.cpu_seconds}
            row = {k: v if not isinstance(v, float) or np.isfinite(v) else None for k, v in row.items()}
            self._lines.append(row)
            self._known[key] = row
        return self._known[key]


def study(runs: Runs, k: int, complete: bool, seed: int) -> dict[str, Any]:
    """What is known about a task: energies of all pairs, and which the planner prefers."""
    task = branch_task(k, seed)
    pairs = plannable_pairs(task)
    without = set() if complete else hopeless(pairs)
    searches = {p: Watched(pair) for p, pair in enumerate(pairs) if p not in without}
    energies = {p: [_energy(runs.get(k, p, 0, search))] for p, search in searches.items()}
    least = min(first for (first,) in energies.values())
    for p, own in energies.items():
        if own[0] <= AGAIN * least:
            own.append(_energy(runs.get(k, p, 1, searches[p])))
    best = {p: min(own) for p, own in energies.items()}
    cheapest = min(best, key=best.__getitem__)
    order = [_index(pairs, one) for one in likely_choices(task)]
    costs = {i: energies[p][0] for i, p in enumerate(order) if p in energies}
    ranked, numbers = [pairs[p] for p in order], range(2 * len(order))
    last = second_round(ranked, numbers, costs) or first_round(ranked, numbers)
    further = {_index(pairs, one) for one, _ in last}
    return {
        "task": task.name,
        "pairs": len(pairs),
        "planned": len(order),
        "further": len(further),
        "best": min(best.values()),
        "second": sorted(best.values())[1] if len(best) > 1 else None,
        "chosen": min(best.get(p, np.inf) for p in further),
        "rank": order.index(cheapest) + 1 if cheapest in order else 0,
    }


def _energy(row: dict[str, Any]) -> float:
    return row["energy"] if row["verified"] else np.inf


def _index(pairs: list[MotionTask], one: MotionTask) -> int:
    ends = [np.append(pair.start, pair.goal) for pair in pairs]
    return int(np.argmin([np.abs(end - np.append(one.start, one.goal)).max() for end in ends]))


def report(rows: list[dict[str, Any]]) -> str:
    """A table and a line below it."""
    head = ["task", "pairs", "planned", "further starts", "cheapest, J", "second, J", "found, J", "rank"]
    lines = [
        [
            row["task"],
            *(str(row[name]) for name in ("pairs", "planned", "further")),
            *(number(row[name], 1) for name in ("best", "second", "chosen")),
            str(row["rank"] or "not planned"),
        ]
        for row in rows
    ]
    found = sum(row["chosen"] <= SAME * row["best"] for row in rows)
    text = [*table(head, lines), "", f"The cheapest pair found in {found} of {len(rows)} tasks."]
    return "\n".join(text) + "\n"


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--tasks", type=int, default=40)
    parser.add_argument("--complete", type=int, default=15)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    runs, rows = Runs(options.out / "postures.jsonl", options.seed), []
    for k in range(options.tasks):
        rows.append(study(runs, k, k < options.complete, options.seed))
        progress(k + 1, options.tasks, rows[-1]["task"])
    note = f"The first {options.complete} enumerations leave nothing out. Seed {options.seed}. "
    note += f"{software(versions())}."
    write_text(options.out / "postures.md", f"# Is the cheapest pair found?\n\n{report(rows)}\n{note}\n")


if __name__ == "__main__":
    main()
