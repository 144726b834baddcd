"""Does the planner find the cheapest pair of postures? Every pair of 40 tasks is planned, for comparison.

    python -m studies.postures.run --out FOLDER [--tasks 40] [--starts 2] [--seed 0]

Three six-axis arms on bases that tip (a UR5 on a cart, two modular arms on three feet) move from a random
posture, or a random gripper pose, to a random gripper pose. Every pair of postures gets the same number of
starts of the planner, with the same numbers; `plan_motion`'s own choice (8 starts) is replayed with these
starts as far as they are the same. Goes on where it was interrupted. Writes postures.jsonl, postures.json.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ocptip.motion.planner.one_start import Search
from ocptip.motion.task import MotionTask
from studies.common import JsonLines, progress
from studies.postures.tasks import branch_task, plannable_pairs


class Watched(Search):
    """A search that remembers the energy of its coarse programs' solution."""

    coarse: float = np.nan

    def _coarse(self, start: Any, clock: Any) -> np.ndarray:
        x = super()._coarse(start, clock)
        end = x[self.formulation.layout.end]
        self.coarse = self.formulation.coarse_program(self.task.limits, end).energy(x)
        return x


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--tasks", type=int, default=40)
    parser.add_argument("--starts", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    runs = Runs(options.out / "postures.jsonl", options.seed)
    for number in range(options.starts):
        for k in range(options.tasks):
            pairs = plannable_pairs(branch_task(k, options.seed))
            for p, pair in enumerate(pairs):
                runs.get(k, p, number, pair)
            progress(k + 1, options.tasks, f"start {number}")


if __name__ == "__main__":
    main()
