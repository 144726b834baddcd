"""Price of a tolerance: plans within it against plans of the world as described; samples within it.

The eight cases with the effective base within `workshop`, three arms on carts within `site`. Of every plan
within a tolerance, random instants with random deviations are solved exactly: none may lose a contact. With
everything exaggerated by 10 % the worst should lose one: then the bounds are not idle.

    python -m studies.tolerance.run --out results [--starts 2] [--samples 10000] [--tasks B "UR5 on a cart"]

Goes on: finished rows are kept.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, PlanningError
from ocptip.basics.write import write_text
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.support import Support
from ocptip.motion.plan import MotionPlan, plan_motion
from ocptip.motion.task import MotionTask
from ocptip.motion.within_tolerance import worst_within
from ocptip.published.cases import motion_cases
from ocptip.published.tasks import experiment_task
from ocptip.standing.tolerance import NONE, PRESETS
from ocptip.task_files.motion import load_task
from studies.common import (
    EXAMPLES,
    PLANNING,
    RowFile,
    ended,
    number,
    percent,
    say,
    source_state,
    state_notes,
    table,
)
from studies.tolerance.samples import lost

BEYOND = 1.1  # everything off by so much of the tolerance
CART = {"mass": 60.0, "half": 0.30, "friction": 0.6}


def on_cart(case: str) -> MotionTask:
    """The arm of a published case on four feet under a heavy base."""
    task = experiment_task(case, "effective")
    own, half = task.robot.support, CART["half"]
    height = own.contacts[0].position[2]
    feet = [
        UnilateralContact(position=[x * half, y * half, height], friction=CART["friction"])
        for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    support = Support(feet, mass=CART["mass"], center_of_mass=[0, 0, height / 2], gravity=own.gravity)
    robot = task.robot.varied(support=support)
    return replace(task, name=f"arm of {case} on a cart", robot=robot, reference=None, source=None)


def tasks() -> dict[str, tuple[MotionTask, str]]:
    """All tasks by name, with the name of their tolerance."""
    found = {name: (experiment_task(name, "effective"), "workshop") for name in motion_cases()}
    found["UR5 on a cart"] = load_task(EXAMPLES / "tasks" / "ur5_cart.toml"), "site"
    for case in ("A", "D"):
        task = on_cart(case)
        found[task.name] = task, "site"
    return found


def planned(task: MotionTask, starts: int) -> tuple[dict[str, Any], MotionPlan | None]:
    """A row's entries about a plan, and the plan."""
    began = time.process_time()
    try:
        plan = plan_motion(task, starts=starts, jobs=1)
    except (InputError, PlanningError) as error:
        return {"refused": f"{error}"}, None
    verified = sum(start.verified for start in plan.starts)
    seconds = time.process_time() - began
    return {
        "energy_J": plan.energy,
        "duration_s": plan.duration,
        "verified": verified,
        "cpu_s": seconds,
    }, plan


def row(name: str, task: MotionTask, preset: str, starts: int, samples: int) -> dict[str, Any]:
    """Everything found for one task."""
    tolerance = PRESETS[preset]
    nominal, _ = planned(replace(task, limits=replace(task.limits, tolerance=NONE)), starts)
    within, plan = planned(replace(task, limits=replace(task.limits, tolerance=tolerance)), starts)
    found = {"task": name, "preset": preset, "nominal": nominal, "within": within}
    if plan is None:
        return found
    assert plan.check.within is not None  # it was planned so
    robot, motion = plan.task.robot, plan.motion
    times = np.linspace(0, motion.end, 400)
    beyond = worst_within(robot, motion, tolerance.scaled(BEYOND), times)
    worst = plan.check.within.to_dict()
    gone = lost(robot, motion, tolerance, np.random.default_rng(0), samples)
    loses = max(beyond.slip.value, beyond.tip.value if beyond.tip else 0.0) > 1
    return {**found, "worst": worst, "lost": gone, "beyond_loses": bool(loses)}


def markdown(rows: Sequence[dict[str, Any]], samples: int, notes: list[str]) -> str:
    """The table and what it says."""
    lines, prices = [], []
    for r in rows:
        nominal, within = r["nominal"], r["within"]
        ratios = [
            within[key] / nominal[key] - 1 if key in within and key in nominal else None
            for key in ("energy_J", "duration_s", "cpu_s")
        ]
        if r["preset"] == "workshop" and ratios[0] is not None:
            prices.append(ratios[0])
        costs = [percent(ratios[0], 1), percent(ratios[1], 1)]
        costs.append(number(None if ratios[2] is None else 1 + ratios[2], 1))
        energies = [number(entry.get("energy_J"), 1) for entry in (nominal, within)]
        beyond = {True: "yes", False: "no", None: "-"}[r.get("beyond_loses")]
        lines.append([r["task"], r["preset"], *energies, *costs, str(r.get("lost", "-")), beyond])
    head = [
        "task",
        "tolerance",
        "nominal J",
        "within J",
        "energy",
        "duration",
        "CPU x",
        "lost",
        "+10 % loses",
    ]
    text = ["# Price of tolerances", "", *table(head, lines, left=2), ""]
    text += [f"- {r['task']}: {r['within']['refused']}" for r in rows if "refused" in r["within"]]
    if prices:
        middle = percent(float(np.median(prices)), 1)
        text.append(f"- Median price in energy of the published cases within `workshop`: {middle}.")
    text.append(f"- Lost: of {samples} random instants with random deviations within the tolerance per plan.")
    return "\n".join([*text, *notes]) + "\n"


def run(out: Path, names: Sequence[str] | None, starts: int, samples: int) -> str:
    """Compute what is missing, write the table."""
    out.mkdir(parents=True, exist_ok=True)
    file = RowFile(
        out / "tolerance.json",
        {"starts": starts, "samples": samples},
        ("task", "preset"),
        source_state(*PLANNING),
    )
    for name, (task, preset) in tasks().items():
        if (names is None or name in names) and file.find(task=name, preset=preset) is None:
            say(f"{name}, {preset}")
            file.put(row(name, task, preset, starts, samples))
    rows = file.own
    text = markdown(rows, samples, state_notes([r.get("state") for r in rows], file.state))
    write_text(out / "tolerance.md", text)
    return text


def main(argv: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--starts", type=int, default=2, help="of every plan")
    parser.add_argument("--samples", type=int, default=10_000, help="per plan")
    parser.add_argument("--tasks", nargs="+", help="only these")
    given = parser.parse_args(argv)
    return ended(
        "tolerance",
        lambda: run(given.out, given.tasks, given.starts, given.samples),
        "finished rows are kept.",
    )


if __name__ == "__main__":
    sys.exit(main())
