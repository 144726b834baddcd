"""Seven axes: the plan whose start and goal postures are optimised, against plans between random postures.

    python -m studies.postures.redundancy --out FOLDER [--packages DIR ...] [--tasks 2] [--random 50]

A Panda and an xArm7 (package example-robot-data) on a platform with four feet move from a random gripper pose
to another. `plan_motion` with default options against the best of 50 plans, each from a random posture of the
first pose to a random posture of the second (one start each; pairs that do not stand are drawn again; those
whose plainest motions cost 1.3 times as much as the cheapest pair's are not planned, see `hopeless`). Goes on
where it was interrupted. Writes redundancy.jsonl and postures_redundancy.md.
"""

from __future__ import annotations

import argparse
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import PlanningError
from ocptip.basics.write import versions, write_text
from ocptip.certificate.checks import certified
from ocptip.motion.plan import plan_motion
from ocptip.motion.planner.one_start import Search
from ocptip.motion.task import MotionTask, refusals
from ocptip.numerics.threads import one_thread
from ocptip.robots.inverse.joint_angles import within_limits
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.task_files.motion import load_task
from studies.common import JsonLines, progress, software, table
from studies.foreign_arms.run import package_folder, task_text, template_of
from studies.postures.tasks import FAR, NEAR, hopeless, pose_task, standing_posture

SEVEN = ("Panda, hand", "xArm7")
ARMS = Path(__file__).parent.parent / "foreign_arms" / "arms.toml"
DEAR = 1.3  # in all tasks of `run` the cheapest pair's plainest motion is within 1.05 of the least
RADIUS = 0.05  # m, of the collision spheres


@cache
def seven_axes(name: str, packages: tuple[Path, ...]) -> tuple[Robot, Limits]:
    """A robot, and the limits of its tasks."""
    arm = next(arm for arm in tomllib.loads(ARMS.read_text())["arm"] if arm["name"] == name)
    urdf = package_folder(arm["package"], packages) / arm["urdf"]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "task.toml"
        path.write_text(task_text(arm, template_of(arm, urdf, path.parent), 0.0, {}, spheres=RADIUS))
        task = load_task(path)
    assert isinstance(task.robot, Robot)
    return task.robot, task.limits


def redundant_task(number: int, seed: int, packages: Sequence[Path]) -> MotionTask:
    """From a random gripper pose to another."""
    name = SEVEN[number % len(SEVEN)]
    rng = np.random.default_rng([seed, number, 7])
    robot, limits = seven_axes(name, tuple(packages))
    while True:
        start, goal = (standing_posture(robot, limits, rng) for _ in range(2))
        if NEAR <= np.max(np.abs(goal - start)[:3]) <= FAR:
            return pose_task(f"{name} {number}", robot, limits, None, start, goal)


def random_pairs(task: MotionTask, count: int, seed: int) -> list[MotionTask]:
    """The task between random postures that stand."""
    assert isinstance(task.robot, Robot)
    arm, rng = task.robot.arm, np.random.default_rng(seed)
    postures = []
    for target in task.targets:
        assert target is not None
        found = np.vstack([target.postures(arm, seed=seed + k) for k in range(3)])
        postures.append(found)
    result: list[MotionTask] = []
    while len(result) < count:
        start, goal = (found[rng.integers(len(found))] for found in postures)
        near = within_limits(arm, goal, start)
        one = replace(task, start=start, goal=near, choices=(), targets=(None, None))
        if not refusals(one):
            result.append(one)
    return result


def rows_of(number: int, options: argparse.Namespace, lines: JsonLines) -> list[dict[str, Any]]:
    """The plan (kind "plan") and the plans between random postures (kind "random") of a task."""
    known = {(row["kind"], row["k"]): row for row in lines.read() if row["task"] == number}
    task = redundant_task(number, options.seed, options.packages)
    pairs = random_pairs(task, options.random, options.seed)
    without = hopeless(pairs, DEAR)
    for kind, k in [("plan", 0), *(("random", k) for k in range(options.random))]:
        if (kind, k) in known:
            continue
        row: dict[str, Any] = {"task": number, "name": task.name, "kind": kind, "k": k, "energy": None}
        with one_thread:
            if kind == "plan":
                try:
                    plan = plan_motion(task, starts=8, seed=options.seed, jobs=1, prove=certified)
                    row |= {"energy": plan.energy, "cpu": sum(start.cpu_seconds for start in plan.starts)}
                except PlanningError as error:
                    row["status"] = str(error)
            elif k in without:
                row["status"] = "not planned"
            else:
                found = Search(pairs[k]).run(k, options.seed).result
                row |= {"energy": found.energy if found.verified else None, "cpu": found.cpu_seconds}
        lines.append(row)
        known[kind, k] = row
        progress(len(known), options.random + 1, task.name)
    return list(known.values())


def report(rows: list[list[dict[str, Any]]]) -> str:
    """A table, one line per task."""
    lines = []
    for own in rows:
        plan = next(row["energy"] for row in own if row["kind"] == "plan")
        others = [row["energy"] for row in own if row["kind"] == "random" and row["energy"] is not None]
        best, middle = min(others), float(np.median(others))
        above = f"{100 * (plan / best - 1):+.1f} %" if plan else "-"
        numbers = [f"{plan:.2f}" if plan else "-", f"{best:.2f}", f"{middle:.1f}", above, str(len(others))]
        lines.append([own[0]["name"], *numbers])
    head = ["task", "plan, J", "best random, J", "median random, J", "plan against best", "verified"]
    return "\n".join(table(head, lines))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--packages", type=Path, nargs="*", default=[])
    parser.add_argument("--tasks", type=int, default=2)
    parser.add_argument("--random", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    lines = JsonLines(options.out / "redundancy.jsonl")
    found = report([rows_of(number, options, lines) for number in range(options.tasks)])
    note = f"Seed {options.seed}, {options.random} random pairs of postures. {software(versions())}."
    write_text(
        options.out / "postures_redundancy.md", f"# Seven axes: optimised postures\n\n{found}\n\n{note}\n"
    )


if __name__ == "__main__":
    main()
