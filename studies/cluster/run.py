"""Where should the cart stand? A motion planned at every place of a map, on a local Dask cluster.

    python -m studies.cluster.run [--cells X Y] [--workers N ...] [--seed N]

The gripper poses of the UR5 example stay where they are in the world, the cart stands at the cells of a grid,
and at each a motion is planned with one start: the map of least energies. Every cell is one call of
`ocptip.numerics.workers.Cluster`, as with `--scheduler`. The map is made with 1, 2 and 4 processes; each time
but the first one of them is killed while it plans. All maps must be the same to the last bit.
"""

from __future__ import annotations

import argparse
import os
import signal
import time
import tomllib
from concurrent.futures import as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import PlanningError, SolverError
from ocptip.basics.toml import toml_text
from ocptip.basics.write import versions, write_json
from ocptip.certificate.checks import certified
from ocptip.motion.plan import plan_motion
from ocptip.motion.task import MotionTask, refusals
from ocptip.numerics.workers import worker_pool
from ocptip.task_files.motion import load_task
from studies.common import EXAMPLES, RESULTS, ended, machine, number, table

EXTENT = 0.06  # m, from the cart's place in the example to the first and last cells
KILLED_AFTER = 0.2  # share of the cells that are finished when a worker is killed


def grid(cells: tuple[int, int]) -> list[tuple[float, float]]:
    """Places of the cart, m, from its place in the example."""
    x, y = (np.linspace(-EXTENT, EXTENT, n) if n > 1 else np.zeros(1) for n in cells)
    return [(float(a), float(b)) for b in y for a in x]


def task_at(place: tuple[float, float], folder: Path) -> MotionTask:
    """The example with the cart elsewhere, the poses where they are in the world; folder: for its file."""
    tasks = EXAMPLES / "tasks"
    data = tomllib.loads((tasks / "ur5_cart.toml").read_text(encoding="utf-8"))
    for pose in (data["motion"]["start_pose"], data["motion"]["goal_pose"]):
        pose["position"] = [a - b for a, b in zip(pose["position"], (*place, 0.0), strict=True)]
    (folder / "ur5.urdf").write_bytes((tasks / "ur5.urdf").read_bytes())
    (folder / "cell.toml").write_text(toml_text(data), encoding="utf-8")
    return replace(load_task(folder / "cell.toml"), source=None)


def cell(task: MotionTask, seed: int) -> dict[str, Any]:
    """The plan of one cell, as plain data."""
    if reasons := refusals(task):
        return {"energy_J": None, "why": reasons[0], "process": os.getpid()}
    try:
        plan = plan_motion(task, starts=1, seed=seed, jobs=1, prove=certified)
    except (PlanningError, SolverError) as error:
        return {"energy_J": None, "why": f"{error}", "process": os.getpid()}
    return {"energy_J": plan.energy, "duration_s": plan.duration, "process": os.getpid()}


def map_with(tasks: list[MotionTask], workers: int, seed: int) -> dict[str, Any]:
    """All cells on that many processes; of several, one is killed on the way."""
    import distributed

    local = {"n_workers": workers, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
    with (
        distributed.LocalCluster(**local) as cluster,
        worker_pool(None, None, 1, cluster.scheduler_address) as pool,
    ):
        for warm in [pool.submit(cell, tasks[0], seed) for _ in range(workers)]:
            warm.result()
        began, killed = time.perf_counter(), None
        futures = {pool.submit(cell, task, seed): k for k, task in enumerate(tasks)}
        rows: dict[int, dict[str, Any]] = {}
        for future in as_completed(futures):
            rows[futures[future]] = future.result()
            if workers > 1 and killed is None and len(rows) >= KILLED_AFTER * len(tasks):
                killed = next(iter(cluster.workers.values())).pid
                os.kill(killed, signal.SIGKILL)
        seconds = time.perf_counter() - began
    return {"workers": workers, "seconds": seconds, "killed": killed, "rows": [rows[k] for k in sorted(rows)]}


def report(result: dict[str, Any]) -> str:
    """Map and scaling as Markdown."""
    runs = result["runs"]
    energies = [[row["energy_J"] for row in run["rows"]] for run in runs]
    same = all(one == energies[0] for one in energies)
    columns = result["cells"][0]
    xs = [place[0] for place in result["places"][:columns]]
    cells = [number(value, 1) for value in energies[0]]
    rows = [
        [f"{result['places'][k][1]:+.2f}", *cells[k : k + columns]] for k in range(0, len(cells), columns)
    ]
    scaling = [
        [
            f"{run['workers']}",
            "one" if run["killed"] else "none",
            f"{sum(row['energy_J'] is not None for row in run['rows'])} of {len(result['places'])}",
            f"{run['seconds']:.1f}",
            f"{runs[0]['seconds'] / run['seconds']:.2f}",
        ]
        for run in runs
    ]
    lines = [
        "Least energy, J, of a motion with the cart at y (rows) and x (columns), m from its place:",
        "",
        *table(["y \\ x", *(f"{x:+.2f}" for x in xs)], rows),
        "",
        f"The maps are {'the same to the last bit' if same else 'NOT the same'}. Load of the machine when it "
        f"began: {result['load']:.1f} on {result['machine']['cores']} cores.",
        "",
        *table(["workers", "killed", "motions", "seconds", "times as fast"], scaling),
    ]
    return "\n".join(lines) + "\n"


def study(options: argparse.Namespace) -> str:
    """Run, write, report."""
    folder = RESULTS / "cluster"
    folder.mkdir(parents=True, exist_ok=True)
    places = grid(tuple(options.cells))
    scratch = folder / "scratch"
    scratch.mkdir(exist_ok=True)
    tasks = [task_at(place, scratch) for place in places]
    for path in scratch.iterdir():
        path.unlink()
    scratch.rmdir()
    load = os.getloadavg()[0]
    runs = [map_with(tasks, workers, options.seed) for workers in options.workers]
    result = {"cells": options.cells, "places": places, "seed": options.seed, "load": load, "runs": runs}
    result |= {"machine": machine(), "versions": versions(("numpy", "casadi", "llvmlite", "distributed"))}
    write_json(folder / "cluster.json", result)
    text = report(result)
    (folder / "report.md").write_text(text, encoding="utf-8")
    return text


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs=2, default=[3, 2], metavar=("X", "Y"))
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    return ended("cluster", lambda: study(options))


if __name__ == "__main__":
    raise SystemExit(main())
