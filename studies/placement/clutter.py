"""`place` with its default options among walls and pillars, from many seeds; and how its time grows.

Odd tasks are for the UR5 on its cart (four braked wheels, full redistribution), even ones for the modular
arm FP1W2F on three feet; one to three gripper poses each. Poses, process force, wall, pillars near the poses,
zones kept free for the base, slope of the ground and weights are random; all constraints are on. One more
task, `ur5_among_pillars.toml`, is a hard one that is not random. "Best known" is the best that any of the
runs has found, those with more starts and samples among them. Then the time of one run is measured with 1 to
20 process forces and 1 to 8 poses of the UR5 that drills into a wall.

    python -m studies.placement.clutter --out results [--uncertainty none] [--tasks 10] [--sets 10]
        [--thorough 2] [--seed 0]

Within another uncertainty (`--uncertainty workshop`) it runs the same tasks, without times, and writes
placement_clutter_workshop. Every finished run is kept in the JSON file with the state of the source that
made it; start again to go on, with --again to run `place` anew with default options. Times are CPU seconds.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import PlanningError
from ocptip.basics.write import versions, write_text
from ocptip.placement.place import place
from ocptip.placement.problem import (
    GripperTask,
    PlacementLimits,
    PlacementProblem,
    ProcessLoad,
    Weights,
    sampled_loads,
)
from ocptip.placement.terrain import plane
from ocptip.robots.geometry import Pillar, Wall
from ocptip.task_files.placement import PlacementTask, load_placement
from ocptip.task_files.tables.tolerance import load_tolerance
from studies.common import (
    EXAMPLES,
    PLACING,
    RowFile,
    say,
    software,
    source_state,
    state_notes,
    table,
)
from studies.placement.brute_force import robots

CLOSE = 0.01  # of the best known total
THOROUGH = {"starts": 24, "samples": 16000}
AMONG_PILLARS = Path(__file__).parent / "ur5_among_pillars.toml"
DRILLING = EXAMPLES / "tasks" / "place_ur5_wall.toml"
FORCES, POSES = (1, 5, 10, 20), (1, 2, 4, 8)
TIMINGS = 3  # seeds per time
CONE = 15.0  # degrees, half angle of the cone of the process forces
LINE = 0.4  # m, length of the line of poses along the wall
MOST = 40  # random tasks tried per task wanted


def cluttered(seed: int, number: int) -> PlacementProblem:
    """A task; number 1, 2, ... counts tasks of a seed. It may have no solution."""
    rng = np.random.default_rng([seed, number])
    modular, ur5 = robots()
    robot, size = (ur5, 1.0) if number % 2 else (modular, 0.5)
    height = 0.75 if number % 2 else 0.3
    middle = np.array([0.0, 0.0, height + size * rng.uniform(0.0, 0.5)])
    tasks: list[GripperTask] = []
    facing = 0.0  # later poses look the same way, roughly
    for i in range(1 + (number - 1) // 2 % 3):
        position = middle + size * rng.uniform(-0.15, 0.15, 3) * (i > 0)
        down, side = rng.uniform(0, np.pi / 2), rng.uniform(-np.pi, np.pi)
        facing, turn = (facing, 0.3 * rng.normal()) if i else (side, 0.0)
        tool = Rotation.from_euler("ZYX", [facing + turn, np.pi / 2 + down, rng.uniform(-np.pi, np.pi)])
        push = rng.normal(size=3)
        force = rng.uniform(10, 30 if size < 1 else 90) * push / np.linalg.norm(push)
        load = ProcessLoad(force, rng.normal(size=3) * size, name="push")
        tasks.append(GripperTask(position, tool.as_matrix(), [load], name=f"pose {i + 1}"))
    obstacles = [_wall(rng.uniform(-np.pi, np.pi), size * rng.uniform(0.35, 0.7), "wall 1")]
    obstacles += [
        Pillar(_beside(rng, size, 0.3, 1.1), size * rng.uniform(0.04, 0.12), name=f"pillar {k + 1}")
        for k in range(rng.integers(4, 8))
    ]
    keep_out = [
        Pillar(_beside(rng, size, 0.5, 0.9), size * rng.uniform(0.05, 0.15), name=f"zone {k + 1}")
        for k in range(rng.integers(1, 4))
    ]
    slope = np.tan(np.deg2rad(rng.uniform(0, 5))) * _direction(rng.uniform(-np.pi, np.pi))[:2]
    return PlacementProblem(
        robot,
        tasks,
        plane(slope),
        weights=Weights(*rng.dirichlet(np.ones(4))),
        limits=PlacementLimits(
            GN=0.9, GT=0.9, clearance=0.01, base_clearance=0.02, condition=40.0, jacobian_length=0.4 * size
        ),
        obstacles=obstacles,
        keep_out=keep_out,
    )


def _direction(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def _wall(angle: float, distance: float, name: str) -> Wall:
    return Wall(_direction(angle), distance, name)


def _beside(rng: np.random.Generator, size: float, near: float, far: float) -> np.ndarray:
    """A point on the ground between `near` and `far` of a size away from the poses."""
    return size * rng.uniform(near, far) * _direction(rng.uniform(-np.pi, np.pi))


def drilling(forces: int, poses: int) -> PlacementProblem:
    """The UR5 that drills into a wall, with process forces in a cone and poses along a line on the wall."""
    problem = load_placement(DRILLING).problem
    drill = problem.tasks[0]
    thrust = drill.loads[0]
    loads = (thrust,)
    if forces > 1:
        size = float(np.linalg.norm(thrust.force))
        loads = sampled_loads(size, forces, axis=thrust.force, half_angle=np.deg2rad(CONE))
    shifts = LINE * (np.arange(poses) / max(poses - 1, 1))
    tasks = [
        replace(drill, position=drill.position - [0.0, shift, 0.0], loads=loads, name=f"hole {k + 1}")
        for k, shift in enumerate(shifts)
    ]
    return replace(problem, tasks=tasks)


def run(problem: PlacementProblem, seed: int, **options: int) -> dict[str, Any]:
    """What `place` finds from one seed, and its time."""
    cpu = time.process_time()
    try:
        result = place(problem, seed=seed, **options)
        entry: dict[str, Any] = {"total": result.best.total, "parameters": result.best.parameters}
        entry |= {"programs": len(result.starts), "iterations": sum(s.iterations for s in result.starts)}
    except PlanningError as error:
        entry = {"total": None, "reason": str(error)}
    return entry | {"cpu_seconds": time.process_time() - cpu}


class Study:
    """Rows of runs, each computed once.

    Args:
        rows: where they are.
        again: runs with default options are made anew where another state of the source has made them.
    """

    def __init__(self, rows: RowFile, again: bool) -> None:
        self.rows, self._again = rows, again

    def rows_of(self, task: str, kind: str) -> list[dict[str, Any]]:
        """Finished runs of a task, of one kind."""
        return [row for row in self.rows.own if row["task"] == task and row["kind"] == kind]

    def runs(self, task: str, problem: PlacementProblem, kind: str, number: int) -> list[dict[str, Any]]:
        """Runs of a kind ("default", "thorough" or "time") with seeds 0, 1, ..."""
        for start_seed in range(number):
            identity = {"task": task, "kind": kind, "start_seed": start_seed}
            kept = self.rows.find(**identity)
            outdated = self._again and kind != "thorough" and kept and kept["state"] != self.rows.state
            if kept is None or outdated:
                say(f"{task}, {kind}, seed {start_seed} ...")
                self.rows.put(identity | run(problem, start_seed, **(THOROUGH if kind == "thorough" else {})))
        return self.rows_of(task, kind)[:number]

    def compare(self, task: str, problem: PlacementProblem, sets: int, thorough: int) -> bool:
        """Make all runs of a task; whether it has a solution."""
        if self.runs(task, problem, "thorough", 1)[0]["total"] is None:
            return False
        self.runs(task, problem, "thorough", thorough)
        self.runs(task, problem, "default", sets)
        return True


def excess(rows: list[dict[str, Any]], best: float) -> list[float]:
    """How much worse than the best known total each run is, relative; infinite where it found none."""
    return [np.inf if row["total"] is None else row["total"] / best - 1 for row in rows]


def markdown(study: Study, random: list[str], further: list[str]) -> str:
    """The tables of runs among obstacles and of times."""
    cells, fine, cpu = [], [], []
    for task in [*random, *further]:
        default, thorough = study.rows_of(task, "default"), study.rows_of(task, "thorough")
        best = min(row["total"] for row in default + thorough if row["total"] is not None)
        worse = excess(default, best)
        close = sum(value <= CLOSE for value in worse)
        seconds = [row["cpu_seconds"] for row in default]
        if task in random:
            fine += [value <= CLOSE for value in worse]
            cpu += seconds
        most = "none found" if np.isinf(max(worse)) else f"{100 * max(worse):+.2f} %"
        times = [f"{np.median(s):.1f}" for s in (seconds, [row["cpu_seconds"] for row in thorough])]
        cells.append([task, f"{best:.5f}", f"{close} of {len(worse)}", most, *times])
    head = ["task", "best known", f"within {100 * CLOSE:g} %", "worst", "CPU s", "CPU s, thorough"]
    uncertainty = study.rows.options["uncertainty"]
    within = "" if uncertainty == "none" else f", within `{uncertainty}`"
    lines = [f"# `place` among obstacles, default options{within}", "", *table(head, cells)]
    if random:
        lines += [
            "",
            f"{sum(fine)} of {len(fine)} runs of the {len(random)} random tasks are within {100 * CLOSE:g} % "
            f"of the best known total; median {np.median(cpu):.1f} s of CPU, largest {max(cpu):.1f} s. "
            f"Thorough: {THOROUGH['starts']} starts, {THOROUGH['samples']} samples.",
        ]
    times = []
    for task in dict.fromkeys(row["task"] for row in study.rows.own if row["kind"] == "time"):
        rows = study.rows_of(task, "time")
        seconds = [row["cpu_seconds"] for row in rows]
        iterations = f"{np.median([row['iterations'] for row in rows]):.0f}"
        times.append([task, f"{np.median(seconds):.1f}", f"{max(seconds):.1f}", iterations])
    head = ["task", "CPU s, median", "largest", "iterations"]
    if times:
        lines += ["", "# Time with many forces and poses", "", *table(head, times)]
    lines += ["", f"- {software(versions())}.", f"- Seed of the tasks {study.rows.options['seed']}."]
    lines += state_notes([row.get("state") for row in study.rows.own], study.rows.state, "runs")
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--uncertainty", default="none", help="preset or TOML file (none)")
    parser.add_argument("--tasks", type=int, default=10, help="random tasks with a solution (10)")
    parser.add_argument("--sets", type=int, default=10, help="seeds of `place` per task (10)")
    parser.add_argument("--thorough", type=int, default=2, help="runs with more starts and samples (2)")
    parser.add_argument("--seed", type=int, default=0, help="of the random tasks")
    parser.add_argument("--again", action="store_true", help="make default runs of older sources anew")
    options = parser.parse_args(arguments)
    if options.tasks < 0 or options.sets < 1 or options.thorough < 1:
        parser.error("--sets and --thorough must be at least 1, --tasks at least 0")
    options.out.mkdir(parents=True, exist_ok=True)
    identity, state = ("task", "kind", "start_seed"), source_state(*PLACING)
    tolerance, name = load_tolerance(options.uncertainty), Path(options.uncertainty).stem
    stem = "placement_clutter" if name == "none" else f"placement_clutter_{name}"
    given = {"seed": options.seed, "uncertainty": name}
    rows = RowFile(options.out / f"{stem}.json", given, identity, state)

    def within(problem: PlacementProblem) -> PlacementProblem:
        return PlacementTask("", problem, problem.tolerance).within(tolerance).problem

    study, random = Study(rows, options.again), []
    for number in islice(count(1), MOST * options.tasks):
        if len(random) == options.tasks:
            break
        problem = within(cluttered(options.seed, number))
        name = f"{number}: {problem.robot.arm.name}, {len(problem.tasks)} poses"
        if study.compare(name, problem, options.sets, options.thorough):
            random.append(name)
    study.compare(
        AMONG_PILLARS.stem, within(load_placement(AMONG_PILLARS).problem), options.sets, options.thorough
    )
    timed = [*((n, 1) for n in FORCES), *((1, n) for n in POSES[1:])] if stem == "placement_clutter" else []
    for forces, poses in timed:
        study.runs(f"{forces} forces, {poses} poses", drilling(forces, poses), "time", TIMINGS)
    text = markdown(study, random, [AMONG_PILLARS.stem])
    write_text(options.out / f"{stem}.md", text)
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
