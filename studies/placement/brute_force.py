"""`place` against a grid search with a million evaluations, on random tasks of six-axis arms.

Odd tasks are for the UR5 on its cart (four braked wheels, full redistribution), even ones for the modular
arm FP1W2F on three feet. Pose, force, slope of the ground, wall, pillar and weights are random; all
constraints are on. The grid holds base position and angle with all branches of the inverse kinematics; about
the best of its blocks it is refined three times. `place` may not be more than 0.5 % worse, whatever its seed.

    python -m studies.placement.brute_force --out results [--tasks 10] [--evaluations 1000000] [--seed 0]

Every finished task is kept in placement_brute_force.json with the state of the source that made it; start
again to go on, with --again to run `place` anew on the tasks that are done. Tasks of other --seed and
--evaluations stay there, too. Run it on an idle core, or read the CPU seconds.
"""

from __future__ import annotations

import argparse
import sys
import time
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import PlanningError
from ocptip.basics.write import plain, write_text
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.placement.maps import Scan, scan
from ocptip.placement.place import place
from ocptip.placement.problem import GripperTask, PlacementLimits, PlacementProblem, ProcessLoad, Weights
from ocptip.placement.terrain import plane
from ocptip.published.tasks import experiment_task
from ocptip.robots.geometry import Pillar, Wall
from ocptip.standing.arm import Robot
from ocptip.task_files.motion import load_task
from studies.common import EXAMPLES, PLACING, RowFile, say, source_state, state_notes, table

ALLOWED = 0.005  # of the grid's total
START_SETS = 5  # seeds of `place` per task
PROBE = 12_000  # random placements that show where tasks are in reach
FEW = 30
MARGIN = 0.15  # on each side of what was found to be in reach
BLOCKS = (6, 6, 8)  # of the grid; the best ones are refined
REFINED = 8
REFINE_POINTS = 9  # per axis and level
REFINE_SHARE = 0.25  # of the evaluations
LEVELS = 3
_UR5 = EXAMPLES / "tasks" / "ur5_cart.toml"


def robots() -> tuple[Robot, Robot]:
    """The modular arm on three feet and the UR5 on four wheels."""
    arm = experiment_task("A").robot.arm.mounted([0.0, 0.0, 0.298])
    feet = [(0.1732, 0.30), (0.1732, -0.30), (-0.3464, 0.0)]
    support = Support(
        [UnilateralContact(position=[x, y, 0.0], friction=0.5, facets=12) for x, y in feet],
        mass=20.0,
        center_of_mass=[0.0, 0.0, 0.15],
    )
    modular = Robot(arm, support, experiment_task("A").robot.motors)
    return modular, load_task(_UR5).robot


def random_problem(seed: int, number: int) -> PlacementProblem:
    """A task; number 1, 2, ... counts tasks of a seed. It may have no solution."""
    rng = np.random.default_rng([seed, number])
    modular, ur5 = robots()
    robot, size = (ur5, 1.0) if number % 2 else (modular, 0.5)
    height = 0.75 if number % 2 else 0.3
    position = np.array([0.0, 0.0, height + size * rng.uniform(0.0, 0.6)])
    down = rng.uniform(0, np.pi / 2)  # tool axis between forward and straight down
    tool = Rotation.from_euler(
        "ZYX", [rng.uniform(-np.pi, np.pi), np.pi / 2 + down, rng.uniform(-np.pi, np.pi)]
    )
    push = rng.normal(size=3)
    force = rng.uniform(10, 30 if size < 1 else 90) * push / np.linalg.norm(push)
    slope = np.tan(np.deg2rad(rng.uniform(0, 8))) * np.array(
        [np.cos(a := rng.uniform(-np.pi, np.pi)), np.sin(a)]
    )
    away, beside = rng.uniform(-np.pi, np.pi, 2)
    wall = Wall(np.array([np.cos(away), np.sin(away), 0.0]), size * rng.uniform(0.25, 0.6), "wall")
    at = size * rng.uniform(0.5, 0.9) * np.array([np.cos(beside), np.sin(beside), 0.0])
    return PlacementProblem(
        robot,
        GripperTask(
            position,
            tool.as_matrix(),
            [ProcessLoad(force, rng.normal(size=3) * size, name="push")],
            name="random",
        ),
        plane(slope),
        weights=Weights(*rng.dirichlet(np.ones(4))),
        limits=PlacementLimits(
            GN=0.9, GT=0.9, clearance=0.01, base_clearance=0.02, condition=40.0, jacobian_length=0.4 * size
        ),
        obstacles=[wall, Pillar(at, 0.08 * size)],
    )


def brute_force(problem: PlacementProblem, evaluations: int) -> dict[str, Any]:
    """The best placement of a grid with about this many states of the arm, refined about its best blocks."""
    began = time.process_time()
    low, high, per_placement = _in_reach(problem)
    points = max(round(((1 - REFINE_SHARE) * evaluations / per_placement) ** (1 / 3)), 4)
    grid, blocks, spacing = _grid(low, high, points)
    found = scan(problem, grid, groups=blocks)
    looked, states, solved = len(grid), found.states, found.solved
    best, order = _best(found), np.argsort(np.nan_to_num(found.totals, nan=np.inf))
    centres = found.parameters[[i for i in order[:REFINED] if np.isfinite(found.totals[i])]]
    for _ in range(LEVELS):
        if not len(centres):
            break
        offsets = np.stack(np.meshgrid(*[np.linspace(-1, 1, REFINE_POINTS)] * 3), axis=-1).reshape(-1, 3)
        fine = (centres[:, None] + spacing * offsets).reshape(-1, 3)
        found = scan(problem, fine, groups=np.repeat(np.arange(len(centres)), len(offsets)))
        looked, states, solved = looked + len(fine), states + found.states, solved + found.solved
        centres, spacing = found.parameters[found.feasible], spacing / ((REFINE_POINTS - 1) / 2)
        best = min(best, _best(found), key=lambda b: b[0])
    return {
        "total": best[0],
        "parameters": best[1],
        "points_per_axis": points,
        "placements": looked,
        "states": states,
        "contacts_solved": solved,
        "cpu_seconds": time.process_time() - began,
    }


def _in_reach(problem: PlacementProblem) -> tuple[np.ndarray, np.ndarray, float]:
    """Box (3,), (3,) that holds all places in reach, with a margin, and states per placement in it."""
    low, high = problem.terrain[0].box(problem.tasks[0].position, problem.reach)
    rng, per_placement = np.random.default_rng(0), 0.0
    for _ in range(2):
        probe = low + rng.random((PROBE, 3)) * (high - low)
        seen = scan(problem, probe)
        per_placement = max(seen.states / PROBE, 0.05)
        inside = probe[~np.isin(seen.causes.astype(str), ("reach", "base clearance"))]
        if len(inside) < FEW:
            break
        near, far = inside.min(axis=0)[:2], inside.max(axis=0)[:2]
        low[:2] = np.maximum(low[:2], near - MARGIN * (far - near))
        high[:2] = np.minimum(high[:2], far + MARGIN * (far - near))
    return low, high, per_placement


def _grid(low: np.ndarray, high: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Placements (N, 3), their blocks (N,), and the spacing (3,); the angle goes once round."""
    ends = [True, True, False]
    axes = [np.linspace(a, b, points, endpoint=end) for a, b, end in zip(low, high, ends, strict=True)]
    index = np.stack(np.meshgrid(*[np.arange(points)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    grid = np.column_stack([axis[index[:, k]] for k, axis in enumerate(axes)])
    block = index * np.array(BLOCKS) // points
    spacing = np.array([axis[1] - axis[0] for axis in axes])
    return grid, np.ravel_multi_index(block.T, BLOCKS), spacing


def _best(found: Scan) -> tuple[float, list[float] | None]:
    at = found.best
    return (np.inf, None) if at is None else (float(found.totals[at]), found.parameters[at].tolist())


def compared(seed: int, number: int, evaluations: int) -> dict[str, Any]:
    """One row: the grid's best and what `place` finds from several start sets."""
    problem = random_problem(seed, number)
    row: dict[str, Any] = {"number": number, "robot": problem.robot.arm.name}
    row["grid"] = brute_force(problem, evaluations)
    return plain(row | {"sets": start_sets(problem)})


def start_sets(problem: PlacementProblem) -> list[dict[str, Any]]:
    """What `place` finds from each start set, and its time."""
    sets = []
    for start_seed in range(START_SETS):
        wall, cpu = time.perf_counter(), time.process_time()
        entry: dict[str, Any] = {"seed": start_seed}
        try:
            result = place(problem, seed=start_seed)
            entry |= {"total": result.best.total, "parameters": result.best.parameters}
            entry["active"] = [str(m) for m in result.best.active]
            entry["starts"] = len(result.starts)
        except PlanningError as error:
            entry |= {"total": np.inf, "reason": str(error)}
        entry |= {"seconds": time.perf_counter() - wall, "cpu_seconds": time.process_time() - cpu}
        sets.append(entry)
    return plain(sets)


def solvable(row: dict[str, Any]) -> bool:
    """The grid or `place` found a placement."""
    return row["grid"]["total"] is not None or any(entry["total"] is not None for entry in row["sets"])


def excess(row: dict[str, Any]) -> list[float]:
    """How much worse than the grid each start set is, relative; infinite where only the grid found one."""
    grid = np.inf if row["grid"]["total"] is None else row["grid"]["total"]
    ours = [np.inf if entry["total"] is None else entry["total"] for entry in row["sets"]]
    return [
        -1.0 if np.isinf(grid) and np.isfinite(t) else np.inf if np.isinf(t) else t / grid - 1 for t in ours
    ]


def markdown(rows: list[dict[str, Any]], notes: list[str]) -> str:
    """The comparison as a table."""
    done = [row for row in rows if solvable(row)]
    cells = []
    for row in done:
        grid, worse = row["grid"], excess(row)
        total = "none" if grid["total"] is None else f"{grid['total']:.5f}"
        seconds = np.median([entry["cpu_seconds"] for entry in row["sets"]])
        shares = [f"{100 * value:+.2f} %" for value in (min(worse), max(worse))]
        times = [f"{seconds:.2f}", f"{grid['cpu_seconds']:.0f}"]
        cells.append([str(row["number"]), row["robot"], str(grid["states"]), total, *shares, *times])
    head = ["task", "robot", "states", "grid total", "best set", "worst set", "CPU s per set", "grid CPU s"]
    lines = ["# `place` against a grid", "", *table(head, cells, left=2)]
    if done:
        worse = [value for row in done for value in excess(row)]
        cpu, wall = ([e[key] for row in done for e in row["sets"]] for key in ("cpu_seconds", "seconds"))
        fine = sum(value <= ALLOWED for value in worse)
        lines += [
            "",
            f"{fine} of {len(worse)} start sets are at most {100 * ALLOWED:g} % worse than the grid; worst "
            f"{100 * max(worse):+.2f} %. Median per start set {np.median(cpu):.2f} s of CPU "
            f"({np.median(wall):.2f} s wall), largest {max(cpu):.2f} s. "
            f"Without solution in grid and `place`: {len(rows) - len(done)} further random tasks.",
        ]
    return "\n".join([*lines, *(["", *notes] if notes else [])]) + "\n"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--tasks", type=int, default=10, help="tasks with a solution (10)")
    parser.add_argument("--evaluations", type=int, default=1_000_000, help="states of the arm per task (1e6)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--again", action="store_true", help="run `place` anew, keep the grids that are done")
    options = parser.parse_args(arguments)
    if options.tasks < 1 or options.evaluations < 1000:
        parser.error("--tasks must be at least 1, --evaluations at least 1000")
    options.out.mkdir(parents=True, exist_ok=True)
    asked, state = {"seed": options.seed, "evaluations": options.evaluations}, source_state(*PLACING)
    kept = RowFile(options.out / "placement_brute_force.json", asked, ("number",), state)
    for row in kept.own if options.again else ():
        sets = start_sets(random_problem(options.seed, row["number"]))
        kept.put(row | {"sets": sets, "grid_state": _grid_state(row)})
    for number in islice(count(1), 20 * options.tasks):
        if sum(solvable(row) for row in kept.own) >= options.tasks:
            break
        if kept.find(number=number) is None:
            say(f"task {number} ...")
            kept.put(compared(options.seed, number, options.evaluations))
    rows = kept.own
    text = markdown(rows, state_notes([_grid_state(row) for row in rows], state))
    write_text(options.out / "placement_brute_force.md", text)
    print(text, end="")
    return 0


def _grid_state(row: dict[str, Any]) -> str | None:
    """State of the source that made the grid: older than that of the row where `place` was run anew."""
    return row.get("grid_state", row.get("state"))


if __name__ == "__main__":
    sys.exit(main())
