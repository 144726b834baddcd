"""Pareto front of slip, tip-over and energy of a placement task.

The task is solved for many weights of GN, GT and GE on a triangular grid; all distinct placements found on
the way are pooled, and those that no other one beats in all three criteria are the front. (Weighted sums
alone find only the convex parts of a front; local optima fill in some of the rest.)

    python -m studies.placement.pareto --out results [--task TASK.toml] [--steps 6] [--starts 6]

Every finished weight is kept in placement_pareto.json with digests of its task file and of the source that
made it; start again to go on. Rows of other tasks, --starts and --seed stay there, too.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.spatial import ConvexHull

from ocptip.basics.errors import PlanningError
from ocptip.basics.write import atomic_file, plain, write_text
from ocptip.placement.place import place
from ocptip.placement.problem import PlacementProblem, Weights
from ocptip.task_files.placement import load_placement
from studies.common import EXAMPLES, PLACING, RowFile, say, source_state, state_notes, table, task_digest

TASK = EXAMPLES / "tasks" / "place_incline.toml"
CRITERIA = ("GN", "GT", "GE")
WORDS = {"GN": "tip-over GN", "GT": "slip GT", "GE": "power at rest GE [W]"}
BETTER = 1e-4  # relative: by less than this nothing is beaten
FRONT, OTHER = "#0072b2", "#b5b5b5"
ENDS = {"GN": "#d55e00", "GT": "#009e73", "GE": "#e69f00"}


def weight_grid(steps: int) -> list[tuple[int, int, int]]:
    """Weights of GN, GT, GE in units of 1 / steps, the corners among them."""
    return [(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]


def solved(
    problem: PlacementProblem, weights: tuple[int, int, int], starts: int, seed: int
) -> dict[str, Any]:
    """All placements found with some weights."""
    gn, gt, ge = (float(w) for w in weights)
    own = replace(problem, weights=Weights(GN=gn, GT=gt, GK=0.0, GE=ge))
    row: dict[str, Any] = {"weights": list(weights)}
    cpu = time.process_time()
    try:
        result = place(own, starts=starts, seed=seed)
    except PlanningError as error:
        return row | {"placements": [], "reason": str(error)}
    row["cpu_seconds"] = time.process_time() - cpu
    row["placements"] = [
        {
            **{name: p.criteria[name] for name in CRITERIA},
            "parameters": p.parameters.tolist(),
            "patch": p.patch,
            "angles_deg": np.rad2deg(p.angles).tolist(),
            "active": [str(m) for m in p.active],
        }
        for p in result.placements
    ]
    return plain(row)


def front(values: np.ndarray) -> np.ndarray:
    """(N,) True where no other row of values (N, m) is at least as small in all and smaller in one."""
    kept = np.ones(len(values), dtype=bool)
    slack = BETTER * np.abs(values).max(axis=0, initial=0.0)
    for i, row in enumerate(values):
        as_good = (values <= row + slack).all(axis=1)
        better = (values < row - slack).any(axis=1)
        kept[i] = not (as_good & better).any()
    return kept


def pooled(rows: list[dict[str, Any]]) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Criteria (N, 3) and the placements they belong to, of all weights."""
    points = [p for row in rows for p in row["placements"]]
    return np.array([[p[name] for name in CRITERIA] for p in points]).reshape(-1, 3), points


def draw(problem: PlacementProblem, name: str, rows: list[dict[str, Any]]) -> Figure:
    """Three projections of the front, and where its bases stand."""
    values, points = pooled(rows)
    kept = front(values)
    best = {k: int(np.flatnonzero(kept)[np.argmin(values[kept, c])]) for c, k in enumerate(CRITERIA)}
    figure = Figure(figsize=(13.0, 11.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 2)
    for ax, (a, b) in zip(axes.ravel(), ((0, 1), (0, 2), (1, 2)), strict=False):
        c = 3 - a - b
        ax.scatter(values[~kept, a], values[~kept, b], s=22, color=OTHER, label="beaten in all criteria")
        mesh = ax.scatter(
            values[kept, a], values[kept, b], c=values[kept, c], s=48, cmap="viridis", label="front", zorder=3
        )
        for key, at in best.items():
            ax.plot(
                *values[at, [a, b]],
                marker="o",
                ms=13,
                mfc="none",
                mec=ENDS[key],
                mew=2.4,
                ls="",
                label=f"least {key}",
                zorder=4,
            )
        figure.colorbar(mesh, ax=ax, label=WORDS[CRITERIA[c]])
        ax.set_xlabel(WORDS[CRITERIA[a]])
        ax.set_ylabel(WORDS[CRITERIA[b]])
        ax.grid(color="#ececec")
        ax.set_axisbelow(True)
    axes[0, 0].legend(frameon=False, fontsize=9)
    _bases(axes[1, 1], problem, points, kept, best)
    figure.suptitle(
        f"{name}: {int(kept.sum())} of {len(values)} placements are on the front", fontweight="bold"
    )
    return figure


def _bases(
    ax: Any, problem: PlacementProblem, points: list[dict[str, Any]], kept: np.ndarray, best: dict[str, int]
) -> None:
    contacts = np.array([c.position for c in problem.robot.support.contacts])
    for i in [*np.flatnonzero(kept), *best.values()]:
        origin, turn = problem.base_pose(points[i]["patch"], np.array(points[i]["parameters"])[None])
        flat = (origin[0] + contacts @ turn[0].T)[:, :2]
        outline = flat[ConvexHull(flat).vertices]
        names = [key for key, at in best.items() if at == i]
        color, width = (ENDS[names[0]], 2.2) if names else (FRONT, 0.5)
        ax.fill(
            *outline.T, fc="none", ec=color, lw=width, label=f"least {', '.join(names)}" if names else None
        )
    for task in problem.tasks:
        ax.plot(*task.position[:2], "+", ms=12, mew=2.4, color="black")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")
    ax.set_title("Where the bases of the front stand; +: gripper", loc="left", fontsize=11)
    handles, labels = ax.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    ax.legend(unique.values(), unique.keys(), frameon=False, fontsize=9)


def markdown(name: str, rows: list[dict[str, Any]], notes: list[str]) -> str:
    """Ends and size of the front."""
    values, points = pooled(rows)
    kept = front(values)
    seconds = [row["cpu_seconds"] for row in rows if "cpu_seconds" in row]
    lines = [
        f"# Pareto front: {name}",
        "",
        f"{len(rows)} weights, {len(values)} placements, {int(kept.sum())} on the front; median "
        f"{np.median(seconds):.2f} s of CPU per weight. GE in W.",
        "",
    ]
    ends = []
    for c, criterion in enumerate(CRITERIA):
        at = int(np.flatnonzero(kept)[np.argmin(values[kept, c])])
        where = ", ".join(f"{v:.3f}" for v in points[at]["parameters"])
        active = "; ".join(points[at]["active"]) or "none"
        ends.append([f"least {criterion}", *(f"{v:.4g}" for v in values[at]), where, active])
    head = ["end", *CRITERIA, "parameters", "active"]
    lines += table(head, ends, left=len(head))
    return "\n".join([*lines, *(["", *notes] if notes else [])]) + "\n"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--task", type=Path, default=TASK)
    parser.add_argument("--steps", type=int, default=6, help="of the weights' grid (6: 28 weights)")
    parser.add_argument("--starts", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    if options.steps < 1 or options.starts < 1:
        parser.error("--steps and --starts must be at least 1")
    task = load_placement(options.task)
    options.out.mkdir(parents=True, exist_ok=True)
    asked = {"task": options.task.name, "task_digest": task_digest(options.task)}
    asked |= {"starts": options.starts, "seed": options.seed}
    state = source_state(*PLACING)
    kept = RowFile(options.out / "placement_pareto.json", asked, ("weights",), state)
    for weights in weight_grid(options.steps):
        if kept.find(weights=list(weights)) is None:
            say(f"weights {weights} ...")
            kept.put(solved(task.problem, weights, options.starts, options.seed))
    rows = [row for row in kept.own if sum(row["weights"]) == options.steps]
    if not any(row["placements"] for row in rows):
        print(f"{options.task.name}: no placement for any weights: {rows[0]['reason']}", file=sys.stderr)
        return 1
    text = markdown(task.name, rows, state_notes([row.get("state") for row in rows], state))
    write_text(options.out / "placement_pareto.md", text)
    with atomic_file(options.out / "placement_pareto.png") as stream:
        draw(task.problem, task.name, rows).savefig(stream, format="png", dpi=100)
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
