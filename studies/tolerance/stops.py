"""Price of stops: plans that may be stopped at any instant against those that need not; what a check takes.

Categories of IEC 60204-1: 1 along the path, 0 by brakes of 1.2 to 1.5 times what holds the arm in the plan
without (at least 0.12 to 0.15 times the largest of these torques). As described, and within `workshop`.

    python -m studies.tolerance.stops --out results [--starts 2] [--seed 0] [--only NAME ...] [--seconds S]

Goes on: finished rows are kept. CPU times are those of one process, of the second of two calls for checks.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, PlanningError
from ocptip.basics.write import versions, write_text
from ocptip.motion.check import check_motion
from ocptip.motion.motion_plan import MotionPlan
from ocptip.motion.plan import plan_motion
from ocptip.motion.stops.check import check_stops
from ocptip.motion.stops.rules import StopRules
from ocptip.motion.task import MotionTask
from ocptip.published.tasks import experiment_task
from ocptip.standing.arm import Robot
from ocptip.standing.stops.by_brakes import stops_of_motion
from ocptip.standing.tolerance import PRESETS
from ocptip.task_files.motion import load_task
from studies.common import (
    EXAMPLES,
    PLANNING,
    RowFile,
    ended,
    number,
    percent,
    say,
    software,
    source_state,
    state_notes,
    table,
)

BRAKES, LEAST = (1.2, 1.5), (0.12, 0.15)
KINDS = {"along the path": "path", "by brakes": "brakes"}
WITHIN = ("none", "workshop")
GRID = 400  # instants at which the torques that hold the arm are looked at


def heavier(task: MotionTask, mass: float) -> MotionTask:
    """The task on a base of this mass, kg."""
    own = task.robot.support
    support = own.varied(own.contacts, mass=mass)
    return replace(task, robot=task.robot.varied(support=support), reference=None, source=None)


def tasks() -> dict[str, tuple[Callable[[], MotionTask], tuple[str, ...]]]:
    """How to make every task, and the kinds of stops it is planned for."""
    path, both = ("along the path",), tuple(KINDS)
    ur5 = EXAMPLES / "tasks" / "ur5_cart.toml"
    return {
        "A": (lambda: experiment_task("A", "effective"), path),
        "G": (lambda: experiment_task("G", "effective"), path),
        "A on 60 kg": (lambda: heavier(experiment_task("A", "effective"), 60.0), both),
        "A on 100 kg": (lambda: heavier(experiment_task("A", "effective"), 100.0), ("by brakes",)),
        "UR5 on a cart": (lambda: load_task(ur5), path),
        "UR5 on a cart of 60 kg": (lambda: heavier(load_task(ur5), 60.0), both),
        "UR5 on a cart of 110 kg": (lambda: heavier(load_task(ur5), 110.0), ("by brakes",)),
    }


def rules_of(plan: MotionPlan) -> StopRules:
    """Brakes a little stronger than what holds the arm wherever the plan goes."""
    robot = plan.task.robot
    q = plan.motion.states(np.linspace(0, plan.motion.end, GRID))[0]
    holds = np.max(np.abs(robot.loads(q, 0 * q, 0 * q)[0]), axis=0)
    least, greatest = (
        np.maximum(share * holds, floor * holds.max()) for share, floor in zip(BRAKES, LEAST, strict=True)
    )
    return StopRules(brake_min=least, brake_max=greatest)


def planned(task: MotionTask, starts: int, seed: int) -> tuple[dict[str, Any], MotionPlan | None]:
    """Energy, duration and CPU time of a plan, or why there is none."""
    began = time.process_time()
    try:
        plan = plan_motion(task, starts=starts, seed=seed, jobs=1)
    except (InputError, PlanningError) as error:
        return {"refused": f"{error}", "cpu_s": time.process_time() - began}, None
    row = {
        "energy_J": plan.energy,
        "duration_s": plan.duration,
        "rise_s": max(plan.motion.rise_times, default=0.0),
        "verified": sum(start.verified for start in plan.starts),
        "cpu_s": time.process_time() - began,
    }
    return row, plan


def looked_at(plan: MotionPlan, rules: StopRules, kind: str) -> dict[str, Any]:
    """Worst values of stops of a plan, the least safe share of its speed, and what the look takes."""
    robot, seconds = plan.task.robot, np.inf
    limits = rules.safe(plan.task.limits.without_stops, robot, KINDS[kind])
    for _ in range(2):
        stops_of_motion.cache_clear()
        plain = time.process_time()
        check_motion(robot, plan.motion, limits.without_stops)
        began = time.process_time()
        checked = check_motion(robot, plan.motion, limits)
        found = check_stops(robot, plan.motion, limits, rules, checked, KINDS[kind])
        seconds = max(time.process_time() - began - (began - plain), 0.0)
    speeds = found.speeds[KINDS[kind]]
    worst = found.worst[KINDS[kind]]
    return {
        "kept": found.verified,
        "GN_stop": worst.get("GN"),
        "GT_stop": worst.get("GT"),
        "safe_speed": float(np.min(speeds)),
        "look_cpu_s": seconds,
    }


def rows_of(name: str, starts: int, seed: int, file: RowFile) -> Iterator[dict[str, Any]]:
    """What is missing of a task."""
    make, kinds = tasks()[name]
    for within in WITHIN:
        wanted = [(kind, with_) for kind in kinds for with_ in (False, True)]
        if all(file.find(task=name, within=within, kind=k, stopped=w) is not None for k, w in wanted):
            continue
        task = make()
        task = replace(task, limits=replace(task.limits, tolerance=PRESETS[within]))
        say(f"{name}, {within}")
        without, plan = planned(task, starts, seed)
        rules = StopRules() if plan is None else rules_of(plan)
        for kind in kinds:
            key = {"task": name, "within": within, "kind": kind}
            yield {**key, "stopped": False, **without, **(looked_at(plan, rules, kind) if plan else {})}
            if plan is None:
                continue
            say(f"{name}, {within}, {kind}")
            assert isinstance(task.robot, Robot)
            asked = replace(task, limits=rules.safe(task.limits, task.robot, KINDS[kind]), stops=rules)
            row, stopped = planned(asked, starts, seed)
            yield {**key, "stopped": True, **row, **(looked_at(stopped, rules, kind) if stopped else {})}


def markdown(rows: Sequence[dict[str, Any]], notes: list[str]) -> str:
    """A row per task, tolerance and kind of stops."""
    lines, looks = [], []
    for row in (row for row in rows if not row["stopped"]):
        same = {key: row[key] for key in ("task", "within", "kind")}
        fit = [own for own in rows if own["stopped"] and all(own[k] == v for k, v in same.items())]
        price = cost = None
        if fit and "energy_J" in fit[0] and "energy_J" in row:
            price = fit[0]["energy_J"] / row["energy_J"] - 1
        if fit:
            cost = fit[0]["cpu_s"]
        own = fit[0] if fit else {}
        looks += [one["look_cpu_s"] for one in (row, own) if "look_cpu_s" in one]
        broken = "no plan" if "refused" in row else "nothing" if row["kept"] else _worst(row)
        lines.append(
            [
                *same.values(),
                broken,
                number(row.get("safe_speed"), 2),
                number(row.get("energy_J"), 1),
                "no plan" if "refused" in own else number(own.get("energy_J"), 1),
                percent(price, 1),
                number(own.get("safe_speed"), 2),
                f"{own['verified']}" if "verified" in own else "-",
                number(row["cpu_s"], 0),
                number(cost, 0),
            ]
        )
    head = ["task", "within", "stops", "broken without", "safe speed", "J without", "J with", "price"]
    head += ["safe speed", "starts verified", "CPU s without", "CPU s with"]
    text = ["# Price of stops", "", *notes, "", *table(head, lines, left=4), ""]
    if looks:
        median, most = np.median(looks), np.max(looks)
        what = f"looking at all stops of a plan, table of safe speeds included: median {median:.2f} s"
        text.append(f"- CPU time of {what}, at most {most:.2f} s ({len(looks)} looks).")
    refused = {f"{row['task']}, {row['within']}, {row['kind']}": row.get("refused") for row in rows}
    text += [f"- No plan: {name} ({why})" for name, why in refused.items() if why]
    return "\n".join(text) + "\n"


def _worst(row: dict[str, Any]) -> str:
    name = max(("GN_stop", "GT_stop"), key=lambda key: row[key] or 0.0)
    return f"{name[:2]} {row[name]:.2f}"


def run(out: Path, starts: int, seed: int, names: Sequence[str] | None, seconds: float) -> str:
    """Compute what is missing, task by task, and write the table."""
    out.mkdir(parents=True, exist_ok=True)
    state = source_state(*PLANNING)
    file = RowFile(
        out / "stops.json",
        {"starts": starts, "seed": seed, "brakes": list(BRAKES)},
        ("task", "within", "kind", "stopped"),
        state,
    )
    began = time.monotonic()
    for name in names or tasks():
        if time.monotonic() - began < seconds:
            for row in rows_of(name, starts, seed, file):
                file.put(row)
    rows = file.own
    notes = [
        f"{software(versions(('numpy', 'casadi')))}; {starts} starts, seed {seed}, one process; best found. "
        "Broken without: the worst value in a stop of the plan that need not be stopped. Safe speed: the "
        "least, over time, of the largest shares of the planned speed from which a stop keeps the limits."
    ]
    text = markdown(rows, notes) + "\n".join(state_notes([r.get("state") for r in rows], state)) + "\n"
    write_text(out / "stops.md", text)
    return text


def main(argv: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--starts", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", help="only these tasks")
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no task after so long")
    given = parser.parse_args(argv)
    return ended(
        "stops",
        lambda: run(given.out, given.starts, given.seed, given.only, given.seconds),
        "finished rows are kept.",
    )


if __name__ == "__main__":
    sys.exit(main())
